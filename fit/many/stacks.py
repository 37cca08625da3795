"""Least squares of many pairs at once: one QR of a stack of centred, column-scaled matrices.

Pairs of one stack have the same factors and nearly the same number of rows; shorter ones end in rows of zeros,
which leave the triangle as it is. It is ``linear`` with one more axis, and keeps the same digits.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.intp]
Flags = NDArray[np.bool_]

BLOCK = 32_768  # rows of a stack: what stays in a processor's own memory
RAGGED = 1.2  # the longest pair of a stack over its shortest


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


def stacks(counts: Ints) -> Iterator[Ints]:
    """Positions of pairs that go into one stack, by their numbers of rows.

    Examples
    --------
    >>> [block.tolist() for block in stacks(np.array([6, 144, 6, 140]))]
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
    A, means = _centred(_side_by_side(logs, starts, there), there, counts)  # (q, m, n)
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


def _side_by_side(logs: Array, starts: Ints, there: Flags) -> Array:
    """Rows of each pair, shape (q, m, n), where it has none those of its first row."""
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
