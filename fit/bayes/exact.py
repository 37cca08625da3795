"""Exact draws of a law that is linear in its parameters: no chain, every draw independent of the others.

Given the scatter sd and the share between edges icc, the coefficients are normal in closed form. With
``b`` their least-squares estimate of rows whitened for that icc, G the cross products of those rows and RSS their
residual sum of squares, normal priors ``N(m, D^-2)`` and ``D^-1 G D^-1 = U diag(l) U'``,

    ln p(sd, icc | y) = ln prior - n ln sd - sum ln(1 + m_g k) / 2 - RSS / (2 sd^2)
                        - sum_j [ d_j^2 / (1 + sd^2 / l_j) + ln(1 + l_j / sd^2) ] / 2,      d = U' D (b - m).

Two numbers are left: a grid of logit icc and, in each of its cells, one of ln sd, from which they are drawn. With flat
priors sd^2 is an inverse gamma, and without edges the draws are normal-inverse-gamma. Proper priors of the
exponents do not go with sd, as those of a conjugate normal-inverse-gamma do: what is thought of an exponent before
the tests has nothing to do with how much they will scatter.

Source: Gelman et al. 2013, Bayesian Data Analysis, sections 3.2, 14.2 and 14.8.
"""

from dataclasses import dataclass
from math import lgamma
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .law_density import LawDensity
from .priors import Flat, Normal, Prior
from .sample import Sample

Array = NDArray[np.float64]
Cells = NDArray[np.intp]

LOGIT = (-16.0, 16.0)  # icc from 1e-7 to one less that
COARSE, FINE = 32, 64  # cells of logit icc, to find where the mass is and to draw from
POINTS = 80  # of ln sd in a cell
ROUGH, MOST_ZOOMS = 24, 40  # points that look where its mass is, and how often they look again
STEPS = np.linspace(0, 1, ROUGH)
WIDE = 5.0  # of the first look: five to seven sds of ln sd, which is about 1 / sqrt(2 n)
FAR = 16.0  # in the log density below its top: beyond it lies 1e-7 of the mass


def exact(density: LawDensity, rng: np.random.Generator, draws: int = 4000) -> Sample:
    """Draw from the posterior of a law with normal errors, on a scale on which it is linear.

    Parameters
    ----------
    density : LawDensity
        Its priors normal for level and slopes, or flat for all and for sd.
    rng : Generator
    draws : int

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.bayes.law_density import law_density
    >>> from fitmodels.fit.bayes.priors import weak
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("ac2017_table1")), "AW", ["V", "f"])
    >>> exact(law_density(law, weak(law, edges=False)), np.random.default_rng(1)).phi.shape
    (4000, 4)
    """
    make = _Flat if isinstance(density.priors.of["level"], Flat) else _Proper
    if not density.edges:
        table = make(density, _given(density, np.zeros(1)))
        cell = np.zeros(draws, dtype=np.intp)
        logit = np.empty((draws, 0))
    else:
        centres, width = _cells(density, make)
        table = make(density, _given(density, _k(centres)))
        mass = table.log_mass + _icc_prior(density.priors.of["icc"], centres)
        cell = _choose(np.exp(mass - mass.max()), rng.random(draws))
        logit = (centres[cell] + width * (rng.random(draws) - 0.5))[:, None]
    ln_sd = table.ln_sd(cell, rng)
    phi = np.hstack([table.coefficients(cell, np.exp(ln_sd), rng), ln_sd[:, None], logit])
    return Sample(phi, 1, "exact", _words(density), ess=float(draws))


@dataclass(frozen=True, slots=True)
class _Given:
    """What the rows say of the coefficients at each of R variance ratios k."""

    b: Array  # (R, p)
    G: Array  # (R, p, p)
    rss: Array  # (R,)
    log_det: Array  # (R,)


def _given(density: LawDensity, k: Array) -> _Given:
    """Least squares of whitened rows, taken about the fit of the rows so that no digit is lost in RSS."""
    Z, starts = density.Z, density.starts
    Q, R = np.linalg.qr(Z)
    plain = np.linalg.solve(R, Q.T @ density.y)
    r = density.y - Z @ plain
    gram, score, square = Z.T @ Z, Z.T @ r, float(r @ r)
    if not density.edges:
        return _Given(plain[None], gram[None], np.array([square]), np.zeros(1))
    sums, level = np.add.reduceat(Z, starts), np.add.reduceat(r, starts)
    m = density.sizes
    w = k[:, None] / (1 + m * k[:, None])
    G = gram - np.einsum("rg,gi,gj->rij", w, sums, sums)
    h = score - w @ (sums * level[:, None])
    b = np.linalg.solve(G, h[:, :, None])[:, :, 0]
    rss = square - w @ level**2 - np.einsum("ri,ri->r", h, b)
    return _Given(plain + b, G, rss, np.log1p(m * k[:, None]).sum(axis=1))


class _Table(Protocol):
    """Scatter and coefficients in each cell of icc."""

    log_mass: Array

    def __init__(self, density: LawDensity, given: _Given) -> None: ...

    def ln_sd(self, cell: Cells, rng: np.random.Generator) -> Array: ...

    def coefficients(self, cell: Cells, sd: Array, rng: np.random.Generator) -> Array: ...


class _Flat:
    """Flat priors: sd^2 is RSS over chi-square of n - p - 1 degrees of freedom, coefficients normal about b."""

    def __init__(self, density: LawDensity, given: _Given) -> None:
        n, p = density.Z.shape
        self.df = n - p - 1
        self.given = given
        self.root = np.linalg.inv(np.linalg.cholesky(given.G)).transpose(0, 2, 1)
        log_det = 2 * np.log(np.diagonal(self.root, axis1=1, axis2=2)).sum(axis=1)
        self.log_mass = 0.5 * (log_det - given.log_det - self.df * np.log(given.rss / 2)) + lgamma(self.df / 2)

    def ln_sd(self, cell: Cells, rng: np.random.Generator) -> Array:
        return np.asarray(0.5 * np.log(self.given.rss[cell] / rng.chisquare(self.df, len(cell))))

    def coefficients(self, cell: Cells, sd: Array, rng: np.random.Generator) -> Array:
        z = rng.standard_normal((len(cell), self.given.b.shape[1])) * sd[:, None]
        return self.given.b[cell] + _times(self.root, cell, z)


class _Proper:
    """Normal priors of the coefficients, any of sd: its posterior on a grid of ln sd in each cell."""

    def __init__(self, density: LawDensity, given: _Given) -> None:
        normal = [prior for name in density.names[: density.p] if isinstance(prior := density.priors.of[name], Normal)]
        self.mean = np.array([prior.mean for prior in normal])
        self.width = np.array([prior.sd for prior in normal])
        self.values, self.U = np.linalg.eigh(given.G * np.outer(self.width, self.width))
        self.values = np.maximum(self.values, 0.0)
        self.d = np.einsum("rij,ri->rj", self.U, (given.b - self.mean) / self.width)
        self.given, self.n, self.prior = given, len(density.y), density.priors.of["sd"]
        self.grid, log_density = self._window()
        step = self.grid[:, 1] - self.grid[:, 0]
        top = log_density.max(axis=1)
        height = np.exp(log_density - top[:, None])
        mass = (height[:, 1:] + height[:, :-1]) / 2 * step[:, None]
        self.height, self.cumulated = height, np.cumsum(mass, axis=1)
        self.log_mass = top + np.log(self.cumulated[:, -1]) - given.log_det / 2

    def _log_density(self, ln_sd: Array) -> Array:
        """Of ln sd in each cell but for what goes with icc alone, (R, K) -> (R, K)."""
        sd2 = np.exp(2 * ln_sd)
        ratio = self.values[:, :, None] / sd2[:, None, :]
        drawn = np.einsum("rj,rjk->rk", self.d**2, ratio / (1 + ratio)) + np.log1p(ratio).sum(axis=1)
        out = self.prior.log_density(np.sqrt(sd2)) + (1 - self.n) * ln_sd
        out -= 0.5 * (self.given.rss[:, None] / sd2 + drawn)
        return np.asarray(out)

    def _window(self) -> tuple[Array, Array]:
        """Points of ln sd and the log density there, widened and zoomed in on until the mass fills them."""
        middle, half = 0.5 * np.log(self.given.rss / self.n), WIDE / np.sqrt(self.n)
        low, high = middle - half, middle + 2 * half
        row = np.arange(len(middle))
        for _ in range(MOST_ZOOMS):
            grid = low[:, None] + (high - low)[:, None] * STEPS
            height = self._log_density(grid)
            near = height > height.max(axis=1, keepdims=True) - FAR
            first, last = near.argmax(axis=1), ROUGH - 1 - near[:, ::-1].argmax(axis=1)
            open_low, open_high, wide = near[:, 0], near[:, -1], high - low
            low = np.where(open_low, low - wide, grid[row, np.maximum(first - 1, 0)])
            high = np.where(open_high, high + 2 * wide, grid[row, np.minimum(last + 1, ROUGH - 1)])
            if not (open_low.any() or open_high.any()) and (last - first).min() > ROUGH // 3:
                break
        grid = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, POINTS)
        return grid, self._log_density(grid)

    def ln_sd(self, cell: Cells, rng: np.random.Generator) -> Array:
        """Invert the distribution, its density taken as straight between points."""
        total = self.cumulated[:, -1]
        target = rng.random(len(cell)) * total[cell]
        share = self.cumulated / total[:, None] + np.arange(len(total))[:, None]  # one rising row of all cells
        at = np.searchsorted(share.ravel(), target / total[cell] + cell) - cell * (POINTS - 1)
        at = np.clip(at, 0, POINTS - 2)
        before = np.where(at > 0, self.cumulated[cell, at - 1], 0.0)
        step = self.grid[cell, 1] - self.grid[cell, 0]
        left, right = self.height[cell, at], self.height[cell, at + 1]
        need = (target - before) / step  # left u + (right - left) u^2 / 2 = need
        root = np.sqrt(np.maximum(left**2 + 2 * (right - left) * need, 0.0))
        u = np.clip(2 * need / np.maximum(left + root, 1e-300), 0.0, 1.0)
        return np.asarray(self.grid[cell, at] + step * u)

    def coefficients(self, cell: Cells, sd: Array, rng: np.random.Generator) -> Array:
        precision = 1 + self.values[cell] / (sd**2)[:, None]
        e = self.d[cell] * (1 - 1 / precision) + rng.standard_normal(precision.shape) / np.sqrt(precision)
        return self.mean + self.width * _times(self.U, cell, e)


def _times(matrices: Array, cell: Cells, vectors: Array) -> Array:
    """Each vector times the matrix of its cell, cell by cell where that is fewer products."""
    if len(matrices) == 1:
        return np.asarray(vectors @ matrices[0].T)
    return np.asarray(np.einsum("sij,sj->si", matrices[cell], vectors))


def _cells(density: LawDensity, make: type[_Table]) -> tuple[Array, float]:
    """Centres of the cells of logit icc that hold the mass, and their width."""
    low, high = LOGIT
    for _ in range(MOST_ZOOMS):
        rough, width = _split(low, high, COARSE)
        mass = make(density, _given(density, _k(rough))).log_mass + _icc_prior(density.priors.of["icc"], rough)
        near = np.flatnonzero(mass > mass.max() - FAR)
        low, high = rough[near[0]] - width, rough[near[-1]] + width
        if near[-1] - near[0] > COARSE // 4:
            break
    return _split(max(low, LOGIT[0]), min(high, LOGIT[1]), FINE)


def _split(low: float, high: float, cells: int) -> tuple[Array, float]:
    width = (high - low) / cells
    return np.asarray(low + width * (np.arange(cells) + 0.5), dtype=np.float64), width


def _k(logit: Array) -> Array:
    """Variance ratio k = icc / (1 - icc)."""
    return np.exp(logit)


def _icc_prior(prior: Prior, logit: Array) -> Array:
    """Log prior of logit icc."""
    ln_icc, ln_rest = -np.logaddexp(0, -logit), -np.logaddexp(0, logit)
    return prior.log_density(np.exp(ln_icc)) + ln_icc + ln_rest


def _choose(weight: Array, u: Array) -> Cells:
    return np.searchsorted(np.cumsum(weight) / weight.sum(), u).clip(0, len(weight) - 1)


def _words(density: LawDensity) -> str:
    two = "scatter and share between edges from their grid" if density.edges else "scatter from its own distribution"
    return f"exact: independent draws, coefficients in closed form given {two}"
