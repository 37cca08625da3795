"""``fitmodels limits``: limits of machine, tool and work, written into a parameter file."""

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import UsageError
from ..core.suggestions import did_you_mean
from .arguments import Parser, parameter_file, traced
from .numbers import NUMBER, check_apart, pairs, with_point
from .output import Printer, output_options, print_json

if TYPE_CHECKING:
    from ..parameters import ParameterFile
    from ..parameters.sections.load_line import LimitsSection

RANGES = {"f": "feed", "fm": "feed_rate", "V": "speed", "n": "spindle_speed"}
LOWER = ("T",)  # responses that are limited from below where one number is given
WRITTEN = "P=7kW, Fxz=1300N, AW=0.3mm, V=50:200m/min or f=0.06:0.6mm/rev"


def parser() -> Parser:
    """Arguments of ``fitmodels limits``."""
    p = Parser(
        "fitmodels limits",
        "fitmodels limits params.json P=7kW Fxz=1300N AW=0.3mm V=50:200m/min f=0.06:0.6mm/rev",
        "Write limits of machine, tool and work into a parameter file: upper limits of power, of a force, of wear and\n"
        "of any other response with a law, Ra=3.2um; a lower one of tool life, T=15min; both ends as Ra=0.4:3.2um;\n"
        "ranges of speed V, spindle speed n, feed f and feed rate fm, from low to high.\n"
        "`fitmodels replay` respects them. Limits that are not named stay as they are.",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json")
    p.add_argument("limits", nargs="+", metavar="P=7kW", help=f"{WRITTEN}; the default unit where none is given")
    p.add_argument("--force", action="store_true", help="replace limits in the file")
    output_options(p, "print the section as JSON (fitmodels.limits/3)")
    return p


def run(args: argparse.Namespace) -> int:
    """Write and print the limits, and return the exit code."""
    from .. import parameters
    from ..parameters.checks.record import check_limits
    from ..parameters.checks.report import cautions, worn_past_window
    from ..parameters.file import sealed
    from ..parameters.setting_words import measured_power_words

    pf = parameter_file(args.file, writes=True)
    given = {symbol: _limit(symbol, text, pf) for symbol, text in pairs(args.limits, "limit", "P=7kW").items()}
    others = {symbol: given.pop(symbol)[1] for symbol in tuple(given) if given[symbol][0] == "responses"}
    asked = dict(given.values())
    if len(asked) < len(given):
        raise UsageError(f"limits {', '.join(given)}: a file has one limit of each kind, and two are of the same kind.")
    held = {} if pf.limits is None else {k: v for k, v in pf.limits.model_dump().items() if v is not None}
    stated = held.get("responses", {})
    twice = [name for name in asked if name in held and held[name] != asked[name]]
    twice += [name for name in others if name in stated and stated[name] != others[name]]
    if twice and not args.force:
        raise UsageError(f"{args.file} has a limit of {', '.join(twice)}; replace it with --force.")
    asked["responses"] = {**stated, **others}
    changed = sealed(pf, limits={**held, **asked}, provenance=traced(pf, args.words))
    found = tuple(check_limits(changed))
    if impossible := " ".join(finding.words for finding in found if finding.passed is False):
        raise UsageError(f"{impossible} Nothing was written.")
    parameters.write(changed, args.file, replaces=pf)
    section = changed.limits
    assert section is not None  # noqa: S101  just written
    bounded = [*(limit["of"] for limit in asked.values() if limit.get("of")), *others]
    verdicts = [*(f"! {finding.words}" for finding in found), *(cautions(pf, *bounded) if bounded else [])]
    past, words = worn_past_window(changed)
    measured = measured_power_words(section, changed.laws) if "power" in asked else ()
    if args.json:
        facts = {"file": Path(args.file).name, "limits": section.model_dump(), "worn_past_window": past}
        print_json("limits", {**facts, "verdicts": verdicts}, version=3)
    else:
        out = Printer(quiet=args.quiet)
        for line in (*_sentences(section), *measured, *([words] if words else []), *verdicts):
            out.show(line)
        out.wrote(f"Written: limits in {args.file}", args.file)
    return 0


def _limit(symbol: str, text: str, pf: "ParameterFile") -> tuple[str, dict[str, Any]]:
    """Kind and section of one limit: a bound of a response, or a range of a setting of the machine."""
    from ..datasets.vocabulary import ROLES

    kind = RANGES.get(symbol) or _bounded(symbol) or ("responses" if symbol in pf.laws else None)
    if kind is None:
        known = [*RANGES, *(s for s in ROLES if _bounded(s)), *pf.laws]
        raise UsageError(f"limit {symbol}: there is no such limit. {did_you_mean(symbol, known, 0.6)}")
    usual = ROLES[symbol].unit if symbol in ROLES else pf.laws[symbol].unit
    found = re.fullmatch(rf"({NUMBER})(?::({NUMBER}))?\s*([^\s,].*)?", text)
    shaped = found is not None and (kind == "responses" or (found[2] is not None) == (symbol in RANGES))
    if found is None or not shaped:
        shape = "low:high with a unit, V=50:200m/min" if symbol in RANGES else "one number with a unit, P=7kW"
        raise UsageError(f"limit {symbol}={text}: give {shape}{with_point(text) and ', with decimal points'}.")
    check_apart(f"limit {symbol}={text}", found[3])
    ends = tuple(float(end) for end in (found[1], found[2]) if end)
    positive = ends[0] >= 0 if symbol in RANGES else ends[0] > 0
    if not positive:
        raise UsageError(
            f"limit {symbol}={text}: {'an end is not below' if symbol in RANGES else 'a limit is above'} zero."
        )
    if len(ends) == 2 and not ends[0] < ends[1]:
        raise UsageError(f"limit {symbol}={text}: low must be below high.")
    unit = _unit(symbol, found[3], usual)
    if symbol in RANGES:
        return kind, {"low": ends[0], "high": ends[1], "unit": unit}
    if symbol not in pf.laws and not _of_section(symbol, kind, pf):
        laws = ", ".join(pf.laws) or "nothing"
        raise UsageError(f"limit {symbol}: the file has laws of {laws}, so the limit would have no effect.")
    return kind, _response_limit(symbol, ends, unit) if kind == "responses" else {
        "value": ends[0], "unit": unit, "of": symbol,
    }  # fmt: skip


def _of_section(symbol: str, kind: str, pf: "ParameterFile") -> bool:
    """Whether a section uses a limit of a quantity without a law: force of a control, or wear at tool change."""
    rough, line = pf.roughness, pf.load_line
    if kind == "force":
        law = None if rough is None else pf.laws.get(rough.law)
        return pf.adaptive_force is not None or (law is not None and law.factors[0].symbol == symbol)
    law = None if line is None else pf.laws.get(line.law)
    return kind == "wear" and law is not None and law.factors[-1].symbol == symbol


def _response_limit(symbol: str, ends: tuple[float, ...], unit: str) -> dict[str, Any]:
    """Section of a limit of a response other than power, force and wear; one number of a life is its lower end."""
    low, high = (*ends, None)[:2] if symbol in LOWER or len(ends) == 2 else (None, ends[0])
    return {"low": low, "high": high, "unit": unit}


def _bounded(symbol: str) -> str | None:
    """Power, force or wear, by the quantity of the symbol."""
    from ..datasets.vocabulary import ROLES

    role = ROLES.get(symbol)
    if role is None:
        return None
    if role.kind == "wear":
        return "wear"
    return {"N": "force", "kW": "power"}.get(role.unit) if role.kind == "load" else None


def _unit(symbol: str, given: str | None, usual: str) -> str:
    from ..datasets.units import is_unit, same_dimension

    if given is None:
        return usual
    if "," in given:
        raise UsageError(f"limit {symbol}: give numbers with a decimal point, as {symbol}=3.2{usual}.")
    if not is_unit(given) or not same_dimension(given, usual):
        raise UsageError(f"limit {symbol} in {given}: this is not a unit of {symbol}; give it in {usual}.")
    return given


def _sentences(section: "LimitsSection") -> list[str]:
    held, sentences = section.model_dump(), []
    for name in type(section).model_fields:  # not those that a later version knows
        limit = held[name]
        if limit is None:
            continue
        what = name.replace("_", " ")
        if name == "responses":
            sentences += [_response_sentence(symbol, ends) for symbol, ends in limit.items()]
        elif "value" in limit:
            of = f" {limit['of']}" if limit.get("of") else ""
            sentences.append(f"{what.capitalize()}{of} at most {limit['value']:g} {limit['unit']}.")
        else:
            sentences.append(f"{what.capitalize()} from {limit['low']:g} to {limit['high']:g} {limit['unit']}.")
    return sentences


def _response_sentence(symbol: str, ends: dict[str, Any]) -> str:
    low, high, unit = ends["low"], ends["high"], ends["unit"]
    if low is None or high is None:
        return f"{symbol} at {'most' if low is None else 'least'} {high if low is None else low:g} {unit}."
    return f"{symbol} from {low:g} to {high:g} {unit}."
