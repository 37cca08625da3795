"""Limits of a parameter file, or of the caller, on V and f, and the laws that they need."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import log, pi
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import ValidationError

from ...core.arrays import Array
from ...core.display import Displayable
from ...core.errors import UsageError
from ...datasets.vocabulary import FLANK_WEAR
from ...parameters.gather.control import limits_section
from ...parameters.messages import schema_message
from ...parameters.sections.load_line import Bound, LimitsSection, Range
from .half_planes import HalfPlane
from .log_planes import USUAL, CutSetting, ratio, wear_law
from .operating_point import plain
from .surfaces import RegionLimit, ResponseBound, surface_of

if TYPE_CHECKING:
    from ...parameters import LawSection, ParameterFile

FORCES = ("Fxz", "F", "Fc", "Ff", "Fp", "Fx", "Fy", "Fz")
NO_RESPONSE_LIMIT = "The file has no limit of a response: add one, e.g. `fitmodels limits params.json P=7kW`."
RANGES = (("V", "speed", "m/min"), ("f", "feed", "mm/rev"))
CANDIDATES: Mapping[str, tuple[str, ...]] = {"power": ("P",), "force": FORCES, "wear": FLANK_WEAR}


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


def limited(pf: "ParameterFile", limits: LimitsSection) -> tuple[ResponseBound, ...]:
    """The bounds of the limited responses.

    Raises
    ------
    UsageError
        The file has no law of a limited response, or several candidates.
    """
    found: list[ResponseBound] = []
    for name in CANDIDATES:
        bound: Bound | None = getattr(limits, name)
        if bound is not None:
            found.append(ResponseBound(_response(pf, name, bound), "most", bound.value, bound.unit))
    for symbol, ends in limits.responses.items():
        if symbol not in pf.laws:
            raise UsageError(f"limits.responses: the file has no law of {symbol}; fit it, or leave this limit out.")
        both: tuple[tuple[Literal["least", "most"], float | None], ...] = (("least", ends.low), ("most", ends.high))
        found += [ResponseBound(symbol, side, value, ends.unit) for side, value in both if value is not None]
    return tuple(found)


def bounded_law(pf: "ParameterFile", name: str, bound: Bound) -> str:
    """Symbol of the law that ``limits.<name>`` bounds: the one named by ``of``, or else the only one of its kind.

    Parameters
    ----------
    pf : ParameterFile
    name : {"power", "force", "wear"}
    bound : Bound

    Returns
    -------
    str
        Empty where the file has no such law.

    Raises
    ------
    UsageError
        The limit names no law, and the file has several of its kind.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> bounded_law(published("AC-2017"), "force", Bound(value=1000.0, unit="N"))
    'Fxz'
    """
    names = laws_of_kind(pf, name, bound)
    if len(names) > 1:
        raise UsageError(
            f"{_label(name, bound)}: the file has laws of {', '.join(names)}; name one of them in the limit's 'of'."
        )
    return names[0] if names else ""


def laws_of_kind(pf: "ParameterFile", name: str, bound: Bound) -> tuple[str, ...]:
    """Symbols of the laws that ``limits.<name>`` may bound: the one named by ``of``, or else all of its kind."""
    return tuple(each for each in ((bound.of,) if bound.of else CANDIDATES[name]) if each in pf.laws)


def _label(name: str, bound: Bound) -> str:
    return f"limits.{name} {bound.value:g} {bound.unit}"


def _response(pf: "ParameterFile", name: str, bound: Bound) -> str:
    if found := bounded_law(pf, name, bound):
        return found
    raise UsageError(
        f"{_label(name, bound)}: the file has no law of {bound.of or CANDIDATES[name][0]}; fit it, or leave this limit "
        f"out with limits={{{name!r}: None}}."
    )


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


def within_tests(machine: MachineRange, tested: Sequence[RegionLimit]) -> MachineRange:
    """The machine's ranges within the tested ranges of laws that are no power laws, with a note on each.

    Raises
    ------
    UsageError
        A fixed factor, or the whole of the machine's range, lies outside the tests of such a law.
    """
    low, high, notes = machine.low.copy(), machine.high.copy(), list(machine.notes)
    for limit in tested:
        law = limit.surface.law
        for i, (symbol, _, unit) in enumerate(RANGES):
            factor = next((f for f in law.factors if f.symbol == symbol), None)
            if factor is not None and factor.low > 0:
                k = ratio(factor.unit, unit)
                low[i], high[i] = max(low[i], log(factor.low * k)), min(high[i], log(factor.high * k))
            if low[i] > high[i]:
                raise UsageError(f"the machine's range of {symbol} lies outside the tests of {law.response}.")
        _need_tested(limit)
        form = law.form.replace("_", " ")
        notes.append(f"The law of {law.response} has the form {form}: the region is limited to where it was tested.")
    return MachineRange(low, high, tuple(notes))


def _need_tested(limit: RegionLimit) -> None:
    """Refuse a fixed factor outside the tests of a law that states nothing there."""
    law, known = limit.surface.law, limit.surface.setting.known
    for factor in law.factors:
        if factor.symbol in known and factor.symbol != getattr(limit.surface.wear, "response", None):
            value, unit = known[factor.symbol]
            value *= ratio(unit or factor.unit, factor.unit)
            if not factor.low * (1 - 1e-9) <= value <= factor.high * (1 + 1e-9):
                remedy = f"{factor.symbol}=" if factor.symbol in ("d", "t") else f"at={{{factor.symbol!r}: ...}}"
                raise UsageError(
                    f"{factor.symbol} {value:g} {factor.unit} lies outside {factor.low:g} to {factor.high:g}, the "
                    f"tested range of the {law.form.replace('_', ' ')} law of {law.response}; give {remedy} within it."
                )


def required_wear_law(pf: "ParameterFile", setting: CutSetting, named: str | None) -> "LawSection | None":
    """The law of wear; None where the file has none or the setting gives the wear itself."""
    wear = wear_law(pf, named)
    if wear is not None and wear.response in setting.at and named is None:
        return None
    if wear is not None:
        surface_of(wear, setting)  # raises here, naming the wear law
    return wear


def unlimited_responses(pf: "ParameterFile", setting: CutSetting, wear: "LawSection | None") -> tuple[str, ...]:
    """Power and forces without a limit whose laws can be evaluated at the setting: reported only."""
    out = []
    for name in ("P", *FORCES):
        if name in pf.laws:
            with suppress(UsageError):
                surface_of(pf.laws[name], setting, None if wear is None else surface_of(wear, setting))
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
