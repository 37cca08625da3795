"""What came of publishing: a site, or all that stands against it."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .entry import Entry


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that stands against publishing a pair: its folder within FOLDER, and a sentence.

    ``kind`` is ``unreadable``, ``field``, ``check`` or ``twice``; ``fields`` are those that are empty.
    """

    folder: str
    kind: str
    words: str
    fields: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Report:
    """What was found, and what was written.

    Attributes
    ----------
    cards : tuple of Entry
        Of the site, in its order; empty where something stands against it.
    problems : tuple of Problem
        All of them, in the order of the folders.
    templates : tuple of Path
        ``card.toml`` written to be filled in.
    site : Path or None
        Where the site stands; None where none was written.
    unchanged : bool
        The very same site was there already.
    found : int
        Pairs in the folder.
    """

    cards: tuple[Entry, ...] = ()
    problems: tuple[Problem, ...] = ()
    templates: tuple[Path, ...] = ()
    site: Path | None = None
    unchanged: bool = False
    found: int = 0

    @property
    def ok(self) -> bool:
        """Whether nothing stands against publishing."""
        return not self.problems

    def facts(self) -> dict[str, Any]:
        """The report for programs, without a name of its schema."""
        return {
            "ok": self.ok,
            "found": self.found,
            "site": None if self.site is None else str(self.site),
            "unchanged": self.unchanged,
            "cards": [card.slug for card in self.cards],
            "problems": [asdict(problem) for problem in self.problems],
            "templates": [str(path) for path in self.templates],
        }
