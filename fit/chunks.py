"""Chunks of a stream: read into blocks of one length, and filtered to the rows that a law can use.

Blocks have one length, so that a result does not depend on the chunks. Columns are checked here once: numbers where a
law needs numbers, names of edges and levels as text.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from ..core.arrays import Array, Flags, Ints
from ..core.errors import DataError, UsageError
from ..core.rounding import label_of
from .rows import Dropped

Chunk = Mapping[str, object] | pd.DataFrame

NAMED = 5  # rows of each reason that are listed by line
FEW = 1024  # labels of a chunk that are expected: a small hash table stays in the cache, and grows where it must
ROWS = 32_768  # of a block: its columns stay in the processor's cache


@dataclass(slots=True)
class LabelNumbers:
    """Labels of a column, numbered in the order of their first appearance."""

    numbers: dict[str, int] = field(default_factory=dict)

    def codes(self, labels: "pd.Series[str]") -> Ints:
        """Number of each label, shape (m,); whole numbers read ``1``, not ``1.0``, and missing ones are empty."""
        numeric = isinstance(labels.dtype, np.dtype) and labels.dtype.kind in "iuf"
        code, unique = pd.factorize(labels.to_numpy(), size_hint=FEW) if numeric else pd.factorize(labels)
        texts = [label_of(label) for label in unique]
        if (code < 0).any():
            texts.append("")  # missing is -1, and so the last
        return np.array([self.numbers.setdefault(text, len(self.numbers)) for text in texts], dtype=np.intp).take(code)

    def in_order(self, present: Ints) -> tuple[tuple[str, ...], Ints]:
        """Sorted names among those present, and their numbers."""
        texts = list(self.numbers)
        order = sorted(present.tolist(), key=texts.__getitem__)
        return tuple(texts[i] for i in order), np.array(order, dtype=np.intp)


@dataclass(frozen=True, slots=True)
class RowBlock:
    """Some rows of a table.

    Attributes
    ----------
    first : int
        Number of the first row, counted from 0 over all chunks.
    columns : tuple of ndarray, shape (m,)
        Response, then factors, NaN where missing.
    edge, level : ndarray of int, shape (m,), or None
        Numbers of the row's edge and of its level of the category.
    """

    first: int
    columns: tuple[Array, ...]
    edge: Ints | None
    level: Ints | None

    def __len__(self) -> int:
        return len(self.columns[0])

    def part(self, start: int, stop: int) -> "RowBlock":
        """Rows from ``start`` up to ``stop``, which share their memory with these."""
        rows = slice(start, stop)
        return RowBlock(
            self.first + start,
            tuple(column[rows] for column in self.columns),
            None if self.edge is None else self.edge[rows],
            None if self.level is None else self.level[rows],
        )


@dataclass(slots=True)
class ChunkReader:
    """Columns read from every chunk, and the labels so far; the first chunk decides whether there are edges."""

    names: Sequence[str]
    edge: str | None
    by: str | None
    edges: LabelNumbers = field(default_factory=LabelNumbers)
    levels: LabelNumbers = field(default_factory=LabelNumbers)
    rows: int = 0
    chunks: int = 0

    def blocks(self, chunks: Iterable[Chunk], size: int = ROWS) -> Iterator[RowBlock]:
        """All rows in order, ``size`` at a time; the last block may be shorter."""
        held: list[RowBlock] = []
        waiting = 0
        for chunk in chunks:
            read, start = self._read(chunk), 0
            while start < len(read):
                part = read.part(start, start + size - waiting)
                held.append(part)
                start, waiting = start + len(part), waiting + len(part)
                if waiting == size:
                    yield _joined(held)
                    held, waiting = [], 0
        if held:
            yield _joined(held)

    def _read(self, chunk: Chunk) -> RowBlock:
        if not self.chunks and self.edge is not None and self.edge not in chunk:
            self.edge = None
        self.chunks += 1
        wanted = [*self.names, *(name for name in (self.by, self.edge) if name is not None)]
        columns = {name: self._column(chunk, name) for name in wanted}
        lengths = {name: len(column) for name, column in columns.items()}
        odd = next((name for name in wanted if lengths[name] != lengths[wanted[0]]), None)
        if odd is not None:
            raise DataError(
                f"chunk {self.chunks}: {odd!r} has {lengths[odd]} rows and {wanted[0]!r} {lengths[wanted[0]]}; "
                "columns of a chunk need one length."
            )
        first, self.rows = self.rows, self.rows + lengths[wanted[0]]
        return RowBlock(
            first,
            tuple(_numbers(name, columns[name]) for name in self.names),
            None if self.edge is None else self.edges.codes(columns[self.edge]),
            None if self.by is None else self.levels.codes(columns[self.by]),
        )

    def _column(self, chunk: Chunk, name: str) -> "pd.Series[str]":
        if name not in chunk:
            given = ", ".join(map(str, chunk)) or "nothing"
            raise UsageError(f"chunk {self.chunks} has no column {name!r}; it has {given}. Every chunk needs it.")
        values = chunk[name]
        return values if isinstance(values, pd.Series) else pd.Series(np.atleast_1d(np.asarray(values)), copy=False)


def _numbers(name: str, column: "pd.Series[str]") -> Array:
    if not pd.api.types.is_numeric_dtype(column) or pd.api.types.is_bool_dtype(column):
        raise UsageError(f"column {name!r} holds text; a law needs numbers.")
    return column.to_numpy(dtype=float, na_value=np.nan)


def _joined(parts: list[RowBlock]) -> RowBlock:
    if len(parts) == 1:
        return parts[0]
    edges = [part.edge for part in parts if part.edge is not None]
    levels = [part.level for part in parts if part.level is not None]
    return RowBlock(
        parts[0].first,
        tuple(np.concatenate(of) for of in zip(*(part.columns for part in parts), strict=True)),
        np.concatenate(edges) if edges else None,
        np.concatenate(levels) if levels else None,
    )


@dataclass(frozen=True, slots=True)
class UsableRows:
    """Rows that are used, all above zero.

    Attributes
    ----------
    columns : tuple of ndarray, shape (m,)
        Response, then factors.
    low, high : ndarray, shape (1 + k,)
        Least and greatest value of each column; NaN without rows.
    edge, level : ndarray of int, shape (m,), or None
    """

    columns: tuple[Array, ...]
    low: Array
    high: Array
    edge: Ints | None
    level: Ints | None

    def __len__(self) -> int:
        return len(self.columns[0])


@dataclass(slots=True)
class RowFilter:
    """Leaves out rows for the reasons, and in the order, of a fit in memory."""

    names: Sequence[str]
    by: str | None
    counts: dict[str, int] = field(default_factory=dict)
    lines: dict[str, list[int]] = field(default_factory=dict)

    def usable(self, block: RowBlock, levels: LabelNumbers) -> UsableRows:
        """Rows of the block without missing values, above zero.

        Raises
        ------
        DataError
            A value is infinite.
        """
        low, high = _ends(block.columns)
        missing = levels.numbers.get("", -1)
        if np.all(low > 0) and np.all(high < np.inf) and (block.level is None or missing < 0):  # False for NaN
            return UsableRows(block.columns, low, high, block.edge, block.level)
        _check_finite(self.names, block)
        named = list(zip(self.names, block.columns, strict=True))
        bad = [(f"{name} missing", np.isnan(column)) for name, column in named]
        if block.level is not None:
            bad.append((f"{self.by} missing", np.asarray(block.level == missing)))
        bad += [
            (f"{name} zero or negative", column <= 0) for name, column in zip(self.names, block.columns, strict=True)
        ]
        keep = np.ones(len(block), dtype=bool)
        for reason, rows in bad:
            self._count(reason, block.first, rows & keep)
            keep &= ~rows
        columns = tuple(column[keep] for column in block.columns)
        edge = None if block.edge is None else block.edge[keep]
        return UsableRows(columns, *_ends(columns), edge, None if block.level is None else block.level[keep])

    def dropped(self) -> tuple[Dropped, ...]:
        """The rows left out, by reason."""
        return tuple(
            Dropped(reason, count, tuple(self.lines[reason])) for reason, count in self.counts.items() if count
        )

    def _count(self, reason: str, first: int, rows: Flags) -> None:
        self.counts.setdefault(reason, 0)  # so that reasons keep their order
        if not rows.any():
            return
        found = self.lines.setdefault(reason, [])
        self.counts[reason] += int(rows.sum())
        found += (first + np.flatnonzero(rows)[: NAMED - len(found)]).tolist()


def _ends(columns: Sequence[Array]) -> tuple[Array, Array]:
    """Least and greatest value of each column, NaN where one is missing or there is none."""
    if not len(columns[0]):
        return np.full(len(columns), np.nan), np.full(len(columns), np.nan)
    return np.array([column.min() for column in columns]), np.array([column.max() for column in columns])


def _check_finite(names: Sequence[str], block: RowBlock) -> None:
    for name, values in zip(names, block.columns, strict=True):
        infinite = np.isinf(values)
        if infinite.any():
            row = int(np.argmax(infinite))
            raise DataError(
                f"column {name!r} row {block.first + row}: {values[row]} is not a measurement; leave the row out."
            )
