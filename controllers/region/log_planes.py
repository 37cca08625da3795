"""Power laws as planes over ln V and ln f at a given depth and time, with the wear substituted from its own law.

``P = c V^a f^b d^g t^h AW^k`` with ``AW = c' V^a' ...`` is ``ln P = intercept + slopes . (ln V, ln f)`` (AC-2016, eq.
8-11, as corrected). The same arithmetic takes the parameters of one law, shape (p,), or draws of them, (S, p).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import log
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array, is_positive
from ...core.display import Displayable
from ...core.errors import UsageError
from ...datasets.units import canonical, convert
from ...datasets.vocabulary import FLANK_WEAR, ROLES
from .half_planes import SAME

if TYPE_CHECKING:
    from ...parameters import LawSection, ParameterFile


STAND_IN = {"n": ("V", "D=80"), "fz": ("f", "z=4"), "fm": ("f", "n=1000")}  # factors that stand for V and f in a law
USUAL = {symbol: ROLES[symbol].unit for symbol in ("V", "f", "d", "t")}


@dataclass(frozen=True, slots=True, repr=False)
class CutSetting(Displayable):
    """Factors that are fixed while V and f are chosen.

    Attributes
    ----------
    d, t : float
        Depth of cut, mm, and cutting time, min.
    by : str or None
        Level of the laws that have levels.
    at : mapping
        Further factors in the units of the laws; a wear given here replaces its law.

    Examples
    --------
    >>> CutSetting(d=2.5, t=10.0).known["t"]
    (10.0, 'min')
    """

    d: float
    t: float
    by: str | None = None
    at: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        for name, value in (("d", self.d), ("t", self.t), *self.at.items()):
            if not is_positive(value):
                raise UsageError(f"{name} = {value:g}: a power law needs a positive value.")

    @property
    def known(self) -> dict[str, tuple[float, str | None]]:
        """Value and unit by symbol; unit None: that of the law."""
        usual = {"d": (self.d, "mm"), "t": (self.t, "min")}
        return {**usual, **{name: (value, None) for name, value in self.at.items()}}


@dataclass(frozen=True, slots=True, repr=False)
class LogPlane(Displayable):
    """A response over the plane: ``ln R = intercept + slopes . (ln V, ln f) + wear_power ln(wear)``.

    Attributes
    ----------
    response, quantity, unit : str
    intercept, wear_power : ndarray, shape (...,)
    slopes : ndarray, shape (..., 2)
        One law, or one for each draw. ``wear_power`` is 0 once the wear is substituted.
    t_power : ndarray, shape (...,)
        Exponent of t in the law itself.
    """

    response: str
    quantity: str
    unit: str
    intercept: Array
    slopes: Array
    wear_power: Array
    t_power: Array

    def value(self, x: Array) -> Array:
        """The response of one law at points (..., 2) of ln V and ln f, in ``unit``."""
        return np.asarray(np.exp(self.intercept + x @ self.slopes))


def plane(
    law: "LawSection", setting: CutSetting, wear: "LawSection | LogPlane | None" = None, of: Array | None = None
) -> LogPlane:
    """A law in ln V and ln f, with the wear still a factor; ``of``: its parameters, (..., p), if not the file's.

    Raises
    ------
    UsageError
        The law is not a power law, is on another speed or feed than V and f, or the value of a factor is unknown.
    """
    if law.form != "power":
        raise UsageError(f"the law of {law.response} is {law.form.replace('_', ' ')}: a region needs power laws.")
    need_speed_and_feed(law)
    of = law.theta if of is None else of
    places = dict(zip(law.parameter_names, np.moveaxis(of, -1, 0), strict=True))
    none = np.zeros(of.shape[:-1])
    out = {"intercept": places["ln c0"] + _shift(law, setting.by, places), "V": none, "f": none, "wear": none}
    for factor in law.factors:
        power = places[factor.symbol]
        if factor.symbol in ("V", "f"):
            out[factor.symbol] = power
            constant = _ln_ratio(USUAL[factor.symbol], factor.unit)
        elif wear is not None and factor.symbol == wear.response and factor.symbol not in setting.at:
            out["wear"] = power
            constant = _ln_ratio(wear.unit, factor.unit)
        else:
            constant = log(known_value(law, factor.symbol, factor.unit, setting))
        out["intercept"] = out["intercept"] + power * constant
    slopes = np.stack([out["V"], out["f"]], axis=-1)
    return LogPlane(
        law.response, law.quantity, law.unit, out["intercept"], slopes, out["wear"], places.get("t", none)
    )  # fmt: skip


def need_speed_and_feed(law: "LawSection") -> None:
    """Raise UsageError for a law whose speed or feed is another quantity than the V and f that span the plane."""
    symbols = {factor.symbol for factor in law.factors}
    for factor in law.factors:
        moved, value = STAND_IN.get(factor.symbol, ("", ""))
        if moved and moved not in symbols:
            raise UsageError(
                f"the law of {law.response} is on {factor.symbol} ({factor.unit}), and a region moves V and f: read "
                f"the tests again with the constant that gives {moved}, for instance --value {value}."
            )


def with_wear(plane: LogPlane, wear: LogPlane) -> LogPlane:
    """A plane with its wear substituted: eq. 8 and 9 of AC-2016."""
    return replace(
        plane,
        intercept=plane.intercept + plane.wear_power * wear.intercept,
        slopes=plane.slopes + plane.wear_power[..., None] * wear.slopes,
        wear_power=np.zeros_like(plane.wear_power),
    )


def wear_law(pf: "ParameterFile", of: str | None = None) -> "LawSection | None":
    """The file's law of wear: the one named, or else of AW, or of VB."""
    names = FLANK_WEAR if of is None else (of,)
    return next((pf.laws[name] for name in names if name in pf.laws), None)


def ratio(of: str, to: str) -> float:
    """Conversion factor from one unit to another; identical units need no table."""
    if of == to or (canonical(of) is not None and canonical(of) == canonical(to)):
        return 1.0
    return float(convert(np.ones(1), of, to)[0])


def _ln_ratio(of: str, to: str) -> float:
    return log(ratio(of, to))


def known_value(law: "LawSection", symbol: str, unit: str, setting: CutSetting) -> float:
    """Value of a fixed factor in the unit of a law; UsageError where the setting has none."""
    if symbol not in setting.known:
        remedy = "give the file its law, or" if symbol in FLANK_WEAR else "give"
        raise UsageError(f"the law of {law.response} needs {symbol} ({unit}); {remedy} at={{{symbol!r}: ...}}.")
    value, given = setting.known[symbol]
    return value * ratio(given or unit, unit)


def _shift(law: "LawSection", by: str | None, places: Mapping[str, Array]) -> Array | float:
    if law.by is None:
        return 0.0
    known = (law.by.reference, *law.by.shifts)
    if by not in known:
        seen = "no level was named" if by is None else f"it has no {by!r}"
        raise UsageError(
            f"the law of {law.response} is by {law.by.column}: {seen}; give by=, one of {', '.join(known)}."
        )
    return 0.0 if by == law.by.reference else places[f"{law.by.column}[{by}]"]


def within_tested_ranges(
    laws: Mapping[str, "LawSection"], setting: CutSetting, wear: str | None, at: Mapping[str, float]
) -> bool:
    """Whether a pair lies in the tested ranges of all laws; ``at`` holds V and f, and the wear by its symbol."""
    known: dict[str, tuple[float, str | None]] = {"V": (at["V"], "m/min"), "f": (at["f"], "mm/rev")}
    if wear is not None:
        known[wear] = at[wear], laws[wear].unit
    known |= setting.known
    return all(_inside(law, setting.by, known) for law in laws.values())


def _inside(law: "LawSection", by: str | None, known: Mapping[str, tuple[float, str | None]]) -> bool:
    given = {}
    for factor in law.factors:
        value, unit = known[factor.symbol]
        value *= ratio(unit or factor.unit, factor.unit)
        ends = (end for end in (factor.low, factor.high) if abs(value - end) <= SAME * abs(end))  # a corner of the box
        given[factor.symbol] = next(ends, value)
    return bool(law.inside(None if law.by is None else by, **given))


def outside_tested_ranges(laws: Mapping[str, "LawSection"], setting: CutSetting) -> tuple[str, ...]:
    """A sentence for each fixed factor outside the tested range of a law."""
    return tuple(dict.fromkeys(words for law in laws.values() for words in _outside(law, setting)))


def _outside(law: "LawSection", setting: CutSetting) -> Iterator[str]:
    for factor in law.factors:
        if factor.symbol in setting.known:
            value, unit = setting.known[factor.symbol]
            value *= ratio(unit or factor.unit, factor.unit)
            if not factor.low * (1 - SAME) <= value <= factor.high * (1 + SAME):
                tested = f"{factor.low:g} to {factor.high:g} {factor.unit}, the tested range of {law.response}"
                yield f"EXTRAPOLATED: {factor.symbol} {value:g} lies outside {tested}: do not rely on the region."
