"""Values of single nodes, each with its time and quality, as samples."""

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from time import time as wall_time
from typing import Final

from ..samples import Notice, Sample
from .channels import Channels, Value
from .clock import Clock

TOGETHER: Final = 0.01  # s: values of several loads that are so close belong to one sample
WAIT: Final = 0.15  # s for the other loads of a sample
SET: Final = 1.0  # s: times further apart than this are not brought in order


@dataclass(frozen=True, slots=True)
class Reading:
    """Value of one node.

    Attributes
    ----------
    place : int
        Of the node in ``Channels.channels``.
    time : float
        s since 1970 by the clock of the source.
    value : float, str or None
        None where the quality is bad.
    bad : str
        Name of the status; empty where it is good.
    arrival : float
        s, as `arrival_time`.
    first : bool
        Whether it is the value that was there when we connected.
    """

    place: int
    time: float
    value: Value
    bad: str
    arrival: float
    first: bool = False


@dataclass(frozen=True, slots=True)
class Held:
    """The value of a node: time (s since 1970, None without one), value, and status where it is bad."""

    time: float | None
    value: Value
    bad: str


class Merger:
    """Samples from the readings of single nodes.

    Readings of loads less than 10 ms apart are one sample. Conditions and states keep their value until another one
    comes; a load whose quality is bad is absent from every sample until it is good. Nodes give a value only where it
    changed: `confirm` repeats loads that the server was asked for and that are still the same.
    """

    def __init__(self, channels: Channels) -> None:
        self._channels = channels
        self._loads = [k for k, c in enumerate(channels.channels) if c.kind == "load"]
        self._words = {k for k, c in enumerate(channels.channels) if c.kind in ("state", "tool")}
        self._held: list[Value] = [None] * len(channels.channels)
        self._bad: dict[int, str] = {}
        self._pending: list[Reading] = []
        self._clock = Clock()
        self._last: tuple[float, float] | None = None  # time and arrival of the last sample

    @property
    def waiting(self) -> bool:
        """Whether a reading waits for the other loads of its sample."""
        return bool(self._pending)

    def add(self, reading: Reading) -> list[Sample | Notice]:
        """Take a reading in; gives samples where the clock of the source was set before it."""
        out: list[Sample | Notice] = []
        if self._pending and abs(reading.time - self._pending[-1].time) > SET:
            out = self.take(float("inf"))
        self._pending.append(reading)
        return out

    def take(self, now: float) -> list[Sample | Notice]:
        """Samples that are complete, or have waited for 0.15 s, in the order of their times."""
        out: list[Sample | Notice] = []
        self._pending.sort(key=attrgetter("time"))
        while self._pending:
            group = self._group()
            if not self._expected(group) and now - max(reading.arrival for reading in group) < WAIT:
                break
            del self._pending[: len(group)]
            out += self._sample(group)
        return out

    def confirm(self, held: Sequence[Held], server: float, arrival: float) -> list[Sample | Notice]:
        """A sample of loads that did not change, after the server was asked for them.

        A node gives no notification where only its time changes.

        Parameters
        ----------
        held : sequence of Held
            What the server holds for each place.
        server : float
            Time of the server, s.
        arrival : float
            s, as `arrival_time`.
        """
        same = all(self._held[k] == (held[k].bad or held[k].value) for k in self._loads)
        if not same or self._pending or (self._last and arrival - self._last[1] < SET / 2):
            return []  # readings are on their way
        newest = max((held[k].time or 0.0 for k in self._loads), default=0.0)
        if self._last is None:
            time = server
        elif newest > self._last[0]:
            time = newest
        else:
            time = self._last[0] + arrival - self._last[1]
        return self._given(time, arrival, self._loads)

    def reconnected(self) -> None:
        """Forget what waits; values are held."""
        self._pending.clear()

    def _quality(self, reading: Reading) -> list[Sample | Notice]:
        """A notice where the quality of a node changes."""
        symbol, before = self._channels.channels[reading.place].symbol, self._bad.get(reading.place, "")
        if reading.bad == before:
            return []
        if reading.bad:
            self._bad[reading.place] = reading.bad
            return [Notice(wall_time(), "bad", f"{symbol}: {reading.bad}; not used until it is good")]
        del self._bad[reading.place]
        return [Notice(wall_time(), "connected", f"{symbol} is good again")]

    def _group(self) -> list[Reading]:
        """The first readings that belong together: conditions before a load, then each load once."""
        group: list[Reading] = []
        start: float | None = None
        places: set[int] = set()
        for reading in self._pending:
            load = reading.place in self._loads
            if start is not None and (reading.time - start > TOGETHER or (load and reading.place in places)):
                break
            if load and start is None:
                start = reading.time
            places.add(reading.place)
            group.append(reading)
        return group

    def _expected(self, group: Sequence[Reading]) -> bool:
        """Whether every load that is good is in a group."""
        places = {reading.place for reading in group}
        return all(k in places or k in self._bad for k in self._loads)

    def _sample(self, group: Sequence[Reading]) -> list[Sample | Notice]:
        loads: list[Reading] = []
        notices: list[Sample | Notice] = []
        for reading in group:
            notices += self._quality(reading)
            self._held[reading.place] = reading.bad or reading.value
            if reading.place in self._loads and not reading.first:
                loads.append(reading)
        if not loads:
            return notices
        return notices + self._given(loads[0].time, loads[-1].arrival, [reading.place for reading in loads])

    def _given(self, time: float, arrival: float, places: Sequence[int]) -> list[Sample | Notice]:
        """A sample of some loads and all that is held."""
        use, notice = self._clock.take(time, arrival)
        out: list[Sample | Notice] = [notice] if notice else []
        if use:
            self._last = time, arrival
            absent = set(self._loads) - set(places) - set(self._bad)
            values = [
                None if k in absent or (k in self._bad and k in self._words) else value
                for k, value in enumerate(self._held)
            ]
            out.append(self._channels.sample(time, values))
        return out
