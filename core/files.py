"""Files and folders that are written whole or not at all, and a lock for one writer at a time."""

import os
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import FitmodelsError, UsageError

STANDARD_INPUT = "standard input"  # name of the data where a command reads them from ``-``


def cause(error: OSError | ValueError) -> str:
    """The reason of a failed file operation in lower case.

    >>> cause(FileNotFoundError(2, "No such file or directory"))
    'no such file or directory'
    """
    return (getattr(error, "strerror", None) or str(error)).lower()


def write_whole(
    path: str | os.PathLike[str],
    content: str | bytes,
    *,
    error: type[FitmodelsError] = UsageError,
    parents: bool = False,
) -> None:
    """Write a file whole or not at all, over what is there: a temporary file beside it, synchronised and renamed.

    Parameters
    ----------
    path : path
    content : str or bytes
        Text is written as UTF-8.
    error : type
        Raised where the file cannot be written.
    parents : bool
        Whether the folder is made where there is none.

    Examples
    --------
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_whole(folder / "a.txt", "1")
    >>> (folder / "a.txt").read_text()
    '1'
    """
    path = Path(path)
    if parents:
        make_folder(path.parent)
    data = content.encode() if isinstance(content, str) else content
    temporary = path.parent / f".fitmodels-{secrets.token_hex(8)}.tmp"
    try:
        with temporary.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)  # noqa: PTH105 - stands beside fsync, and both are made to fail in tests
    except (OSError, ValueError) as failure:  # ValueError: a path with a null character
        raise error(f"{path}: cannot be written: {cause(failure)}; choose another place.") from None
    finally:
        with suppress(OSError, ValueError):
            temporary.unlink(missing_ok=True)


def make_folder(folder: Path) -> None:
    """Make a folder and those above it.

    Raises
    ------
    UsageError
        It cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as failure:
        raise UsageError(f"{folder}: cannot be made: {cause(failure)}; choose another place with --out.") from None


@contextmanager
def staged(parent: Path) -> Iterator[Path]:
    """A hidden folder in ``parent``, removed afterwards with those parents made for it that stayed empty."""
    missing = [place for place in (parent, *parent.parents) if not place.exists()]
    parent.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(prefix=".fitmodels-", dir=parent, ignore_cleanup_errors=True) as name:
            yield Path(name)
    finally:
        for place in missing:
            with suppress(OSError):  # not empty: it holds the result
                place.rmdir()


def move_folder(made: Path, folder: Path) -> None:
    """Rename a new folder into its place; into one that exists, file by file.

    Raises
    ------
    UsageError
        A folder has the name of a file of ours, or the reverse.
    """
    if not folder.exists():
        made.rename(folder)
        return
    moves = [(path, folder / path.relative_to(made)) for path in sorted(made.rglob("*")) if path.is_file()]
    for _, target in moves:
        if target.is_dir() or (target.parent.exists() and not target.parent.is_dir()):
            obstacle = target if target.is_dir() else target.parent
            raise UsageError(
                f"{obstacle} has the name of something that fitmodels writes; "
                "rename it, or choose another place with --out."
            )
    for path, target in moves:
        target.parent.mkdir(parents=True, exist_ok=True)
        path.replace(target)


def swap_folder(made: Path, folder: Path) -> None:
    """Rename a new folder into the place of a former one, which moves beside the new one's place and is lost with it.

    A failure leaves the former folder in its place.
    """
    former = made.with_name(f"{made.name}-former")
    folder.rename(former)
    try:
        made.rename(folder)
    except BaseException:
        former.rename(folder)
        raise


@contextmanager
def locked(path: Path, message: str) -> Iterator[None]:
    """Hold the lock file ``path`` as its only process; the system releases it when the process ends.

    Raises
    ------
    UsageError
        With ``message``: another process holds the lock. Or the lock file cannot be made.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(path, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise UsageError(message) from None
    except OSError as failure:
        raise UsageError(f"{path}: cannot be written: {cause(failure)}; choose another place with --out.") from None
    try:
        yield
    finally:
        lock.release()
