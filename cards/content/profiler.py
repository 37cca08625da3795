"""Data of the profiler of a card, and its arithmetic in Python: the reference for the script of the page."""

import math
from collections.abc import Mapping

import numpy as np

from ...core.intervals import t_quantile
from ...datasets.region import ROUNDING, SLACK
from ...datasets.vocabulary import FLANK_WEAR, ROLES
from ...parameters import LawSection, ParameterFile
from ...parameters.sections.base import Covariance
from .design import factor_ranges, middle
from .numbers import LEVEL
from .parts import FactorRangePart, LeverageSpacePart, ProfiledLawPart, ProfiledRegionPart, ProfilerPart

ROW, ON_NEW_EDGE = "one new observation", "one new observation on a new edge"
MILLING = ("fz", "fm", "ae", "n")  # with one of these, V f d is no removal rate

Value = tuple[float, float | None, float | None]


def profiler_part(pf: ParameterFile) -> ProfilerPart | None:
    """Sliders and laws; None without a law."""
    laws = tuple(profiled(law, pf) for law in pf.laws.values())
    if not laws:
        return None
    own = {law.wear for law in laws}
    ranges = _ranges(pf)
    sliders = tuple(f for f in ranges if f.symbol not in own)
    return ProfilerPart(
        factors=sliders,
        wears=tuple(f for f in ranges if f.symbol in own),
        start=_start(pf, ranges),
        laws=laws,
        of=band_of(pf),
        level=LEVEL,
        removal=_removes(pf, sliders),
    )


def band_of(pf: ParameterFile) -> str:
    """Kind of the prediction bands of the profiled laws."""
    split = [law.deviations is not None for law in pf.laws.values()]
    if all(split):
        return ON_NEW_EDGE
    return f"{ROW}, on a new edge where edges are known" if any(split) else ROW


def profiled(law: LawSection, pf: ParameterFile) -> ProfiledLawPart:
    """A law with all that the profiler needs; of levels the reference."""
    covariance, scatter, t = _band(law)
    formula = law.formula
    return ProfiledLawPart(
        response=law.response,
        quantity=law.quantity,
        unit=law.unit,
        form=law.form,
        logarithmic=law.logarithmic,
        added=getattr(formula.form, "last_added", False),
        multiplies=law.error == "multiplicative",
        factors=formula.factors,
        logs=formula.logs,
        centres=formula.centres or tuple(1.0 if log else 0.0 for log in formula.logs),
        terms=tuple(term.degrees for term in formula.all_terms),
        low=tuple(f.low for f in law.factors),
        high=tuple(f.high for f in law.factors),
        region=_region(law),
        by="" if law.by is None else f"{law.by.column} {law.by.reference}",
        theta=tuple(law.theta.tolist()[: 1 + len(formula.all_terms)]),
        covariance=covariance,
        scatter=scatter,
        t=t,
        wear=substituted_wear(law, pf),
    )


def profile(law: ProfiledLawPart, at: Mapping[str, float]) -> Value:
    """Prediction of a law for one new observation on a new edge: value, low and high, the ends None without a band.

    Parameters
    ----------
    law : ProfiledLawPart
    at : mapping
        A number for each of its factors, the wear among them; above zero where it enters by its logarithm.

    Examples
    --------
    >>> law = ProfiledLawPart(response="AW", quantity="wear", unit="mm", form="power", logarithmic=True, logs=(True,),
    ...                       multiplies=True, factors=("V",), centres=(1.0,), terms=((1,),), low=(50.0,),
    ...                       high=(200.0,), theta=(-4.6, 0.5))
    >>> value, low, high = profile(law, {"V": 100.0})
    >>> round(value, 4), low
    (0.1005, None)
    """
    with np.errstate(all="ignore"):  # as in the script of the page, what overflows is infinite
        value, low, high = _with_band(law, _columns(law, at))
    if not (math.isfinite(low) and math.isfinite(high)):
        return float(value), None, None
    return float(value), float(low), float(high)


def _with_band(law: ProfiledLawPart, z: list[float]) -> tuple[float, float, float]:
    """Value and ends of the band, NaN where there is none."""
    last = z.pop() if law.added else 0.0
    eta = sum(b * x for b, x in zip(law.theta, z, strict=not law.added))
    product = float(np.exp(eta)) if law.logarithmic else 1.0
    value = (product if law.logarithmic else eta) + (law.theta[-1] * last if law.added else 0.0)
    if not law.covariance or law.scatter is None or law.t is None or (law.multiplies and value <= 0):
        return value, math.nan, math.nan
    g = [product * x for x in z] + ([last] if law.added else [])
    variance = np.maximum(
        sum(a * c * b for a, row in zip(g, law.covariance, strict=True) for b, c in zip(g, row, strict=True)), 0
    )
    half = law.t * np.sqrt(np.divide(variance, value * value if law.multiplies else 1.0) + np.square(law.scatter))
    if law.multiplies:
        return value, value * np.exp(-half), value * np.exp(half)
    return value, value - half, value + half


def _columns(law: ProfiledLawPart, at: Mapping[str, float]) -> list[float]:
    """1, then the product of powers of the centred factors of each term; floats, faster than scalars of NumPy."""
    u = [
        float(np.log(np.divide(at[name], g))) if log else at[name] - g
        for name, log, g in zip(law.factors, law.logs, law.centres, strict=True)
    ]
    return [
        1.0,
        *(
            math.prod(x if d == 1 else float(np.power(x, d)) for x, d in zip(u, degrees, strict=True) if d)
            for degrees in law.terms
        ),
    ]


def inside(law: ProfiledLawPart, at: Mapping[str, float]) -> bool:
    """Whether a point lies in the tested region; the profiler greys points outside."""
    points = [at[name] for name in law.factors]
    region = law.region
    if region is None:
        return all(low <= x <= high for x, low, high in zip(points, law.low, law.high, strict=True))
    if any(log and x <= 0 for x, log in zip(points, region.logs, strict=True)):
        return False
    terms = [math.log(x) if log else x for x, log in zip(points, region.logs, strict=True)]
    coded = [(x - c) / h for x, c, h in zip(terms, region.centre, region.half_range, strict=True)]
    if any(abs(u) > 1 + region.rounding for u in coded):
        return False
    if sum(u * u for u in coded) > region.radius**2 * (1 + region.slack):
        return False
    return all(_leverage(space, [1.0, *coded]) <= space.largest * (1 + region.slack) for space in region.spaces)


def profile_all(profiler: ProfilerPart, at: Mapping[str, float], *, held: bool = False) -> dict[str, Value]:
    """Every law at the sliders; a law on wear takes it from its own law, or as in ``at`` where it is ``held``."""
    out: dict[str, Value] = {}
    for law in sorted(profiler.laws, key=lambda each: bool(each.wear)):
        here = dict(at)
        if law.wear and not held:
            here[law.wear] = out[law.wear][0]  # the law of a wear is on no wear itself, and came before
        out[law.response] = profile(law, here)
    return {law.response: out[law.response] for law in profiler.laws}


def substituted_wear(law: LawSection, pf: ParameterFile) -> str:
    """The wear among the factors of a law that the file's own law of it can give; empty where there is none."""
    return next((f.symbol for f in law.factors if f.symbol in FLANK_WEAR and _driven(pf, f.symbol)), "")


def _driven(pf: ParameterFile, wear: str) -> bool:
    """Whether a wear can be substituted by its own law, which itself has no wear as a factor."""
    law = pf.laws.get(wear)
    return law is not None and not any(f.symbol in pf.laws for f in law.factors)


def _band(law: LawSection) -> tuple[tuple[tuple[float, ...], ...], float | None, float | None]:
    held = law.uncertainty
    scatter = math.hypot(*law.deviations) if law.deviations else law.residual_se
    if not isinstance(held, Covariance) or scatter is None:
        return (), None, None
    order = [held.of.index(name) for name in law.parameter_names[: 1 + len(law.formula.all_terms)]]
    matrix = tuple(tuple(held.matrix[i][j] for j in order) for i in order)
    return matrix, scatter, t_quantile(held.df)


def _region(law: LawSection) -> ProfiledRegionPart | None:
    r = law.region
    if r is None:
        return None
    known = 1 + len(law.factors)  # the rest are the indicators of levels, 0 at the reference
    spaces = []
    for space in r.spaces:
        kept = [i for i, column in enumerate(space.columns) if column < known]
        matrix = tuple(tuple(space.matrix[i][j] for j in kept) for i in kept)
        columns = tuple(space.columns[i] for i in kept)
        spaces.append(LeverageSpacePart(columns=columns, matrix=matrix, largest=space.largest[0]))
    return ProfiledRegionPart(
        logs=(r.logs,) * len(r.centre) if isinstance(r.logs, bool) else r.logs,
        centre=r.centre,
        half_range=r.half_range,
        radius=r.largest_radius,
        spaces=tuple(spaces),
        rounding=ROUNDING,
        slack=SLACK,
    )


def _leverage(space: LeverageSpacePart, z: list[float]) -> float:
    part = [z[column] for column in space.columns]
    return sum(a * c * b for a, row in zip(part, space.matrix, strict=True) for b, c in zip(part, row, strict=True))


def _ranges(pf: ParameterFile) -> tuple[FactorRangePart, ...]:
    """The union of the tested ranges of each factor."""
    found: dict[str, FactorRangePart] = {}
    for law in pf.laws.values():
        for new in factor_ranges(law.factors, pf.design):
            old = found.get(new.symbol)
            found[new.symbol] = new if old is None else _widest(old, new)
    return tuple(found.values())


def _widest(a: FactorRangePart, b: FactorRangePart) -> FactorRangePart:
    low = min(a.low, b.low, key=lambda n: n.value or 0.0)
    high = max(a.high, b.high, key=lambda n: n.value or 0.0)
    return a.model_copy(update={"low": low, "high": high, "levels": max(a.levels, b.levels, key=len)})


def _start(pf: ParameterFile, ranges: tuple[FactorRangePart, ...]) -> dict[str, float]:
    """The middle at which the results are shown: of each factor that of the first law that has it."""
    middles: dict[str, float] = {}
    for law in pf.laws.values():
        middles = {**middle(law), **middles}
    return {f.symbol: middles[f.symbol] for f in ranges}


def _removes(pf: ParameterFile, sliders: tuple[FactorRangePart, ...]) -> bool:
    """Whether 1000 V f d is a removal rate here: turning, in these units."""
    units = {f.symbol: f.unit for f in sliders}
    known = {f.symbol for f in pf.design.factors} if pf.design else set()
    milling = known.intersection(MILLING) or pf.load_line or pf.adaptive_force
    return not milling and all(units.get(symbol) == ROLES[symbol].unit for symbol in ("V", "f", "d"))
