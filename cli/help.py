"""``fitmodels help``: the commands in groups, or the help of one of them."""

import os
import shutil
import sys
import textwrap
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Final

from ..core.text import WIDEST

if TYPE_CHECKING:
    import argparse

    from .arguments import Parser

MAIN = "FILE"
GROUPS: Final = {
    "Fit laws, and use them": {
        MAIN: "wear, force and power laws of a file of tests: verdicts, card, figures, params.json",
        "predict": "what the laws give at your settings, with an interval; tool life",
        "compare": "forms of each law on the same tests, and the form to keep",
        "confirm": "whether new tests agree with the laws of earlier ones",
        "optimum": "speed and feed of least cost or greatest rate; edge changes",
        "batch": "the laws of many tool/work pairs: a folder, a CSV or Parquet",
        "app": "all of this on a page in the browser of this machine",
    },
    "Prepare data, and plan tests": {
        "look": "how a file is read, with a picture and the commands that correct it; nothing is fitted",
        "reduce": "a table of tests from records of force, torque, power or current",
        "plan": "a plan of tests for your own ranges, as a table to fill in",
        "next": "the further tests that narrow the answer most",
        "simulate": "simulated tests from the laws of a parameter file, to try a plan",
    },
    "Set up a controller, and watch the machine": {
        "excite": "an excitation signal for the machine",
        "ident": "a model of the machine's dynamics from a recorded run",
        "tune": "PI gains for these dynamics",
        "limits": "limits of machine, tool and work, written into params.json",
        "merge": "parameter files of one pair joined, with conflicts named",
        "costs": "rates, prices and times of a part, written into params.json",
        "settings": "reference load, feed limits and tool change for constant load",
        "roughness": "reference force, feed limits and times for constant roughness",
        "adaptive-force": "gains, rates and set points for a constant force",
        "replay": "the controllers, run on a simulated machine",
        "check": "whether params.json is consistent, and its control safe",
        "export": "params.json in the format of a controller",
        "watch": "wear and remaining life of the edge in use, from its loads",
    },
    "Publish": {
        "card": "the model card of params.json for reading, browser and programs",
        "publish": "a site of many cards, or a model repository",
    },
    "Help": {
        "help": "this list, or the help of a command: fitmodels help predict",
        "completion": "completion of commands, options and files for bash, zsh or fish",
    },
}
OTHER_NAMES: Final = {  # words that a user may try first
    **dict.fromkeys(("analyse", "analyze", "fit", "run", "wear"), MAIN),
    "commands": "help", "list": "help", "read": "look", "show": "look", "identify": "ident", "validate": "check",
    "design": "plan", "forecast": "predict", "site": "publish", "version": "--version",
}  # fmt: skip


def parser() -> "Parser":
    """Arguments of ``fitmodels help``."""
    from .arguments import Parser

    p = Parser("fitmodels help", "fitmodels help predict", "Print the commands in groups, or the help of one of them.")
    p.add_argument("command", metavar="COMMAND", nargs="?", help="a command; FILE for the main job")
    p.add_argument("--all", action="store_true", help="every option of the command, with its default")
    return p


def run(args: "argparse.Namespace") -> int:
    """Print the help, and return the exit code."""
    if args.command is None:
        sys.stdout.write(overview())
        return 0
    name = MAIN if args.command.upper() == MAIN else OTHER_NAMES.get(args.command, args.command)
    known = known_names()
    if name not in known:
        from ..core.errors import UsageError
        from ..core.suggestions import closest

        near = closest(name, known, 0.6)
        remedy = f"did you mean 'fitmodels help {near}'?" if near else "'fitmodels help' lists the commands."
        raise UsageError(f"{args.command}: there is no such command; {remedy}")
    of = import_module(f".{'wear' if name == MAIN else name.replace('-', '_')}", __package__).parser()
    sys.stdout.write(of.format_all() if args.all else of.format_help())
    return 0


def known_names() -> list[str]:
    """Names of all commands, FILE for the main job."""
    return [name for group in GROUPS.values() for name in group]


def overview() -> str:
    """All commands in groups, with a line each.

    >>> overview().splitlines()[0]
    'example: fitmodels data.csv'
    """
    width = min(shutil.get_terminal_size().columns, WIDEST)
    lines = ["example: fitmodels data.csv", ""]
    for title, commands in GROUPS.items():
        lines.append(title)
        for name, words in commands.items():
            lines += textwrap.wrap(words, width, initial_indent=f"  {name:<10} ", subsequent_indent=" " * 13)
    last = (
        f"'fitmodels COMMAND -h' explains a command, 'fitmodels {MAIN} -h' the main job; --version prints the version."
    )
    return "\n".join([*lines, "", *textwrap.wrap(last, width)]) + "\n"


def unknown_command(word: str, following: Sequence[str] = ()) -> str:
    """A sentence on a word that is no file but close to a command, or followed by a file; empty otherwise.

    >>> unknown_command("pedict")
    "pedict: there is no such file or command; did you mean 'fitmodels predict'? 'fitmodels help' lists the commands."
    """
    from ..core.suggestions import closest

    known = [name for name in known_names() if name != MAIN]
    near = OTHER_NAMES.get(word) or closest(word, known, 0.7)
    if near is None and not (word.isalpha() and any(map(os.path.exists, following))):
        return ""
    meant = (following or ("data.csv",))[0] if near == MAIN else near
    guess = "" if near is None else f"did you mean 'fitmodels {meant}'? "
    return f"{word}: there is no such file or command; {guess}'fitmodels help' lists the commands."
