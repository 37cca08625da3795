"""``fitmodels next``: further tests for the design of a file, as CSV with a run order."""

import argparse

from .arguments import Parser
from .options import read, reading_options
from .plan import target


def parser() -> Parser:
    """Arguments of ``fitmodels next``."""
    p = Parser(
        "fitmodels next",
        "fitmodels next data.csv --runs 4 --out next.csv",
        "Plan further tests: repeats where no setting was repeated, else the settings that are most informative for\n"
        "the law (D-optimal). Without --out the plan is printed.",
    )
    p.add_argument("file", metavar="FILE", help="table of the tests so far")
    p.add_argument("--runs", type=int, default=4, help="number of edges to add (default: 4)")
    p.add_argument("--law", metavar="AW", help="response of the law to improve (default: the wear law)")
    p.add_argument("--seed", type=int, default=1, help="seed of the run order (default: 1)")
    p.add_argument("--out", metavar="PLAN", help="file to write")
    p.add_argument("--force", action="store_true", help="replace an existing file")
    reading_options(p)
    return p


def run(args: argparse.Namespace) -> int:
    """Write the plan, and return the exit code."""
    from .. import fit
    from ..core.errors import FitError, UsageError
    from ..datasets import write_csv

    laws, refused = fit.default_laws(read(args.file, args))
    chosen = [law for law in laws if args.law in (None, law.response)]
    if not chosen:
        known = ", ".join(law.response for law in laws)
        if known:
            raise UsageError(f"--law {args.law}: there are laws of {known}.")
        raise FitError("; ".join(item.reason for item in refused) or f"{args.file} contains no law to add runs to.")
    plan = fit.next_runs(chosen[0], args.runs, seed=args.seed)
    notes = [f"plan: {plan.attrs['words']}", f"for the law of {chosen[0].response}; cut in the order of run"]
    write_csv(plan, target(args.out, args.force), notes)
    return 0
