"""Lyapunov function of LYAP's proof along a run, and the largest step at which it still decreases.

    V = e' P e + phi~' Gamma^-1 phi~,    e = (F~, F~'),    phi~ = (m^ - m, alpha^ - alpha, beta^ - beta) / k
    P = [[beta + Kd lambda + lambda (alpha + Kd), lambda m], [lambda m, m]] / k,    Gamma = diag(g1, g2, g3)

The paper prints V (9) without P. With this one

    V' = -2 (alpha + Kd - lambda m) F~'^2 - 2 lambda (beta + Kd lambda) F~^2

so that V falls where alpha + Kd > lambda m (all of alpha, beta, m over k). Averaged over a revolution the two equations
hold as they stand, with the averages of force, F_d and command; so V is computed with the error that the law uses. It
needs the plant's true parameters: it is an analysis, no controller has it.

The law is written in continuous time. Two discretizations, compared at the depth of the highest plant gain:

    as built      averaged over a revolution, trapezoidal rule between samples, F_d at the middle of the command
    as printed    E and the estimates as they stand at a sample, held to the next (Euler), exact F and F', no limits

each with the file's gain Kd, and with ten times of it.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array, Flags
from ...core.display import Displayable
from ...core.errors import UsageError
from .controller import AdaptiveForceControl
from .plant import DriveAndCut
from .settings import settings_for
from .signals import STEADY, ReferenceModel

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ..loop import Trace
    from .plant import DriveAndCut
    from .settings import ForceSettings


RECORDED = (
    "m", "alpha", "beta", "error", "error_rate", "limited", "closed", "adapting", "k", "force", "speed",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Energy:
    """Lyapunov function V along a run.

    Attributes
    ----------
    V : ndarray, shape (n,)
    free : ndarray of bool, shape (n,)
        Where the proof applies: no limit active and constant depth for a revolution.
    rise : float
        The largest rise of V above what it had fallen to, within a segment where the proof applies, as a share of V
        at the beginning of that segment.
    largest : float
        The largest such rise in the unit of V: the share is uninformative where a segment begins near zero.
    starts : tuple of int
        First samples of the segments.
    """

    V: Array
    free: Flags
    rise: float
    largest: float
    starts: tuple[int, ...]


def P(m: Array, alpha: Array, beta: Array, Kd: float, lam: float) -> Array:
    """The matrix of the proof, shape (n, 2, 2); m, alpha, beta over k, shape (n,).

    Raises
    ------
    UsageError
        alpha + Kd is not above lambda m: V need not fall.

    Examples
    --------
    >>> P(np.array([2e-3]), np.array([0.125]), np.array([1.25]), Kd=0.05, lam=30.0).round(3).tolist()
    [[[8.0, 0.06], [0.06, 0.002]]]
    """
    if not (alpha + Kd > lam * m).all():
        raise UsageError("alpha + Kd is not above lambda m, so V need not fall: lower lambda or raise Kd.")
    return np.array([[beta + Kd * lam + lam * (alpha + Kd), lam * m], [lam * m, m]]).transpose(2, 0, 1)


def energy(trace: "Trace", settings: "ForceSettings", plant: "DriveAndCut") -> Energy:
    """V along a replay that recorded `RECORDED`.

    Parameters
    ----------
    trace : Trace
    settings : ForceSettings
        Of the controller.
    plant : DriveAndCut
        Of the run: its m, d, c; k is in the trace.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers import AdaptiveForceControl, replay
    >>> from fitmodels.controllers.adaptive_force.plant import DriveAndCut
    >>> control = AdaptiveForceControl.from_parameters(published("LYAP"), depth=4.0)
    >>> plant = DriveAndCut(depth=4.0)
    >>> trace = replay(control, plant, duration=1.0, dt=0.001, record=RECORDED)
    >>> energy(trace, control.settings, plant).rise < 1e-12
    True
    """
    r = trace.recorded
    e, estimates = (np.column_stack([r[name] for name in names]) for names in (RECORDED[3:5], RECORDED[:3]))
    V = values_of_V(e, estimates, settings, plant, r["k"])
    free = _free(r["adapting"] > 0, r["k"], settings.samples)
    return Energy(V, free, *rise_of(V, free))


def values_of_V(e: Array, estimates: Array, settings: "ForceSettings", plant: "DriveAndCut", k: Array) -> Array:
    """V (n,) of errors (n, 2), of estimates of m, alpha, beta over k (n, 3) and of the plant's k (n,)."""
    s = settings
    true = np.column_stack([plant.m / k, (plant.m * plant.c + plant.d) / k, plant.d * plant.c / k])
    matrix = P(true[:, 0], true[:, 1], true[:, 2], s.Kd, s.lam)
    V = np.einsum("ni,nij,nj->n", e, matrix, e)
    rates = np.array([s.g1, s.g2, s.g3])
    taught = rates > 0  # a rate of 0 leaves its estimate constant
    return np.asarray(V + ((estimates - true)[:, taught] ** 2 / rates[taught]).sum(axis=1), dtype=np.float64)


def _free(adapting: Flags, k: Array, samples: int) -> Flags:
    """Samples where no limit was active and the depth constant for a revolution, over which the error is averaged."""
    free = adapting.copy()
    for change in np.r_[np.flatnonzero(np.diff(k)), np.flatnonzero(~adapting)] + 1:
        free[change : change + samples + 1] = False
    return free


def rise_of(V: Array, free: Flags) -> tuple[float, float, tuple[int, ...]]:
    """The largest rise of a row (n,) within segments marked free: relative to the first value there, and absolute.

    >>> rise_of(np.array([4.0, 2.0, 3.0, 9.0]), np.array([True, True, True, False]))
    (0.25, 1.0, (0,))
    """
    edges = np.flatnonzero(np.diff(np.r_[False, free, False].astype(int)))
    share, largest, starts = 0.0, 0.0, edges[::2]
    for start, end in zip(starts, edges[1::2], strict=True):
        part = V[start:end]
        above = float((part - np.minimum.accumulate(part)).max())
        largest = max(largest, above)
        share = max(share, above / float(part[0])) if part[0] > 0 else share
    return share, largest, tuple(int(start) for start in starts)


STEPS = (0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002, 0.0001)  # s
STIFF = 10.0
DIVERGED = 1e6  # of the set point
LEAST = 200  # steps: divergence is slow at a long step
SETTLED = 0.02


@dataclass(frozen=True, slots=True, repr=False)
class StepSize(Displayable):
    """Stability of one step size of one discretization.

    Attributes
    ----------
    way : str
        ``as built`` or ``as printed``.
    times : float
        Kd over the file's.
    step : float
        s.
    rise : float
        Largest rise of V while nothing is limited, as a share of its initial value; infinite where the run diverges.
    error : float
        Largest error of the force in the last quarter of the run, as a share of the set point.
    free : float
        Share of the run in which the command was not limited, so that the proof applies.
    """

    way: str
    times: float
    step: float
    rise: float
    error: float
    free: float = 1.0

    @property
    def diverged(self) -> bool:
        """Whether the final error of the force exceeds 100 % of its set point."""
        return not self.error < 1

    @property
    def settled(self) -> bool:
        """Whether the final force is within 2 % of its set point."""
        return self.error <= SETTLED


def step_study(
    pf: "ParameterFile", depth: float | None = None, steps: tuple[float, ...] = STEPS, duration: float = 1.5
) -> tuple[StepSize, ...]:
    """Both discretizations and both gains at each step, without ripple and noise, on the plant of the file's estimates.

    Parameters
    ----------
    depth : float, optional
        One of the set points; by default the deepest.
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
    settings: "ForceSettings", times: float, pf: "ParameterFile", step: float, revolution: float, duration: float
) -> StepSize:
    from ..loop import replay

    s = replace(settings, sample_time=step, samples=round(revolution / step))
    plant = DriveAndCut.from_parameters(pf, s.depth)
    trace = replay(AdaptiveForceControl(s, stuck_after=0.0), plant, duration=duration, dt=step, record=RECORDED)
    late = trace.recorded["error"][-round(STEADY * len(trace.time)) :]
    error = float(np.abs(late).max() / s.set_point)
    found = energy(trace, s, plant)
    return StepSize("as built", times, step, found.rise, error, float(found.free.mean()))


def _printed(settings: "ForceSettings", times: float, pf: "ParameterFile", step: float, duration: float) -> StepSize:
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
