"""Files of a Parquet source, and their columns, from the schema and a few rows of the first file."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pandas as pd

from ...core.errors import DataError, UsageError
from ...core.suggestions import did_you_mean
from ...datasets.columns import LARGEST, ColumnUse
from ...datasets.derived.derivation import SUMMED
from ...datasets.derived.rules import Derived
from ...datasets.design import decode_levels
from ...datasets.options import ReadOptions
from ...datasets.reading import runs_of_sample
from ...datasets.vocabulary import ROLES, UNNAMED
from ..plan import Reading
from .common import PARQUET
from .parquet_arrow import UNREADABLE, kind_of, numbers, pq, text_of

NOTHING = "__HIVE_DEFAULT_PARTITION__"  # how Hive and Spark name the folder of rows without a value
FILE_NAME = "file name"  # header of the tool of all rows of a file, taken from its name


@dataclass(frozen=True, slots=True)
class ParquetFile:
    """A file of the source; ``partition`` are header and value of its folders, url-decoded."""

    path: Path
    name: str
    stamp: str
    partition: tuple[tuple[str, str], ...]


def parquet_files(source: Path, without: Path) -> tuple[ParquetFile, ...]:
    """Files of a source in the order of their names, those in the folder ``without`` and hidden ones left out.

    Raises
    ------
    DataError
        There is none.
    """
    source = source.resolve()
    if source.is_file():
        return (ParquetFile(source, source.name, stamp_of(source), ()),)
    found = sorted(_inside(source, without.resolve()), key=lambda path: path.relative_to(source).parts)
    if not found:
        raise DataError(f"{source.name} holds no Parquet file ({', '.join(PARQUET)}) at any depth.")
    names = [path.relative_to(source) for path in found]
    return tuple(
        ParquetFile(path, name.as_posix(), stamp_of(path), hive(name.parts[:-1]))
        for path, name in zip(found, names, strict=True)
    )


def _inside(source: Path, without: Path) -> Iterator[Path]:
    for path in source.rglob("*"):
        hidden = any(part.startswith((".", "_")) for part in path.relative_to(source).parts)
        if not hidden and path.suffix.lower() in PARQUET and path.is_file() and without not in path.parents:
            yield path


def stamp_of(path: Path) -> str:
    """Size and time of change, which show that a file was written again."""
    status = path.stat()
    return f"{status.st_size}:{status.st_mtime_ns}"


def hive(folders: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """Headers and values of folders named ``header=value``.

    >>> hive(("2024", "tool=GC%204325", "work=__HIVE_DEFAULT_PARTITION__"))
    (('tool', 'GC 4325'), ('work', ''))
    """
    matches = (re.fullmatch(r"([^=]+)=(.*)", folder) for folder in folders)
    return tuple((unquote(m[1]), "" if m[2] == NOTHING else unquote(m[2])) for m in matches if m)


def names_of_files(files: tuple[ParquetFile, ...]) -> tuple[str, ...]:
    """The stem of each file, or its path without the ending where two have the same stem."""
    stems = tuple(file.path.stem for file in files)
    if len(set(stems)) == len(stems):
        return stems
    return tuple(str(Path(file.name).with_suffix("").as_posix()) for file in files)


@lru_cache(maxsize=8)
def footer(path: str, stamp: str) -> Any:  # noqa: ANN401  the stamp is part of the key
    """Metadata of a file; cached, since several blocks read from one file."""
    return pq.read_metadata(path)


FEW = 500  # rows from which columns are interpreted


@dataclass(frozen=True, slots=True)
class SourceColumns:
    """Columns that are read from every file.

    Attributes
    ----------
    first : ParquetFile
        The file from whose schema the columns are interpreted.
    columns : tuple of ColumnUse
        Its columns, then those of folders, then the file's name where that is the tool.
    kinds : mapping of str to str
        Kind of each column of the first file.
    assumed : tuple of str
    derived : tuple of Derived
        Quantities that are computed from these columns.
    """

    first: ParquetFile
    columns: tuple[ColumnUse, ...]
    kinds: Mapping[str, str]
    assumed: tuple[str, ...]
    derived: tuple[Derived, ...] = ()


def needed_columns(columns: tuple[ColumnUse, ...], reading: Reading) -> tuple[ColumnUse, ...]:
    """Columns that are read: those with a role, but a name that was given, and those of the groups."""
    given = {"tool": reading.tool, "work": reading.work}
    groups = {group_column(columns, name).number for name in reading.groups}
    return tuple(
        use for use in columns if (use.role is not None and given.get(use.role) is None) or use.number in groups
    )


def group_column(columns: tuple[ColumnUse, ...], name: str) -> ColumnUse:
    """The column of this header, or of this name without a unit."""
    for use in columns:
        if name in (use.header, use.name):
            return use
    hint = did_you_mean(name, [use.header for use in columns], names="There are ")
    raise UsageError(f"no column {name!r} to group the pairs by. {hint}")


def interpret_columns(
    first: ParquetFile, files: tuple[ParquetFile, ...], reading: Reading, notes: tuple[str, ...] = ()
) -> SourceColumns:
    """Roles, units, assumptions, and what is computed from the columns and the constants of the notes.

    Raises
    ------
    DataError, UsageError
        As `datasets.read_runs` raises them; a group that is no column.
    """
    frame, kinds = _few_rows(first)
    for key in dict(first.partition):
        if key not in frame:
            frame[key] = _folder_values(key, files, len(frame))
    frame, coded = _without_codes(frame, reading)
    frame.attrs["notes"] = notes
    how = replace(reading, ranges={}, tool="-", work="-")
    runs = runs_of_sample(frame, how)
    columns, assumed = runs.columns, (*coded, *runs.assumed, *(f"{doubt} (by the first rows)" for doubt in runs.doubts))
    roles = {use.role for use in columns}
    if len(files) > 1 and not roles & {"tool", "work"} and reading.tool is None:
        columns += (ColumnUse(len(columns) + 1, FILE_NAME, FILE_NAME, "tool", "", False, None),)
        assumed += (f"the source names no tool: each file is one, named after it ({names_of_files(files)[0]} ...)",)
    assumed += tuple(
        f"{role}: not named in the source, called {name}; name it with --{role}"
        for role, name in UNNAMED.items()
        if getattr(reading, role) is None and role not in {use.role for use in columns}
    )
    found = SourceColumns(first, columns, kinds, assumed, _row_by_row(runs.derived))
    needed_columns(columns, reading)
    return found


def _row_by_row(derived: tuple[Derived, ...]) -> tuple[Derived, ...]:
    """Quantities computed from the columns; sums along an edge, which need its rows together, are refused."""
    for one in derived:
        if one.equation.endswith(SUMMED):
            raise DataError(
                f"{one.sentence}: rows of so large a source are not summed. Write the time in cut as a column t, or "
                f"leave the length out with --map {one.inputs[0]}=none."
            )
    return derived


def _few_rows(file: ParquetFile) -> tuple[pd.DataFrame, dict[str, str]]:
    """The first rows as headers and cells of a small table; none where their pages cannot be read."""
    known = footer(str(file.path), file.stamp)
    schema = known.schema.to_arrow_schema()
    twice = [name for name in schema.names if schema.names.count(name) > 1]
    if twice:
        raise DataError(f"{file.name}: two columns are called {twice[0]!r}; rename one.")
    try:
        with pq.ParquetFile(file.path, metadata=known, page_checksum_verification=True) as opened:
            batch = next(opened.iter_batches(batch_size=FEW, use_threads=False), None)
    except UNREADABLE:
        batch = None
    table = schema.empty_table().to_batches() if batch is None else [batch]
    kinds = {field.name: kind_of(field.type) for field in schema}
    columns = {
        name: _cells(table[0].column(i) if table else None, kind) for i, (name, kind) in enumerate(kinds.items())
    }
    return pd.DataFrame(columns), kinds


def _cells(array: Any, kind: str) -> "pd.Series[Any]":  # noqa: ANN401
    if kind not in ("number", "nothing"):
        texts = [] if array is None else [text_of(value) for value in array.to_pylist()]
        return pd.Series(texts, dtype=object)
    values = np.zeros(0) if array is None else numbers(array)
    measurable = (np.abs(values) <= LARGEST) & ((np.abs(values) >= 1 / LARGEST) | (values == 0))
    return pd.Series(np.where(measurable, values, np.nan))  # the fit of a pair reports its impossible numbers


def _folder_values(key: str, files: tuple[ParquetFile, ...], n: int) -> "pd.Series[Any]":
    """Values of folders under a key, as numbers where all are numbers."""
    values = [dict(file.partition).get(key, "") for file in files]
    if all(is_number(value) for value in values):
        return pd.Series(np.full(n, number_of(values[0])))
    return pd.Series([values[0]] * n, dtype=object)


def is_number(text: str) -> bool:
    """Whether the value of a folder is a number or empty."""
    try:
        number_of(text)
    except ValueError:
        return False
    return True


def number_of(text: str) -> float:
    """The value of a folder as a number, NaN where it is empty."""
    return float(text) if text else float("nan")


def _without_codes(frame: pd.DataFrame, reading: Reading) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The frame without numbers in columns that have a range, and how these are interpreted."""
    if not reading.ranges:
        return frame, ()
    blank = pd.DataFrame({name: _blank(frame[name]) for name in frame})
    runs = runs_of_sample(blank, ReadOptions(map=reading.columns, units=reading.units, tool="-", work="-"))
    frame, assumed = frame.copy(), tuple[str, ...]()
    for role, given in reading.ranges.items():
        header = next((use.header for use in runs.columns if use.role == role), None)
        if header is None:
            raise UsageError(f"--range {role}: no column has the role {role}; there are {', '.join(runs.units)}.")
        codes = frame[header].to_numpy(dtype=float)
        if np.nanmax(np.abs(codes), initial=0) > 3 or np.nanmin(codes, initial=0) == 0 < np.nanmax(codes, initial=0):
            raise UsageError(f"--range {role}: the column holds no coded levels (-1, 0, 1); leave the range out.")
        assumed += decode_levels(role, np.array([-1.0, 0.0, 1.0]), given)[1]
        frame[header] = np.nan
    return frame, tuple(assumed)


def _blank(cells: "pd.Series[Any]") -> "pd.Series[Any]":
    return cells if cells.dtype == object or not pd.api.types.is_numeric_dtype(cells) else cells * np.nan


def mismatch(file: ParquetFile, schema: Any, known: SourceColumns, reading: Reading) -> str | None:  # noqa: ANN401
    """Reason why a file cannot be read like the first one, None where it can."""
    return next(_mismatches(file, schema, known, reading), None)


def _mismatches(file: ParquetFile, schema: Any, known: SourceColumns, reading: Reading) -> Iterator[str]:  # noqa: ANN401
    partition = dict(file.partition)
    for use in needed_columns(known.columns, reading):
        is_numeric = use.role is not None and ROLES[use.role].kind != "label"
        if use.header == FILE_NAME and use.header not in known.kinds:
            continue
        if use.header in known.kinds:
            yield from _column_mismatch(file, schema, known, use, is_numeric)
        elif use.header not in partition:
            yield f"{file.name}: no folder above it is named {use.header}=..., as one above {known.first.name} does."
        elif is_numeric and not is_number(partition[use.header]):
            yield f"{file.name}: its folder is named {use.header}={partition[use.header]}, which is not a number."


def _column_mismatch(
    file: ParquetFile, schema: Any, known: SourceColumns, use: ColumnUse, is_numeric: bool  # noqa: ANN401
) -> Iterator[str]:  # fmt: skip
    where = schema.get_all_field_indices(use.header)
    if len(where) != 1:
        has = f"has {len(where)} columns {use.header!r}" if where else f"has no column {use.header!r}"
        yield f"{file.name}: {has}, and {known.first.name} has one; write all files with the same columns."
        return
    here, there = kind_of(schema.field(where[0]).type), known.kinds[use.header]
    expected = "number" if there == "nothing" and is_numeric else there
    if here not in ("nothing", expected) and expected != "nothing":
        yield (
            f"{file.name}: column {use.header!r} holds {schema.field(where[0]).type}, and in {known.first.name} "
            f"a {there}; write all files with the same types."
        )
