"""Rows of a long CSV in blocks: text by pyarrow, then numbers and labels; irregular rows are counted."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute as pc  # type: ignore[import-untyped]
from pyarrow import csv

from ...core.bounded import open_regular
from ...core.errors import DataError
from ...core.rounding import count, label_of
from ...datasets.tables.dialect import is_comment, split_line
from ...datasets.tables.layout import footer_label
from ...datasets.tables.numerals import (
    MISSING_AS_WRITTEN,
    Decimal,
    is_missing,
    is_number,
    is_plain_label,
    parse_number,
)

if TYPE_CHECKING:
    from .csv_head import Head

_PLAIN = {"point": r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$", "comma": r"^[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?$"}
_MINUS = "\N{MINUS SIGN}"


@dataclass(slots=True)
class OddCells:
    """Cells of a column of numbers that are none: how many, and the first of them with its row, counted from 1."""

    count: int = 0
    row: int = 0
    text: str = ""

    def sentence(self, name: str) -> str:
        """The sentence on these cells.

        >>> OddCells(2, 17, "worn").sentence("VB")
        "column 'VB': 2 cells are no numbers and count as missing, the first in row 17 of the data: 'worn'."
        """
        cells = count(self.count, "cell is no number and counts", "cells are no numbers and count")
        return f"column {name!r}: {cells} as missing, the first in row {self.row} of the data: {self.text!r}."


@dataclass(slots=True)
class Cells:
    """Converts columns of cells, and remembers the odd ones."""

    decimal: Decimal
    odd: dict[str, OddCells] = field(default_factory=dict)

    def numbers(self, name: str, cells: Any, first_row: int) -> Any:  # noqa: ANN401  Arrow has no static types
        """An array of doubles, null where a cell is missing or no number.

        >>> Cells("comma").numbers("f", pa.array(["1.234,5", " 0,2", None, "worn"]), 1).to_pylist()
        [1234.5, 0.2, None, None]
        """
        plain = self._at_once(cells)
        return plain if plain is not None else self._one_by_one(name, cells, first_row)

    def labels(self, cells: Any, *, as_numbers: bool) -> Any:  # noqa: ANN401
        """Texts as written; of a column of numbers whole ones without a point, as `Column.labels` writes them.

        >>> Cells("point").labels(pa.array(["1.0", " 1", "E7", "1.7220", None]), as_numbers=True).to_pylist()
        ['1', '1', 'E7', '1.7220', None]
        """
        coded = cells.dictionary_encode()
        texts = pa.array([self._label(text, as_numbers) for text in coded.dictionary.to_pylist()], pa.string())
        return texts.take(coded.indices)

    def _label(self, text: str, as_numbers: bool) -> str | None:
        if is_missing(text):
            return None
        value = parse_number(text, self.decimal) if as_numbers else None
        plain = value is not None and is_plain_label(text, value, self.decimal)
        return label_of(value) if plain else text.strip()

    def _at_once(self, cells: Any) -> Any:  # noqa: ANN401
        """All cells as plain finite numbers, or None."""
        if self.decimal == "comma":
            if pc.any(pc.match_substring(cells, ".")).as_py():
                return None  # a thousands mark, or another decimal mark
            cells = pc.replace_substring(cells, ",", ".")
        try:
            values = pc.cast(cells, pa.float64())
        except pa.ArrowInvalid:
            return None
        return values if pc.all(pc.is_finite(values)).as_py() is not False else None

    def _one_by_one(self, name: str, cells: Any, first_row: int) -> Any:  # noqa: ANN401
        """Plain cells at once, each of the others by the grammar of numbers."""
        cells = pc.replace_substring(pc.utf8_trim_whitespace(cells), _MINUS, "-")
        plain = pc.fill_null(pc.match_substring_regex(cells, _PLAIN[self.decimal]), False)
        text = pc.replace_substring(cells, ",", ".") if self.decimal == "comma" else cells
        values = pc.cast(pc.if_else(plain, text, None), pa.float64())
        plain = pc.fill_null(pc.is_finite(values), False)
        others = pc.and_(pc.is_valid(cells), pc.invert(plain))
        if not pc.any(others).as_py():
            return values
        coded = pc.filter(cells, others).dictionary_encode()
        known = coded.dictionary.to_pylist()
        read = [parse_number(text, self.decimal) for text in known]
        bad = [value is None and not is_missing(text) for text, value in zip(known, read, strict=True)]
        self._note(name, coded, bad, pc.indices_nonzero(others), first_row)
        return pc.replace_with_mask(values, others, pa.array(read, pa.float64()).take(coded.indices))

    def _note(self, name: str, coded: Any, bad: list[bool], rows: Any, first_row: int) -> None:  # noqa: ANN401
        found = pc.indices_nonzero(pa.array(bad, pa.bool_()).take(coded.indices))
        if len(found):
            odd = self.odd.setdefault(name, OddCells())
            if not odd.count:
                at = found[0].as_py()
                odd.row, odd.text = first_row + rows[at].as_py(), coded[at].as_py()[:40]
            odd.count += len(found)


MOST_ODD = 100_000  # rows of another width that are held


@dataclass(slots=True)
class IrregularRows:
    """Rows of another width, comments and blank rows met on the way."""

    head: "Head"
    name: str
    short: list[list[str]] = field(default_factory=list)
    remarks: int = 0
    wide: str = ""
    footers: list[str] = field(default_factory=list)

    def odd(self, row: Any) -> str:  # noqa: ANN401  pyarrow.csv.InvalidRow
        """Take a row whose cells are more or fewer than those of the others."""
        text = row.text
        if is_comment(text, self.head.delimiter):
            self.remarks += 1
            return "skip"
        cells = split_line(text, self.head.delimiter)
        width = len(self.head.columns)
        if any(cell.strip() for cell in cells[width:]):
            self.wide = self.wide or text[:80]
            return "error"
        if label := footer_label(cells):
            self.footers.append(label)
        elif not any(map(is_number, cells)):
            self.remarks += any(cell.strip() for cell in cells)
        else:
            self.short.append([*cells, *[""] * (width - len(cells))][:width])
        return "skip" if len(self.short) <= MOST_ODD else "error"

    def refusal(self) -> DataError | None:
        """The error of the row that stopped the reading, if one did."""
        width = len(self.head.columns)
        if self.wide:
            return DataError(
                f"{self.name}: a row has more cells than the {width} of the header: {self.wide!r}. Give the extra "
                "column a name, or remove the extra cell."
            )
        if len(self.short) > MOST_ODD:
            return DataError(
                f"{self.name}: more than {MOST_ODD} rows have fewer or more cells than the others, the first "
                f"{self.head.delimiter.join(self.short[0])!r}: export the file with as many cells in every row."
            )
        return None

    def sentences(self) -> Iterator[str]:
        """Sentences on these rows."""
        if self.short:
            rows = count(len(self.short), "row has", "rows have")
            yield f"{rows} fewer cells than the header; the cells that are lacking count as missing."
        if self.remarks:
            yield f"{count(self.remarks, 'line')} of remarks among the data left out."
        if self.footers:
            yield f"Footer rows are left out: {', '.join(map(repr, self.footers))}."


def batches(
    source: Path, head: "Head", met: IrregularRows, report: Callable[[str], None], block_size: int, cells: Cells
) -> Iterator[list[Any]]:
    """The columns of each block of rows, and at last of the rows that were short."""
    done, waiting = 0, None
    for texts in _texts(source, head, met, report, block_size):
        if waiting is not None:
            yield _columns(waiting, head, cells, done)
            done += waiting.num_rows
        waiting = _without_blanks(texts)
    if waiting is not None:
        waiting = _without_footers(waiting, met)
        yield _columns(waiting, head, cells, done)
        done += waiting.num_rows
    if met.short:
        names = [column.name for column in head.columns]
        columns = [pa.array([cell if cell not in MISSING_AS_WRITTEN else None for cell in column], pa.string())
                   for column in zip(*met.short, strict=True)]  # fmt: skip
        yield _columns(pa.RecordBatch.from_arrays(columns, names=names), head, cells, done)


def _texts(
    source: Path, head: "Head", met: IrregularRows, report: Callable[[str], None], block_size: int
) -> Iterator[Any]:
    """Batches of rows as text, null where a cell is missing."""
    names = [column.name for column in head.columns]
    padded = [*names, *(f"\0{k}" for k in range(len(names), head.cells))][: max(head.cells, 1)]
    size, percent = source.stat().st_size, -1
    with open_regular(source, "stream") as file:
        try:
            reader = csv.open_csv(
                file,
                read_options=csv.ReadOptions(
                    column_names=padded, skip_rows=head.skip, block_size=block_size, encoding=_codec(head.encoding)
                ),
                parse_options=csv.ParseOptions(delimiter=head.delimiter, invalid_row_handler=met.odd),
                convert_options=csv.ConvertOptions(
                    column_types=dict.fromkeys((*names, *padded), pa.string()), include_columns=names,
                    include_missing_columns=True, null_values=sorted(MISSING_AS_WRITTEN), strings_can_be_null=True,
                ),
            )  # fmt: skip
            with reader:
                for k, batch in enumerate(reader, start=1):
                    if (now := min(100 * k * block_size // size, 100)) > percent:
                        percent = now
                        report(f"converting {source.name}: {percent} %")
                    yield batch
        except pa.ArrowInvalid as error:
            raise _refused(source, met, error) from error


def _refused(source: Path, met: IrregularRows, error: Exception) -> Exception:
    if refusal := met.refusal():
        return refusal
    if "UTF8" in str(error):
        return UnicodeError(str(error))
    why = str(error).splitlines()[0][:200]
    return DataError(f"{source.name} cannot be read as a table: {why}. Export it again, one row a line.")


def _codec(encoding: str) -> str:
    return "utf8" if encoding in ("utf-8", "utf-8-sig") else encoding


def _columns(batch: Any, head: "Head", cells: Cells, done: int) -> list[Any]:  # noqa: ANN401
    made = []
    for column, texts in zip(head.columns, batch.columns, strict=True):
        if column.kind == "number":
            made.append(cells.numbers(column.name, texts, done + 1))
        elif column.kind == "unused":
            made.append(pa.nulls(len(texts)))
        else:
            made.append(cells.labels(texts, as_numbers=column.kind == "numbered"))
    return made


def _without_blanks(batch: Any) -> Any:  # noqa: ANN401
    """Rows that hold anything: programs pad tables with rows of delimiters."""
    blank = None
    for column in batch.columns:
        empty = pc.is_null(column)
        blank = empty if blank is None else pc.and_(blank, empty)
        if not pc.any(blank).as_py():
            return batch
    return batch.filter(pc.invert(blank))


def _without_footers(batch: Any, met: IrregularRows) -> Any:  # noqa: ANN401
    """The last rows that are sums or means left out."""
    while batch.num_rows:
        last = [value or "" for value in batch.slice(batch.num_rows - 1).to_pylist()[0].values()]
        if not (label := footer_label(last)):
            break
        met.footers.append(label)
        batch = batch.slice(0, batch.num_rows - 1)
    return batch
