"""FMI: System Structure Parameter Values 1.0, every number as a Real with its unit declared in SI.

Schema: Modelica Association, System Structure and Parameterization 1.0 (2019), SystemStructureParameterValues.xsd. Its
``Unit`` needs the powers of SI base units; a unit without them would pass as a pure number, so it is not declared and
is given in the description only.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from html import escape

import numpy as np

from ...core.text import printable
from ...datasets.units import canonical, convert, same_dimension
from .quantities import Quantity
from .view import ExportView

# A unit of each dimension that `datasets.units` knows: its exponents and its factor to SI.
_OF: dict[str, tuple[dict[str, int], float]] = {
    "m": ({"m": 1}, 1.0),
    "s": ({"s": 1}, 1.0),
    "m/s": ({"m": 1, "s": -1}, 1.0),
    "mm2": ({"m": 2}, 1e-6),
    "mm3/s": ({"m": 3, "s": -1}, 1e-9),
    "N": ({"kg": 1, "m": 1, "s": -2}, 1.0),
    "Nm": ({"kg": 1, "m": 2, "s": -2}, 1.0),
    "W": ({"kg": 1, "m": 2, "s": -3}, 1.0),
    "MPa": ({"kg": 1, "m": -1, "s": -2}, 1e6),
    "A": ({"A": 1}, 1.0),
    "V": ({"kg": 1, "m": 2, "s": -3, "A": -1}, 1.0),
    "Hz": ({"s": -1}, 1.0),
    "rev/s": ({"rad": 1, "s": -1}, 2 * math.pi),
    "mm/rev": ({"m": 1, "rad": -1}, 1e-3 / (2 * math.pi)),
    "mm/tooth": ({"m": 1}, 1e-3),
    "deg": ({"rad": 1}, math.pi / 180),
    "1": ({}, 1.0),
}


@dataclass(frozen=True, slots=True)
class SiUnit:
    """A unit: ``factor`` times the SI base units, each to its power."""

    powers: tuple[tuple[str, int], ...]
    factor: float


@lru_cache(maxsize=256)
def si_unit(unit: str) -> SiUnit | None:
    """A unit in SI, None where it has no such form; quotients such as ``(mm/min)/A/s`` are taken apart.

    >>> si_unit("mm/min"), si_unit("(mm/min)/A").powers, si_unit("HRC")
    (SiUnit(powers=(('m', 1), ('s', -1)), factor=1.6666666666666667e-05), (('m', 1), ('s', -1), ('A', -1)), None)
    """
    depths = _depths(unit)
    if not unit.strip(" ()") or min(depths) < 0 or depths[-1]:
        return None
    whole = _atom(unit)
    if whole is not None:
        return whole
    parts = _quotient(_bare(unit))
    if len(parts) < 2:
        return None
    found = [si_unit(_bare(part)) for part in parts]
    return None if None in found else _divided([part for part in found if part is not None])


def _atom(unit: str) -> SiUnit | None:
    known = canonical(unit)
    if known is None:
        return None
    for reference, (powers, factor) in _OF.items():
        if same_dimension(known, reference):
            return SiUnit(tuple(powers.items()), float(convert(np.array(1.0), known, reference)) * factor)
    return None


def _bare(unit: str) -> str:
    """Without the parentheses round the whole."""
    unit = unit.strip()
    while unit.startswith("(") and unit.endswith(")") and _depths(unit)[1:-1].count(0) == 0:
        unit = unit[1:-1].strip()
    return unit


def _depths(unit: str) -> list[int]:
    """Parentheses open after each character but the last, which closes the outermost."""
    depth, out = 0, []
    for c in unit:
        depth += (c == "(") - (c == ")")
        out.append(depth)
    return out


def _quotient(unit: str) -> list[str]:
    """The parts between slashes outside of parentheses."""
    parts = [""]
    for c, depth in zip(unit, _depths(unit), strict=True):
        if c == "/" and depth == 0:
            parts.append("")
        else:
            parts[-1] += c
    return parts


def _divided(parts: list[SiUnit]) -> SiUnit:
    powers, factor = dict(parts[0].powers), parts[0].factor
    for part in parts[1:]:
        factor /= part.factor
        for base, power in part.powers:
            powers[base] = powers.get(base, 0) - power
    return SiUnit(tuple((base, power) for base, power in powers.items() if power), factor)


SSP = "http://ssp-standard.org/SSP1/SystemStructure"

NOT_IN_SSV = (
    "units that are no product of SI base units, such as HRC: they are given in the description",
    "the covariance, the posterior and text of the laws: a parameter set holds values",
    "the tie to a model's own parameter names: that is a mapping (.ssm), written for the model",
    "arrays: coefficients are single parameters",
)


def ssv_file(view: ExportView) -> str:
    """Content of the file with the parameter set."""
    units = {q.unit: found for q in view.quantities if (found := si_unit(q.unit)) is not None}
    head = f'name="{xml_text(view.name)}" version="1.0" generationTool="{xml_text(view.made_by)}"'
    return "\n".join([
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<ssv:ParameterSet xmlns:ssv="{SSP}ParameterValues" xmlns:ssc="{SSP}Common"',
        f'    {head}',
        f'    description="{xml_text("; ".join((*view.origin, *view.remarks(NOT_IN_SSV))))}">',
        "  <ssv:Parameters>",
        *(_parameter(q, q.unit in units) for q in view.quantities),
        "  </ssv:Parameters>",
        *_units(units),
        "</ssv:ParameterSet>",
        "",
    ])  # fmt: skip


def _parameter(quantity: Quantity, declared: bool) -> str:
    unit = f' unit="{xml_text(quantity.unit)}"' if declared else ""
    return (
        f'    <ssv:Parameter name="{quantity.name}" description="{xml_text(f"{quantity.words}, in {quantity.unit}")}">'
        f'<ssv:Real value="{quantity.value!r}"{unit}/></ssv:Parameter>'
    )


def _units(units: dict[str, SiUnit]) -> list[str]:
    if not units:
        return []
    return ["  <ssv:Units>", *(_unit(name, unit) for name, unit in units.items()), "  </ssv:Units>"]


def _unit(name: str, unit: SiUnit) -> str:
    powers = "".join(f' {base}="{power}"' for base, power in unit.powers)
    return f'    <ssc:Unit name="{xml_text(name)}"><ssc:BaseUnit{powers} factor="{unit.factor!r}"/></ssc:Unit>'


def xml_text(text: str) -> str:
    """A value between double quotes."""
    return escape(printable(text, "_").translate({9: " ", 10: " "}), quote=True)
