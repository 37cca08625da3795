"""The options that say how a lab file is read, shared by every command that reads one."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .arguments import Parser, pairs, ranges

if TYPE_CHECKING:
    from ..datasets import Runs
    from ..datasets.records.formats import FileKind
    from ..datasets.tables import Table


def reading_options(parser: Parser) -> None:
    """Add them to a command."""
    group = parser.add_argument_group("reading")
    group.add_argument("--map", action="append", metavar="VB=COLUMN", help="which column is which, by name or col7")
    group.add_argument(
        "--unit", action="append", metavar="t=s", help="unit of a column that names none, or the wrong one"
    )
    group.add_argument("--range", action="append", metavar="V=50:200", help="what the coded levels -1 and 1 stand for")
    group.add_argument("--tool", metavar="NAME", help="name of the tool")
    group.add_argument("--work", metavar="NAME", help="name of the work material")
    group.add_argument("--decimal", choices=["point", "comma"], help="decimal mark, where the file leaves it open")
    group.add_argument("--delimiter", metavar="MARK", help="what stands between cells, where the file leaves it open")
    group.add_argument("--sheet", metavar="NAME", help="sheet of an .xlsx file")


def recognise(file: str, args: argparse.Namespace) -> tuple["str | Table", "FileKind | None"]:
    """What a file looks like, with its table where that was read; None where the options say that it holds tests."""
    from ..datasets.records.formats import FileKind, kind_of, looks_like_record
    from ..datasets.tables import read_table
    from ..datasets.tables.decode import load_bytes
    from ..datasets.units import is_unit

    if args.map or args.range or args.sheet:
        return file, None
    path = Path(file)
    kind = kind_of(load_bytes(path), path.name)
    if kind != "table":
        return file, FileKind("record", f"a file of samples ({kind})")
    table = read_table(path, is_unit=is_unit, decimal=args.decimal, delimiter=args.delimiter)
    return table, looks_like_record(table)


def read(file: "str | Table", args: argparse.Namespace) -> "Runs":
    """Read a file as the options say."""
    from ..datasets import read_runs

    return read_runs(file, **as_said(args))


def as_said(args: argparse.Namespace) -> dict[str, Any]:
    """What the options say of reading, by the names that `datasets.read_runs` gives it."""
    return {
        "map": pairs(args.map, "--map", "VB=col7"),
        "units": pairs(args.unit, "--unit", "t=s"),
        "ranges": ranges(args.range),
        "tool": args.tool,
        "work": args.work,
        "decimal": args.decimal,
        "delimiter": args.delimiter,
        "sheet": args.sheet,
    }
