"""Cells that a doubt or a check is about: their rows in the file, and the correction that gives one a new value."""

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..core.errors import FitmodelsError, UsageError
from ..datasets.corrections import parse_correction
from ..datasets.options import DecimalMark, ReadOptions
from ..datasets.reading import table_of_tests
from ..datasets.tables import Column, Table
from ..datasets.units import convert
from .command_words import with_points
from .options import pairs

MOST: Final = 6  # rows of one doubt
NEAR: Final = 0.15  # of a decimal logarithm: a ratio is a power of ten
LAST_BIT: Final = 2.3e-16  # relative
ULPS: Final = 12  # neighbours of a factor that are tried
LONGEST: Final = 40  # characters of a cell
LARGEST: Final = 5_000_000  # bytes of a file: a larger one would hold up other requests
NAMED: Final = re.compile(r"\blines? (\d{1,9}(?:(?:, ?|-)\d{1,9})*)")
AGAINST: Final = (", its neighbours in edge ", " where the other rows of edge ")  # a cell, and what is usual beside it
UNIT_RATIO: Final = re.compile(r"a factor of ([\d.]+) as between")
OWN: Final = re.compile(r"lines (\d+):([A-Za-z]\w*)[*/+-].+")


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell whose value may be wrong.

    Attributes
    ----------
    line : int
    symbol, unit : str
        Unit of its column.
    value : float
        As in the file.
    ready : float or None
        A value that a slipped decimal mark or a known ratio of units points to.
    """

    line: int
    symbol: str
    unit: str
    value: float
    ready: float | None = None

    @property
    def words(self) -> str:
        """The ready value in words, with its cell."""
        return f"{self.symbol} in line {self.line} from {self.value:.6g} {self.unit} to {self.ready:.6g} {self.unit}"


@dataclass(frozen=True, slots=True)
class Cells:
    """The table of a file and the columns of its reading, from which cells are found by line and symbol."""

    table: Table
    columns: Sequence[Mapping[str, Any]]
    units: Mapping[str, str]

    def row(self, line: int) -> list[str]:
        """Texts of a row, a cell for each column; none where the line has no row."""
        at = np.flatnonzero(self.table.lines == line)
        return [_text(column.values[at[0]]) for column in self.table.columns] if len(at) else []

    def column(self, symbol: str) -> tuple[Column, str]:
        """The column of a symbol and its unit.

        Raises
        ------
        UsageError
            No column, or one of texts, has this symbol.
        """
        number = next((one["number"] for one in self.columns if one["role"] == symbol), None)
        found = next((one for one in self.table.columns if one.number == number), None)
        if found is None or not found.is_numeric:
            raise UsageError(f"{symbol}: no column of numbers of the file has this role; choose it in the menus above.")
        unit = next(str(one["unit"] or "") for one in self.columns if one["number"] == number)
        return found, unit or self.units.get(symbol, "")

    def cell(self, line: int, symbol: str) -> Cell:
        """The cell of a line and a symbol.

        Raises
        ------
        UsageError
            The line has no row, or several, or no number there.
        """
        column, unit = self.column(symbol)
        at = np.flatnonzero(self.table.lines == line)
        value = float(column.values[at[0]]) if len(at) == 1 else math.nan
        if not math.isfinite(value):
            raise UsageError(f"line {line} has {len(at)} rows with a number of {symbol}: leave the row out instead.")
        return Cell(line, symbol, unit, value)

    def correction(self, line: int, symbol: str, typed: str) -> str:
        """The text of ``--correct`` that gives a cell a new value in the unit of its column.

        Raises
        ------
        UsageError
            The new value is no number, or the one of the file.
        """
        cell, new = self.cell(line, symbol), _number(with_points(typed.strip(), symbol))
        if new is None:
            unit = f" in {cell.unit}" if cell.unit else ""
            raise UsageError(
                f"{symbol} in line {line}: {typed[:40]!r} is no number; write digits with a decimal point{unit}. The "
                f"file has {cell.value:.6g}."
            )
        if new == cell.value:
            raise UsageError(f"{symbol} in line {line}: {new:g} is the value of the file; write another one.")
        if new * cell.value > 0:
            return f"lines {line}:{symbol}{_factor(cell.value, new)}"
        own = self.units.get(symbol, cell.unit)
        old, wanted = (convert(np.array([x]), cell.unit, own)[0] if cell.unit else x for x in (cell.value, new))
        return f"lines {line}:{symbol}{'-' if wanted < old else '+'}{abs(float(wanted) - float(old))!r}"

    def corrected(self, text: str) -> tuple[Cell, float] | None:
        """The cell that a correction changes, and its new value; None where it changes several, or by a sum.

        A sum may be in another unit than the column.
        """
        own = OWN.fullmatch(text)
        try:
            one = parse_correction(text)
            if own is None or not one.scales:
                return None
            cell = self.cell(int(own[1]), own[2])
        except UsageError:
            return None
        return cell, float(one.apply(np.array([cell.value]))[0])

    def worded(self, text: str) -> str:
        """A correction of one cell in words; empty for another one."""
        found = self.corrected(text)
        if found is None:
            return ""
        cell, new = found
        return f"line {cell.line}: {cell.symbol} {cell.value:.6g} {cell.unit} becomes {new:.6g} {cell.unit}"

    def row_after(self, corrections: Sequence[str], line: int) -> list[str]:
        """Texts of a row in which the cells that corrections change have their new and former values."""
        row, numbers = self.row(line), [column.number for column in self.table.columns]
        for cell, new in filter(None, map(self.corrected, corrections)):
            if cell.line == line and row:
                row[numbers.index(self.column(cell.symbol)[0].number)] = f"{new:.6g} (was {cell.value:.6g})"
        return row

    def lines_of_doubt(self, doubt: Mapping[str, Any]) -> list[int]:
        """Lines of a doubt, the first few; of one about whole edges those that it compares with others of their edge.

        None where a doubt is about whole edges, or columns, and compares no cell.
        """
        lines = [int(line) for line in doubt.get("lines") or ()]
        if self._are_whole_edges(lines):
            compared = ratios_in(str(doubt["sentence"]))
            lines = [line for line in lines if line in compared]
        return lines[:MOST]

    def _are_whole_edges(self, lines: Sequence[int]) -> bool:
        """Whether lines are all of their edges, of three rows or more each."""
        edges = self._edges()
        rows, held = Counter(edges.values()), Counter(edges[line] for line in lines if line in edges)
        return bool(held) and all(count == rows[name] > 2 for name, count in held.items())

    def _edges(self) -> dict[int, str]:
        """The name of the edge of each line, where a column has them; a blank one is that of the row above."""
        number = next((one["number"] for one in self.columns if one["role"] == "edge"), None)
        values = next((one.values for one in self.table.columns if one.number == number), ())
        found, name = dict[int, str](), ""
        for line, value in zip(self.table.lines, values, strict=False):
            name = _text(value) or name
            found[int(line)] = name
        return found

    def _is_of_whole_rows(self, symbols: Sequence[str]) -> bool:
        """Whether a doubt is about all columns, as one about copies."""
        roles = {one["role"] for one in self.columns} - {None, "edge"}
        return len(roles) > 3 and roles <= set(symbols)

    def of_doubt(self, doubt: Mapping[str, Any], others: Sequence[Mapping[str, Any]] = ()) -> list[Cell]:
        """Cells of the lines of a doubt, with the value that it points to.

        Where it compares columns, and one of ``others`` finds which of them jumps in a line, that cell is wrong.
        """
        symbols, sentence = [str(one) for one in doubt["columns"]], str(doubt["sentence"])
        if self._is_of_whole_rows(symbols):
            return []
        wrong, ratio = self._jumping(symbols, others), ratios_in(sentence)
        lines, first = self.lines_of_doubt(doubt), next(iter(symbols), "")
        found = [wrong.get(line) or cell for line in lines for cell in self._known(line, first)]
        return [
            one if one in wrong.values()
            else Cell(one.line, one.symbol, one.unit, one.value, _ready(one.value, ratio.get(one.line), sentence))
            for one in found
        ]  # fmt: skip

    def _jumping(self, symbols: Sequence[str], others: Sequence[Mapping[str, Any]]) -> dict[int, Cell]:
        """Cells with a value to replace them, by line, that a doubt about one of several columns alone names."""
        alone = [one for one in others if len(symbols) > len(one["columns"]) == 1 and one["columns"][0] in symbols]
        return {cell.line: cell for one in alone for cell in self.of_doubt(one) if cell.ready is not None}

    def of_target(self, target: str, symbol: str) -> list[Cell]:
        """Cells of the lines of a target."""
        return [cell for line in lines_in(target) for cell in self._known(line, symbol)]

    def _known(self, line: int, symbol: str) -> Iterator[Cell]:
        try:
            yield self.cell(line, symbol)
        except UsageError:
            return


def cells_of(path: Path, options: Sequence[str], look: Mapping[str, Any]) -> Cells | None:
    """Cells of a file as its reading found the table; None where it cannot be read, or is large."""
    given = dict(pairs(options))
    marks: dict[str, DecimalMark] = {"point": "point", "comma": "comma"}
    wanted = ReadOptions(
        decimal=marks.get(given.get("--decimal", "")), delimiter=given.get("--delimiter"), sheet=given.get("--sheet"),
        hidden="--hidden" in given,
    )  # fmt: skip
    try:
        if path.stat().st_size > LARGEST:
            return None
        return Cells(table_of_tests(path, wanted), look.get("columns") or (), look.get("units") or {})
    except (FitmodelsError, OSError):
        return None


def lines_in(target: str) -> list[int]:
    """Lines of a target, the first few; none where it names edges.

    >>> lines_in("lines 31, 3-5,9"), lines_in("E07")
    ([31, 3, 4, 5, 9], [])
    """
    found: dict[int, None] = {}
    for part in NAMED.findall(target):
        for piece in part.split(","):
            first, _, last = piece.partition("-")
            found |= dict.fromkeys(range(int(first), min(int(last or first), int(first) + MOST) + 1))
    return list(found)[:MOST]


def ratios_in(sentence: str) -> dict[int, float]:
    """The ratio of each cell that a doubt names to what is usual beside it.

    >>> ratios_in("line 31 has 250 A, its neighbours in edge C2 0.24 and 0.26; a digit may have slipped")
    {31: 1000.0}
    """
    found = {}
    for part in sentence.split(";"):
        cell, _, beside = next((part.partition(mark) for mark in AGAINST if mark in part), ("", "", ""))
        words, others = cell.replace(",", " ").split(), beside.partition(",")[0].split()
        at = len(words) - 1 - words[::-1].index("line") if "line" in words else len(words)
        line, value = words[at + 1 : at + 2], _numbers(words[at + 3 : at + 4])
        usual = _numbers(others[-3::2] if others[-2:-1] == ["and"] else others[-1:])
        if line and line[0].isdecimal() and words[at + 2] == "has" and value and value[0] > 0 and sum(usual) > 0:
            found[int(line[0])] = value[0] * len(usual) / math.fsum(usual)
    return found


def _numbers(words: Sequence[str]) -> list[float]:
    """Numbers of words; none where one of them is no number."""
    found = [_number(word) for word in words]
    return [] if None in found else [one for one in found if one is not None]


def _ready(value: float, ratio: float | None, sentence: str) -> float | None:
    """The value that a ratio to what is usual points to: by a power of ten, or a ratio of units that is stated."""
    if ratio is None:
        return None
    stated = UNIT_RATIO.search(sentence)
    if stated and abs(abs(math.log10(ratio)) - math.log10(float(stated[1].rstrip(".")))) < NEAR / 10:
        factor = float(stated[1].rstrip("."))
        return value / factor if ratio > 1 else value * factor
    power = round(math.log10(ratio))
    if power == 0 or abs(math.log10(ratio) - power) > NEAR:
        return None
    return float(f"{value / 10.0**power:.12g}")


def _factor(old: float, new: float) -> str:
    """Sign and number that turn a value into another one, exactly where a factor does so.

    >>> _factor(260.929, 0.260929), _factor(2.0, 3.0), _factor(254.0, 10.0)
    ('/1000', '*1.5', '/25.4')
    """
    for sign, ratio in (("*", new / old), ("/", old / new)):
        for digits in (3, 6):
            number = f"{ratio:.{digits}g}"
            if ratio >= 1 and "e" not in number and _gives(old, sign, number, new, LAST_BIT):
                return sign + number
    tried = [new / old]
    for towards in (math.inf, 0.0):
        near = new / old
        for _ in range(ULPS):
            near = math.nextafter(near, towards)
            tried.append(near)
    exact = (f"{one!r}" for one in tried if _gives(old, "*", f"{one!r}", new))
    return f"*{next(exact, repr(new / old))}"


def _gives(old: float, sign: str, number: str, new: float, tolerance: float = 0.0) -> bool:
    """Whether the correction of a value is another one, exactly or but for the last bit."""
    if float(number) == 1:
        return False
    given = float(parse_correction(f"all:x{sign}{number}").apply(np.array([old]))[0])
    return math.isclose(given, new, rel_tol=tolerance, abs_tol=0.0)


def _number(typed: str) -> float | None:
    """A finite number, with a point or a comma before its decimals."""
    try:
        value = float(typed.strip().replace(",", "."))
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _text(value: object) -> str:
    """A cell as the reading shows it."""
    text = f"{value:.6g}" if isinstance(value, float) else str(value)[:LONGEST]
    return "" if text == "nan" else text
