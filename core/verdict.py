"""The verdict on a result: how far it can be used, the reasons, what was checked and what was not."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from .display import Display, Displayable

USABLE, RESERVATIONS, DO_NOT_USE = 0, 1, 2
PROBABILITY: Final = 0.9  # of a specification: required by default, and below which gains are used with reservations
EVEN: Final = 0.5  # where the whole interval lies below it, the specification fails more often than it holds
LEVELS: Final = ("usable inside the tested region", "usable with reservations", "do not use for control")
NOT_JUDGED: Final = "not judged"


class Mark(NamedTuple):
    """Icon, colour and words of a level on terminal, card, notebook and widget: none of the three stands alone."""

    icon: str
    ascii: str  # the icon where an encoding has no other
    colour: str  # ANSI base colour of a terminal, legible on light and dark
    css: str  # class of a page
    tone: str  # colour in a notebook, legible on light and dark
    words: str


MARKS: Final[Mapping[int | None, Mark]] = {  # level of a result -> its mark; None: not judged
    USABLE: Mark("✓", "+", "green", "usable", "#218739", LEVELS[USABLE]),
    RESERVATIONS: Mark("!", "!", "yellow", "reservations", "#a36a00", LEVELS[RESERVATIONS]),
    DO_NOT_USE: Mark("✗", "x", "bold red", "do-not-use", "#d73a49", LEVELS[DO_NOT_USE]),
    None: Mark("?", "?", "yellow", "not-judged", "#a36a00", NOT_JUDGED),
}


@dataclass(frozen=True, slots=True, repr=False)
class Verdict(Displayable):
    """Verdict on the use of a result.

    Attributes
    ----------
    level : {0, 1, 2}
        Usable inside the tested region; usable with reservations; do not use for control.
    reasons : tuple of str
        One sentence for each reservation, reasons not to use the result first.
    checked : tuple of str
        Names of the checks that were computed.
    not_checked : tuple of str
        Each check that was not computed, with its reason.

    Examples
    --------
    >>> Verdict(1, ("The file names no edges.",), ("Lack of fit",)).words
    'usable with reservations'
    """

    level: int = USABLE
    reasons: tuple[str, ...] = ()
    checked: tuple[str, ...] = ()
    not_checked: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """The level in words."""
        return LEVELS[self.level]

    @property
    def mark(self) -> Mark:
        """Icon, colour and words of the level."""
        return MARKS[self.level]

    def _display(self) -> Display:
        facts = (("checked", ", ".join(self.checked)), ("not checked", "; ".join(self.not_checked)))
        return Display(self.words, tuple(fact for fact in facts if fact[1]), sentences=self.reasons)


def verdict_from(
    found: Sequence[tuple[int, str]], checked: Sequence[str] = (), not_checked: Sequence[str] = ()
) -> Verdict:
    """The verdict from levels with their sentences: the highest level decides, and its reasons stand first.

    Examples
    --------
    >>> verdict_from([(1, "No edges."), (2, "R2 is .02."), (0, "Passed.")]).reasons
    ('R2 is .02.', 'No edges.')
    """
    held = sorted((item for item in found if item[0] > USABLE), key=lambda item: -item[0])
    level = held[0][0] if held else USABLE
    return Verdict(level, tuple(dict.fromkeys(words for _, words in held)), tuple(checked), tuple(not_checked))


def level_of_probability(probability: float, upper: float, required: float | None = None) -> int:
    """Least level of gains whose specification holds with a probability.

    Parameters
    ----------
    probability, upper : float
        The probability and the upper end of its interval.
    required : float, optional
        Required probability.

    Examples
    --------
    >>> [level_of_probability(p, p + 0.02) for p in (0.95, 0.6, 0.4)], level_of_probability(0.95, 0.96, 0.99)
    ([0, 1, 2], 1)
    """
    if upper < EVEN:
        return DO_NOT_USE
    return RESERVATIONS if probability < max(PROBABILITY, required or 0.0) else USABLE
