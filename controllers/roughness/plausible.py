"""Values of control at constant roughness that no cut has, or that contradict the laws of the file."""

import math
import re
from typing import TYPE_CHECKING, Final

from ...core.errors import UsageError
from ...datasets.plausibility.ranges import KC, plausible
from ...parameters.sections.force_control import ROUNDING
from .controller import FLOOR
from .plant import Cut
from .reference import (
    feed_of_ideal_roughness,
    force_at,
    force_law_of,
    ideal_marks,
    largest_feed,
    law_of,
    settings_of,
    tested_feeds,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from ...parameters import LawSection, ParameterFile
    from ...parameters.sections.force_control import RoughnessSection

BEYOND: Final = 1.5  # times the largest tested feed, or that of ideal marks, beyond which a reason is needed
WIPER: Final = 2.0  # times the feed of ideal marks: no edge, not even a wiper, gives the roughness beyond it
NEARLY: Final = 1 + 1e-9
TIMES_POSSIBLE: Final = (1e-3, 10.0)  # s, of servo and process
HIGHEST_READING: Final = 20.0  # times the reference force: a valid reading beyond, of either sign, is refused
AGREE: Final = (
    "Roughness control: reference force, threshold, readings, times, spindle speed and kc a agree with each other and "
    "with the laws of the file."
)
ACCEPTED: Final = "Accepted: "  # in a note: what the tests do not cover was accepted for a reason
LEAST_THRESHOLD: Final = 0.01  # of the reference
TWO_DIGITS: Final = 0.1  # share that a number rounded down to two digits may lose
OTHER_ROUGHNESS: Final = 1.5  # times the required one: of a force by regression, which is not the inverse of the law
FAR_FORCE: Final = 1.5  # times the largest force of the tests
MOST_EXPONENT: Final = 700.0  # exp of more is no number
OTHER_GAIN: Final = 3.0  # times the kc a of the force law, or a share of it: a given kc a beyond needs a reason


def check_plausible(
    gain: float | None = None,
    depth: float | None = None,
    times: "Mapping[str, float] | None" = None,
    override: tuple[float, float] | None = None,
) -> None:
    """Refuse a kc a, N per mm/rev, at a depth, mm, or time constants, s, that no cut has, or an override without range.

    Raises
    ------
    UsageError
        The specific force is not 100 to 30000 N/mm2, a time constant not 1 ms to 10 s, or the upper end of the override
        not above the lower feed limit.
    """
    if override is not None:
        _check_override(*override)
    low, high = KC.hard
    if gain is not None and depth is not None and not low <= gain / depth <= high:
        raise UsageError(
            f"kc a {gain:.4g} N per mm/rev at a depth of {depth:g} mm is a specific force of {gain / depth:.3g} N/mm2, "
            f"not {low:g} to {high:g}; check the values and their units."
        )
    low, high = TIMES_POSSIBLE
    for name, time in (times or {}).items():
        if not low <= time <= high:
            words = f"the time constant of the {name}, {time:.4g} s, is not {low:g} to {high:g} s"
            raise UsageError(f"{words}; check its unit.")


def check_readings(
    low: float, high: float, threshold: float, reference: float, lowest: float, *, given: bool = True
) -> None:
    """Refuse valid readings, N, that do not enclose threshold and reference, or that are as good as no limit.

    ``lowest`` is the force at the lower feed limit: a reversed sensor reads minus that in a cut.

    Raises
    ------
    UsageError
        With the limit, and the remedy for a range that is given or derived.

    Examples
    --------
    >>> check_readings(-50.0, 3000.0, 56.0, 580.0, 60.0)
    """
    if not low < threshold < reference < high:
        raise UsageError(
            f"valid={low:g}:{high:g}N: valid readings enclose the threshold {threshold:g} N and the "
            f"reference {reference:.4g} N; widen the range."
        )
    most = HIGHEST_READING * reference
    if max(-low, high) > most:
        remedy = "narrow the range" if given else "check kc a and the feed, or give valid=-50:3000N"
        raise UsageError(
            f"valid={low:.4g}:{high:.4g}N: a valid reading is at most {HIGHEST_READING:g} times the reference force "
            f"{reference:.4g} N, which is {most:.4g} N, of either sign; {remedy}."
        )
    if words := _reversed_valid(low, threshold, lowest):
        raise UsageError(f"valid={low:.4g}:{high:.4g}N: {words}")


def _reversed_valid(low: float, threshold: float, lowest: float) -> str:
    """Sentence on a smallest valid reading, N, by which a reversed sensor reads air in a cut; empty where sound."""
    least = -max(threshold, lowest)
    if low >= least:
        return ""
    return (
        f"a sensor of reversed sign reads {-lowest:.4g} N in a cut at the lower feed limit, which would be taken for "
        f"air, where the feed rises; give a smallest valid reading of at least {least:.4g} N."
    )


def _check_override(low: float, high: float) -> None:
    """Refuse an override whose upper end is not above its lower one, which is assumed where it begins at 0."""
    if high > (low or FLOOR):
        return
    assumed = "" if low else ", assumed as the override begins at 0"
    raise UsageError(
        f"override={100 * low:g}:{100 * high:g}%: its upper end is not above the lower feed limit, "
        f"{100 * (low or FLOOR):g} % of the programmed feed{assumed}, so that the control has no range; raise the "
        "upper end, as a rule to 100 % or more."
    )


def large_feed(top: float, roughness: float, nose_radius: float | None, depth: float | None, times: float) -> str:
    """A sentence on a largest feed that the nose does not form, or whose marks are rougher; empty where it is sound.

    Parameters
    ----------
    top, roughness, nose_radius, depth : float
        mm/rev, um, mm and mm.
    times : float
        The feed of ideal marks, beyond which it is too large.

    Examples
    --------
    >>> large_feed(0.3, 1.6, 0.8, None, WIPER), large_feed(0.42, 1.6, 0.8, None, WIPER)[:44]
    ('', 'The largest feed 0.42 mm/rev is too large. I')
    """
    words, remedy = f"The largest feed {top:.4g} mm/rev", "Lower the feed or the override."
    formed, why = largest_feed(nose_radius, depth)
    if top > formed * NEARLY:
        return f"{words} is above {why}: it cannot form the surface. {remedy}"
    if nose_radius is None or top <= times * feed_of_ideal_roughness(roughness, nose_radius) * NEARLY:
        return ""
    return f"{words} is too large. {ideal_marks(top, nose_radius, roughness)} {remedy}"


def gain_off_law(cut: "Cut", law: "LawSection | None", gain: float, feed: float) -> str:
    """Sentence on a given kc a, N per mm/rev, far from that of the force law; empty where it is near."""
    if law is None or (cut.force_per_feed is None and cut.kc is None):
        return ""
    try:
        own = force_at(law, feed, cut.depth, cut.conditions) / feed
    except UsageError:  # a factor of the law is not given: nothing to compare with
        return ""
    if own / OTHER_GAIN <= gain <= OTHER_GAIN * own:
        return ""
    return (
        f"kc a {gain:.4g} N per mm/rev and the {own:.4g} N per mm/rev of the force law {law.equation} differ by more "
        f"than {OTHER_GAIN:g} times."
    )


def contradictions(pf: "ParameterFile") -> "Iterator[tuple[str, str]]":
    """Values of a complete roughness section that contradict its laws or each other: a name, and a sentence."""
    section, law = settings_of(pf), law_of(pf)
    accepted = any(ACCEPTED in note for note in section.notes)
    yield from _off_law(section, law, accepted=accepted)
    yield from _off_spindle(section)
    yield from _off_assumed(section)
    yield from _off_reference(section)
    times = {"servo": section.servo_time or 0.0, "process": section.process_time or 0.0}
    try:
        check_plausible(times=times)
    except UsageError as error:
        yield "times", f"{str(error)[:1].upper()}{str(error)[1:]}"
    force_law = force_law_of(pf, law.factors[0].symbol)
    yield from _off_feeds(section, tested_feeds(pf, force_law), accepted=accepted)
    yield from () if accepted else _off_force_law(section, force_law)


def _off_reference(section: "RoughnessSection") -> "Iterator[tuple[str, str]]":
    """Threshold and valid readings against the reference force."""
    reference, most = section.force, HIGHEST_READING * section.force
    low, high = section.force_low or 0.0, section.force_high or 0.0
    if section.threshold < LEAST_THRESHOLD * reference:
        words = f"The threshold {section.threshold:.4g} N is below {100 * LEAST_THRESHOLD:g} % of the reference, "
        yield "threshold", f"{words}{reference:.4g} N, where noise in air is taken for a cut; raise it."
    if max(-low, high) > most:
        words = f"Valid readings from {low:.4g} to {high:.4g} N go beyond {most:.4g} N, {HIGHEST_READING:g} times the "
        yield "readings", f"{words}reference, so that none is invalid; narrow them (valid=-50:3000N)."
    lowest = (section.force_per_feed or 0.0) * (section.override_low or FLOOR) * (section.feed or 0.0)
    if words := _reversed_valid(low, section.threshold, lowest):
        yield "readings", f"The smallest valid reading is {low:.4g} N: {words}"


def _off_feeds(
    section: "RoughnessSection", tested: tuple[float, float] | None, *, accepted: bool
) -> "Iterator[tuple[str, str]]":
    """The largest feed against the nose, the marks that it leaves, and the tests."""
    top = max(section.override_high, 1.0) * (section.feed or 0.0)
    times = WIPER if accepted else BEYOND
    if words := large_feed(top, section.roughness, section.nose_radius, section.depth, times):
        yield "limits", words
    elif tested is not None and top > BEYOND * tested[1] * NEARLY and not accepted:
        words = f"The largest feed {top:.4g} mm/rev is more than {BEYOND:g} times the tested ones, "
        yield "limits", f"{words}{tested[0]:g} to {tested[1]:g} mm/rev: lower it."


def _off_force_law(section: "RoughnessSection", force_law: "LawSection | None") -> "Iterator[tuple[str, str]]":
    """The kc a of the section against that of the force law."""
    gain = section.force_per_feed or 0.0
    given = Cut(section.roughness, section.spindle_speed or 1.0, depth=section.depth, force_per_feed=gain)
    if words := gain_off_law(given, force_law, gain, section.feed or 0.0):
        yield "units", f"{words[:1].upper()}{words[1:]} Derive the settings again with `fitmodels roughness`."


def _off_law(section: "RoughnessSection", law: "LawSection", *, accepted: bool) -> "Iterator[tuple[str, str]]":
    """The reference force against the law of roughness, and against its tests."""
    force, c, factor = section.force, law.coefficients, law.factors[0]
    by_law = c["a"] * math.exp(min(c["b"] * force, MOST_EXPONENT))
    times = max(by_law / section.roughness, section.roughness / by_law)
    implied = math.log(section.roughness / c["a"]) / c["b"]
    inverse = section.force_from == "inverse"
    if abs(implied - force) > ROUNDING * force if inverse else times > OTHER_ROUGHNESS:
        yield (
            "reference",
            (
                f"By {law.equation} the reference force {force:.4g} N gives a roughness of {by_law:.4g} um, and "
                f"{section.roughness:.4g} um is required; derive it again with `fitmodels roughness`."
            ),
        )
    if force > FAR_FORCE * factor.high and not accepted:
        yield (
            "reference",
            (
                f"The reference force {force:.4g} N is {force / factor.high:.3g} times the largest of the tests of "
                f"{law.response[:40]}, {factor.high:.4g} N; require a finer surface, or test there."
            ),
        )


def _off_spindle(section: "RoughnessSection") -> "Iterator[tuple[str, str]]":
    """The spindle speed against the time of a revolution, and the feed rate that it gives."""
    n, ranges = section.spindle_speed, plausible("fm", "turning")
    if n is None or ranges is None:
        return
    turn, process = 60 / n, section.process_time or 0.0
    if section.sources.get("process_time", "").startswith("one revolution") and abs(process / turn - 1) > ROUNDING:
        yield (
            "times",
            (
                f"The time constant of the process, {process:.4g} s, is stated to be one revolution, which takes "
                f"{turn:.4g} s at {n:.4g} 1/min; derive the settings again with `fitmodels roughness`."
            ),
        )
    rate = section.override_high * (section.feed or 0.0) * n
    if rate > ranges.unusual[1]:
        yield (
            "limits",
            (
                f"The upper feed limit is {rate:.3g} mm/min at {n:.4g} 1/min, beyond the {ranges.unusual[1]:g} mm/min "
                "of turning; check the spindle speed."
            ),
        )


def _off_assumed(section: "RoughnessSection") -> "Iterator[tuple[str, str]]":
    """Threshold and wait whose source is an assumption, and that are not those of it."""
    n, wait, of_threshold = section.spindle_speed, section.threshold_time, section.sources.get("threshold", "")
    turns = re.match(r"([\d.]+) revolutions, assumed", section.sources.get("threshold_time", ""))
    if turns and n and wait is not None and abs(wait * n / 60 - float(turns[1])) > ROUNDING * float(turns[1]):
        words = f"The time above the threshold, {wait:.4g} s, is stated to be {turns[0]}, which take "
        yield "times", f"{words}{float(turns[1]) * 60 / n:.4g} s; derive the settings again with `fitmodels roughness`."
    share = re.match(r"([\d.]+) % of (?:the reference|the force at the lower feed limit, ([\d.e+]+) N), ", of_threshold)
    of = float(share[1]) / 100 * float(share[2] or section.force) if share else section.threshold
    if not (1 - TWO_DIGITS) * of <= section.threshold <= (1 + ROUNDING) * of:
        words = f"The threshold {section.threshold:.4g} N is stated to be {of_threshold.rpartition(',')[0]}, that is "
        yield "threshold", f"{words}{of:.4g} N; derive the settings again with `fitmodels roughness`."
