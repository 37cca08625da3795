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

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .given_icc import FlatTable, Given, ProperTable, Rows, Table
from .law_density import LawDensity
from .priors import Flat, Prior
from .sample import Sample

Array = NDArray[np.float64]

LOGIT = (-16.0, 16.0)  # icc from 1e-7 to one less that
COARSE, FINE = 24, 64  # cells of logit icc, to find where the mass is and to draw from
MOST_LOOKS = 8
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
    make: type[Table] = FlatTable if isinstance(density.priors.of["level"], Flat) else ProperTable
    rows = Rows.of(density)
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
        phi = np.column_stack([beta, ln_sd, logit])[rng.permutation(draws)]  # cell after cell until here
    return Sample(phi, 1, "exact", _words(density), ess=float(draws))


def _table(density: LawDensity, rows: Rows, make: type[Table]) -> tuple[Table, Array, float]:
    """Scatter in the cells of logit icc that hold the mass, and these; looked for again where an end stands out."""

    def closely(density: LawDensity, given: Given) -> Array:
        return make(density, given).log_mass

    for mass_of in (make.rough_mass, closely):
        centres, width = _cells(density, rows, mass_of)
        table = make(density, rows.given(np.exp(centres)))
        mass = table.log_mass + _icc_prior(density.priors.of["icc"], centres)
        if max(mass[0], mass[-1]) < mass.max() - FAR / 2:
            break
    return table, centres, width


def _cells(density: LawDensity, rows: Rows, mass_of: Callable[[LawDensity, Given], Array]) -> tuple[Array, float]:
    """Centres of the cells of logit icc that hold the mass, and their width."""
    low, high = LOGIT
    for _ in range(MOST_LOOKS):
        rough, width = _split(low, high, COARSE)
        mass = mass_of(density, rows.given(np.exp(rough))) + _icc_prior(density.priors.of["icc"], rough)
        near = np.flatnonzero(mass > mass.max() - FAR)
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
    two = "scatter and share between edges from their grid" if density.edges else "scatter from its own distribution"
    return f"exact: independent draws, coefficients in closed form given {two}"
