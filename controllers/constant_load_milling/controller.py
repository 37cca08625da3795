"""Constant load: a PI on spindle load sets the feed override inside the cut and signals when the tool is worn.

Source: Tai, Tsai & Li 2023, IEEE Access, doi 10.1109/ACCESS.2023.3330587. Gains in position form run in the arithmetic
of LinuxCNC's HAL components (near, wcomp, lowpass, comp, timedelay, pid, sum2, mux2, limit2), so that the replay equals
the HAL export; the form ``incremental_sum``, eq. 16 as it is worded, runs as itself. A moving average, which HAL lacks,
is taken of the load before the comparator or of the command, as the file states.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

from ...core.display import Displayable
from ...core.errors import UsageError
from ..sensor_check import KNOWN, UNKNOWN, SensorCheck
from .control_laws import IncrementalLaw, PositionLaw

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.exports.loop import LoadLoop

DWELL = 4.0  # s: the settling time allowed for the published loop, so that a transient does not count as a worn tool
REST = 0.01  # of the range between the feed limits: a command so near the lower one rests on it
STANDS_STILL = 0.02  # of that range: a command that moved by more changes any load that is measured
STILL_FOR = 25  # samples


@dataclass(slots=True, repr=False)
class ConstantLoad(Displayable):
    """The controller of CLM-2023; its command is the feed override, feed over programmed feed.

    In position form the override is 1 outside the cut, switched off, or with an unknown load. Stuck readings are
    reported and used like others, as LinuxCNC does.

    In the form ``incremental_sum`` it keeps its last command as soon as the load falls below the threshold; with a load
    that is unknown or stuck it goes to the lower limit, switched off to 1.

    A reading that stands still is called stuck where the command moved by 2 % of the range of its limits in 25 samples,
    or by 20 % in any time: one that stands still at the reference itself, or on a limit, is not detected.

    Attributes
    ----------
    loop : LoadLoop
        Gains, limits and settings; see `fitmodels.parameters.exports.loop.LoadLoop`.
    enabled : bool
        The operator's switch.
    command : float
        The last command. In position form it starts at 0, as LinuxCNC's limiter does, and ramps.
    dwell : float
        s that the command rests on its lower limit, within 1 % of the range of the limits and in the cut, before the
        tool is called worn.
    cutting : bool
        Whether the loop is closed.
    worn : bool
        Whether the command has rested on its lower limit.
    rest : float
        A command at or below rests on the lower limit.
    news : tuple of str
        What changed in the last step: ``cut``, ``air``, ``at low``, ``at high``, ``free``, ``load unknown``,
        ``load stuck``, ``load known``, ``change tool``.

    Examples
    --------
    >>> from fitmodels.parameters.exports.loop import LoadLoop
    >>> loop = LoadLoop(
    ...     kp=0.0, ki=8000.0, sample_time=0.02, reference=0.24, feed_low=600.0, feed_high=1000.0,
    ...     feed_programmed=1000.0, unit_load="A", unit_feed="mm/min", filter_time=0.0, engage_at=0.15,
    ...     hysteresis=0.02, engage_after=0.04, disengage_after=0.2, back_off=1.0, recover=0.5, load_low=-1.0,
    ...     load_high=10.0)
    >>> controller = ConstantLoad(loop, command=1.0)
    >>> [round(controller.step(0.3, 0.02), 3) for _ in range(4)]
    [1.0, 0.99, 0.981, 0.971]
    """

    loop: "LoadLoop"
    enabled: bool = True
    command: float = 0.0
    dwell: float = DWELL
    cutting: bool = field(default=False, init=False)
    worn: bool = field(default=False, init=False)
    news: tuple[str, ...] = field(default=(), init=False)
    labels: tuple[str, str] = field(init=False)
    reference: float = field(init=False)
    rest: float = field(init=False)
    _law: PositionLaw | IncrementalLaw = field(init=False)
    _sensing: SensorCheck = field(init=False)
    _felt: float = field(default=0.0, init=False)
    _state: str = field(default=KNOWN, init=False)
    _limited: int = field(default=0, init=False)
    _filtered: float = field(default=0.0, init=False)
    _kept: deque[float] = field(init=False)
    _above: bool = field(default=False, init=False)
    _loaded: bool = field(default=False, init=False)
    _waited: int = field(default=0, init=False)
    _rested: int = field(default=0, init=False)
    _time: float = field(default=0.0, init=False)
    _gain: float = field(default=1.0, init=False)
    _at: float = field(default=0.0, init=False)
    _half: float = field(default=0.0, init=False)
    _dwell: int = field(default=1, init=False)
    _own: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        loop = self.loop
        span = loop.high - loop.low
        self._own = loop.form == "incremental_sum"
        self._law = IncrementalLaw(loop, self.command) if self._own else PositionLaw(loop, self.command)
        self.command, self.reference, self._time = self._law.command, loop.reference, loop.sample_time
        self.labels = ("feed override", f"load, {loop.unit_load}")
        self._gain = -math.expm1(-loop.sample_time / loop.filter_time) if loop.filter_time else 1.0
        average = loop.average if loop.average_of == "measurement" else 1
        self._kept = deque([0.0] * average, maxlen=average)
        self._at, self._half = loop.engage_at, loop.hysteresis / 2
        self._sensing = SensorCheck(loop.load_low, loop.load_high, least_move=STANDS_STILL * span, samples=STILL_FOR)
        self.rest, self._dwell = loop.low + REST * span, max(round(self.dwell / loop.sample_time), 1)

    @classmethod
    def from_parameters(cls, pf: "ParameterFile", command: float | None = None) -> Self:
        """Make the controller from the file alone.

        ``command`` is the initial override: by default 0 in position form, as LinuxCNC's limiter begins, and the
        upper limit in the form ``incremental_sum``.

        Raises
        ------
        GateError
            The file has no gains or no settings of the loop, or its gains fail the check.
        """
        from .control_laws import loop_of

        loop = loop_of(pf)
        dwell = None if pf.load_line is None else pf.load_line.dwell
        start = loop.high if loop.form == "incremental_sum" else 0.0
        return cls(loop, command=start if command is None else command, dwell=DWELL if dwell is None else dwell)

    def step(self, measurement: float, dt: float) -> float:
        """Feed override for a load.

        Raises
        ------
        UsageError
            ``dt`` is not the period that the gains and the filter were made for.
        """
        if dt != self._time and abs(dt - self._time) > 1e-9 * dt:
            raise UsageError(f"a step of {dt:g} s: the loop was made for {self._time:g} s; replay it at that.")
        measurement = float(measurement)  # NumPy bools do not support subtraction
        law, sensing = self._law, self._sensing
        valid = sensing.valid(measurement, self._felt)
        state = sensing.state
        if not self._own:
            valid = state != UNKNOWN
        self._filtered += ((measurement if state != UNKNOWN else 0.0) - self._filtered) * self._gain
        load = self._filtered
        if len(self._kept) > 1:
            self._kept.append(load)
            load = sum(self._kept) / len(self._kept)
        cutting = self._engaged(load) and valid and self.enabled
        if cutting:
            self.command = law.closed(self.reference - load)
            if measurement > self._at:  # the load in air does not depend on the command
                self._felt = self.command
        else:
            self.command = (law.outside() if valid else law.invalid()) if self.enabled else law.off()
        worn = cutting and self._rests()
        if worn or cutting != self.cutting or law.limited != self._limited or state != self._state:
            self._report(cutting, state, worn)
        else:
            self.news = ()
        return self.command

    def _engaged(self, load: float) -> bool:
        """Comparator with hysteresis, then a delay for each direction, in whole samples."""
        over, above = load - self._at, self._above
        if over > self._half:
            self._above = above = True
        elif over < -self._half:
            self._above = above = False
        if above is self._loaded:
            self._waited = 0
            return above
        self._waited += 1
        if self._waited >= (self.loop.engage_samples if above else self.loop.disengage_samples):
            self._loaded, self._waited = above, 0
        return self._loaded and (self._above or not self._own)  # eq. 16 opens at once: in air it would raise the feed

    def _rests(self) -> bool:
        """Whether the command was on its lower limit for the dwell; time in air neither counts nor resets it."""
        if self.command > self.rest:
            self._rested = 0
            return False
        self._rested += 1
        return self._rested == self._dwell

    def _report(self, cutting: bool, state: str, worn: bool) -> None:
        changes = [f"load {state}"] if state != self._state else []
        if cutting != self.cutting:
            changes.append("cut" if cutting else "air")
        if self._law.limited != self._limited:
            changes.append(("free", "at high", "at low")[self._law.limited])  # the third by index -1
        if worn and not self.worn:
            changes.append("change tool")
        self.worn = self.worn or worn
        self.news = tuple(changes)
        self.cutting, self._state, self._limited = cutting, state, self._law.limited
