"""Advice of feed and speed for the edge that is cutting: within the tested region and limits, with its probability."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..controllers.region.limits import laws_of_kind
from ..controllers.region.log_planes import USUAL, ratio
from ..core.errors import UsageError
from ..core.rounding import format_probability
from .decision import Advice, cost_of_change
from .edge_estimate import EdgeEstimate
from .live_laws import LiveLaws

if TYPE_CHECKING:
    from ..parameters import ParameterFile
    from ..parameters.sections.costs import CostsSection

STEPS = 121  # of feed or speed in its range
GRID = 12  # steps of V and of f
GAIN = 0.02  # least relative change that is advised
LEVEL = 0.9  # of the interval of a load, whose upper end keeps to its limit


@dataclass(frozen=True, slots=True)
class Bounds:
    """Limits of an advice.

    Attributes
    ----------
    ranges : mapping of (low, high)
        Of V in m/min and f in mm/rev: tested, and allowed by the machine.
    loads : mapping of float
        Highest load by symbol, in the unit of its law.
    reference : mapping of float
        Load that is to be held, by symbol.
    """

    ranges: Mapping[str, tuple[float, float]]
    loads: Mapping[str, float] = field(default_factory=dict)
    reference: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, pf: "ParameterFile", laws: LiveLaws) -> "Bounds":
        """Tested ranges within the limits of a parameter file, its limits of loads, and its reference load."""
        ranges = {name: laws.wear.ranges[name] for name in ("V", "f") if name in laws.wear.ranges}
        limits, loads = pf.limits, {}
        if limits is not None:
            for name, own in (("V", limits.speed), ("f", limits.feed)):
                if own is not None and name in ranges:
                    k, (low, high) = ratio(own.unit, USUAL[name]), ranges[name]
                    ranges[name] = max(low, k * own.low), min(high, k * own.high)
            bounds = [(name, one) for name in ("power", "force") if (one := getattr(limits, name)) is not None]
            given = {of: (one.value, one.unit) for name, one in bounds for of in laws_of_kind(pf, name, one)}
            given |= {name: (one.high, one.unit) for name, one in limits.responses.items() if one.high is not None}
            found = {name: value for name, value in given.items() if name in laws.loads}
            loads = {name: value * ratio(unit, laws.loads[name].unit) for name, (value, unit) in found.items()}
        line = pf.load_line
        held = line is not None and line.load in laws.loads
        reference = (
            {line.load: line.reference * ratio(line.unit_load, laws.loads[line.load].unit)} if line and held else {}
        )
        return cls(ranges, loads, reference)


def advise(
    estimate: EdgeEstimate,
    bounds: Bounds,
    conditions: Mapping[str, float],
    minutes: float,
    risk: float = 0.05,
    costs: "CostsSection | None" = None,
    *,
    lost: bool = False,
) -> tuple[Advice, ...]:
    """Advice for the work ahead.

    Parameters
    ----------
    estimate : EdgeEstimate
    bounds : Bounds
    conditions : mapping of float
        Present V, f, d and others.
    minutes : float
        Of contact, of the work ahead at these conditions. A higher feed or speed shortens it in proportion.
    risk : float
        Highest probability of being past the criterion at its end.
    costs : CostsSection, optional
        With them, speed and feed of least cost.
    lost : bool
        Whether a load is lost: no speed or feed above the present one is advised.

    Returns
    -------
    tuple of Advice
        Highest feed and highest speed at the risk; feed that holds the reference load; speed and feed of least cost.

    Raises
    ------
    UsageError
        The minutes are not above zero, or the risk is not between 0 and 1.
    """
    if not (minutes > 0 and np.isfinite(minutes)):
        raise UsageError(f"work of {minutes:g} min: give a time above zero.")
    if not 0 < risk < 1:
        raise UsageError(f"risk {risk:g}: give a probability between 0 and 1, such as 0.05.")
    given = estimate.complete(conditions)
    if estimate.distrusted or lost:  # unknown means slower
        ends = {name: (low, min(high, given[name])) for name, (low, high) in bounds.ranges.items() if name in given}
        bounds = replace(bounds, ranges={name: of for name, of in ends.items() if of[0] < of[1]}, reference={})
    return tuple(_advised(estimate, bounds, given, minutes, risk, costs))


def _advised(
    estimate: EdgeEstimate,
    bounds: Bounds,
    given: Mapping[str, float],
    minutes: float,
    risk: float,
    costs: "CostsSection | None",
) -> Iterator[Advice]:
    symbols: tuple[Literal["f", "V"], ...] = ("f", "V")
    for symbol in symbols:
        if (
            symbol in bounds.ranges
            and symbol in given
            and (one := highest(estimate, symbol, bounds, given, minutes, risk))
        ):
            yield one
    if "f" in bounds.ranges and "f" in given:
        yield from (_for_load(estimate, name, bounds, given, minutes) for name in bounds.reference)
    if costs is not None and {"V", "f", "d"} <= set(given) and {"V", "f"} <= set(bounds.ranges):
        yield from least_cost(estimate, bounds, given, minutes, risk, costs)


def _past(estimate: EdgeEstimate, given: Mapping[str, float], at: Mapping[str, float], minutes: float) -> float:
    """Probability of being past the criterion after the work of ``minutes`` at ``given``, cut at other conditions."""
    share = np.prod([given[name] / at[name] for name in ("V", "f") if name in given])
    return estimate.probability_past(minutes * float(share), at)


def _allowed(estimate: EdgeEstimate, bounds: Bounds, at: Mapping[str, float]) -> bool:
    """Whether every load stays below its limit."""
    return all(estimate.expected_load(name, at, LEVEL).high <= top for name, top in bounds.loads.items())


def highest(
    estimate: EdgeEstimate,
    symbol: Literal["f", "V"],
    bounds: Bounds,
    given: Mapping[str, float],
    minutes: float,
    risk: float,
) -> Advice | None:
    """Highest feed or speed with which the work is cut at the risk and within the bounds; None where there is none."""
    low, high = bounds.ranges[symbol]
    for value in np.geomspace(high, low, STEPS) if low < high else ():
        at = {**given, symbol: float(value)}
        past = _past(estimate, given, at, minutes)
        if past <= risk and _allowed(estimate, bounds, at):
            work = f"{format_probability(past)} of being past the criterion after the work of {minutes:.3g} min"
            loads = "".join(_load(estimate, bounds, name, at) for name in estimate.laws.loads)
            text = f"Highest {_setting(symbol, at, given)}: probability {work}; the limit is {risk:g}{loads}."
            return Advice("feed" if symbol == "f" else "speed", text, past, {symbol: float(value)})
    return None


def _load(estimate: EdgeEstimate, bounds: Bounds, name: str, at: Mapping[str, float]) -> str:
    """A load at these conditions and its limit, as the end of a sentence; empty for one that is not used."""
    if name in estimate.distrusted:
        return ""
    load, top = estimate.expected_load(name, at, LEVEL), bounds.loads.get(name)
    limit = "no limit in the file" if top is None else f"limit {top:.3g}"
    return f"; expected {name} {load.median:.3g} {load.unit}, {limit}"


def _setting(symbol: str, at: Mapping[str, float], given: Mapping[str, float]) -> str:
    """A setting and its change in words."""
    change = at[symbol] / given[symbol] - 1
    moved = "as now" if abs(change) < GAIN else f"{100 * change:+.0f} %"
    return f"{symbol} {at[symbol]:.3g} {USUAL[symbol]} ({moved})"


def _for_load(estimate: EdgeEstimate, name: str, bounds: Bounds, given: Mapping[str, float], minutes: float) -> Advice:
    """The feed that holds the reference load now, or the end of its range that is nearest to it."""
    low, high = bounds.ranges["f"]
    feeds = np.geomspace(low, high, STEPS)
    ln = np.array([estimate.expected_ln(name, {**given, "f": float(f)})[0] for f in feeds])
    target = float(np.log(bounds.reference[name]))
    f = float(np.exp(np.interp(target, ln, np.log(feeds)))) if ln[-1] > ln[0] else low  # unknown means slower
    at = {**given, "f": f}
    past, load = _past(estimate, given, at, minutes), estimate.expected_load(name, at, LEVEL)
    end = "" if low < f < high else f", the {'lower' if f <= low else 'upper'} end of its range"
    return Advice(
        "load",
        f"Constant {name} {bounds.reference[name]:.3g} {load.unit}: {_setting('f', at, given)}{end}; expected {name} "
        f"{load.median:.3g} ({load.low:.3g} to {load.high:.3g}, {100 * LEVEL:g} %); probability "
        f"{format_probability(past)} of being past the criterion after the work of {minutes:.3g} min.",
        past,
        {"f": f},
    )


def least_cost(
    estimate: EdgeEstimate,
    bounds: Bounds,
    given: Mapping[str, float],
    minutes: float,
    risk: float,
    costs: "CostsSection",
) -> Iterator[Advice]:
    """Speed and feed of least cost of 1 cm3, each edge changed at the risk; nothing where the bounds allow none.

    The cost is ``(rate + (change + risk failure) / T) / (V f d)``, T the time of a new edge to the risk.
    """
    fresh = EdgeEstimate(estimate.laws, estimate.criterion)
    fresh.advance(0.0, given)
    per_edge = cost_of_change(costs) + risk * (costs.failure or 0.0)
    best: tuple[float, dict[str, float]] | None = None
    for V in np.geomspace(*bounds.ranges["V"], GRID):
        for f in np.geomspace(*bounds.ranges["f"], GRID):
            at = {**given, "V": float(V), "f": float(f)}
            T = fresh.life(at, 1 - 2 * min(risk, 0.49)).low
            cost = (costs.per_minute + per_edge / T) / (V * f * given["d"]) if T > 0 else np.inf
            if (best is None or cost < best[0]) and np.isfinite(cost) and _allowed(estimate, bounds, at):
                best = float(cost), at
    if best is not None:
        cost, at = best
        past = _past(estimate, given, at, minutes)
        yield Advice(
            "cost",
            f"Least cost {cost:.3g} {costs.currency}/cm3: {_setting('V', at, given)}, {_setting('f', at, given)}, "
            f"edges changed at the risk {risk:g}; with this edge, probability {format_probability(past)} of being past "
            f"the criterion after the work of {minutes:.3g} min.",
            past,
            {"V": at["V"], "f": at["f"]},
        )
