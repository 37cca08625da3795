"""Sums, and sums of products, of columns over the rows of each group: of an edge or of a level of a category."""

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Array

Index = NDArray[np.intp]


def sums_by(group: Index, A: Array, G: int) -> Array:
    """Sum of each column of A over the rows of each of G groups (edges, levels), shape (G, k).

    Examples
    --------
    >>> sums_by(np.array([0, 1, 1]), np.array([[1.0], [2.0], [3.0]]), 2).tolist()
    [[1.0], [5.0]]
    """
    sums = np.empty((G, A.shape[1]))
    for j, column in enumerate(A.T):
        sums[:, j] = np.bincount(group, weights=column, minlength=G)
    return sums


def products_by(group: Index, A: Array, G: int) -> Array:
    """Sums of products ``A_g' A_g`` of the rows of each of G groups, shape (G, k, k)."""
    k = A.shape[1]
    out = np.empty((G, k, k))
    for i in range(k):
        for j in range(i + 1):
            out[:, i, j] = out[:, j, i] = np.bincount(group, weights=A[:, i] * A[:, j], minlength=G)
    return out
