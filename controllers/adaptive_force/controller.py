"""The controller of LYAP: control law and adaptation on the force averaged over a revolution.

    E = F~' + lambda F~,    F~ = F - F_d                                          force and F_d averaged alike
    u = m^ F_d'' + alpha^ F_d' + beta^ F_d - Kd E                                  (5), each estimate over k
    m^' = -g1 E F_d'',   alpha^' = -g2 E F_d',   beta^' = -g3 E F_d                the printed law, between samples by
                                                                                  the trapezoidal rule

Source: "adaptive cutting force control", eq. 5-10; the paper gives the law in continuous time, for a force without
ripple and a command without limits. Averaging, limits, the reference model, the trapezoidal rule and the supervision
are **reconstructions**. The law stands in `constant_load_milling.control_laws`; the supervision is that of constant
load, which the exports carry.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

from ...core.display import Displayable
from ...core.errors import UsageError
from ...parameters.exports.loop import STUCK_AFTER
from ..constant_load_milling.control_laws import AdaptiveLaw
from ..constant_load_milling.controller import ConstantLoad
from .settings import ForceSettings, force_loop, settings_for

if TYPE_CHECKING:
    from ...parameters import ParameterFile

MOVES = 0.02  # of the upper limit: a command change by which an equal reading is a stuck sensor, of the fixed PI
HIGH, NORMAL = 1.5, 1.2  # of the set point: thresholds of the event of a high force


@dataclass(slots=True, repr=False)
class AdaptiveForceControl(Displayable):
    """The controller; its command is a feed between the file's limits, its measurement a force.

    From power-on and in air the feed is at its lower limit. Once the mean force of a revolution has been above the
    threshold for a revolution, the law acts, and leads F_d from the measured force to the set point. While a reading is
    below the threshold, between teeth and on leaving the cut, the feed does not rise and adaptation stops; the cut ends
    when the mean of the revolution is below it. Adaptation stops, too, while the command is at a limit or a reading is
    missing.

    Invalid readings are bridged by the last valid one; for 0.05 s, or more than a fifth of them, they latch a fault, as
    equal readings in the cut for ``stuck_after`` do: the feed goes to its lower limit until ``control.reset``. While
    the last revolution holds a bridged reading, the feed stays as it was before the first of them, for 0.05 s and a
    revolution at most; after that the law may lower it, and it rises above that feed only on a whole revolution.

    Attributes
    ----------
    settings : ForceSettings
    stuck_after : float
        s; 0 for a simulated force without ripple and noise.
    command : float
    control : ConstantLoad
        The supervision and its inputs (``enabled``, ``spindle_on``, ``idle``, ``beat``, ``reset``, ``requested``).
    news : tuple of str
        What changed in the last step: ``cut`` (the loop is closed), ``air``, ``at low``, ``at high``, ``free``,
        ``force unknown``, ``force known``, ``force lost``, ``force stuck``, ``overload``, ``reset``, ``change tool``,
        ``force high`` (half above the set point), ``force normal``.

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
    stuck_after: float = STUCK_AFTER
    command: float = field(init=False)
    control: ConstantLoad = field(init=False, compare=False)
    news: tuple[str, ...] = field(default=(), init=False)
    _law: AdaptiveLaw = field(init=False, compare=False)
    _high: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        loop = force_loop(self.settings, stuck_after=self.stuck_after)
        self.control = ConstantLoad(loop, running=True)
        law = self.control.law
        assert isinstance(law, AdaptiveLaw)  # noqa: S101 - of its own loop
        self._law, self.command = law, self.settings.low

    @classmethod
    def from_parameters(cls, pf: "ParameterFile", depth: float, *, stuck_after: float = STUCK_AFTER) -> Self:
        """Make the controller from the file alone.

        Parameters
        ----------
        pf : ParameterFile
        depth : float
            Of cut, in the file's unit: one of its set points. The controller knows no more of the depth than this.
        stuck_after : float
            s.

        Raises
        ------
        GateError
            The file fails the check, lacks a setting, or has no set point for this depth.
        """
        return cls(settings_for(pf, depth), stuck_after)

    @property
    def m(self) -> float:
        """Estimate over k; with alpha and beta it converges to theta k^/k, not to theta."""
        return self._law.m

    @property
    def alpha(self) -> float:
        """Estimate over k."""
        return self._law.alpha

    @property
    def beta(self) -> float:
        """Estimate over k."""
        return self._law.beta

    @property
    def error(self) -> float:
        """F~ of the last revolution."""
        return self._law.error

    @property
    def error_rate(self) -> float:
        """F~' of the last revolution."""
        return self._law.error_rate

    @property
    def closed(self) -> bool:
        """Whether the control loop is closed."""
        return self.control.cutting

    @property
    def adapting(self) -> bool:
        """Whether the estimates were updated in the last step."""
        return self.closed and self._law.adapting

    @property
    def limited(self) -> int:
        """1 while the command is held down by its upper limit, -1 while it is held up by the lower, else 0."""
        return self._law.limited if self.closed else 0

    @property
    def set_point(self) -> float:
        """Set point of the force."""
        return self.settings.set_point

    @property
    def reference(self) -> float:
        """F_d, the output of the reference model."""
        return self._law.model.value

    @property
    def average(self) -> float:
        """Force over the last revolution."""
        return self._law.revolution.force

    @property
    def labels(self) -> tuple[str, str]:
        """Command and measurement, with their units."""
        return self.settings.labels

    def step(self, measurement: float, dt: float) -> float:
        """Feed command for a force.

        Raises
        ------
        UsageError
            ``dt`` is not the file's ``sample_time``.
        """
        own = self.settings.sample_time
        if not abs(dt - own) <= 1e-6 * own:  # true for NaN too
            raise UsageError(f"a step of {dt:g} s: the law takes steps of {own:g} s; replay it at that.")
        self.command = min(self.control.step(measurement, own) * self.settings.high, self.settings.high)
        high = self.closed and self.average > (NORMAL if self._high else HIGH) * self.set_point
        news = tuple(words.replace("load ", "force ") for words in self.control.news)
        self.news = news if high == self._high else (*news, "force high" if high else "force normal")
        self._high = high
        return self.command
