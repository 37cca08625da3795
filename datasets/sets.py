"""Data sets by name: those bundled with the package, and public measurements that are downloaded and verified."""

import os
from collections.abc import Iterable
from hashlib import sha256
from importlib.resources import files
from pathlib import Path

from ..core.errors import DataError, UsageError
from ..core.suggestions import did_you_mean
from .public_sets import SETS, PublicFile, PublicSet


def bundled_names() -> tuple[str, ...]:
    """Names of the bundled sets, in alphabetical order.

    >>> from fitmodels.datasets.sets import bundled_names
    >>> "gc435_709m40" in bundled_names()
    True
    """
    return tuple(sorted(f.name for f in _folder().iterdir() if (f / "data.csv").is_file()))


def bundled(name: str) -> Path:
    """Path of a bundled set's data.csv; the README.md in the same folder gives source, units and known problems.

    Parameters
    ----------
    name : str
        one of `bundled_names()`

    Raises
    ------
    UsageError
        The name is not bundled; the message proposes the closest one.

    Examples
    --------
    >>> from fitmodels.datasets.sets import bundled
    >>> bundled("ac2017_table1").name
    'data.csv'

    """
    known = bundled_names()
    if name not in known:
        raise UsageError(f"no bundled data set {name!r}. {did_you_mean(name, known, names='There are ')}")
    return _folder() / name / "data.csv"


def _folder() -> Path:
    return Path(str(files(__package__)))


LOCAL = "FITMODELS_DATA"  # the environment variable that names a folder of such sets
SHORT = 160  # letters


def fetch(name: str, folder: str | os.PathLike[str] | None = None) -> Path:
    """Folder of a set of real measurements, whose files are verified to be as published.

    A copy in the folder that ``FITMODELS_DATA`` names is taken first; otherwise the files are downloaded once, through
    pooch (``pip install 'fitmodels[fetch]'``), and kept. Sets that were put together or converted from what is
    published cannot be downloaded, and the error names their sources.

    Parameters
    ----------
    name : str
        ``nasa_milling``, ``turning_forces``, ``cnc_mill_current``, ``emps``, ``servo_sweep``, ``daisy``, ``nist_strd``.
    folder : path, optional
        Where downloads are kept, a folder for each set; by default the user's cache.

    Returns
    -------
    Path
        Of a folder that holds the files of the set.

    Raises
    ------
    UsageError
        There is no such set.
    DataError
        There is no local copy and no download, or a file differs from the published one; the message gives the remedy.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> datasets.fetch("nasa_millling")
    Traceback (most recent call last):
    ...
    fitmodels.core.errors.UsageError: no set of measurements 'nasa_millling'. Did you mean 'nasa_milling'?
    """
    if name not in SETS:
        raise UsageError(f"no set of measurements {name!r}. {did_you_mean(name, SETS, names='There are ')}")
    wanted = SETS[name]
    places = [Path(root) / name for root in (os.environ.get(LOCAL), folder) if root]
    here = next((place for place in places if _all_there(place, wanted.files)), None)
    if here is not None:
        return _checked(here, wanted.files)
    if wanted.made:
        raise DataError(
            f"{name} ({wanted.what}) was {wanted.made}, so it cannot be downloaded (licence: {wanted.licence}). Set "
            f"{LOCAL} to a folder that holds {_listed_files(name, wanted.files)}."
        )
    return _downloaded(name, wanted, folder)


def _downloaded(name: str, wanted: PublicSet, folder: str | os.PathLike[str] | None) -> Path:
    """Every file through pooch, which keeps them and compares their SHA-256."""
    try:
        import pooch  # type: ignore[import-untyped, import-not-found, unused-ignore]
    except ModuleNotFoundError:
        raise DataError(
            f"{name} has no local copy and pooch, the downloader, is not installed: pip install 'fitmodels[fetch]', "
            f"or set {LOCAL} to a folder that holds {_listed_files(name, wanted.files)}."
        ) from None
    place = Path(pooch.os_cache("fitmodels") if folder is None else folder) / name
    for file in wanted.files:
        try:
            pooch.retrieve(file.url, known_hash=f"sha256:{file.sha256}", fname=file.name, path=place)
        except (OSError, ValueError) as error:  # no network, no such address (of requests: OSError), or other bytes
            raise DataError(
                f"{name} ({wanted.what}; licence: {wanted.licence}) cannot be downloaded from {file.url}: "
                f"{_short(error)}. Try again, or download it manually and set {LOCAL} to a folder that holds "
                f"{_listed_files(name, wanted.files)}."
            ) from None
    return place


def _all_there(place: Path, files: Iterable[PublicFile]) -> bool:
    return all((place / file.name).is_file() for file in files)


def _checked(place: Path, files: Iterable[PublicFile]) -> Path:
    for file in files:
        found = sha256((place / file.name).read_bytes()).hexdigest()
        if found != file.sha256:
            raise DataError(
                f"{place / file.name}: SHA-256 {found[:12]}..., not {file.sha256[:12]}...: it is not the file that was "
                "published. Restore it, or move it away to have it downloaded again."
            )
    return place


def _listed_files(name: str, files: Iterable[PublicFile]) -> str:
    *rest, last = [f"{name}/{file.name}" for file in files]
    return f"{', '.join(rest)} and {last}" if rest else last


def _short(error: Exception) -> str:
    """Message of an error in one line, or its type where the message is long."""
    message = str(error).strip()
    return message.rstrip(".") if 0 < len(message) <= SHORT and "\n" not in message else type(error).__name__
