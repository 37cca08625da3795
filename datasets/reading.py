"""Read a laboratory file or a DataFrame as `Runs`: columns get roles and units, every assumption is recorded."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..core.arrays import Ints
from ..core.errors import DataError, UsageError
from ..core.suggestions import did_you_mean
from .clock import clock_columns
from .columns import ColumnUse, Values, assign, check_edge_option
from .corrections import Corrections
from .derived.derivation import derive
from .design import decode_levels
from .doubts import Doubt
from .draft import Draft, keep_marks
from .edges.assignment import settle_edges
from .edges.checks import check_edges
from .edges.columns import label_test
from .edges.merged_cells import fill_down
from .headers import is_known, with_latin_headers
from .named_rows import readable_but_for
from .notes import given_values
from .notes import pair_name as pair_name
from .options import ReadOptions
from .plausibility.judgement import check_signs, check_values, settle_units
from .plausibility.quantities import table_process
from .plausibility.stray_values import leave_out_codes
from .runs import UNNAMED, Runs, Source
from .several_files import files_of_folder, joined_sheets, joined_tables
from .shapes import long_table, with_means
from .tables import Column, Table, column_of_texts, read_table
from .units import is_unit
from .vocabulary import ROLES


def read_runs(
    path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | Table,
    *,
    options: ReadOptions | None = None,
    **given: Any,  # noqa: ANN401  the fields of ReadOptions
) -> Runs:
    """Read a wear-test file: text of any dialect, or a workbook (.xlsx, .xls, .xlsb, .ods).

    Parameters
    ----------
    path : path of the file, of a folder or a list of files that are one table, or a Table that was read before
    options : ReadOptions, optional
    **given
        Options by name instead of ``options``: ``map`` (role symbol to column header or ``col7``), ``units`` (role
        symbol to unit), ``ranges`` (role symbol to the ends of coded levels), ``constants`` (role symbol to a value
        that is not in the file), ``correct``, ``leave_out``, ``tool``, ``work``, ``edge``, ``process``, ``hidden``,
        and ``decimal``,
        ``delimiter``, ``sheet`` as in :func:`fitmodels.datasets.read_table`.

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
    how = read_options(given) if options is None else options
    table = path
    if not isinstance(table, Table):
        table = tables_of_tests(table, how)
    table = long_table(table, how.map)
    source = Source(table.path.name, table.sha256, table.n_rows, table.dialect.describe())
    notes = tuple(note.lstrip("#% ") for note in table.notes)
    return _assemble(table.columns, table.lines, source, notes, table.warnings, how, table.assumed, table.doubts)


def tables_of_tests(
    path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    options: ReadOptions,
    check: Callable[[Path, Table], object] | None = None,
) -> Table:
    """Read the table of a file of tests, or those of a folder or list of files as one; ``check`` may refuse a file.

    >>> from fitmodels import datasets
    >>> tables_of_tests([datasets.bundled("ac2017_table1")], ReadOptions()).n_rows
    16
    """
    if isinstance(path, str | os.PathLike):
        if not os.path.isdir(path):  # noqa: PTH112  False also where the name is none of a file
            return table_of_tests(path, options)
        files, others = files_of_folder(Path(path))
        name = Path(path).resolve()
    else:
        files, others = tuple(map(Path, path)), ()
        if not files:
            raise UsageError("an empty list of files: give at least one.")
        name = Path(files[0].name if len(files) == 1 else f"{files[0].name} and {len(files) - 1} more")
    tables = []
    for file in files:
        table = table_of_tests(file, options)
        if check is not None:
            check(file, table)
        tables.append(long_table(table, options.map))
    return tables[0] if len(tables) == 1 else joined_tables(tables, name, others)


def table_of_tests(path: str | os.PathLike[str], options: ReadOptions) -> Table:
    """Read the table of a file of tests, with the units and names of cutting tests.

    >>> from fitmodels import datasets
    >>> table_of_tests(datasets.bundled("ac2017_table1"), ReadOptions()).n_rows
    16
    """
    from .tables.sheets import EqualSheetsError

    try:
        table = read_table(
            path, is_unit=is_unit, is_name=is_known, decimal=options.decimal, delimiter=options.delimiter,
            sheet=options.sheet, hidden=options.hidden,
            is_label=label_test(options.columns, options.named),
        )  # fmt: skip
    except EqualSheetsError as refusal:
        tables = [table_of_tests(path, replace(options, sheet=title)) for title in refusal.titles]
        joined = joined_sheets(tables, refusal.titles, Path(path))
        if joined is None:
            raise
        return joined
    return with_latin_headers(table)


def runs_from_frame(
    frame: pd.DataFrame,
    *,
    options: ReadOptions | None = None,
    judge: bool = True,
    **given: Any,  # noqa: ANN401  the fields of ReadOptions
) -> Runs:
    """Runs from a DataFrame; its column names are read like headers of a file.

    Parameters
    ----------
    frame : DataFrame
        A sequence of texts in ``frame.attrs["notes"]`` counts as the notes of a file, ``attrs["units"]`` gives the
        units of columns by their names, ``attrs["tool"]`` and ``attrs["work"]`` the pair, unless the options do.
    options, **given
        Options of `read_runs`, without ``decimal``, ``delimiter``, ``sheet`` and ``hidden``.
    judge : bool
        False: numbers of no machine, for instance of a textbook. No unit is settled by the values, no value is
        doubted or left out, no edge is inferred, and the runs are marked as not judged.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> frame = pd.DataFrame({"vc [m/s]": [1.0, 2.0], "AW": [0.1, 0.2]})
    >>> datasets.runs_from_frame(frame).values("V").tolist()
    [60.0, 120.0]
    """
    stated = frame.attrs.get("units")
    units: Mapping[object, str] = stated if isinstance(stated, Mapping) else {}
    columns = tuple(
        replace(_column_of(i, str(name), frame.iloc[:, i]), unit_cell=str(units.get(name) or ""))
        for i, name in enumerate(frame.columns)
    )
    source = Source("DataFrame", "", len(frame), "in memory")
    how = _with_pair(read_options(given) if options is None else options, frame)
    return _assemble(columns, np.arange(len(frame)), source, tuple(frame.attrs.get("notes", ())), (), how, judge=judge)


def _with_pair(options: ReadOptions, frame: pd.DataFrame) -> ReadOptions:
    """Options completed by the tool and work in ``attrs`` of a frame of `Runs.to_frame`."""
    pair = {role: frame.attrs[role] for role in UNNAMED if isinstance(frame.attrs.get(role), str)}
    named = {role: name for role, name in pair.items() if role not in frame and getattr(options, role) is None}
    return replace(options, **named) if named else options


def runs_of_sample(frame: pd.DataFrame, options: ReadOptions) -> Runs:
    """Runs of the first rows of a longer table, whose columns have their roles by name: no edges are looked for.

    Examples
    --------
    >>> runs_of_sample(pd.DataFrame({"V": [100.0, 100.0], "Insert": ["1", "2"]}), ReadOptions()).columns[1].role
    'tool'
    """
    columns = tuple(_column_of(i, str(name), frame.iloc[:, i]) for i, name in enumerate(frame.columns))
    notes = tuple(frame.attrs.get("notes", ()))
    return _assemble(
        columns, np.arange(len(frame)), Source("DataFrame", "", len(frame), ""), notes, (), options, sample=True
    )


def read_options(given: Mapping[str, Any]) -> ReadOptions:
    """Options from keywords; None counts as not given, and a name that does not exist is refused.

    Raises
    ------
    UsageError
    """
    known = [one.name for one in fields(ReadOptions)]
    for name in given:
        if name not in known:
            raise UsageError(f"{name}: there is no such option. {did_you_mean(name, known)}")
    return ReadOptions(**{name: value for name, value in given.items() if value is not None})


def _column_of(position: int, name: str, series: "pd.Series[float]") -> Column:
    numeric = pd.api.types.is_numeric_dtype(series) and not pd.api.types.is_bool_dtype(series)
    if not numeric:
        texts = ["" if missing else str(v) for v, missing in zip(series, series.isna(), strict=True)]
        return column_of_texts(position + 1, name, texts)
    values = series.to_numpy(dtype=float, na_value=np.nan)
    if np.isinf(values).any():
        row = int(np.flatnonzero(np.isinf(values))[0])
        raise DataError(f"column {name!r} row {row}: {values[row]} is not a measurement; leave the row out.")
    return Column(position + 1, name, "", values, True, ())


def _assemble(
    columns: tuple[Column, ...],
    lines: Ints,
    source: Source,
    notes: tuple[str, ...],
    warnings: tuple[str, ...],
    options: ReadOptions,
    assumed_shape: tuple[str, ...] = (),
    doubts: tuple[Doubt, ...] = (),
    *,
    sample: bool = False,
    judge: bool = True,
) -> Runs:
    """Give the columns their roles, then complete and judge the draft step by step."""
    columns, means = _of_tests(columns, lines, options) if not sample else (columns, ())
    check_edge_option(columns, options.edge)
    columns, of_columns, clocks, of_times = clock_columns(columns, options)
    uses, data, assumed = assign(columns, options.columns, of_columns)
    units = {role: ROLES[role].unit for role in data if ROLES[role].unit}
    taken = [*assumed_shape, *means, *clocks, *assumed]
    draft = Draft(columns, uses, data, units, lines, notes, taken, list(warnings), [*doubts, *of_times])
    if not sample:
        fill_down(draft)
    draft.assumed[:0] = _decoded(draft.data, options.ranges)
    _settle(draft, options, judge=judge, sample=sample)
    judged = judge and not sample
    if judged:
        check_edges(draft)
    if not sample:
        keep_marks(draft)
    if judged:
        check_values(draft, options)
    return _finished(draft, source, options, judged=judge)


def _of_tests(
    columns: tuple[Column, ...], lines: Ints, options: ReadOptions
) -> tuple[tuple[Column, ...], tuple[str, ...]]:
    """The columns of one table, repeated readings as their means, and what was assumed for it."""
    columns = readable_but_for(columns, options.leave_out)
    _refuse_second_table(columns, lines)
    return with_means(columns, options.columns)


def _names_below(columns: tuple[Column, ...]) -> list[tuple[int, str, str]]:
    """Line, column and text of cells of columns of numbers that hold the name of a quantity."""
    return [(line, column.name, text) for column in columns for line, text in column.bad if is_known(text)]


def _refuse_second_table(columns: tuple[Column, ...], lines: Ints) -> None:
    """Refuse names of quantities among the numbers of several columns: a second table begins there.

    Raises
    ------
    DataError
    """
    found: dict[int, list[tuple[str, str]]] = {}
    for line, name, text in _names_below(columns):
        found.setdefault(line, []).append((name, text))
    line = min((line for line, cells in found.items() if len(cells) > 1), default=0)
    if not line:
        return
    cells = found[line]
    shown = ", ".join(repr(text) for _, text in cells[:4])
    if all(name == text for name, text in cells):
        raise DataError(f'line {line} holds the names of the columns again ({shown}): --leave-out "lines {line}".')
    if line == lines.min():
        texts = [at for column in columns for at, _ in column.bad]
        last = next((at for at in lines.tolist() if texts.count(at) < 2), line + 1) - 1  # a row of units may follow
        raise DataError(
            f"line {line} holds names again ({shown}), below those of the header: leave it out, with the units below "
            f'it, by --leave-out "lines {line}{f"-{last}" * (last > line)}"; give units that are not usual with --unit.'
        )
    raise DataError(
        f"line {line} holds names of columns ({shown}) below the numbers of a table: a second table begins there. "
        f'Save it as a file or sheet of its own, and read the first one with --leave-out "lines {line}-{lines.max()}".'
    )


def _settle(draft: Draft, options: ReadOptions, *, judge: bool, sample: bool) -> None:
    """Settle units, computed quantities and edges, with what the user corrects or leaves out."""
    asked = Corrections(draft, replace(options, correct=(), leave_out=()) if sample else options, judge=judge)
    asked.apply(draft, "as written")
    if judge:
        if not sample:
            leave_out_codes(draft, options)
            check_signs(draft, options)
        settle_units(draft, options)
    asked.apply(draft, "in its unit")
    derive(draft, options)
    asked.apply(draft, "computed")
    if judge and not sample:
        settle_edges(draft, options)
    asked.name_edges(draft)


def _finished(draft: Draft, source: Source, options: ReadOptions, *, judged: bool) -> Runs:
    """The runs of a complete draft, with the names of the pair."""
    data = draft.data | _without_role(draft.columns, draft.uses, draft.data)
    given = {"tool": options.tool, "work": options.work}
    frame = pd.DataFrame({name: v for name, v in data.items() if given.get(name) is None})
    named = {role: given[role] or pair_name(role, frame, draft.notes) for role in given}
    draft.assumed += (
        f"{role}: not named in the file, called {name}; name it with --{role}"
        for role, name in named.items()
        if name == UNNAMED[role]
    )
    constants = {role: one.value for role, one in given_values(options.constants, draft.notes).items()}
    return Runs(
        frame, draft.units, draft.uses, draft.lines, source, named["tool"], named["work"],
        tuple(draft.assumed), tuple(draft.warnings), draft.notes, tuple(draft.doubts), judged=judged,
        derived=tuple(draft.derived), process=table_process(draft, options), constants=constants,
    )  # fmt: skip


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
