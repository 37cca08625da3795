"""Findings of the check of a parameter file."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from ...core.display import Displayable

if TYPE_CHECKING:
    from pandas import DataFrame


VERDICT: Final = "verdict"  # name of the findings on verdicts


@dataclass(frozen=True, slots=True, repr=False)
class FileFinding(Displayable):
    """Result of one check.

    Attributes
    ----------
    name : str
        Name of the check.
    passed : bool or None
        None where it could not be tested, or is a remark that does not fail the file.
    words : str
        One sentence.
    """

    name: str
    passed: bool | None
    words: str


@dataclass(frozen=True, slots=True, repr=False)
class CheckReport(Displayable):
    """All findings on a parameter file.

    Attributes
    ----------
    findings : tuple of FileFinding
        In the order of the checks.
    """

    findings: tuple[FileFinding, ...]

    @property
    def failed(self) -> tuple[FileFinding, ...]:
        """Findings that fail the file."""
        return tuple(f for f in self.findings if f.passed is False)

    @property
    def inconsistent(self) -> tuple[FileFinding, ...]:
        """Findings that fail the file apart from verdicts: a simulation may use what must not control a machine."""
        return tuple(f for f in self.failed if f.name != VERDICT)

    @property
    def ok(self) -> bool:
        """Whether no check failed; untested ones do not count."""
        return not self.failed

    def facts(self) -> dict[str, Any]:
        """The report for programs, without a name of its schema."""
        return {
            "ok": self.ok,
            "findings": [{"name": f.name, "passed": f.passed, "words": f.words} for f in self.findings],
        }

    def to_frame(self) -> "DataFrame":
        """One row per finding."""
        from pandas import DataFrame

        return DataFrame([(f.name, f.passed, f.words) for f in self.findings], columns=["name", "passed", "words"])
