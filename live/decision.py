"""Moment to change an edge, at a stated risk or at least cost."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..controllers.economics.age_replacement import change_interval
from ..core.arrays import is_positive
from ..core.errors import UsageError
from ..core.rounding import format_probability
from .edge_estimate import EdgeEstimate

if TYPE_CHECKING:
    from ..parameters.sections.costs import CostsSection
    from .monitor import Monitor

UNKNOWN = "Not known whether to go on, because {}: by the contact that was counted, {}; the limit is {:g}. {}"


@dataclass(frozen=True, slots=True)
class Doubt:
    """Why it is not known whether to go on, and what to do, as parts of sentences."""

    reason: str
    remedy: str


LOST = Doubt("a load is lost", "Gauge the edge, and acknowledge the alarm once the load is read again.")
UNREAD = Doubt(
    "a part was cut at conditions that were not read or far from the tests",
    "Gauge the edge, and acknowledge the alarm once they are as tested.",
)
FAR_REMEDY = "Check the unit, or fit laws to tests at such conditions."


@dataclass(frozen=True, slots=True)
class Advice:
    """A decision or an advice, with its reason.

    Attributes
    ----------
    kind : {"change", "go on", "not known", "feed", "speed", "load", "cost"}
    text : str
        One sentence with its numbers.
    probability : float
        That the wear is past the criterion at the end of the cut that the text is about.
    settings : mapping of float
        V in m/min and f in mm/rev that are advised.
    """

    kind: Literal["change", "go on", "not known", "feed", "speed", "load", "cost"]
    text: str
    probability: float
    settings: Mapping[str, float] = field(default_factory=dict)


def change_now(
    estimate: EdgeEstimate,
    risk: float = 0.05,
    next_cut_minutes: float = 0.0,
    conditions: Mapping[str, float] | None = None,
    costs: "CostsSection | None" = None,
    *,
    doubts: Sequence[Doubt] = (),
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
    doubts : sequence of Doubt
        Where there are any, such as a load that is lost, it is not advised to go on.

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
    words = f"probability {format_probability(after)} that the wear is past {goal} {when}"
    if estimate.distrusted:
        words += f" (without {', '.join(estimate.distrusted)}, which is far from its law)"
    found = _by_cost(estimate, next_cut_minutes, conditions, costs, words) or _by_risk(words, after, risk)
    if not doubts or found.kind == "change":
        return found
    reasons, remedies = " and ".join(one.reason for one in doubts), " ".join(one.remedy for one in doubts)
    return Advice("not known", UNKNOWN.format(reasons, words, risk, remedies), after)


def doubts_of(monitor: "Monitor") -> list[Doubt]:
    """Why it is not known whether to go on with the edge of a watch; none where it is."""
    found = [LOST] if monitor.alarmed("load") else []
    if far := monitor.laws.far(monitor.conditions):
        found.append(Doubt(" and ".join(far.values()), FAR_REMEDY))
    elif monitor.uncounted > 0 or monitor.alarmed("conditions"):
        found.append(UNREAD)
    return found


def _by_risk(words: str, after: float, risk: float) -> Advice:
    if after > risk:
        return Advice("change", f"Change the edge: {words}; the limit is {risk:g}.", after)
    return Advice("go on", f"Go on: {words}; the limit is {risk:g}.", after)


def cost_of_change(costs: "CostsSection") -> float:
    """Cost of an edge and of the time in which it is changed."""
    return costs.price_of_edge + costs.per_minute * costs.change


def _by_cost(
    estimate: EdgeEstimate,
    minutes: float,
    conditions: Mapping[str, float] | None,
    costs: "CostsSection | None",
    words: str,
) -> Advice | None:
    """The decision of least cost; None where the file does not state the cost of a failure."""
    planned = cost_of_change(costs) if costs is not None else 0.0
    if costs is None or costs.failure is None or not is_positive(planned) or not is_positive(costs.failure):
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
