"""Does the output rise in straight lines? Then a rate limit answers the step, and no time constant describes it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..estimators.filters import ROUNDING
from .step_edges import Stretch

Array = NDArray[np.float64]
BETTER = 0.5  # the ramps' squared error below this part of the linear fit's: then the ramps are believed


def ramp_rate(runs: Sequence[Stretch], gain: float, levels: Sequence[float], loss: float) -> float | None:
    """Slope of the ramps, unit_y/s, where ramps describe the record clearly better than a loss; else None.

    Parameters
    ----------
    runs : sequence of Stretch
    gain : float
        unit_y per unit_u, of the linear fit; the ramps find their own from there.
    levels : sequence of float
        Output before the first edge of each stretch.
    loss : float
        Squared error of the linear fit.
    """
    from scipy.optimize import minimize

    run = runs[0]
    dt = float(np.median(np.diff(run.time)))
    steep = float(np.percentile(np.abs(np.diff(run.y)) / np.diff(run.time), 90))
    if not steep > 0 or loss <= ROUNDING * sum(float(run.y @ run.y) for run in runs):
        return None

    def error(p: Array) -> float:
        rate, late, own = steep * np.exp(p[0]), dt * abs(p[1]), gain * np.exp(p[2])
        return sum(
            float(np.sum((run.y - ramps(run, own, level, rate, late)) ** 2))
            for run, level in zip(runs, levels, strict=True)
        )

    # rate, delay and gain move by a factor 1.6, two samples and a tenth
    simplex = np.array([[0.0, 1.0, 0.0], [0.5, 1.0, 0.0], [0.0, 3.0, 0.0], [0.0, 1.0, 0.1]])
    best = minimize(error, simplex[0], method="Nelder-Mead", options={"maxiter": 150, "initial_simplex": simplex})
    return steep * float(np.exp(best.x[0])) if float(best.fun) < BETTER * loss else None


def ramps(run: Stretch, gain: float, level: float, rate: float, delay: float) -> Array:
    """Output (n,) that runs to gain times the input at a rate, from ``level``, a delay behind it.

    >>> run = Stretch(np.arange(5.0), np.zeros(5), at=np.array([1.0]), size=np.array([2.0]))
    >>> ramps(run, gain=1.0, level=0.0, rate=0.8, delay=0.0).round(9).tolist()
    [0.0, 0.0, 0.8, 1.6, 2.0]
    """
    out = np.full(len(run.time), level)
    here = target = level
    begins = run.at + delay
    for k, begin in enumerate(begins):
        target += gain * run.size[k]
        after = run.time >= begin
        out[after] = here + np.clip(target - here, -rate * (run.time[after] - begin), rate * (run.time[after] - begin))
        if k + 1 < len(begins):
            reach = rate * (begins[k + 1] - begin)
            here += float(np.clip(target - here, -reach, reach))
    return out
