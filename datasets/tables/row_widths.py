"""Width of the data rows against the header: a shift of all rows is refused, or read where its cause is certain."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import islice, pairwise

from ...core.errors import DataError
from .layout import Layout, footer_label
from .numerals import Cell, is_missing, is_number

_SAMPLE = 200  # rows compared with the header
SHARE = 0.8  # of rows whose width differs by the same count: above it the header is at fault, not the rows
_REMARKS = re.compile(
    "remarks?|comments?|notes?|bemerkung(en)?|kommentar|remarques?|commentaires?|observaci(o|ó)n(es)?|notas?|comentarios?"
)


def aligned(
    rows: Iterable[tuple[int, Sequence[Cell]]], layout: Layout, name: str, delimiter: str
) -> tuple[Layout, list[str]]:
    """The layout with a name for each cell of the rows, and sentences on a name that was added or removed.

    Row names 1 to n in front of the rows, as R writes them, get a column of their own; an empty name in front of a
    header that is one cell longer than every row is removed.

    Raises
    ------
    DataError
        Nearly every row has more filled cells than the header.

    >>> rows = [(1, ["V", "f"]), (2, ["1", "100", "0.2"]), (3, ["2", "150", "0.2"])]
    >>> aligned(rows, Layout(1, ("V", "f"), ("", ""), 1, (), (True, True, True)), "a.csv", ",")[0].names
    ('', 'V', 'f')

    """
    width = layout.width
    if not layout.header_line:
        return layout, []
    body = ((line, _trimmed(row)) for line, row in rows if line > layout.above)
    first = next(((line, row) for line, row in body if row), None)
    if first is None or len(first[1]) == width or (len(first[1]) < width and layout.names[0]):
        return layout, []
    if (below := with_numbers_below(layout, *first)) is not layout:
        return below, []
    sample = [(line, row) for line, row in (first, *islice(body, _SAMPLE)) if row and not footer_label(row)]
    extra, count = Counter(len(row) - width for _, row in sample).most_common(1)[0]
    if extra < 0 and count == len(sample) and extra == -1:
        kept = replace(layout, names=layout.names[1:], unit_cells=layout.unit_cells[1:])
        return kept, ["The first name of the header is empty and every row has one cell fewer: it is left out."]
    if extra <= 0 or count < SHARE * len(sample):
        return layout, []
    if extra == 1 and _counts_rows([row[0] for _, row in sample if len(row) == width + 1]):
        named = replace(layout, names=("", *layout.names), unit_cells=("", *layout.unit_cells))
        return named, ["Every row begins with its number, for which the header has no name (as R writes it): not used."]
    if extra == width:
        return layout, []  # decimal commas between commas: `Body` names them
    example = next(row for _, row in sample if len(row) == width + extra)
    commas = " (a decimal comma makes two cells of one: then export with semicolons)" if delimiter == "," else ""
    raise DataError(
        f"{name}: the header in line {layout.header_line} has {width} names, and {_how_many(count, len(sample))} "
        f"{width + extra} cells, so the names stand above the wrong numbers. Add the {_missing_names(extra)} to the "
        f"header, each above its numbers, or remove the extra cells{commas}:\n{side_by_side(layout.names, example)}"
    )


def with_numbers_below(layout: Layout, line: int, row: Sequence[Cell]) -> Layout:
    """The layout with a column for each of the rising numbers that a first row has below the last name.

    >>> with_numbers_below(Layout(1, ("V", "VB"), ("", ""), 1, (), (True, True)), 2, ["", "5", "10"]).names
    ('V', 'VB 5', 'VB 10')
    """
    numbers = _numbers_below(row, layout.width)
    if not numbers:
        return layout
    names = (*layout.names[:-1], *(f"{layout.names[-1]} {number}" for number in numbers))
    units = (*layout.unit_cells, *[layout.unit_cells[-1]] * (len(numbers) - 1))
    return replace(layout, names=names, unit_cells=units, above=line)


def shifted(layout: Layout, name: str, row: Sequence[Cell], lacking: int, count: int, n_rows: int) -> DataError:
    """The refusal of a table nearly all of whose rows lack the same number of cells."""
    return DataError(
        f"{name}: the header in line {layout.header_line} has {layout.width} names, and {_how_many(count, n_rows)} "
        f"{layout.width - lacking} cell{'s' * (layout.width - lacking > 1)}, so the names stand above the wrong "
        f"numbers. Remove the extra name{'s' * (lacking > 1)} from the header, or add the missing cells to the rows:\n"
        f"{side_by_side(layout.names, row)}"
    )


def remarks_only(layout: Layout, lacking: int) -> bool:
    """Whether the last names, to which the rows have no cells, are those of remarks.

    >>> remarks_only(Layout(1, ("V", "AW", "Remarks"), ("",) * 3, 1, (), (True, True)), 1)
    True
    """
    return all(_REMARKS.fullmatch(name.casefold().strip(" :.")) for name in layout.names[-lacking:])


def may_be_inside(row: Sequence[Cell], layout: Layout) -> bool:
    """Whether the last cell of a short row could as well stand under the last name, its missing cell before it.

    >>> layout = Layout(1, ("edge", "V", "AW"), ("",) * 3, 1, (), (False, True, True))
    >>> may_be_inside(["E1", "100"], layout), may_be_inside(["E1", "worn"], layout)
    (True, False)
    """
    lacking = layout.width - len(row)
    place = len(row) - 1 + lacking
    if not row or place >= len(layout.numeric):
        return False
    cell = row[-1]
    return is_number(cell) == layout.numeric[place] and not is_missing(str(cell))


def side_by_side(names: Sequence[str], row: Sequence[Cell]) -> str:
    """Header and row in two lines, cell above cell; of long ones the first cells.

    >>> print(side_by_side(["edge", "V"], ["100"]))
      edge  V
      100   (none)
    """
    size = max(len(names), len(row))
    above = [*(name or "(empty)" for name in names), *["(none)"] * (size - len(names))]
    below = [*(str(cell).strip() or "(empty)" for cell in row), *["(none)"] * (size - len(row))]
    pairs = [(one[:16], two[:16]) for one, two in zip(above, below, strict=True)]
    if size > 12:
        pairs = [*pairs[:6], ("...", "..."), *pairs[-5:]]
    widths = [max(map(len, pair)) for pair in pairs]
    lines = ("  ".join(pair[i].ljust(w) for pair, w in zip(pairs, widths, strict=True)).rstrip() for i in (0, 1))
    return "\n".join(f"  {line}" for line in lines)


def _trimmed(row: Sequence[Cell]) -> list[Cell]:
    cells = list(row)
    while cells and not str(cells[-1]).strip():
        cells.pop()
    return cells


def _numbers_below(row: Sequence[Cell], width: int) -> list[str]:
    """Rising numbers that begin under the last name: the second row of a header, one column for each number."""
    cells = [str(cell).strip().removesuffix(".0") for cell in row]
    numbers = [cell.replace(",", ".") for cell in cells[width - 1 :]]
    if any(cells[: width - 1]) or len(numbers) < 2 or not all(re.fullmatch(r"\d+(\.\d+)?", n) for n in numbers):
        return []
    return numbers if all(float(a) < float(b) for a, b in pairwise(numbers)) else []


def _counts_rows(cells: Sequence[Cell]) -> bool:
    """Whether the cells count the rows from 0 or 1."""
    if len(cells) < 2 or not all(str(cell).strip().removesuffix(".0").isdecimal() for cell in cells):
        return False
    numbers = [int(str(cell).strip().removesuffix(".0")) for cell in cells]
    return numbers[0] in (0, 1) and numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def _how_many(count: int, total: int) -> str:
    return "every row has" if count == total else f"{count} of {total} rows have"


def _missing_names(extra: int) -> str:
    return "missing name" if extra == 1 else f"{extra} missing names"
