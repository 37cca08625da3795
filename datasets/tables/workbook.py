"""A workbook of any format (.xlsx, .xls, .xlsb, .ods) -> sheets of cells."""

import re
import zipfile
from collections.abc import Iterator
from typing import Protocol

from ...core.bounded import LIMITS, MB, UNREADABLE_ARCHIVE, open_archive
from ...core.errors import DataError, UsageError
from ...core.suggestions import did_you_mean
from .worksheet import WorkbookSheet, damaged, protected

SUFFIXES = (".xlsx", ".xlsm", ".xls", ".xlsb", ".ods")
TEXTS = (".csv", ".txt", ".tsv", ".dat", ".prn", ".asc")  # of tables in a text file
_OLE = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
UNPACKED = 400 * MB  # bytes of all parts of a workbook; a sheet of a million rows and eight columns has 300 MB
MOST_TAGS = 45_000_000  # of the sheets together: ten million cells
OTHER_TAGS = 4_000_000  # of each other part: a million different texts
LONGEST_ROW = 32 * MB  # bytes of a row of a sheet, or of what follows the last one
MOST_CELLS = 25_000_000  # cells of a sheet with the empty ones between
_REMEDY = "Save the sheet with the table as .csv."
_CHUNK = 1 << 20
_ENCRYPTED = ("EncryptedPackage".encode("utf-16-le"), b"EncryptedPackage")


class Book(Protocol):
    """An open workbook."""

    titles: tuple[str, ...]
    hidden_titles: frozenset[str]
    reports_hidden: bool  # whether hidden rows and columns can be recognized

    def sheet(self, title: str, hidden: bool = False, most: int | None = None) -> WorkbookSheet:
        """Read one sheet, or its first rows until ``most`` of them are filled."""


def is_workbook(data: bytes, name: str) -> bool:
    """Whether a file is a workbook, whatever its name.

    Raises
    ------
    DataError
        It is a damaged workbook or protected by a password.

    >>> is_workbook(b"V;f", "a.csv")
    False

    """
    return _format(data, name) != ""


def open_book(data: bytes, name: str) -> Book:
    """Open a workbook by the reader of its format.

    Raises
    ------
    DataError
        The workbook is damaged, protected by a password or holds no sheet of cells.

    """
    kind = _format(data, name)
    if len(data) > LIMITS["workbook"].size:
        raise DataError(f"{name} has {len(data)} bytes; a workbook has at most {LIMITS['workbook'].size}. {_REMEDY}")
    if kind != "xls":
        _check_parts(data, name, kind)
    if kind == "xlsx":
        from .xlsx import XlsxBook

        book: Book = XlsxBook(data, name)
    else:
        from .other_books import CalamineBook

        book = CalamineBook(data, name, kind)
    if not book.titles:
        raise DataError(f"{name} holds no sheet of cells: save the sheet with the table as .xlsx or .csv.")
    return book


def _check_parts(data: bytes, name: str, kind: str) -> None:
    """Unpack every part once: its size and checksum are those stated, and what it holds is within the limits.

    Raises
    ------
    DataError
        A part is damaged, or there are more cells than the reader's time and memory are meant for.

    """
    try:
        with open_archive(data, name, UNPACKED, remedy=_REMEDY) as archive:
            for item in archive.infolist():
                sheet = kind != "xlsx" or "/worksheets/" in item.filename
                tags, longest = _measured(archive, item)
                if tags > (MOST_TAGS if sheet else OTHER_TAGS) or (kind == "xlsx" and sheet and longest > LONGEST_ROW):
                    raise DataError(
                        f"{name}: the part {item.filename[:60]!r} has {tags} elements, a row up to {longest} bytes; "
                        f"at most {MOST_TAGS if sheet else OTHER_TAGS} and {LONGEST_ROW} are read. {_REMEDY}"
                    )
            if kind == "ods" and (cells := _repeated_cells(archive.read("content.xml"))) > MOST_CELLS:
                raise DataError(
                    f"{name}: its sheets have {cells} cells with the repeated ones; at most {MOST_CELLS} are read. "
                    f"{_REMEDY}"
                )
    except UNREADABLE_ARCHIVE as error:
        raise damaged(name, error, kind) from error


def _measured(archive: zipfile.ZipFile, item: zipfile.ZipInfo) -> tuple[int, int]:
    """Elements of a part of XML, and the bytes of the longest stretch without ``row``."""
    stated, item.file_size = item.file_size, item.file_size + 1  # one more: a part that goes on is damaged
    tags, longest, size, last = 0, 0, 0, 0
    with archive.open(item) as part:
        while chunk := part.read(_CHUNK):
            tags += chunk.count(b"<")
            first, end = chunk.find(b"row"), chunk.rfind(b"row")
            if first >= 0:
                longest, last = max(longest, size + first - last), size + end
            size += len(chunk)
    item.file_size = stated
    if size != stated:
        raise zipfile.BadZipFile(f"{item.filename} has other than its stated {stated} bytes")
    return tags, max(longest, size - last)


_REPEATED = re.compile(
    rb'<table:(table-row|table-cell|covered-table-cell)|table:number-(?:rows|columns)-repeated="(\d{1,9})"'
    rb"|(office:value|<text:p)"
)


def _repeated_cells(content: bytes) -> int:
    """Cells of an .ods sheet up to the last filled one of each row, as often as rows and cells are repeated."""
    cells = columns = waiting = 0
    rows, of = 1, b""
    for match in _REPEATED.finditer(content):
        if match[1] == b"table-row":
            cells, rows, columns, waiting, of = cells + rows * columns, 1, 0, 0, b"row"
        elif match[1]:
            waiting, of = waiting + 1, b"cell"
        elif match[2] and of == b"row":
            rows = int(match[2])
        elif match[2]:
            waiting += int(match[2]) - 1
        elif of == b"cell":
            columns, waiting = columns + waiting, 0
    return cells + rows * columns


def read_sheets(data: bytes, name: str, sheet: str | None) -> tuple[Iterator[WorkbookSheet], tuple[str, ...]]:
    """Open a workbook.

    Returns
    -------
    sheets : iterator of WorkbookSheet
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
    book = open_book(data, name)
    if sheet is not None:
        check_title(sheet, book, name)
    wanted = book.titles if sheet is None else (sheet,)
    return (book.sheet(title) for title in wanted), book.titles


def check_title(title: str, book: Book, name: str) -> None:
    """Refuse the title of a sheet that the book does not have.

    Raises
    ------
    UsageError

    """
    if title not in book.titles:
        hint = did_you_mean(title, book.titles, cutoff=0.6, names="Its sheets are ")
        raise UsageError(f"{name} has no sheet {title!r}. {hint}")


def book_format(data: bytes, name: str) -> str:
    """Format of a workbook as the usual extension without its point.

    >>> book_format(b"V;f", "a.csv")
    ''
    """
    return _format(data, name)


def _format(data: bytes, name: str) -> str:
    """The extension usual for the format of a workbook, "" for any other file."""
    lower = name.lower()
    if data.startswith(_OLE[:4]):
        if any(mark in data for mark in _ENCRYPTED):
            raise protected(name)
        return "xls"
    ends_in_xlsx = lower.endswith((".xlsx", ".xlsm"))
    if not data.startswith(b"PK\x03\x04"):
        return ""
    try:
        with open_archive(data, name, UNPACKED, remedy=_REMEDY) as archive:
            members = set(archive.namelist())
    except UNREADABLE_ARCHIVE as error:
        if not lower.endswith(SUFFIXES):
            return ""
        raise damaged(name, error) from error
    if "xl/workbook.bin" in members:
        return "xlsb"
    if "content.xml" in members and (lower.endswith(".ods") or b"opendocument.spreadsheet" in data[:200]):
        return "ods"
    return "xlsx" if ends_in_xlsx or "xl/workbook.xml" in members else ""
