"""One answer of the check."""

from dataclasses import dataclass

from ...core.display import Displayable


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
