"""Wide tables of tests, with a column for each edge or each time, turned into one row per measurement."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..core.errors import DataError
from .doubts import Doubt
from .headers import parse_header
from .tables import Column, Table, is_number
from .tables.marks import Mark
from .tables.numerals import parse_number
from .units import canonical, is_unit, same_dimension
from .vocabulary import ROLES, fits, role_of, roles_named

RESPONSES = ("wear", "load", "surface")
EXAMPLE = """
  edge, V [m/min], f [mm/rev], d [mm], t [min], VB [mm]
  E1, 150, 0.2, 2, 2, 0.08
  E1, 150, 0.2, 2, 4, 0.11
  E2, 200, 0.2, 2, 2, 0.10"""
_NUMBERED = re.compile(r"(?P<stem>.*?)(?P<gap>[\s_#.:-]*)(?P<id>\d{1,3}|(?<![^\W\d_])[A-Za-z])")
_AFTER = r"(?:after|at|nach|bei|après|apres|a|à|tras|despu[eé]s de|@|t|time|zeit|=|:|\s|_|,|\()*"
_TIMED = re.compile(
    rf"(?P<stem>.*?){_AFTER}(?<![\d.,])(?P<number>\d+(?:[.,]\d+)?)[\s_]*(?P<unit>min|minutes?|mins|s|sec|seconds?|h)?\)?",
    re.IGNORECASE,
)
_TAIL = re.compile(r"\d\D*$|[\s_#.-][A-Za-z]$")
_EDGES = ("e", "t", "no", "nr", "test", "run", "tool", "insert", "platte", "cutting edge", "tooth", "sample", "probe")


@dataclass(frozen=True, slots=True)
class _Family:
    """Columns of one response, and the label or time that the header of each adds."""

    columns: tuple[Column, ...]
    ids: tuple[str, ...]
    response: str  # symbol, or "" where the headers do not name it
    unit: str  # of the response
    unit_of_time: str = ""


@dataclass(frozen=True, slots=True)
class _Head:
    """A header cell: name, unit, and the role of the name."""

    column: Column
    name: str
    unit: str
    role: str | None


def long_table(table: Table, mapping: Mapping[str, str] | None = None) -> Table:
    r"""The table with one row per measurement; a table that has this shape already is returned unchanged.

    So is one whose response, time or edges are assigned by ``mapping``, role to column.

    Raises
    ------
    DataError
        The table is wide, and it is open what its columns are.

    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp(), "a.csv")
    >>> _ = path.write_text("edge,V,VB 2 min,VB 4 min\nE1,100,0.1,0.2\n")
    >>> from .tables import read_table
    >>> [column.values.tolist() for column in long_table(read_table(path)).columns]
    [['E1', 'E1'], [100.0, 100.0], [2.0, 4.0], [0.1, 0.2]]

    """
    if not 3 <= len(table.columns) <= _WIDEST:
        return table
    if any(role in ("t", "T", "edge") or (role in ROLES and ROLES[role].kind in RESPONSES) for role in mapping or ()):
        return table
    if (turned := _turned(table)) is not None:
        return turned
    if not _may_be_wide(table):
        return table
    written, (table, conditions) = table, _with_header(table)
    heads = [_head(column) for column in table.columns]
    held = {head.role for head in heads if head.role}
    measured = {role for role in held if ROLES[role].kind in RESPONSES or role == "T"}
    free = [head for head in heads if head.role is None and head.column.is_numeric]
    key = "edge" if "t" in held else "t"
    family = _by_edge(table, heads, free) if key == "edge" else _by_time(table, free)
    if family and not (measured and family.response in {"", *measured}):
        return _unpivoted(table, family, key, conditions)
    if len(free) >= 3 and held - {"t"} and not measured and _is_series(free):
        raise DataError(_refusal(table, free))
    return written


_WIDEST = 400  # columns of a wide table
_LONGEST = 10_000  # rows of a wide table with a column for each edge
_QUANTITIES = 40  # rows of a table with a column for each test
_NAMES_ABOVE = 12  # rows of names and conditions above it


def _turned(table: Table) -> Table | None:
    """The table with rows and columns exchanged, where each row holds a quantity and each column a test; else None."""
    first, tests = table.columns[0], table.columns[1:]
    if first.is_numeric or not 3 <= table.n_rows <= _QUANTITIES or any(c.bad or not c.is_numeric for c in tests):
        return None
    labels = [str(value) for value in first.values]
    headers = [parse_header(label) for label in labels]
    roles = [role_of(h.name, canonical(h.unit_text) if h.unit_text else None) for h in headers]
    known = [role for role in roles if role]
    kinds = {ROLES[role].kind for role in known}
    if len(known) < 3 or len(set(known)) < len(known) or "condition" not in kinds or not (
        kinds & set(RESPONSES) or "T" in known
    ):  # fmt: skip
        return None
    values = np.array([column.values for column in tests], dtype=float)
    marks = [{j: dict(column.marks)[row] for j, column in enumerate(tests) if row in dict(column.marks)}
             for row in range(table.n_rows)]  # fmt: skip
    columns = [
        Column(i, label, "", values[:, i - 1], True, marks=tuple(marks[i - 1].items()))
        for i, label in enumerate(labels, start=1)
    ]
    if table.dialect.has_header and "edge" not in known:
        names = np.array([column.name for column in tests], dtype=object)
        columns.append(Column(len(columns) + 1, "edge", "", names, False))
    said = f"each row holds a quantity and each column a test: rows and columns are exchanged, {len(tests)} tests"
    return replace(
        table, columns=tuple(columns), lines=np.array([column.number for column in tests]),
        assumed=(*table.assumed, f"{said}; the lines named are columns of the file"),
        dialect=replace(table.dialect, has_header=True),
        warnings=tuple(text for text in table.warnings if not text.startswith("There is no header row")),
    )  # fmt: skip


def _may_be_wide(table: Table) -> bool:
    """A quick look: two headers end in a number or a letter of their own, or names stand among the numbers."""
    if not table.dialect.has_header or any(column.bad for column in table.columns):
        return True
    names = [column.name for column in table.columns]
    if sum(bool(_TAIL.search(name)) or (len(name) == 1 and name not in ROLES) for name in names) > 1:
        return True
    first = table.columns[0]
    return not first.is_numeric and _as_numbers(first, table).is_numeric


def _head(column: Column) -> _Head:
    header = parse_header(column.name)
    unit = column.unit_cell or header.unit_text
    return _Head(column, header.name, unit, role_of(header.name, canonical(unit) if unit else None))


def _by_edge(table: Table, heads: Sequence[_Head], free: Sequence[_Head]) -> _Family | None:
    """Columns numbered or lettered as edges, with a column of times that all of them share."""
    if len(free) < 2 or any(head.role == "edge" for head in heads):
        return None
    found = [_NUMBERED.fullmatch(head.name) for head in free]
    if not all(found):
        return None
    stems = {" ".join(match["stem"].casefold().split()) for match in found if match}
    units = {head.unit for head in free}
    if len(stems) != 1 or len(units) != 1:
        return None
    stem, unit = stems.pop(), units.pop()
    response, rest = _response_in(stem)
    varies = any(
        head.role and ROLES[head.role].kind == "condition" and np.unique(head.column.values).size > 1 for head in heads
    )
    is_edge = rest in _EDGES or "edge" in roles_named(rest) or rest == ""
    if not is_edge or (not rest and varies):
        return None
    ids = tuple(_label(match, response) if rest else match["id"] for match in found if match)
    noted, noted_unit = ("", "") if response else _named_in_notes(table)
    return _Family(tuple(head.column for head in free), ids, response or noted, unit or noted_unit)


def _by_time(table: Table, free: Sequence[_Head]) -> _Family | None:
    """Columns whose headers name rising times."""
    timed: list[tuple[_Head, str, float, str]] = []
    for head in free:
        match = _TIMED.fullmatch(head.name) or _TIMED.fullmatch(head.column.name)
        if match:
            unit = match["unit"] or (head.unit if same_as_time(head.unit) else "")
            timed.append((head, match["stem"].strip(" _-"), float(match["number"].replace(",", ".")), unit))
    if len(timed) < 2:
        return None
    stems, units = {stem.casefold() for _, stem, _, _ in timed}, {unit for *_, unit in timed}
    times = [time for *_, time, _ in timed]
    if len(stems) != 1 or len(units) != 1 or any(b <= a for a, b in pairwise(times)):
        return None
    stem, unit = stems.pop(), units.pop()
    response, rest = _response_in(stem)
    counted = times == list(range(1, len(times) + 1)) or times == list(range(len(times)))
    if rest or (not unit and counted and not _time_in_notes(table)):
        return None
    measured = {head.unit for head, *_ in timed if not same_as_time(head.unit)}
    columns = tuple(head.column for head, *_ in timed)
    ids = tuple(f"{time:g}" for time in times)
    noted, noted_unit = ("", "") if response else _named_in_notes(table)
    measured_in = "".join(measured) or noted_unit
    return _Family(columns, ids, response or noted, measured_in, unit or _time_in_notes(table))


def same_as_time(unit: str) -> bool:
    """Whether a unit is one of time.

    >>> same_as_time("s"), same_as_time("mm"), same_as_time("")
    (True, False, False)
    """
    known = canonical(unit) if unit else None
    return known is not None and same_dimension(known, "min")


def _response_in(stem: str) -> tuple[str, str]:
    """Symbol of the response that a header names first, and the rest of the header."""
    words = re.split(r"[\s_]+", stem)
    for count in range(len(words), 0, -1):
        role = role_of(" ".join(words[:count]), None) or role_of(" ".join(words[:count]).upper(), None)
        if role and ROLES[role].kind in RESPONSES:
            return role, " ".join(words[count:])
    return "", stem


def _label(match: re.Match[str], response: str) -> str:
    """The label of an edge in a header, without the words of the response."""
    words = re.split(r"[\s_]+", match["stem"])
    kept = " ".join(words[1:] if response and len(words) > 1 else words)
    return f"{kept}{match['gap']}{match['id']}"


def _named_in_notes(table: Table) -> tuple[str, str]:
    """Symbol and unit of the response that a note of the file names, "" where none does."""
    for note in table.notes:
        words = re.findall(r"[^\W\d_]\w*", note)
        for count in (3, 2, 1):
            for start in range(len(words) - count + 1):
                name = " ".join(words[start : start + count])
                role = role_of(name, None) if len(name) > 1 else None
                if role and ROLES[role].kind in RESPONSES:
                    unit = re.search(rf"{re.escape(words[start + count - 1])}\s*(?:\bin\b|\[|\()\s*([^\s\])]+)", note)
                    return role, unit[1] if unit and is_unit(unit[1]) and fits(role, unit[1]) else ""
    return "", ""


def _time_in_notes(table: Table) -> str:
    """Unit of time in a note such as "VB after t min" or "time [s]"."""
    for note in table.notes:
        if match := re.search(r"\b(?:t|time|zeit|temps|tiempo)\b[\s,in/=]*[\[(]?\s*(min|s|h)\b", note, re.IGNORECASE):
            return match[1]
    return ""


def _is_series(free: Sequence[_Head]) -> bool:
    """Whether the columns without a role are numbered ones of one name."""
    found = [_NUMBERED.fullmatch(head.name) for head in free]
    stems = {match["stem"].casefold() for match in found if match}
    return all(found) and len(stems) == 1


def _refusal(table: Table, free: Sequence[_Head]) -> str:
    names = ", ".join(repr(head.name) for head in free[:4]) + (" ..." if len(free) > 4 else "")
    return (
        f"{table.path.name} seems to be a wide table, with its measurements in the columns {names}, and it is open "
        f"whether these are edges, times or repeated readings. Take one of them, as with --map "
        f"VB=col{free[0].column.number}, or write one row per measurement, for instance:{EXAMPLE}"
    )


def _unpivoted(table: Table, family: _Family, key: str, conditions: Sequence[Column]) -> Table:
    """One row for each filled cell of the family; the key becomes a column of its own."""
    n = table.n_rows
    values = np.column_stack([column.values for column in family.columns])
    marked = {(row, j): mark for j, column in enumerate(family.columns) for row, mark in column.marks}
    filled = ~np.isnan(values)
    for place in marked:
        filled[place] = True
    order = filled if key == "t" else filled.T
    first, second = np.nonzero(order)
    rows, places = (first, second) if key == "t" else (second, first)
    others = [column for column in table.columns if column not in family.columns]
    number = max(column.number for column in table.columns)
    ids = np.array(family.ids, dtype=object)[places]
    response = family.response or "AW"
    bad = tuple(cell for column in family.columns for cell in column.bad)
    made = (
        _key_column(key, ids, family.unit_of_time, number + 1),
        Column(number + 2, response, family.unit, values[rows, places], True, bad[:5],
               sum(column.bad_count for column in family.columns), _moved(marked, rows, places)),
    )  # fmt: skip
    kept = tuple(_taken(column, rows) for column in others)
    added = tuple(
        replace(column, number=number + 3 + i, values=column.values[places]) for i, column in enumerate(conditions)
    )
    what = "edge" if key == "edge" else "time"
    names = f"{family.columns[0].name!r} to {family.columns[-1].name!r}"
    sentence = (
        f"the table is wide, {n} rows with a column for each {what} ({names}): read as {len(rows)} rows, one per "
        f"measurement of {response}"
    )
    doubts = () if family.response else (
        Doubt((response,), f"the table is wide and nothing names what its columns {names} hold: read as wear AW"),
    )  # fmt: skip
    return replace(
        table, columns=(*kept, *added, *made), lines=table.lines[rows], assumed=(*table.assumed, sentence),
        doubts=(*table.doubts, *doubts),
    )  # fmt: skip


def _key_column(key: str, ids: NDArray[np.object_], unit: str, number: int) -> Column:
    if key == "edge":
        return Column(number, "edge", "", ids, False)
    return Column(number, "t", unit, ids.astype(float), True)


def _taken(column: Column, rows: NDArray[np.intp]) -> Column:
    """The column with these rows of the table, and its marks wherever their row is repeated."""
    marks = dict(column.marks)
    moved = tuple((i, marks[row]) for i, row in enumerate(rows.tolist()) if row in marks) if marks else ()
    return replace(column, values=column.values[rows], marks=moved)


def _moved(
    marked: dict[tuple[int, int], Mark], rows: NDArray[np.intp], places: NDArray[np.intp]
) -> tuple[tuple[int, Mark], ...]:
    if not marked:
        return ()
    pairs = enumerate(zip(rows.tolist(), places.tolist(), strict=True))
    return tuple((i, marked[pair]) for i, pair in pairs if pair in marked)


def _with_header(table: Table) -> tuple[Table, tuple[Column, ...]]:
    """The table without the rows of names and conditions that its first rows hold, and a condition for each column.

    A header that holds times as numbers is no header to the reader of tables: it comes as the first row. Rows such as
    ``V [m/min], 100, 150, 200`` above a wide table hold a condition of each of its columns.
    """
    table = replace(table, columns=(_as_numbers(table.columns[0], table), *table.columns[1:]))
    cells = [_leading_texts(column) for column in table.columns]
    if not table.dialect.has_header and table.n_rows > 1 and any(cells) and len(cells[0]) < 2:
        first = [texts.get(0, "") for texts in cells]
        if sum(bool(text) and role_of(parse_header(text).name, None) is not None for text in first) >= 1 and all(
            text or np.isfinite(column.values[0])
            for text, column in zip(first, table.columns, strict=True)
            if column.is_numeric
        ):
            names = [text or f"{column.values[0]:g}" for text, column in zip(first, table.columns, strict=True)]
            return _below(table, 1, names), ()
    return _with_conditions(table)


def _with_conditions(table: Table) -> tuple[Table, tuple[Column, ...]]:
    """Read rows of conditions above a wide table, named by the texts of its first column."""
    first, others = table.columns[0], table.columns[1:]
    lead = _leading_texts(first)
    rows = sorted(lead)
    if not first.is_numeric or not rows or rows != list(range(len(rows))) or len(rows) >= table.n_rows:
        return table, ()
    roles = [role_of(parse_header(lead[row]).name, None) for row in rows]
    known = [row for row, role in zip(rows, roles, strict=True) if role and ROLES[role].kind in ("condition", "other")]
    if not known or not all(roles):
        return table, ()
    conditions = tuple(
        Column(0, lead[row], "", np.array([column.values[row] for column in others], dtype=float), True)
        for row in known
        if all(column.is_numeric for column in others)
    )
    names = [column.name for column in table.columns]
    below = first.values[len(rows) :]
    if "t" not in roles and role_of(parse_header(names[0]).name, None) == "edge" and bool(np.all(np.diff(below) > 0)):
        names[0] = "t"  # the numbers below the conditions rise and have no name
    for row, role in zip(rows, roles, strict=True):
        texts = [_leading_texts(column).get(row, "") for column in others]
        if role == "edge" and any(texts):
            names[1:] = [text or name for text, name in zip(texts, names[1:], strict=True)]
        if role == "t":
            names[0] = lead[row]
            if len(set(texts)) == len(texts) and all(texts):
                names[1:] = texts
            elif len(set(texts)) == 1 and _response_in(parse_header(texts[0]).name)[0]:
                names[1:] = [f"{texts[0]} {name}" for name in names[1:]]
    return _below(table, len(rows), names), conditions


def _as_numbers(column: Column, table: Table) -> Column:
    """A column of a few names above numbers as a column of numbers; any other unchanged."""
    if column.is_numeric:
        return column
    texts = [str(value) for value in column.values[:_NAMES_ABOVE]]
    count = next((i for i, text in enumerate(texts) if is_number(text)), 0)
    if not count or not all(texts[:count]) or table.n_rows > _LONGEST:
        return column
    numbers = [parse_number(str(value), table.dialect.decimal) for value in column.values[count:]]
    if any(number is None for number in numbers):
        return column
    values = np.array([np.nan] * count + numbers, dtype=float)
    bad = tuple(zip(table.lines[:count].tolist(), texts[:count], strict=True))
    return replace(column, values=values, is_numeric=True, bad=bad, bad_count=count)


def _leading_texts(column: Column) -> dict[int, str]:
    """Texts of the first rows of a column, by row; of a numeric column its cells that are no numbers."""
    if not column.is_numeric:
        return {0: str(column.values[0])} if len(column.values) and column.values[0] else {}
    if not column.bad or column.bad_count > len(column.bad):
        return {}
    empty = np.flatnonzero(np.isnan(column.values))[: len(column.bad)].tolist()
    return dict(zip(empty, (text for _, text in column.bad), strict=False))


def _below(table: Table, count: int, names: Sequence[str]) -> Table:
    """The table without its first rows, under other names; texts of the removed rows are no bad cells."""
    above = int(table.lines[count - 1])
    columns = []
    for column, name in zip(table.columns, names, strict=True):
        bad = tuple(cell for cell in column.bad if cell[0] > above)
        marks = tuple((row - count, mark) for row, mark in column.marks if row >= count)
        columns.append(
            replace(column, name=name, values=column.values[count:], bad=bad, marks=marks,
                    bad_count=column.bad_count - len(column.bad) + len(bad))
        )  # fmt: skip
    dialect = replace(table.dialect, has_header=True)
    warnings = tuple(text for text in table.warnings if not text.startswith("There is no header row"))
    return replace(table, columns=tuple(columns), lines=table.lines[count:], dialect=dialect, warnings=warnings)
