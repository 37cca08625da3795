"""A lab file becomes Runs: columns with roles and units, one row a measurement, nothing guessed in silence."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .coded import decode
from .columns import ColumnUse, assign
from .errors import DataError, UsageError
from .table import Column, read_table
from .units import is_unit
from .vocabulary import ROLES

Array = NDArray[np.float64]
UNNAMED = {"tool": "unnamed-tool", "work": "unnamed-work"}


@dataclass(frozen=True, slots=True)
class Source:
    """Where the numbers came from: file name, SHA-256 of its bytes, rows, and how it was written."""

    name: str
    sha256: str
    rows: int
    dialect: str


@dataclass(frozen=True, slots=True)
class Runs:
    """Measurements of cutting tests, in the units of the field.

    Attributes
    ----------
    data : DataFrame
        A column for each role, under its symbol (V, f, d, t, AW, Fx ...), in the unit of ``units``; labels
        (edge, tool, work) as text; columns without a role under their own header.
    units : mapping
        Unit of each role's column.
    columns : tuple of ColumnUse
        What became of each column of the file.
    lines : ndarray of int, shape (n,)
        Line of each row in the file.
    source : Source
    tool, work : str
        Names of the pair; ``several`` where a column names more than one.
    assumed, warnings, notes : tuple of str
        What was taken for granted, what was left out or mended, and the free text of the file.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> runs.tool, runs.units["V"], runs.simulated
    ('GC435', 'm/min', True)
    """

    data: pd.DataFrame
    units: Mapping[str, str]
    columns: tuple[ColumnUse, ...]
    lines: NDArray[np.intp]
    source: Source
    tool: str
    work: str
    assumed: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.data)

    @property
    def simulated(self) -> bool:
        """Whether the file says of itself that it is simulated or computed, not measured."""
        text = " ".join(self.notes).lower()
        return any(word in text for word in ("simulated", "simulation", "simuliert", "no measurement"))

    def has(self, name: str) -> bool:
        """Whether a role or column of this name is there."""
        return self._column(name) is not None

    def values(self, name: str) -> Array:
        """Numbers of a role or column, shape (n,), NaN where missing."""
        column = self._known(name)
        if not pd.api.types.is_numeric_dtype(self.data[column]):
            raise UsageError(f"column {name!r} holds text; a law needs numbers.")
        return self.data[column].to_numpy(dtype=float)

    def labels(self, name: str) -> NDArray[np.object_]:
        """Texts of a role or column, shape (n,), empty where missing; whole numbers as ``1``, not ``1.0``."""
        series = self.data[self._known(name)]
        if not pd.api.types.is_numeric_dtype(series):
            return series.to_numpy(dtype=object)
        return np.array(
            ["" if np.isnan(v) else f"{v:.15g}" for v in series.to_numpy(dtype=float)], dtype=object
        )

    def pairs(self) -> Iterator["Runs"]:
        """The runs of each tool/work pair, in the order in which the file names them."""
        keys = [role for role in ("tool", "work") if role in self.data]
        if not keys:
            yield self
            return
        texts = {role: pd.Series(self.labels(role), index=self.data.index) for role in keys}
        texts = {role: text.where(text != "", UNNAMED[role]) for role, text in texts.items()}
        for _, group in pd.DataFrame(texts).groupby(keys, sort=False):
            rows = self.data.index.get_indexer(group.index)
            tool, work = (
                str(group[role].iloc[0]) if role in group else getattr(self, role) for role in UNNAMED
            )
            yield replace(self, data=self.data.iloc[rows], lines=self.lines[rows], tool=tool, work=work)

    def join(self, other: "Runs") -> "Runs":
        """Runs of both, as if they stood in one file; only columns that both hold are kept."""
        shared = [name for name in self.data if name in other.data]
        if not shared:
            raise UsageError(f"{self.source.name} and {other.source.name} have no column in common.")
        data = pd.concat([self.data[shared], other.data[shared]], ignore_index=True)
        source = replace(self.source, name=f"{self.source.name} + {other.source.name}", rows=len(data))
        return replace(
            self,
            data=data,
            units={name: unit for name, unit in self.units.items() if name in shared},
            lines=np.concatenate([self.lines, other.lines]),
            source=source,
            notes=(*self.notes, *other.notes),
            assumed=tuple(dict.fromkeys((*self.assumed, *other.assumed))),
            warnings=(*self.warnings, *other.warnings),
        )

    def _column(self, name: str) -> str | None:
        if name in self.data:
            return name
        return next((use.role for use in self.columns if use.name == name and use.role in self.data), None)

    def _known(self, name: str) -> str:
        column = self._column(name)
        if column is None:
            raise UsageError(f"no column {name!r}; there are {', '.join(map(str, self.data.columns))}.")
        return column


def read_runs(
    path: str | os.PathLike[str],
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
    path : path of the file
    map : mapping of role symbol to column header (or ``col7``), which overrides what the headers say
    units : mapping of role symbol to unit, for columns whose unit is not in the file
    ranges : mapping of role symbol to (low, high) or (low, centre, high), for columns in coded levels
    tool, work : names of the pair, where the file does not hold them
    decimal, delimiter, sheet : see :func:`fitmodels.datasets.read_table`

    Raises
    ------
    DataError
        The file cannot be read, two columns claim one role, a unit does not fit, or a cell is no number.
    UsageError
        ``map``, ``units`` or ``ranges`` name a role or column that does not exist.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> len(datasets.read_runs(datasets.bundled("ac2017_table1")))
    16
    """
    table = read_table(path, is_unit=is_unit, decimal=decimal, delimiter=delimiter, sheet=sheet)
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
    """Runs from a DataFrame whose column names are read as headers of a file are.

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
    values = series.to_numpy(dtype=float) if numeric else series.fillna("").astype(str).to_numpy(dtype=object)
    if numeric and np.isinf(values).any():
        row = int(np.flatnonzero(np.isinf(values))[0])
        raise DataError(f"column {name!r} row {row}: {values[row]} is no measurement; leave the row out.")
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
    for role, values in data.items():
        if ROLES[role].kind == "condition" or role in ranges:
            data[role], said = decode(role, values, ranges.get(role))
            assumed += said
    assumed = (*_computed(data), *assumed)
    roles = {use.number: use.role for use in uses}
    for column in columns:
        if roles[column.number] is None:
            data.setdefault(column.name or f"col{column.number}", column.values)
    frame = pd.DataFrame(data)
    given = {"tool": tool, "work": work}
    for role, name in given.items():
        if name is not None and role in frame:
            frame = frame.drop(columns=role)
    named = {role: _pair_name(role, given[role], frame, notes) for role in given}
    assumed += tuple(
        f"{role}: not named in the file, called {name}; name it with --{role}"
        for role, name in named.items()
        if name == UNNAMED[role]
    )
    roled = {role: ROLES[role].unit for role in data if role in ROLES and ROLES[role].unit}
    return Runs(frame, roled, uses, lines, source, named["tool"], named["work"], assumed, warnings, notes)


def _computed(data: dict[str, NDArray[np.float64] | NDArray[np.object_]]) -> tuple[str, ...]:
    if "Fxz" in data or "Fx" not in data or "Fz" not in data:
        return ()
    data["Fxz"] = np.hypot(data["Fx"].astype(float), data["Fz"].astype(float))
    return ("Fxz is computed from the file's Fx and Fz: sqrt(Fx^2 + Fz^2)",)


def _pair_name(role: str, given: str | None, frame: pd.DataFrame, notes: tuple[str, ...]) -> str:
    """Name of tool or work: as given, from its column, from a note ``tool: GC435``, or the stand-in."""
    if given is not None:
        return given
    if role in frame:
        column = frame[role]
        names = [
            f"{v:.15g}" if isinstance(v, float) else str(v) for v in column.unique() if v not in ("", None)
        ]
        names = [name for name in names if name != "nan"]
        return names[0] if len(names) == 1 else "several" if names else UNNAMED[role]
    words = {name.lower() for name in (role, *ROLES[role].names)}
    for note in notes:
        head, colon, tail = note.lstrip("#% ").replace(";", ":", 1).replace("\t", ":", 1).partition(":")
        if colon and head.strip().lower() in words and tail.strip(" ;,\t:"):
            return tail.strip(" ;,\t:")
    return UNNAMED[role]
