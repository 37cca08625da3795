"""Parsing shared by the commands: help that begins with an example, misspelled options, standard input as a file."""

import argparse
import re
import shlex
import sys
from argparse import ArgumentTypeError
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NoReturn

from ..core.errors import DataError, UsageError
from ..core.files import STANDARD_INPUT
from ..core.suggestions import closest

MARK = "-"  # standard input as the file of a command
STEM = "stdin"  # of what is written by default
ONE_TABLE = "several files that are one table go into a folder: fitmodels FOLDER"

if TYPE_CHECKING:
    from ..parameters import ParameterFile


class Parser(argparse.ArgumentParser):
    """A parser whose help begins with an example and whose errors are one sentence.

    ``more_files`` is the remedy for a second file where the command reads one.
    """

    def __init__(self, prog: str, example: str, description: str, more_files: str = "") -> None:
        layout = argparse.RawDescriptionHelpFormatter
        super().__init__(prog=prog, description=description, allow_abbrev=False, formatter_class=layout)
        self.example = example
        self.more_files = more_files

    def format_help(self) -> str:
        """The example, then the help of argparse."""
        return f"example: {self.example}\n\n{super().format_help()}"

    def error(self, message: str) -> NoReturn:
        """Print one sentence, with the closest option, and end with exit code 2."""
        options = [option for action in self._actions for option in action.option_strings]
        for word in (word.rstrip(":") for word in message.split()):
            if word.startswith("-") and word not in options and (near := closest(word.split("=")[0], options, 0.6)):
                message += f" (did you mean {near}?)"
                break
        if self.more_files and re.match(r"unrecognized arguments: [^-]", message):
            message += f"; {self.more_files}"
        sys.stderr.write(f"{self.prog}: {message}; see '{self.prog} -h'.\n")
        raise SystemExit(2)


def seed(text: str) -> int:
    """A seed from the command line.

    >>> seed("435")
    435
    """
    if not text.isdecimal():
        raise ArgumentTypeError(f"{text} is not a seed; give a whole number, 0 or more")
    return int(text)


def processes(text: str) -> int:
    """A number of processes from the command line.

    >>> processes("4")
    4
    """
    if not text.isdecimal() or not 1 <= int(text) <= 256:
        raise ArgumentTypeError(f"{text} is not a number of processes; give 1 to 256")
    return int(text)


def typed(words: Sequence[str]) -> str:
    """The command as it was typed.

    >>> typed(["my data.csv", "--seed", "2"])
    "fitmodels 'my data.csv' --seed 2"
    """
    return shlex.join(["fitmodels", *words])


def traced(pf: "ParameterFile", typed_words: Sequence[str]) -> dict[str, Any]:
    """The provenance of a file with this command added, as it was typed."""
    then = (typed(typed_words),) if typed_words else ()
    return {**pf.provenance.model_dump(), "then": (*pf.provenance.then, *then)}


def pairs(words: list[str] | None, option: str, example: str) -> dict[str, str]:
    """``["VB=col7"]`` as a mapping.

    >>> pairs(["VB=col7"], "--map", "VB=col7")
    {'VB': 'col7'}
    """
    out: dict[str, str] = {}
    for word in words or []:
        key, equals, value = word.partition("=")
        if not (equals and key.strip() and value.strip()):
            raise UsageError(f"{option} {word}: write it as {example}.")
        if key.strip() in out:
            raise UsageError(f"{option} {word}: {key.strip()} is given twice.")
        out[key.strip()] = value.strip()
    return out


def ranges(words: list[str] | None, option: str = "--range") -> dict[str, tuple[float, ...]]:
    """``["V=50:200"]`` as numbers.

    >>> ranges(["V=50:200"])
    {'V': (50.0, 200.0)}
    """
    out: dict[str, tuple[float, ...]] = {}
    for key, text in pairs(words, option, "V=50:200").items():
        try:
            out[key] = tuple(float(part) for part in text.split(":"))
        except ValueError:
            out[key] = ()
        if len(out[key]) not in (2, 3):
            raise UsageError(
                f"{option} {key}={text}: give low:high or low:centre:high, with decimal points, as V=50:200."
            )
    return out


def values(words: list[str] | None, option: str = "--value") -> dict[str, float]:
    """``["D=80"]`` as numbers.

    >>> values(["D=80"])
    {'D': 80.0}
    """
    out: dict[str, float] = {}
    for key, text in pairs(words, option, "D=80").items():
        try:
            out[key] = float(text)
        except ValueError:
            raise UsageError(f"{option} {key}={text}: give a number with a decimal point, as D=80.") from None
    return out


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
