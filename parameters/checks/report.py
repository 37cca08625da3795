"""Findings of the check of a parameter file."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...core.display import Displayable

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, slots=True, repr=False)
class FileFinding(Displayable):
    """One answer.

    Attributes
    ----------
    name : str
        What was asked, in a word or two.
    passed : bool or None
        None where it could not be asked, or is worth knowing without standing against the file.
    words : str
        One sentence.
    """

    name: str
    passed: bool | None
    words: str


@dataclass(frozen=True, slots=True, repr=False)
class CheckReport(Displayable):
    """All findings on a file.

    Attributes
    ----------
    findings : tuple of FileFinding
        In the order they were asked.
    """

    findings: tuple[FileFinding, ...]

    @property
    def failed(self) -> tuple[FileFinding, ...]:
        """Findings that stand against the file."""
        return tuple(f for f in self.findings if f.passed is False)

    @property
    def ok(self) -> bool:
        """Whether nothing stands against the file; what could not be asked does not."""
        return not self.failed

    def facts(self) -> dict[str, Any]:
        """The report for programs, without a name of its schema."""
        return {
            "ok": self.ok,
            "findings": [{"name": f.name, "passed": f.passed, "words": f.words} for f in self.findings],
        }

    def to_frame(self) -> "DataFrame":
        """A row a finding."""
        from pandas import DataFrame

        return DataFrame([(f.name, f.passed, f.words) for f in self.findings], columns=["name", "passed", "words"])
