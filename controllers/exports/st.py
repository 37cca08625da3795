"""IEC 61131-3 structured text: the whole loop as one function block, called once a period.

The law is that of `fitmodels.controllers.ConstantLoad`, so of the HAL export: low-pass, comparator with delays, PI in
position form with its backward sum held at a limit, hard limits, and one rate downwards and another upwards. Until it
is enabled, outside the cut and with an invalid load the override is the programmed one, 1.
"""

import math

from ...core.errors import GateError
from ...parameters.exports.loop import LoadLoop
from ...parameters.exports.view import ExportView
from ..gate import GatedControl

LONGEST_NAME = 30  # significant characters of a name in older controllers
LONGEST_AVERAGE = 1000  # samples; each is moved in each period

NOT_IN_ST = (
    "the period of the task: set it to SAMPLE_TIME, the block does not measure it",
    "the wiring: the load and the feed override belong to the machine",
    "units as types: they are given in comments",
    "the laws and their covariance, the posterior and the dynamics",
    "the tool-change rule: watch feed_override staying at FEED_LOW",
)

_VARIABLES = """\
VAR_INPUT
  enable : BOOL := FALSE; (* off until it is switched on *)
  load : LREAL; (* {unit_load} *)
END_VAR
VAR_OUTPUT
  feed_override : LREAL := 1.0; (* feed over programmed feed *)
  cutting : BOOL := FALSE; (* the loop is closed *)
  known : BOOL := FALSE; (* the load is a reading *)
END_VAR
VAR
  reading : LREAL := 0.0;
  filtered : LREAL := 0.0;
  measured : LREAL := 0.0;
  above : BOOL := FALSE;
  loaded : BOOL := FALSE;
  waited : DINT := 0;
  needed : DINT := 0;
  deviation : LREAL := 0.0;
  total : LREAL := 0.0;
  asked : LREAL := 0.0;
  clipped : LREAL := 0.0;
  target : LREAL := 1.0;
  falling : BOOL := FALSE;
  most : LREAL := 0.0;
{average}END_VAR
"""

_LAW = """\
(* a load that is not a number, or out of its range, is unknown *)
known := (load > LOAD_LOW) AND (load < LOAD_HIGH);
reading := 0.0;
IF known THEN
  reading := load;
END_IF;
filtered := filtered + (reading - filtered) * FILTER_GAIN;
measured := filtered;
{average_load}
(* a cut is known by the load, after a delay for each direction *)
deviation := measured - ENGAGE_AT;
IF ABS(deviation) > HALF_HYSTERESIS THEN
  above := deviation > 0.0;
END_IF;
IF above = loaded THEN
  waited := 0;
ELSE
  waited := waited + 1;
  needed := DISENGAGE_SAMPLES;
  IF above THEN
    needed := ENGAGE_SAMPLES;
  END_IF;
  IF waited >= needed THEN
    loaded := above;
    waited := 0;
  END_IF;
END_IF;
cutting := enable AND known AND loaded;

(* PI about the middle of the limits; its sum holds while it is clipped and the error pushes further *)
IF cutting THEN
  deviation := HELD_LOAD - measured;
  IF deviation * clipped <= 0.0 THEN
    total := total + deviation * SAMPLE_TIME;
  END_IF;
  asked := CENTRED + KP * deviation + KI * total;
  clipped := 0.0;
  IF asked > HALF_SPAN THEN
    clipped := 1.0;
  END_IF;
  IF asked < -HALF_SPAN THEN
    clipped := -1.0;
  END_IF;
  target := MIDDLE + MIN(MAX(asked, -HALF_SPAN), HALF_SPAN);
ELSE
  total := 0.0;
  clipped := 0.0;
  target := 1.0;
END_IF;
{average_command}
(* hard limits, then the rate *)
IF target <> feed_override THEN
  falling := target < feed_override;
END_IF;
most := RECOVER * SAMPLE_TIME;
IF falling THEN
  most := BACK_OFF * SAMPLE_TIME;
END_IF;
target := MIN(MAX(target, FEED_LOW), FEED_HIGH);
feed_override := MIN(MAX(target, feed_override - most), feed_override + most);
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


def structured_text(control: GatedControl) -> str:
    """Content of the file with the function block.

    Raises
    ------
    GateError
        The moving average is too long for a period.
    """
    view, loop = control.view, control.loop
    if loop.average > LONGEST_AVERAGE:
        raise GateError(f"the gains average {loop.average} samples; a function block takes {LONGEST_AVERAGE} at most.")
    name = f"FB_{view.name}"[:LONGEST_NAME].rstrip("_")
    return "\n".join((
        f"{_head(view, loop)}FUNCTION_BLOCK {name}",
        _VARIABLES.format(unit_load=_comment(loop.unit_load), average=_average_variables(loop)) + _constants(loop),
        f"{_law(loop)}END_FUNCTION_BLOCK\n",
    ))  # fmt: skip


def real(value: float) -> str:
    """A real literal that reads back to the same float: digits on both sides of the point.

    >>> real(1e-05), real(300.0), real(-2.5e+20), real(1.5e-07)
    ('1.0E-05', '300.0', '-2.5E+20', '1.5E-07')
    """
    mantissa, _, exponent = repr(float(value)).partition("e")
    return (mantissa if "." in mantissa else f"{mantissa}.0") + (f"E{exponent}" if exponent else "")


def _law(loop: LoadLoop) -> str:
    """The statements, with the moving average where the loop has one."""
    of = {"measurement": "average_load", "command": "average_command"}.get(loop.average_of) if loop.average > 1 else ""
    return _LAW.format(
        average_load=_AVERAGE.format(of="measured") if of == "average_load" else "",
        average_command=_AVERAGE.format(of="target") if of == "average_command" else "",
    )


def _average_variables(loop: LoadLoop) -> str:
    if loop.average == 1:
        return ""
    at_rest = real(1.0 if loop.average_of == "command" else 0.0)
    return (
        f"  kept : ARRAY[0..{loop.average - 1}] OF LREAL := [{loop.average}({at_rest})];\n"
        "  place : DINT := 0;\n  mean : LREAL := 0.0;\n"
    )


def _constants(loop: LoadLoop) -> str:
    load, middle = loop.unit_load, (loop.low + loop.high) / 2
    gain = -math.expm1(-loop.sample_time / loop.filter_time) if loop.filter_time else 1.0
    reals = {
        "KP": (loop.p, f"override per {load}"), "KI": (loop.i, f"override per {load} and s"),
        "SAMPLE_TIME": (loop.sample_time, "s"), "HELD_LOAD": (loop.reference, load),
        "FEED_LOW": (loop.low, "override, above zero"), "FEED_HIGH": (max(loop.high, 1.0), "override"),
        "MIDDLE": (middle, "override, of the loop's limits"),
        "CENTRED": (1 - middle, "programmed override minus the middle"),
        "HALF_SPAN": ((loop.high - loop.low) / 2, "override"),
        "FILTER_GAIN": (gain, f"time constant {loop.filter_time:.6g} s"),
        "ENGAGE_AT": (loop.engage_at, load), "HALF_HYSTERESIS": (loop.hysteresis / 2, load),
        "BACK_OFF": (loop.back_off, "override per s"), "RECOVER": (loop.recover, "override per s"),
        "LOAD_LOW": (loop.load_low, load), "LOAD_HIGH": (loop.load_high, load),
    }  # fmt: skip
    counts = {"ENGAGE_SAMPLES": loop.samples(loop.engage_after), "DISENGAGE_SAMPLES": 1}
    counts |= {"AVERAGE": loop.average} if loop.average > 1 else {}
    lines = [f"  {name} : LREAL := {real(value)}; (* {_comment(unit)} *)\n" for name, (value, unit) in reals.items()]
    lines += [f"  {name} : DINT := {count}; (* samples *)\n" for name, count in counts.items()]
    return f"VAR CONSTANT\n{''.join(lines)}END_VAR\n"


def _head(view: ExportView, loop: LoadLoop) -> str:
    lines = (
        f"{view.made_by}: constant load, PI with limits, engagement and anti-windup",
        *view.origin,
        f"call once every {loop.sample_time:.15g} s; program F {loop.feed_programmed:.15g} {loop.unit_feed}",
        *view.remarks(NOT_IN_ST),
    )
    return "".join(f"(* {_comment(line)} *)\n" for line in lines)


def _comment(words: str) -> str:
    """Text that neither ends a comment nor begins another, nor a pragma or an escape."""
    return "".join(c if c.isalnum() or c in " ._+-/,:;=^()%" else "_" for c in words).strip()
