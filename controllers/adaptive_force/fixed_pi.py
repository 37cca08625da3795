"""PI force controller with the fixed gains of the file, for comparison with the adaptive controller."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

from ...core.display import Displayable
from ...core.errors import GateError, UsageError
from ..sensor_check import SensorCheck
from .controller import MOVES
from .settings import ForceSettings, settings_for
from .signals import ReferenceModel

if TYPE_CHECKING:
    from ...ident.pi.controller import PiController
    from ...parameters import ParameterFile


@dataclass(slots=True, repr=False)
class FixedForcePi(Displayable):
    """PI on the averaged force, behind the same reference model and between the same limits.

    An invalid reading sets the command to the lower limit.

    Attributes
    ----------
    settings : ForceSettings
    pi : PiController
        Of `fitmodels.ident.pi.controller`, with the file's gains.
    command : float
    news : tuple of str
        ``force unknown``, ``force stuck``, ``force known``, ``at low``, ``at high``, ``free``.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> control = FixedForcePi.from_parameters(published("LYAP"), depth=2.0)
    >>> from fitmodels.controllers import replay
    >>> from fitmodels.controllers.adaptive_force.plant import DriveAndCut
    >>> trace = replay(control, DriveAndCut(depth=2.0), duration=2.0, dt=0.004)
    >>> round(float(trace.measurement[-1]), 1), round(trace.command[-1])
    (200.0, 250)
    """

    settings: ForceSettings
    pi: "PiController"
    command: float = field(init=False)
    news: tuple[str, ...] = field(default=(), init=False)
    _model: ReferenceModel = field(init=False)
    _sensing: SensorCheck = field(init=False)

    def __post_init__(self) -> None:
        s = self.settings
        self.command = s.low
        self._model = ReferenceModel(s.reference_time, s.reference_damping, self.pi.gains.sample_time)
        self._sensing = SensorCheck(s.force_low, s.force_high, least_move=MOVES * s.high)

    @classmethod
    def from_parameters(cls, pf: "ParameterFile", depth: float) -> Self:
        """Make the controller from the file alone.

        Raises
        ------
        GateError
            As for the adaptive controller; and a file without gains, or with gains in another unit.
        """
        from ...ident.pi.controller import PiController
        from ...ident.pi.gains import PiGains

        settings, pi, section = settings_for(pf, depth), pf.pi, pf.adaptive_force
        if pi is None or section is None:
            raise GateError("the file has no pi section: tune gains with `fitmodels tune` and collect them.")
        if (pi.unit_u, pi.unit_y) != (section.unit_u, section.unit_force):
            raise GateError(
                f"pi: gains in {pi.unit_u} per {pi.unit_y}, the adaptive controller's in {section.unit_u} and "
                f"{section.unit_force}: state them in the same units."
            )
        given = {name: getattr(pi, name) for name in PiGains.__dataclass_fields__}
        gains = PiGains(**{**given, "low": settings.low, "high": settings.high})
        return cls(settings, PiController(gains, idle=settings.low, last=settings.low))

    @property
    def reference(self) -> float:
        """F_d, the output of the reference model."""
        return self._model.value

    @property
    def labels(self) -> tuple[str, str]:
        """Command and measurement, with their units."""
        return self.settings.labels

    @property
    def limited(self) -> int:
        """1 while the upper limit holds the command down, -1 while the lower holds it up."""
        return self.pi.limited

    def step(self, measurement: float, dt: float) -> float:
        """Feed command for a force.

        Raises
        ------
        UsageError
            ``dt`` is not the period that the gains were tuned for.
        """
        tuned = self.pi.gains.sample_time
        if not abs(dt - tuned) <= 1e-9 * tuned:  # true for NaN too
            raise UsageError(f"a step of {dt:g} s: the gains were tuned for {tuned:g} s; replay them at that.")
        measurement = float(measurement)
        before = self._sensing.state, self.limited
        valid = self._sensing.valid(measurement, self.command)
        self._model.advance(self.settings.set_point)
        self.command = self.pi.step(self._model.value, measurement if valid else 0.0, engaged=valid)
        state, limited = self._sensing.state, self.limited
        self.news = (
            *((f"force {state}",) if state != before[0] else ()),
            *((("free", "at high", "at low")[limited],) if limited != before[1] else ()),
        )
        return self.command
