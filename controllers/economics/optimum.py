"""Cutting speed and feed of least cost and of greatest rate, within all limits at the end of an edge's life."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arrays import Array, is_positive
from ...core.display import Plottable
from ...core.errors import DataError, UsageError
from ...core.predictions import COMBINATION
from ..recursion.from_file import tested_depths
from ..recursion.laws import Times
from ..region.curved import Limit, curved_conflict
from ..region.half_planes import SAME, HalfPlane, conflict_sentence
from ..region.limits import MachineRange
from ..region.log_planes import CutSetting
from ..region.operating_point import limit_names, ln, plain
from ..region.surfaces import RegionLimit, Surface
from .age_replacement import ChangeInterval, Distribution, change_interval
from .life_end import LifeSource, WornEdge
from .part_cost import PowerSum
from .problem import DrawnParts, PartProblem, Search, draw_parts, limits_of, part_problem, single, tested_regions

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.draws import Draws
    from ...parameters.sections.costs import CostsSection
    from ...parameters.sections.load_line import LimitsSection

Band = tuple[float, float]
LONGEST_LIFE = 1e9  # min
LARGEST = 700.0  # of an exponent


@dataclass(frozen=True, slots=True, repr=False)
class PricedSetting(Plottable):
    """A pair of V and f with the cost and time of a part.

    Attributes
    ----------
    V, f : float
        m/min, mm/rev.
    life : float
        min in cut, of the law.
    cut, time : float
        min of a part in cut, and with handling and changes of edges.
    cost : float
        Of a part, in the currency of the costs.
    parts : dict of float
        The cost by its parts.
    held_by, exceeds : tuple of str
        Limits that are active, and that are exceeded.
    beyond : tuple of str
        What of it lies outside the tests.
    bands : dict of (float, float)
        Intervals of ``V``, ``f``, ``life``, ``time`` and ``cost`` at the level of the result; empty without draws.
    """

    V: float
    f: float
    life: float
    cut: float
    time: float
    cost: float
    parts: Mapping[str, float]
    held_by: tuple[str, ...]
    exceeds: tuple[str, ...]
    beyond: tuple[str, ...]
    bands: Mapping[str, Band] = field(default_factory=dict)

    @property
    def per_edge(self) -> float:
        """Parts that one edge cuts in its life."""
        return self.life / self.cut

    @property
    def xy(self) -> Band:
        """(V, f)."""
        return self.V, self.f


@dataclass(frozen=True, slots=True, repr=False)
class EconomicSettings(Plottable):
    """Settings of least cost and of greatest rate, with today's for comparison.

    Attributes
    ----------
    costs : CostsSection
    setting : CutSetting
        Depth, level, further factors.
    source : LifeSource
    least_cost, greatest_rate : PricedSetting
    tested : PricedSetting or None
        The setting of least cost within the tested region of the laws, where that of ``least_cost`` lies outside it;
        None where it does not, and where no pair of the limits lies inside.
    today : PricedSetting or None
    saving : (float, float, float) or None
        Saving of the least-cost setting over today's per part: estimate, low, high.
    not_knowing : float or None
        Mean cost per part, over the draws of the life, beyond that of the best pair of each draw: what it would be
        worth to know the law exactly.
    change : ChangeInterval or None
        At the least-cost setting; None without the cost of a failure, or where the scatter of edges is not known.
    level : float
    draws : int
        Number of draws behind the intervals; 0 without.
    cost, rate : PowerSum
        Cost and time of a part over ln V and ln f.
    simulated : bool
        Whether the laws were fitted to simulated data.
    limits : tuple of limits
        Those of the responses and the spindle, then the four sides of the machine's ranges.
    machine : MachineRange
    notes : tuple of str
    """

    costs: "CostsSection"
    setting: CutSetting
    source: LifeSource
    least_cost: PricedSetting
    greatest_rate: PricedSetting
    tested: PricedSetting | None
    today: PricedSetting | None
    saving: tuple[float, float, float] | None
    not_knowing: float | None
    change: ChangeInterval | None
    level: float
    draws: int
    cost: PowerSum
    rate: PowerSum
    limits: tuple[Limit, ...]
    machine: MachineRange
    simulated: bool
    notes: tuple[str, ...]


def economic_settings(
    pf: "ParameterFile",
    costs: "CostsSection | Mapping[str, Any] | None" = None,
    *,
    d: float | None = None,
    by: str | None = None,
    at: Mapping[str, float] | None = None,
    limits: "LimitsSection | Mapping[str, Any] | None" = None,
    today: tuple[float, float] | None = None,
    draws: "Mapping[str, Draws] | None" = None,
    level: float = 0.95,
    times: Times | None = None,
    seed: int = 1,
) -> EconomicSettings:
    """Settings of least cost per part and of greatest rate, within the limits at the end of an edge's life.

    Parameters
    ----------
    pf : ParameterFile
        With a tool life: a wear law on t with a criterion, or a law of lives; power laws.
    costs : CostsSection or mapping, optional
        In place of those of the file.
    d : float, optional
        Depth of cut, mm; by default that of the papers, or the middle of the tested depths.
    by : str, optional
        Level of laws that have levels.
    at : mapping, optional
        Further factors in the units of the laws; the diameter ``D`` in mm, for limits of spindle speed and feed rate.
    limits : Limits or mapping, optional
        In place of the file's limits of the same name, as in `controllers.visible_region`.
    today : (float, float), optional
        V and f of today, which are compared.
    draws : mapping of Draws, optional
        Posterior draws by response; a law without draws is drawn from its covariance.
    level : float
        Of the intervals.
    times : {"full", "published"}, optional
        Whether the factors t of power and force count; "published" leaves them out, the default for AC-2017's file.
    seed : int
        Of the pairing of draws.

    Returns
    -------
    EconomicSettings

    Raises
    ------
    UsageError
        No tool life, a limited response without a law, an unknown factor, a value that is not above zero.
    DataError
        The limits exclude each other.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> costs = {"currency": "USD", "machine": 30.0, "edge": 3.0, "change": 2.0}
    >>> found = economic_settings(published("AC-2017"), costs, draws={})
    >>> round(found.least_cost.V, 1), round(found.least_cost.f, 3), round(found.least_cost.life, 2)
    (200.0, 0.204, 14.51)
    """
    costs = _costs(pf, costs)
    problem, notes = part_problem(pf, costs, d, by, at, limits, times)
    edge = problem.edge()
    cost, rate = problem.sums(edge)
    held = limits_of(problem, edge)
    search = Search(problem, held)
    best = {"cost": search.least(edge, cost), "rate": search.least(edge, rate)}
    if not all(np.isfinite(x).all() for x in best.values()):
        raise DataError(_conflict(problem, held, edge))
    for x in (best["cost"][0], best["rate"][0], *(() if today is None else (_point(today),))):
        _check_life(edge, x)
    drawn = draw_parts(problem, search, draws, seed)
    at_best = {name: _priced(problem, edge, held, x[0], drawn, level, name) for name, x in best.items()}
    tested = _tested(problem, search, edge, drawn, level) if at_best["cost"].beyond else None
    now = None if today is None else _priced(problem, edge, held, _point(today), drawn, level, "")
    change, why = _change(problem, at_best["cost"])
    return EconomicSettings(
        costs=costs, setting=problem.setting, source=problem.source, least_cost=at_best["cost"],
        greatest_rate=at_best["rate"], tested=tested, today=now,
        saving=None if now is None else _saving(now, at_best["cost"], drawn, level),
        not_knowing=None if drawn is None else drawn.regret(best["cost"][0]), change=change, level=level,
        draws=0 if drawn is None else drawn.count, cost=cost, rate=rate, limits=held, machine=problem.machine,
        simulated=bool(pf.identity.simulated),
        notes=(*problem.machine.notes, *notes, *why, *(() if drawn is None else drawn.notes)),
    )  # fmt: skip


def _costs(pf: "ParameterFile", given: "CostsSection | Mapping[str, Any] | None") -> "CostsSection":
    """The costs that were given, or those of the file."""
    from pydantic import ValidationError

    from ...parameters.messages import schema_message
    from ...parameters.sections.costs import CostsSection

    given = pf.costs if given is None else given
    if given is None:
        raise UsageError("the file has no costs; write them with fitmodels costs, or give costs={...}.")
    if isinstance(given, CostsSection):
        return given
    try:
        return CostsSection.model_validate(given)
    except ValidationError as error:
        raise UsageError(f"costs: {schema_message(error, dict(given))}.") from None


def _point(today: tuple[float, float]) -> Array:
    V, f = today
    for name, value in (("V", V), ("f", f)):
        if not is_positive(value):
            raise UsageError(f"today's {name} = {value:g}: give a value above zero.")
    return ln(V, f)


def _check_life(edge: WornEdge, x: Array) -> None:
    """Refuse a life that no tool has."""
    ln_life = float(edge.life.intercept[0] + x @ edge.life.slopes[0])
    if ln_life > np.log(LONGEST_LIFE):
        at = f"V {plain(x[0]):g} m/min, f {plain(x[1]):g} mm/rev"
        raise DataError(
            f"The tool life at {at} is 1e{ln_life / np.log(10):.0f} min by its law, above {LONGEST_LIFE:g} min: no "
            "cost follows from it. Check the exponents of the law and the criterion, or narrow the limits of V and f."
        )


def _priced(
    problem: PartProblem,
    edge: WornEdge,
    held: Sequence[Limit],
    x: Array,
    drawn: DrawnParts | None,
    level: float,
    best: str,
) -> PricedSetting:
    cost, rate = problem.sums(edge)
    one = cost.at(0)
    V, f = plain(x[0]), plain(x[1])
    life = float(np.exp(edge.life.intercept[0] + x @ edge.life.slopes[0]))
    over = [(each, float(each.beyond(x))) for each in held]
    cut = float(rate.terms(x[None])[0, 0])
    return PricedSetting(
        V=V, f=f, life=life, cut=cut, time=float(rate.value(x[None])[0]), cost=float(one.value(x)),
        parts={name: value for name, value in one.parts(x).items() if value > 0},
        held_by=limit_names([each for each, by in over if abs(by) <= 10 * SAME]),
        exceeds=limit_names([each for each, by in over if by > 10 * SAME]),
        beyond=_beyond(problem, edge, x), bands=_bands(drawn, x, level, best),
    )  # fmt: skip


def _tested(
    problem: PartProblem, search: Search, edge: WornEdge, drawn: DrawnParts | None, level: float
) -> PricedSetting | None:
    """The setting of least cost within the limits and the tested regions; None where there is none."""
    held = (*search.held, *tested_regions(problem, edge))
    x = Search(problem, held).least(edge, problem.sums(edge)[0])[0]
    found = _priced(problem, edge, held, x, drawn, level, "") if np.isfinite(x).all() else None
    return None if found is None or found.beyond else found


def _bands(drawn: DrawnParts | None, x: Array, level: float, best: str) -> dict[str, Band]:
    """Intervals by quantiles of the draws: of the best pair, and of life, time and cost at the pair."""
    if drawn is None:
        return {}
    ends = [(1 - level) / 2, (1 + level) / 2]
    at = np.broadcast_to(x, (drawn.count, 2))
    of = {
        "life": np.exp(np.minimum(drawn.life.intercept + drawn.life.slopes @ x, LARGEST)),
        "time": drawn.rate.value(at),
        "cost": drawn.cost.value(at),
    }
    if best:
        of |= {"V": np.exp(drawn.best[best][:, 0]), "f": np.exp(drawn.best[best][:, 1])}
    return {name: (float(low), float(high)) for name, v in of.items() for low, high in [np.quantile(v, ends)]}


def _saving(
    now: PricedSetting, best: PricedSetting, drawn: DrawnParts | None, level: float
) -> tuple[float, float, float]:
    if drawn is None:
        return now.cost - best.cost, np.nan, np.nan
    shape = (drawn.count, 2)
    each = drawn.cost.value(np.broadcast_to(ln(*now.xy), shape)) - drawn.cost.value(
        np.broadcast_to(ln(*best.xy), shape)
    )
    low, high = np.quantile(each, [(1 - level) / 2, (1 + level) / 2])
    return now.cost - best.cost, float(low), float(high)


def _beyond(problem: PartProblem, edge: WornEdge, x: Array) -> tuple[str, ...]:
    """What of a pair and of the worn edge lies outside the tests of the laws in use; the depth of those of the file."""
    found = {}
    d, depths = problem.setting.d, tested_depths(problem.pf)
    if depths is not None and not depths[0] * (1 - SAME) <= d <= depths[1] * (1 + SAME):
        found["d"] = _range_words("d", d, "mm", *depths)
    outside = [region for region in tested_regions(problem, edge) if float(region.beyond(x)) > SAME]
    for region in outside:
        found = {**_out_of_range(region, x), **found}
    if outside and not found:
        return (f"{COMBINATION} of {' and '.join(region.surface.response for region in outside)}",)
    return tuple(found.values())


def _out_of_range(region: RegionLimit, x: Array) -> dict[str, str]:
    """Factors of a law outside their tested ranges, each with its value and its range."""
    columns = zip(region.surface.law.factors, region.surface.points(x), region.parts(x), strict=False)
    return {f.symbol: _range_words(f.symbol, value, f.unit, f.low, f.high) for f, value, over in columns if over > SAME}


def _range_words(symbol: str, value: float, unit: str, low: float, high: float) -> str:
    """A value outside its tested range."""
    if symbol == "t":
        longest = f"longest test {high:g} {unit}" if value > high else f"shortest test {low:g} {unit}"
        return f"life {value:.3g} {unit} ({longest})"
    ends = f"{low:g} to {high:g}" if low < high else f"{low:g} alone"
    return f"{symbol} {value:.4g} {unit} (tested {ends})"


def _change(problem: PartProblem, best: PricedSetting) -> tuple[ChangeInterval | None, tuple[str, ...]]:
    """Interval of changing an edge at a setting, or the reason why it is not known."""
    costs = problem.costs
    if costs.failure is None:
        return None, ("The change interval needs the cost of a failed edge: failure=.",)
    scatter = _scatter(problem)
    if scatter is None:
        return None, (
            f"The scatter of edges about the law of {problem.source.law.response} is not known, or none was found.",
        )
    distribution, scale = scatter
    planned = costs.price_of_edge + costs.per_minute * costs.change
    if planned <= 0:
        return None, ("A planned change costs nothing, so there is no change interval.",)
    found = change_interval(
        distribution, median=best.life, scale=scale, planned=planned, failure=planned + costs.failure
    )
    return found, ()


def _scatter(problem: PartProblem) -> tuple[Distribution, float] | None:
    """Distribution of the lives of edges and its scale in ln T."""
    from ...parameters.prediction import edge_scatter

    law = problem.source.law
    if law.life is not None:
        return law.life.distribution, law.life.scale
    if problem.source.criterion is None:
        return None if not law.residual_se else ("lognormal", law.residual_se)
    life = problem.pf.tool_life
    if life is None or law.residual_se is None:
        return None
    sd = float(np.sqrt(edge_scatter(law, life)[0]))
    return ("lognormal", sd / law.coefficients["t"]) if 0 < sd < np.inf else None


def _conflict(problem: PartProblem, held: tuple[Limit, ...], edge: WornEdge) -> str:
    """Sentence on the limits that exclude each other."""
    over: dict[str, Surface] = {**problem.curved, **{name: single(p) for name, p in edge.responses.items()}}
    planes = [each for each in held if isinstance(each, HalfPlane)]
    if len(planes) == len(held):
        words = conflict_sentence(planes[:-4], planes[-4:], over)
    else:
        words = curved_conflict(held[:-4], problem.machine.low, problem.machine.high, over)
    return f"{words} Values are those of a worn edge."
