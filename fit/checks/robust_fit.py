"""Robust refits of a law (Huber's, which users can ask for, and the bisquare, which the checks use), and tails of rows.

Huber's weights bound the influence of one row: a row within 1.345 robust standard deviations has weight 1, one
further out 1.345 over its distance (95 % efficient where errors are normal). They do not bound leverage: an edge far
from all others attracts the law and leaves small residuals (see ``wrong_edges``). The bisquare, started from Huber's
fit, gives no weight to rows beyond 4.685 standard deviations.

Sources: Huber 1964, Ann. Math. Stat. 35, 73; Huber & Ronchetti 2009, Robust Statistics, section 7.6 (covariance of
regression M-estimates); Yohai 1987, Ann. Stat. 15, 642 (redescending weights from a robust start); Renyi 1953, Acta
Math. Acad. Sci. Hung. 4, 191 (spacings of the largest values).
"""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ...core.arrays import Array, Ints
from ...core.display import Plottable
from ..available import NotAvailable
from ..edges import EdgeInference
from ..lawfit import LawFit
from ..least_squares import linear
from .check import Check
from .strata import no_scatter, units_of


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class Refit(Check, Plottable):
    """A law refitted by another method to the same rows.

    Attributes
    ----------
    law : LawFit
        The least-squares fit.
    theta, cov_theta : ndarray, shape (p,) and (p, p)
        Parameters, as ``law.theta``, and their covariance.
    """

    law: LawFit
    theta: Array
    cov_theta: Array

    @property
    def params(self) -> "pd.Series[float]":
        """Coefficients, as ``LawFit.params``."""
        return pd.Series(self.law.formula.coefficients(self.theta), index=list(self.law.names), name=self.law.response)

    @property
    def bse(self) -> "pd.Series[float]":
        """Standard errors of ``theta``."""
        return pd.Series(np.sqrt(np.diag(self.cov_theta)), index=list(self.law.theta_names), name="bse")


def tangent(law: LawFit, Z: Array, theta: Array) -> tuple[Array, Array]:
    """Gradient (n, p) and residuals (n,) at theta, on the scale of the errors."""
    value, G = law.formula.scaled(theta, Z, law.error)
    return G, (np.log(law.observed) if law.error == "multiplicative" else law.observed) - value


def working_response(law: LawFit) -> tuple[Array, Array]:
    """Columns (n, p) and response (n,) of which the law is the linear least-squares fit, linearised where needed."""
    G = law.gradient
    return G, G @ law.theta + law.residuals


K = 1.345  # 95 % efficiency with normal errors
NORMAL = 0.6744897501960817  # of a normal distribution's standard deviation: its median absolute deviation
CLOSE = 1e-11  # largest last step, in standard deviations of the residuals
MOST = 500  # steps of reweighting
HALF = 0.5  # weight below which a row is listed
MOVED = 1.0  # standard errors


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class RobustFit(Refit):
    """Huber's refit of a law.

    Its covariance is the jackknife by edge where the law has one, else Huber's for independent rows.

    Attributes
    ----------
    law, theta, cov_theta
        As in :class:`Refit`.
    weights : ndarray, shape (n,)
        Weight of each row, 0 to 1.
    scale : float
        Robust standard deviation of the residuals (median absolute deviation), in ``law.scale_unit``.
    """

    weights: Array
    scale: float

    @property
    def in_bse(self) -> "pd.Series[float]":
        """Difference of each parameter from least squares, in standard errors of the robust fit.

        Those of least squares contain the outliers.
        """
        return _in_bse(self.law, self.theta, self.cov_theta)

    @property
    def lines(self) -> tuple[int, ...]:
        """Lines of the file whose row has a weight below 0.5, lowest first."""
        return _downweighted(self.law, self.weights)


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
    Z = law.design
    theta = law.theta
    for _ in range(MOST):  # one pass for a linear law; additive errors of others are linearised again
        J, r = tangent(law, Z, theta)
        refit = _huber(J, r)
        if isinstance(refit, NotAvailable):
            return refit
        step, weights, scale = refit
        theta = theta + step
        if law.formula.linearisable and (law.error == "multiplicative" or not law.formula.logarithmic):
            break
        if np.abs(J @ step).max() <= 100 * CLOSE * scale:
            break
    else:
        return NotAvailable(f"Huber's refit with additive errors does not converge in {MOST} steps")
    J, r = tangent(law, Z, theta)
    cov = _by_edge(law, J, r) if isinstance(law.edges, EdgeInference) else _by_row(J, r, scale)
    if isinstance(cov, NotAvailable):
        return cov
    shift, lines = _in_bse(law, theta, cov), _downweighted(law, weights)
    concern = int(shift.abs().max() > MOVED)
    name = str(shift.abs().idxmax())
    j = law.theta_names.index(name)
    found = f"{name} changes from {law.theta[j]:.3g} to {theta[j]:.3g}, {abs(shift[name]):.1f} standard errors"
    if lines:
        found += f"; {len(lines)} row{'s have' if len(lines) > 1 else ' has'} a weight below {HALF:g} (line"
        found += f"{'s' if len(lines) > 1 else ''} {', '.join(map(str, lines[:5]))}{', ...' if len(lines) > 5 else ''})"
    return RobustFit(
        null="the robust refit agrees with least squares within one standard error",
        concern=concern,
        verdict=f"Outliers influence the law: refitted robustly, {found}."
        if concern
        else f"The robust refit agrees with least squares: at most, {found}.",
        law=law,
        theta=theta,
        cov_theta=cov,
        weights=weights,
        scale=scale,
    )


def _in_bse(law: LawFit, theta: Array, cov: Array) -> "pd.Series[float]":
    shift = (theta - law.theta) / np.sqrt(np.diag(cov))
    return pd.Series(shift, index=list(law.theta_names))


def _downweighted(law: LawFit, weights: Array) -> tuple[int, ...]:
    order = np.argsort(weights, kind="stable")
    return tuple(int(law.lines[i]) for i in order if weights[i] < HALF)


def _huber(J: Array, r: Array) -> tuple[Array, Array, float] | NotAvailable:
    """Step from residuals r, weights and scale of Huber's fit of ``r = J step``, by reweighting."""
    L = np.linalg.cholesky(linear(J, r).cov_unscaled)
    Q = J @ L
    step = np.zeros(Q.shape[1])
    for _ in range(MOST):
        left = r - Q @ step
        scale = float(np.median(np.abs(left))) / NORMAL
        if scale <= 1e-9 * np.abs(left).max():
            return NotAvailable("at least half of the rows lie on the law exactly: the robust scale is zero")
        weights = np.minimum(1.0, K * scale / np.maximum(np.abs(left), 1e-300))
        root = np.sqrt(weights)
        new = linear(root[:, None] * Q, root * r).params
        change, step = float(np.abs(Q @ (new - step)).max()), new
        if change <= CLOSE * scale:
            return L @ step, weights, scale
    return NotAvailable(f"Huber's reweighting does not converge in {MOST} steps")


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


BISQUARE = 4.685  # 95 % efficiency with normal errors
ENOUGH, STEPS = 1e-6, 60


def bisquare_residuals(Z: Array, y: Array) -> Array:
    """Residuals of y from its bisquare fit on Z, started from Huber's fit, whose robust scale is kept.

    Examples
    --------
    >>> Z = np.column_stack([np.ones(9), np.arange(9.0)])
    >>> y = 2 + np.arange(9.0) + np.array([0.1, -0.1, 0.1, -0.1, 50, -0.1, 0.1, -0.1, 0.1])
    >>> bool(np.abs(np.delete(bisquare_residuals(Z, y), 4)).max() < 0.2)
    True
    """
    Q = np.linalg.qr(Z / np.linalg.norm(Z, axis=0))[0]
    left, scale = _reweighted(Q, y, y - Q @ (Q.T @ y), None)
    return _reweighted(Q, y, left, scale)[0]


def _reweighted(Q: Array, y: Array, left: Array, fixed: float | None) -> tuple[Array, float]:
    """Residuals by reweighting, Huber's where the scale is not fixed, else the bisquare; and the scale."""
    scale = 0.0
    for _ in range(STEPS):
        scale = float(np.median(np.abs(left))) / NORMAL if fixed is None else fixed
        if scale <= 1e-9 * float(np.abs(left).max()):
            break
        if fixed is None:
            weights = np.minimum(1.0, K * scale / np.maximum(np.abs(left), 1e-300))
        else:
            weights = np.clip(1 - (left / (BISQUARE * scale)) ** 2, 0.0, None) ** 2
        weighted = weights[:, None] * Q
        new = y - Q @ np.linalg.lstsq(Q.T @ weighted, weighted.T @ y, rcond=None)[0]
        change, left = float(np.abs(new - left).max()), new
        if change <= ENOUGH * scale:
            break
    return left, scale


TAIL = 3.5  # index of the tail between 4 and 10 standard deviations of Student's t with 4 degrees of freedom
LIKELY = 1.0  # of log-likelihood; at 144 rows 1 % of sound files with t(4) errors have a p below .006
TAILS = (3.0, 4.0, 5.0, 6.0, 8.0, 12.0, 20.0, 50.0)  # degrees of freedom of Student's t that the rows may have
EM_STEPS = 20


def standing_apart(size: Array, most: int, floor: float) -> int:
    """Number of the largest values that stand apart from the others, at most ``most``.

    >>> standing_apart(np.array([1.0, 1.2, 0.3, 30.0, 28.0, 0.8]), 3, 1.0)
    2
    """
    x, m = np.sort(size)[::-1], np.arange(1, most + 1)
    ratio = np.maximum(x[1 : most + 1], floor) / np.maximum(x[:most], 1e-300)
    return int(np.argmin(m * (m + 1) * np.minimum(ratio, 1.0) ** (TAIL * m))) + 1


def gap_pvalue(r: Array, far: Ints, floor: float) -> float:
    """The p of the gap between the residuals ``far`` (positions) and the largest other, by the tails of the others.

    The tails are the heaviest that the other rows do not clearly contradict: they lose likelihood by less than
    ``LIKELY``. ``floor`` is the least of the largest other, in standard deviations.

    >>> rng = np.random.default_rng(1)
    >>> gap_pvalue(np.append(rng.standard_normal(140), 12.0), np.array([140]), 2.5) < 0.01
    True
    """
    from scipy.special import log_ndtr, stdtr

    others, count = np.delete(r, far), len(far)
    nu, sd = _tail(others, LIKELY)
    following = max(float(np.abs(others).max()), floor * sd)
    ends = -np.array([float(np.abs(r[far]).min()), following]) / sd
    log_tail = log_ndtr(ends) if nu >= TAILS[-1] else np.log(stdtr(nu, ends))
    return float(min(1.0, count * (count + 1) * np.exp(count * min(log_tail[0] - log_tail[1], 0.0))))


def tail_of_rows(r: Array) -> float:
    """Degrees of freedom of Student's t that residuals about the levels of edges have, by maximum likelihood.

    The levels of edges, which are too few to show their tails, are taken to have those of the rows.

    >>> tail_of_rows(np.random.default_rng(1).standard_t(3, 400)) < 6
    True
    """
    return _tail(r, 0.0)[0]


def _tail(r: Array, loss: float) -> tuple[float, float]:
    """Fewest degrees of freedom, and scale, of Student's t that lose at most ``loss`` of the largest likelihood."""
    from scipy.special import gammaln

    square, found = r**2, []
    for nu in TAILS:
        variance = float(square.mean())
        for _ in range(EM_STEPS):
            variance = float(np.mean((nu + 1) * square / (nu + square / variance)))
        each = -(nu + 1) / 2 * np.log1p(square / (nu * variance)) - np.log(variance) / 2
        constant = gammaln((nu + 1) / 2) - gammaln(nu / 2) - np.log(nu) / 2
        found.append((nu, math.sqrt(variance), len(r) * float(each.mean() + constant)))
    most = max(likelihood for _, _, likelihood in found)
    return next((nu, sd) for nu, sd, likelihood in found if likelihood >= most - loss)
