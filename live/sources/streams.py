"""Lines from standard input, or from a socket of this computer, of CSV or JSON."""

import errno
import os
import select
import socket
import sys
import time
from collections.abc import Callable
from typing import Final

from ...core.errors import UsageError
from ...core.text import shortened
from ..samples import Notice
from .clock import arrival_time
from .files import LONGEST_LINE, Items
from .options import SourceOptions
from .rows import Feed

CHUNK: Final = 65_536  # bytes read at once
WAIT: Final = 0.25  # s for bytes, and for a connection
AGAIN: Final = 1.0  # s between two attempts to connect
WAITS: Final = os.name == "posix"  # Windows waits for no pipe, and reads no socket by its descriptor

Opener = Callable[[], int]  # gives the descriptor of an open stream, or raises OSError


def standard_input(options: SourceOptions) -> Items:
    """Readings from standard input, until it ends.

    Raises
    ------
    UsageError
        On Windows.
    """
    _check_system("-")
    return _lines("standard input", _standard_input, options, ends=True)


def _check_system(words: str) -> None:
    if not WAITS:
        raise UsageError(
            f"--from {shortened(words, 80)}: Windows gives no way to wait for lines of a pipe or socket. Let the "
            "program append its lines to a file, and give that file: --from run.csv."
        )


def _standard_input() -> int:
    if sys.__stdin__ is None:  # it was closed at the start: another file may have its number now
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))
    return os.dup(0)


def from_socket(words: str, options: SourceOptions) -> Items:
    """Readings from a server of lines: ``tcp://127.0.0.1:5000`` or ``unix:/run/machine.sock``; it is connected again.

    Raises
    ------
    UsageError
        The address is not of this computer (its lines would be neither signed nor encrypted), or is none; on Windows.
    """
    _check_system(words)
    if words.startswith("unix:"):
        path = words.removeprefix("unix:")
        return _lines(words, lambda: _connected(socket.AF_UNIX, path), options)
    host, _, port = words.removeprefix("tcp://").rpartition(":")
    host = host.strip("[]")
    if not port.isdecimal() or not 0 < int(port) < 65_536:
        raise UsageError(f"--from {shortened(words, 80)}: give the port, as in tcp://127.0.0.1:5000.")
    if host not in ("localhost", "127.0.0.1", "::1"):
        raise UsageError(
            f"--from {shortened(words, 80)}: lines of another computer are neither signed nor encrypted. Tunnel them, "
            f"as with ssh -L {port}:localhost:{port} {shortened(host)}, and give tcp://127.0.0.1:{port}."
        )
    family = socket.AF_INET6 if host == "::1" else socket.AF_INET
    address = ("127.0.0.1" if host == "localhost" else host, int(port))
    return _lines(words, lambda: _connected(family, address), options)


def _connected(family: int, address: str | tuple[str, int]) -> int:
    with socket.socket(family, socket.SOCK_STREAM) as made:
        made.settimeout(WAIT)
        made.connect(address)
        return made.detach()


def _lines(name: str, opener: Opener, options: SourceOptions, *, ends: bool = False) -> Items:
    """Readings of a stream; where it ends, it is opened again, unless it ``ends`` the source."""
    feed, pending, file, next_try = Feed(name, options), b"", -1, 0.0
    try:
        while True:
            if file < 0 and time.monotonic() >= next_try:
                next_try = time.monotonic() + AGAIN
                try:
                    file = opener()
                    feed.restart()
                except OSError as error:
                    why = os.strerror(error.errno).lower() if error.errno else str(error)
                    if ends:
                        raise UsageError(f"{name} cannot be read: {why}. Give it a file or a pipe.") from None
                    yield from feed.lose(why)
            data = _read(file)
            if data == b"":
                if ends:
                    if pending.strip():  # a last line without its end
                        yield from feed.take(pending.removesuffix(b"\r"), arrival_time())
                    yield Notice(time.time(), "end", f"{name} is at its end")
                    return
                os.close(file)
                file, pending = -1, b""
                yield from feed.lose("the connection ended")
            *lines, pending = (pending + (data or b"")).split(b"\n")
            pending = pending[:LONGEST_LINE]
            for line in lines:
                yield from feed.take(line.removesuffix(b"\r"), arrival_time())
            yield from feed.quiet("the connection gives nothing" if file >= 0 else "there is no connection")
    finally:
        if file >= 0:
            os.close(file)


def _read(file: int) -> bytes | None:
    """Bytes that came within .25 s; None where there were none, empty at the end."""
    if file < 0:
        time.sleep(WAIT)
        return None
    if not select.select([file], [], [], WAIT)[0]:
        return None
    try:
        return os.read(file, CHUNK)
    except OSError:
        return b""
