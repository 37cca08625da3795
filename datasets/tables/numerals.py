"""Cells -> numbers: decimal point or comma, and marked numbers such as bounds and footnotes (<0.05, 0.24*)."""

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np

from ...core.arrays import Array
from ...core.rounding import label_of

Decimal: TypeAlias = Literal["point", "comma"]
Cell: TypeAlias = str | float  # a float only where a workbook stores a typed number

_MINUS = "\N{MINUS SIGN}"
_POWERS = 10.0 ** np.arange(1, 16)
# Thousands marks under either reading: apostrophes, the blank and the no-break and thin blanks.
_NEUTRAL_GROUPS = "'’ \u00a0\u2007\u2009\u202f"
_MISSING_TEXTS = """
    n/a na n.a. - -- – — − ? nan -nan +nan null none
    #div/0! #¡div/0! #n/a #nv #n/d #wert! #value! #valeur! #¡valor! #ref! #bezug! #num! #zahl! #null! #name?
"""
_MISSING = frozenset(["", *_MISSING_TEXTS.split()])
# Spellings met in long files, looked up unchanged; any other goes through the strict path.
_WORDS = frozenset(mark[:1] for mark in _MISSING if mark[:1].isalpha())  # first letters of those that are words
MISSING_AS_WRITTEN = _MISSING | {mark.upper() for mark in _MISSING} | {"NaN", "Null", "None"}
# Cells of columns of numbers that stand for a value that was not measured; in other columns they are words.
NOT_MEASURED = frozenset((
    "n.b.", "n.b", "nb", "n. b.", "k.a.", "k.a", "ka", "k. a.", "n.d.", "n.d", "nd", "n.m.", "n.m", "n.v.", "n.v",
    "x", "xx", "/", "//", "missing", "fehlt", "tbd", "t.b.d.", "not measured", "nicht gemessen", "non mesuré",
    "no medido",
))  # fmt: skip
_ONE_GROUP: dict[Decimal, re.Pattern[str]] = {
    "point": re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII),
    "comma": re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}", re.ASCII),
}
# The same cells are asked about for the delimiter and for the layout, and are alike from row to row.
_SHORT = 24  # characters of a cell that is remembered
_SIGNS = {
    "<": "<",
    "≤": "<",
    ">": ">",
    "≥": ">",
    "⩾": ">",
    "≧": ">",
    "~": "~",
    "≈": "~",
    "≃": "~",
    "*": "*",
    "†": "*",
    "‡": "*",
}
_AT_LEAST = (
    *("at least", "more than", "over", "mindestens", "mind.", "mehr als", "über"),
    *("au moins", "plus de", "más de", "al menos"),
)
_FIRST_LETTERS = ("ca", "ci", "ab", "ap", "en", "et", *sorted({words[:2] for words in _AT_LEAST}))  # ca., circa, about
# Words of a test that was stopped before the tool failed, in the cell of its time: 60 (run-out), 60 abgebrochen
_STOPPED = (
    r"run[- ]?outs?|ro|censored|cens\.?|suspended|susp\.?|stopped|no failure|not failed|not worn|not reached|survived|"
    r"abgebrochen|abgebr\.?|durchläufer|nicht erreicht|zensiert|interrompu|arrêté|non atteint|censuré|interrumpido|"
    r"censurado|no alcanzado"
)
STOPPED = re.compile(_STOPPED, re.IGNORECASE)
_MARKED_NUMBER = (
    r"(?P<before>[<>]=?|=?[<>]|[≤≥⩾≧~≈≃*†‡]|(?:ca|approx|env|circa|about|etwa)\b\.?|"
    rf"(?P<least>{'|'.join(map(re.escape, _AT_LEAST))}))?\s*"
    r"(?P<number>[+\-−]?[\d.,]++(?:['’ \u00a0\u2009\u202f][\d.,]++)*+(?:[eE][+-]?\d++)?+)\s*+"
    rf"(?:(?P<unit>(?!(?:{_STOPPED})\b)[^\W\d_][\w/·^]*)\s*+)?"
    rf"(?P<after>\*{{1,3}}|\(\*\)|[†‡]|(?P<longer>\(?(?:\+|[>↑→])\)?(?:\s*(?P<unit2>min|s|sec|h)\b)?"
    rf"(?:\s*\(?(?:{_STOPPED})\)?)?|\(?(?:{_STOPPED})\)?))?"
)


@lru_cache(maxsize=1)
def _marked() -> re.Pattern[str]:
    """A marked number; compiled where a cell asks for it."""
    return re.compile(_MARKED_NUMBER, re.IGNORECASE)


_AMOUNT = re.compile(r"(?P<number>[+\-−]?\d[\d.,'’ \u00a0\u2009\u202f]*+(?:[eE][+-]?\d++)?+)(?P<rest>[^\d\s.,'’].*+)")
_SPREAD = re.compile(r"(?:±|\+/?[-−])\s*+[\d.,]++(?:[eE][+-]?\d++)?+\s*+%?")
_FRACTION = re.compile(r"(?:(\d{1,2})\s)?([1-9]\d?)/(2|4|8|16|32|64|128)", re.ASCII)
SPREAD = "±"


def _grammar(mark: str, other: str) -> re.Pattern[str]:
    plain = rf"(?:\d++(?:{mark}\d*+)?+|{mark}\d++)(?:[eE][+-]?\d++)?+"
    grouped = rf"[1-9]\d{{0,2}}(?P<mark>[{other}{_NEUTRAL_GROUPS}])\d{{3}}(?:(?P=mark)\d{{3}})*(?:{mark}\d*)?"
    return re.compile(rf"[+-]?(?:{plain}|{grouped})", re.ASCII)


_GRAMMAR: dict[Decimal, re.Pattern[str]] = {"point": _grammar(r"\.", ","), "comma": _grammar(",", r"\.")}


def parse_number(text: str, decimal: Decimal) -> float | None:
    """Read one cell as a finite number, or give None.

    Signs, a unicode minus, exponents, one kind of thousands mark, and the apostrophe by which a spreadsheet marks
    text are read; a thousands group never starts with 0 and never carries an exponent; ``inf``, ``1_000``, ``0x10``
    and ``True`` are no numbers.

    >>> parse_number("1.234,5", "comma"), parse_number("1.234", "point"), parse_number("1.234,5", "point")
    (1234.5, 1.234, None)
    """
    match = _GRAMMAR[decimal].fullmatch(text.strip().replace(_MINUS, "-").removeprefix("'"))
    if match is None:
        return None
    value = _value(match, decimal)
    return value if math.isfinite(value) else None


def is_missing(text: str) -> bool:
    """Whether a cell means "no value": empty, a dash, ``n/a``, ``NaN`` or a spreadsheet's error mark.

    A unicode minus counts as the plain one, as it does in a number.

    >>> is_missing(" #DIV/0! "), is_missing("-\N{MINUS SIGN}"), is_missing("inf")
    (True, True, False)
    """
    return text.strip().replace(_MINUS, "-").casefold() in _MISSING


def is_word(text: str) -> bool:
    """Whether a cell begins with a letter that begins neither a number nor a missing mark.

    >>> is_word("E1"), is_word("NaN"), is_word("1.5"), is_word("\N{MINUS SIGN}2")
    (True, False, False, False)
    """
    first = text[:1]
    return first.isalpha() and first.casefold() not in _WORDS


def is_number(cell: Cell) -> bool:
    """Whether a cell is a number under either reading of its marks.

    >>> is_number("1,5"), is_number("12.03.2024")
    (True, False)
    """
    if isinstance(cell, float):
        return True
    return _asked_before(cell) if len(cell) <= _SHORT else _reads(cell)


def _reads(text: str) -> bool:
    return parse_number(text, "point") is not None or parse_number(text, "comma") is not None


_asked_before = lru_cache(maxsize=2**15)(_reads)


def to_floats(cells: Sequence[Cell], decimal: Decimal) -> tuple[Array, list[int]]:
    """Convert one column of cells.

    Returns
    -------
    values : ndarray, shape (n,)
        nan where a cell is missing or no number.
    bad : list of int
        Positions of the cells that are neither a number nor a missing mark.

    >>> to_floats(["1,5", "-", "worn"], "comma")
    (array([1.5, nan, nan]), [2])

    """
    values = plain_floats(cells, decimal)
    return (values, []) if values is not None else strict_floats(cells, decimal)


def plain_floats(cells: Sequence[Cell], decimal: Decimal) -> Array | None:
    """Convert a column without thousands marks, or give None: Python's float() does the work, fenced in.

    >>> plain_floats(["1,5", "-"], "comma"), plain_floats(["1.500"], "comma")
    (array([1.5, nan]), None)
    """
    try:
        text = "\n".join(cells)  # type: ignore[arg-type]  # a typed cell raises the TypeError below
    except TypeError:
        return None
    if "_" in text or (decimal == "comma" and "." in text):
        return None  # float() would take both
    plain = text.replace(_MINUS, "-")
    if not plain.isascii():
        return None  # float() would take the digits of other scripts
    if decimal == "comma":
        plain = plain.replace(",", ".")
    parts = cells if plain is text else plain.split("\n")
    if len(parts) != len(cells):
        return None
    try:
        values = np.fromiter(map(float, parts), dtype=float, count=len(parts))
    except ValueError:
        try:
            values = np.array([math.nan if part in MISSING_AS_WRITTEN else float(part) for part in parts])
        except ValueError:
            return None
    return None if np.isinf(values).any() else values


def strict_floats(cells: Sequence[Cell], decimal: Decimal) -> tuple[Array, list[int]]:
    """Convert any column by the grammar of a number; the result is that of `to_floats`.

    >>> strict_floats(["1.500", "worn"], "comma")
    (array([1500.,   nan]), [1])
    """
    different = set(cells)
    failed: set[Cell] = {cell for cell in different if isinstance(cell, str) and is_word(cell)}
    if len(failed) == len(different):
        return np.full(len(cells), math.nan), list(range(len(cells)))
    read: dict[Cell, float | None] = dict.fromkeys(failed)
    for cell in different - failed:
        read[cell] = cell if isinstance(cell, float) else parse_number(cell, decimal)
        if read[cell] is None and not is_missing(str(cell)):
            failed.add(cell)
    values = np.array([math.nan if (value := read[cell]) is None else value for cell in cells], dtype=float)
    return values, [i for i, cell in enumerate(cells) if cell in failed] if failed else []


def is_plain_label(cell: Cell, value: float, decimal: Decimal) -> bool:
    """Whether a number as a label is shown as its cell has it; the ending of ``1.0`` is that of a program.

    >>> [is_plain_label(cell, float(cell), "point") for cell in ("1", "1.0", "2.5", "007", "1.7220", "5E2")]
    [True, True, True, False, False, False]
    """
    if isinstance(cell, float) or value != value:
        return True
    text = cell.strip() if decimal == "point" else cell.strip().replace(",", ".")
    return text in (label_of(value), f"{value:.1f}")


def are_plain_labels(cells: Sequence[Cell], values: Array, decimal: Decimal) -> bool:
    """Whether all numbers of a column of labels are shown as written.

    >>> are_plain_labels(["1", "", "10"], np.array([1.0, np.nan, 10.0]), "point")
    True
    """
    known = values[values == values]
    try:
        text = "".join(cells)  # type: ignore[arg-type]  # a typed cell raises the TypeError below
    except TypeError:
        text = ""
    if text.isascii() and text.isdecimal() and known.max() < _POWERS[-1]:
        return len(text) == len(known) + int(np.searchsorted(_POWERS, known, side="right").sum())  # no zero in front
    different = dict(zip(cells, values.tolist(), strict=True))
    return all(is_plain_label(cell, value, decimal) for cell, value in different.items())


def one_group(cells: Sequence[Cell], decimal: Decimal) -> list[int]:
    """Positions of cells that are a number of thousands under this reading, and below a thousand under the other.

    >>> one_group(["1,500", "1,500.0", "12", "0,500"], "point")
    [0]
    """
    pattern, mark = _ONE_GROUP[decimal], "," if decimal == "point" else "."
    found = {cell for cell in set(cells) if isinstance(cell, str) and mark in cell and pattern.fullmatch(cell.strip())}
    return [i for i, cell in enumerate(cells) if cell in found] if found else []


@dataclass(slots=True)
class Evidence:
    """Evidence on the decimal mark from the cells read so far.

    ``counts`` has the keys "point" and "comma" (cells that are numbers under that reading alone) and "either"
    (cells that are two different numbers); ``first`` holds one such cell each as (line, column number, text);
    ``thousands`` counts the thousands marks met under each reading.
    """

    counts: Counter[str] = field(default_factory=Counter)
    first: dict[str, tuple[int, int, str]] = field(default_factory=dict)
    thousands: dict[str, Counter[str]] = field(default_factory=lambda: {"point": Counter(), "comma": Counter()})

    @property
    def decided(self) -> bool:
        """Whether a decisive cell has been seen."""
        return bool(self.counts["point"] or self.counts["comma"])

    def add(self, lines: Sequence[int], columns: Iterable[Sequence[Cell]]) -> None:
        """Add a block of rows, given column by column.

        >>> evidence = Evidence()
        >>> evidence.add([2, 3], [("1.234", "0.5")])
        >>> dict(evidence.counts)
        {'either': 1, 'point': 1}
        """
        for number, column in enumerate(columns, start=1):
            seen: set[str] = set()
            for text, count in Counter(column).items():
                if isinstance(text, str) and (kind := self._kind(text, count)):
                    self.counts[kind] += count
                    if kind not in seen:
                        seen.add(kind)
                        sighting = (lines[column.index(text)], number, text)
                        self.first[kind] = min(sighting, self.first.get(kind, sighting))

    def _kind(self, text: str, count: int) -> str:
        whole, point, fraction = text.partition(".")
        if whole.isdecimal() and whole.isascii() and (not point or (fraction.isdecimal() and fraction.isascii())):
            if not point:
                return ""
            if len(fraction) != 3 or whole[0] == "0" or len(whole) > 3:
                return "point"
        numbers: dict[Decimal, float] = {}
        for reading, grammar in _GRAMMAR.items():
            match = grammar.fullmatch(text.strip().replace(_MINUS, "-"))
            if match is not None:
                numbers[reading] = _value(match, reading)
                if match["mark"]:
                    self.thousands[reading][match["mark"]] += count
        if len(numbers) == 2:
            return "either" if numbers["point"] != numbers["comma"] else ""
        return next(iter(numbers), "")


def _value(match: re.Match[str], decimal: Decimal) -> float:
    text = match[0]
    if match["mark"]:
        text = text.replace(match["mark"], "")
    return float(text.replace(",", ".") if decimal == "comma" else text)


@dataclass(frozen=True, slots=True)
class Mark:
    """A number with a mark.

    Attributes
    ----------
    sign : {"<", ">", "~", "*"}
        At most, at least, approximate, or with a footnote.
    value : float
        In ``unit``, or in that of the column where it is "".
    unit, text : str
        Unit as written beside the number, and the whole cell.

    >>> Mark("<", 0.05, "", "<0,05").describe()
    '<0.05'
    """

    sign: str
    value: float
    unit: str
    text: str

    def describe(self, factor: float = 1.0) -> str:
        """The mark with its number times ``factor``, written with a decimal point.

        >>> Mark("*", 240.0, "", "240*").describe(1e-3)
        '0.24*'
        """
        number = f"{self.value * factor:.12g}"
        return f"{number}*" if self.sign == "*" else self.sign + number


def read_mark(text: str, decimal: Decimal) -> Mark | None:
    """A marked number, or None for any other text.

    >>> [read_mark(text, "point").describe() for text in ("<0.05", "> 0.3 mm", "0.24*", "ca. 0.2", "60 (run-out)")]
    ['<0.05', '>0.3', '0.24*', '~0.2', '>60']
    >>> read_mark("worn", "point"), read_mark("0.24", "point")
    (None, None)

    """
    text = text.strip()
    if not text or (text[0].isalpha() and not text[:2].lower().startswith(_FIRST_LETTERS)):
        return None
    match = _marked().fullmatch(text)
    if match is None or not (match["before"] or match["after"]):
        return None
    value = parse_number(match["number"].strip(), decimal)
    if value is None:
        return None
    if match["least"] or match["longer"]:
        return Mark(">", value, match["unit"] or match["unit2"] or "", text)
    sign = match["before"] or "*"
    plain = sign.strip("=")[:1]
    return Mark(_SIGNS.get(plain, "~"), value, match["unit"] or "", text)


def number_and_rest(text: str) -> tuple[str, str]:
    """The text of a number and what follows it, ``±`` for a spread; both empty for any other text.

    >>> number_and_rest("120 m/min"), number_and_rest("0.21 +/- 0.01"), number_and_rest("E1")
    (('120', 'm/min'), ('0.21', '±'), ('', ''))
    """
    match = _AMOUNT.fullmatch(text.strip())
    rest = match["rest"] if match else ""
    return match["number"].strip() if match else "", SPREAD if _SPREAD.fullmatch(rest) else rest


def fraction(text: str) -> float | None:
    """The value of a fraction of an inch, None for any other text.

    >>> fraction("1/32"), fraction("1 1/2"), fraction("3/5")
    (0.03125, 1.5, None)
    """
    match = _FRACTION.fullmatch(text.strip())
    return None if match is None else int(match[1] or 0) + int(match[2]) / int(match[3])
