"""``fitmodels confirm``: new runs compared with the prediction intervals of the laws of earlier ones."""

import argparse

from .arguments import Parser
from .options import form_option, forms, law_option, read, reading_options
from .output import complain, output_options, print_json, print_lines


def parser() -> Parser:
    """Arguments of ``fitmodels confirm``."""
    p = Parser(
        "fitmodels confirm",
        "fitmodels confirm new.csv --data data.csv",
        "Fit the laws of DATA, and test whether the runs of NEW are inside their prediction intervals.",
        main="--level --quiet --json --law --form --map --unit",
    )
    p.add_argument("file", metavar="NEW", help="table of new runs")
    p.add_argument("--data", metavar="DATA", required=True, help="table of the runs that the laws are fitted to")
    p.add_argument(
        "--level", type=float, default=0.95, metavar="LEVEL", help="level of the prediction intervals (default: 0.95)"
    )
    output_options(p, "print the verdicts as JSON (fitmodels.confirm/1)")
    group = p.add_argument_group("laws of DATA, as the main command fits them")
    law_option(group)
    form_option(group)
    reading_options(p)
    return p


def run(args: argparse.Namespace) -> int:
    """Print a verdict for each law, and return the exit code."""
    from .. import fit
    from ..core.errors import FitError, UsageError
    from ..pipeline import FitOptions

    if not 0 < args.level < 1:
        raise UsageError(f"--level {args.level:g}: give a number between 0 and 1, for instance 0.95.")
    old, new = read(args.data, args), read(args.file, args)
    asked = FitOptions(laws=tuple(args.laws or ()), form=forms(args.form))
    laws, refused = fit.default_laws(old, laws=asked.laws, forms=asked.forms)
    if not laws:
        raise FitError("; ".join(item.reason for item in refused) or f"{args.data} contains no law to confirm.")
    verdicts: dict[str, str] = {}
    untested = {item.response: item.reason for item in refused}
    for law in laws:
        try:
            verdicts[law.response] = fit.confirm(law, new, args.level).verdict
        except (FitError, UsageError) as reason:
            untested[law.response] = str(reason)
    if args.json:
        print_json("confirm", {"level": args.level, "verdicts": verdicts, "not_tested": untested})
    else:
        print_lines(verdicts.values(), quiet=args.quiet)
        print_lines((f"{name} is not tested: {why}" for name, why in untested.items()), quiet=args.quiet)
    if not verdicts and args.quiet:
        complain("; ".join(f"{name} is not tested: {why}" for name, why in untested.items()))
    return 0 if verdicts else 4
