"""All checks of a law: adequacy, error structure, competing models, influential edges, measurement error of wear.

Checks that leave out, resample or compare do it by edge where edges have several rows.
"""

from dataclasses import dataclass

from pandas import DataFrame

from ...core.display import Plottable
from ...core.threads import one_thread
from ..available import NotAvailable
from ..lawfit import LawFit
from .autocorrelation import SerialCorrelation, serial_correlation
from .check import Check, frame_of_checks, sentences
from .competing_models import compare_forms
from .deletion_diagnostics import Deletion, deletion, influence, press
from .gauge_error import gauge_corrected
from .model_checks import collinearity, lack_of_fit, precision
from .residual_tests import Residuals, normality, residual_sets, spread
from .response_scale import box_cox, error_structure
from .robust_fit import dominant_edge, robust
from .strata import MOST_ROWS, Strata, even_choice, has_repeated_edges, split
from .time_exponent import common_exponent

Checks = dict[str, Check | NotAvailable]


@dataclass(frozen=True, slots=True, repr=False)
class Judgement(Plottable):
    """Checks of a law.

    Attributes
    ----------
    checks : dict of Check or NotAvailable
        By the keys of ``check.TITLES``; a check that these data do not allow is its reason.
    rows_are_independent : bool
        Whether no edge has more than one row, or the file names no edges.
    nobs : int
        Rows checked: of more than 5000 an even selection, 0 of a law of a stream, which keeps none.
    """

    checks: Checks
    rows_are_independent: bool
    nobs: int

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
def judge(law: LawFit, gauge_sd: float | None = None, *, alternative: LawFit | None = None) -> Judgement:
    """Check a law: adequacy, error structure, competing models, influential edges.

    Parameters
    ----------
    law : LawFit
    gauge_sd : float, optional
        Standard deviation of the wear gauge, in the unit of the wear; its effect on the exponent of wear is then
        checked as well.
    alternative : LawFit, optional
        ``law.alternative`` where it is known: fitting it again takes a sixth of the time.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "P", ["V", "f", "d", "t", "AW"])
    >>> fit.judge(law).checks["collinearity"].level
    'warning'
    """
    found = adequacy(law)
    given, law = law, even_choice(law)
    checks: Checks = {**found.checks}
    if law.formula.logarithmic:  # a line has one error structure only
        checks["error structure"] = error_structure(law, alternative if law is given else None)
    if law.form == "power":
        checks["rival forms"] = compare_forms(law)
    exponent = common_exponent(law)
    if isinstance(exponent, Check):  # of laws without time, or of edges with one row, it does not exist
        checks["time exponent"] = exponent
    edge = dominant_edge(law)
    if isinstance(edge, Check) and edge.concern:
        checks["dominant edge"] = edge
        refit = robust(law)
        if isinstance(refit, Check):
            checks["robust refit"] = refit
    if gauge_sd is not None and (wear := next((name for name in ("AW", "VB") if name in law.factors), None)):
        checks["gauge error"] = gauge_corrected(law, gauge_sd, wear, unit=law.units[wear])
    return Judgement(checks, found.rows_are_independent, found.nobs)


@one_thread
def adequacy(law: LawFit) -> Judgement:
    """Check the adequacy of a law: form, prediction, influence, collinearity, scale and residuals.

    Parameters
    ----------
    law : LawFit
        With an edge column, everything is by edge; without one rows are assumed independent.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> adequacy(law).checks["form"].df
    (11, 9)
    """
    rows_given, law = law.nobs, even_choice(law)
    strata = split(law)
    left = deletion(law, strata)
    rows, edges = residual_sets(law, strata)
    checks: Checks = {
        "form": lack_of_fit(law, strata),
        "single edges": influence(law, strata, left) if isinstance(left, Deletion) else left,
        "prediction": press(law, left) if isinstance(left, Deletion) else left,
        "collinearity": collinearity(law),
        "signal to noise": precision(law, strata),
        "scale of the response": box_cox(law, strata),
        "order within edges": _order(law, strata, rows_given),
        "even scatter": spread(law, rows) if isinstance(rows, Residuals) else rows,
        "even scatter of edges": spread(law, edges) if isinstance(edges, Residuals) else edges,
        "normality": normality(rows) if isinstance(rows, Residuals) else rows,
        "normality of edges": normality(edges) if isinstance(edges, Residuals) else edges,
    }
    return Judgement(checks, not has_repeated_edges(law), 0 if law.rows is None else law.nobs)


def _order(law: LawFit, strata: Strata | NotAvailable, rows_given: int) -> SerialCorrelation | NotAvailable:
    """The test of autocorrelation; not available for a selection of rows, which lacks their neighbours."""
    if isinstance(strata, Strata) and law.nobs < rows_given:
        return NotAvailable(
            f"{law.nobs} of {rows_given} rows were checked, evenly spaced: neighbours on an edge are missing; "
            f"fit whole edges, {MOST_ROWS} rows at most, to test autocorrelation"
        )
    return serial_correlation(law, strata)
