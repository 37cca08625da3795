"""Doubts about a file of tests: unusual values, columns that contradict each other, choices that it does not settle."""

from dataclasses import dataclass

from ..core.display import Display, Displayable


@dataclass(frozen=True, slots=True, repr=False)
class Doubt(Displayable):
    """A doubt about columns of a file: what was seen, beside what is usual, and the options that would correct it.

    Attributes
    ----------
    columns : tuple of str
        Symbols of the roles concerned, or headers of columns without a role.
    sentence : str
        One sentence with the values, the lines and the usual range.
    remedy : str
        Options of the command that correct the reading, as typed (``--unit VB=um``); "" where there is none.

    Examples
    --------
    >>> str(Doubt(("VB",), "VB 1.2 to 1.9 mm is above the usual .02 to .6 mm", "--unit VB=um"))
    'VB 1.2 to 1.9 mm is above the usual .02 to .6 mm: --unit VB=um'
    """

    columns: tuple[str, ...]
    sentence: str
    remedy: str = ""

    def __str__(self) -> str:
        """The sentence with its remedy."""
        return f"{self.sentence}: {self.remedy}" if self.remedy else self.sentence

    def _display(self) -> Display:
        return Display(str(self))
