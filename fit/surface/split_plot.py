"""Term-wise analysis of variance with the error term of each term: edges for V, f, d, rows within edges for t.

An edge is a whole plot: rows of it share its level, so that a term which changes only between edges is tested against
the variation between edges, and a term that changes within edges against the variation within them. Both are tests of
``y = X b + u_edge + e`` by generalised least squares, with the variances of u and e by restricted maximum likelihood
and the degrees of freedom of Kenward & Roger. Where all edges have the same times these are the exact F tests of the
two strata; where they have not, terms draw on both strata and their degrees of freedom lie between. The variance of u
may come out below zero, as a mean square between edges below that within: bounded at zero, the tests lose their level.

Type III adjusts a term for all others, type II for those that do not contain it: V for f and f:d, but not for V^2 and
V:f. Type II does not depend on the origin of the factors; type III does, so that factors are centred.

Sources: Kenward & Roger 1997, Biometrics 53, 983 (doi 10.2307/2533558), the formulas as in Halekoh & Hojsgaard 2014,
J. Stat. Softw. 59(9) (doi 10.18637/jss.v059.i09); Littell, Milliken, Stroup, Wolfinger & Schabenberger 2006, SAS for
Mixed Models, chapter 4 (variances below zero); Nelder 1977, J. R. Stat. Soc. A 140, 48 (marginality).
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import pandas as pd

from ...core.arrays import Array, Flags, Ints
from ...core.display import Displayable
from ..available import NotAvailable
from ..least_squares import linear, sums_by

Type = Literal[2, 3]

SAME = 1e-9  # of a column's largest value: what it may differ by and still be constant
NEARLY_ZERO = 1e-10
FARTHEST = 16.0  # logarithm of the largest ratio of variances that is searched
EDGES, WITHIN, ROWS = "edges", "rows within edges", "rows"


@dataclass(frozen=True, slots=True, repr=False)
class TermTest(Displayable):
    """F test of one term, or of a group of terms.

    Attributes
    ----------
    name : str
        ``V``, ``V^2``, ``V:f``; of a group, what it holds.
    error : {"edges", "rows within edges", "rows"}
        What the term is tested against.
    df, df_error : float
        Numerator and denominator degrees of freedom; the latter need not be whole where edges have unequal times.
    fvalue, pvalue : float
    estimate, se : float or None
        Coefficient of a term of one column, in the units of the columns, with its standard error.
    sum_sq : float or None
        Sum of squares of the rows; None where edges have unequal times, which have no single one.
    """

    name: str
    error: str
    df: float
    df_error: float
    fvalue: float
    pvalue: float
    estimate: float | None = None
    se: float | None = None
    sum_sq: float | None = None


@dataclass(frozen=True, eq=False)
class EdgeModel:
    """Linear model of rows with a random level of each edge, reduced to within-edge contrasts and means of edges.

    Attributes
    ----------
    stacked : ndarray, shape (r + G, p + 1)
        Columns and response: r rows that hold all within-edge contrasts, then means of edges times sqrt(rows).
    size : ndarray, shape (r + G,)
        Rows of each edge; 0 for the contrasts.
    nobs, n_edges : int
        Rows and edges; ``n_edges`` is 0 where rows are independent, and ``stacked`` then holds the rows.
    within : ndarray of bool, shape (p,)
        Which columns change within edges.
    ratio : float
        Variance between edges over that within, estimated; above -1 / rows of an edge.
    """

    stacked: Array
    size: Array
    nobs: int
    n_edges: int
    within: Flags
    ratio: float

    @cached_property
    def whitened(self) -> Array:
        """Stacked rows of equal variance, shape (r + G, p + 1)."""
        return np.asarray(self.stacked / np.sqrt(1 + self.size * self.ratio)[:, None])

    @cached_property
    def beta(self) -> Array:
        """Generalised least-squares coefficients, shape (p,)."""
        return linear(self.whitened[:, :-1], self.whitened[:, -1]).params

    @cached_property
    def row_variance(self) -> float:
        """Variance of rows within edges (of rows, where they are independent)."""
        left = self.whitened[:, -1] - self.whitened[:, :-1] @ self.beta
        return float(left @ left) / (self.nobs - len(self.beta))

    @property
    def edge_variance(self) -> float:
        """Variance between edges; below zero where edges differ by less than their rows explain."""
        return self.ratio * self.row_variance

    @property
    def df_between(self) -> int:
        """Edges less the columns that change only between them, the constant among these."""
        return self.n_edges - int((~self.within).sum())

    @property
    def df_within(self) -> int:
        """Rows less edges (or less the constant) less the columns that change within edges."""
        return self.nobs - (self.n_edges or 1) - int(self.within.sum())

    @cached_property
    def orthogonal(self) -> bool:
        """Whether each column lies in one stratum, so that tests of the strata are exact."""
        of_edges = self.size > 0
        if not of_edges.any():
            return True
        root = np.sqrt(self.size[of_edges])
        means = self.stacked[of_edges, :-1][:, self.within] / root[:, None]
        flat = np.ptp(means, axis=0) <= SAME * np.maximum(
            np.abs(self.stacked[:, :-1][:, self.within]).max(axis=0), SAME
        )
        return bool(np.ptp(self.size[of_edges]) == 0 and flat.all())

    @cached_property
    def _covariances(self) -> tuple[Array, Array, Array, Array]:
        """Covariance of beta, that adjusted, the pieces A_i (2, p, p) and the covariance W (2, 2) of the variances."""
        X = self.stacked[:, :-1]
        v = self.row_variance * (1 + self.size * self.ratio)
        parts = np.vstack([np.ones_like(v), self.size])[: 2 if self.n_edges else 1]
        phi = linear(X / np.sqrt(v)[:, None], np.zeros(len(X))).cov_unscaled
        A: Array = np.array([X.T @ ((d / v**2)[:, None] * X) for d in parts], dtype=float)
        Q = np.array([[X.T @ ((a * b / v**3)[:, None] * X) for b in parts] for a in parts])
        info = (parts / v**2) @ parts.T - 2 * np.einsum("kl,ijlk->ij", phi, Q)
        info[0, 0] += (self.nobs - len(v)) / self.row_variance**2  # contrasts without any column, left out of stacked
        information = (info + np.einsum("iab,jba->ij", phi @ A, phi @ A)) / 2
        W: Array = np.asarray(np.linalg.inv(information), dtype=float)
        k = len(parts)
        between = sum(W[i, j] * (Q[i, j] - A[i] @ phi @ A[j]) for i in range(k) for j in range(k))
        return phi, np.asarray(phi + 2 * phi @ between @ phi), A, W

    def tested(self, L: Array) -> tuple[float, float, float]:
        """F, p and denominator degrees of freedom of the hypothesis ``L beta = 0``, L of shape (q, p)."""
        from scipy.special import fdtrc

        q, b = len(L), L @ self.beta
        phi, adjusted, A, W = self._covariances
        exact = self._exact_df(L)
        if exact is not None:
            F = float(b @ np.linalg.solve(L @ phi @ L.T, b)) / q
            return F, float(fdtrc(q, exact, F)), float(exact)
        F = float(b @ np.linalg.solve(L @ adjusted @ L.T, b)) / q
        if not np.isfinite(F) or F < 0:  # with a variance far below zero the adjusted covariance may be indefinite
            F = float(b @ np.linalg.solve(L @ phi @ L.T, b)) / q
        theta = L.T @ np.linalg.solve(L @ phi @ L.T, L)
        M = [theta @ phi @ part @ phi for part in A]
        pairs = [(i, j) for i in range(2) for j in range(2)]
        a1 = sum(W[i, j] * np.trace(M[i]) * np.trace(M[j]) for i, j in pairs)
        a2 = sum(W[i, j] * np.sum(M[i] * M[j].T) for i, j in pairs)
        df, scale = _kenward_roger(q, float(a1), float(a2))
        df = float(np.clip(df, 1.0, self.df_between + self.df_within))
        return F * scale, float(fdtrc(q, df, F * scale)), df

    def _exact_df(self, L: Array) -> int | None:
        """Degrees of freedom where a hypothesis is of one of two orthogonal strata; None where it is not."""
        used = np.any(L != 0, axis=0)
        if not self.orthogonal or (used & self.within).any() == (used & ~self.within).any():
            return None if self.n_edges else self.df_within
        return self.df_within if (used & self.within).any() or not self.n_edges else self.df_between

    def estimate(self, c: Array) -> tuple[float, float, float]:
        """Estimate of ``c' beta``, its standard error and degrees of freedom, c of shape (p,)."""
        _, _, df = self.tested(c[None, :])
        phi, adjusted, *_ = self._covariances
        variance = float(c @ adjusted @ c)
        return float(c @ self.beta), float(np.sqrt(variance if variance > 0 else c @ phi @ c)), df

    def of_smaller(self, keep: Sequence[int], tested: Sequence[int]) -> Array:
        """Rows L, shape (q, p), of the coefficients of columns ``tested`` in the model of columns ``keep`` alone."""
        X = self.whitened[:, :-1]
        small = X[:, list(keep)]
        at = [list(keep).index(j) for j in tested]
        return np.asarray(np.linalg.pinv(small) @ X)[at]


def _kenward_roger(q: int, a1: float, a2: float) -> tuple[float, float]:
    """Denominator degrees of freedom and scale of an F statistic of q rows (Kenward & Roger 1997, section 3)."""
    b = (a1 + 6 * a2) / (2 * q)
    g = ((q + 1) * a1 - (q + 4) * a2) / ((q + 2) * a2)
    base = 3 * q + 2 * (1 - g)
    top, left, right = 1 + g / base * b, 1 - (q - g) / base * b, 1 - (q + 2 - g) / base * b
    mean = 1 - a2 / q  # of F, its reciprocal
    ratio = mean / left if abs(left) > NEARLY_ZERO else 1.0
    df = 4 + (q + 2) * right / (ratio**2 * top - right)
    return df, df * mean / (df - 2) if abs(df - 2) > 100 * NEARLY_ZERO else 1.0


def edge_model(X: Array, y: Array, edge: Ints | None = None, *, saturated: bool = False) -> EdgeModel | NotAvailable:
    """The model of rows with columns X, the constant among them, or why these rows do not allow its tests.

    Parameters
    ----------
    X : ndarray, shape (n, p)
    y : ndarray, shape (n,)
    edge : ndarray of int, shape (n,), or None
        Edges numbered 0 to G - 1. None, or edges of one row each: rows are independent.
    saturated : bool
        True: for a selection of terms alone, also where terms leave no degrees of freedom for tests.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> edge = np.repeat(np.arange(40), 5)
    >>> y = rng.normal(0, 0.3, 40)[edge] + rng.normal(0, 0.1, 200)
    >>> model = edge_model(np.ones((200, 1)), y, edge)
    >>> round(model.edge_variance**0.5, 1), round(model.row_variance**0.5, 1), model.df_between
    (0.3, 0.1, 39)
    """
    n, p = X.shape
    if edge is None or int(edge.max()) + 1 == n:
        if n <= p:
            return NotAvailable(f"{n} rows for {p} coefficients: no degrees of freedom are left for tests")
        return EdgeModel(np.column_stack([X, y]), np.zeros(n), n, 0, np.arange(p) > 0, 0.0)
    rows = np.bincount(edge).astype(float)
    means = sums_by(edge, np.column_stack([X, y]), len(rows)) / rows[:, None]
    about = np.column_stack([X, y]) - means[edge]
    within = np.abs(about[:, :-1]).max(axis=0) > SAME * np.abs(X).max(axis=0)
    about[:, :-1][:, ~within] = 0.0
    inside = np.asarray(np.linalg.qr(about, mode="r"))
    stacked = np.vstack([inside, np.sqrt(rows)[:, None] * means])
    size = np.concatenate([np.zeros(len(inside)), rows])
    model = EdgeModel(stacked, size, n, len(rows), within, 0.0)
    if saturated and min(model.df_within, model.df_between) < 1:
        return replace(model, ratio=1.0)
    if model.df_within < 1:
        return NotAvailable(
            f"{n} rows of {len(rows)} edges for {int(within.sum())} terms that change within edges: no degrees of "
            "freedom are left within edges; measure each edge more often"
        )
    if model.df_between < 1:
        return NotAvailable(
            f"{len(rows)} edges for {len(rows) - model.df_between} coefficients that change between edges: no degrees "
            f"of freedom are left to test them against; cut at least {1 - model.df_between} more or fit fewer terms"
        )
    ratio = _ratio_of_strata(model) if model.orthogonal else _variance_ratio(stacked, size, n)
    return replace(model, ratio=ratio)


def _ratio_of_strata(model: EdgeModel) -> float:
    """Variance between edges over that within from the mean squares of two orthogonal strata."""
    of_edges = model.size > 0
    squares = []
    for rows, columns, df in ((of_edges, ~model.within, model.df_between), (~of_edges, model.within, model.df_within)):
        part = model.stacked[rows]
        left = part[:, -1] - part[:, :-1][:, columns] @ np.linalg.lstsq(part[:, :-1][:, columns], part[:, -1])[0]
        squares.append(float(left @ left) / df)
    between, inside = squares
    rows_per_edge = float(model.size.max())
    return float(max(between / max(inside, 1e-300), np.exp(-FARTHEST)) - 1) / rows_per_edge


def _variance_ratio(stacked: Array, size: Array, n: int) -> float:
    """Variance between edges over that within, by restricted maximum likelihood, above -1 / (largest edge)."""
    from scipy.optimize import minimize_scalar

    p, lowest = stacked.shape[1] - 1, 1 / float(size.max())

    def criterion(u: float) -> float:
        """Minus twice the restricted log-likelihood of the ratio exp(u) - lowest, but for a constant."""
        v = 1 + size * (np.exp(u) - lowest)
        R = np.abs(np.diag(np.linalg.qr(stacked / np.sqrt(v)[:, None], mode="r")))
        left = max(float(R[p]), 1e-300)
        return float(2 * (n - p) * np.log(left) + np.log(v).sum() + 2 * np.log(R[:p]).sum())

    # the criterion may have two minima, so the search starts on a grid
    grid = np.linspace(-FARTHEST, FARTHEST, 65) + np.log(lowest)
    at = int(np.argmin([criterion(float(u)) for u in grid]))
    ends = (float(grid[max(at - 1, 0)]), float(grid[min(at + 1, len(grid) - 1)]))
    found = minimize_scalar(criterion, bounds=ends, method="bounded", options={"xatol": 1e-12})
    return float(np.exp(found.x) - lowest)


def term_tests(
    model: EdgeModel,
    terms: Mapping[str, Sequence[int]],
    *,
    typ: Type = 3,
    containing: Mapping[str, Collection[str]] | None = None,
    groups: Mapping[str, Collection[str]] | None = None,
) -> tuple[TermTest, ...]:
    """F test of each term, then of each group of terms.

    Parameters
    ----------
    model : EdgeModel
    terms : mapping of str to sequence of int
        Columns of each term; of a category several.
    typ : {2, 3}
        Type II adjusts a term for all but those in ``containing`` of it, type III for all others.
    containing : mapping of str to names
        Terms that contain a term: of V, V^2 and V:f.
    groups : mapping of str to names
        Terms that are tested together; adjusted as their terms are.

    Examples
    --------
    >>> x, edge = np.repeat([-1.0, 0, 1, -1, 0, 1], 2), np.repeat(np.arange(6), 2)
    >>> y = np.array([1.0, 1.2, 2.3, 2.1, 2.9, 3.2, 0.8, 1.1, 1.9, 2.0, 3.1, 2.8])
    >>> (test,) = term_tests(edge_model(np.column_stack([np.ones(12), x]), y, edge), {"V": [1]})
    >>> test.error, test.df, round(test.df_error, 6), round(test.fvalue, 2)
    ('edges', 1, 4.0, 296.02)
    """
    wider = {name: set(containing.get(name, ())) if containing and typ == 2 else set() for name in terms}
    single = [_term_test(model, name, {name}, wider[name], terms) for name in terms]
    together = [
        _term_test(model, name, set(members), set.intersection(*(wider[one] for one in members)) - set(members), terms)
        for name, members in (groups or {}).items()
        if members
    ]
    return (*single, *together)


def _term_test(
    model: EdgeModel, name: str, members: set[str], wider: set[str], terms: Mapping[str, Sequence[int]]
) -> TermTest:
    """Test of members together, the wider terms left out of the model."""
    tested = [j for one in terms if one in members for j in terms[one]]
    L = _hypothesis(model, tested, {j for one in wider for j in terms[one]})
    F, pvalue, df_error = model.tested(L)
    error = error_of(model, tested)
    sum_sq = F * len(tested) * error_mean_square(model, error) if model.orthogonal else None
    estimate, se = (None, None) if len(tested) > 1 else model.estimate(L[0])[:2]
    return TermTest(name, error, len(tested), df_error, F, pvalue, estimate, se, sum_sq)


def _hypothesis(model: EdgeModel, tested: Sequence[int], out: Collection[int]) -> Array:
    """Coefficients of the tested columns, those in ``out`` left out of the model, as rows L (q, p)."""
    p = len(model.beta)
    return model.of_smaller([j for j in range(p) if j not in out], tested) if out else np.eye(p)[list(tested)]


def error_of(model: EdgeModel, columns: Sequence[int]) -> str:
    """Error that a term of these columns is tested against."""
    if not model.n_edges:
        return ROWS
    return WITHIN if model.within[list(columns)].all() else EDGES


def error_mean_square(model: EdgeModel, error: str) -> float:
    """Mean square of an error term, per row: of edges, the row variance plus rows times the edge variance."""
    rows = float(model.size.max()) if error == EDGES else 0.0
    return model.row_variance + rows * model.edge_variance


def means_regression(model: EdgeModel) -> Array:
    """Columns that change between edges and the level of each edge, of equal variance, shape (G, c + 1).

    Levels are means of edges, freed of the terms within edges at their estimates, which matters where edges have
    unequal times. Where rows are independent they are the rows.
    """
    if not model.n_edges:
        return model.whitened
    rows = model.whitened[model.size > 0]
    inner = np.append(model.within, False)
    rows[:, -1] -= rows[:, inner] @ model.beta[model.within]
    return np.asarray(rows[:, ~inner])


def frame_of_tests(tests: Sequence[TermTest]) -> pd.DataFrame:
    """Tests as a frame: error term, df, df_error, sum_sq, F, p, estimate and se, a row for each."""
    rows = [
        (one.error, one.df, one.df_error, one.sum_sq, one.fvalue, one.pvalue, one.estimate, one.se) for one in tests
    ]
    columns = ["error", "df", "df_error", "sum_sq", "F", "p", "estimate", "se"]
    return pd.DataFrame(rows, index=[one.name for one in tests], columns=columns)
