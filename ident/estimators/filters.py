"""Filters and lags by segment, stability of polynomials, and covariances under coloured noise.

Each segment is filtered from rest: no filter state and no regressor crosses a segment boundary. An output-error
estimate is consistent under coloured noise, but sigma^2 (J'J)^-1 is then wrong, often by half. With the error modelled
as an autoregression H e = w (w white),

    cov theta = (J'J)^-1 J' R J (J'J)^-1,    R = s^2 (H'H)^-1,

which is s^2 (J'J)^-1 for white errors (order 0). Source: Soderstrom & Stoica 1989, section 7.5.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from ...core.arrays import Array

ROUNDING = 1e-28  # of the squares of the data: a loss below it is rounding of the arithmetic
EDGE = 1 - 1e-6  # largest modulus of a root of an estimate: a time constant of a million samples


def filtered(num: Array | list[float], den: Array | list[float], x: Array, stretches: Sequence[slice]) -> Array:
    """``num / den`` x, from rest in each segment; x (N,) or (N, k), same shape returned."""
    one = _moving_average if len(den) == 1 else recursive
    if len(stretches) == 1:
        return one(num, den, x)
    out = np.empty_like(x)
    for s in stretches:
        out[s] = one(num, den, x[s])
    return out


def recursive(num: Array | list[float], den: Array | list[float], x: Array, axis: int = 0) -> Array:
    """``num / den`` x along an axis, from rest, by the filter of `scipy.signal.lfilter`.

    >>> recursive([1.0], [1.0, -0.5], np.array([1.0, 0.0, 0.0])).tolist()
    [1.0, 0.5, 0.25]
    """
    return np.asarray(_scipy_filter()(num, den, x, axis), dtype=np.float64)


@cache
def _scipy_filter() -> Callable[..., Array]:
    """The filter that `lfilter` calls: its checks take longer than a short signal. `lfilter` if the name is gone."""
    try:
        from scipy.signal._sigtools import _linear_filter
    except ImportError:
        from scipy.signal import lfilter

        return lfilter
    return _linear_filter


def _moving_average(num: Array | list[float], den: Array | list[float], x: Array) -> Array:
    """The same of a polynomial, by convolution: scipy's general path is ten times slower for short signals."""
    if x.ndim == 1:
        return np.convolve(x, num)[: len(x)] / den[0]
    out = np.empty_like(x, order="F")
    for k in range(x.shape[1]):
        out[:, k] = np.convolve(x[:, k], num)[: len(x)] / den[0]
    return out


def lagged(x: Array, lags: Sequence[int], stretches: Sequence[slice]) -> Array:
    """Column k is x (N,) delayed by ``lags[k]`` samples, zero before each segment; shape (N, len(lags))."""
    out = np.zeros((len(x), len(lags)), order="F")
    for s in stretches:
        n = s.stop - s.start
        for k, lag in enumerate(lags):
            if lag < n:
                out[s.start + lag : s.stop, k] = x[s.start : s.stop - lag]
    return out


def is_stable(polynomial: Array, radius: float = 1.0) -> bool:
    """Whether every root of 1 + p_1 z^-1 + ... has a modulus below ``radius`` (Schur-Cohn: every reflection below 1).

    >>> is_stable(np.array([1.0, -0.5])), is_stable(np.array([1.0, -1.0]))
    (True, False)
    """
    p = [x / radius**k for k, x in enumerate(polynomial.tolist())]
    while len(p) > 1:
        k = p[-1] / p[0]
        if not abs(k) < 1:  # a NaN is not stable
            return False
        p = [x - k * y for x, y in zip(p[:-1], reversed(p[1:]), strict=True)]
    return True


def reflected(polynomial: Array) -> Array:
    """The polynomial with roots outside the unit circle reflected to 1/conj(root), which keeps the shape of |response|.

    >>> reflected(np.array([1.0, -2.0])).tolist()
    [1.0, -0.5]
    """
    if is_stable(polynomial, EDGE) or not np.isfinite(polynomial).all():
        return polynomial
    roots = np.roots(polynomial).astype(np.complex128)
    size = np.abs(roots)
    outside = size >= EDGE
    inside = np.minimum(1 / size[outside], 2 * EDGE - 1)
    roots[outside] = inside * roots[outside] / size[outside]
    return np.real(np.poly(np.r_[roots, np.zeros(len(polynomial) - 1 - len(roots))])).astype(np.float64)


def impulse_response(den: Array, length: int) -> Array:
    """Impulse response of 1 / den, up to ``length`` samples or until it has decayed."""
    n = 1024
    while True:
        pulse = np.zeros(min(n, length))
        pulse[0] = 1.0
        h = recursive([1.0], den, pulse)
        # beyond this, denormal numbers would slow the filter down
        if n >= length or np.abs(h[-len(den) :]).max() < 1e-17 * np.abs(h).max():
            return h
        n *= 8


def squares(e: Array) -> float:
    """Sum of squares; infinite where a simulation diverged."""
    with np.errstate(over="ignore", invalid="ignore"):
        total = float(e @ e)
    return total if math.isfinite(total) else math.inf


MAX_ORDER = 20
PATIENCE = 8  # orders without a lower criterion, after which Burg's recursion ends


def autocovariance(e: Array, stretches: Sequence[slice], lags: int) -> Array:
    """Sums of e(t) e(t - k) / N for k = 0 ... lags, no product across segments."""
    sums = [
        sum(float(e[s][k:] @ e[s][: max(s.stop - s.start - k, 0)]) for s in stretches if s.stop - s.start > k)
        for k in range(lags + 1)
    ]
    return np.asarray(sums) / len(e)


def whitening(e: Array, stretches: Sequence[slice], max_order: int = MAX_ORDER) -> tuple[Array, float]:
    """H (starts with 1; its order chosen by BIC) and the variance of w in H e = w, by Levinson's recursion."""
    n = len(e)
    r = autocovariance(e, stretches, min(max_order, n // 10))
    h, v = np.ones(1), float(r[0])
    best, best_bic = (h, v), n * np.log(v) if v > 0 else -np.inf
    for k in range(1, len(r)):
        if v <= 1e-12 * r[0]:
            break
        reflection = -float(h @ r[k:0:-1]) / v
        h = np.r_[h, 0.0] + reflection * np.r_[0.0, h[::-1]]
        v *= 1 - reflection**2
        if n * np.log(v) + k * np.log(n) < best_bic:
            best, best_bic = (h, v), n * np.log(v) + k * np.log(n)
    return best


def burg(parts: Sequence[Array], max_order: int = MAX_ORDER) -> tuple[Array, float]:
    """Coefficients d (starts with 1; order chosen by BIC) and innovations variance of an autoregression d v = e.

    Burg's recursion on the segments ``parts``: always stable, and without the bias of sample autocovariances near the
    unit circle. Source: Burg 1975; Kay 1988, Modern Spectral Estimation, section 7.3.
    """
    n = sum(len(v) for v in parts)
    most = min(max_order, n // 10, min(len(v) for v in parts) - 2)
    x, ends = np.concatenate(parts), np.cumsum([len(v) for v in parts])
    forward, backward = x, x
    d, variance = np.ones(1), float(x @ x) / n
    best, lowest, power = (d, variance), n * math.log(variance) if variance > 0 else -math.inf, variance
    for k in range(1, most + 1):
        if variance <= 1e-12 * power:
            break
        forward, backward = forward[1:], backward[:-1]
        if len(parts) > 1:  # a product across a join is not used
            forward, backward = forward.copy(), backward.copy()
            for end in ends[:-1]:
                forward[end - k : end] = backward[end - k : end] = 0.0
        own = float(forward @ forward + backward @ backward)
        reflection = -2 * float(forward @ backward) / own if own > 0 else 0.0
        forward, backward = forward + reflection * backward, backward + reflection * forward
        d = np.append(d, 0.0)
        d = d + reflection * d[::-1]
        variance *= 1 - reflection**2
        bic = n * math.log(variance) + k * math.log(n) if variance > 0 else -math.inf
        if bic < lowest:
            best, lowest = (d, variance), bic
        elif k >= len(best[0]) + PATIENCE:
            break
    return best


def solved_step(A: Array, b: Array) -> Array:
    """A^-1 b (n,) of a small matrix, by LAPACK directly: half of the time of `numpy.linalg.solve`, the same bits.

    >>> solved_step(np.array([[2.0, 0.0], [0.0, 4.0]]), np.array([1.0, 1.0])).tolist()
    [0.5, 0.25]
    """
    from scipy.linalg.lapack import dgesv

    _, _, x, zero_pivot = dgesv(A, b)
    if zero_pivot:
        raise np.linalg.LinAlgError("singular matrix of a step")
    return np.asarray(x, dtype=np.float64)


def inverse_of_squares(J: Array) -> Array:
    """(J'J)^-1 by QR of J's columns, scaled to length 1."""
    scale = np.linalg.norm(J, axis=0)
    inverse = np.linalg.inv(np.linalg.qr(J / scale, mode="r")) / scale[:, None]
    return np.asarray(inverse @ inverse.T, dtype=np.float64)


def covariance(J: Array, e: Array, stretches: Sequence[slice], hidden: int = 0) -> tuple[Array, int]:
    """Covariance of theta (p, p) and the order of the error's autoregression; 0: white.

    ``hidden`` counts the parameters estimated in addition to theta (initial states, constants).
    """
    used = J.shape[1] + hidden
    bread = inverse_of_squares(J)
    h, v = whitening(e, stretches)
    v *= len(e) / max(len(e) - used - (len(h) - 1), 1)
    if len(h) == 1:
        return v * bread, 0
    K = np.vstack([recursive([1.0], h, J[s][::-1]) for s in stretches])
    half = K @ bread
    return v * (half.T @ half), len(h) - 1
