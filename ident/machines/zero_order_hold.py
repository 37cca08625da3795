"""From a continuous machine to its samples, with the input held between them and any delay.

x' = A x + B u over a time h with u held: exp([[A, B], [0, 0]] h) = [[Phi, Gamma], [0, 1]]. A delay of whole samples
and a part of one splits Gamma in two (Franklin, Powell & Workman 1998, Digital Control of Dynamic Systems, sections
4.3.3 and 4.3.4).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import IdentError
from ..model import Model
from .continuous import ContinuousModel

Array = NDArray[np.float64]


def sampled(num: ArrayLike, den: ArrayLike, dt: float, delay: float = 0.0) -> Model:
    """Discrete model of num(s) / den(s) exp(-delay s) with its input held between samples.

    Parameters
    ----------
    num, den : array_like
        Highest power of s first.
    dt : float
        Sample time, s.
    delay : float
        Seconds, any: a part of a sample adds one coefficient to b and none to a.

    Raises
    ------
    IdentError
        dt or delay out of range; a numerator of higher degree than the denominator.

    Examples
    --------
    >>> model = sampled([1.0], [0.13, 1.0], dt=0.01, delay=0.025)  # a servo of 0.13 s
    >>> model.nk, model.dc_gain.__round__(12), model.b.round(4).tolist()
    (3, 1.0, [0.0, 0.0, 0.0, 0.0377, 0.0363])
    """
    from scipy.linalg import companion

    if not (np.isfinite(dt) and dt > 0):
        raise IdentError(f"sample time {dt!r} s: above zero, for instance 0.01.")
    plant = ContinuousModel(np.asarray(num, dtype=np.float64), np.asarray(den, dtype=np.float64), float(delay))
    n = len(plant.den) - 1
    full = np.r_[np.zeros(n + 1 - len(plant.num)), plant.num]
    whole = int(np.floor(delay / dt + 1e-9))
    part = min(max(delay / dt - whole, 0.0), 1.0)
    part = 0.0 if part < 1e-9 else part
    if n == 0:
        late = whole + (part > 0)
        return Model(b=np.r_[np.zeros(late), full[0]], a=np.ones(1), nk=late, sample_time=dt)
    power = dt ** np.arange(n + 1)  # time counted in samples: coefficients of one size
    A = np.asarray(companion(plant.den * power), dtype=np.float64)
    B = np.eye(n)[:, 0]
    C = (full * power)[1:] - full[0] * (plant.den * power)[1:]
    late_phi, late_gamma = held(A, B, part)
    rest_phi, rest_gamma = held(A, B, 1 - part)
    a = np.real(np.poly(np.exp(np.roots(plant.den) * dt)))
    phi = rest_phi @ late_phi
    b = numerator(phi, rest_gamma, C, a)
    b = np.r_[b, 0.0] + np.r_[0.0, numerator(phi, rest_phi @ late_gamma, C, a)]
    b += full[0] * (np.r_[a, 0.0] if part == 0 else np.r_[0.0, a])
    b = b if part > 0 else b[:-1]
    nk = whole + (1 if full[0] == 0 or part > 0 else 0)
    return Model(b=np.r_[np.zeros(nk), b[nk - whole :]], a=a, nk=nk, sample_time=dt)


def held(A: Array, B: Array, h: float) -> tuple[Array, Array]:
    """Phi and Gamma of x' = A x + B u over a time h with u held."""
    from scipy.linalg import expm

    n = len(A)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = A * h, B * h
    whole = np.asarray(expm(block), dtype=np.float64)
    return whole[:n, :n], whole[:n, n]


def numerator(phi: Array, gamma: Array, C: Array, a: Array) -> Array:
    """B of b / a = C (z - phi)^-1 gamma, in z^-1, as long as a: its impulse response times a."""
    h, x = np.zeros(len(a)), gamma
    for k in range(1, len(a)):
        h[k] = C @ x
        x = phi @ x
    return np.convolve(h, a)[: len(a)]
