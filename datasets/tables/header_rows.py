"""The rows of a table's head -> one name and one unit for each column."""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from .numerals import Cell, is_number

_BRACKETS = {"[": "]", "(": ")", "{": "}", "<": ">"}
_BRACKETED = re.compile(r"[\[({]([^\[\](){}]+)[\])}]")
_DASHES = ("-", "--", "–", "—")
_FEW = 2  # cells that make a row of the head
_MOST_ABOVE = 2  # rows of group names above the names

_TIMES = re.compile(r"(?:h|hrs?|hours?|m|mins?|minutes?|s|sec|sek|seconds?|['′\"″]+)\.?", re.IGNORECASE)
_INCH = re.compile(r"[\[(,/]\s*in\.?\s*(?:[\])]|$)|\b(?:inch(?:es)?|zoll|pouces?|pulgadas?)\b", re.IGNORECASE)
_UNIT_IN_HEADER, _BETWEEN = re.compile(r"[\[(,/]|\bin\b"), re.compile(r"[\s\[\](),]+")

Test = Callable[[str], bool]


def no_units(text: str) -> bool:
    """False for every text: the default of `read_table`, which finds units rows by brackets only.

    >>> no_units("mm")
    False
    """
    return False


class SampleRow(NamedTuple):
    """A row of the sample: its cells up to the last filled one, and counts of what they are."""

    line: int
    cells: tuple[Cell, ...]
    written: int
    filled: int
    numbers: int
    marks: int

    @property
    def is_text(self) -> bool:
        """Whether no cell is a number or a mark of a missing value."""
        return self.numbers == 0 and self.marks == 0

    def text(self, column: int) -> str:
        """The text of a cell, "" beyond the last one."""
        return str(self.cells[column]).strip() if column < len(self.cells) else ""


@dataclass(frozen=True, slots=True)
class Head:
    """Names and units of the columns, the first line of the head and the last one above the data."""

    names: tuple[str, ...]
    unit_cells: tuple[str, ...]
    first: int
    above: int


@dataclass(frozen=True, slots=True)
class Words:
    """Meaning of a text of the head: a unit, a name of a known quantity.

    >>> Words(no_units, no_units).is_unit("mm")
    False
    """

    is_unit: Test
    is_name: Test


def read_head(
    sample: Sequence[SampleRow],
    head: int,
    first: int,
    words: Words,
    spans: Mapping[tuple[int, int], int] | None,
) -> Head:
    """Names and units from the header row at ``head``, the rows below it and the group names above it.

    Parameters
    ----------
    sample : sequence of SampleRow
    head, first : int
        Positions of the header row and of the first full row of numbers.
    words : Words
    spans : mapping of (int, int) to int, or None
        Line and column (from 1) of each merged cell -> number of columns it covers; None for a text.

    """
    units: SampleRow | None = None
    rows, last = [sample[head]], head
    numeric = [is_number(cell) for cell in sample[first].cells] if first < len(sample) else []
    for place in range(head + 1, max(first, head + 2)):
        row = sample[place] if place < len(sample) else None
        if row is not None and units is None and _holds_units(sample, place, first, rows, words):
            units = row
        elif row is not None and place < first and _is_second_row(row, rows[0], numeric):
            rows.append(row)
        else:
            break
        last = place
    filled = {i for row in sample[first:] for i, cell in enumerate(row.cells) if cell != ""}
    merged = spans or {}
    best = _combine(rows, units, filled, words, merged)
    top = head
    for place in range(head - 1, max(head - 1 - _MOST_ABOVE, -1), -1):
        above = sample[place]
        wider = spans is None and len(above.cells) > len(best[1])
        if wider or not above.is_text or above.line != sample[place + 1].line - 1:
            break
        more = _combine([above, *rows], units, filled, words, merged)
        if more[0] <= best[0]:
            break
        rows, best, top = [above, *rows], more, place
    return Head(best[1], best[2], sample[top].line, sample[last].line)


def _combine(
    rows: Sequence[SampleRow],
    units: SampleRow | None,
    filled: set[int],
    words: Words,
    spans: Mapping[tuple[int, int], int],
) -> tuple[tuple[int, int, int, int], tuple[str, ...], tuple[str, ...]]:
    """The `_worth` of the names of these rows, the names, and the units."""
    width = max(len(row.cells) for row in rows)
    unit_cells = tuple(units.text(i) if units is not None else "" for i in range(width))
    names = _names(rows, width, unit_cells, words, spans)
    return _worth(names, unit_cells, filled, words), names, unit_cells


def is_units_row(row: SampleRow, header: SampleRow, is_unit: Test) -> bool:
    """Whether most filled cells are units, standing below names, and one of them is not a number."""
    row = _without_remark(row, header, is_unit)
    other_width = row.written != header.written and len(row.cells) != len(header.cells)
    if other_width and (len(row.cells) > len(header.cells) or row.filled < _FEW or row.numbers):
        return False
    places = [i for i, cell in enumerate(row.cells) if str(cell).strip()]
    unnamed = [i for i in places if not header.text(i) and row.text(i) not in _DASHES]
    if any(i >= len(header.cells) for i in places) or 2 * len(unnamed) >= len(places):
        return False
    texts = [str(row.cells[i]).strip() for i in places]
    units = [text for text in texts if _is_unit_cell(text, is_unit)]
    dashes = sum(text in _DASHES for text in texts)
    return 2 * (len(units) + dashes) > len(texts) and not all(map(is_number, units))


def _without_remark(row: SampleRow, header: SampleRow, is_unit: Test) -> SampleRow:
    """A row of a sheet without a text beside the table, which stands in no column that has a name."""
    width = len(header.cells)
    beside = [i for i in range(width, len(row.cells)) if row.text(i)]
    if len(beside) != 1 or _is_unit_cell(row.text(beside[0]), is_unit):
        return row
    if is_number(row.cells[beside[0]]):
        return row
    return row._replace(cells=row.cells[:width], filled=row.filled - 1)


def _holds_units(sample: Sequence[SampleRow], place: int, first: int, rows: Sequence[SampleRow], words: Words) -> bool:
    """Whether a row below names holds their units; symbols resemble units, but have the units below them."""
    row = sample[place]
    if not any(is_units_row(row, above, words.is_unit) for above in rows):
        return False
    return place + 1 >= first or not row.is_text or not is_units_row(sample[place + 1], row, words.is_unit)


def _is_unit_cell(text: str, is_unit: Test) -> bool:
    bracketed = len(text) > 2 and _BRACKETS.get(text[0]) == text[-1]
    return bracketed or is_unit(text)


def _is_second_row(row: SampleRow, header: SampleRow, numeric: Sequence[bool]) -> bool:
    """Whether a row of text below the header continues it: most of its cells stand below names, above numbers."""
    places = [i for i, cell in enumerate(row.cells) if str(cell).strip()]
    if not row.is_text or len(places) < _FEW or any(not header.text(i) for i in places):
        return False
    return 2 * sum(i < len(numeric) and numeric[i] for i in places) > len(places)


def _names(
    rows: Sequence[SampleRow],
    width: int,
    unit_cells: Sequence[str],
    words: Words,
    spans: Mapping[tuple[int, int], int],
) -> tuple[str, ...]:
    """One name for each column from the texts above each other, groups first."""
    stacks: list[list[tuple[str, bool]]] = [[] for _ in range(width)]
    for row in rows[:-1]:
        for i, entry in enumerate(_spread(row, rows[-1], width, spans, words)):
            stacks[i].append(entry)
    for i in range(width):
        stacks[i].append((rows[-1].text(i), False))
    return tuple(_name(stack, unit, words) for stack, unit in zip(stacks, unit_cells, strict=True))


def _spread(
    row: SampleRow, below: SampleRow, width: int, spans: Mapping[tuple[int, int], int], words: Words
) -> list[tuple[str, bool]]:
    """Texts of a row by column, and whether each covers several: a merged cell, or blanks after it above names.

    A name above a row of units alone covers no blank: the name of the next column is missing.
    """
    found, text, shared, until = [], "", False, 0
    only_units = all(_is_unit_cell(cell, words.is_unit) for cell in map(below.text, range(width)) if cell)
    for i in range(width):
        own = row.text(i)
        if own:
            span = spans.get((row.line, i + 1), 0)
            after = not row.text(i + 1) and bool(below.text(i)) and bool(below.text(i + 1)) and not only_units
            text, shared = own, span > 1 or (not span and after)
            until = i + span if span else width
        elif i >= until or not shared or not below.text(i):
            text, shared = "", False
        found.append((text, shared))
    return found


def _name(stack: Sequence[tuple[str, bool]], unit_cell: str, words: Words) -> str:
    """The name that a stack of texts gives: a known one if there is one, else all of them."""
    entries = list(dict.fromkeys(entry for entry in stack if entry[0]))
    texts = list(dict.fromkeys(text for text, _ in entries))
    if len(texts) < 2:
        return texts[0] if texts else ""
    whole, lowest = " ".join(texts), texts[-1]
    own = [text for text, shared in reversed(entries[:-1]) if not shared]
    for name in (whole, lowest, *own):
        if words.is_name(name):
            unit = _unit_in(texts[:-1], words) if name == lowest and not unit_cell else ""
            return name if not unit or _unit_in([name], words) else f"{name} [{unit}]"
    return whole


def _unit_in(texts: Sequence[str], words: Words) -> str:
    for text in reversed(texts):
        for match in _BRACKETED.finditer(text):
            if words.is_unit(unit := match[1].strip()):
                return unit
    return ""


def _worth(
    names: Sequence[str], unit_cells: Sequence[str], filled: set[int], words: Words
) -> tuple[int, int, int, int]:
    """The rank of names: known ones, filled columns with a name, names of one column, names with a unit."""
    given = [name for name in names if name]
    known = {name for name in given if words.is_name(name)}
    named = sum(bool(name) for i, name in enumerate(names) if i in filled)
    repeated = sum(count - 1 for count in Counter(given).values())
    units = sum(bool(unit or _unit_in([name], words)) for name, unit in zip(names, unit_cells, strict=True))
    return len(known), named, -repeated, units


def fits_header(unit: str, name: str, unit_cell: str) -> bool:
    """Whether the unit in the cells of a column is that of its header, or the header has none; no times, as of a clock.

    >>> fits_header("mm", "VB", ""), fits_header("um", "VB [mm]", ""), fits_header("min", "t", "")
    (True, False, False)
    """
    words = _BETWEEN.split(f"{name} {unit_cell}")
    return not _TIMES.fullmatch(unit) and (unit in words or not (unit_cell or _UNIT_IN_HEADER.search(name)))


def in_inches(name: str, unit_cell: str) -> bool:
    """Whether the header of a column names inches as its unit.

    >>> in_inches("DOC (in)", ""), in_inches("depth", "inch"), in_inches("VB in mm", "")
    (True, True, False)
    """
    return bool(_INCH.search(f"{name} [{unit_cell.strip('[]()')}]"))
