"""Everything that is judged of a law, in one place: adequacy, error structure, rival forms, single edges, gauge.

Each finding says what it takes for granted, its figures and its verdict, or why it cannot be had; the verdicts
are told worst first, in at most six plain sentences.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...core.display import Plottable
from ...core.threads import one_thread
from ..available import NotAvailable
from ..lawfit import LawFit
from .adequacy import adequacy
from .check import Check, frame_of_checks, worst_first
from .choice import even_choice
from .dominant import dominant_edge
from .forms import rival_forms
from .gauge import gauge_corrected
from .robust import robust
from .slopes import common_exponent
from .structure import error_structure

if TYPE_CHECKING:
    from pandas import DataFrame


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
