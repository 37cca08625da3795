"""The description of a watch as lines of JSON, for programs that read a file or a pipe."""

import errno
import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from ..core.bounded import AS_BYTES
from ..core.errors import UsageError
from ..core.files import cause
from ..core.text import json_text
from .facts import Facts

EACH: Final = 1.0  # s between two lines while nothing is new
OF_SOURCE: Final = 10.0  # s of the source between two lines of a run that is replayed faster
LARGEST: Final = 50_000_000  # bytes of a file, after which it is begun anew


class JsonLines:
    r"""An outlet that writes a line of JSON each second, and at once where something is new.

    Parameters
    ----------
    write : callable
        Takes a line with its end.

    Examples
    --------
    >>> lines = []
    >>> stream = JsonLines(lines.append)
    >>> stream.report(lambda: {"state": "cutting"}, ["Go on."], 12.0)
    >>> lines
    ['{"state":"cutting","said":["Go on."]}\n']
    """

    def __init__(self, write: Callable[[str], object]) -> None:
        self._write = write
        self._last = -EACH
        self._next: float | None = None
        self._left: Facts | None = None

    def show(self, facts: Facts) -> None:
        """Write a line, if the last one is a second old."""
        self._left = facts
        if time.monotonic() - self._last >= EACH:
            self._line(facts, ())

    def report(self, facts: Callable[[], Facts], sentences: Sequence[str], time: float | None) -> None:
        """Write a line where there are new sentences, or ten seconds of the source have passed."""
        late = time is not None and (self._next is None or not self._next - OF_SOURCE <= time < self._next)
        if late and time is not None:
            self._next = time + OF_SOURCE
        if sentences or late:
            self._line(facts(), sentences)

    def _line(self, facts: Facts, sentences: Sequence[str]) -> None:
        self._last, self._left = time.monotonic(), None
        self._write(json_text({**facts, "said": [*sentences]}, separators=(",", ":")) + "\n")

    def close(self) -> None:
        """Write the last description, if it is not written yet."""
        if self._left is not None:
            self._line(self._left, ())


def file_writer(path: Path) -> Callable[[str], object]:
    """A function that appends lines to a file or pipe; the file is begun anew at `LARGEST` bytes.

    Nothing waits for the reader of a pipe: a line that a full pipe does not take is left out.

    Raises
    ------
    UsageError
        The file cannot be written, or no program reads the pipe.
    """
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | AS_BYTES | getattr(os, "O_NONBLOCK", 0)
    try:
        file = os.open(path, flags, 0o644)
    except OSError as failure:
        why = "no program reads this pipe" if failure.errno == errno.ENXIO else f"cannot be written: {cause(failure)}"
        remedy = "start the reader first" if failure.errno == errno.ENXIO else "choose another file"
        raise UsageError(f"--stream {path}: {why}; {remedy}.") from None
    torn = b""  # rest of a line that a pipe took in part

    def write(line: str) -> None:
        nonlocal torn
        if os.fstat(file).st_size > LARGEST:
            os.ftruncate(file, 0)
        with suppress(BlockingIOError):
            torn = torn[os.write(file, torn) :] if torn else b""
            data = b"" if torn else line.encode()
            torn = data[os.write(file, data) :] if data else torn

    return write
