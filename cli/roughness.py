"""``fitmodels roughness``: settings of turning at constant roughness, derived and written into a parameter file."""

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..core.errors import UsageError
from ..core.suggestions import did_you_mean
from .arguments import Parser, failing, joined, now_simulated, parameter_file, traced
from .numbers import NUMBER, pairs
from .output import Printer, output_options, print_json

if TYPE_CHECKING:
    from ..controllers.roughness.derivation import Choices, DerivedSettings
    from ..controllers.roughness.plant import Cut
    from ..datasets import Record
    from ..parameters import ParameterFile
    from ..parameters.sections.force_control import RoughnessSection
    from ..parameters.sections.law import LawSection

VALUES: Final = {  # name -> (field of the cut, its unit, an example)
    "Ra": ("roughness", "um", "Ra=1.6um"),
    "n": ("spindle_speed", "1/min", "n=610rpm"),
    "f": ("feed", "mm/rev", "f=0.2mm/rev"),
    "d": ("depth", "mm", "d=1mm"),
    "r": ("nose_radius", "mm", "r=0.8mm"),
    "chip": ("chip_thickness", "mm", "chip=0.3mm"),
    "threshold": ("threshold", "N", "threshold=100N"),
    "wait": ("wait", "s", "wait=0.3s"),
    "sample": ("sample_time", "s", "sample=10ms"),
    "servo": ("servo_time", "s", "servo=0.13s"),
    "process": ("process_time", "s", "process=0.1s"),
    "kc": ("kc", "N/mm2", "kc=2500N/mm2"),
    "kca": ("force_per_feed", "N", "kca=2781N"),
    "override": ("override", "%", "override=0:150%"),
    "valid": ("valid", "N", "valid=-50:3000N"),
}
OTHER_NAMES: Final = {
    "Ra_ref": "Ra", "roughness": "Ra", "spindle": "n", "speed": "n", "feed": "f", "depth": "d", "nose": "r",
    "ts": "servo", "tc": "process", "kc_a": "kca",
}  # fmt: skip
RANGES: Final = ("override", "valid")
REQUIRED: Final = ("Ra", "n")
LABELS: Final = {  # field -> (name of its value, unit)
    "roughness": ("Required roughness", "um"),
    "force": ("Reference force", "N"),
    "spindle_speed": ("Spindle speed", "1/min"),
    "feed": ("Programmed feed", "mm/rev"),
    "depth": ("Depth of cut", "mm"),
    "nose_radius": ("Nose radius", "mm"),
    "chip_thickness": ("Largest chip thickness", "mm"),
    "force_per_feed": ("kc a", "N per mm/rev"),
    "override_low": ("Lower limit", "% of the programmed feed"),
    "override_high": ("Upper limit", "% of the programmed feed"),
    "threshold": ("Threshold of a cut", "N"),
    "threshold_time": ("Time above it", "s"),
    "force_low": ("Smallest valid reading", "N"),
    "force_high": ("Largest valid reading", "N"),
    "servo_time": ("Time constant of the servo", "s"),
    "process_time": ("Time constant of the process", "s"),
    "sample_time": ("Sample time", "s"),
}


def parser() -> Parser:
    """Arguments of ``fitmodels roughness``."""
    p = Parser(
        "fitmodels roughness",
        "fitmodels roughness params.json Ra=1.6um n=610rpm f=0.2mm/rev d=1mm r=0.8mm servo=0.13s",
        "Set up turning at constant roughness through constant force, and write the settings into the parameter\n"
        "file: the reference force from the law Ra = a exp(b F), kc a from the force law, time constants from\n"
        "recorded steps, the override from the tested feeds. Each value is printed with its origin.",
        main="--step --force-from --data --beyond-tests --force --quiet --json",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json with a law Ra = a exp(b F)")
    words = ", ".join(example.replace("%", "%%") for _, _, example in VALUES.values())
    p.add_argument(
        "values", nargs="+", metavar="Ra=1.6um", help=f"{words}; and other factors of the force law, V=150m/min"
    )
    p.add_argument(
        "--step",
        action="append",
        metavar="RECORD",
        help="recorded steps of the feed command, with the feed (servo) or the cutting force (servo and process, also "
        "of a command without steps); one of each may be given (default: none)",
    )
    p.add_argument("--input", metavar="COLUMN", help="feed command in the records (default: by name and unit)")
    p.add_argument("--output", metavar="COLUMN", help="measured feed or force in them (default: by name and unit)")
    p.add_argument("--unit", action="append", metavar="output=N", help="unit of a column (default: from the header)")
    p.add_argument(
        "--force-from",
        choices=["inverse", "regression"],
        default="inverse",
        help="the reference force that is used: the inverse of the law, or the regression of force on ln Ra "
        "(default: inverse; both are printed)",
    )
    p.add_argument("--data", metavar="FILE", help="tests for that regression (default: those of the law)")
    p.add_argument("--map", action="append", metavar="Ra=COLUMN", help="column in --data (default: by name)")
    p.add_argument("--law", metavar="NAME", help="roughness law (default: the only one on force)")
    p.add_argument("--force-law", metavar="NAME", help="force law (default: that of the force of the roughness law)")
    p.add_argument("--level", type=float, default=0.95, metavar="LEVEL", help="of the interval of the force")
    p.add_argument(
        "--beyond-tests",
        metavar="REASON",
        default="",
        help="accept feeds beyond 1.5 times the tested ones, or a force above the tested or whose interval lacks an "
        "end, for this reason, which is recorded (default: refused)",
    )
    p.add_argument("--force", action="store_true", help="replace the settings in the file")
    output_options(p, "print the section as JSON (fitmodels.roughness/1)")
    return p


def run(args: argparse.Namespace) -> int:
    """Derive and write the settings, and return the exit code."""
    from .. import parameters
    from ..controllers.gate.roughness import check_roughness
    from ..controllers.roughness.controller import ConstantRoughness, not_applied
    from ..controllers.roughness.derivation import derived_settings
    from ..controllers.roughness.plant import measured_from
    from ..controllers.roughness.reference import roughness_law
    from ..parameters.checks.report import cautions
    from ..parameters.file import sealed

    if not 0 < args.level < 1:
        raise UsageError(f"--level {args.level:g}: give a share between 0 and 1, as 0.95.")
    pf = parameter_file(args.file, writes=True)
    if pf.roughness is not None and not args.force:
        raise UsageError(f"{args.file} has settings of constant roughness; replace them with --force.")
    law = pf.laws[roughness_law(pf, args.law)]
    cut = cut_of(args.values, pf)
    steps = [_record(name, args) for name in args.step or ()]
    measured = measured_from(steps, cut)
    found = derived_settings(pf, cut, measured, _choices(args, law))
    provenance = traced(pf, args.words)
    changed = sealed(pf, identity=joined(pf, steps), roughness=found.section, provenance=provenance)
    effective = ConstantRoughness.from_parameters(changed)  # limits of the machine may leave no range
    unsafe = failing(check_roughness(changed), args.file, accepted=bool(args.beyond_tests.strip()))
    parameters.write(changed, args.file, replaces=pf)
    verdicts = [*unsafe, *cautions(pf, *found.laws)]
    if args.json:
        print_json("roughness", {**_facts(found, args), "verdicts": verdicts})
        return 0
    out = Printer(quiet=args.quiet)
    feeds = f"The control commands {effective.low:.4g} to {effective.high:.4g} mm/rev, all limits of feed together."
    for words in (*verdicts, *_sentences(found), feeds, *not_applied(changed)):
        out.show(words)
    out.wrote(f"Written: roughness in {args.file}{now_simulated(pf, changed)}", args.file)
    return 0


def cut_of(words: list[str], pf: "ParameterFile") -> "Cut":
    """Values of the command in the units of the section; a factor of a law of the file is one of its conditions.

    Raises
    ------
    UsageError
        A name is not known, a required one is missing, or a value is no number in a unit of its quantity.
    """
    from ..controllers.roughness.plant import Cut

    given = {OTHER_NAMES.get(name, name): text for name, text in pairs(words, "value", "Ra=1.6um").items()}
    if len(given) < len(words):
        raise UsageError(f"{' '.join(words)}: two values are of the same quantity; give one of them.")
    if missing := [VALUES[name][2] for name in REQUIRED if name not in given]:
        raise UsageError(f"{' and '.join(missing)} missing: give the required roughness and the spindle speed.")
    spindle = _number("n", given["n"], "1/min")
    found: dict[str, Any] = {}
    conditions: dict[str, float | str] = {}
    for name, text in given.items():
        if name in RANGES:
            found[VALUES[name][0]] = _range(name, text)
        elif name in VALUES:
            found[VALUES[name][0]] = _value(name, text, spindle)
        else:
            conditions[name] = _condition(name, text, pf)
    return Cut(**found, conditions=conditions)


def _value(name: str, text: str, spindle: float) -> float:
    """A value above zero; a feed may be per minute, kc a per mm/rev."""
    _, unit, _ = VALUES[name]
    if name == "kca":
        text = re.sub(r"(?<=N)\s*+(/\(?mm/rev\)?|per\s*+mm/rev|rev/mm)$", "", text)
    per_minute = name == "f" and re.search(r"/\s*(min|s)$", text)
    value = _number(name, text, "mm/min") / spindle if per_minute else _number(name, text, unit)
    if not value > 0 and name != "wait":
        raise UsageError(f"{name}={text}: give a value above zero.")
    return value


def _range(name: str, text: str) -> tuple[float, float]:
    """Both ends, shares of the programmed feed or N; the unit stands after the second."""
    found = re.fullmatch(rf"({NUMBER})\s*:\s*({NUMBER})\s*(\S.*)?", text)
    if found is None:
        raise UsageError(f"{name}={text}: write it as {VALUES[name][2]}.")
    unit = "" if name == "override" and found[3] in (None, "%") else found[3] or ""
    low, high = (_number(name, f"{end}{unit}", VALUES[name][1], bare=name == "override") for end in found.groups()[:2])
    if name == "override":
        if found[3] not in (None, "%"):
            raise UsageError(f"override={text}: give it in % of the programmed feed, as override=0:150%.")
        low, high = (end / 100 if found[3] else end for end in (low, high))
    if not low < high or (name == "override" and low < 0):
        raise UsageError(f"{name}={text}: low must be below high{', and not below 0' * (name == 'override')}.")
    return low, high


def _number(name: str, text: str, unit: str, *, bare: bool = False) -> float:
    """A number with its unit in another unit."""
    from ..datasets.units import convert, is_unit, same_dimension

    found = re.fullmatch(rf"({NUMBER})\s*(\S.*)?", text.strip())
    if found is None or not np.isfinite(float(found[1])) or (found[2] or "").startswith(","):
        raise UsageError(f"{name}={text}: give a number with a decimal point and its unit, as {VALUES[name][2]}.")
    if (found[2] or "").startswith("/"):
        raise UsageError(f"{name}={text}: number and unit are ambiguous; give it as {VALUES[name][2]}.")
    if not found[2]:
        if bare:
            return float(found[1])
        raise UsageError(f"{name}={text}: the unit is missing; give it as {VALUES[name][2]}.")
    if not is_unit(found[2]) or not same_dimension(found[2], unit):
        raise UsageError(f"{name}={text}: {found[2]} is no unit of it; give it in {unit}, as {VALUES[name][2]}.")
    return float(f"{float(convert(np.array([float(found[1])]), found[2], unit)[0]):.12g}")


def _condition(name: str, text: str, pf: "ParameterFile") -> float | str:
    """A factor of a law, in its unit, or a level of its category."""
    for law in pf.laws.values():
        if law.by is not None and law.by.column == name:
            return text
        for factor in law.factors:
            if factor.symbol == name:
                found = re.fullmatch(NUMBER, text.strip())
                return float(text) if found else _number_of_factor(name, text, factor.unit)
    known = [*VALUES, *OTHER_NAMES, *(factor.symbol for law in pf.laws.values() for factor in law.factors)]
    raise UsageError(f"{name}: there is no such value. {did_you_mean(name, dict.fromkeys(known), 0.6)}")


def _number_of_factor(name: str, text: str, unit: str) -> float:
    from ..datasets.units import convert, is_unit, same_dimension

    found = re.fullmatch(rf"({NUMBER})\s*(\S.*)", text.strip())
    if found is None or not is_unit(found[2]) or not same_dimension(found[2], unit):
        raise UsageError(f"{name}={text}: give a number in {unit}, as {name}=1{unit}.")
    return float(convert(np.array([float(found[1])]), found[2], unit)[0])


def _record(name: str, args: argparse.Namespace) -> "Record":
    from ..datasets import read_record

    return read_record(name, args.input, args.output, units=pairs(args.unit, "--unit", "output=N"))


def _choices(args: argparse.Namespace, law: "LawSection") -> "Choices":
    from ..controllers.roughness.derivation import Choices

    pair, source = (None, "") if args.data is None else _regression(args, law)
    return Choices(
        law=law.response, force_law=args.force_law, force_from=args.force_from, regression=pair, regression_of=source,
        level=args.level, beyond_tests=args.beyond_tests.strip().rstrip("."),
    )  # fmt: skip


def _regression(args: argparse.Namespace, law: "LawSection") -> tuple[tuple[float, float], str]:
    """Force on ln Ra over the tests of --data, and its source."""
    from ..controllers.roughness.reference import regression_of_tests
    from ..datasets import read_runs

    runs = read_runs(args.data, map=pairs(args.map, "--map", "Ra=col3"))
    symbols = law.response, law.factors[0].symbol
    for symbol, unit in zip(symbols, ("um", "N"), strict=True):
        if symbol not in runs.data or runs.units.get(symbol) != unit:
            raise UsageError(f"{args.data} has no column of {symbol} in {unit}; name it with --map {symbol}=COLUMN.")
    Ra, F = (runs.data[symbol].to_numpy(dtype=np.float64) for symbol in symbols)
    constant, slope = regression_of_tests(F, Ra)
    used = int((np.isfinite(Ra) & np.isfinite(F)).sum())
    columns = "".join(f", {symbol} from column {column}" for symbol, column in pairs(args.map, "--map", "").items())
    return (constant, slope), f"least squares over {used} tests of {Path(args.data).name}{columns}"


def _facts(found: "DerivedSettings", args: argparse.Namespace) -> dict[str, Any]:
    inverse = found.inverse
    ends = {"low": _finite(inverse.low), "high": _finite(inverse.high), "level": inverse.level}
    return {
        "file": Path(args.file).name,
        "roughness": found.section.model_dump(),
        "reference": {
            "inverse": inverse.value,
            "interval": ends if inverse.low is not None else {"reason": inverse.reason},
            "regression": found.regression,
            "no_regression": found.no_regression or None,
        },
        "remarks": list(found.remarks),
    }


def _finite(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else value


def _sentences(found: "DerivedSettings") -> list[str]:
    """Each value with its unit and origin, both readings of the reference force, and the remarks."""
    section = found.section
    lines = [f"{_shown(section, name)} ({section.sources[name]})" for name in LABELS if name in section.sources]
    lines.insert(2, _readings(found))
    return [*lines, *found.remarks]


def _shown(section: "RoughnessSection", name: str) -> str:
    label, unit = LABELS[name]
    value = getattr(section, name)
    if name.startswith("override"):
        feed = section.feed or 0.0
        return f"{label} {100 * value:.4g} {unit}, {value * feed:.4g} {section.unit_feed}"
    return f"{label} {value:.4g} {unit}"


def _readings(found: "DerivedSettings") -> str:
    """Both readings of the reference force, with the interval of the first."""
    inverse, section = found.inverse, found.section
    first = f"By the inverse of the law {inverse.value:.4g} N ({inverse.interval})"
    if found.regression is None or section.regression is None:
        return f"{first}; by a regression of force on ln Ra: {found.no_regression}"
    line = section.regression
    other = f"by the regression {line.constant:.4g} + {line.slope:.4g} ln Ra N {found.regression:.4g} N"
    return f"{first}; {other} ({section.sources['regression']})."
