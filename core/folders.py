"""Folders that are replaced whole or not at all, also where the process is killed in between.

A folder is made in a hidden folder beside its place and swapped in by two renames: ``FOLDER`` to
``.FOLDER.fitmodels-....former``, the new one to ``FOLDER``. `fitmodels.core.journal` restores the former one where a
process was killed between the two.
"""

import errno
import os
import shutil
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import UsageError
from .files import LOCK, TEMPORARY, is_abandoned, synchronised_folder, temporary_name
from .journal import JOURNAL, MADE, check_target, commit, only_writer, recover, remove_tree

FEW = 100  # files that are synchronised one by one; of more the whole system is

FolderState = Mapping[str, tuple[int, int, int]]  # path within the folder: bytes, time of change in ns, inode


def folder_state(folder: Path) -> FolderState:
    """Size, time of change and inode of each file in a folder; empty where there is no folder.

    Examples
    --------
    >>> list(folder_state(Path(__file__).parent))[:1] != [], folder_state(Path("nowhere"))
    (True, {})
    """
    each = ((name, file_state(path)) for name, path in _entries(folder))
    return {name: state for name, state in each if state is not None}


def file_state(path: Path) -> tuple[int, int, int] | None:
    """Size in bytes, time of change in ns and inode of a file or link; None for a folder, and where there is nothing.

    Examples
    --------
    >>> file_state(Path("nowhere")) is None
    True
    """
    try:
        of = path.lstat()
    except FileNotFoundError:
        return None
    return None if stat.S_ISDIR(of.st_mode) else (of.st_size, of.st_mtime_ns, of.st_ino)


def _entries(folder: Path) -> Iterator[tuple[str, Path]]:
    """Everything in a folder by its path within it, links as such, without the temporary files of processes."""
    for place, folders, names in os.walk(folder, onerror=_raise):
        top = Path(place)
        inside = "" if top == folder else f"{top.relative_to(folder).as_posix()}/"
        folders[:] = sorted(name for name in folders if not TEMPORARY.fullmatch(name))
        for name in (*folders, *sorted(names)):
            if name not in (JOURNAL, LOCK) and not (TEMPORARY.fullmatch(name) and is_abandoned(top / name)):
                yield inside + name, top / name


def _raise(failure: OSError) -> None:
    if not isinstance(failure, FileNotFoundError):
        raise failure


@contextmanager
def staged(folder: Path) -> Iterator[Path]:
    """An empty hidden folder from which `put_folder` swaps into ``folder``: beside it, private, removed afterwards.

    It is in ``folder`` itself where that cannot be renamed: a mount point, the current folder of the process, Windows.
    Parents that are made for it and stay empty are removed too.

    Parameters
    ----------
    folder : Path
        The place of the folder that will be made; a link is followed.

    Yields
    ------
    Path
        The folder to fill, ``made`` in the hidden one.

    Raises
    ------
    OSError
        It cannot be made.
    """
    real = Path(os.path.realpath(folder))
    recover(real)
    parent = real if _is_fixed(real) else real.parent
    missing = [place for place in (parent, *parent.parents) if not place.exists()]
    stage = parent / temporary_name()
    try:
        stage.mkdir(mode=0o700, parents=True)
        (stage / MADE).mkdir()
        yield stage / MADE
    finally:
        if not os.path.lexists(parent / JOURNAL):  # which may name files in it
            remove_tree(stage)
        for place in missing:
            with suppress(OSError):  # not empty: it holds the result
                place.rmdir()


def _is_fixed(folder: Path) -> bool:
    """Whether a folder exists and cannot be renamed."""
    if not folder.is_dir():
        return False
    with suppress(OSError):
        here = Path(os.path.realpath(Path.cwd()))
        if here == folder or folder in here.parents:
            return True
    return os.name == "nt" or os.path.ismount(folder)


def put_folder(made: Path, folder: Path, *, expected: FolderState, ours: Callable[[str], bool]) -> None:
    """Put a folder that was filled in `staged` into its place, whole or not at all, with the foreign files held there.

    Everything is on disk before the first rename. Foreign files of the former folder stay the same files (hard links;
    copies where there are none), links stay links. A failure leaves the former folder in its place.

    Parameters
    ----------
    made, folder : Path
        As yielded by `staged`, and as given to it.
    expected : FolderState
        Of ``folder`` when the decision to write was made.
    ours : callable
        Whether a path within the folder is one that fitmodels writes: those are replaced or removed, others stay.

    Raises
    ------
    UsageError
        Files of ours in ``folder`` are others than expected, a foreign file has the name of one of ours, or another
        process keeps the lock.
    OSError
        Something cannot be written.
    """
    real = Path(os.path.realpath(folder))
    _synchronise(made)
    if made.parents[1] == real:
        with only_writer(real):
            _check(real, folder, expected, ours)
            _replace_files(made, real, folder, ours)
        return
    with only_writer(real.parent):
        if not os.path.lexists(real):
            _check(real, folder, expected, ours)
            os.rename(made, real)  # noqa: PTH104
            synchronised_folder(real.parent)
            return
        with only_writer(real):
            _check(real, folder, expected, ours)
            _check_names(made, real, folder)
            _carry(real, made, ours)
            _swap(made, real, folder, expected, ours)


def _check(real: Path, folder: Path, expected: FolderState, ours: Callable[[str], bool]) -> None:
    """Raise unless the files of ours are as expected."""
    if os.path.lexists(real) and not real.is_dir():
        raise UsageError(f"{folder} is a file; choose another folder with --out.")
    then, now = (dict(filter(lambda of: ours(of[0]), state.items())) for state in (expected, folder_state(real)))
    if then == now:
        return
    name = min(name for name in {*then, *now} if then.get(name) != now.get(name))
    change = "removed" if name not in now else "changed" if name in then else "written"
    raise UsageError(
        f"{folder}: {name} was {change} by another process since this command began; nothing was written. Run again."
    )


def _check_names(made: Path, real: Path, folder: Path) -> None:
    """Raise where a folder or a link has the name of a file or folder of ours, or the reverse."""
    for name, path in _entries(made):
        target = real / name
        if not os.path.lexists(target) or path.is_dir() == (target.is_dir() and not target.is_symlink()):
            continue
        raise UsageError(
            f"{folder / name} has the name of something that fitmodels writes; "
            "rename it, or choose another place with --out."
        )


def _carry(real: Path, made: Path, ours: Callable[[str], bool]) -> None:
    """Link the foreign files of a folder into the new one."""
    folders = [(real, made)]
    for name, path in _entries(real):
        target = made / name
        if path.is_dir() and not path.is_symlink():
            folders.append((path, target))
            if not (ours(name) or any(path.iterdir())):
                target.mkdir(parents=True, exist_ok=True)
        elif not ours(name):
            target.parent.mkdir(parents=True, exist_ok=True)
            _link(path, target)
    for path, target in reversed(folders):
        if target.is_dir():
            _finish(path, target)


def _finish(path: Path, target: Path) -> None:
    """Give a new folder the owner and mode of a former one."""
    synchronised_folder(target)
    with suppress(OSError, AttributeError):  # another owner: by the superuser only
        os.chown(target, path.stat().st_uid, path.stat().st_gid)
    shutil.copymode(path, target)


def _link(path: Path, target: Path) -> None:
    """The same file under a second name, or a copy where the file system has no hard links."""
    try:
        os.link(path, target, follow_symlinks=False)
    except (OSError, NotImplementedError) as failure:
        if isinstance(failure, OSError) and failure.errno in (errno.ENOSPC, errno.EDQUOT, errno.EIO):
            raise
        if path.is_symlink():
            target.symlink_to(path.readlink())
        elif path.is_file():
            shutil.copy2(path, target)
            _synchronise(target)
        else:
            raise


def _swap(made: Path, real: Path, folder: Path, expected: FolderState, ours: Callable[[str], bool]) -> None:
    """The two renames; in between, what was moved away is compared once more."""
    former = real.with_name(f".{real.name}{made.parent.name.removesuffix('.tmp')}.former")
    try:
        os.rename(real, former)  # noqa: PTH104
        _check(former, folder, expected, ours)
        _check_carried(former, made, folder, ours)
        os.rename(made, real)  # noqa: PTH104
    except BaseException:
        if os.path.lexists(former) and not os.path.lexists(real):
            os.rename(former, real)  # noqa: PTH104
        raise
    synchronised_folder(real.parent)
    remove_tree(former)


def _check_carried(former: Path, made: Path, folder: Path, ours: Callable[[str], bool]) -> None:
    """Raise where a foreign file was added or changed since it was linked."""
    now = folder_state(made)
    for name, (size, changed, _) in folder_state(former).items():
        if not ours(name) and (now.get(name, (-1,))[0] != size or (
            now[name][1] != changed and not (made / name).is_symlink()
        )):  # fmt: skip
            raise UsageError(
                f"{folder}: {name} was changed while the folder was replaced; nothing was written. Run again."
            )


def _synchronise(path: Path) -> None:
    """Have the system write a file, or all of a folder, to the disk."""
    inside = [path, *(each for _, each in _entries(path))] if path.is_dir() else [path]
    if len(inside) > FEW and hasattr(os, "sync"):
        os.sync()
        return
    for each in reversed(inside):
        if each.is_dir():
            synchronised_folder(each)
        else:
            with each.open("rb" if os.name == "posix" else "rb+") as file:
                os.fsync(file.fileno())


def _replace_files(made: Path, real: Path, folder: Path, ours: Callable[[str], bool]) -> None:
    """Replace the files of a folder that cannot be renamed itself, by a journal."""
    _check_names(made, real, folder)
    new = {name for name, path in _entries(made) if path.is_file()}
    removed = [name for name in folder_state(real) if ours(name) and name not in new]
    for name in (*new, *removed):
        check_target(real / name, real)
    source = f"{made.parent.name}/{made.name}"
    commit(real, made.parent, [(f"{source}/{name}", name) for name in sorted(new)], removed)
