"""Ensemble MCMC by emcee with own moves, run until the convergence checks pass.

Two ensembles, with seeds of their own, are independent. Walkers of one ensemble propose for each other and so are not
independent chains: agreement between the two ensembles is the evidence that the posterior was explored. Draws are
thinned to one per autocorrelation time: draws between them add no information, and R-hat of walkers of a few dozen
draws then separates walkers that differ from walkers that mix slowly.

Moves: to a Student-t fitted to the other half of the walkers, or along the difference of two of them. Half of the
walkers move at once, conditional on the others, so that every move leaves the posterior invariant. The Student-t is
much faster where the posterior is close to normal; differential evolution serves elsewhere. emcee's own moves accept
walker by walker in Python, which costs more than the density of a few hundred rows.

Sources: Foreman-Mackey et al. 2013, PASP 125, 306 (emcee; section 2.2, two halves); Goodman & Weare 2010, Comm. App.
Math. Comp. Sci. 5, 65 (autocorrelation time of an ensemble); Vehtari et al. 2021, Bayesian Analysis 16, 667 (R-hat,
bulk and tail ESS); Margossian et al. 2024, Bayesian Analysis, nested R-hat; ter Braak 2006, Stat. Comput. 16, 239,
and Nelson, Ford & Payne 2014, ApJS 210, 11 (differential evolution); Tierney 1994, Ann. Stat. 22, 1701 (independence
sampler).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ...core.arrays import Array, Flags
from .density import Density, Sample, log_posterior
from .diagnostics import autocorrelation_time, diagnose, r_hat
from .importance_sampling import find_mode

Random: TypeAlias = np.random.RandomState  # emcee's

DF = 6.0
RIDGE = 1e-9  # of each variance, so that walkers on one spot still have a covariance
JITTER = 1e-5  # of the length of a difference, as Nelson, Ford & Payne have it


@dataclass(frozen=True, slots=True)
class HalfByHalf:
    """A move of emcee: ``emcee.EnsembleSampler(..., moves=HalfByHalf(towards_others))``.

    Attributes
    ----------
    propose_from : callable
        ``(moving (m, p), others (n, p), random) -> (proposed (m, p), log factor (m,))``, the factor being that of
        Metropolis & Hastings, q(back) / q(forth).
    """

    propose_from: Callable[[Array, Array, Random], tuple[Array, Array]]

    def propose(self, model: Any, state: Any) -> tuple[Any, Flags]:  # noqa: ANN401 emcee has no types
        """Move every walker once: the method that emcee calls."""
        random: Random = model.random
        accepted = np.zeros(len(state.coords), dtype=bool)
        half = np.arange(len(accepted)) % 2 == 0
        random.shuffle(half)
        for moving in (half, ~half):
            at = state.coords[moving]
            proposed, log_factor = self.propose_from(at, state.coords[~moving], random)
            height = model.log_prob_fn(proposed)
            with np.errstate(over="ignore"):  # a proposal so far off that its density is zero
                gain = log_factor + height - state.log_prob[moving]
            won = gain > np.log(random.random_sample(len(at)))
            who = np.flatnonzero(moving)[won]
            state.coords[who], state.log_prob[who], accepted[who] = proposed[won], height[won], True
        return state, accepted


def towards_others(moving: Array, others: Array, random: Random) -> tuple[Array, Array]:
    """A draw of the Student-t with mean and covariance of the others, independent of the walker.

    Examples
    --------
    >>> random = np.random.RandomState(1)
    >>> towards_others(random.randn(64, 3), random.randn(64, 3), random)[0].shape
    (64, 3)
    """
    p = moving.shape[1]
    mean, covariance = others.mean(axis=0), np.cov(others.T).reshape(p, p)
    root = np.linalg.cholesky(covariance + np.diag(RIDGE * np.diag(covariance) + 1e-300))
    z = random.standard_normal(moving.shape) / np.sqrt(random.chisquare(DF, (len(moving), 1)) / DF)
    was = np.linalg.solve(root, (moving - mean).T).T
    return mean + z @ root.T, (DF + p) / 2 * (np.log1p((z**2).sum(axis=1) / DF) - np.log1p((was**2).sum(axis=1) / DF))


def along_differences(moving: Array, others: Array, random: Random) -> tuple[Array, Array]:
    """A step along the difference of two of the others, 2.38 / sqrt(2 p) of its length.

    Examples
    --------
    >>> random = np.random.RandomState(1)
    >>> along_differences(random.randn(64, 3), random.randn(64, 3), random)[1].max()
    np.float64(0.0)
    """
    m, p = moving.shape
    one = random.randint(len(others), size=m)
    two = (one + random.randint(1, len(others), size=m)) % len(others)
    length = 2.38 / np.sqrt(2 * p) * (1 + JITTER * random.standard_normal((m, 1)))
    return moving + length * (others[one] - others[two]), np.zeros(m)


Progress = Callable[[int, float], None]

ENSEMBLES = 2
WALKERS, WALKERS_EACH = 64, 10  # of one ensemble, or so many a parameter: fewer make the fitted Student-t a poor one
SHARES = (0.7, 0.3)  # of moves to the Student-t and along differences
FIRST = 100  # steps before the first check
BURN, TIMES = 10, 50  # autocorrelation times to leave out, and to run at least
GROWTH, MOST_GROWTH = 1.2, 4.0  # steps at one check over those at the previous check
R_HAT, LEAST_ESS = 1.01, 400
ROWS, ROWS_A_DRAW = 20_000, 5  # at most so many draws are kept, or so many times those that were wanted
MOST_NUMBERS = 4e7  # coordinates of all walkers at all steps that are kept in memory: 320 MB
REPORT_EVERY = 10  # steps
MARGIN = 1.1  # on the estimated need: a check costs as much as a few dozen steps
FEWEST, FEWEST_KEPT = 16, 8  # steps below which an interrupted run is discarded, and draws of a walker


def chains(
    density: Density, seed: int, ess: float = 4000, most: int = 8000, progress: Progress | None = None
) -> Sample:
    """Draw from a posterior by emcee.

    Parameters
    ----------
    density : Density
    seed : int
        The same seed gives the same draws, bit for bit; no other state of random numbers is read or changed.
    ess : float
        Effective draws wanted of every parameter, bulk and tail; 400 at least.
    most : int
        Steps of each walker at the most; fewer where they would fill the memory. What there is then is returned, and
        the convergence checks fail.
    progress : callable, optional
        Called every ten steps with the steps done and the effective draws so far.

    Returns
    -------
    Sample
        Walker after walker, burn-in left out, thinned. After Ctrl-C, the draws so far, with ``interrupted`` set.

    Raises
    ------
    FitError
        The density is zero at its start.
    KeyboardInterrupt
        Ctrl-C before any draws could be kept.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.bayes.density import law_density
    >>> from fitmodels.fit.bayes.priors import weak
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("ac2017_table1")), "AW", ["V", "f"])
    >>> sample = chains(law_density(law, weak(law, edges=False)), seed=1, ess=400)
    >>> sample.chains, sample.interrupted
    (128, False)
    """
    walk = _Walk.start(density, seed, progress)
    most = max(FEWEST, min(most, int(MOST_NUMBERS / walk.numbers)))
    wanted, due, interrupted = max(float(ess), LEAST_ESS), min(FIRST, most), False
    try:
        while True:
            walk.run(due)
            state = _assess(walk, wanted)
            if state.enough or walk.steps >= most:
                break
            due = min(state.next, most)
    except KeyboardInterrupt:
        if walk.steps < FEWEST:
            raise
        interrupted, state = True, _assess(walk, wanted)
    m = state.kept.shape[0]
    phi = state.kept.swapaxes(0, 1).reshape(-1, state.kept.shape[2])
    words = _words(walk, state, most, interrupted)
    return Sample(
        phi, len(phi) // m, "emcee", words, ess=state.ess, tau=state.tau / state.thin, interrupted=interrupted
    )


@dataclass(slots=True)
class _Walk:
    """Running ensembles, in coordinates in which the posterior is close to a standard normal."""

    density: Density
    at: Array
    root: Array
    samplers: list[Any]
    states: list[Any]
    progress: Progress | None
    pace: tuple[float, float] = (0.0, 0.0)  # steps left out, and effective draws a step after them: for progress

    @classmethod
    def start(cls, density: Density, seed: int, progress: Progress | None) -> "_Walk":
        """Walkers about the mode, as wide as the posterior is there."""
        from emcee import EnsembleSampler  # type: ignore[import-untyped]

        mode = find_mode(density)
        p = len(mode.at)
        walkers = max(WALKERS, 2 * ((WALKERS_EACH * p + 1) // 2))

        def height(z: Array) -> Array:
            return log_posterior(density, mode.at + z @ mode.root.T)

        moves = list(zip((HalfByHalf(towards_others), HalfByHalf(along_differences)), SHARES, strict=True))
        samplers, states = [], []
        for ensemble in range(ENSEMBLES):
            random = np.random.RandomState(np.random.MT19937(np.random.SeedSequence([seed, ensemble])))
            states.append(_within(height, random.standard_normal((walkers, p))))
            sampler = EnsembleSampler(walkers, p, height, vectorize=True, moves=moves)
            sampler.random_state = random.get_state()
            samplers.append(sampler)
        return cls(density, mode.at, mode.root, samplers, states, progress)

    @property
    def steps(self) -> int:
        """Steps that every ensemble has made."""
        return min(int(sampler.iteration) for sampler in self.samplers)

    @property
    def numbers(self) -> int:
        """Coordinates of all walkers at one step."""
        return sum(int(state.size) for state in self.states)

    def run(self, due: int) -> None:
        """Run the ensembles in parallel until ``due`` steps are made."""
        n = due - self.steps
        # emcee refuses walkers much wider in one direction than in another, as in a long narrow posterior; the
        # convergence checks judge the draws instead
        runs = [
            s.sample(z, iterations=n, skip_initial_state_check=True)
            for s, z in zip(self.samplers, self.states, strict=True)
        ]
        for self.states in map(list, zip(*runs, strict=True)):
            if self.progress and self.steps % REPORT_EVERY == 0:
                burn, rate = self.pace
                self.progress(self.steps, max(self.steps - burn, 0.0) * rate)

    def path(self) -> Array:
        """Positions of the walkers, (steps, walkers of all ensembles, p)."""
        return np.concatenate([s.get_chain()[: self.steps] for s in self.samplers], axis=1)


@dataclass(frozen=True, slots=True)
class _State:
    """State of a run: draws (m, walkers, p) on the scale of phi, and whether they suffice."""

    kept: Array
    tau: Array
    thin: int
    ess: float
    enough: bool
    next: int


def _assess(walk: _Walk, wanted: float) -> _State:
    path = walk.path()
    steps, walkers, _ = path.shape
    tau = autocorrelation_time(path[steps // 2 :])
    tau = np.where(np.isfinite(tau), np.maximum(tau, 1.0), steps)
    slowest = float(tau.max())
    burn = min(int(np.ceil(BURN * slowest)), steps // 2)
    run, rate = steps - burn, walkers / slowest
    thin = int(max(np.ceil(slowest), np.ceil(run * walkers / max(ROWS, ROWS_A_DRAW * wanted))))
    thin = max(1, min(thin, run // FEWEST_KEPT))
    kept = walk.at + path[burn + thin - 1 :: thin] @ walk.root.T
    walk.pace = (burn, rate)
    need, enough = burn + MARGIN * max(TIMES * slowest, wanted / rate), False
    if run >= max(TIMES * slowest, wanted / rate):
        found, alike = _diagnosed(walk.density, kept)
        enough, need = alike and found >= wanted, burn + MARGIN * run * wanted / found
    following = int(np.clip(need, GROWTH * steps, MOST_GROWTH * steps))
    return _State(kept, tau, thin, min(run * rate, float(len(kept) * walkers)), enough, following)


def _diagnosed(density: Density, kept: Array) -> tuple[float, bool]:
    """Smallest effective sample size of the parameters, bulk or tail, and whether walkers and ensembles agree."""
    m, walkers, p = kept.shape
    draws = density.parameters(np.ascontiguousarray(kept.swapaxes(0, 1)).reshape(-1, p))
    by_walker = diagnose(density.parameter_names, draws, Sample(kept, walkers, "emcee", ""))
    by_ensemble = (
        draws.reshape(ENSEMBLES, walkers // ENSEMBLES, m, -1).swapaxes(1, 2).reshape(ENSEMBLES, -1, draws.shape[1])
    )
    worst = max(float(by_walker.r_hat.max()), float(r_hat(by_ensemble).max()))
    found = float(np.minimum(by_walker.ess_bulk, by_walker.ess_tail).min())
    return max(found, 1.0), worst <= R_HAT


def _within(height: Callable[[Array], Array], z: Array) -> Array:
    """Move walkers that start where the density is zero towards the mode until it is positive."""
    outside = ~np.isfinite(height(z))
    while outside.any():
        z[outside] /= 2
        outside = ~np.isfinite(height(z))
    return z


def _words(walk: _Walk, state: _State, most: int, interrupted: bool) -> str:
    made = (
        f"emcee: {ENSEMBLES} ensembles of {walk.samplers[0].nwalkers} walkers, {walk.steps} steps, one in {state.thin} "
        f"kept, autocorrelation time {state.tau.max():.1f} steps"
    )
    if interrupted:
        return made + "; interrupted before the convergence checks passed"
    return made + ("" if state.enough else f"; stopped at {most} steps before the convergence checks passed")
