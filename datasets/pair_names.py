"""Names of tool and work material of a file of tests."""

import re
from functools import cache

import pandas as pd

from .vocabulary import ROLES, UNNAMED


def pair_name(role: str, frame: pd.DataFrame, notes: tuple[str, ...]) -> str:
    """Name of tool or work: from its column, from a note ``tool: GC435``, or the placeholder.

    >>> pair_name("tool", pd.DataFrame(), ("Werkzeug: GC435",))
    'GC435'
    """
    if role in frame:
        names = [name for name in dict.fromkeys(frame[role]) if name]
        return names[0] if len(names) == 1 else "several" if names else UNNAMED[role]
    for note in notes:
        if match := _entry(role).match(note):
            name = match[1].strip(" ;,|\t:")
            if name:
                return name
    return UNNAMED[role]


@cache
def _entry(role: str) -> re.Pattern[str]:
    """A note that names a role and a value."""
    words = "|".join(re.escape(name) for name in (role, *ROLES[role].names))
    return re.compile(rf"\s*(?:{words})\s*[:;,|=\t]\s*(.*\S)", flags=re.IGNORECASE)
