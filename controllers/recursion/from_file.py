"""Laws and limits of an edge's life, taken from a parameter file."""

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array, Flags, is_positive
from ...core.errors import GateError, UsageError
from ...datasets.units import convert, is_unit, same_dimension
from ...datasets.vocabulary import FLANK_WEAR
from ..region.limits import bounded_law
from ..region.log_planes import ratio
from .laws import LifeLaws, Terms, on_machine

if TYPE_CHECKING:
    from ...parameters import LawSection, ParameterFile
    from ...parameters.sections.law_parts import Factor
    from ...parameters.sections.load_line import Bound, LimitsSection, Range

DEPTH = 2.5  # mm, of both papers
FAR = 1.5  # times the ends of the tests: a plan beyond is exported for a stated reason only
FAR_TIME = 3.0  # times the longest test, of the time in the cut: lives of twice the longest test are usual
NEAR = 1e-9  # of an end of a tested range: a value on it is inside
PAPER = "AC-2017"  # provenance.options["paper"] of its own file
UNITS: Mapping[str, str] = {"V": "m/min", "f": "mm/rev", "d": "mm", "t": "min"}
MOVING = ("V", "f", "t")


def life_laws(
    pf: "ParameterFile", *, d: float | None = None, by: str | None = None, at: Mapping[str, float] | None = None
) -> LifeLaws:
    """Laws and limits of the recursion from a parameter file.

    Parameters
    ----------
    pf : ParameterFile
        With a power law of wear in V, f and t, a wear criterion, and ranges of speed and feed (``limits``, or else
        the tested ones); limits of power and force apply where the file has their laws.
    d : float, optional
        Depth of cut, mm; by default the papers' 2.5, or the middle of the tested depths where 2.5 was not tested.
    by : str, optional
        Level of laws that have levels; by default their reference.
    at : mapping, optional
        Any other factor's value, by its symbol; the diameter ``D``, mm, for the limits of spindle speed and feed rate.

    Raises
    ------
    UsageError
        A law, limit or factor is missing, invalid, or in an unsuitable unit.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> laws = life_laws(published("AC-2017"))
    >>> round(float(laws.wear(150.0, 0.58)), 6), laws.power.most
    (0.157219, 7.0)
    """
    limits, criterion = _limits(pf)
    name = _response(pf, "wear", criterion)
    wear = pf.laws[name]
    _need_wear(wear)
    d = depth(pf) if d is None else d
    if not is_positive(d):
        raise UsageError(f"d {d!r} mm: give a depth of cut above zero.")
    fixed, notes = {**(at or {}), "d": d}, list[str]()
    if limits.responses:
        names = ", ".join(limits.responses)
        notes.append(f"The recursion does not apply the limits of {names}: narrow the range of feed or speed for them.")
    laws = LifeLaws(
        wear=_terms(wear, wear, criterion, fixed, by, notes),
        power=_limited(pf, "power", wear, fixed, by, notes),
        force=_limited(pf, "force", wear, fixed, by, notes),
        d=float(d),
        V=_range(limits.speed, wear, "V"),
        f=_range(limits.feed, wear, "f"),
        times="published" if pf.provenance.options.get("paper") == PAPER else "full",
        notes=tuple(notes),
    )
    return on_machine(laws, limits, fixed.get("D"))


def shortfall(
    pf: "ParameterFile", *, d: float | None = None, by: str | None = None, at: Mapping[str, float] | None = None
) -> str:
    """Reason why a file cannot drive the recursion at these settings; empty where it can.

    >>> from fitmodels.parameters.published import published
    >>> shortfall(published("AC-2017")), "criterion" in shortfall(published("AC-2016"))
    ('', True)
    """
    try:
        life_laws(pf, d=d, by=by, at=at)
    except UsageError as error:
        return str(error)
    return ""


def need_level(pf: "ParameterFile", by: str | None) -> None:
    """Raise UsageError for a level that no law has."""
    levels = dict.fromkeys(name for law in pf.laws.values() if law.by for name in (law.by.reference, *law.by.shifts))
    if by is not None and by not in levels:
        known = f"they have {', '.join(levels)}" if levels else "no law has levels"
        raise UsageError(f"by {by}: no law has this level; {known}.")


def depth(pf: "ParameterFile") -> float:
    """Default depth of cut, mm: the papers' 2.5, or the geometric mean of the tested range where that excludes it."""
    low, high = tested_depths(pf) or (DEPTH, DEPTH)
    return DEPTH if low * (1 - NEAR) <= DEPTH <= high * (1 + NEAR) or low > high else round(math.sqrt(low * high), 3)


def tested_depths(pf: "ParameterFile") -> tuple[float, float] | None:
    """Ends of the depths that all laws with a depth were tested at, mm; of laws without one those of the tests."""
    found = _depths([one for law in pf.laws.values() for one in law.factors]) or _depths(
        pf.design.factors if pf.design is not None else ()
    )
    return (max(low for low, _ in found), min(high for _, high in found)) if found else None


def _depths(factors: "Iterable[Factor]") -> list[tuple[float, float]]:
    named = (f for f in factors if f.symbol == "d" and f.low > 0 and _alike(f.unit, "mm"))
    return [(f.low * ratio(f.unit, "mm"), f.high * ratio(f.unit, "mm")) for f in named]


def _limits(pf: "ParameterFile") -> "tuple[LimitsSection, Bound]":
    """The limits, and the wear criterion among them."""
    if pf.limits is None or pf.limits.wear is None:
        raise UsageError(
            "the file sets no wear criterion (limits.wear), at which an edge is worn out; collect it with "
            "limits={'wear': 0.3, ...}."
        )
    return pf.limits, pf.limits.wear


def _response(pf: "ParameterFile", what: str, bound: "Bound") -> str:
    """Symbol of the limited law, empty where the file has none."""
    found = bounded_law(pf, what, bound)
    if found and pf.laws[found].form != "power":
        raise UsageError(
            f"the law of {found} has the form {pf.laws[found].form.replace('_', ' ')}; the recursion computes with "
            f'power laws: fit it again with --form "{found}=power", or leave the limit of it out.'
        )
    if not found and what == "wear":
        held = ", ".join(pf.laws) or "none"
        names = bound.of or " or ".join(FLANK_WEAR)
        raise UsageError(f"the file holds no power law of the wear {names} (its laws: {held}); fit one.")
    return found


def _need_wear(law: "LawSection") -> None:
    symbols = {factor.symbol for factor in law.factors}
    missing = [name for name in MOVING if name not in symbols]
    if missing:
        raise UsageError(
            f"the law of {law.response} is without {', '.join(missing)}; a life is computed from wear over V, f and t: "
            "fit it on those."
        )
    if law.coefficients["t"] <= 0:
        grows = f"the law of {law.response} has t^{law.coefficients['t']:g}: wear that does not grow with time"
        raise UsageError(f"{grows} gives no end of life. Check the tests.")


def _limited(
    pf: "ParameterFile", what: str, wear: "LawSection", fixed: Mapping[str, float], by: str | None, notes: list[str]
) -> Terms | None:
    """The law of power or force with its limit, or None and a note."""
    bound = getattr(pf.limits, what)
    if bound is None:
        notes.append(f"The file sets no limit of {what}: none is applied.")
        return None
    name = _response(pf, what, bound)
    if not name:
        notes.append(f"The file limits {what} to {bound.value:g} {bound.unit} but has no law of it: not applied.")
        return None
    return _terms(pf.laws[name], wear, bound, fixed, by, notes)


def _terms(
    law: "LawSection", wear: "LawSection", bound: "Bound", fixed: Mapping[str, float], by: str | None, notes: list[str]
) -> Terms:
    put_in = [*_constants(law, wear, fixed), *_shift(law, by, notes)]
    levels = law.by.shifts if law.by else {}
    known = {**law.coefficients, **{f"{law.by.column if law.by else ''}[{name}]": levels[name] for name in levels}}
    exponent = {name: law.coefficients.get(name, 0.0) for name in (*MOVING, wear.response)}
    return Terms(
        response=law.response,
        unit=law.unit,
        ln_c=math.log(law.coefficients["c0"]) + sum(known[name] * times for name, times in put_in),
        V=exponent["V"],
        f=exponent["f"],
        t=exponent["t"],
        AW=exponent[wear.response],
        most=_in_unit(law, bound),
        put_in=tuple(put_in),
    )


def _constants(law: "LawSection", wear: "LawSection", fixed: Mapping[str, float]) -> list[tuple[str, float]]:
    """Terms of the constant: logarithms of fixed factors, and of the ratios of units of the others."""
    units, out = {**UNITS, wear.response: wear.unit}, []
    for factor in law.factors:
        name = factor.symbol
        if name in units and not _alike(factor.unit, units[name]):
            raise UsageError(
                f"the law of {law.response} has {name} in {factor.unit!r}; the recursion computes in {units[name]}: "
                "fit it in that."
            )
        times = ratio(units[name], factor.unit) if name in units else 1.0
        if name not in (*MOVING, wear.response):
            if not fixed.get(name, 0.0) > 0:
                raise UsageError(
                    f"the law of {law.response} needs {name} ({factor.unit}) too; give --at {name}=..., in Python "
                    f"at={{{name!r}: ...}}."
                )
            times *= fixed[name]
        if times != 1.0 or name not in units:
            out.append((name, math.log(times)))
    return out


def _alike(unit: str, other: str) -> bool:
    """Whether two units are the same, or convert into each other."""
    return unit == other or (is_unit(unit) and is_unit(other) and same_dimension(unit, other))


def _shift(law: "LawSection", by: str | None, notes: list[str]) -> list[tuple[str, float]]:
    if law.by is None:
        return []
    level = law.by.reference if by is None else by
    if level != law.by.reference and level not in law.by.shifts:
        known = ", ".join([law.by.reference, *law.by.shifts])
        raise UsageError(f"the law of {law.response} has no {law.by.column} {level!r}; it has {known}.")
    if by is None:
        notes.append(f"{law.response} is evaluated at {law.by.column} {level}, the reference level.")
    return [] if level == law.by.reference else [(f"{law.by.column}[{level}]", 1.0)]


def _in_unit(law: "LawSection", bound: "Bound") -> float:
    if not same_dimension(bound.unit, law.unit):
        raise UsageError(f"the limit of {law.response} is in {bound.unit!r}, its law in {law.unit!r}; give it in that.")
    return bound.value if bound.unit == law.unit else float(convert(np.array([bound.value]), bound.unit, law.unit)[0])


def _range(given: "Range | None", wear: "LawSection", name: str) -> tuple[float, float]:
    """The machine's range, or else the tested one."""
    if given is None:
        factor = next(factor for factor in wear.factors if factor.symbol == name)
        low, high, unit = factor.low, factor.high, factor.unit
    else:
        low, high, unit = given.low, given.high, given.unit
    if not same_dimension(unit, UNITS[name]):
        raise UsageError(f"the range of {name} is in {unit!r}; it must be a unit of the kind of {UNITS[name]}.")
    ends = convert(np.array([low, high]), unit, UNITS[name])
    if not ends[0] > 0:
        raise UsageError(f"the range of {name} begins at {low:g} {unit}; a power law needs it above zero.")
    return float(ends[0]), float(ends[1])


def outside_tests(
    pf: "ParameterFile", laws: LifeLaws, path: Mapping[str, Array], at: Mapping[str, float], by: str | None
) -> tuple[Flags, tuple[str, ...]]:
    """Rows of a plan inside the tested region of every law in use, shape (n,), and sentences on what is EXTRAPOLATED.

    Every edge begins new, so times and wear below those tested are not extrapolated, but those above are.

    Parameters
    ----------
    pf : ParameterFile
    laws : LifeLaws
    path : mapping of ndarray, shape (n,)
        V, m/min, f, mm/rev, t, min, and the wear by its symbol, at the end of each row.
    at, by
        As in `life_laws`.
    """
    wear, count = laws.wear, len(path["V"])
    units, held = {**UNITS, wear.response: wear.unit}, {**at, **path, "d": laws.d}
    inside, beyond = np.full(max(count, 1), True), dict[tuple[str, str], list[str]]()
    combined, corner = list[str](), np.full(max(count, 1), False)
    for name in (wear.response, *(terms.response for _, terms in laws.limited)):
        law, given, within = pf.laws[name], dict[str, Array](), np.full(max(count, 1), True)
        for factor in law.factors:
            times = ratio(units[factor.symbol], factor.unit) if factor.symbol in units else 1.0
            none = not count and factor.symbol in path  # of no row: the fixed factors are judged all the same
            value = np.asarray(factor.low if none else held[factor.symbol], dtype=np.float64) * (1.0 if none else times)
            values = np.broadcast_to(value, (max(count, 1),))
            begins = factor.symbol in ("t", wear.response)
            kept = np.clip(values, factor.low if begins else -np.inf, np.inf)
            on_end = np.clip(kept, factor.low, factor.high)
            within &= np.abs(kept - on_end) <= NEAR * np.abs(on_end)
            given[factor.symbol] = np.where(within, on_end, kept)
            if (np.abs(kept - on_end) > NEAR * np.abs(on_end)).any():
                beyond.setdefault(_beyond_words(factor, values), []).append(name)
        tested = np.asarray(law.inside(None if law.by is None else by, **given))
        if (within & ~tested).any():
            combined.append(name)
            corner |= within & ~tested
        inside &= within & tested
    words = [f"EXTRAPOLATED: {what}, tested {span} ({', '.join(of)})." for (what, span), of in beyond.items()]
    if combined and count:
        words.append(
            f"EXTRAPOLATED: {int(corner.sum())} of {count} pairs lie in a corner of the ranges outside the tested "
            f"region of {', '.join(combined)}."
        )
    return inside[:count], tuple(words)


def require_near_tests(
    pf: "ParameterFile", used: Iterable[LifeLaws], path: Mapping[str, Array], reason: str
) -> tuple[str, ...]:
    """Raise for a plan by these laws far beyond its tests; where a reason accepts it, the words that state both.

    ``path`` holds V, f, t and the wear of its rows, as in `outside_tests`.
    """
    far = dict.fromkeys(
        words
        for laws in used
        for name in (laws.wear.response, *(terms.response for _, terms in laws.limited))
        for factor in pf.laws[name].factors
        if (words := _far(factor, {**path, "d": np.array(laws.d)}, laws.wear))
    )
    if not far:
        return ()
    words = "; ".join(far)
    if reason:
        return (f"BEYOND TESTS: {words}; accepted: {reason}",)
    raise GateError(
        f"not exported: {words}, and from {FAR:g}-fold on ({FAR_TIME:g}-fold in time) a plan is refused. Check the "
        "limits of the file, test nearer to the plan, plan nearer to the tests (--depth, --time, limits of V, f and "
        "wear), or accept it with --beyond-tests and a reason, which is written into the file."
    )


def _far(factor: "Factor", path: Mapping[str, Array], wear: Terms) -> str:
    """Words on the value of a plan that is furthest outside the tests of a factor; empty where none is far outside."""
    units = {**UNITS, wear.response: wear.unit}
    if factor.symbol not in path or factor.symbol not in units:
        return ""
    begins, unit = factor.symbol in ("t", wear.response), units[factor.symbol]
    low, high = (end / ratio(unit, factor.unit) for end in (factor.low, factor.high))
    most, least = float(path[factor.symbol].max()), float(path[factor.symbol].min())
    value, times = (least, low / least) if low / least > most / high and not begins else (most, most / high)
    if times < (FAR_TIME if factor.symbol == "t" else FAR) * (1 - NEAR):
        return ""
    return f"{factor.symbol} {value:.4g} {unit} lies {times:.3g}-fold outside the tested {low:.4g} to {high:.4g} {unit}"


def _beyond_words(factor: "Factor", values: Array) -> tuple[str, str]:
    """Values of a factor beyond its tests, and the range of these."""
    low, high = float(values.min()), float(values.max())
    span = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
    if factor.symbol == "t" or (low != high and low >= factor.low * (1 - NEAR)):
        span = f"up to {high:.4g}"
    return f"{factor.symbol} {span} {factor.unit}", f"{factor.low:.4g} to {factor.high:.4g} {factor.unit}"


def _not_applied(
    limits: "LimitsSection", laws: LifeLaws
) -> tuple[dict[str, tuple[float | None, float | None, str]], str]:
    """Least and largest value and unit of the limits that a plan by these laws does not apply, and what to do."""
    stated = {name: (bound.low, bound.high, bound.unit) for name, bound in limits.responses.items()}
    remedy = "Use `fitmodels optimum` or the system region, which apply it"
    for what, terms in (("power", laws.power), ("force", laws.force)):
        bound = getattr(limits, what)
        if bound is not None and terms is None:
            stated[bound.of or what] = (None, bound.value, bound.unit)
            remedy = f"The file has no law of {bound.of or what}: fit one"
    return stated, remedy


def require_checked(pf: "ParameterFile", laws: LifeLaws, accept: bool) -> tuple[str, ...]:
    """Raise for limits that a plan by these laws does not apply; where they are accepted, the words that name them."""
    if pf.limits is None:
        return ()
    stated, remedy = _not_applied(pf.limits, laws)
    if not stated:
        return ()
    names = ", ".join(stated)
    words = f"NOT CHECKED by the plan: the limit of {names}; predict it at the plan's V and f, and narrow their ranges"
    if accept:
        return (words,)
    ends = ", ".join(
        f"{name} {word} {value:g} {unit}"
        for name, (low, high, unit) in stated.items()
        for word, value in (("at least", low), ("at most", high))
        if value is not None
    )
    raise GateError(
        f"not exported: the file limits {ends}, and the plan does not apply the limit of {names}. {remedy}; or narrow "
        "the ranges of V and f until `fitmodels predict` keeps it at every row, and export with --accept-verdict, "
        "which names the limit in the file as NOT CHECKED."
    )
