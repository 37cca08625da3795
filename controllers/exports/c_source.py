"""The controller in C: ``load_control.c`` with the settings of one tool, for firmware.

The LinuxCNC component and the FMU contain the same text. Its arithmetic is that of
`fitmodels.controllers.ConstantLoad`.
"""

from pathlib import Path
from textwrap import wrap
from typing import Final

from ...parameters.exports.loop import LoadLoop
from ...parameters.exports.names import c_text
from ...parameters.exports.view import ExportView, first_lines
from ..constant_load_milling.states import states_of
from ..gate import GatedControl

NOT_IN_C = (
    "the wiring: the firmware fills LoadInput and applies LoadOutput",
    "the period of the calls: call it every sample_time, and pass the measured period",
    "units as types: they are given in comments",
    "the laws and their covariance, the posterior and the dynamics",
)

_NUMBERS = (
    "sample_time", "reference", "low", "high", "feed_programmed", "p", "i", "entry_gain", "filter_time", "engage_at",
    "hysteresis", "engage_after", "arm_after", "lost_after", "stuck_after", "heartbeat", "overload_after", "dwell",
    "worn_load", "back_off", "recover", "load_low", "load_high",
)  # fmt: skip
_OF_LAWS = (
    "approach", "servo_time", "m", "alpha", "beta", "g1", "g2", "g3", "Kd", "lam", "model_time", "model_damping",
    "model_a", "model_b", "model_c", "model_d",
)  # fmt: skip
LAWS: Final = ("pi", "ratio", "adaptive")  # in the order of LoadLaw
TITLES: Final = {
    "pi": "constant load by feed override",
    "ratio": "constant roughness by feed override",
    "adaptive": "adaptive force control by feed override",
}
_UNITS: Final = {
    **dict.fromkeys(("reference", "engage_at", "hysteresis", "worn_load", "load_low", "load_high"), "{load}"),
    **dict.fromkeys(("low", "high", "approach", "model_damping", "model_a", "model_d"), "1"),
    "m": "({feed})/({load}) s2",
    **dict.fromkeys(("alpha", "Kd"), "({feed})/({load}) s"),
    "beta": "({feed})/({load})",
    **dict.fromkeys(("g1", "g2", "g3"), "rate of adaptation"),
    "lam": "1/s",
    "model_c": "1/s2",
    **dict.fromkeys(("p", "entry_gain"), "1/({load})"),
    **dict.fromkeys(("back_off", "recover"), "1/s"),
    "i": "1/({load})/s",
    "feed_programmed": "{feed}",
}  # the others are s


def c_file(control: GatedControl) -> str:
    """Content of the C file."""
    return c_comment(c_head(control, NOT_IN_C)) + c_controller(control.loop)


def c_controller(loop: LoadLoop) -> str:
    """The source with the settings of a loop as ``load_settings``."""
    source = Path(__file__).with_name("load_control.c").read_text("ascii")
    declared, defined = f"extern const LoadSettings load_settings;\n\n{_AFTER}", f"\n{_settings(loop)}#endif\n"
    average = f"#define LOAD_CONTROL_AVERAGE {loop.average}\n"
    body = source.replace(_AFTER, declared, 1).removesuffix("#endif\n")
    return f"{average}{body}{defined}"


WIDTH: Final = 116  # characters of a line in a comment
_AFTER: Final = "/* 0, or the number of the first setting"


def c_settings(loop: LoadLoop) -> dict[str, float]:
    """The settings in the order of ``LoadSettings``; a zero has no sign."""
    return {
        **{name: float(getattr(loop, name)) + 0.0 for name in _NUMBERS},
        "average": loop.average,
        "average_command": int(loop.average_of == "command"),
        "incremental": int(loop.form == "incremental_sum"),
        "stop_on_fault": int(loop.stop_on_fault),
        "law": LAWS.index(loop.law),
        **{name: float(getattr(loop, name)) + 0.0 for name in _OF_LAWS},
    }


def _settings(loop: LoadLoop) -> str:
    lines = []
    for name, value in c_settings(loop).items():
        unit = _UNITS.get(name, "s").format(load=loop.unit_load, feed=loop.unit_feed)
        number = f"(LoadReal){value!r}" if isinstance(value, float) else f"{value}"
        lines.append(f"    {number}, /* {name}{', ' + c_text(unit) if isinstance(value, float) else ''} */\n")
    return f"const LoadSettings load_settings = {{\n{''.join(lines)}}};\n"


def c_head(control: GatedControl, not_carried: tuple[str, ...]) -> tuple[str, ...]:
    """Lines of the head: origin, units, states, limits of use, assumptions and what is not carried."""
    view, loop = control.view, control.loop
    words = (
        f"load in {loop.unit_load}, feed in {loop.unit_feed}, override = feed / {loop.feed_programmed:.15g}",
        f"one call each {loop.sample_time:g} s",
        *(f"state {int(row.state)} {row.state.name}: {row.condition}; feed: {row.feed}" for row in states_of(loop.law)),
        *view.remarks(not_carried, safety=False),
    )
    return head_lines(view, f"{TITLES[loop.law]}, controller in C", words, first_lines(view, loop))


def head_lines(view: ExportView, title: str, words: tuple[str, ...], first: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Lines of a head: program and title, what comes first, origin, and the words in lines of ``WIDTH``."""
    above, below = ([part for line in of for part in wrap(line, WIDTH, subsequent_indent="    ")]
                    for of in (first, words))  # fmt: skip
    return (f"{view.made_by}: {title}", *above, *view.origin, *below)


def c_comment(lines: tuple[str, ...]) -> str:
    """A C comment of these lines."""
    return "/*\n" + "".join(f" * {c_text(line)}\n" for line in lines) + " */\n"


def with_settings(name: str, declared: str, before: str, defined: str) -> str:
    """A C source of this folder with its settings declared before a comment and defined at the end."""
    source = Path(__file__).with_name(name).read_text("ascii")
    body = source.replace(before, f"{declared}\n{before}", 1).removesuffix("#endif\n")
    return f"{body}\n{defined}#endif\n"
