"""Inference by edge from the sums of each edge, as ``jackknife`` and ``mixed`` make it of rows.

The sums of an edge are written as a few rows that have them. The jackknife sees nothing else of an edge, so that it
takes these rows for the edge's own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..available import NotAvailable
from ..edges import EdgeInference
from ..jackknife import ROUNDING, indispensable, left_out_moves, of_moves, too_few_edges
from ..linear import LinearFit
from ..mixed import Mixed, random_level
from .blocks import Names
from .edge_sums import EdgeSums, square_roots

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Standing:
    """Rows that stand for those of each group, an edge in one level of the category.

    Attributes
    ----------
    names : tuple of str, the E edges, sorted
    edge : ndarray of int, shape (G,), number of each group's edge
    size : ndarray, shape (G,)
    centre : ndarray, shape (G, p + 1), means of the law's columns and of the logarithm of the response less ``base``
    roots : ndarray, shape (G, q, p + 1), rows with the sums of products about the means
    moves : ndarray, shape (p,), the furthest that a column moves within an edge
    base : ndarray, shape (p,), parameters of the law that was taken from the response
    """

    names: tuple[str, ...]
    edge: Index
    size: Array
    centre: Array
    roots: Array
    moves: Array
    base: Array

    @property
    def edge_size(self) -> Array:
        """Rows of each edge, shape (E,)."""
        return np.bincount(self.edge, weights=self.size).astype(float)

    def rows(self) -> tuple[Array, Index]:
        """Design and response side by side, shape (m, p + 1), and the edge of each of these rows."""
        all_of = np.concatenate([(np.sqrt(self.size)[:, None] * self.centre)[:, None], self.roots], axis=1)
        return all_of.reshape(-1, all_of.shape[2]), np.repeat(self.edge, all_of.shape[1])


def standing(sums: EdgeSums, keep: Sequence[int], edges: Names, levels: Index) -> Standing:
    """Rows that stand for the groups of a law of the factors ``keep`` with the levels in their order."""
    if sums.base is None:
        raise ValueError("no rows were added")
    edge, level = sums.groups()
    names, present = edges.in_order(np.unique(edge))
    place = np.empty(int(present.max()) + 1, dtype=np.intp)
    place[present] = np.arange(len(present))
    number = place[edge]
    shifts = (level[:, None] == levels[1:]).astype(float)
    gone = [j for j in range(sums.q - 1) if j not in keep]
    back = np.append(sums.base[gone], 1.0)  # a factor that is left out takes nothing from the response
    columns = [*gone, sums.q - 1]
    one, k = np.ones((len(edge), 1)), len(keep)
    about = square_roots(sums.square)
    roots = np.zeros((len(edge), sums.q, k + 2 + shifts.shape[1]))
    roots[:, :, 1 : k + 1], roots[:, :, -1] = about[:, :, keep], about[:, :, columns] @ back
    return Standing(
        names=names,
        edge=number,
        size=sums.size,
        centre=np.hstack([one, sums.mean[:, keep], shifts, (sums.mean[:, columns] @ back)[:, None]]),
        roots=roots,
        moves=_moves(np.hstack([one, sums.first[:, keep], shifts]), sums.far[:, keep], number),
        base=np.concatenate([sums.base[-1:], sums.base[list(keep)], np.zeros(shifts.shape[1])]),
    )


def _moves(first: Array, far: Array, edge: Index) -> Array:
    """The furthest that each column of the law moves within an edge, from the first rows of groups and their moves."""
    opening = first[np.unique(edge, return_index=True)[1]][edge]  # groups stand in the order of their first rows
    moves: Array = np.abs(first - opening).max(axis=0)
    factors = slice(1, 1 + far.shape[1])
    moves[factors] = np.maximum(moves[factors], far.max(axis=0))
    return moves


def inference(
    fit: LinearFit, rows: Standing, largest: Array, theta_names: tuple[str, ...]
) -> EdgeInference | NotAvailable:
    """Standard errors by edge, or why these data do not allow them, in the words of a fit in memory.

    Parameters
    ----------
    fit : LinearFit
    rows : Standing
    largest : ndarray, shape (p,)
        Largest absolute value of each column.
    theta_names : tuple of str
    """
    E, p = len(rows.names), len(fit.params)
    within = tuple(bool(w) for w in rows.moves > 1e-9 * largest)
    if fit.df_resid == 0 or np.sqrt(fit.rss / fit.nobs) <= ROUNDING:
        return NotAvailable("the law meets every row exactly: there is no scatter to tell edges by")
    if why := too_few_edges(fit.nobs, E, p - sum(within)):
        return NotAvailable(why)
    A, edge = rows.rows()
    moved = left_out_moves(A[:, :p], A[:, p] - A[:, :p] @ (fit.params - rows.base), fit.cov_unscaled, edge, E)
    if isinstance(moved, int):
        return NotAvailable(indispensable(rows.names[moved]))
    levels = _levels(rows, np.array(within))
    return of_moves(moved, fit.params, fit.cov_params, theta_names, rows.names, within, levels)


def _levels(rows: Standing, within: NDArray[np.bool_]) -> Mixed:
    """A random level of each edge, from the sums; the law of the sums is about ``base``."""
    p = rows.centre.shape[1] - 1
    total = [np.bincount(rows.edge, weights=rows.size * c) for c in rows.centre.T]
    means: Array = np.column_stack(total) / rows.edge_size[:, None]
    apart = np.sqrt(rows.size)[:, None] * (rows.centre - means[rows.edge])
    inside = np.asarray(np.linalg.qr(np.vstack([rows.roots.reshape(-1, p + 1), apart]), mode="r"))
    about = random_level(inside, means, rows.edge_size, within)
    return replace(about, theta=rows.base + about.theta)
