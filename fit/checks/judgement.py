"""All checks of a law: adequacy, error structure, competing models, influential edges, measurement error of wear.

Checks that leave out, resample or compare do it by edge where edges have several rows.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...core.display import Plottable
from ...core.threads import one_thread
from ..available import NotAvailable
from ..lawfit import LawFit
from .autocorrelation import SerialCorrelation, serial_correlation
from .check import Check, frame_of_checks, worst_first
from .competing_models import rival_forms
from .deletion_diagnostics import Deletion, Influence, Press, deletion, influence, press
from .gauge_error import gauge_corrected
from .model_checks import Collinearity, LackOfFit, Precision, collinearity, lack_of_fit, precision
from .residual_tests import Normality, Residuals, Spread, normality, residual_sets, spread
from .response_scale import BoxCox, box_cox, error_structure
from .robust_fit import dominant_edge, robust
from .strata import MOST_ROWS, Strata, even_choice, has_repeated_edges, split
from .time_exponent import common_exponent

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, slots=True, repr=False)
class Adequacy(Plottable):
    """All checks of one law; each is there, or is the reason why it cannot be had.

    Attributes
    ----------
    lack_of_fit : LackOfFit or NotAvailable
        Form of the law against replicated edges, or rows where rows are independent.
    press : Press or NotAvailable
        PRESS and predicted R2.
    precision : Precision or NotAvailable
        Range of the predictions over their standard error.
    influence : Influence or NotAvailable
        Leverage, Cook's distance and DFBETAS.
    collinearity : Collinearity
        Variance inflation and condition number.
    boxcox : BoxCox or NotAvailable
        Power of the response.
    serial : SerialCorrelation or NotAvailable
        Whether rows of an edge follow each other.
    spread, spread_of_edges : Spread or NotAvailable
        Breusch-Pagan test of rows (within edges where there are several) and of edges.
    normality, normality_of_edges : Normality or NotAvailable
        Anderson-Darling test of the same.
    rows_are_independent : bool
        Whether no edge gave more than one row, or the file does not say.
    nobs : int
        Rows that were checked: of more than 5000 an even choice, which tells all that is to be told.
    """

    lack_of_fit: LackOfFit | NotAvailable
    press: Press | NotAvailable
    precision: Precision | NotAvailable
    influence: Influence | NotAvailable
    collinearity: Collinearity
    boxcox: BoxCox | NotAvailable
    serial: SerialCorrelation | NotAvailable
    spread: Spread | NotAvailable
    spread_of_edges: Spread | NotAvailable
    normality: Normality | NotAvailable
    normality_of_edges: Normality | NotAvailable
    rows_are_independent: bool
    nobs: int

    @property
    def checks(self) -> dict[str, Check | NotAvailable]:
        """Every check by what it is of, most telling first."""
        return {
            "form": self.lack_of_fit,
            "single edges": self.influence,
            "prediction": self.press,
            "collinearity": self.collinearity,
            "signal to noise": self.precision,
            "scale of the response": self.boxcox,
            "order within edges": self.serial,
            "even scatter": self.spread,
            "even scatter of edges": self.spread_of_edges,
            "normality": self.normality,
            "normality of edges": self.normality_of_edges,
        }

    def verdicts(self, most: int = 6) -> tuple[str, ...]:
        """Plain sentences, worst first, at most ``most``: what is wrong, what cannot be told, what is well.

        Raises
        ------
        UsageError
            ``most`` below 1.
        """
        return worst_first(self.checks, self.rows_are_independent, most)

    def to_frame(self) -> "DataFrame":
        """A row a check: concern, statistic, p, and its verdict."""
        return frame_of_checks(self.checks)


@one_thread
def adequacy(law: LawFit) -> Adequacy:
    """Check a law.

    Parameters
    ----------
    law : LawFit
        With an edge column, everything goes by edge; without one rows are taken as independent.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> adequacy(law).lack_of_fit.df
    (11, 9)
    """
    rows_given, law = law.nobs, even_choice(law)
    strata = split(law)
    left = deletion(law, strata)
    rows, edges = residual_sets(law, strata)
    return Adequacy(
        lack_of_fit=lack_of_fit(law, strata),
        press=press(law, left) if isinstance(left, Deletion) else left,
        precision=precision(law, strata),
        influence=influence(law, strata, left) if isinstance(left, Deletion) else left,
        collinearity=collinearity(law),
        boxcox=box_cox(law, strata),
        serial=_order(law, strata, rows_given),
        spread=spread(law, rows) if isinstance(rows, Residuals) else rows,
        spread_of_edges=spread(law, edges) if isinstance(edges, Residuals) else edges,
        normality=normality(rows) if isinstance(rows, Residuals) else rows,
        normality_of_edges=normality(edges) if isinstance(edges, Residuals) else edges,
        rows_are_independent=not has_repeated_edges(law),
        nobs=law.nobs,
    )


def _order(law: LawFit, strata: Strata | NotAvailable, rows_given: int) -> SerialCorrelation | NotAvailable:
    """The serial test; none of a choice of rows, since those before and after each are not in it."""
    if isinstance(strata, Strata) and law.nobs < rows_given:
        return NotAvailable(
            f"{law.nobs} of {rows_given} rows were checked, evenly chosen, so that neighbours on an edge are missing: "
            f"fit whole edges, {MOST_ROWS} rows at most, to test the order"
        )
    return serial_correlation(law, strata)


@dataclass(frozen=True, slots=True)
class Finding:
    """One judgement in the shape of a check: figures where there are any, and a sentence."""

    null: str
    verdict: str
    brief: str
    concern: int = 0
    statistic: float = 0.0
    df: int | tuple[int, int] | None = None
    pvalue: float | None = None


@dataclass(frozen=True, slots=True, repr=False)
class Judgement(Plottable):
    """What is judged of a law.

    Attributes
    ----------
    checks : dict of Check or NotAvailable
        By what each is of.
    rows_are_independent : bool
    nobs : int
        Rows that were looked at: of more than 5000 an even choice.
    """

    checks: dict[str, Check | NotAvailable]
    rows_are_independent: bool
    nobs: int

    def verdicts(self, most: int = 6) -> tuple[str, ...]:
        """Plain sentences, worst first, at most ``most``."""
        return worst_first(self.checks, self.rows_are_independent, most)

    def to_frame(self) -> "DataFrame":
        """A row a check: concern, statistic, p, and its verdict."""
        return frame_of_checks(self.checks)


@one_thread
def judge(law: LawFit, gauge_sd: float | None = None, *, alternative: LawFit | None = None) -> Judgement:
    """Judge a law.

    Parameters
    ----------
    law : LawFit
    gauge_sd : float, optional
        Standard deviation of the wear gauge, in the unit of the wear: what it does to the wear exponent is
        then a finding too.
    alternative : LawFit, optional
        ``law.alternative``, where somebody has it already: fitting it again takes a sixth of the time.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "P", ["V", "f", "d", "t", "AW"])
    >>> fit.judge(law).verdicts(2)[0].startswith("V, f, t, AW change together")
    True
    """
    found = adequacy(law)
    given, law = law, even_choice(law)
    other = alternative if law is given else None
    checks = {**found.checks, **_structure(law, other), **_forms(law), **_slopes(law), **_edges(law)}
    if gauge_sd is not None and (wear := next((name for name in ("AW", "VB") if name in law.factors), None)):
        checks["gauge error"] = _gauge(law, gauge_sd, wear)
    return Judgement(checks, found.rows_are_independent, found.nobs)


def _structure(law: LawFit, other: LawFit | None) -> dict[str, Check | NotAvailable]:
    """None of a line: it has one structure only."""
    if not law.law.logarithmic:
        return {}
    found = error_structure(law, other)
    if isinstance(found, NotAvailable):
        return {"error structure": found}
    null = "errors multiply and errors add explain the rows alike"
    brief = {"multiplicative": "errors multiply", "additive": "errors add", None: "either error structure"}[
        found.preferred
    ]
    return {"error structure": Finding(null, found.verdict, brief, found.concern, found.difference)}


def _forms(law: LawFit) -> dict[str, Check | NotAvailable]:
    if law.form != "power":
        return {}
    found = rival_forms(law)
    if isinstance(found, NotAvailable):
        return {"rival forms": found}
    null = "no rival form tells a row that was left out better than the power law"
    brief = "power law kept against its rivals"
    return {"rival forms": Finding(null, found.argument, brief, found.concern, found.chosen.difference)}


def _slopes(law: LawFit) -> dict[str, Check | NotAvailable]:
    """Only of laws on time whose edges were measured several times: for others it is no loss."""
    found = common_exponent(law)
    if isinstance(found, NotAvailable):
        return {}
    brief = "one time exponent for all edges"
    return {
        "time exponent": Finding(found.null, found.verdict, brief, found.concern, found.fvalue, found.df, found.pvalue)
    }


def _edges(law: LawFit) -> dict[str, Check | NotAvailable]:
    """The dominant edge, and a robust refit beside the plain one where there is such an edge."""
    found = dominant_edge(law)
    if isinstance(found, NotAvailable) or not found.concern:
        return {}
    null = "no edge moves a parameter by more than 2.5 of its standard errors"
    out: dict[str, Check | NotAvailable] = {
        "dominant edge": Finding(null, found.verdict, "no edge dominates", found.concern)
    }
    refit = robust(law)
    if not isinstance(refit, NotAvailable):
        out["robust refit"] = Finding("a robust refit agrees", refit.verdict, "robust refit agrees", refit.concern)
    return out


def _gauge(law: LawFit, gauge_sd: float, wear: str) -> Check | NotAvailable:
    found = gauge_corrected(law, gauge_sd, wear, unit=law.units[wear])
    if isinstance(found, NotAvailable):
        return found
    return Finding(f"{wear} is measured without error", found.verdict, "gauge error is harmless", found.concern)
