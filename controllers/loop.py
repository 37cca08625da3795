"""Simulation loop for every controller: the plant answers the last command, the controller answers the plant.

A `FaultyPlant` has a sensor, a sign or a stiffness that fails at a time; see `FAULTS`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

import numpy as np

from ..core.arrays import Array
from ..core.display import Displayable, Plottable
from ..core.errors import UsageError

if TYPE_CHECKING:
    from pandas import DataFrame


LONGEST = 100_000_000  # samples of a replay

Reading = Callable[[float, float], float]  # (true reading, last reported reading) -> reported reading

C = TypeVar("C", float, tuple[float, ...])
Answers = TypeVar("Answers", bound=float | tuple[float, ...], covariant=True)
Takes = TypeVar("Takes", bound=float | tuple[float, ...], contravariant=True)


@dataclass(frozen=True, slots=True, repr=False)
class Event(Displayable):
    """An event of a replay: ``cut``, ``air``, ``at low``, ``load unknown`` ... at ``time`` s."""

    time: float
    what: str


class Controller(Protocol[Answers]):
    """A machine's controller: one measurement in, one command out (a number, or several), ``dt`` s apart.

    Optional attributes: ``reference``, the set point; ``news``, what changed in the last step; ``command``, in force
    before the first; ``labels``, names of command and measurement with their units.
    """

    def step(self, measurement: float, dt: float) -> Answers:
        """Command for a measurement."""


class Plant(Protocol[Takes]):
    """A controlled process."""

    def step(self, command: Takes, dt: float, noise: np.random.Generator) -> float:
        """Measurement after ``dt`` s under a command."""


@dataclass(frozen=True, slots=True, repr=False)
class Trace(Plottable):
    """Record of a replay: a simulation.

    Attributes
    ----------
    time : ndarray, shape (n,)
        s; the first sample is at 0.
    command : ndarray, shape (n,) or (n, m)
        Command of the controller at each sample.
    measurement, reference : ndarray, shape (n,)
        Input and set point of the controller; NaN without a reference.
    events : tuple of Event
    recorded : dict of ndarray, shape (n,)
        Further recorded quantities, by name.
    labels : tuple of str
        Names of command and measurement, with their units.
    """

    time: Array
    command: Array
    measurement: Array
    reference: Array
    events: tuple[Event, ...]
    recorded: dict[str, Array] = field(default_factory=dict)
    labels: tuple[str, str] = ("command", "measurement")

    def first(self, what: str) -> float | None:
        """Time of the first event of this name, s; None where there was none."""
        return next((event.time for event in self.events if event.what == what), None)

    def to_frame(self) -> "DataFrame":
        """One row per sample, time in s; several commands as ``command 1``, ``command 2``; recorded values by name."""
        from pandas import DataFrame, Index

        commands = self.command.reshape(len(self.time), -1)
        several = commands.shape[1] > 1
        columns = {f"command {k + 1}" if several else "command": column for k, column in enumerate(commands.T)}
        columns |= {"measurement": self.measurement, "reference": self.reference, **self.recorded}
        return DataFrame(columns, index=Index(self.time, name="time"))


def replay(
    controller: Controller[C],
    plant: Plant[C],
    *,
    duration: float,
    dt: float,
    seed: int = 1,
    command: C | None = None,
    record: Sequence[str] = (),
    until: str | None = None,
) -> Trace:
    """Run a controller on a plant.

    Parameters
    ----------
    controller, plant
        Both keep their state: make new ones for a second run.
    duration, dt : float
        s.
    seed : int
        Of the plant's noise: the same seed gives the same trace.
    command : float or tuple of float, optional
        In force before the first sample; by default the controller's own ``command``, or 0.
    record : sequence of str
        Attributes of the controller, or else of the plant, to record at every sample: ``"wear"``.
    until : str, optional
        Stop after the sample with an event of this name.

    Returns
    -------
    Trace
        At most ``round(duration / dt)`` samples.

    Raises
    ------
    UsageError
        A duration or step that is not above zero, too many samples, or an unknown quantity to record.

    Examples
    --------
    >>> class Half:
    ...     def step(self, measurement, dt):
    ...         return 1.0 - measurement / 2
    >>> class Same:
    ...     def step(self, command, dt, noise):
    ...         return command
    >>> replay(Half(), Same(), duration=0.3, dt=0.1).command.tolist()
    [1.0, 0.5, 0.75]
    """
    samples = _samples(duration, dt)
    noise = np.random.default_rng(seed)
    now: Any = getattr(controller, "command", 0.0) if command is None else command
    readers = [_reader(name, controller, plant) for name in record]
    rows: list[list[float]] = [[] for _ in record]
    commands: list[Any] = []
    measurements, references = [], []
    events: list[Event] = []
    for k in range(samples):
        measurement = plant.step(now, dt, noise)
        now = controller.step(measurement, dt)
        commands.append(now)
        measurements.append(measurement)
        references.append(getattr(controller, "reference", np.nan))
        for row, (of, get) in zip(rows, readers, strict=True):
            row.append(get(of))
        if news := getattr(controller, "news", ()):
            events += [Event(k * dt, what) for what in news]
            if until in news:
                break
    return Trace(
        time=np.arange(len(commands), dtype=np.float64) * dt,
        command=_array(commands),
        measurement=_array(measurements),
        reference=_array(references),
        events=tuple(events),
        recorded={name: _array(row) for name, row in zip(record, rows, strict=True)},
        labels=getattr(controller, "labels", ("command", "measurement")),
    )


def _array(values: list[Any]) -> Array:
    return np.array(values, dtype=np.float64)


def _reader(name: str, controller: object, plant: object) -> tuple[object, Any]:
    for of in (controller, plant):
        if hasattr(of, name):
            return of, attrgetter(name)
    raise UsageError(f"record {name!r}: neither {type(controller).__name__} nor {type(plant).__name__} has it.")


def _samples(duration: float, dt: float) -> int:
    if not (dt > 0 and duration > 0 and duration / dt < LONGEST):
        raise UsageError(
            f"a replay of {duration!r} s in steps of {dt!r} s: give both above zero, with fewer than {LONGEST} steps."
        )
    return max(round(duration / dt), 1)


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
