"""One batch at a time in an output folder."""

import json
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ...core.errors import UsageError

LOCK = Path(".batch", "lock")
_HELD: set[Path] = set()  # by this process: its own number in a lock of another container's says nothing


@contextmanager
def locked(out: Path) -> Iterator[None]:
    """Hold the output folder; a lock whose process on this computer is no more is taken over.

    Raises
    ------
    UsageError
        Another batch holds it.
    """
    path = (out / LOCK).resolve()
    if not _made(path):
        told = _told(path)
        if told is not None and _over(path, told):
            _take_away(path, told)
        if not _made(path):
            raise UsageError(_sentence(out, path, told))
    _HELD.add(path)
    try:
        yield
    finally:
        _HELD.discard(path)
        with suppress(OSError):
            path.unlink()


def _made(path: Path) -> bool:
    """Whether the lock could be made: nobody else had one."""
    try:
        with path.open("x", encoding="utf-8") as file:
            json.dump({"pid": os.getpid(), "host": socket.gethostname()}, file)
    except FileExistsError:
        return False
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}; choose another place with --out.") from None
    return True


def _told(path: Path) -> tuple[int, str] | None:
    """Number of the process that holds the lock and its computer; None where the lock does not tell."""
    try:
        data = json.loads(path.read_text("utf-8"))
        return int(data["pid"]), str(data["host"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _over(path: Path, told: tuple[int, str]) -> bool:
    pid, host = told
    if host != socket.gethostname():
        return False
    return path not in _HELD if pid == os.getpid() else not _alive(pid)


def _alive(pid: int) -> bool:
    if pid <= 0:
        return False
    if sys.platform == "win32":
        return True  # a signal of 0 would end it there; the sentence says what to do
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # somebody else's
        return True
    return True


def _take_away(path: Path, told: tuple[int, str]) -> None:
    """Remove a lock that is over, unless another process has put its own in the place meanwhile."""
    aside = path.with_name(f"lock-{os.getpid()}")
    with suppress(OSError):
        path.rename(aside)
        if _told(aside) == told:
            aside.unlink()
        else:
            aside.rename(path)


def _sentence(out: Path, path: Path, told: tuple[int, str] | None) -> str:
    who = "another batch" if told is None else f"another batch (process {told[0]} on {told[1]})"
    return (
        f"{out}: {who} writes there now; wait for its end or choose another folder with --out "
        f"(if it is no more, remove {path})."
    )
