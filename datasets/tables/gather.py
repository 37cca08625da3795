"""Blocks of cells -> columns of numbers or of text."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array, Texts
from ...core.errors import DataError
from ...core.rounding import label_of, listed
from ..doubts import Doubt
from .body import Body, Findings
from .header_rows import Test, fits_header, in_inches, no_units
from .invisible import visible
from .numerals import (
    NOT_MEASURED,
    SPREAD,
    Cell,
    Decimal,
    Mark,
    are_plain_labels,
    fraction,
    is_missing,
    is_word,
    number_and_rest,
    one_group,
    parse_number,
    plain_floats,
    read_mark,
    strict_floats,
)
from .plain import NumberBlock, stretches

_LISTED = 40  # bad cells kept per column
_FRACTION = "/"
_READ = {SPREAD: "the number before ± is read, and the spread after it is not used",
         _FRACTION: "fractions of an inch are read as decimals"}  # fmt: skip
_SAME = {"\u03bcm": "\u00b5m"}  # the Greek letter, and the sign of micro
_NEAR = 3.0  # factor within which a number lies among the others of its column


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a table.

    Parameters
    ----------
    number : int
        Position in the file, from 1.
    name, unit_cell : str
        Header text and units-row cell as written, without outer blanks, and "" where there is none.
    values : ndarray, shape (n,)
        float, nan where missing or bad; in a text column str objects, "" where missing.
    is_numeric : bool
        Fewer than half of the filled cells fail to be numbers; a column of labels (`read_table`) must besides be shown
        as written by its numbers, otherwise it is one of texts: 007, 1.7220, 5E2.
    bad : tuple of (int, str)
        Line and text of the first 40 cells that are not numbers, where most are.
    bad_count : int
        Number of all such cells.
    marks : tuple of (int, Mark)
        Row, from 0, of each marked number (``<0.05``, ``0.24*``) of a numeric column; its value is nan.

    >>> Column(1, "V", "m/min", np.array([100.0]), True).labels()
    array(['100'], dtype=object)

    """

    number: int
    name: str
    unit_cell: str
    values: NDArray[Any]
    is_numeric: bool
    bad: tuple[tuple[int, str], ...] = ()
    bad_count: int = 0
    marks: tuple[tuple[int, Mark], ...] = ()

    def labels(self) -> Texts:
        """The values as text, shape (n,): whole numbers without a point, "" where missing.

        >>> Column(1, "edge", "", np.array([1.0, 2.5, np.nan]), True).labels()
        array(['1', '2.5', ''], dtype=object)
        """
        if not self.is_numeric:
            return self.values.copy()
        texts = _numbers_as_texts(self.values)
        for row, mark in self.marks:
            texts[row] = mark.text
        return texts

    def numbers(self) -> Array | None:
        """The values as numbers, also of labels such as ``007``; None where they are texts.

        >>> Column(1, "run", "", np.array(["01", "02"], dtype=object), False).numbers()
        array([1., 2.])
        """
        if self.is_numeric:
            return self.values
        texts = self.values.tolist()
        return self.values.astype(float) if texts and all(map(str.isdecimal, texts)) else None

    def bad_cells(self) -> str:
        """The first cells of `bad` as a list for messages, and the number of the others."""
        cells = ", ".join(f"line {line}: {text!r}" for line, text in self.bad[:3])
        return cells + (f" and {self.bad_count - 3} more" if self.bad_count > 3 else "")


def rows_to_leave_out(columns: Sequence[Column]) -> list[str]:
    """The option that leaves out all rows with cells that cannot be read; nothing where not all are known.

    >>> rows_to_leave_out([Column(1, "VB", "mm", np.array([0.1, np.nan]), True, ((3, "120?"),), 1)])
    ["Or leave these rows out: --leave-out 'lines 3'."]
    """
    cells = [cell for column in columns for cell in column.bad]
    if len(cells) < sum(column.bad_count for column in columns):
        return []
    return [f"Or leave these rows out: --leave-out 'lines {','.join(map(str, sorted(dict(cells))))}'."]


def column_of_texts(number: int, name: str, cells: Sequence[str]) -> Column:
    """A column of texts; one of numbers where some of them are marked (``<0.05``, ``60+``).

    >>> column_of_texts(1, "T", ["12", "60+"]).values.tolist(), column_of_texts(1, "edge", ["1", "2"]).is_numeric
    ([12.0, nan], False)
    """
    g = _Gathering()
    g.add(tuple(cells), list(range(len(cells))), "point")
    if not (g.marks and g.is_numeric):
        return Column(number, name, "", np.array(cells, dtype=object), False, ())
    return Column(number, name, "", np.concatenate(g.floats), True, tuple(g.bad), g.bad_count, tuple(g.marks))


@dataclass(frozen=True, slots=True)
class _Amount:
    """A cell of a number and more: its block and row there, its line and text, and its unit or ±."""

    block: int
    row: int
    line: int
    text: str
    rest: str


@dataclass(slots=True)
class _Gathering:
    """One column while its blocks come in; text is kept of blocks where most cells are no numbers.

    Of labels it is also kept of blocks whose numbers are not shown as written.
    """

    is_label: bool = False
    floats: list[Array] = field(default_factory=list)
    texts: list[Texts | None] = field(default_factory=list)
    bad: list[tuple[int, str]] = field(default_factory=list)
    bad_count: int = 0
    filled: int = 0
    n_rows: int = 0
    marks: list[tuple[int, Mark]] = field(default_factory=list)
    grouped: list[tuple[int, int, str]] = field(default_factory=list)  # row, line and text of "1,234"
    errors: list[tuple[int, str]] = field(default_factory=list)  # line and text of "#DIV/0!"
    absent: list[tuple[int, str]] = field(default_factory=list)  # line and text of "n.b."
    is_unit: Test | None = None  # None: cells of a number and more are not read
    in_inches: bool = False  # fractions are read
    amounts: list[_Amount] = field(default_factory=list)
    unit: str = ""  # that each cell repeats

    @property
    def is_numeric(self) -> bool:
        numbers = self.filled - self.bad_count - len(self.marks)
        return 2 * self.bad_count < self.filled and numbers > 0 if self.filled else not self.absent

    def add(self, cells: tuple[Cell, ...], lines: list[int], decimal: Decimal) -> None:
        values = plain_floats(cells, decimal)
        bad: list[int] = []
        if values is None:
            values, bad = strict_floats(cells, decimal)
            self.grouped += ((self.n_rows + i, lines[i], str(cells[i]).strip()) for i in one_group(cells, decimal))
        self.filled += int(np.count_nonzero(values == values)) + len(bad)
        keeps = 2 * len(bad) >= len(cells) or (self.is_label and (bad or not are_plain_labels(cells, values, decimal)))
        self.texts.append(_texts(cells) if keeps else None)
        if bad:
            texts = {str(cell) for cell in set(cells)} if len(bad) == len(cells) else {str(cells[i]) for i in bad}
            found = {text: mark for text in texts if (mark := read_mark(text, decimal))}
            if found:
                self.marks += ((self.n_rows + i, mark) for i in bad if (mark := found.get(str(cells[i]))))
                bad = [i for i in bad if str(cells[i]) not in found]
            absent = {i: text for i in bad if (text := str(cells[i]).strip()).casefold() in NOT_MEASURED}
            self.absent += ((lines[i], text) for i, text in absent.items())
            self.filled -= len(absent)
            bad = [i for i in bad if i not in absent]
            bad = self._with_more(cells, values, bad, lines, decimal) if self.is_unit else bad
        self.bad_count += len(bad)
        self.bad += [(lines[i], str(cells[i]).strip()) for i in bad[: _LISTED - len(self.bad)]]
        if len(self.errors) < _LISTED and self.texts[-1] is None:
            missing = np.flatnonzero(values != values).tolist()
            self.errors += ((lines[i], text) for i in missing if _is_error(text := str(cells[i]).strip()))
        self.floats.append(values)
        self.n_rows += len(cells)

    def _with_more(
        self, cells: tuple[Cell, ...], values: Array, bad: list[int], lines: list[int], decimal: Decimal
    ) -> list[int]:
        """Read cells of a number and a spread or unit, in place; returns the places of the others."""
        read = {text: found for text in {str(cells[i]) for i in bad} if (found := self._amount(text, decimal))}
        for i in (i for i in bad if str(cells[i]) in read):
            text = str(cells[i])
            values[i], rest = read[text]
            self.amounts.append(_Amount(len(self.floats), i, lines[i], text.strip(), rest))
        return [i for i in bad if str(cells[i]) not in read]

    def _amount(self, text: str, decimal: Decimal) -> tuple[float, str] | None:
        number, rest = number_and_rest(text)
        if self.in_inches and (value := fraction(text)) is not None:
            return value, _FRACTION
        if self.is_unit is None or not (rest == SPREAD or (rest and self.is_unit(rest))):
            return None
        value = parse_number(number, decimal)
        return None if value is None else (value, _SAME.get(rest, rest))

    def settle(self, name: str, unit_cell: str) -> list[str]:
        """Take the unit that each cell repeats as that of the column, and state how cells of more are read.

        Cells of another unit, and all with a unit where some have none or the header names another, are no numbers.
        """
        rests = Counter(one.rest for one in self.amounts if one.rest not in _READ)
        unit = rests.most_common(1)[0][0] if rests else ""
        each = rests.total() == self.filled - len(self.marks) and fits_header(unit, name, unit_cell)
        self._take_back([one for one in self.amounts if one.rest not in _READ and not (each and one.rest == unit)])
        self.unit = unit if each and self.is_numeric else ""
        if not self.is_numeric:
            return []
        said = [f"{name}: {unit}, which each cell repeats, is taken as the unit of the column"] * bool(self.unit)
        texts = {rest: [repr(one.text) for one in self.amounts if one.rest == rest] for rest in _READ}
        return [*said, *(f"{name}: {how} ({listed(texts[rest], 1)})" for rest, how in _READ.items() if texts[rest])]

    def _take_back(self, wrong: Sequence[_Amount]) -> None:
        """Count cells as no numbers after all."""
        for one in wrong:
            self.floats[one.block][one.row] = np.nan
        self.bad_count += len(wrong)
        self.bad = sorted([*self.bad, *((one.line, one.text) for one in wrong)])[:_LISTED]

    def add_numbers(self, values: Array, cells: tuple[Cell, ...], decimal: Decimal) -> None:
        self.filled += len(values)
        self.n_rows += len(values)
        self.floats.append(values.copy())  # a view would keep the whole block
        self.texts.append(_texts(cells) if cells and not are_plain_labels(cells, values, decimal) else None)

    def as_written(self) -> Texts | None:
        """The labels of a column of numbers as written, None where its numbers show them."""
        if not self.is_label or all(texts is None for texts in self.texts):
            return None
        blocks = zip(self.texts, self.floats, strict=True)
        names = np.concatenate([_numbers_as_texts(values) if texts is None else texts for texts, values in blocks])
        shown = {name: "" if name.casefold() in NOT_MEASURED else name.removeprefix("'") for name in set(names)}
        return np.array([shown[name] for name in names], dtype=object)


def gather_columns(
    body: Body, decimal: Decimal
) -> tuple[tuple[Column, ...], NDArray[np.int64], Findings, tuple[Doubt, ...]]:
    """Convert the data rows of a table.

    Returns
    -------
    columns : tuple of Column
        Columns without a name and without a value are left out.
    lines : ndarray, shape (n,), int
    findings : Findings
    doubts : tuple of Doubt

    Raises
    ------
    DataError
        No column is numeric, or nearly all rows lack the same number of cells.

    >>> from .layout import find_layout
    >>> rows = [(1, ["edge", "V"]), (2, ["E1", "100"])]
    >>> body = Body("a.csv", rows, find_layout(rows, lambda text: False, "a.csv"), ",")
    >>> [column.is_numeric for column in gather_columns(body, "point")[0]]
    [False, True]

    """
    gatherings = [_gathering(body, i) for i in range(len(body.layout.names))]
    lines: list[NDArray[np.int64]] = []
    findings = Findings()
    for block in stretches(body, findings, decimal):
        lines.append(np.array(block.lines, dtype=np.int64))
        if isinstance(block, NumberBlock):
            for i, (gathering, values) in enumerate(zip(gatherings, block.values.T, strict=True)):
                gathering.add_numbers(values, block.labels.get(i, ()), decimal)
            continue
        for gathering, cells in zip(gatherings, block.columns, strict=True):
            gathering.add(cells, block.lines, decimal)
    heads = list(zip(gatherings, map(visible, body.layout.names), body.layout.unit_cells, strict=True))
    findings.assumed = [said for g, name, unit in heads for said in g.settle(name, unit)]
    if not any(gathering.is_numeric and gathering.filled for gathering in gatherings):
        raise DataError(
            f"{body.name} has no numeric column: in each of {', '.join(map(repr, body.layout.names))} "
            "at least half of the filled cells are no numbers. "
            "Check the delimiter (--delimiter) and the decimal mark (--decimal)."
        )
    findings.check_width(body.layout, body.name, gatherings[0].n_rows)
    doubts: list[Doubt] = []
    names = body.layout.names
    findings.errors = [(name, *one) for g, name in zip(gatherings, names, strict=True) for one in g.errors]
    numeric = ((g, name) for g, name in zip(gatherings, names, strict=True) if g.is_numeric)
    findings.absent = [(name, *one) for g, name in numeric for one in g.absent]
    columns = tuple(_columns(body, gatherings, doubts))
    return columns, np.concatenate(lines), findings, (*findings.doubts(body.layout), *doubts)


def _gathering(body: Body, place: int) -> _Gathering:
    """An empty column; units in its cells are looked for below the name of a known quantity."""
    if place in body.labels:
        return _Gathering(is_label=True)
    name, unit = body.layout.names[place], body.layout.unit_cells[place]
    return _Gathering(
        is_unit=body.words.is_unit if body.words.is_name(name) else no_units, in_inches=in_inches(name, unit)
    )


def _columns(body: Body, gatherings: list[_Gathering], doubts: list[Doubt]) -> Iterator[Column]:
    layout = body.layout
    lacking = [i for i, g in enumerate(gatherings) if not g.is_numeric and any(text is None for text in g.texts)]
    again = _reread(body, lacking)
    for i, (g, name, unit) in enumerate(zip(gatherings, layout.names, layout.unit_cells, strict=True)):
        if not name and not unit and not g.filled:
            continue  # an empty column between the others or next to them
        name, unit = visible(name) or f"col{i + 1}", visible(g.unit or unit)
        if g.is_numeric and (names := g.as_written()) is not None:
            yield Column(i + 1, name, unit, names, False, tuple(g.bad), g.bad_count)
        elif g.is_numeric:
            values: NDArray[Any] = np.concatenate(g.floats)
            g.floats.clear()
            doubts += _without_wrong_groups(name, values, g.grouped)
            yield Column(i + 1, name, unit, values, True, tuple(g.bad), g.bad_count, tuple(g.marks))
        else:
            texts = again[i] if i in again else np.concatenate([text for text in g.texts if text is not None])
            yield Column(i + 1, name, unit, texts, False)


def _without_wrong_groups(name: str, values: Array, grouped: list[tuple[int, int, str]]) -> list[Doubt]:
    """Leave out, in place, numbers like 1,234 that only as 1.234 lie in the range of the column's other numbers."""
    rows = np.array([row for row, _, _ in grouped], dtype=int)
    others = np.delete(values, rows) if rows.size else values[:0]
    others = np.abs(others[np.isfinite(others) & (others != 0)])
    if not others.size:
        return []
    low, high = float(others.min()) / _NEAR, float(others.max()) * _NEAR
    size = np.abs(values[rows])
    wrong = ((size < low) | (size > high)) & (size / 1000 >= low) & (size / 1000 <= high)
    cells = [(line, text) for (_, line, text), is_wrong in zip(grouped, wrong, strict=True) if is_wrong]
    if not cells:
        return []
    values[rows[wrong]] = np.nan
    shown = listed([f"line {line} {text!r}" for line, text in cells], 3)
    sentence = (
        f"{name}, {shown}: in thousands, as the decimal mark of the file has it, this is far from the other "
        f"values ({others.min():g} to {others.max():g}); as a decimal it would lie among them. Left out"
    )
    return [Doubt((name,), sentence, lines=tuple(line for line, _ in cells))]


def _reread(body: Body, places: list[int]) -> dict[int, Texts]:
    """Read the text of columns that turned out to be text after some of their blocks had been all numbers."""
    if not places:
        return {}
    parts: dict[int, list[Texts]] = {i: [] for i in places}
    for block in body.blocks(Findings()):
        for i in places:
            parts[i].append(_texts(block.columns[i]))
    return {i: np.concatenate(blocks) for i, blocks in parts.items()}


def _texts(cells: tuple[Cell, ...]) -> Texts:
    """The cells as text, one object for equal texts."""
    known = {cell: _text(cell) for cell in set(cells)}
    return np.array([known[cell] for cell in cells], dtype=object)


def _numbers_as_texts(values: Array) -> Texts:
    """Numbers as labels, "" where there is none."""
    return np.array(["" if v != v else label_of(v) for v in values.tolist()], dtype=object)


def _is_error(text: str) -> bool:
    """Whether a missing value is the error of a formula; #N/A is also written on purpose."""
    return text.startswith("#") and text.upper() not in ("#N/A", "#NV", "#N/D")


def _text(cell: Cell) -> str:
    if isinstance(cell, float):
        return label_of(cell)
    return visible(cell.strip()) if is_word(cell) or not is_missing(cell) else ""
