"""Data sets by name: those bundled with the package, and public measurements that are downloaded and verified.

``SETS`` holds description, licence, addresses and the SHA-256 of every file of the public sets. A set with ``made`` was
compiled or converted from published data, so that no address holds its files.
"""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from ..core.bounded import sha256_of
from ..core.errors import DataError, UsageError
from ..core.rounding import join_words
from ..core.suggestions import did_you_mean

GITHUB = "https://raw.githubusercontent.com"
SERVO = "nicolazande/camber-control/2a8a2dc8a60ccd5a59c29bf1f5062f33ce71c963/actuators/LinA/data"


@dataclass(frozen=True, slots=True)
class PublicFile:
    """A file of a set: name, SHA-256 of its bytes, and the address that holds these bytes, if any."""

    name: str
    sha256: str
    url: str = ""


@dataclass(frozen=True, slots=True)
class PublicSet:
    """A set: description, licence, files, and how it was made where it is not a copy."""

    what: str
    licence: str
    files: tuple[PublicFile, ...]
    made: str = ""


def _at(address: str, *files: tuple[str, str], path: str = "{}") -> tuple[PublicFile, ...]:
    """Files of a repository at one commit: name and SHA-256 of each; ``path`` gives its place, ``{}`` for the name."""
    return tuple(PublicFile(name, sha256, f"{GITHUB}/{address}/{path.format(name)}") for name, sha256 in files)


SETS = {
    "nasa_milling": PublicSet(
        "flank wear and spindle current of 167 face-milling runs, NASA Ames and UC Berkeley 2007",
        "open data of the US government; the mirrors state no licence",
        (PublicFile("nasa_mill_runs.csv", "0fe438de02c36930ebf8b73887241618fecfc4d46540f916eb7330c52a92cab7"),),
        made="put together from three public tables: mill.csv of "
        "github.com/Subhigupta/Anomaly-Detection-NASA-Milling-Dataset, sensor_saturation_audit.csv of "
        "github.com/qq17596053317-ai/sqtr-tool-wear-estimation and reference.csv of "
        "github.com/Anurag-144/Ai-driven-tool-wear-prediction-with-mlops-",
    ),
    "turning_forces": PublicSet(
        "forces and roughness of 54 turning runs on six rows each, Canal and Borille 2022",
        "none stated",
        _at(
            "shay-tham/turning/624a0a3ddc368f9500b060333f48368cf3454fd0",
            ("Exp1.csv", "8bf73b353a9e4f0c5268f24551af635095551023923989ca2962e7806699f37f"),
        ),
    ),
    "cnc_mill_current": PublicSet(
        "mean spindle and drive currents of 18 milling experiments, University of Michigan 2018; also bundled",
        "CC0 1.0, as declared by the uploader",
        (PublicFile("per_experiment_means.csv", "95ae157935a413cd189476693548749a0d80885a8514cdcdde3038cca46fb469"),),
        made="averaged from experiment_01.csv to experiment_18.csv of github.com/ejhusom/cnc_milling_tool_wear",
    ),
    "emps": PublicSet(
        "two runs of a ball-screw drive at 1 kHz, Janot, Gautier and Brunot 2019",
        "cite the Nonlinear System Identification Benchmarks, 2019; the mirror is Apache-2.0",
        (
            PublicFile("data_emps.csv", "231673054389d597fc613c1fb6d1a17801bced16003ba3139eaf352ff4b25137"),
            PublicFile("data_emps_pulses.csv", "ae7b33d062137a230cafb4b8030315a095e3f27645ee5a82970c5261b414186d"),
        ),
        made="converted from the MAT files at www.nonlinearbenchmark.org (EMPS), mirrored by "
        "github.com/forgi86/sysid-neural-continuous",
    ),
    "servo_sweep": PublicSet(
        "sine sweep and square wave of a servo axis at 10 ms",
        "none stated",
        tuple(
            PublicFile(f"LinA__{name}", sha256, f"{GITHUB}/{SERVO}/{name}")
            for name, sha256 in (
                (
                    "pp-sine-sweep-10mm-0.5Hz.txt",
                    "c0080803529fb32bdc2aa209af6147647c1b6915fd3b87c1ef2fbdac4c451965",
                ),
                (
                    "no-pp-square-wave-10mm-1Hz.txt",
                    "5b900d7005183dda2d61ab21ee0eec75ec883fdb30db2f34dab5a8c1439d57f7",
                ),
            )
        ),
    ),
    "daisy": PublicSet(
        "hair dryer and flexible robot arm of DaISy, KU Leuven",
        "free with citation: De Moor B.L.R., DaISy",
        _at(
            "robotsorcerer/FARNN/9cfb82f2b42a53a604dba66d0eab23243a9a21ae",
            ("dryer.dat", "adcb2f5a1d9e174d08dd49f7f037626745b5e69cbda0bc1e8dca2a7c687d4538"),
            ("robot_arm.dat", "4ee167a8a28ce0da868d1b42f6a2fe0c456ea0e56b60c70915bf6d4a2a933635"),
            path="data/{}",
        ),
    ),
    "nist_strd": PublicSet(
        "regression sets with certified values, NIST",
        "public domain (US government)",
        _at(
            "mathnet/mathnet-numerics/84e9432bc1e8a6b2ae7acd32cda4175abeaeaed1",
            ("DanWood.dat", "df57252533d8e86489dbe0495b93f76a7c568cd2484442a12d12451721c207fe"),
            ("Eckerle4.dat", "007c2b0674e1b06e040045f7c68566a5e5e5537d8c18e51dfdbe20b308a3a16d"),
            ("Filip.dat", "1e8cb9a4644b1c6a8b1038eb46c59543814fa2a8d1ca31cb833040a75bf6a151"),
            ("Longley.dat", "c58ef65a2699826d55f134ddef27d09b9fb6ab4499fdd49a408b4cd5a63dc890"),
            ("MGH09.dat", "7652a2f0128f47266fe65d9feeb852b9109d3e59346cf9240163db3fe4276975"),
            ("Misra1a.dat", "8679e2dd54906496437605a047f5de81677ab056bdc73cfa56374a230be72974"),
            ("Norris.dat", "cc3fd14d1c5fa891d5653000c9d7732c30db842cca49fc051abde1c19d67ab7d"),
            ("Thurber.dat", "dcf20ab4ddd93676ec993bb785675d378d97ebdbae8f37b884e8e68d30949bbc"),
            ("Wampler5.dat", "dd00873dea76a3adb0f7e01be4a9d96f368983cb4be1a89517963a24d3d12afa"),
            path="data/NIST/{}",
        ),
    ),
}


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
        found = sha256_of(place / file.name)
        if found != file.sha256:
            raise DataError(
                f"{place / file.name}: SHA-256 {found[:12]}..., not {file.sha256[:12]}...: it is not the file that was "
                "published. Restore it, or move it away to have it downloaded again."
            )
    return place


def _listed_files(name: str, files: Iterable[PublicFile]) -> str:
    return join_words([f"{name}/{file.name}" for file in files])


def _short(error: Exception) -> str:
    """Message of an error in one line, or its type where the message is long."""
    message = str(error).strip()
    return message.rstrip(".") if 0 < len(message) <= SHORT and "\n" not in message else type(error).__name__
