"""Standard input as the file of a command: ``-`` in place of its name."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from ..core.errors import DataError, UsageError
from ..core.files import STANDARD_INPUT

MARK = "-"
STEM = "stdin"  # of what is written by default


@contextmanager
def opened(file: str) -> Iterator[Path]:
    """The path of a file; of ``-`` a temporary file with everything that standard input gives.

    Raises
    ------
    UsageError
        Standard input is a terminal, or closed.
    DataError
        It is empty.
    """
    if file != MARK:
        yield Path(file)
        return
    if sys.stdin is None or sys.stdin.closed:
        raise UsageError("-: standard input is closed; pipe a file into it, for instance fitmodels - < data.csv.")
    if sys.stdin.isatty():
        raise UsageError(
            "-: standard input is a terminal; pipe a file into it, for instance fitmodels - < data.csv, or give the "
            "path of a file."
        )
    content = sys.stdin.buffer.read()
    if not content:
        raise DataError(f"{STANDARD_INPUT} is empty: the command before the pipe has printed nothing.")
    with TemporaryDirectory(prefix="fitmodels-") as folder:
        path = Path(folder, STANDARD_INPUT)
        path.write_bytes(content)
        yield path


def stem(file: str) -> str:
    """Name of a file without its ending, or of a folder, for what is written by default.

    >>> stem("tests/data.csv"), stem("-")
    ('data', 'stdin')
    """
    if file == MARK:
        return STEM
    path = Path(file)
    return path.resolve().name if path.is_dir() else path.stem
