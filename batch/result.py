"""Result of a batch: its tables, the pairs that need attention, and the written files."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from ..core.display import Display, Plottable, TextTable
from ..core.progress import grouped
from .attention import Attention
from .comparison import Comparison
from .plan import Plan

if TYPE_CHECKING:
    from ..cards.publishing import PublicationReport


@dataclass(frozen=True, slots=True)
class Effort:
    """Time and memory of a batch.

    Attributes
    ----------
    where : str
        Engine.
    fitted, kept : int
        Pairs fitted now, and pairs whose earlier results were kept.
    seconds : float
        Of fitting.
    memory, memory_here : int
        Largest memory of a process that fitted, and of this one, in bytes; 0 where the system does not report it.
    """

    where: str
    fitted: int
    kept: int
    seconds: float
    memory: int
    memory_here: int


@dataclass(frozen=True, slots=True, repr=False)
class Batch(Plottable):
    """Laws of all pairs of a source.

    Attributes
    ----------
    out : Path
        The folder that holds everything.
    plan : Plan
        Plan of the source.
    results : DataFrame
        A row a pair and law: names, groups, ``response, form, unit, reason``, the numbers of `ManyLaws.table` with
        95 % intervals, and the posterior where there is one.
    attention : DataFrame
        ``tool, work, kind, words``: reasons why pairs need attention.
    concerns : tuple of Attention
        The same by kind, the most severe first.
    comparison : Comparison
        Exponents over families of pairs.
    units : mapping
        Unit of each symbol.
    unreadable : mapping of str to str
        Parts of the source that could not be read, and why.
    warnings : tuple of str
    effort : Effort
    written : tuple of str
        Files and folders, as paths within ``out``.
    changed : bool
        Whether any file is new.
    site : PublicationReport or None
        Report of the site of cards; None where none was requested.
    """

    out: Path
    plan: Plan
    results: pd.DataFrame
    attention: pd.DataFrame
    concerns: tuple[Attention, ...]
    comparison: Comparison
    units: Mapping[str, str]
    unreadable: Mapping[str, str]
    warnings: tuple[str, ...]
    effort: Effort
    written: tuple[str, ...]
    changed: bool
    site: "PublicationReport | None"

    @property
    def pairs(self) -> int:
        """Number of pairs of the source."""
        return len(self.plan.pairs)

    @property
    def with_law(self) -> int:
        """Number of pairs with a law."""
        some = self.results[self.results["reason"] == ""]
        return len(some[["tool", "work"]].drop_duplicates())

    @property
    def simulated(self) -> int:
        """Number of simulated pairs."""
        some = self.results[self.results["simulated"].astype(bool)]
        return len(some[["tool", "work"]].drop_duplicates())

    def to_frame(self) -> pd.DataFrame:
        """A copy of ``results``."""
        return self.results.copy()

    def _display(self) -> Display:
        head = f"{self.plan.name}: laws of {grouped(self.with_law)} of {grouped(self.pairs)} pairs, in {self.out}"
        head += f"; {grouped(self.simulated)} simulated" if self.simulated else ""
        rows = tuple((item.kind, grouped(item.pairs), item.examples[0]) for item in self.concerns)
        grid = TextTable(("needs attention", "pairs", "for instance"), rows) if rows else None
        facts = (("fitted", f"{grouped(self.effort.fitted)} pairs by {self.effort.where}"),)
        return Display(head, facts, grid, tuple(self.unreadable.values()))
