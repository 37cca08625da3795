"""Real measurements by name: a local copy, or a download of which every byte is known."""

import os
from collections.abc import Iterable
from difflib import get_close_matches
from hashlib import sha256
from pathlib import Path

from ..core.errors import DataError, UsageError
from .public_sets import SETS, PublicFile, PublicSet

LOCAL = "FITMODELS_DATA"  # the environment variable that names a folder of such sets
SHORT = 160  # letters


def fetch(name: str, folder: str | os.PathLike[str] | None = None) -> Path:
    """Folder of a set of real measurements, every file of it as it was published.

    A copy in the folder that ``FITMODELS_DATA`` names is taken first; otherwise the files are downloaded once, through
    pooch (``pip install 'fitmodels[fetch]'``), and kept. Sets that were put together or converted from what is
    published cannot be downloaded, and say from what they were made.

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
        No copy is here and none can be had, or a file is not what was published: what, from where, and what to do.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> datasets.fetch("nasa_millling")
    Traceback (most recent call last):
    ...
    fitmodels.core.errors.UsageError: no set of measurements 'nasa_millling'; did you mean 'nasa_milling'?
    """
    if name not in SETS:
        near = get_close_matches(name, SETS, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(SETS)}."
        raise UsageError(f"no set of measurements {name!r}; {hint}")
    wanted = SETS[name]
    places = [Path(root) / name for root in (os.environ.get(LOCAL), folder) if root]
    here = next((place for place in places if _all_there(place, wanted.files)), None)
    if here is not None:
        return _checked(here, wanted.files)
    if wanted.made:
        raise DataError(
            f"{name} ({wanted.what}) was {wanted.made}, so it cannot be downloaded (licence: {wanted.licence}). Set "
            f"{LOCAL} to a folder that holds {_listed(name, wanted.files)}."
        )
    return _downloaded(name, wanted, folder)


def _downloaded(name: str, wanted: PublicSet, folder: str | os.PathLike[str] | None) -> Path:
    """Every file through pooch, which keeps them and compares their SHA-256."""
    try:
        import pooch  # type: ignore[import-untyped, import-not-found, unused-ignore]
    except ModuleNotFoundError:
        raise DataError(
            f"{name} is not here and pooch, which downloads it, is not installed: pip install 'fitmodels[fetch]', or "
            f"set {LOCAL} to a folder that holds {_listed(name, wanted.files)}."
        ) from None
    place = Path(pooch.os_cache("fitmodels") if folder is None else folder) / name
    for file in wanted.files:
        try:
            pooch.retrieve(file.url, known_hash=f"sha256:{file.sha256}", fname=file.name, path=place)
        except (OSError, ValueError) as error:  # no network, no such address (of requests: OSError), or other bytes
            raise DataError(
                f"{name} ({wanted.what}; licence: {wanted.licence}) cannot be had from {file.url}: {_short(error)}. "
                f"Try again, or get it by hand and set {LOCAL} to a folder that holds {_listed(name, wanted.files)}."
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


def _listed(name: str, files: Iterable[PublicFile]) -> str:
    *rest, last = [f"{name}/{file.name}" for file in files]
    return f"{', '.join(rest)} and {last}" if rest else last


def _short(error: Exception) -> str:
    """What a library says in a line, or, where that is long, what kind of error it is."""
    said = str(error).strip()
    return said.rstrip(".") if 0 < len(said) <= SHORT and "\n" not in said else type(error).__name__
