"""A copy of a Parquet source with a file a block, for rows of a pair that lie far apart."""

import shutil
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
from hashlib import sha256
from json import dumps
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Array, Flags, Ints
from ...datasets.columns import ColumnUse
from ..plan import Block, Piece, Reading
from ..records import read_json
from .parquet_arrow import UNREADABLE, Labels, numbered, pa, pq, why
from .parquet_index import Held, Index, of_rows, parts
from .parquet_schema import SourceColumns, needed_columns

AT_ONCE = 200  # files that are written at the same time; a source of more blocks is read again for the next ones
HELD_ROWS = 1_000_000  # that are in memory before they are written
FACTS = "copy.json"
COPIED = "sorted:"  # how the stamp of a piece begins that stands in a copy
LAYOUT = 2  # of the copy; another one is another name


def sorted_copy(
    blocks: tuple[Block, ...],
    index: Index,
    ranges: tuple[range, ...],
    known: SourceColumns,
    reading: Reading,
    limits: tuple[int, int],
    folder: Path,
    report: Callable[[str], None],
) -> tuple[tuple[Block, ...], dict[str, str]]:
    """The blocks, each reading from a file of its own, and the row groups that could not be copied.

    The copy is written whole or not at all; one that is there for the same source and limits is used again.
    Rows of a pair keep their order. The stamps of its pieces are those of the source.
    """
    uses = needed_columns(known.columns, reading)
    name = _digest(LAYOUT, limits, asdict(reading), [*map(asdict, uses)], _stamps(held.piece for held in index.held))
    home = folder.resolve() / name
    if (facts := _facts(home, len(blocks))) is None:
        shutil.rmtree(home, ignore_errors=True)
        _write_whole(home, _Copy(index, ranges, uses, reading, report))
        facts = _facts(home, len(blocks)) or {}
    found = tuple(_moved(block, i, home, facts["rows"][i]) for i, block in enumerate(blocks))
    return found, facts["unreadable"]


def _facts(home: Path, blocks: int) -> dict[str, Any] | None:
    """Facts of a copy; None where there is none, or they are damaged."""
    found = read_json(home / FACTS)
    if not isinstance(found.get("unreadable"), dict):
        return None
    rows = found.get("rows")
    whole = isinstance(rows, list) and len(rows) >= blocks and all(type(one) is int and one >= 0 for one in rows)
    return found if whole else None


def _digest(*facts: object) -> str:
    return sha256(repr(facts).encode()).hexdigest()[:16]


def _stamps(pieces: Iterable[Piece]) -> list[tuple[str, str]]:
    return [(piece.name, piece.stamp) for piece in pieces]


def _moved(block: Block, i: int, home: Path, rows: int) -> Block:
    stamp = COPIED + _digest(_stamps(block.pieces), [*map(asdict, block.pairs)])
    piece = Piece(str(home / _file_name(i)), f"sorted copy, {_file_name(i)}", stamp)
    return replace(block, pieces=(piece,) if rows else (), rows=rows, of_pair=())


def _file_name(block: int) -> str:
    return f"block-{block:06d}.parquet"


@dataclass(slots=True)
class _Copy:
    """The data that are copied; ``rows`` are those written of each block."""

    index: Index
    ranges: tuple[range, ...]
    uses: tuple[ColumnUse, ...]
    reading: Reading
    report: Callable[[str], None]
    rows: list[int] = field(default_factory=list)
    lost: dict[str, str] = field(default_factory=dict)


class _Damaged(Exception):  # noqa: N818  it never leaves this module
    """A row group breaks off, and rows of it are written already."""


def _write_whole(home: Path, copy: _Copy) -> None:
    making = home.with_name(f".{home.name}")
    making.mkdir(parents=True, exist_ok=True)
    try:
        try:
            _write(making, copy)
        except _Damaged:
            copy.lost.update(_lost(copy))
            _write(making, copy)
        facts = {"rows": copy.rows, "unreadable": copy.lost}
        (making / FACTS).write_text(dumps(facts), encoding="utf-8")
        making.rename(home)
    finally:
        shutil.rmtree(making, ignore_errors=True)


def _lost(copy: _Copy) -> Iterator[tuple[str, str]]:
    """Row groups that cannot be read to their end, with the reason in a sentence."""
    for group in copy.index.held:
        try:
            for _ in parts(group.piece, copy.uses, copy.reading):
                pass
        except UNREADABLE as error:
            yield group.piece.name, f"{group.piece.name}: cannot be read: {why(error)}."


def _write(folder: Path, copy: _Copy) -> None:
    """Write all blocks, ``AT_ONCE`` at a time."""
    copy.rows[:] = [0] * len(copy.ranges)
    for first in range(0, len(copy.ranges), AT_ONCE):
        writers = _Writers(folder, copy.rows, range(first, min(first + AT_ONCE, len(copy.ranges))))
        try:
            _pass(writers, copy)
            writers.flush()
        finally:
            writers.close()


def _pass(writers: "_Writers", copy: _Copy) -> None:
    """Go through the source once, for some of the blocks."""
    block_of = np.repeat(np.arange(len(copy.ranges)), [len(pairs) for pairs in copy.ranges])
    held = [group for group in copy.index.held if _among(block_of[group.pairs], writers.blocks).any()]
    done, total, mine = 0, sum(group.rows for group in held), writers.blocks
    these = "" if len(mine) == len(copy.ranges) else f" of blocks {mine.start + 1} to {mine.stop} of {len(copy.ranges)}"
    for group in held:
        if group.piece.name not in copy.lost:
            for table, block in _tables(group, copy, block_of, mine):
                writers.add(table, block)
        if 10 * (done + group.rows) // total > 10 * done // total:
            copy.report(f"sorting the rows by pair into a copy: {100 * (done + group.rows) // total} %{these}")
        done += group.rows


def _among(blocks: Ints, mine: range) -> Flags:
    return np.asarray((blocks >= mine.start) & (blocks < mine.stop))


def _tables(group: Held, copy: _Copy, block_of: Ints, mine: range) -> Iterator[tuple[Any, Ints]]:
    """Rows of a row group that belong to these blocks, as a table of the copy, and the block of each."""
    number = copy.index.number
    try:
        for part in parts(group.piece, copy.uses, copy.reading):
            block = block_of[numbered(part.tool, part.work, number.__getitem__)]
            rows = np.flatnonzero(_among(block, mine))
            if len(rows):
                cells = {use.header: _arrow(of_rows(part.columns[use.header], rows)) for use in copy.uses}
                yield pa.table(cells), block[rows]
    except UNREADABLE as error:
        raise _Damaged(group.piece.name) from error


def _arrow(values: Array | Labels) -> Any:  # noqa: ANN401  Arrow has no static types
    return pa.array(values.texts, pa.string()).take(pa.array(values.codes)) if isinstance(values, Labels) else values


@dataclass(slots=True)
class _Writers:
    """Files of some blocks; rows wait in memory until there are enough of them, then each file gets a row group."""

    folder: Path
    rows: list[int]
    blocks: range
    waiting: list[tuple[Any, Ints]] = field(default_factory=list)
    n: int = 0
    open: dict[int, Any] = field(default_factory=dict)

    def add(self, table: Any, block: Ints) -> None:  # noqa: ANN401
        """Take rows, and the block of each."""
        self.waiting.append((table, block))
        self.n += len(block)
        if self.n >= HELD_ROWS:
            self.flush()

    def flush(self) -> None:
        """Write the rows that wait, those of a block in their order."""
        if not self.n:
            return
        table = pa.concat_tables([table for table, _ in self.waiting]).combine_chunks()
        block = np.concatenate([block for _, block in self.waiting])
        self.waiting.clear()
        order = np.argsort(block, kind="stable")
        table, block = table.take(pa.array(order)), block[order]
        starts = np.searchsorted(block, [*self.blocks, self.blocks.stop])
        for i, start, stop in zip(self.blocks, starts[:-1].tolist(), starts[1:].tolist(), strict=True):
            if stop > start:
                self._writer(i, table.schema).write_table(table.slice(start, stop - start))
                self.rows[i] += stop - start
        self.n = 0

    def close(self) -> None:
        """Finish the files."""
        for writer in self.open.values():
            writer.close()

    def _writer(self, block: int, schema: Any) -> Any:  # noqa: ANN401
        if block not in self.open:
            path = self.folder / _file_name(block)
            self.open[block] = pq.ParquetWriter(path, schema, compression="zstd", write_page_checksum=True)
        return self.open[block]
