"""``fitmodels completion``: completion of commands, options, values and files in bash, zsh and fish."""

import argparse
import os
import sys
from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any

from ..core.errors import UsageError
from .arguments import Parser
from .help import known_names

EXTRA = "completion needs argcomplete: pip install 'fitmodels[completion]'."
VARIABLE = "_ARGCOMPLETE"  # set by the shell; its value is the first word of the line that argcomplete parses
SETUP = {
    "bash": 'eval "$(fitmodels completion bash)"   # in ~/.bashrc',
    "zsh": 'eval "$(fitmodels completion zsh)"   # in ~/.zshrc, after compinit',
    "fish": "fitmodels completion fish | source   # in ~/.config/fish/config.fish",
}


def parser() -> Parser:
    """Arguments of ``fitmodels completion``."""
    p = Parser(
        "fitmodels completion",
        "fitmodels completion bash",
        "Print the lines that switch completion on in a shell: commands, options, their values, and files. It needs\n"
        "argcomplete, pip install 'fitmodels[completion]'. To switch it on whenever the shell starts:\n\n"
        + "\n".join(f"  {line}" for line in SETUP.values()),
    )
    p.add_argument("shell", metavar="SHELL", choices=list(SETUP), help=f"{', '.join(SETUP)}")
    return p


def run(args: argparse.Namespace) -> int:
    """Print the lines for the shell, and return the exit code."""
    try:
        shellcode = import_module("argcomplete").shellcode
    except ImportError:
        raise UsageError(EXTRA) from None
    sys.stdout.write(shellcode(["fitmodels"], shell=args.shell))
    return 0


def complete(commands: tuple[str, ...]) -> None:
    """Write the completions of the line that the shell passes on, and end the process."""
    try:
        argcomplete = import_module("argcomplete")
    except ImportError:  # the lines were printed by another environment
        return
    words = argcomplete.split_line(os.environ["COMP_LINE"], int(os.environ["COMP_POINT"]))[3]
    name = next((word for word in words[1:2] if word in commands), "")
    of: Any = import_module(f".{name.replace('-', '_') or 'wear'}", __package__).parser()
    if name:
        os.environ[VARIABLE] = "2"  # the words of the line begin with the name of the command
    first_words = () if name else commands
    for action in (one for one in of._actions if not one.choices):
        action.completer = _completer(action, first_words)
    argcomplete.autocomplete(of, always_complete_options=False)


def _completer(action: argparse.Action, commands: tuple[str, ...]) -> Callable[..., Iterable[str]]:
    """Completion of the value of an option or argument: known words, or files."""
    of_files = import_module("argcomplete").FilesCompleter
    files: Callable[..., Iterable[str]] = of_files()
    documents: Callable[..., Iterable[str]] = of_files(("json",))
    if action.metavar == "PARAMS" or action.dest in ("params", "like"):
        return documents
    if action.dest == "file" and commands:
        return lambda prefix, **_: [*(name for name in commands if name.startswith(prefix)), *files(prefix)]
    if action.metavar == "COMMAND":
        return lambda **_: known_names()
    option = next(iter(action.option_strings), action.metavar)
    words = WORDS.get(str(option).replace("--data-", "--"))
    return files if words is None else lambda parsed_args, **_: words(parsed_args)


def _factors(args: argparse.Namespace) -> list[str]:
    """``V=`` and so on, of the laws of the parameter file on the line; all known symbols where it has none."""
    from ..core.errors import FitmodelsError
    from ..core.text import printable
    from ..datasets.vocabulary import ROLES

    try:
        from ..parameters import read

        pf = read(args.file)
    except (AttributeError, TypeError, FitmodelsError):
        return [f"{name}=" for name in ROLES]
    symbols = dict.fromkeys(f.symbol for law in pf.laws.values() for f in law.factors)
    responses = dict.fromkeys((*pf.laws, *(("T",) if pf.tool_life is not None else ())))
    return [name for name in (*(f"{name}=" for name in symbols), *responses) if printable(name) == name]


def _roles(_: argparse.Namespace) -> list[str]:
    from ..datasets.vocabulary import ROLES

    return [f"{name}=" for name in ROLES]


def _forms(_: argparse.Namespace) -> list[str]:
    from ..fit.form_choice import CHOICES

    return list(CHOICES)


def _formats(_: argparse.Namespace) -> list[str]:
    from ..controllers.exports import FORMATS

    return list(FORMATS)


def _systems(_: argparse.Namespace) -> list[str]:
    from ..cards.replays import SYSTEMS

    return list(SYSTEMS)


WORDS: dict[str, Callable[[argparse.Namespace], list[str]]] = {  # what completes an option or argument
    **dict.fromkeys(("--map", "--unit", "--range", "--value", "--levels"), _roles),
    **dict.fromkeys(("V=120", "P=7kW", "--at", "--u", "--gauge"), _factors),
    **dict.fromkeys(("--form", "--write"), _forms),
    "--to": _formats,
    "--system": _systems,
}
