"""``fitmodels reduce``: records of forces, power or current -> a table of tests, a row a cut."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import UsageError
from ..core.rounding import count, listed
from .arguments import Parser
from .numbers import constants, pairs, values
from .output import Printer, output_options, print_json
from .plan import target

if TYPE_CHECKING:
    from ..datasets.signals.options import ReduceOptions
    from ..datasets.signals.reduction import Reduction

SHOWN = 12  # records and remarks in the terminal


def parser() -> Parser:
    """Arguments of ``fitmodels reduce``."""
    p = Parser(
        "fitmodels reduce",
        "fitmodels reduce records --plan tests.csv --out data.csv",
        "Reduce records of forces, torque, power or current to a table of tests, a row a cut: cuts are found by\n"
        "their load, entry and exit are left out, and the zero is taken from the air before and after. Mean, peak\n"
        "per revolution and standard deviation are joined to the rows of the plan. Each record is drawn in\n"
        "<out>-records/; look at the pictures. An interrupted run continues where it stopped.",
        main="--force --full --quiet --json --map --unit --scale --rate --channel --shortest --join --value",
    )
    p.add_argument("folder", metavar="FOLDER", help="records: CSV, TXT, .lvm, .tdms, .mat or .xlsx")
    p.add_argument("--plan", metavar="FILE", required=True, help="table of tests, a row a cut")
    p.add_argument("--out", metavar="FILE", required=True, help="table to write, for fitmodels FILE")
    p.add_argument("--force", action="store_true", help="replace an existing file")
    output_options(
        p, "print the cuts as JSON (fitmodels.reduction/1)", f"name all records and remarks, not only {SHOWN} of them"
    )
    group = p.add_argument_group("records")
    group.add_argument(
        "--map",
        action="append",
        metavar="Fc=COLUMN",
        help="column of a channel or of time, none: not read (default: by its name)",
    )
    group.add_argument(
        "--unit", action="append", metavar="Fc=N", help="unit of a channel or of time (default: from the header)"
    )
    group.add_argument(
        "--scale", action="append", metavar="Fc=200", help="sensitivity of a channel in volts, N per V (default: none)"
    )
    group.add_argument(
        "--rate", type=float, metavar="HZ", help="samples per second (default: from the column of times)"
    )
    group.add_argument("--decimal", choices=["point", "comma"], help="decimal mark (default: found in the file)")
    group.add_argument("--delimiter", metavar="MARK", help="delimiter of cells (default: found in the file)")
    group.add_argument(
        "--sheet",
        metavar="NAME",
        help="sheet of a workbook, or group of a .tdms file (default: the one that holds a record)",
    )
    group = p.add_argument_group("cuts")
    group.add_argument("--channel", metavar="Fc", help="channel on which cuts are found (default: highest contrast)")
    group.add_argument("--shortest", type=float, default=1.0, metavar="S", help="shortest cut (default: 1)")
    share = "smallest load of a cut, as a share of the largest of its record (default: 0.06)"
    group.add_argument("--threshold", type=float, default=0.06, metavar="SHARE", help=share)
    group.add_argument(
        "--guard",
        type=float,
        default=0.05,
        metavar="SHARE",
        help="share left out beyond entry and exit (default: 0.05)",
    )
    group.add_argument(
        "--join", choices=["name", "time", "order"], help="how cuts find their rows (default: first possible)"
    )
    group.add_argument(
        "--value", action="append", metavar="n=800", help="n (1/min), or V and D (default: from the plan)"
    )
    return p


def run(args: argparse.Namespace) -> int:
    """Reduce, print and write, and return the exit code."""
    from ..core.progress import progress_bar
    from ..datasets import write_csv
    from ..datasets.signals.recording import record_files
    from ..datasets.signals.reduction import reduce_folder
    from ..datasets.signals.rows import reduced_rows

    how = _options(args)
    out = target(args.out, args.force, args.plan)
    if not isinstance(out, Path):
        raise UsageError("--out: give the name of a file.")
    folder, kept = Path(args.folder), out.with_name(f"{out.stem}-records")
    try:
        with progress_bar(unit="records", lines=len(record_files(folder)) > SHOWN and not args.quiet) as meter:
            found = reduce_folder(folder, Path(args.plan), how, kept, besides=(out,), meter=meter)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"interrupted; the records reduced so far are kept in {kept}: run it again.") from None
    frame, notes, remarks = reduced_rows(found, how, folder)
    write_csv(frame, out, notes, units={}, force=args.force)
    if args.json:
        print_json("reduction", _facts(found, out, kept))
    else:
        lines = _report(found, notes, remarks, None if args.full else SHOWN)
        printer = Printer(quiet=args.quiet)
        for line in lines:
            printer.show(line)
        head = f"Written: {out} ({count(len(found.plan), 'row')}); pictures of the records in {kept}/."
        printer.wrote(f"{head} Next: fitmodels {out}", out)
    return 0


def _options(args: argparse.Namespace) -> "ReduceOptions":
    from ..datasets.signals.options import ReduceOptions

    return ReduceOptions(
        map=pairs(args.map, "--map", "Fc=col2"), units=pairs(args.unit, "--unit", "Fc=N"),
        scales=values(args.scale, "--scale"), constants=constants(args.value), rate=args.rate, shortest=args.shortest,
        guard=args.guard, threshold=args.threshold, channel=args.channel, join=args.join, decimal=args.decimal,
        delimiter=args.delimiter, sheet=args.sheet,
    )  # fmt: skip


def _report(found: "Reduction", notes: list[str], remarks: list[str], most: int | None) -> list[str]:
    """Findings, and what a person is to judge, at most so many records and remarks."""
    records = found.records
    cuts = sum(len(record.cuts) for record in records)
    what = f"{count(cuts, 'cut')} in {count(len(records), 'record')}"
    lines = [f"{what}, joined to {count(len(found.plan), 'row')} by {found.how}"]
    if found.resumed:
        lines.append(
            f"{count(found.resumed, 'file')} {'was' if found.resumed == 1 else 'were'} reduced by an earlier run"
        )
    for record in records[:most]:
        levels = ", ".join(f"{state} {level:.3g}" for state, level in record.levels.items())
        lines.append(
            f"  {record.name}: {count(len(record.cuts), 'cut')} in {record.length:.4g} s at {record.rate:.6g} Hz, "
            f"found on {record.signal} ({levels})"
        )
    lines += _and_more(len(records), most)
    common = dict.fromkeys(note for record in records for note in record.notes)
    lines += [
        f"  {note}: {_named([r.name for r in records if note in r.notes], len(records))}"
        for note in list(common)[:most]
    ]
    doubted = [(k, text) for k, text in enumerate(remarks) if text]
    if doubted:
        lines.append(f"remarks on {len(doubted)} of {count(len(remarks), 'row')}, in the column remarks:")
        held = found.plan.table.lines
        lines += [f"  line {held[k]} of the plan: {text}" for k, text in doubted[:most]]
        lines += _and_more(len(doubted), most)
    shown = ("less the idle level", "sign is reversed", "signs are", "does not rise")
    lines += [note for note in notes if note.startswith(("peak:", "t:")) or any(words in note for words in shown)]
    return lines


def _and_more(n: int, most: int | None) -> list[str]:
    """A line on what is not listed."""
    return [f"  and {n - most} more; --full lists all"] if most is not None and n > most else []


def _named(names: list[str], of: int) -> str:
    if len(names) == of:
        return "every record"
    return listed(names, 3)


def _facts(found: "Reduction", out: Path, kept: Path) -> dict[str, object]:
    from dataclasses import asdict

    return {
        "out": str(out),
        "pictures": str(kept),
        "joined_by": found.how,
        "rows": list(found.rows),
        "records": _known([asdict(record) for record in found.records]),
    }


def _known(held: Any) -> Any:  # noqa: ANN401  whatever JSON can hold
    """The same with None for NaN, which JSON does not have."""
    if isinstance(held, dict):
        return {key: _known(value) for key, value in held.items()}
    if isinstance(held, list | tuple):
        return [_known(value) for value in held]
    return None if held != held else held
