"""Posterior densities of forms that compete with a power law: a contribution of wear, and time exponents of edges.

Additive wear: ``R = c0 prod X_j^b_j + k AW``, k > 0, with the errors of the law. ``k`` enters ``phi`` as the logarithm
of the contribution of the mean wear over the middle response, so that

    eta = ln(exp(Z theta) + exp(ln share) R_mid AW / AW_mean).

Straight line in wear: ``R = c0 prod X_j^b_j (1 + k AW)``, k > 0, with share the contribution of the mean wear over the
response of a new edge, ``eta = Z theta + ln(1 + exp(ln share) AW / AW_mean)``.

Time exponents of edges: in logarithms, rows i of edge g are ``y_i = Z_i theta + v_g + u_g x_i + e_i`` with x = ln t
about its mean. Level v and exponent u of an edge are normal about 0, with standard deviations and a correlation, and
are integrated out: with ``(v, u) = sd L z``, z standard normal, and columns ``W = (1, x) L``,

    q = [ r'r - r'W (I + W'W)^-1 W'r ] / sd^2,    ln det = 2 m ln sd + ln det(I + W'W).

Sources: CLM-2023 eq. 14 (load additive in wear), Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587; Pinheiro & Bates
2000, Mixed-Effects Models in S and S-PLUS, section 2.2.
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from ...core.arrays import Array
from ..checks.competing_forms import FittedForm
from ..checks.time_exponent import TIME
from ..lawfit import LawFit
from .density import LN_2PI, Errors, LawDensity, law_density
from .priors import DF, HalfT, Normal, weak

SHARE = "ln share"
USUAL_SHARE = Normal(float(np.log(0.3)), 1.5)  # 95 % of it between 0.016 and 5.7 of the middle response
LEAST_SHARE = 1e-3  # of the start
SPREAD = 0.25  # of ln share, of the start


@dataclass(frozen=True, slots=True, repr=False)
class AdditiveWear(LawDensity):
    """A law with additive wear; its last column is ln of the contribution at share 1, in the unit of the response.

    Attributes
    ----------
    per_share : float
        k over share, in the unit of the response over that of the wear.
    """

    per_share: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the elements of ``phi``."""
        return tuple(SHARE if name == "k" else name for name in LawDensity.names.__get__(self))

    def parameters(self, phi: Array) -> Array:
        """Parameters of the form, ``k`` after the exponents, (m, p) -> (m, q)."""
        out = LawDensity.parameters(self, phi)
        out[:, self.p - 1] = self.per_share * np.exp(phi[:, self.p - 1])
        return out

    def residuals(self, phi: Array) -> Array:
        """Residuals of every row on the scale of the errors, (m, p) -> (m, n)."""
        last = self.p - 1
        eta = np.logaddexp(phi[:, :last] @ self.Z[:, :last].T, phi[:, last, None] + self.Z[:, last])
        return np.asarray(self.y - (np.exp(eta) if self.natural else eta))


@dataclass(frozen=True, slots=True, repr=False)
class StraightLine(AdditiveWear):
    """A law with a factor linear in wear; its last column is ln of the contribution at share 1, over the response."""

    def residuals(self, phi: Array) -> Array:
        """Residuals of every row on the scale of the errors, (m, p) -> (m, n)."""
        last = self.p - 1
        eta = phi[:, :last] @ self.Z[:, :last].T + np.logaddexp(0.0, phi[:, last, None] + self.Z[:, last])
        return np.asarray(self.y - (np.exp(eta) if self.natural else eta))


def wear_contribution(law: LawFit, fitted: FittedForm, edges: bool, errors: Errors = "normal") -> AdditiveWear:
    """Density of a form to which wear contributes linearly: additive wear, or a straight line in wear.

    Parameters
    ----------
    law : LawFit
        The power law, wear among its factors.
    fitted : FittedForm
        The form fitted by least squares in ln R, as start.
    edges : bool
        Whether edges have random levels.
    errors : {"normal", "student"}

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.checks.competing_forms import alternative_forms, rows_of
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> law = fit.power_law(runs, "P", ["V", "f", "d", "t", "AW"])
    >>> form = alternative_forms(law)[1]
    >>> wear_contribution(law, form.fitted(rows_of(law)), edges=True).parameter_names
    ('ln c0', 'V', 'f', 'd', 't', 'k', 'sd', 'icc')
    """
    wear = next(name for name in law.factors if name not in fitted.coefficients)
    j = law.theta_names.index(wear)
    priors = weak(law, edges)
    base = law_density(law, priors, errors)
    AW = np.exp(base.Z[:, j] + base.centre[j])
    line = fitted.name.startswith("straight line")
    middle = 1.0 if line else float(np.exp(np.log(law.observed).mean()))
    per_share = middle / float(AW.mean())
    others = [i for i in range(base.p) if i != j]
    names = (*(base.theta_names[i] for i in others), "k")
    centre = np.array([*base.centre[others], 0.0])
    theta = np.array(list(fitted.coefficients.values()))
    theta[-1] = np.log(max(theta[-1] / per_share, LEAST_SHARE))
    theta[0] += centre[1:] @ theta[1:]
    of = {name: prior for name, prior in priors.of.items() if name != wear} | {SHARE: USUAL_SHARE}
    keep = [*others, *range(base.p, len(base.start))]
    at = [*range(len(others)), *range(base.p, len(base.start))]
    spread = np.zeros_like(base.spread)
    spread[base.p - 1, base.p - 1] = SPREAD
    spread[np.ix_(at, at)] = base.spread[np.ix_(keep, keep)]
    return (StraightLine if line else AdditiveWear)(
        base.law, replace(priors, of=of), errors, base.natural,
        np.column_stack([base.Z[:, others], np.log(per_share * AW)]), base.y, centre,
        base.starts, base.sizes, base.labels, edges, names, np.r_[theta, base.start[base.p :]], spread, per_share,
    )  # fmt: skip


DIFFER = HalfT(DF, 0.3)  # sd of the exponents of edges: half of all sets of edges differ less than about this


@dataclass(frozen=True, slots=True, repr=False)
class EdgeSlopes(LawDensity):
    """A law with edge levels and edge time exponents; ``phi`` ends in ln sd of u and atanh of the correlation.

    Attributes
    ----------
    time : ndarray, shape (n,)
        ln t about its mean; rows sorted by edge.
    """

    time: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the elements of ``phi``."""
        return (*LawDensity.names.__get__(self), "ln sd of u", "atanh correlation")

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters of the law, then sd, icc, sd of u and its correlation with the level."""
        return (*LawDensity.parameter_names.__get__(self), "sd of u", "correlation")

    def parameters(self, phi: Array) -> Array:
        """Parameters of the form, (m, p) -> (m, q)."""
        out = LawDensity.parameters(self, phi)
        out[:, -2], out[:, -1] = np.exp(phi[:, -2]), np.tanh(phi[:, -1])
        return out

    def log_prior(self, phi: Array) -> Array:
        """Log prior with the derivative of ``phi``; uniform for the correlation, (m, p) -> (m,)."""
        z = phi[:, -1]
        uniform = -2 * np.logaddexp(z, -z) + np.log(2)  # ln (1 - tanh^2 z) / 2
        return np.asarray(
            LawDensity.log_prior(self, phi) + DIFFER.log_density(np.exp(phi[:, -2])) + phi[:, -2] + uniform
        )

    def by_unit(self, phi: Array) -> Array:
        """Log likelihood of each edge, (m, p) -> (m, G)."""
        r = self.residuals(phi)
        ln_sd, correlation = phi[:, self.p, None], np.tanh(phi[:, -1, None])
        a, slope = np.exp(0.5 * phi[:, self.p + 1, None]), np.exp(phi[:, -2, None] - ln_sd)
        b, c = correlation * slope, np.sqrt(1 - correlation**2) * slope
        m, x, xx = (self._sum(part) for part in (np.ones_like(self.time), self.time, self.time**2))
        level, with_time, rest = self._sum(r), self._sum(r * self.time), self._sum(r * r)
        h1, h2 = a * level + b * with_time, c * with_time
        M11, M12, M22 = 1 + a * a * m + 2 * a * b * x + b * b * xx, c * (a * x + b * xx), 1 + c * c * xx
        det = M11 * M22 - M12**2
        q = (rest - (M22 * h1**2 - 2 * M12 * h1 * h2 + M11 * h2**2) / det) * np.exp(-2 * ln_sd)
        return np.asarray(-0.5 * (q + 2 * m * ln_sd + np.log(det) + m * LN_2PI))

    def _sum(self, part: Array) -> Array:
        return np.asarray(np.add.reduceat(part, self.starts, axis=-1))


def edge_slopes(law: LawFit) -> EdgeSlopes:
    """Density of a power law in logarithms with random levels and time exponents of edges, normal errors.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> edge_slopes(law).parameter_names[-4:]
    ('sd', 'icc', 'sd of u', 'correlation')
    """
    base = law_density(law, weak(law, edges=True))
    held = {field.name: getattr(base, field.name) for field in fields(base)}
    q = len(base.start)
    spread = np.diag(np.r_[np.zeros(q), 0.5, 0.5])
    spread[:q, :q] = base.spread
    held |= {"start": np.r_[base.start, np.log(0.1), 0.0], "spread": spread}
    return EdgeSlopes(**held, time=base.Z[:, law.theta_names.index(TIME)])
