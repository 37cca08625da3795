"""A workbook of any format (.xlsx, .xls, .xlsb, .ods) -> sheets of cells."""

import io
import zipfile
from collections.abc import Iterator
from typing import Protocol

from ...core.errors import DataError, UsageError
from ...core.suggestions import did_you_mean
from .worksheet import WorkbookSheet, damaged, protected

SUFFIXES = (".xlsx", ".xlsm", ".xls", ".xlsb", ".ods")
_OLE = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
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
    if kind == "xlsx":
        from .xlsx import XlsxBook

        book: Book = XlsxBook(data, name)
    else:
        from .other_books import CalamineBook

        book = CalamineBook(data, name, kind)
    if not book.titles:
        raise DataError(f"{name} holds no sheet of cells: save the sheet with the table as .xlsx or .csv.")
    return book


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
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = set(archive.namelist())
    except (zipfile.BadZipFile, NotImplementedError, ValueError) as error:
        if not lower.endswith(SUFFIXES):
            return ""
        raise damaged(name, error) from error
    if "xl/workbook.bin" in members:
        return "xlsb"
    if "content.xml" in members and (lower.endswith(".ods") or b"opendocument.spreadsheet" in data[:200]):
        return "ods"
    return "xlsx" if ends_in_xlsx or "xl/workbook.xml" in members else ""
