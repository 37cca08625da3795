"""A lab file as ``fitmodels FILE`` reads it; in a folder, a file that names no tool is a tool by its own name."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...core.errors import DataError
from ...datasets import Runs, read_runs, read_table
from ...datasets.records.formats import kind_of, looks_like_record
from ...datasets.tables import Table
from ...datasets.tables.decode import load_bytes
from ...datasets.units import is_unit
from ...datasets.vocabulary import ROLES, UNNAMED
from ..plan import Pair, Reading

NAMED_BY_FILE = "tool: not named in the file, called {name} after it; name it with --tool"


def read_lab_file(path: Path, reading: Reading) -> Runs:
    """The tests of a file.

    Raises
    ------
    DataError
        The file cannot be read, or is a record of one run.
    UsageError
        The options name a column or sheet that the file does not have.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> read_lab_file(datasets.bundled("gc435_709m40"), Reading()).tool
    'GC435'
    """
    table, doubt = _table(path, reading)
    runs = _runs(table, reading, reading.tool)
    if runs.tool == UNNAMED["tool"]:
        runs = _runs(table, reading, path.stem)
        runs = replace(runs, assumed=(*runs.assumed, NAMED_BY_FILE.format(name=path.stem)))
    return replace(runs, assumed=(*runs.assumed, *doubt))


def is_named_by_file(runs: Runs, path: Path) -> bool:
    """Whether the tool has the name of the file."""
    return NAMED_BY_FILE.format(name=path.stem) in runs.assumed


def pairs_of(runs: Runs, groups: tuple[str, ...]) -> Iterator[tuple[Pair, Runs]]:
    """The runs of each pair, of roles and groups only, with tool and work as columns, all in one order."""
    roles = [name for name in map(str, runs.data) if name in ROLES and name not in UNNAMED]
    columns: dict[str, Any] = {
        name: runs.data[name] for name in (*roles, *(name for name in UNNAMED if name in runs.data))
    }
    columns |= {name: group_texts(runs, name) for name in groups if name not in ROLES}
    for part in replace(runs, data=pd.DataFrame(columns, index=runs.data.index)).pairs():
        data = part.data.assign(tool=part.tool, work=part.work)
        order = [*roles, *UNNAMED, *(name for name in groups if name not in ROLES)]
        yield Pair(part.tool, part.work), replace(part, data=data[order].reset_index(drop=True))


def group_texts(runs: Runs, header: str) -> NDArray[np.object_]:
    """Texts of the column under a header, shape (n,); empty where the file has no such column."""
    column = group_column(runs, header)
    return runs.labels(column) if column is not None else np.full(len(runs), "", dtype=object)


def group_column(runs: Runs, header: str) -> str | None:
    """What the data call the column of a header, with its unit or without."""
    for use in sorted(runs.columns, key=lambda use: use.header != header):
        if header in (use.header, use.name):
            names = (use.role,) if use.role else (f"col{use.number}", use.header)
            return next((name for name in names if name in runs.data), None)
    return None


def _runs(table: Table, reading: Reading, tool: str | None) -> Runs:
    return read_runs(
        table, map=reading.map, units=reading.units, ranges=reading.ranges, tool=tool, work=reading.work
    )  # fmt: skip


def _table(path: Path, reading: Reading) -> tuple[Table, tuple[str, ...]]:
    """The table of a file, and what is to be said where it might be a record as well."""
    told = reading.map or reading.ranges or reading.sheet  # then it holds tests: a record has none of these
    if not told and (kind := kind_of(load_bytes(path), path.name)) != "table":
        raise _record(path, f"a file of samples ({kind})")
    table = read_table(
        path, is_unit=is_unit, decimal=reading.decimal, delimiter=reading.delimiter, sheet=reading.sheet  # type: ignore[arg-type]
    )  # fmt: skip
    doubt = () if told else refuse_record(path, table)
    return table, doubt


def refuse_record(path: Path, table: Table) -> tuple[str, ...]:
    """Refuse a record of one run; say so where a table may be either.

    Raises
    ------
    DataError
        It is a record.
    """
    look = looks_like_record(table)
    if look:
        raise _record(path, look.reason)
    if look.kind == "table":
        return ()
    words = f"a table of cutting tests ({look.reason}); if it is a record of one run, say fitmodels ident {path.name}"
    return (words,)


def _record(path: Path, reason: str) -> DataError:
    return DataError(
        f"{path.name} is a record of one run ({reason}): identify it with fitmodels ident {path.name}, or say with "
        "--map which columns are those of cutting tests."
    )
