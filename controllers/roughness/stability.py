"""What the loop does by theory: the feed law made linear in the logarithms of feed and force.

With small letters for relative deviations, servo `f' ts + f = c`, process `x' tc + x = f`, and the law

    servo reading      c = f - (x + e)     f = -e (tc s + 1) / (tc ts s^2 + ts s + 1)     stable for every tc and ts
    command reading    c' = -(x + e) / T   stable only while 1/T < 1/tc + 1/ts

so that f(t-1) must be the servo's output: at T = 10 ms the other reading is an integrator of gain 100/s against a limit
of 17.9/s. Derived here; the paper prints no analysis.
"""

import math
from dataclasses import dataclass

import numpy as np

from ...core.errors import UsageError
from .plant import decays


@dataclass(frozen=True, slots=True)
class LoopFigures:
    """The linear loop.

    Attributes
    ----------
    natural_frequency : float
        rad/s, 1/sqrt(tc ts), with the servo reading.
    damping : float
        sqrt(ts/tc)/2.
    crossover : float
        Hz: force changes slower than this are lessened, faster ones enlarged.
    enlarged : float
        Largest factor that a change of force grows by.
    gain, limit : float
        1/s: of the integrator that the command reading makes, and what a continuous loop would stand.
    servo_radius, command_radius : float
        Largest pole of the sampled loop in either reading; below 1 is stable.
    """

    natural_frequency: float
    damping: float
    crossover: float
    enlarged: float
    gain: float
    limit: float
    servo_radius: float
    command_radius: float


def loop_figures(tc: float, ts: float, dt: float) -> LoopFigures:
    """Figures of the loop with a process lag ``tc``, a servo lag ``ts`` and a sample every ``dt`` s.

    Raises
    ------
    UsageError
        One of them is not above zero.

    Examples
    --------
    >>> figures = loop_figures(60 / 610, 0.13, 0.01)
    >>> round(figures.gain), round(figures.limit, 1), round(figures.servo_radius, 2), round(figures.command_radius, 2)
    (100, 17.9, 0.95, 1.04)
    """
    if not min(tc, ts, dt) > 0:
        raise UsageError(f"lags of {tc:g} and {ts:g} s sampled every {dt:g} s: the loop's figures need all above zero.")
    both = tc * ts
    return LoopFigures(
        natural_frequency=both**-0.5,
        damping=math.sqrt(ts / tc) / 2,
        crossover=1 / (2 * math.pi * math.sqrt(2 * both)),
        enlarged=_enlarged(tc, ts),
        gain=1 / dt,
        limit=1 / tc + 1 / ts,
        servo_radius=_radius(tc, ts, dt, integrator=False),
        command_radius=_radius(tc, ts, dt, integrator=True),
    )


def _enlarged(tc: float, ts: float) -> float:
    """Peak of |F/e| = |1 - 1/(tc ts s^2 + ts s + 1)| over frequency."""
    s = 1j * np.geomspace(0.01, 100, 4001) / math.sqrt(tc * ts)
    return float(np.abs(1 - 1 / (tc * ts * s**2 + ts * s + 1)).max())


def _radius(tc: float, ts: float, dt: float, *, integrator: bool) -> float:
    """Spectral radius over (f, x, c): the command that answers a sample, then a step of servo and process."""
    of_process, of_servo, between = decays(tc, ts, dt)
    answer = np.array([[1.0, 0, 0], [0, 1, 0], [0, -1, 1] if integrator else [1, -1, 0]])
    held = np.array([[of_servo, 0, 1 - of_servo], [between, of_process, 1 - of_process - between], [0, 0, 1]])
    return float(np.abs(np.linalg.eigvals(held @ answer)).max())
