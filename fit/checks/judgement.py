"""All checks of a law, and its verdict.

Each check stands alone: one that raises is reported as not computed, with its reason, and costs only itself. Checks
that leave out, resample or compare do it by edge where edges have several rows. The tests of all laws of a file are
counted together (Holm's procedure), so that a sound file is rarely accused.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import isclose

import numpy as np
from pandas import DataFrame

from ...core.display import Plottable
from ...core.errors import UsageError
from ...core.threads import one_thread
from ...core.verdict import RESERVATIONS, Verdict, verdict_from
from ...datasets.runs import Readable, Runs, as_runs
from ...datasets.vocabulary import FLANK_WEAR
from ..available import NotAvailable, computed
from ..composite_law import without_fixed
from ..lawfit import LawFit
from . import tool_lives
from .agreement import compare_estimates, fixed_exponents
from .autocorrelation import aliased_columns, drift, serial_correlation
from .check import FAMILY_LEVEL, TITLES, Check, Suspect, family_wise, frame_of_checks, sentences
from .competing_models import preferable_form
from .deletion_diagnostics import Deletion, DeterminesAlone, deletion, influence, precision, press, sole_unit
from .missing_factors import missing_conditions, unused_columns
from .model_checks import collinearity, curvature, lack_of_fit
from .physics import exponents, possible_values
from .residual_tests import Residuals, normality, residual_sets, spread
from .response_scale import box_cox, error_structure
from .strata import MOST_ROWS, Strata, even_choice, has_repeated_edges, split, without_found, without_suspects
from .time_offsets import time_restarts, time_tests
from .usefulness import (
    doubts_of_reading,
    form_first,
    limited_readings,
    number_of_edges,
    order_of_reason,
    predictive_use,
)
from .within_edges import lack_of_fit_within
from .wrong_edges import mixed_units, outlying_edges
from .wrong_rows import copies, outlying_rows, sensor_limit

Found = Check | NotAvailable
SAME, SOME = 1e-9, 50  # relative difference of equal values, and rows that are compared
WITHOUT_ROWS = (
    "The law was fitted to a stream and keeps no rows, so its residuals were not checked: fit a sample in memory."
)


@dataclass(frozen=True)
class CheckInput:
    """A law with what its checks share.

    Attributes
    ----------
    asked : LawFit
        The law.
    whole, law : LawFit
        The law without its fixed exponents (`without_fixed`), and that of at most 5000 of its rows, evenly spaced.
    runs : Runs or None
        The runs that it was fitted to, with the columns that it does not use.
    gauge_sd : float or None
    alternative : LawFit or None
        The law with the other error structure, where it is known.
    """

    asked: LawFit
    whole: LawFit
    law: LawFit
    runs: Runs | None = None
    gauge_sd: float | None = None
    alternative: LawFit | None = None

    @cached_property
    def strata(self) -> Strata | NotAvailable:
        """Levels of edges, and rows about them."""
        return split(self.law)

    @cached_property
    def stated(self) -> LawFit:
        """The rows of ``law`` with the fixed exponents."""
        return self.law if self.asked is self.whole else even_choice(self.asked)

    @property
    def icc(self) -> float:
        """Share of the residual variance that lies between edges, 0 where it is not estimated."""
        return self.strata.icc if isinstance(self.strata, Strata) else 0.0

    @cached_property
    def times(self) -> dict[str, Found | None]:
        """Tests of times within and between edges."""
        return time_tests(self.law, self.icc, limited_readings(self.whole, self.runs))

    @cached_property
    def left_out(self) -> Deletion | NotAvailable:
        """Effect of leaving out each edge, or each row where they are independent."""
        return deletion(self.law, self.strata)

    @cached_property
    def residuals(self) -> tuple[Residuals | NotAvailable, Residuals | NotAvailable]:
        """Residuals of rows, and of edges."""
        return residual_sets(self.law, self.strata)

    @cached_property
    def wrong_rows(self) -> Found | None:
        """Outlying rows, among all rows."""
        return computed(partial(outlying_rows, self.whole, self.runs))

    @cached_property
    def right_rows(self) -> tuple[LawFit, Strata | NotAvailable]:
        """The law without outlying rows, and its strata."""
        return without_found(self.law, suspects_of(self.wrong_rows), self.strata)

    @cached_property
    def mixed_units(self) -> Found | None:
        """Edges with a condition in another unit."""
        return computed(partial(mixed_units, *self.right_rows, self.runs))

    @cached_property
    def one_unit(self) -> tuple[LawFit, Strata | NotAvailable]:
        """The law without outlying rows and without edges in another unit, and its strata."""
        return without_found(self.right_rows[0], suspects_of(self.mixed_units), self.right_rows[1])


def suspects_of(found: Found | None) -> tuple[Suspect, ...]:
    """The suspects of a check."""
    return found.suspects if isinstance(found, Check) else ()


@dataclass(frozen=True, slots=True, repr=False)
class Judgement(Plottable):
    """Checks of a law, and its verdict.

    Attributes
    ----------
    checks : dict of Check or NotAvailable
        By the keys of ``check.TITLES``; a check that these data do not allow is its reason.
    rows_are_independent : bool
        Whether no edge has more than one row, or the file names no edges.
    nobs : int
        Rows checked: of more than 5000 an even selection, 0 of a law of a stream, which keeps none.
    without : LawFit or None
        The law fitted without the suspects; None without suspects, or where the other rows do not determine it.
    """

    checks: dict[str, Found]
    rows_are_independent: bool
    nobs: int
    without: LawFit | None = None

    @property
    def verdict(self) -> Verdict:
        """Verdict on the use of the law; the highest ``concern`` of its checks decides.

        Of equal concern, wrong rows and edges, then a wrong form, stand first: other findings may follow from them.
        """
        there = {TITLES[name]: check for name, check in self.checks.items() if isinstance(check, Check)}
        missing = {TITLES[name]: check for name, check in self.checks.items() if isinstance(check, NotAvailable)}
        failed = ", ".join(title for title, check in missing.items() if check.failed)
        unchecked = [(RESERVATIONS, f"Not checked, since the computation failed: {failed}.")] if failed else []
        unchecked += [(RESERVATIONS, WITHOUT_ROWS)] if self.nobs == 0 else []
        ordered = sorted(there.items(), key=order_of_reason)
        return verdict_from(
            [*((check.concern, check.verdict) for _, check in ordered), *unchecked],
            list(there),
            [f"{title}: {check.reason}" for title, check in missing.items()],
        )

    @property
    def suspects(self) -> tuple[Suspect, ...]:
        """Rows and edges that the checks find wrong, each once, with its correction where a check knows one."""
        found = (check for check in self.checks.values() if isinstance(check, Check) and check.concern)
        once: dict[tuple[str, tuple[str, ...], tuple[int, ...]], Suspect] = {}
        for suspect in (suspect for check in found for suspect in check.suspects):
            key = (suspect.column, suspect.edges, suspect.lines)
            if key not in once or (suspect.correction and not once[key].correction):
                once[key] = suspect
        return tuple(once.values())

    def verdicts(self, most: int = 6) -> tuple[str, ...]:
        """Sentences, at most ``most``: failed checks, warnings, checks that are not testable, passed checks.

        Raises
        ------
        UsageError
            ``most`` below 1.
        """
        return sentences(self.checks, self.rows_are_independent, most)

    def to_frame(self) -> DataFrame:
        """A row for each check: concern, statistic, p, and its verdict."""
        return frame_of_checks(self.checks)


@one_thread
def judge(
    law: LawFit,
    gauge_sd: float | None = None,
    *,
    runs: Readable | None = None,
    alternative: LawFit | None = None,
    laws: int = 1,
) -> Judgement:
    """Check a law: its exponents, form, error structure, competing models, and wrong rows and edges.

    Parameters
    ----------
    law : LawFit
    gauge_sd : float, optional
        Standard deviation of the wear gauge, in the unit of the wear; its effect on the exponent of wear is then
        checked as well.
    runs : Runs, DataFrame or path, optional
        The runs that the law was fitted to: columns that it does not use are tested, and doubts of the reading count.
    alternative : LawFit, optional
        ``law.alternative`` where it is known: fitting it again takes a sixth of the time.
    laws : int
        Laws of the file that are judged together: the level of the tests is shared among them.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> fit.judge(law).checks["collinearity"].level
    'passed'
    """
    runs = _checked(law, runs, gauge_sd, laws)
    whole = without_fixed(law)
    chosen = even_choice(whole)
    given = CheckInput(law, whole, chosen, runs, gauge_sd, alternative if chosen is law else None)
    asked = {**CHECKS, **(CHECKS_OF_LIVES if law.life else {}), **(CHECKS_OF_BOUNDS if law.not_least_squares else {})}
    done = {name: _done(name, check, given) for name, check in asked.items()}
    checks = {name: _of_column(check, law.response) for name, check in done.items() if check is not None}
    rows, level = 0 if chosen.rows is None else chosen.nobs, FAMILY_LEVEL / max(laws, 1)
    found = Judgement(form_first(family_wise(checks, level)), not has_repeated_edges(chosen), rows)
    return replace(found, without=without_suspects(law, found.suspects)) if found.suspects else found


def _checked(law: LawFit, runs: Readable | None, gauge_sd: float | None, laws: int) -> Runs | None:
    """The runs of the law, after the arguments of `judge` are checked."""
    if (gauge_sd is not None and not gauge_sd > 0) or laws < 1:
        raise UsageError(f"gauge_sd={gauge_sd}, laws={laws}: a standard deviation is above zero, and laws at least 1.")
    return None if runs is None else _of_the_fit(law, as_runs(runs))


def _holds(runs: Runs, law: LawFit) -> bool:
    """Whether the lines of the law are lines of the runs, with the same responses in the first rows."""
    if not runs.has(law.response):
        return False
    lines, first, count = np.unique(runs.lines, return_index=True, return_counts=True)
    if not np.isin(law.lines, lines).all():
        return False
    once = dict(zip(lines[count == 1].tolist(), first[count == 1].tolist(), strict=True))  # a line may be several rows
    values = runs.values(law.response)
    pairs = zip(law.lines.tolist(), law.observed.tolist(), strict=True)
    compared = [(values[once[line]], y) for line, y in pairs if line in once]
    return all(isclose(value, y, rel_tol=SAME) for value, y in compared[:SOME])


def _of_the_fit(law: LawFit, runs: Runs) -> Runs:
    """The runs, where their lines hold the rows of the law."""
    if law.rows is None or law.life is not None:  # rows of lives hold bounds that are no values of the runs
        return runs
    if not _holds(runs, law):
        raise UsageError(
            f"{law.response}: {runs.source.name} does not hold the rows of the law at their lines: give as runs what"
            " the law was fitted to, the same DataFrame or Runs."
        )
    return runs


def _of_column(check: Found, response: str) -> Found:
    """The check with suspects of the measured column, where it was of the response over fixed powers (``Fc/d``)."""
    if not isinstance(check, Check) or not any(one.column.startswith(f"{response}/") for one in check.suspects):
        return check
    named = (replace(one, column=one.column.split("/")[0]) for one in check.suspects)
    return replace(check, suspects=tuple(named))


OneCheck = Callable[[CheckInput], Found | None]


def _done(name: str, check: OneCheck, given: CheckInput) -> Found | None:
    """The result of a check; those of least squares are not available for a law that is not fitted by them."""
    why = given.law.not_least_squares
    if why and name in CHECKS and name not in (*OF_EVERY_LAW, *CHECKS_OF_LIVES, *CHECKS_OF_BOUNDS):
        return NotAvailable(f"{why}: the check is of least squares") if name in USUAL else None
    return computed(partial(check, given))


def _deleted(check: Callable[[CheckInput, Deletion], Found]) -> OneCheck:
    return lambda given: check(given, given.left_out) if isinstance(given.left_out, Deletion) else given.left_out


def _influence(given: CheckInput) -> Found:
    left = given.left_out
    if isinstance(left, DeterminesAlone):
        return sole_unit(left)
    return influence(given.law, given.strata, left) if isinstance(left, Deletion) else left


def _of_residuals(check: Callable[[CheckInput, Residuals], Found], which: int) -> OneCheck:
    def found(given: CheckInput) -> Found:
        residuals = given.residuals[which]
        return check(given, residuals) if isinstance(residuals, Residuals) else residuals

    return found


def _error_structure(given: CheckInput) -> Found | None:
    """Error structures of the rows that are not wrong: a wrong row alone would decide for additive errors."""
    law = given.right_rows[0]
    if not law.formula.logarithmic or given.asked.formula.fixed:
        return None
    return error_structure(law, given.alternative if law is given.law else None)


def _order(given: CheckInput) -> Found:
    """The test of autocorrelation; not available for a selection of rows, which lacks their neighbours."""
    if isinstance(given.strata, Strata) and given.law.nobs < given.whole.nobs:
        return NotAvailable(
            f"{given.law.nobs} of {given.whole.nobs} rows were checked, evenly spaced: neighbours on an edge are "
            f"missing; fit whole edges, {MOST_ROWS} rows at most, to test autocorrelation"
        )
    return serial_correlation(given.law, given.strata)


def _gauge(given: CheckInput) -> Found | None:
    wear = next((name for name in FLANK_WEAR if name in given.law.factors), None)
    if given.gauge_sd is None or wear is None:
        return None
    from .gauge_error import gauge_corrected

    return gauge_corrected(given.law, given.gauge_sd, wear, unit=given.law.units[wear])


# In the order of the reasons of a verdict: what is wrong in the data, physics, statistics, reading.
CHECKS: Mapping[str, OneCheck] = {
    "wrong rows": lambda given: given.wrong_rows,
    "mixed units": lambda given: given.mixed_units,
    "wrong edges": lambda given: outlying_edges(*given.one_unit, given.runs),
    "copies": lambda given: copies(given.whole),
    "sensor limit": lambda given: sensor_limit(given.whole),
    "longest lives": lambda given: tool_lives.longest_lives(given.law, given.runs),
    "limited readings": lambda given: limited_readings(given.asked, given.runs),
    "time exponent": lambda given: given.times["time exponent"],
    "time between edges": lambda given: given.times["time between edges"],
    "time within edges": lambda given: given.times["time within edges"],
    "time restarts": lambda given: time_restarts(given.law),
    "exponents": lambda given: exponents(given.asked, given.runs),
    "fixed exponents": lambda given: fixed_exponents(given.asked),
    "possible values": lambda given: possible_values(given.asked, given.runs),
    "predictive use": lambda given: predictive_use(given.stated, given.runs),
    "missing conditions": lambda given: missing_conditions(given.stated, given.runs),
    "unused columns": lambda given: unused_columns(given.stated, given.runs, given.icc),
    "aliased columns": lambda given: aliased_columns(given.stated, given.runs),
    "form": lambda given: lack_of_fit(given.law, given.strata),
    "form within edges": lambda given: lack_of_fit_within(given.law),
    "curvature": lambda given: curvature(given.law, given.strata),
    "single edges": _influence,
    "prediction": _deleted(lambda given, left: press(given.law, left)),
    "collinearity": lambda given: collinearity(given.law),
    "signal to noise": lambda given: precision(given.law, given.strata),
    "scale of the response": lambda given: box_cox(given.law, given.strata),
    "order within edges": _order,
    "order of tests": lambda given: drift(given.law, given.runs, given.icc),
    "even scatter": _of_residuals(lambda given, rows: spread(given.law, rows), 0),
    "even scatter of edges": _of_residuals(lambda given, edges: spread(given.law, edges), 1),
    "normality": _of_residuals(lambda _, rows: normality(rows), 0),
    "normality of edges": _of_residuals(lambda _, edges: normality(edges), 1),
    "error structure": _error_structure,
    "competing forms": lambda given: preferable_form(
        given.law, given.runs, lambda one: judge(one, runs=given.runs).checks
    ),
    "number of edges": lambda given: number_of_edges(given.asked, given.runs),
    "gauge error": _gauge,
    "agreement": lambda given: found if isinstance(found := compare_estimates(given.law), Check) else None,
    "reading": lambda given: doubts_of_reading(given.asked, given.runs),
}
USUAL = ("unused columns", "form", "prediction", "normality")
OF_EVERY_LAW = ("longest lives", "exponents", "possible values", "missing conditions", "collinearity", "reading")
CHECKS_OF_LIVES: Mapping[str, OneCheck] = {
    "number of edges": lambda given: tool_lives.edges_of_lives(given.law),
    "run-outs": lambda given: tool_lives.run_outs(given.law),
    "extrapolated lives": lambda given: tool_lives.extrapolated_lives(given.law),
    "distribution of lives": lambda given: tool_lives.distribution_of_lives(given.law),
    "single lives": lambda given: tool_lives.single_lives(given.law),
}
CHECKS_OF_BOUNDS: Mapping[str, OneCheck] = {  # of lives that least squares does not fit
    "wrong rows": lambda given: tool_lives.outlying_lives(given.law),
    "predictive use": lambda given: tool_lives.useful_law(given.law),
    "curvature": lambda given: tool_lives.curvature_of_lives(given.law),
}
