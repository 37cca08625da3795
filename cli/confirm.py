"""``fitmodels confirm``: whether new runs fall where the laws of earlier ones say."""

import argparse

from ..core.errors import FitError
from .arguments import Parser
from .output import Printer
from .reading import read, reading_options


def parser() -> Parser:
    """Arguments of ``fitmodels confirm``."""
    p = Parser(
        "fitmodels confirm",
        "fitmodels confirm new.csv --data data.csv",
        "Fit the laws of DATA, and tell whether the runs of NEW fall inside their prediction intervals.",
    )
    p.add_argument("file", metavar="NEW", help="table of new runs")
    p.add_argument("--data", metavar="DATA", required=True, help="table of the runs that the laws come from")
    p.add_argument("--level", type=float, default=0.95, help="level of the prediction intervals (default: 0.95)")
    reading_options(p)
    return p


def run(args: argparse.Namespace) -> int:
    """Print a verdict for each law, and return the exit code."""
    from rich.text import Text

    from .. import fit
    from ..core.errors import UsageError

    if not 0 < args.level < 1:
        raise UsageError(f"--level {args.level:g}: it lies between 0 and 1, for instance 0.95.")
    old, new = read(args.data, args), read(args.file, args)
    laws, refused = fit.default_laws(old)
    if not laws:
        raise FitError("; ".join(item.reason for item in refused) or f"{args.data} holds no law to confirm.")
    out = Printer()
    judged = 0
    for law in laws:
        try:
            out.show(Text(fit.confirm(law, new, args.level).verdict))
            judged += 1
        except (FitError, UsageError) as reason:
            out.show(Text(f"{law.response} is not judged: {reason}"))
    return 0 if judged else 4
