"""Sums of each edge: rows, means, squares and products about the means, and how far a column moves within it.

An edge may turn up in any chunk. One that was cut in two levels of a category has a group for each, so that the
category's indicators are constant in every group and need no sums.

Source: Chan, Golub & LeVeque 1983, The American Statistician 37, 242 (merging about the means).
"""

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]

MOST_LEVELS = 1 << 31  # edge and level of a group in one number


@dataclass(slots=True)
class EdgeSums:
    """Sums of q columns, logarithms of the k factors and what a first law leaves of the response's, by edge and level.

    Squares of the response itself would drown those of its residuals where a law fits closely. So the law of the
    first rows, ``base``, is taken from it before anything is squared; which law that is matters to rounding alone.

    Attributes
    ----------
    q : int
    base : ndarray, shape (q,), or None
        Exponents of that law and the logarithm of its constant; None before the first rows.
    size : ndarray, shape (G,)
    mean, first, far : ndarray, shape (G, q)
        Means; the first row; the furthest that a row lies from it.
    square : ndarray, shape (G, q, q)
        Sums of products about the means.
    """

    q: int
    base: Array | None = None
    number: dict[int, int] = field(default_factory=dict)
    size: Array = field(init=False)
    mean: Array = field(init=False)
    first: Array = field(init=False)
    far: Array = field(init=False)
    square: Array = field(init=False)

    def __post_init__(self) -> None:
        self.size = np.zeros(0)
        self.mean, self.first, self.far = (np.zeros((0, self.q)) for _ in range(3))
        self.square = np.zeros((0, self.q, self.q))

    def add(self, W: Array, edge: Index, level: Index | None) -> None:
        """Take up rows, shape (m, q), logarithms of factors and response, of these edges and levels."""
        if self.base is None:
            self.base = _first_law(W)
        W = np.column_stack([W[:, :-1], W[:, -1] - W[:, :-1] @ self.base[:-1] - self.base[-1]])
        key = edge.astype(np.int64) * MOST_LEVELS + (0 if level is None else level)
        local, keys = pd.factorize(key)
        at = self._numbers(keys, W, local)
        n = np.bincount(local).astype(float)
        mean: Array = np.column_stack([np.bincount(local, weights=w) for w in W.T]) / n[:, None]
        square = _products(W - mean[local], local, len(n))
        np.maximum.at(self.far, at[local], np.abs(W - self.first[at][local]))
        total, apart = self.size[at] + n, mean - self.mean[at]
        weight = self.size[at] * n / total
        self.square[at] += square + weight[:, None, None] * apart[:, :, None] * apart[:, None, :]
        self.mean[at] += (n / total)[:, None] * apart
        self.size[at] = total

    def groups(self) -> tuple[Index, Index]:
        """Edge and level of each group, both shape (G,)."""
        keys = np.fromiter(self.number, dtype=np.int64, count=len(self.number))
        return (keys // MOST_LEVELS).astype(np.intp), (keys % MOST_LEVELS).astype(np.intp)

    def trimmed(self) -> "EdgeSums":
        """Without the room that was kept for further groups."""
        G = len(self.number)
        for name in ("size", "mean", "first", "far", "square"):
            setattr(self, name, getattr(self, name)[:G])
        return self

    def _numbers(self, keys: NDArray[np.int64], W: Array, local: Index) -> Index:
        """Numbers of these groups; new ones get one, and their first row."""
        old = len(self.number)
        at = np.array([self.number.setdefault(key, len(self.number)) for key in keys.tolist()], dtype=np.intp)
        if len(self.number) > old:
            self._room(len(self.number))
            opening = np.zeros(len(keys), dtype=np.intp)
            opening[local[::-1]] = np.arange(len(local))[::-1]
            new = at >= old
            self.first[at[new]] = W[opening[new]]
        return at

    def _room(self, groups: int) -> None:
        if groups <= len(self.size):
            return
        more = max(groups, 2 * len(self.size)) - len(self.size)
        for name in ("size", "mean", "first", "far", "square"):
            old = getattr(self, name)
            setattr(self, name, np.concatenate([old, np.zeros((more, *old.shape[1:]))]))


def _products(D: Array, local: Index, groups: int) -> Array:
    q = D.shape[1]
    out = np.empty((groups, q, q))
    for i in range(q):
        for j in range(i + 1):
            out[:, i, j] = out[:, j, i] = np.bincount(local, weights=D[:, i] * D[:, j], minlength=groups)
    return out


def square_roots(square: Array) -> Array:
    """Rows, shape (G, q, q), whose sums of products are ``square``: a few that stand for all rows of a group.

    Columns are brought to one length first, or a long one would round away a short one.
    """
    length = np.sqrt(np.einsum("gii->gi", square))
    length[length == 0] = 1.0
    value, vector = np.linalg.eigh(square / length[:, :, None] / length[:, None, :])
    roots = np.sqrt(np.maximum(value, 0.0))[:, :, None] * vector.transpose(0, 2, 1)
    return np.asarray(roots * length[:, None, :])


def _first_law(W: Array) -> Array:
    """Exponents and constant of the last column on the others; of those that cannot be told, the smallest."""
    mean = W.mean(axis=0)
    D = W - mean
    slopes = np.linalg.lstsq(D[:, :-1], D[:, -1], rcond=1e-6)[0]
    return np.append(slopes, mean[-1] - mean[:-1] @ slopes)
