"""The posterior density of a power law whose edges each have a time exponent of their own, about a common one.

In logarithms, rows i of edge g: ``y_i = Z_i theta + v_g + u_g x_i + e_i`` with x = ln t about its mean. Level v and
exponent u of an edge are normal about 0, with standard deviations and a correlation, and are integrated out: with
``(v, u) = sd L z``, z standard normal, and columns ``W = (1, x) L``,

    q = [ r'r - r'W (I + W'W)^-1 W'r ] / sd^2,    ln det = 2 m ln sd + ln det(I + W'W).

Source: Pinheiro & Bates 2000, Mixed-Effects Models in S and S-PLUS, section 2.2.
"""

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks.slopes import TIME
from .law_density import LN_2PI, LawDensity, law_density
from .priors import DF, HalfT, weak

if TYPE_CHECKING:
    from ..lawfit import LawFit

Array = NDArray[np.float64]

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
        """Of ``phi``."""
        return (*LawDensity.names.__get__(self), "ln sd of u", "atanh correlation")

    @property
    def told_names(self) -> tuple[str, ...]:
        """As the law calls its parameters, then sd, icc, sd of u and its correlation with the level."""
        return (*LawDensity.told_names.__get__(self), "sd of u", "correlation")

    def told(self, phi: Array) -> Array:
        """Parameters as they are told, (m, p) -> (m, q)."""
        out = LawDensity.told(self, phi)
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


def edge_slopes(law: "LawFit") -> EdgeSlopes:
    """The density of a power law in logarithms with edge levels and edge time exponents, normal errors.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> edge_slopes(law).told_names[-4:]
    ('sd', 'icc', 'sd of u', 'correlation')
    """
    base = law_density(law, weak(law, edges=True))
    held = {field.name: getattr(base, field.name) for field in fields(base)}
    q = len(base.start)
    spread = np.diag(np.r_[np.zeros(q), 0.5, 0.5])
    spread[:q, :q] = base.spread
    held |= {"start": np.r_[base.start, np.log(0.1), 0.0], "spread": spread}
    return EdgeSlopes(**held, time=base.Z[:, law.theta_names.index(TIME)])
