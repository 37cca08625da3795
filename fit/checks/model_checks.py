"""Lack of fit against pure error, adequate precision, and multicollinearity.

Where a law has several rows per edge, pure error is the variation between *edges* at one setting, and lack of fit the
deviation of the settings from the law. Everything that varies within edges (time, wear) stays in both models.

Sources: Draper & Smith 1998, Applied Regression Analysis, section 2.1 (pure error); Myers, Montgomery & Anderson-Cook,
Response Surface Methodology (adequate precision); Belsley, Kuh & Welsch 1980, Regression Diagnostics, chapter 3
(condition number, variance proportions).
"""

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import SIGNIFICANT, Check, format_p
from .strata import (
    NO_ROWS,
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


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class LackOfFit(Check):
    """F test of the form of the law against pure error; ``df`` are those of lack of fit and of pure error.

    Attributes
    ----------
    units : {"edges", "rows"}
        What was replicated.
    ss_lack, ss_pure : float
        Sums of squares of lack of fit and of pure error, on the scale of the fit.
    settings, replicated : int
        Distinct settings, and how many of them have more than one unit.
    """

    units: str
    ss_lack: float
    ss_pure: float
    settings: int
    replicated: int


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
    between = np.flatnonzero(~strata.within)
    if len(between) < 2:
        return NotAvailable("every factor changes within the edges, so no two edges have the same setting")
    first = np.unique(strata.edge, return_index=True)[1]
    setting = settings_of(law.formula.design(law.X[first], law.shifts[first])[:, between])
    S, G, p = int(setting.max()) + 1, len(strata.names), len(strata.within)
    if S == G:
        return NotAvailable(
            "no two edges were tested at the same conditions, so pure error is unknown and lack of fit not "
            "testable: replicate one setting, for instance the centre point, on three or four new edges"
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
    setting = settings_of(law.design)
    S = int(setting.max()) + 1
    if law.nobs == S:
        return NotAvailable(
            "no two rows were measured at the same conditions, so pure error is unknown and the form of the law cannot "
            "be tested: replicate one setting, for instance the centre point, three or four times"
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
            f"{len(counts)} settings leave no degrees of freedom for lack of fit: test further settings"
        )
    if pure <= COPIES * ss_law:
        return NotAvailable(
            f"replicated {units} are identical, so they are copies without pure error: replicate by a new test"
        )
    lack = max(ss_law - pure, 0.0)
    F = lack / df[0] / (pure / df[1])
    p, replicated = float(fdtrc(df[0], df[1], F)), int((counts > 1).sum())
    result = f"F({df[0]}, {df[1]}) = {F:.2f}, {format_p(p)}"
    rejected = (
        f"Lack of fit ({result}): the law deviates from the means of the settings by more than replicated {units} "
        "vary; try a second-order or competing model, or restrict the range."
    )
    kept = f"No lack of fit against {replicated} replicated settings ({result})."
    return LackOfFit(
        null=f"the law has the right form: settings deviate from it no more than replicated {units} vary",
        statistic=F,
        symbol="F",
        df=df,
        pvalue=p,
        concern=int(p < SIGNIFICANT),
        verdict=rejected if p < SIGNIFICANT else kept,
        kept=kept,
        units=units,
        ss_lack=lack,
        ss_pure=pure,
        settings=len(counts),
        replicated=replicated,
    )


LEAST_PRECISION = 4.0  # range over standard error below which a law is useless for control


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class Precision(Check):
    """Adequate precision: range of the predictions over their mean standard error.

    Attributes
    ----------
    by_edge : bool
        Whether the standard error is by edge (a random level of each) or of independent rows.
    """

    by_edge: bool


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
    ratio = float(np.ptp(eta)) / variance**0.5
    low = (
        f"Adequate precision {ratio:.2g} is below {LEAST_PRECISION:g}: the effect of the conditions is too small "
        "against its standard error for control; widen their ranges or repeat."
    )
    return Precision(
        null=f"the range of the predictions is at least {LEAST_PRECISION:g} of their standard errors",
        statistic=ratio,
        symbol="signal to noise",
        concern=2 * int(ratio < LEAST_PRECISION),
        verdict=low if ratio < LEAST_PRECISION else f"Adequate precision {ratio:.3g}, above {LEAST_PRECISION:g}.",
        by_edge=isinstance(strata, Strata),
    )


VIF_LOOK, VIF_ACT = 5.0, 10.0
CONDITION_ACT = 30.0
INVOLVED = 0.5  # share of a coefficient's variance in the direction of smallest variance


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class Collinearity(Check):
    """Variance inflation of each term of a law (the largest is the statistic) and condition number of all.

    Attributes
    ----------
    names : tuple of str, length k
        Factors and shifts, without the constant.
    vif : ndarray, shape (k,)
        ``1 / (1 - R2)`` of each term on the others.
    condition : float
        Largest over smallest singular value of the terms (logarithms in a power law), centred and of length one.
    entangled : tuple of str
        Terms of the direction of smallest variance.
    """

    names: tuple[str, ...]
    vif: Array
    condition: float
    entangled: tuple[str, ...]


def collinearity(law: LawFit) -> Collinearity | NotAvailable:
    """Variance inflation and condition number of the law's terms.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> found = collinearity(fit.power_law(runs, "AW", ["V", "f", "d", "t"]))
    >>> round(found.statistic, 1), found.concern
    (1.0, 0)
    """
    if law.rows is None:
        return NotAvailable(NO_ROWS)
    terms = law.design[:, 1:]
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
    largest, condition = float(vif.max()), float(s[0] / s[-1])
    concern = 2 if largest > VIF_ACT or condition > CONDITION_ACT else int(largest > VIF_LOOK)
    worst = names[int(np.argmax(vif))]
    correlated = (
        f"Multicollinearity: {', '.join(entangled)} vary together (VIF {largest:.2g} of {worst}, condition number "
        f"{condition:.2g}), so their exponents are correlated; interpret them jointly, leave {worst} out, or vary it "
        "independently."
    )
    return Collinearity(
        null="each factor varies independently of the others",
        statistic=largest,
        symbol="max. VIF",
        concern=concern,
        verdict=correlated
        if concern
        else f"No multicollinearity (VIF at most {largest:.2g}, condition {condition:.2g}).",
        names=names,
        vif=vif,
        condition=condition,
        entangled=entangled,
    )
