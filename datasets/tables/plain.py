"""Fast reading of lines without quotes: of numbers alone to an array, of full rows to columns of cells."""

import csv
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, islice

import numpy as np

from ...core.arrays import Array
from .body import BLOCK, TAIL, Body, Findings, RowBlock
from .dialect import TextSource
from .numerals import Cell, Decimal

# No letter but e: "nan" and "inf" are left to the reader of cells.
_ALLOWED = b"0123456789+-eE \r\n"
_DELIMITERS = ",;\t|"


@dataclass(frozen=True, slots=True)
class NumberBlock:
    """Successive data rows that hold only numbers: line numbers, values of shape (n, width), and cells of labels."""

    lines: range
    values: Array
    labels: dict[int, tuple[Cell, ...]] = field(default_factory=dict)


def stretches(body: Body, findings: Findings, decimal: Decimal) -> Iterator[NumberBlock | RowBlock]:
    r"""Iterate over the data as `Body.blocks` does, the first blocks as numbers while they hold only numbers.

    Columns of labels (`Body.labels`) keep their cells as well. The next blocks, while their rows are full, are split
    without the reader of quoted cells.

    >>> from .layout import find_layout
    >>> source = TextSource("a.csv", b"V,f\n" + 2300 * b"1,2\n", "utf-8", ",", False)
    >>> body = Body("a.csv", source, find_layout(source, lambda text: False, "a.csv"), ",")
    >>> [(type(part).__name__, len(part.lines)) for part in stretches(body, Findings(), "point")]
    [('NumberBlock', 2000), ('RowBlock', 300)]

    """
    below = yield from _plain(body, decimal)
    yield from replace(body, rows=below).blocks(findings)


def plain_numbers(lines: Sequence[str], width: int, delimiter: str, decimal: Decimal) -> Array | None:
    r"""Convert lines whose cells are all there and all plain finite numbers; None for any others.

    Parameters
    ----------
    lines : sequence of str
        With their line ends, at least one.
    width : int
        Cells that each line must have.

    Returns
    -------
    ndarray, shape (len(lines), width), or None
        As Python's ``float`` reads the cells, to the last bit.

    >>> plain_numbers(["1,5;2\n", "3;4e-1\n"], 2, ";", "comma")
    array([[1.5, 2. ],
           [3. , 0.4]])
    >>> plain_numbers(["1,5;2\n", "3;\n"], 2, ";", "comma") is None
    True

    """
    mark = "." if decimal == "point" else ","
    if delimiter not in _DELIMITERS or delimiter == mark or max(map(len, lines)) > csv.field_size_limit():
        return None
    if not lines[0].strip():  # blank lines alone would make loadtxt warn
        return None
    text = "".join(lines)
    if text.encode().translate(None, _ALLOWED + (mark + delimiter).encode()):
        return None
    if mark == ",":
        lines = text.replace(mark, ".").splitlines()
    try:
        values = np.loadtxt(lines, dtype=np.float64, delimiter=delimiter, comments=None, ndmin=2)
    except ValueError:  # a cell is empty or no number, or a line has another width
        return None
    return values if values.shape == (len(lines), width) and np.isfinite(values).all() else None


def plain_cells(lines: Sequence[str], width: int, delimiter: str) -> list[tuple[Cell, ...]] | None:
    r"""Split lines without quotes whose rows are full and begin with a filled cell; None for any others.

    Returns
    -------
    list of tuple of str, or None
        The columns, as the reader of quoted cells gives them.

    >>> plain_cells(["E1,1\n", "E1,2\n"], 2, ",")
    [('E1', 'E1'), ('1', '2')]
    >>> plain_cells(["E1,1\n", "E1\n"], 2, ",") is None, plain_cells(["E1, 1\n"], 2, ",") is None
    (True, True)

    """
    if not delimiter or delimiter not in _DELIMITERS or max(map(len, lines)) > csv.field_size_limit():
        return None
    if {line.count(delimiter) for line in lines} != {width - 1}:
        return None
    text = "".join(lines)
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    cells = text.removesuffix("\n").replace("\n", delimiter).split(delimiter)
    first = cells[::width]
    if len(cells) != width * len(lines) or not all(first) or delimiter + " " in text:
        return None
    if any(cell[0] == " " for cell in first):  # blanks after a delimiter are no part of a cell
        return None
    return [tuple(cells[i::width]) for i in range(width)]


def _plain(
    body: Body, decimal: Decimal
) -> Generator[NumberBlock | RowBlock, None, Iterable[tuple[int, Sequence[Cell]]]]:
    """Yield the blocks of numbers and then of full rows that begin the data, and return the rows below them.

    They end where blocks of cells would end, so that what is found at the foot of a table does not change.
    """
    source = body.rows
    if body.left_out or not isinstance(source, TextSource) or b'"' in source.data:  # a quoted cell may hold line ends
        return source
    lines, above = source.lines(), body.layout.above
    for _ in islice(lines, above):
        pass
    held: list[str] = []
    only_numbers = True
    while True:
        held += islice(lines, BLOCK + TAIL - len(held))
        if len(held) < BLOCK + TAIL:
            break
        block, lines_of = held[:BLOCK], range(above + 1, above + BLOCK + 1)
        values = plain_numbers(block, body.layout.width, source.delimiter, decimal) if only_numbers else None
        if values is not None:
            yield NumberBlock(lines_of, values, _labels(block, body, source.delimiter))
        else:
            only_numbers = False
            cells = plain_cells(block, body.layout.width, source.delimiter)
            if cells is None:
                break
            yield RowBlock(list(lines_of), cells)
        above += BLOCK
        del held[:BLOCK]
    return source.rows_of(chain(held, lines), above)


def _labels(lines: Sequence[str], body: Body, delimiter: str) -> dict[int, tuple[Cell, ...]]:
    """Cells of the columns of labels, by their places, of full lines of numbers."""
    if not body.labels:
        return {}
    text = "".join(lines).replace("\r\n", "\n").replace("\r", "\n").replace(" ", "")
    cells = text.replace("\n", delimiter).split(delimiter)
    return {i: tuple(cells[i : len(lines) * body.layout.width : body.layout.width]) for i in body.labels}
