"""Sentences on the settings of constant load: what is assumed, what rounding does, and likely causes of a refusal."""

import math
import re
from collections.abc import Mapping
from itertools import product
from typing import Final

import numpy as np

from ..core.errors import UsageError
from ..core.text import shortened
from ..core.verdict import DO_NOT_USE
from ..datasets.units import convert, is_unit, same_dimension
from .evaluation import equation_of
from .messages import in_unit, short
from .sections.costs import CostsSection
from .sections.law import LawSection
from .sections.load_line import FeedLimit, LimitsSection, LoadLineSection, not_applied_words

FAR_WEAR: Final = 2.0  # times the largest wear tested: a wear in another unit
LEAST_FACTOR: Final = 0.5  # safety factor: below, twice the reference is still no overload
FAR_WORN: Final = 3.0  # times the largest load tested: a load of a worn tool that no test supports
FAR_LOAD: Final = 5.0  # times the largest load tested, or its inverse: a load in another unit
FAR_LIMIT: Final = 3.0  # times the largest load by the law in the tests: a limit that never binds, or a slip of a digit
MOST_FACTORS: Final = 8  # of a law whose largest load is looked for at all combinations of their ends and middles
BEYOND: Final = 1.5  # times the largest or smallest feed tested: a feed limit further out is a mistake
RATING: Final = "the rating of the motor times the efficiency of the drive"
# Beginning of the note on a window that was not given. The schema has no field of it.
WINDOW_ASSUMED: Final = "The wear at tool change is assumed"
NARROWED: Final = 1.02  # times the lower feed limit of the settings: a limit that a person has rounded
AGREES: Final = 0.01  # of the upper feed limit: that of the law


def window_note(low: float, high: float, unit: str) -> str:
    """Note on a window of wear that was not given."""
    return f"{WINDOW_ASSUMED}: {low:g} to {high:g} {unit}, as in the paper; --window sets it."


def window_assumed(line: LoadLineSection) -> bool:
    """Whether the window of wear was assumed, by the notes of the settings."""
    return any(note.startswith(WINDOW_ASSUMED) for note in line.notes)


def of_cut_lines(laws: Mapping[str, LawSection]) -> tuple[str, ...]:
    """A line on each law of a power that is that of the cut."""
    return tuple(f"{law.of_cut}: a limit of it is {RATING}" for law in laws.values() if law.of_cut)


def power_limit_words(
    limits: LimitsSection | None, laws: Mapping[str, LawSection], costs: CostsSection | None = None
) -> tuple[str, ...]:
    """A sentence on what a limit of power is compared with, where that was computed from the force; else none.

    ``costs`` are those of the file, whose efficiency the limit does not use.
    """
    bound = None if limits is None else limits.power
    law = None if bound is None else laws.get(bound.of or "P")
    if bound is None or law is None or not law.of_cut:
        return ()
    priced = None if costs is None else costs.efficiency
    unused = "" if priced is None else f" The efficiency {priced:g} of the costs is not applied to it."
    return (f"{law.of_cut}: the limit {bound.value:g} {bound.unit} must be {RATING}.{unused}",)


def measured_power_words(limits: LimitsSection | None, laws: Mapping[str, LawSection]) -> tuple[str, ...]:
    """A sentence on a limit of a power that was not computed from the force; none without such a limit."""
    bound = None if limits is None else limits.power
    name = "P" if bound is None else bound.of or "P"
    if bound is None or name not in laws or laws[name].of_cut:
        return ()
    return (
        f"{name} is as the tests state it: if that is at the motor, its limit is the rating of the motor; if at the "
        f"tool, {RATING}.",
    )


def rounded(value: float, step: float | None) -> float:
    """To the nearest step, as a decimal: 0.238 to 0.24, not to 0.24000000000000002."""
    if step is None:
        return value
    found = float(f"{round(value / step) * step:.12g}")
    if not found > 0:
        raise UsageError(f"the reference {value:g} rounds to nothing in steps of {step:g}; give a smaller rounded_to.")
    return found


def rounding_words(line: LoadLineSection) -> str:
    """Sentence on a reference that was rounded above the safety factor asked for; empty where it was not.

    >>> from fitmodels.parameters.published import published
    >>> rounding_words(published("CLM-2023").load_line)
    'After rounding the reference is 0.857 x 0.28 A, above the safety factor 0.85; --round 0 keeps 0.238 A.'
    """
    asked = line.safety_factor * line.worn
    if line.reference <= asked * (1 + 1e-9):
        return ""
    return (
        f"After rounding the reference is {line.reference / line.worn:.3g} x {line.worn:g} {line.unit_load}, above the "
        f"safety factor {line.safety_factor:g}; --round 0 keeps {asked:.4g} {line.unit_load}."
    )


def above_upper_limit(line: LoadLineSection, law: LawSection | None, programmed: float, units: tuple[str, str]) -> str:
    """Sentences on a programmed feed above the upper feed limit: the origin of the limit, and the choices.

    ``units`` are those of feed and load as they are printed.
    """
    (feed, load), upper = units, line.upper.value
    rises = law is not None and law.form == "load_line" and law.coefficients["B"] > 0
    origin, other = "", None
    if law is not None and rises:
        if abs(_law_feed(law, line) - upper) <= AGREES * upper:
            origin = (
                f" A sharp tool reaches the reference {line.reference:g} {load} ({line.safety_factor:g} x "
                f"{line.worn:g} {load}) at {upper:.4g} {feed}."
            )
        other = _higher_factor(line, law, programmed)
    choice = "" if other is None else (
        f", or accept a higher reference: safety factor {other[0]:g} gives {other[1]:g} {load} and {other[2]:.4g} "
        f"{feed} (`fitmodels settings --safety-factor {other[0]:g}`)"
    )  # fmt: skip
    return (
        f"The programmed feed {programmed:.6g} {feed} is above the upper feed limit {upper:.6g} {feed}: a program "
        f"without adaptive feed would cut at it.{origin} Program F{math.floor(upper)} at most{choice}."
    )


def limits_not_applied(limits: LimitsSection | None, line: LoadLineSection) -> tuple[str, ...]:
    """A sentence on the limits of a file that constant load does not apply; none where it applies all.

    A feed per revolution and a spindle speed are among them: the settings hold no spindle speed.
    """
    applied = () if limits is None else ("feed_rate", "wear", *limits.names_of(line.load))
    return not_applied_words(limits, "The control of constant load", *applied)


def narrowed_words(line: LoadLineSection, low: float, load: tuple[float, float, float]) -> str:
    """Sentence on a control that does not go down to the lower feed limit of its settings; empty where it does.

    ``low`` is its own lower limit, ``load`` A, B and k1 of its cut, by which a tool reaches the reference earlier.
    """
    if not low > NARROWED * line.lower.value:
        return ""
    A, B, k1 = load
    wear = (line.reference - A - B * low) / k1 if k1 > 0 else math.nan
    at = f", by the load law at a wear of {wear:.3g} {line.unit_wear}" if wear > 0 else ""
    return (
        f"The feed of this control does not go below {low:.4g} {line.unit_feed}, a limit of the gains or the machine, "
        f"where the settings state {line.lower.value:.4g}: a tool reaches the reference there earlier{at}, and counts "
        "as worn. If that is not meant, run `fitmodels tune` again with the limits of the settings."
    )


def _law_feed(law: LawSection, line: LoadLineSection) -> float:
    """Feed at which a sharp tool draws the reference by the law."""
    shift = law.by.shifts.get(line.by or "", 0.0) if law.by else 0.0
    return (line.reference - law.coefficients["A"] - shift) / law.coefficients["B"]


def _higher_factor(line: LoadLineSection, law: LawSection, programmed: float) -> tuple[float, float, float] | None:
    """Smallest safety factor below 1, not exceeded by rounding, that allows the feed; its reference and upper limit."""
    for percent in range(math.floor(100 * line.safety_factor) + 1, 100):
        reference = rounded(percent / 100 * line.worn, line.rounded_to)
        upper = line.upper.value + (reference - line.reference) / law.coefficients["B"]
        exceeded = reference > percent / 100 * line.worn * (1 + 1e-9)
        if not exceeded and upper >= programmed and not feeds_far_beyond_tests(law, upper, upper):
            return percent / 100, reference, upper
    return None


def cause_of_refusal(law: LawSection, worn: float, reference: float, lower: FeedLimit) -> str:
    """The likely causes of feed limits that cannot be, and what to do: a law that is wrong, then a wrong option."""
    causes = [_wrong_law(law), _wrong_option(law, worn, reference, lower)]
    return " Otherwise: ".join(cause for cause in causes if cause)


def _wrong_law(law: LawSection) -> str:
    """The verdict of a law that must not be used, with the reason that names a row; empty for others."""
    verdict = law.verdict
    if verdict is None or verdict.concern != DO_NOT_USE:
        return ""
    named = [words for words in verdict.reasons if re.search(r"\b(?:lines?|edges?|rows?) [\dA-Z]", words)]
    reason = " ".join([*named, *verdict.reasons][:1])
    return f"The likely cause is the law of {short(law.response)}, '{verdict.level}'. {reason}".rstrip()


def _wrong_option(law: LawSection, worn: float, reference: float, lower: FeedLimit) -> str:
    """The option that leads to feed limits that cannot be, as it was read, and what to do."""
    wear, c = law.factors[-1], law.coefficients
    if lower.wear > FAR_WEAR * wear.high:
        return (
            f"--window or --wear-limit was read as a wear of {lower.wear:g} {wear.unit}, where no tool was tested "
            f"above {wear.high:g} {wear.unit}: write its unit, for instance --window 180:220um."
        )
    if law.form != "load_line" or not (c["B"] > 0 and c["k1"] > 0):
        return f"Check the data of the law of {short(law.response)}: load rises with feed and with wear."
    if slip := _unit_slip(law, worn):
        return slip
    if lower.value > 0:
        return f"Look at the load of a worn tool, --worn {worn:g} {law.unit}, and at the units."
    return (
        f"--worn was read as {worn:g} {law.unit}, a reference of {reference:g} {law.unit}; by the law of "
        f"{short(law.response)} a tool with a wear of {lower.wear:g} {wear.unit} has "
        f"{reference - c['B'] * lower.value:.4g} {law.unit} at a feed of zero. Give the load that a worn tool "
        f"withstands in {law.unit}, or a smaller wear."
    )


def _unit_slip(law: LawSection, worn: float) -> str:
    """Sentences on a load of a worn tool that is far from the loads of the tests, with the unit that it may have."""
    low, high = loads_tested(law)
    if not low > 0 or low / FAR_LOAD <= worn <= high * FAR_LOAD:
        return ""
    size, end, name = (worn / high, high, "largest") if worn > high else (worn / low, low, "smallest")
    meant = _in_another_unit(law.unit, worn, low, high)
    return (
        f"--worn {worn:g} {law.unit} is {float(f'{size:.2g}'):g} times the {name} load of the tests, {end:.3g} "
        f"{law.unit} by their law.{meant} Give it in {law.unit}, or with its unit."
    )


def _in_another_unit(unit: str, worn: float, low: float, high: float) -> str:
    """Question whether the number was in a smaller or larger unit with which it lies near the tests; else empty."""
    for other in (f"m{unit}", f"k{unit}", unit[1:]):
        if other and is_unit(other) and is_unit(unit) and same_dimension(other, unit):
            value = float(f"{float(convert(np.array(worn), other, unit)):.12g}")
            if low / FAR_LOAD <= value <= high * FAR_LOAD:
                return f" Was {value:g} {unit} meant ({worn:g} {other})?"
    return ""


def loads_tested(law: LawSection) -> tuple[float, float]:
    """Smallest and largest load at the ends of the factors tested, by the law, at the reference level.

    >>> from fitmodels.parameters.published import published
    >>> low, high = loads_tested(published("CLM-2023").laws["I"])
    >>> round(low, 3), round(high, 3)
    (0.19, 0.293)
    """
    names = [factor.symbol for factor in law.factors]
    corners = ([getattr(factor, end) for factor in law.factors] for end in ("low", "high"))
    level = None if law.by is None else law.by.reference
    found = [float(law.values(dict(zip(names, corner, strict=True)), by=level)) for corner in corners]
    return min(found), max(found)


def no_overload(law: LawSection | None, worn: float, factor: float, unit: str) -> str:
    """Why a worn tool's load and a safety factor find no overload, without a period; empty where they do.

    >>> no_overload(None, 2.2, 0.109, "A").partition(":")[0]
    'the safety factor 0.109 is below 0.5'
    """
    remedy = "give the load that a worn tool withstands, from the wear tests, and the safety factor, in the paper 0.85"
    if factor < LEAST_FACTOR:
        return (
            f"the safety factor {factor:g} is below {LEAST_FACTOR:g}: twice the reference, {2 * factor * worn:.3g} "
            f"{unit}, is below {worn:g} {unit} and would not be found as an overload; {remedy}"
        )
    if law is None or law.form != "load_line" or law.unit != unit:
        return ""
    tested = loads_tested(law)[1]
    if worn > FAR_WORN * tested > 0:
        times = f"{worn / tested:.3g} times the largest load tested, {tested:.3g} {unit}, more than {FAR_WORN:g} times"
        return f"the load that a worn tool withstands, {worn:g} {unit}, is {times}; {remedy}"
    return ""


def feeds_far_beyond_tests(law: LawSection, lower: float, upper: float) -> str:
    """Sentence on feed limits far outside the feeds that a load law was tested at; empty where they are not.

    >>> from fitmodels.parameters.published import published
    >>> law = published("CLM-2023").laws["I"]
    >>> feeds_far_beyond_tests(law, 600.0, 19000.0)
    'the upper feed limit 1.9e+04 mm/min is 19 times the largest feed tested, 1000 mm/min'
    """
    feed = law.factors[0]
    if law.form != "load_line":
        return ""
    if upper > BEYOND * feed.high:
        return (
            f"the upper feed limit {upper:.4g} {feed.unit} is {upper / feed.high:.3g} times the largest feed tested, "
            f"{feed.high:g} {feed.unit}"
        )
    if lower * BEYOND < feed.low:
        return (
            f"the lower feed limit {lower:.4g} {feed.unit} is {lower / feed.low:.3g} times the smallest feed tested, "
            f"{feed.low:g} {feed.unit}"
        )
    return ""


def limit_far_beyond_tests(law: LawSection, limit: float, unit: str) -> str:
    """Words on a limit of a load far above all that its law gives within the ranges tested; empty where it is not.

    >>> from fitmodels.parameters.published import published
    >>> law = published("AC-2017").laws["P"]
    >>> limit_far_beyond_tests(law, 7.0, "kW"), limit_far_beyond_tests(law, 70.0, "kW").partition(",")[0]
    ('', 'P up to 70 kW is 5.52 times the largest that its law gives in the tests')
    """
    high = in_unit(limit, unit, law.unit)
    if high is None or len(law.factors) > MOST_FACTORS:
        return ""
    X = np.array([*product(*((one.low, (one.low + one.high) / 2, one.high) for one in law.factors))])
    levels = (None,) if law.by is None else (law.by.reference, *law.by.shifts)
    largest = max(float(equation_of(law, level).values(X).max()) for level in levels)
    if not high > FAR_LIMIT * largest > 0:
        return ""
    words = (
        f"{shortened(law.response)} up to {limit:g} {unit} is {high / largest:.3g} times the largest that its law gives"
    )
    return f"{words} in the tests, {largest:.4g} {law.unit}, and has no effect there: check its unit and digits."
