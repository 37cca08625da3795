"""Tests of residuals: normality (Anderson-Darling) and homoscedasticity (Breusch-Pagan).

Where edges have several rows there are two sets of residuals, rows about the level of their edge and levels of edges
about the law, and each has its own tests. Pooled they would be neither independent nor identically distributed, and
the tests would reject correct laws.

Sources: Anderson & Darling 1954, J. Am. Stat. Assoc. 49, 765, with the p-values of D'Agostino & Stephens 1986,
Goodness-of-Fit Techniques, table 4.9; Breusch & Pagan 1979, Econometrica 47, 1287, in the form of Koenker 1981,
J. Econometrics 17, 107.
"""

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array, Ints
from ..available import NotAvailable
from ..lawfit import LawFit
from ..least_squares import sums_by
from .check import STRONG, Check, concern_of, format_p
from .strata import Strata, has_repeated_edges, no_scatter, orthonormal

HELD = 1e-9  # share of its own variance below which a residual is fixed by the fit


@dataclass(frozen=True, slots=True)
class Residuals:
    """One set of residuals that may be tested together.

    Attributes
    ----------
    of : {"rows", "rows within edges", "edges"}
    values : ndarray, shape (m,)
        Residuals; those of edges and within edges are scaled to equal variance.
    names : tuple of str, length k
    terms : ndarray, shape (m, k)
        Terms of the law that change among them, at the same places, without the constant.
    free : int
        Degrees of freedom among them.
    group : ndarray of int, shape (m,), or None
        Edge of each where several are of one edge.
    tied : ndarray, shape (m,), or None
        ``h / (1 - h)`` with h the part of a row's own level: residuals i and j of one edge have correlation
        ``-sqrt(tied_i tied_j)``, their squares ``tied_i tied_j``.
    """

    of: str
    values: Array
    names: tuple[str, ...]
    terms: Array
    free: int
    group: Ints | None = None
    tied: Array | None = None


def residual_sets(
    law: LawFit, strata: Strata | NotAvailable
) -> tuple[Residuals | NotAvailable, Residuals | NotAvailable]:
    """Residuals of rows (within edges where edges gave several), and of the levels of edges.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.checks.strata import split
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> [(found.of, len(found.values)) for found in residual_sets(law, split(law))]
    [('rows within edges', 239), ('edges', 24)]
    """
    if reason := no_scatter(law):
        return NotAvailable(reason), NotAvailable(reason)
    terms = law.design[:, 1:]
    if isinstance(strata, Strata):
        return _within(law, strata, terms), _of_edges(law, strata, terms)
    if has_repeated_edges(law):
        return strata, strata
    return Residuals("rows", law.residuals, law.names[1:], terms, law.df_resid), strata


def _within(law: LawFit, strata: Strata, terms: Array) -> Residuals | NotAvailable:
    if strata.df_within <= 0 or float(strata.rest @ strata.rest) <= HELD**2 * law.rss:
        return NotAvailable("rows of each edge fit exactly: there is no variance within edges")
    own = strata.level**2 / strata.weight[strata.edge]
    hat = own + np.einsum("ij,ij->i", strata.basis, strata.basis)
    free = 1 - hat > HELD
    values = strata.rest[free] / np.sqrt(1 - hat[free])
    tied = own[free] / (1 - own[free])
    return Residuals("rows within edges", values, law.names[1:], terms[free], strata.df_within, strata.edge[free], tied)


def _of_edges(law: LawFit, strata: Strata, terms: Array) -> Residuals:
    stacked, w = strata.stacked(), strata.basis.shape[1]
    Q = orthonormal(stacked[:, :-1])
    left = (stacked[:, -1] - Q @ (Q.T @ stacked[:, -1]))[w:]
    hat = np.einsum("ij,ij->i", Q, Q)[w:]
    free = 1 - hat > HELD
    between = np.flatnonzero(~strata.within[1:])
    means = sums_by(strata.edge, terms[:, between], len(strata.names)) / np.bincount(strata.edge)[:, None]
    values = left[free] / np.sqrt(1 - hat[free])
    return Residuals("edges", values, tuple(law.names[1 + j] for j in between), means[free], strata.df_between)


FEWEST = 8  # values below which the p-value of Anderson and Darling's statistic is unknown
# Anderson-Darling for normality, mean and variance estimated: (upper end, a, b, c) of p = exp(a + b A + c A^2),
# or of 1 - p where A is below .34 (table 4.9).
STEPHENS = ((0.2, -13.436, 101.14, -223.73), (0.34, -8.318, 42.796, -59.938), (0.6, 0.9177, -4.279, -1.38))
STEPHENS_TAIL, STEPHENS_END = (1.2937, -5.709, 0.0186), 13.0


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class Normality(Check):
    """Anderson-Darling test of residuals, mean and variance estimated.

    The statistic is ``A^2``; the p-value is that of ``A^2 (1 + 0.75/n + 2.25/n^2)``.

    Attributes
    ----------
    of : str
        Set of residuals, as in :class:`Residuals`.
    nobs : int
    """

    of: str
    nobs: int


def normality(residuals: Residuals) -> Normality | NotAvailable:
    """Anderson-Darling test of a set of residuals."""
    n = len(residuals.values)
    if residuals.free < FEWEST:
        return NotAvailable(
            f"residuals of {residuals.of} have {residuals.free} degrees of freedom: the test needs {FEWEST}"
        )
    statistic, p = anderson_darling(residuals.values)
    result = f"Anderson-Darling A2 = {statistic:.2f}, {format_p(p)}, n = {n}"
    normal = f"Residuals of {residuals.of} are consistent with normality ({result})."
    not_normal = (
        f"Residuals of {residuals.of} are not normal ({result}): prediction intervals are approximate, coefficients "
        "and their intervals are affected little."
    )
    return Normality(
        null=f"residuals of {residuals.of} are normal on the scale of the fit",
        statistic=statistic,
        symbol="A2",
        pvalue=p,
        verdict=not_normal if p < STRONG else normal,
        kept=normal,
        note=True,
        of=residuals.of,
        nobs=n,
    )


def anderson_darling(x: Array) -> tuple[float, float]:
    """``A^2`` and p-value of the Anderson-Darling test of normality, mean and variance estimated.

    Parameters
    ----------
    x : ndarray, shape (n,), n at least 8, not all equal

    Examples
    --------
    >>> A, p = anderson_darling(np.array([1.0, 2, 3, 4, 5, 6, 7, 8, 9, 40]))
    >>> round(A, 2), p < 0.001
    (1.74, True)
    """
    from scipy.special import log_ndtr

    n = len(x)
    z = np.sort((x - x.mean()) / x.std(ddof=1))
    A2 = -n - float(((2 * np.arange(1, n + 1) - 1) * (log_ndtr(z) + log_ndtr(-z[::-1]))).sum()) / n
    A = A2 * (1 + 0.75 / n + 2.25 / n**2)
    for end, a, b, c in STEPHENS:
        if end > A:
            p = float(np.exp(a + b * A + c * A**2))
            return A2, 1 - p if end < 0.6 else p
    a, b, c = STEPHENS_TAIL
    shown = min(A, STEPHENS_END)  # beyond it the parabola would turn up again
    return A2, float(np.exp(a + b * shown + c * shown**2))


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class Homoscedasticity(Check):
    """Breusch-Pagan test, studentised by Koenker: ``n R2`` of squared residuals on the terms of the law.

    Attributes
    ----------
    of : str
        Set of residuals, as in :class:`Residuals`.
    term : str
        Term with which the variance changes most.
    rises : bool
        Whether it rises with it.
    """

    of: str
    term: str
    rises: bool


def spread(law: LawFit, residuals: Residuals) -> Homoscedasticity | NotAvailable:
    """Breusch-Pagan test of a set of residuals on the terms of the law.

    Independent residuals give Koenker's ``n R2``. Residuals about a common level are correlated, and so are their
    squares: two of an edge's two are equal. The covariance of the scores allows for it.
    """
    from scipy.special import chdtrc

    names, scaled = _centred(residuals)
    Q = orthonormal(scaled)
    n, k = Q.shape
    if k == 0:
        return NotAvailable(f"no factor changes among the residuals of {residuals.of}")
    if residuals.free < k + 3:
        return NotAvailable(
            f"residuals of {residuals.of} have {residuals.free} degrees of freedom for {k} factors: too few to test "
            "homoscedasticity"
        )
    squares = residuals.values**2
    size = float(squares @ squares)
    squares = squares - squares.mean()
    if float(squares @ squares) <= HELD * size:
        return NotAvailable(f"residuals of {residuals.of} are all equal in size: their variance cannot be compared")
    s2, axes = np.linalg.eigh(_covariance_of_squares(Q, residuals))
    free = s2 > HELD  # two rows per edge have no information on variance changes within it
    scores = (axes.T @ (Q.T @ squares))[free]
    statistic = n * float((scores**2 / s2[free]).sum()) / float(squares @ squares)
    pull = scaled.T @ squares
    j = int(np.argmax(np.abs(pull)))
    df, rises = len(scores), bool(pull[j] > 0)
    p = float(chdtrc(df, statistic))
    result = f"Breusch-Pagan chi2({df}) = {statistic:.1f}, {format_p(p)}"
    kept = f"The variance of residuals of {residuals.of} is constant over the conditions ({result})."
    return Homoscedasticity(
        null=f"the variance of residuals of {residuals.of} is the same at all conditions",
        statistic=statistic,
        symbol="Breusch-Pagan chi2",
        df=df,
        pvalue=p,
        concern=concern_of(p),
        verdict=_rejected(law, residuals.of, result, names[j], rises) if concern_of(p) else kept,
        kept=kept,
        of=residuals.of,
        term=names[j],
        rises=rises,
    )


def _rejected(law: LawFit, of: str, result: str, term: str, rises: bool) -> str:
    rescaled = law.error == "additive" and rises  # in logs, a scatter that grows with the response is constant
    remedy = "fit with multiplicative errors" if rescaled else "one interval width for all conditions is misleading"
    return (
        f"Heteroscedasticity: the variance of residuals of {of} {'rises' if rises else 'falls'} with {term} "
        f"({result}): {remedy}."
    )


def _centred(residuals: Residuals) -> tuple[list[str], Array]:
    """Terms that change among the residuals: names, and columns centred and of length one."""
    terms = residuals.terms - residuals.terms.mean(axis=0)
    length = np.sqrt(np.einsum("ij,ij->j", terms, terms))
    seen = length > HELD * np.abs(residuals.terms).max(axis=0, initial=0.0)
    return [name for name, there in zip(residuals.names, seen, strict=True) if there], terms[:, seen] / length[seen]


def _covariance_of_squares(Q: Array, residuals: Residuals) -> Array:
    """Covariance of ``Q' e^2`` for e of unit variance, but for a factor; unity where residuals are independent."""
    if residuals.group is None or residuals.tied is None:
        return np.eye(Q.shape[1])
    of_edges = sums_by(residuals.group, residuals.tied[:, None] * Q, int(residuals.group.max()) + 1)
    return np.asarray((Q * (1 - residuals.tied**2)[:, None]).T @ Q + of_edges.T @ of_edges)
