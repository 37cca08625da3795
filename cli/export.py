"""``fitmodels export``: a parameter file in the format of a controller."""

import argparse
from pathlib import Path

from ..core.errors import UsageError
from .arguments import Parser
from .output import Printer, output_options, print_json


def parser() -> Parser:
    """Arguments of ``fitmodels export``."""
    from ..controllers.exports import FORMATS, SYSTEMS

    p = Parser(
        "fitmodels export",
        "fitmodels export params.json --to hal",
        "Write a file that a controller loads. Gains that fail `fitmodels check` are refused, and so are laws,\n"
        "dynamics and force processes whose verdict is 'do not use for control', or that have none.\n\n"
        + "\n".join(f"  {kind:<4} {of.words}" for kind, of in FORMATS.items()),
    )
    p.add_argument("file", metavar="PARAMS", help="params.json")
    p.add_argument("--to", metavar="KIND", required=True, help=f"{', '.join(FORMATS)}")
    p.add_argument(
        "--system",
        metavar="NAME",
        help=f"what is controlled: {', '.join(SYSTEMS)} (default: constant-load if the file has gains, else the only "
        "one that it supports)",
    )
    p.add_argument("--out", metavar="FILE", help="where to write (default: ./<PARAMS> with the suffix of the kind)")
    accept = "export parts that must not be used for control all the same; the exported file names them and the reasons"
    p.add_argument("--accept-verdict", action="store_true", help=accept)
    p.add_argument("--force", action="store_true", help="replace an existing file")
    output_options(p, "print the path and the notes as JSON (fitmodels.export/1)")
    return p


def run(args: argparse.Namespace) -> int:
    """Write the file, print what was assumed and what it cannot contain, and return the exit code."""
    from .. import parameters
    from ..controllers.exports import SYSTEMS, ControlFormat, ExportJob, export_format, exported, system_of
    from ..parameters.exports import write_export

    export_format(args.to)
    pf = parameters.read(args.file)
    system = system_of(pf, args.to, args.system)
    kind = export_format(args.to, system or None)
    name = kind.file_name if isinstance(kind, ControlFormat) else ""
    path = Path(args.out or name or Path(args.file).stem + kind.suffix)
    if path.is_dir():
        raise UsageError(f"--out {path}: is a folder; give the name of the file.")
    uses = bool(system) and SYSTEMS[system].draws
    draws = parameters.read_draws(pf, Path(args.file).parent) if uses else {}
    made = exported(pf, args.to, system=args.system, job=ExportJob(args.accept_verdict, draws))
    written = write_export(made.content, path, force=args.force)
    if args.json:
        print_json("export", {"file": str(written), "to": args.to, "system": made.system or None, "notes": made.notes})
        return 0
    out = Printer(quiet=args.quiet)
    out.wrote(f"wrote {written}", written)
    for words in made.notes:
        out.show(f"  {words}")
    return 0
