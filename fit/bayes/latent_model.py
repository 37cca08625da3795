"""Posterior density of wear and loads jointly: loads depend on the true wear, which is read with an error.

Rows i of edge g, all in logarithms, with ``x = ln w`` the true wear and laws k of the loads:

    x_i     = Z_w theta_w + u_g + e_i                       Var u, e: s_u^2, s_w^2
    ln AW_i = x_i + tau_i eps_i                             eps standard normal
    y_ki    = Z_k theta_k + b_k x_i + v_kg + f_ki           Var v_k, f_k: s_vk^2, s_k^2

True wear and levels are integrated out. Given its reading, the wear of a row has variance ``rho = s_w^2 tau^2 / S``,
with ``S = s_w^2 + tau^2`` and reliability ``l = s_w^2 / S``. With residuals r_w, r_k of the means, exponents b_k of the
wear, ``g_k = b_k / s_k`` and ``d_k = (r_k - l b_k r_w) / s_k``, whose covariance is ``I + rho g g'``, a row has

    q = r_w^2 / S + sum d_k^2 - rho (g'd)^2 / (1 + rho g'g),    ln det = ln S + sum ln s_k^2 + ln(1 + rho g'g),

which holds at tau = 0 as well. The levels (u, v_1 .. v_K) that rows of an edge share follow by Woodbury's identity.

The data determine the parameters of a plain fit, ``l b_k`` and ``theta_k + (1 - l) b_k theta_w``, far better than b_k:
these enter ``phi``, where the posterior is then close to normal. The same holds for the probit of an icc, whose
uniform prior is a standard normal. Where tau is unknown, ln S / 2 and logit l replace ln s_w and tau.

Sources: Fuller 1987, Measurement Error Models, section 2.2; Carroll et al. 2006, Measurement Error in Nonlinear Models,
chapters 8 and 9 (likelihood and Bayesian treatment of an unobserved regressor); Golub & Van Loan, Matrix Computations,
section 2.1 (Woodbury's identity).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ...core.arrays import Array, Ints
from ...core.display import Displayable
from .density import LN_2PI, NU, Errors, LawDensity, student


def rows_alone(
    r: list[Array], wear: Array, gauge: Array, sds: list[Array], slopes: list[Array]
) -> tuple[Array, Array, list[Array], list[list[Array]]]:
    """For each row: q, ln det, score and information of the levels (u, v_1 .. v_K), information (m, 1 or n)."""
    S = wear + gauge
    reliability, rho = wear / S, wear * gauge / S
    g = [b / s for b, s in zip(slopes, sds, strict=True)]
    norm = sum((x * x for x in g), np.zeros_like(wear))
    d = [(y - reliability * b * r[0]) / s for y, b, s in zip(r[1:], slopes, sds, strict=True)]
    p = sum((x * z for x, z in zip(g, d, strict=True)), np.zeros(1))
    left = 1 + rho * norm
    kappa = rho / left
    q = sum((z * z for z in d), r[0] * r[0] / S - kappa * p * p)
    log_det = np.log(S * left) + 2 * sum((np.log(s) for s in sds), np.zeros(1))
    share = (1 - reliability) / left
    scores = [r[0] / S + share * p, *((z - kappa * x * p) / s for z, x, s in zip(d, g, sds, strict=True))]
    K = len(g)
    info = [[1 / S + (1 - reliability) * share * norm, *(share * x / s for x, s in zip(g, sds, strict=True))]]
    info += [[(float(k == j) - kappa * g[k] * g[j]) / (sds[k] * sds[j]) for j in range(k, K)] for k in range(K)]
    return q, log_det, scores, info


def by_edge(part: Array, starts: Ints, sizes: Array) -> Array:
    """Sum over the rows of each edge, (m, n) -> (m, G), or (m, 1) times the number of its rows."""
    return np.asarray(part * sizes if part.shape[1] == 1 else np.add.reduceat(part, starts, axis=1))


def with_levels(
    q: Array, log_det: Array, scores: list[Array], info: list[list[Array]], sds: list[Array]
) -> tuple[Array, Array]:
    """Woodbury: q less h'F (I + F I F)^-1 F h, ln det of that added, F the diagonal of ``sds``; by elimination."""
    D = len(sds)
    h = [s * x for s, x in zip(sds, scores, strict=True)]
    M = [[sds[i] * sds[i + j] * x + (1.0 if j == 0 else 0.0) for j, x in enumerate(info[i])] for i in range(D)]
    for i in range(D):  # M[i][j] is the element (i, i + j) of what is left of a positive definite matrix
        q = q - h[i] ** 2 / M[i][0]
        log_det = log_det + np.log(M[i][0])
        for j in range(1, D - i):
            f = M[i][j] / M[i][0]
            h[i + j] = h[i + j] - f * h[i]
            for k in range(j, D - i):
                M[i + j][k - j] = M[i + j][k - j] - f * M[i][k]
    return q, log_det


@dataclass(frozen=True, slots=True, repr=False)
class LatentDensity(Displayable):
    """A joint posterior density of a law of wear and laws of loads, but for a constant.

    ``phi`` holds that of each law as in a plain fit, wear first, then the logit of the reliability where the
    gauge error has degrees of freedom, then ln nu of Student's errors (of all rows of an edge in common); ``model``
    turns it into the parameters of the laws of true wear (``LawDensity``) and ln of the gauge error over the given one.

    Attributes
    ----------
    laws : tuple of LawDensity
        Wear, then loads, on the same rows in the same order, with normal errors; they hold rows, priors and names.
    tau : ndarray, shape (n,) or (1,)
        Standard deviation of each row's reading, ln, or one for all.
    gauge_sd : float
        As given, in its unit, to which ``tau`` is proportional.
    gauge_df : float or None
        Degrees of freedom of its estimate; None where it is treated as known.
    start, spread
        As in ``Density``.
    """

    laws: tuple[LawDensity, ...]
    tau: Array
    gauge_sd: float
    gauge_df: float | None
    errors: Errors
    start: Array
    spread: Array
    place: tuple[slice, ...] = field(init=False)
    wear: tuple[int, ...] = field(init=False)
    Z: tuple[Array, ...] = field(init=False)

    def __post_init__(self) -> None:
        """Position of each law in ``phi``, and its columns without the measured wear."""
        ends = np.cumsum([0, *(len(law.names) for law in self.laws)])
        response = self.laws[0].law.response
        wear = tuple(law.theta_names.index(response) for law in self.laws[1:])
        columns = [self.laws[0].Z, *(law.Z.copy() for law in self.laws[1:])]
        for Z, j in zip(columns[1:], wear, strict=True):
            Z[:, j] = 0.0
        object.__setattr__(self, "place", tuple(slice(int(a), int(b)) for a, b in pairwise(ends)))
        object.__setattr__(self, "wear", wear)
        object.__setattr__(self, "Z", tuple(columns))

    @property
    def shares(self) -> list[int]:
        """Positions of the shares between edges in ``phi``."""
        return [at.stop - 1 for at in self.place] if self.edges else []

    @property
    def edges(self) -> bool:
        """Whether edges have random levels."""
        return self.laws[0].edges

    @property
    def units(self) -> tuple[str, ...]:
        """Edges, or rows, in the order of ``by_unit``."""
        return self.laws[0].units

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the elements of ``phi``, each with the response of its law: ``P: V as read``."""
        first, *loads = self.laws
        own = [f"{first.law.response}: {name}" for name in first.names]
        for law in loads:
            own += [f"{law.law.response}: {name}{' as read' if j < law.p else ''}" for j, name in enumerate(law.names)]
        own = [name.replace("logit icc", "probit icc") for name in own]
        gauge = ["logit reliability"] if self.gauge_df is not None else []
        return (*own, *gauge, *(["ln nu"] if self.errors == "student" else []))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters of the laws, then ``gauge sd`` and ``nu`` where they are unknown."""
        own = [f"{law.law.response}: {name}" for law in self.laws for name in law.parameter_names]
        gauge = ["gauge sd"] if self.gauge_df is not None else []
        return (*own, *gauge, *(["nu"] if self.errors == "student" else []))

    def model(self, phi: Array) -> Array:
        """Parameters of the laws of true wear, from those of plain fits, (m, p) -> (m, p)."""
        from scipy.special import log_ndtr

        out, first, x = phi.copy(), self.laws[0], self.place[-1].stop
        out[:, self.shares] = log_ndtr(phi[:, self.shares]) - log_ndtr(-phi[:, self.shares])
        tau2 = float(np.mean(self.tau**2))
        if self.gauge_df is not None:
            ln_reliability, ln_rest = -np.logaddexp(0, -phi[:, x]), -np.logaddexp(0, phi[:, x])
            out[:, first.p] += 0.5 * ln_reliability
            out[:, x] = phi[:, first.p] + 0.5 * ln_rest - 0.5 * np.log(tau2)
            odds = np.exp(-phi[:, x])
        else:
            odds = tau2 * np.exp(-2 * phi[:, first.p])
        for law, at, j in zip(self.laws[1:], self.place[1:], self.wear, strict=True):
            moved = phi[:, at.start + j] * odds
            out[:, at.start] -= moved * (phi[:, 0] - law.centre[j])
            for k, name in enumerate(first.theta_names[1:], start=1):
                if name in law.theta_names:
                    out[:, at.start + law.theta_names.index(name)] -= moved * phi[:, k]
            out[:, at.start + j] += moved
        return out

    def parameters(self, phi: Array) -> Array:
        """Parameters of the laws of true wear, (m, p) -> (m, q)."""
        phi = self.model(phi)
        own = [law.parameters(phi[:, at]) for law, at in zip(self.laws, self.place, strict=True)]
        more = np.exp(phi[:, self.place[-1].stop :])
        if self.gauge_df is not None:
            more[:, 0] *= self.gauge_sd
        return np.hstack([*own, more])

    def log_prior(self, phi: Array) -> Array:
        """Log prior with the derivative of ``phi``, (m, p) -> (m,): of each law its own, of the gauge chi-square."""
        from scipy.special import log_ndtr

        x, ln_sd = self.place[-1].stop, self.laws[0].p
        u = phi[:, self.shares]
        slope = (-0.5 * (u * u + LN_2PI) - log_ndtr(u) - log_ndtr(-u)).sum(axis=1)  # ln d logit / d probit
        read, phi = phi, self.model(phi)
        total = np.sum([law.log_prior(phi[:, at]) for law, at in zip(self.laws, self.place, strict=True)], axis=0)
        if self.gauge_df is not None:
            total = total - self.gauge_df * (phi[:, x] + 0.5 * np.exp(-2 * phi[:, x])) - np.log(2)
            inverse = np.logaddexp(0, -read[:, x])
        else:
            inverse = np.log1p(float(np.mean(self.tau**2)) * np.exp(-2 * phi[:, ln_sd]))
        total = total + slope + len(self.wear) * inverse  # ln 1 / l, for each exponent of wear
        if self.errors == "student":
            total = total + NU[0] * phi[:, -1] - NU[1] * np.exp(phi[:, -1])
        return np.asarray(total)

    def log_likelihood(self, phi: Array) -> Array:
        """Sum over edges, or rows, (m, p) -> (m,)."""
        return np.asarray(self.by_unit(phi).sum(axis=1))

    def by_unit(self, phi: Array) -> Array:
        """Log likelihood of all readings of each edge, or row, (m, p) -> (m, G)."""
        phi = self.model(phi)
        r = self.residuals(phi)
        law = self.laws[0]
        q, log_det, scores, info = rows_alone(r, *self._scales(phi))
        if self.edges:
            q, log_det = (by_edge(part, law.starts, law.sizes) for part in (q, log_det))
            scores = [by_edge(part, law.starts, law.sizes) for part in scores]
            info = [[by_edge(part, law.starts, law.sizes) for part in line] for line in info]
            q, log_det = with_levels(q, log_det, scores, info, self._level_sds(phi))
        size = len(self.laws) * law.sizes
        if self.errors == "student":
            return student(q, log_det, size, np.exp(phi[:, -1, None]))
        return np.asarray(-0.5 * (q + log_det + size * LN_2PI))

    def residuals(self, phi: Array) -> list[Array]:
        """Readings less their means given those of ``model`` alone, of wear and each load, (m, p) -> [(m, n), ...]."""
        first = self.laws[0]
        mean = phi[:, : first.p] @ self.Z[0].T
        out = [first.y - mean]
        for law, at, Z, j in zip(self.laws[1:], self.place[1:], self.Z[1:], self.wear, strict=True):
            theta = phi[:, at][:, : law.p]
            out.append(law.y - theta @ Z.T - theta[:, j, None] * (mean - law.centre[j]))
        return out

    def _scales(self, phi: Array) -> tuple[Array, Array, list[Array], list[Array]]:
        """Variance of the true wear about its level, of readings, sds of loads, exponents of wear, each (m, 1 or n)."""
        sds = [np.exp(phi[:, at.start + law.p, None]) for law, at in zip(self.laws, self.place, strict=True)]
        slopes = [phi[:, at.start + j, None] for at, j in zip(self.place[1:], self.wear, strict=True)]
        tau = self.tau[None, :]
        if self.gauge_df is not None:
            tau = tau * np.exp(phi[:, self.place[-1].stop, None])
        return sds[0] ** 2, tau**2, sds[1:], slopes

    def _level_sds(self, phi: Array) -> list[Array]:
        """Standard deviations of the edge levels of wear and each load, (m, 1)."""
        columns = [at.start + law.p for law, at in zip(self.laws, self.place, strict=True)]
        return [np.exp(phi[:, j, None] + 0.5 * phi[:, j + 1, None]) for j in columns]


def latent_density(
    laws: Sequence[LawDensity],
    tau: Array,
    gauge_sd: float,
    gauge_df: float | None = None,
    errors: Errors = "normal",
) -> LatentDensity:
    """Joint density of laws; it starts where they do, with the gauge error subtracted.

    Parameters
    ----------
    laws : sequence of LawDensity
        Wear, then loads with the wear among their factors, on the same rows in the same order.
    tau : ndarray, shape (n,) or (1,)
        Standard deviation of each reading of ln wear.
    gauge_sd, gauge_df, errors
        As in ``LatentDensity``.
    """
    from scipy.special import ndtri

    first = laws[0].start.copy()
    ln_sd, student_t = laws[0].p, errors == "student"
    scatter = np.exp(2 * first[ln_sd])
    true = max(scatter - float(np.mean(tau**2)), 0.1 * scatter)
    if gauge_df is None:
        first[ln_sd] = 0.5 * np.log(true)
    last = ([np.log(true / (scatter - true))] if gauge_df is not None else []) + ([np.log(10.0)] if student_t else [])
    more = ([0.5] if gauge_df is not None else []) + ([1.0] if student_t else [])
    start = np.concatenate([first, *(law.start for law in laws[1:]), last])
    spread = np.zeros((len(start), len(start)))
    end = 0
    shares = np.cumsum([len(law.names) for law in laws]) - 1 if laws[0].edges else np.array([], dtype=int)
    start[shares] = ndtri(1 / (1 + np.exp(-start[shares])))
    for block in (*(law.spread for law in laws), *(np.array([[v]]) for v in more)):
        spread[end : end + len(block), end : end + len(block)] = block
        end += len(block)
    return LatentDensity(tuple(laws), tau, gauge_sd, gauge_df, errors, start, spread)
