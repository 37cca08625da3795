"""Lack of fit against pure error, adequate precision, and multicollinearity.

Where a law has several rows per edge, pure error is the variation between *edges* at one setting, and lack of fit the
deviation of the settings from the law. Everything that varies within edges (time, wear) stays in both models.

Sources: Draper & Smith 1998, Applied Regression Analysis, section 2.1 (pure error); Myers, Montgomery & Anderson-Cook,
Response Surface Methodology (adequate precision); Belsley, Kuh & Welsch 1980, Regression Diagnostics, chapter 3
(condition number, variance proportions).
"""

from dataclasses import dataclass

import numpy as np

from ...core.display import Displayable
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import SIGNIFICANT, ByRule, p_in_words
from .strata import (
    Array,
    Codes,
    Strata,
    covariance,
    has_repeated_edges,
    linear_columns,
    no_scatter,
    orthonormal,
    without_levels,
)

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


LEAST_PRECISION = 4.0  # signal to noise below which a law cannot steer


@dataclass(frozen=True, slots=True, repr=False)
class Precision(Displayable, ByRule):
    """Adequate precision: range of the predictions over their mean standard error.

    Attributes
    ----------
    statistic : float
    by_edge : bool
        Whether the standard error counts edges (a random level of each) or independent rows.
    """

    statistic: float
    by_edge: bool

    @property
    def null(self) -> str:
        """What is looked for."""
        return f"the law's signal is at least {LEAST_PRECISION:g} times its noise over the rows"

    @property
    def concern(self) -> int:
        """0 fine, 2 below 4. Cause: narrow ranges or few edges. Cure: widen them."""
        return 2 * int(self.statistic < LEAST_PRECISION)

    @property
    def brief(self) -> str:
        """The finding in a few words."""
        return f"signal to noise {self.statistic:.3g}"

    @property
    def verdict(self) -> str:
        """One sentence: what was found and what to do."""
        if self.concern:
            return (
                f"Signal to noise is {self.statistic:.2g}, below {LEAST_PRECISION:g}: the conditions move the response "
                "too little to steer by; widen their ranges or repeat."
            )
        return (
            f"Signal to noise is {self.statistic:.3g}, above {LEAST_PRECISION:g}: the law can steer within its range."
        )


def precision(law: LawFit, strata: Strata | NotAvailable) -> Precision | NotAvailable:
    """Adequate precision on the scale of the fit.

    With independent rows the mean variance of prediction is ``p s^2 / n``, as in the books; with edges it is
    that of the law with a random level of each.
    """
    if reason := no_scatter(law):
        return NotAvailable(reason)
    eta = np.log(law.fitted) if law.error == "multiplicative" else law.fitted
    if not isinstance(strata, Strata):
        if has_repeated_edges(law):
            return strata
        variance = law.rss / law.df_resid * len(law.theta) / law.nobs
    else:
        columns, _ = linear_columns(law)
        variance = float(np.einsum("ij,ij->", columns @ covariance(columns, law, strata), columns)) / law.nobs
    return Precision(float(np.ptp(eta)) / variance**0.5, isinstance(strata, Strata))


VIF_LOOK, VIF_ACT = 5.0, 10.0
CONDITION_ACT = 30.0
INVOLVED = 0.5  # share of a coefficient's variance that the weakest direction holds


@dataclass(frozen=True, slots=True, repr=False)
class Collinearity(Displayable, ByRule):
    """Variance inflation of each term of a law and condition number of all.

    Attributes
    ----------
    names : tuple of str, length k
        Factors and shifts, without the constant.
    vif : ndarray, shape (k,)
        ``1 / (1 - R2)`` of each term on the others.
    condition : float
        Largest over smallest singular value of the terms (logarithms in a power law), centred and of length one.
    entangled : tuple of str
        Terms that the weakest direction joins.
    """

    names: tuple[str, ...]
    vif: Array
    condition: float
    entangled: tuple[str, ...]

    @property
    def null(self) -> str:
        """What is looked for."""
        return "each factor varies by itself, so that its exponent is its own"

    @property
    def statistic(self) -> float:
        """Largest variance inflation factor."""
        return float(self.vif.max())

    @property
    def concern(self) -> int:
        """0 fine, 1 VIF above 5, 2 above 10 or condition above 30. Cause: factors changed together."""
        if self.statistic > VIF_ACT or self.condition > CONDITION_ACT:
            return 2
        return int(self.statistic > VIF_LOOK)

    @property
    def brief(self) -> str:
        """The finding in a few words."""
        return f"VIF at most {self.statistic:.2g}"

    @property
    def verdict(self) -> str:
        """One sentence: what was found and what to do."""
        worst = self.names[int(np.argmax(self.vif))]
        if not self.concern:
            return f"The factors are told apart (VIF at most {self.statistic:.2g}, condition {self.condition:.2g})."
        together = ", ".join(self.entangled)
        return (
            f"{together} change together (VIF {self.statistic:.2g} for {worst}, condition {self.condition:.2g}): their "
            f"exponents trade against each other; read them together, leave {worst} out, or vary it by itself."
        )


def collinearity(law: LawFit) -> Collinearity:
    """Variance inflation and condition number of the law's terms.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> found = collinearity(fit.power_law(runs, "AW", ["V", "f", "d", "t"]))
    >>> round(found.statistic, 1), found.concern
    (1.0, 0)
    """
    terms = law.law.design(law.X, law.shifts)[:, 1:]
    names = law.names[1:]
    terms = terms - terms.mean(axis=0)
    terms = terms / np.sqrt(np.einsum("ij,ij->j", terms, terms))
    _, s, Vt = np.linalg.svd(terms, full_matrices=False)
    parts = (Vt.T / s) ** 2
    vif = parts.sum(axis=1)
    weakest = parts[:, -1] / vif
    entangled = tuple(name for name, share in zip(names, weakest, strict=True) if share > INVOLVED)
    if len(entangled) < 2:
        entangled = tuple(names[j] for j in sorted(np.argsort(-weakest)[:2]))
    return Collinearity(names, vif, float(s[0] / s[-1]), entangled)
