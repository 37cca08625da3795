"""Test of a common time exponent of all edges (analysis of covariance), and random time exponents of edges.

The test compares, with a level of each edge in both models, one common slope of ln t against a slope of each edge. It
assumes independent rows about the line of their edge; serial correlation of cumulated wear raises its level.

Random slopes: in ``ln R = Z theta + (1, ln t) u_edge + e`` with ``u ~ N(0, s^2 D)``, D is estimated by restricted
maximum likelihood; rows whitened by it give theta by least squares.

Sources: Draper & Smith 1998, Applied Regression Analysis, section 14.4; Pinheiro & Bates 2000, Mixed-Effects Models in
S and S-PLUS, section 2.2.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from ...core.arrays import MAD, Array, Ints
from ...core.display import Plottable
from ..available import NotAvailable
from ..lawfit import LawFit
from ..least_squares import sums_by
from .check import SIGNIFICANT, Check, format_p
from .strata import NO_ROWS

TIME = "t"
FLAT = 1e-9  # spread of ln t within an edge below which the edge has no exponent
ROUNDING = 1e-20  # of the within-edge sum of squares: below it rows lie on their edges' lines exactly


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class CommonExponent(Check, Plottable):
    """F test of one time exponent of all edges.

    Attributes
    ----------
    response : str
    exponents : Series, indexed by edge
        Time exponent of each edge with more than one time, adjusted for other factors that change within edges.
    common : float
        The common exponent, from within edges alone.
    """

    response: str
    exponents: "pd.Series[float]"
    common: float


def common_exponent(law: LawFit, clip: float = np.inf) -> CommonExponent | NotAvailable:
    """Test one exponent of time for all edges of a power law, in logarithms.

    Parameters
    ----------
    law : LawFit
    clip : float
        Robust standard deviations of the rows about the common law, beyond which a row is drawn in. Heavy tails raise
        the level of the F test: with errors of Student's t with 4 degrees of freedom and edges of unequal length a test
        at 1 % rejects 4 to 8 % of sound files; with rows drawn in to 2.5, 1 %.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> common_exponent(law).df
    (23, 191)
    """
    from scipy.special import fdtrc

    if reason := _not_applicable(law):
        return NotAvailable(reason)
    names, edge = np.unique(np.asarray(law.edge), return_inverse=True)
    y, time, others = _inside(law, edge)
    y = _clipped(y, np.column_stack([time, others]), edge, clip)
    informative = np.bincount(edge, weights=time**2) > FLAT
    df = int(informative.sum()) - 1
    slopes = _slopes(edge, time, np.column_stack([y, others]))
    own = np.column_stack([y, others]) - time[:, None] * slopes[edge]
    own[:, np.abs(own).max(axis=0) <= FLAT] = 0.0  # a factor that is an exact power of time on every edge
    b, left, rank = _least(own[:, 1:], own[:, 0])
    df_left = len(y) - len(names) - df - 1 - rank
    exact = left <= ROUNDING * float(y @ y)
    if reason := _untestable(len(y), len(names), df, df_left, exact):
        return NotAvailable(reason)
    together, all_left, _ = _least(np.column_stack([time, others]), y)
    F = max(all_left - left, 0.0) / df / (left / df_left)
    exponents = (slopes[:, 0] - slopes[:, 1:] @ b)[informative]
    p = float(fdtrc(df, df_left, F))
    result = f"F({df}, {df_left}) = {F:.3g}, {format_p(p)}"
    low, high = (str(names[informative][i]) for i in (exponents.argmin(), exponents.argmax()))
    rejected = (
        f"A common time exponent is rejected ({result}): exponents of edges range from {exponents.min():.2f} "
        f"(edge {low}) to {exponents.max():.2f} (edge {high})."
    )
    kept = f"A common time exponent of {len(exponents)} edges is kept ({result})."
    return CommonExponent(
        null="all edges have the same time exponent",
        statistic=float(F),
        symbol="F",
        df=(df, df_left),
        pvalue=p,
        concern=int(p < SIGNIFICANT),
        verdict=rejected if p < SIGNIFICANT else kept,
        kept=kept,
        response=law.response,
        exponents=pd.Series(exponents, index=[str(name) for name in names[informative]], name=TIME),
        common=float(together[0]),
    )


def _not_applicable(law: LawFit) -> str | None:
    if law.form != "power":
        return f"a law of the form {law.form.replace('_', ' ')} has no time exponent"
    if TIME not in law.factors:
        return f"no time {TIME} among the factors of {law.response}: there is no time exponent"
    if law.rows is None:
        return NO_ROWS
    if law.edge is None:
        return "no edge column: the edge of each row is unknown"
    if len(set(law.edge)) < 2:
        return f"all {law.nobs} rows come from one edge: there is no other exponent to compare with"
    if (law.observed <= 0).any():
        return f"{law.response} is zero or negative in some rows: exponents of edges are estimated in logarithms"
    return None


def _untestable(n: int, edges: int, df: int, df_left: int, exact: bool) -> str | None:
    if df < 1:
        return f"{df + 1} of {edges} edges were measured at more than one time: two are needed"
    if df_left < 1:
        return (
            f"{n} rows of {edges} edges leave no degrees of freedom with a level and an exponent of each edge: "
            "measure each edge at three times or more"
        )
    return "the rows of each edge lie on its own line exactly: there is no residual variance" if exact else None


def _inside(law: LawFit, edge: Ints) -> tuple[Array, Array, Array]:
    """Logarithms of R and t, and the other columns that change within edges, each less its edge's mean."""
    logs = np.log(law.X)
    rows = np.column_stack([np.log(law.observed), logs, law.shifts])
    size = np.bincount(edge)
    means = sums_by(edge, rows, len(size)) / size[:, None]
    rows = rows - means[edge]
    j = law.factors.index(TIME)
    others = np.delete(rows[:, 1:], j, axis=1)
    return rows[:, 0], rows[:, 1 + j], others[:, np.abs(others).max(axis=0, initial=0.0) > FLAT]


def _clipped(y: Array, columns: Array, edge: Ints, clip: float) -> Array:
    """Logarithms of the response within edges, with residuals of the common law drawn in to ``clip`` robust sd."""
    fitted = columns @ np.linalg.lstsq(columns, y, rcond=1e-9)[0]
    r = y - fitted
    n, used = len(y), int(edge.max()) + 1 + columns.shape[1]
    most = clip * MAD * float(np.median(np.abs(r))) * np.sqrt(n / max(n - used, 1))
    if np.isnan(most) or most == 0 or (np.abs(r) <= most).all():
        return y
    y = fitted + np.clip(r, -most, most)
    size = np.bincount(edge)
    return np.asarray(y - (sums_by(edge, y[:, None], len(size)) / size[:, None])[edge, 0])


def _slopes(edge: Ints, time: Array, columns: Array) -> Array:
    """Slope of each column on time within each edge, shape (G, k); 0 where time does not change."""
    size = np.bincount(edge, weights=time**2)
    size = np.where(size > FLAT, size, np.inf)
    return np.asarray(sums_by(edge, time[:, None] * columns, len(size)) / size[:, None])


def _least(X: Array, y: Array) -> tuple[Array, float, int]:
    """Coefficients, residual sum of squares and rank; redundant columns are allowed."""
    if not X.shape[1]:
        return np.empty(0), float(y @ y), 0
    b, _, rank, _ = np.linalg.lstsq(X, y, rcond=1e-9)
    r = y - X @ b
    return np.asarray(b, dtype=float), float(r @ r), int(rank)


def slope_spread(Z: Array, y: Array, edge: Ints, time: Array) -> Array:
    """D of edge levels and edge slopes in units of the residual variance, shape (2, 2), by REML.

    Parameters
    ----------
    Z : ndarray, shape (n, p)
    y, time : ndarray, shape (n,), ln R and ln t, the latter best centred
    edge : ndarray of int, shape (n,), edges numbered 0 to G - 1

    Examples
    --------
    >>> rng = np.random.default_rng(2)
    >>> edge, time = np.repeat(np.arange(60), 6), np.tile(np.linspace(-1, 1, 6), 60)
    >>> y = (1 + rng.normal(0, 0.3, 60)[edge]) * time + rng.normal(0, 0.1, 360)
    >>> bool(2 < np.sqrt(slope_spread(np.column_stack([np.ones(360), time]), y, edge, time)[1, 1]) < 4)
    True
    """
    from scipy.optimize import minimize

    n, p = Z.shape
    Q = np.linalg.qr(Z)[0]
    rows = np.column_stack([Q, y - Q @ (Q.T @ y)])
    W = np.column_stack([np.ones(n), time])
    WW = _by_edge(W, W, edge)
    WR = _by_edge(W, rows, edge)
    RR = rows.T @ rows

    def criterion(x: Array) -> float:
        """Minus twice the restricted log-likelihood, but for a constant."""
        L = np.array([[x[0], 0.0], [x[1], x[2]]])
        inner = np.eye(2) + L.T @ WW @ L
        LW = L.T @ WR
        M = RR - np.einsum("gik,gil->kl", LW, np.linalg.solve(inner, LW))
        schur = float(M[p, p] - M[p, :p] @ np.linalg.solve(M[:p, :p], M[:p, p]))
        logs = np.log(np.linalg.det(inner)).sum() + np.linalg.slogdet(M[:p, :p])[1]
        return float(logs + (n - p) * np.log(max(schur, 1e-300)))

    found = minimize(criterion, np.array([1.0, 0.0, 1.0]), method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-7})
    L = np.array([[found.x[0], 0.0], [found.x[1], found.x[2]]])
    return np.asarray(L @ L.T)


def whitened(A: Array, edge: Ints, time: Array, D: Array) -> Array:
    """Rows of A, shape (n, k), turned so that rows of an edge are independent under D, each of variance 1.

    Examples
    --------
    >>> whitened(np.array([[2.0], [4.0]]), np.array([0, 0]), np.zeros(2), np.zeros((2, 2))).ravel().tolist()
    [2.0, 4.0]
    """
    out = np.empty_like(A)
    for g in range(int(edge.max()) + 1):
        rows = np.flatnonzero(edge == g)
        W = np.column_stack([np.ones(len(rows)), time[rows]])
        out[rows] = np.linalg.solve(np.linalg.cholesky(np.eye(len(rows)) + W @ D @ W.T), A[rows])
    return out


def _by_edge(A: Array, B: Array, edge: Ints) -> Array:
    """A_g' B_g of each edge, shape (G, a, b)."""
    out = np.zeros((int(edge.max()) + 1, A.shape[1], B.shape[1]))
    np.add.at(out, edge, A[:, :, None] * B[:, None, :])
    return out
