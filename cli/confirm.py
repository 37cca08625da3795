"""``fitmodels confirm``: new runs compared with the prediction intervals of the laws of earlier ones."""

import argparse

from .arguments import Parser
from .options import form_option, forms, law_option, read, reading_options
from .output import print_lines


def parser() -> Parser:
    """Arguments of ``fitmodels confirm``."""
    p = Parser(
        "fitmodels confirm",
        "fitmodels confirm new.csv --data data.csv",
        "Fit the laws of DATA, and test whether the runs of NEW are inside their prediction intervals.",
    )
    p.add_argument("file", metavar="NEW", help="table of new runs")
    p.add_argument("--data", metavar="DATA", required=True, help="table of the runs that the laws are fitted to")
    p.add_argument("--level", type=float, default=0.95, help="level of the prediction intervals (default: 0.95)")
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
    lines, tested = [], 0
    for law in laws:
        try:
            lines.append(fit.confirm(law, new, args.level).verdict)
            tested += 1
        except (FitError, UsageError) as reason:
            lines.append(f"{law.response} is not tested: {reason}")
    lines += [f"{item.response} is not tested: {item.reason}" for item in refused]
    print_lines(lines)
    return 0 if tested else 4
