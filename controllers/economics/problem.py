"""The choice of V and f as an optimisation problem: limits of a worn edge, its least cost, and the same by draws."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import log
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arrays import Array
from ...core.errors import DataError
from ...parameters.evaluation import equation_of
from ...parameters.setting_words import power_limit_words
from ..recursion.from_file import depth
from ..recursion.laws import Times
from ..region.curved import Limit, grid, minimum, worst
from ..region.half_planes import HalfPlane
from ..region.limits import MachineRange, box, check_fixed_factors, limited, merged, of_spindle, within_tests
from ..region.log_planes import CutSetting, LogPlane, ratio
from ..region.sampled_laws import sampled_parameters
from ..region.surfaces import LawSurface, RegionLimit, ResponseBound, Surface, limits_on, tested_limits
from .life_end import LIFE, POWER, LifeSource, WornEdge, curved_ends, life_source, worn_edge
from .part_cost import PowerSum, Sides, cost_of_part, least, time_of_part

if TYPE_CHECKING:
    from ...parameters import LawSection, ParameterFile
    from ...parameters.draws import Draws
    from ...parameters.sections.costs import CostsSection
    from ...parameters.sections.load_line import LimitsSection

MOST_DRAWS = 2000
CURVED_DRAWS = 200  # of a region with curved sides, whose optimum is searched for


@dataclass(frozen=True, slots=True)
class PartProblem:
    """Everything that stays the same while the parameters of the laws are drawn."""

    pf: "ParameterFile"
    costs: "CostsSection"
    setting: CutSetting
    source: LifeSource
    bounds: tuple[ResponseBound, ...]
    spindle: tuple[HalfPlane, ...]
    machine: MachineRange
    curved: Mapping[str, Surface]

    @property
    def limited(self) -> tuple[str, ...]:
        """Symbols of the limited responses."""
        return tuple(dict.fromkeys(bound.symbol for bound in self.bounds))

    def edge(self, thetas: Mapping[str, Array] | None = None) -> WornEdge:
        """The worn edge by the estimates, or by draws of parameters."""
        return worn_edge(self.pf, self.source, self.setting, self.limited, thetas)

    def sums(self, edge: WornEdge) -> tuple[PowerSum, PowerSum]:
        """Cost and time of a part."""
        d = self.setting.d
        return cost_of_part(self.costs, d, edge.life, edge.power), time_of_part(self.costs, d, edge.life)

    def sides(self, edge: WornEdge) -> Sides:
        """Straight sides for each draw: limits of power laws, of the spindle, of the machine."""
        count = len(edge.life.intercept)
        a, b = [], []
        for symbol, side, value, unit in self.bounds:
            if symbol in edge.responses:
                of, sign = edge.responses[symbol], 1.0 if side == "most" else -1.0
                a.append(sign * of.slopes)
                b.append(sign * (log(value * ratio(unit, of.unit)) - of.intercept))
        for each in (*self.spindle, *self.machine.sides):
            a.append(np.broadcast_to(np.array(each.a), (count, 2)))
            b.append(np.full(count, each.b))
        return Sides(np.stack(a, axis=1), np.stack(b, axis=1))


def part_problem(
    pf: "ParameterFile",
    costs: "CostsSection",
    d: float | None,
    by: str | None,
    at: Mapping[str, float] | None,
    limits: "LimitsSection | Mapping[str, Any] | None",
    times: Times | None,
) -> tuple[PartProblem, tuple[str, ...]]:
    """The problem of a file at a depth, and notes on limits that are not applied; arguments as `economic_settings`."""
    setting = CutSetting(float(depth(pf) if d is None else d), 1.0, by, dict(at or {}))
    check_fixed_factors(pf, setting)
    asked = merged(pf, limits)
    source = life_source(pf, asked, times)
    bounds = tuple(b for b in limited(pf, asked) if source.criterion is None or b.symbol != source.law.response)
    names = tuple(dict.fromkeys(b.symbol for b in bounds))
    curved = curved_ends(pf, source, setting, names)
    spindle, notes = of_spindle(asked, setting)
    on_curves = [b for b in bounds if b.symbol in curved]
    machine = within_tests(box(pf, asked), tested_limits(on_curves, curved))
    notes = (*notes, *power_limit_words(asked, pf.laws, costs))
    return PartProblem(pf, costs, setting, source, bounds, spindle, machine, curved), notes


def limits_of(problem: PartProblem, edge: WornEdge) -> tuple[Limit, ...]:
    """All limits by the estimates, those of the machine last."""
    over: dict[str, Surface] = {**problem.curved, **{name: single(p) for name, p in edge.responses.items()}}
    on_curves = [b for b in problem.bounds if b.symbol in problem.curved]
    tested = tested_limits(on_curves, problem.curved)
    return (*limits_on(problem.bounds, over), *problem.spindle, *tested, *problem.machine.sides)


def tested_regions(problem: PartProblem, edge: WornEdge) -> tuple[RegionLimit, ...]:
    """The tested region of the law of the life and of each limited law, at the end of the life of the edge.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> problem, _ = part_problem(published("AC-2017"), {}, None, None, None, None, None)
    >>> [region.name for region in tested_regions(problem, problem.edge())]
    ['tested region of AW', 'tested region of Fxz', 'tested region of P']
    """
    pf, source, life = problem.pf, problem.source, replace(single(edge.life), response="t")
    names = dict.fromkeys((source.law.response, *sorted({*problem.limited} & {*pf.laws})))
    found = []
    for law in (pf.laws[name] for name in names):
        equation = equation_of(law, None if law.by is None else problem.setting.by)
        surface = LawSurface(law, source.worn(problem.setting), equation, life)
        found.append(RegionLimit(surface, ranges(law) if law.region is None else law.region.model_dump()))
    return tuple(found)


def ranges(law: "LawSection") -> dict[str, Any]:
    """The tested ranges of a law as the facts of a region, whose ends are inside it as a criterion of wear often is."""
    low, high = (np.array([getattr(factor, end) for factor in law.factors]) for end in ("low", "high"))
    half = np.maximum((high - low) / 2, 1e-9 * np.abs(high))
    return {
        "logs": False, "centre": (low + high) / 2, "half_range": half, "largest_radius": len(low) ** 0.5, "levels": [],
        "spaces": [],
    }  # fmt: skip


def single(plane: LogPlane) -> LogPlane:
    """The plane of a single draw as that of one law."""
    return LogPlane(
        plane.response, plane.quantity, plane.unit, plane.intercept[0], plane.slopes[0], plane.wear_power[0],
        plane.t_power[0],
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Search:
    """The point of least cost of each draw: exact within straight sides, searched for within curves."""

    problem: PartProblem
    held: tuple[Limit, ...]

    @property
    def straight(self) -> bool:
        """Whether all limits are straight lines over ln V and ln f."""
        return all(isinstance(each, HalfPlane) for each in self.held)

    def least(self, edge: WornEdge, cost: PowerSum) -> Array:
        """Shape (S, 2); NaN where the limits exclude each other."""
        if self.straight:
            return least(cost, self.problem.sides(edge))
        low, high = self.problem.machine.low, self.problem.machine.high
        points = grid(low, high).reshape(-1, 2)
        feasible = points[worst(self.held, points) <= 0]
        if not len(feasible):
            return np.full((len(cost.intercepts), 2), np.nan)
        found = [self._one(cost.at(i), feasible) for i in range(len(cost.intercepts))]
        return np.array(found)

    def _one(self, cost: PowerSum, feasible: Array) -> Array:
        start = feasible[int(np.argmin(cost.value(feasible)))]
        box = self.problem.machine.low, self.problem.machine.high
        return minimum(lambda x: np.log(cost.value(x)), self.held, box, [start], feasible)


@dataclass(frozen=True, slots=True)
class DrawnParts:
    """Cost, time and life by draws, with the best pairs of each."""

    cost: PowerSum
    rate: PowerSum
    life: LogPlane
    best: Mapping[str, Array]
    own: Array
    notes: tuple[str, ...]

    @property
    def count(self) -> int:
        """Number of draws."""
        return len(self.own)

    def regret(self, x: Array) -> float:
        """Mean cost at a pair beyond that of the best pair of each draw within the same limits."""
        beyond = self.cost.value(np.broadcast_to(x, (self.count, 2))) - self.cost.value(self.own)
        return float(np.nanmean(np.maximum(beyond, 0.0)))


def draw_parts(
    problem: PartProblem, search: Search, draws: "Mapping[str, Draws] | None", seed: int
) -> DrawnParts | None:
    """Draws of the laws, paired at random; None where no law has an uncertainty."""
    held = draws or {}
    names = sorted({problem.source.law.response, POWER, *problem.limited} & set(problem.pf.laws))
    laws = {name: problem.pf.laws[name] for name in names if name not in problem.curved}
    most = MOST_DRAWS if search.straight else CURVED_DRAWS
    count = min([most, *(len(held[name].values) for name in laws if name in held)])
    rng = np.random.default_rng(seed)
    thetas = {name: sampled_parameters(law, held.get(name), count, rng) for name, law in laws.items()}
    if all(np.ptp(theta, axis=0).max() == 0 for theta in thetas.values()):
        return None
    edge = problem.edge(thetas)
    cost, rate = problem.sums(edge)
    usable = np.isfinite(edge.life.intercept) & (_exponent(problem.source, thetas) > 0)
    with np.errstate(all="ignore"):
        best = {"cost": search.least(edge, cost), "rate": search.least(edge, rate)}
        fixed = Sides(*(np.repeat(each, count, axis=0) for each in _of_estimates(problem)))
        own = least(cost, fixed) if search.straight else best["cost"]
    usable &= np.isfinite(best["cost"]).all(axis=-1) & np.isfinite(best["rate"]).all(axis=-1)
    if not usable.any():
        raise DataError(f"In none of {count} draws of the laws is there a life within the limits. Fit the data again.")
    lost = count - int(usable.sum())
    notes = [] if not lost else [f"In {lost} of {count} draws there is no life, or the limits exclude each other."]
    if not search.straight:
        notes.append("A limit is no power law: intervals are by draws of the life alone, with limits as estimated.")
    life = LogPlane(
        LIFE, "tool life", "min", edge.life.intercept[usable], edge.life.slopes[usable], edge.life.wear_power[usable],
        edge.life.t_power[usable],
    )  # fmt: skip
    each = {name: x[usable] for name, x in best.items()}
    return DrawnParts(cost.at(usable), rate.at(usable), life, each, own[usable], tuple(notes))


def _of_estimates(problem: PartProblem) -> tuple[Array, Array]:
    sides = problem.sides(problem.edge())
    return sides.a, sides.b


def _exponent(source: LifeSource, thetas: Mapping[str, Array]) -> Array:
    """Exponent of t in the wear law by draws; ones for a law of lives."""
    theta = thetas[source.law.response]
    return np.ones(len(theta)) if source.criterion is None else theta[:, source.law.parameter_names.index("t")]
