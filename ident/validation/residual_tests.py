"""Residual tests: whiteness, and independence of the input, each with valid confidence bands.

Whiteness: the autocorrelation of white noise has standard deviation sqrt(pairs)/N, which is 1/sqrt(N) at small lags.
Independence: sum_t e(t) u(t - k) has variance u' R u. For a residual that follows an autoregression h e = w with
variance v this is v |u filtered backwards by 1/h|^2, equal to N sum_k R_e(k) R_u(k) without truncating the sum. On new
data the uncertainty of the coefficients adds J (theta_0 - theta), which widens the bands; on the estimation record the
same J narrows them. Source: Ljung 1999, section 16.6; Soderstrom & Stoica 1989, section 11.2.
"""

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array, Ints
from ...core.display import Displayable
from ..estimators.filters import autocovariance, filtered, lagged, whitening
from ..estimators.free_simulation import projected_out
from .prediction import OneStep

LAGS = 25


@dataclass(frozen=True, slots=True, repr=False)
class ResidualTest(Displayable):
    """Correlations by lag with their band under the null hypothesis.

    Attributes
    ----------
    null : str
        Null hypothesis.
    lags : ndarray of int, shape (L,)
    correlation : ndarray, shape (L,)
    band : ndarray, shape (L,)
        95 %, pointwise: correlations outside +- band are significant.
    statistic, df, pvalue : float, int, float
        All lags jointly, chi-squared (Ljung-Box for a plain series).
    """

    null: str
    lags: Ints
    correlation: Array
    band: Array
    statistic: float
    df: int
    pvalue: float

    @property
    def flagged(self) -> float:
        """Share of lags outside their band: about 5 % under the null hypothesis."""
        return float(np.mean(np.abs(self.correlation) > self.band))


def whiteness(e: Array, stretches: tuple[slice, ...], lags: int = LAGS) -> ResidualTest:
    """Ljung-Box test of a series with no estimated parameters, at lags 1 to ``lags``.

    Parameters
    ----------
    e : ndarray, shape (N,)
    stretches : tuple of slice
        Segments; no product crosses their boundaries.
    lags : int

    Examples
    --------
    >>> e = np.random.default_rng(1).standard_normal(1000)
    >>> test = whiteness(e, (slice(0, 1000),))
    >>> round(float(test.band[0]), 3), test.pvalue > 0.05
    (0.062, True)
    """
    from scipy.stats import chi2

    n, longest = len(e), max(s.stop - s.start for s in stretches)
    lags = max(min(lags, longest - 2), 1)
    r = autocovariance(e, stretches, lags)
    rho = r[1:] / r[0] if r[0] > 0 else np.zeros(lags)
    pairs = np.array([sum(max(s.stop - s.start - k, 0) for s in stretches) for k in range(1, lags + 1)])
    statistic = float(n * (n + 2) * np.sum(rho**2 / pairs))
    return ResidualTest(
        "residuals are white", np.arange(1, lags + 1), rho, 1.96 * np.sqrt(pairs) / n, statistic, lags,
        float(chi2.sf(statistic, lags)),
    )  # fmt: skip


def residual_whiteness(step: OneStep, cov: Array | None = None, fitted: bool = False, lags: int = LAGS) -> ResidualTest:
    """Whiteness of the residuals of a model at lags 1 to ``lags``, allowing for the estimated coefficients.

    Regression of e on its own lags and J (Breusch 1978, Godfrey 1978); ``cov`` and ``fitted`` as in `independence`.
    """
    lags = max(min(lags, max(s.stop - s.start for s in step.stretches) - 2), 1)
    E = lagged(step.e, range(1, lags + 1), step.stretches)
    white = float(step.e @ step.e) / max(len(step.e) - (step.J.shape[1] if fitted else 0), 1)
    return _test("residuals are white", step, E, 1, np.ones(1), white, cov, fitted)


def independence(step: OneStep, U: Array, first: int, cov: Array | None = None, fitted: bool = False) -> ResidualTest:
    """Cross-correlation of residuals with inputs at lags ``first``, ``first`` + 1, ...

    Parameters
    ----------
    step : OneStep
    U : ndarray, shape (N, L)
        Column k is u(t - first - k).
    first : int
    cov : ndarray, shape (p, p), optional
        Covariance of a and b, estimated on another record.
    fitted : bool
        The coefficients were estimated on these samples.

    Returns
    -------
    ResidualTest
    """
    h, v = whitening(step.e, step.stretches)
    if fitted:
        v *= len(step.e) / max(len(step.e) - step.J.shape[1], 1)
    return _test("residuals are independent of the input", step, U, first, h, v, cov, fitted)


def _test(
    null: str, step: OneStep, U: Array, first: int, h: Array, v: float, cov: Array | None, fitted: bool
) -> ResidualTest:
    from scipy.stats import chi2

    X = projected_out(U, step.free)
    if fitted:
        Q = np.linalg.qr(step.J)[0]
        X = X - Q @ (Q.T @ X)
    S = v * filtered_gram(X, h, step.stretches)
    if cov is not None and not fitted:
        through = X.T @ step.J[:, : len(cov)]
        S = S + through @ cov @ through.T
    # neighbouring lags of a slow input are nearly collinear: only independent directions count
    sums, spread = X.T @ step.e, np.sqrt(np.maximum(np.diag(S), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(S / np.outer(spread, spread))
    kept = values > 1e-6 * values[-1]
    statistic = float(np.sum((vectors[:, kept].T @ (sums / spread)) ** 2 / values[kept]))
    df = int(kept.sum())
    size = np.sqrt(np.maximum(float(step.e @ step.e) * (U * U).sum(axis=0), np.finfo(float).tiny))
    return ResidualTest(
        null,
        first + np.arange(U.shape[1]),
        sums / size,
        1.96 * spread / size,
        statistic,
        df,
        float(chi2.sf(statistic, df)),
    )


def filtered_gram(X: Array, h: Array, stretches: tuple[slice, ...]) -> Array:
    """X' R X for an autoregressive error of unit innovations, R = (H'H)^-1: columns filtered backwards by 1/h."""
    if len(h) == 1:
        return np.asarray(X.T @ X)
    back = np.vstack([filtered([1.0], h, X[s][::-1], (slice(0, s.stop - s.start),)) for s in stretches])
    return np.asarray(back.T @ back)
