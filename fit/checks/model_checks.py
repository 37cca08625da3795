"""Lack of fit against pure error, curvature, and multicollinearity.

Where a law has several rows per edge, pure error is the variation between *edges* at one setting, and lack of fit the
deviation of the settings from the law. Everything that varies within edges (time, wear) stays in both models. The test
has two tails: an F far below one means that repeats of a setting differ by more than the settings differ from the law,
so that they are no repeats, or a factor is missing from the file.

Sources: Draper & Smith 1998, Applied Regression Analysis, section 2.1 (pure error); Christensen 2003, American
Statistician 57, 74 (F below one); Belsley, Kuh & Welsch 1980, Regression Diagnostics, chapter 3 (condition number,
variance proportions).
"""

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array, Ints
from ...core.rounding import format_plain
from ...datasets.vocabulary import ROLES
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import SIGNIFICANT, Check, format_p
from .exponent_ranges import built_up_edge
from .strata import (
    NO_ROWS,
    Strata,
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
    """F test of the form of the law against pure error, in both tails; ``df``: of lack of fit, of pure error.

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
    return lack_of_fit_test("edges", law_ss, pure, (S + rank - p, w + G - S - rank), setting)


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
    return lack_of_fit_test("rows", law.rss, float(about @ about), df, setting)


def _left(A: Array, b: Array) -> tuple[float, int]:
    """Sum of squares of b outside the columns of A, and their rank."""
    Q = orthonormal(A)
    left = b - Q @ (Q.T @ b)
    return float(left @ left), Q.shape[1]


def settings_of(Z: Array) -> Ints:
    """Number of the setting of each row of Z, alike to nine digits; shape (n,)."""
    size = np.abs(Z).max(axis=0)
    size[size == 0] = 1.0
    return np.asarray(np.unique(np.round(Z / size, 9), axis=0, return_inverse=True)[1].ravel(), dtype=np.intp)


def lack_of_fit_test(
    units: str, ss_law: float, pure: float, df: tuple[int, int], setting: Ints
) -> LackOfFit | NotAvailable:
    """F test of lack of fit: sums of squares about the law and about the settings, and their degrees of freedom."""
    from scipy.special import fdtr, fdtrc

    counts = np.bincount(setting)
    if df[0] <= 0:
        return NotAvailable(f"{len(counts)} settings leave no degrees of freedom for lack of fit: test more settings")
    if pure <= COPIES * ss_law:
        return NotAvailable(
            f"replicated {units} are identical, so they are copies without pure error: replicate by a new test"
        )
    lack = max(ss_law - pure, 0.0)
    F = lack / df[0] / (pure / df[1])
    above = float(fdtrc(df[0], df[1], F))
    p, replicated = min(1.0, 2 * min(above, float(fdtr(df[0], df[1], F)))), int((counts > 1).sum())
    result = f"F({df[0]}, {df[1]}) = {F:.2{'f' if F >= 0.1 else 'g'}}, two-sided {format_p(p)}"
    rejected = (
        f"Lack of fit ({result}): the law deviates from the means of the settings by more than replicated {units} "
        "vary; compare forms (fitmodels compare), or restrict the range. Readings of one edge are no replicates."
        if above < 0.5
        else f"Replicated {units} of one setting differ by more than the settings deviate from the law ({result}): a "
        f"factor that is not in the law changed between them, or {units} of different conditions are given as repeats."
    )
    kept = f"No lack of fit against {replicated} replicated settings ({result})."
    return LackOfFit(
        null=f"the law has the right form: settings deviate from it as much as replicated {units} vary",
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


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class Curvature(Check):
    """F tests of the square of each factor that changes between edges (rows, where they are independent).

    The statistic is the largest F, the p-value its own times the number of squares (Bonferroni).

    Attributes
    ----------
    term : str
        Factor whose square improves the law most.
    """

    term: str


FEWEST_LEFT = 3  # degrees of freedom that the test of curvature must leave


def curvature(law: LawFit, strata: Strata | NotAvailable) -> Curvature | NotAvailable:
    """Test of the squares of the factors, of their logarithms in a power law, on the levels of edges.

    Factors that change within edges, time and wear, are not squared: their rows follow each other.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.checks.strata import split
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> found = curvature(law, split(law))
    >>> found.df, found.concern
    ((1, 19), 0)
    """
    if reason := no_scatter(law):
        return NotAvailable(reason)
    if not law.formula.first_order:
        return NotAvailable("the law is of second order, and its own terms test the curvature")
    if has_repeated_edges(law) and not isinstance(strata, Strata):
        return strata
    A, b, squared, df = _squares(law, strata)
    if df - 1 < FEWEST_LEFT:
        return NotAvailable(f"{df} degrees of freedom of the law are too few to test its curvature")
    Q = orthonormal(A[:, : A.shape[1] - len(squared)])
    rest, extra = b - Q @ (Q.T @ b), A[:, A.shape[1] - len(squared) :]
    extra = extra - Q @ (Q.T @ extra)
    length = np.linalg.norm(extra, axis=0)
    new = np.flatnonzero(length > INDEPENDENT)
    if not new.size:
        return NotAvailable("no factor has three levels, or its square follows another column of the law")
    gain = (extra[:, new].T @ rest / length[new]) ** 2
    j = int(np.argmax(gain))
    F = float(gain[j]) / max((float(rest @ rest) - float(gain[j])) / (df - 1), 1e-300)
    return _curvature_test(law, F, df - 1, [law.factors[squared[i]] for i in new], j)


LARGE_F = 1e4  # above which F is printed to four digits
INDEPENDENT = 0.05  # of the length of a square: what must be left of it outside the law


def _squares(law: LawFit, strata: Strata | NotAvailable) -> tuple[Array, Array, list[int], int]:
    """Columns of the law and then the squares, the residual, numbers of the squared factors, degrees of freedom."""
    x = law.formula.transformed(law.X)
    square = (x - x.mean(axis=0)) ** 2
    square = square - square.mean(axis=0)
    if not isinstance(strata, Strata):
        columns = linear_columns(law)[0]
        square = _unit_length(square * columns[:, :1])
        return np.hstack([columns, square]), law.residuals, list(range(x.shape[1])), law.df_resid
    stacked, level = strata.stacked(), strata.level
    changed = [j for j in range(x.shape[1]) if not strata.within[1 + j]]
    levels, _ = without_levels(square[:, changed] * level[:, None], level, strata.edge, len(strata.names))
    of_edges = _unit_length(np.sqrt(strata.weights)[:, None] * levels)
    of_rows = np.zeros((len(stacked) - len(levels), len(changed)))
    return np.hstack([stacked[:, :-1], np.vstack([of_rows, of_edges])]), stacked[:, -1], changed, strata.df_between


def _unit_length(A: Array) -> Array:
    return np.asarray(A / np.maximum(np.linalg.norm(A, axis=0), 1e-300))


def _curvature_test(law: LawFit, F: float, df: int, names: list[str], j: int) -> Curvature:
    from scipy.special import fdtrc

    p = min(1.0, len(names) * float(fdtrc(1, df, F)))
    largest = f", the largest of {len(names)}" if len(names) > 1 else ""
    result = f"F(1, {df}) = {format_plain(F, 4) if F >= LARGE_F else f'{F:.2f}'}{largest}, {format_p(p)}"
    kept = f"No curvature in {', '.join(names)}: at most, the square of {names[j]} ({result})."
    compare = "compare it with a second-order law (fitmodels compare), or restrict the range"
    over = f"Curvature: the square of {names[j]} improves the law ({result}), so that its effect changes over its range"
    return Curvature(
        null=f"the effects of {', '.join(names)} do not change over their ranges",
        statistic=F,
        symbol="max. F",
        df=(1, df),
        pvalue=p,
        concern=int(p < SIGNIFICANT),
        verdict=f"{over}; {built_up_edge(law, names[j]) or compare}." if p < SIGNIFICANT else kept,
        kept=kept,
        term=names[j],
    )


HIGH_VIF = 10.0  # variance inflation above which factors that were set are confounded
WIDE = 1.0  # half-width of the interval of an exponent above which its effect is unknown: a factor 2 either side
USELESS = 2.0  # half-width of an exponent with which no condition can be chosen
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
    s, parts = _inflation(terms)
    vif = parts.sum(axis=1)
    weakest = parts[:, -1] / vif
    entangled = tuple(name for name, share in zip(names, weakest, strict=True) if share > INVOLVED)
    if len(entangled) < 2:
        entangled = tuple(names[j] for j in sorted(np.argsort(-weakest)[:2]))
    largest, condition = float(vif.max()), float(s[0] / s[-1])
    worst, width = names[int(np.argmax(vif))], _widest(law, names, vif)
    were_set = [j for j, name in enumerate(names) if name not in ROLES or ROLES[name].kind not in ("time", "wear")]
    of_set = float(_inflation(terms[:, were_set])[1].sum(axis=1).max()) if were_set else 1.0
    concern = _collinear_concern(largest, of_set, width)
    width_text = "" if width is None else f", half-width of the interval up to {width:.2g}"
    size = f"VIF {largest:.2g} of {worst}, condition number {condition:.2g}{width_text}"
    together = f"{', '.join(entangled)} vary together ({size})"
    verdict = f"No multicollinearity (VIF at most {largest:.2g}, condition {condition:.2g})."
    hidden = [out for out in law.left_out if out.confounded]
    if hidden:
        concern = max(concern, 1)
        several = len(hidden) > 1
        which = "; ".join(f"{out.factor} was left out: {out.reason}" for out in hidden)
        what, values = ("Factor", "exponents") if law.formula.first_order else ("Term", "coefficients")
        verdict = (
            f"{what}{'s' if several else ''} {which}. The {values} of the others include "
            f"{'their effects' if several else 'its effect'}, and hold only where "
            f"{'they follow' if several else 'it follows'} them as in the tests."
        )
    elif concern:
        verdict = (
            f"Multicollinearity: {together}, so their exponents cannot be separated: change one factor only where the "
            f"others follow it as in the tests, leave {worst} out, or vary it independently."
        )
    elif largest > HIGH_VIF:
        verdict = f"{together[0].upper()}{together[1:]}: their intervals include it; interpret them jointly."
    return Collinearity(
        null="each factor varies independently of the others",
        statistic=largest,
        symbol="max. VIF",
        concern=concern,
        verdict=verdict,
        names=names,
        vif=vif,
        condition=condition,
        entangled=entangled,
    )


def _widest(law: LawFit, names: tuple[str, ...], vif: Array) -> float | None:
    """Half-width of the 95 % interval of the widest exponent of high variance inflation; None without exponents."""
    if not law.formula.logarithmic or law.cov_theta is None:
        return None
    half = law.t_quantile(0.95) * law.bse.to_numpy()[1:]
    # an exponent is the effect of 1 in ln x; of a factor that enters as it is, its mean is about that
    size = [1.0 if log else float(np.abs(x).mean()) for x, log in zip(law.X.T, law.formula.logs, strict=True)]
    per = dict(zip(law.factors, size, strict=True))
    of_factors = [half[j] * per[name] for j, name in enumerate(names) if name in per and vif[j] > HIGH_VIF]
    return float(max(of_factors)) if of_factors else None


def _inflation(terms: Array) -> tuple[Array, Array]:
    """Singular values (k,) of terms centred and of length one, and the share of each in each inflation (k, k)."""
    terms = terms - terms.mean(axis=0)
    terms = terms / np.sqrt(np.einsum("ij,ij->j", terms, terms))
    _, s, Vt = np.linalg.svd(terms, full_matrices=False)
    return s, (Vt.T / s) ** 2


def _collinear_concern(largest: float, of_set: float, width: float | None) -> int:
    """2 where no condition can be chosen; 1 where factors that were set vary together, or an interval is too wide.

    Wear and time follow from the conditions, and their exponents stay useful as long as their intervals are narrow.
    """
    if largest <= HIGH_VIF:
        return 0
    if width is not None and width > USELESS:
        return 2
    return int(of_set > HIGH_VIF or width is None or width > WIDE)
