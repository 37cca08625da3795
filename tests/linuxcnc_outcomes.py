"""Figures of a trace of the whole LinuxCNC, its comparison with ConstantLoad, and the checks of each outcome."""

import math
from dataclasses import dataclass

import numpy as np
from fitmodels.controllers import ConstantLoad
from fitmodels.parameters.exports.loop import LoadLoop
from linuxcnc_faults import AT, Scenario
from linuxcnc_machine import Run

PRINTED = 1e-5  # halsampler prints six decimals
RESOLVED = 1e-3  # mm/min: the feed of the machine has reached its command
STANDS = 1.05  # times the load that a worn tool withstands
HALUI = 0.1  # s within which a change of the operator's override reaches its pin: 0.03 s were seen
FOLLOWS = 0.95  # of the commanded feed: the component takes a slower path for slowed
LAG = 0.5  # s in which the load follows the feed through the drive


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
            last = trace["u"][k - 1] if k else loop.low
            controller.slowed = not trace["feed"][k] >= FOLLOWS * trace["request"][k] * last  # at 50 % too
        u = controller.step(load, loop.sample_time)
        row = (u, controller.fault, controller.worn, controller.overload, controller.feed_inhibit)
        for name, value in zip(names, row, strict=True):
            out[name][k] = value
    return out


def closed(loop: LoadLoop, trace: dict[str, np.ndarray], run: Run) -> dict[str, np.ndarray]:
    """A replay in closed loop: the reference on a plant of the same equations.

    Of the trace it takes the digital inputs, the events in force and the noise of the reading, not the load, and the
    feed only while the path accelerates from rest, as the drive may take its next sample of the feed at any of these.
    """
    cut, controller = run.cut, ConstantLoad(loop)
    b, a = [*cut.b, 0.0, 0.0, 0.0][1:4], [*cut.a, 0.0, 0.0, 0.0][1:4]
    feeds, drives = [0.0] * 3, [0.0] * 3
    feed, u = 0.0, loop.low
    n = len(trace["load"])
    out = {name: np.zeros(n) for name in ("u", "feed", "current", "worn")}
    noise = _noise(n, cut.noise)
    moving = trace["request"] > 0
    reached = False
    for k in range(n):
        feed = u * run.feed * run.override if moving[k] else 0.0
        reached = bool(moving[k]) and (reached or trace["feed"][k] >= feed - RESOLVED)
        feed = feed if reached else trace["feed"][k]
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
    if f.load > STANDS * f.worn and scenario.outcome not in ("bounded", "again"):
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


def _again(scenario, kind, trace, loop, f):
    wrong = _stop(scenario, kind, trace, loop, f)
    stops = int((np.diff(trace["inhibit"]) > 0).sum())
    above = float((trace["current"] > STANDS * loop.worn_load).sum()) * loop.sample_time
    if stops != 2 or above > 2 * (scenario.within + LAG):
        wrong.append(f"{stops} stops, {above:.2f} s above {STANDS * loop.worn_load:.3f} A")
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
    stop = last + 1 + int(np.argmax(trace["idle"][last + 1 :] > 0))
    wrong = []
    if trace["u"][last:stop].max() > trace["u"][last] + PRINTED:
        wrong.append("the feed rose on leaving the cut")
    requested = trace["request"][trace["request"] > 0][-1]  # of the rapid: the component keeps its share
    idle = trace["u"][-1] * (requested / loop.feed_programmed if kind == "comp" else 1.0)
    if abs(idle - loop.low) > 10 * PRINTED:
        wrong.append(f"override {idle:.3f} at idle instead of {loop.low:.3f}")
    return wrong


def _bounded(scenario, kind, trace, loop, f):
    exceeds = f.most_feed > loop.feed_high * 1.005
    if kind == "hal":  # stated in its head: an override cannot bound the real feed
        stopped = f.load <= STANDS * f.worn or trace["inhibit"][-1]
        return [] if exceeds and stopped else [f"{f.most_feed:.0f} mm/min, {f.load:.3f} A"]
    above = trace["feed"] > loop.feed_high * 1.005  # halui publishes an override some periods after motion applies it
    seconds = float((above & (trace["cutting"] > 0)).sum()) * loop.sample_time
    return [f"{f.most_feed:.0f} mm/min, above {loop.feed_high:.0f} for {seconds:.3f} s"] if seconds > HALUI else []


def _early(scenario, kind, trace, loop, f):
    armed = int(np.argmax(trace["spindle"] > 0)) + round(loop.arm_after / loop.sample_time)
    contact = int(np.argmax(trace["cutting"] > 0))
    wrong = [] if contact < armed else ["no contact before the controller is armed"]
    mean = _means(trace["current"], loop.sample_time).max()
    if mean > STANDS * loop.worn_load or f.most_feed > 1.005 * loop.feed_high:
        wrong.append(f"{mean:.3f} A at {f.most_feed:.0f} mm/min")
    return [*wrong, *_control(scenario, kind, trace, loop, f)]


def _passes(scenario, kind, trace, loop, f):
    entries = np.flatnonzero(np.diff(trace["cutting"]) > 0)
    mean = _means(np.where(trace["cutting"] > 0, trace["current"], 0.0), loop.sample_time).max()
    wrong = [] if len(entries) == scenario.passes else [f"{len(entries)} passes"]
    wrong += [f"{mean:.3f} A"] if mean > STANDS * loop.worn_load else []
    return [*wrong, *(["a fault"] if f.detected is not None or trace["worn"].any() else [])]


def _pause(scenario, kind, trace, loop, f):
    contact = int(np.argmax(trace["cutting"] > 0))
    paused = contact + np.flatnonzero(trace["idle"][contact:] > 0)
    if not paused.size or trace["feed"][-1] < loop.feed_low * 0.99:
        return ["no pause, or no feed after it"]
    rise = trace["u"][paused].max() - trace["u"][paused[0]]
    mean = _means(trace["current"][contact:], loop.sample_time).max()
    wrong = [f"the feed rose by {rise:.4f} in the pause"] if rise > PRINTED else []
    wrong += [f"{mean:.3f} A"] if mean > STANDS * loop.worn_load else []
    return [*wrong, *(["a fault"] if f.detected is not None else [])]


_OUTCOMES = {
    "again": _again,
    "pause": _pause,
    "passes": _passes,
    "early": _early,
    "fault": _fault, "stop": _stop, "hold": _hold, "control": _control, "worn": _worn, "air": _air,
    "bounded": _bounded,
}  # fmt: skip
