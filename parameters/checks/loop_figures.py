"""Closed loop of the gains and dynamics of a file, and its figures of merit.

    y = G (u + load),    u = F r - C H y,    L = G C H

G is the model in the units of the gains, C the PI with its delay and an average of the command, H the low-pass and an
average of the measurement; F is C with the setpoint weight. Times and shares are those of the unit step of the
reference from rest: 10 to 90 %, within 2 %, lines between the samples.
"""

from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array
from ..sections.dynamics import DynamicsSection, PiSection

Complex = NDArray[np.complex128]
STILL = 1e-7  # to which the slowest pole has decayed at the end of a step
LONGEST = 200_000  # samples of a step
BAND = 0.02
MANY = 300  # coefficients: roots take time with the cube of them
DIFFERENCE = np.array([1.0, -1.0])
RULE = {"backward": np.array([1.0]), "forward": np.array([0.0, 1.0]), "trapezoidal": np.array([0.5, 0.5])}


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """Polynomials in z^-1: plant b / a, controller pn / pd, of the reference rn / pd, measurement hn / hd."""

    b: Array
    a: Array
    pn: Array
    pd: Array
    rn: Array
    hn: Array
    hd: Array
    sample_time: float

    @property
    def characteristic(self) -> Array:
        """Denominator of every closed transfer function."""
        return _sum(_product(self.b, self.pn, self.hn), _product(self.a, self.pd, self.hd))

    @property
    def radius(self) -> float:
        """Largest modulus of a closed pole; infinite where the polynomial is not finite or vanishes."""
        p = np.trim_zeros(self.characteristic, "b")
        if not np.isfinite(p).all() or not len(p) or p[0] == 0:
            return np.inf
        with np.errstate(all="ignore"):
            scaled = p / p[0]
            if not np.isfinite(scaled).all():
                return np.inf
            return _radius(scaled) if len(scaled) > MANY else float(np.abs(np.roots(scaled)).max(initial=0.0))

    def run(self, num: Array, signal: Array) -> Array:
        """``num`` over the characteristic polynomial, driven by a signal (n,)."""
        from scipy.signal import lfilter

        with np.errstate(all="ignore"):
            return np.asarray(lfilter(num, self.characteristic, signal), dtype=np.float64)

    def open(self, theta: Array) -> Complex:
        """L at angles omega T, shape (n,)."""
        z = np.exp(-1j * theta)
        above, below = _product(self.b, self.pn, self.hn), _product(self.a, self.pd, self.hd)
        with np.errstate(all="ignore"):
            return np.asarray(np.polyval(above[::-1], z) / np.polyval(below[::-1], z), dtype=np.complex128)


def closed_loop(dynamics: DynamicsSection, pi: PiSection) -> ClosedLoop:
    """The loop of a file's gains round its dynamics, in the units of the gains."""
    with np.errstate(all="ignore"):
        b = np.array(dynamics.b) * (pi.scaling_y / pi.scaling_u)
        pn, pd = _controller(pi, pi.kp)
        rn, _ = _controller(pi, pi.setpoint_weight * pi.kp)
    gain = -np.expm1(-pi.sample_time / pi.filter_time) if pi.filter_time else 1.0
    hn = gain * _mean(pi.average if pi.average_of == "measurement" else 1)
    hd = np.array([1.0, gain - 1.0]) if pi.filter_time else np.ones(1)
    return ClosedLoop(b, np.array(dynamics.a), pn, pd, rn, hn, hd, pi.sample_time)


def figures(loop: ClosedLoop) -> dict[str, float]:
    """Figures of a stable loop by name, as in `PiSpecification` and `PiFigures`; inf where one does not exist."""
    radius = loop.radius
    n = LONGEST if radius >= 1 else int(np.clip(np.log(STILL) / np.log(max(radius, 1e-3)), 50, LONGEST))
    ones, T = np.ones(n), loop.sample_time
    y = loop.run(_product(loop.b, loop.rn, loop.hd), ones)
    command = loop.run(_product(loop.a, loop.rn, loop.hd), ones)
    load = loop.run(_product(loop.b, loop.pd, loop.hd), ones)
    noise = loop.run(_product(loop.a, loop.pn, loop.hn), np.r_[1.0, np.zeros(n - 1)])
    with np.errstate(all="ignore"):
        final = _at_rest(loop)
        found = {
            **_step(y / final if final else y * np.inf, T),
            "steady_error": 1 - final,
            "disturbance": np.abs(load).max(),
            "travel": np.abs(np.diff(command, prepend=0.0)).sum(),
            "peak_u": np.abs(command).max(),
            "noise_gain": np.sqrt((noise**2).sum()),
            **_margins(loop),
        }
    return {name: float(value) if np.isfinite(value) else np.inf for name, value in found.items()}


def _controller(pi: PiSection, kp: float) -> tuple[Array, Array]:
    extra = DIFFERENCE if pi.form == "incremental_sum" else np.ones(1)
    path = np.r_[np.zeros(pi.delay), _mean(pi.average if pi.average_of == "command" else 1)]
    if pi.ki == 0:
        return kp * path, extra
    gains = _sum(kp * DIFFERENCE, pi.ki * pi.sample_time * RULE[pi.integration])
    return _product(gains, path), _product(DIFFERENCE, extra)


def _radius(p: Array) -> float:
    """Largest modulus of a root of a long polynomial, at least 0.99; infinite where it is not below 1."""
    if not _inside(p, 1.0):
        return np.inf
    low, high = 0.99, 1.0
    while high - low > 1e-6:
        middle = (low + high) / 2
        low, high = (low, middle) if _inside(p, middle) else (middle, high)
    return high


def _inside(p: Array, radius: float) -> bool:
    """Whether all roots of p_0 + p_1 z^-1 + ... lie within a radius (Schur-Cohn: every reflection below 1)."""
    p = p / radius ** np.arange(len(p))
    while len(p) > 1:
        k = p[-1] / p[0]
        if not abs(k) < 1:
            return False
        p = p[:-1] - k * p[:0:-1]
    return True


def _at_rest(loop: ClosedLoop) -> float:
    """Final value of the step: the closed transfer function at z = 1; an integrator makes it 1 exactly."""
    above, below = loop.b.sum() * loop.rn.sum() * loop.hd.sum(), loop.characteristic.sum()
    if abs(_product(loop.a, loop.pd).sum()) <= 1e-13 * np.abs(loop.a).sum() and above:
        return 1.0
    return float(above / below) if below else np.inf


def _step(share: Array, T: float) -> dict[str, float]:
    rise = _first(share, 0.9) - _first(share, 0.1) if share.max(initial=-np.inf) >= 0.9 else np.inf
    return {
        "rise_time": rise * T,
        "settling_time": _settled(share) * T,
        "overshoot": max(share.max() - 1, 0.0),
        "undershoot": max(-share.min(), 0.0),
    }


def _first(share: Array, level: float) -> float:
    """Sample, between samples, at which a level is first reached."""
    k = int(np.argmax(share >= level))
    before = share[k - 1] if k else 0.0
    return max(k - 1 + float((level - before) / (share[k] - before)), 0.0)


def _settled(share: Array) -> float:
    outside = np.flatnonzero(~(np.abs(share - 1) <= BAND))
    if not outside.size:
        return 0.0
    k = int(outside[-1])
    if k + 1 >= len(share):
        return np.inf
    edge = 1 + BAND if share[k] > 1 else 1 - BAND
    return k + float((edge - share[k]) / (share[k + 1] - share[k]))


def _margins(loop: ClosedLoop) -> dict[str, float]:
    theta = np.unique(np.r_[np.geomspace(1e-7, 1, 6000), np.linspace(1e-3, 1, 6000)]) * np.pi
    L = loop.open(theta)
    ok = np.isfinite(L)
    theta, L = theta[ok], L[ok]
    if not len(L):
        return {"ms": np.inf, "phase_margin": 0.0, "delay_margin": 0.0, "gain_margin": 1.0}
    size = np.log(np.maximum(np.abs(L), 1e-300))
    cross = np.flatnonzero((size[1:] > 0) != (size[:-1] > 0))
    share = size[cross] / (size[cross] - size[cross + 1])
    at = theta[cross] + share * (theta[cross + 1] - theta[cross])
    lead = np.angle(-loop.open(at))
    return {
        "ms": (1 / np.abs(1 + L)).max(),
        "phase_margin": float(np.degrees(np.abs(lead).min(initial=np.inf))),
        "delay_margin": float((np.mod(lead, 2 * np.pi) / at).min(initial=np.inf)) * loop.sample_time,
        "gain_margin": _gain_margin(loop, L),
    }


def _gain_margin(loop: ClosedLoop, L: Complex) -> float:
    """The factor nearest 1, as a ratio, that puts L on -1."""
    cross = np.flatnonzero((L.imag[1:] < 0) != (L.imag[:-1] < 0))
    share = L.imag[cross] / (L.imag[cross] - L.imag[cross + 1])
    real = L.real[cross] + share * (L.real[cross + 1] - L.real[cross])
    ends = loop.open(np.array([0.0, np.pi])).real
    real = np.r_[real, ends[np.isfinite(ends)]]
    logs = -np.log(-real[real < 0])
    return float(np.exp(logs[np.argmin(np.abs(logs))])) if logs.size else np.inf


def _mean(samples: int) -> Array:
    return np.full(samples, 1.0 / samples)


def _product(*polynomials: Array) -> Array:
    with np.errstate(all="ignore"):
        return np.asarray(reduce(np.convolve, polynomials), dtype=np.float64)


def _sum(*polynomials: Array) -> Array:
    out = np.zeros(max(len(p) for p in polynomials))
    with np.errstate(all="ignore"):
        for p in polynomials:
            out[: len(p)] += p
    return out
