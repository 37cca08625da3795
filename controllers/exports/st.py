"""IEC 61131-3 structured text: the controller as one function block, called once a period.

The arithmetic is that of `fitmodels.controllers.ConstantLoad`, sample by sample; its states are those of
`constant_load_milling.states.STATES`. Counters stop at their limits, so that none overflows in weeks of running.
"""

from collections.abc import Iterable
from pathlib import Path
from textwrap import indent, wrap
from typing import Final

from ...core.errors import GateError
from ...parameters.exports.loop import LoadLoop
from ...parameters.exports.names import c_text
from ...parameters.exports.view import first_lines
from ..constant_load_milling.control_laws import low_pass_gain
from ..constant_load_milling.controller import (
    OVERLOAD_MEAN,
    REST_SHARE,
    SLOW_AFTER,
    SPARSE_AT,
    SPARSE_MOST,
    SPARSE_RISE,
    WORN_MEAN,
)
from ..constant_load_milling.states import STATES, states_of
from ..gate import GatedControl
from .c_source import TITLES
from .fmu import Variable

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


def _statements() -> dict[str, str]:
    """Parts of the function block by name, from ``load_control.st``."""
    _, *parts = Path(__file__).with_name("load_control.st").read_text("ascii").rstrip().split("\n@")
    return {name: text + "\n" for name, _, text in (part.partition("\n") for part in parts)}


_TEXT: Final = _statements()
_FLAGS = (
    "started", "valid", "armed", "over", "above", "engaged", "loaded", "last_beat", "last_reset", "cleared",
    "cutting", "begins", "had_cut", "falling",
)  # fmt: skip
_COUNTERS = ("found", "bad", "sparse", "running", "waited", "equal", "alive", "high_for", "rested", "slow")
_NUMBERS = (
    "previous", "held", "filtered", "measured", "mean_load", "deviation", "total", "asked", "clipped", "target", "most",
    "mean_feed",
)  # fmt: skip


def structured_text(control: GatedControl) -> str:
    """Content of the file with the function block.

    Raises
    ------
    GateError
        A time of the loop has more samples than a DINT holds.
    """
    view, loop = control.view, control.loop
    name = _block_name(view.name)
    variables = _variables(loop) + _constants(loop)
    return f"{_head(control)}FUNCTION_BLOCK {name}\n{variables}\n{_law(loop)}END_FUNCTION_BLOCK\n"


def _block_name(name: str) -> str:
    return f"FB_{name}"[:LONGEST_NAME].rstrip("_")


def function_block(
    name: str, head: tuple[str, ...], variables: tuple[Variable, ...], constants: str, statements: str
) -> str:
    """Content of a file with one function block: its head as comments, its interface, constants and statements."""
    comments = "".join(f"(* {c_text(line)} *)\n" for line in head)
    return (
        f"{comments}FUNCTION_BLOCK {_block_name(name)}\n{_interface(variables)}"
        f"VAR CONSTANT\n{constants}END_VAR\n{statements}END_FUNCTION_BLOCK\n"
    )


def st_list(values: Iterable[float]) -> str:
    """Literals of an array."""
    return ", ".join(real(value) for value in values)


def _interface(variables: tuple[Variable, ...]) -> str:
    """Inputs and outputs of a function block."""
    kinds, out = {"Real": "LREAL", "Boolean": "BOOL", "Integer": "DINT"}, ""
    for causality, section in (("input", "VAR_INPUT"), ("output", "VAR_OUTPUT")):
        out += f"{section}\n"
        for v in variables:
            if v.causality == causality:
                unit = f", {v.unit}" if v.unit else ""
                out += f"  {v.name} : {kinds[v.kind]} := {v.start.upper()}; (* {c_text(v.words + unit)} *)\n"
        out += "END_VAR\n"
    return out


def real(value: float) -> str:
    """A real literal that reads back to the same float: digits on both sides of the point.

    >>> real(1e-05), real(300.0), real(-2.5e+20), real(1.5e-07)
    ('1.0E-05', '300.0', '-2.5E+20', '1.5E-07')
    """
    mantissa, _, exponent = repr(float(value)).partition("e")
    return (mantissa if "." in mantissa else f"{mantissa}.0") + (f"E{exponent}" if exponent else "")


def _pi(loop: LoadLoop, of: str) -> str:
    """The statements of the PI; ``of`` is the signal that is averaged."""
    control = _TEXT["incremental"] if loop.form == "incremental_sum" else _TEXT["position"]
    return control.format(fill=indent(_TEXT["fill"], "    ") if of == "command" else "")


def _law(loop: LoadLoop) -> str:
    """The statements, with the moving average where the loop has one."""
    of = loop.average_of if loop.average > 1 else ""
    whole, mean = loop.law == "adaptive", "by the mean of a revolution, as between teeth there is no force"
    read = _TEXT["read"].format(
        average_load=_TEXT["average"].format(of="measured") if of == "measurement" else "",
        engaged="" if whole else " AND above",
        leaving=mean if whole else "at once by the reading too",
    )
    average = indent(_TEXT["average"].format(of="target"), "  ") if of == "command" else ""
    if loop.law == "pi":
        feed = _TEXT["feed"].format(average_command=average, air=_TEXT["air"], rates=_TEXT["rates"])
        return read + _TEXT["watch"].format(anew="") + _pi(loop, of) + feed
    follow, closed = (
        _TEXT[name] for name in {"ratio": ("servo", "ratio"), "adaptive": ("revolution", "adaptive")}[loop.law]
    )
    feed = _TEXT["feed"].format(average_command=average, air=_TEXT["approach"], rates=_TEXT["free_rates"])
    closed = closed.format(repeated=_TEXT["repeated"])
    return read + _TEXT["clear"] + _TEXT["watch"].format(anew=_TEXT["anew"]) + follow + closed + feed


def _variables(loop: LoadLoop) -> str:
    monitored = f"changes at least every {loop.heartbeat:.6g} s while the source of the load lives"
    inside = [
        *(f"{name} : BOOL := FALSE" for name in _FLAGS),
        *(f"{name} : DINT := 0" for name in _COUNTERS),
        *(f"{name} : LREAL := 0.0" for name in (*_NUMBERS, *_own_numbers(loop))),
        f"u : LREAL := {real(loop.low)}",
    ]
    if loop.average > 1:
        many = f"kept : ARRAY[0..{loop.average - 1}] OF LREAL := [{loop.average}(0.0)]"
        inside += [many, "mean : LREAL := 0.0"]
    if loop.average > 1 or loop.law == "adaptive":
        inside += ["place : DINT := 0"]
    if loop.law != "pi":
        inside += ["clear_for : DINT := 0"]
    if loop.law == "ratio":
        inside += [f"servo : LREAL := {real(loop.low)}", "soft : BOOL := FALSE"]
    if loop.law == "adaptive":
        inside += _adaptive_variables(loop)
    interface = _TEXT["interface"].format(
        unit_load=_comment(loop.unit_load),
        beat=monitored if loop.heartbeat else "heartbeat of the source of the load, not monitored",
        low=real(loop.low),
        off=int(STATES[0].state),
    )
    return "".join((interface, "VAR\n", *(f"  {line};\n" for line in inside), "END_VAR\n"))


def _own_numbers(loop: LoadLoop) -> tuple[str, ...]:
    """Names of the real variables that one law has."""
    if loop.law == "ratio":
        return ("base",)
    if loop.law == "adaptive":
        return (
            "base", "wanted", "wanted_rate", "rate", "second", "ahead", "error", "change", "last_error", "force_sum",
            "model_sum", "before", "w0", "w1", "w2", "last_w0", "last_w1", "last_w2",
        )  # fmt: skip
    return ("last" if loop.form == "incremental_sum" else "bias",)


def _adaptive_variables(loop: LoadLoop) -> list[str]:
    rows = f"ARRAY[0..{loop.average}] OF LREAL := [{loop.average + 1}(0.0)]"
    return [
        *(f"{name} : {rows}" for name in ("forces", "model", "rates")),
        *(f"{name} : DINT := 0" for name in ("ring", "after", "newest", "gap", "gaps")),
        *(f"{name} : BOOL := FALSE" for name in ("closed", "limited")),
        *(f"{name} : LREAL := {real(getattr(loop, name))}" for name in ("m", "alpha", "beta")),
    ]


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
        "ENTRY_GAIN": (loop.entry_gain or 0.0, f"override per {load}"),
    }
    centre = {"MIDDLE": ((loop.low + loop.high) / 2, "override"), "HALF_SPAN": (span / 2, "override")}
    own = {**gains, **({} if incremental else centre)} if loop.law == "pi" else _reals_of_law(loop)
    return {
        **own, "SAMPLE_TIME": (loop.sample_time, "s"), "HELD_LOAD": (loop.reference, load),
        "FEED_LOW": (loop.low, "override, above zero"), "FEED_HIGH": (loop.high, "override"),
        "FILTER_GAIN": (low_pass_gain(loop, loop.filter_time), f"time constant {loop.filter_time:.6g} s"),
        "OVERLOAD_GAIN": (low_pass_gain(loop, OVERLOAD_MEAN), f"time constant {OVERLOAD_MEAN:.6g} s"),
        "WORN_GAIN": (low_pass_gain(loop, WORN_MEAN), f"time constant {WORN_MEAN:.6g} s"),
        "LOAD_LOW": (loop.load_low, load), "LOAD_HIGH": (loop.load_high, load),
        "ENGAGE_AT": (loop.engage_at, load), "HALF_HYSTERESIS": (loop.hysteresis / 2, load),
        "OVERLOAD_AT": (loop.overload_at, load), "REST_AT": (loop.low + REST_SHARE * min(span, loop.low), "override"),
        "BACK_OFF": (loop.back_off, "override per s"), "RECOVER": (loop.recover, "override per s"),
    }  # fmt: skip


def _reals_of_law(loop: LoadLoop) -> dict[str, tuple[float, str]]:
    approach = {"APPROACH": (loop.approach, "override in air")}
    if loop.law == "ratio":
        share = low_pass_gain(loop, loop.servo_time)
        return {**approach, "SERVO_GAIN": (share, f"time constant {loop.servo_time:.6g} s")}
    per = f"{loop.unit_feed} per {loop.unit_load}"
    return {
        **approach, "FEED_PROGRAMMED": (loop.feed_programmed, loop.unit_feed),
        "RATE_M": (loop.g1, "of adaptation"), "RATE_ALPHA": (loop.g2, "of adaptation"),
        "RATE_BETA": (loop.g3, "of adaptation"), "GAIN": (loop.Kd, f"{per} times s"), "LAMBDA": (loop.lam, "1 per s"),
        "MODEL_TIME": (loop.model_time, "s"), "MODEL_DAMPING": (loop.model_damping, "1"),
        "MODEL_A": (loop.model_a, "1"), "MODEL_B": (loop.model_b, "s"), "MODEL_C": (loop.model_c, "1 per s"),
        "MODEL_D": (loop.model_d, "1"),
    }  # fmt: skip


def _counts(loop: LoadLoop) -> dict[str, int]:
    """Times in samples, no more than a DINT holds."""
    times = {
        "ARM": "arm_after", "LOST": "lost_after", "ENGAGE": "engage_after", "STUCK": "stuck_after", "BEAT": "heartbeat",
        "OVERLOAD": "overload_after", "DWELL": "dwell",
    }  # fmt: skip
    counts = {f"{name}_SAMPLES": loop.samples(getattr(loop, time)) for name, time in times.items()}
    for time, count in zip(times.values(), counts.values(), strict=True):
        if count > LARGEST_COUNT / (2 * SPARSE_MOST if time == "lost_after" else 1):
            raise GateError(
                f"{time}: {getattr(loop, time):g} s are {count} samples of {loop.sample_time:g} s; a counter of a PLC "
                f"(DINT) holds {LARGEST_COUNT} at most. Give a shorter time."
            )
    counts["SLOW_SAMPLES"], lost = loop.samples(SLOW_AFTER), counts["LOST_SAMPLES"]
    sparse = {"SPARSE_RISE": SPARSE_RISE, "SPARSE_AT": SPARSE_AT * lost, "SPARSE_MOST": SPARSE_MOST * lost}
    average = {"AVERAGE": loop.average} if loop.average > 1 or loop.law == "adaptive" else {}
    return counts | sparse | average


def _head(control: GatedControl) -> str:
    view, loop = control.view, control.loop
    rows = (
        f"state {int(row.state)} {row.state.name}: {row.condition}. Feed: {row.feed}. Time: {row.time}."
        for row in states_of(loop.law)
    )
    lines = (
        f"{view.made_by}: {TITLES[loop.law]}, with limits, engagement, monitoring and tool change",
        *(line for words in first_lines(view, loop) for line in wrap(words, LONGEST_LINE)),
        *view.origin,
        f"call once every {loop.sample_time:.15g} s; program F {loop.feed_programmed:.15g} {loop.unit_feed}",
        *(line for words in (*rows, *view.remarks(NOT_IN_ST, safety=False)) for line in wrap(words, LONGEST_LINE)),
    )
    return "".join(f"(* {_comment(line)} *)\n" for line in lines)


def _comment(words: str) -> str:
    """Text that neither ends a comment nor begins another, nor a pragma or an escape."""
    return "".join(c if c.isalnum() or c in " ._+-/,:;=^()%" else "_" for c in words).strip()
