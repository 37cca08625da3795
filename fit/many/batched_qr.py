"""Batched least squares of many pairs, and their jackknife by edge (CR3): one QR of a stack of centred matrices.

Pairs of one stack have the same factors and nearly the same number of rows; shorter ones are padded with rows of
zeros, which leave the triangle unchanged. It is ``linear`` with one more axis, and keeps the same digits. In the
orthonormal basis U of a pair, leaving edge g out changes the estimate by ``-(I - U_g'U_g)^-1 U_g' r_g``; these are
systems of p equations, as many as there are edges, solved together. Sources of CR3 as in ``edges``.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.intp]
Flags = NDArray[np.bool_]

BLOCK = 32_768  # rows of a stack, so that it stays in the cache
RAGGED = 1.2  # the longest pair of a stack over its shortest
# Least eigenvalue of I - U_g'U_g at which ten digits of a standard error are safe; below it, pairs are fitted singly.
SAFE = 1e-3


@dataclass(frozen=True, slots=True)
class Stack:
    """Fits of m pairs with p - 1 factors.

    Attributes
    ----------
    theta : ndarray, shape (m, p)
        ln c0 and exponents.
    root : ndarray, shape (m, p, p)
        L of ``(Z'Z)^-1 = L L'``.
    basis : ndarray, shape (p, N)
        Orthonormal columns of each pair's ``Z L``, its N rows one pair after the other.
    residuals : ndarray, shape (N,)
    rss, tss : ndarray, shape (m,)
    apart : ndarray, shape (m,)
        Least squared part of a scaled factor that those before it do not explain (1 less their R2).
    """

    theta: Array
    root: Array
    basis: Array
    residuals: Array
    rss: Array
    tss: Array
    apart: Array


def stacked_pairs(counts: Ints) -> Iterator[Ints]:
    """Positions of pairs that go into one stack, by their numbers of rows.

    Examples
    --------
    >>> [block.tolist() for block in stacked_pairs(np.array([6, 144, 6, 140]))]
    [[0, 2], [3, 1]]
    """
    order = np.argsort(counts, kind="stable")
    start = 0
    while start < len(order):
        fewest = counts[order[start]]
        stop = int(np.searchsorted(counts[order], fewest * RAGGED, side="right"))
        longest = counts[order[stop - 1]]
        stop = min(stop, start + max(1, int(BLOCK // longest)))
        yield order[start:stop]
        start = stop


def solved(logs: Array, starts: Ints, counts: Ints) -> Stack:
    """Fit every pair of a stack.

    Parameters
    ----------
    logs : ndarray, shape (q, M)
        Logarithms of the factors and, last, of the response, for rows of all pairs.
    starts, counts : ndarray of int, shape (m,)
        Where each pair begins among the M, and its rows.

    Examples
    --------
    >>> x = np.log([1.0, 2, 4, 1, 2, 4])
    >>> solved(np.stack([x, 0.5 * x]), np.array([0, 3]), np.array([3, 3])).theta.round(9).tolist()
    [[0.0, 0.5], [0.0, 0.5]]
    """
    there = np.arange(counts.max()) < counts[:, None]
    A, means = _centred(_padded(logs, starts, there), there, counts)  # (q, m, n)
    lengths = np.sqrt(np.einsum("qmn,qmn->qm", A, A))
    Q, R = np.linalg.qr((A / lengths[:, :, None]).transpose(1, 2, 0))
    k = len(logs) - 1
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = _upper_inverses(R[:, :k, :k])
        slopes = np.einsum("mij,mj->mi", inverse, R[:, :k, k]) * (lengths[k] / lengths[:k]).T
        root = _root(inverse / lengths[:k].T[:, :, None], means[:k].T, counts)
        constant = means[k] - np.einsum("qm,mq->m", means[:k], slopes)
    off = R[:, k, k] * lengths[k]
    const = np.repeat(counts**-0.5, counts)[None]
    rows = (Q.reshape(-1, k + 1) if there.all() else Q[there]).T
    return Stack(
        theta=np.column_stack([constant, slopes]),
        root=root,
        basis=np.concatenate([const, rows[:k]]),
        residuals=rows[k] * np.repeat(off, counts),
        rss=off**2,
        tss=lengths[k] ** 2,
        apart=np.square(np.einsum("mjj->mj", R[:, :k, :k])).min(axis=1),
    )


def _padded(logs: Array, starts: Ints, there: Flags) -> Array:
    """Rows of each pair, shape (q, m, n), padded with its first row."""
    m, n = there.shape
    if there.all() and np.all(np.diff(starts) == n):
        return logs[:, starts[0] : starts[0] + m * n].reshape(-1, m, n)
    return logs.take(np.where(there, starts[:, None] + np.arange(n), starts[:, None]), axis=1)


def _centred(A: Array, there: Flags, counts: Ints) -> tuple[Array, Array]:
    """Columns less their means, in two passes as in ``linear``, and the means, shape (q, m)."""
    whole = bool(there.all())
    total = np.zeros(A.shape[:2])
    for _ in range(2):
        mean = (A if whole else A * there).sum(axis=2) / counts
        A = A - mean[:, :, None]
        total += mean
    return (A if whole else A * there), total


def _upper_inverses(R: Array) -> Array:
    """Inverses of upper triangular matrices, shape (m, k, k), by back substitution."""
    k = R.shape[1]
    inverse = np.zeros_like(R)
    for i in range(k - 1, -1, -1):
        inverse[:, i, i] = 1.0
        inverse[:, i] -= np.einsum("mj,mjl->ml", R[:, i, i + 1 :], inverse[:, i + 1 :])
        inverse[:, i] /= R[:, i, i, None]
    return inverse


def _root(slopes: Array, means: Array, counts: Ints) -> Array:
    """L: from the orthonormal basis, constant first, to theta; ``slopes`` is its lower right part."""
    m, k, _ = slopes.shape
    root = np.zeros((m, k + 1, k + 1))
    root[:, 0, 0] = counts**-0.5
    root[:, 0, 1:] = -np.einsum("mj,mjl->ml", means, slopes)
    root[:, 1:, 1:] = slopes
    return root


def edge_errors(stack: Stack, edge_starts: Ints, pair_starts: Ints, n_edges: Ints) -> tuple[Array, Flags]:
    """CR3 standard errors of ``theta``, shape (m, p), and the pairs for which they are accurate, shape (m,).

    Parameters
    ----------
    edge_starts : ndarray of int, shape (E,)
        Where each edge begins among the rows of the stack.
    pair_starts : ndarray of int, shape (m,)
        Where each pair begins among the E edges.
    n_edges : ndarray of int, shape (m,)
    """
    U = stack.basis
    p, E = len(U), len(edge_starts)
    left = np.empty((p, p, E))
    for i in range(p):
        for j in range(i, p):
            left[i, j] = left[j, i] = float(i == j) - np.add.reduceat(U[i] * U[j], edge_starts)
    score = np.add.reduceat(U * stack.residuals, edge_starts, axis=1)
    moved, determinant = _solved(left.copy(), score)
    safe = _safe(left, determinant)
    spread = np.empty((len(n_edges), p, p))
    for i in range(p):
        for j in range(i, p):
            spread[:, i, j] = spread[:, j, i] = np.add.reduceat(moved[i] * moved[j], pair_starts)
    variance = np.einsum("mij,mjl,mil->mi", stack.root, spread, stack.root) * ((n_edges - 1) / n_edges)[:, None]
    with np.errstate(invalid="ignore"):
        return np.sqrt(variance), np.logical_and.reduceat(safe, pair_starts)


def _solved(A: Array, b: Array) -> tuple[Array, Array]:
    """Solutions of E positive definite systems ``A x = b``, shapes (p, p, E) and (p, E), in place; and determinants.

    Elimination over all systems at once; no pivoting is needed, and a system that is not positive definite shows
    in its pivots, for which the determinant is then zero.
    """
    p = len(A)
    determinant = np.ones(A.shape[2])
    with np.errstate(all="ignore"):
        for j in range(p):
            determinant *= np.maximum(A[j, j], 0.0)
            for i in range(j + 1, p):
                factor = A[i, j] / A[j, j]
                A[i, j:] -= factor * A[j, j:]
                b[i] -= factor * b[j]
        for i in range(p - 1, -1, -1):
            b[i] = (b[i] - np.einsum("je,je->e", A[i, i + 1 :], b[i + 1 :])) / A[i, i]
    return b, determinant


def _safe(left: Array, determinant: Array) -> Flags:
    """Whether the least eigenvalue is above ``SAFE``: as none exceeds one, it is at least the determinant."""
    safe = determinant > SAFE
    doubt = np.flatnonzero(~safe)
    if doubt.size:
        safe[doubt] = np.linalg.eigvalsh(left[:, :, doubt].transpose(2, 0, 1))[:, 0] > SAFE
    return safe
