"""What one more row is about, and how far off it: for a new edge, for an edge that was cut, for independent rows.

=============  ====================================  =================================================
for            centre known to                       scatter of a row, and its degrees of freedom
=============  ====================================  =================================================
a new edge     CR3 covariance by edge, t(G - 1)      between and within edges, Satterthwaite
the same edge  best linear prediction of its level   within edges, rows - edges - parameters within
rows           covariance of independent rows        residual standard error, n - p
=============  ====================================  =================================================

Source of the second: Henderson 1975, Biometrics 31, 423 (prediction of a random level).
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.errors import FitError
from ..core.intervals import KNOWN_LEVEL, Scatter, between_and_within, one_component
from .domain import changes_within
from .edges import EdgeInference
from .lawfit import LawFit
from .linear import linear

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class About:
    """What rows are about, and how far off it: all on the scale of the law's errors.

    Attributes
    ----------
    of : {"new", "same", "independent rows"}
    edge : str or None
        Whose rows they are, in words; None where rows are independent.
    method : str
        Where the variances come from.
    shift, variance : ndarray, shape (n,)
        Level of the edge above the law, and variance with which the centre is known.
    scatter : Scatter
        Of a row about the centre.
    df : float
        Degrees of freedom of t.
    """

    of: str
    edge: str | None
    method: str
    shift: Array
    variance: Array
    scatter: Scatter
    df: float

    @property
    def sd(self) -> float:
        """Standard deviation of a row about the centre."""
        return self.scatter.sd


def new_edge(law: LawFit, Z: Array) -> About:
    """Rows of an edge not yet cut; or rows as such, where there is no inference by edge.

    Parameters
    ----------
    law : LawFit, with a degree of freedom
    Z : ndarray, shape (n, p), design of the points
    """
    G = gradient_at(law, Z)
    variance = np.einsum("ij,jk,ik->i", G, law.covariance(), G)
    none = np.zeros(len(Z))
    if not isinstance(law.edges, EdgeInference):
        sd, df = law.scale_se or 0.0, float(law.df_resid)
        method = f"rows taken as independent ({law.edges.reason})"
        return About("independent rows", None, method, none, variance, one_component(sd, df), df)
    method = "jackknife by edge (CR3), scatter between and within edges"
    levels = law.edges.mixed
    scatter = between_and_within(
        levels.sd_between, levels.sd_within, rows_per_edge(law), df_between(law), df_within(law)
    )
    return About("new", "a new edge", method, none, variance, scatter, float(law.edges.df))


def same_edge(law: LawFit, Z: Array, table: pd.DataFrame) -> About:
    """Further rows of edges that were cut, about the level each has shown.

    The level is predicted as ``lambda_g`` times the mean residual of its ``n_g`` rows, ``lambda_g = s_b^2 /
    (s_b^2 + s_w^2 / n_g)``. Law and level together are then a weighted sum of all rows, whose variance about
    the truth follows from the two variances exactly. Where ``table`` names no edge the level is taken as
    known, and as standing at the law.
    """
    inference = law.edges
    if not isinstance(inference, EdgeInference):
        return new_edge(law, Z)
    sd, df, none = inference.mixed.sd_within, df_within(law), np.zeros(len(Z))
    if "edge" not in table:
        return About("same", KNOWN_LEVEL, "scatter within edges alone", none, none, one_component(sd, df), df)
    at = _known(law, inference, table)
    A, number = gradient_at(law, _design(law)), edge_numbers(law)
    size = np.bincount(number).astype(float)
    means = np.column_stack([np.bincount(number, weights=a) for a in (*A.T, law.residuals)]) / size[:, None]
    drawn = (inference.mixed.sd_between**2 / (inference.mixed.sd_between**2 + sd**2 / size))[at] if sd > 0 else none
    centre, M = means[at, :-1], linear(A, law.residuals).cov_unscaled
    q = gradient_at(law, Z) - drawn[:, None] * centre
    within = np.einsum("ij,jk,ik->i", q, M, q + 2 * drawn[:, None] * centre) + drawn**2 / size[at]
    sums = (q @ M @ means[:, :-1].T) * size  # of the weights, in each edge
    sums[np.arange(len(at)), at] += drawn - 1
    variance = sd**2 * within + inference.mixed.sd_between**2 * np.einsum("ij,ij->i", sums, sums)
    method = "best linear prediction of the edge's level, scatter within edges"
    return About("same", "the same edge", method, drawn * means[at, -1], variance, one_component(sd, df), df)


def gradient_at(law: LawFit, Z: Array) -> Array:
    """Derivative by theta of what is predicted on the scale of the errors, shape (n, p)."""
    return Z if law.error == "multiplicative" else law.law.gradient(law.theta, Z)


def edge_numbers(law: LawFit) -> NDArray[np.intp]:
    """Number of each row's edge, in the order of their names; one edge where the file names none."""
    if law.edge is None:
        return np.zeros(law.nobs, dtype=np.intp)
    return np.asarray(pd.factorize(law.edge, sort=True)[0], dtype=np.intp)


def df_between(law: LawFit) -> float:
    """Edges less parameters told between them, 1 or more."""
    number = edge_numbers(law)
    return float(max(number.max() + 1 - (~changes_within(_design(law), number)).sum(), 1))


def df_within(law: LawFit) -> float:
    """Rows less edges less parameters told within them, 1 or more."""
    number = edge_numbers(law)
    return float(max(law.nobs - number.max() - 1 - changes_within(_design(law), number).sum(), 1))


def rows_per_edge(law: LawFit) -> float:
    """Harmonic mean of the rows an edge has."""
    sizes = np.bincount(edge_numbers(law))
    return len(sizes) / float(np.sum(1.0 / sizes))


def smearing(law: LawFit, of: str) -> float:
    """Mean of exp(residual): over rows; over edges, which count alike; or about each edge's own mean.

    ``of`` is "independent rows", "new" or "same", as in ``About``.
    """
    r = law.residuals
    if of == "independent rows":
        return float(np.exp(r).mean())
    number = edge_numbers(law)
    size = np.bincount(number)
    if of == "new":
        return float((np.bincount(number, weights=np.exp(r)) / size).mean())
    return float(np.exp(r - (np.bincount(number, weights=r) / size)[number]).mean())


def _design(law: LawFit) -> Array:
    return law.law.design(law.X, law.shifts)


def _known(law: LawFit, edges: EdgeInference, table: pd.DataFrame) -> NDArray[np.intp]:
    """Number of each point's edge among those of the fit."""
    number = {name: g for g, name in enumerate(edges.edges)}
    asked = [f"{v:.15g}" if isinstance(v, float) else str(v) for v in table["edge"]]
    strange = next((name for name in asked if name not in number), None)
    if strange is not None:
        some = ", ".join(edges.edges[:6]) + (", ..." if edges.n_edges > 6 else "")
        raise FitError(
            f"{law.response}: edge {strange!r} is not among the {edges.n_edges} of the fit ({some}); for an edge not "
            "yet cut ask for edge='new'."
        )
    return np.array([number[name] for name in asked], dtype=np.intp)
