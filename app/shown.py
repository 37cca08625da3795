"""Checksums of the content of a page, which its forms carry: a request of a page that is out of date runs nothing."""

import hashlib
from collections.abc import Mapping
from typing import Final

from ..core.bounded import sha256_of
from ..core.errors import UsageError
from ..core.text import json_text
from .command_forms import Subject, actions
from .project import CHANGED, Entry, Project
from .stages import OF_CONTROL, current_files, states

OPTIONS: Final = "shown-options"
FILES: Final = "shown-files"
PAGE: Final = "shown-page"  # name of the page itself
NAMES: Final = (OPTIONS, FILES, PAGE)


def of_options(entry: Entry) -> str:
    """Checksum of the options of a file and their reasons.

    >>> of_options(Entry(name="d.csv", sha256=64 * "0", options=("--unit", "VB=um")))
    'bac69dcc8f03c1da'
    """
    return _short(json_text([entry.options, entry.reasons]).encode())


def of_files(project: Project, entry: Entry) -> str:
    """Checksum of the parameter files of a file."""
    current, former = current_files(project, entry)
    sums = []
    for path in sorted(current or former):
        try:
            sums.append(f"{path} {sha256_of(project.folder / path)}")
        except OSError:  # a command replaces it at this moment
            sums.append(path)
    return _short("\n".join(sums).encode())


def check_options(entry: Entry, given: Mapping[str, str]) -> None:
    """Refuse a request of a page that shows other options than the file has.

    Raises
    ------
    UsageError
    """
    if given.get(OPTIONS, of_options(entry)) != of_options(entry):
        raise UsageError(CHANGED)


def check_all(project: Project, entry: Entry, given: Mapping[str, str], left: str = "") -> None:
    """Refuse a request of a page that shows other options or parameter files than there are.

    Parameters
    ----------
    project : Project
    entry : Entry
    given : mapping of str
        Fields of the form.
    left : str
        Checksum of the parameter files at the end of the last command of this page, which it may not show yet.

    Raises
    ------
    UsageError
    """
    check_options(entry, given)
    if FILES in given and of_files(project, entry) not in (given[FILES], left):
        raise UsageError(CHANGED)


def outdated_control(project: Project, entry: Entry, of: Subject) -> str:
    """Sentence on settings, dynamics or gains of a control that are outdated; empty where none is."""
    found, titles = states(project, entry, of), {one.name: one.title for one in actions(of)}
    old = [f"{titles[name]} ({found[name].outdated})" for name in OF_CONTROL if name in found and found[name].outdated]
    if not old:
        return ""
    return (
        f"Not exported: outdated: {'; '.join(old)}. The control would mix former values with new ones: run these again."
    )


def _short(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]
