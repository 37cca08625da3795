"""Parsing shared by the commands: help that begins with an example, misspelled options, standard input as a file."""

import argparse
import re
import shlex
import shutil
import sys
import textwrap
from argparse import ArgumentTypeError
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, BinaryIO, NoReturn

from ..core.bounded import LIMITS
from ..core.errors import DataError, ParameterError, UsageError
from ..core.files import STANDARD_INPUT, cause
from ..core.suggestions import closest
from ..core.text import WIDEST
from .numbers import number
from .output import complain, write_error

NEGATIVE = re.compile(r"-\.?\d")  # how a negative value begins
MARK = "-"  # standard input as the file of a command
ONE_TABLE = "several files that are one table go into a folder: fitmodels FOLDER"

if TYPE_CHECKING:
    from ..datasets import Record
    from ..parameters import ParameterFile
    from ..parameters.checks.report import FileFinding
    from ..parameters.sections.origin import IdentitySection


class Layout(argparse.HelpFormatter):
    """Help as wide as the terminal: paragraphs are filled, indented lines keep their indent, defaults are shown."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=26, width=min(shutil.get_terminal_size().columns, WIDEST) - 2)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        paragraphs, table = [], []
        for part in re.split(r"\n\n+", text):
            if part.startswith("  "):
                table = [
                    textwrap.fill(line, width, subsequent_indent=" " * 8, break_on_hyphens=False)
                    for line in part.split("\n")
                ]
                paragraphs.append("\n".join(table))
            else:
                text = " ".join(part.split())
                paragraphs.append(
                    textwrap.fill(text, width, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)
                )
        return "\n\n".join(paragraphs)

    def _get_help_string(self, action: argparse.Action) -> str:
        return with_default(action)


def with_default(action: argparse.Action) -> str:
    """The help of an option; its default is added where the help does not state it."""
    text = action.help or ""
    if "default" in text or action.default in (None, False, argparse.SUPPRESS) or not action.option_strings:
        return text
    return f"{text} (default: {action.default})".replace("%", "%%").replace("%%%%", "%%")


class _HelpAll(argparse.Action):
    """``--help-all``: print every option with its default."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        assert isinstance(parser, Parser)  # noqa: S101  only added there
        sys.stdout.write(parser.format_all())
        parser.exit()


class Parser(argparse.ArgumentParser):
    """A parser whose help begins with an example and whose errors are one sentence.

    Parameters
    ----------
    prog, example, description : str
    more_files : str
        Remedy for a second file where the command reads one.
    main : str
        Options that ``-h`` explains, with blanks between, for a command with many; ``--help-all`` explains all of them.
    """

    def __init__(self, prog: str, example: str, description: str, more_files: str = "", main: str = "") -> None:
        super().__init__(prog=prog, description=description, allow_abbrev=False, add_help=False, formatter_class=Layout)
        self.example = example
        self.more_files = more_files
        self.main = main.split()
        self._positionals.title = "arguments"
        self.register("type", float, number)
        self.add_argument("-h", "--help", action="help", help="explain the arguments and main options")
        self.add_argument("--help-all", action=_HelpAll, nargs=0, help="explain every option, with its default")

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Take a negative value with a unit, or a range, after its option, as in ``--readings -32:1280N``."""
        return super().parse_known_args(self._joined(sys.argv[1:] if args is None else args), namespace)

    def _joined(self, words: Sequence[str]) -> list[str]:
        """``--option -1mm`` as ``--option=-1mm`` where the option takes one value; argparse reads -1mm as an option."""
        takes = {name for one in self._actions if one.nargs is None for name in one.option_strings if name[:2] == "--"}
        end = list(words).index("--") if "--" in words else len(words)
        joined: list[str] = []
        for word in words[:end]:
            if joined and joined[-1] in takes and NEGATIVE.match(word):
                joined[-1] += f"={word}"
            else:
                joined.append(word)
        return [*joined, *words[end:]]

    def format_help(self) -> str:
        """The example, and the help of arguments and main options; the others are named."""
        return self._help(self.main)

    def format_all(self) -> str:
        """The example, and the help of all arguments and options."""
        return self._help(())

    def _help(self, main: Sequence[str]) -> str:
        layout = self._get_formatter()
        layout.add_text(self.description)
        layout.add_text(f"usage: {' '.join([self.prog, '[options]', *self._arguments()])}")
        named = []
        for group in self._action_groups:
            listed = [one for one in group._group_actions if one.dest not in ("help", "help_all")]
            shown = [one for one in listed if _is_shown(one, main)]
            named += [one.option_strings[0] for one in listed if one not in shown]
            if shown:
                layout.start_section(group.title)
                layout.add_text(group.description)
                layout.add_arguments(shown)
                layout.end_section()
        layout.add_text(f"further options, explained by --help-all: {' '.join(named)}" if named else None)
        return f"example: {self.example}\n\n{layout.format_help()}"

    def _arguments(self) -> Iterator[str]:
        """Names of required options and of arguments, as in a usage line."""
        for action in self._actions:
            name = action.metavar if isinstance(action.metavar, str) else action.dest
            if action.option_strings:
                yield from [f"{action.option_strings[0]} {name}"] if action.required else ()
            else:
                yield {"+": f"{name} ...", "*": f"[{name} ...]", "?": f"[{name}]"}.get(str(action.nargs), name)

    def error(self, message: str) -> NoReturn:
        """Print one sentence, with the closest option, and end with exit code 2."""
        options = [option for action in self._actions for option in action.option_strings]
        for word in (word.rstrip(":") for word in message.split()):
            if word.startswith("-") and word not in options and (near := closest(word.split("=")[0], options, 0.6)):
                message += f" (did you mean {near}?)"
                break
        if self.more_files and re.match(r"unrecognized arguments: [^-]", message):
            message += f"; {self.more_files}"
        write_error(f"{self.prog}: {message}; see '{self.prog}{' FILE' * (' ' not in self.prog)} -h'.")
        raise SystemExit(2)


def _is_shown(action: argparse.Action, main: Collection[str]) -> bool:
    """Whether the help explains an argument or option."""
    return not main or not action.option_strings or action.required or bool({*action.option_strings} & {*main})


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


def joined(pf: "ParameterFile", records: "Iterable[Record]") -> "IdentitySection":
    """Identity of a file that takes records in: it counts as simulated where one of them is."""
    from ..datasets.runs import disclaimers

    simulated = any(disclaimers(rec.notes) for rec in records)
    return pf.identity.model_copy(update={"simulated": True}) if simulated else pf.identity


def now_simulated(former: "ParameterFile", pf: "ParameterFile") -> str:
    """Sentence on a file of measured data that simulated data have joined; empty otherwise."""
    if not pf.identity.simulated or former.identity.simulated:
        return ""
    return ". The record is simulated, so the whole file counts as that: do not run a machine with it"


def parameter_file(path: str, *, writes: bool = False) -> "ParameterFile":
    """A parameter file; one whose checksum does not agree is refused where a command ``writes`` from it, else named.

    Raises
    ------
    ParameterError
        It cannot be read; or something would be written from a content that was changed, or may have been.
    """
    from .. import parameters
    from ..parameters.file import require_seal, seal_fault

    pf = parameters.read(path)
    if writes:
        from ..parameters.checks.record import check_texts

        require_seal(pf, path)
        if finding := next(check_texts(pf), None):
            raise ParameterError(f"{path}: {finding.words} Nothing was written from it.")
    elif fault := seal_fault(pf):
        complain(f"{path}: {fault}. Commands that write from it refuse it.")
    return pf


def failing(found: "Iterable[FileFinding]", path: str, *, accepted: bool) -> list[str]:
    """A sentence on the first finding of the gate that fails settings which were accepted all the same.

    Raises
    ------
    UsageError
        It fails settings that were not accepted: nothing is to be written.
    """
    words = next((finding.words for finding in found if finding.passed is False), "")
    if words and not accepted:
        raise UsageError(f"{path}: {words} Nothing was written.")
    return [f"! fitmodels check fails these settings, and no export is made: {words}"] if words else []


def inputs_of(path: str, pf: "ParameterFile") -> list[Path]:
    """The files that a parameter file consists of: itself, and its draws."""
    draws = None if pf.posterior is None else pf.posterior.draws_file
    return [Path(path), *([] if draws is None else [Path(path).parent / draws])]


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
    with TemporaryDirectory(prefix="fitmodels-") as folder:
        path = Path(folder, STANDARD_INPUT)
        with path.open("wb") as copy:
            _copy_standard_input(copy)
        yield path


def _copy_standard_input(file: BinaryIO) -> None:
    limit, size = LIMITS["measurements"], 0
    try:
        while block := sys.stdin.buffer.read(1 << 20):
            size += len(block)
            if size > limit.size:
                raise DataError(
                    f"{STANDARD_INPUT} gives more than {limit.size} bytes, the limit of {limit.kind}. {limit.remedy}"
                )
            file.write(block)
    except OSError as error:  # a folder, or no room for the copy
        raise DataError(f"{STANDARD_INPUT} cannot be read: {cause(error)}.") from None
    if not size:
        raise DataError(f"{STANDARD_INPUT} is empty: check the command before the pipe, or the file that is read.")


def stem(file: str) -> str:
    """Name of a file without its ending, or of a folder, for what is written by default.

    >>> stem("tests/data.csv"), stem("-")
    ('data', 'stdin')
    """
    if file == MARK:
        return "stdin"
    path = Path(file)
    return path.resolve().name if path.is_dir() else path.stem
