"""Row groups of a Parquet source: rows batch by batch, and the pairs that each contains."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Array, Ints
from ...datasets.columns import ColumnUse
from ...datasets.vocabulary import ROLES, UNNAMED
from ..engine import Run
from ..plan import Pair, Piece, Reading
from .parquet_arrow import (
    UNREADABLE,
    Labels,
    constant,
    kind_of,
    labels,
    numbered,
    numbers,
    pa,
    pq,
    text_of,
    why,
)
from .parquet_schema import FILE_NAME, ParquetFile, SourceColumns, footer, mismatch, names_of_files, number_of

BATCH = 262_144  # rows
ENOUGH = 32_768  # rows of a batch that is not joined with the next one
MANY = 32  # tasks of so many rows
NONE = np.zeros(0, dtype=np.intp)


@dataclass(frozen=True, slots=True)
class PieceRows:
    """Some rows of a piece.

    Attributes
    ----------
    n : int
    tool, work : Labels
        With the stand-ins where nothing is named.
    columns : mapping of str to ndarray or Labels
        By header: numbers of roles that are measured, as they stand in the file; texts of the others.
    """

    n: int
    tool: Labels
    work: Labels
    columns: Mapping[str, Array | Labels]


def parts(
    piece: Piece, uses: tuple[ColumnUse, ...], reading: Reading, row_groups: Sequence[int] | None = None
) -> Iterator[PieceRows]:
    """Rows of a piece with these columns, which hold those of the pair where they are columns.

    Row groups of the same file may be read one after the other, as if they were one piece.

    Raises whatever Arrow raises for a file that is damaged.
    """
    known = footer(piece.path, piece.stamp)
    schema = known.schema.to_arrow_schema()
    if row_groups is None:
        row_groups = range(known.num_row_groups) if piece.row_group is None else [piece.row_group]
    partition = dict(piece.partition)
    names = [use.header for use in uses if use.header not in partition and not is_measured(use)]
    partition |= {name: label for name in names if (label := _same_label(known, row_groups, name)) is not None}
    inside = [use.header for use in uses if use.header not in partition]
    texts = [name for name in inside if kind_of(schema.field(name).type) == "text"]
    if not inside:
        yield _part(sum(known.row_group(i).num_rows for i in row_groups), {}, partition, uses, reading)
        return
    with pq.ParquetFile(
        Path(piece.path), metadata=known, read_dictionary=texts, page_checksum_verification=True
    ) as opened:
        batches = opened.iter_batches(batch_size=BATCH, row_groups=row_groups, columns=inside, use_threads=False)
        for rows in _gathered(batches):
            yield _part(len(rows), {name: rows.column(name) for name in inside}, partition, uses, reading)


def _gathered(batches: Iterable[Any]) -> Iterator[Any]:
    """Batches of ``ENOUGH`` rows or more: Arrow ends one with each row group, however small."""
    waiting: list[Any] = []
    n = 0
    for rows in batches:
        waiting.append(rows)
        n += len(rows)
        if n >= ENOUGH:
            yield _one(waiting)
            waiting, n = [], 0
    if waiting:
        yield _one(waiting)


def _one(batches: list[Any]) -> Any:  # noqa: ANN401
    if len(batches) == 1:
        return batches[0]
    return pa.Table.from_batches(batches).unify_dictionaries().combine_chunks().to_batches()[0]


def _part(
    n: int, cells: Mapping[str, Any], partition: Mapping[str, str], uses: tuple[ColumnUse, ...], reading: Reading
) -> PieceRows:
    columns: dict[str, Array | Labels] = {}
    pair = {role: constant(getattr(reading, role) or UNNAMED[role], n) for role in UNNAMED}
    for use in uses:
        array = cells.get(use.header)
        if is_measured(use):
            columns[use.header] = np.full(n, number_of(partition[use.header])) if array is None else numbers(array)
            continue
        found = constant(partition[use.header], n) if array is None else labels(array)
        columns[use.header] = found
        if use.role in pair and getattr(reading, use.role) is None:
            pair[use.role] = found.named(UNNAMED[use.role])
    return PieceRows(n, pair["tool"], pair["work"], columns)


def is_measured(use: ColumnUse) -> bool:
    """Whether a column holds numbers with a unit, no labels."""
    return use.role is not None and ROLES[use.role].kind != "label"


def of_rows(values: Array | Labels, rows: Ints | slice) -> Array | Labels:
    """Some rows of a column."""
    return values.of(rows) if isinstance(values, Labels) else values[rows]


@dataclass(frozen=True, slots=True)
class Held:
    """Contents of a row group: numbers of its pairs in order of appearance, and the rows of each."""

    piece: Piece
    pairs: Ints
    counts: Ints

    @property
    def rows(self) -> int:
        """All its rows."""
        return int(self.counts.sum())


@dataclass(frozen=True, slots=True)
class Index:
    """Pairs by number, their rows in each row group, and unreadable parts."""

    number: dict[tuple[str, str], int] = field(default_factory=dict)
    held: list[Held] = field(default_factory=list)
    unreadable: dict[str, str] = field(default_factory=dict)

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """In the order in which the rows name them."""
        return tuple(Pair(tool, work) for tool, work in self.number)

    @property
    def rows(self) -> Ints:
        """Rows of each pair, shape (n_pairs,)."""
        counts = np.zeros(len(self.number), dtype=np.intp)
        for group in self.held:
            counts[group.pairs] += group.counts
        return counts

    def of(self, pair: tuple[str, str]) -> int:
        """Number of a pair, the next one where it is new."""
        return self.number.setdefault(pair, len(self.number))


@dataclass(frozen=True, slots=True)
class Contents:
    """Pairs that a row group names, in order of appearance, the rows of each, or the reason why it cannot be read."""

    pairs: tuple[tuple[str, str], ...]
    counts: Ints
    unreadable: str = ""


@dataclass(frozen=True, slots=True)
class _Found:
    """A row group, or a file that cannot be used: its name, its rows, and its contents where the footer shows them."""

    file: int
    name: str
    contents: Contents | None
    piece: Piece | None = None
    rows: int = 0


def indexed(
    files: tuple[ParquetFile, ...],
    known: SourceColumns,
    reading: Reading,
    report: Callable[[str], None],
    workers: Run,
) -> Index:
    """Index of all files, in order; a file or a row group that cannot be read is recorded and skipped.

    Columns that name the pairs are read by ``workers``. Processes are started for ``MANY`` tasks: they take longer to
    start than fewer take.
    """
    index = Index()
    keys = tuple(use for use in known.columns if use.role in UNNAMED and getattr(reading, str(use.role)) is None)
    found = list(_row_groups(files, known, keys, reading))
    work = partial(contents_of, keys=keys, reading=reading)
    tasks = list(_together(found))
    read = chain.from_iterable(workers.where(len(tasks) >= MANY).in_order(work, tasks))
    for before, one in zip([None, *found], found, strict=False):
        if one.file and one.file % 500 == 0 and before is not None and before.file != one.file:
            report(f"indexed {one.file} of {len(files)} files: {len(index.number)} pairs")
        contents = next(read) if one.contents is None else one.contents
        if contents.unreadable:
            index.unreadable[one.name] = contents.unreadable
        elif one.piece is not None and len(contents.pairs):
            numbers = np.array([index.of(pair) for pair in contents.pairs], dtype=np.intp)
            index.held.append(Held(one.piece, numbers, contents.counts))
    return index


def _row_groups(
    files: tuple[ParquetFile, ...], known: SourceColumns, keys: tuple[ColumnUse, ...], reading: Reading
) -> Iterator[_Found]:
    """Row groups of all files, by their footers alone."""
    stems = names_of_files(files) if any(use.header == FILE_NAME for use in keys) else None
    for i, file in enumerate(files):
        partition = _own_partition(file, known, None if stems is None else stems[i])
        try:
            facts = footer(str(file.path), file.stamp)
        except UNREADABLE as error:
            yield _Found(i, file.name, _unreadable(file.name, error))
            continue
        if reason := mismatch(file, facts.schema.to_arrow_schema(), known, reading):
            yield _Found(i, file.name, Contents((), NONE, reason))
            continue
        for j in range(facts.num_row_groups):
            name = f"{file.name}, row group {j}" if facts.num_row_groups > 1 else file.name
            piece = Piece(str(file.path), name, file.stamp, j, partition)
            try:
                rows = facts.row_group(j).num_rows
                pair = _only_pair(piece, facts, keys, reading) if rows else None
            except UNREADABLE as error:
                yield _Found(i, name, _unreadable(name, error))
            else:
                yield _Found(i, name, None if pair is None else Contents((pair,), np.array([rows])), piece, rows)


def _own_partition(file: ParquetFile, known: SourceColumns, stem: str | None) -> tuple[tuple[str, str], ...]:
    """Values of folders without a column in the files, and the file's name where that is the tool."""
    partition = tuple((key, value) for key, value in file.partition if key not in known.kinds)
    return partition if stem is None or FILE_NAME in known.kinds else (*partition, (FILE_NAME, stem))


def _together(found: Iterable[_Found]) -> Iterator[tuple[Piece, ...]]:
    """Row groups whose columns are read, as many as are one task."""
    task: list[Piece] = []
    rows = 0
    for one in found:
        if one.contents is None and one.piece is not None:
            if task and rows + one.rows > BATCH:
                yield tuple(task)
                task, rows = [], 0
            task.append(one.piece)
            rows += one.rows
    if task:
        yield tuple(task)


def contents_of(pieces: Sequence[Piece], keys: tuple[ColumnUse, ...], reading: Reading) -> list[Contents]:
    """Contents of row groups by the columns ``keys`` that name the pairs."""
    return [_contents(piece, keys, reading) for piece in pieces]


def _contents(piece: Piece, keys: tuple[ColumnUse, ...], reading: Reading) -> Contents:
    named: dict[tuple[str, str], int] = {}
    counts: list[Ints] = []
    try:
        for part in parts(piece, keys, reading):
            here = numbered(part.tool, part.work, lambda pair: named.setdefault(pair, len(named)))
            counts.append(np.bincount(here, minlength=len(named)))
    except UNREADABLE as error:  # a row group that breaks off names no pair to the index
        return _unreadable(piece.name, error)
    total = np.zeros(len(named), dtype=np.intp)
    for count in counts:
        total[: len(count)] += count
    return Contents(tuple(named), total)


def _unreadable(name: str, error: BaseException) -> Contents:
    return Contents((), NONE, f"{name}: cannot be read: {why(error)}.")


def _only_pair(piece: Piece, facts: Any, keys: tuple[ColumnUse, ...], reading: Reading) -> tuple[str, str] | None:  # noqa: ANN401
    """The pair of all rows of a row group, where the folders or its statistics name it."""
    partition = dict(piece.partition)
    names = {role: getattr(reading, role) or UNNAMED[role] for role in UNNAMED}
    for use in keys:
        value = partition.get(use.header)
        if value is None and (value := _only_value(facts, piece.row_group, use.header)) is None:
            return None
        names[str(use.role)] = value or UNNAMED[str(use.role)]
    return names["tool"], names["work"]


def _same_label(facts: Any, row_groups: Sequence[int], header: str) -> str | None:  # noqa: ANN401
    """The label of all rows of some row groups by their statistics, so that the column need not be read."""
    first = _only_value(facts, row_groups[0], header) if row_groups else None
    same = first is not None and all(_only_value(facts, i, header) == first for i in row_groups[1:])
    return first if same else None


def _only_value(facts: Any, row_group: int | None, header: str) -> str | None:  # noqa: ANN401
    """The label of all rows by the statistics: least and largest are the same, and none is missing."""
    schema = facts.schema
    column = next(i for i in range(len(schema)) if schema.column(i).path == header)
    stats = facts.row_group(row_group).column(column).statistics
    if stats is None or not (stats.has_min_max and stats.has_null_count) or stats.null_count:
        return None
    kind = kind_of(schema.to_arrow_schema().field(header).type)
    exact = kind == "text" or (kind == "number" and isinstance(stats.min, int))  # NaN is in no statistics
    return text_of(stats.min) if exact and stats.min == stats.max else None
