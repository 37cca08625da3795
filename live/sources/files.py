"""A growing file, and a recorded run at any speed."""

import os
import time
from collections.abc import Iterator
from contextlib import ExitStack
from math import isinf
from pathlib import Path
from typing import BinaryIO, Final

from ...core.bounded import open_regular
from ...core.errors import DataError, UsageError
from ...core.files import cause
from ...core.suggestions import near_path
from ..samples import Notice, Sample
from .clock import arrival_time
from .options import SourceOptions
from .rows import IDLE, LONGEST, Feed, Lines, decoded

POLL: Final = 0.1  # s between two looks at a growing file
CHUNK: Final = 262_144  # bytes read at once
MARK: Final = 64  # bytes at the beginning, and before the place of reading, that show whether the file is the same
LONGEST_LINE: Final = 1_000_000  # bytes without an end of line
Items = Iterator[Sample | Notice]


def _bytes_at(file: int, size: int, at: int) -> bytes:
    """Bytes of an open file from a place on; Windows has no ``pread``."""
    os.lseek(file, at, os.SEEK_SET)
    return os.read(file, size)


class Tail:
    r"""Complete lines of a file that grows; a line without its end is left for the next time.

    The file is held open, so that rows written before it was renamed are read to the end. Another file under its name
    is seen by its inode, a file that was cut by its size, one that was rewritten by its first 64 bytes and by the last
    64 that were read. A file that could not be read for a time is opened again and read on from the same place where
    it is the same file, and from its beginning otherwise.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "run.csv")
    >>> _ = path.write_bytes(b"t,P\n0,1.8\n0.1,1.")
    >>> tail = Tail(path)
    >>> tail.poll()
    ([b't,P', b'0,1.8'], '')
    >>> _ = path.write_bytes(b"t,P\n0,1.8\n0.1,1.9\n")
    >>> tail.poll()
    ([b'0.1,1.9'], '')
    >>> tail.close()
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.missing = ""  # reason why the file cannot be read now
        self.caught_up: bool  # whether all was read at the last poll
        self._stack = ExitStack()
        self._file: BinaryIO | None = None
        self._identity: tuple[int, int] | None = None  # device and inode of the file that was read last
        self._offset: int
        self._begin()

    def close(self) -> None:
        """Close the file."""
        self._stack.close()
        self._file = None

    def poll(self) -> tuple[list[bytes], str]:
        """Complete lines that were added, and what happened to the file: empty, or one sentence."""
        was_closed = self._file is None
        if was_closed and not self._open():
            return [], ""
        file = self._file
        assert file is not None  # noqa: S101  opened above
        try:
            return self._added(file, was_closed=was_closed)
        except OSError as error:
            self.close()
            self.caught_up = False
            self.missing = f"cannot be read: {cause(error)}"
            return [], ""

    def skip(self) -> None:
        """Go on behind the last complete line that is there."""
        if self._file is None:
            return
        number, size = self._file.fileno(), os.fstat(self._file.fileno()).st_size
        if size > self._offset:
            start = max(self._offset, size - CHUNK)
            self._offset = start + _bytes_at(number, size - start, start).rfind(b"\n") + 1
            self._before, self._pending = _bytes_at(number, MARK, max(0, self._offset - MARK)), b""

    def _begin(self) -> None:
        self._offset = 0
        self._head = self._before = self._pending = b""
        self._exhausted = self.caught_up = False

    def _added(self, file: BinaryIO, *, was_closed: bool) -> tuple[list[bytes], str]:
        """Result of `poll` for an open file."""
        status = os.fstat(file.fileno())
        if was_closed and (event := self._reopened(status)):
            return [], event
        if reason := self._changed(file, status.st_size):
            return [], self._again(reason)
        data = _bytes_at(file.fileno(), CHUNK, self._offset)
        return self._taken(file, data, status.st_size) if data else ([], self._successor(status))

    def _open(self) -> bool:
        try:
            self._file = self._stack.enter_context(open_regular(self.path, "stream"))
        except (OSError, DataError) as error:
            self.missing = cause(error) if isinstance(error, OSError) else str(error)
            return False
        self.missing = ""
        return True

    def _reopened(self, status: os.stat_result) -> str:
        """Sentence on another file than the one that was read before; empty for the first, and for the same."""
        before, self._identity = self._identity, (status.st_dev, status.st_ino)
        if before in (None, self._identity):
            return ""
        return self._again(f"another file has the name {self.path.name}")

    def _changed(self, file: BinaryIO, size: int) -> str:
        """Reason why the open file is no continuation of what was read; empty where it is."""
        if size < self._offset:
            return f"{self.path.name} was cut to {size} bytes"
        if size > self._offset and self._offset:
            head = _bytes_at(file.fileno(), len(self._head), 0)
            before = _bytes_at(file.fileno(), len(self._before), self._offset - len(self._before))
            if (head, before) != (self._head, self._before):
                return f"{self.path.name} was rewritten"
        return ""

    def _again(self, reason: str) -> str:
        """Read the open file from its beginning."""
        torn = f"; {len(self._pending)} bytes of a torn line are left out" if self._pending else ""
        self._begin()
        return f"{reason}: it is read from its beginning{torn}"

    def _taken(self, file: BinaryIO, data: bytes, size: int) -> tuple[list[bytes], str]:
        self._head = _bytes_at(file.fileno(), min(MARK, self._offset + len(data)), 0)  # first: it may fail
        self._exhausted = False
        self._offset += len(data)
        self._before = (self._before + data)[-MARK:]
        self.caught_up = self._offset >= size
        *lines, self._pending = (self._pending + data).split(b"\n")
        if len(self._pending) > LONGEST_LINE:
            self._pending = self._pending[:LONGEST_LINE]  # too long for a line: it is refused as one
        return [line.removesuffix(b"\r") for line in lines], ""

    def _successor(self, status: os.stat_result) -> str:
        """Go on with another file under the name, once the open one gave nothing twice."""
        self.caught_up = True
        try:
            named = self.path.stat()
        except OSError as error:
            self.missing = cause(error)
            return ""
        self.missing = ""
        if (named.st_dev, named.st_ino) == (status.st_dev, status.st_ino) or not named.st_size:
            return ""  # the same file, or one that nobody has begun to write
        if not self._exhausted:
            self._exhausted = True
            return ""
        self.close()  # the next poll opens it
        return ""


def check_file(path: Path) -> None:
    """Refuse what is no readable file of text.

    Raises
    ------
    UsageError
        It does not exist.
    DataError
        It is a folder, pipe or device, cannot be read, or is written in UTF-16.
    """
    try:
        with open_regular(path, "stream") as file:
            if file.read(2) in (b"\xff\xfe", b"\xfe\xff"):
                raise DataError(f"{path}: is UTF-16 text; save it as UTF-8.")
    except FileNotFoundError:
        near = near_path(path)
        hint = f" Did you mean {near}?" if near else ""
        raise UsageError(f"{path}: there is no such file; begin once it is there.{hint}") from None
    except OSError as error:
        raise DataError(f"{path}: {cause(error)}.") from None


def growing(path: Path, options: SourceOptions) -> Items:
    """Readings of a file that grows; a file that goes, or gives nothing for ``silent`` s, is lost until it comes back.

    The first header has to name a load of the laws (FitmodelsError); a later one that does not is refused in a notice.
    """
    tail, feed = Tail(path), Feed(path.name, options)
    try:
        if options.from_end:
            lines, _ = tail.poll()
            items = [item for line in lines for item in feed.take(line, None)]
            tail.skip()
            yield from (item for item in items if isinstance(item, Notice) and item.kind == "connected")
        while True:
            live = tail.caught_up
            lines, event = tail.poll()
            if event:
                feed.restart()
                yield Notice(time.time(), "replaced", event)
            arrival = arrival_time() if live else None
            for line in lines:
                yield from feed.take(line, arrival)
            yield from feed.quiet(tail.missing or "it does not grow")
            if not lines:
                time.sleep(POLL)
    finally:
        tail.close()


def replayed(path: Path, options: SourceOptions) -> Items:
    """Readings of a recorded run, ``options.replay`` times as fast as they were recorded.

    Raises
    ------
    FitmodelsError
        There is no header, or it names no load of the laws.
    """
    pace = _Pace(options.replay or 1.0)
    lines = Lines(path.name, options)
    with open_regular(path, "stream") as file:
        while line := file.readline(4 * LONGEST):
            for item in lines.take(decoded(line.rstrip(b"\r\n"))):
                if isinstance(item, Sample):
                    yield from pace.wait(item.time)
                yield item
    if not lines.samples:
        why = f": {lines.fault}" if lines.fault else ""
        raise DataError(f"{path.name} holds no readings below its header{why}.")
    yield Notice(time.time(), "end", f"{path.name} is at its end")


class _Pace:
    """Waits between samples of a recorded run."""

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._begun: tuple[float, float] | None = None
        self._before = -float("inf")

    def wait(self, moment: float) -> Items:
        """Wait until a sample of this time is due, s; notices ``"idle"`` meanwhile."""
        if isinf(self._speed):
            return
        if self._begun is None or moment < self._before:
            self._begun = time.monotonic(), moment  # also where the clock of the recording was set back
        self._before = moment
        due = self._begun[0] + (moment - self._begun[1]) / self._speed
        while (left := due - time.monotonic()) > 0:
            time.sleep(min(left, IDLE))
            if left > IDLE:
                yield Notice(time.time(), "idle")
