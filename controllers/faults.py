"""Faults for simulated plants: a sensor, a sign or a stiffness that fails at a time; see `FAULTS`."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic

import numpy as np

from ..core.display import Displayable
from .loop import C, Plant

Reading = Callable[[float, float], float]  # (true reading, last reported reading) -> reported reading


@dataclass(slots=True, repr=False)
class FaultyPlant(Displayable, Generic[C]):
    """A plant with a fault from ``start`` to ``end``.

    Attributes
    ----------
    plant : Plant
    fault : callable
        (true reading, last reported reading) -> reported reading.
    start, end : float
        s; permanent without an end.

    Examples
    --------
    >>> class Same:
    ...     def step(self, command, dt, noise):
    ...         return command
    >>> plant = FaultyPlant(Same(), FAULTS["stuck"], start=0.1)
    >>> noise = np.random.default_rng(1)
    >>> [plant.step(command, 0.1, noise) for command in (1.0, 2.0, 3.0)]
    [1.0, 1.0, 1.0]
    """

    plant: Plant[C]
    fault: Reading
    start: float = 0.0
    end: float = float("inf")
    _time: float = field(default=0.0, init=False)
    _reported: float = field(default=0.0, init=False)

    def step(self, command: C, dt: float, noise: np.random.Generator) -> float:
        """Reported reading after ``dt`` s under a command."""
        reading = self.plant.step(command, dt, noise)
        if self.start <= self._time < self.end:
            reading = self.fault(reading, self._reported)
        self._time, self._reported = self._time + dt, reading
        return reading


def saturated(at: float) -> Reading:
    """Fault of a sensor that saturates ``at`` a value."""
    return lambda reading, last: min(reading, at)


def stiffer(times: float = 10.0) -> Reading:
    """Fault of a cut that becomes stiffer by a factor."""
    return lambda reading, last: times * reading


FAULTS: dict[str, Reading] = {
    "dropout": lambda reading, last: 0.0,
    "not a number": lambda reading, last: float("nan"),
    "infinite": lambda reading, last: float("inf"),
    "stuck": lambda reading, last: last,
    "wrong sign": lambda reading, last: -reading,
    "ten times stiffer": stiffer(),
}
