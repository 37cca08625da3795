"""``fitmodels adaptive-force``: settings of adaptive force control, derived from estimates in a parameter file."""

import argparse
import math
import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ..core.errors import UsageError
from ..core.verdict import DO_NOT_USE
from .arguments import Parser, failing, parameter_file, traced
from .numbers import NUMBER, pairs
from .output import Printer, complain, output_options, print_json
from .physical import FORCE, fitted, spindle_speed, teeth, with_teeth

if TYPE_CHECKING:
    from rich.table import Table

    from ..controllers.adaptive_force.derivation import ForceChoices, ForceDesign
    from ..core.verdict import Verdict
    from ..parameters import ParameterFile
    from ..parameters.sections.force_control import AdaptiveForceSection

WITH_UNIT = re.compile(rf"({NUMBER})\s*([^\d\s.,+-].*)?")
RANGE = re.compile(rf"({NUMBER}):({NUMBER})\s*([^\d\s.,+-].*)?")
OF_RECORD: Final = ("input", "output", "unit", "depth")
FEED, FEED_RATE = "mm/rev", "mm/min"
UNITS: Final = {  # of the printed values; u: of the command, F: of the force, D: of the depth
    "m": "s^2 {u}/{F}", "alpha": "s {u}/{F}", "beta": "{u}/{F}", "depth": "{D}", "spindle_speed": "1/min",
    "average_time": "s", "sample_time": "s", "low": "{u}", "high": "{u}", "force_low": "{F}", "force_high": "{F}",
    "reference_time": "s", "reference_damping": "", "lam": "1/s", "Kd": "s {u}/{F}", "g3": "{u}/({F}^3)",
    "g2": "s^2 {u}/({F}^3)", "g1": "s^4 {u}/({F}^3)",
}  # fmt: skip


def parser() -> Parser:
    """Arguments of ``fitmodels adaptive-force``."""
    p = Parser(
        "fitmodels adaptive-force",
        "fitmodels adaptive-force params.json 1mm=150N 2mm=200N 4mm=320N --feed 60:500mm/min",
        "Set up milling at a constant force from the estimates of `fitmodels ident --as force-process` in a file:\n"
        "the force for each depth of cut is given, Kd, lambda and the rates follow from a design rule with its\n"
        "stability margins, the averaging time from the spindle speed. Each value is printed with its source.",
        main="--spindle --teeth --feed --readings --record --depth --delay --units --beyond-tested --accept-verdict "
        "--force --quiet --json",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json with estimates of adaptive force")
    p.add_argument(
        "points", nargs="*", metavar="DEPTH=FORCE", help="set points, as 2mm=200N (default: those of the file)"
    )
    p.add_argument("--spindle", type=spindle_speed, metavar="RPM", help="spindle speed (default: that of the record)")
    p.add_argument("--teeth", type=teeth, metavar="N", help="number of teeth of the cutter (default: of the file)")
    p.add_argument("--feed", metavar="LOW:HIGH[UNIT]", help="limits of the command (default: the tested range)")
    p.add_argument(
        "--readings", metavar="LOW:HIGH[UNIT]", help="valid forces (default: -0.1 to 4 times the largest set point)"
    )
    p.add_argument("--record", metavar="RUN", help="record to estimate from first (default: estimates of the file)")
    p.add_argument("--depth", type=float, metavar="MM", help="with --record: its depth of cut (default: not known)")
    p.add_argument("--input", metavar="COLUMN", help="with --record: column of the command (default: by its name)")
    p.add_argument("--output", metavar="COLUMN", help="with --record: column of the force (default: by its name)")
    p.add_argument(
        "--unit", action="append", metavar="time=ms", help="with --record: unit of a column (default: its header)"
    )
    p.add_argument("--sample-time", type=_seconds, metavar="S", help="step of the law (default: 0.001)")
    p.add_argument("--delay", type=_seconds, metavar="S", help="from reading to feed (default: one step)")
    p.add_argument("--reference-time", type=_seconds, metavar="S", help="of the reference model (default: by the rule)")
    p.add_argument("--kd", type=_above_zero, metavar="KD", help="the gain Kd (default: by the rule)")
    p.add_argument(
        "--lam", type=_above_zero, metavar="PER_S", help="lambda in place of that of the rule (default: by the rule)"
    )
    p.add_argument("--g3", type=_above_zero, metavar="G3", help="rate of beta; g1 and g2 follow (default: by the rule)")
    p.add_argument("--units", metavar="FEED,FORCE", help="units of the section, as mm/rev,kN (default: of the record)")
    far = "allow a feed or a force of more than 1.5 times what was tested; the file and the output state it"
    p.add_argument("--beyond-tested", action="store_true", help=far)
    bad = "write settings that `fitmodels check` fails, and estimates of --record that must not be used for control"
    p.add_argument("--accept-verdict", action="store_true", help=bad)
    p.add_argument("--force", action="store_true", help="replace settings in the file")
    output_options(p, "print the section and its margins as JSON (fitmodels.adaptive-force/1)")
    p.parse_args = partial(_parsed, p)  # type: ignore[assignment,method-assign]
    return p


def _parsed(parser: Parser, words: Sequence[str] | None = None) -> argparse.Namespace:
    """The arguments, with set points after options too."""
    args, left = parser.parse_known_args(words)
    if strange := [word for word in left if word.startswith("-") or "=" not in word]:
        parser.error(f"unrecognized arguments: {' '.join(strange)}")
    args.points += left
    return args


def _above_zero(text: str) -> float:
    """A number above zero.

    >>> _above_zero("0.05")
    0.05
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: give a number above zero with a decimal point")
    return value


def _seconds(text: str) -> float:
    """A time in s, with or without its unit.

    >>> _seconds("0.02"), _seconds("20ms")
    (0.02, 0.02)
    """
    found = WITH_UNIT.fullmatch(text.strip())
    factors = {None: 1.0, "s": 1.0, "ms": 1e-3}
    if found is None or found[2] not in factors or not 0 < float(found[1]) < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: give a time above zero in s or ms, as 0.002 or 2ms")
    return float(f"{float(found[1]) * factors[found[2]]:.12g}")


def run(args: argparse.Namespace) -> int:
    """Derive, print and write the settings, and return the exit code."""
    from .. import parameters
    from ..controllers.adaptive_force.derivation import design
    from ..controllers.adaptive_force.settings import limit_words
    from ..controllers.gate.adaptive_force import check_adaptive_force
    from ..parameters.checks.report import cautions
    from ..parameters.file import sealed

    pf = parameter_file(args.file, writes=True)
    if pf.adaptive_force is not None and pf.adaptive_force.Kd is not None and not args.force:
        raise UsageError(f"{args.file} has settings of adaptive force; replace them with --force.")
    section = _in_units(_estimates(pf, args), args)
    found = design(section, _choices(pf, section, args))
    section = _with(section, found)
    identity = with_teeth(pf.identity, args.teeth)
    changed = sealed(pf, identity=identity, adaptive_force=section, provenance=traced(pf, args.words))
    _check(changed, args.file)
    unsafe = failing(check_adaptive_force(changed), args.file, accepted=args.accept_verdict)
    parameters.write(changed, args.file, replaces=pf)
    verdicts = [*unsafe, *cautions(changed, "adaptive_force")]
    if args.json:
        facts = {"file": Path(args.file).name, "adaptive_force": section.model_dump(), **_facts(found)}
        print_json("adaptive-force", {**facts, "verdicts": verdicts})
        return 0
    out = Printer(quiet=args.quiet)
    for line in verdicts if args.quiet and args.record else ():  # of estimates that are new
        complain(line)
    for line in (*verdicts, _plant(changed, section)):
        out.show(line)
    out.show(_values(section))
    for line in (*_at_points(section, found), *_margins(section, found), *limit_words(changed)):
        out.show(line)
    out.wrote(f"Written: adaptive_force in {args.file}", args.file)
    return 0


def _estimates(pf: "ParameterFile", args: argparse.Namespace) -> "AdaptiveForceSection":
    """The section with estimates: that of the file, or with those of ``--record``."""
    from ..datasets import read_record
    from ..parameters.sections.force_control import AdaptiveForceSection

    if args.record is None:
        for name in OF_RECORD:
            if getattr(args, name) is not None:
                raise UsageError(f"--{name} has an effect only with --record; leave it out.")
        if pf.adaptive_force is None:
            raise UsageError(
                f"{args.file} has no estimates of drive and cut; record feed and force of a cut, and add them with "
                "'fitmodels ident RUN --as force-process --depth MM --spindle RPM --params FILE', or give --record RUN."
            )
        return pf.adaptive_force
    if args.depth is None:
        raise UsageError("--record: give the depth of cut of the run, with --depth; the force is proportional to it.")
    rec = read_record(
        args.record, input=args.input, output=args.output, units=pairs(args.unit, "--unit", "time=ms")
    )  # fmt: skip
    known = {"depth": args.depth, "spindle": args.spindle, "teeth": args.teeth}
    given = argparse.Namespace(model=FORCE, given=None, drive_pole=None, **known)
    found = fitted([rec], None, given, pf)
    if found.verdict.level == DO_NOT_USE and not args.accept_verdict:
        _keep_better(pf, found.verdict, args)
    return AdaptiveForceSection.model_validate(found.section)


def _keep_better(pf: "ParameterFile", verdict: "Verdict", args: argparse.Namespace) -> None:
    """Refuse to replace estimates of the file, unless these must not be used for control either."""
    held = pf.adaptive_force
    if held is None or (held.verdict is not None and held.verdict.concern == DO_NOT_USE):
        return
    of_file = "no verdict" if held.verdict is None else held.verdict.level
    raise UsageError(
        f"--record {args.record}: the verdict on its estimates is '{verdict.words}', that on those of {args.file} is "
        f"'{of_file}', and nothing was replaced. {' '.join(verdict.reasons)} Check the columns and their units, or "
        "record the cut again; leave --record out, or replace them all the same with --accept-verdict."
    )


def _in_units(section: "AdaptiveForceSection", args: argparse.Namespace) -> "AdaptiveForceSection":
    """The section in the units of ``--units``."""
    from ..controllers.adaptive_force.derivation import converted

    if args.units is None:
        return section
    feed, comma, force = (part.strip() for part in args.units.partition(","))
    if not (feed and comma and force):
        raise UsageError(f"--units {args.units}: give the units of feed and force, as mm/rev,kN.")
    turning = args.spindle or section.spindle_speed
    of_command, of_force = factor(section.unit_u, feed, turning), factor(section.unit_force, force)
    return converted(section, feed, force, of_command, of_force)


def factor(unit: str, to: str, turning: float | None = None) -> float:
    """One unit in another; feed and feed rate convert into each other by the spindle speed, 1/min.

    Raises
    ------
    UsageError
        Units of different quantities, or no spindle speed.

    Examples
    --------
    >>> factor("kN", "N"), factor("mm/rev", "mm/min", 3000.0)
    (1000.0, 3000.0)
    """
    import numpy as np

    from ..datasets.units import convert, is_unit, same_dimension

    if unit == to:
        return 1.0
    if not (is_unit(unit) and is_unit(to)):
        raise UsageError(f"{unit!r} does not convert into {to!r}: give the value in {to or 'the unit of the file'}.")
    if same_dimension(unit, to):
        return float(convert(np.array([1.0]), unit, to)[0])
    for start, end, power in ((FEED, FEED_RATE, 1), (FEED_RATE, FEED, -1)):
        if same_dimension(unit, start) and same_dimension(to, end):
            if turning is None:
                raise UsageError(f"{unit} converts into {to} by the spindle speed: give it with --spindle.")
            return factor(unit, start) * turning**power * factor(end, to)
    raise UsageError(f"{unit} does not convert into {to}: give the value in {to}.")


def _range(text: str | None, option: str, to: str, example: str, turning: float | None) -> tuple[float, float] | None:
    """LOW:HIGH with a unit, in another unit, which is also the default."""
    if text is None:
        return None
    found = RANGE.fullmatch(text.strip())
    if found is None:
        raise UsageError(f"{option} {text}: write it as {example}.")
    times = factor((found[3] or to).strip(), to, turning)
    low, high = (float(f"{float(end) * times:.12g}") for end in (found[1], found[2]))
    if not low < high:
        raise UsageError(f"{option} {text}: low must be below high.")
    return low, high


def _number(text: str, to: str, word: str) -> float:
    found = WITH_UNIT.fullmatch(text.strip())
    if found is None:
        raise UsageError(f"set point {word}: write it as 2mm=200N, with decimal points.")
    return float(f"{float(found[1]) * factor((found[2] or to).strip(), to):.12g}")


def _choices(pf: "ParameterFile", section: "AdaptiveForceSection", args: argparse.Namespace) -> "ForceChoices":
    """Choices of the options, in the units of the section; earlier given times and readings are kept."""
    from ..controllers.adaptive_force.derivation import GIVEN, ForceChoices
    from ..controllers.adaptive_force.settings import teeth_of

    turning, held = args.spindle or section.spindle_speed, section.sources
    points = tuple(
        (_number(depth, section.unit_depth, f"{depth}={force}"), _number(force, section.unit_force, f"{depth}={force}"))
        for depth, force in pairs(args.points, "set point", "2mm=200N").items()
    )
    readings = _range(args.readings, "--readings", section.unit_force, "-20:1500N", None)
    if readings is None and held.get("force_low") == GIVEN and section.force_low is not None:
        readings = (section.force_low, section.force_high or math.inf)
    kept = section.sample_time if held.get("sample_time") == GIVEN else None
    return ForceChoices(
        points=points, spindle_speed=args.spindle, teeth=args.teeth or teeth_of(pf), readings=readings,
        sample_time=args.sample_time or kept,
        limits=_range(args.feed, "--feed", section.unit_u, "60:500mm/min", turning), delay=args.delay,
        reference_time=args.reference_time, Kd=args.kd, lam=args.lam, g3=args.g3,
        largest_feed=_largest_feed(pf, section, turning), beyond_tested=args.beyond_tested,
    )  # fmt: skip


def _largest_feed(pf: "ParameterFile", section: "AdaptiveForceSection", turning: float | None) -> float:
    """Largest feed that is physically possible: that of any cutter, and no more than the diameter per revolution."""
    from ..datasets.plausibility.ranges import plausible

    ranges = plausible("f", "milling")
    most = math.inf if ranges is None else ranges.unusual[1]
    diameter = pf.identity.iso13399.get("DC")
    if isinstance(diameter, int | float) and diameter > 0:
        most = min(most, float(diameter))
    try:
        return most * factor(FEED, section.unit_u, turning)
    except UsageError:  # a command in V or per cent, or no spindle speed, which is asked for later
        return math.inf


def _with(section: "AdaptiveForceSection", found: "ForceDesign") -> "AdaptiveForceSection":
    """The section with the settings, their sources and a note on their margins."""
    data, settings = section.model_dump(), dict(found.settings)
    sources = {**data["sources"], **settings.pop("sources")}
    notes = [note for note in data["notes"] if not note.startswith(("Design:", "Kd, lambda and rates are of"))]
    data |= {**settings, "sources": sources, "notes": [*notes, f"Design: {' '.join(_margins(section, found))}"]}
    return type(section).model_validate(data)


def _check(pf: "ParameterFile", file: str) -> None:
    """Refuse settings that no controller can run."""
    from ..controllers.adaptive_force.settings import lacking
    from ..parameters.checks import check

    failed = [one.words for one in check(pf).inconsistent if "adaptive_force" in one.words]
    if why := lacking(pf) or " ".join(failed):
        raise UsageError(f"{file}: {why} Nothing was written.")


def _facts(found: "ForceDesign") -> dict[str, Any]:
    drawn = found.drawn
    return {
        "points": [{**one._asdict(), "margins": one.margins._asdict()} for one in found.points],
        "dead_time": found.timing.dead_time,
        "delay": found.timing.delay,
        "largest_step": found.largest_step,
        "draws": None if drawn is None else dict(zip(("n", "gain_margin", "phase_margin"), drawn, strict=True)),
    }


def _values(section: "AdaptiveForceSection") -> "Table":
    """Each value with its unit and its source."""
    from rich.table import Table

    units = {"u": section.unit_u or "1", "F": section.unit_force, "D": section.unit_depth}
    errors = _standard_errors(section)
    table = Table.grid(padding=(0, 2, 0, 0))
    for justify in ("left", "right", "left", "left"):
        table.add_column(justify=justify)
    for name, unit in UNITS.items():
        source = section.sources.get(name, "as in the file") + errors.get(name, "")
        table.add_row(name, f"{getattr(section, name):.5g}", unit.format(**units).strip(), source)
    return table


def _standard_errors(section: "AdaptiveForceSection") -> dict[str, str]:
    from ..parameters.sections.base import ModelCovariance

    held = section.uncertainty
    if not isinstance(held, ModelCovariance):
        return {}
    diagonal = {name: held.matrix[k][k] for k, name in enumerate(held.of)}
    shares = {name: math.sqrt(value) / abs(getattr(section, name)) for name, value in diagonal.items() if value > 0}
    return {name: f", standard error {100 * share:.2g} %" for name, share in shares.items()}


def _plant(pf: "ParameterFile", section: "AdaptiveForceSection") -> str:
    """m, d, c and k that the estimates imply, and which pole is that of the drive."""
    from ..controllers.adaptive_force.settings import machine

    m, c, k = machine(pf)
    which = "the drive taken as the slower pole"
    if pf.drive is not None and pf.drive.M > 0 and pf.drive.Fv > 0:
        pole = pf.drive.Fv / pf.drive.M
        near = min((abs(math.log(pole / p)), name) for p, name in ((1 / m, "slower"), (c, "faster")))
        which += f"; the drive of the file has {pole:.3g} 1/s, nearer to the {near[1]} one"
    return (
        f"Drive and cut: poles {1 / m:.4g} and {c:.4g} 1/s. With d = 1 and {which}: m {m:.4g} s, c {c:.4g} 1/s, "
        f"k {k:.4g} {section.unit_force}/s per {section.unit_u or '1'} and {section.unit_depth} of depth (assumed)."
    )


def _at_points(section: "AdaptiveForceSection", found: "ForceDesign") -> list[str]:
    return [
        f"{one.force:g} {section.unit_force} at {one.depth:g} {section.unit_depth} ({section.sources['set_points']}): "
        f"needs {one.feed:.4g} {section.unit_u}; gain margin {one.margins.gain:.3g}, phase margin "
        f"{one.margins.phase:.0f} degrees; settles in about {one.settling:.2g} s."
        for one in found.points
    ]


def _margins(section: "AdaptiveForceSection", found: "ForceDesign") -> list[str]:
    """Smallest margins, over draws of the estimates too, and the largest step."""
    least = min(found.points, key=lambda one: one.margins.gain)
    m, timing = least.margins, found.timing
    lines = [
        f"Smallest margins, at {least.depth:g} {section.unit_depth}: gain {m.gain:.2g} (the cut may be as many "
        f"times deeper), phase {m.phase:.0f} degrees, {1e3 * m.dead_time:.0f} ms more dead time than the "
        f"{1e3 * timing.dead_time:.4g} ms of averaging, step and a delay of {1e3 * timing.delay:g} ms.",
    ]
    if found.drawn is not None:
        n, gain, phase = found.drawn
        lines.append(
            f"In {n} draws of the estimates: gain margin at least {gain:.2g}, phase margin {phase:.0f} degrees."
        )
    lines.append(f"The loop is stable at steps up to {1e3 * found.largest_step:.4g} ms.")
    return lines
