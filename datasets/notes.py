"""Statements of notes, name and headers of a file: pair, conditions, constants, response and unit of time."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
import pandas as pd

from ..core.errors import UsageError
from ..core.suggestions import closest
from .headers import parse_header
from .tables import Table
from .tables.blocks import ASSIGNMENT
from .units import canonical, convert, is_unit, same_dimension
from .vocabulary import MEASURED, ROLES, UNNAMED, fits, role_of

_TOKEN = re.compile(r"(?<![A-Za-z])([A-Za-z]{1,3})[=-]?(\d+(?:[.,p]\d+)?)(?![\d.,]*[A-Za-z\d])")
_KINDS = ("condition", "other")
_MOST_WORDS = 8  # of the name of a response
IN_NOTES = ("D", "Dc", "z", "n", "V")  # quantities that are constant in a series of tests more often than not
NEED_UNIT = ("n", "V")  # n = 3 is a number of repeats
_NUMBER = r"([-+]?(?:\d++(?:[.,]\d++)?+|[.,]\d++))(?![\d.,]*\d)"
_UNIT = r"[ \t]*+([^\s,;:()\[\]|]*+)"
_VALUE = r"(?:\s*+[:;,|=]|[^\S\t]*+\t)\s*+(\S.*)"  # what follows the name of an entry
_MACHINES = (
    "machine", "machine tool", "lathe", "milling machine", "Maschine", "Werkzeugmaschine", "Drehmaschine",
    "Fräsmaschine", "machine-outil", "máquina", "máquina herramienta", "máquina-herramienta",
)  # fmt: skip
_MACHINE = re.compile(rf"[\s#%]*+(?:{'|'.join(map(re.escape, _MACHINES))}){_VALUE}", flags=re.IGNORECASE)
_NEXT_ENTRY = re.compile(r"[;|\t](?=[^;|\t:=]*[:=])")  # between the entries of one note: "work: C45; machine: CTX"
_RANGE = re.compile(r"\s*(?:to|bis|à|hasta|-|–|\.\.|…|±|/|and|und|et|y)\s*+[\d.]")


def pair_name(role: str, frame: pd.DataFrame, notes: tuple[str, ...]) -> str:
    """Name of tool or work: from its column, from a note ``tool: GC435``, or the placeholder.

    >>> pair_name("tool", pd.DataFrame(), ("Werkzeug: GC435",))
    'GC435'
    >>> [pair_name(role, pd.DataFrame(), ("Werkstoff: C45; Werkzeug: P25",)) for role in ("work", "tool")]
    ['C45', 'P25']
    """
    if role in frame:
        names = [name for name in dict.fromkeys(frame[role]) if name]
        return names[0] if len(names) == 1 else "several" if names else UNNAMED[role]
    for entry in _entries(notes):
        if match := _entry(role).match(entry):
            name = match[1].strip(" ;,|\t:")
            if name:
                return name
    return UNNAMED[role]


def machine_name(notes: Iterable[str]) -> str:
    """The machine that a note names (``machine: Makino V33``); empty where none does.

    >>> machine_name(("# Werkzeugmaschine: Gildemeister CTX", "machine time 5 min"))
    'Gildemeister CTX'
    """
    found = (match[1].strip(" ;,|\t:") for entry in _entries(notes) if (match := _MACHINE.match(entry)))
    return next(filter(None, found), "")


def _entries(notes: Iterable[str]) -> Iterator[str]:
    """The entries of notes, of which a line may hold several."""
    return (entry for note in notes for entry in _NEXT_ENTRY.split(note))


@cache
def _entry(role: str) -> re.Pattern[str]:
    """A note that names a role and a value."""
    words = "|".join(re.escape(name) for name in (role, *ROLES[role].names))
    return re.compile(rf"\s*+(?:{words}){_VALUE}", flags=re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class FileCondition:
    """A condition of all rows of a file: role, number, unit as written ("" for that of the role), and where it stands.

    >>> FileCondition("V", 150.0, "m/min", "note").unit
    'm/min'
    """

    role: str
    value: float
    unit: str
    place: str


def conditions_of_file(name: str, notes: Iterable[str]) -> tuple[FileCondition, ...]:
    """Conditions in the notes of a file (``V = 150 m/min``) and, for others, in its name (``V150_f0.2_ap2.csv``).

    >>> [(one.role, one.value) for one in conditions_of_file("V150_f0.2_ap2.csv", ["V = 160 m/min"])]
    [('V', 160.0), ('f', 0.2), ('d', 2.0)]
    """
    found: dict[str, FileCondition] = {}
    for note in notes:
        for match in ASSIGNMENT.finditer(note):
            header = parse_header(match["name"].strip())
            unit = (match["unit"] or header.unit_text).strip(".")
            role = role_of(header.name, canonical(unit) if unit else None)
            if role and ROLES[role].kind in _KINDS and (not unit or (is_unit(unit) and fits(role, unit))):
                value = float(match["number"].replace(",", "."))
                found.setdefault(role, FileCondition(role, value, unit, "note"))
    stem = Path(name).stem
    for symbol, digits in _TOKEN.findall(stem.replace("_", " ")):
        role = role_of(symbol, None) or (role_of(symbol.upper(), None) if len(symbol) == 1 else None)
        leading_zero = digits.startswith("0") and digits.isdecimal() and len(digits) > 1
        if role and ROLES[role].kind in _KINDS and not leading_zero:
            number = float(re.sub("[,p]", ".", digits))
            found.setdefault(role, FileCondition(role, number, "", "name of the file"))
    return tuple(found.values())


def same_as_time(unit: str) -> bool:
    """Whether a unit is one of time.

    >>> same_as_time("s"), same_as_time("mm"), same_as_time("")
    (True, False, False)
    """
    known = canonical(unit) if unit else None
    return known is not None and same_dimension(known, "min")


def response_in(stem: str) -> tuple[str, str]:
    """Symbol of the response that a header names first, and the rest of the header."""
    words = re.split(r"[\s_]+", stem)
    for count in range(min(len(words), _MOST_WORDS), 0, -1):
        role = role_of(" ".join(words[:count]), None) or role_of(" ".join(words[:count]).upper(), None)
        if role and ROLES[role].kind in MEASURED:
            return role, " ".join(words[count:])
    return "", stem


def named_in_notes(table: Table) -> tuple[str, str]:
    """Symbol and unit of the response that a note of the file names, "" where none does."""
    for note in table.notes:
        words = re.findall(r"[^\W\d_]\w*", note)
        for count in (3, 2, 1):
            for start in range(len(words) - count + 1):
                name = " ".join(words[start : start + count])
                role = role_of(name, None) if len(name) > 1 else None
                if role and ROLES[role].kind in MEASURED:
                    unit = re.search(rf"{re.escape(words[start + count - 1])}\s*(?:\bin\b|\[|\()\s*([^\s\])]+)", note)
                    return role, unit[1] if unit and is_unit(unit[1]) and fits(role, unit[1]) else ""
    return "", ""


def time_in_notes(table: Table) -> str:
    """Unit of time in a note such as "VB after t min" or "time [s]"."""
    for note in table.notes:
        if match := re.search(r"\b(?:t|time|zeit|temps|tiempo)\b[\s,in/=]*+[\[(]?\s*+(min|s|h)\b", note, re.IGNORECASE):
            return match[1]
    return ""


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
            raise UsageError(f"--value {role}={value:g}: {role} is no quantity; {hint}usual are D, Dc, z, n and V.")
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
    named = rf"(?:^|[,;:(#.=]|\b(?:and|und|et|y|with|mit))[ \t]*+(?:{'|'.join(map(re.escape, words))})"
    short = rf"(?<![\w./])(?:{'|'.join(map(re.escape, symbols))})"
    patterns = [
        re.compile(
            rf"{named}[ \t]*+(?:[^\W\d]{{1,2}}[ \t]*+)?(?:[:=][ \t]*+)?{_NUMBER}{_UNIT}", re.IGNORECASE | re.MULTILINE
        ),
        re.compile(rf"{short}[ \t]*+[:=][ \t]*+{_NUMBER}{_UNIT}"),
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
