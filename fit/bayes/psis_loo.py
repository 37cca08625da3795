"""Pareto-smoothed importance weights (PSIS), and leave-one-edge-out cross-validation by them (LOO).

The M largest weights are replaced by the expected order statistics of a generalised Pareto distribution fitted to them:
Vehtari, Simpson, Gelman, Yao & Gabry 2024, J. Mach. Learn. Res. 25(72), arXiv:1507.02646. Its shape k-hat bounds the
number of finite moments of the weights: above 0.7 no practical number of draws gives a stable mean.

LOO: draws are reweighted by one over the likelihood of the edge, with smoothed weights: Vehtari, Gelman & Gabry 2017,
Statistics and Computing 27, 1413, doi:10.1007/s11222-016-9696-4. An edge is left out as a whole, as its rows are not
independent.
"""

from dataclasses import dataclass
from math import ceil, inf, sqrt

import numpy as np

from ...core.arrays import Array, Ints
from ...core.display import Displayable
from ...core.errors import FitError, UsageError
from ...core.rounding import listed
from ..available import NotAvailable

TAIL_SHARE, TAIL_ROOT = 0.2, 3.0  # M = min(0.2 S, 3 sqrt(S)): sec. 2.3 there
FEWEST = 6  # in a tail: with fewer its lowest quarter is one draw, and the shape cannot be estimated
PRIOR_DRAWS, PRIOR_SHAPE = 10, 0.5  # weight and place of the prior on k: sec. 2.4 there
K_HAT = 0.7  # above it weights are unreliable: sec. 3.2.4 there
EQUAL = 1e-12  # of log weights: what lies closer differs by rounding alone


def pareto_smoothed(log_weights: Array, efficiency: float = 1.0) -> tuple[Array, float]:
    """Smoothed, normalised log weights of draws, and the Pareto shape of the raw ones.

    Parameters
    ----------
    log_weights : ndarray, shape (S,)
        Log of target over proposal at each draw, but for a constant; minus infinity is a weight of zero.
    efficiency : float
        Effective draws over draws, where draws come from a chain: the fewer, the longer the tail.

    Returns
    -------
    log_weights : ndarray, shape (S,)
        Their exponentials sum to 1.
    k_hat : float
        Minus infinity where all weights are equal: the proposal is the target. Infinity, with unsmoothed weights,
        where the shape cannot be estimated: 25 draws or fewer, or a tail of equal weights.

    Raises
    ------
    FitError
        A weight that is NaN or infinite, or no weight above zero.

    Examples
    --------
    >>> x = np.random.default_rng(1).standard_t(3, 1000)
    >>> log_weights, k_hat = pareto_smoothed(-(x**2) / 2 + 2 * np.log1p(x**2 / 3))
    >>> round(float(np.exp(log_weights).sum()), 9), k_hat < 0.7
    (1.0, True)
    """
    log_weights = np.array(log_weights, dtype=np.float64)
    if not log_weights.size or np.isnan(log_weights).any() or not np.isfinite(log_weights.max()):
        raise FitError(_unusable(log_weights))
    log_weights -= log_weights.max()
    if log_weights.min() > -EQUAL:
        return np.full(log_weights.size, -np.log(log_weights.size)), -inf
    M = tail_length(log_weights.size, efficiency)
    k_hat = _smooth_tail(log_weights, M) if M >= FEWEST else inf
    return log_weights - np.log(np.exp(log_weights).sum()), k_hat


def smoothed_columns(log_weights: Array, efficiency: float = 1.0) -> tuple[Array, Array]:
    """Smoothed log weights and k-hat of each column, (S, G) -> (S, G) and (G,).

    Examples
    --------
    >>> smoothed_columns(np.zeros((100, 2)))[1].tolist()
    [-inf, -inf]
    """
    pairs = [pareto_smoothed(column, efficiency) for column in np.asarray(log_weights).T]
    return np.stack([smoothed for smoothed, _ in pairs], axis=1), np.array([k_hat for _, k_hat in pairs])


def tail_length(S: int, efficiency: float = 1.0) -> int:
    """Number of the S weights that are smoothed.

    Examples
    --------
    >>> tail_length(4000), tail_length(100)
    (190, 20)
    """
    return ceil(min(TAIL_SHARE * S, TAIL_ROOT * sqrt(S / efficiency)))


def pareto_fit(excess: Array) -> tuple[float, float]:
    """Shape and scale of a generalised Pareto distribution: Zhang & Stephens 2009, Technometrics 51, 316.

    The shape is drawn towards 1/2 as by ten more draws.

    Parameters
    ----------
    excess : ndarray, shape (M,)
        Above the cutoff, ascending.

    Returns
    -------
    k, sigma : float
        Not finite where the lowest quarter is all one value.

    Examples
    --------
    >>> k, sigma = pareto_fit(-np.log1p(-(np.arange(1000) + 0.5) / 1000))  # quantiles of an exponential: k 0, sigma 1
    >>> abs(k) < 0.02, abs(sigma - 1) < 0.02
    (True, True)
    """
    M = excess.size
    quartile = excess[int(M / 4 + 0.5) - 1]
    if not quartile > excess[0]:
        return inf, inf
    m = 30 + int(sqrt(M))
    theta = 1 / excess[-1] + (1 - np.sqrt(m / (np.arange(1, m + 1) - 0.5))) / (3 * quartile)
    k = np.log1p(-theta[:, None] * excess).mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        profile = M * (np.log(-theta / k) - k - 1)
    weight = np.exp(profile - profile.max())
    mean = float(weight @ theta / weight.sum())
    shape = float(np.log1p(-mean * excess).mean())
    return (M * shape + PRIOR_DRAWS * PRIOR_SHAPE) / (M + PRIOR_DRAWS), -shape / mean


def effective(log_weights: Array) -> float:
    """Effective number of draws, ``(sum w)^2 / sum w^2``: Kong, Liu & Wong 1994, J. Am. Stat. Assoc. 89, 278.

    Examples
    --------
    >>> round(effective(np.log([0.5, 0.25, 0.25])), 3)
    2.667
    """
    weights = np.exp(log_weights - np.max(log_weights))
    return float(weights.sum() ** 2 / (weights**2).sum())


def resample(rng: np.random.Generator, weights: Array, n: int) -> Ints:
    """Indices of n draws in proportion to their weights, by systematic resampling.

    A draw of weight w is taken floor(n w) times or once more: Kitagawa 1996, J. Comput. Graph. Stat. 5, 1. Indices
    ascend, so copies of a draw are adjacent, and the autocorrelation of the resample accounts for them.

    Parameters
    ----------
    rng : Generator
    weights : ndarray, shape (S,)
        None below zero, of any sum.
    n : int

    Returns
    -------
    ndarray of int, shape (n,)

    Examples
    --------
    >>> resample(np.random.default_rng(1), np.array([0.5, 0.0, 0.25, 0.25]), 8).tolist()
    [0, 0, 0, 0, 2, 2, 3, 3]
    """
    total = np.cumsum(weights)
    places = (rng.random() + np.arange(n)) / n * total[-1]
    last = np.flatnonzero(weights)[-1]  # rounding may carry the last place past the end
    return np.asarray(np.minimum(np.searchsorted(total, places, side="right"), last))


def _smooth_tail(log_weights: Array, M: int) -> float:
    """Smooth the M largest of weights of which the largest is 1, in place; their k-hat."""
    top = np.argpartition(log_weights, -M - 1)[-M - 1 :]
    top = top[np.argsort(log_weights[top])]
    cutoff, tail = np.exp(log_weights[top[0]]), top[1:]
    k, sigma = pareto_fit(np.exp(log_weights[tail]) - cutoff)
    if not np.isfinite(k):
        return inf
    beyond = -np.log1p(-(np.arange(M) + 0.5) / M)  # of an exponential, at the middle of each step
    quantile = sigma * (np.expm1(k * beyond) / k if abs(k) > np.finfo(float).eps else beyond)
    log_weights[tail] = np.minimum(np.log(cutoff + quantile), 0.0)
    return k


def _unusable(log_weights: Array) -> str:
    if not log_weights.size:
        return "no draws, so no weights: draw at least 400."
    bad = np.flatnonzero(np.isnan(log_weights) | (log_weights == inf))
    if bad.size:
        seen = float(log_weights[bad[0]])
        return (
            f"log weight of draw {bad[0] + 1} is {seen:g}, and {bad.size} of {log_weights.size} are like it: "
            "a weight is finite; the density of the model or of the proposal is zero there."
        )
    return f"all {log_weights.size} draws have weight zero: the proposal misses the posterior; use MCMC."


NAMED = 5  # edges listed in a sentence


@dataclass(frozen=True, slots=True, repr=False)
class LeaveOut(Displayable):
    """Expected log predictive density of left-out edges; only differences between models are meaningful.

    Attributes
    ----------
    units : tuple of str
        The G edges (rows, where there are no edges).
    elpd : float
        Sum over edges of the log predictive density of an edge by draws without it, nats; comparable between models of
        the same rows on the same scale.
    se : float or NotAvailable
        Standard error of ``elpd`` over edges.
    p_eff : float
        Effective number of parameters.
    pointwise : ndarray, shape (G,)
        Of each edge.
    k_hat : ndarray, shape (G,)
        Pareto shape of its weights.
    """

    units: tuple[str, ...]
    elpd: float
    se: float | NotAvailable
    p_eff: float
    pointwise: Array
    k_hat: Array

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Edges whose k-hat is above 0.7: their value is unreliable without a refit that leaves them out."""
        return tuple(name for name, k in zip(self.units, self.k_hat, strict=True) if not k <= K_HAT)

    @property
    def words(self) -> str:
        """The result in one or two sentences."""
        G, doubtful = len(self.units), self.doubtful
        error = f" ± {self.se:.1f}" if isinstance(self.se, float) else ""
        found = f"LOO by edge: elpd {self.elpd:.1f}{error} over {G} edges, effective parameters {self.p_eff:.1f}."
        if not doubtful:
            return found
        return (
            f"{found} Unreliable for {listed(doubtful, NAMED)} (k-hat up to {np.nanmax(self.k_hat):.2f}, above "
            f"{K_HAT:g}): refit without {'it' if len(doubtful) == 1 else 'them'}."
        )


def leave_one_out(by_unit: Array, units: tuple[str, ...]) -> LeaveOut:
    """Expected log predictive density of each edge when it is left out.

    Parameters
    ----------
    by_unit : ndarray, shape (S, G)
        Log likelihood of each edge at each draw, random levels integrated out.
    units : tuple of str
        Names of the G edges.

    Raises
    ------
    UsageError
        Names that do not fit the columns.
    FitError
        A log likelihood that is not a finite number.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> y = rng.normal(size=8)
    >>> mean = rng.normal(y.mean(), 8**-0.5, size=(4000, 1))  # draws of a mean, sd 1 known
    >>> found = leave_one_out(-((y - mean) ** 2) / 2 - np.log(2 * np.pi) / 2, tuple("abcdefgh"))
    >>> found.doubtful, bool(0.2 < found.p_eff < 1.2)
    ((), True)
    """
    S, G = by_unit.shape
    if len(units) != G:
        raise UsageError(f"log likelihoods of {G} edges and {len(units)} names: each edge has one.")
    _finite(by_unit, units)
    log_weights, k_hat = smoothed_columns(-by_unit)
    pointwise = _log_sum(log_weights + by_unit)
    seen = _log_sum(by_unit) - np.log(S)
    se = float(np.sqrt(G * pointwise.var(ddof=1))) if G > 1 else NotAvailable("one edge only: no variance over edges")
    return LeaveOut(tuple(units), float(pointwise.sum()), se, float((seen - pointwise).sum()), pointwise, k_hat)


def _log_sum(a: Array) -> Array:
    """Log of the sum of exponentials of each column."""
    top = a.max(axis=0)
    return np.asarray(top + np.log(np.exp(a - top).sum(axis=0)))


def _finite(by_unit: Array, units: tuple[str, ...]) -> None:
    bad = ~np.isfinite(by_unit)
    if bad.any():
        g = int(bad.any(axis=0).argmax())
        seen = float(by_unit[bad[:, g].argmax(), g])
        raise FitError(
            f"edge {units[g]}: log likelihood {seen:g} at {bad[:, g].sum()} of {len(by_unit)} draws; a posterior has "
            "no draws where an edge is impossible: draw again by MCMC."
        )
