"""The command ``fitmodels``: parses arguments, calls the packages, prints, and ends with an exit code.

0 done, 2 usage, 3 the data cannot be read or used, 4 a model cannot be fitted, 5 a quality check failed or a law does
not hold.
"""

import gc
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from ..core.threads import start_with_one
from ..core.version import __version__

# Each command is a module of this package (see `module_name`) with ``parser()`` and ``run(args) -> exit code``.
COMMANDS = (
    *(
        "adaptive-force",
        "app",
        "batch",
        "card",
        "check",
        "compare",
        "completion",
        "confirm",
        "costs",
        "excite",
        "export",
        "help",
        "ident",
        "limits",
        "look",
        "merge",
        "next",
        "optimum",
        "plan",
        "predict",
    ),
    *("publish", "reduce", "replay", "roughness", "settings", "simulate", "tune", "watch"),
)
DEFECT = 70


def entry() -> int:
    """Run the command as a process of its own, without garbage collection: most commands are short."""
    start_with_one()
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # else all installed packages are searched for some
    os.environ["MPLBACKEND"] = "agg"  # figures are written, none is shown
    gc.disable()  # the collector takes a tenth of the whole time, most of it while importing
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the caller, as in `fitmodels data.csv >&-`
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115  open as long as the process
    if "_ARGCOMPLETE" in os.environ:
        from .completion import complete

        complete(COMMANDS)
    return main()


def keep_running() -> None:
    """Enable garbage collection for a command that runs for days, of what is made from now on.

    What was imported is left out: a collection over it would stop a controller for a tenth of a second.
    """
    gc.freeze()
    gc.enable()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code.

    >>> main(["--version"])  # doctest: +ELLIPSIS
    fitmodels ...
    0
    """
    argv = list(sys.argv[1:] if arguments is None else arguments)
    if argv[:1] in (["--version"], ["-V"]):
        print(f"fitmodels {__version__}")  # noqa: T201
        return 0
    if not argv or argv in (["-h"], ["--help"]):
        return _overview(2 if not argv else 0)
    if argv[0] in ("-h", "--help") and argv[1] in COMMANDS:  # the command first is as good
        argv = [argv[1], argv[0], *argv[2:]]
    name, rest = (argv[0], argv[1:]) if argv[0] in COMMANDS else ("wear", argv)
    if name == "wear" and (sentence := _misspelt(argv)):
        return _fail(sentence, 2)
    command = import_module(f".{module_name(name)}", __name__)
    try:
        args = command.parser().parse_args(rest)
    except SystemExit as stop:
        return int(stop.code or 0)
    args.words = argv
    return _guarded(command.run, args)


def module_name(command: str) -> str:
    """The module of a command.

    >>> module_name("adaptive-force")
    'adaptive_force'
    """
    return command.replace("-", "_")


def _overview(code: int) -> int:
    """Print the commands; nothing was asked for with exit code 2."""
    from .help import overview

    print(overview(), end="")  # noqa: T201
    return code


def _misspelt(argv: Sequence[str]) -> str:
    """A sentence on a first word that is no file but close to a command, or a command after an option."""
    from .help import unknown_command

    first = argv[0]
    if first.startswith("-") and first != "-":
        after = [word for word in argv[1:] if word in COMMANDS and not Path(word).exists()]
        return f"the command comes first: fitmodels {after[0]} {first} ..." if after else ""
    there = os.path.exists(first)  # noqa: PTH110  False where it cannot be reached: the command says why
    return "" if there else unknown_command(first, argv[1:2])


def _guarded(run, args) -> int:  # type: ignore[no-untyped-def]  # noqa: ANN001
    """Turn every error into one sentence on standard error."""
    from ..core.errors import DataError, FitmodelsError
    from .output import drop_output

    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a terminal without ± prints ? instead of failing
    try:
        code = int(run(args))
        sys.stdout.flush()
    except FitmodelsError as error:
        return _fail(str(error), error.exit_code)
    except BrokenPipeError:  # the reader of the pipe has closed it
        drop_output()
        return 0
    except OSError as error:
        drop_output()
        return _fail(f"{error.filename or 'the output'} cannot be read or written: {error.strerror or error}.", 2)
    except KeyboardInterrupt as stop:  # a command may state what it keeps
        return _fail(str(stop) or "interrupted; no file is incomplete.", 130)
    except MemoryError:
        sentence = "not enough memory for these data; leave rows out, or fit the pairs with fitmodels batch."
        return _fail(sentence, DataError.exit_code)
    except Exception as error:
        if os.environ.get("FITMODELS_TRACEBACK"):
            raise
        return _fail(
            f"internal error of fitmodels, not of your data: {type(error).__name__}: {error}. "
            "Set FITMODELS_TRACEBACK=1, run again and report the traceback.",
            DEFECT,
        )
    return code


def _fail(sentence: str, code: int) -> int:
    from .output import complain

    complain(sentence)
    return code
