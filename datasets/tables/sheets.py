"""The sheets of a workbook -> the one that holds the table of tests, and what is left out of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from shlex import quote

from ...core.errors import DataError
from .blocks import sheet_without_blocks
from .header_rows import Words
from .invisible import cleaned_rows
from .layout import SAMPLE, Layout, find_layout
from .numerals import Cell
from .row_widths import with_numbers_below
from .workbook import Book, check_title
from .worksheet import Place, Row, WorkbookSheet, letters

_ALTERNATIVES = 2  # sheets with the same names, of which the much longer one is read
_FEW = 2  # known names that make a table of tests
_COVER = 40  # filled rows of a cover sheet looked at
_COVERS = 3  # sheets at the beginning that may be covers of the one asked for
_NAMED = 6  # cells, rows or sheets named in a sentence
_SAVE = "open the file in Excel or LibreOffice and save it"


@dataclass(frozen=True, slots=True)
class SheetTable:
    """A sheet that holds a table, its layout, names of known quantities in its header, and what was removed."""

    sheet: WorkbookSheet
    layout: Layout
    known: frozenset[str]
    removed: tuple[str, ...] = ()

    @property
    def n_rows(self) -> int:
        """The number of filled rows below the head."""
        return sum(1 for row in self.sheet.rows[self.layout.above :] if row)


class EqualSheetsError(DataError):
    """Several sheets with a table of tests of the same header, each of which may be one test.

    Attributes
    ----------
    titles : tuple of str
        Their titles in the order of the book.
    """

    def __init__(self, message: str, titles: tuple[str, ...]) -> None:
        super().__init__(message)
        self.titles = titles


def sheet_tables(
    book: Book, name: str, words: Words, *, titles: Sequence[str], hidden: bool = False, most: int | None = None
) -> tuple[list[SheetTable], list[DataError]]:
    """The tables of the sheets of these titles, and the refusals of the sheets that hold none."""
    tables: list[SheetTable] = []
    refusals: list[DataError] = []
    for title in titles:
        sheet = book.sheet(title, hidden, most)
        try:
            tables.append(_table(sheet, name, words))
        except DataError as refusal:
            refusals.append(_with_causes(refusal, sheet))
    return tables, refusals


def choose_sheet(book: Book, name: str, title: str | None, words: Words, hidden: bool) -> tuple[SheetTable, list[str]]:
    """The sheet to read, and the lines of the others that name something (``Tool: K10``).

    It is the one asked for, or the one with most names of known quantities, or the first with a table where no
    sheet has such names.

    Raises
    ------
    DataError
        No sheet holds a table, or several are equally good.
    UsageError
        No sheet has the title asked for.

    """
    titles = [one for one in book.titles if hidden or one not in book.hidden_titles] or list(book.titles)
    if title is not None:
        check_title(title, book, name)
    if title is not None or len(titles) == 1:
        tables, refusals = sheet_tables(book, name, words, titles=[title or titles[0]], hidden=hidden)
        if not tables:
            raise refusals[0]
        covers = [one for one in titles[:_COVERS] if one != tables[0].sheet.title]
        seen, _ = sheet_tables(book, name, words, titles=covers, hidden=hidden, most=_COVER)
        return tables[0], [line for one in covers for line in _pairs(book, one, seen)]
    tables, refusals = sheet_tables(book, name, words, titles=titles, hidden=hidden, most=SAMPLE)
    if not tables:
        raise refusals[0]
    best = _best(tables, name)
    others = [one for one in titles if one != best.sheet.title] if len(best.known) >= _FEW else []
    lines = [line for one in others for line in _pairs(book, one, tables)]
    return _table(book.sheet(best.sheet.title, hidden), name, words), lines


def unmerged(sheet: WorkbookSheet) -> WorkbookSheet:
    """The sheet with the value of cells merged downwards in each of their rows.

    >>> sheet = WorkbookSheet("a.xlsx", "A", (("E1", 2.0), ("", 3.0)), merged={(1, 1): (2, 1)})
    >>> unmerged(sheet).rows
    (('E1', 2.0), ('E1', 3.0))
    """
    down = {place: end for place, end in sheet.merged.items() if end[0] > place[0] and end[1] == place[1]}
    if not down:
        return sheet
    rows: list[Row] = list(sheet.rows)
    for (top, column), (bottom, _) in down.items():
        value = _cell(rows, top, column)
        for line in range(top + 1, min(bottom, len(rows)) + 1):
            if value != "" and rows[line - 1] and _cell(rows, line, column) == "":
                row = list(rows[line - 1]) + [""] * (column - len(rows[line - 1]))
                row[column - 1] = value
                rows[line - 1] = tuple(row)
    return replace(sheet, rows=tuple(rows))


def padded(table: SheetTable) -> SheetTable:
    """The table with one width: rows of two filled cells and more are as wide as the widest, which has no name then."""
    sheet, layout = table.sheet, table.layout
    width = max([layout.width, *map(len, sheet.rows[layout.above :])])
    rows = tuple(
        row if len(row) == width or sum(cell != "" for cell in row) < _FEW else row + ("",) * (width - len(row))
        for row in sheet.rows[layout.above :]
    )
    more = width - layout.width
    names = layout.names + ("",) * more
    wide = replace(
        layout, names=names, unit_cells=layout.unit_cells + ("",) * more, numeric=layout.numeric + (False,) * more
    )
    return replace(table, sheet=replace(sheet, rows=sheet.rows[: layout.above] + rows), layout=wide)


def left_out(table: SheetTable, book: Book) -> tuple[list[str], list[str]]:
    """Notes on the sheets that are not read; warnings on hidden, merged and uncomputed cells of the one that is."""
    sheet, layout = table.sheet, table.layout
    others = [one for one in book.titles if one != sheet.title]
    notes = [f"Sheet {sheet.title!r} is read; not read: {', '.join(map(repr, others))}."] if others else []
    if not book.reports_hidden:
        notes.append("Hidden rows and columns of this format cannot be recognized and are read.")
    warnings = list(table.removed)
    if sheet.hidden_columns:
        named = ", ".join(_column_text(i, cells, layout) for i, cells in sheet.hidden_columns.items())
        warnings.append(f"Hidden columns are left out: {named}; --hidden reads them.")
    if rows := [line for line in sheet.hidden_rows if line > layout.above]:
        warnings.append(f"Hidden rows are left out: {ranges(rows)}; --hidden reads them.")
    merged = [
        f"{letters(left)}{max(top, layout.above + 1)}:{letters(left)}{bottom}"
        for (top, left), (bottom, right) in sorted(sheet.merged.items())
        if right == left and bottom > max(top, layout.above + 1) and _cell(sheet.rows, top, left) != ""
    ]
    if merged:
        warnings.append(f"The value of merged cells is read in each of their rows: {_some(merged)}.")
    if cells := [place for place in sheet.formulas if place[0] > layout.above and place[1] <= layout.width]:
        warnings.append(f"{_formulas(cells)} and count as missing: {_SAVE}.")
    return notes, warnings


def ranges(lines: Sequence[int]) -> str:
    """Ascending line numbers as text, successive ones as a range.

    >>> ranges([2, 4, 5, 6, 9])
    '2, 4 to 6, 9'
    """
    parts: list[list[int]] = []
    for line in lines:
        if parts and line == parts[-1][-1] + 1:
            parts[-1].append(line)
        else:
            parts.append([line])
    texts = [str(p[0]) if len(p) == 1 else f"{p[0]} to {p[-1]}" if len(p) > 2 else f"{p[0]}, {p[1]}" for p in parts]
    return _some(texts)


def _table(sheet: WorkbookSheet, name: str, words: Words) -> SheetTable:
    rows, removed = cleaned_rows(sheet.rows)
    sheet, joined = sheet_without_blocks(unmerged(replace(sheet, rows=rows)), words.is_unit)
    spans = {place: end[1] - place[1] + 1 for place, end in sheet.merged.items()}
    layout = find_layout(sheet, words.is_unit, f"{name}, sheet {sheet.title!r}", words.is_name, spans)
    first = next(((line, row) for line, row in sheet if line > layout.above and row), None)
    if layout.header_line and first is not None:
        layout = with_numbers_below(layout, *first)
    return SheetTable(sheet, layout, frozenset(filter(words.is_name, layout.names)), (*removed, *joined))


def _best(tables: Sequence[SheetTable], name: str) -> SheetTable:
    """The table with most known names, or the longest of them; the first where none has two of them."""
    most = max(len(table.known) for table in tables)
    if most < _FEW:
        return next((table for table in tables if table.layout.header_line), tables[0])
    equal = sorted((table for table in tables if len(table.known) == most), key=lambda table: -table.n_rows)
    if len(equal) > _ALTERNATIVES or (len(equal) > 1 and 2 * equal[1].n_rows >= equal[0].n_rows):
        listed = _some([f"--sheet {quote(table.sheet.title)} ({table.n_rows} rows)" for table in equal])
        refusal = f"{name} has several sheets with a table of tests: give one of {listed}."
        alike = [table for table in tables if table.known == equal[0].known]
        if len(alike) == len(equal):
            raise EqualSheetsError(refusal, tuple(table.sheet.title for table in alike))
        raise DataError(refusal)
    return equal[0]


def _pairs(book: Book, title: str, tables: Sequence[SheetTable]) -> list[str]:
    """Lines with a name and a value of a sheet without a table of tests."""
    if any(table.sheet.title == title and len(table.known) >= _FEW for table in tables):
        return []
    sheet = book.sheet(title, most=_COVER)
    cells = {n: [cell for cell in row if cell != ""] for n, row in enumerate(sheet.rows, start=1)}
    pairs = {n for n, filled in cells.items() if len(filled) == _FEW and isinstance(filled[0], str)}
    return list(sheet.as_written(pairs).values())


def _with_causes(refusal: DataError, sheet: WorkbookSheet) -> DataError:
    """The refusal of a sheet, with what may be the cause: formulas without values, hidden rows or columns."""
    more = ""
    if sheet.formulas:
        more += f" {_formulas(sheet.formulas)}: {_SAVE}."
    if sheet.hidden_rows or sheet.hidden_columns:
        more += " Hidden rows and columns are left out: --hidden reads them."
    return DataError(f"{refusal}{more}")


def _formulas(cells: Sequence[Place]) -> str:
    named = _some([f"{letters(column)}{line}" for line, column in cells])
    return (
        f"{len(cells)} cells are formulas without a stored value ({named})"
        if len(cells) > 1
        else f"Cell {named} is a formula without a stored value"
    )


def _column_text(number: int, cells: Mapping[int, Cell], layout: Layout) -> str:
    own = [str(cell).strip() for line, cell in cells.items() if isinstance(cell, str) and line <= layout.above]
    name = " ".join(own[-2:])
    return f"{letters(number)} {name!r}" if name else letters(number)


def _cell(rows: Sequence[Row], line: int, column: int) -> Cell:
    row = rows[line - 1] if line <= len(rows) else ()
    return row[column - 1] if column <= len(row) else ""


def _some(texts: Sequence[str]) -> str:
    return ", ".join(texts[:_NAMED]) + (f" and {len(texts) - _NAMED} more" if len(texts) > _NAMED else "")
