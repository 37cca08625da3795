"""The main job: read a file of wear tests, fit its laws, check them, write a folder for each pair."""

import argparse
import shlex
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.files import STANDARD_INPUT, write_whole
from ..core.rounding import count
from ..core.version import __version__
from ..datasets.options import without
from .arguments import MARK, ONE_TABLE, Parser, opened, stem, typed
from .corrections import corrected
from .look import facts
from .options import fit_options, fitting_options, form_option, reading_options
from .output import Printer, complain, output_options, print_json

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from ..core.errors import UsageError
    from ..core.progress import Meter
    from ..datasets import Runs
    from ..parameters import ParameterFile
    from ..pipeline import FitOptions
    from ..pipeline.folders import Folder
    from ..pipeline.pair import PairAnalysis


LISTED = 5  # folders that are named
AFTER_DRAWS = "\nThe posterior changes a verdict. This replaces the above:\n"


def parser() -> Parser:
    """Arguments of ``fitmodels FILE``."""
    p = Parser(
        "fitmodels",
        "fitmodels data.csv",
        "Fit wear, force and power laws to a file of cutting tests, and write a folder for each tool/work\n"
        "pair with params.json, a model card (README.md) and figures. 'fitmodels help' lists the other commands.",
        ONE_TABLE,
        main="--out --force --full --quiet --json --map --unit --value --leave-out --edge --tool --work --law "
        "--form --criterion --by",
    )
    kinds = "CSV, TXT, TSV, .xlsx, .xls, .xlsb or .ods"
    p.add_argument(
        "file", metavar="FILE", help=f"table of tests: {kinds}, or a folder of such files; - reads standard input"
    )
    p.add_argument("--out", metavar="DIR", help="where to write (default: ./<file>-fit)")
    p.add_argument("--force", action="store_true", help="replace what an earlier run wrote there")
    output_options(
        p, "print the report as JSON; writes nothing unless --out", "print all tables, checks and assumptions"
    )
    reading_options(p)
    fitting_options(p)
    form_option(p)
    p.add_argument(
        "--by", metavar="COLUMN", help="a category whose levels shift the laws, fitted together (default: none)"
    )
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
    from ..core.progress import progress_bar
    from ..pipeline.folders import left_folders

    out = Printer(quiet=args.quiet or args.json)
    folders, refusal = _folders_or_refusal(runs, options, args)
    screen = (_Full if args.full else _First)(args, runs, out, len(folders))
    screen.read()
    pairs: list[PairAnalysis] = []
    for pair, complete in _stages(runs, options, args):
        screen.pair(pair, folders[len(pairs)], complete=complete)
        pairs += [pair] if complete else []
    reports, written = [], []
    for pair, folder in zip(pairs, folders, strict=True):
        if folder is not None and pair.parameters is not None and refusal is None:
            with progress_bar(lines=False) as step:
                step.say(f"drawing figures and the card in {folder.path}")
                folder.write(pair, options, force=args.force)
            written.append(folder.path)
            if not args.json:
                screen.wrote(pair, folder)
        reports.append(_report(pair, folder))
    if refusal is not None:
        raise refusal
    left = left_folders(_root(args), runs, written) if written else ()
    if left:
        out.show(_left(left, runs))
    screen.end(pairs)
    _name_unused_priors(options, pairs)
    if args.json:
        print_json("report", {"understood": facts(runs), "pairs": reports, "left": list(map(str, left))}, version=5)
    if any(pair.failed for pair in pairs):
        return 5
    return 4 if any(pair.parameters is None for pair in pairs) else 0


def _stages(runs: "Runs", options: "FitOptions", args: argparse.Namespace) -> "Iterator[tuple[PairAnalysis, bool]]":
    """Each pair as soon as it is analysed, under a bar of progress that ends before anything is printed."""
    from ..core.progress import progress_bar
    from ..pipeline.analysis import analysis_stages

    bar: list[Meter] = []
    command = typed(without(args.words, "screen"))
    stages = analysis_stages(runs, options, command=command, step=lambda words: bar[-1].say(words))
    while True:
        with progress_bar(lines=False) as meter:
            bar.append(meter)
            found = next(stages, None)
        if found is None:
            return
        yield found


class _Full:
    """All of it: how the file was read, each law with its tables, the files written, and what must not be missed."""

    def __init__(self, args: argparse.Namespace, runs: "Runs", out: Printer, number: int) -> None:
        self.args, self.runs, self.out, self.number = args, runs, out, number

    def read(self) -> None:
        """Print how the file was read."""
        from ..cards.reading_terminal import reading_notes

        self.out.show(reading_notes(self.runs, partial(corrected, self.args.words)))

    def pair(self, pair: "PairAnalysis", folder: "Folder | None", *, complete: bool) -> None:
        """Print a pair that is complete."""
        if complete:
            _show(pair, folder, self.args, self.out)

    def wrote(self, pair: "PairAnalysis", folder: "Folder") -> None:
        """Print the files of a folder."""
        self.out.wrote(_written(pair, folder), folder.path)

    def end(self, pairs: "Sequence[PairAnalysis]") -> None:
        """Print what must not be missed."""
        for line in _reminders(self.runs, pairs):
            self.out.show(line)


class _First(_Full):
    """The first screen."""

    def read(self) -> None:
        """Print the file, units that are assumed, doubts."""
        from ..cards.first_screen import FirstScreen, rendered

        doubts = sorted(self.runs.doubts, key=lambda doubt: not doubt.unsettled)
        words = [shlex.split(corrected(self.args.words, one.remedy)) if one.remedy else [] for one in doubts[:1]]
        self.judged: list[object] = []
        self.shown = ""
        self.screen = FirstScreen(self.out.width, self.number, ascii=self.out.ascii)
        self.out.show(rendered(self.screen.input_lines(self.runs, words[0] if words else [])))

    def pair(self, pair: "PairAnalysis", folder: "Folder | None", *, complete: bool) -> None:
        """Print a pair as soon as its laws are judged; on standard error why it has none, or none that may be used."""
        from ..cards.first_screen import rendered

        if failure := _failure(pair, folder):
            complain(failure)
        if complete and pair.comparisons:
            from ..cards import terminal

            self.out.show(terminal.comparison_line(pair.comparisons))
        if pair.parameters is not None and not self._unchanged(pair.name, pair.parameters):
            path = "params.json" if folder is None else str(folder.path / "params.json")
            lines = self.screen.pair_lines(pair.parameters, pair.runs, pair.refused, path, pair.no_life)
            if lines:
                self._introduce(pair.name)
                self.out.show(rendered(lines))

    def _introduce(self, name: str) -> None:
        """Say that what follows is in place of an earlier screen of the pair, if there is one."""
        if self.shown == name:
            self.out.show(AFTER_DRAWS)
        self.shown = name

    def _unchanged(self, name: str, pf: "ParameterFile") -> bool:
        """Whether the pair stands on the screen already, with the same verdicts."""
        now: list[object] = [name, [law.verdict for law in pf.laws.values()]]
        same = self.judged == now
        self.judged = now
        return same

    def wrote(self, pair: "PairAnalysis", folder: "Folder") -> None:
        """Print the folder, of many pairs at the end."""
        from ..cards.first_screen import rendered
        from ..cards.reading_terminal import wrapped

        if self.number == 1:
            instead = " in place of the former reading" if folder.former else ""
            words = f"{folder.path}: unchanged" if folder.unchanged else f"Written: {folder.path}/{instead}"
            lines = wrapped(f"{words} (card.html; tables: --full)", self.out.width)
            self.out.wrote(rendered(lines), folder.path)
        elif self.out.quiet:
            self.out.wrote("", folder.path)

    def end(self, pairs: "Sequence[PairAnalysis]") -> None:
        """Print where the folders of several pairs are, and how many are not on the screen."""
        from ..cards.first_screen import rendered
        from ..cards.reading_terminal import wrapped

        written = sum(pair.parameters is not None for pair in pairs)
        more = max(0, self.screen.used - self.screen.height)
        if self.number > 1 and written:
            rest = f"... and {more} more pairs. " if more else ""
            folders = count(written, "folder")
            words = f"{rest}Written: {folders} in {_root(self.args)}/ (card.html in each; tables: --full)"
            self.out.show(rendered(wrapped(words, self.out.width)))


def _reminders(runs: "Runs", pairs: "Sequence[PairAnalysis]") -> list[str]:
    """Lines at the end of the output: results that are not simply usable, and doubts about the data."""
    from ..cards.reading_terminal import doubts_reminder
    from ..cards.terminal import verdicts_reminder

    judged = {pair.name: "" if pair.parameters is None else verdicts_reminder(pair.parameters) for pair in pairs}
    lines = [f"{name}: {line}" if len(pairs) > 1 else line for name, line in judged.items() if line]
    return [*lines, *filter(None, [doubts_reminder(runs)])]


def _name_unused_priors(options: "FitOptions", pairs: "Sequence[PairAnalysis]") -> None:
    """Print on standard error which priors are of responses that have no law."""
    from ..fit.bayes.priors_file import laws_of

    tables = options.prior_tables()
    fitted = {law.response for pair in pairs for law in pair.laws}
    unused = [] if isinstance(tables, str) else [name for name in laws_of(tables) if name not in fitted]
    if unused:
        complain(f"priors of {', '.join(unused)} are not used: this file has no such law.")


def _identify(args: argparse.Namespace, path: Path) -> int:
    """Identify a record, with the options that both commands have."""
    from ..core.errors import DataError, UsageError
    from . import ident

    shared = ("out", "tool", "work", "decimal", "delimiter", "unit", "force", "json", "full", "quiet", "words")
    options = ident.parser().parse_args(["--", str(path)])
    options.out = f"{stem(args.file)}-fit" if not args.json else None
    vars(options).update({name: value for name in shared if (value := getattr(args, name)) is not None})
    try:
        return ident.run(options)
    except (UsageError, DataError) as error:  # the options that it names are those of the other command
        name = STANDARD_INPUT if args.file == MARK else args.file
        command = "" if args.file == MARK else f", for fitmodels ident {shlex.quote(args.file)}"
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


def _folders_or_refusal(
    runs: "Runs", options: "FitOptions", args: argparse.Namespace
) -> "tuple[Sequence[Folder | None], UsageError | None]":
    """Folder of each pair, and why nothing is written there; raised at once where no screen is shown before it."""
    from ..core.errors import UsageError

    try:
        return _folders(runs, options, args), None
    except UsageError as error:
        if args.quiet or args.json or args.student or args.force:
            raise
        folders = _folders(runs, options, argparse.Namespace(**{**vars(args), "force": True}))
        return folders, UsageError(f"nothing was written: {error}\n  {typed([*args.words, '--force'])}")


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


def _failure(pair: "PairAnalysis", folder: "Folder | None") -> str:
    """Reason why a pair has no laws, or no complete folder; empty for one that has both."""
    if pair.failed:
        return f"{pair.name}: {pair.failed}{_kept(pair, folder)}"
    if pair.parameters is not None:
        return ""
    from ..cards.terminal import nothing_fitted

    return nothing_fitted(pair.runs, pair.refused)


def _show(pair: "PairAnalysis", folder: "Folder | None", args: argparse.Namespace, out: Printer) -> None:
    """Print the laws of a pair; on standard error why it has none, or none that may be used."""
    from ..cards import terminal

    out.show(terminal.pair_head(pair.runs))
    if failure := _failure(pair, folder):
        complain(failure)
    if pair.parameters is not None and not pair.failed:
        for block in terminal.pair_blocks(pair.runs, pair.parameters, pair.refused, partial(corrected, args.words)):
            out.show(block)
        for block in terminal.surface_blocks(pair.laws):
            out.show(block)
        if pair.no_life:
            out.show(pair.no_life)
    if pair.comparisons:
        out.show(terminal.comparison_block(pair.comparisons))


def _kept(pair: "PairAnalysis", folder: "Folder | None") -> str:
    """Keep the draws of an interrupted run next to the folder that is not written, and name the file."""
    from ..parameters import draws_of

    if folder is None or not any(post.sample.interrupted for post in pair.posteriors):
        return ""
    path = folder.path.with_name(f"{folder.path.name}.draws-so-far.npz")
    write_whole(path, draws_of(pair.posteriors), parents=True)
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
