"""Limits, operating window, controller settings and costs as parts of a card."""

from typing import TYPE_CHECKING, Any

from ...core.errors import FitmodelsError
from ...core.rounding import middle_of
from ...parameters import ParameterFile
from ...parameters.sections.base import Covariance, ModelCovariance
from ...parameters.sections.costs import CostsSection, PartCut
from ...parameters.sections.force_control import AdaptiveForceSection, DriveSection, RoughnessSection
from ...parameters.sections.load_line import (
    Bound,
    Engagement,
    FeedLimit,
    LimitInterval,
    LimitsSection,
    LoadLineSection,
    Range,
)
from ...parameters.setting_words import rounding_words, window_assumed
from .design import reference
from .numbers import count, fact, figure, number, percent, places, quantity, sentence, spread
from .parts import FactPart, NumberPart, WindowPart
from .verdicts import ADAPTIVE_FORCE, DRIVE, law_cautions, verdict_part

if TYPE_CHECKING:
    from ...controllers.region.operating_point import OperatingPoint
    from ...controllers.region.visible import VisibleRegion

ALONE = "The file has no law in V and f of the limited quantities, so there is no operating window."
BOUNDS = {"power": "power", "force": "force", "wear": "wear"}
RANGES = {"feed": "feed", "feed_rate": "feed rate", "speed": "cutting speed", "spindle_speed": "spindle speed"}
TITLE = "Operating window"
# field of the engagement -> words and unit ("load" and "feed": those of the settings)
ENGAGEMENT = {
    "feed_programmed": ("programmed feed, override 1", "feed"),
    "engage_at": ("load that identifies a cut", "load"),
    "hysteresis": ("width of this threshold", "load"),
    "engage_after": ("time above it until the loop controls", "s"),
    "feed_forward": ("feed-forward from the load law at entry", ""),
    "back_off": ("fastest fall of the override", "1/s"),
    "recover": ("fastest rise of the override", "1/s"),
    "filter_corner": ("corner of the low-pass of the load", "Hz"),
    "sample_time": ("period of the thread", "s"),
    "idle": ("load of the running spindle in air", "load"),
    "load_low": ("smallest valid reading", "load"),
    "load_high": ("largest valid reading", "load"),
    "arm_after": ("time that the spindle runs before the load is monitored", "s"),
    "lost_after": ("time of invalid readings that is a fault", "s"),
    "stuck_after": ("time of equal readings in the cut that is a fault, 0: not monitored", "s"),
    "heartbeat": ("time without a heartbeat that is a fault, 0: not monitored", "s"),
    "overload_after": ("time of an overload that inhibits the feed", "s"),
}
ON_FAULT = {"lower limit": "a fault takes the feed to its lower limit", "stop": "a fault inhibits the feed"}
ASSUMED = "engagement and monitoring that are not listed are assumed by exports and replays, which state their values"


def window_parts(pf: ParameterFile) -> tuple[WindowPart, ...]:
    """Limits, operating window, and the settings of each controller in the file."""
    window = operation_window(pf)
    found = (
        None if pf.limits is None else limits_window(pf.limits, alone=window is None),
        window,
        None if pf.load_line is None else load_line_window(pf.load_line, pf),
        None if pf.roughness is None else roughness_window(pf.roughness, pf),
        None if pf.drive is None else drive_window(pf.drive),
        None if pf.adaptive_force is None else adaptive_force_window(pf.adaptive_force),
    )
    return tuple(each for each in found if each is not None)


def limits_window(limits: LimitsSection, *, alone: bool = False) -> WindowPart:
    """Limits of machine, tool and work; ``alone`` where there is no operating window."""
    facts: list[FactPart] = []
    for name, words in BOUNDS.items():
        bound: Bound | None = getattr(limits, name)
        if bound is not None:
            facts += fact(f"{words}{f' {bound.of}' if bound.of else ''}, at most", figure(bound.value, 6, bound.unit))
    for symbol, ends in limits.responses.items():
        facts += [] if ends.low is None else fact(f"{symbol}, at least", figure(ends.low, 6, ends.unit))
        facts += [] if ends.high is None else fact(f"{symbol}, at most", figure(ends.high, 6, ends.unit))
    for name, words in RANGES.items():
        each: Range | None = getattr(limits, name)
        if each is not None:
            facts += fact(f"{words}, lowest", figure(each.low, 6, each.unit))
            facts += fact(f"{words}, highest", figure(each.high, 6, each.unit))
    return WindowPart(
        title="Limits", facts=tuple(facts), sentences=("Limits as given, not fitted.", *([ALONE] if alone else []))
    )


def costs_part(pf: ParameterFile) -> WindowPart | None:
    """Costs of a part as stated, with the commands that stated them; None where the file has none."""
    if (costs := pf.costs) is None:
        return None
    stated = " && ".join(command for command in pf.provenance.then if command.startswith("fitmodels costs "))
    source = f"stated by: {stated}" if stated else "the file does not name the command that stated them"
    assumed = ["The efficiency is not stated: 1 is assumed."] if costs.energy and not costs.efficiency else []
    of = "a part" if costs.cut else "1 cm3, because the cut of a part is not stated"
    sentences = (sentence(f"costs as stated, not measured; {source}"), *assumed)
    return WindowPart(title=f"Costs of {of}", facts=_costs(costs, costs.currency), sentences=sentences)


def _costs(costs: CostsSection, money: str) -> tuple[FactPart, ...]:
    """Each cost with its unit."""
    cut = costs.cut or PartCut.model_construct()
    figures = (
        ("machine rate", costs.machine, f"{money}/h"),
        ("labour rate", costs.labour, f"{money}/h"),
        ("price of an insert", costs.insert, money),
        ("edges of an insert", costs.edges, ""),
        ("price of an edge", costs.price_of_edge, money),
        ("time of a change of the edge", costs.change, "min"),
        ("handling time of a part", costs.handling if costs.cut else None, "min"),
        ("volume cut from a part", cut.volume, "cm3"),
        ("length cut of a part, one pass", cut.length, "mm"),
        ("diameter of this cut", cut.diameter, "mm"),
        ("cost of a failed edge beyond its change", costs.failure, money),
        ("price of energy", costs.energy, f"{money}/kWh"),
        ("efficiency from the line to the tool", costs.efficiency, ""),
    )
    return tuple(item for name, value, unit in figures for item in fact(name, figure(value, 6, unit)))


def load_line_window(line: LoadLineSection, pf: ParameterFile) -> WindowPart:
    """Settings of milling at constant load."""
    wear, feed, load = line.unit_wear, line.unit_feed, line.unit_load
    low, high = line.window
    facts = (
        *fact(f"reference load {line.load}", figure(line.reference, 6, load)),
        *fact("largest load that a worn tool withstands without chipping", figure(line.worn, 6, load)),
        *fact("safety factor", figure(line.safety_factor, 6)),
        *_feed("upper feed limit", line.upper, feed, wear),
        *_feed("lower feed limit", line.lower, feed, wear),
        *fact("tool change, lowest wear", figure(low, 6, wear), "assumed" if window_assumed(line) else ""),
        *fact("tool change, highest wear", figure(high, 6, wear), "assumed" if window_assumed(line) else ""),
        *(fact("probability of a wear in this range", percent(line.probability, 2), line.probability_of)
          if line.probability is not None else ()),
        *fact("dwell time at the lower limit", figure(line.dwell, 6, "s")),
        *_engagement(line.engagement, {"load": load, "feed": feed}),
    )  # fmt: skip
    sentences = [
        *law_cautions(pf, [line.law]),
        f"the loop controls {line.load} to {quantity(figure(line.reference, 6, load))} by the feed, between the two "
        "feed limits; the tool is changed when the command stays at the lower one",
        *([f"no probability of the wear: {line.probability_of}"] if line.probability is None and line.probability_of
          else []),
        *([ON_FAULT[line.engagement.on_fault]] if line.engagement and line.engagement.on_fault else []),
        ASSUMED,
        *([rounding] if (rounding := rounding_words(line)) else []),
        *line.notes,
    ]  # fmt: skip
    by = f", {line.by}" if line.by else ""
    title = f"Constant load, from the law of {line.law}{by}"
    return WindowPart(title=title, facts=facts, sentences=tuple(map(sentence, sentences)))


def _engagement(given: Engagement | None, units: dict[str, str]) -> tuple[FactPart, ...]:
    """Statements of the file on engagement and monitoring."""
    if given is None:
        return ()
    facts = (
        fact(words, figure(getattr(given, name), 6, units.get(unit, unit)))
        for name, (words, unit) in ENGAGEMENT.items()
        if getattr(given, name) is not None
    )
    return tuple(item for each in facts for item in each)


def roughness_window(r: RoughnessSection, pf: ParameterFile) -> WindowPart:
    """Settings of turning at constant roughness."""
    facts = (
        *fact("required roughness", figure(r.roughness, 6, r.unit_roughness)),
        *fact("reference force", figure(r.force, 4, r.unit_force), f"from the law's {r.force_from}"),
        *fact("force threshold of a cut", figure(r.threshold, 6, r.unit_force)),
        *fact("lowest override", figure(r.override_low, 6)),
        *fact("highest override", figure(r.override_high, 6)),
        *fact("programmed feed", figure(r.feed, 6, r.unit_feed)),
        *fact("largest uncut chip thickness", figure(r.chip_thickness, 6, r.unit_feed)),
        *fact("sample time", figure(r.sample_time, 6, "s")),
        *fact("time constant of the feed drive", figure(r.servo_time, 6, "s")),
    )
    sentences = [
        *law_cautions(pf, [r.law]),
        f"{r.law} is controlled to {quantity(figure(r.roughness, 6, r.unit_roughness))} through a force of "
        f"{quantity(figure(r.force, 4, r.unit_force))}, by the feed override",
        *_reaches(r, pf),
        *r.notes,
    ]
    return WindowPart(title="Constant roughness", facts=facts, sentences=tuple(map(sentence, sentences)))


def drive_window(d: DriveSection) -> WindowPart:
    """Inertia and friction of a feed drive."""
    errors = _standard_errors(d.uncertainty)
    values = (
        ("inertia M", "M", d.unit_inertia),
        ("viscous friction Fv", "Fv", d.unit_viscous),
        ("Coulomb friction Fc", "Fc", d.unit_force),
        ("constant force", "offset", d.unit_force),
    )
    unit = f"{d.unit_force} per {d.unit_u or 'unit of the input'}"
    facts = (
        *(
            item
            for words, name, of in values
            for value in [getattr(d, name)]
            for item in fact(words, number(value, errors.get(name), of), _error(value, errors, name))
        ),
        *(fact("force that is not explained", percent(d.relative_error, 2)) if d.relative_error is not None else ()),
        *fact("simulation from the force alone", places(d.simulated_fit, 1, "%"), "of the speed, samples fitted"),
        *(fact("held-out fit", places(d.held_out_fit, 1, "%"), "of the speed of a record that was not fitted")
          if d.held_out_fit is not None else ()),
        *fact("force per unit", figure(d.force_per_unit, 6, unit)),
        *fact("low-pass", figure(d.cutoff, 4, "Hz")),
        *fact("sample time", figure(d.sample_time, 6, "s")),
        *fact("rows", count(d.n)),
    )  # fmt: skip
    law = f"{d.input} = M a + Fv v + Fc sign(v) + offset, with {d.output} for the motion"
    return WindowPart(
        title="Feed drive",
        verdict=verdict_part(DRIVE, d.verdict),
        facts=facts,
        sentences=tuple(sentence(text) for text in (law, *d.notes)),
    )


def _standard_errors(uncertainty: object) -> dict[str, float]:
    """Standard errors by name; empty where there is no covariance."""
    if not isinstance(uncertainty, ModelCovariance):
        return {}
    return {name: row[k] ** 0.5 for k, (name, row) in enumerate(zip(uncertainty.of, uncertainty.matrix, strict=True))}


def _error(value: float, errors: dict[str, float], name: str) -> str:
    """The standard error of an estimate in words; empty where it is not known."""
    error = errors.get(name)
    return f"standard error {spread(value, error).text}" if error else ""


def adaptive_force_window(a: AdaptiveForceSection) -> WindowPart:
    """Estimates and settings of adaptive force control."""
    errors = _standard_errors(a.uncertainty)
    lacking = [name for name in ("g1", "g2", "g3", "Kd", "lam") if getattr(a, name) is None]
    by = a.sources
    points = (
        fact(f"force at depth {quantity(figure(p.depth, 6, a.unit_depth))}", figure(p.force, 6, a.unit_force))
        for p in a.set_points
    )
    facts = (
        *(
            item
            for name in ("m", "alpha", "beta")
            for item in fact(
                name,
                figure(getattr(a, name), 6),
                ", ".join(
                    filter(None, ("first estimate, divided by k", _error(getattr(a, name), errors, name), by.get(name)))
                ),
            )
        ),
        *fact("depth of the run", figure(a.depth, 6, a.unit_depth), by.get("depth", "")),
        *(
            item
            for name in ("g1", "g2", "g3")
            if getattr(a, name) is not None
            for item in fact(name, figure(getattr(a, name), 6), by.get(name, "adaptation rate"))
        ),
        *fact("Kd", figure(a.Kd, 6), by.get("Kd", "")),
        *fact("lambda", figure(a.lam, 6, "1/s"), by.get("lam", "")),
        *(item for point in points for item in point),
        *fact("spindle speed", figure(a.spindle_speed, 6, "1/min"), by.get("spindle_speed", "")),
        *fact("time of the reference model", figure(a.reference_time, 6, "s"), by.get("reference_time", "")),
        *fact("sample time", figure(a.sample_time, 6, "s"), by.get("sample_time", "")),
        *fact("averaging time", figure(a.average_time, 6, "s"), by.get("average_time", "")),
        *fact("lowest command", figure(a.low, 6, a.unit_u), by.get("low", "")),
        *fact("highest command", figure(a.high, 6, a.unit_u), by.get("high", "")),
        *fact("smallest valid force", figure(a.force_low, 6, a.unit_force), by.get("force_low", "")),
        *fact("largest valid force", figure(a.force_high, 6, a.unit_force), by.get("force_high", "")),
    )
    return WindowPart(
        title="Adaptive force",
        verdict=verdict_part(ADAPTIVE_FORCE, a.verdict),
        facts=facts,
        sentences=(
            *(
                [f"Settings not stated: {', '.join(lacking)}; derive them: fitmodels adaptive-force."]
                if lacking
                else []
            ),
            *map(sentence, a.notes),
        ),
    )


def _feed(name: str, limit: FeedLimit, unit: str, unit_wear: str) -> tuple[FactPart, ...]:
    at = f"at a wear of {quantity(figure(limit.wear, 6, unit_wear))}"
    ends = limit.interval
    if isinstance(ends, LimitInterval):
        low, high, level = figure(ends.low, 4, unit), figure(ends.high, 4, unit), percent(ends.level)
        return (
            *fact(name, figure(limit.value, 4, unit), f"{at}; {level.text} % interval by {ends.method}"),
            *fact(f"{name}, low end", low),
            *fact(f"{name}, high end", high),
        )
    return fact(name, figure(limit.value, 4, unit), f"{at}; no interval: {ends.reason}")


def _reaches(r: RoughnessSection, pf: ParameterFile) -> list[str]:
    """Roughness predicted by its law at the reference force, where that is possible."""
    law = pf.laws.get(r.law)
    if law is None or law.by is not None or len(law.factors) != 1 or not isinstance(law.uncertainty, Covariance):
        return []
    if law.residual_se is None:
        return []
    at: dict[str, Any] = {law.factors[0].symbol: r.force}
    return [law.predict(at).words]


def operation_window(pf: ParameterFile) -> WindowPart | None:
    """Corners and optimum at the middle depth and time of the tests; None without limits or laws of V and f.

    Where the limits do not match the laws, the window holds that sentence alone.
    """
    if not _can(pf):
        return None
    from ...controllers.region.visible import visible_region

    d, t = (_middle(pf, symbol) for symbol in ("d", "t"))
    by = next((reference(law) for law in pf.laws.values() if law.by is not None), None)
    at: dict[str, Any] = {name: value for name, value in (("d", d), ("t", t)) if value is not None}
    try:
        found = visible_region(pf, by=by, **at)
        return _window(found, pf)
    except FitmodelsError as error:
        return WindowPart(title=TITLE, sentences=(sentence(f"no operating window: {error}"),))


def _can(pf: ParameterFile) -> bool:
    limits = pf.limits
    if limits is None or not limits.on_responses:
        return False
    return any({"V", "f"} <= {f.symbol for f in law.factors} for law in pf.laws.values())


def _middle(pf: ParameterFile, symbol: str) -> float | None:
    ranges = [(f.low, f.high) for law in pf.laws.values() for f in law.factors if f.symbol == symbol]
    if not ranges:
        return None
    return middle_of(max(low for low, _ in ranges), min(high for _, high in ranges), logs=True)


def _window(found: "VisibleRegion", pf: ParameterFile) -> WindowPart:
    timed = any(factor.symbol == "t" for law in found.laws.values() for factor in law.factors)
    at = f"at d {quantity(figure(found.setting.d, 6, 'mm'))}"
    at += f" and t {quantity(figure(found.setting.t, 6, 'min'))}" if timed else ""
    if found.empty:
        return WindowPart(title=TITLE, sentences=(sentence(f"no feasible point {at}: {found.conflict}"),))
    best = found.best
    corners = (
        item
        for corner in found.corners
        for item in (
            *fact(f"corner {corner.letter}, V", figure(corner.V, 4, "m/min"), " and ".join(corner.limits)),
            *fact(f"corner {corner.letter}, f", figure(corner.f, 4, "mm/rev")),
        )
    )
    held = ", bounded by " + " and ".join(best.held_by) if best.held_by else ""
    tested = "" if best.tested else "; this point lies outside the tested region, so verify it before use"
    sentences = [
        *law_cautions(pf, best.values),
        f"{at}, the maximum metal removal rate within the limits is {quantity(_removal(best.MRR))}{held}{tested}",
        "the window uses median predictions: at a limit about half of all tools exceed it, so keep a margin according "
        "to the intervals",
        *found.notes,
    ]
    return WindowPart(title=TITLE, facts=(*_best(best), *corners), sentences=tuple(map(sentence, sentences)))


def _best(best: "OperatingPoint") -> tuple[FactPart, ...]:
    responses = (
        item
        for name, value in best.values.items()
        for item in fact(f"{name} at the optimum", figure(value, 4, best.units[name]))
    )
    return (
        *fact("V of the optimum", figure(best.V, 4, "m/min")),
        *fact("f of the optimum", figure(best.f, 4, "mm/rev")),
        *fact("metal removal rate of the optimum", _removal(best.MRR), "MRR = 1000 V f d"),
        *responses,
        *fact("wear rate at the optimum", figure(best.wear_rate, 4, "um/min")),
    )


def _removal(value: float) -> NumberPart:
    return figure(value, 4, "mm3/min")
