"""``fitmodels batch``: all pairs of a shop, fitted in one go on one machine or a cluster."""

import argparse
import json
import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import UsageError
from .arguments import Parser, processes
from .output import Printer
from .posteriors import checked, draw_options
from .reading import as_said, reading_options

if TYPE_CHECKING:
    from ..batch import Batch, How, Reading

OPTIONS_OF_A_BATCH = (  # what the numbers and the files of the pairs depend on
    *("pairs", "group", "keep_draws"),
    *("map", "unit", "range", "tool", "work", "decimal", "delimiter", "sheet"),
    *("error", "criterion", "gauge_sd", "seed", "draws", "priors", "student"),
)
FILES = ("pairs", "priors")  # told by name, without the folder


def parser() -> Parser:
    """Arguments of ``fitmodels batch``."""
    p = Parser(
        "fitmodels batch",
        "fitmodels batch measurements/ --jobs 4 --pairs pairs.csv",
        "Fit all tool/work pairs of a folder of lab files, a Parquet data set or a CSV of any size: one table of\n"
        "results, a parameter file a pair, families of pairs compared, a site of cards, and who needs attention.\n"
        "What is done stays done: after an interruption the same command goes on. Exit codes: 3 where part of the\n"
        "source could not be read, 4 where no pair has a law; a pair that fails is a row with its reason.",
    )
    p.add_argument("source", metavar="SOURCE", help="folder of lab files, Parquet file or folder, or a text file")
    p.add_argument("--out", metavar="DIR", help="where to write (default: ./<source>-batch)")
    p.add_argument("--force", action="store_true", help="replace what an earlier batch wrote there, and fit all again")
    p.add_argument("--json", action="store_true", help="print what came of it as JSON (fitmodels.batch-report/1)")
    engine = p.add_argument_group("on what")
    engine.add_argument("--jobs", type=processes, metavar="N", help="processes (default: one a core)")
    engine.add_argument(
        "--dask", metavar="ADDRESS", help="a Dask scheduler, host:port or its file, or: local (needs fitmodels[dask])"
    )
    what = p.add_argument_group("what is made")
    what.add_argument("--table-only", action="store_true", help="the tables, no files: a hundred times as fast")
    what.add_argument(
        "--keep-draws", action="store_true", help="the draws beside each parameter file (half a MB a law)"
    )
    what.add_argument("--no-site", action="store_true", help="no site of cards")
    what.add_argument("--card", metavar="FILE", help="a card.toml that holds for all pairs: licence, authors, machine")
    what.add_argument("--title", metavar="WORDS", help="title of the site")
    about = p.add_argument_group("what pairs belong to")
    about.add_argument(
        "--group", action="append", metavar="COLUMN", help="a column of the source that groups pairs: grade, coolant"
    )
    about.add_argument("--pairs", metavar="FILE", help="a table with tool, work and what they belong to: iso513, grade")
    reading_options(p)
    fitting = p.add_argument_group("fitting")
    fitting.add_argument(
        "--error", choices=["multiplicative", "additive"], default="multiplicative",
        help="where the scatter is: a share of the value (default), or the same everywhere",
    )  # fmt: skip
    fitting.add_argument(
        "--criterion", type=float, metavar="MM", help="wear at which an edge is worn out (default: 0.3)"
    )
    fitting.add_argument("--gauge-sd", type=float, metavar="MM", help="standard deviation of the wear gauge")
    draw_options(p)
    return p


def run(args: argparse.Namespace) -> int:
    """Do it, and return the exit code."""
    from .. import batch
    from ..batch.engine import cores, progress
    from ..batch.telling import batch_blocks, facts, source_block

    if args.table_only and (args.card or args.keep_draws):
        option = "--card" if args.card else "--keep-draws"
        raise UsageError(f"--table-only: no files are made, so {option} means nothing; leave one of the two out.")
    how, reading = _how(args), _reading(args)
    jobs = args.jobs or cores()
    title = {} if args.title is None else {"title": args.title}
    try:
        with progress(0, "pairs") as meter:
            made = batch.run(
                args.source, args.out, reading=reading, how=how, jobs=jobs, dask=args.dask, pairs=args.pairs,
                site=not args.no_site, card=args.card, force=args.force, meter=meter, **title,
            )  # fmt: skip
    except KeyboardInterrupt:
        raise KeyboardInterrupt(_interrupted(args.force)) from None
    if args.json:
        report = {"schema": "fitmodels.batch-report/1", **facts(made)}
        print(json.dumps(report, indent=2, ensure_ascii=False, allow_nan=False))  # noqa: T201
    else:
        out = Printer()
        out.show(source_block(made.plan))
        for block in batch_blocks(made):
            out.show(block)
    return _code(made, args)


def _interrupted(force: bool) -> str:
    onward = "the same command without --force" if force else "the same command"
    return f"interrupted; what is finished is kept, and {onward} goes on from there."


def _code(made: "Batch", args: argparse.Namespace) -> int:
    if made.unreadable:
        return 3
    if not made.with_law or (not args.table_only and "pairs/" not in made.written):
        return 4
    return 5 if args.card and made.site is not None and not made.site.ok else 0


def _how(args: argparse.Namespace) -> "How":
    from ..batch import How
    from ..fit.bayes.priors_file import read_priors

    checked(args)
    priors = args.priors or "weak"
    return How(
        files=not args.table_only,
        draws_kept=args.keep_draws,
        error=args.error,
        criterion=args.criterion,
        gauge_sd=args.gauge_sd,
        seed=1 if args.seed is None else args.seed,
        draws=4000 if args.draws is None else args.draws,
        priors=priors if priors in ("weak", "reference") else read_priors(priors),
        student=bool(args.student),
        command=_command(args),
    )


def _reading(args: argparse.Namespace) -> "Reading":
    from ..batch import Reading

    return Reading(**as_said(args), groups=tuple(dict.fromkeys(args.group or ())))


def _command(args: argparse.Namespace) -> str:
    """The command that makes these numbers again, without where it ran and where it was written."""
    words = ["fitmodels", "batch", Path(os.path.normpath(Path(args.source).absolute())).name]
    for name in OPTIONS_OF_A_BATCH:
        value = getattr(args, name)
        if value is None or value is False or (name == "error" and value == "multiplicative"):
            continue
        for item in value if isinstance(value, list) else [value]:
            told = Path(item).name if name in FILES else str(item)
            words += [f"--{name.replace('_', '-')}", *([] if item is True else [told])]
    return shlex.join(words)
