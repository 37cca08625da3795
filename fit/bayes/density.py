"""What a route to draws asks of a model: its log density at many points at once.

A point ``phi`` is unconstrained: standard deviations stand in it as logarithms, shares as logits, and the
logarithm of their derivative belongs to the prior. ``told`` gives the parameters as an engineer reads them.
"""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Density(Protocol):
    """A posterior density, but for a constant.

    Attributes
    ----------
    names, told_names : tuple of str
        Of ``phi``, length p, and of what is told, length q.
    units : tuple of str
        Names of the G edges (of the rows, where there are no edges), in the order of ``by_unit``.
    start : ndarray, shape (p,)
        The mode, or near it.
    spread : ndarray, shape (p, p)
        Covariance of a normal approximation there.
    """

    @property
    def names(self) -> tuple[str, ...]: ...  # noqa: D102

    @property
    def told_names(self) -> tuple[str, ...]: ...  # noqa: D102

    @property
    def units(self) -> tuple[str, ...]: ...  # noqa: D102

    @property
    def start(self) -> Array: ...  # noqa: D102

    @property
    def spread(self) -> Array: ...  # noqa: D102

    def log_prior(self, phi: Array) -> Array:
        """Log density of the prior on the scale of ``phi``, (m, p) -> (m,)."""

    def by_unit(self, phi: Array) -> Array:
        """Log likelihood of each edge (or row), (m, p) -> (m, G)."""

    def log_likelihood(self, phi: Array) -> Array:
        """Their sum, (m, p) -> (m,)."""

    def told(self, phi: Array) -> Array:
        """Parameters as they are told, (m, p) -> (m, q)."""


def log_posterior(density: Density, phi: Array) -> Array:
    """Log posterior density but for a constant, (m, p) -> (m,); minus infinity where it is no number."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        value = density.log_prior(phi) + density.log_likelihood(phi)
    return np.where(np.isfinite(value), value, -np.inf)
