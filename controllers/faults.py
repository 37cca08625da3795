"""What goes wrong in a loop: a plant whose sensor, sign or stiffness fails at a time.

Wrapped round a plant, each shows what a controller does then; see `FAULTS`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic

import numpy as np

from ..core.display import Displayable
from .loop import C, Plant

Reading = Callable[[float, float], float]  # the true reading, the last one that was told -> what the sensor tells


@dataclass(slots=True, repr=False)
class Faulty(Displayable, Generic[C]):
    """A plant with a fault from ``start`` to ``end``.

    Attributes
    ----------
    plant : Plant
    fault : callable
        The true reading and the last that was told -> what is told instead.
    start, end : float
        s; without an end it stays.

    Examples
    --------
    >>> class Same:
    ...     def step(self, command, dt, noise):
    ...         return command
    >>> plant = Faulty(Same(), FAULTS["stuck"], start=0.1)
    >>> noise = np.random.default_rng(1)
    >>> [plant.step(command, 0.1, noise) for command in (1.0, 2.0, 3.0)]
    [1.0, 1.0, 1.0]
    """

    plant: Plant[C]
    fault: Reading
    start: float = 0.0
    end: float = float("inf")
    _time: float = field(default=0.0, init=False)
    _told: float = field(default=0.0, init=False)

    def step(self, command: C, dt: float, noise: np.random.Generator) -> float:
        """Answer a command with what the sensor makes of it."""
        reading = self.plant.step(command, dt, noise)
        if self.start <= self._time < self.end:
            reading = self.fault(reading, self._told)
        self._time, self._told = self._time + dt, reading
        return reading


def saturated(at: float) -> Reading:
    """A sensor that tells no more than ``at``."""
    return lambda reading, told: min(reading, at)


def stiffer(times: float = 10.0) -> Reading:
    """A cut that answers so many times as strongly."""
    return lambda reading, told: times * reading


FAULTS: dict[str, Reading] = {
    "dropout": lambda reading, told: 0.0,
    "not a number": lambda reading, told: float("nan"),
    "infinite": lambda reading, told: float("inf"),
    "stuck": lambda reading, told: told,
    "wrong sign": lambda reading, told: -reading,
    "ten times stiffer": stiffer(),
}
