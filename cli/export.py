"""``fitmodels export``: a parameter file as what a controller loads."""

import argparse
from pathlib import Path

from ..core.errors import UsageError
from .arguments import Parser
from .output import Printer


def parser() -> Parser:
    """Arguments of ``fitmodels export``."""
    from ..parameters.exports import FORMATS

    p = Parser(
        "fitmodels export",
        "fitmodels export params.json --to hal",
        "Write what a controller loads. Gains that fail `fitmodels check` are refused.\n\n"
        + "\n".join(f"  {kind:<4} {of.words}" for kind, of in FORMATS.items()),
    )
    p.add_argument("file", metavar="PARAMS", help="params.json")
    p.add_argument("--to", metavar="KIND", required=True, help=f"{', '.join(FORMATS)}")
    p.add_argument("--out", metavar="FILE", help="where to write (default: ./<PARAMS> with the ending of the kind)")
    p.add_argument("--force", action="store_true", help="replace a file that is there")
    return p


def run(args: argparse.Namespace) -> int:
    """Write the file, say what was assumed and what it cannot carry, and return the exit code."""
    from rich.text import Text

    from .. import parameters
    from ..parameters.exports import export, export_format
    from ..parameters.exports.loop import loop_settings

    kind = export_format(args.to)
    out = Path(args.out or Path(args.file).stem + kind.suffix)
    if out.is_dir():
        raise UsageError(f"--out {out}: is a folder; give the name of the file.")
    pf = parameters.read(args.file)
    written = export(pf, args.to, out, force=args.force)
    lines = [f"wrote {written}"]
    lines += [f"  assumed: {words}" for words in loop_settings(pf).assumed]
    lines += [f"  not carried: {words}" for words in kind.not_carried]
    Printer().show(Text("\n".join(lines)))
    return 0
