"""``fitmodels costs``: rates, prices and times of a part, written into a parameter file."""

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import UsageError
from ..core.suggestions import did_you_mean
from ..core.text import printable
from .arguments import Parser, parameter_file, traced
from .numbers import NUMBER, pairs
from .output import output_options, print_json, print_lines

if TYPE_CHECKING:
    from ..parameters.sections.costs import CostsSection

PRICES = ("edge", "insert", "failure")
RATES = ("machine", "labour")  # per hour in the file
TIMES = ("change", "handling")  # min in the file
CUT = {"volume": "cm3", "length": "mm", "diameter": "mm"}
KNOWN = (*RATES, *PRICES, "edges", *TIMES, "energy", "efficiency", *CUT, "currency")
VOLUMES = {"cm3": 1.0, "mm3": 1e-3, "in3": 16.387064, "cm³": 1.0, "mm³": 1e-3, "in³": 16.387064}  # in cm3
HOURS = {"h": 1.0, "min": 60.0, "s": 3600.0}  # of an hour
EXAMPLE = "machine=60/h edge=8 change=1.5min handling=2min volume=120cm3 currency=EUR"


def parser() -> Parser:
    """Arguments of ``fitmodels costs``."""
    p = Parser(
        "fitmodels costs",
        f"fitmodels costs params.json {EXAMPLE}",
        "Write the costs of a part into a parameter file: rates of machine and labour (machine=60/h), price of an\n"
        "edge (edge=8) or of an insert with its edges (insert=16 edges=4), times of a change and of handling\n"
        "(change=1.5min), the cut of a part (volume=120cm3, or length=500mm diameter=100mm), energy=0.30/kWh,\n"
        "efficiency=0.8, and the cost of a failed edge beyond its change (failure=40). `fitmodels optimum` computes\n"
        "with them.",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json")
    p.add_argument("costs", nargs="+", metavar="machine=60/h", help=f"one of {', '.join(KNOWN)}, with its unit")
    p.add_argument("--force", action="store_true", help="replace costs in the file")
    output_options(p, "print the section as JSON (fitmodels.costs/1)")
    return p


def run(args: argparse.Namespace) -> int:
    """Write and print the costs, and return the exit code."""
    from .. import parameters
    from ..parameters.file import sealed

    pf = parameter_file(args.file, writes=True)
    given = pairs(args.costs, "cost", "machine=60/h")
    for name in given:
        if name not in KNOWN:
            raise UsageError(f"cost {name}: there is no such cost. {did_you_mean(name, KNOWN, 0.6)}")
    held = {} if pf.costs is None else {k: v for k, v in pf.costs.model_dump().items() if v is not None}
    new, currencies = _numbers(given)
    new["currency"] = _currency(currencies, given.get("currency"), held.get("currency"))
    _require_partners(held, new)
    twice = [name for name in new if name in held and held[name] != new[name]]
    if twice and not args.force:
        raise UsageError(f"{args.file} has costs of {', '.join(twice)}; replace them with --force.")
    section = _section({**_kept(held, new), **new})
    changed = sealed(pf, costs=section, provenance=traced(pf, args.words))
    parameters.write(changed, args.file, replaces=pf)
    if args.json:
        print_json("costs", {"file": Path(args.file).name, "costs": section.model_dump()})
    elif args.quiet:
        print(printable(args.file))  # noqa: T201
    else:
        print_lines([*_sentences(section), f"Written: costs in {args.file}"])
    return 0


def _kept(held: dict[str, Any], new: dict[str, Any]) -> dict[str, Any]:
    """Former costs; the price of an edge and that of an insert replace each other."""
    dropped = {"edge"} if "insert" in new else {"insert", "edges"} if "edge" in new else set()
    return {name: value for name, value in held.items() if name not in dropped}


def _require_partners(held: dict[str, Any], new: dict[str, Any]) -> None:
    """Refuse a price or a size that says nothing without a second one, and name that."""
    of_part = new.get("cut", {})
    needs = [
        ("insert", "edges", new, {**held, **new}, "the number of its edges", "edges=4"),
        ("edges", "insert", new, {**held, **new}, "the price of the insert", "insert=16"),
        ("length", "diameter", of_part, of_part, "the diameter of the part", "diameter=100mm"),
        ("diameter", "length", of_part, of_part, "the length of the part", "length=500mm"),
    ]
    for name, partner, given, known, what, example in needs:
        if name in given and partner not in known:
            raise UsageError(f"cost {name}={given[name]:g}: {what} is missing; add {example}.")


def _section(data: dict[str, Any]) -> "CostsSection":
    from pydantic import ValidationError

    from ..parameters.messages import schema_message
    from ..parameters.sections.costs import CostsSection

    missing = [name for name in ("machine", "change") if name not in data]
    if missing:
        examples = {"machine": "machine=60/h", "change": "change=1.5min"}
        raise UsageError(f"costs: {' and '.join(missing)} missing; add {' '.join(examples[m] for m in missing)}.")
    try:
        return CostsSection.model_validate(data)
    except ValidationError as error:
        raise UsageError(f"costs: {schema_message(error, data)}.") from None


def _numbers(given: dict[str, str]) -> tuple[dict[str, Any], set[str]]:
    """Values in the units of the section, and the currencies that prices name."""
    found: dict[str, Any] = {}
    cut: dict[str, float] = {}
    currencies: set[str] = set()
    for name, text in given.items():
        if name == "currency":
            continue
        number, unit = _split(name, text)
        if name == "volume":
            cut[name] = _volume(text, number, unit)
        elif name in CUT:
            cut[name] = _converted(name, text, number, unit, CUT[name])
        elif name in TIMES:
            found[name] = _converted(name, text, number, unit, "min")
        elif name in ("edges", "efficiency"):
            found[name] = _bare(name, text, number, unit)
        else:
            found[name], currency = _price(name, text, number, unit)
            currencies |= {currency} - {""}
    return {**found, **({"cut": cut} if cut else {})}, currencies


def _split(name: str, text: str) -> tuple[float, str]:
    """Number and unit; a sign of a currency may stand before the number."""
    found = re.fullmatch(rf"([€$£¥]?)\s*+((?![+-]){NUMBER})\s*+(.*)", text.strip())
    if found is None or found[3].startswith(","):
        raise UsageError(f"cost {name}={text}: give a number of zero or more with a decimal point, and its unit.")
    return float(found[2]), found[1] + found[3].strip()


def _converted(name: str, text: str, number: float, unit: str, to: str) -> float:
    from ..datasets.units import convert, is_unit, same_dimension

    if not unit:
        raise UsageError(f"cost {name}={text}: the unit is missing; give it as {name}={number:g}{to}.")
    if not is_unit(unit) or not same_dimension(unit, to):
        raise UsageError(f"cost {name}={text}: {unit} is not a unit of {name}; give it in {to}.")
    import numpy as np

    return float(convert(np.array([number]), unit, to)[0])


def _volume(text: str, number: float, unit: str) -> float:
    """A volume in cm3."""
    if unit not in VOLUMES:
        raise UsageError(f"cost volume={text}: give it in one of {', '.join(VOLUMES)}, as volume={number:g}cm3.")
    return number * VOLUMES[unit]


def _bare(name: str, text: str, number: float, unit: str) -> float | int:
    if name == "efficiency" and unit == "%":
        return number / 100
    if unit:
        raise UsageError(f"cost {name}={text}: give a number without a unit.")
    if name == "edges":
        if number != int(number) or number < 1:
            raise UsageError(f"cost {name}={text}: give the number of edges of an insert, 1 or more.")
        return int(number)
    return number


def _price(name: str, text: str, number: float, unit: str) -> tuple[float, str]:
    """A price, or a rate per hour, with the currency it names."""
    currency, slash, per = unit.partition("/")
    wanted = "kWh" if name == "energy" else "h or /min" if name in RATES else ""
    if name in RATES:
        if per not in HOURS:
            raise UsageError(f"cost {name}={text}: give the rate per time, as {name}={number:g}/h or /min.")
        number *= HOURS[per]
    elif (per != wanted) or (slash and not wanted):
        shape = f"{name}={number:g}/{wanted}" if wanted else f"{name}={number:g}"
        raise UsageError(f"cost {name}={text}: give it as {shape}.")
    return number, currency.strip()


def _currency(named: set[str], stated: str | None, held: str | None) -> str:
    """The one currency of all prices."""
    every = {*named, *({stated} if stated else ())}
    if len(every) > 1:
        raise UsageError(f"costs in {' and '.join(sorted(every))}: give all prices in one currency.")
    found = next(iter(every), held)
    if found is None:
        raise UsageError("the currency is missing; add for instance currency=EUR.")
    return found


def _sentences(section: "CostsSection") -> list[str]:
    c = section.currency
    price = f"{section.price_of_edge:g} {c} an edge"
    if section.insert is not None:
        price = f"{section.insert:g} {c} an insert of {section.edges} edges: {price}"
    lines = [
        f"Machine {section.machine:g} {c}/h, labour {section.labour:g} {c}/h: {section.per_minute:g} {c} per min.",
        f"{price}; change {section.change:g} min; handling {section.handling:g} min.",
    ]
    cut = section.cut
    if cut is None:
        lines.append("Costs are of 1 cm3; for those of a part give its volume, or its length and diameter.")
    elif cut.volume is not None:
        lines.append(f"Cut of one part {cut.volume:g} cm3.")
    else:
        lines.append(f"Cut of one part {cut.length:g} mm long at diameter {cut.diameter:g} mm, one pass.")
    if section.energy is not None:
        eta = (
            "an efficiency of 1, assumed" if section.efficiency is None else f"an efficiency of {section.efficiency:g}"
        )
        lines.append(f"Energy {section.energy:g} {c}/kWh, with {eta}.")
    if section.failure is not None:
        lines.append(f"A failed edge costs {section.failure:g} {c} beyond its change.")
    return lines
