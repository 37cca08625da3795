"""Changes of several files in a folder that happen all or not at all, also where the process is killed in between.

The new files are written to a hidden folder next to them; then a journal, renamed into its place, lists what is to be
renamed and removed. A folder that is replaced whole (see `fitmodels.core.folders`) is moved aside for a moment. Whoever
next writes there as the only writer, or reads what is missing, completes the journal and restores the folder.
"""

import errno
import json
import logging
import os
import re
import shutil
import stat
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from .bounded import parse_json, read_bounded
from .errors import FitmodelsError, UsageError
from .files import (
    SHARE,
    TEMPORARY,
    cause,
    is_abandoned,
    locked_folder,
    make_folder,
    refuse_device,
    remove_stale,
    synchronised,
    synchronised_folder,
    temporary_name,
    write_whole,
)
from .text import printable_message

JOURNAL = ".fitmodels.journal"
_SEARCHED: dict[str, float] = {}  # folder: time of the next search for what ended processes left
SCHEMA = "fitmodels.journal/1"
MADE, FORMER = "made", re.compile(r"\.(?P<name>.+)(?P<token>\.fitmodels-[0-9a-f]{8}-\d+-[0-9a-f]{16})\.former")


@contextmanager
def only_writer(folder: Path, message: str = "", wait: float = 10.0) -> Iterator[None]:
    """Hold a folder as its only writer; what a killed process left unfinished in it is completed or undone first.

    Parameters
    ----------
    folder : Path
        Exists.
    message : str
        Of the error where another process keeps the lock longer than ``wait`` s.

    Raises
    ------
    UsageError
        Another process holds the lock, it cannot be taken here, or the journal is none of fitmodels.
    """
    busy = message or f"{folder}: another process has kept it locked for {wait:g} s; nothing was written. Run again."
    with locked_folder(folder, busy, wait):
        _restore_formers(folder)
        _complete_journal(folder)
        remove_stale(folder)
        _remove_stages(folder)
        yield


def recover(path: str | os.PathLike[str]) -> None:
    """Restore or complete what a killed process left unfinished at a file or folder that is about to be read.

    Nothing is written where nothing is unfinished. A folder that cannot be written stays as it is.

    Examples
    --------
    >>> recover("nowhere/params.json")
    """
    with suppress(OSError, ValueError, FitmodelsError):
        place = Path(os.path.realpath(path))
        missing = place
        while not os.path.lexists(missing.parent):
            missing = missing.parent
        if not os.path.lexists(missing) and any(name == missing.name for name, *_ in _formers(missing.parent)):
            with only_writer(missing.parent):
                pass
        folder = place if place.is_dir() else place.parent
        if os.path.lexists(folder / JOURNAL):
            with only_writer(folder):
                pass
        for each in (folder, folder.parent):
            _remove_left(each)


def _remove_left(folder: Path) -> None:
    """Remove what ended processes left in a folder, unless another process writes there now or it was just searched."""
    begun = time.monotonic()
    if _SEARCHED.get(str(folder), begun) > begun:
        return
    with suppress(OSError, FitmodelsError):
        with os.scandir(folder) as entries:
            hidden = [Path(entry.path) for entry in entries if entry.name.startswith(".")]
        if any(FORMER.fullmatch(path.name) or is_abandoned(path) for path in hidden):
            with only_writer(folder, wait=0.0):
                pass
    end = time.monotonic()
    _SEARCHED[str(folder)] = end + SHARE * (end - begun)


def recover_below(folder: str | os.PathLike[str]) -> None:
    """Recover a folder, and each folder that stood in it and was being replaced when its process was killed."""
    recover(folder)
    with suppress(OSError, ValueError, FitmodelsError):
        if _formers(Path(folder)):
            with only_writer(Path(folder)):
                pass


def _formers(parent: Path) -> list[tuple[str, str, Path]]:
    """Name, token and path of each folder that was being replaced."""
    with os.scandir(parent) as entries:
        hidden = [entry for entry in entries if entry.name.startswith(".") and entry.is_dir(follow_symlinks=False)]
    found = [(FORMER.fullmatch(entry.name), Path(entry.path)) for entry in hidden]
    return sorted((of["name"], of["token"], path) for of, path in found if of)


def _restore_formers(parent: Path) -> None:
    """Put folders whose replacement was interrupted between the two renames back; remove those that were replaced."""
    for name, token, former in _formers(parent):
        folder = parent / name
        if not os.path.lexists(folder):
            try:
                os.rename(former, folder)  # noqa: PTH104 - all calls that change files are made to fail in tests
            except OSError as failure:
                _warn(f"{folder}: its replacement was interrupted; it is {former}, not renamed back: {cause(failure)}.")
                continue
            synchronised_folder(parent)
            _warn(f"{folder}: its replacement was interrupted; the former folder was restored.")
        elif os.path.lexists(parent / f"{token}.tmp" / MADE):
            _warn(
                f"{folder}: its replacement was interrupted, and another folder was put in its place since; the former "
                f"one is {former}. Move one of the two elsewhere."
            )
        else:
            remove_tree(former)


def _warn(sentence: str) -> None:
    """Log a warning, which Python prints to standard error where nothing else is arranged."""
    logging.getLogger("fitmodels").warning("fitmodels: %s", printable_message(sentence))


def _remove_stages(parent: Path) -> None:
    """Remove hidden folders of ended processes, but for one whose former folder could not be put back."""
    kept = {f"{token}.tmp" for _, token, _ in _formers(parent)}
    for path in parent.glob(".fitmodels-*.tmp"):
        if path.name not in kept and is_abandoned(path):
            remove_tree(path)


def remove_tree(path: Path) -> None:
    """Remove a folder with all that is in it as far as that can be done, also folders without write access.

    Examples
    --------
    >>> remove_tree(Path("nowhere"))
    """
    shutil.rmtree(path, ignore_errors=True)
    if path.is_dir() and not path.is_symlink():
        with suppress(OSError):
            path.chmod(0o700)
            for place, folders, _ in os.walk(path):
                for name in folders:
                    if not (below := Path(place, name)).is_symlink():
                        below.chmod(0o700)
        shutil.rmtree(path, ignore_errors=True)


def write_together(
    path: Path, content: bytes, derived: Mapping[Path, bytes | None] | None = None, *, error: type[FitmodelsError]
) -> None:
    """Write a file, and files made from it, all of them or none, as the only writer of its folder.

    Contents are written to a hidden folder and are on disk before the journal; with the journal in its place the
    change is made, and a process that is killed after that leaves the rest to the next one (see `only_writer`).
    Derived files are removed before the file is renamed, and renamed after it: none of them ever stands beside a
    content it was not made from.

    Parameters
    ----------
    path, content
        The file.
    derived : mapping of path to bytes or None
        Contents of the derived files in the same folder or below it; None: the file is only removed.
    error : type
        Raised where a file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> with only_writer(folder):
    ...     write_together(folder / "a.json", b"{}", {folder / "figures" / "a.png": b"PNG"}, error=UsageError)
    >>> (folder / "figures" / "a.png").read_bytes(), sorted(path.name for path in folder.iterdir())
    (b'PNG', ['a.json', 'figures'])
    """
    if not derived:
        write_whole(path, content, error=error)
        return
    contents = {path: content, **derived}
    folder, place = path.parent, path
    stage = folder / temporary_name()
    try:
        for place in contents:
            check_target(place, folder)
        place = path
        commit(folder, stage, *_staged(contents, folder, stage))
    except (OSError, ValueError) as failure:  # ValueError: a path with a null character
        named = [getattr(failure, name, None) for name in ("filename", "filename2")]
        place = next((at for at in contents if at in named or str(at) in named), place)
        rest = f" The next command that uses {folder} completes the change." if _is_committed(folder) else ""
        raise error(f"{place}: cannot be written: {cause(failure)}; choose another place.{rest}") from None
    finally:
        if not _is_committed(folder):
            remove_tree(stage)


def _staged(
    contents: Mapping[Path, bytes | None], folder: Path, stage: Path
) -> tuple[list[tuple[str, str]], list[str]]:
    """Write contents to a hidden folder: what is to be renamed, and to which name, and what is to be removed."""
    stage.mkdir(mode=0o700)
    moves, removed = [], []
    for number, (place, data) in enumerate(contents.items()):
        name = place.relative_to(folder).as_posix()
        if data is None:
            removed.append(name)
        else:
            synchronised(stage / str(number), data)
            moves.append((f"{stage.name}/{number}", name))
    return moves, removed


def write_files(
    folder: Path, contents: Mapping[str, bytes | None], *, error: type[FitmodelsError] = UsageError
) -> None:
    """Write several files of a folder, all of them or none, as its only writer; the folder is made.

    Parameters
    ----------
    folder : Path
    contents : mapping of str to bytes or None
        By the name of the file; over what is there. None, not for the first one: the file is removed.
    error : type
        Raised where a file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_files(folder, {"a.txt": b"1", "b.txt": b"2"})
    >>> sorted(path.name for path in folder.iterdir())
    ['a.txt', 'b.txt']
    """
    if not contents:
        return
    make_folder(folder)
    real = Path(os.path.realpath(folder))
    (first, content), *rest = ((real / name, content) for name, content in contents.items())
    if content is None:
        raise ValueError(f"{first}: the first file has a content")
    with only_writer(real):
        write_together(first, content, dict(rest), error=error)


def check_target(place: Path, folder: Path) -> None:
    """Raise OSError where a file cannot be renamed to a place; ValueError where that is not in the folder."""
    if place.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    refuse_device(place)
    if not place.parent.is_dir():
        if os.path.lexists(place.parent):
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        return
    if not Path(os.path.realpath(place.parent)).is_relative_to(os.path.realpath(folder)):
        raise ValueError(f"its folder is a link that leads out of {folder}")
    if place.parent.stat().st_dev != folder.stat().st_dev:
        raise OSError(f"its folder is on another file system than {folder}")
    if not os.access(place.parent, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


def _is_committed(folder: Path) -> bool:
    with suppress(OSError, ValueError):
        return os.path.lexists(folder / JOURNAL)
    return False


def commit(folder: Path, stage: Path, moves: Iterable[tuple[str, str]], removed: Iterable[str]) -> None:
    """Put a journal into its place and carry it out."""
    renames = list(moves)
    made = {"stage": stage.name, "inode": stage.lstat().st_ino}
    journal = {"schema": SCHEMA, **made, "moves": renames, "removed": list(removed)}
    synchronised(stage / "journal", json.dumps(journal).encode())
    synchronised_folder(stage)
    os.replace(stage / "journal", folder / JOURNAL)  # noqa: PTH105
    synchronised_folder(folder)
    parents = {(folder / target).parent for _, target in renames}
    missing = sorted({place for of in parents for place in (of, *of.parents) if not place.exists()})
    try:
        for place in missing:
            place.mkdir()
    except OSError:  # nothing was changed yet
        (folder / JOURNAL).unlink()
        for place in reversed(missing):
            with suppress(OSError):
                place.rmdir()
        raise
    _carry_out(folder, journal)
    remove_tree(stage)


def _carry_out(folder: Path, journal: Mapping[str, Any]) -> None:
    """Do what a journal lists, in its order and as far as it is not done yet, and remove it."""
    moves = [(folder / source, folder / target) for source, target in journal["moves"]]
    waiting = [(source, target) for source, target in moves if os.path.lexists(source)]
    gone = [folder / name for name in journal["removed"]]
    replaced = [target for _, target in waiting if target != moves[0][1]]  # the first is replaced at once
    for place in (*gone, *replaced):
        place.unlink(missing_ok=True)
    for source, target in waiting:
        target.parent.mkdir(parents=True, exist_ok=True)
        os.replace(source, target)  # noqa: PTH105
    for place in {(folder / name).parent for name in (*journal["removed"], *dict(journal["moves"]).values())}:
        synchronised_folder(place)
    (folder / JOURNAL).unlink()


def _complete_journal(folder: Path) -> None:
    """Carry out the journal of a killed process."""
    path = folder / JOURNAL
    if not os.path.lexists(path):
        return
    journal = _read_journal(path)
    if journal is None:
        raise UsageError(
            f"{path}: is damaged, or was copied with its folder: the change that it lists cannot be completed, and "
            "nothing was written. Compare the files of the folder with each other, remove it, and run again."
        )
    try:
        _carry_out(folder, journal)
    except OSError as failure:
        raise UsageError(
            f"{folder}: a change of its files was interrupted and cannot be completed: {cause(failure)}; nothing else "
            "was written. Remove the cause, and run again: the change is then completed."
        ) from None
    remove_tree(folder / journal["stage"])
    _warn(f"{folder}: a change of its files was interrupted; it was completed.")


def _read_journal(path: Path) -> dict[str, Any] | None:
    """A journal; None where it has another form, names something not in its folder, or came there as a copy.

    A received folder may hold a journal that names files of the reader. The hidden folder of a journal written here
    has the inode that the journal states; that of a copy or an unpacked archive has another one.
    """
    try:
        if path.is_symlink():
            return None
        data: Any = parse_json(read_bounded(path, "state"), str(path))
        moves = dict(data["moves"])
        names = [*moves, *moves.values(), *data["removed"]]
        if data["schema"] != SCHEMA or not all(_is_inside(path.parent, name) for name in names):
            return None
        stage = path.with_name(data["stage"])
        of = stage.lstat()
        ours = TEMPORARY.fullmatch(stage.name) and stat.S_ISDIR(of.st_mode) and of.st_ino == data["inode"]
        return data if ours and all(name.startswith(f"{stage.name}/") for name in moves) else None
    except (FitmodelsError, OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _is_inside(folder: Path, name: str) -> bool:
    """Whether a path is one below the folder, also where links are followed."""
    parts = name.split("/")
    if any(part in ("", ".", "..", JOURNAL) or "\\" in part or "\0" in part for part in parts):
        return False
    return Path(os.path.realpath((folder / name).parent)).is_relative_to(os.path.realpath(folder))
