"""A mass with viscous and Coulomb friction under a force held between samples, run exactly, sticking included.

    M dv/dt = F - offset - Fv v - Fc sign(v);    at rest it stays while |F - offset| <= Fc

Between changes of direction this is linear: v runs to its end speed exponentially. A sample in which v meets zero is
cut there, and the mass sticks or turns.
"""

from math import exp, expm1, log

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def velocity_and_travel(
    force: Array, dt: float, M: float, Fv: float, Fc: float, offset: float, v0: float = 0.0
) -> tuple[Array, Array]:
    """Velocity (N,) and travel from the first sample (N,), at the samples of ``force`` (N,), each held for ``dt``.

    >>> v, x = velocity_and_travel(np.array([3.0, 3.0, 0.0, 0.0]), 1.0, M=1.0, Fv=0.0, Fc=1.0, offset=0.0)
    >>> v.tolist(), x.tolist()
    ([0.0, 2.0, 4.0, 3.0], [0.0, 1.0, 4.0, 7.5])
    """
    n = len(force)
    speeds, places = np.empty(n), np.empty(n)
    v, x = float(v0), 0.0
    for k, net in enumerate((force - offset).tolist()):
        speeds[k], places[k] = v, x
        v, x = _one_sample(v, x, net, dt, M, Fv, Fc)
    return speeds, places


def _one_sample(v: float, x: float, net: float, dt: float, M: float, Fv: float, Fc: float) -> tuple[float, float]:
    """Velocity and place at the end of a sample."""
    left = dt
    for _ in range(2):  # under a constant force v meets zero at most once
        if v == 0.0 and abs(net) <= Fc:
            return 0.0, x
        sign = 1.0 if v > 0 or (v == 0.0 and net > 0) else -1.0
        push = net - sign * Fc
        end, moved = _slide(v, push, left, M, Fv)
        if v == 0.0 or end * sign > 0:
            return end, x + moved
        stop = min(_time_to_rest(v, push, M, Fv), left)
        x += _slide(v, push, stop, M, Fv)[1]
        v, left = 0.0, left - stop
    return v, x


def _slide(v: float, push: float, t: float, M: float, Fv: float) -> tuple[float, float]:
    """Velocity and travel after t under a constant push, no change of direction; exact also as Fv goes to zero."""
    z = Fv * t / M
    if abs(z) < 1e-5:  # series: the closed form divides by Fv squared
        gain = t * (1 - z / 2 + z * z / 6)
        return v + (push - Fv * v) / M * gain, v * gain + push / M * t * t * (0.5 - z / 6 + z * z / 24)
    gain = -expm1(-z) * M / Fv  # integral of exp(-Fv s / M)
    return v * exp(-z) + push / M * gain, v * gain + push / Fv * (t - gain)


def _time_to_rest(v: float, push: float, M: float, Fv: float) -> float:
    """When v meets zero."""
    if abs(Fv * v) < 1e-9 * abs(push):
        return -M * v / push
    return M / Fv * log(1 - Fv * v / push)
