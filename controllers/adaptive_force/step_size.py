"""How long a step the law stands: the largest rise of V, and whether the force settles, for steps of 0.1 to 50 ms.

The law is written in continuous time. Two ways to take it in steps, at the depth where the plant answers most:

    as built      averaged over a revolution, trapezoidal rule between samples, F_d at the middle of the command
    as printed    E and the estimates as they stand at a sample, held to the next (Euler), exact F and F', no limits

each with the file's gain Kd, and with ten times of it.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.display import Displayable
from .control import AdaptiveForceControl
from .judged import STEADY
from .lyapunov import RECORDED, energy, values_of_V
from .process import DriveAndCut
from .reference_model import ReferenceModel
from .settings import settings_for

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from .settings import Settings

Array = NDArray[np.float64]
STEPS = (0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002, 0.0001)  # s
STIFF = 10.0
DIVERGED = 1e6  # of the set point
LEAST = 200  # steps: a loop that runs away takes its time at a long step
SETTLED = 0.02


@dataclass(frozen=True, slots=True, repr=False)
class StepSize(Displayable):
    """One step size, one way to take it.

    Attributes
    ----------
    way : str
        ``as built`` or ``as printed``.
    times : float
        Kd over the file's.
    step : float
        s.
    rise : float
        Largest rise of V while nothing is limited, as a share of where it began; infinite where the run leaves all
        bounds.
    error : float
        Largest error of the force in the last quarter of the run, as a share of the set point.
    free : float
        Share of the run in which the command was not limited, so that the proof speaks.
    """

    way: str
    times: float
    step: float
    rise: float
    error: float
    free: float = 1.0

    @property
    def diverged(self) -> bool:
        """Whether the force ends further from its set point than the set point is from zero."""
        return not self.error < 1

    @property
    def settled(self) -> bool:
        """Whether the force ends within 2 % of its set point."""
        return self.error <= SETTLED


def step_study(
    pf: "ParameterFile", depth: float | None = None, steps: tuple[float, ...] = STEPS, duration: float = 1.5
) -> tuple[StepSize, ...]:
    """Both ways and both gains at each step, without ripple and noise, on the plant of the file's estimates.

    Parameters
    ----------
    depth : float, optional
        One of the set points; the deepest unless said.
    steps : tuple of float
        s. As built, a step is a whole part of the revolution: others are left out.
    duration : float
        s at least.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> for row in step_study(published("LYAP"), steps=(0.005,)):
    ...     print(row.way, row.times, row.rise < 1e-12, row.settled)
    as built 1.0 True True
    as printed 1.0 False True
    as built 10.0 True False
    as printed 10.0 False False
    """
    points = [] if pf.adaptive_force is None else [point.depth for point in pf.adaptive_force.set_points]
    settings = settings_for(pf, max(points, default=1.0) if depth is None else depth)
    revolution = settings.samples * settings.sample_time
    rows = []
    for times in (1.0, STIFF):
        s = replace(settings, Kd=times * settings.Kd)
        rows += [_built(s, times, pf, h, revolution, duration) for h in steps if _whole(revolution, h)]
        rows += [_printed(s, times, pf, h, duration) for h in steps]
    return tuple(rows)


def _whole(revolution: float, step: float) -> bool:
    parts = revolution / step
    return parts > 1 - 1e-9 and abs(parts - round(parts)) < 1e-6


def _built(
    settings: "Settings", times: float, pf: "ParameterFile", step: float, revolution: float, duration: float
) -> StepSize:
    from ..loop import replay

    s = replace(settings, sample_time=step, samples=round(revolution / step))
    plant = DriveAndCut.from_parameters(pf, s.depth)
    trace = replay(AdaptiveForceControl(s), plant, duration=duration, dt=step, record=RECORDED)
    late = trace.recorded["error"][-round(STEADY * len(trace.time)) :]
    error = float(np.abs(late).max() / s.set_point)
    found = energy(trace, s, plant)
    return StepSize("as built", times, step, found.rise, error, float(found.free.mean()))


def _printed(settings: "Settings", times: float, pf: "ParameterFile", step: float, duration: float) -> StepSize:
    """Linear drive and process under the printed law; the plant's own F and F' are fed back."""
    s, plant = settings, DriveAndCut.from_parameters(pf, settings.depth)
    point, model = s.set_point, ReferenceModel(s.reference_time, s.reference_damping, step)
    m, alpha, beta = s.m, s.alpha, s.beta
    rows: list[tuple[float, ...]] = []
    for _ in range(max(round(duration / step), LEAST)):
        second, rate, value = model.second(point), model.rate, model.value
        error, error_rate = plant.force - value, plant.k * plant.speed - plant.c * plant.force - rate
        if not abs(error) < DIVERGED * point:
            return StepSize("as printed", times, step, np.inf, np.inf)
        rows.append((error, error_rate, m, alpha, beta, plant.force))
        E = error_rate + s.lam * error
        plant.move(m * second + alpha * rate + beta * value - s.Kd * E, step)
        m -= step * s.g1 * E * second
        alpha -= step * s.g2 * E * rate
        beta -= step * s.g3 * E * value
        model.advance(point)
    found = np.array(rows)
    V = values_of_V(found[:, :2], found[:, 2:5], s, plant, np.full(len(rows), plant.k))
    late = found[-max(round(STEADY * len(rows)), 1) :, 5]
    rise = float((V - np.minimum.accumulate(V)).max() / V[0]) if V[0] else 0.0
    return StepSize("as printed", times, step, rise, float(np.abs(late / point - 1).max()))
