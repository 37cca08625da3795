"""Best sequences of pairs over a whole life: dynamic programming over the wear, with a bound that no sequence exceeds.

The recursion of AC-2017 optimizes each interval for itself. Wear adds up in s = AW, or in s = AW^(1/h) by the wear
state, and a pair is allowed where the wear that it reaches lies under a cap of its own, from the criterion and from
the limits of power and force. So the metal that can still be removed depends on s and on the number of the interval
alone (R. Bellman, Dynamic Programming, 1957). On a grid of s each increment is rounded: up, the sequence found is
feasible; down, its metal is a bound for every sequence of the pairs.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...core.arrays import Array, Ints
from ...core.display import Displayable
from ...core.errors import UsageError
from .interval_optimum import Choice, Grid, beyond_feed_rate, not_convex, outcome, rates, surfaces
from .laws import LifeLaws, Rules
from .life import MOST, Life, life_of

CELLS, MOST_CELLS = 6000, 24000  # of the wear from 0 to its criterion; a plan of 14 intervals then has a bound to 0.1 %
PER_INTERVAL = 80  # cells
LONGER = 1.25  # times the least cost: longer lives are not searched

WORK = 600_000  # pairs times intervals of a search: half a minute


@dataclass(frozen=True, slots=True, repr=False)
class BestSequence(Displayable):
    """A sequence of pairs over a life, and a bound.

    Attributes
    ----------
    life : Life
        The sequence, checked interval by interval against the limits.
    bound : float
        mm3: no sequence of as many intervals with pairs of the grid removes more.
    """

    life: Life
    bound: float


@dataclass(frozen=True, slots=True)
class Pairs:
    """The pairs of a grid.

    Attributes
    ----------
    rate, wear : ndarray, shape (n,)
        mm3 in an interval, and the increment of s in a first minute.
    base : ndarray, shape (k, n)
        ln(limit / response) of each limited response, without its factors of time and wear.
    """

    rate: Array
    wear: Array
    base: Array


def best_sequence(laws: LifeLaws, rules: Rules, grid: Grid, count: int, known: Life | None = None) -> BestSequence:
    """The sequence that removes most metal in so many intervals, all of which the edge must last.

    Parameters
    ----------
    laws, rules, grid
        As in `whole_life`.
    count : int
        Number of intervals.
    known : Life, optional
        A plan of as many intervals, which the result is not worse than.

    Raises
    ------
    UsageError
        No sequence lasts so many intervals, or power or force falls with wear, so that more wear may be better.

    Examples
    --------
    >>> from fitmodels.controllers import life_laws
    >>> from fitmodels.controllers.recursion.interval_optimum import grid_of
    >>> from fitmodels.parameters.published import published
    >>> laws = life_laws(published("AC-2017"))
    >>> best = best_sequence(laws, Rules("published", "wear_state"), grid_of(laws, 10.0, 0.02), 13)
    >>> best.life.minutes, best.life.removed <= best.bound
    (13.0, True)
    """
    need_monotone(laws)
    pairs, cells = pairs_of(laws, rules, grid), cells_for(count)
    if count * len(pairs.rate) > WORK:
        raise _too_many(count, pairs)
    upper = values_to_go(laws, rules, pairs, count, cells, up=False)
    found = [known] if known is not None and len(known.time) == count else []
    for tables in (values_to_go(laws, rules, pairs, count, cells, up=True), upper):
        life = _followed(laws, rules, grid, tables)
        found += [life] if life is not None else []
    if not found:
        least = least_wear_life(laws, rules, grid, 0.0, count)
        if len(least.time) < count:
            raise UsageError(
                f"no plan on this grid lasts {count * rules.interval:g} min within the limits; the longest lasts "
                f"{least.minutes:g} min. Give a shorter time, a smaller depth, or wider limits."
            )
        found = [least]
    best = max(found, key=lambda life: life.removed)
    return BestSequence(best, max(float(upper[0][0]), best.removed))


def least_cost_sequence(
    laws: LifeLaws, rules: Rules, grid: Grid, per_minute: float, fixed: float, most: int = MOST
) -> tuple[BestSequence, float]:
    """The sequence of least cost per volume over its number of intervals, and a bound of that cost per mm3.

    Parameters
    ----------
    laws, rules, grid
        As in `whole_life`.
    per_minute, fixed : float
        Cost of a minute in cut, and of each edge with its change.
    most : int
        Greatest number of intervals.

    Raises
    ------
    UsageError
        No pair is allowed on a new edge, or power or force falls with wear.
    """
    need_monotone(laws)
    pairs = pairs_of(laws, rules, grid)
    most = min(most, WORK // len(pairs.rate))
    most_metal = [removable(laws, rules, pairs, most, up, per_minute, fixed) for up in (True, False)]
    costs = [
        [(fixed + per_minute * (k + 1) * rules.interval) / metal if metal > 0 else np.inf for k, metal in enumerate(of)]
        for of in most_metal
    ]
    if not costs[0] or not np.isfinite(costs[0]).any():
        raise UsageError("no pair of the grid is within the limits of a new edge, so no cost can be given.")
    count = int(np.argmin(costs[0])) + 1
    if count == WORK // len(pairs.rate):
        raise _too_many(count, pairs)
    return best_sequence(laws, rules, grid, count), float(min(costs[1]))


def _too_many(count: int, pairs: Pairs) -> UsageError:
    return UsageError(
        f"{count} intervals of {len(pairs.rate)} pairs each: a best sequence is searched for among at most {WORK} in "
        "all. Give a longer --interval or larger steps, --grid V=20m/min --grid f=0.01mm/rev."
    )


def least_wear_life(laws: LifeLaws, rules: Rules, grid: Grid, rate: float, most: int = MOST) -> Life:
    """The longest life at a removal rate of at least ``rate``, mm3/min, in every interval.

    Where power and force do not fall with wear, the pair of least wear in each interval gives the longest life of all
    sequences: with less wear every later interval allows the same pairs and more.
    """
    chosen: list[Choice] = []
    while len(chosen) < most:
        before, start = (chosen[-1].AW if chosen else 0.0), len(chosen) * rules.interval
        tried = surfaces(laws, rules, grid, before, start)
        allowed = tried.allowed & (rate * (1 - 1e-12) <= tried.MRR)
        if not allowed.any():
            return life_of(laws, rules, grid, chosen)
        wear = np.where(allowed, tried.AW, np.inf)
        alike = np.where(wear <= wear.min() * (1 + 1e-12), tried.MRR, -1.0)
        i, j = divmod(int(alike.argmax()), alike.shape[1])
        end = start + rules.interval
        chosen.append(
            outcome(laws, rules, float(grid.V[i]), float(grid.f[j]), float(tried.AW[i, j]), end, tried.stops(i, j))
        )
    return life_of(laws, rules, grid, chosen, ended=False)


def need_monotone(laws: LifeLaws) -> None:
    """Raise UsageError where a limited response falls with wear: less wear is then not always better."""
    if why := not_convex(laws):
        raise UsageError(f"no best sequence: {why.split(':')[0]}. Use --objective removal.")


def pairs_of(laws: LifeLaws, rules: Rules, grid: Grid) -> Pairs:
    """Rate, wear and distance from the limits of every pair of the grid."""
    x, y = np.repeat(np.log(grid.V), len(grid.f)), np.tile(np.log(grid.f), len(grid.V))
    rate = rates(laws, grid).ravel() * rules.interval
    wear = laws.wear.ln_c + laws.wear.V * x + laws.wear.f * y
    base = np.array([np.log(one.most) - one.ln_c - one.V * x - one.f * y for _, one in laws.limited])
    scale = laws.wear.t if rules.wear == "wear_state" else 1.0
    kept = ~beyond_feed_rate(laws, grid).ravel()
    return Pairs(rate[kept], np.exp(wear / scale)[kept], base.reshape(-1, len(rate))[:, kept])


def cells_for(count: int) -> int:
    """Number of cells of the wear for so many intervals."""
    return min(max(CELLS, PER_INTERVAL * count), MOST_CELLS)


def steps_of(laws: LifeLaws, rules: Rules, pairs: Pairs, k: int, cells: int, up: bool) -> tuple[Ints, Ints]:
    """Cells by which each pair moves the wear in interval k, and the last cell that it may reach."""
    h, start, end = laws.wear.t, k * rules.interval, (k + 1) * rules.interval
    power = 1.0 / h if rules.wear == "wear_state" else 1.0
    gain = rules.interval if rules.wear == "wear_state" else end**h - start**h
    late = np.log(end) if rules.times == "full" else 0.0
    cap = np.full(len(pairs.rate), np.log(laws.wear.most))
    for base, (_, terms) in zip(pairs.base, laws.limited, strict=True):
        left = base - terms.t * late
        cap = np.minimum(cap, left / terms.AW if terms.AW else np.where(left >= 0, np.inf, -np.inf))
    size = laws.wear.most**power / cells
    moved = pairs.wear * gain / size
    most = np.exp(cap * power) / size
    steps = np.ceil(moved - 1e-9) if up else np.floor(moved + 1e-9)
    return steps.astype(np.intp), np.floor(most + 1e-9).astype(np.intp)


def values_to_go(laws: LifeLaws, rules: Rules, pairs: Pairs, count: int, cells: int, *, up: bool) -> list[Array]:
    """Greatest metal from interval k to the last, mm3, by the cell of the wear; minus infinity where it cannot last."""
    tables = [np.zeros(cells + 1)]
    for k in reversed(range(count)):
        steps, most = steps_of(laws, rules, pairs, k, cells, up)
        value = np.full(cells + 1, -np.inf)
        for rate, step, last in zip(pairs.rate.tolist(), steps.tolist(), most.tolist(), strict=True):
            if last >= step:
                room = value[: last - step + 1]
                np.maximum(room, tables[-1][step : last + 1] + rate, out=room)
        tables.append(value)
    return tables[::-1]


def removable(
    laws: LifeLaws, rules: Rules, pairs: Pairs, most: int, up: bool, per_minute: float, fixed: float
) -> list[float]:
    """Greatest metal in 1, 2 ... intervals, mm3, until the cost per volume is well above the least."""
    cells = MOST_CELLS // 2
    value = np.full(cells + 1, -np.inf)
    value[0] = 0.0
    found: list[float] = []
    least = np.inf
    for k in range(most):
        steps, ends = steps_of(laws, rules, pairs, k, cells, up)
        after = np.full(cells + 1, -np.inf)
        for rate, step, last in zip(pairs.rate.tolist(), steps.tolist(), ends.tolist(), strict=True):
            if last >= step:
                room = after[step : last + 1]
                np.maximum(room, value[: last - step + 1] + rate, out=room)
        value = after
        metal = float(value.max())
        if metal <= 0:
            break
        found.append(metal)
        cost = (fixed + per_minute * (k + 1) * rules.interval) / metal
        least = min(least, cost)
        if cost > LONGER * least:
            break
    return found


def _followed(laws: LifeLaws, rules: Rules, grid: Grid, tables: list[Array]) -> Life | None:
    """The sequence that follows the values to go from exact wear; None where it ends too early."""
    cells = len(tables[0]) - 1
    power = 1.0 / laws.wear.t if rules.wear == "wear_state" else 1.0
    chosen: list[Choice] = []
    for _, after in pairwise(tables):
        before, start = (chosen[-1].AW if chosen else 0.0), len(chosen) * rules.interval
        tried = surfaces(laws, rules, grid, before, start)
        at = np.clip((tried.AW / laws.wear.most) ** power * cells, 0, cells)
        score = np.where(tried.allowed, tried.MRR * rules.interval + _between(after, at), -np.inf)
        i, j = divmod(int(score.argmax()), score.shape[1])
        if not np.isfinite(score[i, j]):
            return None
        end = start + rules.interval
        chosen.append(
            outcome(laws, rules, float(grid.V[i]), float(grid.f[j]), float(tried.AW[i, j]), end, tried.stops(i, j))
        )
    found = life_of(laws, rules, grid, chosen)
    return replace(found, ended=not surfaces(laws, rules, grid, found.before(len(chosen)), found.minutes).allowed.any())


def _between(values: Array, at: Array) -> Array:
    """Values between cells, linear; minus infinity where the upper cell is."""
    low = np.floor(at).astype(np.intp)
    high = np.minimum(low + 1, len(values) - 1)
    share = at - low
    with np.errstate(invalid="ignore"):
        mixed = values[low] * (1 - share) + values[high] * share
    return np.where(share > 0, np.where(np.isfinite(values[high]), mixed, -np.inf), values[low])
