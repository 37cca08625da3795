"""``fitmodels batch``: all tool/work pairs of a source, fitted on one machine or a cluster."""

import argparse
import sys
from importlib.util import find_spec
from typing import TYPE_CHECKING

from ..core.errors import UsageError
from ..core.progress import progress_bar
from ..core.threads import cores
from .arguments import Parser, processes, typed
from .options import fit_options, fitting_options, form_option, reading_options
from .output import Printer, output_options, print_json

if TYPE_CHECKING:
    from ..batch.result import Batch


def parser() -> Parser:
    """Arguments of ``fitmodels batch``."""
    p = Parser(
        "fitmodels batch",
        "fitmodels batch measurements/ --jobs 4 --pairs pairs.csv",
        "Fit all tool/work pairs of a folder of lab files, a Parquet data set or a CSV of any size: one table of\n"
        "results, a parameter file for each pair, a comparison of families of pairs, a site of cards, and a list of\n"
        "the pairs that need attention. Finished pairs are kept: after an interruption the same command continues.\n"
        "Exit codes: 3 where part of the source could not be read, 4 where no pair has a law; a pair that fails is a\n"
        "row with its reason.",
        main="--out --force --full --quiet --json --jobs --table-only --card --pairs --map --unit --criterion",
    )
    p.add_argument("source", metavar="SOURCE", help="folder of lab files, Parquet file or folder, or a text file")
    p.add_argument("--out", metavar="DIR", help="where to write (default: ./<source>-batch)")
    p.add_argument("--force", action="store_true", help="replace what an earlier batch wrote there, and fit all again")
    output_options(
        p, "print the report as JSON (fitmodels.batch-report/1)", "list all remarks, not the first of each kind"
    )
    engine = p.add_argument_group("processes")
    engine.add_argument("--jobs", type=processes, metavar="N", help="processes (default: one for each core)")
    engine.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="a Dask scheduler: host:port, its file, or local, with fitmodels[dask] (default: none)",
    )
    output = p.add_argument_group("output")
    output.add_argument("--table-only", action="store_true", help="tables only, no files: a hundred times as fast")
    output.add_argument("--keep-draws", action="store_true", help="write the draws too (half a MB for each law)")
    output.add_argument("--no-site", action="store_true", help="no site of cards")
    output.add_argument(
        "--card", metavar="FILE", help="a card.toml for all pairs: licence, authors, machine (default: none)"
    )
    output.add_argument(
        "--title", metavar="WORDS", help="title of the site (default: Model cards of tools and work materials)"
    )
    groups = p.add_argument_group("groups of pairs")
    groups.add_argument(
        "--group",
        action="append",
        metavar="COLUMN",
        help="a column of the source that groups pairs: grade, coolant (default: none)",
    )
    groups.add_argument(
        "--pairs", metavar="FILE", help="a table with tool, work and their groups: iso513, grade (default: none)"
    )
    reading_options(p)
    fitting_options(p)
    form_option(p)
    return p


def run(args: argparse.Namespace) -> int:
    """Fit the pairs, print the report, and return the exit code."""
    from .. import batch
    from ..batch.terminal import MOST_LISTED, batch_blocks, facts, source_block

    if args.table_only and (args.card or args.keep_draws):
        option = "--card" if args.card else "--keep-draws"
        raise UsageError(f"--table-only: no files are written, so {option} has no effect; leave one of the two out.")
    jobs = args.jobs or (cores() if find_spec("joblib") else 1)
    try:
        with progress_bar(0, "pairs", lines=not args.quiet) as meter:
            result = batch.run(
                args.source, args.out, options=fit_options(args), groups=args.group or (), pairs=args.pairs,
                files=not args.table_only, keep_draws=args.keep_draws, site=not args.no_site, card=args.card,
                jobs=jobs, dask=args.dask, force=args.force, command=typed(args.words),
                title=args.title, meter=meter,
            )  # fmt: skip
    except KeyboardInterrupt:
        again = "the same command without --force" if args.force else "the same command"
        raise KeyboardInterrupt(f"interrupted; finished pairs are kept, and {again} continues from there.") from None
    if args.json:
        print_json("batch-report", facts(result))
    else:
        out = Printer(quiet=args.quiet)
        most = sys.maxsize if args.full else MOST_LISTED
        out.show(source_block(result.plan, most))
        for block in batch_blocks(result, most):
            out.show(block)
        if jobs < cores() and not args.jobs:
            out.show(f"Without joblib one process fits all pairs: pip install 'fitmodels[batch]' for {cores()}.")
        if args.quiet:
            out.wrote("", result.out)
    return _code(result, args)


def _code(result: "Batch", args: argparse.Namespace) -> int:
    if result.unreadable:
        return 3
    if not result.with_law or (not args.table_only and "pairs/" not in result.written):
        return 4
    return 5 if args.card and result.site is not None and not result.site.ok else 0
