"""Open loops on the unit circle: L = kp' X + ki T W at any frequency, and the grid on which to look for extremes."""

import numpy as np
from numpy.typing import NDArray

from .loops import Loops

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

RATIO = 1.08  # between neighbours of the grid at low frequencies
DECADES = 10  # below the Nyquist frequency
TINY = 1e-9  # a pole this near 1 is an integrator


def open_loops(loops: Loops, theta: Array) -> Complex:
    """L of loop k at angle ``theta[k]`` = omega T in (0, pi], shape (m,)."""
    z, sine = np.exp(-1j * theta), _one_less(theta)
    plant = _horner(loops.b, z) / _horner(loops.a, z)
    return np.asarray(plant * _around(loops, theta, z, sine) * (loops.proportional + loops.integral / sine))


def parts(b: Array, a: Array, loops: Loops, theta: Array) -> tuple[Complex, Complex]:
    """X and W (nf,) of one plant, so that L = kp' X + ki T W."""
    z, sine = np.exp(-1j * theta), _one_less(theta)
    X = _horner(b[:, None], z) / _horner(a[:, None], z) * _around(loops, theta, z, sine)
    return X, X / sine


def grid(b: Array, a: Array, loops: Loops) -> Array:
    """Angles in (0, pi]: even in the logarithm, then evenly spaced, and close together near sharp resonances."""
    kind = loops.kind
    step = np.pi / (20 * (2 + kind.delay + kind.average + len(b)))
    bend = step / np.log(RATIO)
    roots = np.concatenate([np.roots(np.trim_zeros(p, "b")) for p in (a, np.trim_zeros(b, "f")) if np.any(p)])
    low = min(_lowest(b, a, loops), bend / 2)
    slow = np.geomspace(low, bend, int(np.log(bend / low) / np.log(RATIO)) + 2)
    even = np.linspace(bend, np.pi, int((np.pi - bend) / step) + 2)
    angles = np.concatenate([slow, even, *_near(roots)])
    return np.unique(angles[(angles >= low) & (angles <= np.pi)])


def _lowest(b: Array, a: Array, loops: Loops) -> float:
    """Below every crossover and every corner: what lies lower is a straight line, or a constant."""
    gaps = np.abs(1 - np.roots(np.trim_zeros(a, "b")))
    corners = [*gaps[gaps > TINY], *_corners(loops)]
    decades = np.pi * np.power(10.0, np.arange(-DECADES, 0))
    X, W = parts(b, a, loops, decades)
    size = np.abs(np.outer(loops.proportional, X) + np.outer(loops.integral, W))
    above = np.all(size > 3, axis=0)
    if above[0]:  # an integrator: where all |L| exceed 3 no crossover is left
        corners.append(decades[-1 if above.all() else int(np.argmin(above)) - 1])
    return float(max(0.05 * min(corners, default=1.0), decades[0]))


def _corners(loops: Loops) -> Array:
    """Smallest angle at which a PI turns from integral to proportional."""
    both = (loops.proportional != 0) & (loops.integral != 0)
    return np.abs(loops.integral[both] / loops.proportional[both]).min(keepdims=True) if both.any() else np.empty(0)


def _near(roots: Complex) -> list[Array]:
    """Angles round the roots that lie close to the circle and away from 1: there L turns within a hair."""
    out = []
    for root in roots:
        centre, width = abs(np.angle(root)), max(abs(1 - abs(root)), 1e-7)
        if width < 0.2 * centre:
            away = width * np.geomspace(0.05, 20, 24)
            out.append(np.concatenate([centre - away, [centre], centre + away]))
    return out


def _around(loops: Loops, theta: Array, z: Complex, sine: Complex) -> Complex:
    """All in the loop but the plant and the PI: delay, average, low-pass, and the last sum of incremental_sum."""
    kind = loops.kind
    out = z**kind.delay if kind.delay else np.ones_like(z)
    if kind.average > 1:
        out = out * _horner(np.full((kind.average, 1), 1.0 / kind.average), z)
    if kind.filter_time:
        gain = float(-np.expm1(-kind.sample_time / kind.filter_time))
        out = out * gain / (gain + (1 - gain) * sine)
    return out / sine if kind.form == "incremental_sum" else out


def _one_less(theta: Array) -> Complex:
    """1 - exp(-j theta) without the cancellation at small angles."""
    return np.asarray(2 * np.sin(theta / 2) ** 2 + 1j * np.sin(theta))


def _horner(p: Array, z: Complex) -> Complex:
    """Polynomial in z^-1 given as rows of coefficients (n, 1) or (n, m) at m points."""
    out = np.broadcast_to(p[-1] + 0j, np.broadcast_shapes(p[-1].shape, z.shape)).copy()
    for c in p[-2::-1]:
        out *= z
        out += c
    return out
