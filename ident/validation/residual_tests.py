"""Whether residuals are white, and whether anything of the input is left in them; each with bands that hold.

Whiteness: the autocorrelation of white noise has standard deviation sqrt(pairs)/N, which is 1/sqrt(N) at small lags.
Independence: sum_t e(t) u(t - k) has variance u' R u. With the residual an autoregression h e = w of variance v that is
v |u filtered backwards by 1/h|^2, the same as N sum_k R_e(k) R_u(k), and needs no cut-off of the sum. A model with
coefficients of finite precision leaves J (theta_0 - theta) of its input in a new record, which widens the bands; on the
record it was fitted to the same J takes away. Source: Ljung 1999, section 16.6; Soderstrom & Stoica 1989, section 11.2.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.display import Displayable
from ..estimators.filters import autocovariance, filtered, lagged, whitening
from .prediction import OneStep, projected

Array = NDArray[np.float64]
LAGS = 25


@dataclass(frozen=True, slots=True, repr=False)
class ResidualTest(Displayable):
    """Correlations by lag with the band they keep under the null.

    Attributes
    ----------
    null : str
    lags : ndarray of int, shape (L,)
    correlation : ndarray, shape (L,)
    band : ndarray, shape (L,)
        95 %, pointwise: correlations beyond +- band are flagged.
    statistic, df, pvalue : float, int, float
        All lags together, chi-squared: the sums and their covariance (of a bare series, Ljung & Box).
    """

    null: str
    lags: NDArray[np.intp]
    correlation: Array
    band: Array
    statistic: float
    df: int
    pvalue: float

    @property
    def flagged(self) -> float:
        """Share of lags beyond their band: about 5 % under the null."""
        return float(np.mean(np.abs(self.correlation) > self.band))


def whiteness(e: Array, stretches: tuple[slice, ...], lags: int = LAGS) -> ResidualTest:
    """Autocorrelation of a series to which nothing was fitted, at lags 1 to ``lags``.

    Parameters
    ----------
    e : ndarray, shape (N,)
    stretches : tuple of slice
        No product crosses a join.
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


def whiteness_of(step: OneStep, cov: Array | None = None, fitted: bool = False, lags: int = LAGS) -> ResidualTest:
    """Whiteness of a model's residuals at lags 1 to ``lags``: what was fitted to them, or elsewhere, is allowed for.

    A regression of e on its own past beside J, as Breusch 1978 and Godfrey 1978 do it; `independence` tells of ``cov``
    and ``fitted``.
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
        Covariance of a and b, where they come from another record.
    fitted : bool
        The coefficients were fitted to these very samples.

    Returns
    -------
    ResidualTest
    """
    h, v = whitening(step.e, step.stretches)
    if fitted:
        v *= len(step.e) / max(len(step.e) - step.J.shape[1], 1)
    return _test("nothing of the input is left", step, U, first, h, v, cov, fitted)


def _test(
    null: str, step: OneStep, U: Array, first: int, h: Array, v: float, cov: Array | None, fitted: bool
) -> ResidualTest:
    from scipy.stats import chi2

    X = projected(U, step.free)
    if fitted:
        Q = np.linalg.qr(step.J)[0]
        X = X - Q @ (Q.T @ X)
    S = v * squares_behind(X, h, step.stretches)
    if cov is not None and not fitted:
        through = X.T @ step.J[:, : len(cov)]
        S = S + through @ cov @ through.T
    # of a slow input neighbouring lags are all but one: only directions that stand apart are counted
    sums, spread = X.T @ step.e, np.sqrt(np.maximum(np.diag(S), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(S / np.outer(spread, spread))
    told = values > 1e-6 * values[-1]
    statistic = float(np.sum((vectors[:, told].T @ (sums / spread)) ** 2 / values[told]))
    df = int(told.sum())
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


def squares_behind(X: Array, h: Array, stretches: tuple[slice, ...]) -> Array:
    """X' R X for an error of unit innovations, R = (H'H)^-1: columns filtered by 1/h from the last sample back."""
    if len(h) == 1:
        return np.asarray(X.T @ X)
    back = np.vstack([filtered([1.0], h, X[s][::-1], (slice(0, s.stop - s.start),)) for s in stretches])
    return np.asarray(back.T @ back)
