"""The main job: read a file of wear tests, fit its laws, check them, write a folder for each pair."""

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.files import STANDARD_INPUT
from ..core.version import __version__
from .arguments import MARK, ONE_TABLE, Parser, opened, stem, typed
from .corrections import corrected
from .look import facts
from .options import fit_options, fitting_options, form_option, reading_options
from .output import Printer, complain, print_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..datasets import Runs
    from ..pipeline import FitOptions
    from ..pipeline.folders import Folder
    from ..pipeline.pair import PairAnalysis


LISTED = 5  # folders that are named


def parser() -> Parser:
    """Arguments of ``fitmodels FILE``."""
    p = Parser(
        "fitmodels",
        "fitmodels data.csv",
        "Fit wear, force and power laws to a file of cutting tests, and write a folder for each tool/work\n"
        "pair with params.json, a model card (README.md) and figures.\n"
        "Other commands, each with -h: look, reduce, compare; predict, plan, next, confirm, simulate; ident, excite,\n"
        "tune; limits, settings, replay, check, export; card, publish; batch",
        ONE_TABLE,
    )
    kinds = "CSV, TXT, TSV, .xlsx, .xls, .xlsb or .ods"
    p.add_argument(
        "file", metavar="FILE", help=f"table of tests: {kinds}, or a folder of such files; - reads standard input"
    )
    p.add_argument("--out", metavar="DIR", help="where to write (default: ./<file>-fit)")
    p.add_argument("--force", action="store_true", help="replace what an earlier run wrote there")
    p.add_argument("--json", action="store_true", help="print the report as JSON; writes nothing unless --out")
    reading_options(p)
    fitting_options(p)
    form_option(p)
    p.add_argument("--by", metavar="COLUMN", help="a category whose levels shift the laws, fitted together")
    verify = "compare laws with statsmodels, and posteriors with chains of another sampler (a few seconds per law)"
    p.add_argument("--verify", action="store_true", help=verify)
    pictures = "four figures of each posterior: marginals, pairs, by edge, curves"
    p.add_argument("--posterior-figures", action="store_true", help=pictures)
    p.add_argument("--version", "-V", action="version", version=f"fitmodels {__version__}")
    return p


def run(args: argparse.Namespace) -> int:
    """Read the file, analyse it or identify it where it is a record, and return the exit code."""
    from ..core.errors import RecordError
    from ..core.progress import progress_bar
    from ..pipeline.reading import read_tests

    options = fit_options(args, "by", "verify", "posterior_figures")
    with opened(args.file) as path:
        with progress_bar(lines=False) as step:
            step.say(f"reading {path.name}")
            try:
                runs = read_tests(path, options)
            except RecordError:
                runs = None
        if runs is None:
            return _identify(args, path)
    return _analysed(runs, options, args)


def _analysed(runs: "Runs", options: "FitOptions", args: argparse.Namespace) -> int:
    """Analyse the runs, print and write the results, and return the exit code."""
    from ..cards.reading_terminal import reading_notes
    from ..core.progress import progress_bar
    from ..pipeline.analysis import analyse_runs
    from ..pipeline.folders import left_folders

    out = Printer()
    folders = _folders(runs, options, args)
    if not args.json:
        out.show(reading_notes(runs, partial(corrected, args.words)))
    with progress_bar(lines=False) as step:
        analysis = analyse_runs(runs, options, command=typed(args.words), step=step.say)
    reports, written = [], []
    for pair, folder in zip(analysis.pairs, folders, strict=True):
        _show(pair, folder, args, out)
        if folder is not None:
            with progress_bar(lines=False) as step:
                step.say(f"writing {folder.path}")
                folder.write(pair, options, force=args.force)
        if not args.json and folder is not None and pair.parameters is not None:
            out.show(_written(pair, folder))
        if folder is not None and pair.parameters is not None:
            written.append(folder.path)
        reports.append(_report(pair, folder))
    left = left_folders(_root(args), runs, written) if written else ()
    if left and not args.json:
        out.show(_left(left, runs))
    if not args.json:
        for line in _reminders(runs, analysis.pairs):
            out.show(line)
    if args.json:
        print_json("report", {"understood": facts(runs), "pairs": reports, "left": list(map(str, left))}, version=4)
    if any(pair.failed for pair in analysis.pairs):
        return 5
    return 4 if any(pair.parameters is None for pair in analysis.pairs) else 0


def _reminders(runs: "Runs", pairs: "Sequence[PairAnalysis]") -> list[str]:
    """Lines at the end of the output: results that are not simply usable, and doubts about the data."""
    from ..cards.reading_terminal import doubts_reminder
    from ..cards.terminal import verdicts_reminder

    judged = {pair.name: "" if pair.parameters is None else verdicts_reminder(pair.parameters) for pair in pairs}
    lines = [f"{name}: {line}" if len(pairs) > 1 else line for name, line in judged.items() if line]
    return [*lines, *filter(None, [doubts_reminder(runs)])]


def _identify(args: argparse.Namespace, path: Path) -> int:
    """Identify a record, with the options that both commands have."""
    from ..core.errors import DataError, UsageError
    from . import ident

    shared = ("out", "tool", "work", "decimal", "delimiter", "unit", "force", "json", "words")
    options = ident.parser().parse_args(["--", str(path)])
    options.out = f"{stem(args.file)}-fit" if not args.json else None
    vars(options).update({name: value for name in shared if (value := getattr(args, name)) is not None})
    try:
        return ident.run(options)
    except (UsageError, DataError) as error:  # the options that it names are those of the other command
        name = STANDARD_INPUT if args.file == MARK else args.file
        command = "" if args.file == MARK else f", for fitmodels ident {args.file}"
        error.args = (f"{name} is a record of a run{command}: {error}",)
        raise


def _folders(runs: "Runs", options: "FitOptions", args: argparse.Namespace) -> "Sequence[Folder | None]":
    """Folder of each pair; an existing result stops everything before anything is fitted."""
    from ..pipeline.analysis import pairs_of
    from ..pipeline.folders import pair_folders

    each = pairs_of(runs, options)
    if args.json and not args.out:
        return [None] * len(each)
    return pair_folders(each, _root(args), options, force=args.force)


def _root(args: argparse.Namespace) -> str:
    return args.out or f"{stem(args.file)}-fit"


def _left(left: "Sequence[Path]", runs: "Runs") -> str:
    """A sentence on folders that a former reading of the file has left."""
    names = ", ".join(path.name for path in left[:LISTED]) + (", ..." if len(left) > LISTED else "")
    folders = "1 folder" if len(left) == 1 else f"{len(left)} folders"
    return (
        f"Left in {left[0].parent} from a former reading of {runs.source.name}: {folders} ({names}). They are not "
        "part of this result; delete them if they are wrong."
    )


def _show(pair: "PairAnalysis", folder: "Folder | None", args: argparse.Namespace, out: Printer) -> None:
    """Print the laws of a pair; on standard error why it has none, or none that may be used."""
    from ..cards import terminal

    if not args.json:
        out.show(terminal.pair_head(pair.runs))
    if pair.failed:
        complain(f"{pair.name}: {pair.failed}{_kept(pair, folder)}")
    elif pair.parameters is None:
        complain(terminal.nothing_fitted(pair.runs, pair.refused))
    elif not args.json:
        for block in terminal.pair_blocks(pair.runs, pair.parameters, pair.refused, partial(corrected, args.words)):
            out.show(block)
        for block in terminal.surface_blocks(pair.laws):
            out.show(block)
        if pair.no_life:
            out.show(pair.no_life)
    if pair.comparisons and not args.json:
        out.show(terminal.comparison_block(pair.comparisons))


def _kept(pair: "PairAnalysis", folder: "Folder | None") -> str:
    """Keep the draws of an interrupted run next to the folder that is not written, and name the file."""
    from ..parameters import draws_of

    if folder is None or not any(post.sample.interrupted for post in pair.posteriors):
        return ""
    path = folder.path.with_name(f"{folder.path.name}.draws-so-far.npz")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(draws_of(pair.posteriors))
    return f" The draws so far are in {path}."


def _written(pair: "PairAnalysis", folder: "Folder") -> str:
    from ..cards import files

    if folder.unchanged or pair.parameters is None:
        return f"{folder.path}: unchanged"
    instead = " in place of the former reading" if folder.former else ""
    return f"Written: {folder.path}/ ({', '.join(files(pair.parameters))}){instead}"


def _report(pair: "PairAnalysis", folder: "Folder | None") -> dict[str, Any]:
    from dataclasses import asdict

    from ..cards.content.verdicts import verdicts_of

    pf = pair.parameters
    return {
        "tool": pair.runs.tool,
        "work": pair.runs.work,
        "verdicts": {} if pf is None else {verdict.of: verdict.words for verdict in verdicts_of(pf)},
        "folder": None if folder is None or pf is None else str(folder.path),
        "parameters": None if pf is None else pf.model_dump(mode="json"),
        "gate": pair.failed or None,
        "refused": [{"response": item.response, "reason": item.reason} for item in pair.refused],
        "statsmodels": [{**asdict(one), "agrees": one.agrees} for one in pair.comparisons],
    }
