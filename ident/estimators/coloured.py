"""Covariance of an output-error estimate, whatever the colour of its noise.

The estimate is consistent under coloured noise, but sigma^2 (J'J)^-1 is then wrong, often by half. With the error
written as an autoregression H e = w (w white),

    cov theta = (J'J)^-1 J' R J (J'J)^-1,    R = s^2 (H'H)^-1,

which is s^2 (J'J)^-1 where the error is white (order 0). Source: Soderstrom & Stoica 1989, section 7.5.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
MAX_ORDER = 20


def autocovariance(e: Array, stretches: Sequence[slice], lags: int) -> Array:
    """Sums of e(t) e(t - k) / N for k = 0 ... lags, no product across a join."""
    sums = [
        sum(float(e[s][k:] @ e[s][: max(s.stop - s.start - k, 0)]) for s in stretches if s.stop - s.start > k)
        for k in range(lags + 1)
    ]
    return np.asarray(sums) / len(e)


def whitening(e: Array, stretches: Sequence[slice], max_order: int = MAX_ORDER) -> tuple[Array, float]:
    """H (starts with 1; its order chosen by BIC) and the variance of w in H e = w, by Levinson's recursion.

    The data pass once, whatever the order.
    """
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


def inverse_of_squares(J: Array) -> Array:
    """(J'J)^-1 by QR of J's columns, scaled to length 1."""
    scale = np.linalg.norm(J, axis=0)
    inverse = np.linalg.inv(np.linalg.qr(J / scale, mode="r")) / scale[:, None]
    return np.asarray(inverse @ inverse.T, dtype=np.float64)


def covariance(J: Array, e: Array, stretches: Sequence[slice], hidden: int = 0) -> tuple[Array, int]:
    """Covariance of theta (p, p) and the order of the error's autoregression; 0: white.

    ``hidden`` counts what was fitted beside theta (initial states).
    """
    from scipy.signal import lfilter

    used = J.shape[1] + hidden
    bread = inverse_of_squares(J)
    h, v = whitening(e, stretches)
    v *= len(e) / max(len(e) - used - (len(h) - 1), 1)
    if len(h) == 1:
        return v * bread, 0
    K = np.vstack([lfilter([1.0], h, J[s][::-1], axis=0) for s in stretches])
    half = K @ bread
    return v * (half.T @ half), len(h) - 1
