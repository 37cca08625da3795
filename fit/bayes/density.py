"""Posterior densities: the protocol of all models, samples of draws, and the density of one law.

A point ``phi`` is unconstrained: standard deviations enter as logarithms, shares as logits, and the logarithm of
their derivative belongs to the prior.

With residuals r of the rows of an edge, scatter sd within edges and intraclass correlation ``icc``, so that
``k = icc / (1 - icc)`` is the variance of the edge levels over that of the rows, an edge of m rows has

    q = [ sum r^2 - k / (1 + m k) (sum r)^2 ] / sd^2,    ln det = 2 m ln sd + ln(1 + m k),

the level itself being integrated out. Normal errors: ``-(q + ln det + m ln 2 pi) / 2``. Student-t errors give
the rows of an edge one common heavy tail, a multivariate t with ``nu`` degrees of freedom; without edges, each row.

Source of the integral: Pinheiro & Bates 2000, Mixed-Effects Models in S and S-PLUS, section 2.2; of the t:
Lange, Little & Taylor 1989, J. Am. Stat. Assoc. 84, 881; prior of nu: Juarez & Steel 2010, J. Bus. Econ. Stat. 28, 52.
"""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from ...core.arrays import Array, Ints, Texts
from ...core.display import Displayable
from ...core.errors import FitError
from ..lawfit import LawFit
from ..laws import LawForm
from .priors import Priors


class Density(Protocol):
    """A posterior density, but for a constant.

    Attributes
    ----------
    names, parameter_names : tuple of str
        Of ``phi``, length p, and of the parameters, length q.
    units : tuple of str
        Names of the G edges (of the rows, where there are no edges), in the order of ``by_unit``.
    start : ndarray, shape (p,)
        The mode, or near it.
    spread : ndarray, shape (p, p)
        Covariance of a normal approximation there.
    """

    @property
    def names(self) -> tuple[str, ...]: ...  # noqa: D102

    @property
    def parameter_names(self) -> tuple[str, ...]: ...  # noqa: D102

    @property
    def units(self) -> tuple[str, ...]: ...  # noqa: D102

    @property
    def start(self) -> Array: ...  # noqa: D102

    @property
    def spread(self) -> Array: ...  # noqa: D102

    def log_prior(self, phi: Array) -> Array:
        """Log density of the prior on the scale of ``phi``, (m, p) -> (m,)."""

    def by_unit(self, phi: Array) -> Array:
        """Log likelihood of each edge (or row), (m, p) -> (m, G)."""

    def log_likelihood(self, phi: Array) -> Array:
        """Their sum, (m, p) -> (m,)."""

    def parameters(self, phi: Array) -> Array:
        """Parameters of the law, (m, p) -> (m, q)."""


def log_posterior(density: Density, phi: Array) -> Array:
    """Log posterior density but for a constant, (m, p) -> (m,); minus infinity where it is not finite."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        value = density.log_prior(phi) + density.log_likelihood(phi)
    return np.where(np.isfinite(value), value, -np.inf)


Method = Literal["exact", "importance", "emcee"]


@dataclass(frozen=True, slots=True, repr=False)
class Sample(Displayable):
    """Draws on the scale of a density's ``phi``, all of one weight.

    Attributes
    ----------
    phi : ndarray, shape (S, p)
        Chain after chain.
    chains : int
        How many chains of S / chains draws; 1 where draws are independent.
    method : {"exact", "importance", "emcee"}
    words : str
        Sampling method and its settings in one sentence.
    k_hat : float or None
        Pareto shape of the importance weights.
    ess : float or None
        Effective number of draws by the weights, or by the autocorrelation time, as the sampling method estimates it.
    tau : ndarray, shape (p,), or None
        Autocorrelation time in draws of one chain.
    interrupted : bool
        Whether the run was interrupted before the convergence checks passed.
    """

    phi: Array
    chains: int
    method: Method
    words: str
    k_hat: float | None = None
    ess: float | None = None
    tau: Array | None = None
    interrupted: bool = False


Errors = Literal["normal", "student"]
AT_ONCE = 4_000_000  # points times rows: 32 MB of residuals
LN_2PI = float(np.log(2 * np.pi))
NU = (2.0, 0.1)  # gamma prior of nu: shape, rate; nine tenths of it between 3.6 and 47


@dataclass(frozen=True, slots=True, repr=False)
class LawDensity(Displayable):
    """A posterior density of a law, but for a constant.

    ``phi`` is level, slopes, ln sd, then logit icc where there are edges and ln nu where errors are Student's;
    the level is that of the linear form at ``centre``, the middle of the tests.

    Attributes
    ----------
    law : LawForm
    natural : bool
        Whether residuals are in the unit of the response, or in its logarithm.
    Z, y : ndarray, shape (n, p) and (n,)
        Columns about their centre, and response on the scale of the residuals; rows sorted by edge.
    centre : ndarray, shape (p,)
    starts, sizes : ndarray of int, shape (G,)
        First row of each edge and its number of rows, or of each row where rows are independent.
    edges : bool
    """

    law: LawForm
    priors: Priors
    errors: Errors
    natural: bool
    Z: Array
    y: Array
    centre: Array
    starts: Ints
    sizes: Array
    labels: Texts
    edges: bool
    theta_names: tuple[str, ...]
    start: Array
    spread: Array

    @property
    def units(self) -> tuple[str, ...]:
        """Names of the edges, or of the rows by their lines."""
        return tuple(str(label) if self.edges else f"line {label}" for label in self.labels)

    @property
    def p(self) -> int:
        """Number of coefficients: level and slopes."""
        return int(self.Z.shape[1])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the elements of ``phi``."""
        more = (("logit icc",) if self.edges else ()) + (("ln nu",) if self.errors == "student" else ())
        return ("level", *self.theta_names[1:], "ln sd", *more)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters of the law, then sd, icc and nu."""
        more = (("icc",) if self.edges else ()) + (("nu",) if self.errors == "student" else ())
        return (*self.theta_names, "sd", *more)

    def parameters(self, phi: Array) -> Array:
        """Parameters of the law, (m, p) -> (m, q)."""
        out = phi.copy()
        out[:, 0] -= phi[:, 1 : self.p] @ self.centre[1:]
        out[:, self.p] = np.exp(phi[:, self.p])
        if self.edges:
            out[:, self.p + 1] = 1 / (1 + np.exp(-phi[:, self.p + 1]))
        if self.errors == "student":
            out[:, -1] = np.exp(phi[:, -1])
        return out

    def log_prior(self, phi: Array) -> Array:
        """Log prior with the derivative of ``phi``, (m, p) -> (m,)."""
        of = self.priors.of
        total = sum(
            (of[name].log_density(phi[:, j]) for j, name in enumerate(self.names[: self.p])), np.zeros(len(phi))
        )
        ln_sd = phi[:, self.p]
        total = total + of["sd"].log_density(np.exp(ln_sd)) + ln_sd
        if self.edges:
            logit = phi[:, self.p + 1]
            ln_icc, ln_rest = -np.logaddexp(0, -logit), -np.logaddexp(0, logit)
            total = total + of["icc"].log_density(np.exp(ln_icc)) + ln_icc + ln_rest
        if self.errors == "student":
            total = total + NU[0] * phi[:, -1] - NU[1] * np.exp(phi[:, -1])
        return total

    def residuals(self, phi: Array) -> Array:
        """Residuals of every row on the scale of the errors, (m, p) -> (m, n)."""
        eta = phi[:, : self.p] @ self.Z.T
        if self.natural and self.law.logarithmic:
            np.exp(eta, out=eta)
        np.subtract(self.y, eta, out=eta)
        return eta

    def gradient(self, phi: Array) -> Array:
        """Negative gradient of the residuals at one point, (p,) -> (n, p): Z, or the gradient on the original scale."""
        if not (self.natural and self.law.logarithmic):
            return self.Z
        return np.asarray(np.exp(self.Z @ phi[: self.p])[:, None] * self.Z)

    def by_unit(self, phi: Array) -> Array:
        """Log likelihood of each edge, or row, (m, p) -> (m, G)."""
        at_once = max(AT_ONCE // len(self.y), 1)
        if len(phi) > at_once:
            return np.vstack([self._by_unit(phi[i : i + at_once]) for i in range(0, len(phi), at_once)])
        return self._by_unit(phi)

    def _by_unit(self, phi: Array) -> Array:
        r = self.residuals(phi)
        ln_sd = phi[:, self.p, None]
        if self.edges:
            k = np.exp(phi[:, self.p + 1, None])
            sums = np.add.reduceat(r, self.starts, axis=1)
            np.square(r, out=r)
            q = np.add.reduceat(r, self.starts, axis=1) - k / (1 + self.sizes * k) * sums**2
            log_det = 2 * self.sizes * ln_sd + np.log1p(self.sizes * k)
        else:
            q, log_det = np.square(r, out=r), 2 * ln_sd
        q = q * np.exp(-2 * ln_sd)
        if self.errors == "normal":
            return np.asarray(-0.5 * (q + log_det + self.sizes * LN_2PI))
        return student(q, log_det, self.sizes, np.exp(phi[:, -1, None]))

    def log_likelihood(self, phi: Array) -> Array:
        """Sum over edges, or rows, (m, p) -> (m,)."""
        if self.edges or self.errors == "student":
            return np.asarray(self.by_unit(phi).sum(axis=1))
        r = self.residuals(phi)
        ln_sd = phi[:, self.p]
        return np.asarray(-0.5 * np.einsum("ij,ij->i", r, r) * np.exp(-2 * ln_sd) - len(self.y) * (ln_sd + LN_2PI / 2))


def student(q: Array, log_det: Array, m: Array, nu: Array) -> Array:
    """Multivariate t of m rows with degrees of freedom ``nu``."""
    from scipy.special import gammaln

    constant = gammaln((nu + m) / 2) - gammaln(nu / 2) - 0.5 * m * (np.log(nu) + LN_2PI - np.log(2))
    return np.asarray(constant - 0.5 * log_det - (nu + m) / 2 * np.log1p(q / nu))


def law_density(law: LawFit, priors: Priors, errors: Errors = "normal") -> LawDensity:
    """The density of a fitted law; edges have levels where ``priors`` has an ``icc``.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.bayes.priors import weak
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> density = law_density(law, weak(law, edges=True))
    >>> density.names
    ('level', 'V', 'f', 'd', 't', 'ln sd', 'logit icc')
    """
    if law.formula.fixed:
        names = ", ".join(name for name, _ in law.formula.fixed)
        raise FitError(
            f"{law.response}: draws are of laws whose exponents are all estimated, and {names} has a "
            "fixed one; see the intervals."
        )
    if not law.formula.linearisable:
        raise FitError(
            f"{law.response}: draws are of laws that are linear or log-linear in their coefficients, and additive wear "
            "is not; see the intervals, or fit.posterior_of_form(power law, 'additive in wear')."
        )
    edges = "icc" in priors.of
    Z, natural = law.design, law.error == "additive"
    y = law.observed if natural else np.log(law.observed)
    order, starts, sizes, labels = _units(law, edges)
    centre = np.concatenate([[0.0], Z[:, 1:].mean(axis=0)])
    start, spread = _normal_guess(law, centre, edges, errors)
    return LawDensity(
        law.formula, priors, errors, natural, (Z - centre)[order], y[order], centre,
        starts, sizes, labels, edges, law.theta_names, start, spread,
    )  # fmt: skip


def _units(law: LawFit, edges: bool) -> tuple[Ints, Ints, Array, Texts]:
    if not edges or law.edge is None:
        n = law.nobs
        return np.arange(n), np.arange(n), np.ones(n), law.lines.astype(object)
    names, number = np.unique(law.edge.astype(str), return_inverse=True)
    order = np.argsort(number, kind="stable")
    sizes = np.bincount(number)
    return order, np.concatenate([[0], np.cumsum(sizes)[:-1]]), sizes.astype(float), names.astype(object)


def _normal_guess(law: LawFit, centre: Array, edges: bool, errors: Errors) -> tuple[Array, Array]:
    """Estimates of the fit and their covariance, as start of samplers."""
    from ..edges import EdgeInference

    theta, df = law.theta.copy(), max(law.df_resid, 1)
    theta[0] += centre[1:] @ theta[1:]
    to_level = np.eye(len(theta))
    to_level[0, 1:] = centre[1:]
    cov = to_level @ law.covariance() @ to_level.T
    sd, icc = float(np.sqrt(law.rss / df)), 0.3
    if edges and isinstance(law.edges, EdgeInference):
        sd, icc = law.edges.mixed.sd_within, float(np.clip(law.edges.icc, 0.05, 0.95))
    more = ([np.log(icc / (1 - icc))] if edges else []) + ([np.log(10.0)] if errors == "student" else [])
    wide = [1 / (2 * df), *([1.0] if edges else []), *([1.0] if errors == "student" else [])]
    spread = np.zeros((len(theta) + len(wide),) * 2)
    spread[: len(theta), : len(theta)] = cov
    spread[len(theta) :, len(theta) :] = np.diag(wide)
    return np.array([*theta, np.log(sd), *more]), spread
