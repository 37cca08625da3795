"""How long chains remember, and how many independent draws they are therefore worth.

Sources: Vehtari, Gelman, Simpson, Carpenter & Bürkner 2021, Bayesian Analysis 16, 667, doi:10.1214/20-BA1221, eq. 10 to
13 (effective draws); Geyer 1992, Stat. Sci. 7, 473 (the initial monotone sequence); Goodman & Weare 2010, Commun. Appl.
Math. Comput. Sci. 5, 65, and Sokal 1997, sec. 3 (ensembles).
"""

import numpy as np
from numpy.typing import NDArray

from .density import Array

SHORT = 12  # lags summed directly: independent draws need no more
WINDOW = 5.0  # autocorrelation times to sum over: Sokal; emcee takes the same
ROUNDING = 4 * np.finfo(float).eps  # relative: draws that differ by less are all one value


def effective_draws(x: Array) -> Array:
    """Effective draws of chains, by Geyer's initial monotone sequence.

    Parameters
    ----------
    x : ndarray, shape (q, chains, draws)
        Chains as they are to be compared: halved by the caller.

    Returns
    -------
    ndarray, shape (q,)
        At most S log10(S); not a number where nothing moves.

    Examples
    --------
    >>> slow = np.cumsum(np.random.default_rng(1).normal(size=(1, 4, 500)), axis=2)
    >>> bool(effective_draws(slow)[0] < 50)
    True
    """
    _, m, n = x.shape
    centre = x.mean(axis=2)
    between = centre.var(axis=1, ddof=1)
    short = min(n, SHORT)
    x = x - centre[:, :, None]
    tau, ended = _geyer(_products(x, short), between, n)
    if short < n and not ended.all():  # draws that hang together: all lags, by Fourier transform
        tau[~ended], _ = _geyer(_lags(x[~ended], n) / n, between[~ended], n)
    ess = m * n / np.maximum(tau, 1 / np.log10(m * n))
    return np.asarray(ess)


def autocorrelation_time(chain: Array) -> Array:
    """Integrated autocorrelation time of an ensemble, as emcee tells it: Goodman & Weare 2010, Sokal 1997.

    Autocorrelations of the walkers are averaged, and summed up to the first lag of five times the sum.

    Parameters
    ----------
    chain : ndarray, shape (steps, walkers, p)

    Returns
    -------
    ndarray, shape (p,)
        In steps; infinite where a walker never moved, or is not a number. Walkers that swing from side to side get
        next to nothing: take no less than 1 for them.

    Examples
    --------
    >>> bool(abs(autocorrelation_time(np.random.default_rng(1).normal(size=(5000, 8, 1)))[0] - 1) < 0.1)
    True
    """
    x = np.moveaxis(np.asarray(chain, dtype=np.float64), 0, 2)  # (walkers, p, steps)
    return np.array([_ensemble_time(np.ascontiguousarray(x[:, j])) for j in range(x.shape[1])])


def _ensemble_time(x: Array) -> float:
    """Autocorrelation time of one parameter, (walkers, steps)."""
    n = x.shape[1]
    if not np.isfinite(x).all() or (np.ptp(x, axis=1) <= ROUNDING * np.abs(x).max(axis=1)).any():
        return float(np.inf)
    x = x - x.mean(axis=1, keepdims=True)
    x /= np.sqrt((x**2).sum(axis=1, keepdims=True))
    times = 2 * np.cumsum(_lags(x[None], n)[0]) - 1
    return float(times[np.argmax(np.arange(n) >= WINDOW * times)])  # the sum of all lags is zero: one qualifies


def _products(x: Array, lags: int) -> Array:
    """Autocovariance of centred chains at the first lags, mean over chains, (q, chains, draws) -> (q, lags)."""
    _, m, n = x.shape
    sums = [np.einsum("qmn,qmn->q", x[:, :, : n - lag], x[:, :, lag:]) for lag in range(lags)]
    return np.asarray(np.stack(sums, axis=1) / (m * n))


def _geyer(autocovariance: Array, between: Array, n: int) -> tuple[Array, NDArray[np.bool_]]:
    """Autocorrelation time by Geyer's initial monotone sequence, (q, lags) -> (q,), and whether it came to its end."""
    q, lags = autocovariance.shape
    within = autocovariance[:, :1] * n / (n - 1)
    rho = 1 - (within - autocovariance) / (autocovariance[:, :1] + between[:, None])
    rho[:, 0] = 1
    last = max((lags - 3) // 2, 0)
    pairs = rho[:, : 2 * last + 2].reshape(q, last + 1, 2).sum(axis=2)
    ends = pairs <= 0
    ended = ends.any(axis=1)
    K = np.where(ended, ends.argmax(axis=1), last)
    kept = np.minimum.accumulate(pairs, axis=1) * (np.arange(last + 1) < K[:, None])
    return 2 * kept.sum(axis=1) - 1 + np.maximum(rho[np.arange(q), 2 * K], 0), ended


def _lags(x: Array, lags: int) -> Array:
    """Sums of products at the first lags, mean over centred chains, (q, chains, draws) -> (q, lags)."""
    from scipy.fft import irfft, next_fast_len, rfft

    length = next_fast_len(2 * x.shape[2], real=True)  # padded, so that lags do not wrap
    spectrum = rfft(x, length)
    power = (spectrum.real**2 + spectrum.imag**2).mean(axis=1)
    return np.asarray(irfft(power, length)[:, :lags])
