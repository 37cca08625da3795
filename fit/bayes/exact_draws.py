"""Exact draws of a law that is linear in its parameters: independent, without chains.

Given the scatter sd and the share between edges icc, the coefficients are normal in closed form. With
``b`` their least-squares estimate of rows whitened for that icc, G the cross products of those rows and RSS their
residual sum of squares, normal priors ``N(m, D^-2)`` and ``D^-1 G D^-1 = U diag(l) U'``,

    ln p(sd, icc | y) = ln prior - n ln sd - sum ln(1 + m_g k) / 2 - RSS / (2 sd^2)
                        - sum_j [ d_j^2 / (1 + sd^2 / l_j) + ln(1 + l_j / sd^2) ] / 2,      d = U' D (b - m).

Two numbers remain: a grid of logit icc and, in each of its cells, one of ln sd, from which they are drawn. With flat
priors sd^2 is inverse gamma, and without edges the draws are normal-inverse-gamma. Proper priors of the exponents are
independent of sd, unlike those of a conjugate normal-inverse-gamma: prior knowledge of an exponent does not depend on
the scatter of the tests.

Source: Gelman et al. 2013, Bayesian Data Analysis, sections 3.2, 14.2 and 14.8.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import lgamma
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array
from ...core.errors import FitError
from .density import LawDensity, Sample
from .priors import Flat, Normal, Prior

Counts = NDArray[np.int64]

POINTS = 80  # of ln sd in a cell
ROUGH, WINDOW_ROUNDS = 24, 40  # points of the search for its mass, and most rounds of it
STEPS, FINE_STEPS = np.linspace(0, 1, ROUGH), np.linspace(0, 1, POINTS)
WIDE = 5.0  # of the first window: five to seven sds of ln sd, which is about 1 / sqrt(2 n)
ROUNDS = 3
FAR = 16.0  # in the log density below its top: beyond it lies 1e-7 of the mass


@dataclass(frozen=True, slots=True)
class ConditionalFit:
    """Least squares of rows whitened for each of R variance ratios."""

    b: Array  # (R, p)
    G: Array  # (R, p, p)
    rss: Array  # (R,)
    log_det: Array  # (R,)


@dataclass(frozen=True, slots=True)
class EdgeProducts:
    """Cross products of the rows about their least-squares fit, which keeps RSS precise, and sums over edges."""

    plain: Array
    gram: Array
    score: Array
    square: float
    sums: Array
    level: Array
    sizes: Array
    edges: bool

    @classmethod
    def of(cls, density: LawDensity) -> "EdgeProducts":
        """Sums over all rows of a density."""
        Z = density.Z
        Q, R = np.linalg.qr(Z)
        plain = np.linalg.solve(R, Q.T @ density.y)
        r = density.y - Z @ plain
        sums, level = np.add.reduceat(Z, density.starts), np.add.reduceat(r, density.starts)
        return cls(plain, Z.T @ Z, Z.T @ r, float(r @ r), sums, level, density.sizes, density.edges)

    def given(self, k: Array) -> ConditionalFit:
        """Least squares at variance ratios ``k = icc / (1 - icc)``, shape (R,)."""
        if not self.edges:
            return ConditionalFit(self.plain[None], self.gram[None], np.array([self.square]), np.zeros(1))
        w = k[:, None] / (1 + self.sizes * k[:, None])
        p = len(self.plain)
        products = (self.sums[:, :, None] * self.sums[:, None, :]).reshape(-1, p * p)
        G = self.gram - (w @ products).reshape(-1, p, p)
        h = self.score - w @ (self.sums * self.level[:, None])
        b = np.linalg.solve(G, h[:, :, None])[:, :, 0]
        rss = self.square - w @ self.level**2 - np.einsum("ri,ri->r", h, b)
        return ConditionalFit(self.plain + b, G, rss, np.log1p(self.sizes * k[:, None]).sum(axis=1))


class IccTable(Protocol):
    """Posterior of scatter and coefficients in each cell of icc; ``log_mass`` is that of the cell."""

    log_mass: Array

    def __init__(self, density: LawDensity, given: ConditionalFit) -> None: ...

    @staticmethod
    def rough_mass(density: LawDensity, given: ConditionalFit) -> Array:
        """Approximation of ``log_mass``, to locate it."""

    def draw(self, counts: Counts, rng: np.random.Generator) -> tuple[Array, Array]:
        """Coefficients (S, p) and ln sd (S,): ``counts`` of each cell, one after the other."""


class FlatTable:
    """Flat priors: sd^2 is RSS over chi-square of n - p - 1 degrees of freedom, coefficients normal about b."""

    def __init__(self, density: LawDensity, given: ConditionalFit) -> None:
        self.given, self.df = given, density.Z.shape[0] - density.p - 1
        self.root = np.linalg.inv(np.linalg.cholesky(given.G)).transpose(0, 2, 1)
        log_det = 2 * np.log(np.diagonal(self.root, axis1=1, axis2=2)).sum(axis=1)
        self.log_mass = 0.5 * (log_det - given.log_det - self.df * np.log(given.rss / 2)) + lgamma(self.df / 2)

    @staticmethod
    def rough_mass(density: LawDensity, given: ConditionalFit) -> Array:
        """``log_mass`` itself."""
        mass: Array = FlatTable(density, given).log_mass
        return mass

    def draw(self, counts: Counts, rng: np.random.Generator) -> tuple[Array, Array]:
        """Coefficients and ln sd, cell after cell."""
        S = int(counts.sum())
        ln_sd = 0.5 * np.log(np.repeat(self.given.rss, counts) / rng.chisquare(self.df, S))
        z = rng.standard_normal((S, self.given.b.shape[1])) * np.exp(ln_sd)[:, None]
        return np.repeat(self.given.b, counts, axis=0) + _times(self.root, counts, z), ln_sd


class ProperTable:
    """Normal priors of the coefficients, any of sd: its posterior on a grid of ln sd in each cell."""

    def __init__(self, density: LawDensity, given: ConditionalFit) -> None:
        normal = [prior for name in density.names[: density.p] if isinstance(prior := density.priors.of[name], Normal)]
        self.mean = np.array([prior.mean for prior in normal])
        self.width = np.array([prior.sd for prior in normal])
        self.values, self.U = np.linalg.eigh(given.G * np.outer(self.width, self.width))
        self.values = np.maximum(self.values, 0.0)
        self.d = np.einsum("rij,ri->rj", self.U, (given.b - self.mean) / self.width)
        self.given, self.n, self.prior = given, len(density.y), density.priors.of["sd"]
        self.grid, log_density = self._window()
        self.step = self.grid[:, 1] - self.grid[:, 0]
        top = log_density.max(axis=1)
        height = np.exp(log_density - top[:, None])
        mass = (height[:, 1:] + height[:, :-1]) / 2 * self.step[:, None]
        self.height, self.cumulated = height, np.cumsum(mass, axis=1)
        self.log_mass = top + np.log(self.cumulated[:, -1]) - given.log_det / 2

    def _log_density(self, ln_sd: Array) -> Array:
        """Log density of ln sd in each cell, up to terms of icc alone, (R, K) -> (R, K)."""
        sd2 = np.exp(2 * ln_sd)
        ratio = self.values[:, :, None] / sd2[:, None, :]
        drawn = np.einsum("rj,rjk->rk", self.d**2, ratio / (1 + ratio)) + np.log1p(ratio).sum(axis=1)
        out = self.prior.log_density(np.sqrt(sd2)) + (1 - self.n) * ln_sd
        out -= 0.5 * (self.given.rss[:, None] / sd2 + drawn)
        return np.asarray(out)

    def _window(self) -> tuple[Array, Array]:
        """Points of ln sd and the log density there, adapted until the mass fills them."""
        middle, half = 0.5 * np.log(self.given.rss / self.n), WIDE / np.sqrt(self.n)
        low, high = middle - half, middle + 2 * half
        row = np.arange(len(middle))
        for _ in range(WINDOW_ROUNDS):
            grid = low[:, None] + (high - low)[:, None] * STEPS
            height = self._log_density(grid)
            near = height > height.max(axis=1, keepdims=True) - FAR
            first, last = near.argmax(axis=1), ROUGH - 1 - near[:, ::-1].argmax(axis=1)
            open_low, open_high, wide = near[:, 0], near[:, -1], high - low
            low = np.where(open_low, low - wide, grid[row, np.maximum(first - 1, 0)])
            high = np.where(open_high, high + 2 * wide, grid[row, np.minimum(last + 1, ROUGH - 1)])
            if not (open_low.any() or open_high.any()) and (last - first).min() > ROUGH // 3:
                break
        grid = low[:, None] + (high - low)[:, None] * FINE_STEPS
        return grid, self._log_density(grid)

    @staticmethod
    def rough_mass(density: LawDensity, given: ConditionalFit) -> Array:
        """With the scatter at its most likely value."""
        n, eye = len(density.y), np.eye(density.p)
        normal = [prior for name in density.names[: density.p] if isinstance(prior := density.priors.of[name], Normal)]
        width2 = np.diag([prior.sd**2 for prior in normal])
        off = given.b - [prior.mean for prior in normal]
        sd2 = given.rss / n
        for _ in range(ROUNDS):  # (b - m)' (G^-1 + W / sd^2)^-1 (b - m) is the contribution of the priors to RSS
            inner = eye + given.G @ width2 / sd2[:, None, None]
            kept = np.linalg.solve(inner, (given.G @ off[:, :, None]))[:, :, 0]
            sd2 = (given.rss + np.einsum("ri,ri->r", off, kept)) / n
        _, log_det = np.linalg.slogdet(inner)
        return np.asarray(-0.5 * (n * np.log(sd2) + log_det + given.log_det))

    def draw(self, counts: Counts, rng: np.random.Generator) -> tuple[Array, Array]:
        """Coefficients and ln sd, cell after cell."""
        ln_sd = self._ln_sd(counts, rng)
        precision = 1 + np.repeat(self.values, counts, axis=0) * np.exp(-2 * ln_sd)[:, None]
        e = np.repeat(self.d, counts, axis=0) * (1 - 1 / precision)
        e += rng.standard_normal(precision.shape) / np.sqrt(precision)
        return self.mean + self.width * _times(self.U, counts, e), ln_sd

    def _ln_sd(self, counts: Counts, rng: np.random.Generator) -> Array:
        """Draws of ln sd in each cell by inversion, the density linear between points."""
        cell = np.repeat(np.arange(len(counts)), counts)
        u, total = rng.random(len(cell)), self.cumulated[:, -1]
        share = self.cumulated / total[:, None] + np.arange(len(total))[:, None]  # one increasing array of all cells
        at = np.minimum(np.searchsorted(share.ravel(), u + cell) - cell * (POINTS - 1), POINTS - 2)
        point = cell * POINTS + at
        before = np.where(at > 0, self.cumulated.ravel()[cell * (POINTS - 1) + np.maximum(at, 1) - 1], 0.0)
        left, right = self.height.ravel()[point], self.height.ravel()[point + 1]
        step = np.repeat(self.step, counts)
        need = (u * np.repeat(total, counts) - before) / step  # left v + (right - left) v^2 / 2 = need
        root = np.sqrt(np.maximum(left**2 + 2 * (right - left) * need, 0.0))
        v = np.clip(2 * need / np.maximum(left + root, 1e-300), 0.0, 1.0)
        return np.asarray(self.grid.ravel()[point] + step * v)


def _times(matrices: Array, counts: Counts, vectors: Array) -> Array:
    """Each vector times the matrix of its cell, (S, p); vectors stand cell after cell."""
    out, end = np.empty_like(vectors), np.cumsum(counts)
    for matrix, first, last in zip(matrices, end - counts, end, strict=True):
        np.matmul(vectors[first:last], matrix.T, out=out[first:last])
    return out


LOGIT = (-16.0, 16.0)  # icc from 1e-7 to one less that
COARSE, FINE = 24, 64  # cells of logit icc, to find where the mass is and to draw from
GRID_ROUNDS = 8


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
    >>> from fitmodels.fit.bayes.density import law_density
    >>> from fitmodels.fit.bayes.priors import weak
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("ac2017_table1")), "AW", ["V", "f"])
    >>> exact(law_density(law, weak(law, edges=False)), np.random.default_rng(1)).phi.shape
    (4000, 4)
    """
    make: type[IccTable] = FlatTable if isinstance(density.priors.of["level"], Flat) else ProperTable
    rows = EdgeProducts.of(density)
    if not density.edges:
        beta, ln_sd = make(density, rows.given(np.zeros(1))).draw(np.array([draws]), rng)
        phi = np.column_stack([beta, ln_sd])
    else:
        table, centres, width = _table(density, rows, make)
        mass = table.log_mass + _icc_prior(density.priors.of["icc"], centres)
        share = np.exp(mass - mass.max())
        counts = rng.multinomial(draws, share / share.sum())
        beta, ln_sd = table.draw(counts, rng)
        logit = np.repeat(centres, counts) + width * (rng.random(draws) - 0.5)
        phi = np.column_stack([beta, ln_sd, logit])[rng.permutation(draws)]  # cells were in order until here
    return Sample(phi, 1, "exact", _words(density), ess=float(draws))


def _table(density: LawDensity, rows: EdgeProducts, make: type[IccTable]) -> tuple[IccTable, Array, float]:
    """Table over the cells of logit icc that have the mass, their centres and width; refined where an end has mass."""

    def closely(density: LawDensity, given: ConditionalFit) -> Array:
        return make(density, given).log_mass

    for mass_of in (make.rough_mass, closely):
        centres, width = _cells(density, rows, mass_of)
        table = make(density, rows.given(np.exp(centres)))
        mass = table.log_mass + _icc_prior(density.priors.of["icc"], centres)
        if max(mass[0], mass[-1]) < mass.max() - FAR / 2:
            break
    return table, centres, width


def _cells(
    density: LawDensity, rows: EdgeProducts, mass_of: Callable[[LawDensity, ConditionalFit], Array]
) -> tuple[Array, float]:
    """Centres of the cells of logit icc with the mass, and their width."""
    low, high = LOGIT
    for _ in range(GRID_ROUNDS):
        rough, width = _split(low, high, COARSE)
        mass = mass_of(density, rows.given(np.exp(rough))) + _icc_prior(density.priors.of["icc"], rough)
        near = np.flatnonzero(mass > mass.max() - FAR)
        if not near.size:
            raise FitError("the priors contradict the data: no posterior can be computed; check their units.")
        low, high = rough[near[0]] - width, rough[near[-1]] + width
        if near[-1] - near[0] > COARSE // 3:
            break
    return _split(max(low, LOGIT[0]), min(high, LOGIT[1]), FINE)


def _split(low: float, high: float, cells: int) -> tuple[Array, float]:
    width = (high - low) / cells
    return np.asarray(low + width * (np.arange(cells) + 0.5), dtype=np.float64), width


def _icc_prior(prior: Prior, logit: Array) -> Array:
    """Log prior of logit icc."""
    ln_icc, ln_rest = -np.logaddexp(0, -logit), -np.logaddexp(0, logit)
    return prior.log_density(np.exp(ln_icc)) + ln_icc + ln_rest


def _words(density: LawDensity) -> str:
    two = "the residual SD and the ICC on a grid" if density.edges else "the residual variance, drawn from its marginal"
    return f"exact: independent draws, coefficients in closed form given {two}"
