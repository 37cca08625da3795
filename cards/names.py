"""Names of the folders of pairs: letters that every file system takes, and each name once."""

import re
from collections.abc import Iterable
from unicodedata import normalize

LONGEST_NAME = 80  # bytes of tool and of work in a folder's name; most file systems end at 255 for both
_ODD = re.compile(r"[^\w.-]+")
_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³])\.", re.IGNORECASE)


def folder_names(pairs: Iterable[tuple[str, str]]) -> list[str]:
    """``<tool>_<work>`` for each pair; names that differ in case alone are numbered in the order of the pairs.

    A name stays inside its folder, is at most 170 bytes long and is none that Windows keeps for a device. Signs
    that letters are composed of are joined first: "Härte" is one name, however its ä is written.

    Parameters
    ----------
    pairs : iterable of (tool, work)

    Examples
    --------
    >>> folder_names([("GC435", "709M40"), ("gc435", "709m40"), ("../Härte 1", "")])
    ['GC435_709M40', 'gc435_709m40-2', 'Härte-1_unnamed']
    """
    taken: set[str] = set()
    following: dict[str, int] = {}  # the number to try next: counting from 2 each time would be quadratic
    names = []
    for tool, work in pairs:
        name = first = _folder_name(tool, work)
        key = same = _alike(first)
        number = following.get(same, 2)
        while key in taken:
            name, number = f"{first}-{number}", number + 1
            key = _alike(name)
        following[same] = number
        taken.add(key)
        names.append(name)
    return names


def _folder_name(tool: str, work: str) -> str:
    words = [_ODD.sub("-", normalize("NFC", name)).strip("-._") for name in (tool, work)]
    short = [word.encode()[:LONGEST_NAME].decode(errors="ignore").rstrip("-._") for word in words]
    name = "_".join(word or "unnamed" for word in short)
    return name.replace(".", "-", 1) if _DEVICE.match(name) else name


def _alike(name: str) -> str:
    """The same for names that a file system may take for one."""
    return normalize("NFC", name.casefold())
