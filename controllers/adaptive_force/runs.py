"""Simulated runs of the adaptive and the PI controller: the three depths of the paper, and steps of depth."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from ...core.arrays import Array
from ...core.errors import UsageError
from ...parameters.exports.loop import STUCK_AFTER
from ..loop import Trace, replay
from .controller import AdaptiveForceControl
from .fixed_pi import FixedForcePi
from .plant import Depth, DriveAndCut, changes
from .signals import RegulationMetrics, averaged, regulation_metrics
from .stability import RECORDED, Energy, energy

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from .settings import ForceSettings

By = Literal["adaptive", "pi"]
STEADY = 4.0  # s of a run at one depth
BETWEEN = 3.0  # s between two steps of depth


@dataclass(frozen=True, slots=True)
class ForceRun:
    """A replay with its controller settings and plant.

    Attributes
    ----------
    by : str
        ``adaptive`` or ``pi``.
    trace : Trace
    settings : ForceSettings
        Of the controller.
    plant : DriveAndCut
    revolution : float
        s.
    """

    by: By
    trace: Trace
    settings: "ForceSettings"
    plant: DriveAndCut
    revolution: float

    @property
    def force(self) -> Array:
        """The plant's force averaged over a revolution, shape (n,), N."""
        step = float(self.trace.time[1] - self.trace.time[0])
        return averaged(self.trace.recorded["force"], round(self.revolution / step))

    @property
    def depths(self) -> list[tuple[float, float]]:
        """Depths with the times they begin at."""
        return changes(self.plant.depth)

    def segments(self) -> list[RegulationMetrics]:
        """Regulation metrics at each depth in turn."""
        starts = [start for start, _ in self.depths]
        ends = [*starts[1:], np.inf]
        point = self.settings.set_point
        return [
            regulation_metrics(self.trace, point, self.revolution, a, b) for a, b in zip(starts, ends, strict=True)
        ]  # fmt: skip

    def energy(self) -> Energy:
        """Lyapunov function V along the run; of the adaptive controller only.

        Raises
        ------
        UsageError
            The run is that of the PI.
        """
        if self.by != "adaptive":
            raise UsageError("V of a run by the PI: it has no estimates; use the adaptive run.")
        return energy(self.trace, self.settings, self.plant)


def steady_run(
    pf: "ParameterFile",
    depth: float,
    by: By = "adaptive",
    *,
    ripple: float = 0.0,
    noise: float = 0.0,
    duration: float = STEADY,
    seed: int = 1,
) -> ForceRun:
    """Run at one depth of the paper, from rest to its set point (Figs 7-9), on the plant of the file's estimates.

    Parameters
    ----------
    depth : float
        One of the file's set points, mm.
    by : {"adaptive", "pi"}
    ripple, noise : float
        Share of the force, and N.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> run = steady_run(published("LYAP"), 4.0, ripple=0.3)
    >>> run.segments()[0].steady < 0.02
    True
    """
    return _run(pf, depth, depth, by, duration, ripple, noise, seed)


def depth_step_run(
    pf: "ParameterFile",
    by: By = "adaptive",
    *,
    depths: tuple[float, ...] = (2.0, 1.0, 2.0, 4.0, 2.0),
    between: float = BETWEEN,
    ripple: float = 0.0,
    noise: float = 0.0,
    seed: int = 1,
) -> ForceRun:
    """Run with steps of depth, while the set point remains that of the first depth.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> run = depth_step_run(published("LYAP"), depths=(2.0, 4.0))
    >>> [round(segment.steady, 4) for segment in run.segments()]
    [0.0, 0.0]
    """
    plan = [(i * between, depth) for i, depth in enumerate(depths)]
    return _run(pf, depths[0], plan, by, between * len(depths), ripple, noise, seed)


def _run(
    pf: "ParameterFile", at: float, depth: Depth, by: By, duration: float, ripple: float, noise: float, seed: int
) -> ForceRun:
    plant = DriveAndCut.from_parameters(pf, depth, ripple=ripple, noise=noise)
    if by == "adaptive":
        stuck = STUCK_AFTER if ripple or noise else 0.0  # a force without them repeats to the last bit
        control = AdaptiveForceControl.from_parameters(pf, at, stuck_after=stuck)
        s = control.settings
        trace = replay(control, plant, duration=duration, dt=s.sample_time, seed=seed, record=RECORDED)
    elif by == "pi":
        pi = FixedForcePi.from_parameters(pf, at)
        s, dt = pi.settings, pi.pi.gains.sample_time
        trace = replay(pi, plant, duration=duration, dt=dt, seed=seed, record=("force", "k", "speed"))
    else:
        raise UsageError(f"a run by {by!r}: give 'adaptive' or 'pi'.")
    return ForceRun(by, trace, s, plant, s.samples * s.sample_time)
