"""Dialect and columns of a CSV too large for memory, from its beginning."""

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import pandas as pd

from ...core.bounded import open_regular
from ...core.errors import DataError
from ...datasets import read_table
from ...datasets.columns import ColumnUse, assign
from ...datasets.edges.columns import label_test
from ...datasets.headers import is_known, parse_header
from ...datasets.reading import pair_name
from ...datasets.tables import Column, Table
from ...datasets.tables.dialect import split_line
from ...datasets.tables.numerals import Decimal
from ...datasets.units import is_unit
from ...datasets.vocabulary import ROLES, UNNAMED
from ...pipeline.reading import refuse_record
from ..plan import Reading
from .lab_files import NAMED_BY_FILE

Kind = Literal["number", "numbered", "text", "unused"]
_BRACKETS = "[](){}<>"
_COUNTED_LATER = ("fewer cells than the header", "Footer rows are left out", "Text below the data")


@dataclass(frozen=True, slots=True)
class HeadColumn:
    """A column as it goes on: its name with the unit of the units row, and whether its cells are numbers.

    Attributes
    ----------
    name : str
    kind : {"number", "numbered", "text", "unused"}
        Labels are text: as it stands, or, where they are numbers, as `Column.labels` writes them. What no law reads
        is left empty.
    """

    name: str
    kind: Kind


@dataclass(frozen=True, slots=True)
class Head:
    """Dialect and columns of a file, from its beginning.

    Attributes
    ----------
    columns : tuple of HeadColumn
        Of the table, in its order; none is left out.
    cells : int
        In a row: more than columns where rows end with a delimiter, fewer where all leave out the last.
    skip : int
        Lines above the first row of data.
    encoding, delimiter, decimal
    ascii : bool
        Whether the head leaves the encoding open.
    reading : Reading
        Remaining options of reading, with tool and work as the head names them.
    notes, assumed : tuple of str
    """

    columns: tuple[HeadColumn, ...]
    cells: int
    skip: int
    encoding: str
    delimiter: str
    decimal: Decimal
    ascii: bool
    reading: Reading
    notes: tuple[str, ...]
    assumed: tuple[str, ...]


def read_head(path: Path, reading: Reading, folder: Path, size: int) -> Head:
    """Dialect and columns of a file from its first ``size`` bytes.

    Parameters
    ----------
    path : Path
    reading : Reading
    folder : Path
        For the head as a file of its own, which is removed again.
    size : int

    Raises
    ------
    DataError
        The head holds no table, a record, two columns of one role, or is written in a way that only a whole file
        can be read in.
    UsageError
        The options do not fit it.
    """
    data = _whole_lines(path, size)
    table = _table(path, data, reading, folder)
    doubt = refuse_record(path, table) if not (reading.map or reading.ranges) else ()
    if table.dialect.delimiter in ("", " "):
        how = "holds one column" if table.dialect.delimiter == "" else "separates its cells by blanks"
        raise DataError(f"{path.name} {how}, and is too large to be read whole: export it with commas or semicolons.")
    uses, values, _ = assign(
        tuple(replace(c, bad=(), bad_count=0) for c in table.columns), reading.columns, reading.units
    )
    notes = tuple(note.lstrip("#% ") for note in table.notes)
    labels = pd.DataFrame({role: values[role] for role in UNNAMED if role in values})
    onward, assumed = _names(path, reading, labels, notes)
    line = int(table.lines[0])
    cells = _cells(data.decode(table.dialect.encoding, "replace"), table, line)
    return Head(
        _columns(table, uses, reading), cells, line - 1, table.dialect.encoding, table.dialect.delimiter,
        table.dialect.decimal, data.isascii(), onward, notes, (*doubt, *_warnings(table), *assumed),
    )  # fmt: skip


def _warnings(table: Table) -> tuple[str, ...]:
    """Warnings on the whole file: rows that are short, footers and remarks are counted while it is read."""
    return tuple(words for words in table.warnings if not any(mark in words for mark in _COUNTED_LATER))


def _whole_lines(path: Path, size: int) -> bytes:
    with open_regular(path, "stream") as file:
        data = file.read(size)
        if not file.read(1):
            return data
    cut = max(data.rfind(b"\n"), -1) + 1 or data.rfind(b"\r") + 1
    if not cut:
        raise DataError(f"{path.name} has no line end in its first {size} bytes: it is no table. Export it again.")
    if b"\0" in data[:1000]:  # UTF-16: the line end is two bytes
        cut += cut % 2
    return data[:cut]


def _table(path: Path, data: bytes, reading: Reading, folder: Path) -> Table:
    head = folder / "head" / path.name
    head.parent.mkdir(parents=True, exist_ok=True)
    try:
        head.write_bytes(data)
        return read_table(
            head, is_unit=is_unit, is_name=is_known, decimal=reading.decimal, delimiter=reading.delimiter,
            sheet=reading.sheet, is_label=label_test(reading.columns, reading.named),
        )  # fmt: skip
    finally:
        head.unlink(missing_ok=True)
        head.parent.rmdir()


def _names(
    path: Path, reading: Reading, labels: pd.DataFrame, notes: tuple[str, ...]
) -> tuple[Reading, tuple[str, ...]]:
    """Tool and work where no column has them: from a note, or the tool by the name of the file."""
    assumed: tuple[str, ...] = ()
    given = {"tool": reading.tool, "work": reading.work}
    for role, name in given.items():
        if name is None and role not in labels:
            noted = pair_name(role, labels, notes)
            given[role] = None if noted == UNNAMED[role] else noted
    if given["tool"] is None and "tool" not in labels:
        given["tool"] = path.stem
        assumed = (NAMED_BY_FILE.format(name=path.stem),)
    onward = replace(reading, tool=given["tool"], work=given["work"], decimal=None, delimiter=None, sheet=None)
    return onward, assumed


def _cells(text: str, table: Table, first: int) -> int:
    """Cells of most rows of the head."""
    lines = text.splitlines()[first - 1 :]
    counts = Counter(len(split_line(line, table.dialect.delimiter)) for line in lines if line.strip())
    return counts.most_common(1)[0][0]


def _columns(table: Table, uses: tuple[ColumnUse, ...], reading: Reading) -> tuple[HeadColumn, ...]:
    """All columns up to the last, in their places, so that ``col7`` stays the seventh."""
    known = {column.number: (column, use) for column, use in zip(table.columns, uses, strict=True)}
    taken: set[str] = set()
    columns = []
    for number in range(1, max(known) + 1):
        if number not in known:
            columns.append(HeadColumn(f"col{number}", "unused"))
            continue
        column, use = known[number]
        name = _name(column)
        name = f"col{number}" if name in taken else name
        taken.add(name)
        columns.append(HeadColumn(name, _kind(column, use, name, reading)))
    return tuple(columns)


def _kind(column: Column, use: ColumnUse, name: str, reading: Reading) -> Kind:
    if use.role is not None and ROLES[use.role].kind != "label":
        return "number"
    if use.role is None and not {column.name, use.name, name} & set(reading.groups):
        return "unused"
    return "numbered" if column.is_numeric else "text"


def _name(column: Column) -> str:
    """The header followed by the unit of the units row, as one header.

    >>> import numpy as np
    >>> _name(Column(1, "vc", "(m/min)", np.array([1.0]), True))
    'vc [m/min]'
    """
    unit = column.unit_cell.strip()
    if len(unit) > 1 and (unit[0] + unit[-1]) in _BRACKETS:
        unit = unit[1:-1].strip()
    if not unit:
        return column.name
    joined = f"{parse_header(column.name).name} [{unit}]"
    return joined if parse_header(joined).unit_text == unit else column.name
