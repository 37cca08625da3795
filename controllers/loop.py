"""One loop for every controller: the plant answers the last command, the controller answers the plant."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..datasets.errors import UsageError

Array = NDArray[np.float64]
LONGEST = 100_000_000  # samples of a replay


@dataclass(frozen=True, slots=True)
class Event:
    """What happened, and when: ``cut``, ``air``, ``at low``, ``load unknown`` ... at ``time`` s."""

    time: float
    what: str


class Controller(Protocol):
    """A machine's controller: one measurement in, one command out, ``dt`` s apart."""

    def step(self, measurement: float, dt: float) -> float:
        """Answer a measurement with a command."""


class Plant(Protocol):
    """What is controlled."""

    def step(self, command: float, dt: float, noise: np.random.Generator) -> float:
        """Answer the command in force during the last ``dt`` s with a measurement."""


@dataclass(frozen=True, slots=True)
class Trace:
    """What a replay recorded.

    Attributes
    ----------
    time : ndarray, shape (n,)
        s; the first sample is at 0.
    command, measurement : ndarray, shape (n,)
        What the controller answered, and to what.
    reference : ndarray, shape (n,)
        What it aimed at; NaN for a controller without a reference.
    events : tuple of Event
    """

    time: Array
    command: Array
    measurement: Array
    reference: Array
    events: tuple[Event, ...]


def replay(
    controller: Controller, plant: Plant, *, duration: float, dt: float, seed: int = 1, command: float = 0.0
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
    command : float
        In force before the first sample.

    Returns
    -------
    Trace
        ``round(duration / dt)`` samples.

    Raises
    ------
    UsageError
        A duration or step that is not above zero, or too many samples.

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
    commands, measurements, references = (np.empty(samples, dtype=np.float64) for _ in range(3))
    events: list[Event] = []
    for k in range(samples):
        measurement = plant.step(command, dt, noise)
        command = controller.step(measurement, dt)
        commands[k], measurements[k] = command, measurement
        references[k] = getattr(controller, "reference", np.nan)
        if news := getattr(controller, "news", ()):
            events += [Event(k * dt, what) for what in news]
    return Trace(np.arange(samples, dtype=np.float64) * dt, commands, measurements, references, tuple(events))


def _samples(duration: float, dt: float) -> int:
    if not (dt > 0 and duration > 0 and duration / dt < LONGEST):
        raise UsageError(
            f"a replay of {duration!r} s in steps of {dt!r} s: both lie above zero, with fewer than {LONGEST} steps."
        )
    return max(round(duration / dt), 1)
