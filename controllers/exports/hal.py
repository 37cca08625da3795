"""LinuxCNC HAL: the loop from the machine's load pin to ``motion.adaptive-feed``.

    load -> known? -> lowpass -> comp -> timedelay -> cut?
                         |                             |
                         +-> pid -> sum2 (centre) -> mux2 (1.0 outside the cut) -> limit2 -> motion.adaptive-feed

LinuxCNC's pid is ``bias + P e + I sum(e) T``, clipped to plus and minus maxoutput, its sum held while the output is
clipped and the error pushes further. For feeds between low and high, maxoutput is half their distance and sum2 adds
their middle.
"""

import math

from ...core.errors import GateError
from ...parameters.exports.loop import LoadLoop
from ...parameters.exports.view import ExportView
from ..gate import GatedControl

SERVO_PERIOD = 0.002  # s: a longer period than this is no servo thread; the loop then gets a thread of its own

NOT_IN_HAL = (
    "the laws and their covariance, the posterior and the dynamics: HAL holds settings, not models",
    "units: every load is in the unit of the load pin",
    "a moving average: such gains are rejected; HAL has lowpass",
    "the tool-change rule: watch fm-feed staying at its lower limit",
)

_LOAD = """\
loadrt near names=fm.finite
loadrt wcomp names=fm.range
loadrt and2 names=fm.known,fm.on,fm.cut
loadrt mux2 names=fm.load,fm.select,fm.rate
loadrt lowpass names=fm.filter
loadrt comp names=fm.engage,fm.falling
loadrt timedelay names=fm.delay
loadrt pid names=fm.pid
loadrt sum2 names=fm.centre
loadrt limit2 names=fm.limit
"""

_NETS = """\
# The machine's load pin. Without it the loop stays inactive: a load of 0 means no cut.
# >>> net fm-load <= YOUR-LOAD-PIN        (for instance a spindle current or load from the drive)
net fm-load fm.finite.in1 fm.finite.in2 fm.range.in fm.load.in1

# Off until it is switched on: wire a switch to fm-enable, or `halcmd sets fm-enable TRUE`.
newsig fm-enable bit
sets fm-enable FALSE
net fm-enable fm.on.in0

# A load that is not a number, or out of its range, is unknown: the feed is the programmed one.
net fm-finite fm.finite.out => fm.known.in0
net fm-in-range fm.range.out => fm.known.in1
net fm-known fm.known.out => fm.on.in1 fm.load.sel
net fm-read fm.load.out => fm.filter.in
net fm-filtered fm.filter.out => fm.engage.in1 fm.pid.feedback

net fm-above fm.engage.out => fm.delay.in
net fm-loaded fm.delay.out => fm.cut.in0
net fm-on fm.on.out => fm.cut.in1
net fm-cut fm.cut.out => fm.pid.enable fm.select.sel

net fm-pid fm.pid.output => fm.centre.in0
net fm-asked fm.centre.out => fm.select.in1
net fm-target fm.select.out => fm.falling.in0 fm.limit.in
net fm-falling fm.falling.out => fm.rate.sel
net fm-rate fm.rate.out => fm.limit.maxv
net fm-feed fm.limit.out => fm.falling.in1 motion.adaptive-feed
"""

_ORDER = (
    "finite", "range", "known", "load", "filter", "engage", "delay", "on", "cut", "pid.do-pid-calcs", "centre",
    "select", "falling", "rate", "limit",
)  # fmt: skip


def hal_file(control: GatedControl) -> str:
    """Content of the HAL file.

    Raises
    ------
    GateError
        The loop has a moving average.
    """
    view, loop = control.view, control.loop
    if loop.average > 1:
        raise GateError(
            f"the gains were tuned with a moving average of {loop.average} samples, which HAL does not have; tune them "
            "with a filter_time instead."
        )
    settings = "".join(f"setp {pin} {value}\n" for pin, value in _settings(loop))
    thread, made = _thread(loop)
    calls = "".join(f"addf fm.{function} {thread}\n" for function in _ORDER)
    return f"{_head(view, loop, thread)}\n{_LOAD}{made}\n{settings}\n{_NETS}\n{calls}"


def _thread(loop: LoadLoop) -> tuple[str, str]:
    if loop.sample_time <= SERVO_PERIOD:
        return "servo-thread", ""
    return "fm-thread", f"loadrt threads name1=fm-thread period1={_period(loop)} fp1=1\n"


def _period(loop: LoadLoop) -> int:
    return round(loop.sample_time * 1e9)


def _settings(loop: LoadLoop) -> list[tuple[str, str]]:
    """Pin or parameter -> value, in full precision."""
    middle, half = (loop.low + loop.high) / 2, (loop.high - loop.low) / 2
    gain = -math.expm1(-loop.sample_time / loop.filter_time) if loop.filter_time else 1.0
    numbers = {
        "fm.range.min": loop.load_low, "fm.range.max": loop.load_high, "fm.load.in0": 0.0,
        "fm.filter.gain": gain,
        "fm.engage.in0": loop.engage_at, "fm.engage.hyst": loop.hysteresis,
        # half a period less, as sums of periods round
        "fm.delay.on-delay": (loop.samples(loop.engage_after) - 0.5) * loop.sample_time,
        "fm.delay.off-delay": 0.0,
        "fm.pid.command": loop.reference, "fm.pid.Pgain": loop.p, "fm.pid.Igain": loop.i, "fm.pid.Dgain": 0.0,
        "fm.pid.bias": 1 - middle, "fm.pid.maxoutput": half,
        "fm.centre.offset": middle, "fm.select.in0": 1.0,
        "fm.rate.in0": loop.recover, "fm.rate.in1": loop.back_off,
        "fm.limit.min": loop.low, "fm.limit.max": max(loop.high, 1.0),
    }  # fmt: skip
    out = [(pin, repr(float(value))) for pin, value in numbers.items()]
    return [*out, ("fm.pid.error-previous-target", "FALSE")]


def _head(view: ExportView, loop: LoadLoop, thread: str) -> str:
    servo = (
        f"The period of servo-thread must be {_period(loop)} ns: SERVO_PERIOD of the machine's ini file."
        if thread == "servo-thread"
        else f"The loop runs in a separate thread, {_period(loop)} ns; put this file after the one that loads motmod."
    )
    lines = [
        f"{view.made_by}: LinuxCNC HAL, constant load through motion.adaptive-feed",
        f"tool {view.tool}, work {view.work}, machine {view.machine}{'; SIMULATED data' if view.simulated else ''}",
        *view.verdicts,
        f"parameter file {view.checksum}",
        "",
        "Before use:",
        "1. Load it after the machine's own HAL files. Where one of those loads a component that is loaded here, for",
        "   instance pid, move the names beginning with fm. to that line.",
        "2. Write the machine's load pin on the line marked >>>.",
        f"3. The program commands F{loop.feed_programmed:.15g} ({loop.unit_feed}) and M52 P1; otherwise the feed",
        "   is not controlled.",
        "4. Switch fm-enable on.",
        servo,
        "Order in one thread: motion-command-handler, what is added here, motion-controller. Behind motion-controller",
        "the feed is one period late, which is harmless.",
        "",
        f"Load {loop.reference:.6g} {loop.unit_load}; feed {loop.low:.4g} to {loop.high:.4g} of the programmed feed.",
        *(f"Assumed: {words}" for words in view.assumed),
        *(f"Not included: {words}" for words in NOT_IN_HAL),
    ]
    return "".join(f"# {line}".rstrip() + "\n" for line in lines)
