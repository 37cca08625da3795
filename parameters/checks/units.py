"""Units of a file: known, and of the kind that the quantity has."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from ...datasets.units import is_unit, same_dimension, suggest
from ...datasets.vocabulary import ROLES, fits
from ..errors import short, short_name
from .finding import FileFinding

if TYPE_CHECKING:
    from ..file import ParameterFile
    from ..sections.law import LawSection

KINDS = {  # of each limit: a unit of its kind
    "power": "kW",
    "force": "N",
    "wear": "mm",
    "feed": "mm/rev",
    "feed_rate": "mm/min",
    "speed": "m/min",
    "spindle_speed": "1/min",
}


class Stated(NamedTuple):
    """A unit in the file: where it stands, the unit, and a unit of the kind it must have, where that is known."""

    where: str
    unit: str
    kind: str | None


def units(pf: "ParameterFile") -> Iterator[FileFinding]:
    """A finding for each unit that is wrong, or one that all are right."""
    stated = [*_of_laws(pf), *_of_sections(pf)]
    complaints = [words for item in stated if (words := _complaint(item))]
    yield from (FileFinding("units", False, words) for words in complaints)
    if stated and not complaints:
        yield FileFinding("units", True, f"All {len(stated)} units are known and of the right kind.")
    silent = [item.where for item in stated if item.kind is None and not item.unit]
    if silent:
        yield FileFinding("units", None, f"No unit is stated for {', '.join(silent)}.")


def _of_laws(pf: "ParameterFile") -> Iterator[Stated]:
    for key, law in pf.laws.items():
        yield from _of_law(law, f"laws.{short_name(key)}")
    if pf.tool_life is not None:
        yield Stated("tool_life", pf.tool_life.unit, "min")
        yield Stated("tool_life (wear)", pf.tool_life.unit_of_wear, "mm")


def _of_law(law: "LawSection", where: str) -> Iterator[Stated]:
    for symbol, unit in ((law.response, law.unit), *((f.symbol, f.unit) for f in law.factors)):
        place = f"{where} ({short_name(symbol)})"
        if symbol in ROLES and ROLES[symbol].unit:
            yield Stated(place, unit, None if is_unit(unit) and fits(symbol, unit) else ROLES[symbol].unit)
        else:
            yield Stated(place, unit, None)


def _of_sections(pf: "ParameterFile") -> Iterator[Stated]:
    if pf.limits is not None:
        for name, kind in KINDS.items():
            if (bound := getattr(pf.limits, name)) is not None:
                yield Stated(f"limits.{name}", bound.unit, kind)
    if (line := pf.load_line) is not None:
        yield Stated("load_line (load)", line.unit_load, ROLES[line.load].unit if line.load in ROLES else None)
        yield Stated("load_line (feed)", line.unit_feed, "mm/min")
        yield Stated("load_line (wear)", line.unit_wear, "mm")
    if (rough := pf.roughness) is not None:
        yield Stated("roughness", rough.unit_roughness, "um")
        yield Stated("roughness (force)", rough.unit_force, "N")
        yield Stated("roughness (feed)", rough.unit_feed, "mm/rev")
    if (force := pf.adaptive_force) is not None:
        yield Stated("adaptive_force (force)", force.unit_force, "N")
        yield Stated("adaptive_force (depth)", force.unit_depth, "mm")
        yield Stated("adaptive_force (command)", force.unit_u, None)
    for name, section in (("dynamics", pf.dynamics), ("pi", pf.pi)):
        if section is not None:
            yield Stated(f"{name} (input)" if name == "dynamics" else "pi (command)", section.unit_u, None)
            yield Stated(f"{name} (output)" if name == "dynamics" else "pi (measurement)", section.unit_y, None)
    for sensor in pf.identity.sensors:
        yield Stated(f"identity.sensors ({short_name(sensor.symbol)})", sensor.unit, None)


def _complaint(item: Stated) -> str:
    if not item.unit and item.kind is None:
        return ""
    if not is_unit(item.unit):
        return f"{item.where}: the unit {short(item.unit)} is not known; {suggest(item.unit[:40])}"
    if item.kind is not None and not same_dimension(item.unit, item.kind):
        return f"{item.where}: the unit is {short(item.unit)}, which is not of the kind of {item.kind}."
    return ""
