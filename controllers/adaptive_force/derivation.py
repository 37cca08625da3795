"""Settings of adaptive force control from the estimates in a file and what is chosen, each with its source.

Limits of the command are those that were tested unless others are given; beyond 1.5 times the tests they are refused,
and so are set points that the limits do not reach. What is not given is derived by the rule of `design`, or assumed.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from ...core.arrays import Array
from ...core.errors import UsageError
from ...datasets.records.resampling import aliased_teeth, aliased_words, samples_of_revolution
from ...parameters.gather.control import DESIGNED_BEFORE
from ...parameters.sections.force_control import TESTED, RecordRanges
from .design import (
    SLOWEST_REFERENCE,
    ForceGains,
    Margins,
    Timing,
    design_gains,
    largest_step,
    loop_margins,
    poles_of,
    refuse_no_plant,
    settling_time,
    small_margins,
)

if TYPE_CHECKING:
    from ...parameters.sections.force_control import AdaptiveForceSection


ESTIMATES: Final = ("m", "alpha", "beta")
GIVEN, AS_BEFORE = "given", "as in the file"  # sources
ALLOWED: Final = "allowed beyond the tests"  # in a source, with what was allowed
STEP: Final = 0.001  # s: period of the servo thread of usual controls
ALMOST, UNEVEN = 0.02, 0.1  # of a revolution: averages that miss a whole one by more are not assumed, and refused
READINGS: Final = (-0.1, 4.0)  # times the largest set point: valid readings, where the sensor's range is not given
BEYOND, BEYOND_NEED = 1.5, 2.0  # times the tested range; times the feed that the set points need
OTHER_SPEED: Final = 0.1  # relative: a spindle speed that is not that of the record
LONGEST_DELAY, SLOWEST = 1.0, 100.0  # s; times the time of the reference model by the rule
DRAWS, SEED = 1000, 1
ASSUMED: Final = f"assumed: {READINGS[0]:g} and {READINGS[1]:g}"
RULE: Final = "design rule"  # beginning of the source of a gain
AGREES: Final = 2e-3  # of a gain by the rule: a source has four digits of the dead time


@dataclass(frozen=True, slots=True)
class ForceChoices:
    """Choices for adaptive force control, in the units of the section; None is derived, kept or assumed.

    Attributes
    ----------
    points : tuple of (depth, force)
    spindle_speed : float or None
        1/min.
    teeth : int or None
        Of the cutter.
    limits, readings : (low, high) or None
        Of the command, and of a valid reading.
    sample_time, delay, reference_time : float or None
        s.
    Kd, lam, g3 : float or None
        In place of the rule.
    largest_feed : float
        Largest command that is physically possible.
    beyond_tested : bool
        Whether command and force may lie far beyond the ranges of the record.
    """

    points: tuple[tuple[float, float], ...] = ()
    spindle_speed: float | None = None
    teeth: int | None = None
    limits: tuple[float, float] | None = None
    readings: tuple[float, float] | None = None
    sample_time: float | None = None
    delay: float | None = None
    reference_time: float | None = None
    Kd: float | None = None
    lam: float | None = None
    g3: float | None = None
    largest_feed: float = np.inf
    beyond_tested: bool = False


class AtSetPoint(NamedTuple):
    """The loop at one set point: command that it needs, margins, and s until it has settled within 2 %."""

    depth: float
    force: float
    feed: float
    margins: Margins
    settling: float


@dataclass(frozen=True, slots=True)
class ForceDesign:
    """Settings of adaptive force control, each with its source, and the loop that they give.

    Attributes
    ----------
    settings : dict
        Fields of the section, with ``sources``.
    points : tuple of AtSetPoint
    timing : Timing
    drawn : (int, float, float) or None
        Draws of the estimates, smallest gain margin and smallest phase margin among them.
    largest_step : float
        s.
    """

    settings: dict[str, Any]
    points: tuple[AtSetPoint, ...]
    timing: Timing
    drawn: tuple[int, float, float] | None
    largest_step: float


def design(section: "AdaptiveForceSection", choices: ForceChoices) -> ForceDesign:
    """Settings of a section with estimates, by the rule of this module.

    Raises
    ------
    UsageError
        Estimates of no drive and cut or of an unknown depth, a lacking choice, a set point that needs a feed outside of
        the limits, limits or forces far beyond the tests, or margins that are too small.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> found = design(published("LYAP").adaptive_force, ForceChoices(limits=(30.0, 600.0)))
    >>> round(found.settings["Kd"], 4), found.settings["sources"]["lam"]
    (0.0434, 'design rule: the slower pole of drive and cut')
    >>> round(found.points[-1].feed), round(found.points[-1].margins.gain, 1)
    (200, 4.4)
    """
    ratios = np.array([section.m, section.alpha, section.beta])
    refuse_no_plant(ratios.tolist())
    if section.depth is None:
        raise UsageError(
            "adaptive_force: the depth of cut that the estimates come from is not known, and k grows with it; identify "
            "the record with --depth."
        )
    points = _set_points(section, choices)
    timing, timed, timing_from = _timing(section, choices)
    (low, high), limits_from = _limits(section, points, choices)
    deepest, force = points[-1][0], max(force for _, force in points)
    gains, by = _gains(ratios * section.depth / deepest, deepest, force, timing, choices, section.unit_depth)
    at = tuple(_at(ratios * section.depth / d, d, F, gains, timing) for d, F in points)
    _refuse(section, at, (low, high))
    readings = choices.readings or (float(READINGS[0] * force), float(READINGS[1] * force))
    if not (readings[0] < min(F for _, F in points) and readings[1] > force):
        raise UsageError(f"readings {readings[0]:g} to {readings[1]:g}: every set point must lie between them.")
    if readings[0] > 0:
        raise UsageError(
            f"--readings {readings[0]:g}:{readings[1]:g}: readings in air, near 0 {section.unit_force}, would be "
            f"invalid; give a range that encloses 0 and {force:g} {section.unit_force}, the largest set point."
        )
    assumed = GIVEN if choices.readings else f"{ASSUMED} times the largest force (--readings)"
    least = min(at, key=lambda one: one.margins.gain)
    cut = ratios * section.depth / least.depth
    return ForceDesign(
        {
            "set_points": [{"depth": d, "force": F} for d, F in points], **gains._asdict(), **timed, "low": low,
            "high": high, "force_low": readings[0], "force_high": readings[1], "reference_damping": 1.0,
            "sources": {**by, **timing_from, **limits_from, "set_points": GIVEN if choices.points else AS_BEFORE,
                        "force_low": assumed, "force_high": assumed, "reference_damping": "design rule"},
        },
        at, timing, _drawn(section, gains, least, timing), largest_step(cut[None], gains, least.force, timing),
    )  # fmt: skip


def _set_points(section: "AdaptiveForceSection", choices: ForceChoices) -> list[tuple[float, float]]:
    points = sorted(choices.points or [(point.depth, point.force) for point in section.set_points])
    if not points:
        raise UsageError("no set point: give the force for each depth of cut, for instance 2mm=200N.")
    depths = [depth for depth, _ in points]
    if len(set(depths)) < len(depths):
        raise UsageError(f"set points: the depth {max(depths, key=depths.count):g} is given twice.")
    if not all(0 < value < np.inf for point in points for value in point):
        raise UsageError("set points: depths and forces lie above zero.")
    return points


def _timing(section: "AdaptiveForceSection", choices: ForceChoices) -> tuple[Timing, dict[str, float], dict[str, str]]:
    """Timing of the law; its fields, and their sources."""
    average = section.average_time
    speed = choices.spindle_speed or section.spindle_speed or (60 / average if average else None)
    if speed is None:
        raise UsageError("the spindle speed is not known: the force is averaged over a revolution; give --spindle RPM.")
    run = section.spindle_speed or speed
    other = abs(speed / run - 1) > OTHER_SPEED
    if other and not choices.beyond_tested:
        raise UsageError(
            f"--spindle {speed:g} 1/min: the estimates are of a cut at {run:g} 1/min, and the force follows the feed "
            "in revolutions; record a cut at that speed, or allow it with --beyond-tested."
        )
    if choices.delay is not None and choices.delay > LONGEST_DELAY:
        raise UsageError(f"--delay {choices.delay:g} s: at most {LONGEST_DELAY:g} s; give it in s or ms, as 5ms.")
    turn = 60 / speed
    step = choices.sample_time or STEP
    whole = turn / samples_of_revolution(turn / min(step, turn), choices.teeth)
    uneven = abs(round(turn / step) * step / turn - 1) > ALMOST
    if choices.sample_time is None and (uneven or aliased_teeth(turn, step, choices.teeth)):
        step = whole
    samples = round(turn / step)
    turns = samples * step / turn
    if step > turn or abs(turns - 1) > UNEVEN:
        raise UsageError(
            f"--sample-time {step:g} s: the force is averaged over a revolution of {turn:.4g} s in whole steps; give a "
            f"step of at most that, near a whole part of it, as {whole:.4g}."
        )
    if aliased := aliased_teeth(turn, step, choices.teeth):
        known = "" if choices.teeth else ", or the number of teeth with --teeth"
        raise UsageError(
            f"--sample-time {step:g} s: {aliased_words(turn, step, aliased, choices.teeth)}. Give a step of "
            f"{whole:.4g} s{known}."
        )
    words = f"one revolution at {speed:g} 1/min" + ("" if abs(turns - 1) < 1e-9 else f" in whole steps: {turns:.4g}")
    given = f"given; {ALLOWED}: the estimates are of {run:g} 1/min" if other else GIVEN
    sources = {
        "spindle_speed": given if choices.spindle_speed else section.sources.get("spindle_speed", AS_BEFORE),
        "average_time": words,
        "sample_time": GIVEN if choices.sample_time else "assumed: period of the control (--sample-time)",
    }
    fields = {"spindle_speed": speed, "average_time": float(samples * step), "sample_time": float(step)}
    return Timing(float(step), samples, float(step) if choices.delay is None else choices.delay), fields, sources


def _limits(
    section: "AdaptiveForceSection", points: list[tuple[float, float]], choices: ForceChoices
) -> tuple[tuple[float, float], dict[str, str]]:
    """Limits of the command, and their sources; refused far beyond the tests."""
    tested, unit = section.tested, section.unit_u
    stated = None if section.low is None or section.high is None else (section.low, section.high)
    if choices.limits is not None:
        limits, source = choices.limits, GIVEN
    elif stated is not None and section.sources.get("high", GIVEN).startswith(GIVEN):
        limits, source = stated, section.sources.get("high", AS_BEFORE)
    elif tested is not None:
        limits, source = tested.command, f"tested: {section.sources[TESTED].partition(': ')[2]}"
    else:
        raise UsageError("the limits of the command are not known; give them with --feed, for instance 30:600mm/min.")
    low, high = limits
    if not 0 < low < high < np.inf:
        raise UsageError(f"the command from {low:g} to {high:g} {unit}: give 0 < low < high with --feed.")
    if high > choices.largest_feed:
        raise UsageError(
            f"the command up to {high:g} {unit} is more than the {choices.largest_feed:.4g} {unit} of any tool: "
            "check the value and the unit of --feed."
        )
    far = list(far_beyond(section, points, high))
    if far and not choices.beyond_tested:
        raise UsageError(
            f"{'; '.join(far)}: more than {BEYOND:g} times as much. Test there, or allow it with --beyond-tested."
        )
    source += f"; {ALLOWED}: {'; '.join(far)}" if far else ""
    return limits, dict.fromkeys(("low", "high"), source)


def far_beyond(section: "AdaptiveForceSection", points: list[tuple[float, float]], high: float) -> "Iterator[str]":
    """Commands and forces beyond `BEYOND` times the record, or without one beyond the feed for the set points."""
    tested, unit, F = section.tested, section.unit_u, max(force for _, force in points)
    if tested is None:
        need = max(section.beta * (section.depth or np.nan) / depth * force for depth, force in points)
        if high > BEYOND_NEED * need:
            yield f"the command up to {high:g} {unit}, where the set points need {need:.4g} {unit} at most"
        return
    if high > BEYOND * tested.command[1]:
        yield f"the command up to {high:g} {unit}, tested up to {tested.command[1]:g} {unit}"
    if BEYOND * tested.force[1] < F:
        yield f"a force of {F:g} {section.unit_force}, tested up to {tested.force[1]:g} {section.unit_force}"


def _gains(
    ratios: Array, deepest: float, force: float, timing: Timing, choices: ForceChoices, unit_depth: str
) -> tuple[ForceGains, dict[str, str]]:
    """Gains by the rule or as given, and their sources."""
    rule = design_gains(ratios.tolist(), force, timing)
    T = choices.reference_time or rule.reference_time
    if not timing.dead_time <= T <= SLOWEST * rule.reference_time:
        raise UsageError(
            f"--reference-time {T:g} s: between the dead time of {timing.dead_time:.3g} s and "
            f"{SLOWEST * rule.reference_time:.3g} s; the rule gives {rule.reference_time:.3g} s."
        )
    g3 = choices.g3 if choices.g3 is not None else rule.g3 * (choices.Kd or rule.Kd) / rule.Kd
    gains = ForceGains(choices.Kd or rule.Kd, choices.lam or rule.lam, g3 * T**4, g3 * T**2, g3, T)
    at = f"at {deepest:g} {unit_depth}"
    by = {
        "Kd": f"design rule: m/k {at} over twice the dead time of {1e3 * timing.dead_time:.4g} ms",
        "lam": "design rule: the slower pole of drive and cut",
        "g3": f"design rule: Kd times the faster pole over the square of the largest force {force:g}",
        "g2": "design rule: g3 times reference_time^2",
        "g1": "design rule: g3 times reference_time^4",
        "reference_time": f"design rule: 2 / lambda, at least {SLOWEST_REFERENCE:g} dead times",
    }
    given = {"Kd": choices.Kd, "lam": choices.lam, "g3": choices.g3, "reference_time": choices.reference_time}
    return gains, {**by, **{name: GIVEN for name, value in given.items() if value is not None}}


def off_rule(section: "AdaptiveForceSection") -> "Iterator[str]":
    """Gains, times and valid readings that are not those of the rule that their source states.

    >>> from fitmodels.parameters.published import published
    >>> list(off_rule(published("LYAP").adaptive_force))
    []
    """
    gains = {name: getattr(section, name) for name in ForceGains._fields}
    if None in (section.depth, *gains.values()) or not section.set_points or DESIGNED_BEFORE in section.notes:
        return
    for name, value in _by_rule(section, gains).items():
        held, source = getattr(section, name), section.sources.get(name, "")
        if source.startswith((RULE, ASSUMED)) and not abs(held - value) <= AGREES * abs(value):
            yield f"{name} is {held:.4g}; its source, {source}, gives {value:.4g}"


def _by_rule(section: "AdaptiveForceSection", gains: dict[str, float]) -> dict[str, float]:
    ratios = np.array([section.m, section.alpha, section.beta]) * (section.depth or 1.0) / section.set_points[-1].depth
    p, q = (float(pole) for pole in poles_of(ratios[None])[0].real)
    T, largest = gains["reference_time"], max(point.force for point in section.set_points)
    rule = dict(zip(("force_low", "force_high"), (times * largest for times in READINGS), strict=True))
    rule |= {"lam": p, "g3": gains["Kd"] * q / largest**2, "g2": gains["g3"] * T**2, "g1": gains["g3"] * T**4}
    if found := re.search(r"dead time of ([\d.]+(?:e[+-]?\d+)?) ms", section.sources.get("Kd", "")):
        dead_time = float(found[1]) / 1e3
        rule |= {"Kd": ratios[0] / (2 * dead_time), "reference_time": max(2 / p, SLOWEST_REFERENCE * dead_time)}
    return rule


def _at(ratios: Array, depth: float, force: float, gains: ForceGains, timing: Timing) -> AtSetPoint:
    margins = loop_margins(ratios[None], gains, force, timing)[0]
    return AtSetPoint(depth, force, float(ratios[2] * force), margins, settling_time(ratios, gains, force))


def _refuse(section: "AdaptiveForceSection", at: tuple[AtSetPoint, ...], limits: tuple[float, float]) -> None:
    """Refuse set points that the limits do not reach, and small margins."""
    for one in at:
        where = f"{one.force:g} {section.unit_force} at {one.depth:g} {section.unit_depth}"
        if not limits[0] <= one.feed <= limits[1]:
            raise UsageError(
                f"{where} needs a command of {one.feed:.4g} {section.unit_u} by the estimates, outside of the limits "
                f"{limits[0]:g} to {limits[1]:g}: change the set point or the limits (--feed)."
            )
        if words := small_margins(one.margins):
            raise UsageError(f"{where}: {words}")


def _drawn(
    section: "AdaptiveForceSection", gains: ForceGains, at: AtSetPoint, timing: Timing
) -> tuple[int, float, float] | None:
    """Draws of the estimates and their smallest margins at the set point with the smallest gain margin."""
    from ...parameters.sections.base import ModelCovariance

    held = section.uncertainty
    if not isinstance(held, ModelCovariance) or section.depth is None:
        return None
    order = [held.of.index(name) for name in ESTIMATES]
    cov = np.array(held.matrix)[np.ix_(order, order)]
    mean = np.array([section.m, section.alpha, section.beta])
    draws = np.random.default_rng(SEED).multivariate_normal(mean, cov, DRAWS, method="eigh")
    draws = draws[(draws > 0).all(axis=1)] * section.depth / at.depth
    found = loop_margins(draws, gains, at.force, timing)
    return len(draws), min(m.gain for m in found), min(m.phase for m in found)


def converted(
    section: "AdaptiveForceSection", unit_u: str, unit_force: str, of_command: float, of_force: float
) -> "AdaptiveForceSection":
    """Estimates of a section in other units; ``of_command`` and ``of_force`` are a unit of now in the new units.

    Settings of the section are left out: they are designed again.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> section = converted(published("LYAP").adaptive_force, "mm/rev", "kN", 1 / 3000, 1e-3)
    >>> round(section.beta, 4), [point.force for point in section.set_points]
    (0.4167, [0.15, 0.2, 0.32])
    """
    from ...parameters.sections.base import ModelCovariance

    factor, data, held = of_command / of_force, section.model_dump(), section.uncertainty
    data |= {name: data[name] * factor for name in ESTIMATES} | {"unit_u": unit_u, "unit_force": unit_force}
    if isinstance(held, ModelCovariance):
        data["uncertainty"]["matrix"] = (np.array(held.matrix) * factor**2).tolist()
    for name, scale in (("low", of_command), ("high", of_command), ("force_low", of_force), ("force_high", of_force)):
        data[name] = None if data[name] is None else data[name] * scale
    data["set_points"] = [
        {**point, "force": float(f"{point['force'] * of_force:.12g}")} for point in data["set_points"]
    ]
    if (ranges := section.tested) is not None:
        (a, b), (c, d) = ranges
        scaled = RecordRanges((a * of_command, b * of_command), (c * of_force, d * of_force))
        data["sources"][TESTED] = scaled.words(unit_u, unit_force, section.sources[TESTED].rpartition(" of ")[2])
    return type(section).model_validate(data)
