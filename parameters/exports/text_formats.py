"""Text files of single numbers: a C header, an ini file, and G-code parameters."""

from collections.abc import Sequence
from decimal import Decimal
from textwrap import wrap

from .names import c_text, gcode_text
from .quantities import Quantity
from .view import ExportView

NOT_IN_C = (
    "units as types: they are given in comments",
    "the covariance, the posterior and text of the laws",
    "the control itself: these are its constants; the exports c, st, comp and fmu are the control",
    "exact values on a compiler whose double has fewer than 53 bits",
)


def c_header(view: ExportView) -> str:
    """Content of the header file."""
    guard = f"FITMODELS_{view.name.upper()}_H"
    pair, *origin = view.origin
    head = [f"{view.made_by}: {pair}", *origin, *view.remarks(NOT_IN_C)]
    return "\n".join([
        *(f"/* {c_text(words)} */" for words in head),
        *(f"/* {line} */" for words in view.equations for line in wrap(c_text(words), 110)),
        f"#ifndef {guard}", f"#define {guard}", "",
        *(_c_line(q) for q in view.quantities), "",
        f"#endif /* {guard} */", "",
    ])  # fmt: skip


def _c_line(quantity: Quantity) -> str:
    words = c_text(f"{quantity.unit}: {quantity.words}")
    return f"static const double fm_{quantity.name} = {quantity.value!r}; /* {words} */"


NOT_IN_INI = (
    "structure: a law, a model and a loop are single numbers here",
    "the covariance, the posterior and text of the laws",
    "types: every value is text, numbers in 17 digits where they need them",
)


def _numbered(name: str, sentences: Sequence[str]) -> dict[str, str]:
    return {f"{name}_{place}": words for place, words in enumerate(sentences, 1)}


def ini_file(view: ExportView) -> str:
    """Content of the ini file."""
    about = {
        "made_by": view.made_by, "parameter_file": view.checksum, "tool": view.tool, "work": view.work,
        "machine": view.machine, "simulated": {True: "yes", False: "no", None: "unknown"}[view.simulated],
        **_numbered("verdict", view.verdicts), **_numbered("equation", view.equations),
        **_numbered("limit_of_use", view.limits_of_use), **_numbered("assumed", view.assumed),
        **_numbered("not_carried", NOT_IN_INI),
    }  # fmt: skip
    return "\n".join((
        _ini_section("about", about),
        _ini_section("values", {q.name: repr(q.value) for q in view.quantities}),
        _ini_section("units", {q.name: q.unit for q in view.quantities}),
        _ini_section("words", {q.name: q.words for q in view.quantities}),
    ))  # fmt: skip


def _ini_section(name: str, items: dict[str, str]) -> str:
    return f"[{name}]\n" + "".join(f"{key} = {_ini_value(text)}\n" for key, text in items.items())


def _ini_value(text: str) -> str:
    """One line that no reader takes for a comment, a reference or a continuation."""
    return " ".join(text.replace("%", "percent").replace(";", ",").replace("#", "_").split())


FIRST = 500  # common variables that most controls keep when switched off
MOST = 400  # of them
DIGITS = 40  # of a number; LinuxCNC takes lines of 255 characters

BRACKETS = str.maketrans("()", "[]")  # a parenthesis ends a comment

NOT_IN_GCODE = (
    "units: they are given in comments, and G20 or G21 is set by the program",
    "text, covariance and posterior: a parameter is a number",
    "the control itself: M52 P1 enables adaptive feed, the exports comp and hal control it",
    "numbers that take more than 40 digits without an exponent",
)


def gcode(view: ExportView) -> str:
    """G-code to be pasted above the first cut of a program.

    >>> fixed(1.5e-05), fixed(1000.0), fixed(-0.1)
    ('0.000015', '1000', '-0.1')
    """
    lines = [
        _gcode_comment(f"{view.made_by}, tool {view.tool}, work {view.work}"),
        *map(_gcode_comment, view.origin[1:-1]),
        _gcode_comment(f"parameter file {view.checksum}"),
        *map(_gcode_comment, view.limits_of_use),
        *(_gcode_comment(f"not included - {words}") for words in NOT_IN_GCODE),
        *(_gcode_comment(f"assumed - {words}") for words in view.assumed),
        *(_gcode_comment(line) for words in view.equations for line in wrap(words.translate(BRACKETS), 110)),
        *_gcode_numbers(view.quantities),
        *_gcode_feed(view),
    ]
    return "\n".join(["%", *lines, "%", ""])


def _gcode_numbers(quantities: tuple[Quantity, ...]) -> list[str]:
    lines = []
    for number, quantity in enumerate(quantities[:MOST], FIRST):
        value = fixed(quantity.value)
        words = f"{quantity.words}, {quantity.unit}"
        if len(value) > DIGITS:
            lines.append(_gcode_comment(f"{quantity.name} {words} - left out, {quantity.value:.3g}"))
            continue
        lines.append(f"#<_fm_{quantity.name}>={value} {_gcode_comment(words)}")
        lines.append(f"#{number}=#<_fm_{quantity.name}>")
    return lines


def _gcode_feed(view: ExportView) -> list[str]:
    if view.loop is None:
        return []
    loop = view.loop
    per_minute = ", in G94 and G21" if loop.unit_feed == "mm/min" else ""
    return [
        _gcode_comment(
            f"cut with F {loop.feed_programmed:.15g} {loop.unit_feed}{per_minute}, the control reduces it from there"
        ),
        _gcode_comment("adaptive feed scales rapids too, so it is off around them"),
        "M52 P0 " + _gcode_comment("adaptive feed off before a rapid"),
        _gcode_comment("write G0 here"),
        "M52 P1 " + _gcode_comment("adaptive feed on before a cut"),
        _gcode_comment("write G1 here, and repeat these lines for the next cut"),
        _gcode_comment("without M52 P1 before it a cut runs at the programmed feed, uncontrolled"),
    ]


def fixed(value: float) -> str:
    """A number without exponent that reads back to the same float."""
    text = format(Decimal(repr(value)), "f")
    return (text.rstrip("0").rstrip(".") if "." in text else text) or "0"


def _gcode_comment(words: str) -> str:
    """A comment that stays one, and no word that LinuxCNC acts on."""
    return f"(fm - {gcode_text(words.translate(BRACKETS))})"
