"""Groups of pairs: ISO 513, those that a parameter file has a place for, and a separate table with them."""

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd

from ..core.errors import DataError, UsageError
from ..core.rounding import label_of
from ..core.text import shortened
from ..datasets.tables.decode import encoding_of, load_bytes, text_lines
from ..datasets.tables.dialect import is_comment, split_line, text_source
from ..datasets.tables.numerals import Cell, is_missing
from ..datasets.tables.workbook import is_workbook, read_sheets
from ..datasets.vocabulary import roles_named
from .outcomes import GROUPS_DIFFER, Concern, PairOutcome
from .source.common import some_names

NAMES = ("tool", "work")
LISTED = 12  # headers in a message
MARKS = (";", "\t", "|", ",", " ")
Line = tuple[int, Sequence[Cell]]


ISO_FAMILIES = {
    "P": "P steel", "M": "M stainless", "K": "K cast iron",
    "N": "N non-ferrous", "S": "S superalloys and titanium", "H": "H hardened",
}  # fmt: skip
ABOUT = ("machine", "setup", "iso513")  # groups that the identity of a parameter file has a place for
_ISO_HEADERS = frozenset(
    {"iso513", "iso513group", "iso513groups", "groupiso513", "isogroup", "isomaterial", "isomaterialgroup"}
)
_ISO_GROUP = re.compile(r"(?:ISO\s*)?([PMKNSH])[\s.-]?(?:(\d{1,2})(?:\.\d+)?)?", re.IGNORECASE)


def is_iso_513(header: str) -> bool:
    """Whether the header of a column denotes groups of ISO 513.

    Examples
    --------
    >>> is_iso_513("ISO 513"), is_iso_513("iso group"), is_iso_513("ISO13399")
    (True, True, False)
    """
    return _plain(header) in _ISO_HEADERS


def iso_group(value: str) -> str | None:
    """The ISO 513 group of a value, with its number where it has one; None where the value is no group.

    Examples
    --------
    >>> iso_group("iso p20"), iso_group("K-5"), iso_group("M stainless"), iso_group("P60"), iso_group("steel")
    ('P20', 'K05', 'M', None, None)
    """
    plain = value.strip()
    if found := _ISO_GROUP.fullmatch(plain):
        letter, number = found[1].upper(), found[2]
        return letter if number is None else f"{letter}{int(number):02d}" if 0 < int(number) <= 50 else None
    return {name.casefold(): letter for letter, name in ISO_FAMILIES.items()}.get(plain.casefold())


def iso_family(value: str) -> str:
    """Name of the ISO 513 group of a value; other values are unchanged.

    Examples
    --------
    >>> iso_family("P20"), iso_family("k"), iso_family("M stainless"), iso_family("steel")
    ('P steel', 'K cast iron', 'M stainless', 'steel')
    """
    group = iso_group(value)
    return value.strip() if group is None else ISO_FAMILIES[group[0]]


def identity_of(groups: Mapping[str, str]) -> tuple[dict[str, str], list[Concern]]:
    """Identity of a parameter file from the groups, and concerns on invalid groups.

    Examples
    --------
    >>> identity_of({"ISO 513 group": "p20", "coolant": "dry"})
    ({'iso513': 'P20'}, [])
    """
    found = {place: name for header, name in groups.items() if (place := _place(header)) and name}
    given = found.pop("iso513", None)
    if given is None:
        return found, []
    if group := iso_group(given):
        return found | {"iso513": group}, []
    words = f"{given!r} is no group of ISO 513 (P, M, K, N, S or H, or with its number as P20); the file has none."
    return found, [Concern("no group of ISO 513", words)]


def is_identity(header: str) -> bool:
    """Whether a group of this header has a place in the identity of a parameter file.

    >>> is_identity("ISO 513"), is_identity("coolant")
    (True, False)
    """
    return _place(header) != ""


def _place(header: str) -> str:
    plain = "iso513" if is_iso_513(header) else _plain(header)
    return plain if plain in ABOUT else ""


def _plain(header: str) -> str:
    return "".join(letter for letter in header.casefold() if letter.isalnum())


def read_pairs(path: str | os.PathLike[str]) -> pd.DataFrame:
    r"""Read the table of pairs.

    Parameters
    ----------
    path : str or path
        Delimited text or an .xlsx workbook, its header in the first row: a tool column, a work column or both, under
        any of their names, and one or more others. An empty tool or work stands for all.

    Returns
    -------
    DataFrame
        ``tool, work``, empty where the row holds for all; then the other columns under their headers. All is text.

    Raises
    ------
    DataError
        It cannot be read, names neither tools nor works, has no groups of them, or contradicts itself.

    Notes
    -----
    Such a table may hold no number at all, by which a table of measurements is found; hence the header decides here.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp(), "pairs.csv")
    >>> _ = path.write_text("tool;iso513\nGC435;P20\nK10;K\n")
    >>> read_pairs(path).to_dict("list")
    {'tool': ['GC435', 'K10'], 'work': ['', ''], 'iso513': ['P20', 'K']}
    """
    path = Path(path)
    lines = [(number, [_text(cell) for cell in cells]) for number, cells in _lines(path)]
    filled = [(number, cells) for number, cells in lines if any(cells)]
    if not filled:
        raise DataError(f"{path.name} holds no filled cell. Export the table again.")
    header, named = filled[0][1], _named(filled[0][1])
    if not named:
        seen = ", ".join([*filter(None, header)][:LISTED])
        raise DataError(
            f"{path.name}: neither tool nor work is a column of its header, {seen}. The table of pairs begins "
            "with a row of headers such as tool, work, iso513."
        )
    others = {name: place for place, name in enumerate(header) if name and place not in named.values()}
    _check_header(path.name, header, others)
    rows = [_row(path.name, number, cells, len(header)) for number, cells in filled[1:]]
    table = pd.DataFrame(
        {name: [cells[place] if place is not None else "" for cells in rows] for name, place in
         {**{name: named.get(name) for name in NAMES}, **others}.items()},
        dtype=object,
    )  # fmt: skip
    made = _once(path.name, table, [number for number, _ in filled[1:]])
    made.attrs["file"] = path.name
    return made


def with_groups(outcomes: Sequence[PairOutcome], table: pd.DataFrame) -> tuple[PairOutcome, ...]:
    """Outcomes with the groups of their pairs from the table.

    The pair's own rows come first, then a row of the table for the pair, for its tool, for its work; a contradiction is
    a ``Concern("group differs", ...)``.

    Raises
    ------
    UsageError
        The table names none of the pairs.

    Examples
    --------
    >>> table = pd.DataFrame({"tool": ["GC435"], "work": [""], "iso513": ["P20"]})
    >>> with_groups([PairOutcome("GC435", "709M40", 24)], table)[0].groups
    {'iso513': 'P20'}
    """
    groups = _groups(table)
    made = tuple(_with(outcome, groups) for outcome in outcomes)
    if outcomes and groups and not any(key in groups for outcome in outcomes for key in _keys(outcome)):
        file = table.attrs.get("file", "the table of pairs")
        raise UsageError(
            f"{file} names {_some(groups)}, none of which the source holds; it holds"
            f" {_some([(outcome.tool, outcome.work) for outcome in outcomes])}. Check how tools and works are written."
        )
    return made


def unknown_pairs(outcomes: Iterable[PairOutcome], table: pd.DataFrame) -> str:
    """One sentence on rows of the table without a pair in the source; empty where there is none.

    Examples
    --------
    >>> table = pd.DataFrame({"tool": ["GC435", "K10"], "work": ["", ""], "iso513": ["P20", "K"]})
    >>> unknown_pairs([PairOutcome("GC435", "709M40", 24)], table)
    'The table of pairs names what the source does not hold: K10.'
    """
    met = {key for outcome in outcomes for key in _keys(outcome)}
    strange = [key for key in _groups(table) if key not in met]
    return f"The table of pairs names what the source does not hold: {_some(strange)}." if strange else ""


def _lines(path: Path) -> Iterator[Line]:
    data = load_bytes(path)
    if is_workbook(data, path.name):
        sheets, _ = read_sheets(data, path.name, None)
        yield from next((sheet for sheet in sheets if any(any(row) for row in sheet.rows)), ())
        return
    encoding = encoding_of(data, path.name)
    lines = (line for line in text_lines(data, encoding) if line.strip() and not is_comment(line, " "))
    first = next(lines, "")
    has_separator_line = first.strip().strip('"').casefold().startswith("sep=")
    yield from text_source(path.name, data, encoding, None if has_separator_line else _delimiter(first))


def _delimiter(header: str) -> str | None:
    """The delimiter that gives a tool or a work among the headers; of several, the one that gives most headers."""
    cut = {mark: [cell.strip() for cell in split_line(header, mark)] for mark in MARKS}
    good = [mark for mark in MARKS if len(cut[mark]) > 1 and _named(cut[mark])]
    return max(good, key=lambda mark: len(cut[mark]) - 0.5 * (mark == " ") * len(cut[mark]), default=None)


def _named(header: Sequence[str]) -> dict[str, int]:
    """Places of tool and work: under that very name, or else under another name for it."""
    found: dict[str, int] = {}
    for name in NAMES:
        exact = [place for place, text in enumerate(header) if text.casefold() == name]
        other = [place for place, text in enumerate(header) if text and roles_named(text)[:1] == (name,)]
        if exact or other:
            found[name] = (exact or other)[0]
    return found


def _check_header(file: str, header: Sequence[str], others: Mapping[str, int]) -> None:
    if not others:
        raise DataError(
            f"{file} has no groups of pairs: besides {', '.join(header[:LISTED])} it needs a column such as iso513."
        )
    name, count = next(((name, n) for name, n in Counter(header).items() if name and n > 1), ("", 0))
    if count:
        raise DataError(f"{file} has {count} columns named {shortened(name)!r}. Rename or delete all but one.")


def _row(file: str, number: int, cells: Sequence[str], width: int) -> list[str]:
    if any(cells[width:]):
        raise DataError(
            f"{file} line {number} has {len(cells)} cells, its header has {width}."
            " Name the extra column or remove the cell."
        )
    return [*cells[:width], *[""] * (width - len(cells))]


def _once(file: str, table: pd.DataFrame, lines: Sequence[int]) -> pd.DataFrame:
    """A row for each pair: rows that name it again fill its gaps, and must not contradict it."""
    kept: dict[tuple[str, str], dict[str, str]] = {}
    first: dict[tuple[str, str], int] = {}
    for line, row in zip(lines, table.to_dict("records"), strict=True):
        key = (row["tool"], row["work"])
        if not any(key):
            raise DataError(f"{file} line {line} names neither tool nor work. Fill one of them or delete the row.")
        known = kept.setdefault(key, {str(name): value for name, value in row.items()})
        for name in table.columns[2:]:
            if row[name] and known[name] and row[name] != known[name]:
                raise DataError(
                    f"{file} lines {first[key]} and {line} contradict each other: {name} of {_words(key)} is"
                    f" {known[name]!r} and {row[name]!r}. Keep one."
                )
            known[name] = known[name] or row[name]
        first.setdefault(key, line)
    return pd.DataFrame(list(kept.values()), columns=table.columns, dtype=object)


def _groups(table: pd.DataFrame) -> dict[tuple[str, str], dict[str, str]]:
    """Groups of each row of the table, by its tool and work."""
    return {
        (row["tool"], row["work"]): {str(name): str(value) for name, value in row.items() if name not in NAMES}
        for row in table.to_dict("records")
    }


def _keys(outcome: PairOutcome) -> tuple[tuple[str, str], ...]:
    return (outcome.tool, outcome.work), (outcome.tool, ""), ("", outcome.work)


def _with(outcome: PairOutcome, table: Mapping[tuple[str, str], Mapping[str, str]]) -> PairOutcome:
    groups = dict(outcome.groups)
    origin = dict.fromkeys([name for name, value in groups.items() if value], "its own rows")
    concerns = list(outcome.concerns)
    for key in _keys(outcome):
        for name, value in table.get(key, {}).items():
            known = groups.get(name, "")
            if value and known and value != known:
                words = f"{name} is {known!r} by {origin[name]} and {value!r} by the table of pairs for {_words(key)}"
                concerns.append(Concern(GROUPS_DIFFER, f"{words}; {known!r} counts"))
            elif value and not known:
                origin[name] = f"the table of pairs for {_words(key)}"
            groups[name] = known or value
    return replace(outcome, groups=groups, concerns=tuple(concerns))


def _words(key: tuple[str, str]) -> str:
    return " on ".join(part for part in key if part)


def _some(keys: Iterable[tuple[str, str]]) -> str:
    return some_names(map(_words, keys))


def _text(cell: Cell) -> str:
    if isinstance(cell, float):
        return label_of(cell)
    return "" if is_missing(cell) else cell.strip()
