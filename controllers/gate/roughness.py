"""Gate of constant roughness, and the simulation of faults that it shares with adaptive force control.

The control runs on the cut of the file, kc a / ((tc s + 1)(ts s + 1)), with the disturbance of the replay.
"""

import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ...core.arrays import Array
from ...core.errors import FitmodelsError, GateError, ParameterError, UsageError
from ...datasets.plausibility.ranges import KC
from ...parameters.checks.report import FileFinding, require_verdicts
from ...parameters.exports.names import plain_lines
from ...parameters.exports.view import export_view
from ..roughness.controller import ConstantRoughness, assumed_settings, not_applied
from ..roughness.plant import TurningForce, loop_theory
from ..roughness.plausible import AGREE, contradictions
from ..roughness.reference import settings_of
from . import _MADE_BY_THE_GATE, GatedControl
from .settings import TIMES, WIDEST
from .simulation import SAFE_WITHIN, SLOW_SHARE, SLOWED, Fault, FileKey, faults_of

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.exports.loop import LoadLoop

SEED: Final = 20
DRAWS, SPREAD = 20, 0.3  # of the cut; relative, uniform
WRONG: Final = 0.05  # share of draws
HELD: Final = 0.04  # of the reference: deviation of the mean force at rest
LIMITED: Final = 0.95  # of the upper limit of the feed: a mean command so near it rests on it
USUAL: Final = 1.5  # times the programmed feed
_NEEDED: Final = "feed", "sample_time", "servo_time", "process_time", "force_per_feed"
BRIDGED: Final = 1.25  # times the feed before: the law on the last valid reading, until a fault is found


@dataclass(slots=True)
class ForceBench:
    """A force control on a cut."""

    controller: Any  # ConstantRoughness or AdaptiveForceControl
    plant: Any
    period: float
    rng: np.random.Generator
    share: float = 1.0  # of the command that the path has
    news: list[str] = field(default_factory=list)
    _beat: bool = False

    def __post_init__(self) -> None:
        """Let the heartbeat begin before the control is switched on."""
        self.controller.control.enabled = False
        self.run(3 * self.period)
        self.controller.control.enabled = True
        self.news = []

    def run(
        self, seconds: float, *, reading: Callable[[float], float] | None = None, beats: bool = True
    ) -> tuple[Array, Array]:
        """Commands and true forces of each sample; ``reading`` replaces what the sensor reads."""
        controller, control = self.controller, self.controller.control
        n = max(round(seconds / self.period), 1)
        commands, forces = np.empty(n), np.empty(n)
        for k in range(n):
            force = self.plant.step(self.share * controller.command, self.period, self.rng)
            self._beat = self._beat is not beats
            control.beat = self._beat
            commands[k] = controller.step(force if reading is None else reading(force), self.period)
            forces[k] = force
            self.news += controller.news
        return commands, forces


def fault_findings(middle: ForceBench) -> Iterator[FileFinding]:
    """Findings on faults of the sensor and on losses in mid-cut."""
    loop = middle.controller.control.loop
    still = (loop.engage_at + loop.hysteresis / 2 + loop.reference) / 2  # in the cut, and below the reference
    faults = [fault for fault in faults_of(loop, still) if fault.name != "a reading of zero"]
    faults.append(Fault("every second reading lost", _every_second(), True, 7 * _lost(loop)))
    wrong = [words for fault in faults if (words := _answer(middle, fault))]
    yield from (FileFinding("fault", False, f"{words[:1].upper()}{words[1:]}.") for words in wrong)
    if not wrong:
        names = ", ".join(fault.name for fault in faults)
        yield FileFinding(
            "fault", True, f"Each of these takes the feed to its lower limit, latched until reset: {names}."
        )
    rises = [words for name in _LOSSES if (words := _loss(middle, name))]
    yield from (FileFinding("fault", False, f"{words}; it must not rise.") for words in rises)
    if not rises:
        yield FileFinding("fault", True, f"The feed does not rise when in mid-cut {', or '.join(_LOSSES)}.")


def _lost(loop: "LoadLoop") -> float:
    return loop.samples(loop.lost_after) * loop.sample_time


def _every_second() -> Callable[[float], float]:
    turn = [False]

    def reading(force: float) -> float:
        turn[0] = not turn[0]
        return float("nan") if turn[0] else force

    return reading


def _answer(middle: ForceBench, fault: Fault) -> str:
    """Error in the answer to a fault in mid-cut; empty where it is safe."""
    bench = copy.deepcopy(middle)
    control, loop = bench.controller.control, bench.controller.control.loop
    before, allowed = bench.controller.command, fault.detection + 3 * loop.sample_time
    fall = (loop.high - loop.low) / loop.back_off
    if allowed + fall > SAFE_WITHIN + loop.stuck_after * (fault.name == "a stuck reading"):
        return f"{fault.name} reaches the lower feed limit only after {allowed + fall:.3g} s"
    commands, _ = bench.run(allowed + fall + 5 * loop.sample_time, reading=fault.reading, beats=fault.beats)
    if not control.fault or bench.controller.command > loop.feed_low * (1 + 1e-9):
        return f"{fault.name} does not take the feed to its lower limit within {allowed + fall:.3g} s"
    stuck = fault.name == "a stuck reading"
    most = BRIDGED * max(before, loop.feed_low)
    if stuck:  # its first sample is not known to stand still
        commands, most = commands[1:], before + loop.recover * loop.feed_high * (allowed + loop.sample_time)
    if commands.max() > most * (1 + 1e-9):
        return f"{fault.name} raises the feed from {before:.4g} to {commands.max():.4g} before it is detected"
    bench.run(0.5)
    if not control.fault:
        return f"{fault.name} is not latched: the control goes on by itself when the reading returns"
    control.reset = True
    bench.run(loop.sample_time)
    return f"{fault.name} cannot be reset when the reading has returned" if control.fault else ""


_LOSSES: Final = (
    "the force falls to zero", "the sign of the reading is reversed", "enable is lost", "spindle-on is lost",
    "the path stops", SLOWED,
)  # fmt: skip


def _loss(middle: ForceBench, name: str) -> str:
    bench = copy.deepcopy(middle)
    control, before = bench.controller.control, bench.controller.command
    control.enabled = name != "enable is lost"
    control.spindle_on = name != "spindle-on is lost"
    control.idle, control.slowed = name == "the path stops", name == SLOWED
    bench.share = (1.0, SLOW_SHARE)[control.slowed]
    readings = {_LOSSES[0]: lambda force: 0.0, _LOSSES[1]: lambda force: -force}
    highest = float(bench.run(2.0, reading=readings.get(name))[0].max())
    if control.fault and highest <= BRIDGED * before:
        return ""  # the last valid reading was in force until the fault
    return f"When {name} in mid-cut, the feed rises from {before:.4g} to {highest:.4g}" if highest > before else ""


def check_roughness(pf: "ParameterFile") -> tuple[FileFinding, ...]:
    """Findings of the gate on the roughness control of a file; none without its section.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> {finding.name for finding in check_roughness(published("SURF"))} >= {"simulation", "draws", "fault"}
    True
    """
    return () if pf.roughness is None else _findings(FileKey(pf, {"roughness", "laws", "limits"}))


@lru_cache(maxsize=16)
def _findings(same: FileKey) -> tuple[FileFinding, ...]:
    pf = same.pf
    try:
        ConstantRoughness.from_parameters(pf)
        TurningForce.from_parameters(pf)
    except (ParameterError, UsageError) as error:
        incomplete = any(getattr(pf.roughness, name) is None for name in _NEEDED)
        words = f"The roughness control was not simulated: {error}"
        return (FileFinding("control", None if incomplete else False, words),)
    try:
        findings = list(_order(pf))
        if not any(finding.passed is False for finding in findings):
            findings += _simulated(pf)
    except (ArithmeticError, ValueError) as error:
        words = f"its numbers are too large or too small to simulate ({error}); check times, forces and feeds."
        return (_failed("control", words),)
    return tuple(findings)


def _order(pf: "ParameterFile") -> Iterator[FileFinding]:
    """Findings on limits, units and times against each other."""
    wrong = [_failed(name, words) for name, words in contradictions(pf)]
    if wrong:
        yield from wrong
        return
    yield FileFinding("roughness", True, AGREE)
    section, control = settings_of(pf), ConstantRoughness.from_parameters(pf)
    gain, tc, ts = section.force_per_feed or 0.0, section.process_time or 0.0, section.servo_time or 0.0
    if control.high > WIDEST * control.low:
        words = f"The feed limits {control.low:.4g} to {control.high:.4g} mm/rev are more than {WIDEST:g}-fold apart"
        yield _failed("limits", f"{words}; raise override_low or lower override_high.")
    if control.high > USUAL * control.programmed * (1 + 1e-9):
        times = control.high / control.programmed
        words = f"The upper feed limit is {times:.3g} times the programmed feed: no run is known to have cut at it."
        yield FileFinding("limits", None, words)
    yield from (FileFinding("limits", None, words) for words in not_applied(pf))
    needed = control.reference / gain
    if not control.low < needed < control.high:
        yield _failed(
            "units",
            f"At the reference of {control.reference:.4g} N a cut of {gain:.4g} N per mm/rev has a feed of "
            f"{needed:.4g} mm/rev, outside the limits {control.low:.4g} to {control.high:.4g}: check the units "
            "of feed, force and force_per_feed.",
        )
    if section.depth is not None and not KC.hard[0] < gain / section.depth < KC.hard[1]:
        yield _failed(
            "units",
            f"force_per_feed over depth is a specific cutting force of {gain / section.depth:.4g} N/mm2, outside "
            f"{KC.hard[0]:g} to {KC.hard[1]:g}: check the units of feed, force and depth.",
        )
    if not (TIMES["sample_time"][0] <= control.sample_time <= min(tc, ts) / 2):
        yield _failed(
            "times",
            f"A sample time of {control.sample_time:.4g} s does not follow a servo of {ts:.4g} s and a process of "
            f"{tc:.4g} s: at most half of the shorter one.",
        )
    if gain * control.low < control.threshold:
        yield FileFinding(
            "threshold",
            None,
            f"At the lower feed limit a sharp tool has a force of {gain * control.low:.3g} N, below the threshold of "
            f"{control.threshold:.3g} N: after power-on in the cut the feed rises slowly until the force is above it.",
        )


def _failed(name: str, words: str) -> FileFinding:
    return FileFinding(name, False, f"Roughness control: {words}")


def _bench(
    pf: "ParameterFile",
    *,
    seed: int = SEED,
    approached: bool = True,
    **plant: Any,  # noqa: ANN401
) -> ForceBench:
    control = ConstantRoughness.from_parameters(pf)
    if approached:
        control.approached()
    cut = TurningForce.from_parameters(pf, feed=control.command)
    return ForceBench(
        control, replace(cut, **plant) if plant else cut, control.sample_time, np.random.default_rng(seed)
    )


def _simulated(pf: "ParameterFile") -> Iterator[FileFinding]:
    section = settings_of(pf)
    bench = _bench(pf)
    bench.run(3.0 + 12 * ((section.servo_time or 0.0) + (section.process_time or 0.0)))
    commands, forces = bench.run(5.0)
    wrong = wrong_at_rest(bench, commands, forces, bench.controller.reference)
    if wrong:
        yield _failed("simulation", f"simulated on the cut of the file, {wrong}.")
        return
    yield FileFinding(
        "simulation",
        True,
        f"Simulated on the cut of the file, the mean force is {forces.mean():.4g} N at a reference of "
        f"{bench.controller.reference:.4g} N and a feed of {commands.mean():.3g} mm/rev.",
    )
    yield from _draws(pf)
    yield from _power_on(pf)
    yield from fault_findings(bench)


def wrong_at_rest(bench: ForceBench, commands: Array, forces: Array, reference: float) -> str:
    """Error of a force control that should be at rest in the cut; empty where there is none.

    A smaller force at the upper limit of the feed is none.
    """
    control = bench.controller.control
    if control.overload:
        return "the control ends in an overload"
    if control.fault:
        return "the control ends in a fault"
    if not control.cutting:
        return "the control does not begin: the force stays below the threshold"
    if control.worn:
        return "a sharp tool is signalled as worn: the feed rests on its lower limit"
    limited = forces.mean() < reference and commands.mean() > LIMITED * control.loop.feed_high
    if abs(forces.mean() / reference - 1) > HELD and not limited:
        return f"the mean force is {forces.mean():.4g} at a reference of {reference:.4g}"
    return ""


def _draws(pf: "ParameterFile") -> Iterator[FileFinding]:
    """Cuts that differ from the file: gain and both time constants, for which it states no covariance."""
    section, rng = settings_of(pf), np.random.default_rng(SEED + 1)
    failed = 0
    for k in range(DRAWS):
        factors = 1 + SPREAD * rng.uniform(-1, 1, 3)
        tc, ts = (section.process_time or 0.0) * factors[1], (section.servo_time or 0.0) * factors[2]
        bench = _bench(pf, seed=k, gain=(section.force_per_feed or 0.0) * factors[0], tc=tc, ts=ts, hold=tc)
        bench.run(4.0)
        failed += bool(wrong_at_rest(bench, *bench.run(4.0), bench.controller.reference))
    radius = loop_theory(section.process_time or 0.0, section.servo_time or 0.0, section.sample_time or 0.0)
    words = f"of {DRAWS} cuts with force per feed and both time constants changed by up to {100 * SPREAD:.0f} %"
    if failed > WRONG * DRAWS:
        yield _failed("draws", f"{words}, {failed} are not held; identify the cut again, or widen the feed limits.")
    else:
        pole = f"largest pole by the file {radius.servo_radius:.3g}."
        held = f"{DRAWS - failed} are held, or have less force at the upper feed limit; {pole}"
        yield FileFinding("draws", True, f"{words[:1].upper()}{words[1:]}, {held}")


def _power_on(pf: "ParameterFile") -> Iterator[FileFinding]:
    """A power cycle in a cut twice as stiff as that of the file, and in that of the file with a reversed sensor."""
    gain = settings_of(pf).force_per_feed or 0.0
    bench = _bench(pf, approached=False, gain=2 * gain)
    loop = bench.controller.control.loop
    commands, forces = bench.run(6.0)
    least = 2 * gain * loop.feed_low  # no control can be below it
    low = loop.feed_low * (1 + 1e-9)
    if commands[0] > low or forces.max() > 1.5 * max(bench.controller.reference, least):
        yield _failed("fault", f"a power cycle in the cut gives a force of {forces.max():.4g} N.")
    else:
        words = f"After a power cycle in a cut twice as stiff the feed starts at {loop.feed_low:.3g} mm/rev and the"
        yield FileFinding("fault", True, f"{words} force stays below {forces.max():.4g} N.")
    commands, _ = _bench(pf, approached=False).run(6.0, reading=lambda force: -force)
    if commands[-1] > low:
        words = f"a power cycle in the cut with a reversed sensor raises the feed to {commands.max():.4g} mm/rev"
        yield _failed("fault", f"{words}, as if in air; raise force_low.")


def roughness_lacks(pf: "ParameterFile") -> str:
    """Reason why a file does not support the roughness control; empty where it does."""
    if pf.roughness is None:
        return "the file has no roughness section; add it with `fitmodels roughness`."
    try:
        ConstantRoughness.from_parameters(pf)
    except FitmodelsError as error:
        return str(error)
    return ""


def gated_roughness(pf: "ParameterFile", *, accept_verdict: bool = False, per_minute: bool = False) -> GatedControl:
    """The roughness control of a file, once it has passed the gate; ``per_minute`` with its feed in mm/min.

    Raises
    ------
    GateError
        The file fails the check or the gate, lacks a setting, or its law must not be used for control.
    """
    try:
        control, section = ConstantRoughness.from_parameters(pf), settings_of(pf)
    except FitmodelsError as error:
        raise GateError(f"not exported: {error}") from None
    loop = control.loop
    if per_minute:
        if section.spindle_speed is None:
            raise GateError(
                "not exported: LinuxCNC compares feeds in mm/min, and the roughness section has no spindle_speed; "
                "give it with `fitmodels roughness`."
            )
        factor = section.spindle_speed
        loop = replace(
            loop, unit_feed="mm/min", feed_low=loop.feed_low * factor, feed_high=loop.feed_high * factor,
            feed_programmed=loop.feed_programmed * factor,
        )  # fmt: skip
    held = require_verdicts(pf, accept_verdict, only=(section.law,))
    assumed = assumed_settings(pf)
    if per_minute:
        assumed = (*assumed, f"the spindle turns at {section.spindle_speed:g} 1/min, so the feed is in mm/min")
    return gated(pf, loop, check_roughness(pf), held, assumed)


def gated(
    pf: "ParameterFile", loop: "LoadLoop", found: tuple[FileFinding, ...], verdicts: tuple[str, ...],
    assumed: tuple[str, ...],
) -> GatedControl:  # fmt: skip
    """The control of a force loop whose findings do not fail."""
    require_passed(found)
    if not any(finding.name == "simulation" and finding.passed for finding in found):
        raise GateError(f"not exported: {found[0].words if found else 'the control was not simulated.'}")
    view = export_view(pf, accept_verdict=True, loop_only=True)
    doubts = tuple(words for words in view.assumed if words.startswith("the data are right"))
    open_ = tuple(finding.words for finding in found if finding.passed is None)
    lines = tuple(line for words in (*verdicts, *open_) for line in plain_lines(words))
    view = replace(view, loop=loop, gains=None, plant=None, verdicts=lines, assumed=(*doubts, *assumed))
    return GatedControl(view, loop, _key=_MADE_BY_THE_GATE)


def require_passed(found: tuple[FileFinding, ...]) -> None:
    """Raise GateError where a finding fails, with the first of them."""
    refused = [finding for finding in found if finding.passed is False]
    if refused:
        more = f" {len(refused) - 1} more: see `fitmodels check`." if len(refused) > 1 else ""
        raise GateError(f"not exported: {refused[0].words}{more}")
