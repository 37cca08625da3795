"""A project folder: the files that were added, the options of the command that fits each, and what was run.

Everything in the folder is a file of the ordinary commands, which give the same results there; ``project.json`` holds
the options alone.
"""

import hashlib
import os
import re
import threading
import unicodedata
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, BinaryIO, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ..core.bounded import read_bounded, sha256_of
from ..core.errors import DataError, UsageError
from ..core.files import make_folder, temporary_name, write_whole
from ..core.text import json_text, printable
from ..datasets.several_files import TABLES
from ..datasets.signals.recording import SUFFIXES as RECORDS

SCHEMA: Literal["fitmodels.project/1"] = "fitmodels.project/1"
FILE = "project.json"
CHANGED = (
    "This file was changed since this page was shown (another tab or a command): reload the page. Nothing was run."
)
SUFFIXES = tuple(dict.fromkeys((*TABLES, *RECORDS)))  # of the files that can be added
RESERVED = re.compile(r"(?i)(?:con|prn|aux|nul|com\d|lpt\d)")  # names of devices on Windows
LONGEST_NAME = 60
MOST_STEPS = 500
BLOCK = 1 << 20  # bytes copied at once
LONGEST_OPTION = 1000  # characters
Short = Annotated[str, Field(max_length=LONGEST_OPTION)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Entry(_Strict):
    """A file of the project.

    Attributes
    ----------
    name : str
        In the folder.
    sha256 : str
        Of the file as it was added.
    options : tuple of str
        Of the command that fits it, as typed.
    reasons : mapping of str
        Why rows or edges are left out, by target.
    """

    name: Short
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    options: tuple[Short, ...] = ()
    reasons: dict[Short, Short] = Field(default_factory=dict)

    @property
    def stem(self) -> str:
        """The name without its suffix, with which the names of all results begin."""
        return Path(self.name).stem


class Step(_Strict):
    """A command that was run, when, and its exit code."""

    time: Short
    words: tuple[Short, ...]
    code: int


class _Content(_Strict):
    format: Literal["fitmodels.project/1"] = Field(default=SCHEMA, alias="schema")
    files: tuple[Entry, ...] = ()
    steps: tuple[Step, ...] = ()


class Project:
    r"""The folder of a project, and what stands in its ``project.json``.

    Parameters
    ----------
    folder : path
        Made where it does not exist.

    Raises
    ------
    UsageError
        The folder cannot be made, or its ``project.json`` is none of a project.

    Examples
    --------
    >>> import io, tempfile
    >>> project = Project(tempfile.mkdtemp())
    >>> entry = project.add("../../tests 1.csv", io.BytesIO(b"V,f,t,VB\n100,0.2,5,0.1\n"))
    >>> entry.name, [one.name for one in Project(project.folder).files]
    ('tests_1.csv', ['tests_1.csv'])
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder).resolve()
        self._lock = threading.RLock()
        make_folder(self.folder, "--folder")
        self._known = b""
        self._content = self._read()

    @property
    def files(self) -> tuple[Entry, ...]:
        """Files of the project, in the order in which they were added."""
        return self._content.files

    @property
    def steps(self) -> tuple[Step, ...]:
        """Commands that were run."""
        return self._content.steps

    def entry(self, name: str) -> Entry | None:
        """The file of a name."""
        return next((one for one in self.files if one.name == name), None)

    def add(self, name: str, content: BinaryIO) -> Entry:
        """Add a file under a harmless name; one with the same content is not added twice.

        Raises
        ------
        DataError
            The suffix is not one of a table or record, or the file is empty.
        """
        wanted = safe_name(name)
        made, digest = self.folder / temporary_name(), hashlib.sha256()
        try:
            with made.open("xb") as out:
                while block := content.read(BLOCK):
                    digest.update(block)
                    out.write(block)
            if not made.stat().st_size:
                raise DataError(f"{wanted} is empty: add a file with a table of tests or a record.")
            with self._lock:
                found = next((one for one in self.files if one.sha256 == digest.hexdigest()), None)
                if found is not None and (self.folder / found.name).is_file():
                    return found
                entry = Entry(name=self._free(wanted), sha256=digest.hexdigest())
                made.replace(self.folder / entry.name)
                try:
                    self._write(files=(*self.files, entry))
                except (UsageError, OSError):
                    (self.folder / entry.name).unlink(missing_ok=True)
                    raise
        finally:
            made.unlink(missing_ok=True)
        return entry

    def change(self, entry: Entry, options: Sequence[str], reasons: dict[str, str] | None = None) -> Entry:
        """Set the options of a file, and the reasons of what is left out.

        Raises
        ------
        UsageError
            They are no longer those of ``entry``.
        """
        with self._lock:
            now = next((one for one in self.files if one.name == entry.name), None)
            if now is None or (now.options, now.reasons) != (entry.options, entry.reasons):
                raise UsageError(CHANGED)
            new = Entry(
                name=entry.name, sha256=entry.sha256, options=tuple(options),
                reasons=entry.reasons if reasons is None else reasons,
            )  # fmt: skip
            self._write(files=tuple(new if one.name == entry.name else one for one in self.files))
        return new

    def ran(self, words: Sequence[str], code: int) -> None:
        """Record a command that was run."""
        step = Step(time=datetime.now(UTC).isoformat(timespec="seconds"), words=tuple(words), code=code)
        with self._lock:
            self._write(steps=(*self.steps, step)[-MOST_STEPS:])

    def results(self, entry: Entry) -> dict[str, Path]:
        """Files that the commands on a file have written, by their path in the folder; links are left out."""
        found = [path for path in self.folder.glob(f"{_escaped(entry.stem)}-*") if path.name != entry.name]
        every = [path for top in found for path in ([top] if top.is_file() else _below(top))]
        whole = (path for path in every if path.is_file() and not _through_link(path, self.folder))
        return {path.relative_to(self.folder).as_posix(): path for path in whole}

    def parameter_files(self, entry: Entry) -> list[str]:
        """Parameter files among the results."""
        top = f"{entry.stem}-fit/"
        return [name for name in self.results(entry) if name.startswith(top) and name.endswith("/params.json")]

    def is_changed(self, entry: Entry) -> bool:
        """Whether the file in the folder is not the one that was added."""
        path = self.folder / entry.name
        return not path.is_file() or sha256_of(path) != entry.sha256

    def _free(self, wanted: str) -> str:
        """A name whose stem begins the name of no other file of the folder."""
        path, taken = Path(wanted), {one.name.casefold() for one in self.folder.iterdir()}
        for k in range(1, 10_000):
            stem = path.stem if k == 1 else f"{path.stem}_{k}"
            own = stem.casefold()
            if not any(Path(name).stem == own or name.startswith(f"{own}-") for name in taken):
                return f"{stem}{path.suffix}"
        raise DataError(f"{wanted}: the project has too many files of this name; rename it.")

    def _read(self) -> _Content:
        path = self.folder / FILE
        if not path.exists():
            return _Content()
        try:
            self._known = read_bounded(path, "state")
            return _Content.model_validate_json(self._known)
        except (ValidationError, OSError) as failure:
            raise UsageError(
                f"{path} is no project of fitmodels ({printable(str(failure).splitlines()[0])}): choose another folder "
                "with --folder, or remove this file; the data in the folder are kept."
            ) from None

    def _write(self, **changed: object) -> None:
        path, content = self.folder / FILE, self._content.model_copy(update=changed)
        if (path.read_bytes() if path.exists() else b"") != self._known:
            raise UsageError(
                f"{path} was changed by another program: end this page, and start 'fitmodels app' again. Nothing was "
                "changed here."
            )
        data = json_text(content.model_dump(by_alias=True), indent=1).encode()
        write_whole(path, data)
        self._content, self._known = content, data


def safe_name(name: str) -> str:
    r"""A name of a file for this folder, of letters, digits and ``_``, with the suffix of a table.

    Without a hyphen, so that the results of one file, which begin with its stem and a hyphen, are none of another.

    Raises
    ------
    DataError
        The suffix is not one of a table or record.

    >>> safe_name("../../etc/pass wd.CSV"), safe_name("Versuch Ü-3 (neu).xlsx"), safe_name("..\\con.txt")
    ('pass_wd.csv', 'Versuch_Ü_3_neu.xlsx', 'data_con.txt')
    """
    last = re.split(r"[/\\]", unicodedata.normalize("NFC", name))[-1]
    stem, dot, suffix = last.rpartition(".")
    ending = f".{suffix.lower()}" if dot else ""
    if ending not in SUFFIXES:
        raise DataError(
            f"{printable(last)[:LONGEST_NAME] or 'the file'}: add a file that ends in {', '.join(SUFFIXES)}."
        )
    plain = re.sub(r"\W+", "_", stem).strip("_")[:LONGEST_NAME].strip("_")
    if not plain or RESERVED.fullmatch(plain):
        plain = f"data_{plain}".strip("_")
    return f"{plain}{ending}"


def _below(folder: Path) -> list[Path]:
    """Entries of a folder, sorted; nothing where a command replaces it at this moment."""
    try:
        return sorted(folder.rglob("*"))
    except OSError:
        return []


def _escaped(stem: str) -> str:
    """A stem as a pattern that matches it alone."""
    return re.sub(r"([*?\[])", r"[\1]", stem)


def _through_link(path: Path, folder: Path) -> bool:
    """Whether a path leads through a link, which could lead out of the folder."""
    return any(one.is_symlink() for one in (path, *path.parents) if one != folder and folder in one.parents)
