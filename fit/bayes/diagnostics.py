"""Whether draws can be trusted: R-hat, effective draws and Monte Carlo error of each parameter.

Draws have the shape (chains, draws) or (chains, draws, q), answers the shape (q,). Chains are halved, and draws turned
into normal scores of their ranks: Vehtari, Gelman, Simpson, Carpenter & Bürkner 2021, Bayesian Analysis 16, 667,
doi:10.1214/20-BA1221. Draws that cannot be judged (not a number, all one value, fewer than four a chain) get the worst
answer there is, R-hat infinite and no effective draws, so that no gate opens for them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.display import Displayable
from ...core.errors import UsageError
from .autocorrelation import ROUNDING, autocorrelation_time, effective_draws
from .density import Array
from .sample import Sample

__all__ = ["Diagnostics", "autocorrelation_time", "diagnose", "ess_bulk", "ess_mean", "ess_tail", "mcse_mean", "r_hat"]

PIECES = 4  # of independent draws, to compare with one another
FEWEST = 4  # draws of a chain: its halves need two each
TAILS = (0.05, 0.95)  # quantiles whose effective draws are those of the tails: sec. 4.3 there


@dataclass(frozen=True, slots=True, repr=False)
class Diagnostics(Displayable):
    """What is known of how well draws stand for their posterior.

    Attributes
    ----------
    names : tuple of str
        The q parameters.
    chains, length : int
        Draws were judged as so many chains of so many draws; independent draws are cut in four.
    r_hat : ndarray, shape (q,)
        1 where chains tell the same; causes of more: too short chains, several modes, a parameter that nothing holds.
    ess_bulk, ess_tail : ndarray, shape (q,)
        Effective draws for the middle and for the 5 and 95 % quantiles.
    mcse : ndarray, shape (q,)
        Monte Carlo standard error of the mean, in the unit of the parameter.
    k_hat, ess_route : float or None
        As in ``Sample``: Pareto shape of the importance weights, effective draws as the route counts them.
    tau : ndarray or None
        Autocorrelation time of each parameter of the density, in draws of one chain.
    notes : tuple of str
        Which draws could not be judged, and why.
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
    >>> told = diagnose(("V", "f"), draws, Sample(draws, 1, "exact", "drawn independently"))
    >>> bool(told.r_hat.max() < 1.01), bool(told.ess_bulk.min() > 3000)
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


def _ready(draws: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Draws by parameter, zeros for those that cannot be judged, and which these are."""
    draws = np.asarray(draws, dtype=np.float64)
    x = _by_parameter(draws if draws.ndim == 3 else draws[..., None])
    if x.shape[2] < FEWEST:
        raise UsageError(f"chains of {x.shape[2]} draws: at least {FEWEST} are needed to say anything of them.")
    unfit, _ = _unfit(x, ("",) * len(x))
    return np.where(unfit[:, None, None], 0.0, x), unfit


def _all(x: Array, unfit: NDArray[np.bool_]) -> tuple[Array, Array, Array, Array]:
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
    worst, mcse = (np.where(unfit | np.isnan(told), np.inf, told) for told in (worst, mcse))
    return worst, bulk, tail, mcse


def _by_parameter(draws: Array) -> Array:
    """(chains, draws, q) -> (q, chains, draws), in one piece."""
    return np.ascontiguousarray(np.moveaxis(draws, 2, 0))


def _halved(x: Array) -> Array:
    """(q, chains, draws) -> (q, 2 chains, draws // 2); the middle draw of an odd number is left out."""
    n = x.shape[2] // 2
    return np.concatenate([x[:, :, :n], x[:, :, -n:]], axis=1)


def _unfit(x: Array, names: tuple[str, ...]) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Which parameters' draws cannot be judged, and a sentence for each."""
    q, chains, n = x.shape
    if n < FEWEST:
        return np.ones(q, bool), (f"{chains} chains of {n} draws are too short to judge: draw more than 400 in all.",)
    bad = ~np.isfinite(x).reshape(q, -1)
    broken = bad.any(axis=1)
    with np.errstate(invalid="ignore"):
        still = ~broken & (np.ptp(x, axis=(1, 2)) <= ROUNDING * np.abs(x).max(axis=(1, 2)))
    return broken | still, (
        *(f"{names[j]}: {bad[j].sum()} of {chains * n} draws are not finite numbers." for j in np.flatnonzero(broken)),
        *(f"{names[j]}: all draws are {x[j, 0, 0]:.6g}, so they never moved." for j in np.flatnonzero(still)),
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


def _placed(ordered: Array, order: NDArray[np.intp]) -> Array:
    """Normal scores (Blom's) of ascending rows, put where they came from; ties share their mean rank."""
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
