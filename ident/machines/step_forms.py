"""Unit step responses of first and second order, and first guesses of their coefficients read off the curve.

    order 1    1 / (T s + 1)                           T
    order 2    1 / (s^2 / wn^2 + 2 zeta s / wn + 1)    wn, zeta

Guesses: area method and overshoot, Astrom & Hagglund 1995, PID Controllers, sections 2.4 and 2.5.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .step_edges import Stretch

Array = NDArray[np.float64]
SHAPES = {1: ("time_constant",), 2: ("natural_frequency", "damping")}


def unit_response(order: int, t: Array, shape: Sequence[float]) -> Array:
    """Response at times t (n,) after the delay; zero before.

    >>> unit_response(1, np.array([-1.0, 0.5]), [0.5]).round(3).tolist()
    [0.0, 0.632]
    """
    t = np.maximum(t, 0.0)
    if order == 1:
        return np.asarray(-np.expm1(-t / shape[0]))
    wn, zeta = shape
    if zeta > 1 + 1e-3:
        slow, fast = time_constants(wn, zeta)
        return np.asarray(-(slow * np.expm1(-t / slow) - fast * np.expm1(-t / fast)) / (slow - fast))
    damp = np.exp(-zeta * wn * t)
    x = (zeta**2 - 1) * (wn * t) ** 2
    # cosh(sqrt x) and sinh(sqrt x) / sqrt x, also for x < 0: no division by what is zero at zeta = 1
    root = np.sqrt(x.astype(np.complex128))
    sine = np.where(np.abs(x) < 1e-8, 1 + x / 6, np.real(np.sinh(root) / np.where(root == 0, 1, root)))
    return np.asarray(1 - damp * (np.real(np.cosh(root)) + zeta * wn * t * sine))


def time_constants(wn: float, zeta: float) -> tuple[float, float]:
    """The slow and the fast one of a second order with zeta >= 1, s; their product is 1 / wn^2."""
    slow = (zeta + np.sqrt(max(zeta**2 - 1, 0.0))) / wn
    return float(slow), float(1 / (wn**2 * slow))


def guesses(order: int, runs: Sequence[Stretch], delay: float | None) -> list[tuple[list[float], float]]:
    """Shapes and delays to start from: ([T] or [wn, zeta], delay) each."""
    z, t, dt = _longest(runs)
    area = max(float(np.trapezoid(1 - z, t)), dt)  # mean residence time: delay and time constants together
    T = float(math.e * np.trapezoid(z[t <= area], t[t <= area])) if (t <= area).sum() > 1 else area
    dead = min(max(area - T, 0.0), 0.9 * area)
    delays = [dead, dead / 2, 0.0] if delay is None else [delay]
    out: list[tuple[list[float], float]] = []
    for late in delays:
        lag = max(area - late, dt)
        if order == 1:
            out.append(([lag], late))
        else:
            out += [([2 * zeta / lag, zeta], late) for zeta in (0.5, 1.0, 2.0)]
            out += _from_overshoot(z, t, late)
    return out


def overshoot(runs: Sequence[Stretch]) -> float:
    """How far the longest response passes its end value, as a part of the step."""
    return max(float(_longest(runs)[0].max()) - 1, 0.0)


def _from_overshoot(z: Array, t: Array, late: float) -> list[tuple[list[float], float]]:
    """Zeta from the height of the first peak, wn from its time."""
    peak = int(np.argmax(z))
    over = float(z[peak]) - 1
    if over < 0.01 or t[peak] <= late:
        return []
    decrement = np.log(over) / np.pi
    zeta = float(min(max(-decrement / np.hypot(1, decrement), 0.02), 0.95))
    return [([float(np.pi / (t[peak] - late) / np.sqrt(1 - zeta**2)), zeta], late)]


def _longest(runs: Sequence[Stretch]) -> tuple[Array, Array, float]:
    """The response to the edge with the longest plateau behind it, brought to 0 ... 1; times from the edge; spacing."""
    best = (np.zeros(2), np.arange(2.0), 1.0)
    for run in runs:
        ends = [*run.at[1:], run.time[-1] + 1e-9]
        for at, end in zip(run.at, ends, strict=True):
            inside = (run.time >= at) & (run.time < end)
            y, t = run.y[inside], run.time[inside] - at
            if len(y) < 4 or (t[-1] <= best[1][-1] and len(best[0]) > 2):
                continue
            before = run.y[run.time <= at]
            start = float(before[-3:].mean()) if before.size else float(y[0])
            final = float(np.mean(y[-max(len(y) // 10, 1) :]))
            if final != start:
                best = ((y - start) / (final - start), t, float(np.median(np.diff(t))))
    return best
