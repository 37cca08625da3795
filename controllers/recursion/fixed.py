"""One pair of speed and feed to the end of an edge: what the recursion is compared with."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...core.display import Displayable
from ...core.errors import UsageError
from .grid import Grid, grid_of, rates
from .laws import Array, LifeLaws, Terms
from .life import Life
from .rules import Rules, told

EQUAL = 1e-9  # of a limit: a pair on it is within it


@dataclass(frozen=True, slots=True, repr=False)
class FixedLife(Displayable):
    """A fixed pair until the wear criterion: calculated from the laws.

    Attributes
    ----------
    V, f : float
        m/min, mm/rev.
    minutes : float
        Life, min: the time at which AW = C V^a f^b t^h meets the criterion, not rounded to intervals.
    removed, per_minute : float
        mm3 in the whole life, and mm3/min.
    peak_power, peak_force : float
        The largest of the life, in the units of the laws; NaN where they are not limited.
    passes : tuple of str
        Limits that it passes on the way: ``power``, ``force``.
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
class Compared:
    """A life over a fixed pair's: metal removed per minute, in the whole life, and the lives themselves, as ratios."""

    per_minute: float
    removed: float
    minutes: float


def fixed_life(laws: LifeLaws, V: float, f: float, rules: Rules | None = None) -> FixedLife:
    """Cut at one pair until the edge is worn out, whatever power and force that takes.

    Raises
    ------
    UsageError
        A speed or feed that is not above zero.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers.recursion import life_laws
    >>> fixed = fixed_life(life_laws(published("AC-2017")), 145.0, 0.3)
    >>> round(fixed.minutes, 1), round(fixed.per_minute), fixed.passes
    (23.8, 108750, ('force',))
    """
    if not (V > 0 and f > 0):
        raise UsageError(f"a fixed pair of {V!r} m/min and {f!r} mm/rev: both lie above zero.")
    rules = rules or Rules(laws.times)
    minutes, peaks = _to_the_end(laws, rules, V, f)
    values = {name: float(peak) for name, peak in peaks.items()}
    passes = tuple(name for name, terms in laws.limited if values[name] > terms.most * (1 + EQUAL))
    per_minute, none = float(laws.mrr(V, f)), float("nan")
    life = float(minutes)
    power, force = values.get("power", none), values.get("force", none)
    return FixedLife(V, f, life, per_minute * life, per_minute, power, force, passes)


def best_fixed(
    laws: LifeLaws, rules: Rules | None = None, grid: Grid | None = None, most: str = "per_minute"
) -> FixedLife | None:
    """The fixed pair of the grid that keeps power and force within their limits until the edge is worn out, or None.

    Parameters
    ----------
    laws, rules, grid
        As in `whole_life`.
    most : {"per_minute", "removed"}
        What is to be largest: metal per minute of cut, or in the life of the edge.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers.recursion import life_laws
    >>> best = best_fixed(life_laws(published("AC-2017")))
    >>> best.V, best.f
    (200.0, 0.2)
    """
    if most not in ("per_minute", "removed"):
        raise UsageError(f"most={most!r}: it is 'per_minute' or 'removed'.")
    rules, grid = rules or Rules(laws.times), grid or grid_of(laws)
    minutes, peaks = _to_the_end(laws, rules, grid.V[:, None], grid.f)
    keeps = np.full(minutes.shape, True)
    for name, terms in laws.limited:
        keeps &= peaks[name] <= terms.most * (1 + EQUAL)
    score = np.where(keeps, rates(laws, grid) * (minutes if most == "removed" else 1.0), 0.0)
    i, j = divmod(int(score.argmax()), score.shape[1])
    return fixed_life(laws, float(grid.V[i]), float(grid.f[j]), rules) if score[i, j] > 0 else None


def compared(life: Life, fixed: FixedLife) -> Compared:
    """Set a life beside a fixed pair's."""
    return Compared(life.per_minute / fixed.per_minute, life.removed / fixed.removed, life.minutes / fixed.minutes)


def _to_the_end(laws: LifeLaws, rules: Rules, V: ArrayLike, f: ArrayLike) -> tuple[Array, dict[str, Array]]:
    """Time at which the wear of these pairs meets the criterion, and the largest power and force until then.

    At a fixed pair both go with a power of time, so the largest stands at one end: of the life, or of its first
    interval (the laws are of a cut's end, and a power below zero has no value at time 0).
    """
    wear = laws.wear
    minutes = (wear.most / wear(V, f)) ** (1.0 / wear.t)
    first = np.minimum(rules.interval, minutes)

    def peak(terms: Terms) -> Array:
        ends = ((first, wear(V, f, first)), (minutes, np.full_like(minutes, wear.most)))
        early, late = (told(terms, rules, V, f, end, AW) for end, AW in ends)
        return np.maximum(early, late)

    return minutes, {name: peak(terms) for name, terms in laws.limited}
