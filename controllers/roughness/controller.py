"""Constant roughness: the feed is corrected in proportion to reference over measured force, within limits.

    fc(t) = f(t-1) F_ref / F(t)        f(t-1): the feed that the servo has reached

Source: SURF, the feed law after Fig. 4 (its equation is missing in the copy used: a reconstruction from the text).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, Self

from ...core.display import Displayable
from ...core.errors import ParameterError, UsageError
from ..sensor_check import KNOWN, SensorCheck
from .reference import reference_force, settings_of

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.sections.force_control import RoughnessSection

FLOOR = 0.1  # of the programmed feed: from feed 0 a multiplicative law cannot recover, and the edge would rub
WAIT = 0.3  # s above the threshold, where the file has no time
# of the programmed feed, in 25 equal readings: then the sensor is stuck. Stuck within 0.1 % of the reference it moves
# the feed by less, below 1 % a second, and is seen when that has come to ten times as much.
LEAST_MOVE = 0.0025


@dataclass(slots=True, repr=False)
class ConstantRoughness(Displayable):
    """The controller of SURF; its command is the feed, in mm/rev.

    The law is active while the force reading is valid and has been above ``threshold`` for ``wait``. Below the
    threshold and during the wait the feed is the programmed one, so it does not diverge as the force falls to zero.
    While a reading is invalid (NaN, wrong sign, stuck) the command is held, but not above the programmed feed. It
    always lies between ``low`` and ``high``. A sensor that reads 0 is indistinguishable from a tool in air: the feed is
    then the programmed one.

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
    command : float
        mm/rev.
    reference : float
        Set point of the force, N.
    acting : bool
        Whether the law is in force.
    news : tuple of str
        What changed in the last step: ``cut`` (the law acts), ``air`` (the force is below the threshold), ``idle``
        (the reading is not valid), ``at low``, ``at high``, ``free``, ``force unknown``, ``force stuck``,
        ``force known``, ``reference``.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> controller = ConstantRoughness.from_parameters(published("SURF"))
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
    labels: tuple[str, str] = ("feed, mm/rev", "force, N")
    command: float = field(default=0.0, init=False)
    reference: float = field(default=0.0, init=False)
    acting: bool = field(default=False, init=False)
    news: tuple[str, ...] = field(default=(), init=False)
    _sensing: SensorCheck = field(init=False)
    _servo: float = field(default=0.0, init=False)
    _share: float = field(default=1.0, init=False)
    _needed: int = field(default=1, init=False)
    _above: int = field(default=0, init=False)
    _limited: int = field(default=0, init=False)
    _samples: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self.command = self._servo = min(self.programmed, self.high)
        self.reference = self.references[0][1]
        self._share = -math.expm1(-self.sample_time / self.servo_time) if self.servo_time else 1.0
        self._needed = max(math.ceil(self.wait / self.sample_time - 1e-9), 1)
        below = -max(self.threshold, 0.1 * self.reference)  # a drifting zero is air, a negative cutting force is none
        self._sensing = SensorCheck(below, math.inf, LEAST_MOVE * self.programmed)

    @classmethod
    def from_parameters(
        cls,
        pf: "ParameterFile",
        *,
        schedule: Sequence[tuple[float, float]] = (),
        feed: Literal["servo", "command"] = "servo",
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

        Raises
        ------
        ParameterError
            The file lacks a setting, or its limits exclude every feed.
        UsageError
            The schedule is not in order, or a roughness has no force.
        """
        section = settings_of(pf)
        programmed, sample_time, servo_time = (_needed(section, name) for name in ("feed", "sample_time", "servo_time"))
        low, high = feed_limits(pf)
        times = [0.0, *(time for time, _ in schedule)]
        if not all(before < after for before, after in pairwise(times)):
            raise UsageError(f"the schedule {list(schedule)}: give increasing times above 0.")
        changes = ((time, reference_force(pf, Ra)) for time, Ra in schedule)
        return cls(
            references=((0.0, reference_force(pf)), *changes),
            programmed=programmed,
            low=low,
            high=high,
            threshold=section.threshold,
            wait=WAIT if section.threshold_time is None else section.threshold_time,
            sample_time=sample_time,
            servo_time=servo_time,
            reading=feed,
        )

    @property
    def override(self) -> float:
        """Command over programmed feed."""
        return self.command / self.programmed

    def step(self, measurement: float, dt: float) -> float:
        """Feed command for a force.

        Raises
        ------
        UsageError
            ``dt`` is not the period of the file.
        """
        if abs(dt - self.sample_time) > 1e-9 * dt:
            own = f"the file samples the force every {self.sample_time:g} s"
            raise UsageError(f"a step of {dt:g} s: {own}; replay it at that.")
        before = self._sensing.state, self.acting, self._limited, self.reference
        self._servo += (self.command - self._servo) * self._share
        valid = self._sensing.valid(measurement, self.command)
        self._above = self._above + 1 if valid and measurement > self.threshold else 0
        self.acting = self._above >= self._needed
        self._update_reference(dt)
        if self.acting:
            last = self._servo if self.reading == "servo" else self.command
            self._limit(last * self.reference / float(measurement))
        else:
            idle = min(self.programmed, self.high)
            self.command, self._limited = idle if valid else min(self.command, idle), 0
        now = self._sensing.state, self.acting, self._limited, self.reference
        self.news = () if now == before else _changes(before, now)
        return self.command

    def _update_reference(self, dt: float) -> None:
        now = self._samples * dt + 1e-9
        self.reference = next(force for start, force in reversed(self.references) if start <= now)
        self._samples += 1

    def _limit(self, wanted: float) -> None:
        self._limited = int(wanted > self.high) - int(wanted < self.low)
        self.command = min(max(wanted, self.low), self.high)


def feed_limits(pf: "ParameterFile") -> tuple[float, float]:
    """Lowest and highest feed that the controller commands, mm/rev.

    High: the override's, the machine's, and the chip-thickness limit, whichever is least; the chip is taken as thick as
    the feed, as at a cutting-edge angle of 90 degrees, and at any other it is thinner. Low: the override's and the
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
    machine = None if pf.limits is None else pf.limits.feed
    if machine is not None:
        if machine.unit != section.unit_feed:
            raise ParameterError(f"limits.feed is in {machine.unit[:20]}; write it in {section.unit_feed}.")
        lows.append(machine.low)
        highs.append(machine.high)
    low, high = max(lows) or FLOOR * programmed, min(highs)
    if not low < high:
        raise ParameterError(f"Feeds from {low:g} to {high:g} mm/rev are an empty range; widen the limits of feed.")
    return low, high


def _needed(section: "RoughnessSection", name: str) -> float:
    value: float | None = getattr(section, name)
    if value is None:
        raise ParameterError(f"The roughness section has no {name}; add it for the controller.")
    return value


State = tuple[str, bool, int, float]


def _changes(before: State, now: State) -> tuple[str, ...]:
    news = []
    if before[0] != now[0]:
        news.append(f"force {now[0]}")
    if before[1] != now[1]:
        news.append("cut" if now[1] else "air" if now[0] == KNOWN else "idle")
    if before[2] != now[2]:
        news.append(("free", "at high", "at low")[now[2]])  # the third by index -1
    if before[3] != now[3]:
        news.append("reference")
    return tuple(news)
