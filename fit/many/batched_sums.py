"""Batched least squares of many pairs from the Gram matrices of their edges, and their jackknife by edge (CR3).

Rows are read twice: for the sums of products about the means of the edges (`grams_by`), and for the residuals of the
solution, which correct it and give the scores of the edges. Sums of products square the condition number: pairs with
variance inflation factors above `LARGEST_VIF` are fitted singly. Leaving edge g out changes the estimate by
``-(Z'Z - Z_g'Z_g)^-1 Z_g' r_g``; these are systems of p equations, as many as there are edges, solved together.

Sources: Bjorck 1987, Linear Algebra Appl. 88/89, 31 (corrected seminormal equations); of CR3 as in ``edges``.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array, Flags, Ints
from ..least_squares import Grams, grams_by

BLOCK = 32_768  # rows that are fitted together, so that they stay in the cache
LARGEST_VIF = 1e5  # sum of the variance inflation factors up to which sums of products keep eleven digits
LEAST = 1e-10  # of a pivot: the variance inflation of a column with less is above `LARGEST_VIF`
# Least eigenvalue of I - (Z'Z)^-1 Z_g'Z_g at which ten digits of a standard error are safe; below it, pairs are fitted
# singly.
SAFE = 1e-3


def blocks_of(counts: Ints) -> Iterator[slice]:
    """Pairs that are fitted together, by their numbers of rows.

    Examples
    --------
    >>> list(blocks_of(np.array([30_000, 2000, 40_000, 6])))
    [slice(0, 2, None), slice(2, 3, None), slice(3, 4, None)]
    """
    ends, start = np.cumsum(counts), 0
    while start < len(counts):
        before = ends[start] - counts[start]
        stop = max(start + 1, int(np.searchsorted(ends, before + BLOCK, side="right")))
        yield slice(start, stop)
        start = stop


@dataclass(frozen=True, slots=True)
class BatchedFits:
    """Fits of m pairs with p - 1 factors.

    Attributes
    ----------
    theta : ndarray, shape (m, p)
        ln c0 and exponents.
    row_variance : ndarray, shape (m, p)
        Diagonal of ``(Z'Z)^-1``; times the residual variance, that of theta with rows taken as independent.
    edge_variance : ndarray, shape (m, p)
        Variance of theta by edge (CR3).
    rss, tss : ndarray, shape (m,)
    vif : ndarray, shape (m,)
        Sum of the variance inflation factors.
    safe : ndarray of bool, shape (m,)
        Whether the variance by edge is accurate.
    """

    theta: Array
    row_variance: Array
    edge_variance: Array
    rss: Array
    tss: Array
    vif: Array
    safe: Flags


def fitted(W: Array, edge_starts: Ints, pair_starts: Ints) -> BatchedFits:
    """Fit every pair of a block.

    Parameters
    ----------
    W : ndarray, shape (q, N)
        Logarithms of the factors and, last, of the response, pairs one after the other; each changes in every pair.
    edge_starts : ndarray of int, shape (E,)
        Where each edge begins among the N rows.
    pair_starts : ndarray of int, shape (m,)
        Where each pair begins among the E edges.

    Examples
    --------
    >>> x = np.log([1.0, 2, 4, 1, 2, 4])
    >>> fitted(np.stack([x, 0.5 * x]), np.array([0, 3]), np.array([0, 1])).theta.round(9).tolist()
    [[0.0, 0.5], [0.0, 0.5]]
    """
    found, p = grams_by(W, edge_starts), len(W)
    edges = np.diff(np.append(pair_starts, len(edge_starts)))
    mean, apart = _means(found, pair_starts, edges)
    products = _products(found, apart)
    total = np.add.reduceat(products, pair_starts, axis=2)
    scale = np.sqrt(np.einsum("iim->im", total)[:p])
    V = _inverse_roots(total[:p, :p] / scale[:, None] / scale)
    root = V / scale[:, None]
    theta = _times(root, total[:p, p])
    score, rss = _residual_sums(found, edge_starts, apart, np.repeat(theta, edges, axis=1))
    theta += _times(root, np.add.reduceat(score, pair_starts, axis=1))
    moved, safe = _moved(total[:p, :p], root, products[:p, :p], score, edges)
    for array, means in ((theta, mean), (root, mean[:, None]), (moved, np.repeat(mean, edges, axis=1))):
        array[0] -= _dot(means[:-1], array[1:])  # of the constant at ln X = 0
    theta[0] += mean[-1]
    return BatchedFits(
        theta=theta.T,
        row_variance=_dot(root.swapaxes(0, 1), root.swapaxes(0, 1)).T,
        edge_variance=(np.add.reduceat(np.square(moved), pair_starts, axis=1) * (edges - 1) / edges).T,
        rss=np.add.reduceat(rss, pair_starts),
        tss=total[p, p],
        vif=np.square(V).sum(axis=(0, 1)),
        safe=np.logical_and.reduceat(safe, pair_starts),
    )


def _means(found: Grams, pair_starts: Ints, edges: Ints) -> tuple[Array, Array]:
    """Means of the columns of each pair, shape (q, m), and of each edge less these, shape (q, E)."""
    opening = found.first[:, pair_starts]
    about = found.mean - np.repeat(opening, edges, axis=1)
    n = np.add.reduceat(found.size, pair_starts)
    offset = np.add.reduceat(found.size * about, pair_starts, axis=1) / n
    return opening + offset, about - np.repeat(offset, edges, axis=1)


def _products(found: Grams, apart: Array) -> Array:
    """Sums of products in each edge of the constant and the columns about the mean of their pair: upper triangles."""
    products = np.zeros((len(apart) + 1, len(apart) + 1, len(found.size)))
    products[0, 0] = found.size
    products[0, 1:] = found.size * apart
    for i in range(len(apart)):
        products[1 + i, 1 + i :] = products[0, 1 + i] * apart[i:] + found.square[i, i:]
    return products


def _inverse_roots(C: Array) -> Array:
    """Upper triangular V with ``C^-1 = V V'`` of m positive definite matrices, all of shape (p, p, m)."""
    p = len(C)
    R, V = np.zeros_like(C), np.zeros_like(C)
    for i in range(p):
        row = C[i, i:].copy()
        for j in range(i):
            row -= R[j, i] * R[j, i:]
        R[i, i:] = row / np.sqrt(np.maximum(row[0], LEAST))
        R[i, i] = np.sqrt(np.maximum(row[0], LEAST))
    for i in range(p - 1, -1, -1):
        V[i, i] = 1.0
        for j in range(i + 1, p):
            V[i] -= R[i, j] * V[j]
        V[i] /= R[i, i]
    return V


def _dot(a: Array, b: Array) -> Array:
    """Sum of ``a[j] * b[j]`` in the order of j: its bits do not depend on the number of pairs, as those of einsum."""
    total: Array = a[0] * b[0]
    for one, other in zip(a[1:], b[1:], strict=True):
        total += one * other
    return total


def _times(root: Array, b: Array) -> Array:
    """``root root' b``, shape (p, m)."""
    return _dot(root.swapaxes(0, 1), _dot(root, b[:, None])[:, None])


def _residual_sums(found: Grams, edge_starts: Ints, apart: Array, theta: Array) -> tuple[Array, Array]:
    """Sums of products of the columns with the residuals in each edge, shape (p, E), and of their squares, shape (E,).

    ``theta`` is that of the pair of each edge, shape (p, E), for columns about the mean of their pair.
    """
    size, about = found.size, found.about
    level = apart[-1] - theta[0] - _dot(theta[1:], apart[:-1])
    moves = np.flatnonzero(np.einsum("jjg->j", found.square[:-1, :-1]))
    residuals = about[-1].copy()
    for j in moves:
        residuals -= np.repeat(theta[1 + j], size.astype(np.intp)) * about[j]
    score = size * level * np.vstack([np.ones((1, len(size))), apart[:-1]])
    for j in moves:
        score[1 + j] += np.add.reduceat(residuals * about[j], edge_starts)
    return score, np.add.reduceat(np.square(residuals), edge_starts) + size * level**2


def _moved(total: Array, root: Array, products: Array, score: Array, edges: Ints) -> tuple[Array, Flags]:
    """Change of theta when each edge is left out, shape (p, E), and whether it is accurate, shape (E,).

    Sums of products of pairs, their inverse roots and those of edges have the shapes (p, p, m), (p, p, m), (p, p, E).
    """
    left = np.repeat(total, edges, axis=2)
    left -= products
    moved, determinant = _solved(left.copy(), score.copy())
    # No eigenvalue of root'left root exceeds one, so that the least is at least the determinant.
    share = determinant * np.repeat(np.square(np.einsum("iim->im", root).prod(axis=0)), edges)
    safe = share > SAFE
    doubt = np.flatnonzero(~safe)
    if doubt.size:
        of = root.transpose(2, 0, 1)[np.repeat(np.arange(len(edges)), edges)[doubt]]
        whole = left[:, :, doubt].transpose(2, 0, 1)
        whole = whole + np.triu(whole, 1).transpose(0, 2, 1)
        safe[doubt] = np.linalg.eigvalsh(of.transpose(0, 2, 1) @ whole @ of)[:, 0] > SAFE
    return np.where(safe, moved, np.nan), safe


def _solved(A: Array, b: Array) -> tuple[Array, Array]:
    """Solutions of E positive definite systems ``A x = b``, shapes (p, p, E) and (p, E), in place; and determinants.

    Elimination in the upper triangles of all systems at once; no pivoting is needed, and a system that is not positive
    definite shows in its pivots, for which the determinant is then zero.
    """
    p = len(A)
    determinant = np.ones(A.shape[2])
    with np.errstate(all="ignore"):
        for j in range(p):
            determinant *= np.maximum(A[j, j], 0.0)
            for i in range(j + 1, p):
                factor = A[j, i] / A[j, j]
                A[i, i:] -= factor * A[j, i:]
                b[i] -= factor * b[j]
        for i in range(p - 1, -1, -1):
            for j in range(i + 1, p):
                b[i] -= A[i, j] * b[j]
            b[i] /= A[i, i]
    return b, determinant
