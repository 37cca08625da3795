"""Posterior mode, and importance sampling with Student-t proposals about it.

The mode is found by Newton's method: in coordinates z, ``phi = at + root z``, gradient and Hessian are differences over
one stencil of 1 + p + p^2 points, and the step is tried at several lengths at once: two calls per iteration, three or
four iterations.

A draw ``phi`` of the proposal q has the weight ``p(phi) / q(phi)``. The largest weights are Pareto-smoothed, and the
shape k-hat of their tail decides whether the result is reliable: below 0.7 it is. Where one Student-t is a poor
proposal, a second is placed at the weighted draws of the first, and the mixture of both is used.

Sources: Nocedal & Wright 2006, Numerical Optimization, sections 3.4 (modified Hessian) and 8.1 (differences); Vehtari
et al. 2024, J. Mach. Learn. Res. 25(72), Pareto smoothed importance sampling; adaptation: Cappe et al. 2008, Stat.
Comput. 18, 447; Student-t proposals and defensive mixtures: Owen 2013, Monte Carlo theory, ch. 9.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from ...core.arrays import Array, Ints
from ...core.errors import FitError
from .density import Density, Sample, log_posterior
from .psis_loo import effective, pareto_smoothed, resample

STEP = 0.05  # of the stencil, in standard deviations: a log density of 1e3 then leaves 1e-7 of noise in the Hessian
NEAR = 1e-3  # decrement below which a last full step reaches the mode within 0.001 sd
ROUNDS = 30
LENGTHS = 2.0 ** np.array([1, 0, -1, -2, -3, -5, -8])
LEAST_ROOT = 1e-3  # least eigenvalue of a guessed correlation: few edges give a nearly singular covariance


@dataclass(frozen=True, slots=True)
class Mode:
    """Mode of a density, and its curvature there.

    Attributes
    ----------
    at : ndarray, shape (p,)
    root : ndarray, shape (p, p)
        ``root @ root.T`` is the covariance of a normal density of the same curvature.
    curved : bool
        Whether ``root`` is from the curvature; otherwise it is from the initial covariance of the density.
    """

    at: Array
    root: Array
    curved: bool


def find_mode(density: Density) -> Mode:
    """Mode of a density by Newton's method from ``density.start``.

    Raises
    ------
    FitError
        The density is zero at its start.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.bayes.density import law_density
    >>> from fitmodels.fit.bayes.priors import weak
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> find_mode(law_density(law, weak(law, edges=False))).curved
    True
    """
    at, given = np.array(density.start, dtype=float), root_of(density.spread)
    if not np.isfinite(log_posterior(density, at[None])[0]):
        raise FitError("the posterior density is zero at its start; check that priors and data have the same unit")
    root = given
    for _ in range(ROUNDS):
        gradient, hessian = _differences(density, at, root)
        if not np.isfinite(hessian).all():
            break
        values, vectors = np.linalg.eigh(-hessian)
        convex = bool(values[0] > 1e-8 * values[-1] > 0)
        new_root = root @ (vectors / np.sqrt(np.maximum(np.abs(values), 1e-8 * np.abs(values).max() + 1e-12)))
        ahead = np.linalg.solve(root, new_root).T @ gradient  # Newton's step in coordinates of the new root
        if convex and ahead @ ahead < NEAR:
            return Mode(at + new_root @ ahead, new_root, True)
        trials = at + LENGTHS[:, None] * (new_root @ ahead)
        height = log_posterior(density, np.vstack([at, trials]))
        best = int(height.argmax())
        if best == 0:
            return Mode(at, new_root if convex else given, convex)
        at, root = trials[best - 1], new_root if convex else root
    return Mode(at, given, False)


def root_of(covariance: Array) -> Array:
    """Square root of a covariance, also of one that is not quite positive definite, (p, p) -> (p, p)."""
    variance = np.diag(covariance)
    sd = np.sqrt(np.where(np.isfinite(variance) & (variance > 0), variance, 1.0))
    correlation = np.where(np.isfinite(covariance), covariance, 0.0) / np.outer(sd, sd)
    values, vectors = np.linalg.eigh(correlation)
    return np.asarray(sd[:, None] * (vectors * np.sqrt(np.maximum(values, LEAST_ROOT))))


@cache
def _stencil(p: int) -> tuple[Array, Ints, Ints]:
    """Centre, one step forth and back on each axis, and on the diagonal of each pair of axes."""
    i, j = np.triu_indices(p, 1)
    axes = np.eye(p)
    pairs = axes[i] + axes[j]
    return np.vstack([np.zeros((1, p)), axes, -axes, pairs, -pairs]), i, j


def _differences(density: Density, at: Array, root: Array) -> tuple[Array, Array]:
    """Gradient and Hessian of the log density in the coordinates of ``root``."""
    p = len(at)
    points, i, j = _stencil(p)
    f = log_posterior(density, at + STEP * points @ root.T)
    with np.errstate(invalid="ignore"):
        forth, back = f[1 : p + 1], f[p + 1 : 2 * p + 1]
        both, neither = np.split(f[2 * p + 1 :], 2)
        axis = forth + back
        hessian = np.diag(axis - 2 * f[0])
        hessian[i, j] = hessian[j, i] = (both + neither - axis[i] - axis[j] + 2 * f[0]) / 2
        return (forth - back) / (2 * STEP), hessian / STEP**2


DF = 5.0  # tails heavier than those of a posterior; about 3 proposals in 4 are effective
OVERSAMPLE = 1.35  # proposals a draw: what a normal posterior of six parameters needs
MOST = 10  # proposals a draw at the most
RELIABLE_K, POOR = 0.7, 0.2  # k-hat and effective share of proposals that call for a second proposal
DEFENCE = 0.3  # share of the first proposal in the mixture with the second
WIDER = 1.1  # of the second: a covariance from weighted draws is rather too small
AT_ONCE = 256  # points in one call, so that their residuals fit the cache of the processor


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
        With ``k_hat``: above 0.7 it is unreliable, and MCMC is used instead. A draw may be repeated, in adjacent
        positions.

    Raises
    ------
    FitError
        The density is zero at its start.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.bayes.density import law_density
    >>> from fitmodels.fit.bayes.priors import weak
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> law = fit.power_law(runs, "AW", ["V", "f", "d", "t"], error="additive")
    >>> sample = importance(law_density(law, weak(law, edges=False)), np.random.default_rng(1))
    >>> sample.phi.shape, sample.k_hat < 0.7
    ((4000, 6), True)
    """
    mode = find_mode(density)
    parts: tuple[_Part, ...] = (_Part(1.0, mode.at, mode.root),)
    found = _propose(density, parts, rng, int(np.ceil(OVERSAMPLE * draws)))
    if found.k_hat > RELIABLE_K or found.share < POOR:
        moved = _adapted(parts[0], found)
        again = _propose(density, moved, rng, len(found.phi))
        if _rank(again) > _rank(found):
            parts, found = moved, again
    found = _enlarged(density, parts, rng, found, draws)
    phi = found.phi[resample(rng, found.weights, draws)]
    return Sample(phi, 1, "importance", _words(found, len(parts)), k_hat=found.k_hat, ess=found.ess)


def _propose(density: Density, parts: tuple[_Part, ...], rng: np.random.Generator, n: int) -> _Weighted:
    """Draw n proposals and their weights."""
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
    """The first proposal as defensive component, and one with mean and covariance of the weighted draws."""
    w = found.weights
    mean = w @ found.phi
    off = (found.phi - mean) * np.sqrt(w)[:, None]
    covariance = off.T @ off
    if not (np.diag(covariance) > 0).all():
        return (first,)
    return _Part(DEFENCE, first.at, first.root), _Part(1 - DEFENCE, mean, WIDER * root_of(covariance))


def _rank(found: _Weighted) -> tuple[bool, float]:
    """Sort key of sets of weights: reliable k-hat first, then effective sample size."""
    return found.k_hat <= RELIABLE_K, found.ess


def _enlarged(
    density: Density, parts: tuple[_Part, ...], rng: np.random.Generator, found: _Weighted, draws: int
) -> _Weighted:
    """Further proposals until ``draws`` are effective, where that is possible."""
    missing = int(1.05 * draws / found.share) - len(found.phi)
    if found.ess >= draws or found.k_hat > RELIABLE_K:
        return found
    more = _propose(density, parts, rng, max(min(missing, MOST * draws - len(found.phi)), AT_ONCE))
    return _weigh(np.vstack([found.phi, more.phi]), np.concatenate([found.raw, more.raw]))


def _words(found: _Weighted, parts: int) -> str:
    about = "about the mode" if parts == 1 else "about the mode and the weighted mean"
    reliable = "" if found.k_hat <= RELIABLE_K else ", above 0.7: unreliable"
    return (
        f"importance: {len(found.phi)} proposals of a Student-t {about}, {found.ess:.0f} of them effective, "
        f"k-hat {found.k_hat:.2f}{reliable}"
    )
