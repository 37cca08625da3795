"""Conditions of a test that stand in the notes or in the name of its file."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from .headers import parse_header
from .tables.blocks import ASSIGNMENT
from .units import canonical, is_unit
from .vocabulary import ROLES, fits, role_of

_TOKEN = re.compile(r"(?<![A-Za-z])([A-Za-z]{1,3})[=-]?(\d+(?:[.,p]\d+)?)(?![\d.,]*[A-Za-z\d])")
_KINDS = ("condition", "other")


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
