"""Constant roughness: the feed is corrected in proportion to reference over measured force, within limits.

    fc(t) = f(t-1) F_ref / F(t)        f(t-1): the feed that the servo has reached

Source: SURF, the feed law after Fig. 4 (its equation is missing in the copy used: a reconstruction from the text).

The supervision is that of constant load (`fitmodels.controllers.constant_load_milling.controller`), which the exports
carry: states, faults, overload, worn tool. Its override is the command over the upper limit of the feed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Final, Literal, Self

import numpy as np

from ...core.display import Displayable
from ...core.errors import ParameterError, UsageError
from ...datasets.units import convert
from ...parameters.exports.loop import BACK_OFF, OVERLOAD_SHARE, RECOVER, STUCK_AFTER, LoadLoop, monitoring
from ...parameters.file import require_unchanged
from ...parameters.messages import in_unit
from ...parameters.sections.load_line import not_applied_words
from ..constant_load_milling.controller import ConstantLoad
from .reference import law_of, reference_force, settings_of

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.sections.force_control import RoughnessSection

FLOOR = 0.1  # of the programmed feed: from feed 0 a multiplicative law cannot recover, and the edge would rub
LONGEST_WAIT = 60.0
WAIT = 0.3  # s above the threshold, where the file has no time
HYSTERESIS: Final = 0.25  # of the threshold, whole width: above a change of the force by 10 % either way
DRIFT: Final = 0.1  # of the reference, at least the threshold: a more negative force is no drift of the zero
HIGHEST: Final = 20.0  # times the reference: a larger force is that of a broken sensor
NEAR: Final = 1e-9  # of a limit: rounding
OVERLOAD: Final = 2.0  # times the reference that a tool withstands, where nothing is known of it


@dataclass(slots=True, repr=False)
class ConstantRoughness(Displayable):
    """The controller of SURF; its command is the feed, in mm/rev.

    From power-on the feed is at its lower limit. Once valid readings were below the threshold for ``wait``, the tool is
    known to be in air and the feed rises to the programmed one; it is held while the force is above the threshold for
    less than ``wait``, then the law acts. After a cut the feed keeps its last value, but at most the programmed one.
    Invalid readings are bridged by the last valid one; for 0.05 s, or more than a fifth of them, they latch a fault, as
    equal readings in the cut for ``stuck_after`` do: the feed goes to its lower limit until ``reset``. A sensor that
    reads 0 is indistinguishable from a tool in air.

    Attributes
    ----------
    references : tuple of (float, float)
        s from which each reference force holds, and the force in N; the first at 0.
    programmed, low, high : float
        Programmed feed and limits of the command, mm/rev.
    threshold, wait : float
        N, and s that the force stays above it before the law acts.
    sample_time, servo_time : float
        s; the controller carries a model of the servo, a lag of ``servo_time``.
    reading : str
        Meaning of f(t-1): the ``servo`` output, or the last ``command``, which is not stable (see `stability`).
    force_low, force_high : float or None
        N: a reading at or beyond these is invalid. None: minus the threshold or a tenth of the reference, and 20 times
        the reference.
    force_most : float or None
        N: a mean force above the limit of the file is an overload; at most 2.1 times the reference.
    stuck_after : float
        s; 0 for a simulated force without noise.
    labels : tuple of str
    control : ConstantLoad
        The supervision and its inputs (``enabled``, ``spindle_on``, ``idle``, ``beat``, ``reset``, ``requested``).
    command : float
        mm/rev.
    reference : float
        Set point of the force, N.
    news : tuple of str
        What changed in the last step: ``cut`` (the law acts), ``air``, ``at low``, ``at high``, ``free``,
        ``force unknown``, ``force known``, ``force lost``, ``force stuck``, ``overload``, ``reset``, ``change tool``,
        ``reference``.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> controller = ConstantRoughness.from_parameters(published("SURF")).approached()
    >>> feeds = [controller.step(600.0 + k % 2, 0.01) for k in range(40)]
    >>> round(feeds[0], 3), round(feeds[-1], 3), controller.acting
    (0.2, 0.176, True)
    """

    references: tuple[tuple[float, float], ...]
    programmed: float
    low: float
    high: float
    threshold: float
    wait: float
    sample_time: float
    servo_time: float
    reading: Literal["servo", "command"] = "servo"
    force_low: float | None = None
    force_high: float | None = None
    force_most: float | None = None
    stuck_after: float = STUCK_AFTER
    labels: tuple[str, str] = ("feed, mm/rev", "force, N")
    control: ConstantLoad = field(init=False, compare=False)
    command: float = field(default=0.0, init=False)
    reference: float = field(default=0.0, init=False)
    news: tuple[str, ...] = field(default=(), init=False)
    _samples: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self.control = ConstantLoad(self.loop, running=True)
        self.command, self.reference = self.low, self.references[0][1]

    @classmethod
    def from_parameters(
        cls,
        pf: "ParameterFile",
        *,
        schedule: Sequence[tuple[float, float]] = (),
        feed: Literal["servo", "command"] = "servo",
        stuck_after: float = STUCK_AFTER,
    ) -> Self:
        """Make the controller from the file alone.

        Parameters
        ----------
        pf : ParameterFile
            Its roughness section with feed, sample_time and servo_time, and the law.
        schedule : sequence of (float, float)
            Changes of the roughness along the run: s, and the roughness from then on.
        feed : {"servo", "command"}
            Meaning of f(t-1).
        stuck_after : float
            s.

        Raises
        ------
        ParameterError
            The file lacks a setting, or its limits exclude every feed, the spindle speed or the reference force.
        UsageError
            The schedule is not in order, or a roughness has no force.
        GateError
            The content of the file was changed after it was written.
        """
        require_unchanged(pf)
        section = settings_of(pf)
        programmed, sample_time, servo_time = (_needed(section, name) for name in ("feed", "sample_time", "servo_time"))
        low, high = feed_limits(pf)
        times = [0.0, *(time for time, _ in schedule)]
        if not all(before < after for before, after in pairwise(times)):
            raise UsageError(f"the schedule {list(schedule)}: give increasing times above 0.")
        references = ((0.0, reference_force(pf)), *((time, reference_force(pf, Ra)) for time, Ra in schedule))
        _require_spindle(pf)
        _require_allowed(pf, section.roughness, *(Ra for _, Ra in schedule))
        _require_reached(pf)
        return cls(
            references=references,
            programmed=programmed,
            low=low,
            high=high,
            threshold=_threshold(section),
            wait=_wait(section),
            sample_time=sample_time,
            servo_time=servo_time,
            reading=feed,
            force_low=section.force_low,
            force_high=section.force_high,
            force_most=_force_limit(pf, max(force for _, force in references)),
            stuck_after=stuck_after,
        )

    @property
    def loop(self) -> LoadLoop:
        """The settings as the supervision and the exports take them; the program commands the upper limit."""
        reference, span = self.references[0][1], (self.high - self.low) / self.high
        drift, largest = -max(self.threshold, DRIFT * reference), max(force for _, force in self.references)
        return LoadLoop(
            kp=0.0, ki=0.0, sample_time=self.sample_time, reference=reference,
            feed_low=self.low, feed_high=self.high, feed_programmed=self.high, unit_load="N", unit_feed="mm/rev",
            filter_time=0.0, engage_at=(1 - HYSTERESIS / 2) * self.threshold,
            hysteresis=HYSTERESIS * self.threshold, engage_after=self.wait,
            back_off=span / BACK_OFF, recover=span / RECOVER,
            load_low=drift if self.force_low is None else self.force_low,
            load_high=HIGHEST * largest if self.force_high is None else self.force_high,
            worn_load=self._withstood(largest), stuck_after=self.stuck_after, law="ratio",
            approach=min(max(self.programmed, self.low), self.high) / self.high,
            servo_time=self.servo_time if self.reading == "servo" else 0.0,
        )  # fmt: skip

    def _withstood(self, largest: float) -> float:
        """Force that a tool withstands, N: an overload is 1.05 times it."""
        assumed = OVERLOAD * largest
        return assumed if self.force_most is None else min(assumed, self.force_most / OVERLOAD_SHARE)

    @property
    def acting(self) -> bool:
        """Whether the law is in force."""
        return self.control.cutting

    @property
    def override(self) -> float:
        """Command over programmed feed."""
        return self.command / self.programmed

    def approached(self) -> Self:
        """The controller after it has run in air until its feed came to rest; times count from then."""
        last = -1.0
        for _ in range(self.control.loop.samples(self.wait + RECOVER) + 2):
            last = self.control.step(0.0, self.sample_time)
        self.command = last * self.high
        return self

    def step(self, measurement: float, dt: float) -> float:
        """Feed command for a force.

        Raises
        ------
        UsageError
            ``dt`` is not the period of the file.
        """
        if not abs(dt - self.sample_time) <= 1e-9 * self.sample_time:  # true for NaN too
            own = f"the file samples the force every {self.sample_time:g} s"
            raise UsageError(f"a step of {dt:g} s: {own}; replay it at that.")
        before, now = self.reference, self._samples * dt + 1e-9
        self.reference = next(force for start, force in reversed(self.references) if start <= now)
        self._samples += 1
        self.control.reference = self.reference
        self.command = min(self.control.step(measurement, self.sample_time) * self.high, self.high)
        news = tuple(words.replace("load ", "force ") for words in self.control.news)
        self.news = news if self.reference == before else (*news, "reference")
        return self.command


def assumed_settings(pf: "ParameterFile") -> tuple[str, ...]:
    """The settings of the supervision that the file does not hold, each with the value that is assumed."""
    section, control = settings_of(pf), ConstantRoughness.from_parameters(pf)
    loop, assumed = control.loop, []
    if section.threshold_time is None:
        assumed.append(f"threshold_time {WAIT:g} s")
    if section.force_low is None:
        assumed.append(f"force_low {loop.load_low:.4g} N, minus the threshold or a tenth of the reference")
    if section.force_high is None:
        assumed.append(f"force_high {loop.load_high:.4g} N, {HIGHEST:g} times the reference")
    limited = loop.worn_load < OVERLOAD * max(force for _, force in control.references)
    unknown = f"1.05 times {OVERLOAD:g} times the reference: the file holds no force that the tool withstands"
    why = "the limit of force in the file" if limited else unknown
    return (
        *assumed,
        f"override 1 is the upper limit, {control.high:.4g} mm/rev: the program commands that F, or the control reads "
        "the requested feed",
        f"overload above {loop.overload_at:.4g} N, {why}",
        f"hysteresis {loop.hysteresis:.4g} N: a cut begins at the threshold and ends that much below it",
        f"feed out of the cut down by {loop.back_off:.4g} and up by {loop.recover:.4g} of the upper limit per s",
        *monitoring(loop),
    )


def _force_limit(pf: "ParameterFile", largest: float) -> float | None:
    """The limit of the controlled force, N, above the largest reference; None without one."""
    limits, symbol = pf.limits, pf.laws[settings_of(pf).law].factors[0].symbol
    if limits is None:
        return None
    _, most = limits.response_range(symbol, "N")
    if limits.force is not None and limits.force.of is None:
        most = min(most, float(convert(np.array([limits.force.value]), limits.force.unit, "N")[0]))
    if not math.isfinite(most):
        return None
    if most <= largest:
        raise ParameterError(
            f"limits.force: {symbol} at most {most:.4g} N, but the reference force is {largest:.4g} N; require a finer "
            "surface, or raise the limit."
        )
    return most


def _require_spindle(pf: "ParameterFile") -> None:
    """Refuse a spindle speed beyond the limits of the file."""
    n, limit = settings_of(pf).spindle_speed, None if pf.limits is None else pf.limits.spindle_speed
    if n is None or limit is None:
        return
    low, high = convert(np.array([limit.low, limit.high]), limit.unit, "1/min")
    if not low * (1 - NEAR) <= n <= high * (1 + NEAR):
        raise ParameterError(
            f"Spindle speed {n:g} 1/min: the limits of the file are {low:g} to {high:g} 1/min; give n within them."
        )


def _threshold(section: "RoughnessSection") -> float:
    if not (section.threshold > 0 and section.threshold < section.force):
        raise ParameterError(
            f"roughness.threshold {section.threshold:g} N: a cut is distinguished from air by a force above zero and "
            f"below the reference of {section.force:.4g} N; give such a threshold."
        )
    return section.threshold


def feed_limits(pf: "ParameterFile") -> tuple[float, float]:
    """Lowest and highest feed that the controller commands, mm/rev.

    High: the override's, the machine's (feed, and feed rate at the spindle speed), and the chip-thickness limit,
    whichever is least; the chip is taken as thick as the feed, as at a cutting-edge angle of 90 degrees, and at any
    other it is thinner. Low: the override's and the
    machine's, or a tenth of the programmed feed where both are 0, as in the paper.

    Raises
    ------
    ParameterError
        They leave no range, or the machine's are in another unit.
    """
    section = settings_of(pf)
    programmed = _needed(section, "feed")
    lows, highs = [section.override_low * programmed], [section.override_high * programmed]
    if section.chip_thickness is not None:
        highs.append(section.chip_thickness)
    machine_low, machine_high = _machine_feeds(pf)
    low, high = max(*lows, machine_low) or FLOOR * programmed, min(*highs, machine_high)
    if not low < high:
        raise ParameterError(f"Feeds from {low:g} to {high:g} mm/rev are an empty range; widen the limits of feed.")
    return low, high


def _machine_feeds(pf: "ParameterFile") -> tuple[float, float]:
    """Feeds that the limits of feed and feed rate of the file allow, mm/rev."""
    section, limits = settings_of(pf), pf.limits
    if limits is None:
        return 0.0, math.inf
    if limits.feed is not None and in_unit(1.0, limits.feed.unit, section.unit_feed) is None:
        raise ParameterError(f"limits.feed is in {limits.feed.unit[:20]}; write it in {section.unit_feed}.")
    found = limits.feed_range(section.unit_feed, section.spindle_speed)
    if found is None:
        raise ParameterError(
            f"limits.feed_rate cannot be compared with feeds in {section.unit_feed} without the spindle speed; give it "
            "with `fitmodels roughness ... n=610rpm --force`."
        )
    return found


def _require_allowed(pf: "ParameterFile", *required: float) -> None:
    """Refuse a required roughness, um, outside the limits of the file."""
    law = settings_of(pf).law
    low, high = (0.0, math.inf) if pf.limits is None else pf.limits.response_range(law, "um")
    for Ra in required:
        if not low * (1 - NEAR) <= Ra <= high * (1 + NEAR):
            most = f"at most {high:g}" if Ra > high else f"at least {low:g}"
            raise ParameterError(
                f"limits.responses.{law[:40]}: {most} um, but a roughness of {Ra:g} um is required; require one within "
                "the limit, or change the limit."
            )


def _require_reached(pf: "ParameterFile") -> None:
    """Refuse limits of feed that exclude the feed of the reference force."""
    section, (low, high) = settings_of(pf), _machine_feeds(pf)
    if section.force_per_feed is None:
        return
    needed = section.force / section.force_per_feed
    if not low < needed < high:
        raise ParameterError(
            f"The limits of feed of the file leave {low:.4g} to {high:.4g} mm/rev, and the reference of "
            f"{section.force:.4g} N needs {needed:.4g} mm/rev; require another roughness, or change limits.feed or "
            "limits.feed_rate."
        )


def not_applied(pf: "ParameterFile") -> tuple[str, ...]:
    """A sentence on the limits of the file that the roughness control does not apply; none where it applies all."""
    law = law_of(pf)
    force, limits = law.factors[0].symbol, pf.limits
    if limits is None:
        return ()
    used = ["feed", "feed_rate", "spindle_speed", *limits.names_of(law.response), *limits.names_of(force)]
    used += ["force"] if limits.force is not None and limits.force.of is None else []
    return not_applied_words(limits, "The roughness control", *used)


def _wait(section: "RoughnessSection") -> float:
    """Time above the threshold before the control begins, s."""
    wait = WAIT if section.threshold_time is None else section.threshold_time
    if wait > LONGEST_WAIT:
        raise ParameterError(
            f"roughness: threshold_time {wait:g} s is above {LONGEST_WAIT:g} s: the cut would not be controlled. Give "
            "about three revolutions."
        )
    return wait


def _needed(section: "RoughnessSection", name: str) -> float:
    value: float | None = getattr(section, name)
    if value is None:
        raise ParameterError(f"The roughness section has no {name}; add it for the controller.")
    return value
