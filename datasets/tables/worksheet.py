"""One sheet of a workbook: its rows, what is hidden, merged or not computed in it, and its typed cells."""

import datetime
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from ...core.errors import DataError
from ...core.rounding import label_of
from .numerals import Cell, is_number

FORMATS = {
    "xlsx": "Excel workbook",
    "xls": "Excel workbook (.xls)",
    "xlsb": "Excel workbook (.xlsb)",
    "ods": "OpenDocument spreadsheet",
}  # by the extension of each

_QUOTED = re.compile(r'"[^"]*"|\\.|\[(?!h+\]|m+\]|s+\])[^\[\]]*\]', re.IGNORECASE)
_DAY = 86_400.0  # seconds
_YEAR = 365.0  # days; a serial number above it is a date, even where its format shows the hours only

Row = tuple[Cell, ...]
Place = tuple[int, int]  # row and column of a cell, from 1


@dataclass(frozen=True, slots=True)
class WorkbookSheet:
    """The rows of one sheet; numbers stay numbers, all else is text.

    Parameters
    ----------
    name, title : str
        Of the file and of the sheet.
    rows : tuple of tuple
        Cells of each row from the first; rows and cells that are hidden and left out are empty.
    hidden_rows : tuple of int
        Filled rows that are left out.
    hidden_columns : mapping of int to tuple
        Filled columns that are left out, each with its cells by row.
    merged : mapping
        Upper left cell of each range of merged cells -> its lower right cell.
    formulas : tuple of (int, int)
        Cells with a formula whose value the file does not hold.

    >>> list(WorkbookSheet("a.xlsx", "Data", (("V",), (100.0,))))
    [(1, ('V',)), (2, (100.0,))]

    """

    name: str
    title: str
    rows: tuple[Row, ...]
    hidden_rows: tuple[int, ...] = ()
    hidden_columns: Mapping[int, Mapping[int, Cell]] = field(default_factory=dict)
    merged: Mapping[Place, Place] = field(default_factory=dict)
    formulas: tuple[Place, ...] = ()

    def __iter__(self) -> Iterator[tuple[int, Row]]:
        """Iterate over (row number, cells)."""
        return enumerate(self.rows, start=1)

    def as_written(self, numbers: set[int]) -> dict[int, str]:
        """Rows by number as text: name and value, also with a unit, as ``name: value unit``; others joined by blanks.

        >>> rows = (("Tool", "", "K10"), ("vc", 80.0, "m/min"), ("Test 5",))
        >>> WorkbookSheet("a.xlsx", "Data", rows).as_written({1, 2, 3})
        {1: 'Tool: K10', 2: 'vc: 80 m/min', 3: 'Test 5'}
        """
        return {n: _line(self.rows[n - 1]) for n in sorted(numbers)}


def without_hidden(sheet: WorkbookSheet, rows: set[int], columns: set[int]) -> WorkbookSheet:
    """The sheet without the filled cells of these rows and columns.

    >>> sheet = without_hidden(WorkbookSheet("a.xlsx", "A", (("V", "f"), (1.0, 2.0), (3.0, 4.0))), {3}, {2, 5})
    >>> sheet.rows, sheet.hidden_rows, sheet.hidden_columns
    ((('V', ''), (1.0, ''), ()), (3,), {2: {1: 'f', 2: 2.0}})
    """
    if not rows and not columns:
        return sheet
    left_out = tuple(line for line, row in enumerate(sheet.rows, start=1) if row and line in rows)
    kept: list[Row] = [() if line in rows else row for line, row in enumerate(sheet.rows, start=1)]
    width = max(map(len, kept), default=0)
    concealed: dict[int, Mapping[int, Cell]] = {}
    for i in sorted(column for column in columns if column <= width):
        cells = {n: row[i - 1] for n, row in enumerate(kept, start=1) if len(row) >= i and row[i - 1] != ""}
        if cells:
            concealed[i] = cells
    if concealed:
        kept = [tuple("" if i in concealed else cell for i, cell in enumerate(row, start=1)) for row in kept]
    formulas = tuple(place for place in sheet.formulas if place[0] not in rows and place[1] not in columns)
    return replace(sheet, rows=tuple(kept), hidden_rows=left_out, hidden_columns=concealed, formulas=formulas)


def letters(column: int) -> str:
    """Letters of a column of a sheet, counted from 1.

    >>> letters(1), letters(28)
    ('A', 'AB')
    """
    text = ""
    while column:
        column, rest = divmod(column - 1, 26)
        text = chr(ord("A") + rest) + text
    return text


def damaged(name: str, error: BaseException, kind: str = "xlsx") -> DataError:
    """The refusal of a workbook whose parts cannot be read."""
    why = " ".join(str(error).split())[:200].rstrip(".")
    return DataError(
        f"{name} is a damaged {FORMATS[kind]} ({why}). Open it in Excel or LibreOffice and save it again "
        "as .xlsx or .csv."
    )


def protected(name: str) -> DataError:
    """The refusal of a workbook with a password."""
    return DataError(
        f"{name} is protected by a password, so its cells cannot be read. "
        "Open it, remove the password (in Excel: File, Info, Protect Workbook) and save it again."
    )


def _line(row: Row) -> str:
    filled = [label_of(cell) for cell in row]
    filled = [text.strip() for text in filled if text.strip()]
    pair = len(filled) == 2 or (len(filled) == 3 and is_number(filled[1]) and not is_number(filled[2]))
    if pair and not filled[0].endswith((":", "=")):
        return f"{filled[0]}: {' '.join(filled[1:])}"
    return " ".join(filled)


def cell_of(value: object) -> Cell:
    """A stored value as a number or text: times as ``h:mm`` or ``h:mm:ss``, dates as in ISO 8601.

    >>> cell_of(datetime.time(0, 2, 30)), cell_of(datetime.date(2024, 3, 1)), cell_of(3), cell_of(None)
    ('0:02:30', '2024-03-01', 3.0, '')
    """
    if value is None:
        return ""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, str):
        return value
    if isinstance(value, datetime.timedelta):
        return time_text(value.total_seconds())
    if isinstance(value, datetime.datetime):
        since = value.replace(tzinfo=None) - datetime.datetime(1899, 12, 30)
        if since.days < _YEAR:  # a length of time that a format of dates was given to
            return time_text(since.total_seconds())
        return value.isoformat(" ").removesuffix(" 00:00:00")
    if isinstance(value, datetime.time):
        return time_text(3600 * value.hour + 60 * value.minute + value.second + value.microsecond / 1e6)
    return value.isoformat() if isinstance(value, datetime.date) else str(value)


def time_text(seconds: float, with_seconds: bool | None = None) -> str:
    """A length of time as ``h:mm:ss``, or as ``h:mm`` where it is whole minutes.

    >>> time_text(9000.0), time_text(150.5), time_text(9000.0, with_seconds=True)
    ('2:30', '0:02:30.5', '2:30:00')
    """
    sign, whole = "-" if seconds < 0 else "", round(abs(seconds), 3)
    hours, rest = divmod(whole, 3600)
    minutes, left = divmod(rest, 60)
    text = f"{sign}{int(hours)}:{int(minutes):02}"
    if with_seconds is None:
        with_seconds = left > 0
    return (
        f"{text}:{left:06.3f}".rstrip("0").rstrip(".")
        if with_seconds and left % 1
        else (f"{text}:{int(left):02}" if with_seconds or left else text)
    )


def is_length_of_time(code: str, serial: float) -> bool:
    """Whether a number of days is shown as hours, minutes or seconds without a date.

    >>> is_length_of_time("[h]:mm:ss", 1.9), is_length_of_time("dd/mm/yy", 0.5), is_length_of_time("h:mm", 45000.4)
    (True, False, False)
    """
    plain = _QUOTED.sub("", code.split(";")[0]).lower()
    return abs(serial) < _YEAR and not set("dy") & set(plain) and bool(set("hs:") & set(plain) or "[m" in plain)


def shown_time(code: str, serial: float) -> str:
    """A number of days as the time that a number format shows, with seconds where the format has them.

    >>> shown_time("h:mm", 0.10416666666666667), shown_time("mm:ss", 0.10416666666666667)
    ('2:30', '2:30:00')
    """
    plain = _QUOTED.sub("", code.split(";")[0]).lower()
    return time_text(serial * _DAY, with_seconds="s" in plain or None)
