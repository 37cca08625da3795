"""Normal random-effects model of the exponents of a family of pairs, integrated over the variance between pairs.

    b_i ~ N(beta_i, v_i),    beta_i ~ N(mu, tau^2),    mu flat,    tau half-t

Given tau all else is normal in closed form (``Given``); what is left is one integral over tau, taken by Gauss-Legendre
panels on asinh(tau / c), which is even where tau is small and logarithmic where it is large.

Source: Gelman et al. 2013, Bayesian Data Analysis, section 5.4; half-t prior: Gelman 2006, Bayesian Analysis 1, 515.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array

FARTHEST = 16.0  # asinh(tau / c) up to which the posterior is searched: tau of four million standard errors
COARSE, CLOSE = 64, 24  # points of the first search for the mass, and of each closer one
CLOSER = {"mass": 2, "top": 8}  # closer searches: at the top each is eleven times as close
FAR = 30.0  # in the log density below its top
PANELS, NODES = 96, 2
FEW = 28  # nodes of tau that do for the pairs of a large family
LARGE = 32  # pairs; of fewer, tau is known so poorly that all nodes are kept
AT_ONCE = 500_000  # numbers of one array, so that it stays in the cache


@dataclass(frozen=True, slots=True)
class FamilyFit:
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


def given(tau: Array, b: Array, v: Array) -> FamilyFit:
    """The family given each tau, shape (T,).

    Examples
    --------
    >>> of = given(np.array([0.0]), np.array([0.4, 0.6]), np.array([0.01, 0.01]))
    >>> round(float(of.mean[0]), 9), round(float(of.variance[0]), 9)
    (0.5, 0.005)
    """
    parts = [_given(some, b, v) for some in np.array_split(tau, -(-len(tau) * len(b) // AT_ONCE))]
    if len(parts) == 1:
        return parts[0]
    return FamilyFit(*(np.concatenate([getattr(part, name) for part in parts]) for name in FamilyFit.__slots__))


def _given(tau: Array, b: Array, v: Array) -> FamilyFit:
    total = v + np.square(tau)[:, None]
    w = 1 / total
    variance = 1 / w.sum(axis=1)
    mean = variance * (w @ b)
    off = b - mean[:, None]
    squares = np.einsum("tj,tj,tj->t", w, off, off)
    return FamilyFit(0.5 * (np.log(variance) - np.log(total).sum(axis=1) - squares), mean, variance)


def half_t(df: float, scale: float) -> Callable[[Array], Array]:
    """Log density of a half-t for tau, but for a constant; an infinite scale makes it uniform."""
    return lambda tau: -(df + 1) / 2 * np.log1p(np.square(tau / scale) / df)


def reml(b: Array, v: Array) -> float:
    """The tau of largest restricted likelihood."""
    c = _unit(v)
    x = np.linspace(0.0, _farthest(b, c), COARSE)
    for _ in range(CLOSER["top"] + 1):
        best = int(np.argmax(given(c * np.sinh(x), b, v).loglike))
        top, x = x[best], np.linspace(x[max(best - 1, 0)], x[min(best + 1, len(x) - 1)], CLOSE)
    return float(c * np.sinh(top))


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

    ends = np.linspace(*_where(log_mass, _farthest(b, c)), PANELS + 1)
    node, share = np.polynomial.legendre.leggauss(NODES)
    half = (ends[1] - ends[0]) / 2
    x = ((ends[:-1] + half)[:, None] + half * node).ravel()
    at = given(c * np.sinh(x), b, v)
    mass = at.loglike + log_prior(c * np.sinh(x)) + np.log(np.cosh(x))
    weight = np.tile(share, PANELS) * np.exp(mass - mass.max())
    weight /= weight.sum()
    below = np.append(0.0, np.cumsum(weight.reshape(PANELS, NODES).sum(axis=1)))
    return Family(b, v, c * np.sinh(x), weight, at.mean, at.variance, c * np.sinh(ends), below)


def thinned(of: Family) -> Family:
    """The posterior of a large family on ``FEW`` nodes of tau: the Gauss rule of its own weights.

    Ends of the pairs' intervals differ from those of all nodes by less than 1e-6 of a standard error.

    Source: Golub and Welsch 1969, Mathematics of Computation 23, 221; the three terms by Lanczos.

    Examples
    --------
    >>> of = family(np.linspace(0.2, 1.1, 40), np.full(40, 0.01), half_t(3, 0.3))
    >>> few = thinned(of)
    >>> len(of.tau), len(few.tau), bool(abs(few.weight @ few.mean - of.weight @ of.mean) < 1e-9)
    (192, 28, True)
    """
    if len(of.b) < LARGE:
        return of
    c = _unit(of.v)
    x = np.arcsinh(of.tau / c)
    middle = (x[0] + x[-1]) / 2
    half = (x[-1] - x[0]) / 2
    node, vectors = np.linalg.eigh(_lanczos((x - middle) / half, of.weight))
    tau, weight = c * np.sinh(middle + half * node), np.square(vectors[0])
    at = given(tau, of.b, of.v)
    return Family(of.b, of.v, tau, weight / weight.sum(), at.mean, at.variance, of.ends, of.below)


def _lanczos(x: Array, weight: Array) -> Array:
    """Matrix of the three-term recursion of the polynomials orthogonal on x, shape (FEW, FEW)."""
    q = np.zeros((FEW + 1, len(x)))
    q[0] = np.sqrt(weight)
    T = np.zeros((FEW + 1, FEW + 1))
    for k in range(FEW):
        r = x * q[k]
        T[k, k] = r @ q[k]
        for _ in range(2):  # once is not enough for rounding
            r -= q[: k + 1].T @ (q[: k + 1] @ r)
        T[k, k + 1] = T[k + 1, k] = np.linalg.norm(r)
        q[k + 1] = r / T[k, k + 1]
    return T[:FEW, :FEW]


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
    """Quantile p of mixtures of normals over tau, shapes (T, J) -> (J,): Newton's steps, halving where one leaves."""
    from scipy.special import ndtr, ndtri

    some = of.weight > 1e-12
    weight, m, s = of.weight[some], mean[some], np.sqrt(variance[some])
    ends = m + s * float(ndtri(p))  # of each normal: the mixture's lies between the least and the largest
    low, high = ends.min(axis=0), ends.max(axis=0)
    near = 1e-10 * (high - low) + 1e-15 * np.abs(high)
    at = weight @ ends
    for _ in range(60):
        z = (at - m) / s
        over = weight @ ndtr(z) - p
        slope = weight @ (np.exp(-np.square(z) / 2) / s) / np.sqrt(2 * np.pi)
        low, high = np.where(over < 0, at, low), np.where(over < 0, high, at)
        step = at - over / np.maximum(slope, 1e-300)
        there = np.where((step >= low) & (step <= high), step, (low + high) / 2)
        done, at = np.abs(there - at) <= near, there
        if done.all():
            break
    return np.asarray(at)


def tau_quantile(of: Family, p: float) -> float:
    """Quantile p of tau."""
    rising = np.append(True, np.diff(of.below) > 1e-14)
    return _monotone(of.below[rising], of.ends[rising], p)


def _monotone(x: Array, y: Array, at: float) -> float:
    """The monotone cubic through rising points x, y, shapes (n,), n 3 or more, at a place between them.

    ``scipy.interpolate.PchipInterpolator`` has the same numbers; importing it takes longer than pooling 10 000 pairs.

    Source: Fritsch and Butland 1984, SIAM Journal on Scientific and Statistical Computing 5, 300.

    >>> _monotone(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 8.0]), 1.0)
    1.0
    """
    h = np.diff(x)
    rise = np.diff(y) / h
    before, after = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    inner = (before + after) / (before / rise[:-1] + after / rise[1:])
    first, last = (
        max(0.0, ((2 * wide + other) * own - wide * next_one) / (wide + other))
        for wide, other, own, next_one in ((h[0], h[1], rise[0], rise[1]), (h[-1], h[-2], rise[-1], rise[-2]))
    )
    slope = np.concatenate([[first], inner, [last]])
    i = int(np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(h) - 1))
    s = at - x[i]
    square = (3 * rise[i] - 2 * slope[i] - slope[i + 1]) / h[i]
    cube = (slope[i] + slope[i + 1] - 2 * rise[i]) / h[i] ** 2
    return float(y[i] + s * (slope[i] + s * (square + s * cube)))


def _unit(v: Array) -> float:
    """Size of a standard error, for tau to be measured by."""
    return float(1 / np.sqrt(np.mean(1 / v)))


def _farthest(b: Array, c: float) -> float:
    """Largest asinh(tau / c) searched; a pair of small error makes c small compared with the spread of exponents."""
    return max(FARTHEST, float(np.arcsinh(100 * np.ptp(b) / c)))


def _where(log_mass: Callable[[Array], Array], farthest: float) -> tuple[float, float]:
    """Ends of the mass, searched ever more closely."""
    x = np.linspace(0.0, farthest, COARSE)
    for _ in range(CLOSER["mass"] + 1):
        mass = log_mass(x)
        near = np.flatnonzero(mass > mass.max() - FAR)
        low, high = float(x[max(near[0] - 1, 0)]), float(x[min(near[-1] + 1, len(x) - 1)])
        x = np.linspace(low, high, CLOSE)
    return low, high
