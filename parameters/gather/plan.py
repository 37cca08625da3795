"""Which kind of plan a set of settings is, from the level that each factor has in each of them.

Source: Montgomery 2017, Design and Analysis of Experiments: chapters 5 and 8 (factorials), 11.4 (central composite and
Box-Behnken designs).
"""

from math import comb, prod

import numpy as np
from numpy.typing import NDArray

Index = NDArray[np.intp]


def kind_of_plan(levels: Index) -> str | None:
    """The kind of plan, in words; None where it is none of those that are known.

    Parameters
    ----------
    levels : ndarray of int, shape (m, k)
        Distinct settings: position of each factor's level, from 0, in rising order of the levels.

    Examples
    --------
    >>> kind_of_plan(np.array([[0, 0], [0, 1], [1, 0], [1, 1]]))
    'full factorial, 2 x 2 levels'
    >>> kind_of_plan(np.array([[0, 0], [0, 1], [1, 2]])) is None
    True
    """
    if levels.ndim != 2 or levels.shape[1] < 2 or len(levels) < 3:
        return None
    counts = (levels.max(axis=0) + 1).tolist()
    if min(counts) < 2:
        return None
    for found in (_full(levels, counts), _composite(levels, counts), _box_behnken(levels, counts)):
        if found is not None:
            return found
    return _one_at_a_time(levels) or _orthogonal(levels, counts)


def _full(levels: Index, counts: list[int]) -> str | None:
    return f"full factorial, {' x '.join(map(str, counts))} levels" if len(levels) == prod(counts) else None


def _composite(levels: Index, counts: list[int]) -> str | None:
    if set(counts) not in ({5}, {3}):
        return None
    k, faces = len(counts), counts[0] == 3
    z = np.abs(levels - counts[0] // 2)
    factorial = (z == 1).all(axis=1)
    axial = ((z > 0).sum(axis=1) == 1) & (z.max(axis=1) == (1 if faces else 2))
    covered = factorial | axial | (z == 0).all(axis=1)
    corners = int(factorial.sum())
    if not covered.all() or axial.sum() != 2 * k or corners not in (2**k, 2 ** (k - 1)) or corners < 4:
        return None
    return ("face-centred " if faces else "") + "central composite" + (", half the corners" if corners < 2**k else "")


def _box_behnken(levels: Index, counts: list[int]) -> str | None:
    k = len(counts)
    if set(counts) != {3} or not 3 <= k <= 5:
        return None
    moved = (levels != 1).sum(axis=1)
    fits = np.isin(moved, (0, 2)).all() and (moved == 2).sum() == 4 * comb(k, 2)
    return "Box-Behnken" if fits else None


def _one_at_a_time(levels: Index) -> str | None:
    base = np.array([np.bincount(column).argmax() for column in levels.T])
    moved = (levels != base).sum(axis=1)
    return "one factor at a time" if (moved <= 1).all() and (moved == 0).any() else None


def _orthogonal(levels: Index, counts: list[int]) -> str | None:
    """Every pair of factors has each pair of levels equally often."""
    for i, first in enumerate(counts):
        for j in range(i + 1, len(counts)):
            times = np.bincount(levels[:, i] * counts[j] + levels[:, j], minlength=first * counts[j])
            if times.min() != times.max():
                return None
    return f"orthogonal array of {len(levels)} settings"
