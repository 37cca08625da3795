"""Strata of a law: levels of edges, and rows about them; the columns and residuals that the checks share.

Rows of one edge share that edge's level, so their scatter carries no information on how two edges at the same setting
differ. Edges of unequal length are weighted by the variance split, estimated from the law itself.

Sources: Henderson 1953, Biometrics 9, 226, method 3; Hurlbert 1984, Ecological Monographs 54, 187 (pseudoreplication).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from shlex import quote

import numpy as np
import pandas as pd

from ...core.arrays import Array, Flags, Ints, Texts
from ...core.errors import FitError
from ...datasets import Runs
from ..available import NotAvailable
from ..lawfit import LawFit
from ..least_squares import sums_by
from ..regression import refitted
from .check import Suspect

FEWEST = 3  # degrees of freedom of a test between edges
LIFE = "T"
MOST_OF_LEVEL = 2 / 3  # of the edges of a level
NO_ROWS = "a law of a stream keeps no rows, and checks use them: fit a sample of the rows in memory"


def no_scatter(law: LawFit) -> str | None:
    """Reason why a law has no rows, or no residual variance, to test it by; None where it has both.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("ac2017_table1")), "AW", ["V", "f"])
    >>> no_scatter(law) is None
    True
    """
    if law.rows is None:
        return NO_ROWS
    if law.df_resid <= 0:
        return f"{law.nobs} observations fix {len(law.theta)} parameters exactly: no degrees of freedom are left"
    return "the law fits every row exactly: there is no residual variance" if law.exact else None


def is_computed(name: str, runs: Runs | None) -> bool:
    """Whether a quantity was computed from others when the file was read: it has no unit of its own to be wrong."""
    return runs is not None and any(one.role == name for one in runs.derived)


def has_repeated_edges(law: LawFit) -> bool:
    """Whether some edge gave more than one row."""
    return law.n_edges is not None and law.n_edges < law.nobs


def units_of(law: LawFit) -> tuple[str, Ints]:
    """The unit of independent observation, ``edge`` or ``row``, and the number of each row's unit, shape (n,)."""
    if law.edge is None:
        return "row", np.arange(law.nobs)
    return "edge", np.unique(law.edge, return_inverse=True)[1]


def rows_in(law: LawFit, runs: Runs) -> Ints | None:
    """Positions in the runs of the rows of a law; None where rows of the runs share lines, or lack those of the law."""
    place = {line: i for i, line in enumerate(runs.lines.tolist())}
    if len(place) < len(runs) or not place.keys() >= set(law.lines.tolist()):
        return None
    return np.array([place[line] for line in law.lines.tolist()], dtype=np.intp)


def of_one_level(law: LawFit, columns: Mapping[str, Texts], edges: list[str]) -> str:
    """Clause on two edges or more that are most of those of one level of a column; empty where none has them so."""
    here = np.isin(np.asarray(law.edge).astype(str), edges)
    for name, x in columns.items() if len(edges) > 1 else ():
        at = x == x[here][0]
        if at[here].all() and len(edges) >= MOST_OF_LEVEL * len(np.unique(units_of(law)[1][at])):
            return f"they are edges of {name} {x[here][0]}, which may shift them all: fit it with --by {quote(name)}"
    return ""


def levels_of_edges(Z: Array, r: Array, x: Array, unit: Ints, moving: Flags) -> tuple[Array, Array, Array, Array]:
    """Levels of edges about the law, means of the columns that are constant within edges and of x, rows per edge."""
    size, p = np.bincount(unit).astype(float), Z.shape[1]
    means = sums_by(unit, np.column_stack([Z, r, x]), len(size)) / size[:, None]
    levels = means[:, p]
    if moving.any():
        inside = np.column_stack([Z[:, moving], r]) - (means[:, : p + 1][:, np.append(moving, True)])[unit]
        slope = np.linalg.lstsq(inside[:, :-1], inside[:, -1], rcond=1e-9)[0]
        levels = levels - means[:, :p][:, moving] @ slope
    return levels, means[:, :p][:, ~moving], means[:, p + 1 :], size


def blocks_between(levels: Array, others: Array, D: Array, weight: Array) -> tuple[float, int, float] | None:
    """Weighted regression of levels of edges on other columns and indicators D: F of D, its denominator df and p.

    None where D depends on the other columns, or too few degrees of freedom are left.

    Examples
    --------
    >>> D = np.repeat(np.eye(2)[:, 1:], 4, axis=0)
    >>> F, df, p = blocks_between(D[:, 0] + np.tile([0.1, -0.1], 4), np.ones((8, 1)), D, np.ones(8))
    >>> round(F, 6), df
    (150.0, 6)
    """
    from scipy.special import fdtrc

    root = np.sqrt(weight)[:, None]
    Q, R = np.linalg.qr(np.hstack([others, D]) * root)
    p, k, size = others.shape[1], D.shape[1], np.abs(np.diag(R))
    df = len(levels) - p - k
    if df < FEWEST or (size < 1e-9 * np.linalg.norm(np.hstack([others, D]) * root, axis=0)).any():
        return None
    y = root[:, 0] * levels
    effects = Q.T @ y
    F = float(np.sum(effects[p:] ** 2) / k / ((y @ y - effects @ effects) / df))
    return F, df, float(fdtrc(k, df, F))


MOST_ROWS = 5_000


def even_choice(law: LawFit, most: int = MOST_ROWS) -> LawFit:
    """The law refitted to at most ``most`` of its rows, evenly spaced; the law itself where it has no more.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> even_choice(law).nobs, even_choice(law, 100).nobs
    (239, 80)
    """
    if law.rows is None or law.nobs <= most:
        return law
    try:
        return refitted(law, law.error, slice(None, None, -(-law.nobs // most)))
    except FitError:  # a level or setting without selected rows
        return law


# Of columns scaled to length one: what is left of a column below this is rounding.
ROUNDING = 1e-9


def linear_columns(law: LawFit) -> tuple[Array, Array]:
    """Columns along which the fit is linear, shape (n, p), that of the constant first, and ``back``.

    All but the first are freed of it and scaled to length one, which keeps the digits that logarithms of
    narrow ranges lose; ``theta`` moves by ``back`` times what the coefficients of these columns move.
    """
    Z = law.gradient
    level = Z[:, 0]
    share = level @ Z[:, 1:] / (level @ level)
    rest = Z[:, 1:] - np.outer(level, share)
    length = np.sqrt(np.einsum("ij,ij->j", rest, rest))
    size = np.linalg.norm(level)
    back = np.diag(np.concatenate([[1 / size], 1 / length]))
    back[0, 1:] = -share / length
    return np.column_stack([level / size, rest / length]), back


def without_levels(A: Array, level: Array, edge: Ints, G: int) -> tuple[Array, Array]:
    """Levels of the columns of A in each edge, shape (G, k), and A without them, shape (n, k)."""
    weight = np.bincount(edge, weights=level**2, minlength=G)
    levels = sums_by(edge, level[:, None] * A, G) / weight[:, None]
    return levels, A - level[:, None] * levels[edge]


def orthonormal(A: Array) -> Array:
    """Orthonormal basis of columns of length about one, shape (n, rank)."""
    if not A.shape[1]:
        return A
    U, s, _ = np.linalg.svd(A, full_matrices=False)
    return np.asarray(U[:, s > ROUNDING])


# Largest intraclass correlation; above it rows of an edge are copies of each other.
NEARLY_ONE = 1 - 1e-6


@dataclass(frozen=True, slots=True)
class Strata:
    """Columns and residuals of a law, split into levels of edges and rows about them.

    The columns are those along which the fit is linear, each freed of the constant and of length one
    (``theta`` moves by ``back`` times what their coefficients move).

    Attributes
    ----------
    names : tuple of str, length G
    edge : ndarray of int, shape (n,)
    level : ndarray, shape (n,)
        Column of the constant: an edge's own level is a multiple of it.
    weight : ndarray, shape (G,)
        Sum of squares of ``level`` in each edge: the number of its rows where errors multiply.
    within : ndarray of bool, shape (p,)
        Which columns change within edges.
    back : ndarray, shape (p, p)
    levels : ndarray, shape (G, p + 1)
        Level of each column, and of the residual, in each edge.
    basis : ndarray, shape (n, w)
        Orthonormal basis of what changes within edges.
    inner : ndarray, shape (w, p + 1)
        Columns, and the residual, in that basis.
    rest : ndarray, shape (n,)
        Residuals once edges have levels of their own.
    icc : float
        Share of the variance between edges (Henderson's method 3, never below zero).
    """

    names: tuple[str, ...]
    edge: Ints
    level: Array
    weight: Array
    within: Flags
    back: Array
    levels: Array
    basis: Array
    inner: Array
    rest: Array
    icc: float = 0.0

    @property
    def df_within(self) -> int:
        """Rows less edges less what changes within them."""
        return len(self.rest) - len(self.names) - int(self.basis.shape[1])

    @property
    def df_between(self) -> int:
        """Edge levels less the parameters that only they determine."""
        return int(self.basis.shape[1]) + len(self.names) - len(self.within)

    @property
    def weights(self) -> Array:
        """Weight of each edge level against a row's part within, shape (G,)."""
        return np.asarray(self.weight * (1 - self.icc) / (1 - self.icc + self.icc * self.weight))

    def stacked(self) -> Array:
        """Columns and residual as w + G rows that hold all but ``rest``, whitened; shape (w + G, p + 1)."""
        return np.vstack([self.inner, np.sqrt(self.weights)[:, None] * self.levels])


def split(law: LawFit) -> Strata | NotAvailable:
    """Split a law into edges and rows within them, or return the reason why it cannot be split.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> strata = split(law)
    >>> strata.df_between, strata.df_within
    (20, 214)
    """
    if law.rows is None:
        return NotAvailable(NO_ROWS)
    if law.edge is None:
        return NotAvailable("no edge column: rows are assumed independent")
    if not has_repeated_edges(law):
        return NotAvailable("every row is a separate edge")
    if reason := no_scatter(law):
        return NotAvailable(reason)
    found = _parted(law, law.edge)
    if found.df_between > 0:
        return _with_icc(found)
    G, between = len(found.names), len(found.within) - found.basis.shape[1]
    if G == 1:
        return NotAvailable(
            "all rows are from one edge, so the variance between edges is unknown: test at least one more"
        )
    return NotAvailable(f"{G} edges for {between} parameters that vary between edges only: test more edges than that")


def covariance(columns: Array, law: LawFit, strata: Strata) -> Array:
    """Covariance of the coefficients of the linear columns, each edge having a random level; shape (p, p)."""
    stacked = strata.stacked()
    A, b = stacked[:, :-1], stacked[:, -1]
    left = b - A @ np.linalg.lstsq(A, b, rcond=None)[0]
    s2 = (float(strata.rest @ strata.rest) + float(left @ left)) / law.df_resid
    gram = columns.T @ columns
    of_edges = strata.weight[:, None] * strata.levels[:, :-1]
    inverse = np.linalg.inv(gram)
    return np.asarray(s2 * inverse @ (gram + strata.icc / (1 - strata.icc) * of_edges.T @ of_edges) @ inverse)


def _parted(law: LawFit, labels: Texts) -> Strata:
    edge, names = pd.factorize(labels, sort=True)
    columns, back = linear_columns(law)
    level = columns[:, 0] * np.sqrt(len(columns))  # ones, or the gradient of the constant scaled to their size
    weight: Array = np.asarray(np.bincount(edge, weights=level**2), dtype=float)
    levels, inside = without_levels(np.column_stack([columns, law.residuals]), level, edge, len(names))
    within = np.linalg.norm(inside[:, :-1], axis=0) > ROUNDING
    inside[:, :-1][:, ~within] = 0.0
    basis = orthonormal(inside[:, :-1][:, within])
    inner = basis.T @ inside
    rest = inside[:, -1] - basis @ inner[:, -1]
    return Strata(tuple(map(str, names)), edge, level, weight, within, back, levels, basis, inner, rest)


def _with_icc(strata: Strata) -> Strata:
    """Variance split by equating the sums of squares between and within edges to their expectations."""
    if strata.df_within <= 0:
        return strata
    stacked = strata.stacked()
    Q = orthonormal(stacked[:, :-1])
    left = stacked[:, -1] - Q @ (Q.T @ stacked[:, -1])
    inside = float(strata.rest @ strata.rest) / strata.df_within
    of_edges = Q[strata.basis.shape[1] :]
    spread = float(strata.weight @ (1 - np.einsum("ij,ij->i", of_edges, of_edges)))
    between = max(0.0, (float(left @ left) - inside * strata.df_between) / spread)
    return replace(strata, icc=min(between / (between + inside), NEARLY_ONE))


@dataclass(frozen=True, slots=True)
class EdgeLevels:
    """Regression of the levels of edges, what varies within them stacked above; rows where they are independent.

    Attributes
    ----------
    names : tuple of str, length G
        Edges, or lines of the file.
    by_edge : bool
    A, b : ndarray, shape (w + G, p) and (w + G,)
        Columns, and the response, whitened.
    root : ndarray, shape (G,)
        Square root of the weight of each level.
    x : ndarray, shape (G, k)
        Mean of the terms of the law (logarithms of the factors) on each edge.
    back : ndarray, shape (p, p)
        ``theta`` is ``back`` times the coefficients of A.
    """

    names: tuple[str, ...]
    by_edge: bool
    A: Array
    b: Array
    root: Array
    x: Array
    back: Array

    @property
    def within(self) -> int:
        """Rows above the levels."""
        return len(self.b) - len(self.names)


def edge_levels(law: LawFit, strata: Strata | NotAvailable) -> EdgeLevels | NotAvailable:
    """Levels of the edges of a law; of its rows where each is an edge or no edge is known."""
    if isinstance(strata, Strata):
        stacked = strata.stacked()
        count = np.bincount(strata.edge)
        x = np.column_stack([np.bincount(strata.edge, term) / count for term in law.design[:, 1:].T])
        own = np.linalg.solve(strata.back, law.theta)
        A, root = stacked[:, :-1], np.sqrt(strata.weights)
        return EdgeLevels(strata.names, True, A, A @ own + stacked[:, -1], root, x, strata.back)
    if reason := no_scatter(law):
        return NotAvailable(reason)
    if law.n_edges is not None and law.n_edges < law.nobs:
        return strata
    columns, back = linear_columns(law)
    b = columns @ np.linalg.solve(back, law.theta) + law.residuals
    names = law.lines if law.edge is None else law.edge
    one = np.ones(law.nobs)
    return EdgeLevels(tuple(map(str, names)), law.edge is not None, columns, b, one, law.design[:, 1:], back)


def without_found(
    law: LawFit, suspects: "tuple[Suspect, ...]", strata: Strata | NotAvailable
) -> tuple[LawFit, Strata | NotAvailable]:
    """The law refitted without suspects, and its strata; both as they are where there are none."""
    rest = without_suspects(law, suspects) if suspects else None
    return (law, strata) if rest is None else (rest, split(rest))


LARGEST = 0.4  # share of the rows that the suspects may have in a comparison without them


def _rows_of(law: LawFit, suspects: "tuple[Suspect, ...]") -> Flags:
    """Whether a row of the law is one of the suspects or belongs to an edge that is one."""
    edges = {edge for one in suspects for edge in one.edges}
    lines = [line for one in suspects if not one.edges for line in one.lines]
    out = np.isin(law.lines, lines)
    if law.edge is not None:
        out |= np.isin(np.asarray(law.edge, dtype=str), sorted(edges))
    return out


def without_suspects(law: LawFit, suspects: "tuple[Suspect, ...]") -> LawFit | None:
    """The law refitted without the rows and edges that are suspected; None where too few are left for it."""
    out = _rows_of(law, suspects)
    if not 0 < out.mean() <= LARGEST or np.count_nonzero(~out) <= len(law.theta):
        return None
    try:
        return refitted(law, law.error, ~out)
    except FitError:  # a level or a factor that no longer varies
        return None
