"""Autocorrelation of residuals within edges: the pooled lag-1 correlation against its exact moments.

Source: Durbin & Watson 1950, Biometrika 37, 409 (exact moments of a ratio of quadratic forms in residuals).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.display import Displayable
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import concern_of, p_in_words
from .residual_tests import HELD
from .strata import Array, Strata, no_scatter


@dataclass(frozen=True, slots=True, repr=False)
class SerialCorrelation(Displayable):
    """Pooled lag-1 correlation of residuals within edges, each edge having its own level.

    Removing the level alone makes it about ``-1/(m - 1)`` for m rows an edge, so it is set beside its exact mean
    and variance under independence; the p-value is that of a beta variable with these moments.

    Attributes
    ----------
    correlation, expected, sd : float
        What was found, and its mean and standard deviation for independent rows.
    nobs, n_edges : int
        Rows and edges that tell it.
    order : str
        What rows were put in order by: ``t`` or ``line of the file``.
    pvalue : float
    """

    correlation: float
    expected: float
    sd: float
    nobs: int
    n_edges: int
    order: str
    pvalue: float

    @property
    def null(self) -> str:
        """What the test takes for granted until it rejects it."""
        return "rows of an edge scatter about its level independently of each other"

    @property
    def statistic(self) -> float:
        """Standard deviations between the correlation and what independence gives."""
        return (self.correlation - self.expected) / self.sd

    @property
    def df(self) -> None:
        """None: the p-value follows from two exact moments."""
        return

    @property
    def concern(self) -> int:
        """0 fine, 1 below .05, 2 below .001. Cause: cumulative wear, or edges with time exponents of their own."""
        return concern_of(self.pvalue)

    @property
    def brief(self) -> str:
        """The finding in a few words."""
        return f"independent rows within edges {p_in_words(self.pvalue)}"

    @property
    def verdict(self) -> str:
        """One sentence: what was found and what to do."""
        found = f"lag-1 {self.correlation:.2f} where independence gives {self.expected:.2f}, {p_in_words(self.pvalue)}"
        if not self.concern:
            return f"Rows of an edge do not follow each other ({found})."
        if self.correlation < self.expected:
            return f"Rows of an edge swing about each other ({found}): check how wear was read and in which order."
        return (
            f"Rows of an edge follow each other ({found}): wear adds up or edges differ in their course, so trust "
            "only the by-edge interval for what changes within edges."
        )


def serial_correlation(law: LawFit, strata: Strata | NotAvailable) -> SerialCorrelation | NotAvailable:
    """Pooled lag-1 correlation within edges, in order of time where the law has it, else of the file."""
    from scipy.special import betainc

    if reason := no_scatter(law):
        return NotAvailable(reason)
    if not isinstance(strata, Strata):
        return strata
    total = float(strata.rest @ strata.rest)
    by_time = "t" in law.factors and bool(strata.within[1 + law.factors.index("t")])
    key = law.X[:, law.factors.index("t")] if by_time else law.lines
    order = np.lexsort((law.lines, key, strata.edge))
    mean, variance = _moments(strata, order)
    if variance < HELD or total <= HELD**2 * law.rss:
        return NotAvailable("rows of an edge can only be told to follow each other where edges have three or more")
    rest, same = strata.rest[order], np.diff(strata.edge[order]) == 0
    found = float((rest[1:] * rest[:-1])[same].sum()) / total
    x, m, v = (found + 1) / 2, (mean + 1) / 2, variance / 4
    size = m * (1 - m) / v - 1
    below = float(betainc(m * size, (1 - m) * size, x))
    rows = np.bincount(strata.edge)
    return SerialCorrelation(
        found, mean, variance**0.5, int(rows[rows > 1].sum()), int((rows > 1).sum()),
        "t" if by_time else "line of the file", min(1.0, 2 * min(below, 1 - below)),
    )  # fmt: skip


def _moments(strata: Strata, order: NDArray[np.intp]) -> tuple[float, float]:
    """Mean and variance of the lag-1 ratio for independent normal rows.

    With ``M`` the projection that makes the residuals and ``A`` the matrix of neighbours, ``r = e'Ae / e'e``
    has mean ``tr(MA) / v`` and variance ``2 (v tr(MAMA) - tr(MA)^2) / (v^2 (v + 2))``, v the rank of M.
    """
    edge, level, basis = strata.edge[order], strata.level[order], strata.basis[order]
    same = np.diff(edge) == 0
    by_edge = np.bincount
    beside = _neighbours(level, same)
    one = by_edge(edge, weights=level * beside) / strata.weight
    two = by_edge(edge, weights=beside**2) / strata.weight
    of_basis = np.column_stack([_neighbours(q, same) for q in basis.T]) if basis.shape[1] else basis
    inner = basis.T @ of_basis
    shared = sum(float((by_edge(edge, weights=level * q) ** 2 / strata.weight).sum()) for q in of_basis.T)
    first = -float(one.sum()) - float(np.trace(inner))
    second = 0.5 * float(same.sum()) - 2 * float(two.sum()) + float((one**2).sum())
    second += -2 * (float((of_basis**2).sum()) - shared) + float((inner**2).sum())
    v = strata.df_within
    if v <= 0:
        return 0.0, 0.0
    return first / v, 2 * (v * second - first**2) / (v**2 * (v + 2))


def _neighbours(x: Array, same: NDArray[np.bool_]) -> Array:
    """Half the sum of the neighbours of each row on its edge."""
    out = np.zeros_like(x)
    out[1:] += np.where(same, x[:-1], 0.0)
    out[:-1] += np.where(same, x[1:], 0.0)
    return out / 2
