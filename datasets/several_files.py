"""Several files of one laboratory, such as one file per test, as one table."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..core.arrays import Array, Texts
from ..core.errors import DataError
from ..core.rounding import listed
from .doubts import Doubt
from .headers import parse_header
from .notes import FileCondition, conditions_of_file, pair_name
from .tables import Column, Table
from .tables.workbook import SUFFIXES, TEXTS
from .units import canonical, convert, same_dimension
from .vocabulary import MEASURED, ROLES, UNNAMED, role_of, understood_unit

TABLES = (*TEXTS, *SUFFIXES)  # endings of the files of a folder that are read
_SHEET = ".sheet"  # ends the name of a table that is a sheet of a workbook
_LISTED = 4  # files named in a sentence


@dataclass(frozen=True, slots=True)
class _Part:
    """A file: its name, its table, its columns by key, and the conditions outside its columns."""

    name: str
    table: Table
    columns: Mapping[str, Column]
    conditions: Mapping[str, FileCondition]
    pair: Mapping[str, str]  # tool and work where its notes name them


def files_of_folder(folder: Path) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Files of a folder that may hold a table, by name with numbers in order, and the names of the others.

    Raises
    ------
    DataError
        There is none.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name in ("t10.csv", "t9.csv", "photo.jpg"): _ = (folder / name).write_text("V")
    >>> [path.name for path in files_of_folder(folder)[0]], files_of_folder(folder)[1]
    (['t9.csv', 't10.csv'], ('photo.jpg',))
    """
    try:
        entries = [path for path in folder.iterdir() if path.is_file() and path.name[0] not in ".~"]
    except OSError as error:
        raise DataError(f"{folder} cannot be read: {error.strerror}.") from error
    found = sorted((path for path in entries if path.suffix.lower() in TABLES), key=lambda path: _natural(path.name))
    if not found:
        raise DataError(f"{folder} holds no table: none of its files ends in {', '.join(TABLES[:4])} or .xlsx.")
    return tuple(found), tuple(sorted(path.name for path in entries if path not in found))


def joined_tables(tables: Sequence[Table], path: Path, others: Sequence[str] = ()) -> Table:
    r"""One table of several files: columns matched by role or name, values in the units of the first file.

    Without a column of edges a file whose time rises is one edge, named as the file. Conditions that a file does not
    have as a column are taken from its notes or its name.

    Parameters
    ----------
    tables : sequence of Table
    path : Path
        Whose name the table has.
    others : sequence of str
        Files that were not read.

    Raises
    ------
    DataError
        A file lacks a condition, the time or every measurement, or has another kind of unit.

    Examples
    --------
    >>> import tempfile
    >>> from fitmodels import datasets
    >>> folder = Path(tempfile.mkdtemp())
    >>> for V in (100, 150): _ = (folder / f"V{V}.csv").write_text("t [min],VB [mm]\n2,0.1\n4,0.2\n")
    >>> datasets.read_runs(folder).values("V").tolist()
    [100.0, 100.0, 150.0, 150.0]
    """
    parts = [_part(table) for table in tables]
    keys = list(dict.fromkeys(key for part in parts for key in part.columns))
    given = list(dict.fromkeys(role for part in parts for role in part.conditions if role not in keys))
    _refuse_misfits(parts, keys, given)
    doubts: list[Doubt] = []
    columns = [_stacked(key, parts, number, doubts) for number, key in enumerate(keys, start=1)]
    sentences = [f"{len(parts)} files are read as one table: {listed([part.name for part in parts], _LISTED)}"]
    if given:
        columns += [_stacked(role, parts, len(keys) + i, doubts) for i, role in enumerate(given, start=1)]
    sentences += _places(parts)
    doubts += _copies(columns, parts)
    columns, named = _with_edges(columns, parts)
    columns, pairs = _with_pairs(columns, parts)
    warnings = [f"Not read in {path.name}: {listed(list(others), _LISTED)}."] if others else []
    return Table(
        path=path,
        sha256=sha256("".join(f"{p.name}\0{p.table.sha256}\n" for p in parts).encode()).hexdigest(),
        columns=tuple(replace(column, number=i) for i, column in enumerate(columns, start=1)),
        lines=np.concatenate([part.table.lines for part in parts]),
        notes=tuple(_by_file(parts, "notes")),
        warnings=(*warnings, *_by_file(parts, "warnings")),
        dialect=parts[0].table.dialect,
        assumed=(*sentences, *named, *pairs, *_by_file(parts, "assumed")),
        doubts=(*(replace(d, sentence=f"{p.name}: {d.sentence}") for p in parts for d in p.table.doubts), *doubts),
    )


def joined_sheets(tables: Sequence[Table], titles: Sequence[str], path: Path) -> Table | None:
    """One table of the sheets of a workbook if each is the course of one edge or has a pair of its own, else None."""
    named = [replace(table, path=Path(f"{title}{_SHEET}")) for table, title in zip(tables, titles, strict=True)]
    parts = [_part(table) for table in named]
    one_edge_each = all(map(_is_one_edge, parts)) and all(map(_has_one_condition, parts))
    if not (one_edge_each or _have_own_pairs(parts)):
        return None
    try:
        joined = joined_tables(named, path)
    except DataError as refusal:
        raise DataError(f"{path.name}: {_of_sheets(str(refusal))}") from refusal
    return replace(
        joined,
        sha256=tables[0].sha256,
        sheets=tuple(titles),
        other_sheets=tuple(one for one in (*tables[0].sheets, *tables[0].other_sheets) if one not in titles),
        notes=tuple(dict.fromkeys(text for table in tables for text in table.notes if not text.startswith("Sheet "))),
        warnings=tuple(map(_of_sheets, joined.warnings)),
        assumed=tuple(map(_of_sheets, joined.assumed)),
        doubts=tuple(replace(doubt, sentence=_of_sheets(doubt.sentence)) for doubt in joined.doubts),
    )


def _of_sheets(text: str) -> str:
    return re.sub(r"\bfile(s?)\b", r"sheet\1", text).replace(_SHEET, "")


def _has_one_condition(part: _Part) -> bool:
    """Whether no condition varies within a file, as far as it has columns of them."""
    conditions = [c for key, c in part.columns.items() if key in ROLES and ROLES[key].kind == "condition"]
    return all(len(set(column.labels().tolist()) - {""}) <= 1 for column in conditions)


def _have_own_pairs(parts: Sequence[_Part]) -> bool:
    """Whether each file names a tool and work that no other file names."""
    pairs = [frozenset(product(*(_names_of(part, role) for role in UNNAMED))) for part in parts]
    return all(any(map(any, pair)) for pair in pairs) and sum(map(len, pairs)) == len(frozenset().union(*pairs))


def _names_of(part: _Part, role: str) -> frozenset[str]:
    """Names of tools or works in a file, by its column or its notes; one empty name without either."""
    column = part.columns.get(role)
    return frozenset([part.pair.get(role, "")] if column is None else column.labels().tolist())


def _part(table: Table) -> _Part:
    columns: dict[str, Column] = {}
    for column in table.columns:
        header = parse_header(column.name)
        text = column.unit_cell or header.unit_text
        role = role_of(header.name, canonical(text) if text else None)
        key = role if role and role not in columns else " ".join(column.name.casefold().split())
        columns[key if key not in columns else f"{key} (column {column.number})"] = column
    notes = tuple(note.lstrip("#% ") for note in table.notes)
    found = {one.role: one for one in conditions_of_file(table.path.name, notes) if one.role not in columns}
    names = {role: pair_name(role, pd.DataFrame(), notes) for role in UNNAMED if role not in columns}
    return _Part(table.path.name, table, columns, found, {r: n for r, n in names.items() if n != UNNAMED[r]})


def _refuse_misfits(parts: Sequence[_Part], keys: Sequence[str], given: Sequence[str]) -> None:
    """Refuse a file that lacks what a law needs of every file."""
    needed = [key for key in keys if key in ROLES and (ROLES[key].kind == "condition" or key == "t")] + list(given)
    for part in parts:
        lacking = [role for role in needed if role not in part.columns and role not in part.conditions]
        measured = any(key in ROLES and (ROLES[key].kind in MEASURED or key == "T") for key in part.columns)
        if not measured and any(key in ROLES for key in keys):
            raise DataError(
                f"{part.name} holds no wear, force, power or roughness, and the files of a folder are read as one "
                "table: move it elsewhere, or read the other files alone."
            )
        if lacking:
            role = ROLES[lacking[0]]
            holder = next(p.name for p in parts if lacking[0] in p.columns or lacking[0] in p.conditions)
            raise DataError(
                f"{part.name} has no {role.quantity} {role.symbol}, which {holder} has: add the column, write a line "
                f"'# {role.symbol} = ... {role.unit}' above its table, or move the file elsewhere."
            )


def _stacked(key: str, parts: Sequence[_Part], number: int, doubts: list[Doubt]) -> Column:
    """The column of this key in all files, in the unit of the first file that names one."""
    own = [_own(key, part) for part in parts]
    first = next(column for column in own if column is not None)
    header = parse_header(first.name)
    unit = next((unit for column in own if column is not None and (unit := _unit(column))), "")
    role = ROLES.get(key)
    numeric = all(column is None or column.is_numeric or not _filled(column) for column in own)
    values: list[Array | Texts] = []
    marks: list[tuple[int, Any]] = []
    bad: list[tuple[int, str]] = []
    unitless: list[str] = []
    at = 0
    for part, column in zip(parts, own, strict=True):
        n = part.table.n_rows
        if column is None or (numeric and not column.is_numeric):
            values.append(np.full(n, np.nan) if numeric else np.full(n, "", dtype=object))
        elif not numeric:
            values.append(column.labels())
        else:
            values.append(_in_unit(column, unit, part.name, key))
            if role is not None and role.unit and unit and not _unit(column) and key in part.columns:
                unitless.append(part.name)
        if column is not None and numeric:
            marks += ((at + row, replace(mark, unit=mark.unit or _unit(column))) for row, mark in column.marks)
            bad += ((line, f"{text} ({part.name})") for line, text in column.bad)
        at += n
    if unitless and canonical(unit) != role_unit(role):
        doubts.append(
            Doubt(
                (key,),
                f"{key} has no unit in {listed(unitless, _LISTED)} and is taken in {unit}, as in the other files",
            )
        )
    every = np.concatenate(values)
    count = sum(column.bad_count for column in own if column is not None)
    name = first.name if not unit or _unit(first) else f"{header.name} [{unit}]"
    cell = first.unit_cell
    return Column(number, name, cell, every, numeric, tuple(bad[:5]), count if numeric else 0, tuple(marks))


def role_unit(role: Any) -> str:  # noqa: ANN401  a Role or None
    """Unit of a role, "" without one.

    >>> role_unit(ROLES["V"]), role_unit(None)
    ('m/min', '')
    """
    return role.unit if role is not None else ""


def _own(key: str, part: _Part) -> Column | None:
    """The column of a file, or one made of a condition in its notes or name."""
    if key in part.columns:
        return part.columns[key]
    condition = part.conditions.get(key)
    if condition is None:
        return None
    return Column(0, condition.role, condition.unit, np.full(part.table.n_rows, condition.value), True)


def _unit(column: Column) -> str:
    return column.unit_cell or parse_header(column.name).unit_text


def _filled(column: Column) -> bool:
    return bool(len(column.values)) and bool(set(column.labels()) - {""})


def _in_unit(column: Column, unit: str, name: str, key: str) -> Array:
    """The numbers of a column in another unit."""
    own = _unit(column)
    values = np.asarray(column.values, dtype=float)
    if not own or not unit or own == unit:
        return values
    known, wanted = (understood_unit(key, text) if key in ROLES else canonical(text) for text in (own, unit))
    if known == wanted:
        return values
    if known is None or wanted is None or not same_dimension(known, wanted):
        raise DataError(
            f"{name}: column {column.name!r} is in {own}, in the other files in {unit}: correct the unit in its header."
        )
    return convert(values, known, wanted)


def _copies(columns: Sequence[Column], parts: Sequence[_Part]) -> list[Doubt]:
    """A doubt on each file half of whose rows, or more, stand in an earlier file too."""
    frame = pd.DataFrame({str(i): np.asarray(one.values) for i, one in enumerate(columns) if one.is_numeric})
    again = frame.duplicated(keep="first").to_numpy() & (frame.notna().sum(axis=1).to_numpy() > 1)
    doubts, at = [], 0
    for part in parts:
        n = part.table.n_rows
        own = frame.iloc[at : at + n].duplicated(keep="first").to_numpy()
        count = int(np.count_nonzero(again[at : at + n] & ~own))
        if count >= 2 and 2 * count >= n:
            names = tuple(key for key in part.columns if key in ROLES)
            sentence = (
                f"{part.name}: {count} of its {n} rows stand in a file before it too, with the same numbers; remove "
                "the copy from the folder, or these rows count twice"
            )
            doubts.append(Doubt(names, sentence))
        at += n
    return doubts


def _with_edges(columns: list[Column], parts: Sequence[_Part]) -> tuple[list[Column], list[str]]:
    """Edges named by their file where no column names them, or where files use the same names for other edges."""
    sizes = [part.table.n_rows for part in parts]
    files = np.repeat(np.array([Path(part.name).stem for part in parts], dtype=object), sizes)
    if len(set(files.tolist())) < len(parts) and all(sizes):
        files = np.repeat(np.array([part.name for part in parts], dtype=object), sizes)
    place = next(
        (i for i, column in enumerate(columns) if role_of(parse_header(column.name).name, None) == "edge"), None
    )
    if place is None:
        if not all(map(_is_one_edge, parts)):
            return [*columns, Column(0, "file", "", files, False)], []
        return [*columns, Column(0, "edge", "", files, False)], ["each file is one cutting edge, named as the file"]
    labels = columns[place].labels()
    if not _names_recur(labels, files, parts):
        return columns, []
    texts = np.array(
        [f"{file}: {label}" if label else "" for file, label in zip(files, labels, strict=True)], dtype=object
    )
    columns = [*columns]
    columns[place] = replace(columns[place], values=texts, is_numeric=False, bad=(), bad_count=0, marks=())
    return columns, ["files number their edges alike: edges are distinguished by file"]


def _is_one_edge(part: _Part) -> bool:
    """Whether the rows of a file may be the course of one edge: its time rises, or its conditions are constant."""
    time = part.columns.get("t")
    if time is not None and time.is_numeric:
        times = np.asarray(time.values, dtype=float)
        return bool(np.all(np.diff(times[np.isfinite(times)]) > 0))
    return all(
        len(np.unique(column.values)) <= 1
        for key, column in part.columns.items()
        if key in ROLES and ROLES[key].kind == "condition" and column.is_numeric
    )


def _names_recur(labels: Texts, files: Texts, parts: Sequence[_Part]) -> bool:
    """Whether a name of an edge occurs in two files without its time going on from one to the next."""
    ends: dict[str, tuple[object, float]] = {}
    every = np.concatenate([_times(part) for part in parts])
    for label, file, time in zip(labels.tolist(), files.tolist(), every.tolist(), strict=True):
        if not label:
            continue
        seen = ends.get(label)
        if seen is not None and seen[0] != file and not time > seen[1]:
            return True
        ends[label] = (file, time)
    return False


def _times(part: _Part) -> Array:
    """Times of a file, zero where it has none."""
    time = part.columns.get("t")
    return np.asarray(time.values, dtype=float) if time and time.is_numeric else np.zeros(part.table.n_rows)


def _with_pairs(columns: list[Column], parts: Sequence[_Part]) -> tuple[list[Column], list[str]]:
    """Columns of tool and work where the notes of the files name different ones."""
    added, sentences = [], []
    for role in UNNAMED:
        names = [part.pair.get(role, "") for part in parts]
        if len(set(names)) < 2 or any(role in part.columns for part in parts):
            continue
        texts = np.repeat(np.array(names, dtype=object), [part.table.n_rows for part in parts])
        added.append(Column(0, role, "", texts, False))
        known = listed(list(dict.fromkeys(filter(None, names))), _LISTED)
        sentences.append(f"{role} is read from the notes of each file: {known}")
    return [*columns, *added], sentences


def _places(parts: Sequence[_Part]) -> list[str]:
    """Sentences on the conditions that stand in notes or names of the files."""
    found: dict[tuple[str, str], list[str]] = {}
    for part in parts:
        for one in part.conditions.values():
            found.setdefault((one.role, one.place), []).append(f"{one.value:g}")
    by_place: dict[str, list[str]] = {}
    for (role, place), values in found.items():
        ends = sorted(set(values), key=float)
        words = f"{role} {ends[0]}" + (f" to {ends[-1]}" if len(ends) > 1 else "")
        by_place.setdefault(place, []).append(words)
    plural = {"note": "notes", "name of the file": "names"}
    return [f"from the {plural[place]} of the files: {', '.join(words)}" for place, words in by_place.items()]


def _by_file(parts: Sequence[_Part], name: str) -> list[str]:
    """Sentences of the files: once where all files have them, else with the name of the file."""
    everywhere = set.intersection(*(set(getattr(part.table, name)) for part in parts))
    out: dict[str, None] = {}
    for part in parts:
        for text in getattr(part.table, name):
            out[text if text in everywhere else f"{part.name}: {text.lstrip('#% ')}"] = None
    return list(out)


def _natural(name: str) -> list[tuple[int, int | str]]:
    return [(0, int(text)) if text.isdecimal() else (1, text.casefold()) for text in re.split(r"(\d+)", name) if text]
