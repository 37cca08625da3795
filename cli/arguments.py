"""Parsing shared by the commands: help that leads with an example, and a did-you-mean on options."""

import argparse
import shlex
import sys
from argparse import ArgumentTypeError
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from ..core.errors import UsageError

if TYPE_CHECKING:
    from ..parameters import ParameterFile


class Parser(argparse.ArgumentParser):
    """A parser whose help starts with an example and whose complaints are one sentence."""

    def __init__(self, prog: str, example: str, description: str) -> None:
        super().__init__(
            prog=prog,
            description=description,
            allow_abbrev=False,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        self.example = example

    def format_help(self) -> str:
        """The example first, then what argparse has to say."""
        return f"example: {self.example}\n\n{super().format_help()}"

    def error(self, message: str) -> NoReturn:
        """One sentence, with the option that was probably meant, and exit code 2."""
        options = [option for action in self._actions for option in action.option_strings]
        for word in (word.rstrip(":") for word in message.split()):
            if word.startswith("-") and word not in options and (near := nearest(word.split("=")[0], options)):
                message += near
                break
        sys.stderr.write(f"{self.prog}: {message}; {self.prog} -h says what there is.\n")
        raise SystemExit(2)


def seed(text: str) -> int:
    """A seed from the command line.

    >>> seed("435")
    435
    """
    if not text.isdecimal():
        raise ArgumentTypeError(f"{text} is no seed; give a whole number, 0 or more")
    return int(text)


def processes(text: str) -> int:
    """A number of processes from the command line.

    >>> processes("4")
    4
    """
    if not text.isdecimal() or not 1 <= int(text) <= 256:
        raise ArgumentTypeError(f"{text} is no number of processes; give 1 to 256")
    return int(text)


def traced(pf: "ParameterFile", args: argparse.Namespace) -> dict[str, Any]:
    """The provenance of a file with this command after those that made it, without folders and ``--force``."""
    words = [Path(word).name if "/" in word else word for word in getattr(args, "words", ()) if word != "--force"]
    then = (shlex.join(["fitmodels", *words]),) if words else ()
    return {**pf.provenance.model_dump(), "then": (*pf.provenance.then, *then)}


def nearest(word: str, known: Iterable[str]) -> str:
    """What was probably meant, to stand behind a complaint.

    >>> nearest("recurson", ["region", "recursion"])
    ' (did you mean recursion?)'
    """
    near = get_close_matches(word, list(known), 1, 0.6)
    return f" (did you mean {near[0]}?)" if near else ""


def pairs(words: list[str] | None, option: str, example: str) -> dict[str, str]:
    """``["VB=col7"]`` as a mapping.

    >>> pairs(["VB=col7"], "--map", "VB=col7")
    {'VB': 'col7'}
    """
    out: dict[str, str] = {}
    for word in words or []:
        key, equals, value = word.partition("=")
        if not (equals and key.strip() and value.strip()):
            raise UsageError(f"{option} {word}: it is written as {example}.")
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
                f"{option} {key}={text}: it is low:high or low:centre:high, with decimal points, as V=50:200."
            )
    return out
