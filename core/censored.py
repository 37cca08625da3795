"""Maximum likelihood for censored lognormal and Weibull lives, ``ln T = Z beta + s W``.

A life that ended contributes its density, a run-out the probability of lasting longer, and a life that was over at the
first look the probability of a shorter one. In ``gamma = beta/s`` and ``kappa = 1/s`` the log-likelihood is concave, so
that Newton's method finds the only maximum, where there is one.

Sources: Burridge 1981, J. R. Statist. Soc. B 43, 41 (concavity); Meeker & Escobar 1998, Statistical Methods for
Reliability Data, chapters 4, 8 and 17.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .errors import FitError

Distribution: TypeAlias = Literal["lognormal", "weibull"]
ENDED, RUN_OUT, EARLIER = 0, 1, -1  # the life is T; it is longer than T; it is shorter than T
Side: TypeAlias = NDArray[np.int8]
LARGEST_STEPS = 200
CONVERGED = 1e-13  # expected rise of the log-likelihood: below it rounding decides
EULER_SD = float(np.pi / np.sqrt(6.0))  # standard deviation of the smallest extreme value, W of a Weibull life
HALF_LN_TWO_PI = 0.9189385332046727


@dataclass(frozen=True, slots=True)
class CensoredFit:
    """Maximum-likelihood fit of ``ln T = Z beta + s W``.

    Attributes
    ----------
    beta, scale : ndarray, shape (p,), and float
        Location coefficients and s.
    covariance : ndarray, shape (p + 1, p + 1)
        Inverse of the observed information of (beta, ln s).
    log_likelihood : float
        Of the lives themselves, in the unit of T.
    """

    beta: Array
    scale: float
    covariance: Array
    log_likelihood: float


def standard_quantile(distribution: Distribution, share: float) -> float:
    """Quantile of W: of a standard normal, or of the smallest extreme value distribution.

    >>> round(standard_quantile("lognormal", 0.975), 4), round(standard_quantile("weibull", 0.5), 4)
    (1.96, -0.3665)
    """
    if distribution == "weibull":
        return float(np.log(-np.log1p(-share)))
    from scipy.special import ndtri

    return float(ndtri(share))


def standard_deviation(distribution: Distribution, scale: float) -> float:
    """Standard deviation of ln T.

    >>> round(standard_deviation("weibull", 0.5), 4)
    0.6413
    """
    return scale * EULER_SD if distribution == "weibull" else scale


def fit_censored(Z: Array, ln_life: Array, side: Side, distribution: Distribution) -> CensoredFit:
    """Fit of censored lives.

    Parameters
    ----------
    Z : ndarray, shape (n, p)
        Columns of the linear predictor; those of the lives that ended have rank p.
    ln_life : ndarray, shape (n,)
    side : ndarray of int, shape (n,)
        0 the life ended, 1 it is longer (run-out), -1 it is shorter.
    distribution : {"lognormal", "weibull"}

    Raises
    ------
    FitError
        No convergence: the lives that ended meet the law exactly, or do not identify it.

    Examples
    --------
    >>> found = fit_censored(np.ones((3, 1)), np.log([10.0, 20.0, 40.0]), np.zeros(3, dtype=np.int8), "lognormal")
    >>> round(float(np.exp(found.beta[0])), 6), round(found.scale, 6)
    (20.0, 0.565952)
    """
    shift = float(ln_life.mean())  # the search is for ln T about its mean
    size = np.sqrt((Z**2).sum(axis=0))
    A = np.column_stack([ln_life - shift, -Z / size])
    start = _start(A)
    x = _maximum(A, side, distribution, start)
    scale = float(1.0 / x[0])
    beta = x[1:] * scale / size
    z = (ln_life - shift - Z @ beta) / scale
    covariance = _covariance(Z, z, side, scale, distribution)
    ended = side == ENDED
    total = float(_terms(z, side, distribution)[0].sum() - ended.sum() * np.log(scale) - ln_life[ended].sum())
    return CensoredFit(beta + _of_constant(Z, shift), scale, covariance, total)


def log_likelihoods(z: Array, side: Side, distribution: Distribution, scale: float) -> Array:
    """Log density of each ln T that ended, and log probability of each bound, at standardised residuals z, shape (n,).

    >>> log_likelihoods(np.zeros(2), np.array([0, 1], dtype=np.int8), "lognormal", 1.0).round(4).tolist()
    [-0.9189, -0.6931]
    """
    return np.asarray(_terms(z, side, distribution)[0] - np.where(side == ENDED, np.log(scale), 0.0))


def _of_constant(Z: Array, shift: float) -> Array:
    """Coefficients of a constant in the columns of Z, the first of which is the constant."""
    out = np.zeros(Z.shape[1])
    out[0] = shift / float(Z[0, 0])
    return out


def _start(A: Array) -> Array:
    """Kappa and gamma of least squares of all lives, run-outs among them."""
    y, X = A[:, 0], -A[:, 1:]
    beta = np.linalg.lstsq(X, y, rcond=None)[0]
    scale = max(float(np.sqrt(np.mean((y - X @ beta) ** 2))), 1e-3)
    return np.concatenate([[1.0], beta]) / scale


def _maximum(A: Array, side: Side, distribution: Distribution, x: Array) -> Array:
    """Newton's method with halved steps on the concave log-likelihood of (kappa, gamma), ``z = A x``."""
    ended = float((side == ENDED).sum())
    value = _value(A, side, distribution, x, ended)
    for _ in range(LARGEST_STEPS):
        _, d, d2 = _terms(A @ x, side, distribution)
        gradient, hessian = A.T @ d, (A.T * d2) @ A
        gradient[0] += ended / x[0]
        hessian[0, 0] -= ended / x[0] ** 2
        try:
            step = np.linalg.solve(-hessian, gradient)
        except np.linalg.LinAlgError:
            break
        rise = float(gradient @ step)
        if rise < CONVERGED * max(1.0, abs(value)):  # a last step then has all digits
            return x + step
        share = 1.0
        while share > 1e-12:
            trial = x + share * step
            found = _value(A, side, distribution, trial, ended) if trial[0] > 0 else -np.inf
            if found > value - 1e-13 * abs(value):
                break
            share /= 2
        x, value = trial, found
        if x[0] > 1e9:
            break
    raise FitError(
        "the maximum-likelihood fit of the lives does not converge: those that ended meet the law exactly, or do not "
        "identify it. Measure more lives to their end"
    )


def _value(A: Array, side: Side, distribution: Distribution, x: Array, ended: float) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        found = float(_terms(A @ x, side, distribution)[0].sum() + ended * np.log(x[0]))
    return found if np.isfinite(found) else -np.inf


def _covariance(Z: Array, z: Array, side: Side, scale: float, distribution: Distribution) -> Array:
    """Inverse of the observed information of (beta, ln s)."""
    p = Z.shape[1]
    _, d, d2 = _terms(z, side, distribution)
    H = np.empty((p + 1, p + 1))
    H[:p, :p] = (Z.T * d2) @ Z / scale**2
    H[:p, p] = H[p, :p] = Z.T @ (d2 * z + d) / scale
    H[p, p] = float(np.sum(d2 * z**2 + d * z))
    size = 1.0 / np.sqrt(-np.diag(H))  # columns of one length: the constant beside ln V
    C = np.linalg.inv(-H * np.outer(size, size)) * np.outer(size, size)
    return np.asarray((C + C.T) / 2, dtype=float)


def _terms(z: Array, side: Side, distribution: Distribution) -> tuple[Array, Array, Array]:
    """Log-likelihood of each life at its standardised residual, without ``-ln s``, and two derivatives by z."""
    of = _weibull if distribution == "weibull" else _lognormal
    out = tuple(np.empty_like(z) for _ in range(3))
    for which in (ENDED, RUN_OUT, EARLIER):
        rows = side == which
        if rows.any():
            for column, found in zip(out, of(z[rows], which), strict=True):
                column[rows] = found
    return out[0], out[1], out[2]


def _lognormal(z: Array, which: int) -> tuple[Array, Array, Array]:
    from scipy.special import log_ndtr

    log_density = -0.5 * z**2 - HALF_LN_TWO_PI
    if which == ENDED:
        return log_density, -z, -np.ones_like(z)
    sign = -float(which)  # +1 for the probability below z, -1 for that above
    total = log_ndtr(sign * z)
    ratio = np.exp(log_density - total)
    return total, sign * ratio, -ratio * (ratio + sign * z)


def _weibull(z: Array, which: int) -> tuple[Array, Array, Array]:
    a = np.exp(np.minimum(z, 700.0))
    if which == ENDED:
        return z - a, 1 - a, -a
    if which == RUN_OUT:
        return -a, -a, -a
    small = np.maximum(a, 1e-300)
    ratio = np.where(a < 700, small / np.expm1(np.minimum(small, 700.0)), 0.0)
    total = np.where(a < 1e-8, np.log(small), np.log(-np.expm1(-small)))
    return total, ratio, ratio * (1 - a - ratio)


@dataclass(frozen=True, slots=True)
class LifeDistribution:
    """Distribution of the lives about their law, and how many of them ended.

    Attributes
    ----------
    name : {"lognormal", "weibull"}
    scale : float
        s of ln T, times ``sqrt(ended / (ended - p))``: unbiased to first order, as the residual standard error is.
    log_scale_sd : float
        Standard error of ln s.
    with_scale : tuple of float
        Covariance of ln s with each parameter of the law, whose constant is that of the median life.
    ended, run_outs, earlier : int
        Lives that ended, are longer than the number in the file, and are shorter.
    log_likelihood : float
        Of the lives, in their unit.

    Examples
    --------
    >>> LifeDistribution("weibull", 0.25, 0.1, (0.0,), 9, 3, 0, -30.0).shape
    4.0
    """

    name: Distribution
    scale: float
    log_scale_sd: float
    with_scale: tuple[float, ...]
    ended: int
    run_outs: int
    earlier: int
    log_likelihood: float

    @property
    def censored(self) -> bool:
        """Whether some life is known by a bound alone."""
        return self.run_outs + self.earlier > 0

    @property
    def shape(self) -> float | None:
        """Shape (slope) of a Weibull life, 1/s."""
        return 1.0 / self.scale if self.name == "weibull" else None

    @property
    def least_squares(self) -> bool:
        """Whether the maximum-likelihood law is that of least squares of ln T."""
        return self.name == "lognormal" and not self.censored
