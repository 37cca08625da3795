"""The PI loop on load in the units of the machine, built from the sections of a parameter file.

Position form, its sum by the rectangle that ends now, e = reference - filtered load, from the feed at entry:

    feed = feed at entry + kp e + ki * sum(e) * sample_time,    clipped to feed_low ... feed_high

The other form, ``incremental_sum``, goes on from the last feed; HAL has no component for it:

    feed = last feed + kp e + ki * sum(e) * sample_time
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ...datasets.units import convert, is_unit, same_dimension
from ..file import ParameterFile
from ..sections.dynamics import PiSection
from ..sections.load_line import Engagement, LoadLineSection
from ..setting_words import NARROWED, window_assumed
from .names import plain, plain_unit

ARM_AFTER, LOST_AFTER, STUCK_AFTER, HEARTBEAT, OVERLOAD_AFTER = 0.5, 0.05, 1.0, 0.2, 0.5  # s
DWELL = 4.0  # s: the settling time allowed for the published loop, so that a transient does not count as a worn tool
OVERLOAD_SHARE: Final = 1.05  # of the load that a worn tool withstands


@dataclass(frozen=True, slots=True)
class LoadLoop:
    """The PI loop on load: gains, limits and settings, each in the unit of its comment.

    A command of a controller is ``feed / feed_programmed``, the feed override: ``low`` and ``high`` are its limits.
    """

    kp: float  # unit_feed per unit_load
    ki: float  # unit_feed per unit_load and second
    sample_time: float  # s, period of the thread
    reference: float  # unit_load
    feed_low: float  # unit_feed, above zero
    feed_high: float  # unit_feed
    feed_programmed: float  # unit_feed: programmed F, at which the override is 1
    unit_load: str
    unit_feed: str
    filter_time: float  # s, time constant of the one-pole low-pass on the load; 0: none
    engage_at: float  # unit_load of the filtered load: the middle of the hysteresis
    hysteresis: float  # unit_load, the whole width
    engage_after: float  # s above the threshold until the loop takes over
    back_off: float  # override per second, downwards
    recover: float  # override per second, upwards
    load_low: float  # unit_load, above zero: a reading at or outside these two is invalid
    load_high: float  # unit_load
    worn_load: float  # unit_load that a worn tool withstands
    arm_after: float = ARM_AFTER  # s that the spindle runs before the load is monitored
    lost_after: float = LOST_AFTER  # s with invalid readings before a fault
    stuck_after: float = STUCK_AFTER  # s of equal readings in the cut before a fault; 0: not monitored
    heartbeat: float = HEARTBEAT  # s without a change of the heartbeat before a fault; 0: not monitored
    overload_after: float = OVERLOAD_AFTER  # s of an overload before the feed is inhibited
    dwell: float = DWELL  # s on the lower limit that mean a worn tool
    stop_on_fault: bool = False  # inhibit the feed on a fault, instead of the lower limit
    entry_gain: float = 0.0  # override per unit_load below the reference at entry, added to the feed
    average: int = 1  # samples of a moving average; 1: none
    average_of: str = "measurement"  # or "command"
    form: str = "position"  # or "incremental_sum", its kp per sample
    law: str = "pi"  # or "ratio" (constant roughness), "adaptive" (adaptive force); what follows belongs to these two
    approach: float = 0.0  # override in air
    servo_time: float = 0.0  # s, time constant of the feed drive, of "ratio"
    m: float = 0.0  # unit_feed s^2 per unit_load; alpha unit_feed s, beta unit_feed per unit_load: first estimates
    alpha: float = 0.0
    beta: float = 0.0
    g1: float = 0.0  # rates of adaptation of m, alpha and beta
    g2: float = 0.0
    g3: float = 0.0
    Kd: float = 0.0  # unit_feed s per unit_load
    lam: float = 0.0  # 1/s
    model_time: float = 0.0  # s, reference model of second order, and its damping
    model_damping: float = 0.0
    model_a: float = 0.0  # transition of the reference model over sample_time
    model_b: float = 0.0
    model_c: float = 0.0
    model_d: float = 0.0

    @property
    def low(self) -> float:
        """Smallest override, above zero."""
        return self.feed_low / self.feed_programmed

    @property
    def high(self) -> float:
        """Largest override of the loop."""
        return self.feed_high / self.feed_programmed

    @property
    def p(self) -> float:
        """Kp in override per unit of load."""
        return self.kp / self.feed_programmed

    @property
    def i(self) -> float:
        """Ki in override per unit of load and second."""
        return self.ki / self.feed_programmed

    @property
    def overload_at(self) -> float:
        """Mean load above which the feed is inhibited, unit_load."""
        return OVERLOAD_SHARE * self.worn_load

    def samples(self, time: float) -> int:
        """A time in whole samples, at least one."""
        return max(round(time / self.sample_time), 1)


def monitoring(loop: LoadLoop) -> tuple[str, ...]:
    """Times of the supervision that no force section holds, in the words of an assumption."""
    return (
        f"arm_after {loop.arm_after:g} s, lost_after {loop.lost_after:g} s, stuck_after {loop.stuck_after:g} s",
        f"heartbeat {loop.heartbeat:g} s, overload_after {loop.overload_after:g} s",
        f"dwell {loop.dwell:g} s on the lower limit",
        "on_fault lower limit, not stop",
    )


LEAST_FEED: Final = 0.05  # of the programmed feed: at zero a tool rubs in its cut for ever, below it runs back
BACK_OFF, RECOVER = 0.5, 2.0  # s for the whole range of the feed, downwards and upwards: back off faster than recover
ENGAGE = 0.1  # s
HYSTERESIS = 0.1  # of the reference
HIGHEST = 10.0  # of the reference: loads beyond are those of a broken sensor
IDLE = 0.5  # of the load of the running spindle in air: readings below are those of a lost sensor
LEAST_LOAD = 0.1  # of the reference, where the load in air is not known
_EARLY = {"backward": 0.0, "trapezoidal": 0.5, "forward": 1.0}


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """The loop, or the reason why there is none; and the assumptions for settings missing from the file."""

    loop: LoadLoop | None
    lacking: str = ""
    assumed: tuple[str, ...] = ()


class _Lacking(Exception):  # noqa: N818  it ends in a sentence of the view, not in an error
    """Reason why there is no loop."""


def loop_settings(pf: ParameterFile, *, own_form: bool = False) -> LoopSettings:
    """The loop of a parameter file, in the units of its feed limits and reference load.

    ``own_form`` keeps the form ``incremental_sum``; otherwise it becomes the position form where that is the same.
    """
    if pf.pi is None:
        return LoopSettings(None, "has no PI gains; find them with `fitmodels tune params.json`.")
    if pf.load_line is None:
        return LoopSettings(None, "has gains but no reference load; set it with `fitmodels settings params.json`.")
    assumed: list[str] = []
    try:
        return LoopSettings(_loop(pf, pf.pi, pf.load_line, assumed, own_form), assumed=tuple(assumed))
    except _Lacking as reason:
        return LoopSettings(None, str(reason))


def _loop(pf: ParameterFile, pi: PiSection, line: LoadLineSection, assumed: list[str], own_form: bool) -> LoadLoop:
    form = "incremental_sum" if own_form and pi.form == "incremental_sum" and pi.ki else "position"
    assumed += _assumed_window(line)
    given = line.engagement or Engagement()
    programmed = given.feed_programmed or line.upper.value
    per_u = _feed_per_unit(pi, line, programmed)
    per_y = _factor(pi.unit_y, line.unit_load, "a PI that measures", "a reference load", "give both in one unit")
    kp, ki = (gain * per_u / per_y for gain in _gains(pi, form))
    low, high = _feeds(pf, pi, line, programmed, per_u, assumed)
    rate = None if pi.rate is None else pi.rate * per_u / programmed
    span = (high - low) / programmed
    reference, load = line.reference, plain_unit(line.unit_load)

    def own(name: str, instead: float, unit: str, words: str = "") -> float:
        value = getattr(given, name)
        if value is None:
            assumed.append(f"{name} {instead:.4g} {unit}".rstrip() + (f", {words}" if words else ""))
        return float(instead if value is None else value)

    half, why = _threshold(pf, line, low)
    loop = LoadLoop(
        kp=kp, ki=ki, sample_time=_period(pi, given), reference=reference,
        feed_low=low, feed_high=high, feed_programmed=programmed,
        unit_load=load, unit_feed=plain_unit(line.unit_feed),
        filter_time=_filter_time(pi, given), average=pi.average, average_of=pi.average_of,
        engage_at=own("engage_at", half, load, why),
        hysteresis=own("hysteresis", HYSTERESIS * reference, load),
        engage_after=own("engage_after", ENGAGE, "s"),
        back_off=own("back_off", rate or span / BACK_OFF, "per s"),
        recover=own("recover", rate or span / RECOVER, "per s"),
        load_low=own("load_low", *_least_load(pf, line, given)),
        load_high=own("load_high", HIGHEST * reference, load),
        worn_load=_withstood(pf, line, assumed),
        arm_after=own("arm_after", ARM_AFTER, "s"),
        lost_after=own("lost_after", LOST_AFTER, "s"),
        stuck_after=own("stuck_after", STUCK_AFTER, "s"),
        heartbeat=own("heartbeat", HEARTBEAT, "s"),
        overload_after=own("overload_after", OVERLOAD_AFTER, "s"),
        dwell=DWELL if line.dwell is None else line.dwell,
        stop_on_fault=given.on_fault == "stop",
        entry_gain=_entry_gain(pf, pi, line, kp, programmed, given),
        form=form,
    )  # fmt: skip
    if pi.anti_windup != "clamping" or pi.form != form:
        assumed.append(f"{form} form with clamping at the limits; the file has {pi.form} with {pi.anti_windup}")
    assumed += _assumed_choices(line, given, loop)
    _check_order(loop)
    _check_idle(loop, given.idle)
    return loop


def _assumed_window(line: LoadLineSection) -> list[str]:
    low, high = line.window
    words = f"window {low:g} to {high:g} {plain_unit(line.unit_wear)}, the wear at tool change"
    return [words] if window_assumed(line) else []


def _assumed_choices(line: LoadLineSection, given: Engagement, loop: LoadLoop) -> list[str]:
    """Choices that the file leaves open besides the numbers of the engagement."""
    programmed = f"feed_programmed {loop.feed_programmed:.6g} {loop.unit_feed}, the upper feed limit"
    return [
        *([programmed] if given.feed_programmed is None else []),
        *([f"dwell {DWELL:g} s on the lower limit"] if line.dwell is None else []),
        *(["on_fault lower limit, not stop"] if given.on_fault is None else []),
    ]


def _gains(pi: PiSection, form: str) -> tuple[float, float]:
    """Gains of the same controller in a form, its sum ending now, ki per second."""
    if pi.form == "incremental_sum" and form == "position":
        if pi.ki:
            raise _Lacking(
                f"has gains in the form incremental_sum with ki {pi.ki:g}, an integrator of an integrator, which no "
                "controller's PI is; tune in the form position, or set ki to 0."
            )
        return 0.0, pi.kp / pi.sample_time
    return pi.kp - _EARLY[pi.integration] * pi.ki * pi.sample_time, pi.ki


def _feed_per_unit(pi: PiSection, line: LoadLineSection, programmed: float) -> float:
    """Unit of the feed limits in one unit of the command."""
    if pi.unit_u in ("%", "1", "override"):
        return programmed / 100 if pi.unit_u == "%" else programmed
    remedy = (
        "tune again with the scaling of the feed drive: `fitmodels tune params.json ... --scaling S --unit "
        f"{plain_unit(line.unit_feed)} --force`, S in {plain_unit(line.unit_feed)} per {plain_unit(pi.unit_u)}"
    )
    return _factor(pi.unit_u, line.unit_feed, "a PI that commands", "feed limits", remedy)


def _factor(unit: str, to: str, does: str, what: str, remedy: str) -> float:
    if unit == to:
        return 1.0
    if not (is_unit(unit) and is_unit(to) and same_dimension(unit, to)):
        raise _Lacking(f"has {does} {plain_unit(unit)!r} but {what} in {plain_unit(to)!r}; {remedy}.")
    return float(convert(np.array(1.0), unit, to))


def _feeds(
    pf: ParameterFile, pi: PiSection, line: LoadLineSection, programmed: float, per_u: float, assumed: list[str]
) -> tuple[float, float]:
    """The narrowest of the settings, the gains' own limits and the machine's; above zero, no more than programmed."""
    machine = pf.limits.feed_rate if pf.limits else None
    lows, highs = [line.lower.value], [line.upper.value]
    lows += [] if pi.low is None else [pi.low * per_u]
    highs += [] if pi.high is None else [pi.high * per_u]
    if machine is not None:
        per = _factor(machine.unit, line.unit_feed, "a limit of the feed rate in", "feed limits", "limit fm")
        lows, highs = [*lows, machine.low * per], [*highs, machine.high * per]
    low, high = max(lows), min(highs)
    if low > NARROWED * line.lower.value:
        assumed.append(
            f"feed_low {low:.6g}, of gains or machine; the settings have {line.lower.value:.6g}: worn earlier"
        )
    if high > programmed:
        assumed.append(f"feed_high {programmed:.6g}, the programmed feed; the file has {high:.6g}")
        high = programmed
    if low < LEAST_FEED * programmed:
        assumed.append(f"feed_low {LEAST_FEED * programmed:.6g}, above zero; the file has {low:.6g}")
        low = LEAST_FEED * programmed
    return low, high


def _withstood(pf: ParameterFile, line: LoadLineSection, assumed: list[str]) -> float:
    """Load that a worn tool withstands; less where the file limits the load: an overload is 1.05 times it."""
    most = math.inf if pf.limits is None else pf.limits.response_range(line.load, line.unit_load)[1]
    within, unit = most / OVERLOAD_SHARE, plain_unit(line.unit_load)
    if not within < line.worn:
        return line.worn
    if not line.reference < within:
        raise _Lacking(
            f"limits {plain(line.load)} to {most:g} {unit}, not above {OVERLOAD_SHARE:g} times the reference of "
            f"{line.reference:g} {unit}, where an overload lies; lower the reference (--worn), or change the limit."
        )
    assumed.append(f"overload above {most:.6g} {unit}, the limit of {plain(line.load)} in the file")
    return within


def _threshold(pf: ParameterFile, line: LoadLineSection, low: float) -> tuple[float, str]:
    """Load that identifies a cut: halfway up a sharp tool's at the lowest feed, or half of the reference."""
    law = _load_law(pf, line)
    if law is not None:
        A, B = law
        if 0 < A + B * low / 2 < line.reference and B > 0:
            return A + B * low / 2, "halfway up the sharp tool at the lowest feed"
    return line.reference / 2, "half of the reference"


def _load_law(pf: ParameterFile, line: LoadLineSection) -> tuple[float, float] | None:
    """Load at rest and load per unit of feed of a sharp tool, where the load law of the file has the loop's units."""
    law = pf.laws.get(line.law)
    if law is None or (law.form, law.unit, law.factors[0].unit) != ("load_line", line.unit_load, line.unit_feed):
        return None
    shift = law.by.shifts.get(line.by or "", 0.0) if law.by else 0.0
    return law.coefficients["A"] + shift, law.coefficients["B"]


def _least_load(pf: ParameterFile, line: LoadLineSection, given: Engagement) -> tuple[float, str, str]:
    """Load at or below which a reading is that of a lost sensor, its unit, and where it comes from."""
    load, law = plain_unit(line.unit_load), _load_law(pf, line)
    if given.idle is not None:
        return IDLE * given.idle, load, "half of the load in air"
    if law is not None and law[0] > 0:
        return IDLE * law[0], load, "half of the load law at a feed of zero"
    return LEAST_LOAD * line.reference, load, "a tenth of the reference, as the load in air is not known"


def _entry_gain(
    pf: ParameterFile, pi: PiSection, line: LoadLineSection, kp: float, programmed: float, given: Engagement
) -> float:
    """Change of the first override per unit of load below the reference: feed-forward and setpoint weight."""
    gain = -(1 - pi.setpoint_weight) * kp / programmed
    if not given.feed_forward:
        return gain
    law = _load_law(pf, line)
    if law is None or not law[1] > 0:
        raise _Lacking("has a feed_forward but no load law in its units whose load rises with feed; set it to 0.")
    return gain + given.feed_forward / (law[1] * programmed)


def _filter_time(pi: PiSection, given: Engagement) -> float:
    if pi.filter_time or given.filter_corner is None:
        return pi.filter_time
    return 1 / (2 * math.pi * given.filter_corner)


def _period(pi: PiSection, given: Engagement) -> float:
    """Period of the thread: that of the gains, or a shorter one."""
    thread = given.sample_time or pi.sample_time
    if thread > pi.sample_time * (1 + 1e-9):
        raise _Lacking(
            f"has a thread of {thread:g} s but gains for {pi.sample_time:g} s: a slower thread lags more than they "
            f"allow for; tune at {thread:g} s."
        )
    if pi.form == "incremental_sum" and pi.ki and thread < pi.sample_time * (1 - 1e-9):
        raise _Lacking(
            f"has gains in the form incremental_sum for {pi.sample_time:g} s and a thread of {thread:g} s: per sample, "
            "they are another controller there; give both one period."
        )
    if pi.average > 1 and thread < pi.sample_time * (1 - 1e-9):
        raise _Lacking(
            f"averages {pi.average} samples of {pi.sample_time:g} s but has a thread of {thread:g} s; give both one "
            "period."
        )
    return thread


def _check_order(loop: LoadLoop) -> None:
    if not loop.feed_low < loop.feed_high:
        raise _Lacking(
            f"has feed limits {loop.feed_low:g} to {loop.feed_high:g} {loop.unit_feed}, which leave the loop no range; "
            "settings, gains and machine limits must overlap."
        )
    if not loop.load_low > 0:
        raise _Lacking(
            f"takes loads from {loop.load_low:g} {loop.unit_load} for readings, so that a lost sensor, which reads "
            "zero, would be taken for air; give load_low above zero and below the load of the running spindle in air."
        )
    if not loop.reference < loop.load_high:
        raise _Lacking(
            f"has a reference of {loop.reference:g} {loop.unit_load} and readings up to {loop.load_high:g}; the "
            "reference lies inside the range of valid readings."
        )
    low = loop.engage_at - loop.hysteresis / 2
    if not loop.load_low < low or not loop.engage_at + loop.hysteresis / 2 < loop.reference:
        raise _Lacking(
            f"engages at {loop.engage_at:g} +- {loop.hysteresis / 2:g} {loop.unit_load}: both ends lie between the "
            f"smallest valid reading, {loop.load_low:g}, and the reference, {loop.reference:g}."
        )


def _check_idle(loop: LoadLoop, idle: float | None) -> None:
    engages = loop.engage_at - loop.hysteresis / 2
    if idle is not None and not loop.load_low < idle < engages:
        raise _Lacking(
            f"has a load in air of {idle:g} {loop.unit_load}, which must lie above the smallest valid reading, "
            f"{loop.load_low:g}, and below the threshold of a cut, {engages:g}; otherwise air is a fault or a cut."
        )
