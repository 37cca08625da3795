"""Plan of a Parquet source: its columns interpreted once, its pairs indexed, its rows cut into blocks."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ...core.errors import DataError
from ...datasets.vocabulary import UNNAMED
from ..engine import SERIAL, Run
from ..plan import Block, Piece, Plan, Reading
from .common import STREAMED, packed
from .parquet_arrow import UNREADABLE, why
from .parquet_index import Held, Index, indexed
from .parquet_schema import ParquetFile, SourceColumns, footer, interpret_columns, parquet_files
from .sorted_copies import sorted_copy


def parquet_plan(
    source: Path,
    reading: Reading,
    *,
    most_rows: int,
    most_pairs: int,
    work: Path,
    report: Callable[[str], None],
    name: str | None = None,
    reads: float = 4.0,
    notes: tuple[str, ...] = (),
    workers: Run = SERIAL,
) -> Plan:
    """Cut a Parquet file, or a folder of them, into blocks of pairs.

    Parameters
    ----------
    source : Path
        A file, or a data set: files at any depth, in folders as ``tool=GC435/work=709M40`` or in plain ones.
    reading : Reading
    most_rows, most_pairs : int
        Of a block; a pair of more than ``most_rows`` rows is a block of its own, one of more than eight times
        as many is streamed.
    work : Path
        Folder for a sorted copy, where one is needed.
    report : callable
        Receives progress updates.
    name : str, optional
        Name of the source, where it was made from another.
    reads : float
        How many times its rows the blocks may read together; beyond it a copy is sorted by block first.
    notes : tuple of str
        Free text above the table of a CSV that became this source.
    workers : Run
        Read the pairs of row groups; this process by default.

    Returns
    -------
    Plan
        The same for the same files. Files that differ from the first in their columns, and what cannot be read, are
        in its ``unreadable``.

    Raises
    ------
    DataError
        No file can be read, its columns cannot be interpreted, or it holds no row.
    UsageError
        The reading names a column or a role that is not there.

    Examples
    --------
    >>> import pandas as pd, tempfile
    >>> from fitmodels.batch.plan import Reading
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "tests.parquet")
    ...     rows = {"tool": ["A", "B", "A"], "work": "steel", "vc [m/s]": [1.0, 2.0, 3.0], "AW": [0.1, 0.2, 0.3]}
    ...     pd.DataFrame(rows).to_parquet(path)
    ...     plan = parquet_plan(path, Reading(), most_rows=100, most_pairs=1, work=Path(folder), report=print)
    >>> [(str(block.pairs[0]), block.rows) for block in plan.blocks]
    [('A on steel', 2), ('B on steel', 1)]
    """
    files = parquet_files(source, work)
    known = interpret_columns(_first_readable(files), files, reading, notes)
    index = indexed(files, known, reading, report, workers)
    if not index.held:
        raise DataError(_nothing(source, index.unreadable))
    ranges = packed(index.rows, most_rows, most_pairs)
    blocks = _blocks(index, ranges, most_rows)
    unreadable, assumed = index.unreadable, [*known.assumed, *_unnamed(index, known, reading), *_files(index)]
    if _times_read(index.held, blocks) > reads:
        limits = (most_rows, most_pairs)
        blocks, lost = sorted_copy(blocks, index, ranges, known, reading, limits, work / "sorted", report)
        unreadable = unreadable | lost
        assumed.append(SORTED)
    rows = sum(block.rows for block in blocks)
    return Plan(
        name or source.name, "parquet", blocks, rows, known.columns, unreadable, tuple(assumed), reading,
        notes=notes, derived=known.derived,
    )  # fmt: skip


SORTED = "the rows of a pair are far apart in the source: they are read from a copy that is sorted by pair"


def _first_readable(files: tuple[ParquetFile, ...]) -> ParquetFile:
    reasons = []
    for file in files:
        try:
            footer(str(file.path), file.stamp)
        except UNREADABLE as error:
            reasons.append(f"{file.name}: cannot be read: {why(error)}.")
        else:
            return file
    raise DataError(reasons[0] if len(files) == 1 else f"none of {len(files)} Parquet files can be read. {reasons[0]}")


def _nothing(source: Path, unreadable: Mapping[str, str]) -> str:
    if not unreadable:
        return f"{source.name} holds no rows."
    return f"{source.name}: nothing of it can be read. {next(iter(unreadable.values()))}"


def _blocks(index: Index, ranges: tuple[range, ...], most_rows: int) -> tuple[Block, ...]:
    """Blocks with the row groups that hold rows of their pairs."""
    of_block = np.repeat(np.arange(len(ranges)), [len(pairs) for pairs in ranges])
    pieces: list[list[Piece]] = [[] for _ in ranges]
    places: list[list[int]] = [[] for _ in index.number]  # of each pair, among the pieces of its block
    for held in index.held:
        for block in np.unique(of_block[held.pairs]).tolist():
            pieces[block].append(held.piece)
        for pair in held.pairs.tolist():
            places[pair].append(len(pieces[of_block[pair]]) - 1)
    pairs, rows = index.pairs, index.rows
    return tuple(
        Block(
            pairs[numbers.start : numbers.stop], tuple(mine), n, n > STREAMED * most_rows,
            tuple(map(tuple, places[numbers.start : numbers.stop])),
        )
        for numbers, mine in zip(ranges, pieces, strict=True)
        for n in (int(rows[numbers.start : numbers.stop].sum()),)
    )  # fmt: skip


def _times_read(held: list[Held], blocks: tuple[Block, ...]) -> float:
    """Rows that the blocks read together, over those of the source."""
    rows = {group.piece: group.rows for group in held}
    return sum(rows[piece] for block in blocks for piece in block.pieces) / sum(rows.values())


def _unnamed(index: Index, known: SourceColumns, reading: Reading) -> tuple[str, ...]:
    """Sentences on rows that name no tool or work though there is a column for it."""
    columns = {use.role for use in known.columns}
    sentences = []
    for role, place in (("tool", 0), ("work", 1)):
        n = sum(int(rows) for key, rows in zip(index.number, index.rows, strict=True) if key[place] == UNNAMED[role])
        if n and role in columns and getattr(reading, role) is None:
            sentences.append(f"{role}: {n} rows name none; they are called {UNNAMED[role]}")
    return tuple(sentences)


def _files(index: Index) -> tuple[str, ...]:
    """The assumption on edges of pairs that are in several files."""
    seen: dict[int, str] = {}
    for held in index.held:
        for pair in held.pairs.tolist():
            if seen.setdefault(pair, held.piece.path) != held.piece.path:
                return ("rows of a pair in several files are one test: an edge of the same name is the same edge",)
    return ()
