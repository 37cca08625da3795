"""``fitmodels export``: a parameter file in the format of a controller."""

import argparse
from pathlib import Path

from ..core.errors import UsageError
from .arguments import Parser
from .output import Printer, output_options, print_json

SIMULATED = ("simulation", "draws", "fault")  # findings that state how the control was tried


def parser() -> Parser:
    """Arguments of ``fitmodels export``."""
    from ..controllers.exports import FORMATS

    p = Parser(
        "fitmodels export",
        "fitmodels export params.json --to hal",
        "Write a file that a controller loads. Gains that fail `fitmodels check` are refused, and so are laws,\n"
        "dynamics and force processes whose verdict is 'do not use for control', or that have none.\n\n"
        + "\n".join(f"  {kind:<4} {of.words}" for kind, of in FORMATS.items()),
    )
    p.add_argument("file", metavar="PARAMS", help="params.json")
    p.add_argument("--to", metavar="KIND", required=True, help=f"{', '.join(FORMATS)}")
    p.add_argument("--out", metavar="FILE", help="where to write (default: ./<PARAMS> with the suffix of the kind)")
    accept = "export parts that must not be used for control all the same; the exported file names them and the reasons"
    p.add_argument("--accept-verdict", action="store_true", help=accept)
    p.add_argument("--force", action="store_true", help="replace an existing file")
    output_options(p, "print the path and the notes as JSON (fitmodels.export/1)")
    return p


def run(args: argparse.Namespace) -> int:
    """Write the file, print what was assumed and what it cannot contain, and return the exit code."""
    from .. import parameters
    from ..controllers.exports import ControlFormat, export, export_format
    from ..controllers.gate import check_control
    from ..parameters.checks.report import require_verdicts
    from ..parameters.exports.view import export_view

    kind = export_format(args.to)
    loop_only = isinstance(kind, ControlFormat)
    name = kind.file_name if isinstance(kind, ControlFormat) else ""
    path = Path(args.out or name or Path(args.file).stem + kind.suffix)
    if path.is_dir():
        raise UsageError(f"--out {path}: is a folder; give the name of the file.")
    pf = parameters.read(args.file)
    written = export(pf, args.to, path, force=args.force, accept_verdict=args.accept_verdict)
    view = export_view(pf, accept_verdict=args.accept_verdict, loop_only=loop_only)
    control = check_control(pf).findings
    notes = [
        *require_verdicts(pf, args.accept_verdict, loop_only=loop_only),
        *(f"VERDICT ACCEPTED - {f.words}" for f in control if f.passed is False),
        *(f"{f.name}: {f.words}" for f in control if f.passed and f.name in SIMULATED),
        *(f"not known: {f.words}" for f in control if f.passed is None),
        *(f"assumed: {words}" for words in view.assumed),
        *(f"not included: {words}" for words in kind.not_carried),
    ]
    if args.json:
        print_json("export", {"file": str(written), "to": args.to, "notes": notes})
        return 0
    out = Printer(quiet=args.quiet)
    out.wrote(f"wrote {written}", written)
    for words in notes:
        out.show(f"  {words}")
    return 0
