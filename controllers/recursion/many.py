"""The recursion for a thousand draws of the laws at once.

Pairs stand in one row, largest MRR first, so that the first allowed is the best. A limit R <= R_most is compared as
ln R, of which all but the wear is computed once: one logarithm an evaluation. Draws go in batches that stay in cache.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .grid import Grid, rates
from .laws import Array, LifeLaws
from .life import MOST, Life
from .rules import Rules

BATCH = 16  # draws: three tables of 16 x 1744 numbers are 0.7 MB


@dataclass(frozen=True, slots=True)
class DrawnTerms:
    """One law for S draws: the numbers of `Terms`, each an array of shape (S,)."""

    ln_c: Array
    V: Array
    f: Array
    t: Array
    AW: Array
    most: float

    def part(self, rows: slice) -> "DrawnTerms":
        """Some of the draws."""
        return DrawnTerms(self.ln_c[rows], self.V[rows], self.f[rows], self.t[rows], self.AW[rows], self.most)

    def logs(self, x: Array, y: Array) -> Array:
        """Logarithm of C V^a f^b, shape (S, n), at n pairs of ln V and ln f."""
        return np.asarray(self.ln_c[:, None] + self.V[:, None] * x + self.f[:, None] * y)


@dataclass(frozen=True, slots=True)
class ManyLaws:
    """The laws of an edge's life for S draws; see `LifeLaws`."""

    wear: DrawnTerms
    power: DrawnTerms | None
    force: DrawnTerms | None

    @property
    def limited(self) -> tuple[DrawnTerms, ...]:
        """Power and force, those that are limited."""
        return tuple(terms for terms in (self.power, self.force) if terms is not None)

    def part(self, rows: slice) -> "ManyLaws":
        """Some of the draws."""
        power, force = (None if one is None else one.part(rows) for one in (self.power, self.force))
        return ManyLaws(self.wear.part(rows), power, force)


def recursions(laws: LifeLaws, many: ManyLaws, rules: Rules, grid: Grid, most: int = MOST) -> tuple[Array, Array]:
    """Each draw's own recursion on the grid: number of intervals and metal removed, mm3, each shape (S,).

    A draw with ``most`` intervals was not worn out by then.
    """
    rate = rates(laws, grid).ravel()
    order = np.argsort(-rate, kind="stable")  # of equals the slower first, as in `Surfaces.best`
    x = np.repeat(np.log(grid.V), len(grid.f))[order]
    y = np.tile(np.log(grid.f), len(grid.V))[order]
    n = np.zeros(len(many.wear.ln_c), dtype=np.float64)
    removed = np.zeros(len(n))
    for first in range(0, len(n), BATCH):
        rows = slice(first, first + BATCH)
        n[rows], removed[rows] = _batch(many.part(rows), rules, x, y, rate[order], most)
    return n, removed * rules.interval


def _batch(many: ManyLaws, rules: Rules, x: Array, y: Array, rate: Array, most: int) -> tuple[Array, Array]:
    h, steps = many.wear.t, rules.wear == "wear_state"  # in u = AW, or AW^(1/h), wear adds up
    scale = h if steps else np.ones_like(h)
    first = np.exp(many.wear.logs(x, y) / scale[:, None])
    tables = [terms.logs(x, y) - np.log(terms.most) for terms in many.limited]
    n, removed, u = np.zeros(len(h), dtype=np.float64), np.zeros(len(h)), np.zeros(len(h))
    alive = np.arange(len(h))
    for k in range(most):
        start, end = k * rules.interval, (k + 1) * rules.interval
        gain = np.full(len(alive), rules.interval) if steps else end ** h[alive] - start ** h[alive]
        reached = u[alive, None] + gain[:, None] * first
        allowed = _allowed(many, alive, tables, np.log(reached) * scale[alive, None], rules, end)
        best = allowed.argmax(axis=1)
        found = allowed[np.arange(len(alive)), best]
        if not found.all():
            alive, best, reached = alive[found], best[found], reached[found]
            first, tables = first[found], [table[found] for table in tables]
        if not len(alive):
            break
        u[alive] = reached[np.arange(len(alive)), best]
        removed[alive] += rate[best]
        n[alive] += 1
    return n, removed


def _allowed(
    many: ManyLaws, alive: NDArray[np.intp], tables: list[Array], ln_AW: Array, rules: Rules, end: float
) -> NDArray[np.bool_]:
    """Whether wear, power and force keep their limits, shape (draws alive, pairs)."""
    allowed = ln_AW <= np.log(many.wear.most)
    for terms, table in zip(many.limited, tables, strict=True):
        over = terms.AW[alive, None] * ln_AW
        over += table
        if rules.times == "full":
            over += terms.t[alive, None] * np.log(end)
        allowed &= over <= 0
    return np.asarray(allowed)


def plan_on(plan: Life, many: ManyLaws, most: int) -> tuple[Array, Array, Array | None, Array | None]:
    """Intervals, metal removed and largest power and force of a plan on every drawn edge, the last pair held."""
    rules, wear = plan.rules, many.wear
    S = len(wear.ln_c)
    n, removed = np.zeros(S), np.zeros(S)
    peaks = [None if terms is None else np.zeros(S) for terms in (many.power, many.force)]
    if not len(plan.time):
        return n, removed, peaks[0], peaks[1]
    scale = wear.t if rules.wear == "wear_state" else np.ones(S)
    u, alive = np.zeros(S), np.ones(S, dtype=bool)
    for k in range(most):
        start, end = k * rules.interval, (k + 1) * rules.interval
        j = min(k, len(plan.V) - 1)
        x, y = np.log(plan.V[j : j + 1]), np.log(plan.f[j : j + 1])
        gain = rules.interval if rules.wear == "wear_state" else end**wear.t - start**wear.t
        u = u + gain * np.exp(wear.logs(x, y)[:, 0] / scale)
        ln_AW = np.log(u) * scale
        alive &= ln_AW <= np.log(wear.most)
        if not alive.any():
            break
        n += alive
        removed += alive * (plan.MRR[j] * rules.interval)
        for peak, terms in zip(peaks, (many.power, many.force), strict=True):
            if peak is not None and terms is not None:
                late = np.log(end) if rules.times == "full" else 0.0
                value = np.exp(terms.logs(x, y)[:, 0] + terms.t * late + terms.AW * ln_AW)
                np.maximum(peak, value, out=peak, where=alive)
    return n, removed, peaks[0], peaks[1]
