"""Edges whose times are offset or in another unit, found by the likelihood of their rows.

Edges are compared by the likelihood of their rows with ``ln t`` and with ``ln(t - t0)`` or ``ln(t/k)`` in the same law,
each edge having a random level. A choice of edges has a price, ``2 ln`` of the number of such choices; the search
follows a test that rejects, and only names what the test has found.

Source: Celeux & Govaert 1992, Computational Statistics & Data Analysis 14, 315 (classification likelihood).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import comb, log

import numpy as np

from ...core.arrays import Array, Flags, Ints
from ..least_squares import sums_by

SPREAD = 0.05  # of the first times of edges, in ln t, below which they follow one schedule
UNITS = {60.0: "seconds for minutes", 3600.0: "seconds for hours"}
OFFSETS = np.geomspace(0.05, 4.0, 15)  # in units of the median time
SHARES = (0.0, 0.2, 0.5, 0.8)  # intraclass correlations that the search tries
LATEST = 0.98  # of the first time of an edge: the largest offset
ROUNDS = 6
NAMED = 10.0  # evidence, 2 ln(likelihood ratio) less the price of the choice, above which edges are named
EARLY = 6.0  # evidence that times too small need over times too large of the other edges


@dataclass(frozen=True, slots=True)
class TimeRows:
    """Rows of a power law in logarithms, sorted by edge and time.

    Attributes
    ----------
    names : tuple of str, length G
    edge : ndarray of int, shape (n,)
    y, t : ndarray, shape (n,), ln of the response, and time in min
    steady, moving : ndarray, shape (n, k)
        Columns of the other factors that are constant within edges, the constant first, and those that change.
    """

    names: tuple[str, ...]
    edge: Ints
    y: Array
    t: Array
    steady: Array
    moving: Array

    @property
    def size(self) -> Array:
        """Rows of each edge, shape (G,)."""
        return np.bincount(self.edge).astype(float)

    def means(self, columns: Array) -> Array:
        """Mean of each column in each edge, shape (G, k)."""
        return np.asarray(sums_by(self.edge, columns, len(self.names)) / self.size[:, None])

    def inside(self, columns: Array) -> Array:
        """Columns less the mean of their edge, shape (n, k)."""
        return np.asarray(columns - self.means(columns)[self.edge])


def first_times(rows: TimeRows) -> Array:
    """Mean of ln t over the first rows of each edge, as many as the shortest edge has, shape (G,)."""
    start = np.searchsorted(rows.edge, np.arange(len(rows.names)))
    few = np.arange(len(rows.edge)) - start[rows.edge] < rows.size.min()
    return np.asarray(np.bincount(rows.edge[few], np.log(rows.t[few])) / rows.size.min())


@dataclass(frozen=True, slots=True)
class Shift:
    """Times of some edges, less an offset in min or divided by a factor.

    Attributes
    ----------
    edges : ndarray of bool, shape (G,)
    offset, factor : float
    evidence : float
        2 ln(likelihood ratio) against the times as they are, less the price of the choice of edges.
    """

    edges: Flags
    offset: float = 0.0
    factor: float = 1.0
    evidence: float = 0.0


class Search:
    """Likelihood of the rows of a law with changed times of some edges, at one intraclass correlation."""

    def __init__(self, rows: TimeRows, icc: float) -> None:
        self.rows, self.size = rows, rows.size
        self.shrink = 1 - 1 / np.sqrt(1 + self.size * icc / (1 - icc))
        self.penalty = float(np.log1p(self.size * icc / (1 - icc)).sum())
        self.Q = _basis(self.white(np.column_stack([rows.steady, rows.moving])))
        self.y = self._free(self.white(rows.y[:, None]))[:, 0]

    def white(self, columns: Array) -> Array:
        """Columns less the shrunken mean of their edge."""
        return np.asarray(columns - (self.shrink[:, None] * self.rows.means(columns))[self.rows.edge])

    def _free(self, columns: Array) -> Array:
        return np.asarray(columns - self.Q @ (self.Q.T @ columns))

    def fit(self, log_t: Array) -> tuple[float, float, Array]:
        """-2 ln(likelihood), time exponent, and whitened residuals; log_t of shape (n,)."""
        x = self._free(self.white(log_t[:, None]))[:, 0]
        b = float(x @ self.y) / max(float(x @ x), 1e-300)
        r = self.y - b * x
        n = len(r)
        return n * log(max(float(r @ r), 1e-300) / n) + self.penalty, b, r

    def classify(self, log_t: Array, moved: Array, chosen: Flags, able: Flags) -> tuple[float, Flags]:
        """-2 ln(likelihood) and edges of the best choice reached from one, by alternation."""
        edge = self.rows.edge
        best = np.inf
        for _ in range(ROUNDS):
            value, b, r = self.fit(np.where(chosen[edge], moved, log_t))
            if value >= best - 1e-6:
                break
            best, kept = value, chosen
            step = b * self.white((moved - log_t)[:, None])[:, 0]
            as_is, changed = (r + np.where(chosen[edge], step, 0.0), r - np.where(chosen[edge], 0.0, step))
            better = np.bincount(edge, changed**2) < np.bincount(edge, as_is**2)
            chosen = better & able
        return best, kept


def search(rows: TimeRows) -> tuple[Shift, ...]:
    """Changes of times that make the rows likely: the best one, and the best one of all edges; empty if none does."""
    log_t = np.log(rows.t)
    searches = [Search(rows, icc) for icc in SHARES]
    null = min(one.fit(log_t)[0] for one in searches)
    found = [shift for one in searches for shift in _shifts(one, rows, log_t, null) if shift.evidence > NAMED]
    found.sort(key=lambda shift: -shift.evidence)
    common = [shift for shift in found if shift.edges.all()]
    return (*found[:1], *common[:1])


def _shifts(one: Search, rows: TimeRows, log_t: Array, null: float) -> Iterator[Shift]:
    """Changes of times with their evidence: groups of the schedule, edges by their likelihood, and all edges."""
    G = len(rows.names)
    lowest = np.minimum.reduceat(rows.t, np.searchsorted(rows.edge, np.arange(G)))
    groups, slopes = list(_groups(rows)), _by_slope(rows)
    for offset, factor in _changes(float(np.median(rows.t))):
        able = lowest * LATEST > offset
        moved = np.log(np.where(able[rows.edge], rows.t - offset, rows.t) / factor)
        most = G if factor == 1 else G // 2
        early = EARLY * (offset < 0)
        for chosen in (*groups, np.ones(G, dtype=bool)):
            if (able | ~chosen).all() and 0 < chosen.sum() <= most:
                value = one.fit(np.where(chosen[rows.edge], moved, log_t))[0]
                yield Shift(chosen, offset, factor, null - value - 2 * log(2 * len(groups) + 2) - early)
        for start in (*groups, *slopes):
            value, chosen = one.classify(log_t, moved, start & able, able)
            k = int(chosen.sum())
            if 0 < k <= min(most, G - 1):
                yield Shift(chosen, offset, factor, null - value - 2 * log(comb(G, k)) - 2 * max(0, 2 * k - G) - early)


def _changes(middle: float) -> Iterator[tuple[float, float]]:
    """Offsets and factors that are tried; ``middle`` is the median time."""
    yield from ((sign * size * middle, 1.0) for size in OFFSETS for sign in (1, -1))
    yield from ((0.0, k) for unit in UNITS for k in (unit, 1 / unit))


def _groups(rows: TimeRows) -> Iterator[Flags]:
    """Edges on each side of the widest gaps of the first times."""
    first = first_times(rows)
    levels = np.sort(first)
    gaps = np.diff(levels)
    for k in np.argsort(-gaps)[:3]:
        if gaps[k] > SPREAD:
            yield first > levels[k]
            yield first <= levels[k]


def _by_slope(rows: TimeRows) -> tuple[Flags, Flags]:
    """Edges whose own exponent of time is above, or below, the median."""
    x, y = rows.inside(np.column_stack([np.log(rows.t), rows.y])).T
    slope = np.bincount(rows.edge, x * y) / np.maximum(np.bincount(rows.edge, x * x), 1e-9)
    return slope > np.median(slope), slope < np.median(slope)


def refined(rows: TimeRows, found: Shift) -> float:
    """The offset at the highest likelihood, rounded to two digits."""
    from scipy.optimize import minimize_scalar

    moved, log_t = found.edges[rows.edge], np.log(rows.t)
    one = Search(rows, SHARES[1])
    low, high = sorted((found.offset * 0.6, found.offset * 1.6))
    high = min(high, float(rows.t[moved].min()) * LATEST)

    def value(offset: float) -> float:
        return one.fit(np.where(moved, np.log(np.where(moved, rows.t - offset, rows.t)), log_t))[0]

    best = float(minimize_scalar(value, bounds=(low, high), method="bounded").x)
    rounded = float(f"{best:.2g}")
    return rounded if rounded < float(rows.t[moved].min()) else float(f"{best:.3g}")


def _basis(columns: Array) -> Array:
    """Orthonormal basis of columns, shape (n, rank)."""
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(U[:, s > 1e-9 * s[0]])
