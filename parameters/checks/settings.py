"""Settings in order: feed limits above zero and the right way round, windows, thresholds, set points."""

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

from ..sections.load_line import LimitInterval
from .finding import FileFinding

if TYPE_CHECKING:
    from ..file import ParameterFile
    from ..sections.adaptive_force import AdaptiveForceSection
    from ..sections.load_line import Engagement, FeedLimit, LoadLineSection

EXCEEDS = 1 + 1e-9


def settings_in_order(pf: "ParameterFile") -> Iterator[FileFinding]:
    """A finding for each thing out of order, and one for each section that is in order."""
    if (line := pf.load_line) is not None:
        yield from _told("feed limits", "load_line", [*_feed(line), *_feed_of_machine(pf, line)])
        yield from _told("window", "load_line", [*_window(line), *_criterion(pf, line)])
        yield from _told("reference", "load_line", [*_reference(line), *_source(pf, line)])
        if line.engagement is not None:
            yield from _told("engagement", "load_line.engagement", list(_engagement(line.engagement, line)))
    if (rough := pf.roughness) is not None and pf.laws:
        lacking = [] if rough.law in pf.laws else [f"the law of {rough.law[:40]!r} is not in the file"]
        yield from _told("roughness", "roughness", lacking)
    if (force := pf.adaptive_force) is not None:
        yield from _told("set points", "adaptive_force", list(_set_points(force)))


def _told(name: str, where: str, complaints: list[str]) -> Iterator[FileFinding]:
    yield from (FileFinding(name, False, f"{where}: {words}.") for words in complaints)
    if not complaints:
        yield FileFinding(name, True, f"{where}: {name} in order.")


def _feed(line: "LoadLineSection") -> Iterator[str]:
    low, high = line.lower.value, line.upper.value
    if not low > 0:
        yield f"the lower feed limit is {low:g} {line.unit_feed}; a feed lies above zero"
    if not low < high:
        yield f"the lower feed limit {low:g} is not below the upper, {high:g} {line.unit_feed}"
    for name, limit in (("lower", line.lower), ("upper", line.upper)):
        if not _inside(limit):
            yield f"the {name} feed limit {limit.value:g} lies outside its own interval"


def _inside(limit: "FeedLimit") -> bool:
    held = limit.interval
    return not isinstance(held, LimitInterval) or held.low <= limit.value <= held.high


def _feed_of_machine(pf: "ParameterFile", line: "LoadLineSection") -> Iterator[str]:
    allowed = None if pf.limits is None else pf.limits.feed_rate
    if allowed is not None and allowed.unit == line.unit_feed:
        for name, value in (("lower", line.lower.value), ("upper", line.upper.value)):
            if not allowed.low <= value <= allowed.high:
                yield f"the {name} feed limit {value:g} is outside the machine's {allowed.low:g} to {allowed.high:g}"
    pi = pf.pi
    if pi is not None and pi.unit_u == line.unit_feed and pi.low is not None and pi.low <= 0:
        yield f"the gains may command a feed of {pi.low:g} {line.unit_feed}; a feed lies above zero"


def _window(line: "LoadLineSection") -> Iterator[str]:
    low, high = line.window
    if not low < high:
        yield f"the tool-change window {low:g} to {high:g} {line.unit_wear} has its ends the wrong way round"
    if not low <= line.lower.wear <= high * EXCEEDS:
        yield f"the lower feed limit stands for a wear of {line.lower.wear:g} {line.unit_wear}, outside the window"
    if not line.upper.wear < line.lower.wear:
        yield f"the upper feed limit stands for more wear than the lower: {line.upper.wear:g} and {line.lower.wear:g}"


def _criterion(pf: "ParameterFile", line: "LoadLineSection") -> Iterator[str]:
    worn = None if pf.limits is None else pf.limits.wear
    wear = line.lower.wear
    if worn is not None and worn.unit == line.unit_wear and wear > worn.value * EXCEEDS:
        yield f"the wear at the lower feed limit, {wear:g} {worn.unit}, is above the criterion, {worn.value:g}"


def _reference(line: "LoadLineSection") -> Iterator[str]:
    unit = line.unit_load
    if not 0 < line.reference < line.worn:
        yield f"the reference {line.reference:g} is not between 0 and what a worn tool stands, {line.worn:g} {unit}"
        return
    step = line.rounded_to or 0.0
    if abs(line.reference - line.safety_factor * line.worn) > step / 2 + 1e-9 * line.worn:
        product = line.safety_factor * line.worn
        yield f"the reference {line.reference:g} is not {line.safety_factor:g} x {line.worn:g} = {product:g} {unit}"


def _source(pf: "ParameterFile", line: "LoadLineSection") -> Iterator[str]:
    if pf.laws and line.law not in pf.laws:
        yield f"the law of {line.law[:40]!r} that the limits come from is not in the file"


def _engagement(e: "Engagement", line: "LoadLineSection") -> Iterator[str]:
    if e.load_low is not None and e.load_high is not None and not e.load_low < e.load_high:
        yield f"readings from {e.load_low:g} to {e.load_high:g} leave no range"
    at, half = e.engage_at, (e.hysteresis or 0.0) / 2
    if at is not None and not at + half < line.reference:
        yield f"the loop engages at {at + half:g} {line.unit_load}, not below the reference {line.reference:g}"
    if at is not None and e.load_low is not None and not e.load_low < at - half:
        yield f"the loop lets go at {at - half:g}, not above the smallest reading {e.load_low:g}"
    if e.load_high is not None and not e.load_high > line.worn:
        yield f"the largest reading {e.load_high:g} is not above what a worn tool stands, {line.worn:g}"
    if e.feed_programmed is not None and not e.feed_programmed >= line.lower.value:
        yield f"the programmed feed {e.feed_programmed:g} is below the lower feed limit {line.lower.value:g}"


def _set_points(force: "AdaptiveForceSection") -> Iterator[str]:
    depths = [point.depth for point in force.set_points]
    if any(a >= b for a, b in pairwise(depths)):
        yield "the set points are not in order of depth, each once"
    if force.low is not None and force.high is not None and not force.low < force.high:
        yield f"the limits of the command are {force.low:g} to {force.high:g}"
    if not force.alpha + force.Kd > force.lam * force.m:
        yield "alpha + Kd is not above lambda m, so its energy need not fall"
