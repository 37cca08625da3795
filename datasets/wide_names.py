"""What headers and notes of a wide table name: the response, its unit, and the unit of time."""

import re

from .tables import Table
from .units import canonical, is_unit, same_dimension
from .vocabulary import ROLES, fits, role_of

RESPONSES = ("wear", "load", "surface")


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
    for count in range(len(words), 0, -1):
        role = role_of(" ".join(words[:count]), None) or role_of(" ".join(words[:count]).upper(), None)
        if role and ROLES[role].kind in RESPONSES:
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
                if role and ROLES[role].kind in RESPONSES:
                    unit = re.search(rf"{re.escape(words[start + count - 1])}\s*(?:\bin\b|\[|\()\s*([^\s\])]+)", note)
                    return role, unit[1] if unit and is_unit(unit[1]) and fits(role, unit[1]) else ""
    return "", ""


def time_in_notes(table: Table) -> str:
    """Unit of time in a note such as "VB after t min" or "time [s]"."""
    for note in table.notes:
        if match := re.search(r"\b(?:t|time|zeit|temps|tiempo)\b[\s,in/=]*[\[(]?\s*(min|s|h)\b", note, re.IGNORECASE):
            return match[1]
    return ""
