"""Moves of walkers for emcee: to a Student-t fitted to the other half, or along the difference of two walkers of it.

Half of the walkers move at once, given where the others are, so that every move leaves the posterior as it is. The
Student-t is the faster by far where the posterior is near a normal one; differential evolution carries it where not.
emcee's own moves accept walker by walker in Python, which costs more than the posterior of a few hundred rows does.

Sources: Foreman-Mackey et al. 2013, PASP 125, 306, section 2.2 (two halves); ter Braak 2006, Stat. Comput. 16, 239, and
Nelson, Ford & Payne 2014, ApJS 210, 11 (differential evolution); Tierney 1994, Ann. Stat. 22, 1701 (independence).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
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

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:  # noqa: ANN401 emcee has no types
        """Move every walker once: what emcee calls."""
        random: Random = model.random
        accepted = np.zeros(len(state.coords), dtype=bool)
        half = np.arange(len(accepted)) % 2 == 0
        random.shuffle(half)
        for moving in (half, ~half):
            at = state.coords[moving]
            proposed, log_factor = self.propose_from(at, state.coords[~moving], random)
            height = model.log_prob_fn(proposed)
            won = log_factor + height - state.log_prob[moving] > np.log(random.random_sample(len(at)))
            who = np.flatnonzero(moving)[won]
            state.coords[who], state.log_prob[who], accepted[who] = proposed[won], height[won], True
        return state, accepted


def towards_others(moving: Array, others: Array, random: Random) -> tuple[Array, Array]:
    """A draw of the Student-t with mean and covariance of the others, wherever the walker was.

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
