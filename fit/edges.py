"""What inference by edge gives: rows of one cutting edge are one test measured many times, not many tests.

Standard errors are those of the jackknife by edge (``jackknife``); a random level of each edge (``mixed``)
stands beside it as a cross-check and splits the variance.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.display import Plottable
from .mixed import Mixed

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, repr=False)
class EdgeInference(Plottable):
    """Standard errors of a law that hold for repeated measures on an edge.

    Attributes
    ----------
    names : tuple of str
        Parameters, as ``LawFit.theta_names``.
    cov_theta : ndarray, shape (p, p)
        CR3 covariance of ``LawFit.theta``.
    df : int
        Its degrees of freedom, edges less one.
    n_edges : int
    within : tuple of bool
        Whether each parameter is told within edges (t, wear) or between them (V, f, d).
    moved : ndarray, shape (G, p)
        How far each parameter moves when an edge is left out.
    edges : tuple of str
        Names of the edges, in the order of ``moved``.
    mixed : Mixed
        The law with a random level of each edge.
    fvalue, row_fvalue : float or None
        F of the factors told between edges: with this covariance on ``(f_df, df)`` degrees of freedom, and
        with rows taken as independent. None where every factor changes within edges.
    """

    names: tuple[str, ...]
    cov_theta: Array
    df: int
    n_edges: int
    within: tuple[bool, ...]
    moved: Array
    edges: tuple[str, ...]
    mixed: Mixed
    fvalue: float | None
    row_fvalue: float | None

    @property
    def f_df(self) -> int:
        """Number of factors told between edges."""
        return sum(not w for w in self.within[1:])

    @property
    def f_pvalue(self) -> float | None:
        """P of ``fvalue``."""
        from scipy.special import fdtrc

        return None if self.fvalue is None else float(fdtrc(self.f_df, self.df, self.fvalue))

    @property
    def inflation(self) -> float | None:
        """How many times larger F is when rows are taken as independent."""
        if self.fvalue is None or self.row_fvalue is None:
            return None
        return self.row_fvalue / self.fvalue

    @property
    def bse(self) -> "pd.Series[float]":
        """CR3 standard errors of ``theta``."""
        return pd.Series(np.sqrt(np.diag(self.cov_theta)), index=list(self.names))

    @property
    def sd_new(self) -> float:
        """Standard deviation of a row of a new edge about the law."""
        return float(np.hypot(self.mixed.sd_between, self.mixed.sd_within))

    @property
    def icc(self) -> float:
        """Share of the residual variance that lies between edges."""
        return self.mixed.icc
