"""The parameter file: its class, and reading and writing it; an incomplete file is never left behind."""

import os
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, PrivateAttr, ValidationError, model_validator

from ..core.bounded import LIMITS, parse_json, read_bounded
from ..core.display import Plottable
from ..core.errors import GateError, ParameterError
from ..core.files import cause, write_whole
from ..core.journal import only_writer, recover, write_together
from ..core.suggestions import near_path
from ..core.text import json_text
from .file_format import REMEDY, SCHEMA, content_sha256, migrated
from .messages import schema_message
from .sections.base import Section, Sha256
from .sections.costs import CostsSection
from .sections.dynamics import DynamicsSection, PiSection
from .sections.edge_sums import VersionSection
from .sections.force_control import AdaptiveForceSection, DriveSection, RoughnessSection
from .sections.law import LawSection
from .sections.law_parts import ToolLifeSection
from .sections.load_line import LimitsSection, LoadLineSection
from .sections.origin import DesignSection, IdentitySection, ProvenanceSection, ReadingSection
from .sections.posterior import PosteriorSection

TABLES = (".csv", ".tsv", ".txt", ".dat", ".xlsx", ".xlsm", ".xls", ".xlsb", ".ods")  # ends of names of tables of tests


class ParameterFile(Plottable, Section):
    """Parameter file of one tool and work material.

    Attributes
    ----------
    schema_version : str
        ``fitmodels.parameters/10``.
    identity : IdentitySection
    reading : ReadingSection or None
        Doubts about the data file; None where its values were not judged, as in files of schema version 1.
    design : Design or None
        The tests behind the laws; earlier files lack it and stay valid.
    laws : dict of LawSection
        By the symbol of the response.
    tool_life : ToolLifeSection or None
        Solved from the wear law at a criterion.
    posterior : Posterior or None
        Summaries of the posterior draws of the laws' parameters, and the file that holds them.
    dynamics : Dynamics or None
        The identified feed drive and cut.
    drive : Drive or None
        Inertia and friction of the feed drive.
    pi : Pi or None
        Gains tuned on the dynamics.
    load_line : LoadLine or None
        Settings of milling at constant load.
    limits : Limits or None
        What machine, tool and work allow.
    costs : Costs or None
        Rates, prices and times from which the cost of a part follows; earlier files have none.
    roughness : Roughness or None
        Settings of turning at constant roughness.
    adaptive_force : AdaptiveForce or None
        Estimates and rates of adaptive force control.
    history : tuple of VersionSection
        Versions with further edges, in their order; empty for the file of a fit.
    provenance : ProvenanceSection
    content_sha256 : str or None
        Checksum of everything else (see `file_format`) when written; it is ignored when files are compared.

    Sections and fields that this version does not know are kept, and written back.

    Examples
    --------
    >>> pf = ParameterFile(identity={"tool": "GC435", "work": "709M40", "simulated": True},
    ...                    provenance={"fitmodels": "0.1.0"})
    >>> pf.identity.simulated
    True
    """

    schema_version: Literal["fitmodels.parameters/10"] = SCHEMA
    identity: IdentitySection
    reading: ReadingSection | None = None
    design: DesignSection | None = None
    laws: dict[str, LawSection] = Field(default_factory=dict)
    tool_life: ToolLifeSection | None = None
    posterior: PosteriorSection | None = None
    dynamics: DynamicsSection | None = None
    drive: DriveSection | None = None
    pi: PiSection | None = None
    load_line: LoadLineSection | None = None
    limits: LimitsSection | None = None
    costs: CostsSection | None = None
    roughness: RoughnessSection | None = None
    adaptive_force: AdaptiveForceSection | None = None
    history: tuple[VersionSection, ...] = ()
    provenance: ProvenanceSection
    content_sha256: Sha256 | None = None
    _is_read: bool = PrivateAttr(default=False)

    __hash__ = None  # type: ignore[assignment]  # it holds dictionaries

    @model_validator(mode="after")
    def _named(self) -> Self:
        """Refuse a law under the name of another response, and a section without a name."""
        for name, law in self.laws.items():
            if name != law.response:
                raise ValueError(f"laws.{name} is a law of {law.response}: give it the name of its response")
        if "" in (self.model_extra or {}):
            raise ValueError("a section has no name")
        return self

    @property
    def is_read(self) -> bool:
        """Whether the file was read from disk, where it must have its checksum."""
        return self._is_read

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ParameterFile):
            return NotImplemented
        bare = ({**vars(pf), "content_sha256": None} for pf in (self, other))
        return next(bare) == next(bare) and self.model_extra == other.model_extra


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
        The file is missing, is not JSON, has another schema or version, or violates the schema:
        the message names the place.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> pf = ParameterFile(identity={"tool": "GC435", "work": "709M40", "simulated": False},
    ...                    provenance={"fitmodels": "0.1.0"})
    >>> with TemporaryDirectory() as folder:
    ...     read(write(pf, f"{folder}/params.json")) == pf
    True
    """
    recover(path)
    pf = _parse(_bytes(Path(path)), str(path))
    pf._is_read = True
    return pf


def write(
    pf: ParameterFile, path: str | os.PathLike[str], *, force: bool = False, replaces: ParameterFile | None = None
) -> Path:
    """Write a parameter file and renew its checksum; an incomplete file is never left behind.

    Parameters
    ----------
    pf : ParameterFile
        What is written.
    path : path-like
        In a folder that exists.
    force : bool
        Replace an existing file, whatever it contains.
    replaces : ParameterFile, optional
        Replace the file that was read as this one, only where its content is still the same.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    ParameterError
        The file exists, or was changed since ``replaces`` was read; the folder cannot be written; a section has a value
        that JSON cannot represent.

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
    if replaces is not None:
        return replace(pf, path, replaces)
    content = as_bytes(pf, str(path))
    if not force and os.path.lexists(path):
        raise ParameterError(f"{path}: the file exists; choose another path, or replace it with --force.")
    write_whole(path, content, error=ParameterError, force=force)
    return path


def replace(
    pf: ParameterFile,
    path: str | os.PathLike[str],
    former: ParameterFile,
    derived: Mapping[str, bytes | None] | None = None,
) -> Path:
    """Replace a parameter file that still has the content of ``former``, and with it the files derived from it.

    The folder is locked while the contents are compared and the files are renamed: of two processes that read the same
    file, the second is refused. A link is followed.

    Parameters
    ----------
    pf, path, former
        What is written, where, and what was read there.
    derived : mapping of str to bytes or None
        Pictures of the file's sections by their names in its folder, such as ``figures/pi.png``, None to remove them;
        see `fitmodels.core.journal.write_together`.

    Raises
    ------
    ParameterError
        The file has another content, or a file cannot be written.
    UsageError
        Another process keeps the folder locked.
    """
    target = Path(os.path.realpath(path))
    content = as_bytes(pf, str(path))
    recover(target)
    busy = f"{path}: another process has kept its folder locked for 10 s; nothing was written. Run the command again."
    if not target.parent.is_dir():
        raise ParameterError(f"{path}: its folder was removed since it was read; nothing was written.")
    pictures = {target.parent / name: data for name, data in (derived or {}).items()}
    with only_writer(target.parent, busy):
        _check_unchanged(target, former, str(path))
        write_together(target, content, pictures, error=ParameterError)
    return Path(path)


def picture_folder(path: str | os.PathLike[str]) -> Path:
    """Folder of the file that a path or a link leads to, in which `replace` puts its pictures.

    >>> picture_folder("nowhere/params.json").name
    'nowhere'
    """
    path = Path(path)
    return (Path(os.path.realpath(path)) if path.is_symlink() else path).parent


def _check_unchanged(target: Path, former: ParameterFile, name: str) -> None:
    if not target.exists():
        raise ParameterError(f"{name}: the file was removed since it was read; nothing was written.")
    then, now = (content_sha256(pf.model_dump()) for pf in (former, read(target)))
    if then != now:
        raise ParameterError(
            f"{name}: another program changed the file since it was read (content {then[:8]} then, {now[:8]} now), so "
            "nothing was written. Run the command again: it starts from the changed file."
        )


def as_bytes(pf: ParameterFile, name: str = "the parameter file") -> bytes:
    r"""The bytes that `write` puts on disk, with the checksum renewed; ParameterError, with ``name``, as for `write`.

    >>> pf = ParameterFile(identity={"tool": "GC435", "work": "709M40", "simulated": False},
    ...                    provenance={"fitmodels": "0.1.0"})
    >>> as_bytes(pf)[:20]
    b'{\n  "schema_version"'
    """
    checksum, content = _content(pf.model_dump(), name, indent=2)
    if checksum != pf.content_sha256:  # otherwise it was read back when its checksum was made
        _parse(content, name)
    return content


def sealed(pf: ParameterFile, **sections: object) -> ParameterFile:
    """The file with the given sections added or replaced, and its checksum renewed.

    Raises
    ------
    ParameterError
        A section violates the schema, or has a value that JSON cannot represent.

    Examples
    --------
    >>> pf = ParameterFile(identity={"tool": "GC435", "work": "709M40", "simulated": False},
    ...                    provenance={"fitmodels": "0.1.0"})
    >>> sealed(pf, limits={"power": {"value": 7.0, "unit": "kW"}}).limits.power.value
    7.0
    """
    data = {**pf.model_dump(), **{name: _data(value) for name, value in sections.items()}}
    name = "the parameter file"
    return _parse(_content(data, name)[1], name)


def _data(value: object) -> object:
    """Sections as data, also those in a dictionary."""
    if isinstance(value, Mapping):
        return {key: _data(inner) for key, inner in value.items()}
    return value.model_dump() if isinstance(value, Section) else value


def seal_fault(pf: ParameterFile) -> str:
    """Reason why the content of a file that was read is not known to be what fitmodels wrote; empty where it is.

    Examples
    --------
    >>> pf = sealed(ParameterFile(identity={"tool": "GC435", "work": "709M40", "simulated": False},
    ...                           provenance={"fitmodels": "0.1.0"}))
    >>> seal_fault(pf), seal_fault(pf.model_copy(update={"content_sha256": None}))
    ('', 'it has no content_sha256, so that a change since it was written cannot be detected')
    """
    if pf.content_sha256 is None:
        return "it has no content_sha256, so that a change since it was written cannot be detected"
    found = content_sha256(pf.model_dump(exclude_unset=True))
    if found == pf.content_sha256:
        return ""
    return f"its content was changed after it was written (SHA-256 {found[:12]}..., not {pf.content_sha256[:12]}...)"


def require_unchanged(pf: ParameterFile) -> None:
    """Raise where the content of a file is not that of its checksum, or a file read from disk has none.

    Raises
    ------
    GateError
        The content was changed after it was written, or may have been.

    Examples
    --------
    >>> pf = sealed(ParameterFile(identity={"tool": "GC435", "work": "709M40", "simulated": False},
    ...                           provenance={"fitmodels": "0.1.0"}))
    >>> require_unchanged(pf)
    """
    if (pf.is_read or pf.content_sha256 is not None) and (fault := seal_fault(pf)):
        raise GateError(
            f"the file fails the check: {fault}: restore the file, or make the change with fitmodels, which writes it."
        )


def require_seal(pf: ParameterFile, name: str) -> None:
    """Raise unless the checksum of a file agrees: what is written from it would carry a checksum for an unknown change.

    Raises
    ------
    ParameterError
        The checksum is missing, or is that of another content; ``name`` begins the message.
    """
    if fault := seal_fault(pf):
        raise ParameterError(
            f"{name}: {fault}. Nothing was written from it. Restore the file, or fit again and make the change with "
            "the commands of fitmodels."
        )


def _content(data: dict[str, Any], name: str, **options: int) -> tuple[str, bytes]:
    """Checksum of the data of a file, and its bytes with this checksum; ``options`` of `json.dumps`."""
    try:
        renewed = {**data, "content_sha256": None}
        renewed["content_sha256"] = checksum = content_sha256(renewed)
        content = (json_text(renewed, **options) + "\n").encode()
    except (TypeError, ValueError, RecursionError) as error:
        raise ParameterError(f"{name}: a section has a value that JSON cannot represent: {error}.") from None
    if len(content) > (largest := LIMITS["parameters"].size):
        raise ParameterError(f"{name}: {len(content)} bytes to write; the limit is {largest}.")
    return checksum, content


def _bytes(path: Path) -> bytes:
    try:
        if path.is_dir():
            raise ParameterError(f"{path}: is a folder; give the path of the params.json in it.")
        return read_bounded(path, "parameters", ParameterError)
    except FileNotFoundError:
        near = near_path(path)
        remedy = f"did you mean {near}?" if near else "give the path of a params.json written by fitmodels."
        raise ParameterError(f"{path}: the file does not exist; {remedy}") from None
    except (OSError, ValueError) as error:
        raise ParameterError(f"{path}: cannot be read: {cause(error)}.") from None


def _parse(content: bytes, name: str) -> ParameterFile:
    if name.lower().endswith(TABLES) and not content.lstrip().startswith(b"{"):
        raise ParameterError(
            f"{name}: is a table, not a parameter file: fit it first (fitmodels {shlex.quote(name)}), and give the "
            "params.json that this writes."
        )
    data = migrated(parse_json(content, name, error=ParameterError, remedy=REMEDY), name)
    try:
        return ParameterFile.model_validate(data)
    except ValidationError as error:
        raise ParameterError(f"{name}: {schema_message(error, data)}. {REMEDY}") from None
