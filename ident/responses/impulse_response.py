"""Regularised impulse response: a finite impulse response with a smooth, decaying prior.

    y(t) = sum_k g_k u(t - k) + transient + offset + e(t),    cov(g_i, g_j) = c l^max(i, j)

The prior states that the response decays and is smooth; c, l and the size of the transient maximise the marginal
likelihood. Standard errors are those of the posterior and approach the prior's where the input has no power, so that
they are valid for a single sweep. Coloured noise is whitened first.
Source: Chen, Ohlsson & Ljung 2012, doi 10.1016/j.automatica.2012.05.026 (the "tuned/correlated" kernel).
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...core.arrays import Array
from ...datasets.records.record import Record
from ..estimators.filters import filtered, lagged, whitening

MANY = 3  # segments whose transients are estimated; with more, the start of each segment is omitted
BLOCK = 8192  # rows
TRIALS = 80  # of hyperparameters; more have little effect on the errors
FLAT = 1e6  # prior variance of an offset over that of the noise


@dataclass(frozen=True, slots=True)
class ImpulseResponse:
    """Posterior distribution of the impulse response.

    Attributes
    ----------
    g : ndarray, shape (n,)
        Lags 0 to n - 1, unit_y per unit_u.
    root : ndarray, shape (n, p)
        root root' is the covariance of g.
    noise : tuple of ndarray and float
        Autoregression (starts with 1) and variance of its innovations.
    dof : int
        Samples less the effective number of coefficients.
    tail : float
        Prior variance at the last lag over that at the first; if not small, the response is truncated.
    """

    g: Array
    root: Array
    noise: tuple[Array, float]
    dof: float
    tail: float


@dataclass(frozen=True, slots=True)
class _Sums:
    """Cross products of the columns (summed lags of u, summed transients, offsets) and y over N rows."""

    ZZ: Array
    Zy: Array
    yy: float
    rows: int
    n: int
    transients: int


def regularised_impulse(rec: Record, n: int) -> ImpulseResponse:
    """Estimate n coefficients; for coloured noise again, with data whitened by the first residuals."""
    stretches = rec.stretches
    x, found, hyper, transients = _estimate(rec.u, rec.y, stretches, n, None)
    tail = found.tail  # whitening may absorb the response beyond the last lag
    h, _ = whitening(_residuals(rec.u, rec.y, stretches, n, x, transients), stretches)
    if len(h) > 1:
        u, y = (filtered(h, [1.0], values, stretches) for values in (rec.u, rec.y))
        _, found, _, _ = _estimate(u, y, stretches, n, hyper)
        found = replace(found, noise=(h, found.noise[1]), tail=max(tail, found.tail))
    return found


def block_means(rec: Record, k: int) -> Record:
    """Block means of k samples of u and y: white noise stays white, slow dynamics are unchanged."""
    if k == 1:
        return rec
    kept = [s for s in rec.stretches if s.stop - s.start >= k]
    u, y = (
        np.concatenate([v[s.start : s.stop - (s.stop - s.start) % k].reshape(-1, k).mean(axis=1) for s in kept])
        for v in (rec.u, rec.y)
    )
    starts = np.cumsum([0, *((s.stop - s.start) // k for s in kept)])[:-1]
    return replace(
        rec,
        u=u,
        y=y,
        sample_time=rec.sample_time * k,
        starts=tuple(int(s) for s in starts),
        offsets=None,
        sha256=None,
        reference=None,
    )


def _estimate(
    u: Array, y: Array, stretches: tuple[slice, ...], n: int, start: Array | None
) -> tuple[Array, ImpulseResponse, Array, int]:
    """Posterior mean of all unknowns, posterior of g, hyperparameters, and number of segments with a transient."""
    sums = _summed(u, y, stretches, n)
    hyper = _marginal_likelihood_maximum(sums, start)
    L, D, quad = _posterior(sums, hyper)
    inverse = np.linalg.inv(L)
    x = D * (inverse.T @ (inverse @ (D * sums.Zy)))
    variance = quad / sums.rows
    root = np.cumsum((np.sqrt(variance) * D[:n, None] * inverse.T[:n])[::-1], axis=0)[::-1]
    g = _summed_up(x[:n])
    effective = len(L) - float((inverse * inverse).sum())
    tail = float(_decay(hyper) ** n)
    posterior = ImpulseResponse(g, root, (np.ones(1), variance), max(sums.rows - effective, 1.0), tail)
    return x, posterior, hyper, sums.transients


def _summed_up(x: Array) -> Array:
    """Reverse cumulative sums: from weights of the prior to coefficients."""
    return np.asarray(np.cumsum(x[::-1])[::-1])


def _columns(u: Array, s: slice, begin: int, end: int, n: int) -> Array:
    """Sums of lags 0 ... k of u, k < n, for samples begin to end of a segment; zero before it."""
    lo = max(begin - n, s.start)
    part = u[lo:end]
    return np.cumsum(lagged(part, range(n), (slice(0, len(part)),))[begin - lo :], axis=1)


def _summed(u: Array, y: Array, stretches: tuple[slice, ...], n: int) -> _Sums:
    few = len(stretches) <= MANY
    extra = n if few else 0
    p = n + len(stretches) * (1 + extra)
    ZZ, Zy, yy, rows = np.zeros((p, p)), np.zeros(p), 0.0, 0
    for k, s in enumerate(stretches):
        for begin in range(s.start if few else min(s.start + n, s.stop), s.stop, BLOCK):
            end = min(begin + BLOCK, s.stop)
            Z = np.zeros((end - begin, p))
            Z[:, :n] = _columns(u, s, begin, end, n)
            Z[:, p - len(stretches) + k] = 1.0
            if few and begin == s.start:
                m = min(n, end - begin)
                Z[:m, n + k * n : n + k * n + n] = np.triu(np.ones((m, n)))
            ZZ += Z.T @ Z
            Zy += Z.T @ y[begin:end]
            yy += float(y[begin:end] @ y[begin:end])
            rows += end - begin
    return _Sums(ZZ, Zy, yy, rows, n, len(stretches) if few else 0)


def _decay(hyper: Array) -> float:
    """The factor l of the prior, from sample to sample."""
    return float(np.exp(-np.exp(np.clip(hyper[1], -9, 2))))


def _scale(sums: _Sums, hyper: Array) -> Array:
    """Prior standard deviation of each coefficient relative to the noise; hyper: ln of c, decay and transient."""
    n = sums.n
    decay = _decay(hyper)
    w = decay ** np.arange(1, n + 1) * (1 - decay)
    w[-1] /= 1 - decay
    out = np.full(len(sums.Zy), FLAT)
    out[:n] = np.exp(np.clip(hyper[0], -60, 60)) * w
    for k in range(sums.transients):
        out[n + k * n : n + (k + 1) * n] = np.exp(np.clip(hyper[2], -60, 60)) * w
    return np.asarray(np.sqrt(out))


def _posterior(sums: _Sums, hyper: Array) -> tuple[Array, Array, float]:
    """Cholesky factor of the scaled information matrix, the scale, and the residual sum of squares."""
    from scipy.linalg import solve_triangular

    D = _scale(sums, hyper)
    M = D[:, None] * sums.ZZ * D
    M[np.diag_indices_from(M)] += 1.0 + 1e-13 * M.diagonal().max()  # rounding of the products in noise-free data
    L = np.asarray(np.linalg.cholesky(M), dtype=np.float64)
    along = solve_triangular(L, D * sums.Zy, lower=True, check_finite=False)
    return L, D, max(sums.yy - float(along @ along), 1e-13 * sums.yy)


def _marginal_likelihood_maximum(sums: _Sums, start: Array | None) -> Array:
    """Hyperparameters of maximum marginal likelihood, the noise variance profiled out."""
    from scipy.optimize import minimize

    def cost(hyper: Array) -> float:
        L, _, quad = _posterior(sums, hyper)
        return float(sums.rows * np.log(quad) + 2 * np.log(np.diag(L)).sum())

    if start is None:
        size = np.log(sums.rows / max(float(np.trace(sums.ZZ[: sums.n, : sums.n])) / sums.n, 1e-300))
        tries = [np.array([size + above, np.log(k / sums.n), 0.0]) for k in (3.0, 10.0, 30.0) for above in (3.0, 9.0)]
        start = min(tries, key=cost)
    simplex = start + np.vstack([np.zeros(3), np.diag([2.0, 0.5, 3.0])])
    options: Any = {"xatol": 0.05, "fatol": 0.05, "maxfev": TRIALS, "initial_simplex": simplex}
    return np.asarray(minimize(cost, start, method="Nelder-Mead", options=options).x)


def _residuals(u: Array, y: Array, stretches: tuple[slice, ...], n: int, x: Array, transients: int) -> Array:
    """Residuals of the estimate, shape (N,)."""
    out = y - filtered(_summed_up(x[:n]), [1.0], u, stretches)
    for k, s in enumerate(stretches):
        out[s] -= x[len(x) - len(stretches) + k]
        m = min(n, s.stop - s.start)
        if transients:
            out[s.start : s.start + m] -= _summed_up(x[n + k * n : n + (k + 1) * n])[:m]
        else:
            out[s.start : s.start + m] = 0.0
    return out
