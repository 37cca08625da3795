"""ForceSettings of the adaptive force controller from a parameter file, validated on entry."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from ...core.display import Displayable
from ...core.errors import GateError
from ...datasets.units import convert, is_unit, same_dimension
from ...parameters.exports.loop import BACK_OFF, OVERLOAD_SHARE, RECOVER, STUCK_AFTER, LoadLoop, monitoring
from ...parameters.messages import in_unit
from ...parameters.sections.load_line import not_applied_words
from .signals import ReferenceModel

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.sections.force_control import AdaptiveForceSection

TEETH = 2  # assumed of the simulated force, where the file has no number
NEEDED = (
    "g1", "g2", "g3", "Kd", "lam", "unit_u", "reference_time", "reference_damping", "sample_time", "average_time",
    "low", "high",
)  # fmt: skip
ENGAGE: Final = 0.125  # of the force at the lower feed limit by the estimates, and at most of the set point: a cut
HYSTERESIS: Final = 0.2  # of the threshold, whole width
OVERLOAD: Final = 2.0  # times the set point that a tool withstands, where nothing is known of it
DAMPING: Final = (0.1, 10.0)  # of the reference model
LONGEST_REFERENCE: Final = 1e4  # s
NEAR: Final = 1e-9  # of a limit: rounding
LONGEST_AVERAGE: Final = 100_000  # steps of a revolution
DRIFT, HIGHEST = 0.1, 10.0  # of the smallest and times the largest set point: forces beyond are no readings


@dataclass(frozen=True, slots=True, repr=False)
class ForceSettings(Displayable):
    """Settings of the adaptive_force section, complete and in its units.

    Attributes
    ----------
    samples : int
        Steps of the law in ``average_time``.
    set_point : float
        Set point of the force at ``depth``.
    force_most : float
        Limit of force of the file: a larger mean force is an overload, at most 2.1 times the set point.
    """

    m: float
    alpha: float
    beta: float
    g1: float
    g2: float
    g3: float
    Kd: float
    lam: float
    reference_time: float
    reference_damping: float
    sample_time: float
    samples: int
    low: float
    high: float
    force_low: float
    force_high: float
    set_point: float
    depth: float
    labels: tuple[str, str]
    force_most: float = math.inf


def settings_for(pf: "ParameterFile", depth: float) -> ForceSettings:
    """Settings for a depth of cut, one of the file's set points.

    Raises
    ------
    GateError
        The file fails the check, verdicts apart, lacks a setting, or has no set point for this depth.
    """
    from ...parameters.checks import check

    if why := lacking(pf):
        raise GateError(why)
    failed = check(pf).inconsistent
    if failed:
        raise GateError(f"the file fails the check: {failed[0].words}")
    section = _section(pf)
    held = {name: getattr(section, name) for name in ForceSettings.__dataclass_fields__ if hasattr(section, name)}
    held["force_most"] = _force_limit(pf)
    held["low"], held["high"] = command_limits(pf)
    samples = round((section.average_time or 0.0) / held["sample_time"])
    return ForceSettings(
        **{**held, **_force_range(section), "depth": depth}, samples=samples, set_point=_set_point(section, depth),
        labels=(f"feed command, {section.unit_u}", f"force, {section.unit_force}"),
    )  # fmt: skip


def lacking(pf: "ParameterFile") -> str:
    """Reason why a file cannot drive the adaptive controller, with the remedy; empty where it can."""
    section = pf.adaptive_force
    if section is None:
        return "the file has no adaptive_force section: give collect(adaptive_force=...) its estimates and settings."
    if missing := _missing(section):
        return f"adaptive_force: {', '.join(missing)} not stated; derive them: fitmodels adaptive-force."
    low, high, step, average = (getattr(section, n) for n in ("low", "high", "sample_time", "average_time"))
    damping, time = section.reference_damping or 0.0, section.reference_time or 0.0
    if not DAMPING[0] <= damping <= DAMPING[1]:
        return f"adaptive_force: reference_damping {damping:g}: give {DAMPING[0]:g} to {DAMPING[1]:g}, usually 1."
    if not step <= time <= LONGEST_REFERENCE:
        return (
            f"adaptive_force: reference_time {time:g} s: give at least the step of {step:g} s and at most "
            f"{LONGEST_REFERENCE:g} s."
        )
    if not 0 < low < high:
        return f"adaptive_force: the command's limits are {low:g} to {high:g} {section.unit_u}; 0 < low < high."
    if abs(average / step - round(average / step)) > 1e-6 or average < step:
        return f"adaptive_force: average_time {average:g} s is not a multiple of the step of {step:g} s."
    if average > LONGEST_AVERAGE * step:
        return (
            f"adaptive_force: average_time {average:g} s is {average / step:.3g} steps of {step:g} s; at most "
            f"{LONGEST_AVERAGE} are kept. It is the time of one revolution."
        )
    if section.force_low is not None and not section.force_low < min(p.force for p in section.set_points):
        return "adaptive_force: force_low does not lie below every set point; no reading would be valid."
    if section.force_high is not None and not section.force_high > max(p.force for p in section.set_points):
        return "adaptive_force: force_high does not lie above every set point; no reading would be valid."
    return beyond_limit(pf)


def _missing(section: "AdaptiveForceSection") -> list[str]:
    missing = [name for name in NEEDED if getattr(section, name) in (None, "")]
    return missing if section.set_points else [*missing, "set_points"]


def incomplete(pf: "ParameterFile") -> bool:
    """Whether the section lacks a setting of the controller, its estimates, or the depth that they come from."""
    section = pf.adaptive_force
    return section is None or section.depth is None or bool(_missing(section))


def beyond_limit(pf: "ParameterFile") -> str:
    """Reason why the section contradicts the limits of the file, with the remedy; empty where it does not."""
    return "" if pf.limits is None else _force_beyond(pf) or _spindle_beyond(pf) or _feed_beyond(pf)


def not_applied(pf: "ParameterFile") -> tuple[str, ...]:
    """A sentence on the limits of the file that adaptive force control does not apply; none where it applies all."""
    used = ["force", "spindle_speed"]
    if pf.limits is not None and pf.limits.feed_range(_section(pf).unit_u, turning(pf)) is not None:
        used += ["feed", "feed_rate"]
    return not_applied_words(pf.limits, "Adaptive force control", *used)


def command_limits(pf: "ParameterFile") -> tuple[float, float]:
    """Limits of the command: those of the section and the feeds that the limits of the file allow, whichever is less.

    A command in another unit than that of a feed is limited by the section alone; `not_applied` names that.
    """
    section = _section(pf)
    of_file = None if pf.limits is None else pf.limits.feed_range(section.unit_u, turning(pf))
    low, high = of_file or (0.0, math.inf)
    return max(section.low or 0.0, low), min(section.high or math.inf, high)


def limit_words(pf: "ParameterFile") -> tuple[str, ...]:
    """Sentences on the limits of the file: that they narrow the command, and those that are not applied."""
    section, (low, high), unused = _section(pf), command_limits(pf), not_applied(pf)
    words = f"The control commands {low:.4g} to {high:.4g} {section.unit_u}, all limits of feed together."
    narrowed = (low, high) != (section.low, section.high)
    return (*([words] if narrowed else []), *unused, *falling_force(section))


def falling_force(section: "AdaptiveForceSection") -> tuple[str, ...]:
    """A sentence on a set point of more force than one of a larger depth; none where the force rises with the depth."""
    return tuple(
        f"The set point at {a.depth:g} {section.unit_depth} asks for more force than that at {b.depth:g} "
        f"{section.unit_depth}, {a.force:g} and {b.force:g} {section.unit_force}: check that they are not exchanged."
        for a, b in pairwise(section.set_points)
        if a.force > b.force
    )


def turning(pf: "ParameterFile") -> float | None:
    """Spindle speed of the section, 1/min: as stated, or that of the revolution that is averaged over."""
    section = _section(pf)
    return section.spindle_speed or (60 / section.average_time if section.average_time else None)


def _spindle_beyond(pf: "ParameterFile") -> str:
    """Reason why the spindle speed lies outside the limits of the file; empty where it does not."""
    n, limit = turning(pf), None if pf.limits is None else pf.limits.spindle_speed
    if n is None or limit is None:
        return ""
    ends = [in_unit(end, limit.unit, "1/min") for end in (limit.low, limit.high)]
    if ends[0] is None or ends[1] is None or ends[0] * (1 - NEAR) <= n <= ends[1] * (1 + NEAR):
        return ""
    return (
        f"limits.spindle_speed: {ends[0]:g} to {ends[1]:g} 1/min, but adaptive_force is of a cut at {n:g} 1/min; "
        "record a cut within the limit, or change the limit."
    )


def needed_feeds(section: "AdaptiveForceSection") -> list[float]:
    """Feeds that the set points need by the estimates, unit_u."""
    scale = section.beta * (section.depth or math.nan)
    return [point.force * scale / point.depth for point in section.set_points]


def _feed_beyond(pf: "ParameterFile") -> str:
    """Reason why the limits of feed of the file leave no range, or not the feeds that the set points need."""
    section, unit = _section(pf), _section(pf).unit_u
    (low, high), own = command_limits(pf), (section.low, section.high)
    if None in own or (low, high) == own:
        return ""
    words = f"the limits of feed of the file leave {low:.4g} to {high:.4g} {unit} of the command"
    if not low < high:
        return (
            f"{words}, an empty range; change limits.feed or limits.feed_rate, or the limits of the command (--feed)."
        )
    if not section.beta > 0 or section.depth is None:
        return ""
    feeds = needed_feeds(section)
    if low < min(feeds, default=high) and max(feeds, default=low) < high:
        return ""
    return (
        f"{words}, and by the estimates the set points need {min(feeds):.4g} to {max(feeds):.4g} {unit}; change the "
        "set points, or limits.feed and limits.feed_rate."
    )


def _force_beyond(pf: "ParameterFile") -> str:
    """Reason why a set point is not below the limit of force of the file, with the remedy; empty where all are."""
    section, bound = _section(pf), None if pf.limits is None else pf.limits.force
    unit = section.unit_force
    if bound is None:
        return ""
    if not (is_unit(bound.unit) and is_unit(unit) and same_dimension(bound.unit, unit)):
        return f"limits.force is in {bound.unit[:20]} and adaptive_force in {unit[:20]}; write both in N."
    most, largest = _force_limit(pf), max((point.force for point in section.set_points), default=0.0)
    if largest < most:
        return ""
    return (
        f"limits.force: at most {most:.4g} {unit}, but adaptive_force has a set point of {largest:.4g} {unit}; lower "
        "the set point, or raise the limit."
    )


def _force_limit(pf: "ParameterFile") -> float:
    """The limit of force of the file, of whichever force, in the unit of the section; infinite without one."""
    bound = None if pf.limits is None else pf.limits.force
    if bound is None:
        return math.inf
    return float(convert(np.array([bound.value]), bound.unit, _section(pf).unit_force)[0])


def _force_range(section: "AdaptiveForceSection") -> dict[str, float]:
    """Limits of a valid reading: those of the file, or assumed from the set points."""
    forces = [point.force for point in section.set_points]
    return {
        "force_low": -DRIFT * min(forces) if section.force_low is None else section.force_low,
        "force_high": HIGHEST * max(forces) if section.force_high is None else section.force_high,
    }


def force_loop(settings: ForceSettings, *, stuck_after: float = STUCK_AFTER) -> LoadLoop:
    """The settings as the supervision and the exports take them; the program commands the upper limit."""
    s, span = settings, (settings.high - settings.low) / settings.high
    at_low = s.low / s.beta if s.beta > 0 else s.set_point
    model = ReferenceModel(s.reference_time, s.reference_damping, s.sample_time).transition
    threshold = ENGAGE * min(at_low, s.set_point)
    unit_feed, unit_load = (label.rpartition(", ")[2] for label in s.labels)
    return LoadLoop(
        kp=0.0, ki=0.0, sample_time=s.sample_time, reference=s.set_point,
        feed_low=s.low, feed_high=s.high, feed_programmed=s.high, unit_load=unit_load, unit_feed=unit_feed,
        filter_time=0.0, average=s.samples, engage_at=threshold, hysteresis=HYSTERESIS * threshold,
        engage_after=(s.samples + 1) * s.sample_time, back_off=span / BACK_OFF, recover=span / RECOVER,
        load_low=s.force_low, load_high=s.force_high, stuck_after=stuck_after,
        worn_load=min(OVERLOAD * s.set_point, s.force_most / OVERLOAD_SHARE),
        law="adaptive", approach=s.low / s.high, m=s.m, alpha=s.alpha, beta=s.beta, g1=s.g1, g2=s.g2, g3=s.g3,
        Kd=s.Kd, lam=s.lam, model_time=s.reference_time, model_damping=s.reference_damping,
        model_a=model[0], model_b=model[1], model_c=model[2], model_d=model[3],
    )  # fmt: skip


def assumed_settings(pf: "ParameterFile", settings: ForceSettings) -> tuple[str, ...]:
    """The settings of the supervision that the file does not hold, each with the value that is assumed."""
    section, loop, assumed = _section(pf), force_loop(settings), []
    if section.force_low is None:
        assumed.append(f"force_low {loop.load_low:.4g} {loop.unit_load}, minus a tenth of the smallest set point")
    if section.force_high is None:
        assumed.append(f"force_high {loop.load_high:.4g} {loop.unit_load}, {HIGHEST:g} times the largest set point")
    unknown = f"1.05 times {OVERLOAD:g} times the set point: the file holds no force that the tool withstands"
    limited = loop.worn_load < OVERLOAD * settings.set_point
    if (section.low, section.high) != (settings.low, settings.high):
        narrowed = f"feed {settings.low:.4g} to {settings.high:.4g} {loop.unit_feed}"
        own = f"{section.low or 0.0:.4g} to {section.high or 0.0:.4g}"
        assumed.append(f"{narrowed}, within the limits of feed of the file; adaptive_force has {own}")
    why = "the limit of force in the file" if limited else unknown
    return (
        *assumed,
        f"threshold of a cut {loop.engage_at:.4g} {loop.unit_load}, an eighth of the force at the lower feed limit by "
        f"the estimates, with a hysteresis of {loop.hysteresis:.3g} {loop.unit_load}",
        f"overload above {loop.overload_at:.4g} {loop.unit_load}, {why}",
        f"feed out of the cut down by {loop.back_off:.4g} and up by {loop.recover:.4g} of the upper limit per s",
        *monitoring(loop),
    )


def machine(pf: "ParameterFile") -> tuple[float, float, float]:
    """Plant parameters m, c and k per unit of depth, for d = 1 and the drive as the slower pole.

    Raises
    ------
    GateError
        Missing estimates or their depth, or complex or unstable poles.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> [round(x, 1) for x in machine(published("LYAP"))]
    [0.1, 50.1, 20.0]
    """
    section = pf.adaptive_force
    if section is None or section.depth is None:
        raise GateError(
            "adaptive_force: no estimates with the depth they come from, so the plant is unknown; add them."
        )
    poles = np.roots([section.m, section.alpha, section.beta])
    if np.abs(poles.imag).max() > 0 or poles.max() >= 0:
        raise GateError("adaptive_force: m, alpha, beta give complex or unstable poles; identify them again.")
    slow, fast = sorted(-poles.real)
    m = 1 / slow  # of d = 1
    return float(m), float(fast), float(m / section.m / section.depth)


def teeth_of(pf: "ParameterFile") -> int | None:
    """Number of teeth of the tool by the file: ZEFP or NOF of ISO 13399; None where it holds none.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> teeth_of(published("CLM-2023")), teeth_of(published("LYAP"))
    (2, None)
    """
    held = (pf.identity.iso13399.get(symbol) for symbol in ("ZEFP", "NOF"))
    known = (int(value) for value in held if isinstance(value, int | float) and value >= 1 and value == int(value))
    return next(known, None)


def tooth_frequency(pf: "ParameterFile") -> float:
    """Tooth frequency, Hz, of the teeth of the file, otherwise of two."""
    average = _section(pf).average_time
    return (teeth_of(pf) or TEETH) / average if average else 100.0


def _section(pf: "ParameterFile") -> "AdaptiveForceSection":
    if pf.adaptive_force is None:
        raise GateError(lacking(pf))
    return pf.adaptive_force


def _set_point(section: "AdaptiveForceSection", depth: float) -> float:
    found = {point.depth: point.force for point in section.set_points}
    if depth not in found:
        there = ", ".join(f"{known:g}" for known in found)
        raise GateError(
            f"adaptive_force: no set point for a depth of {depth:g} {section.unit_depth}; there are {there}: add it."
        )
    return found[depth]
