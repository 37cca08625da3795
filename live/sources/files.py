"""A growing file, and a recorded run at any speed."""

import time
from collections.abc import Iterator
from math import isinf
from pathlib import Path
from typing import Final

from ...core.bounded import open_regular
from ...core.errors import DataError, FitmodelsError, UsageError
from ...core.files import cause
from ...core.suggestions import near_path
from ..samples import Notice, Sample
from .options import SourceOptions
from .rows import LONGEST, Lines
from .tail import Tail

POLL: Final = 0.1  # s between two looks at a growing file
IDLE: Final = 0.5  # s without a reading, after which the monitor gets its turn
Items = Iterator[Sample | Notice]


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


def decoded(line: bytes) -> str:
    """A line of UTF-8, or of Windows-1252 where it is none."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", "replace")


def growing(path: Path, options: SourceOptions) -> Items:
    """Readings of a file that grows; a file that goes, or gives nothing for ``silent`` s, is lost until it comes back.

    The first header has to name a load of the laws (FitmodelsError); a later one that does not is refused in a notice.
    """
    return _Growing(path, options).items()


class _Growing:
    def __init__(self, path: Path, options: SourceOptions) -> None:
        self._path, self._options = path, options
        self._tail = Tail(path)
        self._lines = Lines(path.name, options)
        self._refused = False  # the header of the present file was not understood
        self._lost = False
        self._last = self._given = time.monotonic()  # of a reading, and of anything

    def items(self) -> Items:
        try:
            if self._options.from_end:
                yield from self._header()
            while True:
                live = self._tail.caught_up
                lines, event = self._tail.poll()
                if event:
                    self._lines.restart()
                    self._refused = False
                    yield Notice(time.time(), "replaced", event)
                now = time.monotonic()
                for line in lines:
                    for item in self._take(line, now if live else None):
                        self._given = time.monotonic()
                        yield item
                yield from self._quiet()
                if not lines:
                    time.sleep(POLL)
        finally:
            self._tail.close()

    def _header(self) -> Items:
        """What the header holds; rows that are there already are left out."""
        lines, _ = self._tail.poll()
        items = [item for line in lines for item in self._take(line, None)]
        self._tail.skip()
        yield from (item for item in items if isinstance(item, Notice) and item.kind == "connected")

    def _take(self, line: bytes, arrival: float | None) -> Items:
        if self._refused:
            return
        try:
            for item in self._lines.take(decoded(line), arrival):
                if isinstance(item, Sample):
                    self._last = time.monotonic()
                    if self._lost:
                        self._lost = False
                        yield Notice(time.time(), "connected", f"{self._path.name} gives readings again")
                yield item
        except FitmodelsError as error:
            if self._lines.samples < 2:  # units of times without a unit are known from the second
                raise
            self._refused = True
            yield Notice(time.time(), "refused", f"{error} Its rows are not read.")

    def _quiet(self) -> Items:
        """Notices of a file that gives nothing."""
        now = time.monotonic()
        if not self._lost and now - self._last >= self._options.silent:
            self._lost, self._given = True, now
            why = self._tail.missing or "it does not grow"
            yield Notice(time.time(), "lost", f"{self._path.name}: no reading for {now - self._last:.1f} s; {why}")
        elif now - self._given >= IDLE:
            self._given = now
            yield Notice(time.time(), "idle")


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
        raise DataError(f"{path.name} holds no readings below its header.")
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
