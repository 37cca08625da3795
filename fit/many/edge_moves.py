"""The jackknife by edge (CR3) of a stack: every edge of every pair left out at once.

In the orthonormal basis U of a pair, leaving edge g out moves the estimate by ``-(I - U_g'U_g)^-1 U_g' r_g``; these
are systems of p equations, as many as there are edges, solved together. Sources as in ``jackknife``.
"""

import numpy as np
from numpy.typing import NDArray

from .stacks import Stack

Array = NDArray[np.float64]
Ints = NDArray[np.intp]
Flags = NDArray[np.bool_]

# Least eigenvalue of I - U_g'U_g at which ten digits of a standard error are safe; below it, one by one.
SAFE = 1e-3


def edge_errors(stack: Stack, edge_starts: Ints, pair_starts: Ints, n_edges: Ints) -> tuple[Array, Flags]:
    """CR3 standard errors of ``theta``, shape (m, p), and which pairs they are safe for, shape (m,).

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
