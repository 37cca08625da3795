"""Settings of control at constant roughness from what a parameter file, a step record and the user state.

Every value is given, derived or assumed, and its origin is a sentence in ``sources`` of the section.

    reference force    inverse of the law Ra = a exp(b F), or regression of force on ln Ra           `reference`
    kc a               F/f of the file's force law at the programmed feed, kc times depth, or the gain of a record
    servo, process     time constants of a step record, or given; the process otherwise one revolution
    override           tested feeds over the programmed one, at most 150 % as in SURF

A feed beyond 1.5 times the tested ones needs a reason, and no feed lies above what the nose radius can form.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from ...core.errors import ParameterError, UsageError
from ...parameters.sections.force_control import RoughnessSection
from .controller import FLOOR
from .inverse import ForceOfRoughness, inverse_force
from .plant import Cut, Measured, loop_theory
from .plausible import BEYOND, NEARLY, WIPER, check_plausible, check_readings, gain_off_law, large_feed
from .reference import (
    Reading,
    feed_of_force,
    feed_of_ideal_roughness,
    force_at,
    force_law_of,
    ideal_marks,
    largest_feed,
    outside_tests,
    regression_of_law,
    roughness_law,
    tested_feeds,
)

if TYPE_CHECKING:
    from ...parameters import LawSection, ParameterFile

OVERRIDE: Final = 1.5  # of the programmed feed: the highest of SURF's lathe
STIFF: Final = 0.5  # of the programmed feed: the highest lower limit that is assumed
SAMPLE: Final = 0.01  # s, SURF
SLOWEST_SAMPLE: Final = 0.5  # of the shorter time constant: a longer sample time is refused
LONGEST_WAIT: Final = 10.0  # s
REVOLUTIONS: Final = 3.0  # above the threshold before the law acts
OF_LOWEST: Final = 0.5  # of the force at the lower feed limit: the threshold
OF_REFERENCE: Final = 0.2  # of the reference: the highest threshold that is assumed
LARGEST_READING: Final = 5.0  # times the largest force expected: a larger reading is invalid


@dataclass(frozen=True, slots=True)
class Choices:
    """Laws and readings to derive with.

    Attributes
    ----------
    law, force_law : str or None
        Responses of the roughness law and of the force law; None: the only ones that fit.
    force_from : {"inverse", "regression"}
    regression : (float, float) or None
        Constant and slope of force on ln Ra from tests, N, with ``regression_of``; None: from the law.
    level : float
        Of the interval of the reference force.
    beyond_tests : str
        Reason why feeds or forces that the tests do not cover are accepted; empty: they are not.
    """

    law: str | None = None
    force_law: str | None = None
    force_from: Reading = "inverse"
    regression: tuple[float, float] | None = None
    regression_of: str = ""
    level: float = 0.95
    beyond_tests: str = ""


@dataclass(frozen=True, slots=True)
class DerivedSettings:
    """A roughness section, both readings of its reference force, and remarks.

    Attributes
    ----------
    section : RoughnessSection
    inverse : ForceOfRoughness
    regression : float or None
        N; None with ``no_regression``.
    remarks : tuple of str
        Sentences on limits, extrapolation and the loop.
    laws : tuple of str
        Responses of the laws that were used.
    """

    section: RoughnessSection
    inverse: ForceOfRoughness
    regression: float | None
    no_regression: str
    remarks: tuple[str, ...]
    laws: tuple[str, ...]


def derived_settings(pf: "ParameterFile", cut: Cut, measured: Measured, chosen: Choices) -> DerivedSettings:
    """Derive the roughness section of a file.

    Raises
    ------
    UsageError
        A value is missing and cannot be derived, or lies beyond the tests, the nose radius or the sampling of the loop.
    ParameterError
        The file has no law of roughness on force, or no force law.

    Examples
    --------
    >>> from fitmodels import datasets, fit, parameters
    >>> Ra = fit.exponential_law(datasets.bundled("surf_table1"), "Ra", "F")
    >>> F = fit.power_law(datasets.bundled("surf_table1"), "F", ["f"])
    >>> pf = parameters.collect(laws=[Ra, F])
    >>> section = derived_settings(pf, Cut(1.6, 610.0, feed=0.2, servo_time=0.13), Measured(), Choices()).section
    >>> round(section.force), round(section.force_per_feed), round(section.process_time, 3), section.override_high
    (580, 2878, 0.098, 1.4)
    """
    name = roughness_law(pf, chosen.law)
    draft = _Draft(pf, cut, measured, chosen, pf.laws[name])
    draft.values["law"] = name
    draft.reference()
    draft.cutting()
    draft.limits()
    draft.threshold()
    draft.times()
    return draft.finished()


class _Draft:
    """Values of the section with their sources, completed step by step."""

    def __init__(self, pf: "ParameterFile", cut: Cut, measured: Measured, chosen: Choices, law: "LawSection") -> None:
        self.cut, self.measured, self.chosen, self.law = cut, measured, chosen, law
        self.force_law = force_law_of(pf, law.factors[0].symbol, chosen.force_law)
        self.tested = tested_feeds(pf, self.force_law)
        self.values: dict[str, Any] = {}
        self.sources: dict[str, str] = {}
        self.remarks: list[str] = []
        self.notes: list[str] = []
        self.inverse = inverse_force(law, cut.roughness, chosen.level)
        self.regression, self.no_regression = self._regression()

    def put(self, name: str, value: object, source: str) -> None:
        self.values[name], self.sources[name] = value, source

    def note(self, words: str) -> None:
        self.remarks.append(words)
        self.notes.append(words)

    def beyond(self, words: str, remedy: str, kind: str = "EXTRAPOLATED") -> None:
        """Refuse what the tests do not cover, or record it with the reason that accepts it."""
        if not self.chosen.beyond_tests:
            raise UsageError(f"{words} {remedy}, or accept it with --beyond-tests and a reason.")
        self.note(f"{kind}: {words} Accepted: {self.chosen.beyond_tests}.")

    def _regression(self) -> tuple[float | None, str]:
        try:
            constant, slope = self.chosen.regression or regression_of_law(self.law)
        except ParameterError as error:
            return None, str(error)
        force = constant + slope * math.log(self.cut.roughness)
        if not force > 0:
            return None, f"the regression of force on ln Ra gives {force:.4g} N at {self.cut.roughness:g} um."
        own = f"least squares over the {self.law.n} tests of {self.law.equation}, from the covariance of the law"
        self.put("regression", {"constant": constant, "slope": slope}, self.chosen.regression_of or own)
        return force, ""

    def reference(self) -> None:
        """Required roughness, and the reference force by the reading that was chosen."""
        cut, reading, law = self.cut, self.chosen.force_from, self.law
        self.put("roughness", cut.roughness, "given")
        if reading == "inverse":
            force, source = self.inverse.value, f"inverse of {law.equation} at {cut.roughness:g} um"
        elif self.regression is not None:
            force, source = self.regression, f"regression of force on ln Ra at {cut.roughness:g} um"
        else:
            raise UsageError(f"--force-from regression: {self.no_regression}")
        self.put("force", force, source)
        self.values["force_from"] = reading
        factor = law.factors[0]
        tests = f"tests of {law.response}, {factor.low:.4g} to {factor.high:.4g} N"
        if force > factor.high * NEARLY:
            self.beyond(f"The reference force {force:.4g} N lies above the {tests}.", "Ask for a finer surface")
        elif force < factor.low / NEARLY:
            self.note(f"EXTRAPOLATED: the reference force {force:.4g} N lies below the {tests}.")
        if self.inverse.undetermined:
            words = f"The reference force is {force:.4g} N; {self.inverse.interval}."
            self.beyond(words, f"Fit the law to more tests over a wider range of {factor.symbol}", "NOT DETERMINED")

    def cutting(self) -> None:
        """Spindle speed, depth, nose radius, programmed feed, and kc a at it."""
        cut = self.cut
        for name in ("spindle_speed", "depth", "nose_radius", "chip_thickness"):
            if (value := getattr(cut, name)) is not None:
                self.put(name, value, "given")
        self.put("feed", *((cut.feed, "given") if cut.feed is not None else self._feed_of_force()))
        self.put("force_per_feed", *self._force_per_feed(self.values["feed"]))
        recorded, used = self.measured.force_per_feed, self.values["force_per_feed"]
        check_plausible(used, cut.depth)
        if words := gain_off_law(cut, self.force_law, used, self.values["feed"]):
            self.beyond(words, "Correct the value or its unit, or leave it out to use the law")
        if recorded is not None and recorded != used:
            words = f"The record gives kc a {recorded:.4g} N per mm/rev, {recorded / used:.3g} times the one used."
            self.remarks.append(words)

    def force(self, feed: float) -> float:
        """Force at a feed, N, by the force law, or by kc a where there is none."""
        if self.force_law is None or self.cut.force_per_feed is not None or self.cut.kc is not None:
            return float(self.values["force_per_feed"]) * feed
        return force_at(self.force_law, feed, self.cut.depth, self.cut.conditions)

    def _feed_of_force(self) -> tuple[float, str]:
        law = self.force_law
        if law is None or self.tested is None:
            raise UsageError("the programmed feed is missing, and no force law of the file gives it; add f=0.2mm/rev.")
        feed = feed_of_force(law, self.values["force"], self.tested, self.cut.depth, self.cut.conditions)
        return feed, f"feed of the reference force by {law.equation}, rounded down to 0.001 mm/rev"

    def _force_per_feed(self, feed: float) -> tuple[float, str]:
        """Gain kc a, N per mm/rev: given, of the force law, or of a record."""
        cut, law, recorded = self.cut, self.force_law, self.measured.force_per_feed
        if cut.force_per_feed is not None:
            return cut.force_per_feed, "given"
        if cut.kc is not None:
            if cut.depth is None:
                raise UsageError(f"kc={cut.kc:g}N/mm2: kc a is kc times the depth of cut; add d=1mm.")
            return cut.kc * cut.depth, f"kc {cut.kc:g} N/mm2, given, times the depth {cut.depth:g} mm"
        if law is not None:
            held = {"f": feed, **({} if cut.depth is None else {"d": cut.depth}), **cut.conditions}
            gain = self.force(feed) / feed
            at = ", ".join(f"{one.symbol} {held[one.symbol]:g} {one.unit}" for one in law.factors)
            for words in outside_tests(law, held):
                self.note(f"EXTRAPOLATED: {words}")
            return gain, f"F/f of {law.equation} at {at}"
        if recorded is not None:
            return recorded, self.measured.sources["force_per_feed"]
        symbol = self.law.factors[0].symbol
        raise UsageError(
            f"kc a is not known: the file has no law of {symbol} on feed. Fit one with --law '{symbol} ~ f, d', or "
            "give kc=2500N/mm2 and d=1mm, or a step of the feed with the force by --step."
        )

    def limits(self) -> None:
        """Override range: given, or from the tests; no feed beyond them without a reason, none that cannot cut."""
        cut, feed, tested = self.cut, self.values["feed"], self.tested
        formed, _ = largest_feed(cut.nose_radius, cut.depth)
        low, high = cut.override or self._tested_override(feed, formed)
        if cut.override is not None:
            self.put("override_low", low, "given")
            self.put("override_high", high, "given")
        check_plausible(override=(low, high))
        top = max(high, 1.0) * feed
        words = f"The largest feed {top:.4g} mm/rev"
        if impossible := large_feed(top, cut.roughness, cut.nose_radius, cut.depth, WIPER):
            raise UsageError(impossible)
        if tested is None:
            if high > BEYOND * NEARLY:
                untested = f"{words} is {high:.4g} times the programmed one, and no tests of feed are known."
                self.beyond(untested, f"Give an override of at most {100 * BEYOND:g} %")
        elif feed < tested[0] / NEARLY:
            self.note(
                f"EXTRAPOLATED: the programmed feed {feed:.4g} mm/rev lies below the tested ones, {tested[0]:g} up."
            )
        elif top > tested[1] * NEARLY:
            beyond = f"{words} lies above the tested ones, {tested[0]:g} to {tested[1]:g} mm/rev."
            if top > BEYOND * tested[1] * NEARLY:
                self.beyond(beyond, f"Stay within {BEYOND:g} times the tests")
            else:
                self.note(f"EXTRAPOLATED: {beyond}")
        if rough := large_feed(top, cut.roughness, cut.nose_radius, cut.depth, BEYOND):
            remedy = "Lower the feed or the override"
            self.beyond(rough.removesuffix(f" {remedy}."), remedy)

    def _tested_override(self, feed: float, formed: float) -> tuple[float, float]:
        """Override range of the tested feeds, at most 150 % and what the nose forms; its values are put."""
        low, high, of_low = FLOOR, OVERRIDE, f"{100 * FLOOR:g} % of the programmed feed, assumed"
        of_high = f"{100 * OVERRIDE:g} % of the programmed feed, assumed as in SURF"
        if self.tested is not None:
            tests = "tested feed over the programmed one"
            if self.tested[0] / feed > FLOOR:
                low, of_low = self.tested[0] / feed, f"smallest {tests}, {self.tested[0]:g} over {feed:g} mm/rev"
            if low > STIFF:
                low, of_low = STIFF, "below the tested feeds, so that a cut twice as stiff is held; assumed"
            if self.tested[1] / feed < high:
                high = max(self.tested[1] / feed, 1.0)
                of_high = f"largest {tests}, {self.tested[1]:g} over {feed:g} mm/rev"
        radius = self.cut.nose_radius
        marks = math.inf if radius is None else BEYOND * feed_of_ideal_roughness(self.cut.roughness, radius)
        if min(formed, marks) < high * feed and feed <= min(formed, marks):
            high = min(formed, marks) / feed
            of_high = f"largest feed by the nose radius, {high * feed:.4g} over {feed:g} mm/rev"
        self.put("override_low", float(f"{low:.12g}"), of_low)
        self.put("override_high", float(f"{high:.12g}"), of_high)
        return self.values["override_low"], self.values["override_high"]

    def threshold(self) -> None:
        """Force of a cut, and the valid readings."""
        cut, reference = self.cut, self.values["force"]
        low_feed = (self.values["override_low"] or FLOOR) * self.values["feed"]
        lowest = self.force(low_feed)
        highest = self.force(self.values["override_high"] * self.values["feed"])
        if not lowest < highest:
            raise UsageError(
                f"the force falls from {lowest:.4g} to {highest:.4g} N as the feed rises from its lower to its upper "
                "limit: no feed control can hold it; look at the force law."
            )
        if lowest > reference:
            words = f"At the lower feed limit the force is {lowest:.4g} N, above the reference {reference:.4g} N: the "
            self.note(f"{words}required roughness is not reached there.")
        if cut.threshold is not None:
            self.put("threshold", cut.threshold, "given")
        elif OF_LOWEST * lowest < OF_REFERENCE * reference:
            words = f"{100 * OF_LOWEST:g} % of the force at the lower feed limit, {lowest:.4g} N, assumed"
            self.put("threshold", _down(OF_LOWEST * lowest), words)
        else:
            self.put(
                "threshold", _down(OF_REFERENCE * reference), f"{100 * OF_REFERENCE:g} % of the reference, assumed"
            )
        if not 0.01 * reference <= self.values["threshold"] < reference:
            own = f"f={self.values['feed']:.4g}mm/rev gives {lowest:.4g} N at its lower limit: correct f or its unit; "
            raise UsageError(
                f"{own if cut.threshold is None else ''}threshold={self.values['threshold']:.4g}N is not above 1 % of "
                f"the reference force and below it, {reference:.4g} N; only there is a cut distinguished from noise in "
                "air and acted upon."
            )
        if self.values["threshold"] >= lowest:
            words = f"At the lower feed limit the force is {lowest:.4g} N, not above the threshold: the control takes "
            self.note(f"{words}the cut for air there; lower the threshold or raise the lower limit.")
        of_cut = min(lowest, self.values["force_per_feed"] * low_feed)
        margin = max(self.values["threshold"], min(0.1 * reference, of_cut))
        usual = -_down(margin), _down(LARGEST_READING * max(reference, highest))
        low, high = cut.valid or usual
        assumed = f"{LARGEST_READING:g} times the largest force expected, {max(reference, highest):.4g} N, assumed"
        given = cut.valid is not None
        check_readings(low, high, self.values["threshold"], reference, of_cut, given=given)
        self.put("force_low", low, "given" if given else "a drift of the zero below the threshold, assumed")
        self.put("force_high", high, "given" if given else assumed)

    def times(self) -> None:
        """Time constants, sample time and the wait above the threshold."""
        cut, measured = self.cut, self.measured
        for name, given in (("servo_time", cut.servo_time), ("process_time", cut.process_time)):
            recorded = getattr(measured, name)
            if given is not None:
                self.put(name, given, "given")
            elif recorded is not None:
                self.put(name, recorded, measured.sources[name])
        if "servo_time" not in self.values:
            raise UsageError("the time constant of the feed servo is missing; give servo=0.13s, or a record by --step.")
        if "process_time" not in self.values:
            self.put("process_time", cut.revolution, f"one revolution at {cut.spindle_speed:g} 1/min, assumed")
        servo, process = self.values["servo_time"], self.values["process_time"]
        check_plausible(times={"servo": servo, "process": process})
        shorter = min(servo, process)
        if cut.sample_time is not None:
            self.put("sample_time", cut.sample_time, "given")
        else:
            own = _down(shorter / 5)
            words = "a fifth of the shorter time constant" if own < SAMPLE else "as in SURF"
            self.put("sample_time", min(own, SAMPLE), f"{words}, assumed")
        if not self.values["sample_time"] <= SLOWEST_SAMPLE * shorter:
            raise UsageError(
                f"sample={self.values['sample_time']:g}s: the shorter time constant of servo and process is "
                f"{shorter:.4g} s, and the force must be sampled at least every {SLOWEST_SAMPLE * shorter:.3g} s."
            )
        if cut.wait is not None and cut.wait > LONGEST_WAIT:
            raise UsageError(f"wait={cut.wait:g}s: the cut is not controlled that long; {LONGEST_WAIT:g} s at most.")
        turns = REVOLUTIONS * cut.revolution, f"{REVOLUTIONS:g} revolutions, assumed"
        self.put("threshold_time", *(turns if cut.wait is None else (cut.wait, "given")))

    def finished(self) -> DerivedSettings:
        """The section with its sources; remarks on loop and geometry."""
        v, cut = self.values, self.cut
        loop = loop_theory(v["process_time"], v["servo_time"], v["sample_time"])
        self.remarks.append(
            f"Loop: damping {loop.damping:.2g}; force changes slower than {loop.crossover:.2g} Hz are attenuated, "
            f"faster ones amplified up to {loop.enlarged:.2g} times; largest sampled pole {loop.servo_radius:.3g}."
        )
        if cut.nose_radius is not None:
            self.remarks.append(ideal_marks(v["feed"], cut.nose_radius, cut.roughness))
        section = RoughnessSection(**v, sources=self.sources, notes=tuple(self.notes))
        laws = v["law"], *(() if self.force_law is None else (self.force_law.response,))
        return DerivedSettings(
            section, self.inverse, self.regression, self.no_regression, tuple(self.remarks), tuple(dict.fromkeys(laws))
        )


def _down(value: float) -> float:
    """A number rounded down to two digits.

    >>> _down(56.9), _down(0.01976)
    (56.0, 0.019)
    """
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / step + 1e-9) * step:.12g}")
