"""Files and folders that are written whole or not at all, and a lock for one writer at a time."""

import os
import platform
import re
import secrets
import tempfile
import time
import zlib
from collections.abc import Iterator, Mapping
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
    write_together(path, content.encode() if isinstance(content, str) else content, error=error)


def write_together(
    path: Path, content: bytes, derived: Mapping[Path, bytes | None] | None = None, *, error: type[FitmodelsError]
) -> None:
    """Write a file, and files made from it, so that none of these ever stands beside a content it was not made from.

    All contents are on disk before the first change: then the former derived files are removed, the file is renamed
    into its place, and after it the derived files; a process that is killed leaves some of these missing at most, and
    temporary files that the next write into the folder removes.

    Parameters
    ----------
    path, content
        The file.
    derived : mapping of path to bytes or None
        Contents of the derived files, whose folders are made; None: the file is only removed.
    error : type
        Raised where a file cannot be written.

    Examples
    --------
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_together(folder / "a.json", b"{}", {folder / "figures" / "a.png": b"PNG"}, error=UsageError)
    >>> (folder / "figures" / "a.png").read_bytes()
    b'PNG'
    """
    derived = derived or {}
    temporary: dict[Path, Path] = {}
    place, written = path, False
    try:
        for place, data in {path: content, **derived}.items():
            if data is not None:
                if place.exists() and not (place.is_file() or place.is_dir()):
                    raise OSError("it is a device or a pipe, which a file would replace")
                if place != path:
                    place.parent.mkdir(exist_ok=True)
                remove_stale(place.parent)
                temporary[place] = place.parent / temporary_name()
                _synchronised(temporary[place], data)
        for place in derived:
            place.unlink(missing_ok=True)
        for place, made in temporary.items():
            os.replace(made, place)  # noqa: PTH105 - stands beside fsync, and both are made to fail in tests
            written = True
    except (OSError, ValueError) as failure:  # ValueError: a path with a null character
        but = f" {path} was written." if written else ""
        raise error(f"{place}: cannot be written: {cause(failure)}; choose another place.{but}") from None
    finally:
        for made in temporary.values():
            with suppress(OSError, ValueError):
                made.unlink(missing_ok=True)


STALE = 3600.0  # s: no write takes as long
TEMPORARY = re.compile(r"\.fitmodels-(?:(?P<host>[0-9a-f]{8})-(?P<pid>\d+)-)?[0-9a-f]{16}\.tmp")


def temporary_name() -> str:
    """Name of a temporary file of this process, by which another one can tell whether it is still written."""
    return f".fitmodels-{_host()}-{os.getpid()}-{secrets.token_hex(8)}.tmp"


def remove_stale(folder: Path) -> None:
    """Remove temporary files in a folder that were left by killed processes: of no process now, or older than an hour.

    Examples
    --------
    >>> folder = Path(tempfile.mkdtemp())
    >>> left = folder / temporary_name().replace(f"-{os.getpid()}-", "-4194399-")  # beyond the largest number of Linux
    >>> left.touch()
    >>> remove_stale(folder)
    >>> left.exists()
    False
    """
    with suppress(OSError):
        for path in folder.glob(".fitmodels-*.tmp"):
            if found := TEMPORARY.fullmatch(path.name):
                with suppress(OSError):
                    ended = found["host"] == _host() and not _runs(int(found["pid"]))
                    if ended or time.time() - path.stat().st_mtime > STALE:
                        path.unlink()


def _host() -> str:
    return f"{zlib.crc32(platform.node().encode()):08x}"


def _runs(pid: int) -> bool:
    """Whether a process of this number exists; yes where the system cannot say (Windows ends what is asked so)."""
    if os.name != "posix":
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def refuse_input(path: str | os.PathLike[str], *inputs: str | os.PathLike[str]) -> None:
    """Raise where an output is one of the files that are read for it, by whatever path or link.

    Raises
    ------
    UsageError
        It is one of them.

    Examples
    --------
    >>> refuse_input("params.ini", "params.json")
    """
    for each in inputs:
        with suppress(OSError, ValueError):
            if os.path.realpath(path) == os.path.realpath(each) or Path(path).samefile(each):
                raise UsageError(
                    f"--out {path}: is the file {each} that is read; it would be lost. Choose another name with --out."
                )


def _synchronised(path: Path, data: bytes) -> None:
    with path.open("xb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


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
def locked(path: Path, message: str, wait: float = 0.0) -> Iterator[None]:
    """Hold the lock file ``path`` as its only process; the system releases it when the process ends.

    Another process that holds it is waited for, ``wait`` s at most.

    Raises
    ------
    UsageError
        With ``message``: another process holds the lock. Or the lock file cannot be made.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(path, timeout=wait)
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


POLL = 0.01  # s between attempts to take a lock


@contextmanager
def locked_folder(folder: Path, message: str, wait: float = 10.0) -> Iterator[None]:
    """Hold a folder as its only writer; the system releases it when the process ends, and no file is left in it.

    Where the system or the file system (Windows, network folders) has no lock of folders, the hidden file
    ``.fitmodels.lock`` in it is locked instead.

    Parameters
    ----------
    folder : Path
        Exists.
    message : str
        Of the error where another process keeps the lock longer than ``wait`` s.

    Raises
    ------
    UsageError
        Another process holds the lock, or it cannot be taken here.

    Examples
    --------
    >>> folder = Path(tempfile.mkdtemp())
    >>> with locked_folder(folder, "in use"):
    ...     list(folder.iterdir())
    []
    """
    end = time.monotonic() + wait
    try:
        held = _held_folder(folder, end)
    except TimeoutError:
        raise UsageError(message) from None
    if held is None:
        with locked(folder / ".fitmodels.lock", message, wait):
            yield
        return
    try:
        yield
    finally:
        os.close(held)


def _held_folder(folder: Path, end: float) -> int | None:
    """Open descriptor that holds the lock of a folder; None where there is no such lock."""
    try:
        import fcntl
    except ImportError:
        return None
    while True:
        try:
            found = os.open(folder, os.O_RDONLY)
        except OSError:
            return None
        try:
            fcntl.flock(found, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(found), folder.stat()):  # it may have been replaced by another folder
                return found
        except BlockingIOError:
            pass
        except OSError:  # network folders
            os.close(found)
            return None
        os.close(found)
        if time.monotonic() > end:
            raise TimeoutError
        time.sleep(POLL)
