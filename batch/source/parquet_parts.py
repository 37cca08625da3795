"""A piece of a Parquet source, read batch by batch: which pair each row names, and the columns that are needed."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...datasets.columns import ColumnUse
from ...datasets.vocabulary import ROLES, UNNAMED
from ..plan import Piece, Reading
from .parquet_arrow import pa, pq
from .parquet_cells import Array, Ints, Labels, constant, kind_of, labels, numbers
from .parquet_columns import number_of
from .parquet_files import footer

BATCH = 262_144  # rows


@dataclass(frozen=True, slots=True)
class Part:
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
) -> Iterator[Part]:
    """Rows of a piece with these columns, which hold those of the pair where they are columns.

    Row groups of the same file may be read one after the other, as if they were one piece.

    Raises whatever Arrow raises for a file that is damaged.
    """
    said = dict(piece.partition)
    known = footer(piece.path, piece.stamp)
    schema = known.schema.to_arrow_schema()
    inside = [use.header for use in uses if use.header not in said]
    texts = [name for name in inside if kind_of(schema.field(name).type) == "text"]
    if row_groups is None:
        row_groups = range(known.num_row_groups) if piece.row_group is None else [piece.row_group]
    if not inside:
        yield _part(sum(known.row_group(i).num_rows for i in row_groups), {}, said, uses, reading)
        return
    with pq.ParquetFile(
        Path(piece.path), metadata=known, read_dictionary=texts, page_checksum_verification=True
    ) as opened:
        batches = opened.iter_batches(batch_size=BATCH, row_groups=row_groups, columns=inside, use_threads=False)
        for rows in _gathered(batches):
            yield _part(len(rows), {name: rows.column(name) for name in inside}, said, uses, reading)


def _gathered(batches: Iterable[Any]) -> Iterator[Any]:
    """Batches of about ``BATCH`` rows: Arrow ends one with each row group, however small."""
    waiting: list[Any] = []
    n = 0
    for rows in batches:
        waiting.append(rows)
        n += len(rows)
        if n >= BATCH:
            yield _one(waiting)
            waiting, n = [], 0
    if waiting:
        yield _one(waiting)


def _one(batches: list[Any]) -> Any:  # noqa: ANN401
    if len(batches) == 1:
        return batches[0]
    return pa.Table.from_batches(batches).unify_dictionaries().combine_chunks().to_batches()[0]


def _part(
    n: int,
    cells: Mapping[str, Any],
    said: Mapping[str, str],
    uses: tuple[ColumnUse, ...],
    reading: Reading,
) -> Part:
    columns: dict[str, Array | Labels] = {}
    pair = {role: constant(getattr(reading, role) or UNNAMED[role], n) for role in UNNAMED}
    for use in uses:
        array = cells.get(use.header)
        if is_measured(use):
            columns[use.header] = np.full(n, number_of(said[use.header])) if array is None else numbers(array)
            continue
        found = constant(said[use.header], n) if array is None else labels(array)
        columns[use.header] = found
        if use.role in pair and getattr(reading, use.role) is None:
            pair[use.role] = found.named(UNNAMED[use.role])
    return Part(n, pair["tool"], pair["work"], columns)


def is_measured(use: ColumnUse) -> bool:
    """Whether a column holds numbers with a unit, no labels."""
    return use.role is not None and ROLES[use.role].kind != "label"


def of_rows(values: Array | Labels, rows: Ints | slice) -> Array | Labels:
    """Some rows of a column."""
    return values.of(rows) if isinstance(values, Labels) else values[rows]
