"""The recursion: interval after interval the best pair, until none keeps the wear under its criterion."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.display import Displayable, as_columns
from ...core.errors import UsageError
from .choice import Choice, How, choose, outcome
from .grid import Grid, Surfaces, grid_of, surfaces
from .laws import Array, LifeLaws
from .rules import Rules, wear_after

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

MOST = 1000  # intervals of a life


@dataclass(frozen=True, slots=True, repr=False)
class Life(Displayable):
    """An edge from new to worn out: a calculation from laws, not a measurement.

    Attributes
    ----------
    laws, rules, grid
        What it was computed from.
    time : ndarray, shape (n,)
        End of each interval, min.
    V, f : ndarray, shape (n,)
        Pair of each interval, m/min and mm/rev.
    AW, P, Fxz : ndarray, shape (n,)
        Wear, power and force at its end, in the units of the laws; P and Fxz are NaN where they are not limited.
    MRR : ndarray, shape (n,)
        mm3/min.
    stops : tuple of tuple of str
        What forbids a larger MRR in each interval; empty where the pair was not chosen there.
    ended : bool
        False where the edge was not worn out after the most intervals that are computed.
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
        """Metal removed per minute of cut, mm3/min; 0 where no pair was allowed at all."""
        return self.removed / self.minutes if len(self.time) else 0.0

    def before(self, k: int) -> float:
        """Wear at the beginning of interval k, counted from 0."""
        return float(self.AW[k - 1]) if k else 0.0

    def surfaces(self, k: int) -> Surfaces:
        """What every pair of the grid would have done in interval k, counted from 0; the last finds no pair."""
        if not 0 <= k <= len(self.time):
            raise UsageError(f"interval {k}: this life has the intervals 0 to {len(self.time)}.")
        return surfaces(self.laws, self.rules, self.grid, self.before(k), k * self.rules.interval)

    def to_frame(self) -> "DataFrame":
        """A row an interval, by its end in min."""
        return as_columns(self, "time", "V", "f", "AW", "P", "Fxz", "MRR").set_index("time")

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Wear and metal removal rate over the life."""
        from .draw import life_picture

        return life_picture(self, ax)


@dataclass(frozen=True, slots=True)
class BySpeed:
    """The best feed at each speed in one interval, as Tables 1 and 2 of AC-2017; speeds without one are left out.

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
    laws: LifeLaws, rules: Rules | None = None, grid: Grid | None = None, how: How = "grid", most: int = MOST
) -> Life:
    """Run the recursion of AC-2017 (eq. 4-8) to the end of the edge.

    Parameters
    ----------
    laws : LifeLaws
    rules : Rules, optional
        Unless given, wear by the clock in intervals of a minute, and the times of ``laws.times``.
    grid : Grid, optional
        The paper's steps unless given.
    how : {"grid", "exact"}
        The best pair of the grid, as published, or the exact optimum of each interval. Both look no further than the
        interval: neither is the best sequence of a whole life.
    most : int
        Intervals after which it stops.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers.recursion import life_laws
    >>> life = whole_life(life_laws(published("AC-2017")))
    >>> life.minutes, life.removed, list(zip(life.V.tolist(), life.f.tolist()))[:2]
    (14.0, 2213750.0, [(150.0, 0.58), (140.0, 0.58)])
    """
    rules, grid = rules or Rules(laws.times), grid or grid_of(laws)
    chosen: list[Choice] = []
    while len(chosen) < most:
        best = choose(laws, rules, grid, how, chosen[-1].AW if chosen else 0.0, len(chosen) * rules.interval)
        if best is None:
            return _life(laws, rules, grid, chosen)
        chosen.append(best)
    return _life(laws, rules, grid, chosen, ended=False)


def carried_out(plan: Life, laws: LifeLaws, rules: Rules | None = None, most: int = MOST) -> Life:
    """Run a life's pairs, whatever comes, on an edge of other laws or rules; the last is held until it is worn out.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers.recursion import Rules, life_laws
    >>> laws = life_laws(published("AC-2017"))
    >>> carried_out(whole_life(laws), laws, Rules(wear="wear_state")).minutes
    13.0
    """
    rules = plan.rules if rules is None else rules
    done: list[Choice] = []
    while len(plan.time) and len(done) < most:
        k, step = len(done), rules.interval
        V, f = float(plan.V[min(k, len(plan.V) - 1)]), float(plan.f[min(k, len(plan.f) - 1)])
        AW = float(wear_after(laws, rules, V, f, done[-1].AW if done else 0.0, k * step, (k + 1) * step))
        if laws.wear.most < AW:
            return _life(laws, rules, plan.grid, done)
        done.append(outcome(laws, rules, V, f, AW, (k + 1) * step))
    return _life(laws, rules, plan.grid, done, ended=not len(plan.time))


def by_speed(life: Life, k: int) -> BySpeed:
    """Interval k of a life, counted from 0, as the paper's tables have it.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers.recursion import life_laws
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


def _life(laws: LifeLaws, rules: Rules, grid: Grid, chosen: Sequence[Choice], ended: bool = True) -> Life:
    V, f, AW, P, Fxz, MRR = (
        np.array([getattr(one, name) for one in chosen], dtype=np.float64)
        for name in ("V", "f", "AW", "P", "Fxz", "MRR")
    )
    time = rules.interval * np.arange(1.0, len(chosen) + 1)
    return Life(laws, rules, grid, time, V, f, AW, P, Fxz, MRR, tuple(one.stops for one in chosen), ended)
