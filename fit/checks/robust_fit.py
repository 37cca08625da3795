"""Robust refit of a law (Huber), and the edge with the largest influence on it.

Huber's weights bound the influence of one row: a row within 1.345 robust standard deviations has weight 1, one
further out 1.345 over its distance (95 % efficient where errors are normal). They do not bound leverage: an edge far
from all others attracts the law and leaves small residuals; ``dominant_edge`` finds it.

Sources: Huber 1964, Ann. Math. Stat. 35, 73; Huber & Ronchetti 2009, Robust Statistics, section 7.6 (covariance of
regression M-estimates); Belsley, Kuh & Welsch 1980, Regression Diagnostics, chapter 2 (deletion of an edge).
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from ...core.display import Plottable
from ..available import NotAvailable
from ..edges import EdgeInference
from ..jackknife import edge_inference
from ..lawfit import LawFit
from ..linear import linear
from .strata import Array, no_scatter, units_of


@dataclass(frozen=True, slots=True)
class Refit:
    """Other parameters of a law on the same rows.

    Attributes
    ----------
    law : LawFit
        The plain fit.
    theta, cov_theta : ndarray, shape (p,) and (p, p)
        Parameters, as ``law.theta``, and their covariance.
    """

    law: LawFit
    theta: Array
    cov_theta: Array

    @property
    def params(self) -> "pd.Series[float]":
        """Coefficients, as ``LawFit.params``."""
        return pd.Series(self.law.law.coefficients(self.theta), index=list(self.law.names), name=self.law.response)

    @property
    def bse(self) -> "pd.Series[float]":
        """Standard errors of ``theta``."""
        return pd.Series(np.sqrt(np.diag(self.cov_theta)), index=list(self.law.theta_names), name="bse")


def tangent(law: LawFit, Z: Array, theta: Array) -> tuple[Array, Array]:
    """Gradient (n, p) and residuals (n,) at theta, on the scale of the errors."""
    if law.error == "multiplicative":
        return Z, np.log(law.observed) - Z @ theta
    return law.law.gradient(theta, Z), law.observed - law.law.response_at(theta, Z)


# Standard errors of the law without it that an edge must move some parameter by: the largest over edges and parameters
# stays below it in 97 of 100 sound composite designs of 12 edges, in 99 of 100 of 24.
DOMINANT = 2.5
FEW = 10  # edges below which that happens by chance too often


@dataclass(frozen=True, slots=True, repr=False)
class DominantEdge(Plottable):
    """The edge that a law leans on most.

    Attributes
    ----------
    edge : str
    n_edges : int
    moved : Series, indexed as ``LawFit.theta_names``
        How far each parameter moves when it is left out.
    in_bse : Series
        The same in standard errors, by edge, of the law fitted without it: an edge that is astray would
        otherwise widen the measure it is held against.
    """

    edge: str
    n_edges: int
    moved: "pd.Series[float]"
    in_bse: "pd.Series[float]"

    @property
    def parameter(self) -> str:
        """The parameter it moves most, in standard errors."""
        return str(self.in_bse.abs().idxmax())

    @property
    def dominates(self) -> bool:
        """Whether it moves some parameter by more than 2.5 standard errors, among ten edges or more."""
        return self.n_edges >= FEW and float(self.in_bse.abs().max()) > DOMINANT

    @property
    def concern(self) -> int:
        """0 fine, 1 one edge dominates. Cause: a damaged edge, or a lone setting. Cure: check it, or cut it again."""
        return int(self.dominates)

    @property
    def verdict(self) -> str:
        """One sentence: which edge, and how far the law moves without it."""
        name = self.parameter
        found = f"without {self.edge}, {name} moves by {self.moved[name]:+.2g} ({abs(self.in_bse[name]):.1f}"
        found += " standard errors)"
        if self.dominates:
            return f"Edge {self.edge} dominates: {found}; look at that edge, or cut another at its conditions."
        if self.n_edges < FEW:
            return f"With {self.n_edges} edges each of them counts much: {found}."
        return f"No edge dominates: at most, {found}."


def dominant_edge(law: LawFit) -> DominantEdge | NotAvailable:
    """The edge whose leaving out moves some parameter furthest, in standard errors by edge.

    Found among all edges by the law's own standard errors, then measured by those of the law without it.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> dominant_edge(law).dominates
    False
    """
    if isinstance(law.edges, NotAvailable):
        return law.edges
    moved, bse = law.edges.moved, np.sqrt(np.diag(law.edges.cov_theta))
    g = int(np.argmax(np.abs(moved / bse).max(axis=1)))
    rest = _without(law, law.edges.edges[g], moved[g])
    if isinstance(rest, EdgeInference):
        bse = np.sqrt(np.diag(rest.cov_theta))
    index = list(law.theta_names)
    return DominantEdge(
        law.edges.edges[g], law.edges.n_edges, pd.Series(moved[g], index=index), pd.Series(moved[g] / bse, index=index)
    )


def _without(law: LawFit, edge: str, moved: Array) -> EdgeInference | NotAvailable:
    """Inference by edge of the law fitted without one of its edges."""
    kept = np.array([str(name) != edge for name in law.edge]) if law.edge is not None else slice(None)
    J, r = tangent(law, law.law.design(law.X, law.shifts), law.theta)
    left = (r - J @ moved)[kept]
    rest = replace(
        law, cov_theta=linear(J[kept], left).cov_params, X=law.X[kept], shifts=law.shifts[kept],
        observed=law.observed[kept], fitted=law.fitted[kept], residuals=left, rss=float(left @ left),
        lines=law.lines[kept], edge=None if law.edge is None else law.edge[kept],
    )  # fmt: skip
    return edge_inference(rest)


K = 1.345  # 95 % efficiency with normal errors
NORMAL = 0.6744897501960817  # of a normal distribution's standard deviation: its median absolute deviation
CLOSE = 1e-11  # largest last step, in standard deviations of the residuals
MOST = 500  # steps of reweighting
HALF = 0.5  # weight below which a row is named
MOVED = 1.0  # standard errors


@dataclass(frozen=True, slots=True, repr=False)
class RobustFit(Plottable, Refit):
    """Huber's refit of a law.

    Its covariance is the jackknife by edge where the law has one, else Huber's for independent rows.

    Attributes
    ----------
    law, theta, cov_theta
        As in :class:`Refit`.
    weights : ndarray, shape (n,)
        Weight of each row, 1 for a row that counts whole.
    scale : float
        Robust standard deviation of the residuals (median absolute deviation), in ``law.scale_unit``.
    dominant : DominantEdge or NotAvailable
    """

    weights: Array
    scale: float
    dominant: DominantEdge | NotAvailable

    @property
    def in_bse(self) -> "pd.Series[float]":
        """How far each parameter lies from the plain fit, in standard errors of the plain fit."""
        far = (self.theta - self.law.theta) / np.sqrt(np.diag(self.law.covariance()))
        return pd.Series(far, index=list(self.law.theta_names))

    @property
    def lines(self) -> tuple[int, ...]:
        """Lines of the file whose row counts less than half, lightest first."""
        order = np.argsort(self.weights, kind="stable")
        return tuple(int(self.law.lines[i]) for i in order if self.weights[i] < HALF)

    @property
    def concern(self) -> int:
        """0 fine, 1 the plain fit follows outliers. Cure: look at ``lines``, or report the robust fit."""
        return int(self.in_bse.abs().max() > MOVED)

    @property
    def verdict(self) -> str:
        """One sentence: how far robust and plain fit lie apart, and which rows count less than half."""
        far = self.in_bse
        name = str(far.abs().idxmax())
        at = self.law.theta_names.index(name)
        gap = f"{name} {self.law.theta[at]:.3g} becomes {self.theta[at]:.3g}, {abs(far[name]):.1f} standard errors"
        light = self.lines
        rows = f"; {len(light)} row{'s count' if len(light) > 1 else ' counts'} less than half" if light else ""
        if light:
            rows += f" (line{'s' if len(light) > 1 else ''} {', '.join(map(str, light[:5]))}"
            rows += ", ...)" if len(light) > 5 else ")"
        if self.concern:
            return f"Outliers move the law: refitted robustly, {gap}{rows}."
        return f"A robust refit agrees: at most, {gap}{rows}."


def robust(law: LawFit) -> RobustFit | NotAvailable:
    """Refit a law with Huber's weights, on the scale its errors are on.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> robust(law).concern
    0
    """
    if reason := no_scatter(law):
        return NotAvailable(reason)
    Z = law.law.design(law.X, law.shifts)
    theta = law.theta
    for _ in range(MOST):  # one pass for a straight line; a law in natural units is followed along its gradient
        J, r = tangent(law, Z, theta)
        refit = _huber(J, r)
        if isinstance(refit, NotAvailable):
            return refit
        step, weights, scale = refit
        theta = theta + step
        if law.error == "multiplicative" or not law.law.logarithmic:
            break
        if np.abs(J @ step).max() <= 100 * CLOSE * scale:
            break
    else:
        return NotAvailable(f"Huber's refit in natural units does not settle in {MOST} steps")
    J, r = tangent(law, Z, theta)
    cov = _by_edge(law, J, r) if isinstance(law.edges, EdgeInference) else _by_row(J, r, scale)
    if isinstance(cov, NotAvailable):
        return cov
    return RobustFit(law, theta, cov, weights, scale, dominant_edge(law))


def _huber(J: Array, r: Array) -> tuple[Array, Array, float] | NotAvailable:
    """Step from residuals r, weights and scale of Huber's fit of ``r = J step``, by reweighting."""
    L = np.linalg.cholesky(linear(J, r).cov_unscaled)
    Q = J @ L
    step = np.zeros(Q.shape[1])
    for _ in range(MOST):
        left = r - Q @ step
        scale = float(np.median(np.abs(left))) / NORMAL
        if scale <= 1e-9 * np.abs(left).max():
            return NotAvailable("half of the rows or more lie on the law exactly: no robust scale of the others")
        weights = np.minimum(1.0, K * scale / np.maximum(np.abs(left), 1e-300))
        root = np.sqrt(weights)
        new = linear(root[:, None] * Q, root * r).params
        change, step = float(np.abs(Q @ (new - step)).max()), new
        if change <= CLOSE * scale:
            return L @ step, weights, scale
    return NotAvailable(f"Huber's reweighting does not settle in {MOST} steps")


def _by_edge(law: LawFit, J: Array, r: Array) -> Array | NotAvailable:
    """Jackknife by edge of Huber's fit, along the gradient."""
    edge = units_of(law)[1]
    G = int(edge.max()) + 1
    moved = np.empty((G, J.shape[1]))
    for g in range(G):
        kept = edge != g
        refit = _huber(J[kept], r[kept])
        if isinstance(refit, NotAvailable):
            return refit
        moved[g] = refit[0]
    return np.asarray((G - 1) / G * moved.T @ moved)


def _by_row(J: Array, r: Array, scale: float) -> Array:
    """Huber's covariance of independent rows, with his correction for the number of parameters."""
    n, p = J.shape
    inside = (np.abs(r) <= K * scale).astype(float)
    m = float(inside.mean())
    correction = 1 + p / n * float(inside.var()) / m**2
    psi = np.clip(r, -K * scale, K * scale)
    variance = correction**2 * float(psi @ psi) / (n - p) / m**2
    return np.asarray(variance * linear(J, r).cov_unscaled)
