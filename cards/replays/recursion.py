"""Report on the recursion of AC-2017: life, metal removed, limits, alternative readings, fixed pair, and draws."""

from collections.abc import Mapping
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from ...controllers.recursion.controller import TurningRecursion, WearingEdge
from ...controllers.recursion.distribution import LifeDraws, life_draws, responses
from ...controllers.recursion.from_file import shortfall
from ...controllers.recursion.interval_optimum import not_convex
from ...controllers.recursion.laws import Rules
from ...controllers.recursion.life import Life, no_pair, whole_life
from ...controllers.recursion.plan import ENDS, Plan, PlanOptions, PlanRow, intervals_in, plan_of
from ...core.rounding import join_words
from . import Replayed
from .plan_comparisons import (
    best_of,
    cost_lines,
    cost_words,
    exact_lines,
    fixed_facts,
    fixed_lines,
    fixed_of,
    greedy_lines,
    metal,
    reading_lines,
    rounded,
    sequence_facts,
    sequence_lines,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...parameters import ParameterFile
    from ...parameters.draws import Draws

TITLE = "Recursive turning to the end of an edge (AC-2017: Alaskari and Oraby 2017)"
CALCULATED = "All results are calculated from the laws of the file; none is measured."
CAUTION = "Each interval is optimized for itself; a sequence with less wear at first may remove more in the whole life."
STATE = "Wear accumulation from the wear state is a reconstruction: the paper uses the time (eq. 4)."


Found = tuple[LifeDraws, LifeDraws, LifeDraws | None]  # plan on the law, plan on new edges, each draw its own


def lacks(pf: "ParameterFile", options: PlanOptions | None = None) -> str:
    """Reason why a file cannot drive the recursion; empty where it can."""
    asked = options or PlanOptions()
    return shortfall(pf, d=asked.depth, by=asked.by, at=asked.at)


def replayed(
    pf: "ParameterFile", draws: "Mapping[str, Draws]", seed: int, options: PlanOptions | None = None
) -> Replayed:
    """Report on a plan: by default on the recursion, its alternative readings, the exact optimum and a fixed pair."""
    plan = plan_of(pf, None, options, seed)
    life, greedy = plan.life, plan.options.objective == "removal"
    most = intervals_in(plan.options, life.rules)
    exact = None
    if greedy and not not_convex(life.laws):
        exact = whole_life(life.laws, life.rules, life.grid, how="exact", most=most)
    found = drawn(life, draws, seed, own=greedy, most=most)
    best = best_of(life) if greedy else {}
    head, *more = _life_lines(plan)
    lines = [head, *plan.extrapolated, *more]
    if greedy:
        lines += [*reading_lines(life, most), *sequence_lines(life, best), *exact_lines(life, exact)]
    else:
        lines += greedy_lines(plan, pf.costs, most)
    fixed = fixed_of(plan, pf.costs)
    lines += [*fixed_lines(plan, fixed), *cost_lines(life, pf.costs, fixed)]
    cautions = (CALCULATED, STATE, *((CAUTION,) if greedy else ()))
    return Replayed(
        system="recursion",
        title=TITLE,
        lines=(*lines, *draw_lines(found, draws)),
        assumed=(*plan.assumed, _times(life.rules), *cautions),
        facts={
            **_facts(plan, exact, found), **sequence_facts(best), "best_fixed": fixed_facts(life, fixed),
            "replay_agrees": _agrees(plan),
        },
        figures=_figures(life, exact, found),
    )  # fmt: skip


def _agrees(plan: Plan) -> bool:
    """Whether the controller, or the pairs of the plan, give the same life step by step on an edge of the same laws."""
    from ...controllers.loop import replay

    life = plan.life
    step, n = 60 * life.rules.interval, len(life.time)
    pairs = [[V, f] for V, f in zip(life.V.tolist(), life.f.tolist(), strict=True)]
    edge = WearingEdge(life.laws, life.rules)
    if plan.options.objective != "removal":
        rng = np.random.default_rng(1)
        return bool(np.allclose([edge.step((V, f), step, rng) for V, f in pairs], life.AW, rtol=1e-9, atol=0))
    controller = TurningRecursion(life.laws, life.rules, life.grid)
    trace = replay(controller, edge, duration=(n + 1) * step, dt=step, until="worn out")
    same_end = not life.ended or trace.first("worn out") == n * step
    return trace.command[:n].tolist() == pairs and same_end


def _life_lines(plan: Plan) -> list[str]:
    life, laws = plan.life, plan.laws
    if not len(life.time):
        return [f"N{no_pair(life)[1:]}"]
    first = (
        f"{_objective(plan)} after {life.minutes:g} min and {metal(life.removed)}, {metal(life.per_minute)} per min, "
        f"from {life.V[0]:g} m/min and {life.f[0]:g} mm/rev in the first to {life.V[-1]:g} and {life.f[-1]:g} in "
        "the last interval, "
        f"d {laws.d:g} mm."
    )
    held = [] if plan.options.objective == "life" else [_binding(life)]  # least wear decides, not a limit
    return [first, *held, _end(plan) if life.ended else _worn_share(life)]


def _objective(plan: Plan) -> str:
    """Beginning of the main sentence: what was planned, and how it ends."""
    options, life = plan.options, plan.life
    end = "is worn out" if life.ended else "is not worn out (computation stopped)"
    if not life.ended and (options.time is not None or options.objective in ("cost", "time")):
        end = "is changed, not worn out by then," if options.objective == "cost" else "is not worn out"
    heads = {
        "removal": "The edge",
        "life": f"Longest life at {metal(options.removal or 0)} per min or more in every interval: the edge",
        "cost": f"Least cost, {cost_words(plan.cost)}: the edge",
        "time": f"Most metal in {life.minutes:g} min: the edge",
    }
    return f"{heads[options.objective]} {end}"


def _worn_share(life: Life) -> str:
    """Wear at the end of a plan that ends before the edge does."""
    wear = life.laws.wear
    return f"At the end {wear.response} is {life.AW[-1]:.3g} {wear.unit} of {wear.most:g}."


def _binding(life: Life) -> str:
    """Active limits by interval."""
    parts, k = [], 0
    for stops, group in groupby(life.stops):
        n = len(list(group))
        parts.append(f"{join_words([ENDS.get(stop, stop) for stop in stops]) or 'none'} in {_span(life, k, k + n)}")
        k += n
    return f"Active limits: {'; '.join(parts)}."


def _end(plan: Plan) -> str:
    """The wear at the end, and why no pair of the grid goes on."""
    life, least = plan.life, plan.options.removal if plan.options.objective == "life" else None
    tried = life.surfaces(len(life.time))
    enough = (least or 0.0) * (1 - 1e-12) <= tried.MRR
    breaks = {name: broken[enough] for name, broken in tried.breaks.items()}
    wear, criterion = life.laws.wear, f"{life.laws.wear.most:g} {life.laws.wear.unit}"
    reached = f"At the end {wear.response} is {life.AW[-1]:.3g} {wear.unit}"
    asked = f"{metal(least)} per min or more" if least else ""
    if breaks["wear"].all():
        pairs = f"every pair of the grid{asked and f' that removes {asked}'}"
        return f"{reached}; {pairs} would exceed {criterion} in the next interval."
    others = join_words([name for name, broken in breaks.items() if (broken & ~breaks["wear"]).any()])
    pairs = f"the pairs that {asked and f'remove {asked} and '}keep it below {criterion}"
    return f"{reached}; {pairs} in the next interval exceed the limits of {others}."


def _times(rules: Rules) -> str:
    return (
        "The time factors of power and force are omitted, as in eq. 6 and 7 of the paper and its tables."
        if rules.times == "published"
        else "The time factors of all laws apply; the tables of the paper omit those of power and force."
    )


def _facts(plan: Plan, exact: Life | None, found: Found | None) -> dict[str, object]:
    life = plan.life
    facts: dict[str, object] = {
        "objective": plan.options.objective,
        "depth_mm": life.laws.d,
        "times": life.rules.times,
        "wear": life.rules.wear,
        "interval_min": life.rules.interval,
        "grid": {"V_m_per_min": plan.options.steps[0], "f_mm_per_rev": plan.options.steps[1]},
        "extrapolated": list(plan.extrapolated),
        "life_min": life.minutes,
        "worn_out": life.ended,
        "removed_mm3": life.removed,
        "removed_mm3_per_min": life.per_minute,
        "bound_mm3": plan.bound,
        "cost_per_cm3": None if plan.cost is None else {"value": plan.cost[0], "currency": plan.cost[1]},
        "units": dict(plan.units),
        "intervals": [_interval(row) for row in plan.rows],
        "exact_life_min": None if exact is None else exact.minutes,
        "exact_removed_mm3": None if exact is None else exact.removed,
    }
    for times in ("published", "full"):
        for wear in ("clock", "wear_state"):
            other = whole_life(life.laws, Rules(times, wear, life.rules.interval), life.grid)
            facts[f"{times}_{wear}"] = {"life_min": other.minutes, "removed_mm3": other.removed}
    for name, of in zip(("plan", "plan_new_edges", "own"), found or (), strict=False):
        if of is not None:
            facts[f"draws_{name}"] = _of_draws(of)
    return facts


def _interval(row: PlanRow) -> dict[str, object]:
    return {
        "end_min": row.end, "V_m_per_min": row.V, "f_mm_per_rev": row.f, "n_per_min": row.n,
        "MRR_mm3_per_min": row.rate, "wear": row.wear, "responses": dict(row.responses), "stops": list(row.limits),
        "tested": row.tested,
    }  # fmt: skip


def _of_draws(of: LifeDraws) -> dict[str, object]:
    ends = {key: of.band(what, LEVEL) for what, key in (("minutes", "life_min"), ("removed", "removed_mm3"))}
    return {
        "draws": len(of.minutes), "level": LEVEL, "ends_early": of.ends_early,
        **{key: {"low": low, "median": middle, "high": high} for key, (low, middle, high) in ends.items()},
    }  # fmt: skip


def _figures(life: Life, exact: Life | None, found: Found | None) -> "dict[str, Figure]":
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


def _span(life: Life, first: int, end: int) -> str:
    step = life.rules.interval
    if step != 1:
        return f"{first * step:g} to {end * step:g} min"
    return f"minute {end}" if end == first + 1 else f"minutes {first + 1} to {end}"


LEVEL = 0.95
OWN = 1000  # draws that each run a recursion


def drawn(life: Life, draws: "Mapping[str, Draws]", seed: int, *, own: bool, most: int) -> Found | None:
    """Plan on the law's draws, plan on new edges, each draw's own recursion; None without draws of the laws used."""
    if not set(responses(life.laws)) & set(draws):
        return None
    laws, rules, grid = life.laws, life.rules, life.grid
    return (
        life_draws(laws, draws, rules=rules, grid=grid, seed=seed, life=life),
        life_draws(laws, draws, rules=rules, grid=grid, seed=seed, life=life, edge="new"),
        life_draws(laws, draws, rules=rules, grid=grid, seed=seed, life=life, of="own", count=OWN, most=most)
        if own else None,
    )  # fmt: skip


def draw_lines(found: Found | None, draws: "Mapping[str, Draws]") -> list[str]:
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
    ]
    if own is not None:
        lines.append(f"With an own plan for each of {len(own.minutes)} drawn laws: {_bands(own)} ({band} of the law).")
    lines += _peak_lines(plan, band)
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
