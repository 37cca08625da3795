"""The pairs of speed and feed that are tried, and what each would do in an interval."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.display import Displayable
from ...core.errors import UsageError
from .laws import Array, LifeLaws
from .rules import Rules, told, wear_after

SPEED_STEP, FEED_STEP = 10.0, 0.005  # m/min, mm/rev: the paper's
MOST_PAIRS = 1_000_000
EVEN = 1e-9  # of a step: 0.06 + 108 x 0.005 is 0.6 but for rounding


@dataclass(frozen=True, slots=True, repr=False)
class Grid(Displayable):
    """Speeds V, shape (m,), m/min, and feeds f, shape (n,), mm/rev, both rising."""

    V: Array
    f: Array


@dataclass(frozen=True, slots=True, repr=False)
class Surfaces(Displayable):
    """What every pair of a grid would do in one interval.

    Attributes
    ----------
    grid : Grid
    AW, MRR : ndarray, shape (m, n)
        Wear at the end, in the unit of the law; mm3/min.
    P, Fxz : ndarray, shape (m, n), or None
        Power and force at the end, where they are limited.
    breaks : dict of ndarray, shape (m, n), bool
        By the name of a limit, the pairs that pass it: ``wear``, ``power``, ``force``.
    """

    grid: Grid
    AW: Array
    P: Array | None
    Fxz: Array | None
    MRR: Array
    breaks: dict[str, NDArray[np.bool_]]

    @property
    def allowed(self) -> NDArray[np.bool_]:
        """Pairs within every limit, shape (m, n)."""
        return np.asarray(~np.logical_or.reduce(list(self.breaks.values())))

    def best(self) -> tuple[int, int] | None:
        """Speed and feed of the largest MRR within the limits, by position, or None; of equals the slower."""
        rate = np.where(self.allowed, self.MRR, 0.0)
        i, j = divmod(int(rate.argmax()), rate.shape[1])
        return (i, j) if rate[i, j] > 0 else None

    def stops(self, i: int, j: int) -> tuple[str, ...]:
        """What forbids one step more of speed or of feed from a pair: limits by name, ``most speed``, ``most feed``."""
        m, n = self.AW.shape
        higher = [(i + 1, j)] * (i + 1 < m) + [(i, j + 1)] * (j + 1 < n)
        found = [name for name, broken in self.breaks.items() if any(broken[at] for at in higher)]
        return (*found, *(["most speed"] * (i + 1 == m)), *(["most feed"] * (j + 1 == n)))


def grid_of(laws: LifeLaws, speed_step: float = SPEED_STEP, feed_step: float = FEED_STEP) -> Grid:
    """The grid over the ranges of the laws: V 50(10)200 and f 0.06(0.005)0.6 in the paper, 16 x 109 pairs.

    Raises
    ------
    UsageError
        A step that is not above zero, or more than a million pairs.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers.recursion import life_laws
    >>> grid = grid_of(life_laws(published("AC-2017")))
    >>> len(grid.V), len(grid.f), float(grid.f[-1])
    (16, 109, 0.6)
    """
    if not (speed_step > 0 and feed_step > 0):
        raise UsageError(f"steps of {speed_step!r} m/min and {feed_step!r} mm/rev: both lie above zero.")
    counts = [int((high - low) / step + EVEN) + 1 for (low, high), step in ((laws.V, speed_step), (laws.f, feed_step))]
    if counts[0] * counts[1] > MOST_PAIRS:
        raise UsageError(f"a grid of {counts[0]} x {counts[1]} pairs; at most {MOST_PAIRS}: take larger steps.")
    V, f = (
        np.round(low + step * np.arange(n), 10)
        for low, step, n in ((laws.V[0], speed_step, counts[0]), (laws.f[0], feed_step, counts[1]))
    )
    return Grid(V, f)


def rates(laws: LifeLaws, grid: Grid) -> Array:
    """MRR of every pair, shape (m, n), rounded so that equal products are equal: 200 x 0.3 and 150 x 0.4."""
    return np.round(laws.mrr(grid.V[:, None], grid.f), 6)


def surfaces(laws: LifeLaws, rules: Rules, grid: Grid, before: float, start: float) -> Surfaces:
    """Wear, power, force and MRR of every pair in the interval that begins at ``start`` min with wear ``before``.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers.recursion import Rules, life_laws
    >>> laws = life_laws(published("AC-2017"))
    >>> first = surfaces(laws, Rules(), grid_of(laws), 0.0, 0.0)
    >>> i, j = first.best()
    >>> float(first.grid.V[i]), float(first.grid.f[j]), float(first.MRR[i, j])
    (150.0, 0.58, 217500.0)
    """
    V, f, end = grid.V[:, None], grid.f[None, :], start + rules.interval
    AW = wear_after(laws, rules, V, f, before, start, end)
    values = {name: told(terms, rules, V, f, end, AW) for name, terms in laws.limited}
    breaks = {"wear": laws.wear.most < AW, **{name: terms.most < values[name] for name, terms in laws.limited}}
    return Surfaces(grid, AW, values.get("power"), values.get("force"), rates(laws, grid), breaks)
