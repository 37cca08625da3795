"""Report on region and optimum, AC-2016: limits, best pair, wear against removal rate, and probability."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING

from ...controllers.region.limits import NO_RESPONSE_LIMIT
from ...controllers.region.log_planes import ratio
from ...controllers.region.operating_point import OperatingPoint, four, three
from ...controllers.region.probability import Feasibility, feasibility
from ...controllers.region.sampled_laws import Kind
from ...controllers.region.surfaces import RegionLimit
from ...controllers.region.visible import VisibleRegion, WearFront, visible_region, wear_front
from ...core.errors import DataError, UsageError
from . import Replayed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...controllers.recursion.plan import PlanOptions
    from ...parameters import ParameterFile
    from ...parameters.draws import Draws

TITLE = "Visible region and best V, f (Alaskari & Oraby 2016, doi 10.15242/IIE.E1216006)"
REQUIRED, LOSS = 0.95, 0.05
PRINTED = {"B": (154.7, 0.53), "H": (144.0, 0.54), "(147, 0.54)": (147.0, 0.54)}  # AC-2016, read off its charts
WORDS = {"B": "greatest MRR", "H": "least wear rate", "(147, 0.54)": "least wear"}
USUAL = {"d": 2.5, "t": 10.0}  # of AC-2016
UNITS = {"d": "mm", "t": "min"}


@dataclass(frozen=True, slots=True)
class DefaultSetting:
    """Fixed depth, time, level and factors, with the assumptions made where the file leaves them open."""

    d: float
    t: float
    by: str | None
    at: dict[str, float]
    assumed: tuple[str, ...]

    def region(self, pf: "ParameterFile") -> VisibleRegion:
        """The region at these values."""
        return visible_region(pf, d=self.d, t=self.t, by=self.by, at=self.at)

    def probability(self, pf: "ParameterFile", draws: "Mapping[str, Draws]", seed: int, kind: Kind) -> Feasibility:
        """Probability that pairs keep the limits at these values."""
        return feasibility(pf, draws=draws, d=self.d, t=self.t, by=self.by, at=self.at, kind=kind, seed=seed)


def default_setting(pf: "ParameterFile", options: "PlanOptions | None" = None) -> DefaultSetting:
    """The setting of the options, and else the paper's depth and time where tested, or the middle of the tests.

    Laws with levels are taken at their reference level, other factors in the middle of their range.
    """
    assumed = ["The laws come from simulated tests."] if pf.identity.simulated else []
    given = {} if options is None else {"d": options.depth, "t": options.time}
    chosen = {name: given.get(name) or _middle(pf, name, usual, assumed) for name, usual in USUAL.items()}
    asked = {} if options is None else dict(options.at)
    laws = [law for law in pf.laws.values() if law.form == "power" or {"V", "f"} & {f.symbol for f in law.factors}]
    by = next((law.by for law in laws if law.by is not None), None)
    level = None if options is None else options.by
    if by is not None and level is None:
        level = by.reference
        assumed.append(f"The laws are evaluated at {by.column} {level}, their reference level.")
    known = {"V", "f", "d", "t", *pf.laws}
    others = {
        f.symbol: float(f"{sqrt(f.low * f.high):.4g}")
        for law in laws
        for f in law.factors
        if f.symbol not in {*known, *asked} and f.low > 0
    }
    assumed += [f"{name} is fixed at {value:.4g}, the middle of its tested range." for name, value in others.items()]
    return DefaultSetting(chosen["d"], chosen["t"], level, {**others, **asked}, tuple(assumed))


def _middle(pf: "ParameterFile", name: str, usual: float, assumed: list[str]) -> float:
    factors = [f for law in pf.laws.values() for f in law.factors if f.symbol == name and f.low > 0]
    ranges = [(f.low * ratio(f.unit, UNITS[name]), f.high * ratio(f.unit, UNITS[name])) for f in factors]
    low, high = max((low for low, _ in ranges), default=0.0), min((high for _, high in ranges), default=usual)
    straight = all(law.form == "power" for law in pf.laws.values())  # others are limited to their tests
    if (straight and low <= usual <= high) or not 0 < low <= high:
        value, why = usual, "as in AC-2016"
    else:
        value, why = float(f"{sqrt(low * high):.4g}"), "the middle of the tested range"
    if ranges or name == "d":  # the removal rate has the depth, the time matters where a law has it
        assumed.append(f"{name} is {value:.4g} {UNITS[name]}, {why}.")
    return value


def lacks(pf: "ParameterFile", options: "PlanOptions | None" = None) -> str:
    """Reason why a file cannot drive the system; empty where it can."""
    limits = pf.limits
    if limits is None or not limits.on_responses:
        return NO_RESPONSE_LIMIT
    try:
        default_setting(pf, options).region(pf)
    except UsageError as error:
        return str(error)
    return ""


def replayed(
    pf: "ParameterFile", draws: "Mapping[str, Draws]", seed: int, options: "PlanOptions | None" = None
) -> Replayed:
    """Report on the region of a file, its best pair, and its probabilities."""
    held = default_setting(pf, options)
    region = held.region(pf)
    beyond = [line for line in region.notes if line.startswith("EXTRAPOLATED: ")]
    assumed = [*held.assumed, *(line for line in region.notes if line not in beyond)]
    setting = {"d_mm": held.d, "t_min": held.t, "by": held.by, "at": held.at, "extrapolated": beyond}
    if region.empty:
        facts: dict[str, object] = {**setting, "empty": True, "conflict": region.conflict}
        lines = [*beyond, region.conflict]
        return Replayed("region", TITLE, tuple(lines), tuple(assumed), facts, _figures(region, {}, None, None, {}))
    front = wear_front(region) if region.wear is not None else None
    marks = {f"AC-2016's {name}": region.at(*pair) for name, pair in PRINTED.items()} if _is_ac2016(pf, held) else {}
    lines = [*beyond, *_optimum(region), *_less(region)]
    facts = {**setting, "empty": False, "optimum": region.best.facts(), "corners": _corners(region)}
    if front is not None:
        facts["least_wear"] = {"loss": LOSS, **region.least_wear(LOSS).facts()}
    chances, more = _chances(pf, held, draws, seed)
    risks, facts["probability"], safe = _risk(region, chances)
    facts["printed"] = {name: point.facts() for name, point in marks.items()}
    lines += [*risks, *_printed(region, marks, chances.get("new_edge"))]
    assumed += more
    figures = _figures(region, marks, front, chances.get("new_edge"), safe)
    return Replayed("region", TITLE, tuple(lines), tuple(assumed), facts, figures)


def _optimum(region: VisibleRegion) -> list[str]:
    best = region.best
    gains = ", ".join(f"{name} {value:.2f} %" for name, value in region.sensitivities.items())
    active = f"Active limits: {' and '.join(best.held_by)}"
    lines = [
        f"Greatest metal removal rate within the limits at {_at(region)}: {best.words} (calculated).",
        f"{active}; gain in MRR per 1 % of each: {gains}." if gains else f"{active}.",
    ]
    if not best.tested:
        lines.append(
            "EXTRAPOLATED: this pair lies outside the tested region of the laws; test it before relying on it."
        )
    corners = "; ".join(f"{c.letter} ({four(c.V)}, {four(c.f)}) {' and '.join(c.limits)}" for c in region.corners)
    lines.append(f"Corners of the region, (V m/min, f mm/rev) and the limits that meet there: {corners}.")
    return lines


def _less(region: VisibleRegion) -> list[str]:
    if region.wear is None:
        return ["The file has no law of wear, so wear and MRR cannot be compared."]
    best, less = region.best, region.least_wear(LOSS)
    before, after, unit = best.values[region.wear], less.values[region.wear], best.units[region.wear]
    rate = ""
    if best.wear_rate is not None and less.wear_rate is not None:
        rate = f", and the wear rate, also least there, from {three(best.wear_rate)} to {three(less.wear_rate)} um/min"
    return [
        f"{100 * LOSS:g} % less MRR ({less.where}: MRR {less.MRR:.0f} mm3/min) lowers {region.wear} after "
        f"{region.setting.t:g} min by {100 * (1 - after / before):.1f} %, from {three(before)} to {three(after)} {unit}"
        f"{rate}."
    ]


def _risk(
    region: VisibleRegion, chances: Mapping[str, Feasibility]
) -> tuple[list[str], dict[str, object], dict[str, OperatingPoint]]:
    """Sentences, facts and best pairs at a required probability: of a new edge, and of the laws where uncertain."""
    best, lines, found = region.best, [], {}
    facts: dict[str, dict[str, object]] = {}
    for kind, chance in chances.items():
        kept = chance.at(*best.xy)
        facts[kind] = {"of": chance.of, "draws": chance.count, "at_optimum": kept, "level": REQUIRED, "best": None}
        head = f"For {chance.of} ({chance.count} draws)"
        try:
            safe = chance.best(REQUIRED)
        except DataError as error:
            lines.append(f"{head}: {error}")
            continue
        facts[kind]["best"] = safe.facts()
        if kind == "new_edge":
            found[f"best for {100 * REQUIRED:g} %"] = safe
        lines.append(
            f"{head} the best pair keeps all limits with probability {_percent(kept, chance.count)}; for "
            f"{100 * REQUIRED:g} % the best is {safe.where}: MRR {safe.MRR:.0f} mm3/min, "
            f"{_change(safe.MRR / best.MRR)}{'' if safe.tested else ', outside the tested ranges'}."
        )
    return lines, dict(facts), found


def _printed(region: VisibleRegion, marks: Mapping[str, OperatingPoint], chance: Feasibility | None) -> list[str]:
    """Points that AC-2016 reads off its charts, with their loads and probabilities."""
    out = []
    for (name, point), words in zip(marks.items(), WORDS.values(), strict=False):
        limits = [e for e in region.limits if not isinstance(e, RegionLimit) and e.symbol in point.values]
        risks = {} if chance is None else chance.risks(*point.xy)
        loads = [
            f"{each.symbol} {three(point.values[each.symbol])} {point.units[each.symbol]} for {each.value:g}"
            + (f" (exceeded in {100 * risks[each.symbol]:.0f} % of new edges)" if risks else "")
            for each in limits
        ]
        over = f"over {' and '.join(point.exceeds)}" if point.exceeds else "within the limits"
        out.append(
            f"{name} ({words}, read off a chart), {point.where}: MRR {point.MRR:.0f} mm3/min, {', '.join(loads)}: "
            f"{over}{_kept_words(point, chance)}."
        )
    return out


def _chances(
    pf: "ParameterFile", held: DefaultSetting, draws: "Mapping[str, Draws]", seed: int
) -> tuple[dict[str, Feasibility], list[str]]:
    """Probabilities of a new edge, and of the laws themselves where they are uncertain; and the assumptions."""
    try:
        chances = {"new_edge": held.probability(pf, draws, seed, "prediction")}
    except UsageError as error:
        return {}, [f"The probability of keeping the limits is not known: {error}"]
    sources = chances["new_edge"].sources
    if draws or not all("exactly known" in words for words in sources):
        chances["laws"] = held.probability(pf, draws, seed, "mean")
    return chances, [
        f"Probabilities are based on the laws of {_grouped(sources)}.",
        "Given the data the laws are independent, and so are the deviations of wear, power and force of a row from "
        "them.",
    ]


def _grouped(sources: tuple[str, ...]) -> str:
    """Sources with their laws, equal ones grouped."""
    by_source: dict[str, list[str]] = {}
    for words in sources:
        name, _, source = words.partition(" ")
        by_source.setdefault(source, []).append(name)
    return "; ".join(f"{', '.join(names)} {source}" for source, names in by_source.items())


def _kept_words(point: OperatingPoint, chance: Feasibility | None) -> str:
    """The probability that a point keeps all limits; empty where it is not computed."""
    if chance is None:
        return ""
    return f"; it keeps all with probability {_percent(chance.at(*point.xy), chance.count)}"


def _is_its_pair(tool: str, work: str) -> bool:
    return any(name in tool.upper() for name in ("GC435", "GC345")) and work.upper().startswith("709M40")


def _is_ac2016(pf: "ParameterFile", held: DefaultSetting) -> bool:
    """Whether this is the paper's case: its file, or its tool, work and limits; at its depth and time."""
    if (held.d, held.t) != (2.5, 10.0):
        return False
    if pf.provenance.options.get("paper") == "AC-2016":
        return True
    limits = pf.limits
    if (
        not _is_its_pair(pf.identity.tool, pf.identity.work)
        or limits is None
        or limits.power is None
        or limits.force is None
    ):
        return False
    asked = (limits.power.value, limits.power.unit, limits.force.value, limits.force.unit)
    return asked == (7.0, "kW", 1300.0, "N")


def _figures(
    region: VisibleRegion,
    marks: Mapping[str, OperatingPoint],
    front: WearFront | None,
    chance: Feasibility | None,
    safe: Mapping[str, OperatingPoint],
) -> "dict[str, Figure]":
    from ...controllers.region.figures import (
        plot_front,
        plot_probability,
        plot_region,
        plot_region_detail,
        plot_wear,
        surfaces_figure,
    )

    axes = {"region": plot_region(region, marks=marks)}
    if front is not None:
        axes["region_wear"] = plot_wear(region, front=front)
        axes["region_less_metal"] = plot_front(front)
        if front.wear_rate is not None:
            axes["region_wear_rate"] = plot_wear(region, front=front, rate=True)
    if marks:
        axes["region_close"] = plot_region_detail(region, marks)
    if chance is not None:
        axes["region_probability"] = plot_probability(chance, marks={**marks, **safe})
    figures: dict[str, Figure] = {name: ax.get_figure(root=True) for name, ax in axes.items()}  # type: ignore[misc]
    return {**figures, "region_surfaces": surfaces_figure(region)}


def _corners(region: VisibleRegion) -> list[dict[str, object]]:
    return [{"letter": c.letter, "V_m_min": c.V, "f_mm_rev": c.f, "limits": list(c.limits)} for c in region.corners]


def _change(share: float) -> str:
    """Removal rate against that of the best pair; above it where draws of a law lie below its estimate."""
    return f"{100 * abs(1 - share):.0f} % {'less' if share <= 1 else 'more'} MRR"


def _at(region: VisibleRegion) -> str:
    return region.at_words.replace(", t ", " and t ")


def _percent(p: float, draws: int) -> str:
    """A share of draws with its Monte Carlo error, two standard errors."""
    return f"{100 * p:.0f} +- {200 * sqrt(p * (1 - p) / draws):.1f} %"
