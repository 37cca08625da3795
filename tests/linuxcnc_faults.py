"""Faults injected into the whole LinuxCNC, what each must end in, and the figures of a trace."""

import math
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from fitmodels.controllers import ConstantLoad
from fitmodels.controllers.constant_load_milling.control_laws import loop_of
from fitmodels.controllers.constant_load_milling.cut_model import CutModel
from fitmodels.controllers.exports import rendered
from fitmodels.parameters import ParameterFile
from fitmodels.parameters.exports.loop import LoadLoop
from fitmodels.parameters.published import published
from linuxcnc_machine import PERIOD, Cut, Event, Run, compiled, run_machine

AT = 1.5  # s after the first contact: when a fault begins
PRINTED = 1e-5  # halsampler prints six decimals
STANDS = 1.05  # times the load that a worn tool withstands
LAG = 0.5  # s in which the load follows the feed through the drive
NOISE = 0.001  # A, half width of the reading's noise


@dataclass(frozen=True)
class Scenario:
    """A run and its outcome.

    Attributes
    ----------
    outcome : str
        ``fault``: lower limit, latched; ``stop``: feed inhibited; ``control``: nothing; ``hold``: the last feed at
        most; ``worn``: pin worn, lower limit; ``air``: the last feed until motion is idle, then the upper limit;
        ``bounded``: the real feed inside the limits, which HAL, with the override alone, cannot do.
    within : float
        s from the fault to its detection.
    changes : dict
        Settings of the engagement that differ.
    """

    name: str
    outcome: str
    events: tuple[Event, ...] = ()
    within: float = math.inf
    duration: float = 3.2
    wear: float = 150.0
    wear_rate: float = 0.0
    feed_share: float = 1.0
    override: float = 1.0
    length: float = 1000.0
    end: float = 1e9
    dwell: float = 1.1
    adaptive: bool = True
    operator: tuple[tuple[float, str], ...] = ()
    changes: dict[str, object] = field(default_factory=dict)


def _reading(
    name: str, value: float, outcome: str = "fault", within: float = 0.052, until: float = 1e6, duration: float = 3.2
) -> Scenario:
    return Scenario(name, outcome, (Event("value", AT, until, value),), within, duration)


SCENARIOS = (
    Scenario("no fault", "control"),
    _reading("NaN", math.nan),
    _reading("infinite", math.inf),
    _reading("zero", 0.0),
    _reading("negative", -0.3),
    _reading("out of range", 99.0),
    _reading("spike, 40 ms", 99.0, "control", until=AT + 0.04),
    _reading("loss to idle", 0.11584, "hold", math.inf),
    Scenario("zero, wear 224 um", "fault", (Event("value", AT, value=0.0),), 0.052, wear=224.0),
    Scenario("stuck", "fault", (Event("hold", AT),), 1.002, 4.0),
    _reading("stuck below the reference", 0.2, within=1.004, duration=4.5),
    Scenario(
        "NaN, loop of 20 ms in its own thread", "fault", (Event("value", AT, value=math.nan),), 0.062,
        changes={"sample_time": 0.02},
    ),
    Scenario("dead source", "fault", (Event("dead", AT),), 0.222),
    Scenario("spindle-on lost", "hold", (Event("spindle", AT),)),
    Scenario("enable lost", "hold", (Event("enable", AT),)),
    Scenario(
        "lost in mid-cut, healed; reset during and after", "fault",
        (Event("value", AT, AT + 0.6, 0.0), Event("reset", AT + 0.4, AT + 0.5), Event("reset", AT + 1.2, AT + 1.3)),
        0.052,
    ),
    Scenario("NaN, stop chosen", "stop", (Event("value", AT, value=math.nan),), 0.052, changes={"on_fault": "stop"}),
    Scenario("overload: load 1.4 times", "stop", (Event("load", AT, value=1.4),), 0.8),
    Scenario("wear until the change", "worn", wear=192.0, wear_rate=8.0, duration=6.3),
    Scenario("end of the cut, then the end of the program", "air", end=25.0, length=45.0, duration=7.5),
    Scenario("load pin never connected: 0 from the start", "fault", (Event("value", -1.0, value=0.0),), 0.0),
    Scenario("heartbeat never connected", "fault", (Event("beat", -1.0),), 0.0),
    Scenario("contact before the spindle has run for arm_after", "early", dwell=0.1, wear=190.0),
    Scenario(
        "M52 P1 missing in the program, load 1.2 times", "stop", (Event("load", AT, value=1.2),), 1.0, adaptive=False
    ),
    Scenario("operator's pause in the cut", "control", operator=((AT, "pause"), (AT + 1.0, "resume")), duration=4.5),
    Scenario(
        "operator's override 100, 150, 50, 100 % in the cut", "bounded", (Event("load", 0.0, value=0.85),), wear=0.0,
        operator=((AT, "1.5"), (AT + 1.0, "0.5"), (AT + 1.5, "1.0")), duration=4.5,
    ),
    Scenario("F twice that of the file", "bounded", feed_share=2.0),
    Scenario(
        "operator's override 120 %, load 0.85 times", "bounded", (Event("load", 0.0, value=0.85),),
        override=1.2, wear=0.0, duration=4.5,
    ),
)  # fmt: skip


def machine_file(**engagement: object) -> ParameterFile:
    """The published file of constant load with gains in the position form, for a servo thread of `PERIOD`."""
    content = published("CLM-2023").model_dump(mode="json", exclude_none=True)
    content.pop("content_sha256", None)
    content["pi"] = {
        "kp": 300.0, "ki": 8000.0, "sample_time": 0.02, "filter_time": 0.08, "unit_u": "mm/min", "unit_y": "A",
        "scaling_u": 1459.129,
    }  # fmt: skip
    line = content["load_line"]
    line["dwell"] = 1.5
    line["engagement"] = {"feed_programmed": 1000.0, "load_high": 1.0, "sample_time": PERIOD, **engagement}
    return ParameterFile.model_validate(content)


def run_of(scenario: Scenario, pf: ParameterFile, export: str, **modules: Path) -> Run:
    """The run of a scenario with the plant that the file implies."""
    cut, period = CutModel.from_parameters(pf), loop_of(pf).sample_time
    plant = Cut(
        cut.A, cut.B, cut.k1, cut.b, cut.a, divide=round(cut.sample_time / period), wear=scenario.wear,
        wear_rate=scenario.wear_rate, noise=NOISE, end=scenario.end,
    )  # fmt: skip
    programmed = pf.load_line.engagement.feed_programmed
    return Run(
        export, plant, programmed * scenario.feed_share, scenario.events, scenario.duration, scenario.override,
        scenario.length, scenario.dwell, scenario.adaptive, period,
        scenario.operator, modules,
    )  # fmt: skip


def run_all(runs: Sequence[Run], plant: Path, at_once: int = 2) -> list[dict[str, np.ndarray]]:
    """Traces of runs, in their order."""
    with ThreadPoolExecutor(at_once) as pool:
        return list(pool.map(lambda run: run_machine(run, plant), runs))


def followed(loop: LoadLoop, trace: dict[str, np.ndarray], *, requested: bool = False) -> dict[str, np.ndarray]:
    """The reference controller on the recorded inputs of a trace: override, fault, worn, overload, inhibit."""
    controller = ConstantLoad(loop)
    names = ("u", "fault", "worn", "overload", "inhibit")
    out = {name: np.zeros(len(trace["load"])) for name in names}
    for k, load in enumerate(trace["load"]):
        controller.enabled, controller.spindle_on = bool(trace["enable"][k]), bool(trace["spindle"][k])
        controller.idle, controller.beat = bool(trace["idle"][k]), bool(trace["beat"][k])
        controller.reset = bool(trace["reset"][k])
        if requested:
            controller.requested = float(trace["request"][k])
        u = controller.step(load, loop.sample_time)
        row = (u, controller.fault, controller.worn, controller.overload, controller.feed_inhibit)
        for name, value in zip(names, row, strict=True):
            out[name][k] = value
    return out


def closed(loop: LoadLoop, trace: dict[str, np.ndarray], run: Run) -> dict[str, np.ndarray]:
    """A replay in closed loop: the reference on a plant of the same equations, the feed without acceleration.

    Of the trace it takes the digital inputs, the events in force and the noise of the reading, not the load.
    """
    cut, controller = run.cut, ConstantLoad(loop)
    b, a = [*cut.b, 0.0, 0.0, 0.0][1:4], [*cut.a, 0.0, 0.0, 0.0][1:4]
    feeds, drives = [0.0] * 3, [0.0] * 3
    feed, u = 0.0, loop.low
    n = len(trace["load"])
    out = {name: np.zeros(n) for name in ("u", "feed", "current", "worn")}
    noise = _noise(n, cut.noise)
    moving = trace["request"] > 0
    for k in range(n):
        feed = u * run.feed * run.override if moving[k] else 0.0
        if k % cut.divide == 0:
            drive = sum(x * y for x, y in zip(b, feeds, strict=True)) - sum(
                x * y for x, y in zip(a, drives, strict=True)
            )
            feeds, drives = [feed, *feeds[:2]], [drive, *drives[:2]]
        current = cut.A + (cut.B * drives[0] + cut.k1 * trace["wear"][k] if trace["cutting"][k] else 0.0)
        load = round((current + noise[k]) * 1e5) / 1e5
        controller.enabled, controller.spindle_on = bool(trace["enable"][k]), bool(trace["spindle"][k])
        controller.idle, controller.beat = bool(trace["idle"][k]), bool(trace["beat"][k])
        u = controller.step(load, loop.sample_time)
        out["u"][k], out["feed"][k], out["current"][k], out["worn"][k] = u, feed, current, controller.worn
    return out


def _noise(n: int, half: float) -> np.ndarray:
    """Noise of the plant's generator, shape (n,)."""
    state, out = 0, np.zeros(n)
    for k in range(n):
        state = (state * 1103515245 + 12345) & 0x7FFFFFFF
        out[k] = half * (2.0 * state / 2147483648.0 - 1.0)
    return out


@dataclass(frozen=True)
class Figures:
    """Figures of a trace; times in s from the fault, None where it did not happen."""

    detected: float | None  # until a latched pin
    low: float | None  # until the override is at the lower limit
    before: float  # override at the fault
    most: float  # largest override afterwards
    bound: float  # override before plus recover rate times detection time
    most_feed: float  # mm/min, largest from contact with the work
    feed: float  # mm/min at the end
    load: float  # largest mean over 0.2 s of the current in A, from LAG after detection
    worn: float  # A: what a worn tool withstands
    released: float | None  # until the latched pin is off again


def figures(trace: dict[str, np.ndarray], loop: LoadLoop) -> Figures:
    """Figures of a trace whose fault began `AT` s after contact."""
    period = loop.sample_time
    first = int(np.argmax(trace["seconds"] >= AT - period / 2))
    latched = (trace["fault"] > 0) | (trace["overload"] > 0)
    after = {name: values[first:] for name, values in trace.items()}
    detected = _first(latched[first:])
    gone = None if detected is None else _first(~latched[first + detected :])
    seconds = None if detected is None else detected * period
    cutting = trace["cutting"] > 0
    begin = first + (detected or 0) + round(LAG / period)
    mean = _means(np.where(cutting, trace["current"], 0.0)[begin:], period)
    recover = loop.recover * (0.0 if seconds is None else seconds)
    before = float(trace["u"][first - 1])
    return Figures(
        detected=seconds,
        low=_seconds(_first(after["u"] <= loop.low + PRINTED), period),
        before=before, most=float(after["u"].max()), bound=before + recover,
        most_feed=float(trace["feed"][cutting].max()), feed=float(trace["feed"][-1]),
        load=float(mean.max()), worn=loop.worn_load,
        released=None if gone is None or detected is None else (detected + gone) * period,
    )  # fmt: skip


def _means(values: np.ndarray, period: float) -> np.ndarray:
    """Means over 0.2 s, shape (n - 0.2 s + 1,)."""
    n = round(0.2 / period)
    return np.convolve(values, np.full(n, 1 / n), "valid")


def _first(flags: np.ndarray) -> int | None:
    return int(np.argmax(flags)) if flags.any() else None


def _seconds(samples: int | None, period: float) -> float | None:
    return None if samples is None else samples * period


def loops_and_runs(scenarios: Sequence[Scenario], kind: str, folder: Path) -> tuple[list[LoadLoop], list[Run]]:
    """Loop and run of each scenario with an export of a kind, ``hal`` or ``comp``."""
    loops, runs = [], []
    for scenario in scenarios:
        pf = machine_file(**scenario.changes)
        loops.append(loop_of(pf))
        export, modules = exported(pf, kind, folder)
        runs.append(run_of(scenario, pf, export, **modules))
    return loops, runs


def exported(pf: ParameterFile, kind: str, folder: Path) -> tuple[str, dict[str, Path]]:
    """HAL text of an export, and the realtime components that it needs."""
    text = str(rendered(pf, kind, accept_verdict=True))
    if kind == "hal":
        return text, {}
    folder = Path(tempfile.mkdtemp(dir=folder))
    source = folder / "fm_control.comp"
    source.write_text(text)
    lines = [line.removeprefix("//| ") for line in text.splitlines() if line.startswith("//| ")]
    return "\n".join(lines) + "\n", {"fm_control": compiled(source)}


def unequal(scenario: Scenario, kind: str, trace: dict[str, np.ndarray], loop: LoadLoop) -> float:
    """Largest difference between the recorded override and that of the reference on the recorded inputs."""
    ours = followed(loop, trace, requested=kind == "comp")
    bits = any((ours[name] != trace[name]).any() for name in ("fault", "worn", "overload", "inhibit"))
    return math.inf if bits else float(np.abs(ours["u"] - trace["u"]).max())


def faults_of(scenario: Scenario, kind: str, trace: dict[str, np.ndarray], loop: LoadLoop) -> list[str]:
    """What in a trace is not as the scenario asks; empty where all is."""
    f = figures(trace, loop)
    wrong = _OUTCOMES[scenario.outcome](scenario, kind, trace, loop, f)
    share = trace["u"] * trace["request"] / loop.feed_programmed if kind == "comp" else trace["u"]
    share = share[trace["request"] > 0]
    if share.min() < loop.low - PRINTED or share.max() > loop.high + PRINTED:
        wrong.append(f"feed {share.min():.3f} to {share.max():.3f} of the programmed, outside the limits")
    if f.load > STANDS * f.worn and scenario.outcome != "bounded":
        wrong.append(f"{f.load:.3f} A")
    if unequal(scenario, kind, trace, loop) > PRINTED:
        wrong.append("differs from ConstantLoad")
    return wrong


def _fault(scenario, kind, trace, loop, f):
    wrong = _detected(scenario, loop, f)
    if f.most > f.bound + PRINTED:
        wrong.append(f"override {f.most:.4f} above {f.bound:.4f}")
    allowed = (f.detected or 0.0) + (loop.high - loop.low) / loop.back_off + 2 * loop.sample_time
    if f.low is None or f.low > allowed:
        wrong.append(f"lower limit after {f.low} s instead of {allowed:.3f} s")
    resets = [event.at for event in scenario.events if event.kind == "reset"]
    if resets:
        expected = max(resets) - AT
        if f.released is None or abs(f.released - expected) > 2 * loop.sample_time:
            wrong.append(f"released after {f.released} s instead of {expected:.3f} s")
    elif f.released is not None or trace["u"][-1] > loop.low + PRINTED:
        wrong.append("not latched at the lower limit")
    return wrong


def _stop(scenario, kind, trace, loop, f):
    wrong = _detected(scenario, loop, f)
    if not trace["inhibit"][-1] or f.feed > 0.5:
        wrong.append(f"feed {f.feed:.0f} mm/min instead of a stop")
    return wrong


def _detected(scenario, loop, f):
    if f.detected is None or f.detected > scenario.within + loop.sample_time:
        return [f"detected after {f.detected} s instead of {scenario.within} s"]
    return []


def _hold(scenario, kind, trace, loop, f):
    return [f"override {f.most:.4f} above the last, {f.before:.4f}"] if f.most > f.before + PRINTED else []


def _control(scenario, kind, trace, loop, f):
    wrong = [f"detected after {f.detected} s"] if f.detected is not None else []
    mean = trace["current"][-100:].mean()
    return [*wrong, *([f"{mean:.4f} A"] if abs(mean - loop.reference) > 0.02 * loop.reference else [])]


def _worn(scenario, kind, trace, loop, f):
    wrong = [] if trace["worn"][-1] and not trace["fault"].any() else ["no worn tool signalled"]
    return [*wrong, *([] if trace["u"][-1] <= loop.low + 0.01 else ["not at the lower limit"])]


def _air(scenario, kind, trace, loop, f):
    cut = np.flatnonzero(trace["cutting"])
    last = cut[-1]
    stop = last + int(np.argmax(trace["idle"][last:] > 0))
    wrong = []
    if trace["u"][last:stop].max() > trace["u"][last] + PRINTED:
        wrong.append("the feed rose on leaving the cut")
    requested = trace["request"][trace["request"] > 0][-1]  # of the rapid: the component keeps its share
    idle = trace["u"][-1] * (requested / loop.feed_programmed if kind == "comp" else 1.0)
    if abs(idle - loop.high) > 10 * PRINTED:
        wrong.append(f"override {idle:.3f} at idle instead of {loop.high:.3f}")
    return wrong


def _bounded(scenario, kind, trace, loop, f):
    exceeds = f.most_feed > loop.feed_high * 1.005
    if kind == "hal":  # stated in its head: an override cannot bound the real feed
        stopped = f.load <= STANDS * f.worn or trace["inhibit"][-1]
        return [] if exceeds and stopped else [f"{f.most_feed:.0f} mm/min, {f.load:.3f} A"]
    return [f"{f.most_feed:.0f} mm/min instead of at most {loop.feed_high:.0f}"] if exceeds else []


def _early(scenario, kind, trace, loop, f):
    armed = int(np.argmax(trace["spindle"] > 0)) + round(loop.arm_after / loop.sample_time)
    contact = int(np.argmax(trace["cutting"] > 0))
    wrong = [] if contact < armed else ["no contact before the controller is armed"]
    mean = _means(trace["current"][armed + round(LAG / loop.sample_time) :], loop.sample_time).max()
    if mean > STANDS * loop.worn_load or f.most_feed > 1.005 * loop.feed_high:
        wrong.append(f"{mean:.3f} A at {f.most_feed:.0f} mm/min")
    return [*wrong, *_control(scenario, kind, trace, loop, f)]


_OUTCOMES = {
    "early": _early,
    "fault": _fault, "stop": _stop, "hold": _hold, "control": _control, "worn": _worn, "air": _air,
    "bounded": _bounded,
}  # fmt: skip
