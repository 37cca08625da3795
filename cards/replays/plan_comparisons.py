"""Comparisons of a plan of turning: other readings of the paper, best sequence, exact optimum, fixed pair, cost."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from ...controllers.economics.part_cost import cost_of_edge
from ...controllers.recursion.interval_optimum import not_convex
from ...controllers.recursion.laws import Rules, WearRule
from ...controllers.recursion.life import FixedLife, Life, apply_plan, best_fixed, life_ratios, whole_life
from ...controllers.recursion.plan import Plan
from ...controllers.recursion.sequence import BestSequence, best_sequence
from ...core.rounding import join_words

if TYPE_CHECKING:
    from ...parameters.sections.costs import CostsSection

COUNTED = {
    "full": "with the time factors of all laws",
    "published": "without the time factors of power and force (as in the paper)",
}
WEARS: Mapping[WearRule, str] = {"clock": "time", "wear_state": "the wear state"}
OTHER: Mapping[WearRule, WearRule] = {"clock": "wear_state", "wear_state": "clock"}
STATE_RULE: WearRule = "wear_state"
MOST_COMPARED = 60  # intervals up to which a best sequence is computed beside the recursion


def greedy_lines(plan: Plan, costs: "CostsSection | None", most: int) -> list[str]:
    """The recursion of the paper at the same settings, against a plan for another objective; and the bound."""
    life, asked = plan.life, plan.options.objective
    greedy = whole_life(life.laws, life.rules, life.grid, most=most)
    lines = []
    if plan.bound is not None:
        span = f"{life.minutes:g} min"
        lines.append(f"No sequence of pairs of the grid removes more than {metal(plan.bound)} in {span}.")
    if plan.least is not None:
        lines.append(
            f"No sequence costs less than {cost_words(plan.least)} (lives to 1.25 times the least cost compared)."
        )
    if life.rules.wear == "clock" and len(life.time):
        lines.append(_by_state(life))
    if not len(greedy.time):
        return lines
    cost = ""
    if costs is not None:
        cost = f", {cost_words((cost_of_edge(costs, greedy.minutes, greedy.removed)[0], costs.currency))}"
    against = f"{_more(life, greedy)} than with" if asked != "life" else "against"
    lines.append(
        f"{against[:1].upper()}{against[1:]} the largest removal rate of each interval for itself: that gives "
        f"{_lasts(greedy)}{cost}."
    )
    return lines


def _by_state(life: Life) -> str:
    """Outcome of a plan by the time on an edge that wears by the wear state."""
    count = len(life.time)
    held = apply_plan(life, life.laws, Rules(life.rules.times, STATE_RULE, life.rules.interval), count)
    values = {"power": held.P, "force": held.Fxz}
    peaks = [
        f"{rounded(float(values[name].max(initial=0.0)))} {terms.unit} of {terms.most:g}"
        for name, terms in life.laws.limited
    ]
    end = _lasts(held) if len(held.time) < count else "as long"
    taken = f", with peaks of {join_words(peaks)}" if peaks else ""
    return f"On edges that wear by the wear state this plan lasts {end}{taken}."


def reading_lines(life: Life, most: int) -> list[str]:
    """Effect on life and metal of the time factors and of the rule of wear accumulation."""
    if not len(life.time):
        return []
    laws, rules = life.laws, life.rules
    other = Rules("full" if rules.times == "published" else "published", rules.wear, rules.interval)
    alternative = whole_life(laws, other, life.grid, most=most)
    turned = Rules(rules.times, OTHER[rules.wear], rules.interval)
    own, held = whole_life(laws, turned, life.grid, most=most), apply_plan(life, laws, turned, most)
    this, by = WEARS[rules.wear], WEARS[turned.wear]
    return [
        f"This plan is computed {COUNTED[rules.times]}; {COUNTED[other.times]}: {_lasts(alternative)}, "
        f"{_more(alternative, life)}.{_wrong_times(life, alternative)}",
        f"Wear accumulates by {this} in this plan; by {by}: {_lasts(own)}, {_more(own, life)}.",
        f"This plan on edges that wear by {by}: {_lasts(held)}, {_more(held, life)}.",
    ]


def _wrong_times(life: Life, alternative: Life) -> str:
    """Peak power and force of the plan with all time factors if these do not apply."""
    full = alternative if alternative.rules.times == "full" else life
    taken = apply_plan(full, life.laws, Rules("published", life.rules.wear, life.rules.interval))
    values = {"power": taken.P, "force": taken.Fxz}
    peaks = [
        f"{rounded(float(values[name].max()))} {terms.unit}" for name, terms in life.laws.limited if len(taken.time)
    ]
    return f" Without the time factors, the plan that uses them reaches {join_words(peaks)}." if peaks else ""


def best_of(life: Life) -> dict[WearRule, tuple[Life, BestSequence]]:
    """The recursion and the best sequence of its time, by the rule of the plan and by the wear state; empty if long."""
    if not 0 < len(life.time) <= MOST_COMPARED or not_convex(life.laws):
        return {}
    found: dict[WearRule, tuple[Life, BestSequence]] = {}
    for wear in dict.fromkeys((life.rules.wear, STATE_RULE)):
        rules = replace(life.rules, wear=wear)
        greedy = life if wear == life.rules.wear else whole_life(life.laws, rules, life.grid, most=len(life.time))
        if len(greedy.time):
            found[wear] = greedy, best_sequence(life.laws, rules, life.grid, len(greedy.time), greedy)
    return found


def sequence_lines(life: Life, best: Mapping[WearRule, tuple[Life, BestSequence]]) -> list[str]:
    """Gain of a best sequence of the same time over the recursion, with the bound of all sequences."""
    lines = []
    for wear, (greedy, found) in best.items():
        gain = (
            f"the best sequence of its {greedy.minutes:g} min removes {metal(found.life.removed)}, "
            f"{_more(found.life, greedy)} (no sequence of the grid more than {metal(found.bound)})"
        )
        if wear == life.rules.wear:
            why = "; by the time, wear late in a life is small whatever was cut before" if wear == "clock" else ""
            lines.append(f"{gain[:1].upper()}{gain[1:]}{why}.")
        else:
            lines.append(f"By {WEARS[wear]} the recursion removes {metal(greedy.removed)}, and {gain}.")
    return lines


def sequence_facts(best: Mapping[WearRule, tuple[Life, BestSequence]]) -> dict[str, object]:
    """Numbers of the best sequences by the rule of wear."""
    return {
        f"best_sequence_{wear}": {
            "life_min": greedy.minutes, "recursion_mm3": greedy.removed, "removed_mm3": found.life.removed,
            "bound_mm3": found.bound,
        }
        for wear, (greedy, found) in best.items()
    }  # fmt: skip


def exact_lines(life: Life, exact: Life | None) -> list[str]:
    """The exact optimum of each interval against the best pair of the grid."""
    if exact is None:
        return [f"No exact optimum: {not_convex(life.laws)}"]
    if not len(life.time) or not len(exact.time):
        return []
    return [
        f"With the exact optimum of each interval instead of the best pair of the grid: {_lasts(exact)}, "
        f"{_more(exact, life)}, {exact.V[0]:.1f} m/min and {exact.f[0]:.3f} mm/rev in the first interval."
    ]


def fixed_of(plan: Plan, costs: "CostsSection | None") -> FixedLife | None:
    """The fixed pair that is best by the objective of a plan and keeps its limits; None where none does."""
    life, options = plan.life, plan.options
    if not len(life.time):
        return None
    find = partial(best_fixed, life.laws, life.rules, life.grid)
    if options.objective == "life":
        return find("minutes", rate=options.removal or 0.0)
    if options.objective == "time":
        return find(until=life.minutes)
    if options.objective == "cost" and costs is not None:
        return find((costs.per_minute * costs.change + costs.price_of_edge, costs.per_minute))
    return find()


def fixed_lines(plan: Plan, fixed: FixedLife | None) -> list[str]:
    """Metal, life, peak power and peak force of the best fixed pair by the objective, compared with the plan."""
    life = plan.life
    if fixed is None:
        return []
    pair, pairs = f"{fixed.V:g} m/min and {fixed.f:g} mm/rev", _pairs(life)
    if pairs == {(fixed.V, fixed.f)}:
        return [f"The plan is one fixed pair, {pair} in every interval: {_best(plan, 'the fixed pair')}."]
    same = "The plan is a fixed pair, too. " if len(pairs) == 1 else ""
    ratio, peaks = life_ratios(life, fixed), {"power": fixed.peak_power, "force": fixed.peak_force}
    longer = f"lasts {ratio.minutes:.2f} times as long, and " if plan.options.objective == "life" else ""
    own = {"power": life.P, "force": life.Fxz}
    compared = [
        f"{name} {rounded(peaks[name])} {terms.unit} against {rounded(float(own[name].max()))}"
        for name, terms in life.laws.limited
    ]
    return [
        f"{same}{_best(plan, 'The fixed pair')}, {pair}, lasts "
        f"{fixed.minutes:.1f} min and removes {metal(fixed.removed)}, {metal(fixed.per_minute)} per min: the "
        f"plan {longer}removes {ratio.per_minute:.2f} times as much per minute and {ratio.removed:.2f} times as much "
        "per edge"
        f"{f'; peaks of the fixed pair: {join_words(compared)}' if compared else ''}."
    ]


def _pairs(life: Life) -> set[tuple[float, float]]:
    """The different pairs of a plan."""
    return set(zip(life.V.tolist(), life.f.tolist(), strict=True))


def _best(plan: Plan, head: str) -> str:
    """What the best fixed pair is by the objective of a plan."""
    least, time = metal(plan.options.removal or 0), f"{plan.life.minutes:g} min"
    return {
        "life": f"{head} of longest life, within the limits to the end, that removes {least} per min or more",
        "cost": f"{head} of least cost within the limits to the end",
        "time": f"{head} that removes most in {time} within the limits",
    }.get(plan.options.objective, f"{head.replace('fixed', 'best fixed')} within the limits to the end")


def fixed_facts(life: Life, fixed: FixedLife | None) -> dict[str, object] | None:
    """Numbers of the best fixed pair; power and force where they are limited."""
    if fixed is None:
        return None
    peaks = {"power": fixed.peak_power, "force": fixed.peak_force}
    return {
        "V_m_per_min": fixed.V, "f_mm_per_rev": fixed.f, "life_min": fixed.minutes, "removed_mm3": fixed.removed,
        "removed_mm3_per_min": fixed.per_minute,
        **{f"peak_{name}_{terms.unit}": peaks[name] for name, terms in life.laws.limited},
    }  # fmt: skip


def cost_lines(life: Life, costs: "CostsSection | None", fixed: FixedLife | None) -> list[str]:
    """Cost and rate of an edge under the plan and at the best fixed pair, with its change, where the file has costs."""
    if costs is None or not len(life.time):
        return []
    plan = cost_of_edge(costs, life.minutes, life.removed)
    words = f"{plan[0]:.4g} {costs.currency} per cm3 and {plan[1]:.4g} cm3/min"
    other = ""
    if fixed is not None and _pairs(life) != {(fixed.V, fixed.f)}:
        pair = cost_of_edge(costs, fixed.minutes, fixed.removed)
        other = f"; at the best fixed pair {pair[0]:.4g} and {pair[1]:.4g}"
    return [
        f"With the costs of the file and a change of {costs.change:g} min, the plan costs and removes {words}{other}."
    ]


def _lasts(life: Life) -> str:
    return f"{life.minutes:g} min and {metal(life.removed)}"


def _more(life: Life, than: Life) -> str:
    share = life.removed / than.removed - 1
    return f"{100 * abs(share):.1f} % {'more' if share >= 0 else 'less'} metal"


def cost_words(cost: tuple[float, str] | None) -> str:
    """A cost per cm3 with its currency."""
    return "" if cost is None else f"{cost[0]:.4g} {cost[1]} per cm3"


def metal(volume: float) -> str:
    """Metal in cm3; the facts have mm3 in full."""
    return f"{volume / 1000:.4g} cm3"


def rounded(value: float) -> str:
    """A force to the newton, a power to three digits."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
