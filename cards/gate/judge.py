"""Everything that stands against publishing a card, in one go."""

import os
from dataclasses import dataclass

from ...core.errors import GateError
from ...parameters import ParameterFile, check
from ..content.parts import Card
from .ask import QUESTIONS, Missing
from .missing import missing


@dataclass(frozen=True, slots=True)
class GateReport:
    """What a card lacks, and what is wrong with its parameter file.

    Attributes
    ----------
    title : str
    missing : tuple of Missing
        In the order of card.toml.
    refusals : tuple of str
        Findings of ``parameters.check`` that stand against the file, a shut posterior gate among them.
    """

    title: str
    missing: tuple[Missing, ...]
    refusals: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether it may be published."""
        return not (self.missing or self.refusals)

    def sentences(self) -> list[str]:
        """Refusals, then what is missing with what it is needed for and how it is told."""
        asked = [
            f"{item.field}: {item.why}. {item.ask}"
            + (f" For example: {QUESTIONS[item.field].example}" if item.field in QUESTIONS else "")
            for item in self.missing
        ]
        return [*self.refusals, *asked]

    def raise_if_shut(self) -> None:
        """Raise `GateError` with everything in one sentence a line."""
        if not self.ok:
            n = len(self.missing) + len(self.refusals)
            against = "1 thing stands" if n == 1 else f"{n} things stand"
            head = f"{self.title} is not published: {against} against it."
            raise GateError("\n".join([head, *(f"- {words}" for words in self.sentences())]))


def judge(card: Card, pf: ParameterFile, folder: str | os.PathLike[str] | None = None) -> GateReport:
    """Judge a card and the parameter file on disk that it was made from.

    Parameters
    ----------
    card : Card
        With what card.toml tells.
    pf : ParameterFile
        As it was read, without what card.toml tells.
    folder : path, optional
        Where the file stands, to look at its draws too.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.compose import compose
    >>> pf = parameters.collect(tool="GC435", work="709M40")
    >>> report = judge(compose(pf), pf)
    >>> report.ok, len(report.missing), report.refusals
    (False, 8, ())
    """
    report = check(pf, folder)
    return GateReport(card.title, tuple(missing(card)), tuple(finding.words for finding in report.failed))
