"""Measurements of cutting tests: columns with roles and units, one row per measurement."""

import os
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pandas as pd

from ..core.arrays import Array, Ints, Texts
from ..core.display import Display, Displayable, Plottable, TextTable
from ..core.errors import DataError, ReadingWarning, UsageError
from ..core.rounding import format_plain, label_of
from .columns import ColumnUse
from .derived.rules import Derived
from .doubts import Doubt
from .headers import last_bracket
from .options import Process
from .vocabulary import MARK, ROLES
from .vocabulary import UNNAMED as UNNAMED

NOT_MEASURED = ("simulated", "simulation", "simuliert", "simulé", "simulad", "no measurement")


def disclaimers(notes: Iterable[str]) -> tuple[str, ...]:
    """Notes that declare data as simulated or computed, not measured.

    >>> disclaimers(["simulated: no measurement", "coolant: dry"])
    ('simulated: no measurement',)
    """
    return tuple(note for note in notes if any(word in note.lower() for word in NOT_MEASURED))


@dataclass(frozen=True, slots=True, repr=False)
class Source(Displayable):
    """Origin of the numbers: file name, SHA-256 of its bytes, number of rows, encoding and delimiters."""

    name: str
    sha256: str
    rows: int
    dialect: str


@dataclass(frozen=True, slots=True, repr=False)
class Runs(Plottable):
    """Measurements of cutting tests, in the units of the field.

    Attributes
    ----------
    data : DataFrame
        A column for each role, under its symbol (V, f, d, t, AW, Fx ...), in the unit of ``units``; labels
        (edge, tool, work) as text; columns without a role under their own header. ``VB mark`` holds the marked
        values of VB (``<0.05``, ``>0.3``, ``~0.2``, ``0.24*``) as text, where it has any: VB itself is NaN there.
    units : mapping
        Unit of each role's column.
    columns : tuple of ColumnUse
        Use of each column of the file.
    lines : ndarray of int, shape (n,)
        Line of each row in the file.
    source : Source
    tool, work : str
        Names of the pair; ``several`` where a column names more than one.
    assumed, warnings, notes : tuple of str
        Assumptions; what was left out or corrected; the free text of the file.
    doubts : tuple of Doubt
        Unusual values, contradictions between columns, and choices that the file does not settle.
    judged : bool
        Whether the reading looked for doubts; runs made of arrays, or of a stream, are not judged.
    derived : tuple of Derived
        Quantities that were computed from others, with the formula.
    process : {"turning", "milling", "drilling", "grinding"} or None
        As given, or as columns, headers and notes name it; None where they do not.
    constants : mapping of str to float
        Values of quantities without a column, by role: given, or stated in the notes.

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
    lines: Ints
    source: Source
    tool: str
    work: str
    assumed: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    judged: bool = False
    derived: tuple[Derived, ...] = ()
    process: Process | None = None
    constants: Mapping[str, float] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.data)

    def _display(self) -> Display:
        numbers = [name for name in self.units if name in self.data]
        known = {name: self.data[name].dropna().astype(float) for name in numbers}
        shown = [(name, f"{format_plain(v.min())} to {format_plain(v.max())}", self.units[name], str(len(v)))
                for name, v in known.items() if len(v)]  # fmt: skip
        edges = f" of {len(set(self.labels('edge')) - {''})} edges" if self.has("edge") else ""
        ranges = ", ".join(f"{name} {ends} {unit}".rstrip() for name, ends, unit, _ in shown)
        head = f"{self.tool} on {self.work}{', simulated' if self.simulated else ''}: {len(self)} rows{edges}; {ranges}"
        facts = (("from", self.source.name), ("SHA-256", f"{self.source.sha256[:12]}..."))
        grid = TextTable(("", "range", "unit", "rows"), tuple(shown))
        return Display(head, facts, grid, (*map(str, self.doubts), *self.warnings, *self.assumed, *self.notes))

    @property
    def disclaimers(self) -> tuple[str, ...]:
        """Notes in which the file declares itself simulated or computed, not measured."""
        return disclaimers(self.notes)

    @property
    def simulated(self) -> bool:
        """Whether the file declares itself simulated or computed."""
        return bool(self.disclaimers)

    def has(self, name: str) -> bool:
        """Whether a role or column of this name exists."""
        return self._column(name) is not None

    def symbol(self, name: str) -> str:
        """Symbol of a column that is named by its header, with or without its unit; a symbol as it is.

        >>> from fitmodels import datasets
        >>> frame = pd.DataFrame({"cutting speed [m/s]": [1.0, 2.0], "flank wear [mm]": [0.1, 0.2]})
        >>> datasets.runs_from_frame(frame).symbol("cutting speed [m/s]")
        'V'
        """
        bare = str(name)[: last_bracket(str(name))].rstrip()
        return next((found for one in (name, bare) if (found := self._column(one))), name)

    def values(self, name: str) -> Array:
        """Numbers of a role or column, shape (n,), NaN where missing."""
        column = self._known(name)
        if not pd.api.types.is_numeric_dtype(self.data[column]):
            raise UsageError(f"column {name!r} holds text; a law needs numbers.")
        return self.data[column].to_numpy(dtype=float)

    def labels(self, name: str) -> Texts:
        """Texts of a role or column, shape (n,), empty where missing; whole numbers as ``1``, not ``1.0``."""
        series = self.data[self._known(name)]
        if not pd.api.types.is_numeric_dtype(series):
            return series.to_numpy(dtype=object)
        return np.array(["" if v != v else label_of(v) for v in series.tolist()], dtype=object)

    def marked(self, role: str, sign: str) -> int:
        """Number of values of a role that are known by a bound alone: ``>`` for at least, ``<`` for at most."""
        column = f"{role}{MARK}"
        return int(np.char.startswith(self.labels(column).astype(str), sign).sum()) if column in self.data else 0

    def pairs(self) -> Iterator["Runs"]:
        """The runs of each tool/work pair, in the order of the file, with the doubts about its rows."""
        keys = [role for role in ("tool", "work") if role in self.data]
        if not keys:
            yield self
            return
        texts = {role: pd.Series(self.labels(role), index=self.data.index) for role in keys}
        texts = {role: text.where(text != "", UNNAMED[role]) for role, text in texts.items()}
        for _, group in pd.DataFrame(texts).groupby(keys, sort=False):
            rows = self.data.index.get_indexer(group.index)
            tool, work = (str(group[role].iloc[0]) if role in group else getattr(self, role) for role in UNNAMED)
            lines = self.lines[rows]
            doubts = tuple(doubt for doubt in self.doubts if doubt.concerns(lines))
            yield replace(self, data=self.data.iloc[rows], lines=lines, tool=tool, work=work, doubts=doubts)

    def join(self, other: "Readable") -> "Runs":
        """Runs of both as one file; only columns that both have are kept."""
        other = as_runs(other)
        shared = [name for name in self.data if name in other.data]
        if not shared:
            raise UsageError(f"{self.source.name} and {other.source.name} have no column in common.")
        frames = [self.data, other.data]
        for mark in dict.fromkeys(name for frame in frames for name in map(str, frame) if name.endswith(MARK)):
            if mark.removesuffix(MARK) in shared and mark not in shared:
                frames = [frame if mark in frame else frame.assign(**{mark: ""}) for frame in frames]
                shared.append(mark)
        data = pd.concat([frame[shared] for frame in frames], ignore_index=True)
        digest = sha256((self.source.sha256 + other.source.sha256).encode()).hexdigest()
        name = f"{self.source.name} + {other.source.name}"
        return replace(
            self,
            data=data,
            units={name: unit for name, unit in self.units.items() if name in shared},
            lines=np.concatenate([self.lines, other.lines]),
            source=replace(self.source, name=name, rows=len(data), sha256=digest),
            tool=self.tool if self.tool == other.tool else "several",
            work=self.work if self.work == other.work else "several",
            notes=tuple(dict.fromkeys((*self.notes, *other.notes))),
            assumed=tuple(dict.fromkeys((*self.assumed, *other.assumed))),
            warnings=(*self.warnings, *other.warnings),
            doubts=tuple(dict.fromkeys((*self.doubts, *other.doubts))),
            judged=self.judged and other.judged,
            derived=tuple(dict.fromkeys((*self.derived, *other.derived))),
        )

    def to_frame(self) -> pd.DataFrame:
        """A copy of the rows, one column per role; ``attrs`` holds units, notes, tool and work, which are read again.

        Examples
        --------
        >>> from fitmodels import datasets, fit
        >>> frame = datasets.read_runs(datasets.bundled("gc435_709m40")).to_frame()
        >>> frame.attrs["units"]["V"], fit.power_law(frame[frame["V"] < 200], "AW", ["V", "t"]).source.simulated
        ('m/min', True)
        """
        frame = self.data.copy()
        named = {role: name for role in UNNAMED if (name := getattr(self, role)) not in (UNNAMED[role], "several")}
        frame.attrs.update(named, units=dict(self.units), notes=list(self.notes))
        return frame

    def _column(self, name: str) -> str | None:
        if name in self.data or name in ROLES:  # a header that is the symbol of another role does not answer to it
            return name if name in self.data else None
        return next((use.role for use in self.columns if use.name == name and use.role in self.data), None)

    def _known(self, name: str) -> str:
        column = self._column(name)
        if column is None:
            raise UsageError(f"no column {name!r}; there are {', '.join(map(str, self.data.columns))}.")
        return column


Readable: TypeAlias = str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | pd.DataFrame | Runs


def as_runs(source: Readable) -> Runs:
    """Runs of whatever holds tests: the path of a file or folder, a list of paths, a DataFrame, or Runs as they are.

    A DataFrame is read as a file is: its column names are headers (``V``, ``f [mm/rev]``), ``attrs["units"]`` names
    units by header. Units that had to be assumed, and doubts about the values, are a `ReadingWarning`.

    Raises
    ------
    UsageError
        The source is none of these.
    DataError
        It cannot be read, or has no rows.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> frame = pd.DataFrame({"V [m/min]": [100.0, 200.0], "AW [mm]": [0.1, 0.2]})
    >>> as_runs(frame).units
    {'V': 'm/min', 'AW': 'mm'}
    """
    from .reading import read_runs, runs_from_frame

    if isinstance(source, Runs):
        return source
    frame = isinstance(source, pd.DataFrame)
    if not frame and not _is_path(source):
        kind = type(source).__name__
        raise UsageError(f"tests as {kind}: give the path of a file, a DataFrame or Runs (of datasets.read_runs).")
    runs = runs_from_frame(source) if isinstance(source, pd.DataFrame) else read_runs(source)
    if not len(runs):
        raise DataError(f"{runs.source.name} has no rows; give the rows of tests.")
    for text in _remarks(runs, frame=frame):
        warnings.warn(f"{runs.source.name}: {text}", ReadingWarning, stacklevel=_outside())
    return runs


def _remarks(runs: Runs, *, frame: bool) -> tuple[str, ...]:
    """Units of a DataFrame that had to be assumed, and doubts."""
    remedy = 'name units in the headers, as "V [m/min]", or read it with datasets.runs_from_frame(df, units={...})'
    found = [
        f"{text.replace('the file does', 'its columns do')}; {remedy}."
        for text in runs.assumed
        if frame and text.startswith("units that")
    ]
    return (*found, *(f"Doubt: {doubt.in_python}" for doubt in runs.doubts))


def edges_of(runs: Runs) -> tuple[Ints, list[tuple[str, ...]]]:
    """Number of the edge of each row, shape (n,), -1 without one, and tool, work and name of each edge.

    Rows of one name under different tools or work materials are of different edges.

    >>> from fitmodels import datasets
    >>> frame = pd.DataFrame({"tool": ["A", "B", "B"], "edge": ["1", "1", ""], "V": [100.0, 120.0, 140.0]})
    >>> edges_of(datasets.runs_from_frame(frame, work="C45", judge=False))
    (array([ 0,  1, -1]), [('A', 'C45', '1'), ('B', 'C45', '1')])
    """
    labels = [runs.labels(role) if role in runs.data else None for role in (*UNNAMED, "edge")]
    keys = np.zeros(len(runs), dtype=np.intp)
    for texts in labels:
        if texts is not None:
            code, different = pd.factorize(texts)
            keys = keys * len(different) + code
    rows = np.flatnonzero(runs.labels("edge") != "")
    codes = np.full(len(runs), -1, dtype=np.intp)
    codes[rows] = pd.factorize(keys[rows])[0]
    first = rows[np.unique(codes[rows], return_index=True)[1]].tolist()
    given = zip(labels, (runs.tool, runs.work, ""), strict=True)
    names = [[name if texts is None else texts[row] for row in first] for texts, name in given]
    return codes, list(zip(*names, strict=True))


def _is_path(source: object) -> bool:
    if isinstance(source, list | tuple):
        return all(isinstance(file, str | os.PathLike) for file in source)
    return isinstance(source, str | os.PathLike)


def _outside() -> int:
    """Level of the caller outside the package, for a warning."""
    import sys

    root, level, frame = str(Path(__file__).parent.parent), 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(root):
        frame, level = frame.f_back, level + 1
    return level
