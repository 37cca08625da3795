"""Doubts about a file of tests: unusual values, columns that contradict each other, choices that it does not settle."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Ints
from ..core.display import Display, Displayable

KEYWORDS = {"unit": "units", "map": "map", "value": "constants"}  # options of the command -> of datasets.read_runs


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
    unsettled : bool
        Whether the values may be wrong by a factor of 10 or more, so that no law on the columns is to be used.
    lines : tuple of int
        Lines of the file that the doubt is about; () where it is about the columns as a whole.

    Examples
    --------
    >>> str(Doubt(("VB",), "VB 1.2 to 1.9 mm is above the usual .02 to .6 mm", "--unit VB=um"))
    'VB 1.2 to 1.9 mm is above the usual .02 to .6 mm: --unit VB=um'
    """

    columns: tuple[str, ...]
    sentence: str
    remedy: str = ""
    unsettled: bool = False
    lines: tuple[int, ...] = ()

    def concerns(self, lines: Sequence[int] | Ints) -> bool:
        """Whether the doubt is about one of these lines, or about the columns as a whole.

        >>> doubt = Doubt(("VB",), "line 7: VB 12 mm is far from all other rows", lines=(7,))
        >>> doubt.concerns([6, 7, 8]), doubt.concerns([9, 10])
        (True, False)
        """
        return not self.lines or bool(np.isin(self.lines, lines).any())

    def __str__(self) -> str:
        """The sentence with its remedy."""
        return f"{self.sentence}: {self.remedy}" if self.remedy else self.sentence

    @property
    def in_python(self) -> str:
        """The sentence with its remedy as a keyword of `datasets.read_runs`.

        >>> Doubt(("VB",), "VB 120 to 190 mm is above the usual .02 to .6 mm", "--unit VB=um").in_python
        "VB 120 to 190 mm is above the usual .02 to .6 mm: units={'VB': 'um'}"
        """
        one = re.fullmatch(r"--(unit|map|value) (\w+)=(\S+)", self.remedy)
        if one is None:
            return str(self)
        value = one[3] if one[1] == "value" else repr(one[3])
        return f"{self.sentence}: {KEYWORDS[one[1]]}={{{one[2]!r}: {value}}}"

    def _display(self) -> Display:
        return Display(str(self))
