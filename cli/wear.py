"""The main job: understand a wear-test file, fit its laws, judge them, write a folder for each pair."""

import argparse
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import ParameterError
from ..core.version import __version__
from .arguments import Parser
from .output import Printer, complain
from .posteriors import checked, kept, posterior_options
from .reading import read, reading_options, recognise

if TYPE_CHECKING:
    from ..datasets import Runs
    from ..datasets.records.formats import FileKind
    from ..datasets.tables import Table

OPTIONS_OF_A_FIT = (
    "map",
    "unit",
    "range",
    "tool",
    "work",
    "by",
    "error",
    "criterion",
    "gauge_sd",
    "seed",
    "draws",
    "priors",
    "student",
    "verify",
    "posterior_figures",
    "decimal",
    "delimiter",
    "sheet",
)


def parser() -> Parser:
    """Arguments of ``fitmodels FILE``."""
    p = Parser(
        "fitmodels",
        "fitmodels data.csv",
        "Fit wear, force and power laws to a file of cutting tests, and write a folder for each tool/work\n"
        "pair with params.json, a model card (README.md) and figures.\n"
        "Other commands, each with -h: predict, plan, next, confirm, simulate; ident, excite, tune; limits,\n"
        "settings, replay, check, export; card, publish; batch",
    )
    p.add_argument("file", metavar="FILE", help="table of tests: CSV, TXT, TSV or .xlsx")
    p.add_argument("--out", metavar="DIR", help="where to write (default: ./<file>-fit)")
    p.add_argument("--force", action="store_true", help="replace what an earlier run wrote there")
    p.add_argument("--json", action="store_true", help="print the report as JSON; writes nothing unless --out")
    reading_options(p)
    fit = p.add_argument_group("fitting")
    fit.add_argument("--by", metavar="COLUMN", help="a category whose levels shift the laws, fitted together")
    fit.add_argument(
        "--error", choices=["multiplicative", "additive"], default="multiplicative",
        help="where the scatter is: a share of the value (default), or the same everywhere",
    )  # fmt: skip
    fit.add_argument("--criterion", type=float, metavar="MM", help="wear at which an edge is worn out (default: 0.3)")
    fit.add_argument(
        "--gauge-sd",
        type=float,
        metavar="MM",
        help="standard deviation of the wear gauge, to see what it does",
    )
    posterior_options(p)
    p.add_argument("--version", "-V", action="version", version=f"fitmodels {__version__}")
    return p


@dataclass(frozen=True, slots=True)
class Job:
    """One tool/work pair: its runs, where its folder goes, and whether that already holds this very fit."""

    runs: "Runs"
    folder: Path | None
    unchanged: bool


def run(args: argparse.Namespace) -> int:
    """Do it, and return the exit code."""
    from ..cards import terminal
    from ..core.errors import UsageError
    from ..core.progress import progress

    if args.criterion is not None and not 0 < args.criterion < float("inf"):
        raise UsageError(f"--criterion {args.criterion:g}: a wear criterion lies above zero, for instance 0.3.")
    if args.gauge_sd is not None and not 0 <= args.gauge_sd < float("inf"):
        raise UsageError(f"--gauge-sd {args.gauge_sd:g}: a standard deviation is not below zero, for instance 0.01.")
    out = Printer()
    with progress(lines=False) as step:
        step.say(f"reading {Path(args.file).name}")
        table, look = recognise(args.file, args)
        runs = None if look else _tests(table, look, args)
        del table  # as large as the runs
    if runs is None:
        return _identify(args)
    options = {name: value for name in OPTIONS_OF_A_FIT if (value := getattr(args, name)) is not None}
    options |= checked(args)
    jobs = _jobs(runs, args, options)
    if not args.json:
        out.show(terminal.understood(runs))
    reports = [_one_pair(job, args, options, out) for job in jobs]
    if args.json:
        report = {"schema": "fitmodels.report/1", "understood": _facts(runs), "pairs": reports}
        print(json.dumps(report, indent=2, ensure_ascii=False, allow_nan=False))  # noqa: T201
    if any(report["gate"] for report in reports):
        return 5
    return 4 if any(report["parameters"] is None for report in reports) else 0


def _tests(table: "str | Table", look: "FileKind | None", args: argparse.Namespace) -> "Runs":
    """The tests of a file; where it might be a record as well, that is said."""
    runs = read(table, args)
    if look is None or look.kind == "table":
        return runs
    word = f"a table of cutting tests ({look.reason}); if it is a record of one run, say fitmodels ident {args.file}"
    return replace(runs, assumed=(*runs.assumed, word))


def _identify(args: argparse.Namespace) -> int:
    """A record: what ``fitmodels ident`` does, with the options that both know."""
    from ..core.errors import DataError, UsageError
    from . import ident

    words = [args.file]
    for name in ("out", "tool", "work", "decimal", "delimiter"):
        if getattr(args, name) is not None:
            words += [f"--{name}", getattr(args, name)]
    words += [f"--unit={item}" for item in args.unit or ()]
    words += [f"--{name}" for name in ("force", "json") if getattr(args, name)]
    try:
        return ident.run(ident.parser().parse_args(words))
    except (UsageError, DataError) as error:  # the options that it names are those of the other command
        error.args = (f"{args.file} is a record of a run, for fitmodels ident {args.file}: {error}",)
        raise


def _jobs(runs: "Runs", args: argparse.Namespace, options: Mapping[str, Any]) -> list[Job]:
    """The pairs and their folders; an existing result stops everything before anything is fitted."""
    from ..cards.names import folder_names
    from ..core.errors import UsageError

    each = [runs] if args.by else list(runs.pairs())
    if args.json and not args.out:
        return [Job(pair, None, False) for pair in each]
    root = Path(args.out or f"{Path(args.file).stem}-fit")
    if root.exists() and not root.is_dir():
        raise UsageError(f"{root} is a file; choose a folder with --out.")
    jobs: list[Job] = []
    names = folder_names((pair.tool, pair.work) for pair in each)
    for pair, folder in zip(each, (root / name for name in names), strict=True):
        same = not args.force and _holds(folder, pair, options)
        if not (same or args.force) and folder.is_dir() and any(folder.iterdir()):
            raise UsageError(
                f"{folder} is there already and holds something else than this very fit; replace what "
                "fitmodels wrote there with --force, or write elsewhere with --out."
            )
        jobs.append(Job(pair, folder, same))
    return jobs


def _holds(folder: Path, runs: "Runs", options: Mapping[str, Any]) -> bool:
    """Whether the folder already holds the fit of these data by this version with these options."""
    from .. import cards, parameters

    try:
        pf = parameters.read(folder / "params.json")
    except ParameterError:
        return False
    if not all((folder / name).is_file() for name in cards.files(pf)):
        return False
    p = pf.provenance
    made = (p.data_sha256, p.fitmodels, p.options, p.data_file)
    return made == (runs.source.sha256, __version__, dict(options), runs.source.name)


def _one_pair(job: Job, args: argparse.Namespace, options: Mapping[str, Any], out: Printer) -> dict[str, Any]:
    from rich.text import Text

    from .. import cards
    from ..batch.fitting.one_pair import fit_pair, parameter_file
    from ..cards import terminal
    from ..core.progress import progress

    runs = job.runs
    with progress(lines=False) as step:
        step.say(f"fitting {runs.tool} on {runs.work}")
        fitted = fit_pair(
            runs, error=args.error, by=args.by, criterion=args.criterion, seed=_seed(args),
            draws=4000 if args.draws is None else args.draws, priors=args.priors or "weak",
            student=bool(args.student), verify=bool(args.verify), step=step.say,
        )  # fmt: skip
        made = {"gauge_sd": args.gauge_sd, "command": _command(args), "options": options, "seed": _seed(args)}
        pf = parameter_file(runs, fitted, **made) if fitted.laws and not fitted.shut else None
    if not args.json:
        out.show(terminal.pair_head(runs))
    if fitted.shut:
        complain(f"{runs.tool} on {runs.work}: {fitted.shut}{kept(fitted.posteriors, job.folder)}")
    elif pf is None:
        complain(terminal.nothing_fitted(runs, fitted.refused))
    elif not args.json:
        for block in terminal.pair_blocks(runs, pf, fitted.refused):
            out.show(block)
    folder = job.folder
    if pf is not None and folder is not None and not job.unchanged:
        with progress(lines=False) as step:
            step.say(f"writing {folder}")
            cards.write(
                pf,
                folder,
                laws=fitted.laws,
                posteriors=fitted.posteriors,
                posterior_figures=bool(args.posterior_figures),
                force=args.force,
            )
    if not args.json and pf is not None:
        out.show(
            Text(f"{folder}: unchanged" if job.unchanged else f"Written: {folder}/ ({', '.join(cards.files(pf))})")
        )
    return {
        "tool": runs.tool,
        "work": runs.work,
        "folder": None if folder is None or pf is None else str(folder),
        "parameters": None if pf is None else pf.model_dump(mode="json"),
        "gate": fitted.shut or None,
        "refused": [{"response": item.response, "reason": item.reason} for item in fitted.refused],
    }


def _seed(args: argparse.Namespace) -> int:
    return 1 if args.seed is None else int(args.seed)


def _command(args: argparse.Namespace) -> str:
    """The command that makes this again, without where it was written."""
    import shlex

    words = ["fitmodels", Path(args.file).name]
    for name in OPTIONS_OF_A_FIT:
        value = getattr(args, name)
        if name == "error" and value == "multiplicative":
            continue
        for item in value if isinstance(value, list) else [value] if value is not None else []:
            words += [f"--{name.replace('_', '-')}"] + ([] if item is True else [str(item)])
    return shlex.join(words)


def _facts(runs: "Runs") -> dict[str, Any]:
    """What was understood, for programs."""
    from dataclasses import asdict

    return {
        "source": asdict(runs.source),
        "tool": runs.tool,
        "work": runs.work,
        "columns": [asdict(use) for use in runs.columns],
        "units": dict(runs.units),
        "assumed": list(runs.assumed),
        "warnings": list(runs.warnings),
        "notes": list(runs.notes),
        "simulated": runs.simulated,
    }
