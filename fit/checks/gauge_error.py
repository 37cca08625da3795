"""Measurement error of the wear: its effect on a law with wear among its factors, and the correction.

A gauge error of variance ``s^2`` adds ``s^2`` to the apparent scatter of the wear, so least squares attenuates its
exponent and shifts its effect to correlated factors, time first. Subtracting that variance,

    (Z'Z - sum s_i^2 e e') theta = Z'y,    e the column of the wear,

is consistent whatever the distributions, needs no ratio to the error of the response, and is a closed form; where
that ratio is the one it estimates, orthogonal distance regression gives the same numbers. Standard errors leave
out one edge at a time (one row, where there is no inference by edge) and treat ``s`` as known.

Sources: Fuller 1987, Measurement Error Models, sections 1.2 and 2.2; Carroll et al. 2006, Measurement Error in
Nonlinear Models, section 3.4.
"""

from dataclasses import dataclass
from math import isfinite

import numpy as np

from ...core.arrays import Array, Ints
from ...core.errors import UsageError
from ..available import NotAvailable
from ..edges import EdgeInference
from ..lawfit import LawFit
from ..least_squares import linear
from .robust_fit import Refit
from .strata import no_scatter, units_of

LITTLE = 0.5  # reliability below which the correction more than doubles the exponent of wear
ALONE = 1e-8  # relative eigenvalue of the corrected cross-products without a unit, below which it holds the fit
COARSE = 0.3  # gauge error relative to the wear, beyond which d ln AW = dAW / AW is a poor approximation
BLOCK = 4096  # units at a time


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class GaugeFit(Refit):
    """A law corrected for the gauge error of its wear; its standard errors treat that error as known.

    Attributes
    ----------
    law, theta, cov_theta
        As in :class:`Refit`; least squares treats the wear as exact.
    wear : str
    gauge_sd : float
        Standard deviation of the gauge error, in ``unit``.
    unit : str
        ``ln`` or the unit of the wear.
    reliability : float
        Share of the variance of the wear given the other factors that is not gauge error, above 0 to 1.
    coarse : int
        Rows in which the gauge error is more than 0.3 of the wear, where the correction is a poor approximation.
    """

    wear: str
    gauge_sd: float
    unit: str
    reliability: float
    coarse: int


def gauge_corrected(law: LawFit, gauge_sd: float, wear: str = "AW", unit: str = "ln") -> GaugeFit | NotAvailable:
    """Correct a law for an independent error in each reading of its wear.

    Parameters
    ----------
    law : LawFit
        With multiplicative errors, or a line.
    gauge_sd : float
        Standard deviation of one reading, 0 or more.
    wear : str
        Factor that was read.
    unit : str
        ``ln`` (a share of the reading), or the unit of the wear, which a power law turns into ``gauge_sd / AW``.

    Returns
    -------
    GaugeFit, or NotAvailable where the gauge error is as large as the variation that identifies the exponent of wear.

    Raises
    ------
    UsageError
        ``wear`` is no factor of the law, the unit is another, or ``gauge_sd`` is negative.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "P", ["V", "f", "d", "t", "AW"])
    >>> bool(gauge_corrected(law, 0.03).params["AW"] > law.params["AW"])
    True
    """
    _check(law, gauge_sd, wear, unit)
    if reason := _uncorrectable(law):
        return NotAvailable(reason)
    Z, at = law.design, 1 + law.factors.index(wear)
    y = np.log(law.observed) if law.error == "multiplicative" else law.observed
    logs = law.formula.logs[at - 1]
    sd = gauge_sd / law.X[:, at - 1] if logs and unit != "ln" else np.full(len(y), float(gauge_sd))
    others = linear(np.delete(Z, at, axis=1), Z[:, at])
    variance = sd**2 * others.df_resid / len(y)  # less the share explained by the other factors
    reliability = 1.0 - float(variance.sum()) / others.rss
    if reliability <= 0:
        return NotAvailable(
            f"a gauge error of {gauge_sd:g} {unit} is as large as the variation of {wear} given the other factors "
            f"({others.scale**0.5:.2g} on the scale of the fit): its exponent is not identified"
        )
    unit_of_row = units_of(law)[1] if isinstance(law.edges, EdgeInference) else np.arange(law.nobs)
    fit = _corrected(Z, y, at, variance, unit_of_row)
    if isinstance(fit, NotAvailable):
        return fit
    coarse = int((sd > COARSE).sum()) if logs else 0
    theta, cov = fit
    found = (
        f"A gauge error of {gauge_sd:g} {unit} changes the coefficient of {wear} in the law of {law.response} from "
        f"{law.theta[at]:.3g} to {theta[at]:.3g} ± {np.sqrt(cov[at, at]):.2g}"
    )
    weak = reliability < LITTLE
    if coarse:
        found += f"; in {coarse} rows it exceeds {COARSE:g} of the wear, where this is a poor approximation"
    elif weak:
        found += f"; {wear} has a reliability of {100 * reliability:.0f} %: treat this coefficient as weakly identified"
    return GaugeFit(
        null=f"{wear} is measured without error",
        concern=int(weak or coarse > 0),
        verdict=f"{found}.",
        law=law,
        theta=theta,
        cov_theta=cov,
        wear=wear,
        gauge_sd=gauge_sd,
        unit=unit,
        reliability=reliability,
        coarse=coarse,
    )


def _check(law: LawFit, gauge_sd: float, wear: str, unit: str) -> None:
    if wear not in law.factors:
        raise UsageError(f"{wear} is no factor of the law of {law.response} ({', '.join(law.factors)}): name its wear.")
    if not (isfinite(gauge_sd) and gauge_sd >= 0):
        raise UsageError(f"gauge error {gauge_sd:g}: a standard deviation is 0 or more, for instance 0.05.")
    own = law.units.get(wear, "")
    if unit == "ln" and not law.formula.logs[law.factors.index(wear)]:
        raise UsageError(f"the law of {law.response} has {wear} itself, not its logarithm: give the error in {own}.")
    if unit not in ("ln", own):
        raise UsageError(f"gauge error in {unit!r}: {wear} is in {own or 'no unit'}; give it in that, or in 'ln'.")


def _uncorrectable(law: LawFit) -> str | None:
    if reason := no_scatter(law):
        return reason
    if not (law.formula.first_order and law.formula.linearisable):
        return f"the correction needs a law that is linear in the wear, which the form {law.form} is not"
    in_units = law.error == "additive" and law.formula.logarithmic
    return "the correction holds for multiplicative errors only: fit with multiplicative errors" if in_units else None


def _corrected(Z: Array, y: Array, at: int, variance: Array, unit: Ints) -> tuple[Array, Array] | NotAvailable:
    """Parameters and their covariance by units left out.

    In columns Q = Z L, orthonormal, with A = I less the error: leaving unit g out solves
    ``(A - A_g) move = -(Q_g'y_g - A_g phi)``.
    """
    plain = linear(Z, y)
    L = np.linalg.cholesky(plain.cov_unscaled)
    Q, e = Z @ L, L[at]
    r = y - Z @ plain.params
    whole = np.eye(len(e)) - variance.sum() * np.outer(e, e)
    phi = np.linalg.solve(whole, variance.sum() * plain.params[at] * e)
    slope = plain.params[at] + float(e @ phi)
    scores = Q * (r - Q @ phi)[:, None] + slope * variance[:, None] * e
    G = int(unit.max()) + 1
    order = np.argsort(unit, kind="stable")
    start = np.searchsorted(unit[order], np.arange(G + 1))
    moved = np.empty((G, len(e)))
    for g in range(0, G, BLOCK):
        rows = order[start[g] : start[min(g + BLOCK, G)]]
        first = start[g : min(g + BLOCK, G)] - start[g]
        own = Q[rows, :, None] * Q[rows, None, :] - variance[rows, None, None] * np.outer(e, e)
        left = whole - np.add.reduceat(own, first)
        if np.linalg.eigvalsh(left)[:, 0].min() < ALONE:
            return NotAvailable(
                "without one of its units the exponent of wear is not identified at this gauge error: add edges, or "
                "measure the wear more precisely"
            )
        sums = np.add.reduceat(scores[rows], first)
        moved[g : g + BLOCK] = -np.linalg.solve(left, sums[:, :, None])[:, :, 0]
    cov = (G - 1) / G * moved.T @ moved
    return plain.params + L @ phi, L @ cov @ L.T
