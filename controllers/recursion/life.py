"""Tool life by the recursion of AC-2017, by a given plan, and at a fixed pair of speed and feed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Array
from ...core.display import Displayable, Plottable, as_columns
from ...core.errors import UsageError
from .interval_optimum import (
    Choice,
    Grid,
    IntervalSurfaces,
    SearchMethod,
    beyond_feed_rate,
    choose,
    grid_of,
    outcome,
    rates,
    surfaces,
)
from .laws import LifeLaws, Rules, Terms, response_at_end, wear_after

if TYPE_CHECKING:
    from pandas import DataFrame

MOST = 1000  # intervals of a life


@dataclass(frozen=True, slots=True, repr=False)
class Life(Plottable):
    """An edge from new to worn out: a calculation from laws, not a measurement.

    Attributes
    ----------
    laws, rules, grid
        The inputs.
    time : ndarray, shape (n,)
        End of each interval, min.
    V, f : ndarray, shape (n,)
        Pair of each interval, m/min and mm/rev.
    AW, P, Fxz : ndarray, shape (n,)
        Wear, power and force at its end, in the units of the laws; P and Fxz are NaN where they are not limited.
    MRR : ndarray, shape (n,)
        mm3/min.
    stops : tuple of tuple of str
        Active limits of each interval; empty where the pair was not optimized there.
    ended : bool
        False where the edge was not worn out after the greatest number of intervals.
    """

    laws: LifeLaws
    rules: Rules
    grid: Grid
    time: Array
    V: Array
    f: Array
    AW: Array
    P: Array
    Fxz: Array
    MRR: Array
    stops: tuple[tuple[str, ...], ...]
    ended: bool = True

    @property
    def minutes(self) -> float:
        """Life, min."""
        return len(self.time) * self.rules.interval

    @property
    def removed(self) -> float:
        """Metal removed in the whole life, mm3."""
        return float(self.MRR.sum()) * self.rules.interval

    @property
    def per_minute(self) -> float:
        """Metal removed per minute of cut, mm3/min; 0 without a feasible pair."""
        return self.removed / self.minutes if len(self.time) else 0.0

    @property
    def path(self) -> dict[str, Array]:
        """V, f, t and the wear at the end of each interval, by their symbols in the laws."""
        return {"V": self.V, "f": self.f, "t": self.time, self.laws.wear.response: self.AW}

    def before(self, k: int) -> float:
        """Wear at the beginning of interval k, counted from 0."""
        return float(self.AW[k - 1]) if k else 0.0

    def surfaces(self, k: int) -> IntervalSurfaces:
        """Responses of every pair of the grid in interval k, counted from 0; the last has no feasible pair."""
        if not 0 <= k <= len(self.time):
            raise UsageError(f"interval {k}: give 0 to {len(self.time)}.")
        return surfaces(self.laws, self.rules, self.grid, self.before(k), k * self.rules.interval)

    def to_frame(self) -> "DataFrame":
        """One row per interval, indexed by its end in min."""
        return as_columns(self, "time", "V", "f", "AW", "P", "Fxz", "MRR").set_index("time")


@dataclass(frozen=True, slots=True)
class BySpeed:
    """Best feed at each speed in one interval, as Tables 1 and 2; speeds without a feasible feed are omitted.

    Attributes
    ----------
    V, f : ndarray, shape (m,)
        m/min, mm/rev.
    before : float
        Wear at the beginning of the interval.
    fresh_end, fresh_start : ndarray, shape (m,)
        Wear of a fresh edge at this pair at the end and at the beginning of the interval: Wo_i and Wo_{i-1}.
    AW, P, Fxz, MRR : ndarray, shape (m,)
        P and Fxz are None where they are not limited.
    """

    V: Array
    f: Array
    before: float
    fresh_end: Array
    fresh_start: Array
    AW: Array
    P: Array | None
    Fxz: Array | None
    MRR: Array


def whole_life(
    laws: LifeLaws, rules: Rules | None = None, grid: Grid | None = None, how: SearchMethod = "grid", most: int = MOST
) -> Life:
    """Run the recursion of AC-2017 (eq. 4-8) to the end of the edge.

    Parameters
    ----------
    laws : LifeLaws
    rules : Rules, optional
        By default wear by the clock in intervals of a minute, and the times of ``laws.times``.
    grid : Grid, optional
        The paper's steps unless given.
    how : {"grid", "exact"}
        The best pair of the grid, as published, or the exact optimum of each interval. Both are greedy: neither is
        the best sequence of a whole life.
    most : int
        Greatest number of intervals.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers import life_laws
    >>> life = whole_life(life_laws(published("AC-2017")))
    >>> life.minutes, life.removed, list(zip(life.V.tolist(), life.f.tolist()))[:2]
    (14.0, 2213750.0, [(150.0, 0.58), (140.0, 0.58)])
    """
    rules, grid = rules or Rules(laws.times), grid or grid_of(laws)
    chosen: list[Choice] = []
    while len(chosen) < most:
        best = choose(laws, rules, grid, how, chosen[-1].AW if chosen else 0.0, len(chosen) * rules.interval)
        if best is None:
            return life_of(laws, rules, grid, chosen)
        chosen.append(best)
    return life_of(laws, rules, grid, chosen, ended=False)


def apply_plan(plan: Life, laws: LifeLaws, rules: Rules | None = None, most: int = MOST) -> Life:
    """Apply the pairs of a life to an edge of other laws or rules; the last is held until the edge is worn out.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers.recursion.laws import Rules
    >>> from fitmodels.controllers import life_laws
    >>> laws = life_laws(published("AC-2017"))
    >>> apply_plan(whole_life(laws), laws, Rules(wear="wear_state")).minutes
    13.0
    """
    rules = plan.rules if rules is None else rules
    done: list[Choice] = []
    while len(plan.time) and len(done) < most:
        k, step = len(done), rules.interval
        V, f = float(plan.V[min(k, len(plan.V) - 1)]), float(plan.f[min(k, len(plan.f) - 1)])
        AW = float(wear_after(laws, rules, V, f, done[-1].AW if done else 0.0, k * step, (k + 1) * step))
        if laws.wear.most < AW:
            return life_of(laws, rules, plan.grid, done)
        done.append(outcome(laws, rules, V, f, AW, (k + 1) * step))
    return life_of(laws, rules, plan.grid, done, ended=not len(plan.time))


def by_speed(life: Life, k: int) -> BySpeed:
    """Interval k of a life, counted from 0, in the form of the paper's tables.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers import life_laws
    >>> table = by_speed(whole_life(life_laws(published("AC-2017"))), 0)
    >>> float(table.V[10]), float(table.f[10]), round(float(table.P[10]), 8)
    (150.0, 0.58, 6.97040767)
    """
    tried = life.surfaces(k)
    rate = np.where(tried.allowed, tried.MRR, 0.0)
    i = np.flatnonzero(rate.any(axis=1))
    j = rate.argmax(axis=1)[i]
    V, f = life.grid.V[i], life.grid.f[j]
    first, h, step = life.laws.wear(V, f), life.laws.wear.t, life.rules.interval
    at = i, j
    return BySpeed(
        V, f, life.before(k), first * ((k + 1) * step) ** h, first * (k * step) ** h, tried.AW[at],
        None if tried.P is None else tried.P[at], None if tried.Fxz is None else tried.Fxz[at], tried.MRR[at],
    )  # fmt: skip


def life_of(laws: LifeLaws, rules: Rules, grid: Grid, chosen: Sequence[Choice], ended: bool = True) -> Life:
    """The life of chosen pairs, one an interval."""
    V, f, AW, P, Fxz, MRR = (
        np.array([getattr(one, name) for one in chosen], dtype=np.float64)
        for name in ("V", "f", "AW", "P", "Fxz", "MRR")
    )
    time = rules.interval * np.arange(1.0, len(chosen) + 1)
    return Life(laws, rules, grid, time, V, f, AW, P, Fxz, MRR, tuple(one.stops for one in chosen), ended)


def no_pair(life: Life, outside: Sequence[str] = ()) -> str:
    """The reason why a life has no interval: limits that the slowest pair exceeds, and sentences on what is untested.

    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers import life_laws
    >>> no_pair(whole_life(life_laws(published("AC-2017"), d=20.0))).split(": ")[0]
    'no pair of speed and feed keeps the limits on a new edge'
    """
    laws, rules, end = life.laws, life.rules, life.rules.interval
    V, f = float(life.grid.V[0]), float(life.grid.f[0])
    AW = float(wear_after(laws, rules, V, f, 0.0, 0.0, end))
    found = [(laws.wear, AW), *((one, float(response_at_end(one, rules, V, f, end, AW))) for _, one in laws.limited)]
    over = [
        f"{one.response} {value:.4g} {one.unit} exceeds {one.most:g} {one.unit}"
        for one, value in found
        if value > one.most
    ]
    head = "no pair of speed and feed keeps the limits on a new edge"
    pair = f"at the slowest pair, {V:g} m/min and {f:g} mm/rev, d {laws.d:g} mm, {' and '.join(over)} after {end:g} min"
    said = f"{head}: {pair}." if over else f"{head}."
    return " ".join([said, *outside, "Give a smaller depth, or a lower range of V or f."])


EQUAL = 1e-9  # of a limit: a pair on it is within it


@dataclass(frozen=True, slots=True, repr=False)
class FixedLife(Displayable):
    """A fixed pair until the wear criterion: calculated from the laws.

    Attributes
    ----------
    V, f : float
        m/min, mm/rev.
    minutes : float
        Life, min: the time at which AW = C V^a f^b t^h meets the criterion, not rounded to intervals; at most the time
        asked for.
    removed, per_minute : float
        mm3 in that time, and mm3/min.
    peak_power, peak_force : float
        The largest of the life, in the units of the laws; NaN where they are not limited.
    passes : tuple of str
        Limits that it exceeds: ``power``, ``force``.
    """

    V: float
    f: float
    minutes: float
    removed: float
    per_minute: float
    peak_power: float
    peak_force: float
    passes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LifeRatios:
    """Ratios of a life to that of a fixed pair: metal removed per minute, in the whole life, and the lives."""

    per_minute: float
    removed: float
    minutes: float


def fixed_life(laws: LifeLaws, V: float, f: float, rules: Rules | None = None, until: float = np.inf) -> FixedLife:
    """Life of a fixed pair until the edge is worn out, without regard to the limits of power and force.

    ``until`` ends it after so many min.

    Raises
    ------
    UsageError
        A speed or feed that is not above zero.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers import life_laws
    >>> fixed = fixed_life(life_laws(published("AC-2017")), 145.0, 0.3)
    >>> round(fixed.minutes, 1), round(fixed.per_minute), fixed.passes
    (23.8, 108750, ('force',))
    """
    if not (V > 0 and f > 0):
        raise UsageError(f"a fixed pair of {V!r} m/min and {f!r} mm/rev: give both above zero.")
    rules = rules or Rules(laws.times)
    minutes, peaks = _to_the_end(laws, rules, V, f, until)
    values = {name: float(peak) for name, peak in peaks.items()}
    passes = tuple(name for name, terms in laws.limited if values[name] > terms.most * (1 + EQUAL))
    per_minute, none = float(laws.mrr(V, f)), float("nan")
    life = float(minutes)
    power, force = values.get("power", none), values.get("force", none)
    return FixedLife(V, f, life, per_minute * life, per_minute, power, force, passes)


def best_fixed(
    laws: LifeLaws,
    rules: Rules | None = None,
    grid: Grid | None = None,
    most: str | tuple[float, float] = "per_minute",
    *,
    rate: float = 0.0,
    until: float = np.inf,
) -> FixedLife | None:
    """The fixed pair of the grid that keeps power and force within their limits until the edge is worn out, or None.

    Parameters
    ----------
    laws, rules, grid
        As in `whole_life`.
    most : {"per_minute", "removed", "minutes"} or (float, float)
        What is to be largest: metal per minute of cut or in the life of the edge, or the life; metal per cost, with the
        costs of an edge and of a minute.
    rate : float
        Least removal rate, mm3/min.
    until : float
        Time that the edge must last and that the limits must be kept for, min, in place of its life.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers import life_laws
    >>> best = best_fixed(life_laws(published("AC-2017")))
    >>> best.V, best.f
    (200.0, 0.2)
    """
    costs = {"per_minute": (0.0, 1.0), "removed": (1.0, 0.0), "minutes": (0.0, 1.0)}
    if isinstance(most, str) and most not in costs:
        raise UsageError(f"most={most!r}: it is one of {', '.join(costs)}, or the costs of an edge and of a minute.")
    of_edge, of_minute = costs[most] if isinstance(most, str) else most
    rules, grid = rules or Rules(laws.times), grid or grid_of(laws)
    minutes, peaks = _to_the_end(laws, rules, grid.V[:, None], grid.f, until)
    removal = rates(laws, grid)
    keeps = ~beyond_feed_rate(laws, grid) & (rate * (1 - EQUAL) <= removal)
    keeps &= (minutes >= until * (1 - EQUAL)) | np.isinf(until)
    for name, terms in laws.limited:
        keeps &= peaks[name] <= terms.most * (1 + EQUAL)
    score = minutes if most == "minutes" else removal * minutes / (of_edge + of_minute * minutes)
    score = np.where(keeps, score, 0.0)
    i, j = divmod(int(score.argmax()), score.shape[1])
    return fixed_life(laws, float(grid.V[i]), float(grid.f[j]), rules, until) if score[i, j] > 0 else None


def life_ratios(life: Life, fixed: FixedLife) -> LifeRatios:
    """Ratios of a life to that of a fixed pair."""
    return LifeRatios(life.per_minute / fixed.per_minute, life.removed / fixed.removed, life.minutes / fixed.minutes)


def _to_the_end(
    laws: LifeLaws, rules: Rules, V: ArrayLike, f: ArrayLike, until: float
) -> tuple[Array, dict[str, Array]]:
    """Time at which the wear of these pairs meets the criterion, and at most ``until``; largest power and force in it.

    At a fixed pair both go with a power of time, so the largest stands at one end: of the life, or of its first
    interval (the laws are of a cut's end, and a power below zero has no value at time 0).
    """
    wear = laws.wear
    life = (wear.most / wear(V, f)) ** (1.0 / wear.t)
    minutes, first = np.minimum(life, until), np.minimum(rules.interval, life)
    worn = np.where(life <= until, wear.most, wear(V, f, minutes))

    def peak(terms: Terms) -> Array:
        ends = ((first, wear(V, f, first)), (minutes, worn))
        early, late = (response_at_end(terms, rules, V, f, end, AW) for end, AW in ends)
        return np.maximum(early, late)

    return minutes, {name: peak(terms) for name, terms in laws.limited}
