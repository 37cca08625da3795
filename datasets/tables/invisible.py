"""Invisible characters of text: zero-width marks, soft hyphens, direction marks and control characters, removed."""

import re
import unicodedata
from collections import Counter
from collections.abc import Iterator

from ...core.text import INVISIBLE
from .numerals import Cell

_INVISIBLE = re.compile(f"[{INVISIBLE}]")
_SPACES = re.compile("[\u00a0\u1680\u2000-\u200a\u202f\u205f\u3000]")
_NAMES = {"\ufeff": "byte order mark", "\x7f": "delete"}


def visible(text: str) -> str:
    r"""The text without invisible characters, blanks of every kind as plain ones.

    >>> visible("f\u200b\u00a0[mm/rev]")
    'f [mm/rev]'
    """
    return text if text.isascii() and "\x7f" not in text else _SPACES.sub(" ", _INVISIBLE.sub("", text))


def without_invisible(data: bytes, encoding: str) -> tuple[bytes, str, list[str]]:
    r"""Bytes of a text without its invisible characters, their encoding, and a sentence on what was removed.

    No-break and thin blanks stay: they are the thousands marks of many countries.

    >>> without_invisible("f\u200b,V\n".encode(), "utf-8")
    (b'f,V\n', 'utf-8', ['Invisible characters are removed: 1 (zero width space in line 1).'])
    >>> without_invisible(b"f,V\n", "utf-8")
    (b'f,V\n', 'utf-8', [])
    """
    if not _may_hold(data, encoding):
        return data, encoding, []
    text = data.decode(encoding).removeprefix("\ufeff")
    found = [(match[0], match.start()) for match in _INVISIBLE.finditer(text)]
    if not found:
        return data, encoding, []
    first = {mark: 1 + len(re.findall("\r\n|\r|\n", text[:place])) for mark, place in reversed(found)}
    cleaned = _INVISIBLE.sub("", text).encode()
    return cleaned, "utf-8-sig" if encoding == "utf-8-sig" else "utf-8", _sentence(first, len(found))


def cleaned_rows(rows: tuple[tuple[Cell, ...], ...]) -> tuple[tuple[tuple[Cell, ...], ...], list[str]]:
    r"""Rows of a sheet without invisible characters in their texts, and a sentence on what was removed.

    >>> cleaned_rows([("f\u200b", 1.0)])
    ((('f', 1.0),), ['Invisible characters are removed: 1 (zero width space in line 1).'])
    """
    first: dict[str, int] = {}
    count: Counter[str] = Counter()

    def cleaned() -> Iterator[tuple[Cell, ...]]:
        for line, row in enumerate(rows, start=1):
            if all(not isinstance(cell, str) or cell.isascii() for cell in row):
                yield row
                continue
            for mark in _INVISIBLE.findall("".join(cell for cell in row if isinstance(cell, str))):
                first.setdefault(mark, line)
                count[mark] += 1
            yield tuple(_INVISIBLE.sub("", cell) if isinstance(cell, str) else cell for cell in row)

    made = tuple(cleaned())
    return made, _sentence(first, count.total()) if first else []


def _may_hold(data: bytes, encoding: str) -> bool:
    """A quick look for the first bytes of such characters; "no" is certain."""
    if encoding in ("cp1252", "cp1250"):
        return b"\xad" in data or b"\x7f" in data
    if encoding.startswith("utf-16"):
        return True
    start = 3 if data.startswith(b"\xef\xbb\xbf") else 0
    if data.isascii():
        return b"\x7f" in data
    leads = (b"\xc2", b"\xcd\x8f", b"\xd8\x9c", b"\xe1", b"\xe2\x80", b"\xe2\x81", b"\xe3\x85", b"\x7f")
    return data.find(b"\xef", start) >= 0 or any(lead in data for lead in leads)


def _sentence(first: dict[str, int], count: int) -> list[str]:
    kinds = sorted(first.items(), key=lambda item: item[1])[:3]
    named = ", ".join(f"{_name(mark)} in line {line}" for mark, line in kinds)
    return [f"Invisible characters are removed: {count} ({named})."]


def _name(mark: str) -> str:
    return _NAMES.get(mark) or unicodedata.name(mark, f"U+{ord(mark):04X}").lower()
