"""``fitmodels limits``: what machine, tool and work allow, put into a parameter file."""

import argparse
import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import UsageError
from .arguments import Parser, nearest, pairs, traced
from .output import Printer

if TYPE_CHECKING:
    from ..parameters import ParameterFile

RANGES = {"f": "feed", "fm": "feed_rate", "V": "speed", "n": "spindle_speed"}
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
WRITTEN = "P=7kW, Fxz=1300N, AW=0.3mm, V=50:200m/min or f=0.06:0.6mm/rev"


def parser() -> Parser:
    """Arguments of ``fitmodels limits``."""
    p = Parser(
        "fitmodels limits",
        "fitmodels limits params.json P=7kW Fxz=1300N AW=0.3mm V=50:200m/min f=0.06:0.6mm/rev",
        "Put into a parameter file what machine, tool and work allow: power, a force, and the wear at which an edge\n"
        "is worn out, each at most; speed V, spindle speed n, feed f and feed rate fm, each from low to high.\n"
        "`fitmodels replay` keeps to them. What is not named stays as it is.",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json")
    p.add_argument("limits", nargs="+", metavar="P=7kW", help=f"{WRITTEN}; without a unit: the usual one")
    p.add_argument("--force", action="store_true", help="replace limits that are in the file")
    p.add_argument("--json", action="store_true", help="print the section as JSON")
    return p


def run(args: argparse.Namespace) -> int:
    """Write the limits, say them, and return the exit code."""
    from rich.text import Text

    from .. import parameters
    from ..parameters.file import sealed

    pf = parameters.read(args.file)
    given = {symbol: _limit(symbol, text, pf) for symbol, text in pairs(args.limits, "limit", "P=7kW").items()}
    asked = dict(given.values())
    if len(asked) < len(given):
        raise UsageError(f"limits {', '.join(given)}: a file holds one limit of each kind, and two are of one kind.")
    held = {} if pf.limits is None else {k: v for k, v in pf.limits.model_dump().items() if v is not None}
    twice = [name for name in asked if name in held and held[name] != asked[name]]
    if twice and not args.force:
        raise UsageError(f"{args.file} holds a limit of {', '.join(twice)} already; replace it with --force.")
    changed = sealed(pf, limits={**held, **asked}, provenance=traced(pf, args))
    parameters.write(changed, args.file, force=True)
    section = changed.limits
    assert section is not None  # noqa: S101  just written
    if args.json:
        facts = {"schema": "fitmodels.limits/1", "file": Path(args.file).name, "limits": section.model_dump()}
        print(json.dumps(facts, indent=2, ensure_ascii=False, allow_nan=False))  # noqa: T201
        return 0
    out = Printer()
    for line in (*_words(section.model_dump()), f"Written: limits in {args.file}"):
        out.show(Text(line))
    return 0


def _limit(symbol: str, text: str, pf: "ParameterFile") -> tuple[str, dict[str, Any]]:
    """Kind and section of one limit: a bound of a response, or a range of what the machine is set to."""
    from ..datasets.vocabulary import ROLES

    kind = RANGES.get(symbol) or _bounded(symbol)
    if kind is None:
        known = [*RANGES, *(s for s in ROLES if _bounded(s))]
        raise UsageError(f"limit {symbol}: there are limits of {', '.join(known)}{nearest(symbol, known)}.")
    usual = ROLES[symbol].unit
    found = re.fullmatch(rf"({NUMBER})(?::({NUMBER}))?\s*(\S.*)?", text)
    if found is None or (found[2] is not None) != (symbol in RANGES):
        shape = "low:high with a unit, V=50:200m/min" if symbol in RANGES else "one number with a unit, P=7kW"
        raise UsageError(f"limit {symbol}={text}: it is {shape}.")
    unit = _unit(symbol, found[3], usual)
    if symbol in RANGES:
        low, high = float(found[1]), float(found[2])
        if not 0 <= low < high:
            raise UsageError(f"limit {symbol}={text}: low lies below high, neither below zero.")
        return kind, {"low": low, "high": high, "unit": unit}
    value = float(found[1])
    if not value > 0:
        raise UsageError(f"limit {symbol}={text}: it lies above zero.")
    if symbol not in pf.laws:
        held = ", ".join(pf.laws) or "nothing"
        raise UsageError(f"limit {symbol}: the file holds laws of {held}, so nothing would keep to it.")
    return kind, {"value": value, "unit": unit, "of": symbol}


def _bounded(symbol: str) -> str | None:
    """Power, force or wear, by what the symbol stands for."""
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
    if not is_unit(given) or not same_dimension(given, usual):
        raise UsageError(f"limit {symbol} in {given}: that is no unit of it; {usual}, say.")
    return given


def _words(section: dict[str, Any]) -> list[str]:
    said = []
    for name, limit in section.items():
        if limit is None:
            continue
        what = name.replace("_", " ")
        if "value" in limit:
            of = f" {limit['of']}" if limit.get("of") else ""
            said.append(f"{what.capitalize()}{of} at most {limit['value']:g} {limit['unit']}.")
        else:
            said.append(f"{what.capitalize()} from {limit['low']:g} to {limit['high']:g} {limit['unit']}.")
    return said
