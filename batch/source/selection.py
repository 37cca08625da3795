"""Selection of the kind of source: a folder of lab files, a Parquet data set, or a CSV too large for memory."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from ...core.bounded import regular_status
from ...core.errors import DataError, UsageError
from ...core.rounding import count
from ...datasets.tables.decode import load_bytes
from ..engine import SERIAL, Run
from ..engine.base import no_report
from ..plan import Block, Plan, Reading
from ..rows import PairRows
from .common import LAB, PARQUET, is_large, some_names

OURS = ("results.csv", "attention.csv", "comparison.csv", "pooled.csv", "pairs", "figures", "site")


@dataclass(frozen=True, slots=True)
class FolderContents:
    """Contents of a folder at any depth, in the order of the paths, without hidden files and output of fitmodels."""

    lab: tuple[Path, ...]
    parquet: tuple[Path, ...]
    other: tuple[str, ...]
    ours: tuple[str, ...]


def open_source(
    source: str | os.PathLike[str],
    reading: Reading,
    *,
    most_rows: int = 250_000,
    most_pairs: int = 1000,
    reads: float = 4.0,
    work: Path,
    report: Callable[[str], None] = no_report,
    workers: Run = SERIAL,
) -> Plan:
    """Plan a source: its pairs, the places of their rows, and the blocks in which they are fitted.

    Parameters
    ----------
    source : path
        A folder of lab files at any depth, one lab file, a text file of any size, a Parquet file, or a folder of
        Parquet files.
    reading : Reading
    most_rows, most_pairs : int
        Of a block.
    reads : float
        How often a Parquet source may be read over before it is sorted by pair first.
    work : Path
        Folder for a copy of the source, where one is needed.
    report : callable
        Receives progress updates.
    workers : Run
        Read the files or row groups; this process by default.

    Raises
    ------
    UsageError
        A folder holds both lab files and Parquet, or ``reading`` names a column that does not exist.
    DataError
        The source is missing, empty, or holds nothing that can be read.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> plan = open_source(datasets.bundled("gc435_709m40"), Reading(), work=Path("unused"))
    >>> plan.kind, [str(pair) for pair in plan.pairs]
    ('files', ['GC435 on 709M40 (En 19)'])
    """
    from .lab_plan import files_plan

    path = existing_path(source)
    limits: dict[str, Any] = {"most_rows": most_rows, "most_pairs": most_pairs}
    onward: dict[str, Any] = {**limits, "work": work, "report": report, "reads": reads, "workers": workers}
    if not path.is_dir():
        regular_status(path, "stream")
    inside = folder_contents(path)
    if inside.parquet:
        from .parquet_blocks import parquet_plan

        _one_kind(path, inside)
        return parquet_plan(path, reading, **onward)
    if path.is_file():
        if is_large(path):
            from .csv_copy import csv_stream

            return csv_stream(path, reading, **onward)
        return files_plan(path, (path,), reading, **limits, report=report, workers=workers)
    if not inside.lab:
        raise DataError(_nothing(path, inside))
    skipped = tuple(_skipped(inside))
    return files_plan(path, inside.lab, reading, **limits, report=report, workers=workers, assumed=skipped)


def existing_path(source: str | os.PathLike[str]) -> Path:
    """The path of a source from the root, as it is written; a link stays one.

    Raises
    ------
    UsageError
        Its name is empty.
    DataError
        It does not exist; the message proposes the closest name.
    """
    if not os.fspath(source):
        raise UsageError("the name of the source is empty: name a folder of lab files, a Parquet file or a text file.")
    path = Path(os.path.normpath(Path(source).absolute()))
    if not path.exists():
        load_bytes(path)
    return path


def rows_of(block: Block, plan: Plan) -> tuple[list[PairRows], dict[str, str]]:
    """Rows of the pairs of a block, and the pieces that could not be read, with the reason."""
    if plan.kind == "files":
        from .lab_files import files_rows

        return files_rows(block, plan)
    from .parquet_reading import parquet_rows

    return parquet_rows(block, plan)


def chunks_of(block: Block, plan: Plan) -> Iterator[pd.DataFrame]:
    """Rows of the pair of a streamed block, chunk by chunk, all with the same columns.

    Raises
    ------
    DataError
        A piece can no longer be read.
    """
    if plan.kind == "files":
        from .lab_files import files_chunks

        return files_chunks(block, plan)
    from .parquet_reading import parquet_chunks

    return parquet_chunks(block, plan)


def folder_contents(folder: Path) -> FolderContents:
    """Contents of a folder by kind, without output of ``fitmodels``; a Parquet file is its own content.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name in ("b.csv", "a.TXT", ".hidden.csv", "photo.jpg"):
    ...     (folder / name).touch()
    >>> inside = folder_contents(folder)
    >>> [path.name for path in inside.lab], inside.other
    (['a.TXT', 'b.csv'], ('photo.jpg',))
    """
    lab, parquet, other, ours = [], [], [], []
    if folder.suffix.lower() in PARQUET and folder.is_file():
        parquet.append(folder)
    for here, folders, files in os.walk(folder):
        at = Path(here)
        written = {name for name in folders if _is_ours(at / name)}
        written |= {name for name in (*folders, *files) if name in OURS and (at / ".batch").is_dir()}
        ours += [(at / name).relative_to(folder).as_posix() for name in written]
        folders[:] = [name for name in folders if not _is_hidden(name) and name not in written]
        for path in (at / name for name in files if not _is_hidden(name) and name not in written):
            ending = path.suffix.lower()
            if ending in LAB:
                lab.append(path)
            elif ending in PARQUET:
                parquet.append(path)
            else:
                other.append(path.relative_to(folder).as_posix())
    return FolderContents(tuple(sorted(lab)), tuple(sorted(parquet)), tuple(sorted(other)), tuple(sorted(ours)))


def _is_hidden(name: str) -> bool:
    return name.startswith((".", "~$"))  # ~$: the lock of a workbook that is open in Excel


def _is_ours(folder: Path) -> bool:
    return (folder / ".batch").is_dir() or (folder / "params.json").is_file()


def _one_kind(folder: Path, inside: FolderContents) -> None:
    if inside.lab:
        parquet, lab = (some_names(path.name for path in paths) for paths in (inside.parquet, inside.lab))
        raise UsageError(
            f"{folder} holds both Parquet ({parquet}) and lab files ({lab}): give a folder that holds one kind."
        )


def _nothing(folder: Path, inside: FolderContents) -> str:
    others = f"; there are {some_names(inside.other)}" if inside.other else ""
    others += f"; results of fitmodels are skipped ({some_names(inside.ours)})" if inside.ours else ""
    return f"{folder} holds no lab file ({' '.join(LAB)}) and no .parquet{others}: name the folder of the measurements."


def _skipped(inside: FolderContents) -> Iterator[str]:
    if inside.other:
        files = count(len(inside.other), "file of another kind is", "files of other kinds are")
        yield f"{files} skipped: {some_names(inside.other)}."
    if inside.ours:
        yield f"Results of fitmodels are skipped: {some_names(inside.ours)}."
