"""Time after which an edge is changed before it fails: age replacement.

An edge is changed at time t at the cost cp of a planned change, or when it fails before, at the cost cf. The cost per
minute in cut is

    g(t) = (cp R(t) + cf F(t)) / int_0^t R(u) du,

F the distribution of lives and R = 1 - F (Barlow & Hunter 1960, doi 10.1287/opre.8.1.90). It is least where
``h(t) int_0^t R - F(t) = cp / (cf - cp)``, h the hazard rate, if that cost is below that of running to failure.
"""

from dataclasses import dataclass
from math import exp, inf
from typing import Literal

import numpy as np

from ...core.arrays import Array
from ...core.display import Displayable
from ...core.errors import UsageError

Distribution = Literal["lognormal", "weibull"]
FINE = 4001  # times of the search, in logarithms
LOWEST, HIGHEST = 0.001, 20.0  # of the search, as multiples of the median life


@dataclass(frozen=True, slots=True, repr=False)
class ChangeInterval(Displayable):
    """Interval after which an edge is changed before it fails.

    Attributes
    ----------
    time : float
        min in cut; infinite where running to failure costs least.
    failed : float
        Share of edges that fail before.
    cost : float
        Per min in cut, of changes and failures.
    to_failure : float
        The same where every edge runs to failure.
    planned, failure : float
        Cost of a planned change and of a failure, with its change.

    Examples
    --------
    >>> median = 15.0 * 0.6931471805599453**0.25
    >>> found = change_interval("weibull", median=median, scale=0.25, planned=4.0, failure=12.0)
    >>> round(found.time, 3), round(found.cost, 4), round(found.to_failure, 4)
    (9.624, 0.5634, 0.8826)
    """

    time: float
    failed: float
    cost: float
    to_failure: float
    planned: float
    failure: float

    @property
    def planned_change(self) -> bool:
        """Whether a planned change costs less than running to failure."""
        return self.time < inf


def change_interval(
    distribution: Distribution, *, median: float, scale: float, planned: float, failure: float
) -> ChangeInterval:
    """The time of least cost per minute, after which an edge is changed.

    Parameters
    ----------
    distribution : {"lognormal", "weibull"}
    median : float
        Median life, min.
    scale : float
        Of ln T: standard deviation of a lognormal life, reciprocal shape of a Weibull one.
    planned, failure : float
        Cost of a planned change and of a failure, with its change.

    Raises
    ------
    UsageError
        A cost, the median or the scale is not above zero.
    """
    for name, value in (("median", median), ("scale", scale), ("planned", planned), ("failure", failure)):
        if not (0 < value < inf):
            raise UsageError(f"{name} {value:g}: give a number above zero.")
    mean = _mean(distribution, median, scale)
    always = failure / mean
    t = median * np.geomspace(LOWEST, HIGHEST, FINE)
    for _ in range(3):
        g, failed = _rate(distribution, t, median, scale, planned, failure)
        i = int(np.argmin(g))
        best, best_rate, share = float(t[i]), float(g[i]), float(failed[i])
        t = np.geomspace(t[max(i - 1, 0)], t[min(i + 1, len(t) - 1)], FINE)
    if failure <= planned or best_rate >= always * (1 - 1e-9) or share > 1 - 1e-9:
        return ChangeInterval(inf, 1.0, always, always, planned, failure)
    return ChangeInterval(best, share, best_rate, always, planned, failure)


def _rate(
    distribution: Distribution, t: Array, median: float, scale: float, planned: float, failure: float
) -> tuple[Array, Array]:
    """Cost per min of changes after each time, and the share of edges that fail before."""
    survival = _survival(distribution, t, median, scale)
    whole = _mean_until(distribution, t, median, scale)
    return np.asarray((planned * survival + failure * (1 - survival)) / whole), np.asarray(1 - survival)


def _survival(distribution: Distribution, t: Array, median: float, scale: float) -> Array:
    from scipy.special import ndtr

    z = np.log(t / median) / scale
    return np.asarray(np.exp2(-np.exp(z)) if distribution == "weibull" else ndtr(-z))


def _mean(distribution: Distribution, median: float, scale: float) -> float:
    from scipy.special import gamma

    if distribution == "weibull":
        return float(median * np.log(2) ** -scale * gamma(1 + scale))
    return float(median * exp(scale**2 / 2))


def _mean_until(distribution: Distribution, t: Array, median: float, scale: float) -> Array:
    """``int_0^t R``, the mean time in cut of an edge that is changed at t at the latest, in closed form."""
    from scipy.special import gammainc, ndtr

    z, mean = np.log(t / median) / scale, _mean(distribution, median, scale)
    if distribution == "weibull":  # int_0^t exp(-(u/b)^k) du = mean P(1/k, (t/b)^k)
        return np.asarray(mean * gammainc(scale, np.log(2) * np.exp(z)))
    return np.asarray(mean * ndtr(z - scale) + t * ndtr(-z))
