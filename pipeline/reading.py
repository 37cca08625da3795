"""Tests of an analysis: from a path, a DataFrame, or runs that were read before."""

import os
import shlex
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from ..core.errors import DataError, RecordError, UsageError
from ..core.files import STANDARD_INPUT
from ..datasets import read_runs, runs_from_frame
from ..datasets.options import ReadOptions
from ..datasets.reading import table_of_tests, tables_of_tests
from ..datasets.records.formats import kind_of, looks_like_record
from ..datasets.runs import Readable, Runs
from ..datasets.shapes import long_table
from ..datasets.tables.decode import load_bytes

if TYPE_CHECKING:
    from ..datasets.records.formats import FileKind
    from ..datasets.tables import Table

OF_FILES = ("decimal", "delimiter", "sheet", "ranges", "hidden")  # reading options that a DataFrame does not have


def read_source(source: Readable, options: ReadOptions) -> Runs:
    """The tests of a source.

    Raises
    ------
    UsageError
        The options do not fit the source.
    DataError
        The file cannot be read; `RecordError` where it is a record of one run.
    """
    given = {name: value for name, value in options.reading().items() if value not in (None, {}, (), False)}
    if isinstance(source, Runs):
        if given:
            raise UsageError(f"{', '.join(given)}: Runs have been read already; give this to datasets.read_runs.")
        return source
    if isinstance(source, pd.DataFrame):
        wrong = [name for name in given if name in OF_FILES]
        if wrong:
            raise UsageError(f"{', '.join(wrong)}: a DataFrame has no such option of reading; leave it out.")
        runs = runs_from_frame(source, **given)
        if not len(runs):
            raise DataError("the DataFrame has no rows; give the rows of tests.")
        return replace(runs, source=replace(runs.source, sha256=digest(source)))
    if isinstance(source, str | os.PathLike):
        return read_tests(Path(source), options)
    if not isinstance(source, list | tuple) or not all(isinstance(file, str | os.PathLike) for file in source):
        raise UsageError(
            f"source of type {type(source).__name__}: give the path of a file, a DataFrame or Runs, or a list of paths."
        )
    return read_runs(tables_of_tests(source, options, None if options.map else _refuse_in_folder), options=options)


def read_tests(path: Path, options: ReadOptions) -> Runs:
    """The tests of a file; where it might be a record of one run as well, ``assumed`` names the other command.

    Raises
    ------
    DataError
        The file cannot be read; `RecordError` where it is a record of one run.
    UsageError
        The options name a column or sheet that the file does not have.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> read_tests(datasets.bundled("gc435_709m40"), ReadOptions()).tool
    'GC435'
    """
    table, doubt = tests_table(path, options)
    runs = read_runs(table, options=options)
    return replace(runs, assumed=(*runs.assumed, *doubt))


def tests_table(path: Path, options: ReadOptions) -> "tuple[Table, tuple[str, ...]]":
    """The table of a file of tests, and a sentence where it might be a record as well."""
    of_tests = options.map or options.ranges or options.sheet  # a record has none of these
    if os.path.isdir(path):  # noqa: PTH112  False also where the name is none of a file
        return tables_of_tests(path, options, None if of_tests else _refuse_in_folder), ()
    if not of_tests and kind_of(load_bytes(path), path.name) != "table":
        raise _record(path, looks_like_record(path))
    table = table_of_tests(path, options)
    doubt = () if of_tests else refuse_record(path, table)
    rows = long_table(table, options.map)
    return rows, doubt if rows is table else ()


def _refuse_in_folder(path: Path, table: "Table") -> None:
    try:
        refuse_record(path, table)
    except RecordError as record:
        raise DataError(f"{record} The files of a folder are read as one table of tests.") from record


def refuse_record(path: Path, table: "Table") -> tuple[str, ...]:
    """Refuse a record of one run; a sentence where a table may be either.

    Raises
    ------
    RecordError
    DataError
        It is a record of forces, power or current, to be reduced to rows.
    """
    look = looks_like_record(table)
    if look:
        raise _record(path, look)
    if look.kind == "table":
        return ()
    return (f"a table of cutting tests ({look.reason}); for a record of one run use {_identify(path)}",)


def digest(data: pd.DataFrame) -> str:
    """SHA-256 of rows that are not a file of their own: names of the columns, then each column's values.

    Numbers as IEEE 754 doubles, little-endian; texts as UTF-8 with a zero byte after each.

    Examples
    --------
    >>> digest(pd.DataFrame({"V": [100.0], "tool": ["GC435"]}))[:12]
    '041a98c4fd2f'
    """
    made = sha256()
    for name in data:
        made.update(f"{name}\0".encode())
        values = data[name]
        if pd.api.types.is_numeric_dtype(values):
            made.update(values.to_numpy(dtype="<f8", na_value=np.nan).tobytes())
        else:
            made.update("".join(f"{value}\0" for value in values).encode())
    return made.hexdigest()


def _identify(path: Path) -> str:
    """The command that identifies a record; that of standard input has no name."""
    return "fitmodels -" if path.name == STANDARD_INPUT else f"fitmodels ident {shlex.quote(path.name)}"


def _record(path: Path, look: "FileKind") -> DataError:
    """The refusal of a record: one of loads is to be reduced, one of input and output to be identified."""
    if look.loads:
        return DataError(
            f"{path.name} is a record of {', '.join(look.loads)} ({look.reason}), not a table of tests. "
            "Put the records of the tests into a folder and reduce them to a row a cut: fitmodels reduce FOLDER --plan "
            f"tests.csv --out data.csv. To identify dynamics from it: {_identify(path)} --input ... "
            "--output ..."
        )
    return RecordError(
        f"{path.name} is a record of one run ({look.reason}): identify it with {_identify(path)}, or assign the "
        "columns of cutting tests with --map."
    )


def pair_of_several(runs: "Runs") -> dict[str, dict[str, str]]:
    """Names of the pair where its data hold others as well: a plan of further tests is of one pair."""
    named = {role: name for role, name in (("tool", runs.tool), ("work", runs.work)) if role in runs.data}
    return {"pair": named} if named and len(runs) < runs.source.rows else {}
