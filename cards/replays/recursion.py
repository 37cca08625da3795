"""Report on the recursion of AC-2017: life, metal removed, limits, alternative readings, fixed pair, and draws."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

from ...controllers.economics.part_cost import cost_of_edge
from ...controllers.recursion.controller import TurningRecursion, WearingEdge
from ...controllers.recursion.distribution import LifeDraws, life_draws
from ...controllers.recursion.from_file import depth, life_laws, shortfall
from ...controllers.recursion.interval_optimum import not_convex
from ...controllers.recursion.laws import LifeLaws, Rules
from ...controllers.recursion.life import Life, apply_plan, best_fixed, life_ratios, whole_life
from . import Replayed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...parameters import ParameterFile
    from ...parameters.draws import Draws
    from ...parameters.sections.costs import CostsSection

TITLE = "Recursive turning to the end of an edge (AC-2017: Alaskari and Oraby 2017)"
CALCULATED = "All results are calculated from the laws of the file; none is measured."
CAUTION = "Each interval is optimized for itself; a sequence with less wear at first may remove more in the whole life."
COUNTED = {
    "full": "with the time factors of all laws",
    "published": "without the time factors of power and force (as in the paper)",
}
ENDS = {"most speed": "the upper limit of speed", "most feed": "the upper limit of feed"}
STATE = "Wear accumulation from the wear state is a reconstruction: the paper uses the time (eq. 4)."

Three = tuple[LifeDraws, LifeDraws, LifeDraws]  # plan on the law, plan on new edges, each draw its own


def lacks(pf: "ParameterFile") -> str:
    """Reason why a file cannot drive the recursion; empty where it can."""
    return shortfall(pf)


def replayed(pf: "ParameterFile", draws: "Mapping[str, Draws]", seed: int) -> Replayed:
    """Report on the recursion, its alternative readings, the exact optimum, a fixed pair, and the draws."""
    laws = life_laws(pf)
    rules = Rules(laws.times)
    life = whole_life(laws)
    exact = None if not_convex(laws) else whole_life(laws, rules, how="exact")
    found = drawn(laws, draws, rules, seed)
    lines = [*_life_lines(life), *_reading_lines(life), *_exact_lines(life, exact), *fixed_lines(life)]
    lines += cost_lines(life, pf.costs)
    return Replayed(
        system="recursion",
        title=TITLE,
        lines=(*lines, *draw_lines(found, draws)),
        assumed=(*_assumed(pf, laws), *laws.notes, CALCULATED, STATE, CAUTION),
        facts={**_facts(life, exact, found), "best_fixed": fixed_facts(life), "replay_agrees": _agrees(pf, life)},
        figures=_figures(life, exact, found),
    )


def _agrees(pf: "ParameterFile", life: Life) -> bool:
    """Whether the controller, step by step on an edge of the same laws, chooses the pairs and the end of the life."""
    from ...controllers.loop import replay

    step, n = 60 * life.rules.interval, len(life.time)
    edge = WearingEdge(life.laws)
    trace = replay(TurningRecursion.from_parameters(pf), edge, duration=(n + 1) * step, dt=step, until="worn out")
    pairs = [[V, f] for V, f in zip(life.V.tolist(), life.f.tolist(), strict=True)]
    return trace.command[:n].tolist() == pairs and trace.first("worn out") == (n * step if life.ended else None)


def _life_lines(life: Life) -> list[str]:
    laws = life.laws
    if not len(life.time):
        broken = " and ".join(name for name, by in life.surfaces(0).breaks.items() if by.any())
        return [f"No pair of the grid is within the limits of a new edge ({broken})."]
    end = "is worn out" if life.ended else "is not worn out (computation stopped)"
    first = (
        f"The edge {end} after {life.minutes:g} min and {metal(life.removed)}, {metal(life.per_minute)} per min, "
        f"from {life.V[0]:g} m/min and {life.f[0]:g} mm/rev in the first to {life.V[-1]:g} and {life.f[-1]:g} in "
        "the last interval, "
        f"d {laws.d:g} mm."
    )
    return [first, _binding(life), *([_end(life)] if life.ended else [])]


def _binding(life: Life) -> str:
    """Active limits by interval."""
    parts, k = [], 0
    for stops, group in groupby(life.stops):
        n = len(list(group))
        parts.append(f"{listed([ENDS.get(stop, stop) for stop in stops]) or 'none'} in {_span(life, k, k + n)}")
        k += n
    return f"Active limits: {'; '.join(parts)}."


def _end(life: Life) -> str:
    k = len(life.time)
    breaks = life.surfaces(k).breaks
    wear, criterion = life.laws.wear, f"{life.laws.wear.most:g} {life.laws.wear.unit}"
    reached = f"At the end {wear.response} is {life.AW[-1]:.3g} {wear.unit}"
    if breaks["wear"].all():
        return f"{reached}; every pair of the grid would exceed {criterion} in the next interval."
    others = listed([name for name, broken in breaks.items() if name != "wear" and broken.any()])
    return f"{reached}; the pairs that keep it below {criterion} in the next interval exceed the limits of {others}."


def _reading_lines(life: Life) -> list[str]:
    """Effect on life and metal of the time factors and of the rule of wear accumulation."""
    if not len(life.time):
        return []
    laws, rules = life.laws, life.rules
    other = Rules("full" if rules.times == "published" else "published", rules.wear, rules.interval)
    alternative, state = whole_life(laws, other, life.grid), Rules(rules.times, "wear_state", rules.interval)
    own, held = whole_life(laws, state, life.grid), apply_plan(life, laws, state)
    return [
        f"This plan is computed {COUNTED[rules.times]}; {COUNTED[other.times]}: {_lasts(alternative)}, "
        f"{_more(alternative, life)}.{_wrong_times(life, alternative)}",
        f"Wear accumulates by time in this plan; by the wear state: {_lasts(own)}, {_more(own, life)}.",
        f"This plan on edges that wear by the wear state: {_lasts(held)}, {_more(held, life)}.",
    ]


def _wrong_times(life: Life, alternative: Life) -> str:
    """Peak power and force of the plan with all time factors if these do not apply."""
    full = alternative if alternative.rules.times == "full" else life
    taken = apply_plan(full, life.laws, Rules("published", life.rules.wear, life.rules.interval))
    values = {"power": taken.P, "force": taken.Fxz}
    peaks = [
        f"{rounded(float(values[name].max()))} {terms.unit}" for name, terms in life.laws.limited if len(taken.time)
    ]
    return f" Without the time factors, the plan that uses them reaches {listed(peaks)}." if peaks else ""


def _exact_lines(life: Life, exact: Life | None) -> list[str]:
    if exact is None:
        return [f"No exact optimum: {not_convex(life.laws)}"]
    if not len(life.time) or not len(exact.time):
        return []
    return [
        f"With the exact optimum of each interval instead of the best pair of the grid: {_lasts(exact)}, "
        f"{_more(exact, life)}, {exact.V[0]:.1f} m/min and {exact.f[0]:.3f} mm/rev in the first interval."
    ]


def _assumed(pf: "ParameterFile", laws: LifeLaws) -> tuple[str, ...]:
    times = (
        "The time factors of power and force are omitted, as in eq. 6 and 7 of the paper and its tables."
        if laws.times == "published"
        else "The time factors of all laws apply; the tables of the paper omit those of power and force."
    )
    tested = any(factor.symbol == "d" for law in pf.laws.values() for factor in law.factors)
    why = "the papers'" if depth(pf) == 2.5 else "the middle of the tested depths" if tested else "no law has a depth"
    return (f"Depth of cut {laws.d:g} mm ({why}), intervals of 1 min, steps of 10 m/min and 0.005 mm/rev.", times)


def _facts(life: Life, exact: Life | None, found: Three | None) -> dict[str, object]:
    facts: dict[str, object] = {
        "depth_mm": life.laws.d,
        "times": life.rules.times,
        "wear": life.rules.wear,
        "life_min": life.minutes,
        "removed_mm3": life.removed,
        "removed_mm3_per_min": life.per_minute,
        "intervals": [
            {"end_min": float(t), "V_m_per_min": float(V), "f_mm_per_rev": float(f), "MRR_mm3_per_min": float(rate),
             "stops": list(stops)}
            for t, V, f, rate, stops in zip(life.time, life.V, life.f, life.MRR, life.stops, strict=True)
        ],
        "exact_life_min": None if exact is None else exact.minutes,
        "exact_removed_mm3": None if exact is None else exact.removed,
    }  # fmt: skip
    for times in ("published", "full"):
        for wear in ("clock", "wear_state"):
            other = whole_life(life.laws, Rules(times, wear, life.rules.interval), life.grid)
            facts[f"{times}_{wear}"] = {"life_min": other.minutes, "removed_mm3": other.removed}
    for name, of in zip(("plan", "plan_new_edges", "own"), found or (), strict=False):
        ends = {key: of.band(what, LEVEL) for what, key in (("minutes", "life_min"), ("removed", "removed_mm3"))}
        facts[f"draws_{name}"] = {
            "draws": len(of.minutes), "level": LEVEL, "ends_early": of.ends_early,
            **{key: {"low": low, "median": middle, "high": high} for key, (low, middle, high) in ends.items()},
        }  # fmt: skip
    return facts


def _figures(life: Life, exact: Life | None, found: Three | None) -> "dict[str, Figure]":
    from ...controllers.recursion.figures import draws_figure, life_figure, pairs_figure, plane_figure, speeds_figure

    if not len(life.time):
        return {"recursion_first_plane": plane_figure(life, 0)}
    figures = {
        "recursion_life": life_figure(life, exact),
        "recursion_pairs": pairs_figure(life, exact),
        "recursion_first_speeds": speeds_figure(life, 0),
        "recursion_first_plane": plane_figure(life, 0),
        "recursion_last_plane": plane_figure(life, len(life.time) - 1),
    }
    return figures if found is None else {**figures, "recursion_draws": draws_figure(found[0], found[2])}


def _lasts(life: Life) -> str:
    return f"{life.minutes:g} min and {metal(life.removed)}"


def _more(life: Life, than: Life) -> str:
    share = life.removed / than.removed - 1
    return f"{100 * abs(share):.1f} % {'more' if share >= 0 else 'less'} metal"


def _span(life: Life, first: int, end: int) -> str:
    step = life.rules.interval
    if step != 1:
        return f"{first * step:g} to {end * step:g} min"
    return f"minute {end}" if end == first + 1 else f"minutes {first + 1} to {end}"


LEVEL = 0.95
OWN = 1000  # draws that each run a recursion


def drawn(laws: LifeLaws, draws: "Mapping[str, Draws]", rules: Rules, seed: int) -> Three | None:
    """Plan on the law's draws, plan on new edges, and each draw's own; None without draws of the laws used."""
    used = {laws.wear.response, *(terms.response for _, terms in laws.limited)} & set(draws)
    if not used:
        return None
    return (
        life_draws(laws, draws, rules=rules, seed=seed),
        life_draws(laws, draws, rules=rules, seed=seed, edge="new"),
        life_draws(laws, draws, rules=rules, seed=seed, of="own", count=OWN),
    )


def draw_lines(found: Three | None, draws: "Mapping[str, Draws]") -> list[str]:
    """Bands of life and metal removed over the draws, or the reason why there are none."""
    if found is None:
        available = f"of {', '.join(draws)} only" if draws else "none"
        return [
            f"Draws: {available}, so no band of life or metal removed; `fitmodels data.csv` makes draws when it fits."
        ]
    plan, new, own = found
    band = f"{100 * LEVEL:g} % band"
    lines = [
        f"This plan on edges of {len(plan.minutes)} drawn laws, the last pair held to the end: "
        f"{_bands(plan)} ({band} of the law, equal-tailed); {_share(plan.ends_early)} are worn out before the plan "
        "ends.",
        f"On single new edges, with variation between edges: {_bands(new)} ({band} of edges); "
        f"{_share(new.ends_early)} are "
        "worn out before the plan ends.",
        f"With an own plan for each of {len(own.minutes)} drawn laws: {_bands(own)} ({band} of the law).",
        *_peak_lines(plan, band),
    ]
    if plan.left_out or plan.unended:
        lines.append(f"{plan.left_out} draws without growing wear are excluded; {plan.unended} lives were truncated.")
    return lines


def _peak_lines(plan: LifeDraws, band: str) -> list[str]:
    """Power and force of the plan, draw by draw."""
    lines = []
    for what, terms in (("peak_power", plan.plan.laws.power), ("peak_force", plan.plan.laws.force)):
        values = getattr(plan, what)
        if terms is None or values is None:
            continue
        low, middle, high = (rounded(end) for end in plan.band(what, LEVEL))
        passes = _share(float((values > terms.most).mean()))
        lines.append(
            f"The plan's peak {what[5:]} is {low} to {high} {terms.unit}, median {middle} ({band} of the law), and "
            f"exceeds {terms.most:g} {terms.unit} in {passes} of the draws."
        )
    return lines


def _bands(found: LifeDraws) -> str:
    low, middle, high = found.band("minutes", LEVEL)
    least, half, most = (end / 1000 for end in found.band("removed", LEVEL))
    return (
        f"life {low:.3g} to {high:.3g} min, median {middle:.3g}, and {least:.0f} to {most:.0f} cm3 removed, "
        f"median {half:.0f}"
    )


def _share(share: float) -> str:
    return f"{100 * share:.0f} %"


def rounded(value: float) -> str:
    """A force to the newton, a power to three digits."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def fixed_lines(life: Life) -> list[str]:
    """Metal, life, peak power and peak force of the best fixed pair, compared with the recursion."""
    fixed = best_fixed(life.laws, life.rules, life.grid) if len(life.time) else None
    if fixed is None:
        return []
    ratio, peaks = life_ratios(life, fixed), {"power": fixed.peak_power, "force": fixed.peak_force}
    own = {"power": life.P, "force": life.Fxz}
    compared = [
        f"{name} {rounded(peaks[name])} {terms.unit} against {rounded(float(own[name].max()))}"
        for name, terms in life.laws.limited
    ]
    return [
        f"The best fixed pair within the limits to the end, {fixed.V:g} m/min and {fixed.f:g} mm/rev, lasts "
        f"{fixed.minutes:.1f} min and removes {metal(fixed.removed)}, {metal(fixed.per_minute)} per min: the "
        f"recursion removes {ratio.per_minute:.2f} times as much per minute and {ratio.removed:.2f} times as much "
        "per edge"
        f"{f'; peaks of the fixed pair: {listed(compared)}' if compared else ''}."
    ]


def cost_lines(life: Life, costs: "CostsSection | None") -> list[str]:
    """Cost and rate of an edge under the plan and at the best fixed pair, with its change, where the file has costs."""
    if costs is None or not len(life.time):
        return []
    plan = cost_of_edge(costs, life.minutes, life.removed)
    words = f"{plan[0]:.4g} {costs.currency} per cm3 and {plan[1]:.4g} cm3/min"
    fixed = best_fixed(life.laws, life.rules, life.grid)
    other = ""
    if fixed is not None:
        pair = cost_of_edge(costs, fixed.minutes, fixed.removed)
        other = f"; at the best fixed pair {pair[0]:.4g} and {pair[1]:.4g}"
    return [
        f"With the costs of the file and a change of {costs.change:g} min, the plan costs and removes {words}{other}."
    ]


def fixed_facts(life: Life) -> dict[str, object] | None:
    """Numbers of the best fixed pair; power and force where they are limited."""
    fixed = best_fixed(life.laws, life.rules, life.grid) if len(life.time) else None
    if fixed is None:
        return None
    peaks = {"power": fixed.peak_power, "force": fixed.peak_force}
    return {
        "V_m_per_min": fixed.V, "f_mm_per_rev": fixed.f, "life_min": fixed.minutes, "removed_mm3": fixed.removed,
        "removed_mm3_per_min": fixed.per_minute,
        **{f"peak_{name}_{terms.unit}": peaks[name] for name, terms in life.laws.limited},
    }  # fmt: skip


def metal(volume: float) -> str:
    """Metal in cm3; the facts have mm3 in full."""
    return f"{volume / 1000:.4g} cm3"


def listed(names: Sequence[str]) -> str:
    """Names with an ``and`` before the last."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 2 else names)
