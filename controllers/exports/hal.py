"""LinuxCNC HAL: the loop from the machine's load pin to ``motion.adaptive-feed``, of LinuxCNC's own components.

It is the arithmetic of `fitmodels.controllers.ConstantLoad`, sample by sample, in the order of `_FUNCTIONS`:

    load -> held (last valid reading) -> filter -> engaged -> loaded -> cut
                                            |                           |
                                            +-> pid (from fm.bias) -> centre -> closed -> target -> limit -> feed

A wcomp gives True for NaN, so near(load, load) tests for a number. Its ``over`` is >=, so that ``max`` is the next
number where the condition is >. The delays and the counter switch half a
sample early, as sums of periods round. ``limit2.load`` and ``lowpass.load`` take the first value as it is.
"""

import math
from collections.abc import Iterable
from textwrap import wrap
from typing import Final

from ...core.errors import GateError
from ...datasets.units import is_unit, same_dimension
from ...parameters.exports.loop import LoadLoop
from ...parameters.exports.view import NOT_DETECTED, ExportView, first_lines
from ..constant_load_milling.control_laws import low_pass_gain
from ..constant_load_milling.controller import (
    OVERLOAD_MEAN,
    SPARSE_AT,
    SPARSE_MOST,
    SPARSE_RISE,
    WORN_MEAN,
    ConstantLoad,
)
from ..constant_load_milling.states import STATES
from ..gate import GatedControl

SERVO_PERIOD = 0.002  # s: a longer period than this is no servo thread; the loop then gets a thread of its own
STANDING = 1 / 60  # mm/s, 1 mm/min: a slower path does not advance
WIDTH = 110  # characters of a comment line

NOT_IN_HAL = (
    "the laws and their covariance, the posterior and the dynamics: HAL holds settings, not models",
    "units: every load is in the unit of the load pin",
    "a moving average and the form incremental_sum: the component (kind comp) has them",
    "a bound of the requested feed: the component (kind comp) has it",
)
_REAL_FEED: Final = (
    "The limits hold as shares: another F, or an operator's override other than 100 %, moves the real feed by the same "
    "factor, above 100 % beyond the upper limit. Below 100 % the loop raises its share until it holds the load again, "
    "and after the return to 100 % the feed is too large until the loop lowers it. The component (--to comp) does not."
)

_FUNCTIONS: Final = (
    ("standing", "comp"),
    ("number", "near"), ("range", "wcomp"), ("valid", "and2"), ("bad", "not"), ("lost", "timedelay"),
    ("turning", "timedelay"), ("armed", "and2"), ("unarmed", "not"), ("loose", "mux2"), ("sparse", "integ"),
    ("scattered", "comp"), ("held", "mux4"), ("filter", "lowpass"), ("mean", "lowpass"),
    ("over", "comp"), ("above", "comp"), ("engaged", "lut5"), ("loaded", "timedelay"),
    ("change", "ddt"), ("same", "near"), ("still", "lut5"), ("stuck", "timedelay"),
    ("first-beat", "flipflop"), ("beat", "xor2"), ("alive", "oneshot"),
    ("cause", "lut5"), ("fault", "flipflop"),
    ("high", "wcomp"), ("strained", "and2"), ("exceeded", "timedelay"), ("overload", "flipflop"),
    ("entry", "sum2"), ("bias", "mux2"), ("cut", "lut5"), ("pid", "pid"), ("centre", "sum2"),
    ("heavy", "wcomp"), ("unused", "lut5"), ("had-cut", "flipflop"),
    ("before", "mux2"), ("after", "mux2"), ("closed", "mux2"), ("stop", "lut5"), ("target", "mux2"),
    ("falling", "comp"), ("rate", "mux2"), ("limit", "limit2"), ("average", "lowpass"), ("begun", "flipflop"),
    ("above-rest", "wcomp"), ("rests", "lut5"), ("count", "mux2"), ("acknowledged", "oneshot"), ("clear", "lut5"),
    ("rested", "integ"), ("dwell", "comp"), ("worn", "flipflop"), ("inhibit", "or2"),
)  # fmt: skip
_BEFORE_USE = (
    "Before use:",
    "1. Load it after the machine's own HAL files (LinuxCNC 2.9 or newer). HAL loads a component once: where one of",
    "   those files loads pid or another one too, set TWOPASS = ON in section HAL of the ini file if that line has",
    "   names=, otherwise move the names beginning with fm. to it.",
    "2. Write the machine's pins on the lines marked >>>.",
    "3. Where motion.feed-inhibit is in use already, join both with an or2 instead of the last net.",
)
_STUCK = ("change", "same", "still", "stuck")
_HEARTBEAT = ("first-beat", "beat", "alive")

_INPUTS = """\
# The machine's pins. A signal that gets none stays FALSE or 0, and the loop off or at its lower limit.
# >>> net fm-load <= YOUR-LOAD-PIN            float, {unit}: {origin}
# >>> net fm-spindle-on <= spindle.0.on       bit: the spindle turns; where that pin has a signal, use its name below
# >>> net fm-velocity <= motion.current-vel   float, mm/s; on a machine in inches: setp fm.standing.in1 0.00066
"""
_HEARTBEAT_INPUT = """\
# >>> net fm-heartbeat <= YOUR-HEARTBEAT-PIN  bit: changes every {period:.6g} to {heartbeat:.6g} s; where there is
#     none: fitmodels settings --heartbeat 0, and a source that stops is found by its equal readings alone
"""
_SWITCHES = """\
# FALSE at first: a switch and a push button, or `halcmd sets fm-enable TRUE` on the running machine. The rising edge
# of fm-reset clears a fault, an overload and a worn tool whose cause is gone.
newsig fm-enable bit
newsig fm-reset bit
"""

_NETS = """\
# A valid reading is a number within its range; an invalid one leaves the last valid one in force.
net fm-load => fm.number.in1 fm.number.in2 fm.range.in fm.held.in1 fm.held.in3 fm.heavy.in
net fm-is-number fm.number.out => fm.valid.in0 fm.unused.in-3
net fm-in-range fm.range.out => fm.valid.in1 fm.unused.in-4
net fm-valid fm.valid.out => fm.bad.in fm.held.sel0
net fm-bad fm.bad.out => fm.lost.in fm.loose.sel
net fm-lost fm.lost.out => fm.cause.in-1

# Armed: switched on, and the spindle has turned long enough.
net fm-spindle-on => fm.turning.in
net fm-turning fm.turning.out => fm.armed.in0
net fm-enable => fm.armed.in1 fm.stop.in-2 fm.before.sel
net fm-armed fm.armed.out => fm.held.sel1 fm.engaged.in-0 fm.cause.in-0 fm.strained.in0 fm.unused.in-0
net fm-armed => fm.unarmed.in fm.stop.in-3

# More than a fifth of the readings invalid, each counted by 4 and a valid one by -1: lost too.
net fm-unarmed fm.unarmed.out => fm.sparse.reset
net fm-loose fm.loose.out => fm.sparse.in
net fm-sparse fm.sparse.out => fm.scattered.in1
net fm-scattered fm.scattered.out => fm.cause.in-4

# Idle: the path does not advance, also in a pause, a dwell, and at an override of 0.
net fm-velocity => fm.standing.in0
net fm-idle fm.standing.out => fm.cut.in-3

# Loaded: filtered load and reading above the threshold for long enough.
net fm-held fm.held.out => fm.held.in2 fm.filter.in fm.above.in1 fm.mean.in
net fm-filtered fm.filter.out => fm.over.in1 fm.pid.feedback fm.entry.in1
net fm-over fm.over.out => fm.engaged.in-1
net fm-above fm.above.out => fm.engaged.in-2
net fm-engaged fm.engaged.out => fm.loaded.in
net fm-loaded fm.loaded.out => fm.cut.in-0
"""
_STUCK_NETS = """
# Stuck: equal readings in the cut.
net fm-held => fm.change.in
net fm-change fm.change.out => fm.same.in1
net fm-same fm.same.out => fm.still.in-0
net fm-loaded => fm.still.in-1
net fm-idle => fm.still.in-2
net fm-still fm.still.out => fm.stuck.in
net fm-stuck fm.stuck.out => fm.cause.in-2
"""
_HEARTBEAT_NETS = """
# The source of the load is dead where its heartbeat does not change; the first value is no change.
net fm-heartbeat => fm.first-beat.data fm.beat.in0
net fm-first-beat fm.first-beat.out => fm.beat.in1
net fm-beat fm.beat.out => fm.alive.in
net fm-dead fm.alive.out-not => fm.cause.in-3
"""
_STATE_NETS = """
# Fault and overload: set while the cause is there, cleared by a rising edge of fm-reset without it.
net fm-cause fm.cause.out => fm.fault.set
net fm-mean fm.mean.out => fm.high.in
net fm-high fm.high.over => fm.strained.in1
net fm-strained fm.strained.out => fm.exceeded.in
net fm-exceeded fm.exceeded.out => fm.overload.set
net fm-reset => fm.fault.clk fm.overload.clk
net fm-fault fm.fault.out => fm.cut.in-1 fm.stop.in-0
net fm-overload fm.overload.out => fm.cut.in-2 fm.stop.in-1 fm.inhibit.in0

# Control: fm.bias runs before fm.cut, so that in a cut it holds the value of the cut's first sample.
net fm-cut fm.cut.out => fm.bias.sel fm.pid.enable fm.had-cut.set fm.closed.sel fm.rests.in-0 fm.clear.in-0
net fm-entry fm.entry.out => fm.bias.in0
net fm-bias fm.bias.out => fm.bias.in1 fm.pid.bias
net fm-pid fm.pid.output => fm.centre.in0
net fm-control fm.centre.out => fm.closed.in1

# After a cut the last feed holds, until the loop is off, the path stops and the load is below the threshold.
net fm-idle => fm.unused.in-1
net fm-heavy fm.heavy.over => fm.unused.in-2
net fm-unused fm.unused.out => fm.had-cut.reset
net fm-had-cut fm.had-cut.out => fm.after.sel

# Target: lower limit in a fault, in an overload, and switched on but not armed; else cut, after a cut, before one.
net fm-before fm.before.out => fm.after.in0
net fm-after fm.after.out => fm.closed.in0
net fm-closed fm.closed.out => fm.target.in0
net fm-stop fm.stop.out => fm.target.sel
net fm-target fm.target.out => fm.falling.in0 fm.limit.in
net fm-falling fm.falling.out => fm.rate.sel
net fm-rate fm.rate.out => fm.limit.maxv
net fm-feed fm.limit.out => fm.falling.in1 fm.after.in1 fm.entry.in0 fm.average.in motion.adaptive-feed

# TRUE in the first period only, when limit and average take their input as it is.
net fm-first fm.begun.out => fm.limit.load fm.average.load
sets fm-first TRUE

# Worn: samples in the cut with the mean feed on its lower limit; a reset counts its own sample (fm.rested.min).
net fm-average fm.average.out => fm.above-rest.in
net fm-above-rest fm.above-rest.over => fm.rests.in-1 fm.clear.in-1
net fm-rests fm.rests.out => fm.count.sel
net fm-count fm.count.out => fm.rested.in fm.rested.min
net fm-reset => fm.acknowledged.in fm.worn.clk
net fm-acknowledged fm.acknowledged.out => fm.clear.in-2
net fm-clear fm.clear.out => fm.rested.reset
net fm-rested fm.rested.out => fm.dwell.in1
net fm-dwell fm.dwell.out => fm.worn.set
net fm-worn fm.worn.out

net fm-inhibit fm.inhibit.out => motion.feed-inhibit
"""
_STOP_NET = "net fm-fault => fm.inhibit.in1\n"


def hal_file(control: GatedControl) -> str:
    """Content of the HAL file.

    Raises
    ------
    GateError
        The loop has a moving average or the form ``incremental_sum``.
    """
    view, loop = control.view, control.loop
    if loop.average > 1:
        raise GateError(
            f"the gains were tuned with a moving average of {loop.average} samples, which HAL does not have; use the "
            "component (kind comp), or tune with a filter_time instead."
        )
    if loop.form != "position":
        raise GateError(f"the gains have the form {loop.form}, which HAL does not have; use the component (kind comp).")
    functions = [(name, component) for name, component in _FUNCTIONS if name not in _left_out(loop)]
    thread, made = _thread(loop)
    unit, inputs = loop.unit_load, _INPUTS + (_HEARTBEAT_INPUT if loop.heartbeat else "") + "\n" + _SWITCHES
    parts = (
        _head(view, loop, thread),
        _loading(functions) + made,
        "".join(f"setp fm.{pin} {value}\n" for pin, value in settings_of(loop)),
        inputs.format(unit=unit, origin=load_origin(unit), heartbeat=loop.heartbeat, period=loop.sample_time),
        _NETS + (_STUCK_NETS if loop.stuck_after else "") + (_HEARTBEAT_NETS if loop.heartbeat else "") + _STATE_NETS
        + (_STOP_NET if loop.stop_on_fault else ""),
        "".join(f"addf fm.{name}{'.do-pid-calcs' * (name == 'pid')} {thread}\n" for name, _ in functions),
    )  # fmt: skip
    return "\n".join(parts)


def load_origin(unit: str) -> str:
    """Where a load in this unit is measured.

    Examples
    --------
    >>> load_origin("N"), load_origin("A")
    ('cutting force from its sensor', 'spindle current or load from the drive')
    """
    of_force = is_unit(unit) and same_dimension(unit, "N")
    return "cutting force from its sensor" if of_force else "spindle current or load from the drive"


def _left_out(loop: LoadLoop) -> tuple[str, ...]:
    """Names of the components of what is not monitored."""
    return (() if loop.stuck_after else _STUCK) + (() if loop.heartbeat else _HEARTBEAT)


def _loading(functions: Iterable[tuple[str, str]]) -> str:
    """One ``loadrt`` line for each component: HAL loads a component once."""
    names: dict[str, list[str]] = {}
    for name, component in functions:
        names.setdefault(component, []).append(f"fm.{name}")
    return "".join(f"loadrt {component} names={','.join(of)}\n" for component, of in names.items())


def _thread(loop: LoadLoop) -> tuple[str, str]:
    if loop.sample_time <= SERVO_PERIOD:
        return "servo-thread", ""
    return "fm-thread", f"loadrt threads name1=fm-thread period1={_period(loop)}\n"


def _period(loop: LoadLoop) -> int:
    return round(loop.sample_time * 1e9)


def settings_of(loop: LoadLoop) -> list[tuple[str, str]]:
    """Pins and parameters of the HAL file with their values, numbers in full precision.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from fitmodels.controllers.constant_load_milling.control_laws import loop_of
    >>> from fitmodels.parameters.published import published
    >>> dict(settings_of(replace(loop_of(published("CLM-2023")), reference=0.25)))["pid.command"]
    '0.25'
    """
    middle, half = (loop.low + loop.high) / 2, (loop.high - loop.low) / 2
    numbers = {  # an input that is not set is 0 or FALSE
        "standing.in1": STANDING,
        "range.min": loop.load_low, "range.max": loop.load_high,
        **_delay("lost", loop, loop.lost_after), **_delay("turning", loop, loop.arm_after),
        "loose.in0": -1.0, "loose.in1": float(SPARSE_RISE), "sparse.gain": 1 / loop.sample_time, "sparse.min": 0.0,
        "sparse.max": float(SPARSE_MOST * loop.samples(loop.lost_after)),
        "scattered.in0": SPARSE_AT * loop.samples(loop.lost_after) - 0.5,
        "filter.gain": low_pass_gain(loop, loop.filter_time), "mean.gain": low_pass_gain(loop, OVERLOAD_MEAN),
        "over.in0": loop.engage_at, "over.hyst": loop.hysteresis,
        "above.in0": loop.engage_at, "above.hyst": loop.hysteresis,
        **_delay("loaded", loop, loop.engage_after), **_delay("stuck", loop, loop.stuck_after),
        "alive.width": _early(loop, loop.heartbeat),
        "high.max": math.nextafter(loop.overload_at, math.inf), **_delay("exceeded", loop, loop.overload_after),
        "entry.gain1": -loop.entry_gain, "entry.offset": loop.entry_gain * loop.reference - middle,
        "pid.command": loop.reference, "pid.Pgain": loop.p, "pid.Igain": loop.i,
        "pid.maxoutput": half, "centre.offset": middle,
        "heavy.max": loop.engage_at - loop.hysteresis / 2,
        "before.in0": 1.0, "before.in1": loop.low, "target.in1": loop.low,
        "rate.in0": loop.recover, "rate.in1": loop.back_off,
        "limit.min": loop.low, "limit.max": loop.high,
        "average.gain": low_pass_gain(loop, WORN_MEAN),
        "above-rest.max": math.nextafter(ConstantLoad(loop).rest, math.inf),
        "count.in1": 1.0, "rested.gain": 1 / loop.sample_time, "dwell.in0": loop.samples(loop.dwell) - 0.5,
        "acknowledged.width": loop.sample_time / 2,
    }  # fmt: skip
    tables = {
        "engaged": 0x80,  # armed, over, above: all three
        "cause": 0xAAAAAAA8,  # armed, and one of lost, stuck, dead, scattered
        "still": 0x8,  # same, loaded, not idle
        "cut": 0x2,  # loaded, not fault, not overload, not idle
        "unused": 0x4000404,  # not armed, idle, not heavy, and a number: in range is true for NaN
        "stop": 0xEEFE,  # fault, overload, or switched on and not armed
        "rests": 0x2,  # in the cut, not above rest
        "clear": 0xF8,  # in the cut and above rest, or acknowledged
    }
    settings = [
        *((pin, repr(float(value))) for pin, value in numbers.items()),
        *((f"{name}.function", f"{value:#x}") for name, value in tables.items()),
        ("first-beat.clk", "TRUE"), ("alive.falling", "TRUE"), ("begun.reset", "TRUE"),
    ]  # fmt: skip
    return [(pin, value) for pin, value in settings if pin.split(".")[0] not in _left_out(loop)]


def _delay(name: str, loop: LoadLoop, time: float) -> dict[str, float]:
    return {f"{name}.on-delay": _early(loop, time), f"{name}.off-delay": 0.0}


def _early(loop: LoadLoop, time: float) -> float:
    """Half a sample before the whole number of samples of a time, s."""
    return (loop.samples(time) - 0.5) * loop.sample_time


def _head(view: ExportView, loop: LoadLoop, thread: str) -> str:
    servo = (
        f"The period of servo-thread must be {_period(loop)} ns: SERVO_PERIOD of the machine's ini file."
        if thread == "servo-thread"
        else f"The loop runs in a separate thread, {_period(loop)} ns; put this file after the one that loads motmod."
    )
    lines = [
        f"{view.made_by}: LinuxCNC HAL, constant load through motion.adaptive-feed",
        *_wrapped(first_lines(view, loop, _REAL_FEED)),
        f"tool {view.tool}, work {view.work}, machine {view.machine}{'; SIMULATED data' if view.simulated else ''}",
        *view.data,
        *view.verdicts,
        f"parameter file {view.checksum}",
        "",
        *_BEFORE_USE,
        f"4. The program commands F{loop.feed_programmed:.6g} ({loop.unit_feed}) and M52 P1; otherwise the feed",
        "   is not controlled. M52 P0 before rapids and M52 P1 after them: adaptive feed slows rapids too.",
        "5. Switch fm-enable on.",
        servo,
        "Order in one thread: motion-command-handler, what is added here, motion-controller. Behind motion-controller",
        "the feed is one period late, which is harmless.",
        "",
        *_states(loop),
        *_wrapped(f"Assumed: {words}" for words in view.assumed),
        *_wrapped(f"Not included: {words}" for words in NOT_IN_HAL),
        *_wrapped(f"{words[0].upper()}{words[1:]}." for words in NOT_DETECTED),
    ]
    return "".join(f"# {line}".rstrip() + "\n" for line in lines)


def _states(loop: LoadLoop) -> list[str]:
    """The table of states, and the times and loads of this file."""
    rows = [f"{row.state.name.lower()}: {row.condition}. Feed: {row.feed}. Time: {row.time}." for row in STATES]
    times = {
        "arm_after": loop.arm_after, "lost_after": loop.lost_after, "engage_after": loop.engage_after,
        "stuck_after": loop.stuck_after, "heartbeat": loop.heartbeat, "overload_after": loop.overload_after,
        "dwell": loop.dwell,
    }  # fmt: skip
    values = "Times: " + ", ".join(f"{name} {time:.6g} s" if time else f"{name} off" for name, time in times.items())
    loads = (
        f"Valid loads {loop.load_low:.6g} to {loop.load_high:.6g}, threshold {loop.engage_at:.6g} +- "
        f"{loop.hysteresis / 2:.6g}, overload {loop.overload_at:.6g} {loop.unit_load}; feed down {loop.back_off:.6g}, "
        f"up {loop.recover:.6g} of the programmed feed per s; a fault {'stops' if loop.stop_on_fault else 'lowers'} "
        "the feed."
    )
    return _wrapped(["States; where several apply, the last of them holds:", *rows, values + ".", loads, ""])


def _wrapped(texts: Iterable[str]) -> list[str]:
    return [line for text in texts for line in wrap(text, WIDTH, subsequent_indent="  ") or [""]]
