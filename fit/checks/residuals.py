"""Residuals that may be tested together: rows about the level of their edge, and levels of edges about the law.

Where edges gave several rows there are these two sets, and each has its own tests. Taken together they would be
neither independent nor alike, and the tests would reject sound laws.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..available import NotAvailable
from ..lawfit import LawFit
from .columns import Array, orthonormal, sums_by
from .evidence import has_repeated_edges, no_scatter
from .strata import Strata

HELD = 1e-9  # share of its own variance below which a residual is fixed by the fit


@dataclass(frozen=True, slots=True)
class Residuals:
    """One set of residuals that may be tested together.

    Attributes
    ----------
    of : {"rows", "rows within edges", "edges"}
    values : ndarray, shape (m,)
        Residuals; those of edges and within edges are scaled to equal variance.
    names : tuple of str, length k
    terms : ndarray, shape (m, k)
        Terms of the law that change among them, at the same places, without the constant.
    free : int
        Degrees of freedom among them.
    group : ndarray of int, shape (m,), or None
        Edge of each where several are of one edge.
    tied : ndarray, shape (m,), or None
        ``h / (1 - h)`` with h the part of a row's own level: residuals i and j of one edge have correlation
        ``-sqrt(tied_i tied_j)``, their squares ``tied_i tied_j``.
    """

    of: str
    values: Array
    names: tuple[str, ...]
    terms: Array
    free: int
    group: NDArray[np.intp] | None = None
    tied: Array | None = None


def residual_sets(
    law: LawFit, strata: Strata | NotAvailable
) -> tuple[Residuals | NotAvailable, Residuals | NotAvailable]:
    """Residuals of rows (within edges where edges gave several), and of the levels of edges.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.checks.strata import split
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> [(found.of, len(found.values)) for found in residual_sets(law, split(law))]
    [('rows within edges', 239), ('edges', 24)]
    """
    if reason := no_scatter(law):
        return NotAvailable(reason), NotAvailable(reason)
    terms = law.law.design(law.X, law.shifts)[:, 1:]
    if isinstance(strata, Strata):
        return _within(law, strata, terms), _of_edges(law, strata, terms)
    if has_repeated_edges(law):
        return strata, strata
    return Residuals("rows", law.residuals, law.names[1:], terms, law.df_resid), strata


def _within(law: LawFit, strata: Strata, terms: Array) -> Residuals | NotAvailable:
    if strata.df_within <= 0 or float(strata.rest @ strata.rest) <= HELD**2 * law.rss:
        return NotAvailable("rows of an edge stand on one common course exactly: no scatter within edges")
    own = strata.level**2 / strata.weight[strata.edge]
    hat = own + np.einsum("ij,ij->i", strata.basis, strata.basis)
    free = 1 - hat > HELD
    values = strata.rest[free] / np.sqrt(1 - hat[free])
    tied = own[free] / (1 - own[free])
    return Residuals("rows within edges", values, law.names[1:], terms[free], strata.df_within, strata.edge[free], tied)


def _of_edges(law: LawFit, strata: Strata, terms: Array) -> Residuals:
    stacked, w = strata.stacked(), strata.basis.shape[1]
    Q = orthonormal(stacked[:, :-1])
    left = (stacked[:, -1] - Q @ (Q.T @ stacked[:, -1]))[w:]
    hat = np.einsum("ij,ij->i", Q, Q)[w:]
    free = 1 - hat > HELD
    told = np.flatnonzero(~strata.within[1:])
    means = sums_by(strata.edge, terms[:, told], len(strata.names)) / np.bincount(strata.edge)[:, None]
    values = left[free] / np.sqrt(1 - hat[free])
    return Residuals("edges", values, tuple(law.names[1 + j] for j in told), means[free], strata.df_between)
