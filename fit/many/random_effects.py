"""Exponents of a family of pairs, as draws about a common mean: the normal random-effects model, integrated exactly.

    b_i ~ N(beta_i, v_i),    beta_i ~ N(mu, tau^2),    mu flat,    tau half-t

Given tau all else is normal in closed form (``Given``); what is left is one integral over tau, taken by Gauss-Legendre
panels on asinh(tau / c), which is even where tau is small and logarithmic where it is large.

Source: Gelman et al. 2013, Bayesian Data Analysis, section 5.4; half-t prior: Gelman 2006, Bayesian Analysis 1, 515.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FARTHEST = 16.0  # asinh(tau / c) beyond which nothing is looked for: tau of four million standard errors
COARSE, LOOKS = 200, 3  # points of a look for the mass, and looks
FAR = 30.0  # in the log density below its top
PANELS, NODES = 48, 4


@dataclass(frozen=True, slots=True)
class Given:
    """The model given tau, shapes (T,): log restricted likelihood, mean of the family and its variance."""

    loglike: Array
    mean: Array
    variance: Array


@dataclass(frozen=True, slots=True)
class Family:
    """Posterior of one family of J pairs: T nodes of tau with their weights.

    Attributes
    ----------
    b, v : ndarray, shape (J,)
        Estimates and the variances of their errors.
    tau, weight, mean, variance : ndarray, shape (T,)
        Nodes, their share of the posterior (sum 1), and mean and variance of mu given each.
    ends, below : ndarray, shape (PANELS + 1,)
        Ends of the panels of tau and the posterior below each.
    """

    b: Array
    v: Array
    tau: Array
    weight: Array
    mean: Array
    variance: Array
    ends: Array
    below: Array


def given(tau: Array, b: Array, v: Array) -> Given:
    """The family given each tau, shape (T,).

    Examples
    --------
    >>> of = given(np.array([0.0]), np.array([0.4, 0.6]), np.array([0.01, 0.01]))
    >>> round(float(of.mean[0]), 9), round(float(of.variance[0]), 9)
    (0.5, 0.005)
    """
    total = v + np.square(tau)[:, None]
    w = 1 / total
    variance = 1 / w.sum(axis=1)
    mean = variance * (w @ b)
    squares = (w * np.square(b - mean[:, None])).sum(axis=1)
    return Given(0.5 * (np.log(variance) - np.log(total).sum(axis=1) - squares), mean, variance)


def half_t(df: float, scale: float) -> Callable[[Array], Array]:
    """Log density of a half-t for tau, but for a constant; an infinite scale makes it uniform."""
    return lambda tau: -(df + 1) / 2 * np.log1p(np.square(tau / scale) / df)


def reml(b: Array, v: Array) -> float:
    """The tau of largest restricted likelihood."""
    low, high = 0.0, FARTHEST
    c = _unit(v)
    for _ in range(12):
        x = np.linspace(low, high, COARSE)
        best = int(np.argmax(given(c * np.sinh(x), b, v).loglike))
        low, high = x[max(best - 1, 0)], x[min(best + 1, COARSE - 1)]
    return float(c * np.sinh(x[best]))


def family(b: Array, v: Array, log_prior: Callable[[Array], Array]) -> Family:
    """Integrate over tau.

    Parameters
    ----------
    b, v : ndarray, shape (J,)
        Estimates and variances of their errors, above zero.
    log_prior : function of tau, shape (T,)
    """
    c = _unit(v)

    def log_mass(x: Array) -> Array:
        tau = c * np.sinh(x)
        return given(tau, b, v).loglike + log_prior(tau) + np.log(np.cosh(x))

    ends = np.linspace(*_where(log_mass), PANELS + 1)
    node, share = np.polynomial.legendre.leggauss(NODES)
    half = (ends[1] - ends[0]) / 2
    x = ((ends[:-1] + half)[:, None] + half * node).ravel()
    mass = log_mass(x)
    weight = np.tile(share, PANELS) * np.exp(mass - mass.max())
    weight /= weight.sum()
    at = given(c * np.sinh(x), b, v)
    below = np.append(0.0, np.cumsum(weight.reshape(PANELS, NODES).sum(axis=1)))
    return Family(b, v, c * np.sinh(x), weight, at.mean, at.variance, c * np.sinh(ends), below)


def of_pairs(of: Family) -> tuple[Array, Array, Array]:
    """Mean and variance of each beta_i given each tau, shape (T, J), and the pull B = v / (v + tau^2)."""
    pull = of.v / (of.v + np.square(of.tau)[:, None])
    mean = of.b + pull * (of.mean[:, None] - of.b)
    return mean, (1 - pull) * of.v + np.square(pull) * of.variance[:, None], pull


def moments(of: Family, mean: Array, variance: Array) -> tuple[Array, Array]:
    """Mean and standard deviation of mixtures of normals over tau; shapes (T, J) -> (J,)."""
    middle = of.weight @ mean
    return middle, np.sqrt(of.weight @ (variance + np.square(mean - middle)))


def quantiles(of: Family, mean: Array, variance: Array, p: float) -> Array:
    """Quantile p of mixtures of normals over tau, shapes (T, J) -> (J,), by halving."""
    from scipy.special import ndtr, ndtri

    some = of.weight > 1e-12
    weight, m, s = of.weight[some], mean[some], np.sqrt(variance[some])
    ends = m + s * float(ndtri(p))  # of each normal: the mixture's lies between the least and the largest
    low, high = ends.min(axis=0), ends.max(axis=0)
    for _ in range(34):  # to 1e-10 of the widest bracket
        middle = (low + high) / 2
        under = weight @ ndtr((middle - m) / s) < p
        low, high = np.where(under, middle, low), np.where(under, high, middle)
    return np.asarray((low + high) / 2)


def tau_quantile(of: Family, p: float) -> float:
    """Quantile p of tau."""
    from scipy.interpolate import PchipInterpolator

    rising = np.append(True, np.diff(of.below) > 1e-14)
    return float(PchipInterpolator(of.below[rising], of.ends[rising])(p))


def _unit(v: Array) -> float:
    """Size of a standard error, for tau to be measured by."""
    return float(1 / np.sqrt(np.mean(1 / v)))


def _where(log_mass: Callable[[Array], Array]) -> tuple[float, float]:
    """Ends of the mass, looked for ever more closely."""
    low, high = 0.0, FARTHEST
    for _ in range(LOOKS):
        x = np.linspace(low, high, COARSE)
        mass = log_mass(x)
        near = np.flatnonzero(mass > mass.max() - FAR)
        low, high = float(x[max(near[0] - 1, 0)]), float(x[min(near[-1] + 1, COARSE - 1)])
    return low, high
