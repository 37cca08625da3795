"""Units as powers of SI base units and a factor, as FMI and SSP declare them.

A revolution is 2 pi rad, as FMI has it; teeth are counted. Hardness and powers of a law have no such form.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...datasets.units import canonical, convert, same_dimension

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
class Si:
    """A unit: ``factor`` times the SI base units, each to its power."""

    powers: tuple[tuple[str, int], ...]
    factor: float


@lru_cache(maxsize=256)
def si(unit: str) -> Si | None:
    """A unit in SI, None where it has no such form; quotients such as ``(mm/min)/A/s`` are taken apart.

    >>> si("mm/min"), si("(mm/min)/A").powers, si("HRC")
    (Si(powers=(('m', 1), ('s', -1)), factor=1.6666666666666667e-05), (('m', 1), ('s', -1), ('A', -1)), None)
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
    found = [si(_bare(part)) for part in parts]
    return None if None in found else _divided([part for part in found if part is not None])


def _atom(unit: str) -> Si | None:
    known = canonical(unit)
    if known is None:
        return None
    for reference, (powers, factor) in _OF.items():
        if same_dimension(known, reference):
            return Si(tuple(powers.items()), float(convert(np.array(1.0), known, reference)) * factor)
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
    """The parts between the strokes that stand in no parenthesis."""
    parts = [""]
    for c, depth in zip(unit, _depths(unit), strict=True):
        if c == "/" and depth == 0:
            parts.append("")
        else:
            parts[-1] += c
    return parts


def _divided(parts: list[Si]) -> Si:
    powers, factor = dict(parts[0].powers), parts[0].factor
    for part in parts[1:]:
        factor /= part.factor
        for base, power in part.powers:
            powers[base] = powers.get(base, 0) - power
    return Si(tuple((base, power) for base, power in powers.items() if power), factor)
