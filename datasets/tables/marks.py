"""Marked numbers of a table: bounds, approximate values and footnote marks, such as <0.05, ~0.2 and 0.24*."""

import re
from dataclasses import dataclass

from .numerals import Decimal, parse_number

_SIGNS = {"<": "<", "≤": "<", ">": ">", "≥": ">", "~": "~", "≈": "~", "≃": "~", "*": "*", "†": "*", "‡": "*"}
_FIRST_LETTERS = ("ca", "ci", "ab", "ap", "en", "et")  # of ca., circa, about, approx., env., etwa
_MARKED = re.compile(
    r"(?P<before>[<>]=?|=?[<>]|[≤≥~≈≃*†‡]|(?:ca|approx|env|circa|about|etwa)\b\.?)?\s*"
    r"(?P<number>[+\-−]?[\d.,][\d.,'’ \u00a0\u2009\u202f]*(?:[eE][+-]?\d+)?)\s*"
    r"(?P<unit>[^\W\d_][\w/·^]*)?\s*(?P<after>\*{1,3}|\(\*\)|[†‡+])?",
    re.IGNORECASE,
)


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

    >>> [read_mark(text, "point").describe() for text in ("<0.05", "> 0.3 mm", "0.24*", "ca. 0.2", "60+")]
    ['<0.05', '>0.3', '0.24*', '~0.2', '>60']
    >>> read_mark("worn", "point"), read_mark("0.24", "point")
    (None, None)

    """
    text = text.strip()
    if not text or (text[0].isalpha() and not text[:2].lower().startswith(_FIRST_LETTERS)):
        return None
    match = _MARKED.fullmatch(text)
    if match is None or not (match["before"] or match["after"]):
        return None
    value = parse_number(match["number"].strip(), decimal)
    if value is None:
        return None
    sign = match["before"] or (">" if match["after"] == "+" else "*")
    plain = sign.strip("=")[:1]
    return Mark(_SIGNS.get(plain, "~"), value, match["unit"] or "", text)
