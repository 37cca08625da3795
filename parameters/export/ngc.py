"""G-code parameters: named ones for LinuxCNC, numbered ones for any control, and M52 P1.

A number in G-code has no exponent, so each is written out in full.
"""

from decimal import Decimal

from .quantities import Quantity
from .view import View

FIRST = 500  # common variables that most controls keep when switched off
MOST = 400  # of them
DIGITS = 40  # of a number; LinuxCNC takes lines of 255 characters

CANNOT = (
    "units: they stand in comments, and G20 or G21 is the programme's",
    "text, covariance and posterior: a parameter is a number",
    "the loop itself: M52 P1 lets HAL steer the feed, the hal export steers it",
    "numbers that take more than 40 digits without an exponent",
)


def render(view: View) -> str:
    """Give the G-code: to be pasted above the first cut of a programme.

    >>> fixed(1.5e-05), fixed(1000.0), fixed(-0.1)
    ('0.000015', '1000', '-0.1')
    """
    lines = [
        _comment(f"{view.made_by}, tool {view.tool}, work {view.work}"),
        *([_comment("SIMULATED data, not measured")] if view.simulated else []),
        _comment(f"parameter file {view.checksum}"),
        *(_comment(f"not carried - {words}") for words in CANNOT),
        *(_comment(f"assumed - {words}") for words in view.assumed),
        *_numbers(view.quantities),
        *_feed(view),
    ]
    return "\n".join(["%", *lines, "%", ""])


def _numbers(quantities: tuple[Quantity, ...]) -> list[str]:
    lines = []
    for number, quantity in enumerate(quantities[:MOST], FIRST):
        value = fixed(quantity.value)
        words = f"{quantity.words}, {quantity.unit}"
        if len(value) > DIGITS:
            lines.append(_comment(f"{quantity.name} {words} - left out, {quantity.value:.3g}"))
            continue
        lines.append(f"#<_fm_{quantity.name}>={value} {_comment(words)}")
        lines.append(f"#{number}=#<_fm_{quantity.name}>")
    return lines


def _feed(view: View) -> list[str]:
    if view.loop is None:
        return []
    return [
        _comment(f"cut with F {view.loop.feed_programmed:.15g} {view.loop.unit_feed}, HAL lowers it from there"),
        "M52 P1 " + _comment("adaptive feed on, HAL may steer the feed"),
    ]


def fixed(value: float) -> str:
    """A number without exponent that reads back to the same float."""
    text = format(Decimal(repr(value)), "f")
    return (text.rstrip("0").rstrip(".") if "." in text else text) or "0"


def _comment(words: str) -> str:
    """A comment that stays one: no parenthesis, no control character, no word that LinuxCNC acts on."""
    kept = "".join(c if c.isalnum() or c in " ._+-/,=^" else "_" for c in words)
    return f"(fm - {kept.encode('ascii', 'replace').decode()})"
