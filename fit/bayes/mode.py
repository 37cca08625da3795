"""The top of a posterior density and its shape there, by Newton's method in few calls of many points.

In coordinates z, ``phi = at + root z``, gradient and Hessian are differences over one stencil of 1 + p + p^2 points,
and the step along which to go is tried at several lengths at once: two calls a round, three or four rounds.

Source: Nocedal & Wright 2006, Numerical Optimization, sections 3.4 (modified Hessian) and 8.1 (differences).
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ...core.errors import FitError
from .density import Density, log_posterior

Array = NDArray[np.float64]

STEP = 0.05  # of the stencil, in standard deviations: a log density of 1e3 then leaves 1e-7 of noise in the Hessian
NEAR = 1e-3  # decrement at which a last whole step ends on the top: it misses it by less than 0.001 sd
ROUNDS = 30
LENGTHS = 2.0 ** np.array([1, 0, -1, -2, -3, -5, -8])
LEAST_ROOT = 1e-3  # least eigenvalue of a guessed correlation: few edges give a covariance that is nearly singular


@dataclass(frozen=True, slots=True)
class Mode:
    """Where a density is highest.

    Attributes
    ----------
    at : ndarray, shape (p,)
    root : ndarray, shape (p, p)
        ``root @ root.T`` is the covariance of a normal density of the same curvature.
    curved : bool
        Whether the curvature gave it; otherwise the spread the density came with did.
    """

    at: Array
    root: Array
    curved: bool


def find_mode(density: Density) -> Mode:
    """Climb from ``density.start``.

    Raises
    ------
    FitError
        The density is nothing at its start.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.bayes.law_density import law_density
    >>> from fitmodels.fit.bayes.priors import weak
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> find_mode(law_density(law, weak(law, edges=False))).curved
    True
    """
    at, given = np.array(density.start, dtype=float), root_of(density.spread)
    if not np.isfinite(log_posterior(density, at[None])[0]):
        raise FitError("the posterior has no density where it should start; are priors and data in the same unit?")
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
    """A root of a covariance, of one that is not quite positive definite too, (p, p) -> (p, p)."""
    variance = np.diag(covariance)
    sd = np.sqrt(np.where(np.isfinite(variance) & (variance > 0), variance, 1.0))
    correlation = np.where(np.isfinite(covariance), covariance, 0.0) / np.outer(sd, sd)
    values, vectors = np.linalg.eigh(correlation)
    return np.asarray(sd[:, None] * (vectors * np.sqrt(np.maximum(values, LEAST_ROOT))))


@cache
def _stencil(p: int) -> tuple[Array, NDArray[np.intp], NDArray[np.intp]]:
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
