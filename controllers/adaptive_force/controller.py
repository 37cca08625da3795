"""The controller of LYAP: control law and adaptation on the force averaged over a revolution.

    E = F~' + lambda F~,    F~ = F - F_d                                          force and F_d averaged alike
    u = m^ F_d'' + alpha^ F_d' + beta^ F_d - Kd E                                  (5), each estimate over k
    m^' = -g1 E F_d'',   alpha^' = -g2 E F_d',   beta^' = -g3 E F_d                the printed law, between samples by
                                                                                  the trapezoidal rule

Source: "adaptive cutting force control", eq. 5-10; the paper gives the law in continuous time, for a force without
ripple and a command without limits. Averaging, limits, the reference model, the trapezoidal rule and the treatment of
lost readings are **reconstructions**.
"""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

from ...core.display import Displayable
from ..sensor_check import KNOWN, STUCK, UNKNOWN, SensorCheck
from .settings import ForceSettings, settings_for
from .signals import ReferenceModel, Revolution

if TYPE_CHECKING:
    from ...parameters import ParameterFile

MOVES = 0.02  # of the upper limit: a command change by which an equal reading is a stuck sensor
BRIDGED = 0.5  # of a revolution without a reading: interpolated linearly, adaptation stopped
HELD = 2.0  # revolutions that the command is held after a reading went missing
RECOVERY = 10.0  # revolutions of valid readings before control resumes after one that was out of range or stuck
HIGH, NORMAL = 1.5, 1.2  # of the set point: thresholds of the event of a high force


@dataclass(slots=True, repr=False)
class AdaptiveForceControl(Displayable):
    """The controller; its command is a feed between the file's limits, its measurement a force.

    It begins at the lower limit for a revolution, and leads F_d from the measured force to the set point. The law
    takes whole steps of ``sample_time``, several a call where ``dt`` is longer, with the force between two readings
    taken as a straight line.

    While the command is at a limit, adaptation stops.

    After a reading that is not a number the command is held for two revolutions; gaps of up to half a revolution are
    interpolated. A reading beyond the sensor's range (saturated, wrong sign, infinite) or stuck while the command
    moves (also at zero) sets the command to its lower limit at once. In both cases adaptation stops until a whole
    revolution is known again, ten of them in the second case, with a force above zero, and F_d restarts from the
    measured force.

    Attributes
    ----------
    settings : ForceSettings
    command : float
    m, alpha, beta : float
        The estimates over k; they converge to theta k^/k, not to theta.
    error, error_rate : float
        F~ and F~' of the last revolution.
    limited : int
        1 while the command is held down by its upper limit, -1 while it is held up by the lower, else 0.
    closed : bool
        Whether the control loop is closed.
    adapting : bool
    news : tuple of str
        What changed in the last step: ``at low``, ``at high``, ``free``, ``force unknown``, ``force stuck``,
        ``force known`` (and the loop closed again), ``force high`` (half above the set point), ``force normal``.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> control = AdaptiveForceControl.from_parameters(published("LYAP"), depth=2.0)
    >>> control.command, control.set_point
    (30.0, 200.0)
    >>> from fitmodels.controllers import replay
    >>> from fitmodels.controllers.adaptive_force.plant import DriveAndCut
    >>> trace = replay(control, DriveAndCut(depth=2.0), duration=2.0, dt=0.001)
    >>> round(float(trace.measurement[-1]), 1), round(trace.command[-1])
    (200.0, 250)
    """

    settings: ForceSettings
    command: float = field(init=False)
    m: float = field(init=False)
    alpha: float = field(init=False)
    beta: float = field(init=False)
    error: float = field(default=0.0, init=False)
    error_rate: float = field(default=0.0, init=False)
    limited: int = field(default=0, init=False)
    closed: bool = field(default=False, init=False)
    adapting: bool = field(default=False, init=False)
    news: tuple[str, ...] = field(default=(), init=False)
    _model: ReferenceModel = field(init=False)
    _revolution: Revolution = field(init=False)
    _sensing: SensorCheck = field(init=False)
    _last: float = field(default=math.nan, init=False)
    _E: float = field(default=0.0, init=False)
    _w: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0), init=False)
    _missing: int = field(default=0, init=False)  # steps since the last reading
    _open: int = field(default=0, init=False)  # steps since the loop was last closed
    _recovering: int = field(default=0, init=False)  # valid steps still needed before control resumes
    _still: int = field(default=0, init=False)  # steps for which adaptation is still stopped
    _high: bool = field(default=False, init=False)
    _sensor: str = field(default=KNOWN, init=False)

    def __post_init__(self) -> None:
        s = self.settings
        self.m, self.alpha, self.beta, self.command = s.m, s.alpha, s.beta, s.low
        self._model = ReferenceModel(s.reference_time, s.reference_damping, s.sample_time)
        self._revolution = Revolution(s.samples, s.sample_time)
        self._sensing = SensorCheck(s.force_low, s.force_high, least_move=MOVES * s.high)

    @classmethod
    def from_parameters(cls, pf: "ParameterFile", depth: float) -> Self:
        """Make the controller from the file alone.

        Parameters
        ----------
        pf : ParameterFile
        depth : float
            Of cut, in the file's unit: one of its set points. The controller knows no more of the depth than this.

        Raises
        ------
        GateError
            The file fails the check, lacks a setting, or has no set point for this depth.
        """
        return cls(settings_for(pf, depth))

    @property
    def set_point(self) -> float:
        """Set point of the force."""
        return self.settings.set_point

    @property
    def reference(self) -> float:
        """F_d, the output of the reference model."""
        return self._model.value

    @property
    def average(self) -> float:
        """Force over the last revolution."""
        return self._revolution.force

    @property
    def labels(self) -> tuple[str, str]:
        """Command and measurement, with their units."""
        return self.settings.labels

    def step(self, measurement: float, dt: float) -> float:
        """Feed command for a force.

        Raises
        ------
        UsageError
            ``dt`` is not a multiple of the file's ``sample_time``.
        """
        steps, measurement = self.settings.steps_in(dt), float(measurement)  # NumPy bools do not support subtraction
        before = self._sensor, self.limited, self._high
        valid = self._sensing.valid(measurement, self.command)
        if valid:
            self._take(measurement, steps)
        else:
            self._miss(measurement, steps)
        if valid and self.closed:
            self._answer(steps)
        else:
            self._wait(steps)
        if self.closed or self._sensing.state != KNOWN:
            self._sensor = self._sensing.state  # known again only when the loop is closed again
        now = self._sensor, self.limited, self._high
        self.news = () if now == before else _changes(before, now)
        return self.command

    def _take(self, force: float, steps: int) -> None:
        """Advance the law to a reading, interpolated linearly from the last one."""
        gap, self._missing = self._missing, 0
        if math.isnan(self._last) or gap > BRIDGED * self.settings.samples:
            self._begin(force)
            return
        start, total = self._last, gap + steps
        for i in range(1, total + 1):
            self._advance(start + (force - start) * i / total, known=not gap)
        self._last = force

    def _begin(self, force: float) -> None:
        """Restart the revolution after a gap."""
        self._revolution.clear()
        self._revolution.push(force, 0.0, 0.0)
        self._last, self.closed, self.adapting = force, False, False

    def _advance(self, force: float, known: bool) -> None:
        """One step of reference model, averages and estimates."""
        s, model, revolution = self.settings, self._model, self._revolution
        if self.closed:
            model.advance(s.set_point)
        revolution.push(force, model.value, model.rate)
        if not self.closed:
            self._recovering -= 1
            if self._recovering <= 0 and revolution.full and revolution.force > 0:
                self._close()
            return
        w = revolution.wanted
        self.error, self.error_rate = revolution.force - w[2], revolution.force_rate - w[1]
        E = self.error_rate + s.lam * self.error
        self._still -= 1
        self.adapting = known and self._still < 0
        if self.adapting:
            self._adapt((self._E + E) / 2 * s.sample_time, w)
        self._E, self._w = E, w

    def _close(self) -> None:
        """Close the loop with F_d at the measured force."""
        self._model.restart(self._revolution.force)
        self._revolution.want(self._revolution.force)
        self.closed, self._open, self._still = True, 0, 0
        self.error, self.error_rate = 0.0, self._revolution.force_rate
        self._E, self._w = self.error_rate, self._revolution.wanted

    def _adapt(self, E_dt: float, w: tuple[float, float, float]) -> None:
        """The adaptation law over a step, trapezoidal in E and F_d."""
        s, old = self.settings, self._w
        self.m -= s.g1 * E_dt * (w[0] + old[0]) / 2
        self.alpha -= s.g2 * E_dt * (w[1] + old[1]) / 2
        self.beta -= s.g3 * E_dt * (w[2] + old[2]) / 2

    def _answer(self, steps: int) -> None:
        """The control law (5), within the limits."""
        s, model = self.settings, self._model
        second, rate, value = model.midway(s.set_point, steps * s.sample_time)
        unlimited = self.m * second + self.alpha * rate + self.beta * value - s.Kd * self._E
        self.command = min(max(unlimited, s.low), s.high)
        self.limited = (unlimited > s.high) - (unlimited < s.low)
        if self.limited:
            self._still = steps
        average = self._revolution.force
        self._high = average > (NORMAL if self._high else HIGH) * s.set_point

    def _miss(self, reading: float, steps: int) -> None:
        """Invalid reading: wait if it is missing, open the loop if the sensor gives impossible values."""
        self._missing += steps
        self.adapting = False
        if not math.isnan(reading) or self._missing > BRIDGED * self.settings.samples:
            self._last, self.closed = math.nan, False
        if not math.isnan(reading) or self._sensing.state == STUCK:
            self._recovering = round(RECOVERY * self.settings.samples)
            self.command = self.settings.low

    def _wait(self, steps: int) -> None:
        """Open loop: the command is held for a while, then set to its lower limit."""
        self._open += steps
        if self._open > HELD * self.settings.samples:
            self.command = self.settings.low


State = tuple[str, int, bool]


def _changes(before: State, now: State) -> tuple[str, ...]:
    words = (
        {KNOWN: "force known", UNKNOWN: "force unknown", STUCK: "force stuck"},
        {0: "free", 1: "at high", -1: "at low"},
        {True: "force high", False: "force normal"},
    )
    return tuple(names[new] for names, old, new in zip(words, before, now, strict=True) if old != new)  # type: ignore[index]
