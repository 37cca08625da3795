"""Lack of fit against pure error: how far settings stand off a law, against how far what was cut alike differs.

Where a law has several rows an edge, pure error is how far *edges* at one setting differ, and lack of fit how far
the settings stand off the law. Everything that varies within edges (time, wear) stays in both models.

Source: Draper & Smith 1998, Applied Regression Analysis, section 2.1 (pure error).
"""

from dataclasses import dataclass

import numpy as np

from ...core.display import Displayable
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import SIGNIFICANT, p_in_words
from .columns import Array, Codes, orthonormal, without_levels
from .evidence import has_repeated_edges, no_scatter
from .strata import Strata

# Pure error below this share of the law's sum of squares is rounding: the replicates are copies.
COPIES = 1e-11


@dataclass(frozen=True, slots=True, repr=False)
class LackOfFit(Displayable):
    """Test of the law's form against the scatter of what was cut twice at the same conditions.

    Attributes
    ----------
    units : {"edges", "rows"}
        What was replicated.
    ss_lack, ss_pure : float
        Sums of squares of lack of fit and of pure error, on the scale of the fit.
    df : tuple of int
        Degrees of freedom of both.
    settings, replicated : int
        Distinct settings, and how many of them hold more than one unit.
    pvalue : float
    """

    units: str
    ss_lack: float
    ss_pure: float
    df: tuple[int, int]
    settings: int
    replicated: int
    pvalue: float

    @property
    def null(self) -> str:
        """What the test takes for granted until it rejects it."""
        return f"the law has the right form: settings stand off it no more than replicated {self.units} differ"

    @property
    def statistic(self) -> float:
        """F, mean square of lack of fit over that of pure error."""
        return self.ss_lack / self.df[0] / (self.ss_pure / self.df[1])

    @property
    def concern(self) -> int:
        """0 fine, 2 the form is in doubt. Cause: curvature or a product of factors. Cure: another form."""
        return 2 if self.pvalue < SIGNIFICANT else 0

    @property
    def brief(self) -> str:
        """The finding in a few words."""
        return f"no lack of fit {p_in_words(self.pvalue)}"

    @property
    def verdict(self) -> str:
        """One sentence: what was found and what to do."""
        found = f"F({self.df[0]},{self.df[1]}) {self.statistic:.2f}, {p_in_words(self.pvalue)}"
        if self.concern:
            return (
                f"Lack of fit ({found}): the law misses more than {self.units} cut alike differ, so its form is not "
                "quite right; try a second-order or rival form, or keep to a narrower range."
            )
        return f"No lack of fit against {self.replicated} replicated settings ({found})."


def lack_of_fit(law: LawFit, strata: Strata | NotAvailable) -> LackOfFit | NotAvailable:
    """Lack of fit against replicated edges, or replicated rows where rows are independent.

    Parameters
    ----------
    law : LawFit
    strata : Strata or NotAvailable
        What :func:`split` gives for the law.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.checks.strata import split
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> lack_of_fit(law, split(law)).df
    (11, 9)
    """
    if reason := no_scatter(law):
        return NotAvailable(reason)
    if not has_repeated_edges(law):
        return _of_rows(law)
    return _of_edges(law, strata) if isinstance(strata, Strata) else strata


def _of_edges(law: LawFit, strata: Strata) -> LackOfFit | NotAvailable:
    told = np.flatnonzero(~strata.within)
    if len(told) < 2:
        return NotAvailable("every factor changes within the edges, so no two edges are cut at one setting")
    first = np.unique(strata.edge, return_index=True)[1]
    setting = settings_of(law.law.design(law.X[first], law.shifts[first])[:, told])
    S, G, p = int(setting.max()) + 1, len(strata.names), len(strata.within)
    if S == G:
        return NotAvailable(
            "no two edges were cut at the same conditions, so pure error is unknown and the form of the law cannot be "
            "tested: repeat one setting, the middle one say, on three or four new edges"
        )
    stacked, w = strata.stacked(), strata.basis.shape[1]
    law_ss = _left(stacked[:, :-1], stacked[:, -1])[0]
    others = np.append(strata.within, True)
    outer = stacked[w:, others]
    _, outer = without_levels(outer, np.sqrt(strata.weights), setting, S)
    rows = np.vstack([stacked[:w, others], outer])
    pure, rank = _left(rows[:, :-1], rows[:, -1])
    return _test("edges", law_ss, pure, (S + rank - p, w + G - S - rank), setting)


def _of_rows(law: LawFit) -> LackOfFit | NotAvailable:
    setting = settings_of(law.law.design(law.X, law.shifts))
    S = int(setting.max()) + 1
    if law.nobs == S:
        return NotAvailable(
            "no two rows were measured at the same conditions, so pure error is unknown and the form of the law cannot "
            "be tested: repeat one setting, the middle one say, three or four times"
        )
    one = np.ones(law.nobs)
    about = without_levels(law.residuals[:, None], one, setting, S)[1][:, 0]
    df = (S - len(law.theta), law.nobs - S)
    return _test("rows", law.rss, float(about @ about), df, setting)


def _left(A: Array, b: Array) -> tuple[float, int]:
    """Sum of squares of b outside the columns of A, and their rank."""
    Q = orthonormal(A)
    left = b - Q @ (Q.T @ b)
    return float(left @ left), Q.shape[1]


def settings_of(Z: Array) -> Codes:
    """Number of the setting of each row of Z, alike to nine digits; shape (n,)."""
    size = np.abs(Z).max(axis=0)
    size[size == 0] = 1.0
    return np.asarray(np.unique(np.round(Z / size, 9), axis=0, return_inverse=True)[1].ravel(), dtype=np.intp)


def _test(units: str, ss_law: float, pure: float, df: tuple[int, int], setting: Codes) -> LackOfFit | NotAvailable:
    from scipy.special import fdtrc

    counts = np.bincount(setting)
    if df[0] <= 0:
        return NotAvailable(
            f"{len(counts)} settings leave nothing over once the law is fitted: cut at further ones to test its form"
        )
    if pure <= COPIES * ss_law:
        return NotAvailable(
            f"replicated {units} agree to every digit, so they are copies and no pure error: replicate by cutting again"
        )
    lack = max(ss_law - pure, 0.0)
    p = float(fdtrc(df[0], df[1], lack / df[0] / (pure / df[1])))
    return LackOfFit(units, lack, pure, df, len(counts), int((counts > 1).sum()), p)
