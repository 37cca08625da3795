"""``fitmodels settings``: reference load, feed limits and tool change from a load law, in its parameter file."""

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import UsageError
from .arguments import Parser, traced
from .output import print_json, print_lines

if TYPE_CHECKING:
    from ..parameters import ParameterFile
    from ..parameters.sections.load_line import FeedLimit, LoadLineSection


def parser() -> Parser:
    """Arguments of ``fitmodels settings``."""
    p = Parser(
        "fitmodels settings",
        "fitmodels settings params.json --worn 0.28 --window 180:220um",
        "Set up milling at constant load by the rules of Tai, Tsai & Li 2023 (doi 10.1109/ACCESS.2023.3330587), and\n"
        "write the settings into the parameter file: the reference is the load limit of a worn tool times a safety\n"
        "factor; feed limits are the feeds at that load with a sharp tool and at the wear limit.",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json with a load law (load on feed and wear)")
    p.add_argument("--worn", type=float, metavar="A", required=True, help="load limit of a worn tool, from wear tests")
    p.add_argument("--safety-factor", type=float, default=0.85, metavar="K", help="default: 0.85")
    p.add_argument(
        "--round", type=float, default=0.01, metavar="A", help="step of the reference (default: 0.01; 0: none)"
    )
    p.add_argument(
        "--window", default="180:220um", metavar="LOW:HIGH[UNIT]", help="wear at tool change (default: 180:220um)"
    )
    p.add_argument("--wear-limit", metavar="VB[UNIT]", help="wear of the lower limit (default: the top of the window)")
    p.add_argument("--law", metavar="NAME", help="load law, where there are several")
    p.add_argument("--by", metavar="LEVEL", help="level of the law")
    p.add_argument("--level", type=float, default=0.95, help="level of the intervals (default: 0.95)")
    p.add_argument("--dwell", type=float, metavar="S", help="seconds on the lower limit before the tool counts as worn")
    p.add_argument("--force", action="store_true", help="replace settings in the file")
    p.add_argument("--json", action="store_true", help="print the section as JSON")
    return p


def run(args: argparse.Namespace) -> int:
    """Compute and write the settings, and return the exit code."""
    from .. import parameters
    from ..parameters.checks.report import cautions
    from ..parameters.file import sealed

    pf = parameters.read(args.file)
    if pf.load_line is not None and not args.force:
        raise UsageError(f"{args.file} has settings of constant load; replace them with --force.")
    line = _computed(pf, args)
    parameters.write(sealed(pf, load_line=line, provenance=traced(pf, args.words)), args.file, replaces=pf)
    verdicts = cautions(pf, line.law)
    if args.json:
        facts = {"file": Path(args.file).name, "load_line": line.model_dump(), "verdicts": verdicts}
        print_json("settings", facts, version=2)
    else:
        print_lines([*verdicts, *_sentences(line), f"Written: load_line in {args.file}"])
    return 0


def _computed(pf: "ParameterFile", args: argparse.Namespace) -> "LoadLineSection":
    from .. import parameters

    unit = next((law.factors[-1].unit for law in pf.laws.values() if law.form in ("load_line", "feed_line")), "mm")
    window = _wears(args.window, unit, "--window", "180:220um", 2)
    limit = None if args.wear_limit is None else _wears(args.wear_limit, unit, "--wear-limit", "200um", 1)[0]
    return parameters.settings(
        pf, args.worn, safety_factor=args.safety_factor, rounded_to=args.round or None, window=(window[0], window[1]),
        wear_limit=limit, law=args.law, by=args.by, level=args.level, dwell=args.dwell,
    )  # fmt: skip


def _wears(text: str, unit: str, option: str, example: str, count: int) -> list[float]:
    """Wear in the unit of the law, which is also the default unit."""
    from ..datasets.units import convert

    found = re.fullmatch(r"([\d.:eE+-]+)\s*([^\d\s].*)?", text.strip())
    try:
        values = [float(part) for part in found[1].split(":")] if found else []
    except ValueError:
        values = []
    if found is None or len(values) != count or not np.isfinite(values).all():
        raise UsageError(f"{option} {text}: write it as {example}.")
    if not found[2]:
        return values
    # through a decimal: 220 um is 0.22 mm, not 0.22000000000000003
    return [float(f"{value:.12g}") for value in convert(np.array(values), found[2], unit)]


def _sentences(line: "LoadLineSection") -> list[str]:
    rounded = "" if line.rounded_to is None else f", rounded to {line.rounded_to:g}"
    low, high = line.window
    sentences = [
        f"Reference {line.reference:g} {line.unit_load}: {line.safety_factor:g} x {line.worn:g} {line.unit_load} = "
        f"{line.safety_factor * line.worn:.4g} {line.unit_load}{rounded}.",
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
    return [*sentences, *line.notes]


def _limit(limit: "FeedLimit", line: "LoadLineSection") -> str:
    from ..parameters.sections.load_line import LimitInterval

    held = limit.interval
    interval = held.reason if not isinstance(held, LimitInterval) else (
        f"{held.level:.0%} interval {held.low:.4g} to {held.high:.4g}, {held.method}"
    )  # fmt: skip
    return f"{limit.value:.4g} {line.unit_feed} at wear {limit.wear:g} {line.unit_wear} ({interval})"
