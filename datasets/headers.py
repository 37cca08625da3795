"""Header cells split into the name of a column and its unit, number or time, in the notations of laboratories."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

from .tables import Column, Table
from .units import canonical, is_unit
from .vocabulary import ROLES, fits, role_of, role_within, roles_named

_BRACKETS = re.compile(r"\[([^\[\]]*)\]|\{([^{}]*)\}|\(([^()]*)\)")
_MARKS = (
    r"(.+?) (?:in|en) (?s:(.+))",
    r"(.+?) ?[,;:] ?(?s:(.+))",
    r"(.+?) / ?(?s:(.+))",
    r"(.+?)/(?s:(.+))",
)
_LOGARITHM = re.compile(r"(?:ln|lg|log(?:10|e)?)[\s_(]++(\w.*+)", re.IGNORECASE)
LONGEST = 1000  # characters of a header that is split; a longer one is a text, and its unit is not looked for
_MOST_WORDS = 8  # of a unit after the name
_LAST = re.compile(r"(?:\d{1,3}|(?<![^\W\d_])[A-Za-z])\Z")  # number or letter that ends a header
_GAP = "_#.:-"
_TIME = re.compile(
    r"(?<![\d.,])(?P<number>\d++(?:[.,]\d++)?+)[\s_]*+(?P<unit>min|minutes?|mins|s|sec|seconds?|h)?\)?\Z", re.IGNORECASE
)
_BEFORE = re.compile(r"(?<=[\s_,(])(?P<unit>min|s|h)[\s_)]{1,4}\Z", re.IGNORECASE)  # VB after t min 2
_AFTER = (
    *("after", "at", "nach", "bei", "après", "apres", "a", "à", "tras", "después de", "despues de"),
    *("t", "time", "zeit", "@", "=", ":", "_", ",", "("),
)  # between the name of a response and a time
_CYRILLIC = dict(zip("АВСЕНІЈКМОРЅТХаеорсухіјѕԁһ", "ABCEHIJKMOPSTXaeopcyxijsdh", strict=True))
_GREEK = dict(zip("ΑΒΕΖΗΙΚΜΝΟΡΤΥΧνορ", "ABEZHIKMNOPTYXvop", strict=True))
_LETTERS = str.maketrans(_CYRILLIC | _GREEK)


@dataclass(frozen=True, slots=True)
class Header:
    """A header cell split into the name of the column and the text of its unit ("" when it has none).

    >>> Header(name="V", unit_text="m/min").unit_text
    'm/min'
    """

    name: str
    unit_text: str


class Numbered(NamedTuple):
    """A header that ends in a number or a letter of its own: ``VB E1`` is ``VB E``, no gap, ``1``."""

    stem: str
    gap: str
    id: str


def _is_unit_of(name: str, inside: str) -> bool:
    """Whether a text next to a name is its unit rather than its symbol: V in "Cutting speed (V)" is not volt."""
    roles = roles_named(name)
    if not is_unit(inside) or inside.isdigit():
        return False
    symbol = name.strip() != inside and not set(roles).isdisjoint(roles_named(inside))
    return not symbol or any(fits(role, inside) for role in roles)


def last_bracket(text: str) -> int:
    """Index of the bracket that ends a header, or of the blanks before it; the length of a text without one.

    >>> [text[: last_bracket(text)] for text in ("V [m/min]", "t (min) (s) ", "VB (mean) max")]
    ['V', 't (min)', 'VB (mean) max']
    """
    end = len(text.rstrip())
    if not text[:end].endswith(("]", ")")):
        return len(text)
    first = 1 + max(text.rfind("]", 0, end - 1), text.rfind(")", 0, end - 1))
    opened = [place for mark in "[(" if (place := text.find(mark, first, end)) >= 0]
    return len(text[: min(opened)].rstrip()) if opened else len(text)


def _bracketed(text: str) -> Iterator[tuple[str, str]]:
    """Units in brackets, last first; round ones also hold remarks ("VB (mean)") and must look like a unit."""
    for match in reversed(list(_BRACKETS.finditer(text))):
        inside = next(group for group in match.groups() if group is not None).strip()
        name = f"{text[: match.start()]} {text[match.end() :]}"
        foreign = not is_unit(inside) and set(roles_named(name)).isdisjoint(roles_named(inside))
        looks = match[0][0] in "[{" or re.search(r"[/^*·%°µμ⁻]|^[hm]+(in)?:", inside)
        if _is_unit_of(name, inside) or (foreign and looks):
            yield name, inside


def _marked(text: str) -> Iterator[tuple[str, str]]:
    """Units after "in", a comma or a slash; a slash without blanks only after a known name."""
    for pattern in _MARKS:
        match = re.fullmatch(pattern, text)
        if match and _is_unit_of(match[1], match[2]) and (pattern != _MARKS[-1] or roles_named(match[1])):
            yield match[1], match[2]


def _ends_in_unit(name: str, words: list[str], unit_text: str) -> bool:
    """Whether the last words of a header without marks are its unit; the first rule that applies decides.

    They are when written with "per"; when the name before them is known and measured in that unit; when they
    are a quotient (mm_s); when the name is unknown and they are a canonical unit of two letters and more, but
    neither "min" (minimum) nor "in"; when a word of the name is a quantity of that unit (X1_absCurrent_A).
    """
    if not is_unit(unit_text) or not any(map(str.isalpha, unit_text)) or words[0] == "per":
        return False
    if "per" in words or any(fits(role, unit_text) for role in roles_named(name)):
        return True
    if "/" in unit_text and not any(word.isdigit() for word in words):
        return True
    plain = canonical(unit_text) == unit_text and len(unit_text) > 1 and unit_text not in ("min", "in")
    if plain and not roles_named(name):
        return True
    parts = re.findall(r"[A-Z]?[a-z]{2,}|[A-Z]{2,}(?![a-z])", name)
    return any(fits(role, unit_text) for part in parts for role in roles_named(part))


def _suffixed(text: str) -> Iterator[tuple[str, str]]:
    """Units at the end after ``_`` or a blank, the longest first."""
    for gap in list(re.finditer(r"[_\s]+", text))[-_MOST_WORDS:]:
        name, words = text[: gap.start()], re.split(r"[_\s]+", text[gap.end() :])
        for unit_text in ("/".join(words).replace("/per/", "/"), " ".join(words)):
            if name and _ends_in_unit(name, words, unit_text):
                yield name, unit_text


@lru_cache(maxsize=4096)  # each header is read by several steps
def parse_header(text: str) -> Header:
    """Split a header cell into name and unit.

    Read are ``V [m/min]``, ``V (m/min)``, ``V{m/min}``, ``V in m/min``, ``V, m/min``, ``V / m/min``,
    ``V m/min`` and ``V_m_per_min``. A tail that is no unit stays in the name (``Ra_mean``,
    ``Cutting speed (Vc)``).

    >>> parse_header("feed_mm_s"), parse_header("Ra_mean").unit_text
    (Header(name='feed', unit_text='mm/s'), '')
    """
    text = " ".join(text.replace("\ufeff", "").split())
    if len(text) > LONGEST:
        return Header(text, "")
    for read in (_bracketed, _marked, _suffixed):
        for name, unit_text in () if is_unit(text) and read is not _bracketed else read(text):
            if name := " ".join(name.split()).strip(" _,;:/-"):
                return Header(name, unit_text.strip())
    return Header(text, "")


def numbered(name: str) -> Numbered | None:
    """The parts of a numbered header, None for any other.

    >>> numbered("VB E1"), numbered("VB - A").stem, numbered("VBA")
    (Numbered(stem='VB E', gap='', id='1'), 'VB', None)
    """
    match = _LAST.search(name, max(len(name) - 3, 0))
    if match is None:
        return None
    stem = without_gap(name[: match.start()])
    return Numbered(stem, name[len(stem) : match.start()], match[0])


def without_gap(text: str) -> str:
    """A header without the blanks and marks that end it.

    >>> without_gap("VB no. "), without_gap("Ra_")
    ('VB no', 'Ra')
    """
    end = len(text)
    while end and (text[end - 1].isspace() or text[end - 1] in _GAP):
        end -= 1
    return text[:end]


def timed(name: str) -> tuple[str, float, str] | None:
    """Text before the time in a header, the time, and its unit ("" where none is written); None without a time.

    >>> timed("VB after 2.5 min"), timed("VB (t min 2)"), timed("VB")
    (('VB', 2.5, 'min'), ('VB', 2.0, 'min'), None)
    """
    match = _TIME.search(name)
    if match is None:
        return None
    stem = name[: match.start()]
    before = _BEFORE.search(stem, max(len(stem) - 8, 0))
    stem = _without_after(stem[: before.start()] if before else stem)
    unit = match["unit"] or (before["unit"] if before else "")
    return stem.strip(" _-"), float(match["number"].replace(",", ".")), unit


def _without_after(text: str) -> str:
    """The text without the words before a time that end it."""
    folded, ends = text.lower(), {len(text)}
    for start in range(len(text) - 1, -1, -1):
        words = (word for word in _AFTER if folded.startswith(word, start))
        if (start + 1 in ends and text[start].isspace()) or any(start + len(word) in ends for word in words):
            ends.add(start)
        elif start < min(ends) - 12:  # the longest word
            break
    return text[: min(ends)]


def is_known(text: str) -> bool:
    """Whether a header cell names a known quantity.

    >>> is_known("Cutting speed (Vc) [m/min]"), is_known("Remarks")
    (True, False)
    """
    return bool(text.strip()) and bool(roles_named(parse_header(text).name))


def setting_named(name: str) -> str:
    """Symbol of the setting that a name denotes in a header; the name itself where it denotes none.

    >>> setting_named("vc"), setting_named("ap"), setting_named("coolant"), setting_named("insert")
    ('V', 'd', 'coolant', 'insert')
    """
    role = None if name in ROLES else role_of(name, None)
    return role if role is not None and (role == "t" or ROLES[role].kind in ("condition", "other")) else name


def logarithm_of(name: str) -> str:
    """The text of which a header names the logarithm, "" where it names none.

    >>> logarithm_of("ln Fc"), logarithm_of("log10(VB)"), logarithm_of("Log")
    ('Fc', 'VB', '')
    """
    match = _LOGARITHM.match(name.strip())
    text = match[1] if match else ""
    return text if "(" in text else text.removesuffix(")")


def unrecognised(columns: tuple[Column, ...]) -> str:
    """Sentence on a table of which no column is recognised by its header.

    >>> import numpy as np
    >>> unrecognised((Column(1, "Speed set", "", np.array([1.0]), True),)).partition(". ")[2]
    'By the words in their names they may be V: --map "V=Speed set".'
    """
    names = ", ".join(repr(c.name) for c in columns[:12]) + (", ..." if len(columns) > 12 else "")
    if all(c.name == f"col{c.number}" for c in columns):
        head = f"the file has no row of column names above its numbers: no column is recognised among {names}"
    else:
        head = f"no column is recognised among {names}"
    logs = [column.name for column in columns if is_known(logarithm_of(column.name))]
    if logs:
        return f"{head}. {', '.join(map(repr, logs[:6]))} hold logarithms: write the values, not their logarithms."
    alike: dict[str, Column] = {}
    for column in columns:
        role = role_within(parse_header(column.name).name) if column.is_numeric else None
        if role is not None:
            alike.setdefault(role, column)
    if alike:
        each = " ".join(f'--map "{role}={column.name}"' for role, column in alike.items())
        return f"{head}. By the words in their names they may be {', '.join(alike)}: {each}."
    example = '--map "V=col1" --map "VB=col3"'
    return f"{head}: name them as V, f, d, t, AW ... in a header row, or assign them, for instance {example}."


def with_latin_headers(table: Table) -> Table:
    r"""The table with Latin letters in headers that only then name a quantity or a unit, and a warning on each.

    >>> import pathlib, tempfile
    >>> from .tables import read_table
    >>> path = pathlib.Path(tempfile.mkdtemp(), "a.csv")
    >>> _ = path.write_text("V,\N{CYRILLIC SMALL LETTER A}p [mm]\n100,2\n", "utf-8")
    >>> [column.name for column in with_latin_headers(read_table(path)).columns]
    ['V', 'ap [mm]']
    """
    columns = list(table.columns)
    sentences: list[str] = []
    for i, column in enumerate(columns):
        if column.name.isascii() and column.unit_cell.isascii():
            continue
        name = _latin(column.name) if _gains(column.name) else column.name
        cell = column.unit_cell
        cell = _latin(cell) if cell and not is_unit(cell) and is_unit(_latin(cell)) else cell
        if (name, cell) != (column.name, column.unit_cell):
            columns[i] = replace(column, name=name, unit_cell=cell)
            sentences.append(f"Column {column.number}: {name!r} is written with letters of another script.")
    return replace(table, columns=tuple(columns), warnings=(*table.warnings, *sentences)) if sentences else table


def _gains(text: str) -> bool:
    """Whether a header names a quantity, or has a known unit, only in Latin letters."""
    latin = _latin(text)
    if latin == text:
        return False
    old, new = parse_header(text), parse_header(latin)
    if not roles_named(new.name):
        return False
    return not roles_named(old.name) or (is_unit(new.unit_text) and not is_unit(old.unit_text))


def _latin(text: str) -> str:
    return text.translate(_LETTERS)
