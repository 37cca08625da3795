"""Constant load: a PI on spindle load sets the feed override inside the cut, and fails to the lower feed limit.

Source: Tai, Tsai & Li 2023, IEEE Access, doi 10.1109/ACCESS.2023.3330587. The arithmetic is that of the exports, sample
by sample: HAL, structured text and C equal it. Its states are those of `states.STATES`.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self

from ...core.display import Displayable
from ...core.errors import UsageError
from .control_laws import AdaptiveLaw, IncrementalLaw, PositionLaw, RatioLaw, law_of_loop, low_pass_gain
from .states import State

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.exports.loop import LoadLoop

REST_SHARE: Final = 0.01  # of the range of the feed, at most of its lower limit: a mean command so near rests on it
SPARSE_RISE, SPARSE_AT, SPARSE_MOST = 4, 8, 10  # count of an invalid reading; lost, and end of the count, by lost_after
SLOW_AFTER: Final = 0.5  # s after a feed that was slowed from outside: the load has followed it
WORN_MEAN: Final = 0.2  # s, time constant of the mean command
OVERLOAD_MEAN: Final = 0.1  # s, time constant of the mean load: the mean delay of a mean over 0.2 s
PERIOD: Final = 0.01  # relative deviation of the period that the gains and filters allow


@dataclass(slots=True, repr=False)
class ConstantLoad(Displayable):
    """The controller of CLM-2023; its command is the feed override, feed over programmed feed.

    Armed, with the spindle running, it monitors the load: invalid readings, equal readings in the cut, a heartbeat that
    stops and an overload latch a fault, which takes the feed to its lower limit until ``reset``. The same supervision
    runs constant roughness and adaptive force control, by the ``law`` of the loop: before a cut their feed is the lower
    limit, and ``approach`` once air is known; after it the last one, at most ``approach``.

    Attributes
    ----------
    loop : LoadLoop
        Gains, limits and settings; see `fitmodels.parameters.exports.loop.LoadLoop`.
    running : bool
        The spindle has run for ``arm_after`` before the first sample.
    enabled, spindle_on, idle, reset, slowed : bool
        Inputs: the operator's switch; the spindle turns; the path does not advance, also in a pause; the operator's
        acknowledgement, at its edge; the operator's override is below 1, or the path is slower than commanded: no rise.
    beat : bool or None
        Input: heartbeat of the load's source; None: it lives.
    requested : float or None
        Input: feed that the program requests, times an operator's override above 1, unit_feed; None: the programmed
        feed of the file. In a fault it only reduces the command. Where it is below the loop's feed, this does not rise.
    command : float
        The last command; before the first one the lower limit.
    state : State
    fault, worn, overload : bool
        Latched until reset.
    feed_inhibit : bool
        The feed is to be stopped.
    cutting : bool
        Whether the loop is closed.
    rest : float
        A mean command at or below rests on the lower limit.
    news : tuple of str
        What changed in the last step: ``cut``, ``air``, ``at low``, ``at high``, ``free``, ``load unknown``,
        ``load known``, ``load lost``, ``load stuck``, ``no heartbeat``, ``feed unknown``, ``overload``, ``reset``,
        ``change tool``.

    Examples
    --------
    >>> from fitmodels.parameters.exports.loop import LoadLoop
    >>> loop = LoadLoop(
    ...     kp=0.0, ki=8000.0, sample_time=0.02, reference=0.24, feed_low=600.0, feed_high=1000.0,
    ...     feed_programmed=1000.0, unit_load="A", unit_feed="mm/min", filter_time=0.0, engage_at=0.15,
    ...     hysteresis=0.02, engage_after=0.04, back_off=1.0, recover=0.5, load_low=0.05, load_high=1.0,
    ...     worn_load=0.28)
    >>> controller = ConstantLoad(loop, running=True)
    >>> [round(controller.step(0.2, 0.02), 3) for _ in range(4)]
    [0.6, 0.606, 0.613, 0.619]
    >>> controller.step(float("nan"), 0.02) >= 0.6, controller.state.name
    (True, 'CONTROL')
    """

    loop: "LoadLoop"
    running: bool = False
    enabled: bool = True
    spindle_on: bool = True
    idle: bool = False
    reset: bool = False
    slowed: bool = False
    beat: bool | None = None
    requested: float | None = None
    command: float = field(init=False)
    state: State = field(default=State.OFF, init=False)
    fault: bool = field(default=False, init=False)
    worn: bool = field(default=False, init=False)
    overload: bool = field(default=False, init=False)
    cutting: bool = field(default=False, init=False)
    news: tuple[str, ...] = field(default=(), init=False)
    labels: tuple[str, str] = field(init=False)
    reference: float = field(init=False)
    rest: float = field(init=False)
    _law: PositionLaw | IncrementalLaw | RatioLaw | AdaptiveLaw = field(init=False)
    _u: float | None = field(default=None, init=False)
    _factor: float = field(default=1.0, init=False)
    _held: float = field(default=0.0, init=False)
    _filtered: float = field(default=0.0, init=False)
    _measured: float = field(default=0.0, init=False)
    _mean: float = field(default=0.0, init=False)
    _average: float = field(default=0.0, init=False)
    _over: bool = field(default=False, init=False)
    _above: bool = field(default=False, init=False)
    _armed: bool = field(default=False, init=False)
    _engaged: bool = field(default=False, init=False)
    _loaded: bool = field(default=False, init=False)
    _had_cut: bool = field(default=False, init=False)
    _before: float = field(default=0.0, init=False)
    _gap: int = field(default=0, init=False)  # samples for which the revolution holds a bridged reading
    _gaps: int = field(default=0, init=False)  # samples since the first of them
    _base: float = field(default=0.0, init=False)  # override before the first of equal readings
    _falling: bool = field(default=False, init=False)
    _capped: bool = field(default=False, init=False)  # the program requests less than the loop
    _slow: int = field(default=0, init=False)  # samples without a rise, as the load is that of a slowed feed
    _last_reset: bool = field(default=False, init=False)
    _last_beat: bool | None = field(default=None, init=False)
    _limited: int = field(default=0, init=False)
    _bad: int = field(default=0, init=False)
    _sparse: int = field(default=0, init=False)
    _clear_for: int = field(default=0, init=False)
    _spindle: int = field(default=0, init=False)
    _loaded_for: int = field(default=0, init=False)
    _same: int = field(default=0, init=False)
    _alive: int = field(default=0, init=False)
    _high_for: int = field(default=0, init=False)
    _rested: int = field(default=0, init=False)
    _loads: deque[float] = field(init=False)
    _targets: deque[float] = field(init=False)
    _n: dict[str, int] = field(init=False)
    _gains: tuple[float, float, float] = field(init=False)
    _bounds: tuple[float, float, float, float] = field(init=False)
    _threshold: tuple[float, float] = field(init=False)
    _overload_at: float = field(init=False)

    def __post_init__(self) -> None:
        loop = self.loop
        self._law = law_of_loop(loop)
        self.command, self.reference = loop.low, loop.reference
        self.labels = ("feed override", f"load, {loop.unit_load}")
        times = ("arm_after", "lost_after", "engage_after", "stuck_after", "heartbeat", "overload_after", "dwell")
        self._n = {name: loop.samples(getattr(loop, name)) for name in times} | {"slow": loop.samples(SLOW_AFTER)}
        load, mean, rest = (low_pass_gain(loop, time) for time in (loop.filter_time, OVERLOAD_MEAN, WORN_MEAN))
        self._gains = (load, mean, rest)
        self._threshold = (loop.engage_at, loop.hysteresis / 2)
        self._bounds = (loop.low, loop.high, loop.back_off * loop.sample_time, loop.recover * loop.sample_time)
        self.rest = loop.low + REST_SHARE * min(loop.high - loop.low, loop.low)
        self._overload_at = loop.overload_at
        average = {name: loop.average if loop.average_of == name else 1 for name in ("measurement", "command")}
        self._loads = deque([0.0] * average["measurement"], average["measurement"])
        self._targets = deque([0.0] * average["command"], average["command"])
        self._spindle = self._n["arm_after"] if self.running else 0

    @classmethod
    def from_parameters(cls, pf: "ParameterFile", *, running: bool = False) -> Self:
        """Make the controller from the file alone.

        Raises
        ------
        GateError
            The file has no gains or no settings of the loop, or its gains fail the check.
        """
        from .control_laws import loop_of

        return cls(loop_of(pf), running=running)

    @property
    def law(self) -> PositionLaw | IncrementalLaw | RatioLaw | AdaptiveLaw:
        """The control law, with its state."""
        return self._law

    @property
    def feed_inhibit(self) -> bool:
        """Whether the feed is to be stopped."""
        return self.overload or (self.fault and self.loop.stop_on_fault)

    def step(self, measurement: float, dt: float) -> float:
        """Feed override for a load.

        Raises
        ------
        UsageError
            ``dt`` is not the period that the gains and the filter were made for.
        """
        loop, load = self.loop, float(measurement)  # NumPy bools do not support subtraction
        if dt != loop.sample_time and not abs(dt - loop.sample_time) <= PERIOD * loop.sample_time:  # true for NaN too
            raise UsageError(f"a step of {dt:g} s: the loop was made for {loop.sample_time:g} s; replay it at that.")
        self.news = ()
        equal = self._read(load)
        self._engage()
        self._watch(equal)
        self._slow = self._n["slow"] if self.slowed or self._capped else max(self._slow - 1, 0)
        if isinstance(self._law, RatioLaw | AdaptiveLaw):
            u = loop.low if self._u is None else self._u
            self._law.track(u, self._held, self.reference, closed=self.cutting)
        target = self._target(load)
        u = self._limit(target)
        self._rests(u)
        if self.requested:
            self._factor = loop.feed_programmed / self.requested if self._requested_valid() else self._factor
        self.state = self._state()
        # In a fault a smaller requested feed does not raise the output, which a wrong unit of it would.
        factor = min(self._factor, 1.0) if self.state == State.FAULT else self._factor
        self._capped, self.command = u * factor > 1.0, min(u * factor, 1.0)
        return self.command

    def _read(self, load: float) -> bool:
        """Hold the last valid reading and filter it; whether it equals the one before."""
        if self.loop.load_low < load < self.loop.load_high:  # false for NaN
            if self._bad:
                self.news += ("load known",)
            self._bad = 0
        else:
            if not self._bad:
                self.news += ("load unknown",)
            self._bad += 1
        self._spindle = self._spindle + 1 if self.spindle_on else 0
        self._armed = self.enabled and self._spindle >= self._n["arm_after"]
        self._sparse = self._count_invalid() if self._armed else 0
        previous = self._held
        if not self._bad:
            self._held = load
        elif not self._armed:
            self._held = 0.0
        self._filtered += (self._held - self._filtered) * self._gains[0]
        self._measured = self._filtered
        if len(self._loads) > 1:
            self._loads.append(self._filtered)
            self._measured = sum(self._loads) / len(self._loads)
        self._mean += (self._held - self._mean) * self._gains[1]
        return self._held == previous

    def _count_invalid(self) -> int:
        """Count that rises where more than a fifth of the readings are invalid."""
        if not self._bad:
            return max(self._sparse - 1, 0)
        return min(self._sparse + SPARSE_RISE, SPARSE_MOST * self._n["lost_after"])

    def _engage(self) -> None:
        """Engage by the filtered load after a delay; disengage at once by the reading, or by that of a revolution."""
        at, half = self._threshold
        filtered, held = self._measured - at, self._held - at
        self._over = filtered > half or (self._over and filtered >= -half)
        self._above = held > half or (self._above and held >= -half)
        self._engaged = self._armed and self._over and (self._above or self.loop.law == "adaptive")
        self._loaded_for = self._loaded_for + 1 if self._engaged else 0
        self._loaded = self._loaded_for >= self._n["engage_after"]
        self._clear_for = 0 if self._bad or self._over or self._above else self._clear_for + 1

    def _watch(self, equal: bool) -> None:
        """Latch a fault and an overload; a reset clears each whose cause is gone."""
        cleared = self.reset and not self._last_reset
        self._last_reset = self.reset
        cause = self._cause(equal)
        if cause and not self.fault:
            self.news += (cause,)
        elif cleared and (self.fault or self.overload or self.worn):
            self.news += ("reset",)
        self.fault = bool(cause) or (self.fault and not cleared)
        self._high_for = self._high_for + 1 if self._armed and self._mean > self._overload_at else 0
        exceeded = self._high_for >= self._n["overload_after"]
        if exceeded and not self.overload:
            self.news += ("overload",)
        self.overload = exceeded or (self.overload and not cleared)
        if cleared:
            self.worn, self._rested = False, 0
            if self.loop.law != "pi" and not (self.fault or self.overload):
                self._had_cut = False

    def _cause(self, equal: bool) -> str:
        """Cause of a fault that is present, or nothing."""
        loop, n = self.loop, self._n
        self._same = self._same + 1 if self._loaded and not self.idle and equal else 0
        beat = self.beat
        if beat is None or (self._last_beat is not None and beat != self._last_beat):
            self._alive = n["heartbeat"]
        else:
            self._alive = max(self._alive - 1, 0)
        self._last_beat = beat
        if not self._armed:
            return ""
        if self._bad >= n["lost_after"] or self._sparse >= SPARSE_AT * n["lost_after"]:
            return "load lost"
        if loop.stuck_after and self._same >= n["stuck_after"]:
            return "load stuck"
        if loop.heartbeat and not self._alive:
            return "no heartbeat"
        return "" if self._requested_valid() else "feed unknown"

    def _requested_valid(self) -> bool:
        return self.requested is None or 0.0 <= self.requested < math.inf

    def _target(self, load: float) -> float:
        """Override that the state asks for, before limits and rates."""
        cutting = self._loaded and not (self.fault or self.overload or self.idle)
        u = self.loop.low if self._u is None else self._u
        if cutting != self.cutting:
            self.news += ("cut" if cutting else "air",)
        if cutting:
            self._had_cut = True
        elif not self._armed and self.idle and load - self._threshold[0] < -self._threshold[1]:  # false for NaN
            self._had_cut = False
        if cutting:
            target = self._control(u, begins=not self.cutting)
            target = min(target, u) if self._slow else target
        elif self.fault or self.overload or (self.enabled and not self._armed):
            target = self.loop.low
        elif self.loop.law != "pi":
            approach = self.loop.approach
            known = self._clear_for >= self._n["engage_after"]
            target = min(u, approach) if self._had_cut else approach if known else u
        elif self._had_cut:
            target = u
        else:
            target = self.loop.low if self.enabled else 1.0
        self.cutting = cutting
        return target

    def _control(self, u: float, *, begins: bool) -> float:
        """The control law's override, its mean where the file averages the command."""
        law = self._law
        if isinstance(law, RatioLaw | AdaptiveLaw):
            if begins:
                law.enter()
            adaptive = isinstance(law, AdaptiveLaw)
            known = not (self._bad or self._gap or self._slow) and (self._above or not adaptive)
            target = law.target(self._measured, self.reference, known=known)
            if adaptive:
                target = self._bridged(target, u, begins=begins)
            self._base = u if begins or not self._same else self._base
            if self._same and self.loop.stuck_after:
                target = min(target, self._base + self._same * self._bounds[3])
            if not self._above or (self._bad and not adaptive):
                target = min(target, u)  # between teeth, on leaving the cut and on a bridged reading it never rises
        else:
            error = self.reference - self._measured
            if begins:
                law.enter(u + self.loop.entry_gain * error)
                self._targets.extend([u] * len(self._targets))
            target = law.target(error, slow=self._slow > 0)
        if law.limited != self._limited:
            self._limited = law.limited
            self.news += (("free", "at high", "at low")[law.limited],)  # the third by index -1
        if len(self._targets) == 1:
            return target
        self._targets.append(target)
        return sum(self._targets) / len(self._targets)

    def _bridged(self, target: float, u: float, *, begins: bool) -> float:
        """The target; where the revolution holds a bridged reading, the last override before it, later at most that."""
        if begins:
            self._gap = 0
        if self._bad:
            if not self._gap:
                self._before, self._gaps = u, 0
            self._gap = self.loop.average + 1
        if not self._gap:
            return target
        self._gap, self._gaps = self._gap - 1, self._gaps + 1
        return min(u if self._gaps <= self._n["lost_after"] + self.loop.average else target, self._before)

    def _limit(self, target: float) -> float:
        """Limits, then a rate that differs downwards and upwards; the first command meets the limits at once."""
        (low, high, back_off, recover), last = self._bounds, self._u
        if last is None:
            self._u = self._average = min(max(target, low), high)
            return self._u
        if target != last:
            self._falling = target < last
        if self.cutting and self.loop.law != "pi":
            self._u = target
            return target
        most = back_off if self._falling else recover
        target = min(max(target, low), high)
        self._u = min(max(target, last - most), last + most)
        return self._u

    def _rests(self, u: float) -> None:
        """Latch ``worn`` where the mean command rested for the dwell; time in air, or slowed, does not count."""
        self._average += (u - self._average) * self._gains[2]
        if self.cutting and not (self._slow and self._measured < self.reference):
            self._rested = self._rested + 1 if self._average <= self.rest else 0
            if self._rested >= self._n["dwell"] and not self.worn:
                self.worn = True
                self.news += ("change tool",)

    def _state(self) -> State:
        if self.fault or self.overload:
            return State.FAULT
        if self.cutting:
            return State.WORN if self.worn else State.CONTROL
        return State.ENTRY if self._engaged else State.AIR if self._armed else State.OFF
