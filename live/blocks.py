"""Samples gathered into blocks of a tenth of a second, a revolution or one sample, and the idle level they show.

The longest revolution follows from the spindle speed ``n`` of the samples, or from ``V`` and ``D``. Conditions that the
laws need are computed as in tables of tests: V from n and D, f from the feed rate and n.
"""

from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite, isnan, nan, pi
from statistics import fmean, median, stdev

from ..datasets.derived.rules import RULES
from ..datasets.signals.cuts import SETTLED
from .samples import Block, CutEnd, Notice, Sample, State, Window

BLOCK = 0.1  # s; five samples at 50 Hz
GAP = 2.0  # s without a sample, at least, that are a gap
FORGOTTEN = 5.0  # s without a reading of a condition that is to be read, after which its last value is not used
INTERVALS = 5.0  # usual intervals between samples that are a gap
BRIDGED = 5.0  # s; a shorter gap within a cut counts as cutting
SECONDS_OF_DRIFT = 5.0  # s in which the idle level drifts by the noise of a second of air, before it is learned
FOLLOWED = 0.3  # share of a step of the idle level that is followed in a second, at least
FEWEST = 3  # blocks of a second of air
LONGEST = 3.0  # s of a revolution that is averaged over
SPEEDS = ("n", "V")
OTHER_SPEED = 0.03  # relative change
DERIVED = ("V", "f", "fz")
FIRST_CUT = 0.03  # of the idle level that the first cut exceeds
MOST_LEVELS = 600  # blocks of an early feed whose loads are kept
EARLY = (
    "the source began in a cut: {:.3g} min of feed count, without loads; what was cut before is not known: gauge it."
)
NEVER_IDLE = (
    "the machine fed for {0:.3g} min and was not seen to idle, so no load shows whether it cut and nothing is counted. "
    "Begin while it idles, or count them with --used {0:.3g}min."
)


@dataclass(slots=True)
class IdleLevel:
    """Level of a load in the air and its drift.

    Attributes
    ----------
    level : float
        In the unit of the load.
    variance : float
        Of the level at ``time``; infinite before the first second of air.
    time : float
        s, middle of the last second of air.
    mean : float
        Of that second.
    reading : float
        Variance of such a mean, from successive seconds.
    scatters : list of float
        Standard deviations of the blocks of the last seconds of air.
    walk : float
        Variance that the level gained per second over cuts, mean of the steps seen.
    steps, seconds : int
        Steps from which ``walk``, and differences from which ``reading`` was learned.
    """

    level: float = 0.0
    variance: float = inf
    time: float = 0.0
    mean: float = 0.0
    reading: float = 0.0
    scatters: list[float] = field(default_factory=list)
    walk: float = 0.0
    steps: int = 0
    seconds: int = 0

    @property
    def known(self) -> bool:
        """Whether two seconds of air have been read."""
        return len(self.scatters) > 1

    @property
    def noise(self) -> float:
        """Standard deviation of blocks in a quiet second of air."""
        return median(self.scatters) if self.scatters else 0.0

    @property
    def drift(self) -> float:
        """Variance that the level gains per second; what is assumed before it is learned counts as one step."""
        return (self.reading / SECONDS_OF_DRIFT + self.steps * self.walk) / (1 + self.steps)

    def variance_at(self, time: float) -> float:
        """Variance of the level at a time, s."""
        return self.variance + self.drift * max(0.0, time - self.time)

    def add(self, values: Sequence[float], time: float, *, follows: bool) -> None:
        """Take in the blocks of a second of air around ``time`` (s); ``follows``: no cut lies before it."""
        mean = fmean(values)
        self.scatters = [*self.scatters, stdev(values)][-30:]
        if self.variance == inf:
            self.level, self.reading = mean, stdev(values) ** 2
            self.variance = self.reading
        else:
            if follows:
                self._learn_reading(mean)
            else:
                self._learn_drift(mean, time)
            before = self.variance_at(time)
            gain = max(before / (before + self.reading), FOLLOWED) if before > 0 else 0.0
            self.level += gain * (mean - self.level)
            self.variance = (1 - gain) ** 2 * before + gain**2 * self.reading
        self.mean, self.time = mean, time

    def change_speed(self, ratio: float, *, proportional: bool) -> None:
        """Follow another spindle speed: the level changes in proportion, or stays; neither is certain."""
        change = (ratio - 1) * self.level
        self.level += change if proportional else 0.0
        self.unsettle(change**2 / 4)

    def unsettle(self, variance: float) -> None:
        """Add to the variance: the level has changed to a value that is not known, as with another spindle speed."""
        self.variance += variance

    def _learn_reading(self, mean: float) -> None:
        half = (mean - self.mean) ** 2 / 2
        self.seconds += 1
        self.reading += (min(half, 10 * self.reading) - self.reading) / min(self.seconds + 1, 30)

    def _learn_drift(self, mean: float, time: float) -> None:
        step = max(0.0, (mean - self.level) ** 2 - self.variance - self.reading)
        rate = min(step / max(time - self.time, 1.0), 30 * self.drift)
        self.steps = min(self.steps + 1, 20)
        self.walk += (rate - self.walk) / self.steps


class Gap(float):
    """Seconds without a sample; negative where the clock went back."""


class Blocks:
    """Blocks of a stream of samples.

    Parameters
    ----------
    constants : mapping of str to float
        Conditions that the source does not give, in the units of the laws (``d``, ``D``, ``n``).

    Examples
    --------
    >>> blocks = Blocks({"d": 2.0})
    >>> found = [b for k in range(12) for b in blocks.add(Sample(k / 50, {"P": 1.0}, {"n": 600, "D": 50}))]
    >>> found[0].loads, round(found[0].conditions["V"], 2)
    ({'P': 1.0}, 94.25)
    """

    def __init__(self, constants: Mapping[str, float] | None = None) -> None:
        self.constants = dict(constants or {})
        self._held: list[Sample] = []
        self._known = dict(self.constants)  # conditions as they were last given
        self._unread: dict[str, float] = {}  # s, since when a condition could not be read
        self._begin = self._last = float("nan")  # s: where the block that is being filled begins, and the last sample
        self._intervals: deque[float] = deque(maxlen=21)

    @property
    def interval(self) -> float:
        """Usual time between samples, s; 0 before the second sample."""
        return median(self._intervals) if self._intervals else 0.0

    def add(self, sample: Sample) -> Iterator[Block | Gap]:
        """Blocks that are complete with this sample, and a gap before it; a sample counts for the time before it."""
        passed = sample.time - self._last
        if passed < 0 or passed > max(GAP, INTERVALS * self.interval):
            yield from self.close()
            yield Gap(passed)
            if not 0 < passed <= BRIDGED:
                self._begin = sample.time - self.interval
        elif passed > 0:
            self._intervals.append(passed)
        elif isnan(passed):
            self._begin = sample.time
        self._last = sample.time
        self._held.append(sample)
        self._keep(sample)
        length = max(BLOCK, _revolution(self._known))
        if sample.time - self._begin > length - 0.5 * self.interval:
            yield from self.close()

    def _keep(self, sample: Sample) -> None:
        """Keep the conditions of a sample; one that could not be read for a time is not known any more."""
        for name, value in sample.conditions.items():
            if isfinite(value):
                self._known[name] = value
                self._unread.pop(name, None)
            elif not 0 <= sample.time - self._unread.setdefault(name, sample.time) <= FORGOTTEN:
                self._known.pop(name, None)

    def close(self) -> Iterator[Block]:
        """The block of the samples held, if there are any."""
        held, self._held = self._held, []
        if held and self._last > self._begin:
            yield _block(self._begin, self._last, held, self._known)
            self._begin = self._last


def _revolution(conditions: Mapping[str, float]) -> float:
    """Duration of a revolution, s; 0 where it is not known, and at most `LONGEST`."""
    n = conditions.get("n", 0.0)
    if not n and conditions.get("D", 0.0) > 0:
        n = 1000 * conditions.get("V", 0.0) / (pi * conditions["D"])
    return min(60 / n, LONGEST) if n > 0 else 0.0


def _block(start: float, end: float, samples: Sequence[Sample], known: Mapping[str, float]) -> Block:
    values: dict[str, list[float]] = {}
    given: dict[str, list[float]] = {}
    for sample in samples:
        for held, readings in ((values, {} if sample.bad else sample.loads), (given, sample.conditions)):
            for name, value in readings.items():
                if isfinite(value):
                    held.setdefault(name, []).append(value)
    conditions = {**known, **{name: sum(held) / len(held) for name, held in given.items()}}
    loads = {name: fmean(held) for name, held in values.items()}
    return Block(start, end, values, loads, derived(conditions), _phase(samples, conditions))


def derived(conditions: dict[str, float]) -> dict[str, float]:
    """Conditions with V, f and fz computed where they are not given; a standing spindle has no feed a revolution."""
    for rule in RULES:
        if rule.role not in DERIVED or rule.role in conditions or not all(name in conditions for name in rule.inputs):
            continue
        if rule.role == "V" or conditions.get("n", 1.0) > 0:
            conditions[rule.role] = float(rule.function(*(conditions[name] for name in rule.inputs)))
    return conditions


def _phase(samples: Sequence[Sample], conditions: Mapping[str, float]) -> State:
    """Phase by the last sample, or by a speed or feed of zero."""
    said = samples[-1].state
    if said == "off" or any(conditions.get(name) == 0 for name in ("V", "n")):
        return "off"
    if said == "idle" or any(conditions.get(name) == 0 for name in ("f", "fm", "fz")):
        return "idle"
    return said


class Air:
    """Idle levels of all loads, from the air between cuts.

    Attributes
    ----------
    idle : dict of str to IdleLevel
        By load.
    begun : float
        s, from which these levels are assumed; NaN before.
    """

    def __init__(self) -> None:
        self.idle: dict[str, IdleLevel] = {}
        self.forget()

    @property
    def known(self) -> set[str]:
        """Loads whose idle level is known."""
        return {name for name, level in self.idle.items() if level.known}

    def forget(self) -> None:
        """Nothing of the moment; the levels stay."""
        self.begun = nan
        self._waiting: deque[Block] = deque()  # the last moment, which may be the ramp of a cut
        self._second: list[Block] = []
        self.begin(-inf)

    def begin(self, time: float, *, follows: bool = False) -> None:
        """Air begins at a time (s); ``follows``: it goes on, after something too short for a cut."""
        self._from, self._second = time, []
        self._follows = follows
        self._waiting.clear()

    def leave(self) -> None:
        """A load leaves its level: what was read in the last moment may be the ramp of a cut."""
        self._waiting.clear()

    def add(self, block: Block, only: Collection[str] | None = None) -> None:
        """Take in a block of air, but the last moments before a cut and the first after one."""
        if block.start >= self._from:
            self._waiting.append(block)
        while self._waiting and block.end - self._waiting[0].end > SETTLED:
            earlier = self._waiting.popleft()
            if earlier.start >= self._from + SETTLED:
                self._second.append(earlier)
        if sum(b.seconds for b in self._second) >= 1.0 - BLOCK / 2 and len(self._second) >= FEWEST:
            second, self._second = self._second, []
            self._learn(second, only, follows=self._follows)
            self._follows = True

    def _learn(self, blocks: Sequence[Block], only: Collection[str] | None, *, follows: bool) -> None:
        time = (blocks[0].start + blocks[-1].end) / 2
        self.begun = blocks[0].start if isnan(self.begun) else self.begun
        for name in blocks[-1].loads.keys() if only is None else blocks[-1].loads.keys() & only:
            values = [b.loads[name] for b in blocks if name in b.loads]
            if len(values) >= FEWEST:
                self.idle.setdefault(name, IdleLevel()).add(values, time, follows=follows)

    def leap(self, block: Block) -> bool:
        """Whether a load leaves the few blocks read so far, from which the levels are then taken."""
        few = [*self._second, *self._waiting]
        for name, value in block.loads.items():
            values, idle = [b.loads[name] for b in few if name in b.loads], self.idle.get(name)
            if idle is not None and _leaps(value, idle.level, idle.noise):
                idle.scatters = [*idle.scatters, idle.noise]
                return True
            if idle is None and len(values) >= FEWEST and _leaps(value, median(values), stdev(values)):
                self.assume(few)
                return True
        return False

    def assume_lowest(self, blocks: Sequence[Block], name: str, parts: int) -> None:
        """Take the part of these blocks in which a load is lowest as air, which begins after all of them."""
        size = max(FEWEST, len(blocks) // parts)
        every = [blocks[k : k + size] for k in range(0, len(blocks) - size + 1, size)]
        if every:
            self.assume(min(every, key=lambda part: median([b.loads[name] for b in part])))
            self.begun = blocks[0].start
            self.begin(blocks[-1].end)

    def assume(self, blocks: Sequence[Block]) -> None:
        """Take blocks as air whatever was taken before."""
        self.idle.clear()
        self.begun = blocks[0].start
        for follows in (False, True):
            self._learn(blocks, None, follows=follows)


class EarlyFeed:
    """Feed that a machine reported before it was seen to idle, which no load can show to be a cut at that time."""

    def __init__(self) -> None:
        self.seconds, self.goes_on = 0.0, False  # whether it was the last that the machine reported
        self._start = self._end = nan
        self._conditions: Mapping[str, float] = {}
        self._loads: dict[str, deque[float]] = {}

    def add(self, block: Block) -> None:
        """Take in a block."""
        self._start = self._start if self.seconds else block.start
        self._end, self._conditions = block.end, block.conditions
        self.seconds, self.goes_on = self.seconds + block.seconds, True
        for name, value in block.loads.items():
            self._loads.setdefault(name, deque(maxlen=MOST_LEVELS)).append(value)

    def above(self, idle: Mapping[str, IdleLevel]) -> bool:
        """Whether a load was above its idle level by as much as in a cut, or no idle level is known."""
        known = [(median(levels), idle[name]) for name, levels in self._loads.items() if name in idle]
        return not known or any(x > of.level + FIRST_CUT * abs(of.level) + 3 * of.noise for x, of in known)

    def sentences(self) -> list[str]:
        """That a minute of feed or more may have been a cut, where the machine was never seen to idle."""
        return [NEVER_IDLE.format(self.seconds / 60)] if self.seconds >= 60 else []

    def cut(self, number: int) -> tuple[Window, CutEnd, Notice]:
        """The cut so far: a window without loads, its end, and a notice."""
        minutes = self.seconds / 60
        window = Window(self._start, self._end, minutes, dict(self._conditions), {}, number)
        end = CutEnd(self._end, 0.0, number, unseen=True)
        return window, end, Notice(self._end, "refused", EARLY.format(minutes))


def _leaps(value: float, level: float, noise: float) -> bool:
    return abs(value - level) > max(10 * noise, abs(level) / 2)


def speed_ratio(conditions: Mapping[str, float], before: Mapping[str, float]) -> tuple[float, Mapping[str, float]]:
    """Ratio of the spindle speed to that before, 1 where it is not another one, and the speed to compare with next.

    >>> speed_ratio({"n": 1200.0}, {"n": 800.0}), speed_ratio({"n": 810.0}, {"n": 800.0})
    ((1.5, {'n': 1200.0}), (1.0, {'n': 800.0}))
    """
    now = {name: conditions[name] for name in SPEEDS if conditions.get(name, 0.0) > 0}
    name = next(iter(now), "")
    if name not in before:
        return 1.0, now or before
    ratio = now[name] / before[name]
    return (ratio, now) if abs(ratio - 1) > OTHER_SPEED else (1.0, before)
