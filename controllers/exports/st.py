"""IEC 61131-3 structured text: the controller as one function block, called once a period.

The arithmetic is that of `fitmodels.controllers.ConstantLoad`, sample by sample; its states are those of
`constant_load_milling.states.STATES`. Counters stop at their limits, so that none overflows in weeks of running.
"""

import math
from textwrap import indent, wrap
from typing import Final

from ...core.errors import GateError
from ...parameters.exports.loop import LoadLoop
from ..constant_load_milling.controller import OVERLOAD_MEAN, REST_SHARE, WORN_MEAN
from ..constant_load_milling.states import STATES
from ..gate import GatedControl

LONGEST_NAME = 30  # significant characters of a name in older controllers
LONGEST_LINE, LARGEST_COUNT = 116, 2**31 - 1  # characters of a comment; value of a DINT

NOT_IN_ST: Final = (
    "the period of the task: set it to SAMPLE_TIME, the block does not measure it, and all its times scale with it",
    "numbers by IEEE 754: a comparison with a load that is not a number must be false",
    "a watchdog: a block that is no longer called keeps its last feed_override; use the watchdog of the task",
    "the requested feed: another programmed F, or an override above 100 %, scales the limits of the real feed",
    "the wiring: load, spindle, motion, heartbeat, feed override and feed inhibit belong to the machine",
    "units as types, which are given in comments; the laws and their covariance, the posterior and the dynamics",
)

_INTERFACE = """\
VAR_INPUT
  load : LREAL := 0.0; (* {unit_load} *)
  enable : BOOL := FALSE; (* off until it is switched on *)
  spindle_on : BOOL := FALSE; (* the spindle turns *)
  motion_idle : BOOL := FALSE; (* the path does not advance, also in a pause or dwell: without it they raise the feed *)
  beat : BOOL := FALSE; (* {beat} *)
  reset : BOOL := FALSE; (* its rising edge clears fault, worn and overload where their cause is gone *)
END_VAR
VAR_OUTPUT
  feed_override : LREAL := {low}; (* feed over programmed feed *)
  feed_inhibit : BOOL := FALSE; (* stop the feed *)
  state : DINT := {off}; (* one of the constants STATE_ *)
  fault : BOOL := FALSE; (* latched *)
  cause : DINT := 0; (* of the fault: one of the constants CAUSE_ *)
  worn : BOOL := FALSE; (* latched: change the tool *)
  overload : BOOL := FALSE; (* latched *)
END_VAR
"""
_FLAGS = (
    "started", "valid", "armed", "over", "above", "engaged", "loaded", "last_beat", "last_reset", "cleared",
    "cutting", "begins", "had_cut", "falling",
)  # fmt: skip
_COUNTERS = ("found", "bad", "running", "waited", "equal", "alive", "high_for", "rested")
_NUMBERS = (
    "previous", "held", "filtered", "measured", "mean_load", "deviation", "total", "asked", "clipped", "target", "most",
    "mean_feed",
)  # fmt: skip

_READ = """\
(* 1. a reading at or outside its limits is invalid; both comparisons are false for one that is not a number *)
valid := (load > LOAD_LOW) AND (load < LOAD_HIGH);
IF valid THEN
  bad := 0;
ELSIF bad < LOST_SAMPLES THEN
  bad := bad + 1;
END_IF;

(* 2. armed after the spindle has run *)
IF NOT spindle_on THEN
  running := 0;
ELSIF running < ARM_SAMPLES THEN
  running := running + 1;
END_IF;
armed := enable AND (running >= ARM_SAMPLES);

(* 3. the last valid reading, filtered *)
previous := held;
IF valid THEN
  held := load;
ELSIF NOT armed THEN
  held := 0.0;
END_IF;
filtered := filtered + (held - filtered) * FILTER_GAIN;
measured := filtered;
{average_load}mean_load := mean_load + (held - mean_load) * OVERLOAD_GAIN;

(* 4. engaged by the filtered load after a delay, disengaged at once by the reading too *)
deviation := measured - ENGAGE_AT;
over := (deviation > HALF_HYSTERESIS) OR (over AND (deviation >= -HALF_HYSTERESIS));
deviation := held - ENGAGE_AT;
above := (deviation > HALF_HYSTERESIS) OR (above AND (deviation >= -HALF_HYSTERESIS));
engaged := armed AND over AND above;
IF NOT engaged THEN
  waited := 0;
ELSIF waited < ENGAGE_SAMPLES THEN
  waited := waited + 1;
END_IF;
loaded := waited >= ENGAGE_SAMPLES;
"""

_WATCH = """
(* 5. faults and overload, latched; a reset clears each whose cause is gone *)
IF NOT (loaded AND NOT motion_idle AND (held = previous)) THEN
  equal := 0;
ELSIF equal < STUCK_SAMPLES THEN
  equal := equal + 1;
END_IF;
IF started AND (beat <> last_beat) THEN
  alive := BEAT_SAMPLES;
ELSIF alive > 0 THEN
  alive := alive - 1;
END_IF;
last_beat := beat;
found := 0;
IF armed AND (bad >= LOST_SAMPLES) THEN
  found := CAUSE_LOST;
ELSIF armed AND STUCK_MONITORED AND (equal >= STUCK_SAMPLES) THEN
  found := CAUSE_STUCK;
ELSIF armed AND BEAT_MONITORED AND (alive = 0) THEN
  found := CAUSE_NO_BEAT;
END_IF;
cleared := reset AND NOT last_reset;
last_reset := reset;
IF cleared OR NOT fault THEN
  cause := found;
END_IF;
fault := (found > 0) OR (fault AND NOT cleared);
IF NOT (armed AND (mean_load > OVERLOAD_AT)) THEN
  high_for := 0;
ELSIF high_for < OVERLOAD_SAMPLES THEN
  high_for := high_for + 1;
END_IF;
overload := (high_for >= OVERLOAD_SAMPLES) OR (overload AND NOT cleared);
IF cleared THEN
  worn := FALSE;
  rested := 0;
END_IF;

(* 6. after a cut the last feed is kept until the path stops and the load is below the threshold *)
begins := loaded AND NOT fault AND NOT overload AND NOT motion_idle AND NOT cutting;
cutting := loaded AND NOT fault AND NOT overload AND NOT motion_idle;
IF cutting THEN
  had_cut := TRUE;
ELSIF (NOT armed) AND motion_idle AND (load - ENGAGE_AT < -HALF_HYSTERESIS) THEN
  had_cut := FALSE;
END_IF;
"""

_POSITION = """
(* 7. PI from the last feed; its sum holds while it is clipped and the error pushes further *)
IF cutting THEN
  deviation := HELD_LOAD - measured;
  IF begins THEN
    bias := u + ENTRY_GAIN * deviation - MIDDLE;
    total := 0.0;
    clipped := 0.0;
{fill}  END_IF;
  IF deviation * clipped <= 0.0 THEN
    total := total + deviation * SAMPLE_TIME;
  END_IF;
  asked := bias + KP * deviation + KI * total;
  clipped := 0.0;
  IF asked > HALF_SPAN THEN
    clipped := 1.0;
  ELSIF asked < -HALF_SPAN THEN
    clipped := -1.0;
  END_IF;
  target := MIDDLE + MIN(MAX(asked, -HALF_SPAN), HALF_SPAN);
"""

_INCREMENTAL = """
(* 7. increments KP e + KI sum(e); the sum holds while the feed is clipped and the error pushes further *)
IF cutting THEN
  deviation := HELD_LOAD - measured;
  IF begins THEN
    last := u + ENTRY_GAIN * deviation;
    total := 0.0;
    clipped := 0.0;
{fill}  END_IF;
  IF deviation * clipped <= 0.0 THEN
    total := total + deviation;
  END_IF;
  asked := last + KP * deviation + KI * SAMPLE_TIME * total;
  clipped := 0.0;
  IF asked > FEED_HIGH THEN
    clipped := 1.0;
  ELSIF asked < FEED_LOW THEN
    clipped := -1.0;
  END_IF;
  target := MIN(MAX(asked, MAX(FEED_LOW, last - BACK_OFF * SAMPLE_TIME)), FEED_HIGH);
  last := MIN(target, last + RECOVER * SAMPLE_TIME);
  target := last;
"""

_FEED = """\
{average_command}ELSIF fault OR overload THEN
  target := FEED_LOW;
ELSIF had_cut THEN
  target := u;
ELSIF armed THEN
  target := FEED_LOW;
ELSE
  target := 1.0;
END_IF;

(* 8. limits, at once in the first call, then a rate downwards and another upwards *)
IF started THEN
  IF target <> u THEN
    falling := target < u;
  END_IF;
  most := RECOVER * SAMPLE_TIME;
  IF falling THEN
    most := BACK_OFF * SAMPLE_TIME;
  END_IF;
  target := MIN(MAX(target, FEED_LOW), FEED_HIGH);
  u := MIN(MAX(target, u - most), u + most);
ELSE
  u := MIN(MAX(target, FEED_LOW), FEED_HIGH);
  mean_feed := u;
  started := TRUE;
END_IF;

(* 9. worn: the mean feed rests on its lower limit in the cut; time outside the cut neither counts nor resets it *)
mean_feed := mean_feed + (u - mean_feed) * WORN_GAIN;
IF cutting THEN
  IF mean_feed > REST_AT THEN
    rested := 0;
  ELSIF rested < DWELL_SAMPLES THEN
    rested := rested + 1;
  END_IF;
  worn := worn OR (rested >= DWELL_SAMPLES);
END_IF;

(* 10. outputs *)
feed_override := u;
feed_inhibit := overload OR (fault AND STOP_ON_FAULT);
IF fault OR overload THEN
  state := STATE_FAULT;
ELSIF cutting AND worn THEN
  state := STATE_WORN;
ELSIF cutting THEN
  state := STATE_CONTROL;
ELSIF engaged THEN
  state := STATE_ENTRY;
ELSIF armed THEN
  state := STATE_AIR;
ELSE
  state := STATE_OFF;
END_IF;
"""

_AVERAGE = """\
FOR place := 0 TO AVERAGE - 2 DO
  kept[place] := kept[place + 1];
END_FOR;
kept[AVERAGE - 1] := {of};
mean := 0.0;
FOR place := 0 TO AVERAGE - 1 DO
  mean := mean + kept[place];
END_FOR;
{of} := mean / DINT_TO_LREAL(AVERAGE);
"""

_FILL = """\
FOR place := 0 TO AVERAGE - 1 DO
  kept[place] := u;
END_FOR;
"""


def structured_text(control: GatedControl) -> str:
    """Content of the file with the function block.

    Raises
    ------
    GateError
        A time of the loop has more samples than a DINT holds.
    """
    view, loop = control.view, control.loop
    name = f"FB_{view.name}"[:LONGEST_NAME].rstrip("_")
    variables = _variables(loop) + _constants(loop)
    return f"{_head(control)}FUNCTION_BLOCK {name}\n{variables}\n{_law(loop)}END_FUNCTION_BLOCK\n"


def real(value: float) -> str:
    """A real literal that reads back to the same float: digits on both sides of the point.

    >>> real(1e-05), real(300.0), real(-2.5e+20), real(1.5e-07)
    ('1.0E-05', '300.0', '-2.5E+20', '1.5E-07')
    """
    mantissa, _, exponent = repr(float(value)).partition("e")
    return (mantissa if "." in mantissa else f"{mantissa}.0") + (f"E{exponent}" if exponent else "")


def _law(loop: LoadLoop) -> str:
    """The statements, with the moving average where the loop has one."""
    of = loop.average_of if loop.average > 1 else ""
    control = _INCREMENTAL if loop.form == "incremental_sum" else _POSITION
    return (
        _READ.format(average_load=_AVERAGE.format(of="measured") if of == "measurement" else "")
        + _WATCH
        + control.format(fill=indent(_FILL, "    ") if of == "command" else "")
        + _FEED.format(average_command=indent(_AVERAGE.format(of="target"), "  ") if of == "command" else "")
    )


def _variables(loop: LoadLoop) -> str:
    monitored = f"changes at least every {loop.heartbeat:.6g} s while the source of the load lives"
    inside = [
        *(f"{name} : BOOL := FALSE" for name in _FLAGS),
        *(f"{name} : DINT := 0" for name in _COUNTERS),
        *(f"{name} : LREAL := 0.0" for name in (*_NUMBERS, "last" if loop.form == "incremental_sum" else "bias")),
        f"u : LREAL := {real(loop.low)}",
    ]
    if loop.average > 1:
        many = f"kept : ARRAY[0..{loop.average - 1}] OF LREAL := [{loop.average}(0.0)]"
        inside += [many, "place : DINT := 0", "mean : LREAL := 0.0"]
    interface = _INTERFACE.format(
        unit_load=_comment(loop.unit_load),
        beat=monitored if loop.heartbeat else "heartbeat of the source of the load, not monitored",
        low=real(loop.low),
        off=int(STATES[0].state),
    )
    return "".join((interface, "VAR\n", *(f"  {line};\n" for line in inside), "END_VAR\n"))


def _constants(loop: LoadLoop) -> str:
    lines = [
        f"  {name} : LREAL := {real(value)}; (* {_comment(unit)} *)\n" for name, (value, unit) in _reals(loop).items()
    ]
    lines += [f"  {name} : DINT := {count}; (* samples *)\n" for name, count in _counts(loop).items()]
    flags = {"STUCK_MONITORED": loop.stuck_after, "BEAT_MONITORED": loop.heartbeat, "STOP_ON_FAULT": loop.stop_on_fault}
    lines += [f"  {name} : BOOL := {str(bool(flag)).upper()};\n" for name, flag in flags.items()]
    numbers = {f"STATE_{row.state.name}": int(row.state) for row in STATES}
    numbers |= {"CAUSE_LOST": 1, "CAUSE_STUCK": 2, "CAUSE_NO_BEAT": 3}
    lines += [f"  {name} : DINT := {number};\n" for name, number in numbers.items()]
    return f"VAR CONSTANT\n{''.join(lines)}END_VAR\n"


def _reals(loop: LoadLoop) -> dict[str, tuple[float, str]]:
    """Constants of the law: value and unit."""
    load, span = loop.unit_load, loop.high - loop.low
    incremental = loop.form == "incremental_sum"
    gains = {
        "KP": (loop.p, f"override per {load}{' and sample' if incremental else ''}"),
        "KI": (loop.i, f"override per {load} and s{' and sample' if incremental else ''}"),
    }
    centre = {"MIDDLE": ((loop.low + loop.high) / 2, "override"), "HALF_SPAN": (span / 2, "override")}
    return {
        **gains, "SAMPLE_TIME": (loop.sample_time, "s"), "HELD_LOAD": (loop.reference, load),
        "ENTRY_GAIN": (loop.entry_gain or 0.0, f"override per {load}"),
        "FEED_LOW": (loop.low, "override, above zero"), "FEED_HIGH": (loop.high, "override"),
        **({} if incremental else centre),
        "FILTER_GAIN": (_gain(loop, loop.filter_time), f"time constant {loop.filter_time:.6g} s"),
        "OVERLOAD_GAIN": (_gain(loop, OVERLOAD_MEAN), f"time constant {OVERLOAD_MEAN:.6g} s"),
        "WORN_GAIN": (_gain(loop, WORN_MEAN), f"time constant {WORN_MEAN:.6g} s"),
        "LOAD_LOW": (loop.load_low, load), "LOAD_HIGH": (loop.load_high, load),
        "ENGAGE_AT": (loop.engage_at, load), "HALF_HYSTERESIS": (loop.hysteresis / 2, load),
        "OVERLOAD_AT": (loop.overload_at, load), "REST_AT": (loop.low + REST_SHARE * span, "override"),
        "BACK_OFF": (loop.back_off, "override per s"), "RECOVER": (loop.recover, "override per s"),
    }  # fmt: skip


def _gain(loop: LoadLoop, time: float) -> float:
    return -math.expm1(-loop.sample_time / time) if time else 1.0


def _counts(loop: LoadLoop) -> dict[str, int]:
    """Times in samples, no more than a DINT holds."""
    times = {
        "ARM": "arm_after", "LOST": "lost_after", "ENGAGE": "engage_after", "STUCK": "stuck_after", "BEAT": "heartbeat",
        "OVERLOAD": "overload_after", "DWELL": "dwell",
    }  # fmt: skip
    counts = {f"{name}_SAMPLES": loop.samples(getattr(loop, time)) for name, time in times.items()}
    for time, count in zip(times.values(), counts.values(), strict=True):
        if count > LARGEST_COUNT:
            raise GateError(
                f"{time}: {getattr(loop, time):g} s are {count} samples of {loop.sample_time:g} s; a counter of a PLC "
                f"(DINT) holds {LARGEST_COUNT} at most. Give a shorter time."
            )
    return counts | ({"AVERAGE": loop.average} if loop.average > 1 else {})


def _head(control: GatedControl) -> str:
    view, loop = control.view, control.loop
    rows = (
        f"state {int(row.state)} {row.state.name}: {row.condition}. Feed: {row.feed}. Time: {row.time}."
        for row in STATES
    )
    lines = (
        f"{view.made_by}: constant load, PI with limits, engagement, monitoring of the load, and tool change",
        *view.origin,
        f"call once every {loop.sample_time:.15g} s; program F {loop.feed_programmed:.15g} {loop.unit_feed}",
        *(line for words in (*rows, *view.remarks(NOT_IN_ST)) for line in wrap(words, LONGEST_LINE)),
    )
    return "".join(f"(* {_comment(line)} *)\n" for line in lines)


def _comment(words: str) -> str:
    """Text that neither ends a comment nor begins another, nor a pragma or an escape."""
    return "".join(c if c.isalnum() or c in " ._+-/,:;=^()%" else "_" for c in words).strip()
