"""Constant quantities of a file that are in no column: given by option, or written in its notes."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...core.errors import UsageError
from ...core.suggestions import closest
from ..units import canonical, convert, same_dimension
from ..vocabulary import ROLES

IN_NOTES = ("D", "Dc", "z", "n", "V")  # quantities that are constant in a series of tests more often than not
NEED_UNIT = ("n", "V")  # n = 3 is a number of repeats
_NUMBER = r"([-+]?(?:\d+(?:[.,]\d+)?|[.,]\d+))(?![\d.,]*\d)"
_UNIT = r"[ \t]*([^\s,;:()\[\]|]*)"
_RANGE = re.compile(r"\s*(?:to|bis|à|hasta|-|–|\.\.|…|±|/|and|und|et|y)\s*[\d.]")


@dataclass(frozen=True, slots=True)
class Given:
    """A constant in the unit of its role, and where it comes from.

    >>> str(Given("D", 80.0, "--value"))
    'D = 80 mm (--value)'
    """

    role: str
    value: float
    source: str

    def __str__(self) -> str:
        unit = ROLES[self.role].unit
        return f"{self.role} = {self.value:.6g}{'' if unit == '1' else ' ' + unit} ({self.source})"


def given_values(constants: Mapping[str, float], notes: Iterable[str]) -> dict[str, Given]:
    """Constants by role; one of an option takes precedence over the notes.

    Raises
    ------
    UsageError
        An option names no role, a label, or a value that is not above zero.

    >>> {role: given.value for role, given in given_values({}, ["Werkstückdurchmesser: 80 mm", "z = 4"]).items()}
    {'D': 80.0, 'z': 4.0}
    """
    found = from_notes(notes)
    for role, value in constants.items():
        if role not in ROLES or ROLES[role].kind == "label":
            near = closest(role, ROLES)
            hint = f"did you mean {near}? " if near else ""
            raise UsageError(f"--value {role}={value:g}: {role} is no quantity; {hint}Usual are D, Dc, z, n and V.")
        if value <= 0:
            raise UsageError(f"--value {role}={value:g}: give a number above zero, in {ROLES[role].unit}.")
        found[role] = Given(role, float(value), "--value")
    return found


def from_notes(notes: Iterable[str]) -> dict[str, Given]:
    """Constants that the notes state; one with two different values, or a range, is left out.

    >>> str(from_notes(["end mill, diameter 0.5 in; 4 teeth"])["D"])
    'D = 12.7 mm (notes)'
    """
    text = "\n".join(notes)
    found = {}
    for role in IN_NOTES if text else ():
        values = {value for pattern in _patterns(role) for value in _values(role, pattern, text)}
        if len(values) == 1:
            found[role] = Given(role, values.pop(), "notes")
    return found


@lru_cache(maxsize=8)
def _patterns(role: str) -> tuple[re.Pattern[str], ...]:
    """``D = 80``, ``diameter: 80`` and ``diameter 80 mm`` at the start of a phrase, ``4 teeth``."""
    words = [name for name in ROLES[role].names if len(name) > 3]
    symbols = [name for name in ROLES[role].names if len(name) <= 3 and name.isascii()]
    named = rf"(?:^|[,;:(#.=]|\b(?:and|und|et|y|with|mit))[ \t]*(?:{'|'.join(map(re.escape, words))})"
    short = rf"(?<![\w./])(?:{'|'.join(map(re.escape, symbols))})"
    patterns = [
        re.compile(rf"{named}[ \t]*(?:[^\W\d]{{1,2}}[ \t]*)?[:=]?[ \t]*{_NUMBER}{_UNIT}", re.IGNORECASE | re.MULTILINE),
        re.compile(rf"{short}[ \t]*[:=][ \t]*{_NUMBER}{_UNIT}"),
    ]
    if role == "z":
        counted = "teeth|flutes?|Zähne|Schneiden|dents|dientes"
        patterns.append(re.compile(rf"(?<![\w.,])(\d{{1,2}})[ -]?({counted})\b", re.IGNORECASE))
    return tuple(patterns)


def _values(role: str, pattern: re.Pattern[str], text: str) -> Iterable[float]:
    for match in pattern.finditer(text):
        value, unit = float(match[1].replace(",", ".")), ROLES[role].unit
        written = canonical(match[2].rstrip(".")) if match[2] else None
        if value <= 0 or _RANGE.match(text[match.end(1) :]):
            continue
        if written in (None, "1") and role in NEED_UNIT:
            continue
        if written in (None, "1", unit):
            yield value
        elif same_dimension(written, unit):
            yield float(convert(np.array([value]), written, unit)[0])
