"""Standard errors of few edges are poor themselves: what the scatter of the family says of that of each pair.

A pair's squared standard error is its variance factor times what its design makes of it, ``se^2 = s^2 c`` with
``c = (row_bse / scale_se)^2``. With d_i degrees of freedom s_i^2 is nearly sigma_i^2 chi^2 / d_i, and over the family
sigma_i^2 is scaled inverse chi^2 with d_0 degrees of freedom about s_0^2. Then

    s~_i^2 = (d_0 s_0^2 + d_i s_i^2) / (d_0 + d_i),    with d_0 + d_i degrees of freedom.

d_0 and s_0 follow from the spread of ln s_i^2, whose variance beyond trigamma(d_i / 2) is trigamma(d_0 / 2): a family
whose pairs scatter unlike each other has a small d_0, and every pair keeps its own error.

Source: Smyth 2004, Statistical Applications in Genetics and Molecular Biology 3, article 3, sections 3 and 6.2; the
spread here by restricted likelihood, since pairs differ in their degrees of freedom.
"""

import numpy as np
from numpy.typing import NDArray

from .random_effects import given, reml

Array = NDArray[np.float64]

NONE = 1e-6  # variance of ln sigma^2 below which pairs scatter alike


def moderated(se: Array, df: Array, design: Array) -> tuple[Array, Array]:
    """Standard errors and degrees of freedom with the family's say, shapes (J,).

    Parameters
    ----------
    se, df : ndarray, shape (J,)
        Of each pair by itself; J is 3 or more, df finite.
    design : ndarray, shape (J,)
        c, the squared standard error for a variance of one.

    Examples
    --------
    >>> se, df = moderated(np.array([0.1, 0.11, 0.09, 0.02]), np.array([20.0, 20, 20, 3]), np.ones(4))
    >>> bool(se[3] > 0.04), bool(df[3] > 4)
    (True, True)
    """
    from scipy.special import polygamma, psi

    own = np.square(se) / design
    level, noise = np.log(own) - psi(df / 2) + np.log(df / 2), polygamma(1, df / 2)
    spread = reml(level, noise)
    mean = float(given(np.array([spread]), level, noise).mean[0])
    d0 = _trigamma_inverse(spread**2) * 2
    most = df.sum()  # no more is known than all pairs tell
    if d0 >= most:
        return np.sqrt(np.exp(mean) * design), np.full(len(df), most)
    s0 = np.exp(mean + psi(d0 / 2) - np.log(d0 / 2))
    return np.sqrt((d0 * s0 + df * own) / (d0 + df) * design), np.minimum(d0 + df, most)


def _trigamma_inverse(value: float) -> float:
    """Where trigamma takes a value; infinite for next to nothing."""
    from scipy.optimize import brentq
    from scipy.special import polygamma

    if value < NONE:
        return float("inf")
    return float(np.exp(brentq(lambda ln_x: float(np.log(polygamma(1, np.exp(ln_x)) / value)), -30, 30)))
