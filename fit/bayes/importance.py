"""Importance sampling: independent draws of a Student-t about the top of a posterior, weighted by how wrong it is.

A draw ``phi`` of the proposal q has the weight ``p(phi) / q(phi)``. Pareto-smoothing tames the largest weights, and the
shape k-hat of their tail says whether the answer can be trusted: below 0.7 it can. Where one Student-t does badly, a
second is placed where the weighted draws of the first lie, and both propose together.

Source: Vehtari et al. 2024, J. Mach. Learn. Res. 25(72), Pareto smoothed importance sampling; adaptation: Cappe et al.
2008, Stat. Comput. 18, 447; Student-t proposals and the defence of the first: Owen 2013, Monte Carlo theory, ch. 9.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .density import Density, log_posterior
from .mode import find_mode, root_of
from .psis import effective, pareto_smoothed, resample
from .sample import Sample

Array = NDArray[np.float64]

DF = 5.0  # tails heavier than those of a posterior, and yet three proposals in four count
AHEAD = 1.35  # proposals a draw: what a normal posterior of six parameters needs
MOST = 10  # proposals a draw at the most
TRUSTED_K, POOR = 0.7, 0.2  # k-hat and effective share of proposals that call for a second proposal
DEFENCE = 0.3  # share of the first proposal in the mixture with the second
WIDER = 1.1  # of the second: a covariance from weighted draws is rather too small
AT_ONCE = 256  # points in one call, so that their residuals stay in the cache of the processor, and in memory


@dataclass(frozen=True, slots=True)
class _Part:
    """A Student-t with share ``share`` of a proposal."""

    share: float
    at: Array
    root: Array

    def log_density(self, phi: Array) -> Array:
        """Log of share times density but for a constant all parts have in common, (m, p) -> (m,)."""
        z = (phi - self.at) @ np.linalg.inv(self.root).T
        d = np.einsum("ij,ij->i", z, z)
        _, log_det = np.linalg.slogdet(self.root)
        return np.asarray(np.log(self.share) - log_det - (DF + len(self.at)) / 2 * np.log1p(d / DF))


@dataclass(frozen=True, slots=True)
class _Weighted:
    """Proposals, their raw and their smoothed log weights."""

    phi: Array
    raw: Array
    log_weights: Array
    k_hat: float
    ess: float

    @property
    def share(self) -> float:
        return self.ess / len(self.phi)

    @property
    def weights(self) -> Array:
        w = np.exp(self.log_weights - self.log_weights.max())
        return np.asarray(w / w.sum())


def importance(density: Density, rng: np.random.Generator, draws: int = 4000) -> Sample:
    """Draw from a posterior by importance sampling.

    Parameters
    ----------
    density : Density
    rng : Generator
    draws : int
        Draws of equal weight to return; proposals go on until as many are effective, or are ten times as many.

    Returns
    -------
    Sample
        Whatever ``k_hat`` is: above 0.7 it must not be trusted, and chains take over. A draw may stand there
        several times, next to itself.

    Raises
    ------
    FitError
        The density is nothing at its start.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.bayes.law_density import law_density
    >>> from fitmodels.fit.bayes.priors import weak
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> law = fit.power_law(runs, "AW", ["V", "f", "d", "t"], error="additive")
    >>> sample = importance(law_density(law, weak(law, edges=False)), np.random.default_rng(1))
    >>> sample.phi.shape, sample.k_hat < 0.7
    ((4000, 6), True)
    """
    mode = find_mode(density)
    parts: tuple[_Part, ...] = (_Part(1.0, mode.at, mode.root),)
    found = _propose(density, parts, rng, int(np.ceil(AHEAD * draws)))
    if found.k_hat > TRUSTED_K or found.share < POOR:
        moved = _adapted(parts[0], found)
        again = _propose(density, moved, rng, len(found.phi))
        if _rank(again) > _rank(found):
            parts, found = moved, again
    found = _enlarged(density, parts, rng, found, draws)
    phi = found.phi[resample(rng, found.weights, draws)]
    return Sample(phi, 1, "importance", _words(found, len(parts)), k_hat=found.k_hat, ess=found.ess)


def _propose(density: Density, parts: tuple[_Part, ...], rng: np.random.Generator, n: int) -> _Weighted:
    """Draw n proposals and weigh them."""
    p = len(parts[0].at)
    z = rng.standard_normal((n, p)) / np.sqrt(rng.chisquare(DF, (n, 1)) / DF)
    if len(parts) == 1:
        phi = parts[0].at + z @ parts[0].root.T
    else:
        of = rng.choice(len(parts), size=n, p=[part.share for part in parts])
        phi = np.empty((n, p))
        for k, part in enumerate(parts):
            phi[of == k] = part.at + z[of == k] @ part.root.T
    q = np.logaddexp.reduce([part.log_density(phi) for part in parts], axis=0)
    pieces = [log_posterior(density, phi[i : i + AT_ONCE]) for i in range(0, n, AT_ONCE)]
    return _weigh(phi, np.concatenate(pieces) - q)


def _weigh(phi: Array, raw: Array) -> _Weighted:
    smoothed, k_hat = pareto_smoothed(raw)
    return _Weighted(phi, raw, smoothed, float(k_hat), float(effective(smoothed)))


def _adapted(first: _Part, found: _Weighted) -> tuple[_Part, ...]:
    """The first proposal in defence, and one with mean and covariance of the weighted draws."""
    w = found.weights
    mean = w @ found.phi
    off = (found.phi - mean) * np.sqrt(w)[:, None]
    covariance = off.T @ off
    if not (np.diag(covariance) > 0).all():
        return (first,)
    return _Part(DEFENCE, first.at, first.root), _Part(1 - DEFENCE, mean, WIDER * root_of(covariance))


def _rank(found: _Weighted) -> tuple[bool, float]:
    """What makes one set of weights better than another: trusted at all, then more effective."""
    return found.k_hat <= TRUSTED_K, found.ess


def _enlarged(
    density: Density, parts: tuple[_Part, ...], rng: np.random.Generator, found: _Weighted, draws: int
) -> _Weighted:
    """Further proposals until ``draws`` are effective, where that can be."""
    missing = int(1.05 * draws / found.share) - len(found.phi)
    if found.ess >= draws or found.k_hat > TRUSTED_K:
        return found
    more = _propose(density, parts, rng, max(min(missing, MOST * draws - len(found.phi)), AT_ONCE))
    return _weigh(np.vstack([found.phi, more.phi]), np.concatenate([found.raw, more.raw]))


def _words(found: _Weighted, parts: int) -> str:
    about = "about the mode" if parts == 1 else "about the mode and the weighted mean"
    trust = "" if found.k_hat <= TRUSTED_K else ", above 0.7: not to be trusted"
    return (
        f"importance: {len(found.phi)} proposals of a Student-t {about}, {found.ess:.0f} of them effective, "
        f"k-hat {found.k_hat:.2f}{trust}"
    )
