"""The data rows of a table: in blocks, of one width, without blank rows, footer and remarks."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from ...core.errors import DataError
from ...core.rounding import count
from ..doubts import Doubt
from .header_rows import Words, no_units
from .layout import WEAK_FOOTERS, Layout, footer_label, is_text_line
from .numerals import Cell, Decimal, Evidence, number_and_rest, parse_number
from .row_widths import SHARE, may_be_inside, remarks_only, shifted

BLOCK = 2_000  # rows converted at once: more leave the processor's cache and take twice the time
_PHRASE = re.compile(r"[-=*#_~>]{2,}|[^\W\d]\S*\s+\S+\s+\S")  # dashes, or three words and more
_NO_WORDS = Words(no_units, no_units)
TAIL = 200  # rows held back, among which footer and remarks are looked for


@dataclass(frozen=True, slots=True)
class RowBlock:
    """Successive data rows: their line numbers, and the cells of each column."""

    lines: list[int]
    columns: list[tuple[Cell, ...]]


@dataclass(slots=True)
class Findings:
    """Findings made while reading the rows; complete once all blocks have been read."""

    short: int = 0
    first_short: int = 0
    lacking: Counter[int] = field(default_factory=Counter)
    example: Sequence[Cell] = ()
    inside: list[int] = field(default_factory=list)
    footers: list[tuple[int, str]] = field(default_factory=list)
    remarks: list[int] = field(default_factory=list)
    errors: list[tuple[str, int, str]] = field(default_factory=list)  # column, line and text of errors of formulas
    absent: list[tuple[str, int, str]] = field(default_factory=list)  # the same of cells such as "n.b."
    between: list[tuple[int, str]] = field(default_factory=list)  # line and text of notes among the rows
    assumed: list[str] = field(default_factory=list)  # how cells of a number and more are read

    def add_short(self, line: int, row: Sequence[Cell], layout: Layout) -> None:
        """Note a row with fewer cells than the header."""
        self.short += 1
        self.lacking[layout.width - len(row)] += 1
        if not self.first_short:
            self.first_short, self.example = line, row
        if may_be_inside(row, layout):
            self.inside.append(line)

    def check_width(self, layout: Layout, name: str, n_rows: int) -> None:
        """Refuse a table nearly all of whose rows lack the same number of cells, unless these are remarks.

        Raises
        ------
        DataError
        """
        lacking, count = self.lacking.most_common(1)[0] if self.lacking else (0, 0)
        if count and layout.header_line and count >= SHARE * n_rows and not remarks_only(layout, lacking):
            raise shifted(layout, name, self.example, lacking, count, n_rows)

    def doubts(self, layout: Layout) -> tuple[Doubt, ...]:
        """A doubt on the rows in which another cell than the last may be missing."""
        if not self.inside or not layout.header_line:
            return ()
        lines = ", ".join(map(str, self.inside[:5])) + (f" and {len(self.inside) - 5} more" * (len(self.inside) > 5))
        least = min(self.lacking)
        names = tuple(name for name in layout.names[-least:] if name)
        last = " and ".join(map(repr, names)) or "the last column"
        return (
            Doubt(
                names,
                f"line{'s' * (len(self.inside) > 1)} {lines} of the file: the row is short, and {last} counts as "
                "missing; if another cell is missing, the numbers after it stand under the wrong names",
                lines=tuple(self.inside),
            ),
        )

    def sentences(self) -> list[str]:
        """The findings as full sentences.

        >>> Findings(footers=[(9, "Mean")]).sentences()
        ["Footer rows are left out: line 9 'Mean'."]
        """
        sentences = []
        if self.short:
            sentences.append(
                f"{count(self.short, 'row has', 'rows have')} fewer cells than the header, the first in line "
                f"{self.first_short}; the cells they lack count as missing."
            )
        if self.footers:
            rows = ", ".join(f"line {line} {label!r}" for line, label in self.footers)
            sentences.append(f"Footer rows are left out: {rows}.")
        if self.remarks:
            sentences.append(f"Text below the data is kept as a note: line {', '.join(map(str, self.remarks))}.")
        if self.errors:
            cells = ", ".join(f"{name!r} line {line} {text}" for name, line, text in self.errors[:4])
            more = ", ..." if len(self.errors) > 4 else ""
            sentences.append(f"Cells with an error of a formula count as missing: {cells}{more}.")
        if self.absent:
            cells = ", ".join(f"{name!r} line {line} {text!r}" for name, line, text in self.absent[:4])
            more = ", ..." if len(self.absent) > 4 else ""
            sentences.append(f"Cells without a measurement count as missing: {cells}{more}.")
        if self.between:
            rows = ", ".join(f"line {line} {text!r}" for line, text in self.between)
            sentences.append(f"Notes between the rows are left out: {rows}.")
        return sentences


@dataclass(frozen=True, slots=True)
class Body:
    """The rows of a source seen through its layout; it can be walked through again and again."""

    name: str
    rows: Iterable[tuple[int, Sequence[Cell]]]
    layout: Layout
    delimiter: str
    left_out: frozenset[int] = frozenset()  # lines of averages
    labels: frozenset[int] = frozenset()  # places, from 0, of columns of names, also where these are numbers
    words: Words = _NO_WORDS

    def blocks(self, findings: Findings) -> Iterator[RowBlock]:
        """Iterate over the data in blocks of at most 2000 rows, noting what is met.

        Raises
        ------
        DataError
            A row has more filled cells than the table has columns.

        >>> from .layout import find_layout
        >>> rows = [(1, ["V", "f"]), (2, ["1", "2"]), (3, ["Mean", "2"])]
        >>> body = Body("a.csv", rows, find_layout(rows, lambda text: False, "a.csv"), ",")
        >>> list(body.blocks(Findings()))
        [RowBlock(lines=[2], columns=[('1',), ('2',)])]

        """
        lines: list[int] = []
        rows: list[Sequence[Cell]] = []
        above = self.layout.above
        numbered = self.rows if not self.left_out else (one for one in self.rows if one[0] not in self.left_out)
        for line, row in numbered:
            if line > above and row:
                lines.append(line)
                rows.append(row)
                if len(rows) == BLOCK + TAIL:
                    yield from self._block(lines[:BLOCK], rows[:BLOCK], findings)
                    del lines[:BLOCK], rows[:BLOCK]
        self._cut_tail(lines, rows, findings)
        yield from self._block(lines, rows, findings)

    def _block(self, lines: list[int], rows: list[Sequence[Cell]], findings: Findings) -> Iterator[RowBlock]:
        """Bring the rows to one width; if all begin with a filled cell and have it, nothing is done."""
        width = self.layout.width
        first = [row[0] if row else "" for row in rows]
        alone = _notes_between(rows) if width > 2 else {}
        if alone:
            findings.between += ((lines[i], text) for i, text in alone.items())
            lines = [line for i, line in enumerate(lines) if i not in alone]
            rows = [row for i, row in enumerate(rows) if i not in alone]
        if set(map(len, rows)) != {width} or not all(first) or " " in first:
            kept = [
                (line, fitted)
                for line, row in zip(lines, rows, strict=True)
                if (fitted := self._fit(line, row, findings)) is not None
            ]
            lines, rows = [line for line, _ in kept], [row for _, row in kept]
        if rows:
            yield RowBlock(lines, list(zip(*rows, strict=True)))

    def _fit(self, line: int, row: Sequence[Cell], findings: Findings) -> Sequence[Cell] | None:
        width = self.layout.width
        if _is_blank(row):
            return None
        if len(row) < width:
            findings.add_short(line, row, self.layout)
            return [*row, *[""] * (width - len(row))]
        if len(row) > width:
            if not _is_blank(row[width:]):
                raise self._too_wide(line, row)
            return row[:width]
        return row

    def _cut_tail(self, lines: list[int], rows: list[Sequence[Cell]], findings: Findings) -> None:
        if rows and all(footer_label(row) for row in rows):
            return  # a column whose values are such words
        while rows:
            if label := _tail_label(rows):
                findings.footers.insert(0, (lines[-1], label))
            elif not _is_blank(rows[-1]):
                if not is_text_line(rows[-1], self.layout):
                    return
                findings.remarks.insert(0, lines[-1])
            del lines[-1], rows[-1]

    def _too_wide(self, line: int, row: Sequence[Cell]) -> DataError:
        width = self.layout.width
        seen = max(i for i, cell in enumerate(row, start=1) if str(cell).strip())
        expected = f"the header in line {self.layout.header_line}" if self.layout.header_line else "the first full row"
        if self.delimiter == "," and seen == 2 * width:
            return DataError(
                f"{self.name} line {line} has {seen} cells, twice the {width} of {expected}: commas seem "
                "to be both decimal mark and delimiter, which is ambiguous. "
                "Export with semicolons, or with decimal points."
            )
        return DataError(
            f"{self.name} line {line} has {seen} cells, {expected} has {width}. "
            "Give the extra column a name, or remove the extra cell"
            + (
                " (a decimal comma makes two cells of one: then export with semicolons)."
                if self.delimiter == ","
                else "."
            )
        )


def _tail_label(rows: Sequence[Sequence[Cell]]) -> str:
    """Label of the last row as a footer, "" where it is none; a lone letter (n, s) needs a word in a row above it."""
    if label := footer_label(rows[-1]):
        return label
    above = next((row for row in reversed(rows) if not footer_label(row, WEAK_FOOTERS)), None)
    return footer_label(rows[-1], WEAK_FOOTERS) if above is not None and footer_label(above) else ""


def weigh_decimal(body: Body, decimal: Decimal | None) -> tuple[Decimal, str, list[str]]:
    """Decide the decimal mark of a table, unless given, by the majority of the cells with one reading only.

    All cells of the first block that holds such a cell are counted, except in columns of labels.

    Returns
    -------
    decimal, thousands : str
        The mark and the thousands mark seen with it, "" when there is none.
    warnings : list of str

    Raises
    ------
    DataError
        Cells have two readings and no cell decides, or as many cells have a point as a comma.

    >>> from .layout import find_layout
    >>> rows = [(1, ["V", "f"]), (2, ["1.234", "2,5"])]
    >>> weigh_decimal(Body("a.csv", rows, find_layout(rows, lambda text: False, "a.csv"), ";"), None)
    ('comma', '.', [])

    """
    evidence = Evidence()
    for block in body.blocks(Findings()):
        evidence.add(block.lines, [() if i in body.labels else cells for i, cells in enumerate(block.columns)])
        if evidence.decided or decimal is not None:
            break
    chosen = decimal or (_majority(body, evidence) if evidence.counts else _mark_of_amounts(body))
    thousands = max(evidence.thousands[chosen].items(), key=lambda item: item[1], default=("", 0))[0]
    other = "comma" if chosen == "point" else "point"
    warnings = []
    if evidence.counts[other]:
        line, number, text = evidence.first[other]
        cells = count(evidence.counts[other], "cell is a number", "cells are numbers")
        warnings.append(
            f"The numbers are read with a decimal {chosen}, but {cells} "
            f"with a decimal {other} only, the first in line {line}, "
            f"{_column(body, number)}: {text.strip()!r}."
        )
    return chosen, thousands, warnings


def _mark_of_amounts(body: Body) -> Decimal:
    """The decimal mark of numbers that a spread or a unit follows, for a table without any other number with a mark."""
    evidence = Evidence()
    for block in body.blocks(Findings()):
        columns = [() if i in body.labels else cells for i, cells in enumerate(block.columns)]
        evidence.add(block.lines, [[number_and_rest(str(cell))[0] for cell in cells] for cells in columns])
        break
    return "comma" if evidence.counts["comma"] > evidence.counts["point"] else "point"


def _majority(body: Body, evidence: Evidence) -> Decimal:
    counts = evidence.counts
    if counts["point"] != counts["comma"]:
        return "point" if counts["point"] > counts["comma"] else "comma"
    flags = "Give --decimal point or --decimal comma."
    if counts["point"]:
        places = [
            f"{text.strip()!r} in line {line}" for line, _, text in map(evidence.first.__getitem__, ("point", "comma"))
        ]
        raise DataError(
            f"{body.name} mixes decimal marks: as many cells are numbers with a decimal point only "
            f"({places[0]}) as with a decimal comma only ({places[1]}). {flags}"
        )
    if counts["either"]:
        line, number, text = evidence.first["either"]
        point, comma = parse_number(text, "point"), parse_number(text, "comma")
        raise DataError(
            f"{body.name} line {line}, {_column(body, number)}: {text.strip()!r} is {point:.10g} with "
            f"a decimal point and {comma:.10g} with a decimal comma, and no cell of the file decides. {flags}"
        )
    return "point"


def _column(body: Body, number: int) -> str:
    return f"column {number} {body.layout.names[number - 1]!r}"


def _notes_between(rows: Sequence[Sequence[Cell]]) -> dict[int, str]:
    """Rows with a phrase in one cell and no other, between rows that have a value there: notes, by their position.

    >>> _notes_between([["1", "0.2", "5"], ["--- new bar ---", "", ""], ["2", "0.2", "5"], ["E 7", "", ""]])
    {1: '--- new bar ---'}
    """
    found = {}
    for i in range(1, len(rows) - 1):
        row = rows[i]
        if len(row) > 1 and row[-1] != "" and row[0] != "":
            continue  # nearly all rows
        filled = [k for k, cell in enumerate(row) if str(cell).strip()]
        if len(filled) != 1:
            continue
        k, text = filled[0], str(row[filled[0]]).strip()
        beside = (rows[i - 1], rows[i + 1])
        if _PHRASE.match(text) and all(len(one) > k and str(one[k]).strip() for one in beside):
            found[i] = text
    return found


def _is_blank(row: Sequence[Cell]) -> bool:
    return not any(cell.strip() if isinstance(cell, str) else True for cell in row)
