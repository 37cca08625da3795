"""The plan of a batch: the pairs of a source, where their rows are, blocks of pairs, and the options of the fits."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from ..core.display import Display, Displayable, facts_of
from ..datasets.columns import ColumnUse
from ..datasets.derived.rules import Derived
from ..datasets.options import ReadOptions
from ..pipeline.options import FitOptions


@dataclass(frozen=True, slots=True, order=True, repr=False)
class Pair(Displayable):
    """A tool and a work material.

    >>> str(Pair("GC435", "709M40"))
    'GC435 on 709M40'
    """

    tool: str
    work: str

    def __str__(self) -> str:
        return f"{self.tool} on {self.work}"

    def __reduce__(self) -> tuple[type["Pair"], tuple[str, str]]:  # a third of the time that a dataclass takes
        return Pair, (self.tool, self.work)

    def _display(self) -> Display:
        return Display(str(self))


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Reading(ReadOptions):
    """Reading of a source, as in `ReadOptions`, and which of its columns group the pairs.

    Attributes
    ----------
    groups : tuple of str
        Headers of columns that name a group of the pair: its grade, its coolant.
    """

    groups: tuple[str, ...] = ()

    @property
    def named(self) -> tuple[str, ...]:
        """Headers of the groups, which are names."""
        return self.groups

    def _display(self) -> Display:
        facts = tuple(facts_of(self))
        return Display(", ".join(map(" ".join, facts)) or "columns as the source names them", facts)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class BatchOptions(FitOptions):
    """Options of the fits of a batch, and which files are made of each pair.

    Attributes
    ----------
    files : bool
        A parameter file for each pair, with checks and posterior, besides its row in the table.
    keep_draws : bool
        The draws of each posterior in a file too (about half a megabyte for each law).
    command : str or None
        Recorded in each parameter file.
    """

    files: bool = True
    keep_draws: bool = False
    command: str | None = None

    @classmethod
    def of(cls, options: FitOptions, **more: Any) -> "BatchOptions":  # noqa: ANN401
        """The options of an analysis, with those of a batch; priors of a file by their content."""
        shared = {one.name: getattr(options, one.name) for one in fields(FitOptions)}
        return cls(**shared | {"priors": options.prior_tables()}, **more)

    def facts(self, reading: Reading) -> dict[str, Any]:
        """All that the numbers of a pair depend on besides its rows, for the key of its record."""
        facts = asdict(self) | {"reading": asdict(reading)}
        return {name: value for name, value in facts.items() if name != "command"}


@dataclass(frozen=True, slots=True)
class Piece:
    """A unit of reading: a lab file, or a row group of a Parquet file.

    Attributes
    ----------
    path : str
        Absolute, so that a process elsewhere finds it.
    name : str
        Its path within the source, with the row group where there are several.
    stamp : str
        Changes when the content does: SHA-256 of a lab file, size and time of a Parquet file.
    row_group : int or None
    partition : tuple of (header, value)
        Values from the folders of a Parquet data set, as ``tool=GC435/``.
    """

    path: str
    name: str
    stamp: str
    row_group: int | None = None
    partition: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Block:
    """Pairs that are fitted together, as a task of its own.

    Rows of other pairs in the pieces are skipped.

    Attributes
    ----------
    pairs : tuple of Pair
    pieces : tuple of Piece
        All that hold rows of these pairs.
    rows : int
        Of these pairs.
    streamed : bool
        One pair with more rows than fit into the memory of a process: it is fitted in one pass.
    of_pair : tuple of tuple of int
        For each pair the positions of its pieces among ``pieces``; empty where that is not known, and then a piece
        that cannot be read costs every pair of the block.
    identity : tuple of tuple of (header, value)
        For each pair its groups in the table of pairs that belong into its parameter file; empty where there is none.
    """

    pairs: tuple[Pair, ...]
    pieces: tuple[Piece, ...]
    rows: int
    streamed: bool = False
    of_pair: tuple[tuple[int, ...], ...] = ()
    identity: tuple[tuple[tuple[str, str], ...], ...] = ()

    def identity_of(self, pair: Pair) -> dict[str, str]:
        """The ``identity`` of a pair."""
        return dict(self.identity[self.pairs.index(pair)]) if self.identity else {}


@dataclass(frozen=True, slots=True, repr=False)
class Plan(Displayable):
    """A source cut into blocks, independent of the number of processes.

    Attributes
    ----------
    name, kind : str
        Of the source: ``files`` (a folder of lab files, or one) or ``parquet``.
    blocks : tuple of Block
    rows : int
    columns : tuple of ColumnUse
        Interpretation of the columns of a Parquet source; empty for files, each of which has its own.
    unreadable : mapping of str to str
        Reason of each piece that cannot be read, by its name.
    assumed : tuple of str
        Assumptions, in full sentences.
    reading : Reading
    notes : tuple of str
        Free text above the table of a CSV that became Parquet; a lab file's notes stay with its pairs.
    derived : tuple of Derived
        Quantities that are computed from columns of a Parquet source.
    """

    name: str
    kind: str
    blocks: tuple[Block, ...]
    rows: int
    columns: tuple[ColumnUse, ...]
    unreadable: Mapping[str, str]
    assumed: tuple[str, ...]
    reading: Reading
    notes: tuple[str, ...] = ()
    derived: tuple[Derived, ...] = ()

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """All pairs, in the order of the blocks."""
        return tuple(pair for block in self.blocks for pair in block.pairs)

    def _display(self) -> Display:
        pairs, blocks = len(self.pairs), len(self.blocks)
        of = f"{pairs} pair{'s' * (pairs != 1)}, in {blocks} block{'s' * (blocks != 1)}"
        head = f"{self.name}: {self.rows} rows of {of}"
        return Display(head, sentences=(*self.assumed, *self.unreadable.values()))
