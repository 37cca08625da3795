"""Columns of a law's fit, and what edges have in common of them."""

import numpy as np
from numpy.typing import NDArray

from ..jackknife import gradient
from ..lawfit import LawFit

Array = NDArray[np.float64]
Codes = NDArray[np.intp]

# Of columns scaled to length one: what is left of a column below this is rounding.
ROUNDING = 1e-9


def linear_columns(law: LawFit) -> tuple[Array, Array]:
    """Columns along which the fit is linear, shape (n, p), that of the constant first, and ``back``.

    All but the first are freed of it and scaled to length one, which keeps the digits that logarithms of
    narrow ranges lose; ``theta`` moves by ``back`` times what the coefficients of these columns move.
    """
    Z = gradient(law)
    level = Z[:, 0]
    share = level @ Z[:, 1:] / (level @ level)
    rest = Z[:, 1:] - np.outer(level, share)
    length = np.sqrt(np.einsum("ij,ij->j", rest, rest))
    size = np.linalg.norm(level)
    back = np.diag(np.concatenate([[1 / size], 1 / length]))
    back[0, 1:] = -share / length
    return np.column_stack([level / size, rest / length]), back


def sums_by(edge: Codes, A: Array, G: int) -> Array:
    """Sum of each column of A over the rows of each of G edges, shape (G, k).

    Examples
    --------
    >>> sums_by(np.array([0, 1, 1]), np.array([[1.0], [2.0], [3.0]]), 2).tolist()
    [[1.0], [5.0]]
    """
    sums = np.empty((G, A.shape[1]))
    for j, column in enumerate(A.T):
        sums[:, j] = np.bincount(edge, weights=column, minlength=G)
    return sums


def without_levels(A: Array, level: Array, edge: Codes, G: int) -> tuple[Array, Array]:
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
