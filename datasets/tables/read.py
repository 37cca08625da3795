"""A text file or workbook -> columns, with no knowledge of what they mean."""

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import itemgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.errors import DataError, UsageError
from ...core.suggestions import did_you_mean
from ..doubts import Doubt
from .averages import average_rows, average_sentences
from .blocks import without_blocks
from .body import Body, weigh_decimal
from .decode import encoding_of, load_bytes
from .dialect import Dialect, TextSource, split_line, text_source
from .gather import Column, gather_columns
from .header_rows import Words, no_units
from .invisible import visible, without_invisible
from .layout import Layout, find_layout
from .numerals import Decimal, is_missing, is_number
from .row_widths import aligned
from .workbook import book_format
from .worksheet import WorkbookSheet

__all__ = ["Column", "Table", "no_units", "read_table"]


@dataclass(frozen=True, slots=True)
class Table:
    r"""Contents of a file.

    Parameters
    ----------
    path : Path
    sha256 : str
        Of the file's bytes.
    columns : tuple of Column
    lines : ndarray, shape (n,), int
        Line in the file, or row of the sheet, of each data row.
    notes : tuple of str
        Preamble, comment and trailing lines as written.
    warnings : tuple of str
        Full sentences on what was left out, filled in or presumed.
    dialect : Dialect
    assumed : tuple of str
        How a table of another shape was brought to one row per measurement.
    doubts : tuple of Doubt
    sheets, other_sheets : tuple of str
        Titles of the sheets of a workbook that were read, and of the others.

    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp(), "a.csv")
    >>> _ = path.write_text("V;f\n100;0,2\n")
    >>> read_table(path).column("f").values
    array([0.2])

    """

    path: Path
    sha256: str
    columns: tuple[Column, ...]
    lines: NDArray[np.int64]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    dialect: Dialect
    assumed: tuple[str, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    sheets: tuple[str, ...] = ()
    other_sheets: tuple[str, ...] = ()

    @property
    def n_rows(self) -> int:
        """The number of data rows."""
        return len(self.lines)

    def column(self, name: str) -> Column:
        """Find a column by its exact name, or by its position as ``colN``.

        Raises
        ------
        UsageError
            There is none, or more than one, of that name.

        """
        found = [column for column in self.columns if column.name == name]
        if len(found) > 1:
            places = " or ".join(f"col{column.number}" for column in found)
            raise UsageError(f"{self.path.name} has {len(found)} columns named {name!r}. Give one of {places}.")
        found = found or [column for column in self.columns if f"col{column.number}" == name]
        if found:
            return found[0]
        names = [column.name for column in self.columns]
        hint = did_you_mean(name, names, cutoff=0.6, names="Its columns are ")
        raise UsageError(f"{self.path.name} has no column {name!r}. {hint}")


def no_labels(number: int, header: str, unit: str) -> bool:
    """False for every column: the default of `read_table`, which knows no names.

    >>> no_labels(1, "tool", "")
    False
    """
    return False


def read_table(
    path: str | os.PathLike[str],
    *,
    is_unit: Callable[[str], bool] = no_units,
    is_name: Callable[[str], bool] = no_units,
    decimal: Decimal | None = None,
    delimiter: str | None = None,
    sheet: str | None = None,
    hidden: bool = False,
    is_label: Callable[[int, str, str], bool] = no_labels,
) -> Table:
    r"""Read a delimited text file or a workbook (.xlsx, .xls, .xlsb, .ods).

    Encoding, delimiter, decimal mark, sheet, preamble, header rows, units row and footer are found; an ambiguous
    file is refused.

    Parameters
    ----------
    path : str or path
        A text file in UTF-8, UTF-16, Windows-1252 or -1250, or a workbook, whatever its extension.
    is_unit : callable
        Whether a cell's text is a unit; a row of such cells below the header is the units row.
    is_name : callable
        Whether a header names a known quantity: it decides between sheets and between header rows.
    decimal : {"point", "comma"}, optional
        The decimal mark; by default the cells decide.
    delimiter : str, optional
        One character, or comma, semicolon, tab, bar, space.
    sheet : str, optional
        The sheet of a workbook; by default the one with most known names, or else the first with a table.
    hidden : bool
        Read hidden rows, columns and sheets of a workbook too.
    is_label : callable
        Whether a column holds names, by its number from 1, header and units-row cell: numbers in it are kept as
        written (007, 1.7220, 5E2), and say nothing about the decimal mark.

    Raises
    ------
    DataError
        The file cannot be read as a table with at least one numeric column.
    UsageError
        The sheet, the delimiter or the decimal mark asked for does not exist.

    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp(), "a.csv")
    >>> _ = path.write_text("V\tf\n100\t0,2\n")
    >>> read_table(path).dialect.describe()
    'UTF-8, tabs, decimal comma'

    """
    if decimal not in (None, "point", "comma"):
        raise UsageError(f"--decimal {decimal!r} is not a decimal mark: give point or comma.")
    path = Path(path)
    data = load_bytes(path)
    if data.lstrip().startswith(b'{\n  "schema_version"'):
        raise DataError(f"{path.name} is a parameter file, no table of tests: give the file with the measurements.")
    source: TextSource | WorkbookSheet
    words = Words(is_unit, is_name)
    kind = encoding = book_format(data, path.name)
    written = ""
    titles: tuple[str, ...] = ()
    if kind:
        source, layout, notes, warnings, titles = _from_workbook(data, path.name, sheet, words, hidden)
    elif sheet is not None:
        raise UsageError(f"{path.name} is a text file and has no sheets: leave out --sheet {sheet}.")
    else:
        encoding = encoding_of(data, path.name)
        seen, decoded, removed = without_invisible(data, encoding)
        text = text_source(path.name, seen, decoded, delimiter)
        source, joined = without_blocks(text, is_unit)
        layout, notes, warnings = _from_text(source, words)
        warnings += [*removed, *joined]
        written = text.delimiter
    mark = ""
    realigned: list[str] = []
    if isinstance(source, TextSource):
        mark = source.delimiter
        layout, realigned = aligned(source, layout, path.name, mark)
    body = Body(path.name, source, layout, mark, labels=_labels(layout, is_label), words=words)
    point, thousands, doubts = weigh_decimal(body, decimal)
    columns, lines, findings, cell_doubts = gather_columns(body, point)
    averages = average_rows(columns, lines, body)
    if averages:
        body = replace(body, left_out=frozenset(averages))
        columns, lines, findings, cell_doubts = gather_columns(body, point)
    named = source.as_written({*layout.note_lines, *findings.remarks}).items()
    return Table(
        path=path,
        sha256=hashlib.sha256(data).hexdigest(),
        columns=columns,
        lines=lines,
        notes=tuple(text for _, text in sorted([*notes, *named], key=itemgetter(0))),
        warnings=(*warnings, *realigned, *doubts, *average_sentences(averages), *findings.sentences()),
        dialect=Dialect(encoding, written, point, thousands, layout.header_line > 0),
        assumed=tuple(findings.assumed),
        doubts=cell_doubts,
        sheets=titles[:1],
        other_sheets=titles[1:],
    )


def _labels(layout: Layout, is_label: Callable[[int, str, str], bool]) -> frozenset[int]:
    """Places, from 0, of the columns of names."""
    headers = enumerate(zip(layout.names, layout.unit_cells, strict=True))
    return frozenset(i for i, (header, unit) in headers if is_label(i + 1, visible(header), visible(unit)))


def _from_workbook(
    data: bytes, name: str, title: str | None, words: Words, hidden: bool
) -> tuple[WorkbookSheet, Layout, list[tuple[int, str]], list[str], tuple[str, ...]]:
    """The sheet with the table, its layout, notes on other sheets, warnings on what is left out, and all titles."""
    from .sheets import choose_sheet, left_out, padded
    from .workbook import open_book

    book = open_book(data, name)
    table, lines = choose_sheet(book, name, title, words, hidden)
    notes, warnings = left_out(table, book)
    table = padded(table)
    above = [(0, text) for text in (*notes, *lines)]
    title = table.sheet.title
    titles = (title, *(one for one in book.titles if one != title))
    return table.sheet, table.layout, above, _header_warning(table.layout) + warnings, titles


def _from_text(source: TextSource, words: Words) -> tuple[Layout, list[tuple[int, str]], list[str]]:
    """Layout of a text file; without a header row, a comment above with as many cells serves as one."""
    layout = find_layout(source, words.is_unit, source.name, words.is_name)
    comments = source.comments()
    if layout.header_line:
        return layout, comments, []
    for line, text in reversed([comment for comment in comments if comment[0] <= layout.above]):
        cells = [cell.strip() for cell in split_line(text.lstrip("#% \t"), source.delimiter)]
        if len(cells) == layout.width > 1 and not any(is_number(cell) or is_missing(cell) for cell in cells):
            names = replace(layout, header_line=line, names=tuple(cells))
            return names, comments, [f"The column names are taken from the comment in line {line}."]
    return layout, comments, _header_warning(layout)


def _header_warning(layout: Layout) -> list[str]:
    if layout.header_line:
        return []
    return [f"There is no header row; the columns are named col1 to col{layout.width}."]
