"""A random level of each edge: variance between and within edges by restricted maximum likelihood.

The model is ``y = Z theta + u_edge + e`` with ``u ~ N(0, s_b^2)`` and ``e ~ N(0, s_w^2)``. Given the ratio
``k = s_b^2 / s_w^2`` everything is least squares of rows in which each edge's mean is drawn towards zero by
``1 / sqrt(1 + n_g k)``, so that a search over one number, the intraclass correlation, is all there is to do.

Source: Pinheiro & Bates 2000, Mixed-Effects Models in S and S-PLUS, section 2.2.
"""

from dataclasses import dataclass
from math import log

import numpy as np
from numpy.typing import NDArray

from ..core.display import Displayable

Array = NDArray[np.float64]

BLOCK = 16_384  # rows at a time


@dataclass(frozen=True, slots=True, repr=False)
class Mixed(Displayable):
    """Fit with a random level of each edge.

    Attributes
    ----------
    theta, bse : ndarray, shape (p,)
        Generalised least-squares estimates and their standard errors.
    df : ndarray, shape (p,)
        Degrees of freedom: edges less parameters that are told between edges, or rows less edges less
        parameters that are told within them.
    sd_between, sd_within : float
        Standard deviations of the edge levels and of the rows about them, on the scale of the fit.
    """

    theta: Array
    bse: Array
    df: Array
    sd_between: float
    sd_within: float

    @property
    def icc(self) -> float:
        """Intraclass correlation: share of the variance that lies between edges."""
        total = self.sd_between**2 + self.sd_within**2
        return self.sd_between**2 / total if total > 0 else 0.0


def mixed(Z: Array, y: Array, edge: NDArray[np.intp], within: NDArray[np.bool_]) -> Mixed:
    """Fit a random level of each edge by restricted maximum likelihood.

    Parameters
    ----------
    Z : ndarray, shape (n, p), the constant among its columns
    y : ndarray, shape (n,)
    edge : ndarray of int, shape (n,), edges numbered 0 to G - 1
    within : ndarray of bool, shape (p,), whether a column changes within edges

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> edge = np.repeat(np.arange(40), 5)
    >>> y = 2.0 + rng.normal(0, 0.3, 40)[edge] + rng.normal(0, 0.1, 200)
    >>> fit = mixed(np.ones((200, 1)), y, edge, np.array([False]))
    >>> round(fit.sd_within, 1), round(fit.sd_between, 1)
    (0.1, 0.3)
    """
    size = np.bincount(edge).astype(float)
    means = np.column_stack([np.bincount(edge, weights=column) for column in (*Z.T, y)]) / size[:, None]
    return random_level(_about_means(Z, y, edge, means), means, size, within)


def random_level(inside: Array, means: Array, size: Array, within: NDArray[np.bool_]) -> Mixed:
    """The same fit from what `mixed` makes of the rows.

    Parameters
    ----------
    inside : ndarray, shape (any, p + 1)
        Triangle of ``[Z y]`` less the means of each edge: all that is told within edges, in few rows.
    means : ndarray, shape (G, p + 1)
        Mean of ``[Z y]`` in each edge.
    size : ndarray, shape (G,)
        Rows of each edge.
    within : ndarray of bool, shape (p,)
    """
    from scipy.optimize import minimize_scalar

    n, p = int(size.sum()), means.shape[1] - 1

    def triangle(icc: float) -> Array:
        weight: Array = np.sqrt(size / (1 + size * icc / (1 - icc)))
        return np.asarray(np.linalg.qr(np.vstack([inside, weight[:, None] * means]), mode="r"))

    def criterion(icc: float) -> float:
        """Minus twice the restricted log-likelihood, but for a constant."""
        R = np.abs(np.diag(triangle(icc)))
        inflation = float(np.log1p(size * icc / (1 - icc)).sum())
        return float(2 * (n - p) * log(max(float(R[p]), 1e-300)) + inflation + 2 * np.log(R[:p]).sum())

    found = minimize_scalar(criterion, bounds=(0.0, 1 - 1e-6), method="bounded", options={"xatol": 1e-7})
    icc = float(found.x) if criterion(float(found.x)) < criterion(0.0) else 0.0
    R = triangle(icc)
    inverse = np.linalg.inv(R[:p, :p])
    s2 = float(R[p, p] ** 2) / (n - p)
    G, inner = len(size), int(within.sum())
    return Mixed(
        theta=inverse @ R[:p, p],
        bse=np.sqrt(s2 * np.einsum("ij,ij->i", inverse, inverse)),
        df=np.where(within, n - G - inner, G - (p - inner)).astype(float),
        sd_between=float(np.sqrt(s2 * icc / (1 - icc))),
        sd_within=float(np.sqrt(s2)),
    )


def _about_means(Z: Array, y: Array, edge: NDArray[np.intp], means: Array) -> Array:
    """Triangle of ``[Z y]`` less the means of each edge, taken in blocks so that it needs no copy of the whole."""
    blocks = []
    for start in range(0, len(y), BLOCK):
        rows = slice(start, start + BLOCK)
        about = np.column_stack([Z[rows], y[rows]]) - means[edge[rows]]
        blocks.append(np.linalg.qr(about, mode="r"))
    return np.vstack(blocks) if len(blocks) == 1 else np.asarray(np.linalg.qr(np.vstack(blocks), mode="r"))
