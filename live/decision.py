"""Moment to change an edge at a stated risk or at least cost, and advice of feed and speed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..controllers.economics.age_replacement import change_interval
from ..core.arrays import is_positive
from ..core.errors import UsageError
from .edge_estimate import EdgeEstimate

if TYPE_CHECKING:
    from ..parameters.sections.costs import CostsSection

STEPS = 121  # of feed or speed in the tested range
GAIN = 0.02  # least relative change that is advised


@dataclass(frozen=True, slots=True)
class Advice:
    """A decision or an advice, with its reason.

    Attributes
    ----------
    kind : {"change", "go on", "feed", "speed", "gauge"}
    text : str
        One sentence with its numbers.
    probability : float
        That the wear is past the criterion at the end of the cut that the text speaks of.
    value : float or None
        Of feed or speed, in mm/rev or m/min.
    """

    kind: Literal["change", "go on", "feed", "speed", "gauge"]
    text: str
    probability: float
    value: float | None = None


def change_now(
    estimate: EdgeEstimate,
    risk: float = 0.05,
    next_cut_minutes: float = 0.0,
    conditions: Mapping[str, float] | None = None,
    costs: "CostsSection | None" = None,
) -> Advice:
    """Whether to change the edge before the next cut: at a stated risk, or at least cost where costs are given.

    Parameters
    ----------
    estimate : EdgeEstimate
    risk : float
        Highest probability of being past the criterion at the end of the next cut.
    next_cut_minutes : float
        Minutes of contact of the next cut; 0 asks for now.
    conditions : mapping of float, optional
        Of the next cut; the last ones by default.
    costs : CostsSection, optional
        With a cost of failure: the edge is changed when the expected cost of failing in the next cut exceeds the mean
        cost of an edge over that time (age replacement).

    Raises
    ------
    UsageError
        The risk is not between 0 and 1.
    """
    if not 0 < risk < 1:
        raise UsageError(f"risk {risk:g}: give a probability between 0 and 1, such as 0.05.")
    wear, unit = estimate.laws.wear.symbol, estimate.laws.wear.unit
    after = estimate.probability_past(next_cut_minutes, conditions)
    goal = f"{wear} {estimate.criterion:g} {unit}"
    when = f"after the next cut of {next_cut_minutes:.3g} min" if next_cut_minutes > 0 else "now"
    words = f"probability {_probability(after)} that the wear is past {goal} {when}"
    if costs is not None and (by_cost := _by_cost(estimate, next_cut_minutes, conditions, costs, words)) is not None:
        return by_cost
    if after > risk:
        return Advice("change", f"Change the edge: {words}; the limit is {risk:g}.", after)
    return Advice("go on", f"Go on: {words}; the limit is {risk:g}.", after)


def _probability(value: float) -> str:
    return "< 0.001" if value < 0.001 else f"{value:.2g}"


def _by_cost(
    estimate: EdgeEstimate, minutes: float, conditions: Mapping[str, float] | None, costs: "CostsSection", words: str
) -> Advice | None:
    """The decision of least cost; None where the file does not state the cost of a failure."""
    planned = costs.price_of_edge + costs.per_minute * costs.change
    if costs.failure is None or not is_positive(planned) or not is_positive(costs.failure):
        return None
    fresh = EdgeEstimate(estimate.laws, estimate.criterion)
    fresh.advance(0.0, estimate.complete(conditions or {}))
    life = fresh.life(level=0.68)
    scale = float(np.log(life.high / life.low)) / 2
    rate = change_interval(
        "lognormal", median=life.median, scale=scale, planned=planned, failure=planned + costs.failure
    ).cost
    step = max(minutes, 0.01 * life.median)
    now, after = estimate.probability_past(0.0, conditions), estimate.probability_past(step, conditions)
    share = (after - now) / max(1.0 - now, 1e-9)
    loss = costs.failure * (share if now < 0.5 else 1.0)
    numbers = f"{loss:.3g} {costs.currency} expected of a failure in {step:.3g} min, {rate * step:.3g} for an edge"
    if loss > rate * step:
        return Advice("change", f"Change the edge, at least cost: {numbers}; {words}.", after)
    return Advice("go on", f"Go on, at least cost: {numbers}; {words}.", after)


def highest(
    estimate: EdgeEstimate,
    symbol: Literal["f", "V"],
    conditions: Mapping[str, float],
    minutes: float,
    risk: float = 0.05,
    limits: tuple[float, float] | None = None,
    loads: Mapping[str, float] | None = None,
) -> Advice | None:
    """Highest feed or speed with which the work ahead is cut at the risk, and within limits of the loads.

    The work is what the given conditions would cut in ``minutes``; a higher feed or speed shortens the time of contact
    in proportion. Only tested feeds and speeds are advised.

    Parameters
    ----------
    estimate : EdgeEstimate
    symbol : {"f", "V"}
    conditions : mapping of float
    minutes : float
        Of contact, of the work ahead.
    risk : float
    limits : (float, float), optional
        Of the machine, mm/rev or m/min.
    loads : mapping of float, optional
        Highest load by symbol, in the units of the laws: the 95 % end of its interval stays below it.

    Returns
    -------
    Advice or None
        None where no tested value keeps to the risk and the limits.
    """
    given = estimate.complete(conditions)
    low, high = estimate.laws.wear.ranges.get(symbol, (given[symbol], given[symbol]))
    if limits is not None:
        low, high = max(low, limits[0]), min(high, limits[1])
    for value in np.geomspace(high, low, STEPS) if low < high else ():
        at = {**given, symbol: float(value)}
        past = estimate.probability_past(minutes * given[symbol] / float(value), at)
        if past <= risk and all(estimate.expected_load(s, at, 0.9).high <= top for s, top in (loads or {}).items()):
            return _advice(symbol, float(value), given[symbol], past, minutes)
    return None


def _advice(symbol: Literal["f", "V"], value: float, present: float, past: float, minutes: float) -> Advice:
    unit, kind = ("mm/rev", "feed") if symbol == "f" else ("m/min", "speed")
    change = value / present - 1
    if abs(change) < GAIN:
        text = f"Keep {symbol} {present:.3g} {unit}"
    else:
        text = f"{symbol} {value:.3g} {unit} ({100 * change:+.0f} %)"
    work = f"the work of {minutes:.3g} min at {symbol} {present:.3g}"
    text += f": probability {_probability(past)} of being past the criterion after {work}."
    return Advice("feed" if kind == "feed" else "speed", text, past, value)
