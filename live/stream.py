"""The description of a watch as lines of JSON, for programs that read a file or a pipe."""

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from ..core.errors import UsageError
from ..core.files import cause
from ..core.text import json_text
from .facts import Facts

EACH: Final = 1.0  # s between two lines while nothing is new
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
    >>> stream.say(lambda: {"state": "cutting"}, ["Go on."], 12.0)
    >>> lines
    ['{"state":"cutting","said":["Go on."]}\n']
    """

    def __init__(self, write: Callable[[str], object]) -> None:
        self._write = write
        self._last = -EACH
        self._window: float | None = None

    def show(self, facts: Facts) -> None:
        """Write a line, if the last one is a second old."""
        if time.monotonic() - self._last >= EACH:
            self._line(facts, ())

    def say(self, facts: Callable[[], Facts], sentences: Sequence[str], _: float | None) -> None:
        """Write a line with the new sentences."""
        if sentences:
            self._line(facts(), sentences)

    def _line(self, facts: Facts, sentences: Sequence[str]) -> None:
        self._last = time.monotonic()
        self._write(json_text({**facts, "said": [*sentences]}, separators=(",", ":")) + "\n")

    def close(self) -> None:
        """End."""


def file_writer(path: Path) -> Callable[[str], object]:
    """A function that appends lines to a file, each by one write; the file is begun anew at `LARGEST` bytes.

    Raises
    ------
    UsageError
        The file cannot be written.
    """
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_CLOEXEC", 0)
    try:
        file = os.open(path, flags, 0o644)
    except OSError as failure:
        raise UsageError(f"--stream {path}: cannot be written: {cause(failure)}; choose another file.") from None

    def write(line: str) -> None:
        if os.fstat(file).st_size > LARGEST:
            os.ftruncate(file, 0)
        os.write(file, line.encode())

    return write
