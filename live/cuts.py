"""Cuts of a running machine: where a load leaves its idle level, by hysteresis, and the steady windows within them.

As `datasets.signals.cuts` finds them in a whole record, with its thresholds, from samples as they come. What the
machine says of itself (off, idle) is taken as certain, a feed motion only as possible cutting: the load shows contact.
Where it says nothing, the first level is taken as idle until the load has returned to it or is less quiet in the cut;
before that, cutting time counts and loads do not. A load that stands near zero may be that of a stopped spindle.
"""

from collections import deque
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, replace
from math import inf, sqrt
from statistics import median, stdev
from typing import Any, Literal

from ..datasets.signals.cuts import FOLLOWING, LEFT, MERGED, NOISE, OFF, STARTING
from ..datasets.signals.options import DRIVEN, ReduceOptions
from .blocks import BLOCK, BRIDGED, FIRST_CUT, SPEEDS, Air, Blocks, EarlyFeed, Gap, IdleLevel, speed_ratio
from .samples import Block, CutEnd, LostLoads, Notice, Sample, Window
from .windows import AGAINST, FALLEN, INTERRUPTED, QUIETER, RESTING, STUCK, SeenLoads, Windows

SMOOTHED = 0.5  # s; shorter peaks are neither cut nor idle
SHORTEST, THRESHOLD = ReduceOptions().shortest, ReduceOptions().threshold
COARSE = 0.002  # of the idle level, below which no load is seen
ENDING = ("lost", "clock", "replaced", "end")  # notices after which a cut cannot be followed
CONTRADICTED = 5.0  # s of a load above idle while the machine says that it does not cut
OFTEN = 6  # excursions too short for a cut, within twelve seconds
ZERO = 0.02  # share of a load below which its idle level may be that of a spindle that stands
RUN_UP = 1.0  # s after a spindle stood in which no load is idle
SILENT = 1.0  # s without a reading in a cut, after which the signal is lost

Found = Window | CutEnd | Notice
Phase = Literal["starting", "off", "idle", "entry", "cutting"]


class Cuts:
    """Windows and ends of cuts in a stream of samples.

    Parameters
    ----------
    constants : mapping of str to float, optional
        Conditions that the source does not give (``d`` in mm, ``D`` in mm, ``n`` in 1/min).
    whole : collection of str
        Loads whose law is one of the whole load: the idle level is not subtracted.
    rest : {"off", "idle"}, optional
        What a load of a drive near zero is, where the machine does not say so; None: it is not known.
    seconds : float
        Length of a window.

    Examples
    --------
    >>> from math import exp
    >>> from fitmodels.live.samples import Sample
    >>> cuts, found = Cuts(seconds=5.0), []
    >>> for k in range(1500):
    ...     load, state = (1.8, "feed") if 250 <= k < 1250 else (0.8, "idle")
    ...     found += cuts.add(Sample(k / 50, {"P": load + 0.01 * (-1) ** (k // 5)}, {"V": 120, "f": 0.2}, state))
    >>> [(round(w.start), round(w.contact, 3), round(exp(w.loads["P"].ln), 2)) for w in found[:2]]
    [(5, 0.082, 1.0), (10, 0.082, 1.0)]
    >>> type(found[-1]).__name__, cuts.state
    ('CutEnd', 'idle')
    """

    def __init__(
        self,
        *,
        constants: Mapping[str, float] | None = None,
        whole: Collection[str] = (),
        rest: Literal["off", "idle"] | None = None,
        seconds: float = 10.0,
    ) -> None:
        self._air = Air()
        self.idle = self._air.idle
        self._blocks, self._windows = Blocks(constants), Windows(self.idle, whole, seconds)
        self.lost = LostLoads(self._windows, self._high)
        self._rest, self._believed, self._mute = rest, True, 0.0  # s without a load
        self._speeds: Mapping[str, float] = {}
        self._short: list[float] = []  # s, beginnings of excursions too short for a cut
        self._reached: dict[str, float] = {}  # level above idle of the last cuts
        self._seen, self._early, self._last = SeenLoads(), EarlyFeed(), 0.0
        self._forget()

    def _forget(self) -> None:
        """Nothing of the moment: no cut, no air."""
        self._ahead: deque[Block] = deque()
        self._air.forget()
        self._span: list[Block] = []  # away from idle, not yet a cut
        self._against: list[Block] = []  # away from idle while the machine says that it does not cut
        self._below: list[Block] = []  # back at idle, not yet the end of the cut
        self._cut = self._stopped = False
        self._started: list[Block] = []  # of a spindle
        self._standing: float | None = None  # level before it
        self._lead, self._sign, self._level = "", 1.0, 0.0

    @property
    def number(self) -> int:
        """Number of the last cut."""
        return self._windows.number

    @property
    def contact(self) -> float:
        """Minutes of the cut that are in no window yet."""
        return self._windows.minutes

    @property
    def conditions(self) -> Mapping[str, float]:
        """Conditions of the last block."""
        return self._ahead[-1].conditions if self._ahead else {}

    @property
    def state(self) -> Phase:
        """State of the machine as the loads show it."""
        if self._cut:
            return "entry" if self._windows.entering else "cutting"
        known = self._air.known and not self._early.seconds
        return "off" if self._stopped else "idle" if known else "starting"

    def add(self, item: Sample | Notice) -> list[Found]:
        """Findings with a sample, or with a notice that the source is lost, jumped in time, changed or ended.

        Gaps and readings that are missing show in the samples: a short gap in a cut counts as cutting.
        """
        if isinstance(item, Notice):
            return list(self.close() if item.kind == "end" else self._lost() if item.kind in ENDING else ())
        found: list[Found] = []
        for block in self._blocks.add(item):
            if not isinstance(block, Gap):
                found += self._smoothed(block)
            elif not 0 < block <= BRIDGED:
                found += self._lost()
        return found

    def as_json(self) -> dict[str, Any]:
        """Idle levels and noise, with which `resume` follows a cut after a restart."""
        idle = {name: asdict(level) for name, level in self.idle.items()}
        own = {"believed": self._believed, "speeds": dict(self._speeds), "lost": self.lost.as_json()}
        return {**own, "idle": idle, "windows": self._windows.as_json()}

    def resume(self, data: Mapping[str, Any]) -> None:
        """Take over idle levels and noise of `as_json`; the variance of the levels grows with the time since."""
        self._believed, self._speeds = bool(data["believed"]), dict(data["speeds"])
        self.idle.clear()
        self.idle.update({name: IdleLevel(**level) for name, level in data["idle"].items()})
        self._windows.resume(data["windows"])
        self.lost.resume(data.get("lost", {}))

    def close(self) -> list[Found]:
        """Findings at the end of a source: a cut that has not ended is lost; the loads, where there was no cut."""
        found = list(self._lost())
        if not self.number:
            for text in self._early.sentences() or self._seen.sentences():
                found += self._windows.once(text, self._last, text)
        return found

    def _lost(self) -> Iterator[Found]:
        for block in self._blocks.close():
            yield from self._smoothed(block)
        if self._cut:
            yield from self._end(lost=True)
        self._forget()

    def _smoothed(self, block: Block) -> Iterator[Found]:
        """Steps with the medians over half a second around each block: short peaks are gone, edges stay."""
        width = 2 * round(SMOOTHED / max(block.seconds, BLOCK) / 2) + 1
        self._ahead.append(block)
        while len(self._ahead) > width:
            self._ahead.popleft()
        if len(self._ahead) < width:
            return
        centre = self._ahead[width // 2]
        loads = {name: median([b.loads[name] for b in self._ahead if name in b.loads]) for name in centre.loads}
        yield from self._step(replace(centre, loads=loads))

    def _step(self, block: Block) -> Iterator[Found]:
        self._last = block.end
        if not self.number:
            self._seen.add(block)
        block, found = self.lost.judge(block, contact=self._cut and self._lead != "")
        yield from found
        self._mute = 0.0 if block.loads else self._mute + block.seconds + SILENT * bool(found)
        if not block.loads and self._unseen(block):
            yield from self._by_state_alone(block)
            return
        if self._cut and not self._lead and block.loads:
            yield from self._end()
        if not self._cut:
            self._at_speed(block)
        if self._believed and block.phase in ("off", "idle"):
            yield from self._stated_stop(block)
        elif self._cut:
            yield from self._in_cut(block)
        elif self._stopped or self._started:
            self._in_start(block)
        else:
            yield from self._in_air(block)

    def _unseen(self, block: Block) -> bool:
        """Whether no load shows what the machine does: none was ever read, or none for a second while it feeds."""
        if not self.idle or (self._cut and not self._lead):
            return True
        return not self._cut and block.phase == "feed" and self._mute > SILENT

    def _by_state_alone(self, block: Block) -> Iterator[Found]:
        """No load is read: the stated feed of the machine decides alone, and all of its time counts."""
        if block.phase == "feed":
            if not self._cut:
                self._cut, self._lead = True, ""
                self._windows.begin("")
            yield from self._windows.add(block)
        elif self._cut:
            yield from self._end()

    def _stated_stop(self, block: Block) -> Iterator[Found]:
        """The machine states that it does not cut; it is believed unless the load contradicts for long."""
        if self._cut:
            yield from self._end()
        self._span, self._started = [], []
        self._stopped = block.phase == "off"
        if self._early.goes_on and not self._windows.proved:  # what was read in it is no idle level
            self.idle.clear()
            self._air.forget()
        self._early.goes_on = False
        name, away = self._furthest(block.loads)
        reach = self._windows.reach.get(name)
        if name and away > max(self._high(name), LEFT * median(reach) if reach else 0.0):
            self._against.append(block)
            if sum(b.seconds for b in self._against) > CONTRADICTED:
                yield from self._contradicted(name)
            return
        self._against = []
        at_rest = {name for name in block.loads if block.phase == "idle" or name not in DRIVEN}
        if at_rest:
            self._air.add(block, at_rest)
        else:
            self._air.begin(block.end + RUN_UP)
            self._air.begun = block.end
        self._windows.proved |= block.phase == "idle" and bool(self._air.known)
        if self._early.seconds and (self._stopped or self._windows.proved):
            early, self._early = self._early, EarlyFeed()
            yield from self._windows.early(early) if early.above(self.idle) else ()

    def _contradicted(self, name: str) -> Iterator[Found]:
        """A load that stays above idle shows contact, whatever the machine says: a column may be dead."""
        span, self._against = self._against, []
        if self._windows.stands_still(name, span):
            yield from self._windows.once(f"stuck {name}", span[-1].end, STUCK.format(name, span[-1].loads[name]))
            return
        self._believed, self._stopped, self._lead, self._sign = False, False, name, 1.0
        level, idle = median([b.loads[name] for b in span if name in b.loads]), self.idle[name].level
        yield Notice(span[0].start, "refused", AGAINST.format(name, level, CONTRADICTED, idle, span[-1].phase))
        yield from self._begin(span)

    def _at_speed(self, block: Block) -> None:
        """The idle level of a drive changes with the spindle speed: power in proportion, the rest by what is read."""
        ratio, self._speeds = speed_ratio(block.conditions, self._speeds)
        if ratio == 1:
            return
        self._air.begin(block.end)
        for name in self.idle.keys() & set(DRIVEN):
            self.idle[name].change_speed(ratio, proportional=name == "P")

    def _in_air(self, block: Block) -> Iterator[Found]:
        name, away = self._furthest(block.loads)
        if not name and self._air.leap(block):
            name, away = self._furthest(block.loads)
        high = self._high(name) if name else float("inf")
        if not self._span and abs(away) <= high:
            if self._believed and block.phase == "feed" and not (self._windows.proved and self._air.known):
                self._early.add(block)
            self._air.add(block)
        elif not self._span or away * self._sign > self._left(abs(self._level), high):
            if not self._span:
                self._lead, self._sign, self._level = name, 1.0 if away > 0 else -1.0, 0.0
                self._air.leave()
            self._span.append(block)
            self._level = abs(median([b.loads[name] for b in self._span if name in b.loads]) - self.idle[name].level)
            if sum(b.seconds for b in self._span) >= SHORTEST:
                yield from self._confirmed()
        else:
            span, self._span = self._span, []
            self._air.begin(block.end, follows=True)
            self._short = [*self._short[1 - OFTEN :], span[0].start]
            if len(self._short) == OFTEN and block.end - self._short[0] < 2 * OFTEN * SHORTEST:
                yield from self._windows.once("short", block.end, INTERRUPTED.format(name, SHORTEST))

    def _furthest(self, levels: Mapping[str, float]) -> tuple[str, float]:
        """The load furthest from idle by its threshold, or the one that has left it, and how far it is."""
        known = {name: value - self.idle[name].level for name, value in levels.items() if name in self._air.known}
        if not known:
            return "", 0.0
        if self._span and self._lead in known:
            return self._lead, known[self._lead]
        lead = max(known, key=lambda name: abs(known[name]) / self._high(name))
        return lead, known[lead]

    def _high(self, name: str) -> float:
        """Distance from idle at which a cut begins."""
        idle, reach = self.idle[name], self._windows.reach.get(name)
        usual = THRESHOLD * median(reach) if reach else FIRST_CUT * abs(idle.level)
        now = self._ahead[-1].end if self._ahead else idle.time
        noise = NOISE * sqrt(idle.noise**2 + idle.reading + idle.variance_at(now))
        return max(min(noise, self._reached.get(name, inf) / 2), usual, COARSE * abs(idle.level), 1e-12)

    @staticmethod
    def _left(level: float, high: float) -> float:
        """Distance from idle at which a cut of this level has ended."""
        return max(LEFT * level, min(high / 2, level / 2))

    def _confirmed(self) -> Iterator[Found]:
        """A load has been away from idle for as long as a cut."""
        span, self._span = self._span, []
        loads = [b.loads[self._lead] for b in span if self._lead in b.loads]
        idle, new, driven = self.idle[self._lead], median(loads), self._lead in DRIVEN
        said = span[-1].phase == "feed" and self._windows.proved
        later = loads[len(loads) // 2 :]  # after the ramp
        restless = len(later) > 1 and stdev(later) > QUIETER * idle.noise
        lower = self._sign < 0 if self._windows.proved else not restless
        if lower and not said and abs(new) < abs(idle.level):
            yield from self._fallen(span, new)
        elif driven and self._may_start(span[-1]) and abs(idle.level) < OFF * abs(new):
            self._started, self._standing = span, idle.level
        else:
            if driven and self._rest is None and not said and abs(idle.level) < ZERO * abs(new):
                yield from self._windows.once("rest", span[0].start, RESTING.format(self._lead, idle.level))
            yield from self._begin(span)

    def _may_start(self, block: Block) -> bool:
        """Whether a load that leaves a level near zero may be that of a spindle that starts."""
        stands = not any(block.conditions.get(name, 0.0) > 0 for name in SPEEDS)
        return not self._windows.proved and (self._rest == "off" or (self._rest is None and stands))

    def _begin(self, span: list[Block]) -> Iterator[Found]:
        self._cut, self._below = True, []
        self._windows.begin(self._lead)
        for block in span:
            yield from self._windows.add(block)

    def _fallen(self, span: list[Block], new: float) -> Iterator[Found]:
        """The load fell below the level that was taken as idle: the spindle stopped, or that level was another one."""
        name, old, begun = self._lead, self.idle[self._lead].level, self._air.begun
        self._air.begin(span[0].start)
        if name in DRIVEN and self._windows.proved and abs(new) < OFF * abs(old):
            self._stopped = True
            return
        self._early = EarlyFeed()  # its time is in that since air began
        if not self._windows.proved:
            minutes = (span[0].start - begun) / 60
            yield Window(begun, span[0].start, minutes, dict(span[0].conditions), {}, self._windows.number)
            yield CutEnd(span[0].start, 0.0, self._windows.number, unseen=True)
            yield Notice(span[0].start, "refused", FALLEN.format(name, old, new, 60 * minutes))
            if self._standing is not None and abs(new - self._standing) < OFF * abs(old):
                self._rest = self._rest or "idle"
        self.idle.clear()
        self._air.begun, self._standing = span[0].start, None

    def _in_start(self, block: Block) -> None:
        """The spindle stands, or has just started: its surge is no cut."""
        name = self._lead if self._lead in block.loads else next(iter(block.loads), "")
        if name not in self._air.known:
            self._stopped, self._started = False, []
            return
        idle = self.idle[name]
        if self._stopped:
            if block.loads[name] >= idle.level / 2:
                self._stopped, self._started = False, [block]
            return
        self._started.append(block)
        passed = block.end - self._started[0].start
        near = [abs(b.loads.get(name, idle.level) - idle.level) for b in self._started[-5:]]
        if self._windows.proved and (passed > STARTING or (passed > SHORTEST and max(near) < self._high(name))):
            self._started = []
            self._air.begin(block.end)
        elif not self._windows.proved and passed > STARTING:  # the lowest second after a start is idle
            started, self._started = [b for b in self._started if name in b.loads], []
            self._air.assume_lowest(started, name, round(STARTING))

    def _in_cut(self, block: Block) -> Iterator[Found]:
        if self._lead not in block.loads:
            yield from self._windows.add(block)
            if self._windows.silent(SILENT):
                yield from self._end(lost=True)
            return
        away = self._sign * (block.loads[self._lead] - self.idle[self._lead].level)
        self._level += min(1.0, block.seconds / FOLLOWING) * (away - self._level)
        if away < self._left(self._level, self._high(self._lead)):
            self._below.append(block)
            if sum(b.seconds for b in self._below) >= MERGED:
                fallen = list(self.lost.fallen(self._lead, self._below)) if self._sign > 0 else []
                yield from fallen
                yield from self._end(lost=bool(fallen))
            return
        below, self._below = self._below, []
        for earlier in (*below, block):
            yield from self._windows.add(earlier)

    def _end(self, *, lost: bool = False) -> Iterator[Found]:
        yield from self._windows.close(lost=lost)
        self._air.begin(self._windows.last)
        self._reached[self._lead] = max(self._level, self._reached.get(self._lead, 0.0) / 2)
        self._cut, self._below, self._level = False, [], 0.0
