"""Hints for a name that does not exist: the closest one that does, or all of them."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path


def closest(name: object, known: Iterable[str], cutoff: float = 0.5) -> str | None:
    """The known name most like ``name``, without regard to case; None where none is similar.

    >>> closest("Vb", ["VB", "AW"]), closest("speed", ["VB", "AW"])
    ('VB', None)
    """
    folded = {item.casefold(): item for item in reversed(list(known))}
    near = get_close_matches(str(name).casefold(), folded, n=1, cutoff=cutoff)
    return folded[near[0]] if near else None


def did_you_mean(name: object, known: Iterable[str], cutoff: float = 0.5, *, names: str = "Known: ") -> str:
    """A sentence that proposes the closest known name, or lists all of them after ``names``.

    >>> did_you_mean("nasa_millling", ["nasa_milling", "daisy"])
    "Did you mean 'nasa_milling'?"
    >>> did_you_mean("x", ["nasa_milling", "daisy"], names="There are ")
    'There are nasa_milling, daisy.'
    """
    known = list(known)
    near = closest(name, known, cutoff)
    return f"Did you mean {near!r}?" if near else f"{names}{', '.join(known)}."


def near_path(path: Path) -> Path | None:
    """The existing path most like one that does not exist: its first wrong part is replaced; None without one.

    >>> here = Path(__file__)
    >>> near_path(here.parent / "sugestions.py").name
    'suggestions.py'
    >>> near_path(here.parent.parent / "croe" / "suggestions.py") == here
    True
    """
    folder = path.parent if path.parent.is_dir() else near_path(path.parent)
    if folder is None or not folder.is_dir():
        return None
    if (folder / path.name).exists():
        return folder / path.name
    near = closest(path.name, (entry.name for entry in folder.iterdir() if entry.name != path.name), cutoff=0.6)
    if near is None or closest(path.stem, [Path(near).stem], cutoff=0.6) is None:  # alike in the suffix alone
        return None
    return folder / near
