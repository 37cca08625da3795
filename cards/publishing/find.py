"""Folders of pairs under a folder, in a fixed order."""

import os
from pathlib import Path

from ...core.errors import DataError, UsageError

PARAMETERS = "params.json"


def pair_folders(folder: Path, site: Path | None = None) -> tuple[Path, ...]:
    """Folders that hold a ``params.json``, sorted by their path; hidden ones and the site itself are passed by.

    Raises
    ------
    UsageError
        There is no such folder.
    DataError
        It holds no ``params.json``.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as place:
    ...     (Path(place) / "a").mkdir()
    ...     _ = (Path(place) / "a" / "params.json").write_text("{}")
    ...     [path.name for path in pair_folders(Path(place))]
    ['a']
    """
    if not folder.is_dir():
        raise UsageError(f"{folder}: is no folder; give the one that holds the pairs, each with its {PARAMETERS}.")
    own = None if site is None else site.resolve()
    found = []
    for place, below, names in os.walk(folder):
        below[:] = sorted(n for n in below if not n.startswith(".") and (own is None or _real(place, n) != own))
        if PARAMETERS in names:
            found.append(Path(place))
    if not found:
        raise DataError(f"{folder}: holds no {PARAMETERS}; fit first: fitmodels data.csv --out {folder}.")
    return tuple(sorted(found, key=lambda path: path.relative_to(folder).parts))


def _real(place: str, name: str) -> Path:
    return Path(place, name).resolve()
