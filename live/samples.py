"""Readings of a running machine, notices of their source, steady parts of cuts found in them, loads that are lost."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import median
from typing import Any, Literal, Protocol

State = Literal["unknown", "off", "idle", "feed"]
Kind = Literal["connected", "lost", "gap", "bad", "clock", "replaced", "idle", "end", "refused", "load"]

BELOW_FOR = 5.0  # s of feed with a load below idle, after which it is lost
FED_FOR = 20.0  # s of feed without contact, at least, after which the loads are lost
FED_TIMES = 3.0  # times the longest feed without contact so far
FED_CUTS = 3  # cuts that were seen before, at least

LOW = (
    "{0} reads {1:.4g} while the machine feeds, and idle was {2:.4g}: the load is lost. Feed counts as cutting without "
    "it. Check its sensor and channel, and gauge the edge."
)
AIR = (
    "no contact was seen in {:.3g} min of feed, which was {:.3g} min at most so far ({}): the load is lost or the edge "
    "broke. This feed and what follows count as cutting until contact is seen. Look at the edge, and gauge it."
)
FELL = (
    "{0} fell from the cut to {1:.4g} at once, below idle ({2:.4g}), and the machine does not say whether it feeds: "
    "the load is lost, and what is cut from here on may not be counted. Check its sensor and channel, map the state of "
    "the machine, and gauge the edge."
)
CUT_UNREAD = (
    "no load was read for {:g} s in mid-cut: unless the machine says that it feeds, what is cut is not counted until a "
    "load is read again, and then up to the longest cut so far. Check sensor and channel, and gauge the edge."
)
FED_UNREAD = (
    "no load was read for {:g} s of feed: all feed counts as cutting until one is. Check sensor and channel, and gauge "
    "the edge."
)


@dataclass(frozen=True, slots=True)
class Sample:
    """One reading of a machine.

    Attributes
    ----------
    time : float
        s since 1970 (UTC) by the clock of the source, or s since the start of a recorded run.
    loads : mapping
        Readings of loads by their symbol in the parameter file (``P``, ``Fc``, ``I``), in the units of its laws. A load
        that was not read, or whose quality is bad, is absent.
    conditions : mapping
        ``V`` in m/min, ``f`` in mm/rev, ``d`` in mm and others, as far as the source has them: one that is absent is
        as it was before, and one that is NaN could not be read.
    state : str
        Of the machine as it says itself: ``"off"`` (spindle stopped), ``"idle"`` (no feed motion), ``"feed"``.
    tool : str
        As the source names it; empty where it does not.
    bad : str
        What is wrong with the reading, empty where nothing is.

    Examples
    --------
    >>> Sample(12.5, {"P": 1.8}, {"V": 120.0, "f": 0.2, "d": 2.0}).state
    'unknown'
    """

    time: float
    loads: Mapping[str, float]
    conditions: Mapping[str, float] = field(default_factory=dict)
    state: State = "unknown"
    tool: str = ""
    bad: str = ""


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that happened to a source, or ``"idle"``: nothing was read for a moment.

    Attributes
    ----------
    time : float
        s by the clock of this program.
    kind : str
        ``"connected"``, ``"lost"``, ``"gap"`` (samples are missing), ``"bad"`` (quality), ``"clock"`` (times jumped),
        ``"replaced"`` (another file under the same name), ``"idle"``, ``"refused"`` (what cannot be used), ``"load"``
        (a load is lost while the machine cuts) or ``"end"``.
    text : str
        What happened, in one sentence with its values.
    """

    time: float
    kind: Kind
    text: str = ""


@dataclass(frozen=True, slots=True)
class LoadMean:
    """Mean of a load over a window, idle load subtracted where the law is one of cutting alone.

    Attributes
    ----------
    ln : float
        Of the mean load.
    se : float
        Its standard error, with the errors of the idle load and of serial correlation.
    samples : int
    """

    ln: float
    se: float
    samples: int


@dataclass(frozen=True, slots=True)
class Window:
    """A steady part of a cut.

    Attributes
    ----------
    start, end : float
        s, by the clock of the source.
    contact : float
        Minutes of cutting since the window before it ended (or the cut began), with parts that were not steady.
    conditions : mapping
        Means of V, f, d and others over the steady part, and over parts before it that were in no window.
    loads : mapping
        `LoadMean` by symbol.
    cut : int
        Number of the cut.
    """

    start: float
    end: float
    contact: float
    conditions: Mapping[str, float]
    loads: Mapping[str, LoadMean]
    cut: int = 0


@dataclass(frozen=True, slots=True)
class CutEnd:
    """End of a cut.

    Attributes
    ----------
    time : float
        s, by the clock of the source.
    contact : float
        Minutes of cutting since the last window.
    cut : int
        Number of the cut.
    lost : bool
        Whether it ended because the signal was lost: the cut may have gone on.
    unseen : bool
        Whether it began before the source was read.
    """

    time: float
    contact: float
    cut: int = 0
    lost: bool = False
    unseen: bool = False


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive samples.

    Attributes
    ----------
    start, end : float
        s by the clock of the source.
    values : mapping of str to sequence of float
        Every reading by load.
    loads, conditions : mapping of str to float
        Means.
    phase : State
        What the machine says of itself, or what speed and feed of zero say: ``"off"``, ``"idle"``, ``"feed"``,
        ``"unknown"``.
    """

    start: float
    end: float
    values: Mapping[str, Sequence[float]]
    loads: Mapping[str, float]
    conditions: Mapping[str, float]
    phase: State

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return self.end - self.start


class Seen(Protocol):
    """Loads of a stream as its windows have shown them."""

    number: int
    proved: bool

    @property
    def idle(self) -> Mapping[str, Any]:
        """Idle level of each load, with ``level`` and ``known``."""

    @property
    def reach(self) -> Mapping[str, Sequence[float]]:
        """Levels above idle in the last windows, by load."""


class LostLoads:
    """Loads that are lost: they read air or less where the machine cuts, so neither contact nor air follows from them.

    Parameters
    ----------
    windows : Seen
        Of the same stream, with the idle levels.
    threshold : callable
        Distance of a load from idle at which a cut begins.

    Attributes
    ----------
    floors : dict of str to float
        By load that is lost: the level from which it counts as read again.
    unread : set of str
        Loads of the last block that are not used.
    """

    def __init__(self, windows: Seen, threshold: Callable[[str], float]) -> None:
        self.floors: dict[str, float] = {}
        self.unread: set[str] = set()
        self._windows, self._threshold = windows, threshold
        self._below: dict[str, float] = {}  # s of feed
        self._fed, self._longest = 0.0, 0.0  # s of feed without contact: since the last cut, and at most before

    def as_json(self) -> dict[str, Any]:
        """State that `resume` takes over."""
        return {"floors": dict(self.floors), "longest": self._longest}

    def resume(self, data: Mapping[str, Any]) -> None:
        """Take over what `as_json` gave."""
        self.floors, self._longest = dict(data.get("floors", {})), float(data.get("longest", 0.0))

    def judge(self, block: Block, *, contact: bool) -> tuple[Block, list[Window | CutEnd | Notice]]:
        """The block without lost loads, and what was found lost with it.

        Parameters
        ----------
        block : Block
        contact : bool
            Whether a load shows a cut.
        """
        for name in [name for name, floor in self.floors.items() if block.loads.get(name, floor) > floor]:
            del self.floors[name]
        low: set[str] = set()
        found: list[Window | CutEnd | Notice] = []
        if block.phase == "feed" and self._windows.proved:
            low = {name for name in block.loads if self._is_below(name, block.loads[name])}
            found += [*self._feed_below(block, low - self.floors.keys()), *self._feed_in_air(block, contact=contact)]
        elif block.phase != "feed":
            self._below.clear()
        self.unread = {name for name in block.loads if name in low or name in self.floors}
        if not self.unread:
            return block, found
        loads = {name: level for name, level in block.loads.items() if name not in self.unread}
        values = {name: read for name, read in block.values.items() if name not in self.unread}
        return replace(block, loads=loads, values=values), found

    def fallen(self, name: str, blocks: Sequence[Block]) -> list[Notice]:
        """A cut ended with these blocks, in which the load went below idle at once and the machine says nothing."""
        levels = [b.loads[name] for b in blocks if name in b.loads]
        said = any(b.phase != "unknown" for b in blocks)
        if said or not self._windows.proved or not all(self._is_below(name, level) for level in levels):
            return []
        return [self._lose(name, blocks[-1].end, FELL, median(levels))]

    def _lose(self, name: str, time: float, text: str, level: float) -> Notice:
        """Take a load for lost until it is back at idle."""
        idle = self._windows.idle[name].level
        self.floors[name] = idle - self._threshold(name)
        self.unread.add(name)
        return Notice(time, "load", text.format(name, level, idle))

    def _is_below(self, name: str, level: float) -> bool:
        """Whether a load that showed cuts is below its idle level by as much as the beginning of a cut is above."""
        idle = self._windows.idle.get(name)
        known = idle is not None and idle.known and bool(self._windows.reach.get(name))
        return known and level < self._windows.idle[name].level - self._threshold(name)

    def _feed_below(self, block: Block, low: set[str]) -> list[Notice]:
        self._below = {name: self._below.get(name, 0.0) + block.seconds for name in low}
        lost = [name for name in sorted(low) if self._below[name] > BELOW_FOR]
        return [self._lose(name, block.end, LOW, block.loads[name]) for name in lost]

    def _feed_in_air(self, block: Block, *, contact: bool) -> list[Window | CutEnd | Notice]:
        """Feed without contact for much longer than before: it counts, and loads are lost until they show contact."""
        read = block.loads.keys() & self._windows.reach.keys()
        if contact:
            self._longest, self._fed = max(self._longest, self._fed), 0.0
        elif read and not read & (self.floors.keys() | self._below.keys()):
            self._fed += block.seconds
        if self._windows.number < FED_CUTS or self._fed <= max(FED_FOR, FED_TIMES * self._longest):
            return []
        minutes, self._fed = self._fed / 60, 0.0
        for name in read:
            self.floors[name] = self._windows.idle[name].level + self._threshold(name)
        levels = ", ".join(f"{name} {block.loads[name]:.4g}" for name in sorted(read))
        number, start = self._windows.number, block.end - 60 * minutes
        return [
            Window(start, block.end, minutes, dict(block.conditions), {}, number),
            CutEnd(block.end, 0.0, number, unseen=True),
            Notice(block.end, "load", AIR.format(minutes, self._longest / 60, levels)),
        ]
