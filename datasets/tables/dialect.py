"""Text lines -> rows of cells: the delimiter of a file and the way its numbers are written."""

import csv
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain, islice

from ...core.errors import DataError, UsageError
from .decode import encoding_name, text_lines
from .numerals import Decimal, is_missing, is_number, number_and_rest
from .worksheet import FORMATS

_DELIMITERS = {"comma": ",", "semicolon": ";", "tab": "\t", "bar": "|", "space": " ", "\\t": "\t"}
_PLURALS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks", "": "one column"}
_MARK_NAMES = {",": "comma", ".": "point", "'": "apostrophe", "’": "apostrophe"}
_SEP_LINE = re.compile(r'\s*"?sep=(.)"?\s*', re.IGNORECASE)
_QUOTED_OR_BARE = re.compile(r'"([^"]*)"|([^ \t"][^ \t]*)')
_KEY_AND_VALUE = re.compile(r"\s*[^\W\d_][^,;\t|\d=:]*[:=][^,;\t|]*$")  # "vc: 150 m/min" says nothing of the delimiter
_SAMPLE = 300  # lines examined to find the delimiter
_MOSTLY = 0.5  # share of numbers with a unit from which they show the delimiter
_LONGEST_CELL = 30  # lines one quoted cell may span
_END = "\x00end"  # follows the last line: a cell that swallows it was opened by a quote and never closed


@dataclass(frozen=True, slots=True)
class Dialect:
    """Encoding, delimiter and decimal mark of a table.

    Parameters
    ----------
    encoding : str
        Python codec name, or the format of a workbook: "xlsx", "xls", "xlsb", "ods".
    delimiter : str
        One character; " " for runs of blanks, "" when there is one column or a workbook.
    decimal : {"point", "comma"}
    thousands : str
        The thousands mark met, or "".
    has_header : bool

    >>> Dialect("utf-8", ";", "comma", ".", True).describe()
    'UTF-8, semicolons, decimal comma, thousands point'

    """

    encoding: str
    delimiter: str
    decimal: Decimal
    thousands: str
    has_header: bool

    def describe(self) -> str:
        r"""The dialect in one short phrase.

        >>> Dialect("cp1252", "\t", "point", "", False).describe()
        'Windows-1252, tabs, decimal point, no header'
        """
        parts = [encoding_name(self.encoding)]
        if self.encoding not in FORMATS:
            parts += [_PLURALS.get(self.delimiter, repr(self.delimiter)), f"decimal {self.decimal}"]
        if self.thousands:
            parts.append(f"thousands {_MARK_NAMES.get(self.thousands, 'blank')}")
        return ", ".join(parts if self.has_header else [*parts, "no header"])


@dataclass(frozen=True, slots=True)
class TextSource:
    r"""The rows of a text file, read anew from its bytes at each iteration.

    >>> list(TextSource("a.csv", b"V;f\n1,5;2\n", "utf-8", ";", False))
    [(1, ['V', 'f']), (2, ['1,5', '2'])]
    """

    name: str
    data: bytes
    encoding: str
    delimiter: str
    has_sep_line: bool

    def __iter__(self) -> Iterator[tuple[int, list[str]]]:
        """Iterate over (line number, cells); comment lines come as blank lines."""
        return self.rows_of(self.lines(), 0)

    def lines(self) -> Iterator[str]:
        r"""The lines unchanged, comment lines as blank lines.

        >>> list(TextSource("a.csv", b"# steel\nV;f\n", "utf-8", ";", False).lines())
        ['\n', 'V;f\n']
        """
        lines = text_lines(self.data, self.encoding)
        if self.has_sep_line:
            next(lines)
        if self._may_hold_comments():
            lines = ("\n" if is_comment(line, self.delimiter) else line for line in lines)
        return chain(["\n"], lines) if self.has_sep_line else lines

    def rows_of(self, lines: Iterable[str], above: int) -> Iterator[tuple[int, list[str]]]:
        r"""Iterate over (line number, cells) of the lines that follow line ``above``.

        >>> list(TextSource("a.csv", b"V;f\n1;2\n", "utf-8", ";", False).rows_of(["1;2\n"], 1))
        [(2, ['1', '2'])]
        """
        if self.delimiter in ("", " "):
            yield from enumerate((split_line(line, self.delimiter) for line in lines), start=above + 1)
            return
        quoted = b'"' in self.data
        ends = chain(lines, [_END]) if quoted else lines
        reader = csv.reader(ends, delimiter=self.delimiter, skipinitialspace=True)
        start = above + 1
        try:
            if not quoted:  # each line is a row
                yield from enumerate(reader, start)
                return
            for row in reader:
                end = above + reader.line_num
                if end - start > _LONGEST_CELL or (row and row[-1].endswith(_END)):
                    if row != [_END]:
                        raise self._unclosed(start)
                    return
                yield start, row
                start = end + 1
        except csv.Error as error:
            start = start if quoted else above + reader.line_num
            raise self._unclosed(start) if self._is_short(start) else self._too_long(start) from error

    def comments(self) -> list[tuple[int, str]]:
        r"""List the comment lines, those beginning with # or %, as (line number, text).

        >>> TextSource("a.csv", b"# steel\nV;f\n", "utf-8", ";", False).comments()
        [(1, '# steel')]
        """
        if not self._may_hold_comments():
            return []
        lines = enumerate(text_lines(self.data, self.encoding), start=1)
        return [(n, line.strip()) for n, line in lines if is_comment(line, self.delimiter)]

    def as_written(self, numbers: set[int]) -> dict[int, str]:
        r"""Lines by number as written in the file, without the delimiters Excel pads them with.

        >>> TextSource("a.csv", b"Test 5;;\nV;f\n", "utf-8", ";", False).as_written({1})
        {1: 'Test 5'}
        """
        if not numbers:
            return {}
        lines = islice(enumerate(text_lines(self.data, self.encoding), start=1), max(numbers))
        return {n: line.strip().strip(self.delimiter + " \t") for n, line in lines if n in numbers}

    def _may_hold_comments(self) -> bool:
        return b"#" in self.data or b"%" in self.data

    def _is_short(self, line: int) -> bool:
        return len(self.as_written({line}).get(line, "")) <= csv.field_size_limit()

    def _too_long(self, line: int) -> DataError:
        return DataError(
            f"{self.name} line {line} holds a cell of more than {csv.field_size_limit()} characters, which "
            "is no measurement. Delete that cell or its column, or check the delimiter (--delimiter)."
        )

    def _unclosed(self, line: int) -> DataError:
        return DataError(f'{self.name} line {line}: a quote " opens a cell and no quote closes it. Close or delete it.')


def text_source(name: str, data: bytes, encoding: str, delimiter: str | None) -> TextSource:
    r"""Find the delimiter of a text file: the given one, that of its ``sep=`` line, or the one its rows suggest.

    Raises
    ------
    UsageError
        ``delimiter`` is neither one character nor one of comma, semicolon, tab, bar, space.

    >>> text_source("a.csv", b"V\tf\n1,5\t2,5\n", "utf-8", None).delimiter
    '\t'

    """
    if data.endswith(b"\x1a"):  # the end-of-file mark of DOS
        data = data.rstrip(b"\x1a")
    first = _SEP_LINE.fullmatch(next(iter(text_lines(data, encoding)), ""))
    if delimiter is not None:
        chosen = _DELIMITERS.get(delimiter, delimiter)
        if len(chosen) != 1 or chosen in '"\r\n':
            raise UsageError(
                f"--delimiter {delimiter!r} is not a delimiter: give comma, semicolon, tab, bar, space or a character."
            )
    else:
        chosen = first[1] if first else guess_delimiter(_sample(data, encoding))
    return TextSource(name, data, encoding, chosen, first is not None)


def guess_delimiter(lines: Sequence[str]) -> str:
    """Delimiter of a few lines of a table; " " stands for runs of blanks, "" for one column.

    Semicolon, tab and bar seldom occur in a cell, so one of them that splits most lines wins; a comma may
    be a decimal mark and a blank a part of a text, so these two are compared by the numbers they leave.

    >>> [guess_delimiter(lines) for lines in (["V;f", "1,5;2,5"], ["V  f", "1,5  2,5"], ["V", "1"])]
    [';', ' ', '']
    """
    found = _best(lines, ";\t|", is_number) or _best(lines, ", ", is_number)
    if found is None or not found[0]:
        with_units = _best(lines, ";\t|,", _is_amount)
        found = with_units if with_units is not None and with_units >= (True, _MOSTLY) else found
    return found[2] if found is not None else ""


def split_line(line: str, delimiter: str) -> list[str]:
    """Split a single line.

    >>> split_line(' 1.5   "tool A" 2 ', " ")
    ['1.5', 'tool A', '2']
    """
    if delimiter == "":
        return [line.strip()]
    if delimiter != " ":
        try:
            return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
        except csv.Error:  # a cell longer than the reader takes: refused, by its line, when the table is read
            return line.split(delimiter)
    if '"' in line:
        return [quoted or bare for quoted, bare in _QUOTED_OR_BARE.findall(line.strip())]
    # Not str.split(): it would split at the no-break blanks inside a number.
    return [cell for cell in line.strip().replace("\t", " ").split(" ") if cell]


def is_comment(line: str, delimiter: str) -> bool:
    """Whether a line is a comment, not a row whose first cell is an Excel error mark or a column named "#".

    >>> is_comment("# steel", ";"), is_comment("#DIV/0!;2", ";"), is_comment("#;V", ";")
    (True, False, False)
    """
    start = line.lstrip(" \t")[:1]
    if start != "#" and start != "%":
        return False
    cells = [cell.strip() for cell in split_line(line, delimiter)]
    if is_missing(cells[0]):
        return False
    return cells[0] not in ("#", "%") or delimiter in ("", " ") or not any(cells[1:])


def _sample(data: bytes, encoding: str) -> list[str]:
    lines = text_lines(data, encoding)  # any number of comments and blank lines may stand above the table
    kept = list(islice((line for line in lines if line.strip() and not is_comment(line, " ")), _SAMPLE))
    table = [line for line in kept if not _KEY_AND_VALUE.match(line)]
    return table if len(table) > 1 else kept


def _is_amount(cell: str) -> bool:
    """Whether a cell holds a number and more: its unit or spread."""
    return bool(number_and_rest(cell)[0])


def _best(lines: Sequence[str], delimiters: str, is_value: Callable[[str], bool]) -> tuple[bool, float, str] | None:
    """The trial of the delimiter that leaves most, None where none splits the lines."""
    trials = (trial for mark in delimiters if (trial := _try(lines, mark, is_value)) is not None)
    return max(trials, key=lambda trial: trial[:2], default=None)


def _try(lines: Sequence[str], delimiter: str, is_value: Callable[[str], bool]) -> tuple[bool, float, str] | None:
    """(Whether a text row has the width of the numbers, share of numbers in all lines, delimiter) of the lines."""
    if delimiter != " " and delimiter not in "".join(lines):
        return None
    rows = _split_lines(lines, delimiter)
    asked = {cell: is_value(cell) for cell in set(chain.from_iterable(row for row in rows if len(row) > 1))}
    numbers = [sum(map(asked.__getitem__, row)) if len(row) > 1 else 0 for row in rows]
    first = next((i for i, row in enumerate(rows) if len(row) > 1 and numbers[i]), None)
    if first is None:
        return None
    block = [(row, count) for row, count in zip(rows[first:], numbers[first:], strict=True) if len(row) > 1]
    if len(block) < 0.6 * len(rows[first:]):
        return None
    width = Counter(len(row) for row, count in block if count).most_common(1)[0][0]
    has_header = any(len(row) == width and not count for row, count in zip(rows[:first], numbers, strict=False))
    filled = sum(map(bool, map(str.strip, chain.from_iterable(row for row, _ in block))))
    return has_header, sum(count for _, count in block) / filled * len(block) / len(rows), delimiter


def _split_lines(lines: Sequence[str], delimiter: str) -> list[list[str]]:
    """Cells of each line as `split_line` finds them; one reader for all where no cell is quoted."""
    if delimiter == " ":
        return [split_line(line, " ") if " " in (inner := line.strip()) or "\t" in inner else [line] for line in lines]
    if '"' not in "".join(lines):
        with suppress(csv.Error):
            return list(csv.reader(lines, delimiter=delimiter, skipinitialspace=True))
    return [split_line(line, delimiter) for line in lines]
