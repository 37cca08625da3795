"""An Excel workbook -> rows of cells."""

import io
import warnings
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass

from ...core.errors import DataError, UsageError
from ...core.suggestions import did_you_mean
from .numerals import Cell

_OLE = b"\xd0\xcf\x11\xe0"
_CURE = "Save it as .xlsx or .csv."


@dataclass(frozen=True, slots=True)
class WorkbookSheet:
    """The rows of one sheet; numbers stay numbers, all else is text.

    >>> list(WorkbookSheet("a.xlsx", "Data", (("V",), (100.0,))))
    [(1, ('V',)), (2, (100.0,))]
    """

    name: str
    title: str
    rows: tuple[tuple[Cell, ...], ...]

    def __iter__(self) -> Iterator[tuple[int, tuple[Cell, ...]]]:
        """Iterate over (row number, cells)."""
        return enumerate(self.rows, start=1)

    def as_written(self, numbers: set[int]) -> dict[int, str]:
        """Rows by number as text, filled cells joined by a blank.

        >>> WorkbookSheet("a.xlsx", "Data", (("Test", "", "5"),)).as_written({1})
        {1: 'Test 5'}
        """
        return {n: " ".join(str(cell) for cell in self.rows[n - 1] if cell != "") for n in sorted(numbers)}


def is_workbook(data: bytes, name: str) -> bool:
    """Whether a file is an .xlsx workbook, whatever its name.

    Raises
    ------
    DataError
        It is a spreadsheet of another format (.xls, .xlsb, .ods), or a damaged workbook.

    >>> is_workbook(b"V;f", "a.csv")
    False

    """
    if data.startswith(_OLE):
        raise DataError(f"{name} is an old Excel workbook (.xls) or one with a password, which cannot be read. {_CURE}")
    ends_in_xlsx = name.lower().endswith((".xlsx", ".xlsm"))
    if not data.startswith(b"PK\x03\x04"):
        return False
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = set(archive.namelist())
    except zipfile.BadZipFile as error:
        if not ends_in_xlsx:
            return False
        raise _damaged(name, error) from error
    if "xl/workbook.bin" in members:
        raise DataError(f"{name} is a binary Excel workbook (.xlsb), which cannot be read. {_CURE}")
    if "content.xml" in members:
        raise DataError(f"{name} is an OpenDocument file (.ods), which cannot be read. {_CURE}")
    return ends_in_xlsx or "xl/workbook.xml" in members


def read_sheets(data: bytes, name: str, sheet: str | None) -> tuple[Iterator[WorkbookSheet], tuple[str, ...]]:
    """Open a workbook.

    Returns
    -------
    sheets : iterator of Sheet
        The sheet asked for, or all of them in the book's order, each read when it is reached.
    titles : tuple of str
        The titles of all sheets.

    Raises
    ------
    DataError
        The workbook is damaged or holds no sheet of cells.
    UsageError
        No sheet has the title asked for.

    """
    import openpyxl

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # styles and extensions the reader leaves out carry no data
            book = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True)
            titles = tuple(page.title for page in book.worksheets)
    except Exception as error:  # a damaged part raises whatever the XML or zip reader raises
        raise _damaged(name, error) from error
    if not titles:
        raise DataError(f"{name} holds no sheet of cells. {_CURE}")
    if sheet is not None and sheet not in titles:
        hint = did_you_mean(sheet, titles, cutoff=0.6, names="Its sheets are ")
        raise UsageError(f"{name} has no sheet {sheet!r}. {hint}")
    wanted = titles if sheet is None else (sheet,)
    return (WorkbookSheet(name, title, _rows(book, title, name)) for title in wanted), titles


def _rows(book: object, title: str, name: str) -> tuple[tuple[Cell, ...], ...]:
    page = book[title]  # type: ignore[index]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            page.reset_dimensions()  # some programs store a wrong sheet size
            return tuple(tuple(map(_cell, row)) for row in page.iter_rows(values_only=True))
    except Exception as error:  # as above: the sheet is parsed only now
        raise _damaged(name, error) from error


def _cell(value: object) -> Cell:
    if value is None:
        return ""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    return value if isinstance(value, str) else str(value)


def _damaged(name: str, error: Exception) -> DataError:
    return DataError(
        f"{name} is a damaged Excel workbook ({error}). Open it in Excel and save it again as .xlsx or .csv."
    )
