"""Simulation of the exported arithmetic on the cuts that a parameter file implies, and under faults.

Cut: the line of the load law behind the drive's dynamics, the override in steps of 1 % as a machine takes it, noise of
the sensor, wear from sharp to beyond the lower feed limit. One tool: air, entry, constant load, air and entry again,
wear up to the lower limit, the dwell on it. The faults start from constant load in mid-life.
"""

import copy
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from ...core.arrays import Array
from ...parameters.checks.report import FileFinding
from ..constant_load_milling.controller import ConstantLoad
from .settings import Line

if TYPE_CHECKING:
    from collections.abc import Callable

    from ...parameters import ParameterFile
    from ...parameters.exports.loop import LoadLoop
    from ...parameters.sections.dynamics import DynamicsSection

STEPS: Final = 100  # of the override up to 1
LONGEST: Final = 20_000  # samples of the settling time: a tool takes some eight times as long
BEYOND: Final = 1.15  # of the wear at the lower limit, where the tool is called worn
HELD: Final = 0.03  # of the reference: deviation of the mean load at rest
RIPPLE: Final = 0.25  # of the range of the override: peak to peak at rest; at least three steps of it
SAFE_WITHIN: Final = 3.0  # s from a fault to the lower feed limit
SEED: Final = 20


class FileKey:
    """A parameter file for a cache, equal to another where the sections and texts that a gate reads are equal."""

    __slots__ = ("key", "pf")

    def __init__(self, pf: "ParameterFile", sections: set[str], *texts: str) -> None:
        self.pf, self.key = pf, (pf.model_dump_json(include=sections), *texts)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FileKey) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


class Drive(NamedTuple):
    """Dynamics of unit gain between feed and load: polynomials in z^-1, and their period in s."""

    b: tuple[float, ...]
    a: tuple[float, ...]
    sample_time: float


def drive_of(model: "DynamicsSection", delay: int) -> Drive:
    """The drive of a file with the delay of the gains; the sample between command and answer is the simulation's."""
    gain = model.dc_gain
    b = (*[0.0] * delay, *(value / gain for value in model.b))
    return Drive(b[1:] if b[0] == 0 and len(b) > 1 else b, model.a, model.sample_time)


@dataclass(slots=True)
class Cut:
    """A tool under a feed override; its load is that of the line behind the drive, out of the cut that of air."""

    line: Line
    drive: Drive
    programmed: float
    period: float  # s of the controller
    rng: np.random.Generator
    wear: float = 0.0
    in_cut: bool = False
    _driven: float = field(default=0.0, init=False)
    _state: list[float] = field(init=False)
    _behind: float = field(default=0.0, init=False)
    _noise: list[float] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self._state = [0.0] * max(len(self.drive.b), len(self.drive.a))

    def load(self, override: float) -> float:
        """Reading after a period under an override."""
        self._behind += self.period
        if self._behind > self.drive.sample_time * (1 - 1e-6):
            self._behind -= self.drive.sample_time
            self._step(round(override * STEPS) / STEPS * self.programmed)
        line = self.line
        load = line.A + line.B * self._driven + line.k1 * self.wear if self.in_cut else line.idle
        if not line.noise:
            return load
        if not self._noise:
            self._noise = (line.noise * self.rng.standard_normal(256)).tolist()
        return load + self._noise.pop()

    def _step(self, feed: float) -> None:
        s, b, a = self._state, self.drive.b, self.drive.a
        self._driven = driven = b[0] * feed + s[0]
        for i in range(1, len(s)):  # transposed direct form II
            s[i - 1] = s[i] + (b[i] * feed if i < len(b) else 0.0) - (a[i] * driven if i < len(a) else 0.0)


class Span(NamedTuple):
    """Part of a simulation: override and load of each sample, shape (n,), cuts that began, causes of faults."""

    override: Array
    load: Array
    cuts: int
    news: tuple[str, ...]


@dataclass(slots=True)
class Bench:
    """A controller on a cut."""

    controller: ConstantLoad
    cut: Cut
    samples: int = 0
    share: float = 1.0  # of the command that the path has
    _beat: bool = False

    def run(
        self,
        seconds: float,
        *,
        wear: float | None = None,
        reading: "Callable[[float], float] | None" = None,
        beats: bool = True,
    ) -> Span:
        """Run for a time; the wear changes evenly up to ``wear``, ``reading`` replaces what the sensor reads."""
        controller, cut = self.controller, self.cut
        n = max(round(seconds / cut.period), 1)
        rise = 0.0 if wear is None else (wear - cut.wear) / n
        overrides, loads = np.empty(n), np.empty(n)
        news: list[str] = []
        for k in range(n):
            cut.wear += rise
            load = cut.load(self.share * controller.command)
            self._beat = self._beat is not beats
            controller.beat = self._beat
            overrides[k] = controller.step(load if reading is None else reading(load), cut.period)
            loads[k] = load
            if controller.news:
                news += controller.news
        self.samples += n
        return Span(overrides, loads, news.count("cut"), tuple(news))


@dataclass(frozen=True, slots=True)
class Tool:
    """One simulated tool: what was found wrong, in sentences, its largest mean load, and the bench in mid-life."""

    wrong: tuple[str, ...]
    largest: float
    middle: Bench | None


def simulate_tool(loop: "LoadLoop", line: Line, drive: Drive, settling: float, *, design: bool = True) -> Tool:
    """A tool from its first entry to the signal of its change.

    Without ``design`` the line is a draw: the control must be stable and keep the load below an overload, but the feed
    limits need not be those of the line.
    """
    cut = Cut(line, drive, loop.feed_programmed, loop.sample_time, np.random.default_rng(SEED))
    bench = Bench(ConstantLoad(loop), cut)
    bench.controller.enabled = False
    settling += (loop.high - loop.low) / loop.recover
    spans = [bench.run(0.2)]
    bench.controller.enabled = True
    spans.append(bench.run(loop.arm_after + 0.5))
    wrong = list(_air(bench, spans[-1], loop, line))
    if wrong:
        return Tool(tuple(wrong), 0.0, None)
    cut.in_cut = True
    spans.append(bench.run(loop.engage_after + 1.5 * settling + 1))
    spans.append(bench.run(max(settling / 2, 1.0)))
    wrong += _held(bench, spans[-1], loop, line, design)
    spans.append(bench.run(max(settling, 4.0), wear=line.wear / 2))
    if bench.controller.worn and design:
        wrong.append("the tool is called worn at half of its wear; tune faster, or raise dwell")
    middle = copy.deepcopy(bench)
    cut.in_cut = False
    spans.append(bench.run(0.5))
    cut.in_cut = True
    spans.append(bench.run(loop.engage_after + settling + 1))
    wrong += _held(bench, spans[-1], loop, line, design)
    spans.append(bench.run(max(settling, 4.0), wear=BEYOND * line.wear))
    spans.append(bench.run(settling + loop.dwell + 2))
    wrong += _whole(bench, spans, loop, design)
    largest = max(float(_mean(span.load, loop.sample_time).max()) for span in spans)
    return Tool(tuple(dict.fromkeys(wrong)), largest, middle)


def _air(bench: Bench, span: Span, loop: "LoadLoop", line: Line) -> Iterator[str]:
    if bench.controller.fault:
        yield (
            f"in air the control ends in a fault ({_cause(span)}): the load in air is {line.idle:.4g} {loop.unit_load} "
            f"with a noise of {line.noise:.2g}, readings are valid above {loop.load_low:.4g}; lower load_low"
        )
    elif span.cuts:
        yield (
            f"in air the control begins: the load in air is {line.idle:.4g} {loop.unit_load} with a noise of "
            f"{line.noise:.2g}, the threshold {loop.engage_at:.4g}; raise engage_at or its hysteresis"
        )


def _held(bench: Bench, span: Span, loop: "LoadLoop", line: Line, design: bool) -> Iterator[str]:
    """Faults of the cut after settling, at one wear."""
    controller = bench.controller
    if controller.fault or controller.overload:
        return
    if not controller.cutting:
        yield (
            f"the control does not begin: the tool's load is {span.load[-1]:.4g} {loop.unit_load}, the threshold "
            f"{loop.engage_at:.4g} +- {loop.hysteresis / 2:.2g}; lower engage_at or engage_after"
        )
        return
    last = slice(len(span.override) // 2, None)
    override, load = span.override[last], span.load[last]
    swing, allowed = float(np.ptp(override)), max(RIPPLE * (loop.high - loop.low), 3 / STEPS)
    if swing > allowed:
        yield (
            f"the feed override does not come to rest: it moves by {swing:.3g} at constant wear, more than "
            f"{allowed:.3g} (sensor noise {line.noise:.2g} {loop.unit_load}); tune slower, or filter the load"
        )
        return
    deviation, step = float(load.mean() - loop.reference), line.B * loop.feed_programmed / STEPS
    limited = override.mean() > loop.high - 2 / STEPS if deviation < 0 else override.mean() < loop.low + 2 / STEPS
    if design and not limited and abs(deviation) > HELD * loop.reference + step:
        yield (
            f"the load settles at {load.mean():.4g} {loop.unit_load}, not at the reference {loop.reference:.4g}: the "
            "integral action is too weak; tune again"
        )


def _whole(bench: Bench, spans: list[Span], loop: "LoadLoop", design: bool) -> Iterator[str]:
    """Faults over the life of the tool."""
    controller = bench.controller
    if controller.overload:
        yield (
            f"normal cutting ends in an overload: the mean load exceeds {loop.overload_at:.4g} {loop.unit_load}, 1.05 "
            f"times what a worn tool withstands, for {loop.overload_after:.2g} s; tune with less overshoot, or lower "
            "the feed limits"
        )
    elif controller.fault:
        cause = next((_cause(span) for span in spans if _cause(span)), "unknown")
        yield f"normal cutting ends in a fault ({cause}); widen load_low and load_high, or lost_after and stuck_after"
    cuts = sum(span.cuts for span in spans)
    if cuts > 2:
        yield (
            f"the engagement hunts: {cuts} entries in 2 cuts at the threshold {loop.engage_at:.4g} +- "
            f"{loop.hysteresis / 2:.2g} {loop.unit_load}; lower engage_at or widen the hysteresis"
        )
    low, high = (float(of(span.override)) for of, span in ((np.min, _least(spans)), (np.max, _most(spans))))
    if low < loop.low * (1 - 1e-12) or high > loop.high * (1 + 1e-12):
        yield f"the feed override leaves its limits, {loop.low:.4g} to {loop.high:.4g}: {low:.4g} to {high:.4g}"
    if design and not controller.worn and not controller.fault and not controller.overload:
        yield (
            f"a tool worn by {100 * (BEYOND - 1):.0f} % more than its limit is not signalled: the mean override does "
            f"not rest on {loop.low:.4g} for {loop.dwell:.3g} s; tune with less movement of the command, or lower dwell"
        )


def _least(spans: list[Span]) -> Span:
    return min(spans, key=lambda span: float(span.override.min()))


def _most(spans: list[Span]) -> Span:
    return max(spans, key=lambda span: float(span.override.max()))


def _cause(span: Span) -> str:
    causes = ("load lost", "load stuck", "no heartbeat", "feed unknown")
    return next((word for word in span.news if word in causes), "")


def _mean(load: Array, period: float) -> Array:
    """Mean over 0.2 s."""
    n = min(max(round(0.2 / period), 1), len(load))
    sums = np.cumsum(np.concatenate([[0.0], load]))
    return np.asarray((sums[n:] - sums[:-n]) / n, dtype=np.float64)


class Fault(NamedTuple):
    """A fault in mid-cut: name, reading in place of the load, whether the heartbeat goes on, s to its detection."""

    name: str
    reading: "Callable[[float], float] | None"
    beats: bool
    detection: float


def faults_of(loop: "LoadLoop", held: float) -> tuple[Fault, ...]:
    """The faults that the control monitors; ``held`` is the reading at which the sensor is stuck."""
    lost = loop.samples(loop.lost_after) * loop.sample_time
    found = [
        Fault("a reading that is not a number", lambda load: float("nan"), True, lost),
        Fault("a reading of zero", lambda load: 0.0, True, lost),
        Fault("a reading above load_high", lambda load: float("inf"), True, lost),
    ]
    if loop.stuck_after:
        found.append(
            Fault("a stuck reading", lambda load: held, True, loop.samples(loop.stuck_after) * loop.sample_time)
        )
    if loop.heartbeat:
        found.append(Fault("a source that stops", None, False, loop.samples(loop.heartbeat) * loop.sample_time))
    return tuple(found)


def simulate_fault(loop: "LoadLoop", middle: Bench, fault: Fault) -> str:
    """Failure of the answer to a fault in mid-cut, as a sentence; empty where it is safe."""
    bench = copy.deepcopy(middle)
    before = bench.controller.command
    allowed = fault.detection + 3 * loop.sample_time
    fall = (loop.high - loop.low) / loop.back_off
    span = bench.run(allowed + fall + 5 * loop.sample_time, reading=fault.reading, beats=fault.beats)
    rise = loop.recover * (allowed + loop.sample_time)
    if allowed + fall > SAFE_WITHIN + loop.stuck_after * (fault.name == "a stuck reading"):
        return (
            f"{fault.name} reaches the lower feed limit only after {allowed + fall:.3g} s, more than {SAFE_WITHIN:g} s"
        )
    if not bench.controller.fault or bench.controller.command > loop.low * (1 + 1e-9):
        return f"{fault.name} does not take the feed to its lower limit within {allowed + fall:.3g} s"
    if span.override.max() > min(before + rise, loop.high) + 1e-9:
        return f"{fault.name} raises the override from {before:.4g} to {span.override.max():.4g} before it is detected"
    bench.run(0.5)
    if not bench.controller.fault:
        return f"{fault.name} is not latched: the control goes on by itself when the reading returns"
    bench.controller.reset = True
    bench.run(loop.sample_time)
    return f"{fault.name} cannot be reset when the reading has returned" if bench.controller.fault else ""


SLOWED: Final = "the path is slowed"
HELD_FEED: Final = ("the load falls to that of air", "enable is lost", "the path stops", SLOWED)
SLOW_SHARE: Final = 0.5  # of the command, by the operator or in a corner
LOWEST_FEED: Final = ("spindle-on is lost", "the controller restarts")


def check_losses(middle: Bench) -> Iterator[FileFinding]:
    """Findings on losses in mid-cut that are no fault of the sensor: the feed must not rise, or be the lowest."""
    loop, wrong = middle.controller.loop, []
    for name in (*HELD_FEED, *LOWEST_FEED):
        bench = copy.deepcopy(middle)
        before, seconds, armed = bench.controller.command, 2.0, 1e-9
        if name == "the controller restarts":
            bench.controller = ConstantLoad(loop)
            before, seconds, armed = loop.low, loop.arm_after, loop.recover * loop.sample_time  # it may close at once
        controller = bench.controller
        controller.enabled = name != "enable is lost"
        controller.spindle_on = name != "spindle-on is lost"
        controller.idle, controller.slowed = name == "the path stops", name == SLOWED
        bench.share = (1.0, SLOW_SHARE)[controller.slowed]
        bench.cut.in_cut = name != "the load falls to that of air"
        overrides = bench.run(max(seconds, (before - loop.low) / loop.back_off + loop.sample_time)).override
        highest, last = float(overrides.max()), float(overrides[-1])
        if highest > before + armed:
            wrong.append(f"When {name} in mid-cut, the override rises from {before:.4g} to {highest:.4g}")
        elif name in LOWEST_FEED and last > loop.low + armed:
            wrong.append(
                f"When {name} in mid-cut, the override is {last:.4g} and not at its lower limit {loop.low:.4g}"
            )
    yield from (FileFinding("fault", False, f"{words}; nothing monitors the load then.") for words in wrong)
    if not wrong:
        words = (
            "In mid-cut the feed does not rise when the load falls to that of air, enable is lost, or the path stops "
            f"or is slowed to {100 * SLOW_SHARE:g} %; it goes to its lower limit when spindle-on is lost, and is there "
            "when the controller restarts."
        )
        yield FileFinding("fault", True, words)
