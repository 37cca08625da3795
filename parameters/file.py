"""The parameter file: its schema, and reading and writing it whole or not at all."""

import json
import os
import secrets
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Final, Literal

from pydantic import Field, JsonValue, ValidationError, field_validator

from .errors import ParameterError, in_words, short
from .law import Law
from .posterior import Posterior
from .sections import Count, Section, Text, ToolLifeSection
from .strict_json import CURE, strict_json

SCHEMA: Final = "fitmodels.parameters/1"
LARGEST = 50_000_000  # bytes


class Identity(Section):
    """Whose parameters these are; ``simulated`` when the data came from a simulation.

    Examples
    --------
    >>> Identity(tool="GC435", work="709M40", simulated=False).tool
    'GC435'
    """

    tool: Text
    work: Text
    machine: str | None = None
    simulated: bool = Field(strict=True)
    note: str | None = None


class Provenance(Section):
    """Where the numbers come from: the data, the program and how it was called.

    Attributes
    ----------
    fitmodels : str
        Version of the program.
    versions : dict of str
        Versions of python, numpy and scipy.
    data_file, data_sha256, n_rows
        Name, checksum and number of rows of the data file.
    created : str or None
        ISO date, as it was given.
    command, options, seed
        How it was called.

    Examples
    --------
    >>> Provenance(fitmodels="0.1.0", data_file="data.csv", n_rows=120).n_rows
    120
    """

    created: str | None = None
    data_file: str | None = None
    data_sha256: str | None = Field(default=None, pattern="^[0-9a-f]{64}$")
    n_rows: Count | None = None
    fitmodels: Text
    versions: dict[str, str] = Field(default_factory=dict)
    command: str | None = None
    options: dict[str, JsonValue] = Field(default_factory=dict)
    seed: Count | None = None

    @field_validator("created")
    @classmethod
    def _is_a_date(cls, created: str | None) -> str | None:
        if created is not None:
            try:
                datetime.fromisoformat(created)
            except ValueError:
                raise ValueError(f"{short(created)} is not an ISO date such as 2024-05-01") from None
        return created


class ParameterFile(Section):
    """Everything handed over for one tool and work material.

    Attributes
    ----------
    schema_version : str
        ``fitmodels.parameters/1``.
    identity : Identity
    laws : dict of Law
        By the symbol of the response.
    tool_life : ToolLifeSection or None
        Solved from the wear law at a criterion.
    posterior : Posterior or None
        What draws of the laws' parameters say, and the file that holds them.
    provenance : Provenance

    Sections and fields that this version does not know are kept, and written back.

    Examples
    --------
    >>> pf = ParameterFile(identity={"tool": "GC435", "work": "709M40", "simulated": True},
    ...                    provenance={"fitmodels": "0.1.0"})
    >>> pf.identity.simulated
    True
    """

    schema_version: Literal["fitmodels.parameters/1"] = SCHEMA
    identity: Identity
    laws: dict[str, Law] = Field(default_factory=dict)
    tool_life: ToolLifeSection | None = None
    posterior: Posterior | None = None
    provenance: Provenance


def read(path: str | os.PathLike[str]) -> ParameterFile:
    """Read a parameter file.

    Parameters
    ----------
    path : path-like
        A JSON file of at most 50 MB, UTF-8.

    Returns
    -------
    ParameterFile

    Raises
    ------
    ParameterError
        The file is missing, is not JSON, is of another schema or version, or breaks the schema:
        the sentence names the place.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> pf = ParameterFile(identity={"tool": "GC435", "work": "709M40", "simulated": False},
    ...                    provenance={"fitmodels": "0.1.0"})
    >>> with TemporaryDirectory() as folder:
    ...     read(write(pf, f"{folder}/params.json")) == pf
    True
    """
    return _parse(_bytes(Path(path)), str(path))


def write(pf: ParameterFile, path: str | os.PathLike[str], *, force: bool = False) -> Path:
    """Write a parameter file, whole or not at all.

    Parameters
    ----------
    pf : ParameterFile
        What is written.
    path : path-like
        In a folder that exists.
    force : bool
        Replace a file that is there.

    Returns
    -------
    Path
        Where it was written.

    Raises
    ------
    ParameterError
        A file is there, the folder cannot be written, or a section holds what JSON cannot.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> pf = ParameterFile(identity={"tool": "GC435", "work": "709M40", "simulated": False},
    ...                    provenance={"fitmodels": "0.1.0"})
    >>> with TemporaryDirectory() as folder:
    ...     write(pf, f"{folder}/params.json").name
    'params.json'
    """
    path = Path(path)
    content = _content(pf, path)
    if not force and os.path.lexists(path):
        raise ParameterError(f"{path}: there is a file already; choose another path, or replace it with --force.")
    _replace(path, content)
    return path


def _content(pf: ParameterFile, path: Path) -> bytes:
    """Give the file's bytes; what could not be read again is refused here."""
    try:
        text = json.dumps(pf.model_dump(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        content = text.encode()
    except (TypeError, ValueError, RecursionError) as error:
        raise ParameterError(f"{path}: a section holds what JSON cannot: {error}.") from None
    if len(content) > LARGEST:
        raise ParameterError(f"{path}: {len(content)} bytes to write; the limit is {LARGEST}.")
    _parse(content, str(path))
    return content


def _replace(path: Path, content: bytes) -> None:
    temporary = path.parent / f".fitmodels-{secrets.token_hex(8)}.tmp"
    try:
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)  # noqa: PTH105 - stands beside fsync, and both are made to fail in tests
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        raise ParameterError(f"{path}: cannot be written: {_cause(error)}.") from None
    finally:
        with suppress(OSError, ValueError):
            temporary.unlink(missing_ok=True)


def _bytes(path: Path) -> bytes:
    try:
        if path.is_dir():
            raise ParameterError(f"{path}: is a folder; give the path of the params.json in it.")
        size = path.stat().st_size
        if not path.is_file():
            raise ParameterError(f"{path}: is not a plain file; a parameter file is read from disk.")
        if size > LARGEST:
            raise ParameterError(f"{path}: {size} bytes; a parameter file has at most {LARGEST}.")
        return path.read_bytes()
    except FileNotFoundError:
        cure = "give the path of a params.json written by fitmodels"
        raise ParameterError(f"{path}: there is no such file; {cure}.") from None
    except (OSError, ValueError) as error:
        raise ParameterError(f"{path}: cannot be read: {_cause(error)}.") from None


def _cause(error: OSError | ValueError) -> str:
    return (getattr(error, "strerror", None) or str(error)).lower()


def _parse(content: bytes, name: str) -> ParameterFile:
    data = strict_json(content, name)
    _check_version(data, name)
    try:
        return ParameterFile.model_validate(data)
    except ValidationError as error:
        raise ParameterError(f"{name}: {in_words(error, data)}. {CURE}") from None


def _check_version(data: object, name: str) -> None:
    if not isinstance(data, dict) or "schema_version" not in data:
        raise ParameterError(f"{name}: is not a parameter file: it has no schema_version {SCHEMA}.")
    found = data["schema_version"]
    if found == SCHEMA:
        return
    family, _, number = found.partition("/") if isinstance(found, str) else ("", "", "")
    if family == SCHEMA.partition("/")[0] and number.isdecimal() and number not in ("0", "1"):
        raise ParameterError(
            f"{name}: is of the newer schema {short(found)}; this version reads {SCHEMA}. Upgrade fitmodels."
        )
    raise ParameterError(f"{name}: schema_version is {short(found)}, not {SCHEMA}; is it a parameter file?")
