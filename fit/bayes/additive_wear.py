"""The posterior density of the rival form in which wear adds: ``R = c0 prod X_j^b_j + k AW``, k > 0.

Errors are those of the law: they multiply (residuals in ln R) or add (in the unit of R); levels of edges as in
``LawDensity``. ``k`` stands in ``phi`` as the logarithm of what the mean wear adds, over the middle response, so that

    eta = ln(exp(Z theta) + exp(ln share) R_mid AW / AW_mean).

Source of the form: CLM-2023 eq. 14 (load additive in wear); Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .law_density import Errors, LawDensity, law_density
from .priors import Normal, weak

if TYPE_CHECKING:
    from ..checks.rivals import FittedForm
    from ..lawfit import LawFit

Array = NDArray[np.float64]

SHARE = "ln share"
USUAL_SHARE = Normal(float(np.log(0.3)), 1.5)  # 95 % of it between 0.016 and 5.7 of the middle response
LEAST_SHARE = 1e-3  # to start from
SPREAD = 0.25  # of ln share, to start from


@dataclass(frozen=True, slots=True, repr=False)
class AdditiveWear(LawDensity):
    """A law with wear added, its last column ln of what share 1 adds, in the unit of the response.

    Attributes
    ----------
    per_share : float
        k over share, in the unit of the response over that of the wear.
    """

    per_share: float

    @property
    def names(self) -> tuple[str, ...]:
        """Of ``phi``."""
        return tuple(SHARE if name == "k" else name for name in LawDensity.names.__get__(self))

    def told(self, phi: Array) -> Array:
        """Parameters as they are told, ``k`` after the exponents, (m, p) -> (m, q)."""
        out = LawDensity.told(self, phi)
        out[:, self.p - 1] = self.per_share * np.exp(phi[:, self.p - 1])
        return out

    def residuals(self, phi: Array) -> Array:
        """Of every row on the scale of the errors, (m, p) -> (m, n)."""
        last = self.p - 1
        eta = np.logaddexp(phi[:, :last] @ self.Z[:, :last].T, phi[:, last, None] + self.Z[:, last])
        return np.asarray(self.y - (np.exp(eta) if self.natural else eta))


def additive_wear(law: "LawFit", fitted: "FittedForm", edges: bool, errors: Errors = "normal") -> AdditiveWear:
    """The density of a power law's rival in which wear adds.

    Parameters
    ----------
    law : LawFit
        The power law, wear among its factors.
    fitted : FittedForm
        The rival as least squares in ln R fits it, to start from.
    edges : bool
        Whether edges have levels of their own.
    errors : {"normal", "student"}

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.checks.rivals import rival_makers
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> law = fit.power_law(runs, "P", ["V", "f", "d", "t", "AW"])
    >>> name, make = rival_makers(law)[1]
    >>> additive_wear(law, make(law), edges=True).told_names
    ('ln c0', 'V', 'f', 'd', 't', 'k', 'sd', 'icc')
    """
    wear = next(name for name in law.factors if name not in fitted.coefficients)
    j = law.theta_names.index(wear)
    priors = weak(law, edges)
    base = law_density(law, priors, errors)
    AW = np.exp(base.Z[:, j] + base.centre[j])
    middle = float(np.exp(np.log(law.observed).mean()))
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
    return AdditiveWear(
        base.law, replace(priors, of=of), errors, base.natural,
        np.column_stack([base.Z[:, others], np.log(per_share * AW)]), base.y, centre,
        base.starts, base.sizes, base.labels, edges, names, np.r_[theta, base.start[base.p :]], spread, per_share,
    )  # fmt: skip
