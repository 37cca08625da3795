"""What the rows of each pair allow, seen for all pairs at once: which factors vary, and whether a stack may take it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..rows import CONSTANT, FEWEST
from .pair_rows import PairRows

Array = NDArray[np.float64]
Ints = NDArray[np.intp]
Flags = NDArray[np.bool_]

# Margin of a border: on its far side rounding cannot have decided.
MARGIN = 1.001


@dataclass(frozen=True, slots=True)
class Look:
    """What the rows of each pair allow.

    Attributes
    ----------
    constant, within : ndarray, shape (K, k)
        Factors that do not change in a pair, and those that change within its edges.
    level : ndarray, shape (K, k)
        First value of each factor, in logarithms.
    largest : ndarray, shape (K,)
        Largest ``|ln y|``.
    plain : ndarray, shape (K,)
        Pairs that a stack may take.
    """

    constant: Flags
    within: Flags
    level: Array
    largest: Array
    plain: Flags


def look_at(rows: PairRows) -> Look:
    """Look at all rows once; pairs without any row are not plain."""
    K, k = len(rows.names), len(rows.logs) - 1
    here = np.flatnonzero(rows.counts)
    look = Look(
        np.zeros((K, k), dtype=bool), np.zeros((K, k), dtype=bool), np.zeros((K, k)), np.zeros(K),
        np.zeros(K, dtype=bool),
    )  # fmt: skip
    if not here.size:
        return look
    starts, counts = rows.bounds[here], rows.counts[here]
    first = _first_rows(rows, starts, counts)
    about = np.abs(rows.logs - np.repeat(rows.logs[:, first], counts, axis=1))
    reach = np.maximum.reduceat(about, starts, axis=1)
    level = rows.logs[:k, first].T
    share = reach[:k].T / np.maximum(1.0, np.abs(level))
    constant = share <= CONSTANT
    close = ((share > CONSTANT / MARGIN) & (share < CONSTANT * MARGIN)).any(axis=1)
    copied = (np.add.reduceat(~about.any(axis=0), starts) > 1) & (counts >= 2 * FEWEST)
    p = 1 + k - constant.sum(axis=1)
    look.plain[here] = (counts > p) & (p > 1) & (reach[k] > 0) & ~close & ~copied
    infinite = np.logical_or.reduce([np.isinf(values) for values in rows.raw.values()])
    look.plain[rows.number[infinite]] = False
    look.constant[here], look.level[here], look.within[here] = constant, level, _within(rows, starts)
    look.largest[here] = np.maximum.reduceat(np.abs(rows.logs[k]), starts)
    return look


def _first_rows(rows: PairRows, starts: Ints, counts: Ints) -> Ints:
    """Where the first row of each pair in the table now stands: what is measured from it then is as in a loop."""
    return np.flatnonzero(rows.source == np.repeat(np.minimum.reduceat(rows.source, starts), counts))


def _within(rows: PairRows, starts: Ints) -> Flags:
    """Which factors change within the edges of a pair, shape (pairs with rows, k); see ``jackknife``."""
    X = rows.logs[:-1]
    if rows.edge_starts is None:
        return np.zeros((len(starts), len(X)), dtype=bool)
    lengths = np.diff(rows.edge_starts, append=X.shape[1])
    change = np.maximum.reduceat(np.abs(X - np.repeat(X[:, rows.edge_starts], lengths, axis=1)), starts, axis=1)
    return np.asarray((change > 1e-9 * np.maximum.reduceat(np.abs(X), starts, axis=1)).T)
