"""Files that are written whole or not at all, and locks for one writer at a time."""

import errno
import os
import platform
import re
import secrets
import time
import zlib
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
    system: str | None = getattr(error, "strerror", None)
    return system.lower() if system else str(error)  # which may contain a path


def write_whole(
    path: str | os.PathLike[str],
    content: str | bytes,
    *,
    error: type[FitmodelsError] = UsageError,
    parents: bool = False,
    force: bool = True,
) -> None:
    """Write a file whole or not at all: a temporary file beside it, synchronised and renamed.

    Parameters
    ----------
    path : path
    content : str or bytes
        Text is written as UTF-8.
    error : type
        Raised where the file cannot be written.
    parents : bool
        Whether the folder is made where there is none.
    force : bool
        Whether a file that has the name is replaced, also one that another process writes at the same time.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_whole(folder / "a.txt", "1")
    >>> (folder / "a.txt").read_text()
    '1'
    """
    path = Path(path)
    if parents:
        make_folder(path.parent)
    made = path.parent / temporary_name()
    try:
        refuse_device(path)
        remove_stale(path.parent)
        synchronised(made, content.encode() if isinstance(content, str) else content)
        (os.replace if force else _rename_new)(made, path)
    except FileExistsError:
        raise error(f"{path}: the file exists; choose another path, or replace it with --force.") from None
    except (OSError, ValueError) as failure:  # ValueError: a path with a null character
        raise error(f"{path}: cannot be written: {cause(failure)}; choose another place.") from None
    finally:
        with suppress(OSError, ValueError):
            made.unlink(missing_ok=True)
    synchronised_folder(path.parent)


def refuse_device(path: Path) -> None:
    """Raise OSError where a path is a device, a pipe or a socket."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise OSError("it is a device or a pipe, which a file would replace")


def _rename_new(made: Path, path: Path) -> None:
    """Rename a file to a name that nothing has, which a renaming alone does not see to."""
    try:
        os.link(made, path)
    except FileExistsError:
        raise
    except (OSError, NotImplementedError):  # a file system without hard links
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST)) from None
        os.rename(made, path)  # noqa: PTH104


STALE = 86_400.0  # s: no write takes as long
TEMPORARY = re.compile(r"\.fitmodels-(?:(?P<host>[0-9a-f]{8})-(?P<pid>\d+)-)?[0-9a-f]{16}\.tmp")
LOCK = ".fitmodels.lock"
SHARE = 10.0  # of the time that a search for temporary files takes, before the next one in the same folder
_SEARCHED: dict[str, float] = {}  # folder: time of the next search


def temporary_name() -> str:
    """Name of a temporary file of this process, by which another one can tell whether it is still written."""
    return f".fitmodels-{_host()}-{os.getpid()}-{secrets.token_hex(8)}.tmp"


def is_abandoned(path: Path) -> bool:
    """Whether a temporary file or folder is one of an ended process of this machine, or older than a day.

    Examples
    --------
    >>> is_abandoned(Path(temporary_name()))
    False
    """
    found = TEMPORARY.fullmatch(path.name)
    if found and found["pid"] and found["host"] == _host() and not _runs(int(found["pid"])):
        return True
    with suppress(OSError):
        return found is not None and time.time() - path.lstat().st_mtime > STALE
    return False


def remove_stale(folder: Path) -> None:
    """Remove temporary files in a folder that were left by killed processes: of no process now, or older than a day.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> left = folder / temporary_name().replace(f"-{os.getpid()}-", "-4194399-")  # beyond the largest number of Linux
    >>> left.touch()
    >>> remove_stale(folder)
    >>> left.exists()
    False
    """
    begun = time.monotonic()
    if _SEARCHED.get(str(folder), begun) > begun:
        return
    with suppress(OSError):
        for path in folder.glob(".fitmodels-*.tmp"):
            if is_abandoned(path) and not path.is_dir():
                with suppress(OSError):
                    path.unlink()
    end = time.monotonic()
    _SEARCHED[str(folder)] = end + SHARE * (end - begun)


def _host() -> str:
    """The machine, and the container on it: numbers of processes mean something within it alone."""
    try:
        within = Path("/proc/self/ns/pid").readlink().name
    except OSError:
        within = ""
    return f"{zlib.crc32((platform.node() + within).encode()):08x}"


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


def synchronised(path: Path, data: bytes) -> None:
    """Write a new file, and wait until it is on the disk."""
    with path.open("xb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def synchronised_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk, where the system can do that."""
    with suppress(OSError):
        found = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(found)
        finally:
            os.close(found)


def make_folder(folder: Path, option: str = "--out") -> None:
    """Make a folder and those above it; ``option`` is the one that gives its place.

    Raises
    ------
    UsageError
        It cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as failure:
        raise UsageError(f"{folder}: cannot be made: {cause(failure)}; choose another place with {option}.") from None


@contextmanager
def locked(path: Path, message: str, wait: float = 0.0, option: str = "--out") -> Iterator[None]:
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
        raise UsageError(f"{path}: cannot be written: {cause(failure)}; choose another place with {option}.") from None
    try:
        yield
    finally:
        lock.release()


POLL = 0.01  # s between attempts to take a lock
SWAPPED = 1.0  # s after which a folder that is absent is no longer one that another process is replacing


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
    >>> import tempfile
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
        with locked(folder / LOCK, message, wait):
            yield
        return
    try:
        yield
    finally:
        os.close(held)


def _opened(folder: Path) -> int:
    """Descriptor of a folder; one that is absent may be just being replaced by another process."""
    absent = time.monotonic() + SWAPPED
    while True:
        try:
            return os.open(folder, os.O_RDONLY)
        except OSError as failure:
            if not isinstance(failure, FileNotFoundError) or time.monotonic() > absent:
                raise UsageError(f"{folder}: cannot be locked: {cause(failure)}; nothing was written.") from None
            time.sleep(POLL)


def _held_folder(folder: Path, end: float) -> int | None:
    """Open descriptor that holds the lock of a folder; None where there is no such lock."""
    try:
        import fcntl
    except ImportError:
        return None
    while True:
        found = _opened(folder)
        try:
            fcntl.flock(found, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(found), folder.stat()):  # it may have been replaced by another folder
                return found
        except (BlockingIOError, FileNotFoundError):
            pass
        except OSError:  # network folders
            os.close(found)
            return None
        os.close(found)
        if time.monotonic() > end:
            raise TimeoutError
        time.sleep(POLL)
