"""Plausible ranges of the quantities of cutting tests by process, and the units in which laboratories keep them.

Three ranges a quantity: usual, unusual beyond, and impossible beyond. Roughness is from a published table of surface
finish; the others are the judgement of the compiler, from criteria and machines in use: outside "usual" they give
a sentence, and only beyond the outer range a refusal. ISO 3685 ends a test at VB .3 mm (mean) or .6 mm (largest).
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

from ..options import Process
from ..vocabulary import ROLES, WEAR

Range = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Plausible:
    """Ranges of a quantity in the unit of its role: usual, outside of ``unusual`` doubted, outside of ``hard`` refused.

    >>> plausible("V", "turning").usual
    (20, 600)
    """

    usual: Range
    unusual: Range
    hard: Range


def _row(usual_low: float, usual_high: float, low: float, high: float, least: float, most: float) -> Plausible:
    return Plausible((usual_low, usual_high), (low, high), (least, most))


_FORCE = {
    "turning": _row(5, 5000, 0.5, 20000, 0, 1e6),
    "milling": _row(1, 5000, 0.05, 20000, 0, 1e6),
    "drilling": _row(10, 10000, 0.5, 30000, 0, 1e6),
    "grinding": _row(1, 2000, 0.05, 20000, 0, 1e6),
}
_DIAMETER = {"any": _row(1, 1000, 0.05, 5000, 0, 30000)}
MOST_WEAR = 5.0  # mm
_WEAR = {"any": _row(0.02, 0.6, 0.01, 1, 0, MOST_WEAR), "grinding": _row(0.001, 0.6, 0.0002, 1, 0, MOST_WEAR)}
KC = _row(500, 6000, 250, 15000, 100, 30000)  # N/mm2, steel and cast iron to hard metals and small chips
_TIME = {"any": _row(0.2, 120, 0.02, 600, 0, 1e5)}
FORCES = ("Fx", "Fy", "Fz", "Fxz", "Fc", "Ff", "Fp", "F")

_TABLE: dict[str, dict[str, Plausible]] = {
    # m/min. High-speed steel 12 to 120, carbide to 270 uncoated and 600 coated; ceramic more
    "V": {
        "turning": _row(20, 600, 5, 1000, 0, 12000),
        "milling": _row(12, 1500, 4, 3000, 0, 12000),
        "drilling": _row(8, 250, 3, 1000, 0, 12000),
        "grinding": _row(1200, 3600, 300, 7200, 0, 30000),
    },
    # mm/rev; per revolution of a cutter with many teeth it is larger than in turning
    "f": {
        "turning": _row(0.05, 0.8, 0.01, 1.5, 0, 10),
        "milling": _row(0.02, 4, 0.003, 10, 0, 40),
        "drilling": _row(0.02, 0.6, 0.005, 1.5, 0, 10),
    },
    "fz": {"any": _row(0.01, 0.4, 0.002, 1, 0, 5)},  # mm/tooth
    "fm": {"any": _row(10, 10000, 1, 40000, 0, 2e5), "turning": _row(5, 2000, 1, 20000, 0, 2e5)},  # mm/min
    "d": {
        "turning": _row(0.1, 6, 0.01, 12, 0, 100),
        "milling": _row(0.05, 30, 0.01, 60, 0, 500),
        "drilling": _row(0.5, 40, 0.05, 60, 0, 500),
        "grinding": _row(0.001, 0.05, 0.0001, 12, 0, 50),
    },
    "ae": {"any": _row(0.05, 160, 0.005, 320, 0, 1000)},  # mm
    "n": {
        "turning": _row(20, 6000, 5, 60000, 0, 400000),
        "milling": _row(100, 40000, 10, 120000, 0, 400000),
        "drilling": _row(50, 30000, 5, 120000, 0, 400000),
        "grinding": _row(500, 60000, 50, 200000, 0, 400000),
    },
    "t": _TIME,
    "T": {"any": _row(0.5, 600, 0.02, 6000, 0, 1e6)},
    "D": _DIAMETER,
    "Dc": _DIAMETER,
    "re": {"any": _row(0.1, 3.2, 0.02, 20, 0, 200)},  # mm
    "theta": {"any": _row(80, 1200, 35, 1500, -200, 3000)},  # degC, at the edge or in the work near it
    **dict.fromkeys(WEAR, _WEAR),
    **dict.fromkeys(FORCES, _FORCE),
    "P": {
        "turning": _row(0.05, 30, 0.005, 100, 0, 2000),
        "milling": _row(0.01, 50, 0.001, 100, 0, 2000),
        "drilling": _row(0.05, 20, 0.002, 100, 0, 2000),
        "grinding": _row(0.1, 40, 0.01, 100, 0, 2000),
    },
    "M": {
        "turning": _row(1, 500, 0.05, 2000, 0, 1e5),
        "milling": _row(0.005, 300, 0.0005, 2000, 0, 1e5),
        "drilling": _row(0.05, 200, 0.002, 2000, 0, 1e5),
    },
    "I": {"any": _row(0.05, 60, 0.005, 200, 0, 5000)},
    # um. Usual finish of the process; diamond turning from .1
    "Ra": {
        "turning": _row(0.1, 12.5, 0.02, 50, 0, 500),
        "milling": _row(0.1, 12.5, 0.02, 50, 0, 500),
        "drilling": _row(0.4, 12.5, 0.1, 50, 0, 500),
        "grinding": _row(0.05, 3.2, 0.005, 12.5, 0, 500),
    },
    "Rz": {"any": _row(0.5, 60, 0.1, 200, 0, 2500)},
}

# Units in which the quantity is kept, from the likely to the rare; the unit of the role itself comes first.
_UNITS: dict[str, tuple[str, ...]] = {
    "V": ("m/min", "sfm", "m/s", "mm/min"),
    "f": ("mm/rev", "in/rev", "um/rev"),
    "fz": ("mm/tooth", "in/tooth", "um/tooth"),
    "fm": ("mm/min", "in/min", "mm/s", "m/min"),
    "d": ("mm", "in", "um"),
    "ae": ("mm", "in", "um"),
    "n": ("1/min", "rev/s"),
    "t": ("min", "s", "h", "ms"),
    "T": ("min", "s", "h"),
    **dict.fromkeys(("D", "Dc"), ("mm", "in", "m")),
    "re": ("mm", "in"),
    "theta": ("degC", "degF", "K"),
    "lf": ("mm", "m", "in"),
    **dict.fromkeys(WEAR, ("mm", "um", "in", "mil")),
    **dict.fromkeys(FORCES, ("N", "kN", "lbf", "daN")),
    "P": ("kW", "W", "hp"),
    "M": ("Nm", "Nmm", "Ncm", "in lbf"),
    "I": ("A", "mA"),
    "Ra": ("um", "uin", "mm"),
    "Rz": ("um", "uin", "mm"),
}
INCH = frozenset(("sfm", "in/rev", "in/tooth", "in/min", "in", "mil", "uin", "lbf", "in lbf", "ft lbf", "in3/min"))
_WORDS: dict[Process, str] = {
    "milling": r"\bmilling\b|\b(?:end|face|slot) mill|\bfräsen\b|\bfraisage\b|\bfresado\b",
    "turning": r"\bturning\b|\blathe\b|\bdrehen\b|\bdrehmaschine\b|\blängsdrehen\b|\btournage\b|\btorneado\b",
    "drilling": r"\bdrill(?:ing|s|ed)?\b|\bbohren\b|\bbohrer|\bforet\b|\bbroca\b|\bperçage\b|\btaladrado\b",
    "grinding": r"\bgrinding\b|\bschleifen\b|\brectificado\b",
}


@lru_cache(maxsize=256)
def plausible(role: str, process: Process | None) -> Plausible | None:
    """Ranges of a role in a process, None where none are listed.

    For an unknown process they cover turning and milling; the feed per revolution is that of turning, since tables of
    milling state it per tooth or per minute.

    >>> plausible("V", None).usual, plausible("edge", None)
    ((12, 1500), None)
    """
    rows = _TABLE.get(role)
    if rows is None:
        return None
    if process is not None:
        return rows.get(process, rows.get("any"))
    if role == "f":
        return rows["turning"]
    return _union([rows[one] for one in ("any", "turning", "milling") if one in rows])


def widest(role: str) -> Plausible:
    """Ranges of a role that cover every process."""
    return _union(_TABLE[role].values())


def _union(rows: Iterable[Plausible]) -> Plausible:
    def cover(ranges: list[Range]) -> Range:
        return min(low for low, _ in ranges), max(high for _, high in ranges)

    rows = list(rows)
    return Plausible(*(cover([getattr(row, name) for row in rows]) for name in ("usual", "unusual", "hard")))


def candidate_units(role: str) -> tuple[str, ...]:
    """Units in which laboratories keep a quantity, that of the role first.

    >>> candidate_units("VB")
    ('mm', 'um', 'in', 'mil')
    """
    return _UNITS.get(role, (ROLES[role].unit,))


@lru_cache(maxsize=64)  # each step of a reading asks
def _named_in(text: str) -> tuple[Process, ...]:
    folded = text.casefold()
    return tuple(process for process, words in _WORDS.items() if re.search(words, folded))


def process_of(roles: Iterable[str], texts: Iterable[str]) -> Process | None:
    """Process that the roles of a table or its texts name, None where they name none or several.

    >>> process_of(("V", "fz", "ae"), ()), process_of(("V",), ("machine: lathe",)), process_of(("V", "f"), ())
    ('milling', 'turning', None)
    """
    roles, named = frozenset(roles), _named_in("\n".join(texts))
    if len(named) == 1:
        return named[0]
    if not named and not {"fz", "ae", "z"}.isdisjoint(roles):
        return "milling"
    thrust = {"Fxz", "Ff"} & roles
    if not named and thrust and "M" in roles and not {"Fc", "Fp", "Fx", "Fz", "d"} & roles:  # torque and thrust
        return "drilling"
    if not named and not {"Ff", "Fp"}.isdisjoint(roles):
        return "turning"
    return None
