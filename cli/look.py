"""``fitmodels look``: how a file is read, a first picture, and the commands that correct or confirm it."""

import argparse
import shlex
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .arguments import ONE_TABLE, Parser, opened, stem
from .corrections import corrected, explicit, remedies_in
from .options import read_keywords, reading_options
from .output import Printer, output_options, print_json

if TYPE_CHECKING:
    from ..core.errors import FitmodelsError
    from ..datasets import Runs
    from ..datasets.options import ReadOptions
    from ..datasets.tables import Table

FIRST_ROWS, LONGEST_CELL = 12, 40  # of the table in the JSON
MADE_BY = "fitmodels look"  # in the picture, so that another picture of its name is not replaced


def parser() -> Parser:
    """Arguments of ``fitmodels look``."""
    p = Parser(
        "fitmodels look",
        "fitmodels look data.csv",
        "Print how a file of cutting tests is read (columns, units, edges, pairs, doubts), draw a first picture, and\n"
        "print the whole command that fits it as read, or corrected. Nothing is fitted. Where the reading is refused,\n"
        "the columns are printed as found.",
        ONE_TABLE,
        main="--out --force --quiet --json --map --unit --value --edge --tool --work",
    )
    p.add_argument("file", metavar="FILE", help="table of tests, as of fitmodels FILE; - reads standard input")
    p.add_argument("--out", metavar="FILE", help="the picture (default: ./<file>-look.png)")
    p.add_argument("--force", action="store_true", help="replace a picture that another program made")
    output_options(p, "print the reading as JSON (fitmodels.look/3); no picture")
    reading_options(p)
    return p


def run(args: argparse.Namespace) -> int:
    """Print the reading, draw the picture, and return the exit code."""
    from ..core.errors import DataError, UsageError
    from ..datasets.options import ReadOptions
    from ..pipeline.reading import read_tests

    options = ReadOptions(**read_keywords(args))
    picture = None if args.json else _picture_path(args)
    with opened(args.file) as path:
        try:
            runs = read_tests(path, options)
        except (DataError, UsageError) as refusal:
            if not args.quiet:
                _show_columns(path, options, refusal, args)
            raise
        if args.json:
            proposed = [{"purpose": why, "command": how} for why, how in _commands(runs, args.words)]
            found = {**facts(runs), "refused": None, "commands": proposed, **_first_rows(path, options)}
            print_json("look", found, version=3)
            return 0
    commands = _commands(runs, args.words)
    out = Printer(quiet=args.quiet)
    _show(runs, commands, args.words, out)
    if picture is not None:
        _draw(runs, picture)
        out.wrote(f"Picture: {picture}", picture)
    return 0


def facts(runs: "Runs") -> dict[str, Any]:
    """The reading of the file, for programs."""
    from dataclasses import asdict

    return {
        "source": asdict(runs.source),
        "tool": runs.tool,
        "work": runs.work,
        "columns": [asdict(use) for use in runs.columns],
        "units": dict(runs.units),
        "assumed": list(runs.assumed),
        "warnings": list(runs.warnings),
        "doubts": [asdict(doubt) for doubt in runs.doubts],
        "notes": list(runs.notes),
        "simulated": runs.simulated,
    }


def _show(runs: "Runs", commands: list[tuple[str, str]], words: list[str], out: Printer) -> None:
    from ..cards import reading_terminal as shown

    out.show(shown.reading_notes(runs, partial(corrected, words)))
    out.show(shown.pairs_block(tuple(runs.pairs()), _laws))
    if (edges := shown.edges_block(runs)) is not None:
        out.show(edges)
    out.show(shown.commands_block(commands))


def _laws(runs: "Runs") -> str:
    """Responses of the laws that the columns of a pair ask for, with their factors."""
    from ..fit.defaults import Held, requested_laws

    laws = requested_laws(Held.of_runs(runs), ())
    return "; ".join(f"{law.response} of {', '.join(law.factors)}" for law in laws)


def _commands(runs: "Runs", words: list[str]) -> list[tuple[str, str]]:
    """Purpose and whole command: as read, with every assumption written out, and corrected."""
    found = [(_purpose(runs), corrected(words, ""))]
    if written := explicit(runs):
        found.append(("The same, with the units that the file does not name written out:", corrected(words, written)))
    remedies = [doubt.remedy for doubt in runs.doubts if doubt.remedy]
    found += [(f"Corrected, for {_named(doubt.columns)}:", corrected(words, doubt.remedy))
              for doubt in runs.doubts if doubt.remedy]  # fmt: skip
    if len(dict.fromkeys(remedies)) > 1:
        found.append(("Corrected, all of them:", corrected(words, " ".join(dict.fromkeys(remedies)))))
    return list({command: (why, command) for why, command in reversed(found)}.values())[::-1]


def _purpose(runs: "Runs") -> str:
    """What the command of the file as read is for; where no law can be fitted, the columns that are empty."""
    import numpy as np

    from ..core.rounding import join_words
    from ..datasets.vocabulary import MEASURED, ROLES

    if any(_laws(pair) for pair in runs.pairs()):
        return "Fit it as read:"
    measured = [use for use in runs.columns if use.role and ROLES[use.role].kind in MEASURED]
    empty = [f"{use.header!r}" for use in measured if np.isnan(runs.values(str(use.role))).all()]
    if not empty:
        return "No law can be fitted to these columns; add columns to this command with --map:"
    what = f"column {empty[0]} is" if len(empty) == 1 else f"columns {join_words(empty)} are"
    return f"No law can be fitted: {what} empty. Filled in, the file is read by:"


def _named(columns: tuple[str, ...]) -> str:
    return ", ".join(columns) or "the doubt above"


def _show_columns(path: Path, options: "ReadOptions", refusal: "FitmodelsError", args: argparse.Namespace) -> None:
    """Columns of a file whose reading is refused, where its table can be read, and the remedy as a whole command."""
    from ..cards import reading_terminal as shown

    remedies = remedies_in(str(refusal))
    first = "Corrected:" if len(remedies) == 1 else "Either:"
    commands = [("Or:" if k else first, corrected(args.words, remedy)) for k, remedy in enumerate(remedies)]
    table = _table(path, options)
    if table is None:
        return
    if args.json:
        facts = {"refused": str(refusal), "columns": _columns_as_found(table), **_first_rows(path, options)}
        pairs = [{"purpose": why, "command": how} for why, how in commands]
        print_json("look", {**facts, "commands": pairs}, version=3)
        return
    out = Printer()
    out.show(shown.raw_columns(table))
    if commands:
        out.show(shown.commands_block(commands))


def _table(path: Path, options: "ReadOptions") -> "Table | None":
    """The table of a file, where it can be read."""
    from ..core.errors import FitmodelsError
    from ..datasets.reading import tables_of_tests

    try:
        return tables_of_tests(path, options)
    except FitmodelsError:
        return None


def _columns_as_found(table: "Table") -> list[dict[str, Any]]:
    """Columns of a table with the roles and units of their headers."""
    from ..datasets.columns import recognised

    columns = table.columns
    return [
        {"number": column.number, "header": column.name, "name": column.name, "role": role, "unit": unit}
        for column, (role, unit) in zip(columns, recognised(columns), strict=True)
    ]


def _first_rows(path: Path, options: "ReadOptions") -> dict[str, Any]:
    """Texts of the first rows, a cell for each column, their lines, and the sheets of a workbook."""
    table = _table(path, options)
    if table is None:
        return {"rows": [], "lines": [], "sheets": [], "other_sheets": []}
    columns = [column.values[:FIRST_ROWS] for column in table.columns]
    texts = ([f"{v:.6g}" if isinstance(v, float) else str(v)[:LONGEST_CELL] for v in values] for values in columns)
    rows = [["" if text == "nan" else text for text in row] for row in zip(*texts, strict=True)]
    lines = [int(line) for line in table.lines[:FIRST_ROWS]]
    return {"rows": rows, "lines": lines, "sheets": list(table.sheets), "other_sheets": list(table.other_sheets)}


def _picture_path(args: argparse.Namespace) -> Path:
    """Path of the picture; a file there that is not such a picture is not replaced."""
    from ..core.errors import UsageError

    path = Path(args.out or f"{stem(args.file)}-look.png")
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise UsageError(f"--out {args.out}: the picture is a file that ends in .png, .pdf or .svg.")
    if path.is_dir() or not path.parent.is_dir():
        where = "is a folder" if path.is_dir() else f"cannot be written: there is no folder {path.parent}"
        raise UsageError(f"{path} {where}; choose another file with --out.")
    if not args.force:
        _check_replaceable(path)
    return path


def _check_replaceable(path: Path) -> None:
    from ..core.bounded import contains
    from ..core.errors import UsageError

    if path.exists() and not contains(path, MADE_BY.encode()):
        raise UsageError(
            f"{path} exists and was not made by {MADE_BY}; replace it with --force, or choose another file with --out "
            f"{shlex.quote(f'{path.stem}-2{path.suffix}')}."
        )


def _draw(runs: "Runs", path: Path) -> None:
    from io import BytesIO

    from ..core.files import write_whole
    from ..core.plotting import save_figure
    from ..datasets.overview import overview_figure

    held, kind = BytesIO(), path.suffix.lower()[1:]
    named = {"png": "Software", "pdf": "Creator", "svg": "Creator"}[kind]
    save_figure(overview_figure(runs), held, format=kind, dpi=110, metadata={named: MADE_BY})
    write_whole(path, held.getvalue())
