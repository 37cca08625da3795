"""``fitmodels settings``: reference load, feed limits and tool change from a load law, in its parameter file."""

import argparse
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..core.errors import DataError, UsageError
from .arguments import Parser, parameter_file, traced
from .output import Printer, output_options, print_json

if TYPE_CHECKING:
    from ..parameters import ParameterFile
    from ..parameters.exports.loop import LoopSettings
    from ..parameters.sections.load_line import FeedLimit, LoadLineSection

DEFAULT = "default"
FEW_PAST = 0.05  # share of tools worn past the window that is no warning
ON_FAULT: Final = {"lower-limit": "lower limit", "stop": "stop", DEFAULT: DEFAULT}
# option, metavar and help of each number of the engagement; A and F: the units of the load and of the feed limits
OF_CUT: Final = (
    ("--feed-programmed", "F", "programmed feed, at which the override is 100 %% (default: the upper feed limit)"),
    ("--engage-at", "A", "filtered load that identifies a cut (default: between the load in air and that of a cut)"),
    ("--hysteresis", "A", "whole width of this threshold (default: a tenth of the reference)"),
    ("--engage-after", "S", "time above the threshold until the loop controls (default: 0.1)"),
    ("--feed-forward", "SHARE", "share of the load law's correction of the feed at this moment, 0 to 1 (default: 0)"),
    ("--back-off", "PER_S", "fastest fall of the override per second (default: the whole range in 0.5 s)"),
    ("--recover", "PER_S", "fastest rise of the override per second (default: the whole range in 2 s)"),
    ("--filter-corner", "HZ", "corner of a low-pass of the load, where the gains have none (default: none)"),
    ("--sample-time", "S", "period of the thread, no longer than that of the gains (default: that of the gains)"),
)
OF_MONITORING: Final = (
    (
        "--idle",
        "A",
        "load of the running spindle in air; half of it is the smallest valid reading (default: not known)",
    ),
    ("--load-low", "A", "smallest valid reading, above zero (default: half of the load in air)"),
    ("--load-high", "A", "largest valid reading (default: 10 times the reference)"),
    ("--arm-after", "S", "time that the spindle runs before the load is monitored, at most 10 (default: 0.5)"),
    ("--lost-after", "S", "time with invalid readings that is a fault (default: 0.05)"),
    ("--stuck-after", "S", "time of equal readings in the cut that is a fault; 0: not monitored (default: 1)"),
    ("--heartbeat", "S", "time without a sign of the load's source that is a fault; 0: not monitored (default: 0.2)"),
    ("--overload-after", "S", "time of a mean load above 1.05 x --worn that stops the feed (default: 0.5)"),
)


def parser() -> Parser:
    """Arguments of ``fitmodels settings``."""
    p = Parser(
        "fitmodels settings",
        "fitmodels settings params.json --worn 0.28 --window 180:220um",
        "Set up milling at constant load by the rules of Tai, Tsai & Li 2023 (doi 10.1109/ACCESS.2023.3330587), and\n"
        "write the settings into the parameter file: the reference is the load limit of a worn tool times a safety\n"
        "factor; feed limits are the feeds at that load with a sharp tool and at the wear limit.",
        main="--safety-factor --window --wear-limit --law --by --dwell --idle --on-fault --force --quiet --json",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json with a load law (load on feed and wear)")
    p.add_argument(
        "--worn", metavar="A[UNIT]", required=True, help="load limit of a worn tool, from wear tests, as 0.28 or 280mA"
    )
    p.add_argument(
        "--safety-factor", type=float, default=0.85, metavar="K", help="reference over the limit (default: 0.85)"
    )
    p.add_argument(
        "--round", type=float, default=0.01, metavar="A", help="step of the reference (default: 0.01; 0: none)"
    )
    p.add_argument("--window", metavar="LOW:HIGH[UNIT]", help="wear at tool change (default: 180:220um)")
    p.add_argument("--wear-limit", metavar="VB[UNIT]", help="wear of the lower limit (default: the top of the window)")
    p.add_argument("--law", metavar="NAME", help="load law (default: the only one of the file)")
    p.add_argument("--by", metavar="LEVEL", help="level of the law (default: none; asked for where it has several)")
    p.add_argument("--level", type=float, default=0.95, metavar="LEVEL", help="level of the intervals (default: 0.95)")
    p.add_argument(
        "--dwell",
        type=float,
        metavar="S",
        help="seconds on the lower limit before the tool counts as worn (default: as before, or not used)",
    )
    _engagement_options(p)
    p.add_argument("--force", action="store_true", help="replace settings in the file")
    output_options(p, "print the section as JSON (fitmodels.settings/3)")
    return p


def _engagement_options(p: Parser) -> None:
    """Options of the engagement: what is not given stays as the file has it, or is assumed and printed."""
    words = f"When the loop controls, and how fast the feed changes; '{DEFAULT}' undoes an earlier value."
    group = p.add_argument_group("cut", words)
    for option, metavar, words in OF_CUT:
        group.add_argument(option, type=_number, metavar=metavar, help=words)
    group = p.add_argument_group("monitoring", "What is a fault of the load, and what it does.")
    for option, metavar, words in OF_MONITORING:
        group.add_argument(option, type=_number, metavar=metavar, help=words)
    does = "feed to its lower limit, or stop by inhibiting the feed (default: lower-limit)"
    group.add_argument("--on-fault", choices=list(ON_FAULT), help=does)


def _number(text: str) -> float | str:
    """A finite number, or the word that undoes an earlier option.

    >>> _number("0.05"), _number("default")
    (0.05, 'default')
    """
    if text == DEFAULT:
        return text
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is not a number with a decimal point; give one, or '{DEFAULT}'")
    return value


def run(args: argparse.Namespace) -> int:
    """Compute and write the settings, and return the exit code."""
    from .. import parameters
    from ..parameters.checks.report import cautions, worn_past_window
    from ..parameters.file import sealed
    from ..parameters.setting_words import limits_not_applied

    pf = parameter_file(args.file, writes=True)
    if pf.load_line is not None and not args.force:
        raise UsageError(f"{args.file} has settings of constant load; replace them with --force.")
    given = _given(args)
    line = _computed(pf, {**_kept(pf), **given}, args)
    changed = sealed(pf, load_line=line, provenance=traced(pf, args.words))
    _check(changed, args.file, refused=bool(given) or args.dwell is not None)
    found = _loop(changed)
    lacking, assumed = found.lacking, list(found.assumed)
    parameters.write(changed, args.file, replaces=pf)
    verdicts = cautions(pf, line.law)
    past, past_words = worn_past_window(changed)
    if args.json:
        facts = {"file": Path(args.file).name, "load_line": line.model_dump(), "assumed": assumed, "lacking": lacking}
        print_json("settings", {**facts, "worn_past_window": past, "verdicts": verdicts}, version=3)
    else:
        loop = _of_loop(line, set(_kept(pf)) - set(given), assumed, lacking)
        worn = past_words if past is not None and past <= FEW_PAST else f"! {past_words}"
        out = Printer(quiet=args.quiet)
        for words in (*verdicts, *_sentences(line), worn, *loop, *limits_not_applied(pf.limits, line)):
            out.show(words)
        out.wrote(f"Written: load_line in {args.file}", args.file)
    return 0


def _given(args: argparse.Namespace) -> dict[str, Any]:
    """Engagement from the options; None where the word `default` undoes an earlier one."""
    names = [_name(option) for option, _, _ in (*OF_CUT, *OF_MONITORING)]
    found = {name: value for name in names if (value := getattr(args, name)) is not None}
    if args.on_fault is not None:
        found["on_fault"] = ON_FAULT[args.on_fault]
    return {name: None if value == DEFAULT else value for name, value in found.items()}


def _kept(pf: "ParameterFile") -> dict[str, Any]:
    """Engagement of the former settings, which stays where no option replaces it."""
    from ..parameters.sections.load_line import Engagement

    held = None if pf.load_line is None else pf.load_line.engagement
    if held is None:
        return {}
    return {name: value for name in Engagement.model_fields if (value := getattr(held, name)) is not None}


def _check(pf: "ParameterFile", file: str, *, refused: bool) -> None:
    """Refuse an engagement that no controller can run, or that the gate of the exports would refuse.

    Raises
    ------
    UsageError
        With all reasons; only where the engagement was given now. What gains lack is no reason to refuse settings.
    """
    from ..controllers.gate.settings import Line, check_order
    from ..parameters.file import sealed

    found, line = _loop(sealed(pf, pi=None)), pf.load_line
    assert line is not None  # noqa: S101  just computed
    if found.loop is None:
        wrong = [f"{file} {found.lacking}"]
    else:
        law = pf.laws[line.law]
        c, idle = law.coefficients, line.engagement.idle if line.engagement else None
        A = c.get("A", 0.0) + (law.by.shifts.get(line.by or "", 0.0) if law.by else 0.0)
        in_air = idle or max(A, 1.2 * found.loop.load_low)
        cut = Line(A, c["B"], c["k1"], in_air, line.lower.wear, 0.0) if law.form == "load_line" else None
        wrong = [] if cut is None else [
            one.words for one in check_order(pf, found.loop, cut, math.inf) if one.passed is False
        ]  # fmt: skip
    if wrong and refused:
        raise UsageError(f"{' '.join(wrong)} Nothing was written.")


def _loop(pf: "ParameterFile") -> "LoopSettings":
    """The loop of these settings; of a file without gains with placeholders, which no assumption depends on."""
    from ..parameters.exports.loop import loop_settings
    from ..parameters.file import sealed

    line = pf.load_line
    assert line is not None  # noqa: S101  just computed
    if pf.pi is None:
        period = 0.02 if line.engagement is None else line.engagement.sample_time or 0.02
        units = {"unit_u": line.unit_feed, "unit_y": line.unit_load}
        pf = sealed(pf, pi={"kp": 0.0, "ki": 0.0, "sample_time": period, **units})
    return loop_settings(pf)


def _of_loop(line: "LoadLineSection", kept: set[str], assumed: list[str], lacking: str) -> list[str]:
    """The engagement in sentences: what the file holds, what is assumed, and why it cannot be run."""
    from ..parameters.setting_words import WINDOW_ASSUMED

    held = {} if line.engagement is None else line.engagement.model_dump(exclude_none=True)
    units, sentences = _units(line), []
    for label, names in (("Given", set(held) - kept), ("Kept of the former settings", kept & set(held))):
        named = [f"{name} {_value(held[name], units.get(name, ''))}" for name in held if name in names]
        sentences += [f"{label}: {'; '.join(named)}."] if named else []
    if assumed:
        sentences.append(f"Assumed, each replaced by the option of its name: {'; '.join(assumed)}.")
    if lacking:  # then nothing is listed as assumed
        sentences += [note for note in line.notes if note.startswith(WINDOW_ASSUMED)]
        sentences.append(f"No controller can run these settings: the file {lacking}")
    return sentences


def _units(line: "LoadLineSection") -> dict[str, str]:
    """Unit of each number of the engagement, by the metavariable of its option."""
    of = {"A": line.unit_load, "F": line.unit_feed, "S": "s", "PER_S": "per s", "HZ": "Hz"}
    return {_name(option): of.get(metavar, "") for option, metavar, _ in (*OF_CUT, *OF_MONITORING)}


def _value(value: object, unit: str) -> str:
    return f"{value:g} {unit}".rstrip() if isinstance(value, float) else str(value)


def _name(option: str) -> str:
    return option[2:].replace("-", "_")


def _computed(pf: "ParameterFile", engagement: dict[str, Any], args: argparse.Namespace) -> "LoadLineSection":
    from .. import parameters

    unit = next((law.factors[-1].unit for law in pf.laws.values() if law.form in ("load_line", "feed_line")), "mm")
    window = None if args.window is None else _numbers(args.window, unit, "--window", "180:220um", 2)
    limit = None if args.wear_limit is None else _numbers(args.wear_limit, unit, "--wear-limit", "200um", 1)[0]
    former = None if pf.load_line is None else pf.load_line.dwell
    return parameters.settings(
        pf, _worn(pf, args), safety_factor=args.safety_factor, rounded_to=args.round or None,
        window=None if window is None else (window[0], window[1]), wear_limit=limit, law=args.law, by=args.by,
        level=args.level,
        dwell=former if args.dwell is None else args.dwell,
        engagement={name: value for name, value in engagement.items() if value is not None} or None,
    )  # fmt: skip


def _worn(pf: "ParameterFile", args: argparse.Namespace) -> float:
    """Load of a worn tool in the unit of the load law."""
    from ..parameters.setting_rules import load_law_of

    law = load_law_of(pf, args.law)
    unit = law.unit if law.form == "load_line" else "A"
    return _numbers(args.worn, unit, "--worn", f"0.28{unit}", 1)[0]


def _numbers(text: str, unit: str, option: str, example: str, count: int) -> list[float]:
    """Numbers in the unit of the law, which is also the default unit."""
    from ..datasets.units import convert, is_unit, same_dimension

    found = re.fullmatch(r"([\d.:eE+-]+)\s*([^\d\s,].*)?", text.strip())
    try:
        values = [float(part) for part in found[1].split(":")] if found else []
    except ValueError:
        values = []
    if found is None or len(values) != count or not np.isfinite(values).all():
        shape = f"{'two ends with a colon between' if count == 2 else 'one number'}, with decimal points, as"
        raise UsageError(f"{option} {text}: give {shape} {example}.")
    if not found[2]:
        return values
    if not is_unit(found[2]):
        raise UsageError(f"{option} {text}: the unit {found[2]!r} is not known; give it in {unit}, as {example}.")
    if not same_dimension(found[2], unit):
        words = f"values in {found[2]!r} cannot be converted to {unit!r}, which measures another quantity"
        raise DataError(f"{option} {text}: {words}; give it in {unit}, as {example}.")
    # through a decimal: 220 um is 0.22 mm, not 0.22000000000000003
    return [float(f"{value:.12g}") for value in convert(np.array(values), found[2], unit)]


def _sentences(line: "LoadLineSection") -> list[str]:
    from ..parameters.setting_words import WINDOW_ASSUMED, rounding_words

    rounded = "" if line.rounded_to is None else f", rounded to {line.rounded_to:g}"
    note = rounding_words(line)
    low, high = line.window
    sentences = [
        f"Reference {line.reference:g} {line.unit_load}: {line.safety_factor:g} x {line.worn:g} {line.unit_load} = "
        f"{line.safety_factor * line.worn:.4g} {line.unit_load}{rounded}.{f' {note}' if note else ''}",
        f"Upper feed limit {_limit(line.upper, line)}.",
        f"Lower feed limit {_limit(line.lower, line)}.",
    ]
    window = f"{low:g} to {high:g} {line.unit_wear}"
    if line.probability is None:
        sentences.append(f"Probability that wear is in {window} at the lower limit: not known, {line.probability_of}.")
    else:
        sentences.append(
            f"Probability that wear is in {window} when the lower limit is reached: {line.probability:.2f} "
            f"({line.probability_of})."
        )
    warnings = [f"! {note}" for note in line.notes if not note.startswith(WINDOW_ASSUMED)]
    return [*sentences, *warnings]


def _limit(limit: "FeedLimit", line: "LoadLineSection") -> str:
    from ..parameters.sections.load_line import LimitInterval

    held = limit.interval
    interval = held.reason if not isinstance(held, LimitInterval) else (
        f"{held.level:.0%} interval {held.low:.4g} to {held.high:.4g}, {held.method}"
    )  # fmt: skip
    return f"{limit.value:.4g} {line.unit_feed} at wear {limit.wear:g} {line.unit_wear} ({interval})"
