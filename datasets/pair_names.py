"""Names of tool and work material of a file of tests."""

import re

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
    words = "|".join(re.escape(name) for name in (role, *ROLES[role].names))
    for note in notes:
        if match := re.match(rf"\s*(?:{words})\s*[:;,|=\t]\s*(.*\S)", note, flags=re.IGNORECASE):
            name = match[1].strip(" ;,|\t:")
            if name:
                return name
    return UNNAMED[role]
