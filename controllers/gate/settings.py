"""Findings across the sections of a file, from its numbers alone: units, signs, sizes, order and times.

The load of a cut is I = A + B f + k1 VB (eq. 14 of Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587). The dynamics
of the drive and the scaling of the gains state B a second time, the feed limits state the line a second time: a sign,
a unit or a factor that is wrong in one place contradicts the other.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from ...core.errors import ParameterError
from ...datasets.units import is_unit, same_dimension
from ...parameters.checks.report import VERDICT, FileFinding
from ...parameters.exports.names import plain, plain_unit
from ...parameters.sections.load_line import is_feed
from ...parameters.setting_words import above_upper_limit, narrowed_words
from ..constant_load_milling.cut_model import unit_factor

if TYPE_CHECKING:
    from ...parameters import LawSection, ParameterFile
    from ...parameters.exports.loop import LoadLoop
    from ...parameters.sections.dynamics import DynamicsSection, PiSection
    from ...parameters.sections.load_line import FeedLimit, LoadLineSection

SLOPES: Final = (0.5, 2.0)  # slope of the dynamics over that of the load law
APART: Final = 0.25  # of the range of the feed limits: deviation of a limit from its law; `settings` writes them equal
WIDEST: Final = 20.0  # times the lower feed limit
ABOVE: Final = 1.01  # times the upper feed limit: a programmed feed that a person has rounded
LEAST_SHARE: Final = 0.2  # of the load in air: a lost sensor reads zero with noise, not zero
HIGHEST: Final = 40.0  # times the load of a worn tool: beyond, no reading is out of range
# s, smallest and largest; 0 switches stuck_after and heartbeat off
TIMES: Final = {
    "sample_time": (1e-5, 0.5),
    "arm_after": (0.0, 10.0),  # until then the feed is the programmed one, without monitoring
    "engage_after": (0.0, 2.0),
    "lost_after": (0.0, 0.5),
    "stuck_after": (0.0, 10.0),
    "heartbeat": (0.0, 2.0),
    "overload_after": (0.0, 2.0),
    "dwell": (0.5, 60.0),
}
BACK_OFF_WITHIN, RECOVER_WITHIN = 2.0, 30.0  # s for the whole range of the feed


@dataclass(frozen=True, slots=True)
class Line:
    """Load in air and in the cut, unit_load: ``A + B feed + k1 wear``, its end of life, and its sensor noise.

    ``law`` is False where the file holds no load law and the line is that of dynamics and feed limits.
    """

    A: float
    B: float
    k1: float
    idle: float
    wear: float  # at the lower feed limit
    noise: float  # standard deviation of a reading: of the sensor, or the residual of the identification
    law: bool = True

    def load(self, feed: float, wear: float) -> float:
        """Load in the cut at rest."""
        return self.A + self.B * feed + self.k1 * wear


def check_line(pf: "ParameterFile", loop: "LoadLoop") -> Iterator[FileFinding]:
    """Findings on load law, dynamics, scaling and feed limits against each other."""
    pi, model, line = pf.pi, pf.dynamics, pf.load_line
    if pi is None or line is None:
        return
    if model is None:
        yield _failed(
            "dynamics",
            "The file holds no dynamics, so the control cannot be simulated; identify them with "
            "`fitmodels ident record.csv --params params.json`.",
        )
        return
    law = pf.laws.get(line.law)
    if law is None or law.form not in ("load_line", "feed_line"):
        yield FileFinding(
            VERDICT,
            False,
            f"load law: the file holds no law {plain(line.law)} of the load, so that sign "
            "and size of gains and feed limits cannot be compared with a measured cut; fit runs with the "
            "columns fm, VB and the load.",
        )
    else:
        yield from _units(law, line)
        yield from _slopes(law, dynamics_slope(pi, model, line, loop), line, loop)
        yield from _limits(law, line)


def check_order(pf: "ParameterFile", loop: "LoadLoop", cut: Line, settling: float) -> Iterator[FileFinding]:
    """Findings on limits, thresholds and times of a control; ``settling`` of its loop in s."""
    if pf.load_line is not None:
        yield from _feeds(loop, pf.load_line, pf.laws.get(pf.load_line.law))
        if words := narrowed_words(pf.load_line, loop.feed_low, (cut.A, cut.B, cut.k1)):
            yield FileFinding("feed limits", None, words)
        yield from _machine(pf, loop, pf.load_line)
    yield from _loads(loop, cut)
    yield from _times(loop, settling)


def dynamics_slope(pi: "PiSection", model: "DynamicsSection", line: "LoadLineSection", loop: "LoadLoop") -> float:
    """Load per unit of feed at rest by dynamics and scaling, unit_load per unit_feed."""
    if pi.unit_u in ("%", "1", "override"):
        per_u = loop.feed_programmed / (100 if pi.unit_u == "%" else 1)
    else:
        per_u = unit_factor(pi.unit_u, line.unit_feed)
    return model.dc_gain * pi.scaling_y * unit_factor(pi.unit_y, line.unit_load) / (pi.scaling_u * per_u)


def in_units_of_the_loop(pi: "PiSection", line: "LoadLineSection") -> bool:
    """Whether gains can be converted to the units of the settings; others run in a controller of their own."""
    pairs = [(pi.unit_y, line.unit_load)]
    feeds = is_feed(pi.unit_u) and is_feed(line.unit_feed)  # per revolution and per minute: a contradiction
    pairs += [] if feeds or pi.unit_u in ("%", "1", "override") else [(pi.unit_u, line.unit_feed)]
    return all(is_unit(one) and is_unit(other) and same_dimension(one, other) for one, other in pairs)


def line_of_file(pf: "ParameterFile", loop: "LoadLoop") -> Line:
    """Load of a cut by the load law, or by dynamics and feed limits where the file holds none.

    Raises
    ------
    ParameterError
        The file has no settings, no dynamics or no gains.
    """
    pi, model, line = pf.pi, pf.dynamics, pf.load_line
    if pi is None or model is None or line is None:
        raise ParameterError("a cut to simulate needs gains, dynamics and settings; the file lacks one of them.")
    law = pf.laws.get(line.law)
    if law is not None and law.form == "load_line":
        A, B, k1 = (law.coefficients[name] for name in ("A", "B", "k1"))
        A += _shift(law, line)
    else:
        B = dynamics_slope(pi, model, line, loop)
        sharp, worn = line.upper, line.lower
        k1 = B * (sharp.value - worn.value) / (worn.wear - sharp.wear)
        A = line.reference - B * sharp.value - k1 * sharp.wear
    given = None if line.engagement is None else line.engagement.idle
    idle = given if given is not None else max(A, 1.2 * loop.load_low)
    sensors = [s.sd for s in pf.identity.sensors if (s.symbol, s.unit) == (line.load, line.unit_load)]
    known = next((sd for sd in sensors if sd is not None), None)
    if known is None and model.noise_variance:
        known = math.sqrt(model.noise_variance) * pi.scaling_y * unit_factor(pi.unit_y, line.unit_load)
    held = law is not None and law.form in ("load_line", "feed_line")
    return Line(A, B, k1, idle, line.lower.wear, known or 0.0, held)


def _shift(law: "LawSection", line: "LoadLineSection") -> float:
    return law.by.shifts.get(line.by or "", 0.0) if law.by else 0.0


def _units(law: "LawSection", line: "LoadLineSection") -> Iterator[FileFinding]:
    found = (law.unit, *(factor.unit for factor in law.factors))
    load = (line.unit_load,) if law.form == "load_line" else ()
    expected = (*load, line.unit_feed, line.unit_wear)
    if found != expected:
        given = ", ".join(map(plain_unit, found)), ", ".join(map(plain_unit, expected))
        yield _failed(
            "units", f"The load law is in {given[0]} and the settings are in {given[1]}; give both in the same units."
        )


def _slope_of_feed_line(law: "LawSection", slope: float, line: "LoadLineSection", unit: str) -> Iterator[FileFinding]:
    """A line of feed holds one load: with the load in air it gives a slope to compare."""
    words = f"By dynamics and scaling the load changes by {slope:.4g} {unit}"
    sharp = law.coefficients["fm0"] + _shift(law, line)
    idle = None if line.engagement is None else line.engagement.idle
    remedy = "Check sign and scale of the load's sensor and of the gains, identify and tune again."
    if not 0 < slope * sharp < line.reference:
        yield _failed(
            "slope",
            f"{words}, which leaves a load in air of {line.reference - slope * sharp:.4g} "
            f"{plain_unit(line.unit_load)}; it lies between zero and the reference. {remedy}",
        )
    elif idle is None:
        yield FileFinding(
            VERDICT,
            False,
            f"load law: it gives the feed at one load alone, so that the slope of the dynamics, {slope:.4g} {unit}, "
            "cannot be compared; state the load of the spindle in air with `fitmodels settings --idle`, or fit runs "
            "at several loads.",
        )
    elif not SLOPES[0] <= slope * sharp / (line.reference - idle) <= SLOPES[1]:
        yield _failed(
            "slope",
            f"{words}, and from air to the reference by {(line.reference - idle) / sharp:.4g}: "
            f"{slope * sharp / (line.reference - idle):.3g} times as much, outside {SLOPES[0]:g} to {SLOPES[1]:g}. "
            f"{remedy}",
        )
    else:
        yield FileFinding("slope", True, f"{words}, as from air to the reference, within a factor of two.")


def _slopes(law: "LawSection", slope: float, line: "LoadLineSection", loop: "LoadLoop") -> Iterator[FileFinding]:
    unit = f"{loop.unit_load} per {loop.unit_feed}"
    if law.form == "feed_line":
        yield from _slope_of_feed_line(law, slope, line, unit)
        return
    B = law.coefficients["B"]
    words = f"The load rises with feed by {B:.4g} {unit} by the load law and by {slope:.4g} by dynamics and scaling"
    if not (B > 0 and law.coefficients["k1"] > 0):
        yield _failed(
            "slope",
            f"The load law has B {B:.4g} {unit} and k1 {law.coefficients['k1']:.4g}; load rises with "
            "feed and with wear. Fit runs with more feeds and more wear.",
        )
    elif not slope > 0:
        yield _failed(
            "slope",
            f"{words}: the sign differs, so that the control would be positive feedback. Check the "
            "sign of the current sensor, identify and tune again.",
        )
    elif not SLOPES[0] <= slope / B <= SLOPES[1]:
        yield _failed(
            "slope",
            f"{words}: {slope / B:.3g} times as much, outside {SLOPES[0]:g} to {SLOPES[1]:g}. Check "
            "units and scaling of gains and dynamics, identify and tune again.",
        )
    else:
        yield FileFinding("slope", True, f"{words}: ratio {slope / B:.3g}, allowed {SLOPES[0]:g} to {SLOPES[1]:g}.")


def _limits(law: "LawSection", line: "LoadLineSection") -> Iterator[FileFinding]:
    """The limits are the feeds of the law at the reference; the upper one may give up to the load of a worn tool."""
    unit, agree = plain_unit(line.unit_feed), True
    for name, limit, load in (("upper", line.upper, line.worn), ("lower", line.lower, line.reference)):
        feed, most = (_law_feed(law, line, limit, of) for of in (line.reference, load))
        slack = APART * abs(line.upper.value - line.lower.value)
        if not feed - slack <= limit.value <= max(feed + slack, most):
            agree = False
            yield _failed(
                "feed limits",
                f"The {name} feed limit is {limit.value:.4g} {unit}, where the load law gives {feed:.4g} {unit} at the "
                f"reference {line.reference:.4g} {plain_unit(line.unit_load)} and a wear of {limit.wear:.4g} "
                f"{plain_unit(line.unit_wear)}; run `fitmodels settings` again.",
            )
    if agree:
        yield FileFinding("feed limits", True, "The feed limits agree with the load law at the reference.")


def _law_feed(law: "LawSection", line: "LoadLineSection", limit: "FeedLimit", load: float) -> float:
    """Feed of the law at a load and the wear of a limit; a line of feed gives it at the reference alone."""
    c = law.coefficients
    if law.form == "feed_line":
        return c["fm0"] + _shift(law, line) + c["slope"] * limit.wear
    return (load - c["A"] - _shift(law, line) - c["k1"] * limit.wear) / c["B"] if c["B"] else math.nan


def _feeds(loop: "LoadLoop", line: "LoadLineSection", law: "LawSection | None") -> Iterator[FileFinding]:
    upper, unit = line.upper.value, loop.unit_feed
    if loop.feed_programmed > upper * ABOVE:
        units = (loop.unit_feed, loop.unit_load)
        yield _failed("programmed feed", above_upper_limit(line, law, loop.feed_programmed, units))
    if upper > WIDEST * line.lower.value:
        yield _failed(
            "feed limits",
            f"The upper feed limit {upper:.4g} {unit} is {upper / line.lower.value:.3g} times "
            f"the lower, {line.lower.value:.4g}; at most {WIDEST:g} times. Run `fitmodels settings` "
            "again.",
        )


def _machine(pf: "ParameterFile", loop: "LoadLoop", line: "LoadLineSection") -> Iterator[FileFinding]:
    """The machine's feed rates may be stated in another unit than the settings."""
    allowed = None if pf.limits is None else pf.limits.feed_rate
    if allowed is None:
        return
    low, high = (value * unit_factor(allowed.unit, line.unit_feed) for value in (allowed.low, allowed.high))
    slack = 1e-9 * high
    if loop.feed_low < low - slack or loop.feed_high > high + slack:
        yield _failed(
            "feed limits",
            f"The feed goes from {loop.feed_low:.4g} to {loop.feed_high:.4g} {loop.unit_feed}, beyond the machine's "
            f"{low:.4g} to {high:.4g}; state limits.feed_rate as the machine has it, or run `fitmodels settings` "
            "again.",
        )


def _loads(loop: "LoadLoop", cut: Line) -> Iterator[FileFinding]:
    unit, wear = loop.unit_load, cut.wear
    worn = cut.load(loop.feed_low, wear)
    if worn > loop.worn_load:
        yield _failed(
            "load",
            f"At the lower feed limit {loop.feed_low:.4g} {loop.unit_feed} a worn tool has a load of "
            f"{worn:.4g} {unit}, above the {loop.worn_load:.4g} that it withstands; lower the limit or the "
            "wear at which the tool is changed.",
        )
    low, high = (loop.engage_at + sign * loop.hysteresis / 2 for sign in (-1, 1))
    sharp = cut.load(loop.feed_low, 0.0)
    if not cut.idle > loop.load_low:
        yield _failed(
            "engagement",
            f"The load in air, {cut.idle:.4g} {unit}, is not above load_low {loop.load_low:.4g}, "
            "so that air would be taken for a lost sensor; lower load_low.",
        )
    elif not loop.load_low >= LEAST_SHARE * cut.idle:
        yield _failed(
            "engagement",
            f"The smallest valid reading, {loop.load_low:.4g} {unit}, is below {LEAST_SHARE:g} times the load in air, "
            f"{cut.idle:.4g}: a lost sensor reads zero with noise and would be taken for air; raise load_low.",
        )
    elif not cut.idle < low:
        yield _failed(
            "engagement",
            f"The load in air, {cut.idle:.4g} {unit}, is not below the threshold, {low:.4g} to "
            f"{high:.4g}, so that air would be taken for a cut; raise engage_at.",
        )
    elif not sharp > high:
        yield _failed(
            "engagement",
            f"A sharp tool at the lower feed limit has a load of {sharp:.4g} {unit}, not above "
            f"the threshold, {low:.4g} to {high:.4g}, so that the control would never begin; lower "
            "engage_at.",
        )
    if loop.load_high > HIGHEST * loop.worn_load:
        yield _failed(
            "engagement",
            f"The largest valid reading, {loop.load_high:.4g} {unit}, is {loop.load_high / loop.worn_load:.3g} times "
            f"what a worn tool withstands, more than {HIGHEST:g} times, so that none is out of range; lower load_high.",
        )
    if not loop.load_high > loop.overload_at:
        yield _failed(
            "engagement",
            f"The largest valid reading, {loop.load_high:.4g} {unit}, is not above the overload, "
            f"{loop.overload_at:.4g}; raise load_high.",
        )


def _times(loop: "LoadLoop", settling: float) -> Iterator[FileFinding]:
    span = loop.high - loop.low
    wrong = [
        f"{name} is {getattr(loop, name):.4g} s, outside {low:g} to {high:g} s; {_setting(name)}"
        for name, (low, high) in TIMES.items()
        if not low <= getattr(loop, name) <= high
    ]
    if not loop.back_off * BACK_OFF_WITHIN >= span:
        wrong.append(
            f"back_off takes {span / loop.back_off:.4g} s for the range of the feed, more than {BACK_OFF_WITHIN:g} s; "
            + _setting("back_off")
        )
    if not loop.recover * RECOVER_WITHIN >= span:
        wrong.append(
            f"recover takes {span / loop.recover:.4g} s for the range of the feed, more than {RECOVER_WITHIN:g} s; "
            + _setting("recover")
        )
    if loop.recover > loop.back_off * (1 + 1e-9):
        wrong.append(
            f"recover {loop.recover:.4g} per s is faster than back_off {loop.back_off:.4g} per s; {_setting('recover')}"
        )
    average = (loop.average - 1) * loop.sample_time / 2
    if loop.filter_time + average > settling:
        wrong.append(
            f"low-pass and average take {loop.filter_time + average:.4g} s, longer than the loop takes to "
            f"settle, {settling:.4g} s; {_setting('filter_corner')}, or tune with the filter"
        )
    if settling < 2 * loop.sample_time:
        wrong.append(
            f"the sample time {loop.sample_time:.4g} s is too long for a loop that settles in {settling:.4g} s; "
            "identify and tune at a shorter one"
        )
    yield from (_failed("times", f"{words[:1].upper()}{words[1:]}.") for words in wrong)
    unmonitored = [
        words
        for name, words in (("stuck_after", "a stuck reading"), ("heartbeat", "a source that stops"))
        if not getattr(loop, name)
    ]
    for words in unmonitored:
        yield FileFinding("times", None, f"The control does not monitor {words}: its time is 0.")
    brief = [name for name in ("lost_after", "stuck_after") if 0 < getattr(loop, name) < 2 * loop.sample_time]
    for name in brief:
        yield FileFinding("times", None, f"{name} is shorter than two samples: a single reading is a fault.")
    if not wrong:
        yield FileFinding("times", True, _times_cleared(loop, span, settling))


def _times_cleared(loop: "LoadLoop", span: float, settling: float) -> str:
    """The times that were compared, each with its limits, in one line."""
    found = [
        f"{name} {getattr(loop, name):.4g} s ({f'{low:g} to' if low else 'at most'} {high:g})"
        for name, (low, high) in TIMES.items()
    ]
    rates = (("back_off", loop.back_off, BACK_OFF_WITHIN), ("recover", loop.recover, RECOVER_WITHIN))
    found += [f"{name} {span / rate:.4g} s for the range of the feed (at most {most:g})" for name, rate, most in rates]
    filters = loop.filter_time + (loop.average - 1) * loop.sample_time / 2
    found.append(f"low-pass and average {filters:.4g} s (at most the settling time of the loop, {settling:.4g})")
    return f"Times are within their limits: {', '.join(found)}."


def _setting(name: str) -> str:
    return f"`fitmodels settings --{name.replace('_', '-')}` changes it"


def _failed(name: str, words: str) -> FileFinding:
    return FileFinding(name, False, words)
