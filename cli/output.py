"""Results to standard output, as text through rich or as JSON; messages to standard error."""

import os
import re
import shutil
import sys
from argparse import ArgumentParser
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ..core.text import NARROWEST, WIDEST, json_text, printable, printable_message, without_long_words
from ..core.verdict import MARKS

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live

IN_ASCII = {**{ord(mark.icon): mark.ascii for mark in MARKS.values()}, ord("…"): "..."}  # signs of other encodings
PAGE = 25  # lines; nothing that is printed depends on it
OF_A_PIPE = 100  # columns where the output is no terminal and COLUMNS is not set


def output_options(parser: ArgumentParser, json: str = "print the result as JSON", full: str = "") -> None:
    """Add ``--json``, ``--quiet`` and, where the default output leaves something out, ``--full``.

    Parameters
    ----------
    parser : ArgumentParser
    json, full : str
        Help of the two options; without a help ``--full`` is not added.
    """
    if full:
        parser.add_argument("--full", action="store_true", help=full)
    parser.add_argument("--quiet", "-q", action="store_true", help="print only errors and the paths that are written")
    parser.add_argument("--json", action="store_true", help=json)


class Printer:
    """Standard output through rich: colours at a terminal, plain text in a pipe, no blanks at line ends.

    Parameters
    ----------
    quiet : bool
        Print nothing but the paths of files that are written.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        from rich.console import Console

        self.quiet = quiet
        # size given: rich fails where COLUMNS or LINES is a digit that is no number
        self._console = Console(markup=False, highlight=False, emoji=False, width=OF_A_PIPE, height=PAGE)
        if self._console.is_terminal or "COLUMNS" in os.environ:
            self._console.width = min(max(shutil.get_terminal_size().columns, NARROWEST), WIDEST)

    @property
    def ascii(self) -> bool:
        """Whether the encoding of the output lacks the icons of verdicts."""
        try:
            "✓✗…".encode(getattr(sys.stdout, "encoding", None) or "utf-8")
        except (UnicodeEncodeError, LookupError):
            return True
        return False

    @property
    def width(self) -> int:
        """Columns of the output, 60 to 120."""
        return self._console.width

    @property
    def is_terminal(self) -> bool:
        """Whether the output is a terminal, and not quiet."""
        return self._console.is_terminal and not self.quiet

    def renewed(self) -> "Live":
        """A started display that is renewed in place, for blocks whose text is printable already."""
        from rich.live import Live

        live = Live(console=self._console, auto_refresh=False, vertical_overflow="crop")
        live.start()
        return live

    def show(self, block: "RenderableType") -> None:
        """Print one block, unless the output is quiet."""
        if not self.quiet:
            self._print(as_options(block) if isinstance(block, str) else block)

    def wrote(self, block: "RenderableType", *paths: str | Path) -> None:
        """Print a block on files that were written; where the output is quiet, their paths, a line each."""
        if not self.quiet:
            self._print(block)
            return
        for path in paths:
            _write(f"{printable(str(path))}\n")

    def _print(self, block: "RenderableType") -> None:
        """Print a block; its escape sequences are those of rich, for text of a file has none."""
        from rich.segment import Segment, Segments

        shown = (Segment(printable(text), style, control) for text, style, control in self._console.render(block))
        with self._console.capture() as captured:
            self._console.print(Segments(shown), crop=False)  # commands may be longer than a line
        text = "\n".join(without_long_words(line.rstrip() for line in captured.get().split("\n")))
        _write(text.translate(IN_ASCII) if self.ascii else text)


def _write(text: str) -> None:
    """Write to standard output at once; a reader that has closed the pipe does not stop the work."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:
        drop_output()


def drop_output() -> None:
    """Redirect what is still to be printed, so that it does not fail again when the process ends."""
    with suppress(OSError, ValueError):  # standard output is no file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def print_lines(lines: Iterable[str], *, quiet: bool = False) -> None:
    """Print lines of text, unless the output is quiet."""
    from rich.text import Text

    out = Printer(quiet=quiet)
    for line in lines:
        out.show(Text(as_options(line)))


def line_writer() -> Callable[[str], None]:
    """A function that writes lines of JSON to standard output; a reader that has closed the pipe stops nothing."""
    return _write


def print_json(schema: str, facts: Mapping[str, Any], version: int = 1) -> None:
    """Print facts as JSON, with the schema ``fitmodels.<schema>/<version>`` first."""
    report = {"schema": f"fitmodels.{schema}/{version}", **facts}
    print(json_text(report, indent=2))  # noqa: T201


def complain(sentence: str) -> None:
    """Print on standard error what went wrong, with options of the command in place of Python arguments."""
    named = NAMED.sub(lambda found: f"{_option(found[1])} ", FUNCTION.sub("", sentence))
    write_error(f"fitmodels: {as_options(named)}")


def write_error(line: str) -> None:
    """Write a line to standard error, with values of files made printable."""
    sys.stderr.write(f"{printable_message(line)}\n")


OPTIONS: Final = {  # names of arguments in Python, and of options where these differ by more than hyphens
    "rise_time": "rise", "settling_time": "settle", "units": "unit", "ranges": "range", "constants": "value",
    "drive": "drive-pole", "laws": "law", "f1": "band",
}  # fmt: skip
NAME = (
    "(by|criterion|decimal|delay|delimiter|draws|drive|edge|error|form|gauge_sd|kind|level|priors|probability|process|"
    "rate|sample_time|seed|sheet|student|aim)"
)
TEXT = re.compile(rf"(?<![^\s(]){NAME}=(?:'([^']*)'|\"([^\"]*)\")(?![\w/\\]|\.\w)")
NUMBER = re.compile(  # only in advice: a column, a folder or a condition may be named level=3 too
    rf"\b((?i:add|controller|give|set|use|with)) {NAME}=(\d+(?:\.\d+)?|True|None)(?![\w/\\=-]|\.\w)"
)
NAMED = re.compile(  # an argument that a sentence begins with, but not a file: law 3.csv
    r"^(?![^:]*\.[A-Za-z]\w*(?::| (?:does|holds|is|has)\b))"
    r"(alpha|amplitude|average|blocks|criterion|delay|design|draws|duration|edge|f1|filter_time|form|gain_margin|"
    r"gauge_sd|interval|law|level(?= \S+ of an interval)|ms|noise_gain|overshoot|phase_margin|priors|probability|"
    r"readings|repeats|rise_time|seed|setpoint_weight|settling_time|t_max|travel|undershoot|unit|window|worn) "
    r"(?=['\d.-]|nan|inf)"
)
FUNCTION = re.compile(r"^(?:batch|cards|controllers|datasets|fit|ident|parameters|pipeline)\.\w+: ")
WHOLE: Final = {  # other advice in terms of Python, and the same in terms of the command
    "Fit without by.": "Leave --by out.",
    "Give rise_time or settling_time, or": "Give --rise or --settle, or",
    "; leave half out": "; leave --half out",
    ': limit="scale"': "",
    "or None to estimate it": "or leave it out to have it estimated",
    "give force= (--force-per-unit)": "give --force-per-unit",
    "give drive='faster' or 'slower' (--drive-pole)": "give --drive-pole faster or slower",
    "nominal and probability: a nominal": "--nominal and --probability: a nominal",
    "or identify with nk=1": "or identify with --orders NA,NB,1",
    "collect it with limits={'wear': 0.3, ...}": "write it into the file: fitmodels limits PARAMS AW=0.3mm, or "
    "VB=0.3mm by the name of its wear law",
    "give collect(adaptive_force=...) its estimates and settings": "fitmodels ident RUN --as force-process --params "
    "PARAMS adds one",
    "use the grid (how='grid')": "give narrower limits",
    "they need the diameter, at={'D': ...} in mm": "they need the diameter, which is not in the file",
    "use scale='log'": "use --form second-order",
    "or None for no limit": "or leave it out",
    "certain=True": "--certain",
}


def as_options(sentence: str) -> str:
    """A sentence of the packages with options of the command in place of arguments in Python.

    >>> as_options("fit with error='multiplicative', or leave out a factor")
    'fit with --error multiplicative, or leave out a factor'
    >>> as_options("runs/seed=1/data.csv: columns V, level=3")  # names in a file stay
    'runs/seed=1/data.csv: columns V, level=3'
    """
    for python, command in WHOLE.items():
        sentence = sentence.replace(python, command)
    sentence = NUMBER.sub(lambda found: f"{found[1]} {_option(found[2])} {found[3]}", sentence)
    return TEXT.sub(lambda found: f"{_option(found[1])} {found[2] or found[3]}", sentence)


def _option(name: str) -> str:
    return f"--{OPTIONS.get(name, name).replace('_', '-')}"
