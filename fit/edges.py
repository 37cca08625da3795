"""Inference by edge: jackknife standard errors (CR3), F between edges, and the variance between and within edges.

Rows of one cutting edge are repeated measures. The jackknife leaves out one edge at a time: it assumes nothing of the
dependence of rows within an edge, holds its level for what changes between edges (V, f, d) and within them (t), and
gives one covariance for the whole law. A random level of each edge, ``y = Z theta + u_edge + e`` with
``u ~ N(0, s_b^2)`` and ``e ~ N(0, s_w^2)``, is fitted as well, by restricted maximum likelihood; it splits the
variance. Given the ratio ``k = s_b^2 / s_w^2`` it is least squares of rows in which the mean of each edge is shrunk by
``1 / sqrt(1 + n_g k)``, so that the search is over one number, the intraclass correlation.

Sources: Bell & McCaffrey 2002, Survey Methodology 28, 169; Cameron & Miller 2015, J. Human Resources 50, 317 (CR3);
Pinheiro & Bates 2000, Mixed-Effects Models in S and S-PLUS, section 2.2 (random level).
"""

from dataclasses import dataclass
from math import log

import numpy as np
import pandas as pd

from ..core.arrays import Array, Flags, Ints, Texts
from ..core.display import Displayable, Plottable
from ..core.errors import FitError
from ..core.rounding import count
from .available import NotAvailable
from .least_squares import products_by, sums_by

BLOCK = 16_384  # rows at a time
SAME = 1e-9  # of a column's largest value: what it may differ by within an edge and still be constant there
NO_EDGES = NotAvailable(
    "no edge column: rows are taken as independent; if several come from one edge, intervals are too narrow"
)
EXACT_FIT = NotAvailable("the law meets every row exactly: there is no scatter to estimate")


@dataclass(frozen=True, slots=True, repr=False)
class RandomLevel(Displayable):
    """The law with a random level of each edge, fitted by restricted maximum likelihood.

    Attributes
    ----------
    theta, bse : ndarray, shape (p,)
        Generalised least-squares estimates and their standard errors.
    df : ndarray, shape (p,)
        Degrees of freedom: edges less parameters estimated between edges, or rows less edges less parameters
        estimated within them.
    sd_between, sd_within : float
        Standard deviations of the edge levels and of the rows about them, on the scale of the fit.
    """

    theta: Array
    bse: Array
    df: Array
    sd_between: float
    sd_within: float

    @property
    def icc(self) -> float:
        """Intraclass correlation: share of the variance that lies between edges."""
        total = self.sd_between**2 + self.sd_within**2
        return self.sd_between**2 / total if total > 0 else 0.0


@dataclass(frozen=True, slots=True, repr=False)
class EdgeInference(Plottable):
    """Standard errors of a law that are valid for repeated measures on an edge.

    Attributes
    ----------
    names : tuple of str
        Parameters, as ``LawFit.theta_names``.
    cov_theta : ndarray, shape (p, p)
        CR3 covariance of ``LawFit.theta``.
    df : int
        Its degrees of freedom, edges less one.
    n_edges : int
    within : tuple of bool
        Whether each parameter is estimated within edges (t, wear) or between them (V, f, d).
    moved : ndarray, shape (G, p)
        Change of each parameter when an edge is left out.
    edges : tuple of str
        Names of the edges, in the order of ``moved``.
    sizes : ndarray, shape (G,)
        Rows of each edge.
    mixed : RandomLevel
        The law with a random level of each edge.
    fvalue, row_fvalue : float or None
        F of the factors that change between edges only: with this covariance on ``(f_df, df)`` degrees of
        freedom, and with rows taken as independent. None where every factor changes within edges.
    """

    names: tuple[str, ...]
    cov_theta: Array
    df: int
    n_edges: int
    within: tuple[bool, ...]
    moved: Array
    edges: tuple[str, ...]
    sizes: Array
    mixed: RandomLevel
    fvalue: float | None
    row_fvalue: float | None

    @property
    def f_df(self) -> int:
        """Number of factors that change between edges only."""
        return sum(not w for w in self.within[1:])

    @property
    def f_pvalue(self) -> float | None:
        """P of ``fvalue``."""
        from scipy.special import fdtrc

        return None if self.fvalue is None else float(fdtrc(self.f_df, self.df, self.fvalue))

    @property
    def inflation(self) -> float | None:
        """Ratio of ``row_fvalue`` to ``fvalue``."""
        if self.fvalue is None or self.row_fvalue is None:
            return None
        return self.row_fvalue / self.fvalue

    @property
    def bse(self) -> "pd.Series[float]":
        """CR3 standard errors of ``theta``."""
        return pd.Series(np.sqrt(np.diag(self.cov_theta)), index=list(self.names))

    @property
    def df_between(self) -> int:
        """Edges less parameters that change between edges only, 1 or more."""
        return max(self.n_edges - len(self.within) + sum(self.within), 1)

    @property
    def df_within(self) -> int:
        """Rows less edges less parameters that change within edges, 1 or more."""
        return max(int(self.sizes.sum()) - self.n_edges - sum(self.within), 1)

    @property
    def rows_per_edge(self) -> float:
        """Harmonic mean of the rows of an edge."""
        return self.n_edges / float(np.sum(1.0 / self.sizes))

    @property
    def icc(self) -> float:
        """Share of the residual variance that lies between edges."""
        return self.mixed.icc


def infer_by_edge(
    Z: Array,
    residuals: Array,
    *,
    theta: Array,
    row_cov: Array,
    cov_unscaled: Array,
    names: tuple[str, ...],
    edge: Texts,
    within_of: Array,
) -> EdgeInference | NotAvailable:
    """Inference by edge from rows, or why these data do not allow it.

    Parameters
    ----------
    Z, residuals : ndarray, shape (n, p) and (n,)
        Columns along which the fit is linear, and its residuals.
    theta, row_cov, cov_unscaled : ndarray, shape (p,) and (p, p)
        The fit, its covariance with rows taken as independent, and that divided by the residual variance.
    names : tuple of str, names of theta
    edge : ndarray of str, shape (n,)
    within_of : ndarray, shape (n, p)
        Columns by which parameters are sorted into those between and within edges.
    """
    number, labels = pd.factorize(edge, sort=True)
    G = len(labels)
    within = tuple(changes_within(within_of, number).tolist())
    if why := too_few_edges(len(Z), G, Z.shape[1] - sum(within)):
        return NotAvailable(why)
    moved = left_out_moves(Z, residuals, cov_unscaled, number, G)
    if isinstance(moved, int):
        return NotAvailable(indispensable(str(labels[moved])))
    levels = fit_random_level(Z, residuals + Z @ theta, number, np.array(within))
    return of_moves(
        moved, theta, row_cov, names, tuple(map(str, labels)), np.bincount(number).astype(float), within, levels
    )


def changes_within(columns: Array, edge: Ints) -> Flags:
    """Whether each column (n, c) changes among the rows of one edge, edges numbered from 0.

    Examples
    --------
    >>> changes_within(np.array([[1, 50, 2.0], [1, 50, 4.0], [1, 80, 2.0]]), np.array([0, 0, 1])).tolist()
    [False, False, True]
    """
    first = np.zeros(edge.max() + 1, dtype=np.intp)
    first[edge[::-1]] = np.arange(len(edge))[::-1]
    moves = [np.any(np.abs(z - z[first][edge]) > SAME * np.abs(z).max()) for z in columns.T]
    return np.array(moves, dtype=bool)


def too_few_edges(nobs: int, G: int, between: int) -> str:
    """Reason why so few edges allow no inference by edge; empty where they do.

    ``between`` counts the parameters that change between edges only.
    """
    if nobs == G:
        return f"each of the {G} rows is a separate edge: rows are independent"
    if between + 1 > G:
        return (
            f"{count(G, 'edge')} for {count(between, 'parameter')} estimated between "
            f"edges: cut at least {between + 1 - G} more, at other conditions"
        )
    return ""


def indispensable(edge: str) -> str:
    """Reason for no inference by edge where one edge cannot be left out."""
    return (
        f"edge {edge} alone identifies a parameter of the law: it cannot be estimated without it. Cut another edge "
        "near its conditions"
    )


def of_moves(
    moved: Array,
    theta: Array,
    row_cov: Array,
    theta_names: tuple[str, ...],
    edges: tuple[str, ...],
    sizes: Array,
    within: tuple[bool, ...],
    levels: RandomLevel,
) -> EdgeInference:
    """Inference by edge from the changes of theta when each edge is left out.

    Parameters
    ----------
    moved : ndarray, shape (G, p)
    theta, row_cov : ndarray, shape (p,) and (p, p)
        The fit, and its covariance with rows taken as independent.
    theta_names, edges, sizes, within
        As in `EdgeInference`.
    levels : RandomLevel
        The fit with a random level of each edge.
    """
    G = len(edges)
    cov = (G - 1) / G * moved.T @ moved
    between = [j for j in range(1, len(theta)) if not within[j]]
    return EdgeInference(
        names=theta_names,
        cov_theta=cov,
        df=G - 1,
        n_edges=G,
        within=within,
        moved=moved,
        edges=edges,
        sizes=sizes,
        mixed=levels,
        fvalue=_wald(theta, cov, between),
        row_fvalue=_wald(theta, row_cov, between),
    )


def left_out_moves(Z: Array, residuals: Array, cov_unscaled: Array, edge: Ints, G: int) -> Array | int:
    """Change of theta when each edge is left out, shape (G, p); or the number of an edge that cannot be.

    With Q = Z L orthonormal, leaving edge g out moves L^-1 theta by ``-(I - Q_g'Q_g)^-1 Q_g' r_g``.

    Raises
    ------
    FitError
        The covariance has no root, as with values beyond the range of a double.
    """
    try:
        L = np.linalg.cholesky(cov_unscaled)
    except np.linalg.LinAlgError:
        L = np.full_like(cov_unscaled, np.nan)
    with np.errstate(over="ignore", invalid="ignore"):
        Q_all = Z @ L
    if not np.isfinite(Q_all).all():
        raise FitError(
            "the covariance of the parameters cannot be computed by edge: values of the response or of a factor are "
            "too extreme. Correct or leave out the largest and smallest of them."
        )
    left = np.eye(Z.shape[1]) - products_by(edge, Q_all, G)
    few = np.flatnonzero(np.linalg.eigvalsh(left)[:, 0] < 1e-10)
    if few.size:
        return int(few[0])
    score = sums_by(edge, Q_all * residuals[:, None], G)
    return np.asarray(-np.linalg.solve(left, score[:, :, None])[:, :, 0] @ L.T)


def _wald(theta: Array, cov: Array, which: list[int]) -> float | None:
    """F of some parameters together; None of none."""
    if not which:
        return None
    b = theta[which]
    return float(b @ np.linalg.solve(cov[np.ix_(which, which)], b)) / len(which)


def fit_random_level(Z: Array, y: Array, edge: Ints, within: Flags) -> RandomLevel:
    """Fit a random level of each edge by restricted maximum likelihood.

    Parameters
    ----------
    Z : ndarray, shape (n, p), the constant among its columns
    y : ndarray, shape (n,)
    edge : ndarray of int, shape (n,), edges numbered 0 to G - 1
    within : ndarray of bool, shape (p,), whether a column changes within edges

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> edge = np.repeat(np.arange(40), 5)
    >>> y = 2.0 + rng.normal(0, 0.3, 40)[edge] + rng.normal(0, 0.1, 200)
    >>> fit = fit_random_level(np.ones((200, 1)), y, edge, np.array([False]))
    >>> round(fit.sd_within, 1), round(fit.sd_between, 1)
    (0.1, 0.3)
    """
    size = np.bincount(edge).astype(float)
    means = sums_by(edge, np.column_stack([Z, y]), len(size)) / size[:, None]
    return random_level(_within_triangle(Z, y, edge, means), means, size, within)


def random_level(inside: Array, means: Array, size: Array, within: Flags) -> RandomLevel:
    """The fit of `fit_random_level` from sums of the rows.

    Parameters
    ----------
    inside : ndarray, shape (any, p + 1)
        Triangle of ``[Z y]`` less the means of each edge.
    means : ndarray, shape (G, p + 1)
        Mean of ``[Z y]`` in each edge.
    size : ndarray, shape (G,)
        Rows of each edge.
    within : ndarray of bool, shape (p,)
    """
    from scipy.optimize import minimize_scalar

    n, p = int(size.sum()), means.shape[1] - 1

    def triangle(icc: float) -> Array:
        weight: Array = np.sqrt(size / (1 + size * icc / (1 - icc)))
        return np.asarray(np.linalg.qr(np.vstack([inside, weight[:, None] * means]), mode="r"))

    def criterion(icc: float) -> float:
        """Minus twice the restricted log-likelihood, but for a constant."""
        R = np.abs(np.diag(triangle(icc)))
        inflation = float(np.log1p(size * icc / (1 - icc)).sum())
        return float(2 * (n - p) * log(max(float(R[p]), 1e-300)) + inflation + 2 * np.log(R[:p]).sum())

    found = minimize_scalar(criterion, bounds=(0.0, 1 - 1e-6), method="bounded", options={"xatol": 1e-7})
    icc = float(found.x) if criterion(float(found.x)) < criterion(0.0) else 0.0
    R = triangle(icc)
    inverse = np.linalg.inv(R[:p, :p])
    s2 = float(R[p, p] ** 2) / (n - p)
    G, inner = len(size), int(within.sum())
    return RandomLevel(
        theta=inverse @ R[:p, p],
        bse=np.sqrt(s2 * np.einsum("ij,ij->i", inverse, inverse)),
        df=np.where(within, n - G - inner, G - (p - inner)).astype(float),
        sd_between=float(np.sqrt(s2 * icc / (1 - icc))),
        sd_within=float(np.sqrt(s2)),
    )


def _within_triangle(Z: Array, y: Array, edge: Ints, means: Array) -> Array:
    """Triangle of ``[Z y]`` less the means of each edge, in blocks, so that no copy of the whole is made."""
    blocks = []
    for start in range(0, len(y), BLOCK):
        rows = slice(start, start + BLOCK)
        about = np.column_stack([Z[rows], y[rows]]) - means[edge[rows]]
        blocks.append(np.linalg.qr(about, mode="r"))
    return np.vstack(blocks) if len(blocks) == 1 else np.asarray(np.linalg.qr(np.vstack(blocks), mode="r"))
