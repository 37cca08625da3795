"""``fitmodels export``: a parameter file in the format of a controller."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import UsageError
from ..core.files import refuse_input
from .arguments import Parser, inputs_of, parameter_file
from .numbers import measured
from .options import plan_asked, plan_options, plan_options_of
from .output import Printer, output_options, print_json

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..controllers.exports.plan_table import ExportJob
    from ..controllers.exports.turning_job import Stretch, TurningJob
    from ..controllers.exports.turning_program import TurningRequest
    from ..parameters import ParameterFile
    from ..parameters.draws import Draws

PLANS = ("nc", "csv")
RUNNING = ("--diameter", "--max-rpm")  # of the part, which a running control takes too
PLANNED = ("recursion", "region")  # systems with the settings of `plan_options`


def parser() -> Parser:
    """Arguments of ``fitmodels export``."""
    from ..controllers.exports import FORMATS, SYSTEMS

    p = Parser(
        "fitmodels export",
        "fitmodels export params.json --to hal",
        "Write a file that a controller loads. Gains that fail `fitmodels check` are refused, and so are laws,\n"
        "dynamics and force processes whose verdict is 'do not use for control', or that have none.\n"
        "An NC program needs --diameter, --length and --max-rpm, explained by --help-all.\n\n"
        + "\n".join(f"  {kind:<4} {of.words}" for kind, of in FORMATS.items()),
        main="--to --system --out --accept-verdict --force --quiet --json",
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
    accept = (
        "export parts that must not be used for control, or a plan that does not apply a limit, all the same; the "
        "exported file names them and the reasons"
    )
    p.add_argument("--accept-verdict", action="store_true", help=accept)
    p.add_argument(
        "--beyond-tests", metavar="REASON", default="",
        help="accept a plan 1.5 times or more beyond the tested depths, speeds, feeds or wear, or 3 times the longest "
        "test, for this reason, which is written into the file (default: refused)",
    )  # fmt: skip
    p.add_argument("--force", action="store_true", help="replace an existing file")
    output_options(p, "print the path and the notes as JSON (fitmodels.export/1)")
    plan_options(p)
    part_options(p)
    return p


def part_options(parser: Parser) -> None:
    """Add the part, the machine and the control of an NC program, and the machine of a running plan."""
    group = parser.add_argument_group("part and control, of nc and csv")
    group.add_argument(
        "--diameter", metavar="80mm",
        help="of the work before the first pass; of a running plan too, 60mm, or 40mm:80mm where it is measured "
        "(default: none)",
    )  # fmt: skip
    group.add_argument("--length", metavar="200mm", help="of each pass (default: none)")
    group.add_argument("--passes", type=int, metavar="N", help="passes of a part, each one depth deeper (default: 1)")
    group.add_argument(
        "--pass", action="append", dest="pass_", metavar="80:200:2.5",
        help="a pass: diameter before the cut, length, and depth where it is another; parts of a pass with commas, "
        "80:120,78:80:1.5 (instead of --diameter and --length; default: none)",
    )  # fmt: skip
    group.add_argument("--parts", type=int, metavar="N", help="number of parts (default: as many as the edge cuts)")
    group.add_argument(
        "--max-rpm",
        metavar="2500",
        help="highest spindle speed, of a running plan too (default: the limit of n in the file)",
    )
    group.add_argument(
        "--from", dest="from_", metavar="4min", help="time that the edge has cut by this plan (default: 0)"
    )
    group.add_argument(
        "--speed", choices=["G96", "G97"], help="constant surface speed, or spindle speed (default: G96)"
    )
    group.add_argument("--feed-mode", choices=["G95", "G94"], help="feed per revolution or per minute (default: G95)")
    group.add_argument("--dialect", choices=["linuxcnc", "fanuc"], help="control; fanuc: system A (default: linuxcnc)")
    units = group.add_mutually_exclusive_group()
    units.add_argument("--inch", action="store_true", help="lengths and words in inches and ft/min (default: mm)")
    units.add_argument("--mm", action="store_true", help="lengths and words in mm and m/min (default)")
    group.add_argument("--period", metavar="20ms", help="of the calls of a running plan or region (default: 20 ms)")
    group.add_argument("--tool", type=int, metavar="N", help="tool that is called (default: none is called)")
    group.add_argument(
        "--retract",
        metavar="200:150",
        help="diameter and Z of the tool while parts and edges are changed (default: 2 mm off the work)",
    )


PART = {
    "diameter": "--diameter", "length": "--length", "passes": "--passes", "pass_": "--pass", "parts": "--parts",
    "max_rpm": "--max-rpm", "from_": "--from", "speed": "--speed", "feed_mode": "--feed-mode", "dialect": "--dialect",
    "tool": "--tool", "retract": "--retract",
}  # fmt: skip


def turning_request(args: argparse.Namespace, pf: "ParameterFile") -> "TurningRequest":
    """Plan and part of the command line.

    Raises
    ------
    UsageError
        An option without those that it needs, or one that is no length, speed or time.
    """
    from ..controllers.exports.turning_program import TurningRequest

    options = plan_options_of(args, pf)
    given = [option for name, option in PART.items() if getattr(args, name) is not None]
    if not given:
        return TurningRequest(options, inch=args.inch, beyond_tests=args.beyond_tests.strip())
    job = _job(args, given, options.depth or _depth(pf))
    return TurningRequest(options, job, beyond_tests=args.beyond_tests.strip())


def _job_of(args: argparse.Namespace, pf: "ParameterFile", system: str, draws: "Mapping[str, Draws]") -> "ExportJob":
    """Choices of the export; an option that the format does not use is refused."""
    from ..controllers.exports.plan_table import ExportJob
    from ..controllers.exports.turning_program import TurningRequest

    program, running = args.to in PLANS, system in PLANNED and args.to not in PLANS
    given = [option for name, option in PART.items() if getattr(args, name) is not None]
    given += ["--inch"] * args.inch + ["--mm"] * args.mm
    own = RUNNING if running else ()
    if (others := [option for option in given if option not in own]) and not program:
        raise _misplaced(others[0], args.to, system)
    if args.beyond_tests and not program and system != "recursion":
        raise UsageError(f"--beyond-tests belongs to a plan; leave it out of {args.to}.")
    if args.period and not running:
        raise UsageError(f"--period belongs to a running plan or region; leave it out of {args.to}.")
    asked = [name for name in plan_asked(args) if system != "region" or name not in ("--by", "--at")]
    if asked == ["--depth"] and system == "adaptive-force" and pf.adaptive_force is not None:
        unit = pf.adaptive_force.unit_depth
        return ExportJob(args.accept_verdict, draws, depth=measured(args.depth, unit, "--depth", f"2{unit}"))
    if asked and system not in PLANNED:
        raise UsageError(f"{asked[0]} belongs to a plan or a region; leave it out of {args.to}.")
    if asked and system == "region":
        raise UsageError(f"{asked[0]}: the running region reads depth and time from the machine; leave it out.")
    if not running:
        return ExportJob(args.accept_verdict, draws, turning=turning_request(args, pf))
    ends = [_length(text, "mm", "--diameter", "40mm:80mm") for text in (args.diameter or "").split(":") if text]
    if len(ends) > 2:
        raise UsageError(f"--diameter {args.diameter}: give one, 60mm, or the smallest and the largest, 40mm:80mm.")
    return ExportJob(
        args.accept_verdict, draws,
        turning=TurningRequest(plan_options_of(args, pf), beyond_tests=args.beyond_tests.strip()),
        diameter=(ends[0], ends[-1]) if ends else None,
        max_rpm=0.0 if args.max_rpm is None else measured(args.max_rpm, "1/min", "--max-rpm", "2500"),
        sample_time=0.0 if args.period is None else measured(args.period, "s", "--period", "20ms"),
    )  # fmt: skip


def _misplaced(option: str, kind: str, system: str) -> UsageError:
    """The error of an option of a part that this export does not take."""
    if option not in RUNNING or kind not in ("st", "c", "comp", "fmu"):
        return UsageError(f"{option} belongs to --to nc and --to csv; leave it out of {kind}.")
    systems = " and ".join(f"--system {name}" for name in PLANNED)
    return UsageError(
        f"{option} belongs to --to nc, --to csv, {systems}, and {system} is exported: name one of them, or leave "
        f"{option} out."
    )


def _depth(pf: "ParameterFile") -> float:
    from ..controllers.recursion.from_file import depth

    return depth(pf)


def _job(args: argparse.Namespace, given: list[str], depth: float) -> "TurningJob":
    from ..controllers.exports.turning_job import TurningJob

    if args.pass_ and (args.diameter or args.length or args.passes):
        raise UsageError("--pass gives diameters and lengths itself: leave --diameter, --length and --passes out.")
    if not args.pass_ and not (args.diameter and args.length):
        raise UsageError(f"{given[0]} belongs to a part: give --diameter 80mm --length 200mm too, or --pass 80:200.")
    return TurningJob(
        passes=_passes(args, depth),
        max_rpm=0.0 if args.max_rpm is None else measured(args.max_rpm, "1/min", "--max-rpm", "2500"),
        parts=args.parts,
        start=0.0 if args.from_ in (None, "0") else measured(args.from_, "min", "--from", "4min"),
        speed=args.speed or "G96", feed=args.feed_mode or "G95", dialect=args.dialect or "linuxcnc",
        inch=args.inch, tool=args.tool, retract=_retract(args.retract, "in" if args.inch else "mm"),
    )  # fmt: skip


def _retract(text: str | None, unit: str) -> tuple[float, float] | None:
    """Diameter and Z, mm."""
    if text is None:
        return None
    if text.count(":") != 1:
        raise UsageError(f"--retract {text}: give diameter and Z, such as 200:150.")
    X, Z = (_length(part, unit, f"--retract {text}", "200:150") for part in text.split(":"))
    return X, Z


def _passes(args: argparse.Namespace, depth: float) -> "tuple[tuple[Stretch, ...], ...]":
    """The passes: as written, or each from the diameter that the last one left."""
    from ..controllers.exports.turning_job import Stretch

    unit = "in" if args.inch else "mm"
    if args.pass_:
        return tuple(tuple(_stretch(part, text, unit) for part in text.split(",")) for text in args.pass_)
    count = 1 if args.passes is None else args.passes
    if not 1 <= count <= 1000:
        raise UsageError(f"--passes {count}: give 1 to 1000.")
    diameter, length = (_mm(args, name, unit) for name in ("diameter", "length"))
    return tuple((Stretch(diameter - 2 * depth * k, length),) for k in range(count))


def _mm(args: argparse.Namespace, name: str, unit: str) -> float:
    text = getattr(args, name)
    return _length(text, unit, f"--{name}", f"80{unit}")


def _length(text: str, unit: str, option: str, example: str) -> float:
    """mm; a number without a unit is in the unit of the program."""
    with_unit = f"{text}{unit}" if text.strip().replace(".", "", 1).isdigit() else text
    return measured(with_unit, "mm", option, example)


def _stretch(part: str, text: str, unit: str) -> "Stretch":
    from ..controllers.exports.turning_job import Stretch

    numbers = part.split(":")
    if not 2 <= len(numbers) <= 3:
        raise UsageError(f"--pass {text}: give diameter:length, or diameter:length:depth, such as 80:200:2.5.")
    diameter, length, *depth = (_length(number, unit, f"--pass {text}", "80:200:2.5") for number in numbers)
    return Stretch(diameter, length, depth[0] if depth else None)


def run(args: argparse.Namespace) -> int:
    """Write the file, print what was assumed and what it cannot contain, and return the exit code."""
    from .. import parameters
    from ..controllers.exports import SYSTEMS, ControlFormat, export_format, exported, system_of
    from ..parameters.exports import write_export

    export_format(args.to)
    pf = parameter_file(args.file, writes=True)
    system = system_of(pf, args.to, args.system)
    kind = export_format(args.to, system or None)
    name = kind.file_name if isinstance(kind, ControlFormat) else ""
    path = Path(args.out or name or Path(args.file).stem + kind.suffix)
    if path.is_dir():
        raise UsageError(f"--out {path}: is a folder; give the name of the file.")
    refuse_input(path, *inputs_of(args.file, pf))
    uses = bool(system) and SYSTEMS[system].draws
    draws = parameters.read_draws(pf, Path(args.file).parent) if uses else {}
    made = exported(pf, args.to, system=args.system, job=_job_of(args, pf, system, draws))
    written = write_export(made.content, path, force=args.force)
    if args.json:
        print_json("export", {"file": str(written), "to": args.to, "system": made.system or None, "notes": made.notes})
        return 0
    out = Printer(quiet=args.quiet)
    out.wrote(f"wrote {written}", written)
    for words in made.notes:
        out.show(f"  {words}")
    return 0
