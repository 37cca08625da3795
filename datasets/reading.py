"""Read a laboratory file or a DataFrame as `Runs`: columns get roles and units, every assumption is recorded."""

import os
import re
from collections.abc import Mapping
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.errors import DataError, UsageError
from .columns import NONE, ColumnUse, Values, assign
from .design import decode_levels
from .runs import UNNAMED, Runs, Source
from .tables import Column, Table, read_table
from .units import is_unit
from .vocabulary import ROLES


def read_runs(
    path: str | os.PathLike[str] | Table,
    *,
    map: Mapping[str, str] | None = None,  # noqa: A002  the option of the command is --map
    units: Mapping[str, str] | None = None,
    ranges: Mapping[str, tuple[float, ...]] | None = None,
    tool: str | None = None,
    work: str | None = None,
    decimal: Literal["point", "comma"] | None = None,
    delimiter: str | None = None,
    sheet: str | None = None,
) -> Runs:
    """Read a wear-test file: text of any dialect, or .xlsx.

    Parameters
    ----------
    path : path of the file, or a Table that was read from it
    map : mapping of role symbol to column header (or ``col7``), which overrides the headers
    units : mapping of role symbol to unit, for columns whose unit is not in the file
    ranges : mapping of role symbol to (low, high) or (low, centre, high), for columns in coded levels
    tool, work : names of the pair, where the file does not hold them
    decimal, delimiter, sheet : see :func:`fitmodels.datasets.read_table`

    Raises
    ------
    DataError
        The file cannot be read, two columns claim one role, a unit does not fit, or a cell is not a number.
    UsageError
        ``map``, ``units`` or ``ranges`` name a role or column that does not exist.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> len(datasets.read_runs(datasets.bundled("ac2017_table1")))
    16
    """
    table = path
    if not isinstance(table, Table):
        table = read_table(table, is_unit=is_unit, decimal=decimal, delimiter=delimiter, sheet=sheet)
    source = Source(table.path.name, table.sha256, table.n_rows, table.dialect.describe())
    notes = tuple(note.lstrip("#% ") for note in table.notes)
    return _assemble(
        table.columns, table.lines, source, notes, table.warnings,
        mapping=map or {}, units=units or {}, ranges=ranges or {}, tool=tool, work=work,
    )  # fmt: skip


def runs_from_frame(
    frame: pd.DataFrame,
    *,
    map: Mapping[str, str] | None = None,  # noqa: A002
    units: Mapping[str, str] | None = None,
    tool: str | None = None,
    work: str | None = None,
) -> Runs:
    """Runs from a DataFrame; its column names are read like headers of a file.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> frame = pd.DataFrame({"vc [m/s]": [1.0, 2.0], "AW": [0.1, 0.2]})
    >>> datasets.runs_from_frame(frame).values("V").tolist()
    [60.0, 120.0]
    """
    columns = tuple(_column_of(i, str(name), frame.iloc[:, i]) for i, name in enumerate(frame.columns))
    source = Source("DataFrame", "", len(frame), "in memory")
    return _assemble(
        columns, np.arange(len(frame)), source, (), (),
        mapping=map or {}, units=units or {}, ranges={}, tool=tool, work=work,
    )  # fmt: skip


def _column_of(position: int, name: str, series: "pd.Series[float]") -> Column:
    numeric = pd.api.types.is_numeric_dtype(series) and not pd.api.types.is_bool_dtype(series)
    texts = [] if numeric else ["" if missing else str(v) for v, missing in zip(series, series.isna(), strict=True)]
    values = series.to_numpy(dtype=float, na_value=np.nan) if numeric else np.array(texts, dtype=object)
    if numeric and np.isinf(values).any():
        row = int(np.flatnonzero(np.isinf(values))[0])
        raise DataError(f"column {name!r} row {row}: {values[row]} is not a measurement; leave the row out.")
    return Column(position + 1, name, "", values, numeric, ())


def _assemble(
    columns: tuple[Column, ...],
    lines: NDArray[np.intp],
    source: Source,
    notes: tuple[str, ...],
    warnings: tuple[str, ...],
    *,
    mapping: Mapping[str, str],
    units: Mapping[str, str],
    ranges: Mapping[str, tuple[float, ...]],
    tool: str | None,
    work: str | None,
) -> Runs:
    uses, data, assumed = assign(columns, mapping, units)
    roled = {role: ROLES[role].unit for role in data if ROLES[role].unit}
    assumed = (*with_thrust(data, roled, mapping), *_decoded(data, ranges), *assumed)
    data |= _without_role(columns, uses, data)
    given = {"tool": tool, "work": work}
    frame = pd.DataFrame({name: v for name, v in data.items() if given.get(name) is None})
    named = {role: given[role] or pair_name(role, frame, notes) for role in given}
    assumed += tuple(
        f"{role}: not named in the file, called {name}; name it with --{role}"
        for role, name in named.items()
        if name == UNNAMED[role]
    )
    return Runs(frame, roled, uses, lines, source, named["tool"], named["work"], assumed, warnings, notes)


def with_thrust(data: dict[str, Values], units: dict[str, str], mapping: Mapping[str, str]) -> tuple[str, ...]:
    """Add Fxz to Fx and Fz in place, unless it is present or unwanted; returns the note on it.

    >>> with_thrust({"Fx": np.array([3.0]), "Fz": np.array([4.0])}, {}, {})
    ("Fxz is computed from the file's Fx and Fz: sqrt(Fx^2 + Fz^2)",)
    """
    if "Fxz" in data or not {"Fx", "Fz"} <= set(data) or mapping.get("Fxz", "").strip().lower() == NONE:
        return ()
    data["Fxz"] = np.hypot(data["Fx"].astype(float), data["Fz"].astype(float))
    units["Fxz"] = ROLES["Fxz"].unit
    return ("Fxz is computed from the file's Fx and Fz: sqrt(Fx^2 + Fz^2)",)


def _decoded(data: dict[str, Values], ranges: Mapping[str, tuple[float, ...]]) -> tuple[str, ...]:
    """Convert coded levels to conditions in place; returns the assumptions."""
    absent = [role for role in ranges if role not in data]
    if absent:
        raise UsageError(f"--range {absent[0]}: no column has the role {absent[0]}; there are {', '.join(data)}.")
    assumed: tuple[str, ...] = ()
    for role, values in data.items():
        if ROLES[role].kind == "condition" or role in ranges:
            data[role], how = decode_levels(role, values, ranges.get(role))
            assumed += how
    return assumed


def _without_role(
    columns: tuple[Column, ...], uses: tuple[ColumnUse, ...], data: Mapping[str, Values]
) -> dict[str, Values]:
    """The other columns under their headers, or as ``col7`` where that name is a symbol or is taken."""
    out: dict[str, Values] = {}
    for column, use in zip(columns, uses, strict=True):
        if use.role is None:
            taken = not column.name or column.name in ROLES or column.name in data or column.name in out
            out[f"col{column.number}" if taken else column.name] = column.values  # noqa: PD011  a Column, not a Series
    return out


def pair_name(role: str, frame: pd.DataFrame, notes: tuple[str, ...]) -> str:
    """Name of tool or work: from its column, from a note ``tool: GC435``, or the placeholder.

    >>> pair_name("tool", pd.DataFrame(), ("Werkzeug: GC435",))
    'GC435'
    """
    if role in frame:
        names = [name for name in dict.fromkeys(frame[role]) if name]
        return names[0] if len(names) == 1 else "several" if names else UNNAMED[role]
    words = "|".join(re.escape(name) for name in (role, *ROLES[role].names))
    for note in notes:
        if match := re.match(rf"\s*(?:{words})\s*[:;,|=\t]\s*(.*\S)", note, flags=re.IGNORECASE):
            name = match[1].strip(" ;,|\t:")
            if name:
                return name
    return UNNAMED[role]
