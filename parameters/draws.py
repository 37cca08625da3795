"""Posterior draws in an ``.npz`` file next to the parameter file, read without pickle and verified by its hash."""

import hashlib
import io
import os
import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Array
from ..core.bounded import LIMITS, UNREADABLE_ARCHIVE, open_archive, read_bounded
from ..core.display import Plottable, as_columns
from ..core.errors import ParameterError
from .messages import short

if TYPE_CHECKING:
    from ..core.display import Frame
    from .file import ParameterFile
    from .sections.posterior import PosteriorSection


REMEDY = "Fit again, or restore the file."
DAMAGED = (*UNREADABLE_ARCHIVE, KeyError, MemoryError)
HEADER = re.compile(
    rb"\x93NUMPY\x01\x00..\{'descr': '<(f8|U\d{1,4})', 'fortran_order': (?:True|False), "
    rb"'shape': \((\d{1,12}),(?: (\d{1,12}))?\), \} *\n",
    flags=re.DOTALL,
)


@dataclass(frozen=True, slots=True, repr=False)
class Draws(Plottable):
    """Draws of one law's parameters.

    Attributes
    ----------
    names : tuple of str
        As in the posterior section.
    values : ndarray, shape (S, q)
    """

    names: tuple[str, ...]
    values: Array

    def to_frame(self) -> "Frame":
        """The draws, one column per parameter."""
        return as_columns(self, **dict(zip(self.names, self.values.T, strict=True)))


def packed(draws: Mapping[str, Draws]) -> bytes:
    """The bytes of the file: for each response its draws and their names; the same draws give the same bytes.

    Examples
    --------
    >>> packed({"AW": Draws(("V",), np.ones((2, 1)))})[:2]
    b'PK'
    """
    arrays: dict[str, NDArray[np.generic]] = {}
    for response, of in draws.items():
        arrays[f"{response}.draws"] = of.values
        arrays[f"{response}.names"] = np.array(of.names, dtype=np.str_)
    with io.BytesIO() as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]
        return file.getvalue()


def read_draws(pf: "ParameterFile", folder: str | os.PathLike[str]) -> dict[str, Draws]:
    """Posterior draws of a parameter file, by response.

    Parameters
    ----------
    pf : ParameterFile
    folder : path-like
        Folder of the draws file and of the parameter file.

    Returns
    -------
    dict of Draws
        Empty where the file has no draws.

    Raises
    ------
    ParameterError
        The file is missing, is not the one that was written, or contains anything but numbers and names.

    Examples
    --------
    >>> from fitmodels.parameters import ParameterFile
    >>> pf = ParameterFile(identity={"tool": "GC435", "work": "709M40", "simulated": False},
    ...                    provenance={"fitmodels": "0.1.0"})
    >>> read_draws(pf, ".")
    {}
    """
    section = pf.posterior
    if section is None or section.draws_file is None:
        return {}
    path = Path(folder) / section.draws_file
    try:
        content = read_bounded(path, "draws", ParameterError)
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise ParameterError(f"{path}: the draws of {pf.identity.tool} cannot be read: {why}. {REMEDY}") from None
    found = hashlib.sha256(content).hexdigest()
    if found != section.draws_sha256:
        raise ParameterError(
            f"{path}: not the draws that the parameter file was written with (SHA-256 {found[:12]}..., "
            f"not {str(section.draws_sha256)[:12]}...). {REMEDY}"
        )
    return unpacked(content, str(path))


def unpacked(content: bytes, name: str) -> dict[str, Draws]:
    """Draws from the bytes of a file; ParameterError if they are not valid."""
    try:
        with open_archive(content, name, LIMITS["draws"].size, ParameterError, remedy=REMEDY) as archive:
            for item in archive.infolist():
                _check_header(archive, item)
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            responses = [key.removesuffix(".draws") for key in arrays.files if key.endswith(".draws")]
            return {response: _one(arrays, response, name) for response in responses}
    except DAMAGED as error:
        why = (str(error) or type(error).__name__).splitlines()[0].rstrip(".")
        raise ParameterError(f"{name}: is not a file of draws: {why}. {REMEDY}") from None


def _check_header(archive: zipfile.ZipFile, item: zipfile.ZipInfo) -> None:
    """Refuse an array unlike those that are written: numpy evaluates a header, and reserves memory before it reads."""
    with archive.open(item) as file:
        head = file.read(300)
    found = HEADER.match(head)
    if found is None or found.end() != 10 + int.from_bytes(head[8:10], "little"):
        raise ValueError(f"{item.filename} is no array of numbers or names")
    size = 8 if found[1] == b"f8" else 4 * int(found[1][1:])
    if size * int(found[2]) * int(found[3] or 1) != item.file_size - found.end():
        raise ValueError(f"{item.filename} has {item.file_size} bytes, which its header does not describe")


def _one(arrays: Mapping[str, NDArray[np.generic]], response: str, name: str) -> Draws:
    values, names = arrays[f"{response}.draws"], arrays[f"{response}.names"]
    if values.dtype != np.float64 or values.ndim != 2 or names.shape != values.shape[1:] or names.dtype.kind != "U":
        raise ParameterError(
            f"{name}: the draws of {short(response)} are not a table of numbers with named columns. {REMEDY}"
        )
    if not len(values):
        raise ParameterError(f"{name}: has no draw of {short(response)}. {REMEDY}")
    if not np.isfinite(values).all():
        raise ParameterError(f"{name}: a draw of {short(response)} is not finite. {REMEDY}")
    return Draws(tuple(str(n) for n in names), np.asarray(values, dtype=np.float64))


def joined_posterior(
    files: Sequence[tuple["PosteriorSection | None", Mapping[str, Draws]]], laws: Mapping[str, int], stem: str
) -> tuple[dict[str, Any] | None, bytes | None]:
    """Posterior section and draws of laws from several files.

    Draws of one file stay paired with each other. Those of each further file are put into another order, the same for
    all of its laws: files of one seed come from one stream of random numbers, and draws of independent tests must not
    be correlated by it.

    Parameters
    ----------
    files : sequence of section and draws
    laws : mapping of str to int
        Number of the file of each law.
    stem : str
        Beginning of the name of the file of draws, which ends with their checksum: of two versions each has its own.

    Returns
    -------
    dict or None
        The section.
    bytes or None
        Content of the file of draws.
    """
    kept = {response: files[number] for response, number in laws.items()}
    held = {name: of for name, (of, _) in kept.items() if of is not None and name in of.laws}
    if not held:
        return None, None
    section = {"seed": next(iter(held.values())).seed, "laws": _kept_laws(held, kept)}
    first = min((number for number, (_, draws) in enumerate(files) if draws), default=0)
    given = {name: _reordered(kept[name], name, laws[name] == first) for name in held if name in kept[name][1]}
    if not given:
        return section, None
    content = packed(given)
    digest = hashlib.sha256(content).hexdigest()
    return {**section, "draws_file": f"{stem}-draws-{digest[:12]}.npz", "draws_sha256": digest}, content


def _kept_laws(
    held: Mapping[str, "PosteriorSection"], kept: Mapping[str, tuple["PosteriorSection | None", Mapping[str, Draws]]]
) -> dict[str, Any]:
    """Posterior of each law; a reason where its draws were not kept and those of another law are."""
    some = any(draws for _, draws in kept.values())
    lost = {"reason": "its draws were not kept, and those of other laws are"}
    found = {name: of.laws[name].model_dump() for name, of in held.items()}
    return {
        name: lost if some and law["method"] is not None and name not in kept[name][1] else law
        for name, law in found.items()
    }


def _reordered(file: tuple["PosteriorSection | None", Mapping[str, Draws]], response: str, first: bool) -> Draws:
    """Draws of a law, those of the first file in their order, of another one in that of its checksum."""
    section, draws = file
    found = draws[response]
    if first:
        return found
    seed = int(str((section and section.draws_sha256) or "0")[:16], 16)
    return Draws(found.names, found.values[np.random.default_rng(seed).permutation(len(found.values))])
