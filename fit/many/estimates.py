"""The numbers of all pairs while they come in: arrays with a row a pair, NaN until it is fitted."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..edges import EdgeInference
from ..lawfit import LawFit

Array = NDArray[np.float64]
Ints = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Estimates:
    """Facts of K fits with up to p parameters; what a pair does not have is NaN, a count 0, a reason empty.

    Attributes
    ----------
    theta, se, row_se : ndarray, shape (K, p)
        ln c0 and exponents, their standard errors (by edge where ``by_edge``) and those of rows.
    rss, tss : ndarray, shape (K,)
    nobs, n_edges, dropped : ndarray of int, shape (K,)
        Rows used, edges among them, rows left out.
    by_edge, stacked : ndarray of bool, shape (K,)
        Whether standard errors are by edge; whether the fit came from a stack.
    reason, edge_reason, left_out : ndarray of str, shape (K,)
        Why there is no law, why no standard errors by edge, which factors the law does without and why.
    """

    theta: Array
    se: Array
    row_se: Array
    rss: Array
    tss: Array
    nobs: Ints
    n_edges: Ints
    dropped: Ints
    by_edge: NDArray[np.bool_]
    stacked: NDArray[np.bool_]
    reason: NDArray[np.object_]
    edge_reason: NDArray[np.object_]
    left_out: NDArray[np.object_]

    @property
    def df_model(self) -> Ints:
        """Exponents of each law, shape (K,); -1 where there is none."""
        return np.asarray(np.isfinite(self.theta).sum(axis=1) - 1)

    @property
    def df_resid(self) -> Ints:
        """Rows less parameters, shape (K,)."""
        return self.nobs - self.df_model - 1

    @property
    def df(self) -> Ints:
        """Degrees of freedom of t, p and intervals: edges less one, or those of the rows; shape (K,)."""
        return np.where(self.by_edge, self.n_edges - 1, self.df_resid)


def nothing_yet(K: int, p: int) -> Estimates:
    """Room for K pairs and p parameters."""
    numbers = [np.full((K, p), np.nan) for _ in range(3)] + [np.full(K, np.nan) for _ in range(2)]
    counts = [np.zeros(K, dtype=np.intp) for _ in range(3)]
    flags = [np.zeros(K, dtype=bool) for _ in range(2)]
    return Estimates(*numbers, *counts, *flags, *(np.full(K, "", dtype=object) for _ in range(3)))


def enter(into: Estimates, i: int, law: LawFit, names: tuple[str, ...]) -> None:
    """Write the law of pair i down."""
    at = [names.index(name) for name in law.names]
    into.theta[i, at] = law.theta
    into.se[i, at] = np.sqrt(np.diag(law.covariance()))
    into.row_se[i, at] = np.nan if law.cov_theta is None else np.sqrt(np.diag(law.cov_theta))
    into.rss[i], into.tss[i], into.nobs[i] = law.rss, law.tss, law.nobs
    into.n_edges[i] = law.n_edges or 0
    into.dropped[i] = sum(item.count for item in law.dropped)
    into.by_edge[i] = isinstance(law.edges, EdgeInference)
    into.edge_reason[i] = "" if isinstance(law.edges, EdgeInference) else law.edges.reason
    into.left_out[i] = "; ".join(f"{item.factor} {item.reason}" for item in law.left_out)
