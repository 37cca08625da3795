"""Workbooks of the formats .xls, .xlsb and .ods, read by python-calamine."""

import io
import re
import zipfile
from html import unescape
from itertools import islice
from typing import Any

from ...core.errors import DataError
from .worksheet import Place, Row, WorkbookSheet, cell_of, damaged, protected, without_hidden

_HIDING = re.compile(rb'table:visibility="(?:collapse|filter)"')
_TAGS = re.compile(rb"<table:(table|table-row|table-column)((?:\s[^<>]*)?)>")
_ATTRIBUTES = re.compile(rb'table:([\w-]+)="([^"]*)"')
_LONGEST = 1_048_576  # rows of a sheet


class CalamineBook:
    """An open .xls, .xlsb or .ods workbook.

    Its reader does not report hidden rows and columns; they are found for .ods only.

    Raises
    ------
    DataError
        The workbook is damaged or protected by a password.

    """

    def __init__(self, data: bytes, name: str, kind: str) -> None:
        import python_calamine

        self._name, self._kind, self._data = name, kind, data
        self.reports_hidden = kind == "ods"
        try:
            if kind == "ods" and _is_encrypted(data):
                raise protected(name)
            self._book: Any = python_calamine.CalamineWorkbook.from_filelike(io.BytesIO(data))
            sheets = [one for one in self._book.sheets_metadata if one.typ == python_calamine.SheetTypeEnum.WorkSheet]
        except python_calamine.PasswordError as error:
            raise protected(name) from error
        except BaseException as error:  # a panic of the reader is no Exception
            raise _refusal(name, error, kind) from error
        self.titles: tuple[str, ...] = tuple(one.name for one in sheets)
        visible = python_calamine.SheetVisibleEnum.Visible
        self.hidden_titles = frozenset(one.name for one in sheets if one.visible != visible)

    def sheet(self, title: str, hidden: bool = False, most: int | None = None) -> WorkbookSheet:
        """Read one sheet, or its first ``most`` rows.

        Raises
        ------
        DataError
            The sheet is damaged.

        """
        try:
            page = self._book.get_sheet_by_name(title)
            top, left = page.start or (0, 0)
            cells = islice(page.iter_rows(), most) if most is not None else page.to_python(skip_empty_area=True)
            rows: list[Row] = [()] * top
            rows += (_trimmed(("",) * left + tuple(map(cell_of, row))) for row in cells)
            merged = {_place(first): _place(last) for first, last in page.merged_cell_ranges or ()}
            marked = _hidden_in_ods(self._data, title) if self._kind == "ods" and not hidden else (set(), set())
        except BaseException as error:  # a panic of the reader is no Exception
            raise _refusal(self._name, error, self._kind) from error
        return without_hidden(WorkbookSheet(self._name, title, tuple(rows), merged=merged), *marked)


def _hidden_in_ods(data: bytes, title: str) -> tuple[set[int], set[int]]:
    """Numbers of the rows and of the columns that a sheet of an .ods workbook hides."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        content = archive.read("content.xml")
    hidden: dict[str, set[int]] = {"row": set(), "column": set()}
    if not _HIDING.search(content):
        return hidden["row"], hidden["column"]
    place, inside = {"row": 0, "column": 0}, False
    for match in _TAGS.finditer(content):
        tag, attributes = match[1].decode(), dict(_ATTRIBUTES.findall(match[2]))
        if tag == "table":
            inside = unescape(attributes.get(b"name", b"").decode("utf-8", "replace")) == title
        elif inside:
            kind = tag.removeprefix("table-")
            count = int(attributes.get(f"number-{kind}s-repeated".encode(), b"1"))
            if attributes.get(b"visibility") in (b"collapse", b"filter"):
                hidden[kind] |= set(range(place[kind] + 1, min(place[kind] + count, _LONGEST) + 1))
            place[kind] += count
    return hidden["row"], hidden["column"]


def _place(cell: tuple[int, int]) -> Place:
    return cell[0] + 1, cell[1] + 1


def _trimmed(row: Row) -> Row:
    end = len(row)
    while end and row[end - 1] == "":
        end -= 1
    return row[:end]


def _is_encrypted(data: bytes) -> bool:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        names = archive.namelist()
        return "META-INF/manifest.xml" in names and b"encryption-data" in archive.read("META-INF/manifest.xml")


def _refusal(name: str, error: BaseException, kind: str) -> BaseException:
    """The error to raise: an interruption by the user stays what it is."""
    if isinstance(error, (KeyboardInterrupt, SystemExit, DataError)):
        return error
    return damaged(name, error, kind)
