"""Rows of the pairs of a block in standard units, ready to be fitted."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from ..core.arrays import Ints
from ..datasets import Runs
from ..datasets.columns import ColumnUse
from ..datasets.derived.rules import Derived
from ..datasets.doubts import Doubt
from ..datasets.options import Process
from ..datasets.plausibility.ranges import process_of
from ..datasets.runs import Source, disclaimers
from ..pipeline.reading import digest
from .plan import Pair

NO_LINES = "Parquet"  # dialect of a source whose rows have no lines: they are counted within their pair, from 1


@dataclass(frozen=True, slots=True)
class PairSource:
    """Source, columns, doubts and notes of a pair of lab files, as in the `Runs` of its own file."""

    source: Source
    columns: tuple[ColumnUse, ...]
    assumed: tuple[str, ...]
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    doubts: tuple[Doubt, ...] = ()
    judged: bool = False
    derived: tuple[Derived, ...] = ()
    process: Process | None = None
    constants: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, runs: Runs) -> "PairSource":
        """Those of the runs of a pair."""
        return cls(
            runs.source, runs.columns, runs.assumed, runs.warnings, runs.notes, runs.doubts, runs.judged, runs.derived,
            runs.process, runs.constants,
        )  # fmt: skip

    def remarks(self, shared: bool) -> tuple[bool, tuple[str, ...]]:
        """Whether notes mark the rows as simulated; doubts and warnings from reading the file.

        Those of a file that is ``shared`` by several pairs may be about any of them, which is stated.
        """
        words = (*map(str, self.doubts), *self.warnings)
        of = f"{self.source.name}, a file of several pairs: " if shared else ""
        return bool(disclaimers(self.notes)), tuple(f"{of}{each}" for each in words)


@dataclass(frozen=True, slots=True)
class PairRows:
    """Rows of one or more pairs that hold the same columns.

    Attributes
    ----------
    frame : DataFrame
        A column for each role under its symbol, in the unit of ``units``; ``tool`` and ``work`` are always there,
        as text; ``edge`` as text where it is known; columns of the reading's groups under their headers.
    lines : ndarray of int, shape (n,), or None
        Line of each row in its file. None where no file has lines: the rows of each pair are then counted from 1.
    units : mapping
    columns : tuple of ColumnUse
    source : Source
        Of the rows of one lab file or several; for Parquet its ``sha256`` is empty and is taken of each pair's rows.
    assumed, warnings, notes : tuple of str
    derived : tuple of Derived
        Quantities that were computed from others.
    process : str or None
        As given; where it is not, what columns and notes name.
    constants : mapping of str to float
        Values given of quantities that the source does not hold.
    of_pair : mapping of Pair to PairSource
        Source, columns, assumed, warnings and notes of pairs that have their own; the others have those above.
    """

    frame: pd.DataFrame
    lines: Ints | None
    units: Mapping[str, str]
    columns: tuple[ColumnUse, ...]
    source: Source
    assumed: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    derived: tuple[Derived, ...] = ()
    process: Process | None = None
    constants: Mapping[str, float] = field(default_factory=dict)
    of_pair: Mapping[Pair, PairSource] = field(default_factory=dict)

    def remarks(self, pairs: Sequence[Pair]) -> list[tuple[bool, tuple[str, ...]]]:
        """Whether notes mark the rows of each pair as simulated; doubts and warnings from reading."""
        shared = bool(disclaimers(self.notes)), self.warnings
        if not self.of_pair:
            return [shared] * len(pairs)
        held = Counter(about.source for about in self.of_pair.values())
        found = map(self.of_pair.get, pairs)
        return [shared if about is None else about.remarks(held[about.source] > 1) for about in found]

    def runs(self) -> Iterator[tuple[Pair, Runs]]:
        """The runs of each pair, in the order in which the rows name them."""
        groups = self.frame.groupby([self.frame["tool"], self.frame["work"]], sort=False, observed=True)
        number = groups.ngroup().to_numpy()
        for where in np.split(np.argsort(number, kind="stable"), np.cumsum(np.bincount(number))[:-1]):
            if len(where):
                yield self._runs(where)

    def _runs(self, where: Ints) -> tuple[Pair, Runs]:
        data = self.frame.iloc[where]
        pair = Pair(str(data["tool"].iloc[0]), str(data["work"].iloc[0]))
        about = self.of_pair.get(pair)
        if about is None:
            source = Source(self.source.name, self.source.sha256 or digest(data), len(data), self.source.dialect)
            about = PairSource(
                source, self.columns, self.assumed, self.warnings, self.notes, derived=self.derived,
                process=self.process or process_of(map(str, data), self.notes), constants=self.constants,
            )  # fmt: skip
        lines = np.arange(1, 1 + len(where)) if self.lines is None else self.lines[where]
        return pair, Runs(
            data, self.units, about.columns, lines, about.source, pair.tool, pair.work,
            about.assumed, about.warnings, about.notes, about.doubts, about.judged, about.derived,
            about.process, about.constants,
        )  # fmt: skip
