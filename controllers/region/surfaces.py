"""Laws of any form over ln V and ln f, and the limits on them, which are curves there.

Only a power law is a plane in ln V and ln f (`log_planes`). Every other form is evaluated from its section of the
parameter file, with the wear put in from its own law, and is limited to the tested region of that law: a polynomial
in particular states nothing beyond its tests.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import log
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from ...core.arrays import Array
from ...core.display import Displayable
from ...core.errors import UsageError
from ...datasets import region as tested_region
from ...parameters.evaluation import Equation, equation_of
from .half_planes import HalfPlane, ValueLimit
from .log_planes import USUAL, CutSetting, LogPlane, known_value, need_speed_and_feed, plane, ratio, with_wear

if TYPE_CHECKING:
    from ...parameters import LawSection, ParameterFile
    from ...parameters.sections.law_parts import Factor

MARGIN = 1e-8  # coded: a point on this limit lies in the region after rounding too
FAR = 1e6  # coded: stands for the excess of a point with a factor that has no logarithm
USUAL_PAIR = ("V", "f")
LEAST = 1e-12  # share of a limit that stands for a response at or below zero, which has no logarithm


@dataclass(frozen=True, slots=True, repr=False)
class LawSurface(Displayable):
    """A law of any form over ln V and ln f at a setting.

    Attributes
    ----------
    law : LawSection
    setting : CutSetting
        Depth, time, level, further factors.
    equation : Equation
        Of the law at the level.
    wear : LogPlane, LawSurface or None
        The wear that the law takes from its own law; None where it has none or the setting gives it.
    """

    law: "LawSection"
    setting: CutSetting
    equation: Equation
    wear: "LogPlane | LawSurface | None" = None

    @property
    def response(self) -> str:
        """Symbol of the response."""
        return self.law.response

    @property
    def quantity(self) -> str:
        """The response in words."""
        return self.law.quantity

    @property
    def unit(self) -> str:
        """Unit of the response."""
        return self.law.unit

    @property
    def wear_place(self) -> int | None:
        """Number of the factor that is the wear of its own law; None without one."""
        symbols = [factor.symbol for factor in self.law.factors]
        return None if self.wear is None else symbols.index(self.wear.response)

    def points(self, x: Array) -> Array:
        """Factors at points (..., 2) of ln V and ln f, shape (..., k), in the units of the law."""
        columns = [np.broadcast_to(self._values(factor, x), x.shape[:-1]) for factor in self.law.factors]
        return np.stack(columns, axis=-1)

    def _values(self, factor: "Factor", x: Array) -> Array | float:
        if factor.symbol in USUAL_PAIR:
            return np.exp(x[..., USUAL_PAIR.index(factor.symbol)]) * ratio(USUAL[factor.symbol], factor.unit)
        if self.wear is not None and factor.symbol == self.wear.response:
            return self.wear.value(x) * ratio(self.wear.unit, factor.unit)
        return known_value(self.law, factor.symbol, factor.unit, self.setting)

    def value(self, x: Array) -> Array:
        """The response at points (..., 2) of ln V and ln f, in its unit; what is not finite stays so."""
        return self.equation.values(self.points(x))


Surface = LogPlane | LawSurface


@dataclass(frozen=True, slots=True, repr=False)
class CurvedLimit(ValueLimit):
    """One limit on a law that is no plane in ln V and ln f.

    Attributes
    ----------
    symbol, unit : str
    side : {"most", "least"}
    value : float
        In ``unit``.
    surface : LogPlane or LawSurface
    allowed : float
        The value in the unit of the surface.
    """

    surface: Surface
    allowed: float

    def beyond(self, x: Array) -> Array:
        """Excess of points over the limit, in logarithms: (..., 2) -> (...,); negative is within."""
        share = self.surface.value(x) / self.allowed
        ln = np.log(np.clip(share, LEAST, 1 / LEAST))
        return np.asarray(np.where(np.isfinite(share), ln if self.side == "most" else -ln, FAR))

    def parts(self, x: Array) -> Array:
        """`beyond` as smooth functions, shape (..., 1)."""
        return self.beyond(x)[..., None]


@dataclass(frozen=True, slots=True, repr=False)
class RegionLimit(Displayable):
    """The tested region of a law: range, radius and leverage, as the parameter file holds them.

    Attributes
    ----------
    surface : LawSurface
    facts : mapping or None
        The region of the file, None where it has only the ranges of the factors.
    """

    surface: LawSurface
    facts: Mapping[str, Any] | None

    @property
    def symbol(self) -> str:
        """No response: the limit is of the tests."""
        return ""

    @property
    def name(self) -> str:
        """Short: ``tested region of P``."""
        return f"tested region of {self.surface.response}"

    @property
    def words(self) -> str:
        """The limit as a phrase."""
        return f"the tested region of {self.surface.response}"

    def beyond(self, x: Array) -> Array:
        """Excess of points over the region, coded: (..., 2) -> (...,); negative is within."""
        return np.asarray(self.parts(x).max(axis=-1))

    def parts(self, x: Array) -> Array:
        """Excess over each range, the largest radius and the largest leverage, shape (..., parts)."""
        law, points = self.surface.law, self.surface.points(x)
        if self.facts is not None:
            with np.errstate(all="ignore"):
                over = tested_region.excess(self.facts, points, self.surface.setting.by)
            return np.asarray(np.where(np.isfinite(over), over, FAR) + MARGIN)
        low, high = (np.array([getattr(f, end) for f in law.factors]) for end in ("low", "high"))
        half = np.where(high > low, (high - low) / 2, np.maximum(np.abs(high), 1e-300))
        return np.asarray(np.abs(points - (low + high) / 2) / half - np.where(high > low, 1 - MARGIN, MARGIN))


def surface_of(law: "LawSection", setting: CutSetting, wear: Surface | None = None) -> Surface:
    """A law over ln V and ln f: a plane where it and its wear are power laws.

    Raises
    ------
    UsageError
        The law is on another speed or feed than V and f, or the value of a factor is unknown.
    """
    of_wear = wear is not None and wear.response not in setting.at and _has(law, wear.response)
    if law.form == "power" and not of_wear:
        return plane(law, setting)
    if law.form == "power" and isinstance(wear, LogPlane):
        return with_wear(plane(law, setting, wear), wear)
    need_speed_and_feed(law)
    held = law.by
    if held is not None and setting.by not in (held.reference, *held.shifts):
        levels = ", ".join((held.reference, *held.shifts))
        raise UsageError(f"the law of {law.response} is by {held.column}: give by=, one of {levels}.")
    by = None if held is None else setting.by
    made = LawSurface(law, setting, equation_of(law, by), wear if of_wear else None)
    made.points(np.zeros(2))  # raises here where a factor is unknown
    return made


def law_surfaces(
    pf: "ParameterFile", responses: tuple[str, ...], setting: CutSetting, wear: "LawSection | None"
) -> dict[str, Surface]:
    """The requested responses, and the wear, over V and f alone."""
    own = {} if wear is None else {wear.response: surface_of(wear, setting)}
    worn = None if wear is None else own[wear.response]
    for name in responses:
        if name not in own:
            own[name] = surface_of(pf.laws[name], setting, worn)
    return own


class ResponseBound(NamedTuple):
    """The largest or smallest value allowed of a response, in a unit of its dimension."""

    symbol: str
    side: Literal["most", "least"]
    value: float
    unit: str


def limits_on(bounds: Sequence[ResponseBound], over: Mapping[str, Surface]) -> tuple[HalfPlane | CurvedLimit, ...]:
    """Limit of each response, labelled in its own unit: a half plane on a plane, else a curve."""
    out: list[HalfPlane | CurvedLimit] = []
    for name, side, value, unit in bounds:
        surface = over[name]
        allowed = value * ratio(unit, surface.unit)
        if isinstance(surface, LawSurface):
            out.append(CurvedLimit(name, unit, side, value, surface, allowed))
            continue
        sign = 1.0 if side == "most" else -1.0
        a = (sign * float(surface.slopes[0]), sign * float(surface.slopes[1]))
        out.append(HalfPlane(name, unit, side, value, a, sign * (log(allowed) - float(surface.intercept))))
    return tuple(out)


def tested_limits(bounds: Sequence[ResponseBound], over: Mapping[str, Surface]) -> tuple[RegionLimit, ...]:
    """The tested region of each limited law, and of the wear in it, that is no power law."""
    found: dict[str, RegionLimit] = {}
    for bound in bounds:
        surface: Surface | None = over[bound.symbol]
        while isinstance(surface, LawSurface):
            if surface.law.form != "power":
                region = surface.law.region
                facts = None if region is None else region.model_dump()
                found.setdefault(surface.response, RegionLimit(surface, facts))
            surface = surface.wear
    return tuple(found.values())


def _has(law: "LawSection", symbol: str) -> bool:
    return any(factor.symbol == symbol for factor in law.factors)
