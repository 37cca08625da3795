"""Reference model, averages over a spindle revolution, and regulation metrics of the averaged force.

F_d'' + 2 zeta/T F_d' + F_d/T^2 = set point / T^2        the reference model: the law needs F_d' and F_d''
"""

import math
from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array

if TYPE_CHECKING:
    from ..loop import Trace


@dataclass(slots=True)
class ReferenceModel:
    """Second-order reference model F_d of a set point, exact at its steps.

    Attributes
    ----------
    time, damping : float
        T in s, and zeta.
    step_time : float
        s.
    value, rate : float
        F_d and F_d'.

    Examples
    --------
    >>> model = ReferenceModel(time=0.1, damping=1.0, step_time=0.1)
    >>> for _ in range(40):
    ...     model.advance(200.0)
    >>> round(model.value, 3), abs(model.second(200.0)) < 1e-6
    (200.0, True)
    """

    time: float
    damping: float
    step_time: float
    value: float = 0.0
    rate: float = 0.0
    _phi: tuple[float, float, float, float] = field(init=False)

    def __post_init__(self) -> None:
        self._phi = _transition(1 / self.time, self.damping, self.step_time)

    @property
    def transition(self) -> tuple[float, float, float, float]:
        """Transition of (value - target, rate) over a step, by rows."""
        return self._phi

    def advance(self, target: float) -> None:
        """Advance one step with a constant target."""
        a, b, c, d = self._phi
        off, rate = self.value - target, self.rate
        self.value = target + a * off + b * rate
        self.rate = c * off + d * rate

    def second(self, target: float) -> float:
        """F_d'' now."""
        return ((target - self.value) / self.time - 2 * self.damping * self.rate) / self.time

    def midway(self, target: float, dt: float) -> tuple[float, float, float]:
        """F_d'', F_d', F_d at half of ``dt`` from now, the best instant for a command held over ``dt``."""
        second, half = self.second(target), dt / 2
        value, rate = self.value + self.rate * half + second * half**2 / 2, self.rate + second * half
        return ((target - value) / self.time - 2 * self.damping * rate) / self.time, rate, value

    def restart(self, value: float) -> None:
        """Restart at rest at a value."""
        self.value, self.rate = value, 0.0


def _transition(omega: float, zeta: float, h: float) -> tuple[float, float, float, float]:
    """exp([[0, 1], [-omega^2, -2 zeta omega]] h), by its closed form at every damping."""
    shift = zeta * omega
    s2 = shift**2 - omega**2
    fade = math.exp(-shift * h)
    if abs(s2) * h**2 < 1e-10:  # critical: sinh(s h) / s is h to rounding
        even, odd = fade, fade * h
    elif s2 > 0:  # cosh and sinh would overflow where the damping is large
        s = math.sqrt(s2)
        slow, fast = math.exp(-(omega**2) / (shift + s) * h), math.exp(-(shift + s) * h)
        even, odd = (slow + fast) / 2, (slow - fast) / (2 * s)
    else:
        s = math.sqrt(-s2)
        even, odd = fade * math.cos(s * h), fade * math.sin(s * h) / s
    return even + shift * odd, odd, -(omega**2) * odd, even - shift * odd


@dataclass(slots=True)
class Revolution:
    """The last ``samples`` steps of force, F_d and F_d', as means and as their rates of change.

    The mean is trapezoidal, so that its rate is exactly the difference of the end values over the time: a ripple with a
    whole number of periods in it vanishes from both.

    Attributes
    ----------
    samples : int
        Steps of the law in a revolution; 1 applies no averaging.
    step_time : float
        s.

    Examples
    --------
    >>> last = Revolution(samples=4, step_time=0.005)
    >>> for k in range(6):
    ...     last.push(100.0 + 10 * k, 0.0, 0.0)
    >>> last.full, last.force, last.force_rate
    (True, 130.0, 2000.0)
    """

    samples: int
    step_time: float
    _rows: deque[tuple[float, float, float]] = field(init=False)
    _sums: list[float] = field(init=False)
    _pushed: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._rows = deque(maxlen=self.samples + 1)
        self._sums = [0.0, 0.0]

    @property
    def full(self) -> bool:
        """Whether the buffer holds a whole revolution."""
        return len(self._rows) == self.samples + 1

    def clear(self) -> None:
        """Empty the buffer."""
        self._rows.clear()
        self._sums, self._pushed = [0.0, 0.0], 0

    def push(self, force: float, wanted: float, wanted_rate: float) -> None:
        """Add force, F_d and F_d' of a step."""
        rows = self._rows
        if len(rows) == self.samples + 1:
            gone, after = rows[0], rows[1]
            self._sums[0] -= (gone[0] + after[0]) / 2
            self._sums[1] -= (gone[1] + after[1]) / 2
        if rows:
            self._sums[0] += (rows[-1][0] + force) / 2
            self._sums[1] += (rows[-1][1] + wanted) / 2
        rows.append((force, wanted, wanted_rate))
        self._pushed += 1
        if self._pushed > self.samples:  # sums anew, so that rounding does not accumulate
            self._pushed = 0
            self._sums = [0.0, 0.0]
            for one, other in pairwise(rows):
                self._sums[0] += (one[0] + other[0]) / 2
                self._sums[1] += (one[1] + other[1]) / 2

    def want(self, value: float) -> None:
        """Set F_d of the whole revolution to a value, at rest."""
        self._rows = deque(((force, value, 0.0) for force, _, _ in self._rows), maxlen=self.samples + 1)
        self._sums[1] = value * (len(self._rows) - 1)

    @property
    def force(self) -> float:
        """Mean force."""
        return self._sums[0] / self.samples

    @property
    def force_rate(self) -> float:
        """Rate of the mean force, 1/s."""
        return self._rate(0)

    @property
    def wanted(self) -> tuple[float, float, float]:
        """F_d'', F_d', F_d, each as its mean."""
        return self._rate(2), self._rate(1), self._sums[1] / self.samples

    def _rate(self, column: int) -> float:
        return (self._rows[-1][column] - self._rows[0][column]) / (self.samples * self.step_time)


BAND = 0.02  # of the set point: settling band
STEADY = 0.25  # the last share of a segment


@dataclass(frozen=True, slots=True)
class RegulationMetrics:
    """Regulation metrics of a segment of a run at one set point.

    Attributes
    ----------
    settling : float or None
        s until the averaged force stays within 2 % of the set point; None where it does not.
    overshoot, undershoot : float
        Largest excursion above and below the set point, as shares of it; of the averaged force.
    steady : float
        Largest error of the last quarter of the segment, as a share.
    iae : float
        Mean of the absolute error, as a share.
    """

    settling: float | None
    overshoot: float
    undershoot: float
    steady: float
    iae: float


def averaged(values: Array, samples: int) -> Array:
    """Mean of the last ``samples`` intervals of a row (n,), of fewer at its beginning.

    >>> averaged(np.array([0.0, 2.0, 4.0, 6.0]), 2).tolist()
    [0.0, 1.0, 2.0, 4.0]
    """
    total = np.r_[0.0, np.cumsum((values[1:] + values[:-1]) / 2)]
    start = np.maximum(np.arange(len(values)) - samples, 0)
    count = np.arange(len(values)) - start
    return np.where(count > 0, (total - total[start]) / np.maximum(count, 1), values)


def regulation_metrics(
    trace: "Trace", set_point: float, revolution: float, start: float = 0.0, end: float = np.inf
) -> RegulationMetrics:
    """Regulation metrics of a segment of a replay that recorded ``force``, that of the plant without ripple.

    Parameters
    ----------
    set_point : float
    revolution : float
        s that the force is averaged over.
    start, end : float
        s.
    """
    dt = float(trace.time[1] - trace.time[0])
    inside = (trace.time >= start - dt / 2) & (trace.time < end - dt / 2)
    share = averaged(trace.recorded["force"], round(revolution / dt))[inside] / set_point - 1
    out = np.flatnonzero(np.abs(share) > BAND)
    last = int(out[-1]) + 1 if len(out) else 0
    return RegulationMetrics(
        settling=last * dt if last < len(share) else None,
        overshoot=max(float(share.max()), 0.0),
        undershoot=max(-float(share.min()), 0.0),
        steady=float(np.abs(share[-round(STEADY * len(share)) :]).max()),
        iae=float(np.abs(share).mean()),
    )
