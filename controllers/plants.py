"""General plants: a cut under a feed override, and any plant with a fault of sensor, sign or stiffness (`FAULTS`)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Generic

import numpy as np

from ..core.display import Displayable
from ..core.errors import UsageError
from .loop import C, Plant


@dataclass(slots=True, repr=False)
class Cut(Displayable):
    """A cut under a feed override: the identified drive, a constant offset, and the load of wear.

        load(k) = offset + b(q)/a(q) command + wear(t) in the cut,    idle outside it

    Attributes
    ----------
    b, a : sequence of float
        Polynomials in z^-1, load per unit of override; b begins with at least one zero (nk of 1 or more).
    offset, idle : float
        Load at no feed in the cut, and outside it.
    wear : callable
        Time in s -> additional load.
    cutting : callable
        Time in s -> whether the tool is in the cut.
    noise : float
        Standard deviation of the sensor.

    Examples
    --------
    >>> cut = Cut(b=[0.0, 0.1], a=[1.0, -0.5], offset=0.1)
    >>> noise = np.random.default_rng(1)
    >>> [round(cut.step(1.0, 0.02, noise), 3) for _ in range(3)]
    [0.2, 0.25, 0.275]
    """

    b: Sequence[float]
    a: Sequence[float]
    offset: float = 0.0
    idle: float = 0.0
    wear: Callable[[float], float] = field(default=lambda t: 0.0)
    cutting: Callable[[float], bool] = field(default=lambda t: True)
    noise: float = 0.0
    _b: list[float] = field(default_factory=list, init=False)
    _a: list[float] = field(default_factory=list, init=False)
    _state: list[float] = field(default_factory=list, init=False)
    _samples: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        if not len(self.b) or self.b[0] != 0 or self.a[0] != 1:
            raise UsageError(
                f"b {list(self.b)}, a {list(self.a)} of a plant: b must begin with 0, a delay of one "
                "sample, and a with 1."
            )
        size = max(len(self.b) - 1, len(self.a))
        self._b = [*self.b[1:], *[0.0] * (size + 1 - len(self.b))]  # the replay adds the sample of delay
        self._a = [*self.a, *[0.0] * (size - len(self.a))]
        self._state = [0.0] * size

    def step(self, command: float, dt: float, noise: np.random.Generator) -> float:
        """Load at the sample, for the command in force before it."""
        t = self._samples * dt
        self._samples += 1
        s, b, a = self._state, self._b, self._a
        drive = b[0] * command + s[0]
        for i in range(1, len(b)):  # transposed direct form II
            s[i - 1] = b[i] * command - a[i] * drive + s[i]
        load = self.offset + drive + self.wear(t) if self.cutting(t) else self.idle
        return load + self.noise * noise.standard_normal() if self.noise else load


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
