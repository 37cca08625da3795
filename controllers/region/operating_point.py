"""Operating points (pairs of V and f) with their responses, and the corners of a region."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from string import ascii_uppercase

import numpy as np

from ...core.arrays import Array
from ...core.display import Displayable
from .curved import Limit, gradient
from .half_planes import SAME, TOUCH
from .log_planes import LogPlane
from .surfaces import RegionLimit, Surface


@dataclass(frozen=True, slots=True, repr=False)
class OperatingPoint(Displayable):
    """A pair of cutting speed and feed at the depth and time of its region.

    Attributes
    ----------
    V, f : float
        m/min and mm/rev.
    MRR : float
        Metal removal rate ``1000 V f d``, mm3/min.
    values, units : dict
        Each response by its symbol: ``P``, ``Fxz``, ``AW``; the median of a law whose errors multiply.
    wear_rate : float or None
        ``dAW/dt = h AW / t`` with h the exponent of t in the wear law, um/min; None without a law of wear over t.
    held_by, exceeds : tuple of str
        Limits that are active at the point, and that it exceeds.
    tested : bool
        Whether the point lies in the tested ranges of every law.
    probability : float or None
        Of keeping the limits of power, force and wear, where it was computed.

    Examples
    --------
    >>> OperatingPoint(150.0, 0.5, 187500.0, {"P": 6.5}, {"P": "kW"}, None, (), (), True).words
    'V 150 m/min, f 0.5 mm/rev: MRR 187500 mm3/min, P 6.50 kW'
    """

    V: float
    f: float
    MRR: float
    values: Mapping[str, float]
    units: Mapping[str, str]
    wear_rate: float | None
    held_by: tuple[str, ...]
    exceeds: tuple[str, ...]
    tested: bool
    probability: float | None = None

    @property
    def words(self) -> str:
        """The point with its responses as text."""
        parts = [f"{name} {three(value)} {self.units[name]}" for name, value in self.values.items()]
        if self.wear_rate is not None:
            parts.append(f"wear rate {three(self.wear_rate)} um/min")
        return ", ".join([f"{self.where}: MRR {self.MRR:.0f} mm3/min", *parts])

    @property
    def where(self) -> str:
        """The pair of V and f as text."""
        return f"V {four(self.V)} m/min, f {four(self.f)} mm/rev"

    @property
    def xy(self) -> tuple[float, float]:
        """(V, f)."""
        return self.V, self.f

    def facts(self) -> dict[str, object]:
        """JSON-compatible values; each name contains its unit."""
        return {
            "V_m_min": self.V,
            "f_mm_rev": self.f,
            "MRR_mm3_min": self.MRR,
            "responses": {name: {"value": v, "unit": self.units[name]} for name, v in self.values.items()},
            "wear_rate_um_min": self.wear_rate,
            "held_by": list(self.held_by),
            "exceeds": list(self.exceeds),
            "tested": self.tested,
            "probability": self.probability,
        }


def four(value: float) -> str:
    """A setting to at most four significant digits."""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"


def three(value: float) -> str:
    """A prediction to three significant digits."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:#.3g}"


def ln(V: float, f: float) -> Array:
    """(ln V, ln f)."""
    return np.log(np.array([V, f], dtype=np.float64))


def plain(ln_value: float) -> float:
    """Exponential of a logarithm, rounded to 12 digits: 200, not 199.99999999999991."""
    return float(f"{np.exp(ln_value):.12g}")


@dataclass(frozen=True, slots=True, repr=False)
class Corner(Displayable):
    """A corner of the region: ``V`` m/min, ``f`` mm/rev, and ``limits``, the two (or more) that meet there."""

    letter: str
    V: float
    f: float
    limits: tuple[str, ...]


def best_corner(polygon: Array, wear: Surface | None) -> int:
    """Index of the corner with the greatest MRR; of equals, the one of least wear, or else of least speed."""
    removed = polygon.sum(axis=1)
    alike = np.flatnonzero(removed >= removed.max() - TOUCH)
    if wear is None:
        cost = polygon[alike, 0]
    else:
        cost = polygon[alike] @ wear.slopes if isinstance(wear, LogPlane) else wear.value(polygon[alike])
    return int(alike[np.argmin(cost)])


def start_at_best(polygon: Array, wear: Surface | None) -> Array:
    """Corners clockwise, rotated so that the best is the second."""
    if len(polygon) < 2:
        return polygon
    return np.roll(polygon, 1 - best_corner(polygon, wear), axis=0)


def limit_names(limits: Sequence[Limit]) -> tuple[str, ...]:
    """Names of limits; laws of the same tests end together, and share a name: ``tested region of P and AW``."""
    ends = [each.surface.response for each in limits if isinstance(each, RegionLimit)]
    names = [each.name for each in limits if not isinstance(each, RegionLimit)]
    return (*names, *([f"tested region of {' and '.join(ends)}"] if ends else []))


def label_corners(polygon: Array, limits: tuple[Limit, ...]) -> tuple[Corner, ...]:
    """Corners of a region, A to Z, with all limits that meet in each."""
    out = []
    for letter, x in zip(ascii_uppercase, polygon, strict=False):
        meet = [each for each in limits if abs(float(each.beyond(x))) <= SAME]
        out.append(Corner(letter, plain(x[0]), plain(x[1]), limit_names(meet)))
    return tuple(out)


def sensitivities(x: Array, limits: tuple[Limit, ...]) -> dict[str, float]:
    """Gain in MRR, %, per 1 % of each limit active at the best pair: the multipliers of the programme.

    Empty unless exactly two limits meet, or one curve alone is active. The end of a tested region has no value to
    raise, and none is given for it.
    """
    meet = [each for each in limits if abs(float(each.beyond(x))) <= SAME]
    ends = [each for each in meet if isinstance(each, RegionLimit)]  # laws of the same tests end together
    meet = [each for each in meet if each not in ends[1:]]
    slopes = np.array([gradient(each, x) for each in meet])
    if len(meet) == 2:
        multipliers = np.linalg.solve(slopes.T, np.ones(2))
    elif len(meet) == 1:
        multipliers = slopes.sum(axis=1) / np.square(slopes).sum(axis=1)
    else:
        return {}
    shown = zip(meet, multipliers, strict=True)
    return {each.name: float(value) for each, value in shown if not isinstance(each, RegionLimit)}
