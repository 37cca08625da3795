"""Limits of a parameter file, or of the caller, as half planes of ln V and ln f, and the laws that they need."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import log, pi
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from ...core.arrays import Array
from ...core.display import Displayable
from ...core.errors import UsageError
from ...parameters.gather.control import limits_section
from ...parameters.messages import schema_message
from ...parameters.sections.load_line import Bound, LimitsSection, Range
from .half_planes import HalfPlane
from .log_planes import USUAL, WEARS, CutSetting, LogPlane, plane, ratio, wear_law
from .operating_point import plain

if TYPE_CHECKING:
    from ...parameters import LawSection, ParameterFile

FORCES = ("Fxz", "F", "Fc", "Ff", "Fp", "Fx", "Fy", "Fz")
RANGES = (("V", "speed", "m/min"), ("f", "feed", "mm/rev"))


@dataclass(frozen=True, slots=True, repr=False)
class MachineRange(Displayable):
    """The ranges of V and f: ``low`` and ``high`` are (ln V, ln f), shape (2,); ``notes`` give their origin."""

    low: Array
    high: Array
    notes: tuple[str, ...]

    @property
    def sides(self) -> tuple[HalfPlane, ...]:
        """The four sides as limits."""
        out = []
        for i, (symbol, _, unit) in enumerate(RANGES):
            e = (float(i == 0), float(i == 1))
            low, high = float(self.low[i]), float(self.high[i])
            out.append(HalfPlane(symbol, unit, "least", plain(low), (-e[0], -e[1]), -low))
            out.append(HalfPlane(symbol, unit, "most", plain(high), e, high))
        return tuple(out)


def merged(pf: "ParameterFile", given: LimitsSection | Mapping[str, Any] | None) -> LimitsSection:
    """The file's limits, replaced by those given; one given as None is dropped.

    Raises
    ------
    UsageError
        An unknown or invalid limit.
    """
    data = {} if pf.limits is None else pf.limits.model_dump()
    new = given.model_dump(exclude_unset=True) if isinstance(given, LimitsSection) else dict(given or {})
    if unknown := [name for name in new if name not in LimitsSection.model_fields]:
        raise UsageError(
            f"limits: there is no limit {unknown[0]!r}; there are {', '.join(LimitsSection.model_fields)}."
        )
    for name, value in new.items():
        bare = isinstance(value, int | float) and not isinstance(value, bool)
        data[name] = {**limits_section({name: value})[name], "of": (data.get(name) or {}).get("of")} if bare else value
    data = limits_section(data)
    try:
        return LimitsSection.model_validate(data)
    except ValidationError as error:
        raise UsageError(f"limits: {schema_message(error, data)}.") from None


def limited(pf: "ParameterFile", limits: LimitsSection) -> dict[str, Bound]:
    """Bound of each limited response.

    Raises
    ------
    UsageError
        The file has no law of a limited response, or several candidates.
    """
    candidates = {"power": ("P",), "force": FORCES, "wear": WEARS}
    found: dict[str, Bound] = {}
    for name, usual in candidates.items():
        bound: Bound | None = getattr(limits, name)
        if bound is not None:
            found[_response(pf, name, bound, usual)] = bound
    return found


def _response(pf: "ParameterFile", name: str, bound: Bound, usual: tuple[str, ...]) -> str:
    label = f"limits.{name} {bound.value:g} {bound.unit}"
    names = [bound.of] if bound.of else [each for each in usual if each in pf.laws]
    if len(names) > 1:
        raise UsageError(f"{label}: the file has laws of {', '.join(names)}; name one of them in the limit's 'of'.")
    if not names or names[0] not in pf.laws:
        raise UsageError(
            f"{label}: the file has no law of {names[0] if names else usual[0]}; fit it, or leave this limit out with "
            f"limits={{{name!r}: None}}."
        )
    return names[0]


def half_planes(bounds: Mapping[str, Bound], planes: Mapping[str, LogPlane]) -> tuple[HalfPlane, ...]:
    """Half plane of each limited response, labelled in the limit's own unit."""
    out = []
    for name, bound in bounds.items():
        plane = planes[name]
        allowed = log(bound.value * ratio(bound.unit, plane.unit))
        a = (float(plane.slopes[0]), float(plane.slopes[1]))
        out.append(HalfPlane(name, bound.unit, "most", bound.value, a, allowed - float(plane.intercept)))
    return tuple(out)


def box(pf: "ParameterFile", limits: LimitsSection) -> MachineRange:
    """The machine's ranges of V and f, or the tested ranges where the file has none.

    Raises
    ------
    UsageError
        Neither is available.
    """
    ends, notes = [], []
    for symbol, name, unit in RANGES:
        tested = _tested(pf, symbol, unit)
        given: Range | None = getattr(limits, name)
        if given is None and tested is None:
            raise UsageError(f"no law has {symbol} and there is no range of it; give limits={{{name!r}: (low, high)}}.")
        if given is None or given.low == 0:
            low, high = _filled(symbol, given, tested, unit)
            why = f"no range of {symbol}" if given is None else f"no lower end of {symbol} above zero"
            notes.append(f"The limits have {why}: the tested range {low:g} to {high:g} {unit} is used.")
        else:
            low, high = (end * ratio(given.unit, unit) for end in (given.low, given.high))
            if tested is not None and (low < tested[0] * (1 - 1e-9) or high > tested[1] * (1 + 1e-9)):
                notes.append(
                    f"The machine's range of {symbol}, {low:g} to {high:g} {unit}, is wider than the tested "
                    f"{tested[0]:g} to {tested[1]:g}."
                )
        if not 0 < low <= high:
            raise UsageError(f"{symbol} from {low:g} to {high:g} {unit}: give a range above zero that is not empty.")
        ends.append((log(low), log(high)))
    return MachineRange(np.array([low for low, _ in ends]), np.array([high for _, high in ends]), tuple(notes))


def _filled(symbol: str, given: Range | None, tested: tuple[float, float] | None, unit: str) -> tuple[float, float]:
    if tested is None:
        raise UsageError(
            f"a range of {symbol} from 0 has no lower end above 0 and no law has a tested range; give it a low above 0."
        )
    return tested if given is None else (tested[0], given.high * ratio(given.unit, unit))


def _tested(pf: "ParameterFile", symbol: str, unit: str) -> tuple[float, float] | None:
    """The tested range common to all laws with this factor."""
    held = [(f, ratio(f.unit, unit)) for law in pf.laws.values() for f in law.factors if f.symbol == symbol]
    if not held:
        return None
    return max(f.low * k for f, k in held), min(f.high * k for f, k in held)


def of_spindle(limits: LimitsSection, setting: CutSetting) -> tuple[tuple[HalfPlane, ...], tuple[str, ...]]:
    """Limits of n and fm: ``n = 1000 V / (pi D)``, ``fm = f n``; they need the diameter, D in mm."""
    stated = [(symbol, each) for symbol, each in (("n", limits.spindle_speed), ("fm", limits.feed_rate)) if each]
    if not stated:
        return (), ()
    if "D" not in setting.at:
        names = " and ".join(symbol for symbol, _ in stated)
        return (), (f"The limits of {names} are not applied: they need the diameter, at={{'D': ...}} in mm.",)
    constant = log(1000 / (pi * setting.at["D"]))
    out = []
    for symbol, each in stated:
        usual, a = ("1/min", (1.0, 0.0)) if symbol == "n" else ("mm/min", (1.0, 1.0))
        k = ratio(each.unit, usual)
        out.append(HalfPlane(symbol, each.unit, "most", each.high, a, log(each.high * k) - constant))
        if each.low > 0:
            out.append(HalfPlane(symbol, each.unit, "least", each.low, (-a[0], -a[1]), constant - log(each.low * k)))
    return tuple(out), ()


def required_wear_law(pf: "ParameterFile", setting: CutSetting, named: str | None) -> "LawSection | None":
    """The law of wear; None where the file has none or the setting gives the wear itself."""
    wear = wear_law(pf, named)
    if wear is not None and wear.response in setting.at and named is None:
        return None
    if wear is not None:
        plane(wear, setting)  # raises here, naming the wear law
    return wear


def unlimited_responses(pf: "ParameterFile", setting: CutSetting, wear: "LawSection | None") -> tuple[str, ...]:
    """Power and forces without a limit whose laws can be evaluated at the setting: reported only."""
    out = []
    for name in ("P", *FORCES):
        if name in pf.laws:
            with suppress(UsageError):
                plane(pf.laws[name], setting, wear)
                out.append(name)
    return tuple(out)


def check_fixed_factors(pf: "ParameterFile", setting: CutSetting) -> None:
    """Raise UsageError for a fixed factor that no law has, or that has its own argument."""
    factors = {factor.symbol for law in pf.laws.values() for factor in law.factors}
    for name in setting.at:
        if name in USUAL:
            remedy = f"give {name}=" if name in ("d", "t") else "the limits give its range"
            raise UsageError(f"at: {name} is not allowed here; {remedy}.")
        if name not in {*factors, "D"}:
            raise UsageError(f"at: no law has a factor {name!r}; they have {', '.join(sorted(factors))}.")
