"""Stability and the size of a noise response of many loops, from one table of their polynomials.

Source: Åström 1970, Introduction to Stochastic Control Theory, chapter 5, theorems 2.1 and 2.2 (the Jury table, and the
variance of a signal from two such tables).
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def stable_columns(a: Array) -> NDArray[np.bool_]:
    """Whether every root of each column a_0 + a_1 z^-1 + ... lies inside the unit circle; a (n + 1, m), a_0 = 1.

    >>> stable_columns(np.array([[1.0, 1.0], [-0.5, -1.0]])).tolist()
    [True, False]
    """
    good = np.ones(a.shape[1], dtype=bool)
    with np.errstate(all="ignore"):  # columns that have failed go on as numbers that nobody reads
        while len(a) > 1:
            alpha = a[-1] / a[0]
            good &= np.abs(alpha) < 1
            a = a[:-1] - alpha * a[:0:-1]
    return good


def noise_size(b: Array, a: Array) -> Array:
    """Standard deviation of b/a driven by unit white noise, each column on its own; stable a only, shape (m,).

    >>> noise_size(np.array([[1.0], [0.0]]), np.array([[1.0], [-0.6]])).tolist()
    [1.25]
    """
    n = max(len(a), len(b))
    a, b = (np.vstack([p, np.zeros((n - len(p), p.shape[1]))]) for p in (a, b))
    first, total = a[0], np.zeros(a.shape[1])
    while True:
        total = total + b[-1] ** 2 / a[0]
        if len(a) == 1:
            return np.asarray(np.sqrt(total / first), dtype=np.float64)
        turned = a[:0:-1]
        alpha, beta = a[-1] / a[0], b[-1] / a[0]
        a, b = a[:-1] - alpha * turned, b[:-1] - beta * turned
