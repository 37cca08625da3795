"""Cells of a long CSV -> numbers or labels, as the reader of lab files understands them, a batch at a time."""

from dataclasses import dataclass, field
from typing import Any

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute as pc  # type: ignore[import-untyped]

from ...datasets.tables.numerals import Decimal, is_missing, parse_number

_PLAIN = {"point": r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$", "comma": r"^[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?$"}
_MINUS = "\N{MINUS SIGN}"


@dataclass(slots=True)
class Odd:
    """Cells of a column of numbers that are none: how many, and the first of them with its row, counted from 1."""

    count: int = 0
    row: int = 0
    text: str = ""

    def sentence(self, name: str) -> str:
        """Tell it.

        >>> Odd(2, 17, "worn").sentence("VB")
        "column 'VB': 2 cell(s) are no numbers and count as missing, the first in row 17 of the data: 'worn'."
        """
        return (
            f"column {name!r}: {self.count} cell(s) are no numbers and count as missing, the first in row {self.row} "
            f"of the data: {self.text!r}."
        )


@dataclass(slots=True)
class Cells:
    """Converts columns of cells, and remembers the odd ones."""

    decimal: Decimal
    odd: dict[str, Odd] = field(default_factory=dict)

    def numbers(self, name: str, cells: Any, first_row: int) -> Any:  # noqa: ANN401  Arrow has no static types
        """An array of doubles, null where a cell is missing or no number.

        >>> Cells("comma").numbers("f", pa.array(["1.234,5", " 0,2", None, "worn"]), 1).to_pylist()
        [1234.5, 0.2, None, None]
        """
        plain = self._at_once(cells)
        return plain if plain is not None else self._one_by_one(name, cells, first_row)

    def labels(self, cells: Any, *, as_numbers: bool) -> Any:  # noqa: ANN401
        """Texts; of a column of numbers whole ones without a point, as `Column.labels` writes them.

        >>> Cells("point").labels(pa.array(["1.0", " 1", "E7", None]), as_numbers=True).to_pylist()
        ['1', '1', 'E7', None]
        """
        coded = cells.dictionary_encode()
        texts = pa.array([self._label(text, as_numbers) for text in coded.dictionary.to_pylist()], pa.string())
        return texts.take(coded.indices)

    def _label(self, text: str, as_numbers: bool) -> str | None:
        if is_missing(text):
            return None
        value = parse_number(text, self.decimal) if as_numbers else None
        if value is None:
            return text.strip()
        return str(int(value)) if value.is_integer() else repr(value)

    def _at_once(self, cells: Any) -> Any:  # noqa: ANN401
        """All cells as plain finite numbers, or None."""
        if self.decimal == "comma":
            if pc.any(pc.match_substring(cells, ".")).as_py():
                return None  # a thousands mark, or another decimal mark
            cells = pc.replace_substring(cells, ",", ".")
        try:
            values = pc.cast(cells, pa.float64())
        except pa.ArrowInvalid:
            return None
        return values if pc.all(pc.is_finite(values)).as_py() is not False else None

    def _one_by_one(self, name: str, cells: Any, first_row: int) -> Any:  # noqa: ANN401
        """Plain cells at once, each of the others by the grammar of numbers."""
        cells = pc.replace_substring(pc.utf8_trim_whitespace(cells), _MINUS, "-")
        plain = pc.fill_null(pc.match_substring_regex(cells, _PLAIN[self.decimal]), False)
        text = pc.replace_substring(cells, ",", ".") if self.decimal == "comma" else cells
        values = pc.cast(pc.if_else(plain, text, None), pa.float64())
        plain = pc.fill_null(pc.is_finite(values), False)
        others = pc.and_(pc.is_valid(cells), pc.invert(plain))
        if not pc.any(others).as_py():
            return values
        coded = pc.filter(cells, others).dictionary_encode()
        known = coded.dictionary.to_pylist()
        read = [parse_number(text, self.decimal) for text in known]
        bad = [value is None and not is_missing(text) for text, value in zip(known, read, strict=True)]
        self._note(name, coded, bad, pc.indices_nonzero(others), first_row)
        return pc.replace_with_mask(values, others, pa.array(read, pa.float64()).take(coded.indices))

    def _note(self, name: str, coded: Any, bad: list[bool], rows: Any, first_row: int) -> None:  # noqa: ANN401
        found = pc.indices_nonzero(pa.array(bad, pa.bool_()).take(coded.indices))
        if len(found):
            odd = self.odd.setdefault(name, Odd())
            if not odd.count:
                at = found[0].as_py()
                odd.row, odd.text = first_row + rows[at].as_py(), coded[at].as_py()[:40]
            odd.count += len(found)
