"""An .xlsx workbook, read by the parser of openpyxl, which keeps hidden parts, merged cells and number formats."""

import io
import warnings
from collections.abc import Generator, Iterator, Sequence
from typing import Any

import openpyxl
from openpyxl.styles.numbers import BUILTIN_FORMATS
from openpyxl.utils.cell import range_boundaries
from openpyxl.worksheet._reader import COL_TAG, DATA_TAG, FORMULA_TAG, ROW_TAG, VALUE_TAG, WorkSheetParser
from openpyxl.xml.functions import iterparse

from ...core.errors import DataError
from .numerals import Cell
from .workbook import MOST_CELLS
from .worksheet import Place, Row, WorkbookSheet, cell_of, damaged, is_length_of_time, shown_time, without_hidden

_TRUE = ("1", "true")
ROWS, COLUMNS = 1_048_576, 16_384  # of a sheet
_MERGED_TAG = VALUE_TAG[: -len("v")] + "mergeCell"
_PARTS = {VALUE_TAG[: -len("v")] + name for name in ("c", "v", "f", "is", "t", "r", "rPr", "phoneticPr", "rPh")}
_TEXT_TAG = VALUE_TAG[: -len("v")] + "t"
_Cells = list[tuple[int, Cell]]


class _Parser(WorkSheetParser):
    """The parser of openpyxl, with cells as (column, value) and a list of formulas that have no stored value."""

    def __init__(self, source: Any, page: Any, book: Any) -> None:  # noqa: ANN401  openpyxl has no types
        super().__init__(
            source,
            page._shared_strings,
            data_only=True,
            epoch=book.epoch,
            date_formats=book._date_formats,
            timedelta_formats=book._timedelta_formats,
        )
        self.book = book
        self.is_ascending = True  # the cells of the row
        self.places: dict[str, int] = {}
        self.formulas: list[Place] = []
        self.merged: list[str] = []

    def parse(self) -> Generator[Any, None, None]:
        """Rows of the sheet; nothing is kept but the cells, and which rows and columns are hidden or merged."""
        rows: Any = None
        for event, element in iterparse(self.source, ("start", "end")):
            tag = element.tag
            if event == "start":
                rows = element if tag == DATA_TAG else rows
            elif tag == ROW_TAG:
                yield self.parse_row(element)
                rows.clear()
            elif tag == COL_TAG:
                self.parse_column_dimensions(element)
            elif tag == _MERGED_TAG:
                self.merged.append(element.get("ref", ""))
            elif tag not in _PARTS:
                element.clear()

    def parse_row(self, row: Any) -> tuple[int, Any]:  # noqa: ANN401
        """Number of a row, and its cells in the order of their columns."""
        cells: Any
        self.is_ascending = True
        number, cells = super().parse_row(row)
        if not self.is_ascending:
            cells = sorted(dict(cells).items())
        if row.get("hidden") not in _TRUE:
            self.row_dimensions.pop(str(number), None)
        if not 1 <= number <= ROWS or (cells and cells[-1][0] > COLUMNS):
            raise ValueError(f"a cell of row {number}, column {cells[-1][0]} lies outside of a sheet")
        return number, cells

    def parse_cell(self, element: Any) -> tuple[int, Cell]:  # type: ignore[override]  # noqa: ANN401
        """Column and value of a cell: plain numbers and shared texts here, all else as openpyxl reads it."""
        kind, reference, style = element.get("t"), element.get("r"), element.get("s")
        if reference is None:
            self.col_counter += 1
            column = self.col_counter
        else:
            name = reference.rstrip("0123456789")
            column = self.places.get(name) or self.places.setdefault(name, _number(name))
            if column <= self.col_counter:
                self.is_ascending = False
            self.col_counter = column
        value = element.findtext(VALUE_TAG)
        if value:
            if kind == "s":
                return column, self.shared_strings[int(value)] or ""
            if kind is None or kind == "n":
                if style is None or int(style) not in self.date_formats:
                    return column, float(value)
                return column, self._dated(float(value), int(style))
        elif kind == "inlineStr" and len(element) == 1 and len(element[0]) == 1 and element[0][0].tag == _TEXT_TAG:
            return column, element[0][0].text or ""  # one piece of text
        elif kind in (None, "n") or (kind == "e" and element.find(FORMULA_TAG) is not None):
            if len(element) and element.find(FORMULA_TAG) is not None:
                self.formulas.append((self.row_counter, column))
            return column, ""
        return column, cell_of(super().parse_cell(element)["value"])

    def _dated(self, serial: float, style: int) -> Cell:
        code = _format_code(self.book, style)
        if is_length_of_time(code, serial):
            return shown_time(code, serial)
        from openpyxl.utils.datetime import from_excel

        try:
            return cell_of(from_excel(serial, self.epoch))
        except (OverflowError, ValueError):  # no date has this number
            return serial


class XlsxBook:
    """An open .xlsx workbook.

    Raises
    ------
    DataError
        The workbook is damaged.

    """

    reports_hidden = True

    def __init__(self, data: bytes, name: str) -> None:
        self._name = name
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # styles and extensions the reader leaves out carry no data
                self._book: Any = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True)
                pages = self._book.worksheets
                self.titles: tuple[str, ...] = tuple(page.title for page in pages)
        except Exception as error:  # a damaged part raises whatever the XML or zip reader raises
            raise damaged(name, error) from error
        self.hidden_titles = frozenset(page.title for page in pages if page.sheet_state != "visible")

    def sheet(self, title: str, hidden: bool = False, most: int | None = None) -> WorkbookSheet:
        """Read one sheet, or its first rows until ``most`` of them are filled.

        Raises
        ------
        DataError
            The sheet is damaged.

        """
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return self._read(title, hidden, most)
        except DataError:
            raise
        except Exception as error:  # as above: the sheet is parsed only now
            raise damaged(self._name, error) from error

    def _read(self, title: str, hidden: bool, most: int | None) -> WorkbookSheet:
        page = self._book[title]
        with page._get_source() as source:
            parser = _Parser(source, page, self._book)
            rows: list[Row] = []
            filled = size = 0
            for number, cells in parser.parse():
                row = _row(cells)
                if not row:
                    continue
                if number <= len(rows) and rows[number - 1]:
                    raise ValueError(f"row {number} of sheet {title!r} is there twice")
                size += len(row)
                if size > MOST_CELLS:
                    raise DataError(
                        f"{self._name}, sheet {title!r}: has more than {MOST_CELLS} cells with the empty ones between "
                        f"them; at most {MOST_CELLS} are read. Save the sheet as .csv."
                    )
                rows.extend([()] * (number - len(rows)))
                rows[number - 1] = row
                filled += 1
                if most is not None and filled >= most:
                    break
        sheet = WorkbookSheet(
            self._name, title, tuple(rows), merged=dict(_merged(parser.merged)), formulas=tuple(parser.formulas)
        )
        return sheet if hidden else without_hidden(sheet, *_hidden(parser))


def _row(cells: _Cells) -> Row:
    """The cells of a row in their columns, empty ones at its end left off."""
    while cells and cells[-1][1] == "":
        cells.pop()
    if not cells:
        return ()
    if cells[-1][0] == len(cells):
        return tuple([value for _, value in cells])
    row: list[Cell] = [""] * cells[-1][0]
    for column, value in cells:
        row[column - 1] = value
    return tuple(row)


def _hidden(parser: _Parser) -> tuple[set[int], set[int]]:
    """Numbers of the rows and of the columns that a sheet hides."""
    rows = {int(number) for number, row in parser.row_dimensions.items() if row.get("hidden") in _TRUE}
    columns = [column for column in parser.column_dimensions.values() if column.get("hidden") in _TRUE]
    return rows, {i for column in columns for i in range(int(column["min"]), min(int(column["max"]), COLUMNS) + 1)}


def _merged(ranges: Sequence[str]) -> Iterator[tuple[Place, Place]]:
    rows = 0
    for one in ranges:
        left, top, right, bottom = (bound or 0 for bound in range_boundaries(one))
        rows += max(bottom - top, 0)
        if rows > 4 * ROWS:  # they would overlap, which no program writes
            raise ValueError(f"merged cells of more than {4 * ROWS} rows")
        yield (top, left), (bottom, right)


def _format_code(book: Any, style: int) -> str:  # noqa: ANN401
    number = book._cell_styles[style].numFmtId
    return str(BUILTIN_FORMATS.get(number, "") if number < 164 else book._number_formats[number - 164])


def _number(name: str) -> int:
    number = 0
    for letter in name.upper():
        number = 26 * number + ord(letter) - ord("A") + 1
    return number
