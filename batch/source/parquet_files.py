"""The files of a Parquet source: where they stand, what their folders say, and their footers."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from ...core.errors import DataError
from .open_source import PARQUET
from .parquet_arrow import pq

NOTHING = "__HIVE_DEFAULT_PARTITION__"  # how Hive and Spark name the folder of rows without a value
FILE_NAME = "file name"  # header of what the name of a file says of all its rows


@dataclass(frozen=True, slots=True)
class ParquetFile:
    """A file of the source; ``partition`` is what its folders say: header and value, url-decoded."""

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
    """Size and time of change: what tells that a file was written again."""
    status = path.stat()
    return f"{status.st_size}:{status.st_mtime_ns}"


def hive(folders: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """What folders named ``header=value`` say.

    >>> hive(("2024", "tool=GC%204325", "work=__HIVE_DEFAULT_PARTITION__"))
    (('tool', 'GC 4325'), ('work', ''))
    """
    said = (re.fullmatch(r"([^=]+)=(.*)", folder) for folder in folders)
    return tuple((unquote(m[1]), "" if m[2] == NOTHING else unquote(m[2])) for m in said if m)


def names_of_files(files: tuple[ParquetFile, ...]) -> tuple[str, ...]:
    """The stem of each file, or its path without the ending where two have the same stem."""
    stems = tuple(file.path.stem for file in files)
    if len(set(stems)) == len(stems):
        return stems
    return tuple(str(Path(file.name).with_suffix("").as_posix()) for file in files)


@lru_cache(maxsize=8)
def footer(path: str, stamp: str) -> Any:  # noqa: ANN401  the stamp is part of the key
    """What the end of a file says of it; kept, since several blocks read from one file."""
    return pq.read_metadata(path)
