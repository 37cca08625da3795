"""Convergence diagnostics: R-hat, effective sample size and Monte Carlo error of each parameter.

Draws have the shape (chains, draws) or (chains, draws, q), results the shape (q,). Chains are split in halves, and
draws rank-normalised: Vehtari, Gelman, Simpson, Carpenter & Bürkner 2021, Bayesian Analysis 16, 667,
doi:10.1214/20-BA1221, eq. 10 to 14. Draws that cannot be assessed (not finite, constant, fewer than four per chain)
get the worst values, R-hat infinite and no effective draws, so that the convergence checks fail.

R-hat, effective sample sizes and Monte Carlo errors equal those of arviz-stats 0.8 within 2e-15, which is not used:
its base imports scipy.stats and scipy.interpolate (twice the time of numpy, scipy.special and scipy.fft together),
and xarray with pandas where they are installed; one call takes 3 to 5 times as long; and its k-hat differs by 0.2 %.

Sources: Geyer 1992, Stat. Sci. 7, 473 (the initial monotone sequence); Goodman & Weare 2010, Commun. Appl. Math.
Comput. Sci. 5, 65, and Sokal 1997, sec. 3 (ensembles).
"""

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array, Flags, Ints
from ...core.display import Displayable
from ...core.errors import UsageError
from .density import Sample

SHORT = 12  # lags summed directly: independent draws need no more
WINDOW = 5.0  # autocorrelation times to sum over: Sokal; emcee takes the same
ROUNDING = 4 * np.finfo(float).eps  # relative: draws that differ by less are all one value


def effective_draws(x: Array) -> Array:
    """Effective draws of chains, by Geyer's initial monotone sequence.

    Parameters
    ----------
    x : ndarray, shape (q, chains, draws)
        Chains to compare: split in halves by the caller.

    Returns
    -------
    ndarray, shape (q,)
        At most S log10(S); NaN where all draws are equal.

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
    if short < n and not ended.all():  # correlated draws: all lags, by Fourier transform
        tau[~ended], _ = _geyer(_lags(x[~ended], n) / n, between[~ended], n)
    ess = m * n / np.maximum(tau, 1 / np.log10(m * n))
    return np.asarray(ess)


def autocorrelation_time(chain: Array) -> Array:
    """Integrated autocorrelation time of an ensemble, as emcee estimates it: Goodman & Weare 2010, Sokal 1997.

    Autocorrelations of the walkers are averaged, and summed up to the first lag of five times the sum.

    Parameters
    ----------
    chain : ndarray, shape (steps, walkers, p)

    Returns
    -------
    ndarray, shape (p,)
        In steps; infinite where a walker accepted no proposal or is not finite. Antithetic walkers give values near
        0: use at least 1 for them.

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


def _geyer(autocovariance: Array, between: Array, n: int) -> tuple[Array, Flags]:
    """Autocorrelation time by Geyer's initial monotone sequence, (q, lags) -> (q,), and whether the sequence ended."""
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


__all__ = ["Diagnostics", "autocorrelation_time", "diagnose", "ess_bulk", "ess_mean", "ess_tail", "mcse_mean", "r_hat"]

PIECES = 4  # of independent draws, to compare with each other
FEWEST = 4  # draws of a chain: its halves need two each
TAILS = (0.05, 0.95)  # quantiles whose effective draws are those of the tails: sec. 4.3 there


@dataclass(frozen=True, slots=True, repr=False)
class Diagnostics(Displayable):
    """Convergence diagnostics of draws.

    Attributes
    ----------
    names : tuple of str
        The q parameters.
    chains, length : int
        Number and length of chains in the diagnostics; independent draws are split into four.
    r_hat : ndarray, shape (q,)
        1 where chains agree; larger for short chains, several modes, or a parameter that is not identified.
    ess_bulk, ess_tail : ndarray, shape (q,)
        Effective draws for the middle and for the 5 and 95 % quantiles.
    mcse : ndarray, shape (q,)
        Monte Carlo standard error of the mean, in the unit of the parameter.
    k_hat, ess_route : float or None
        As in ``Sample``: Pareto shape of the importance weights, effective draws by the sampling method.
    tau : ndarray or None
        Autocorrelation time of each parameter of the density, in draws of one chain.
    notes : tuple of str
        Draws that could not be assessed, with the reason.
    """

    names: tuple[str, ...]
    chains: int
    length: int
    r_hat: Array
    ess_bulk: Array
    ess_tail: Array
    mcse: Array
    k_hat: float | None = None
    tau: Array | None = None
    ess_route: float | None = None
    notes: tuple[str, ...] = ()


def diagnose(names: tuple[str, ...], draws: Array, sample: Sample) -> Diagnostics:
    """Diagnostics of draws.

    Parameters
    ----------
    names : tuple of str
        Of the q columns.
    draws : ndarray, shape (S, q)
        Chain after chain.
    sample : Sample
        Where they come from.

    Raises
    ------
    UsageError
        Names that do not fit the columns, or chains of unequal length.

    Examples
    --------
    >>> draws = np.random.default_rng(1).normal(size=(4000, 2))
    >>> found = diagnose(("V", "f"), draws, Sample(draws, 1, "exact", "drawn independently"))
    >>> bool(found.r_hat.max() < 1.01), bool(found.ess_bulk.min() > 3000)
    (True, True)
    """
    S, q = draws.shape
    chains = PIECES if sample.chains == 1 else sample.chains
    if len(names) != q or (sample.chains > 1 and S % chains):
        raise UsageError(f"{S} draws of {q} columns: they need {q} names, not {len(names)}, and {chains} equal chains.")
    x = _by_parameter(draws[: S // chains * chains].reshape(chains, S // chains, q))
    unfit, notes = _unfit(x, names)
    if x.shape[2] < FEWEST:
        worst, bulk, tail, mcse = np.full(q, np.inf), np.zeros(q), np.zeros(q), np.full(q, np.inf)
    else:
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            worst, bulk, tail, mcse = _all(np.where(unfit[:, None, None], 0.0, x), unfit)
    return Diagnostics(names, chains, x.shape[2], worst, bulk, tail, mcse, sample.k_hat, sample.tau, sample.ess, notes)


def r_hat(draws: Array) -> Array:
    """Rank-normalised split R-hat, the larger of that of draws and of their distance from the median: eq. 14 there.

    Examples
    --------
    >>> apart = np.random.default_rng(1).normal(size=(4, 500)) + np.array([[0], [0], [0], [1]])
    >>> bool(r_hat(apart)[0] > 1.1)
    True
    """
    return _one(draws, 0)


def ess_bulk(draws: Array) -> Array:
    """Effective draws for the middle: of the normal scores of ranks.

    Examples
    --------
    >>> bool(abs(ess_bulk(np.random.default_rng(1).normal(size=(4, 1000)))[0] / 4000 - 1) < 0.1)
    True
    """
    return _one(draws, 1)


def ess_tail(draws: Array) -> Array:
    """Effective draws for the 5 and 95 % quantiles, the smaller.

    Examples
    --------
    >>> bool(abs(ess_tail(np.random.default_rng(1).normal(size=(4, 1000)))[0] / 4000 - 1) < 0.2)
    True
    """
    return _one(draws, 2)


def mcse_mean(draws: Array) -> Array:
    """Monte Carlo standard error of the mean: standard deviation over the root of ``ess_mean``.

    Examples
    --------
    >>> float(mcse_mean(np.random.default_rng(1).normal(size=(4, 1000)))[0].round(3))
    0.016
    """
    return _one(draws, 3)


def ess_mean(draws: Array) -> Array:
    """Effective draws for the mean: of the draws as they are.

    Examples
    --------
    >>> ess_mean(np.ones((4, 1000))).tolist()
    [0.0]
    """
    x, unfit = _ready(draws)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(unfit, 0.0, effective_draws(_halved(x)))


def _one(draws: Array, which: int) -> Array:
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return _all(*_ready(draws))[which]


def _ready(draws: Array) -> tuple[Array, Flags]:
    """Draws by parameter, zeros for those that cannot be assessed, and a mask of these."""
    draws = np.asarray(draws, dtype=np.float64)
    x = _by_parameter(draws if draws.ndim == 3 else draws[..., None])
    if x.shape[2] < FEWEST:
        raise UsageError(f"chains of {x.shape[2]} draws: at least {FEWEST} are needed for diagnostics.")
    unfit, _ = _unfit(x, ("",) * len(x))
    return np.where(unfit[:, None, None], 0.0, x), unfit


def _all(x: Array, unfit: Flags) -> tuple[Array, Array, Array, Array]:
    """R-hat, bulk and tail ESS, Monte Carlo error of the mean, of draws (q, chains, draws)."""
    halves = _halved(x)
    scores, folded = _scores(halves.reshape(len(x), -1))
    shape = halves.shape
    worst = np.fmax(*(_spread_ratio(z.reshape(shape)) for z in (scores, folded)))
    low, high = np.quantile(x, TAILS, axis=(1, 2))
    below = [_halved((x <= level[:, None, None]).astype(np.float64)) for level in (low, high)]
    bulk, left, right, mean = np.split(effective_draws(np.concatenate([scores.reshape(shape), *below, halves])), 4)
    mcse = x.std(axis=(1, 2), ddof=1) / np.sqrt(mean)
    bulk, tail = (np.where(unfit | np.isnan(ess), 0.0, ess) for ess in (bulk, np.minimum(left, right)))
    worst, mcse = (np.where(unfit | np.isnan(value), np.inf, value) for value in (worst, mcse))
    return worst, bulk, tail, mcse


def _by_parameter(draws: Array) -> Array:
    """(chains, draws, q) -> (q, chains, draws), in one piece."""
    return np.ascontiguousarray(np.moveaxis(draws, 2, 0))


def _halved(x: Array) -> Array:
    """(q, chains, draws) -> (q, 2 chains, draws // 2); the middle draw of an odd number is left out."""
    n = x.shape[2] // 2
    return np.concatenate([x[:, :, :n], x[:, :, -n:]], axis=1)


def _unfit(x: Array, names: tuple[str, ...]) -> tuple[Flags, tuple[str, ...]]:
    """Mask of the parameters whose draws cannot be assessed, and a sentence for each."""
    q, chains, n = x.shape
    if n < FEWEST:
        return np.ones(q, bool), (f"{chains} chains of {n} draws are too short to assess: draw more than 400 in all.",)
    bad = ~np.isfinite(x).reshape(q, -1)
    broken = bad.any(axis=1)
    with np.errstate(invalid="ignore"):
        still = ~broken & (np.ptp(x, axis=(1, 2)) <= ROUNDING * np.abs(x).max(axis=(1, 2)))
    return broken | still, (
        *(f"{names[j]}: {bad[j].sum()} of {chains * n} draws are not finite numbers." for j in np.flatnonzero(broken)),
        *(f"{names[j]}: all draws are {x[j, 0, 0]:.6g}: the chains are constant." for j in np.flatnonzero(still)),
    )


def _scores(x: Array) -> tuple[Array, Array]:
    """Normal scores of ranks of each row, and of the ranks of distances from the median, (q, S) -> two of (q, S)."""
    order = np.argsort(x, axis=1)
    ordered = np.take_along_axis(x, order, axis=1)
    S = x.shape[1]
    distance = np.abs(ordered - (ordered[:, (S - 1) // 2, None] + ordered[:, S // 2, None]) / 2)
    merged = np.argsort(distance, axis=1, kind="stable")  # falls, then rises: a stable sort only merges
    return _placed(ordered, order), _placed(
        np.take_along_axis(distance, merged, axis=1), np.take_along_axis(order, merged, axis=1)
    )


def _placed(ordered: Array, order: Ints) -> Array:
    """Normal scores (Blom's) of ascending rows, in the original order; ties share their mean rank."""
    from scipy.special import ndtri

    q, S = ordered.shape
    new = np.ones((q, S), bool)
    np.not_equal(ordered[:, 1:], ordered[:, :-1], out=new[:, 1:])
    first = np.flatnonzero(new)
    if first.size == q * S:
        scores = np.broadcast_to(ndtri((np.arange(S) + 5 / 8) / (S + 1 / 4)), (q, S))
    else:
        ties = np.diff(first, append=q * S)
        rank = first % S + (ties + 1) / 2
        scores = np.repeat(ndtri((rank - 3 / 8) / (S + 1 / 4)), ties).reshape(q, S)
    z = np.empty((q, S))
    np.put_along_axis(z, order, scores, axis=1)
    return z


def _spread_ratio(x: Array) -> Array:
    """R-hat of chains as they are, (q, chains, draws) -> (q,): eq. 4 there."""
    n = x.shape[2]
    within = x.var(axis=2, ddof=1).mean(axis=1)
    between = x.mean(axis=2).var(axis=1, ddof=1)
    return np.asarray(np.sqrt((n - 1) / n + between / within))
