"""Windows of a cut: means of loads above their idle level, with a standard error that holds for both.

The idle level is a random walk that is read each second of air (a Kalman filter of one state): its variance grows
during a cut by a drift that is learned from the steps between the air before and after cuts. The variance of a mean
is that of the means of ten parts of the window, and of neighbouring windows of a cut: neither assumes that samples are
independent. The idle level enters every window of a cut alike.
"""

from collections import deque
from collections.abc import Collection, Generator, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from math import inf, log, sqrt
from statistics import fmean, median, stdev
from typing import Any

import numpy as np

from ..core.arrays import MAD, Array, Flags
from ..datasets.signals.cuts import MERGED, OFF, SETTLED, settled_blocks
from ..datasets.signals.options import DRIVEN
from ..datasets.signals.statistics import PARTS, batch_variance
from .blocks import BLOCK, EarlyFeed, IdleLevel
from .samples import Block, CutEnd, LoadMean, Notice, Window

OUTLYING = 6.0  # standard deviations, from the median absolute deviation, from which a value is left out
FREQUENT = 0.15  # share of values far off from which they are no outliers
CERTAIN = 3.0  # standard errors by which a cut exceeds idle
OWN = 1.0  # weight of the scatter of a window beside that of a window before it
MEMORY = 20.0  # windows that the scatter is averaged over, at most
PAIRS = 5  # of neighbouring windows, at least
NORMAL = 0.4549  # median of the square of a standard normal variate
CHANGED = 0.03  # relative change of a condition that begins another window
OF_MACHINE = ("n", "fm", "D")  # they change with V and f, or are compensated
STEADY = 0.5  # s for which it stays so
LEAST = 1.0  # s of a window
QUIETER = 2.0  # ratio of the scatters of cut and air that shows which is which

INTERRUPTED = (
    "{} leaves idle again and again for less than {:g} s, which counts as air: if the cut is interrupted, give the "
    "spindle speed (n, or V and D) at the source or with --value."
)
AGAINST = (
    "{} is {:.4g} for {:g} s, idle was {:.4g}, and the machine says {}: from here cuts follow from the load alone. "
    "Check how state, spindle speed and feed are mapped."
)
FALLEN = (
    "{} fell from {:.4g} to {:.4g}, the lowest level so far: the {:.0f} s before are counted as cutting, without their "
    "loads. Connect while the machine idles, map its state, or give --rest idle where this is the idle load."
)
RESTING = (
    "{} rests at {:.3g}, which is taken as idle, because the spindle turns there by its speed or nothing "
    "else is known: if it stands there, give --rest off."
)
STUCK = (
    "{} stands still at {:.4g} in the cut and did not when idle: the signal may be stuck. Cutting time counts without "
    "this load."
)
UNPROVED = (
    "{} is {:.4g} and was {:.4g} before: whether that was idle is seen when it returns there; until then cutting time "
    "counts and loads do not."
)
BELOW = (
    "{0} is {1:.4g} in the cut and {2:.4g} when idle: a cut must exceed idle. Reverse its sign (--scale {0}=-1), or "
    "map another channel. Cutting time counts without this load."
)
UNSURE = (
    "{} is {:.4g} in the cut, and its idle level is too uncertain ({:.4g}): cutting time counts without this load. Let "
    "the spindle idle for some seconds before a cut."
)
NONE = (
    "no cut was found in {:.3g} min: {} lay between {:.4g} and {:.4g}. Check which column or channel it is and its "
    "unit, and give --rest."
)


@dataclass(slots=True)
class SeenLoads:
    """Least and largest value of each load, and minutes, of a source in which no cut has been found."""

    minutes: float = 0.0
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)

    def add(self, block: Block) -> None:
        """Take in a block."""
        self.minutes += block.seconds / 60
        for name, value in block.loads.items():
            low, high = self.ranges.get(name, (value, value))
            self.ranges[name] = min(low, value), max(high, value)

    def sentences(self) -> list[str]:
        """Sentences on each load in a minute or more."""
        if self.minutes < 1:
            return []
        return [NONE.format(self.minutes, name, *ends) for name, ends in self.ranges.items()]


@dataclass(slots=True)
class MeanNoise:
    """Scatter of the means of windows of a load, relative to the load, learned over windows.

    Attributes
    ----------
    own : float
        Variance of a mean times its seconds, from the parts of windows.
    windows : float
        Windows that entered, at most `MEMORY`.
    pairs : list of float
        Squared differences of the ln of neighbouring windows, times their seconds.
    """

    own: float = 0.0
    windows: float = 0.0
    pairs: list[float] = field(default_factory=list)

    def add(self, own: float, seconds: float) -> None:
        """Take in the relative variance of the mean of a window."""
        self.windows = min(self.windows + 1, MEMORY)
        self.own += (own * seconds - self.own) / self.windows

    def add_pair(self, step: float, seconds: float) -> None:
        """Take in the step of the ln from a window to the next one."""
        self.pairs = [*self.pairs, step**2 * seconds][-40:]

    def variance(self, seconds: float) -> float:
        """Relative variance of the mean of a window that lasts so long."""
        apart = median(self.pairs) / NORMAL / 2 if len(self.pairs) >= PAIRS else 0.0
        return max(self.own, apart) / seconds


@dataclass(frozen=True, slots=True)
class PlainMean:
    """Mean of a load over a window, with idle: value, variance from its parts, and samples without outliers."""

    value: float
    variance: float
    samples: int


def plain_mean(parts: Sequence[Sequence[float]]) -> PlainMean:
    """Mean of blocks, each a sequence of samples, without outlying samples and blocks.

    Examples
    --------
    >>> mean = plain_mean([[1.0, 1.2], [1.1, 0.9], [1.0, 90.0], [1.0, 1.1], [0.9, 1.0], [1.1, 1.2]])
    >>> round(mean.value, 2), mean.samples
    (1.04, 11)
    """
    values = np.concatenate([np.asarray(part, dtype=np.float64) for part in parts])
    kept = np.where(_near(values), values, np.nan)
    lengths = np.cumsum([len(part) for part in parts])[:-1]
    means = np.array([part[np.isfinite(part)].mean() for part in np.split(kept, lengths) if np.isfinite(part).any()])
    means = means[_near(means)]
    if len(means) < 2 * PARTS:
        variance = float(np.mean(np.diff(means) ** 2) / 2 / len(means)) if len(means) > 1 else inf
    else:
        variance = batch_variance(means)
    return PlainMean(float(means.mean()), variance, int(np.isfinite(kept).sum()))


def _near(values: Array) -> Flags:
    """Values that are no outliers, as a mask; all of them where many lie far off, as in an interrupted cut."""
    off = np.abs(values - np.median(values))
    near: Flags = off <= OUTLYING * MAD * float(np.median(off))
    return near if near.mean() >= 1 - FREQUENT else np.ones(len(values), dtype=np.bool_)


def load_mean(mean: PlainMean, idle: tuple[float, float], noise: MeanNoise, seconds: float) -> LoadMean | None:
    """Mean of the ln above an idle level, or None where the load does not exceed it.

    Parameters
    ----------
    mean : PlainMean
    idle : tuple of float
        Level, in the unit of the load, and its variance; zeros where the law is one of the whole load.
    noise : MeanNoise
        Scatter of windows before; takes in this one.
    seconds : float
        Duration of the window.
    """
    net = mean.value - idle[0]
    if not net > CERTAIN * sqrt(mean.variance + idle[1]):
        return None
    noise.add(mean.variance / net**2, seconds)
    own = (OWN * mean.variance / net**2 + noise.windows * noise.variance(seconds)) / (OWN + noise.windows)
    return LoadMean(log(net), sqrt(own + idle[1] / net**2), mean.samples)


class Windows:
    """Windows of the cuts of a stream.

    Parameters
    ----------
    idle : mapping of str to IdleLevel
        By load; the caller keeps it up to date.
    whole : collection of str
        Loads whose law is one of the whole load: the idle level is not subtracted.
    seconds : float
        Length of a window.

    Attributes
    ----------
    number : int
        Of the cut.
    entering : bool
        Whether the load has not settled since the cut, or another feed, began.
    proved : bool
        Whether the idle level is known to be one; loads above a level that may be that of a cut are not used.
    last : float
        s, end of the last block.
    """

    def __init__(self, idle: Mapping[str, IdleLevel], whole: Collection[str], seconds: float) -> None:
        self.idle, self.whole, self.seconds = idle, frozenset(whole), seconds
        self.noise: dict[str, MeanNoise] = {}
        self.reach: dict[str, deque[float]] = {}  # levels above idle in the last windows
        self.number, self.last = 0, 0.0
        self.entering, self.proved = True, False
        self._lead = ""
        self._segment: list[Block] = []  # of the next window
        self._carried: list[Block] = []  # cut, in no window
        self._first = True  # no window of the cut yet
        self._previous: Window | None = None
        self._said: set[str] = set()

    @property
    def minutes(self) -> float:
        """Minutes of cutting since the last window."""
        return sum(b.seconds for part in (self._carried, self._segment) for b in part) / 60

    def as_json(self) -> dict[str, Any]:
        """Snapshot without the cut of the moment."""
        noise = {name: asdict(noise) for name, noise in self.noise.items()}
        reach = {name: list(reach) for name, reach in self.reach.items()}
        return {"number": self.number, "proved": self.proved, "noise": noise, "reach": reach}

    def resume(self, data: Mapping[str, Any]) -> None:
        """Take over what `as_json` gave."""
        self.number, self.proved = int(data["number"]), bool(data["proved"])
        self.noise = {name: MeanNoise(**noise) for name, noise in data["noise"].items()}
        self.reach = {name: deque(reach, maxlen=10) for name, reach in data["reach"].items()}

    def begin(self, lead: str) -> None:
        """Begin a cut, which was found on the load ``lead``."""
        self.number += 1
        self.entering = self._first = True
        self._lead, self._previous = lead, None

    def add(self, block: Block) -> Iterator[Window | Notice]:
        """Take a block of the cut; windows that are complete with it."""
        self._segment.append(block)
        self.last = block.end
        if at := self._change():
            earlier, self._segment = self._segment[:at], self._segment[at:]
            yield from self._window(earlier, leaving=False)
            self.entering, self._previous = True, None
        elif sum(b.seconds for b in self._segment) >= self.seconds + MERGED:
            held = next(k for k, b in enumerate(self._segment) if block.end - b.end <= MERGED)
            earlier, self._segment = self._segment[:held], self._segment[held:]
            yield from self._window(earlier, leaving=False)

    def close(self, *, lost: bool) -> Iterator[Window | CutEnd | Notice]:
        """The last window of the cut and its end; a cut without a window gives one without loads."""
        segment, self._segment = self._segment, []
        yield from self._window(segment, leaving=True)
        if self._first and self._carried:
            yield self._without_loads()
        yield CutEnd(self.last, self.minutes, self.number, lost)
        self._carried = []
        self.proved |= not lost and self._lead != ""

    def early(self, feed: EarlyFeed) -> Iterator[Window | CutEnd | Notice]:
        """The cut in which the source began."""
        self.number += 1
        yield from feed.cut(self.number)

    def stands_still(self, name: str, blocks: Sequence[Block]) -> bool:
        """Whether all readings of a load are one value, and those of its idle level were not."""
        read = {value for b in blocks for value in b.values.get(name, ())}
        return len(read) == 1 and name in self.idle and self.idle[name].noise > 0

    def silent(self, seconds: float) -> bool:
        """Whether the load of the cut has not been read for so long."""
        heard = [b.end for b in (*self._carried, *self._segment) if self._lead in b.loads]
        return bool(heard) and self.last - heard[-1] > seconds

    def _change(self) -> int:
        """Number of blocks before a condition changed and stayed so for half a second; 0 where none did."""
        last = self._segment[-1]
        recent = next(k for k, b in enumerate(self._segment) if last.end - b.end < STEADY)
        before, after = self._segment[:recent], self._segment[recent:]
        if not before or sum(b.seconds for b in after) < STEADY - BLOCK / 2:
            return 0
        for name, old in _conditions(before).items():
            if name in OF_MACHINE:
                continue
            steps = [b.conditions[name] - old for b in after if name in b.conditions]
            if steps and min(map(abs, steps)) > CHANGED * abs(old) and min(steps) * max(steps) > 0:
                if name == "V":
                    self._unsettle(fmean(steps) / old if old else 1.0)
                return recent
        return 0

    def _unsettle(self, change: float) -> None:
        """The idle level at another spindle speed is another one: by as much as the speed, at most."""
        for name, idle in self.idle.items():
            if name in DRIVEN:
                idle.unsettle((change * idle.level) ** 2)

    def _window(self, blocks: Sequence[Block], *, leaving: bool) -> Iterator[Window | Notice]:
        """The window of a part of a cut, without entry and exit; blocks that are in none are carried on."""
        first, end = 0, len(blocks)
        idle = self.idle[self._lead].level if self._lead in self.idle else 0.0
        loads = [abs(b.loads.get(self._lead, idle) - idle) for b in blocks]
        run = max(1, round(SETTLED / (blocks[0].seconds if blocks else 1.0)))
        if len(blocks) > 2 * run and self.entering:
            first = settled_blocks(np.array(loads), run)
        if len(blocks) > 2 * run and leaving:
            end -= settled_blocks(np.array(loads[::-1]), run)
        part = blocks[first:end]
        if sum(b.seconds for b in part) < LEAST - BLOCK / 2:
            self._carried += blocks
            if sum(b.seconds for b in self._carried) > 2 * self.seconds:
                yield self._without_loads()
            return
        means: dict[str, LoadMean] = {}
        for name in dict.fromkeys(name for b in part for name in b.loads):
            found = yield from self._load(name, part)
            if found is not None:
                means[name] = found
        every = [*self._carried, *blocks[:end]]
        minutes = sum(b.seconds for b in every) / 60
        steady = _conditions([*self._carried, *(part[1:-1] or part)])
        window = Window(part[0].start, part[-1].end, minutes, steady, means, self.number)
        self._carried = list(blocks[end:])
        self.entering = False
        self._first = False
        self._pair(window)
        yield window

    def _without_loads(self) -> Window:
        """A window of what was cut in none: its time counts."""
        part, self._carried, self._first = self._carried, [], False
        minutes = sum(b.seconds for b in part) / 60
        return Window(part[0].start, part[-1].end, minutes, _conditions(part[1:-1] or part), {}, self.number)

    def _load(self, name: str, part: Sequence[Block]) -> Generator[Notice, None, LoadMean | None]:
        """Mean of a load over a window; None where there is none, with a notice the first time."""
        idle = self.idle.get(name, IdleLevel())
        values = [b.values[name] for b in part if name in b.values]
        if not idle.known or len(values) < 4 or len(values) < len(part) / 2:
            return None
        mean, start, end = plain_mean(values), part[0].start, part[-1].end
        if self.stands_still(name, part):
            yield from self.once(f"stuck {name}", end, STUCK.format(name, mean.value))
            return None
        loads = [b.loads[name] for b in part if name in b.loads]
        small = abs(idle.level) < OFF * abs(mean.value)  # of the load: no other cut was so light
        self.proved = self.proved or small or stdev(loads) > QUIETER * idle.noise
        if mean.value > idle.level and not self.proved:
            yield from self.once(f"unproved {name}", end, UNPROVED.format(name, mean.value, idle.level))
            return None
        level = (0.0, 0.0) if name in self.whole else (idle.level, idle.variance_at((start + end) / 2))
        found = load_mean(mean, level, self.noise.setdefault(name, MeanNoise()), end - start)
        above = mean.value - idle.level
        if found is None or above <= 0:
            text = BELOW if above <= 0 else UNSURE
            yield from self.once(f"{name} {above <= 0}", end, text.format(name, mean.value, idle.level))
            return None
        self.reach.setdefault(name, deque(maxlen=10)).append(above)
        return found

    def _pair(self, window: Window) -> None:
        """Learn the scatter of means from two neighbouring windows of a cut under the same conditions."""
        before, self._previous = self._previous, window
        if before is None or before.end - before.start < self.seconds / 2:
            return
        for name in window.loads.keys() & before.loads.keys():
            seconds = (before.end - before.start + window.end - window.start) / 2
            self.noise[name].add_pair(window.loads[name].ln - before.loads[name].ln, seconds)

    def once(self, key: str, time: float, text: str) -> Iterator[Notice]:
        """A notice of what cannot be used, the first time."""
        if key not in self._said:
            self._said.add(key)
            yield Notice(time, "load" if key.startswith("stuck") else "refused", text)


def _conditions(blocks: Sequence[Block]) -> dict[str, float]:
    """Means over time."""
    out: dict[str, float] = {}
    for name in dict.fromkeys(name for b in blocks for name in b.conditions):
        held = [(b.conditions[name], b.seconds) for b in blocks if name in b.conditions]
        out[name] = sum(value * seconds for value, seconds in held) / sum(seconds for _, seconds in held)
    return out
