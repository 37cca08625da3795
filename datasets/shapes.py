"""Wide tables of tests: columns of edges or times become one row per measurement, repeated readings their mean."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..core.arrays import Ints, Texts
from ..core.errors import DataError
from .doubts import Doubt
from .headers import Numbered, numbered, parse_header, timed, without_gap
from .leading_rows import as_numbers, with_header
from .notes import named_in_notes, response_in, same_as_time, time_in_notes
from .tables import Column, Table
from .tables.numerals import Mark
from .units import canonical
from .vocabulary import MEASURED, ROLES, role_of, role_of_mean, roles_named

EXAMPLE = """
  edge, V [m/min], f [mm/rev], d [mm], t [min], VB [mm]
  E1, 150, 0.2, 2, 2, 0.08
  E1, 150, 0.2, 2, 4, 0.11
  E2, 200, 0.2, 2, 2, 0.10"""
_TAIL = re.compile(r"\d\D*$|[\s_#.-][A-Za-z]$")
_EDGES = ("e", "t", "no", "nr", "test", "run", "tool", "insert", "platte", "cutting edge", "tooth", "sample", "probe")
_READING_NUMBER = re.compile(r"(?<!\d)\d{1,2}\Z")
READINGS = ("load", "surface")  # readings of wear in several columns are of several times or edges
MOST_READINGS = 12


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
    if any(role in ("t", "T", "edge") or (role in ROLES and ROLES[role].kind in MEASURED) for role in mapping or ()):
        return table
    if (turned := _turned(table)) is not None:
        return turned
    _refuse_blocks(table)
    if not _may_be_wide(table):
        return table
    written, (table, conditions) = table, with_header(table)
    heads = [_head(column) for column in table.columns]
    held = {head.role for head in heads if head.role}
    measured = {role for role in held if ROLES[role].kind in MEASURED or role == "T"}
    free = [head for head in heads if head.role is None and head.column.is_numeric]
    key = "edge" if "t" in held else "t"
    family = _by_edge(table, heads, free) if key == "edge" else _by_time(table, free)
    if key == "edge" and family is None and (found := _by_condition(table, free)) is not None:
        family, conditions = found[0], (*conditions, found[1])
    if family and not (measured and family.response in {"", *measured}):
        return _unpivoted(table, family, key, conditions)
    if len(free) >= 3 and held - {"t"} and not measured and _is_series(free) and not _are_readings(free):
        raise DataError(_refusal(table, free))
    return written


def _refuse_blocks(table: Table) -> None:
    """Refuse blocks of equal columns side by side, each with the tests of an edge."""
    filled = [column for column in table.columns if not re.fullmatch(r"col\d+", column.name)]
    names = [column.name for column in filled]
    size = names.index(names[0], 1) if names and names[0] in names[1:] else 0
    blocks = size > 1 and names == names[:size] * (len(names) // size)
    if blocks and all(_head(column).role for column in filled[:size]):
        raise DataError(
            f"the columns {', '.join(map(repr, names[:size]))} stand {len(names) // size} times side by side, as "
            "blocks of edges or tests. Write them below each other, with columns of the edge and its conditions, for "
            f"instance:{EXAMPLE}"
        )


_WIDEST = 400  # columns of a wide table
_QUANTITIES = 40  # rows of a table with a column for each test


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
        kinds & set(MEASURED) or "T" in known
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
    return not first.is_numeric and as_numbers(first, table).is_numeric


def _head(column: Column) -> _Head:
    header = parse_header(column.name)
    unit = column.unit_cell or header.unit_text
    return _Head(column, header.name, unit, role_of(header.name, canonical(unit) if unit else None))


def _by_edge(table: Table, heads: Sequence[_Head], free: Sequence[_Head]) -> _Family | None:
    """Columns numbered or lettered as edges, with a column of times that all of them share."""
    if len(free) < 2 or any(head.role == "edge" for head in heads):
        return None
    found = [numbered(head.name) for head in free]
    if not all(found):
        return None
    stems = {" ".join(match.stem.casefold().split()) for match in found if match}
    units = {head.unit for head in free}
    if len(stems) != 1 or len(units) != 1:
        return None
    stem, unit = stems.pop(), units.pop()
    response, rest = response_in(stem)
    varies = any(
        head.role and ROLES[head.role].kind == "condition" and np.unique(head.column.values).size > 1 for head in heads
    )
    is_edge = rest in _EDGES or "edge" in roles_named(rest) or rest == ""
    if not is_edge or (not rest and varies):
        return None
    ids = tuple(_label(match, response) if rest else match.id for match in found if match)
    noted, noted_unit = ("", "") if response else named_in_notes(table)
    return _Family(tuple(head.column for head in free), ids, response or noted, unit or noted_unit)


_OF_LEVEL = re.compile(r"(?P<name>[^\d=]*[^\d=\s_])[\s_=]*+(?P<number>\d+(?:[.,]\d+)?)\s*+(?P<unit>[^\d\s]\S*)?")


def _by_condition(table: Table, free: Sequence[_Head]) -> tuple[_Family, Column] | None:
    """Columns whose headers name levels of one condition (``vc 120 m/min``), and the column of these levels.

    Each column is an edge, of which several may be at one level; the response is named before the condition, or in the
    notes.
    """
    columns = tuple(head.column for head in free)
    named = {_response_before(column.name) for column in columns}
    response, unit, _ = named.pop() if len({one[:2] for one in named}) == 1 else ("", "", "")
    if not response:
        response, unit = named_in_notes(table)
    found = [_OF_LEVEL.fullmatch(_response_before(column.name)[2]) for column in columns]
    if len(free) < 2 or not all(found) or not response:
        return None
    units = {match["unit"] or "" for match in found if match}
    roles = {role_of(match["name"], canonical(match["unit"]) if match["unit"] else None) for match in found if match}
    levels = [float(match["number"].replace(",", ".")) for match in found if match]
    role = roles.pop() if len(roles) == len(units) == 1 else None
    if role is None or ROLES[role].kind != "condition":
        return None
    names = [column.name.strip() for column in columns]
    again = [names[:i].count(name) for i, name in enumerate(names)]
    ids = tuple(f"{name} ({k + 1})" if k else name for name, k in zip(names, again, strict=True))
    return _Family(columns, ids, response, unit), Column(0, role, units.pop(), np.array(levels), True)


def _response_before(name: str) -> tuple[str, str, str]:
    """Symbol and unit of the response that a header begins with, and the rest; of other headers all is the rest."""
    response, rest = response_in(name.strip())
    match = re.match(r"\[([^\]]*)\]\s*+", rest) if response else None
    return response, match[1] if match else "", rest[match.end() :] if match else rest


def _by_time(table: Table, free: Sequence[_Head]) -> _Family | None:
    """Columns whose headers name rising times."""
    times_named: list[tuple[_Head, str, float, str]] = []
    for head in free:
        if found := timed(head.name) or timed(head.column.name):
            stem, time, unit = found
            times_named.append((head, stem, time, unit or (head.unit if same_as_time(head.unit) else "")))
    if len(times_named) < 2:
        return None
    stems, units = {stem.casefold() for _, stem, _, _ in times_named}, {unit for *_, unit in times_named}
    times = [time for *_, time, _ in times_named]
    if len(stems) != 1 or len(units) != 1 or any(b <= a for a, b in pairwise(times)):
        return None
    stem, unit = stems.pop(), units.pop()
    response, rest = response_in(stem)
    counted = times == list(range(1, len(times) + 1)) or times == list(range(len(times)))
    if rest or (not unit and counted and not time_in_notes(table)):
        return None
    measured = {head.unit for head, *_ in times_named if not same_as_time(head.unit)}
    columns = tuple(head.column for head, *_ in times_named)
    ids = tuple(f"{time:g}" for time in times)
    noted, noted_unit = ("", "") if response else named_in_notes(table)
    measured_in = "".join(measured) or noted_unit
    return _Family(columns, ids, response or noted, measured_in, unit or time_in_notes(table))


def _label(match: Numbered, response: str) -> str:
    """The label of an edge in a header, without the words of the response."""
    words = re.split(r"[\s_]+", match.stem)
    kept = " ".join(words[1:] if response and len(words) > 1 else words)
    return f"{kept}{match.gap}{match.id}"


def _is_series(free: Sequence[_Head]) -> bool:
    """Whether the columns without a role are numbered ones of one name."""
    found = [numbered(head.name) for head in free]
    stems = {match.stem.casefold() for match in found if match}
    return all(found) and len(stems) == 1


def _are_readings(free: Sequence[_Head]) -> bool:
    """Whether the columns are readings of one response, few enough for their mean (`with_means`)."""
    roles = {_reading(head.column, head.name, head.unit or None) for head in free}
    return len(free) <= MOST_READINGS and len(roles) == 1 and "" not in roles


def _refusal(table: Table, free: Sequence[_Head]) -> str:
    names = ", ".join(repr(head.name) for head in free[:4]) + (" ..." if len(free) > 4 else "")
    first = numbered(free[0].name)
    role = (role_of(first.stem, free[0].unit or None) if first else None) or "VB"
    return (
        f"{table.path.name} seems to be a wide table, with its measurements in the columns {names}, and it is open "
        f"whether these are edges, times or repeated readings. Take one of them, as with --map "
        f"{role}=col{free[0].column.number}, or write one row per measurement, for instance:{EXAMPLE}"
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


def _key_column(key: str, ids: Texts, unit: str, number: int) -> Column:
    if key == "edge":
        return Column(number, "edge", "", ids, False)
    return Column(number, "t", unit, ids.astype(float), True)


def _taken(column: Column, rows: Ints) -> Column:
    """The column with these rows of the table, and its marks wherever their row is repeated."""
    marks = dict(column.marks)
    moved = tuple((i, marks[row]) for i, row in enumerate(rows.tolist()) if row in marks) if marks else ()
    return replace(column, values=column.values[rows], marks=moved)


def _moved(marked: dict[tuple[int, int], Mark], rows: Ints, places: Ints) -> tuple[tuple[int, Mark], ...]:
    if not marked:
        return ()
    pairs = enumerate(zip(rows.tolist(), places.tolist(), strict=True))
    return tuple((i, marked[pair]) for i, pair in pairs if pair in marked)


def with_means(columns: tuple[Column, ...], mapping: Mapping[str, str]) -> tuple[tuple[Column, ...], tuple[str, ...]]:
    """The columns, with a further one of the means of repeated readings, and a sentence on each.

    Readings are columns of numbers whose headers are one force, power, temperature or roughness with different
    numbers, and the same unit. Nothing is added where a column of that response is there or assigned by ``mapping``.

    Examples
    --------
    >>> names = ("Ra1 [um]", "Ra2 [um]")
    >>> columns = tuple(Column(i, name, "", np.array([i, 3.0]), True) for i, name in enumerate(names, 1))
    >>> found, said = with_means(columns, {})
    >>> found[-1].name, found[-1].values.tolist(), said
    ('Ra [um]', [1.5, 3.0], ("Ra is the mean of the readings in columns 'Ra1 [um]' and 'Ra2 [um]' of each row",))
    """
    held, families = set(mapping), dict[tuple[str, str], list[Column]]()
    for column in columns:
        header = parse_header(column.name)
        text = column.unit_cell or header.unit_text
        unit = canonical(text) if text else None
        role = role_of(header.name, unit) or role_of_mean(header.name, unit)
        if role is not None:
            held.add(role)
        elif reading := _reading(column, header.name, unit):
            families.setdefault((reading, text), []).append(column)
    roles = [role for role, _ in families]
    found = {
        key: each for key, each in families.items()
        if 2 <= len(each) <= MOST_READINGS and key[0] not in held and roles.count(key[0]) == 1
    }  # fmt: skip
    means = tuple(_column_of_means(key, each, len(columns) + i) for i, (key, each) in enumerate(found.items(), 1))
    return (*columns, *means), tuple(_said_of_means(role, each) for (role, _), each in found.items())


def _reading(column: Column, name: str, unit: str | None) -> str:
    """Symbol of the response of which a numbered column is a reading, empty where it is none."""
    match = _READING_NUMBER.search(name, max(len(name) - 2, 0))
    stem = name[: match.start()] if match else ""
    role = role_of(without_gap(stem) or stem, unit) if stem and column.is_numeric and not column.bad else None
    return role if role is not None and ROLES[role].kind in READINGS else ""


def _column_of_means(key: tuple[str, str], each: list[Column], number: int) -> Column:
    values = np.array([column.values for column in each], dtype=float)
    known = np.isfinite(values).sum(axis=0)
    sums = np.where(np.isfinite(values), values, 0.0).sum(axis=0)
    mean = np.divide(sums, known, out=np.full(len(sums), np.nan), where=known > 0)
    return Column(number, f"{key[0]} [{key[1]}]" if key[1] else key[0], "", mean, True)


def _said_of_means(role: str, each: list[Column]) -> str:
    names = [repr(column.name) for column in each]
    return f"{role} is the mean of the readings in columns {', '.join(names[:-1])} and {names[-1]} of each row"
