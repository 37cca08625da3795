"""What SOURCE is: a folder of lab files, a Parquet data set, or a CSV too large for memory."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from ...core.errors import DataError, UsageError
from ...datasets.tables.decode import load_bytes
from ..plan import Block, Plan, Reading
from ..rows import Rows

PARQUET = (".parquet", ".pq", ".parq")
LAB = (".csv", ".txt", ".tsv", ".dat", ".xlsx")
LARGE = 60_000_000  # bytes of a text file; read whole it takes ten times as much memory
OURS = ("results.csv", "attention.csv", "comparison.csv", "pooled.csv", "pairs", "figures", "site")
SHOWN = 3  # names in a sentence

MapOver = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]


def silent(words: str) -> None:
    """Tell nobody."""


@dataclass(frozen=True, slots=True)
class Inside:
    """What a folder holds, at any depth, in the order of the paths; without hidden files and our own output."""

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
    told: Callable[[str], None] = silent,
    map_over: MapOver = map,
) -> Plan:
    """Look through a source: which pairs it holds, where their rows stand, and in which blocks they are fitted.

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
    told : callable
        Is told what is being done.
    map_over : callable
        ``map_over(work, tasks)`` gives the results in the order of the tasks; the built-in ``map`` by default.

    Raises
    ------
    UsageError
        A folder holds lab files beside Parquet, or ``reading`` names what is not there.
    DataError
        The source is missing, empty, or holds nothing that can be read.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> plan = open_source(datasets.bundled("gc435_709m40"), Reading(), work=Path("unused"))
    >>> plan.kind, [str(pair) for pair in plan.pairs]
    ('files', ['GC435 on 709M40 (En 19)'])
    """
    from .files_plan import files_plan

    path = there(source)
    limits: dict[str, Any] = {"most_rows": most_rows, "most_pairs": most_pairs}
    onward: dict[str, Any] = {**limits, "work": work, "told": told, "reads": reads}
    if path.is_file():
        if path.suffix.lower() in PARQUET:
            return _parquet(path, reading, onward)
        if is_large(path):
            from .csv_stream import csv_stream

            return csv_stream(path, reading, **onward)
        return files_plan(path, (path,), reading, **limits, told=told, map_over=map_over)
    inside = look_inside(path)
    if inside.parquet:
        _one_kind(path, inside)
        return _parquet(path, reading, onward)
    if not inside.lab:
        raise DataError(_nothing(path, inside))
    said = tuple(_passed_by(inside))
    return files_plan(path, inside.lab, reading, **limits, told=told, map_over=map_over, assumed=said)


def there(source: str | os.PathLike[str]) -> Path:
    """The path of a source from the root, as it is written; a link stays one.

    Raises
    ------
    UsageError
        Its name is empty.
    DataError
        There is nothing: the sentence says which name comes nearest.
    """
    if not os.fspath(source):
        raise UsageError("the name of the source is empty: name a folder of lab files, a Parquet file or a text file.")
    path = Path(os.path.normpath(Path(source).absolute()))
    if not path.exists():
        load_bytes(path)
    return path


def _parquet(path: Path, reading: Reading, onward: Mapping[str, Any]) -> Plan:
    from .parquet_plan import parquet_plan

    return parquet_plan(path, reading, **onward)


def rows_of(block: Block, plan: Plan) -> tuple[list[Rows], dict[str, str]]:
    """Rows of the pairs of a block, and the pieces that could not be read, with the reason."""
    if plan.kind == "files":
        from .files_rows import files_rows

        return files_rows(block, plan)
    from .parquet_rows import parquet_rows

    return parquet_rows(block, plan)


def chunks_of(block: Block, plan: Plan) -> Iterator[pd.DataFrame]:
    """Rows of the pair of a streamed block, chunk by chunk, all with the same columns.

    Raises
    ------
    DataError
        A piece can no longer be read.
    """
    if plan.kind == "files":
        from .files_rows import files_chunks

        return files_chunks(block, plan)
    from .parquet_rows import parquet_chunks

    return parquet_chunks(block, plan)


def is_large(path: Path) -> bool:
    """Whether a file is a text that is not read whole."""
    return path.suffix.lower() != ".xlsx" and path.stat().st_size > LARGE


def look_inside(folder: Path) -> Inside:
    """Sort what a folder holds; what ``fitmodels`` wrote there is passed by.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name in ("b.csv", "a.TXT", ".hidden.csv", "photo.jpg"):
    ...     (folder / name).touch()
    >>> inside = look_inside(folder)
    >>> [path.name for path in inside.lab], inside.other
    (['a.TXT', 'b.csv'], ('photo.jpg',))
    """
    lab, parquet, other, ours = [], [], [], []
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
    return Inside(tuple(sorted(lab)), tuple(sorted(parquet)), tuple(sorted(other)), tuple(sorted(ours)))


def shown(names: Iterable[str]) -> str:
    """The first of several names.

    >>> shown(["a", "b"]), shown("abcde")
    ('a, b', 'a, b, c and 2 more')
    """
    names = list(names)
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more


def _is_hidden(name: str) -> bool:
    return name.startswith((".", "~$"))  # ~$: the lock of a workbook that is open in Excel


def _is_ours(folder: Path) -> bool:
    return (folder / ".batch").is_dir() or (folder / "params.json").is_file()


def _one_kind(folder: Path, inside: Inside) -> None:
    if inside.lab:
        found: Mapping[str, tuple[Path, ...]] = {"Parquet": inside.parquet, "lab files": inside.lab}
        told = " and ".join(f"{kind} ({shown(path.name for path in paths)})" for kind, paths in found.items())
        raise UsageError(f"{folder} holds both {told}: give a folder that holds one kind.")


def _nothing(folder: Path, inside: Inside) -> str:
    beside = f"; there are {shown(inside.other)}" if inside.other else ""
    beside += f"; what fitmodels wrote is passed by ({shown(inside.ours)})" if inside.ours else ""
    return f"{folder} holds no lab file ({' '.join(LAB)}) and no .parquet{beside}: name the folder of the measurements."


def _passed_by(inside: Inside) -> Iterator[str]:
    if inside.other:
        yield f"{len(inside.other)} file(s) are of no kind that is read here, and passed by: {shown(inside.other)}."
    if inside.ours:
        yield f"What fitmodels wrote is passed by: {shown(inside.ours)}."
