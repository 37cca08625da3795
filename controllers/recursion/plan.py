"""A plan of cutting speed and feed over the life of an edge, for an objective and settings by choice.

The same plan is replayed, printed, and exported to machines: `plan_of` makes it from a parameter file alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, get_args

from ...core.arrays import is_positive
from ...core.display import Displayable
from ...core.errors import UsageError
from ..economics.part_cost import cost_of_edge
from .distribution import LifeDraws, life_draws, responses
from .from_file import DEPTH, depth, life_laws, need_level, outside_tests, tested_depths
from .interval_optimum import FEED_STEP, SPEED_STEP, Grid, grid_of, not_convex
from .laws import LifeLaws, Rules, Times, WearRule
from .life import MOST, Life, whole_life
from .sequence import best_sequence, least_cost_sequence, least_wear_life

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.draws import Draws

Objective = Literal["removal", "life", "cost", "time"]
OBJECTIVES: tuple[Objective, ...] = get_args(Objective)
WHOLE = 1e-9  # of an interval
EARLY = 2.0  # intervals before the first test that are not worth a note
ENDS = {
    "most speed": "the upper limit of speed", "most feed": "the upper limit of feed",
    "feed rate": "the limit of the feed rate",
}  # fmt: skip


@dataclass(frozen=True, slots=True, repr=False)
class PlanOptions(Displayable):
    """Settings and objective of a plan; None leaves one to the file.

    Attributes
    ----------
    depth : float or None
        Depth of cut, mm; the papers' 2.5, or the middle of the tested depths.
    time : float or None
        min in the cut: the plan is for this time at most; objective ``time`` lasts it. Whole intervals are planned.
    interval : float or None
        min between changes of the pair; 1, as in the paper.
    grid : (float, float) or None
        Steps of speed and feed, m/min and mm/rev; 10 and 0.005, as in the paper.
    wear_state : bool or None
        Wear adds up from the wear reached and not by the time, see `Rules`; by default so for objectives ``cost`` and
        ``time``, since by the time a sequence gains by cutting slowly at first, whatever it cuts later.
    factors : {"published", "full"} or None
        Whether the laws of power and force keep their factors of time; published only in the paper's own file.
    objective : {"removal", "life", "cost", "time"}
        ``removal``: the largest removal rate of each interval for itself, as in the paper. ``life``: the longest life
        at a removal rate of at least ``removal``. ``cost``: least cost per volume, from the costs of the file.
        ``time``: most metal in ``time``, which the edge must last.
    removal : float or None
        mm3/min, of objective ``life``.
    by : str or None
        Level of laws that have levels.
    at : mapping
        Other factors of the laws in their units; the diameter ``D``, mm, gives the spindle speed.

    Examples
    --------
    >>> PlanOptions(depth=1.5, objective="time", time=12.0).interval is None
    True
    """

    depth: float | None = None
    time: float | None = None
    interval: float | None = None
    grid: tuple[float, float] | None = None
    wear_state: bool | None = None
    factors: Times | None = None
    objective: Objective = "removal"
    removal: float | None = None
    by: str | None = None
    at: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        if self.objective not in OBJECTIVES:
            raise UsageError(f"objective {self.objective!r}: give {', '.join(OBJECTIVES[:-1])} or {OBJECTIVES[-1]}.")
        for name, value, unit in (
            ("depth", self.depth, "mm"), ("time", self.time, "min"), ("interval", self.interval, "min"),
            ("removal", self.removal, "mm3/min"),
        ):  # fmt: skip
            if value is not None and not is_positive(value):
                raise UsageError(f"{name} {value:g} {unit}: give a value above zero.")
        if self.objective == "time" and self.time is None:
            raise UsageError("objective time: give the time that the edge must last, --time 15min.")
        if self.objective == "life" and self.removal is None:
            raise UsageError(
                "objective life: the longest life of all has the least speed and feed. Give the removal rate that "
                "every interval must reach at least, --removal 60cm3/min."
            )
        if self.objective != "life" and self.removal is not None:
            raise UsageError(f"a least removal rate belongs to objective life, not {self.objective}: leave it out.")

    @property
    def by_wear(self) -> bool:
        """Whether wear adds up from the wear reached."""
        return self.objective in ("cost", "time") if self.wear_state is None else self.wear_state

    @property
    def steps(self) -> tuple[float, float]:
        """Steps of speed and feed, m/min and mm/rev."""
        return self.grid or (SPEED_STEP, FEED_STEP)


@dataclass(frozen=True, slots=True, repr=False)
class PlanRow(Displayable):
    """One interval of a plan.

    Attributes
    ----------
    start, end : float
        min in the cut.
    V, f, d : float
        m/min, mm/rev, mm.
    n : float or None
        Spindle speed, 1/min, where the diameter is known.
    wear : float
        At the end, in ``Plan.units["wear"]``.
    rate : float
        Removal rate, mm3/min.
    responses : dict
        Limited power and force at the end, by symbol, in ``Plan.units``.
    margins : dict
        Share of each limit that is left at the end, by name: ``wear``, ``power``, ``force``.
    limits : tuple of str
        Active limits: ``power``, ``force``, ``wear``, ``most speed``, ``most feed``.
    tested : bool
        Whether the pair lies inside the tested region of every law in use.
    """

    start: float
    end: float
    V: float
    f: float
    d: float
    n: float | None
    wear: float
    rate: float
    responses: Mapping[str, float]
    margins: Mapping[str, float]
    limits: tuple[str, ...]
    tested: bool


@dataclass(frozen=True, slots=True, repr=False)
class Plan(Displayable):
    """A plan of speed and feed over the life of an edge: a calculation from laws, not a measurement.

    Attributes
    ----------
    rows : tuple of PlanRow
        Empty where no pair is within the limits of a new edge.
    units : dict
        Unit of each quantity: V, f, d, t, n, rate, wear, and the symbols of power and force.
    life : Life
        The same as arrays, with laws, rules and grid.
    options : PlanOptions
    limit_reasons : tuple of str
        Active limits of each row in words, with their values.
    extrapolated : tuple of str
        A sentence for each factor outside the tested range of a law, marked EXTRAPOLATED; empty inside.
    assumed : tuple of str
        Settings that neither the file nor the options give.
    bound : float or None
        mm3: no sequence of as many intervals removes more; of objectives time and cost.
    cost, least : (float, str) or None
        Cost per cm3 with its currency, and of objective ``cost`` the bound below which no sequence comes.
    chance : LifeDraws or None
        The plan on new edges drawn from the laws, where there are draws.
    """

    rows: tuple[PlanRow, ...]
    units: Mapping[str, str]
    life: Life
    options: PlanOptions
    limit_reasons: tuple[str, ...]
    extrapolated: tuple[str, ...]
    assumed: tuple[str, ...]
    bound: float | None = None
    cost: tuple[float, str] | None = None
    least: tuple[float, str] | None = None
    chance: LifeDraws | None = None

    @property
    def laws(self) -> LifeLaws:
        """Laws and limits of the plan."""
        return self.life.laws

    @property
    def minutes(self) -> float:
        """Min in the cut."""
        return self.life.minutes

    @property
    def removed(self) -> float:
        """Metal removed, mm3."""
        return self.life.removed

    @property
    def ends_early(self) -> float | None:
        """Share of new edges that are worn out before the plan ends; None without draws."""
        return None if self.chance is None else self.chance.ends_early


def plan_of(
    pf: "ParameterFile",
    draws: "Mapping[str, Draws] | None" = None,
    options: PlanOptions | None = None,
    seed: int = 1,
) -> Plan:
    """The plan of a parameter file for these options.

    Parameters
    ----------
    pf : ParameterFile
        See `life_laws`.
    draws : mapping of Draws, optional
        By response; with them the plan is also run on new edges.
    options : PlanOptions, optional
    seed : int
        Of the levels of new edges.

    Raises
    ------
    UsageError
        The file cannot drive the recursion, lacks costs or a factor, or no plan keeps the limits.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> plan = plan_of(published("AC-2017"))
    >>> plan.minutes, plan.rows[0].V, plan.rows[0].f, plan.limit_reasons[0]
    (14.0, 150.0, 0.58, 'power 7 kW')
    """
    options = options or PlanOptions()
    _need_known(pf, options)
    diameter = diameter_of(pf, options)
    at = options.at if diameter is None else {**options.at, "D": diameter}
    laws = life_laws(pf, d=options.depth, by=options.by, at=at)
    wear: WearRule = "wear_state" if options.by_wear else "clock"
    rules = Rules(options.factors or laws.times, wear, options.interval or 1.0)
    grid = grid_of(laws, *options.steps)
    life, bound, least = _chosen(pf, laws, rules, grid, options)
    tested, outside = outside_tests(pf, laws, life.path, options.at, options.by)
    rows = tuple(_row(life, k, diameter, bool(tested[k])) for k in range(len(life.time)))
    currency = "" if pf.costs is None else pf.costs.currency
    cost = None if pf.costs is None or not rows else (cost_of_edge(pf.costs, life.minutes, life.removed)[0], currency)
    return Plan(
        rows=rows,
        units=_units(laws),
        life=life,
        options=options,
        limit_reasons=tuple(_reason(laws, row.limits) for row in rows),
        extrapolated=outside,
        assumed=(*_assumed(pf, laws, rules, options), *laws.notes),
        bound=bound,
        cost=cost,
        least=None if least is None else (least, currency),
        chance=_chance(laws, life, draws, seed) if rows else None,
    )


def _need_known(pf: "ParameterFile", options: PlanOptions) -> None:
    """Raise UsageError for a factor that no law has, that has an option of its own, or that is not above zero."""
    need_level(pf, options.by)
    known = {factor.symbol for law in pf.laws.values() for factor in law.factors}
    for name, value in options.at.items():
        if name in ("V", "f", "d", "t") or name in pf.laws:
            raise UsageError(f"at {name}: the plan gives V, f, t and the wear; the depth is --depth.")
        if name not in {*known, "D"}:
            raise UsageError(f"at {name}: no law has this factor; they have {', '.join(sorted(known))}.")
        if not is_positive(value):
            raise UsageError(f"at {name}={value:g}: give a value above zero.")


def diameter_of(pf: "ParameterFile", options: PlanOptions) -> float | None:
    """Diameter of the work, mm: of the options, or of the part in the costs of the file; None where it is unknown."""
    if "D" in options.at:
        return float(options.at["D"])
    cut = None if pf.costs is None else pf.costs.cut
    return None if cut is None else cut.diameter


def intervals_in(options: PlanOptions, rules: Rules) -> int:
    """Whole intervals in the time of the options, or the greatest number of a life."""
    if options.time is None:
        return MOST
    count = int(options.time / rules.interval + WHOLE)
    if count < 1:
        raise UsageError(f"time {options.time:g} min is shorter than one interval of {rules.interval:g} min.")
    return min(count, MOST)


def _chosen(
    pf: "ParameterFile", laws: LifeLaws, rules: Rules, grid: Grid, options: PlanOptions
) -> tuple[Life, float | None, float | None]:
    """The life by its objective; the bound of its metal and of its cost per cm3, where there is one."""
    most = intervals_in(options, rules)
    if options.objective == "removal":
        return whole_life(laws, rules, grid, most=most), None, None
    if options.objective == "life":
        return _longest(laws, rules, grid, options.removal or 0.0, most), None, None
    if options.objective == "time":
        best = best_sequence(laws, rules, grid, most)
        return best.life, best.bound, None
    costs = pf.costs
    if costs is None:
        raise UsageError(
            "objective cost: the file has no costs; write them with `fitmodels costs params.json machine=60/h edge=8 "
            "change=1.5min`."
        )
    fixed = costs.per_minute * costs.change + costs.price_of_edge
    best, least = least_cost_sequence(laws, rules, grid, costs.per_minute, fixed, most)
    return best.life, best.bound, least * 1000


def _longest(laws: LifeLaws, rules: Rules, grid: Grid, rate: float, most: int) -> Life:
    if why := not_convex(laws):
        raise UsageError(f"objective life: {why.split(':')[0]}, so least wear need not give the longest life.")
    life = least_wear_life(laws, rules, grid, rate, most)
    if len(life.time):
        return life
    best = whole_life(laws, rules, grid, most=1)
    able = f"{best.per_minute / 1000:.4g} cm3/min" if len(best.time) else "nothing"
    raise UsageError(
        f"removal {rate / 1000:g} cm3/min: no pair within the limits of a new edge removes as much; it removes at most "
        f"{able}. Give less, or wider limits."
    )


def _row(life: Life, k: int, diameter: float | None, tested: bool) -> PlanRow:
    laws, V = life.laws, float(life.V[k])
    values = {"power": float(life.P[k]), "force": float(life.Fxz[k])}
    margins = {"wear": 1 - float(life.AW[k]) / laws.wear.most}
    margins |= {name: 1 - values[name] / terms.most for name, terms in laws.limited}
    return PlanRow(
        start=float(life.time[k]) - life.rules.interval,
        end=float(life.time[k]),
        V=V,
        f=float(life.f[k]),
        d=laws.d,
        n=None if diameter is None else 1000 * V / (pi * diameter),
        wear=float(life.AW[k]),
        rate=float(life.MRR[k]),
        responses={terms.response: values[name] for name, terms in laws.limited},
        margins=margins,
        limits=life.stops[k],
        tested=tested,
    )


def _units(laws: LifeLaws) -> dict[str, str]:
    of = {terms.response: terms.unit for _, terms in laws.limited}
    usual = {"V": "m/min", "f": "mm/rev", "d": "mm", "t": "min", "n": "1/min", "rate": "mm3/min"}
    return {**usual, "wear": laws.wear.unit, laws.wear.response: laws.wear.unit, **of}


def _reason(laws: LifeLaws, stops: tuple[str, ...]) -> str:
    """Active limits with their values."""
    values = {"wear": laws.wear, **dict(laws.limited)}
    words = [ENDS.get(stop) or f"{stop} {values[stop].most:g} {values[stop].unit}" for stop in stops]
    return " and ".join(words) or "none"


def _assumed(pf: "ParameterFile", laws: LifeLaws, rules: Rules, options: PlanOptions) -> tuple[str, ...]:
    """Assumptions on what neither the file nor the options give; whole intervals of a time that is none of them."""
    low, high = tested_depths(pf) or (0.0, 0.0)
    why = "the middle of the tested depths" if low < high else "that of all tests" if low else "no law has a depth"
    why = "the papers'" if depth(pf) == DEPTH and low < high else why
    parts = [] if options.depth is not None else [f"Depth of cut {laws.d:g} mm ({why})"]
    parts += [] if options.interval is not None else [f"intervals of {rules.interval:g} min"]
    parts += [] if options.grid is not None else [f"steps of {SPEED_STEP:g} m/min and {FEED_STEP:g} mm/rev"]
    words = ", ".join(parts)
    out = [f"{words[:1].upper()}{words[1:]}."] if parts else []
    if options.by_wear and not options.wear_state:
        out.append("Wear adds up from the wear reached: by the time, a plan gains by cutting slowly first.")
    first = max((each.low for each in pf.laws[laws.wear.response].factors if each.symbol == "t"), default=0.0)
    if first > EARLY * rules.interval:
        out.append(f"No test is shorter than {first:g} min: the wear before is that of the law.")
    if options.time is not None:
        whole = intervals_in(options, rules) * rules.interval
        if abs(whole - options.time) > WHOLE * options.time:
            out.append(f"Of {options.time:g} min {whole:g} are planned: whole intervals of {rules.interval:g} min.")
    return tuple(out)


def _chance(laws: LifeLaws, life: Life, draws: "Mapping[str, Draws] | None", seed: int) -> LifeDraws | None:
    if not set(responses(laws)) & set(draws or {}):
        return None
    return life_draws(laws, draws or {}, edge="new", rules=life.rules, grid=life.grid, seed=seed, life=life)
