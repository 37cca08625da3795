"""Scatter between edges and wander within them: estimated from the sums of a parameter file, otherwise assumed.

From the sums of a law by edge follow, at the law's own coefficients, the mean residual of each edge and the slope of
its residuals on ln t. The variance of the slopes beyond that of their errors is that of the time exponents (DerSimonian
& Laird 1986, Controlled Clinical Trials 7, 177); the correlation of the mean residuals of two laws is that of the
levels of an edge, shrunk towards 0 by its standard error.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import exp, isfinite, pi
from typing import TYPE_CHECKING

import numpy as np

from ..core.arrays import Array, is_positive
from ..core.errors import UsageError

if TYPE_CHECKING:
    from ..parameters import LawSection
    from ..parameters.sections.edge_sums import EdgeSumsSection

FEWEST_EDGES = 5  # from which scatter between edges is estimated
EXPONENT_SHARE = 0.1  # of the time exponent, where it is not estimated
LEAST_SHARE, LEAST_WANDER = 0.05, 0.02  # of the time exponent, and of wear: few rows do not show that there is none
WANDER_SHARE = 0.25  # of the variance within edges, where the correlation in time is not known
SPACING = 2.0  # spacings of rows, over which wear and loads are taken to wander
LARGEST_CORRELATION = 0.95
ORDER = "order within edges"  # the check of the lag-1 correlation


@dataclass(frozen=True, slots=True)
class Wander:
    """Slow random deviation of a logarithm: an Ornstein-Uhlenbeck process in the time of contact.

    Attributes
    ----------
    sd : float
        Standard deviation of the logarithm.
    minutes : float
        Time after which its correlation has fallen to 1/e, min of contact.

    Examples
    --------
    >>> round(Wander(0.02, 1.0).kept(1.0), 3)
    0.368
    """

    sd: float
    minutes: float

    def __post_init__(self) -> None:
        if not (self.sd >= 0 and isfinite(self.sd) and is_positive(self.minutes)):
            raise UsageError(f"wander of {self.sd:g} over {self.minutes:g} min: give 0 or more, and a time above zero.")

    def kept(self, minutes: float) -> float:
        """Share of the deviation that is left after a time of contact."""
        return exp(-minutes / self.minutes)

    def highest(self, growth: Array) -> Array:
        """Mean of the highest value so far of this deviation plus a rising trend, less that trend now, shape (R,).

        With the trend in standard deviations per correlation time, g, the highest value is below x standard deviations
        with probability Phi(x) exp(-phi(x) / (g Phi(x))): the rate of first passages of Durbin (1985, Journal of
        Applied Probability 22, 99), in clumps (Aldous 1989, Probability Approximations via the Poisson Clumping
        Heuristic). Within .13 standard deviations of simulated ones.

        Parameters
        ----------
        growth : ndarray, shape (R,)
            Slope of the trend, 1/min.
        """
        if self.sd == 0:
            return np.zeros(len(growth))
        slopes, means = _highest()
        return self.sd * np.interp(np.log(np.maximum(growth, 1e-300) * self.minutes / self.sd), slopes, means)

    @property
    def words(self) -> str:
        """Its numbers."""
        return f"{100 * self.sd:.2g} % over {self.minutes:.2g} min"


@cache
def _highest() -> tuple[Array, Array]:
    """Mean of the highest value of a standard wander plus a trend, over the logarithm of the slope of the trend."""
    from scipy.special import log_ndtr

    x, slopes = np.linspace(-6.0, 9.0, 1501), np.linspace(np.log(0.01), np.log(100.0), 60)
    ln_Phi = log_ndtr(x)
    passages = np.exp(-x * x / 2 - ln_Phi) / (2 * pi) ** 0.5
    below = np.exp(ln_Phi - passages * np.exp(-slopes)[:, None])
    return slopes, np.trapezoid(1 - below, x, axis=1) + x[0]


FAST = Wander(0.01, 1.0)  # least wander of a load within minutes


@dataclass(frozen=True, slots=True)
class Assumptions:
    """Values that replace those estimated from a parameter file; None: estimated, or the usual value.

    Attributes
    ----------
    exponent_share : float or None
        Standard deviation between edges of the time exponent, as a share of the exponent.
    wear_wander : Wander or None
        Of ln wear about the curve of its edge.
    load_wander : Wander or None
        Of each ln load about its law at that wear.
    level_correlation : float or None
        Between the level of an edge in wear and in each load.
    """

    exponent_share: float | None = None
    wear_wander: Wander | None = None
    load_wander: Wander | None = None
    level_correlation: float | None = None


@dataclass(frozen=True, slots=True)
class EdgeScatter:
    """Scatter of edges about their laws.

    Attributes
    ----------
    exponent_sd : float
        Standard deviation between edges of the time exponent of wear.
    wear_wander : Wander
    load_wander : mapping of Wander
        Slow wander of each load, over minutes.
    load_rest : mapping of Wander
        The rest of its scatter within edges, taken as a fast wander until windows show how large it is.
    correlation : ndarray, shape (1 + k, 1 + k)
        Of the levels of an edge in wear and k loads.
    notes : tuple of str
        Each number, and whether it was estimated or assumed.
    """

    exponent_sd: float
    wear_wander: Wander
    load_wander: Mapping[str, Wander]
    load_rest: Mapping[str, Wander]
    correlation: Array
    notes: tuple[str, ...] = ()


def scatter_of_edges(
    wear: "LawSection", loads: Sequence["LawSection"], exponent: float, given: Assumptions
) -> EdgeScatter:
    """Scatter of edges about the laws of a file.

    Parameters
    ----------
    wear, loads : LawSection
        Laws of wear and of loads.
    exponent : float
        Time exponent of the wear law.
    given : Assumptions
        What is not estimated.
    """
    sd, words = _exponent(wear, exponent, given)
    wander, _, how = _wander(wear, given.wear_wander, LEAST_WANDER)
    slow, rest, notes = {}, {}, [words, how]
    for law in loads:
        slow[law.response], left, how = _wander(law, given.load_wander)
        rest[law.response] = Wander(max(left, FAST.sd), FAST.minutes)
        notes.append(how)
    correlation, between = _correlation(wear, loads, given)
    return EdgeScatter(sd, wander, slow, rest, correlation, (*notes, *between))


def _exponent(wear: "LawSection", exponent: float, given: Assumptions) -> tuple[float, str]:
    """Standard deviation of the time exponent between edges, and where it comes from."""
    what = "sd of the time exponent between edges"
    if given.exponent_share is not None:
        return given.exponent_share * exponent, f"given: {what} {100 * given.exponent_share:.2g} % of it"
    found = slope_variance(wear, "t")
    if found is None:
        sd = EXPONENT_SHARE * exponent
        return sd, f"assumed: {what} {100 * EXPONENT_SHARE:g} % of it, as the file has no sums by edge"
    variance, se, edges = found
    sd = max(above_zero(variance, se) ** 0.5, LEAST_SHARE * exponent)
    least = f"at least {100 * LEAST_SHARE:g} % is taken"
    return sd, f"estimated from {edges} edges: {what} {sd:.2g} ({100 * sd / exponent:.2g} % of it; {least})"


def slope_variance(law: "LawSection", symbol: str) -> tuple[float, float, int] | None:
    """Variance between edges of the exponent of a factor, its standard error, and the number of edges.

    The estimate may be below 0 by chance. None where the file has no sums, or too few edges.
    """
    rows = [(one.rows, *sums) for one in law.sums.edges if (sums := _within(law, one, symbol))] if law.sums else []
    rows = [row for row in rows if row[0] > 2]
    if len(rows) < FEWEST_EDGES:
        return None
    n, Sxx, Sxe, See = np.array(rows, dtype=float).T
    slopes = Sxe / Sxx
    error = np.maximum(See - Sxe * slopes, 0.0).sum() / (n - 2).sum()
    mean = (Sxx * slopes).sum() / Sxx.sum()
    spread, G = float((Sxx * (slopes - mean) ** 2).sum()), len(rows)
    free = float(Sxx.sum() - (Sxx**2).sum() / Sxx.sum())
    variance = (spread - (G - 1) * error) / free
    return variance, float((2 / (G - 1)) ** 0.5 * (max(variance, 0.0) + (G - 1) * error / free)), G


def above_zero(value: float, se: float) -> float:
    """Mean of a quantity that is not below 0, given its normal estimate: what is estimated as 0 need not be 0.

    >>> round(above_zero(0.0, 1.0), 3), round(above_zero(5.0, 1.0), 3)
    (0.399, 5.0)
    """
    from scipy.special import ndtr

    z = value / se if se > 0 else 0.0
    return float(value * ndtr(z) + se * exp(-z * z / 2) / (2 * pi) ** 0.5) if se > 0 else max(value, 0.0)


def _within(law: "LawSection", one: "EdgeSumsSection", symbol: str) -> tuple[float, float, float] | None:
    """Sums of squares of a factor, of its products with the residuals, and of the residuals, within one edge."""
    columns = law.sums.columns if law.sums else ()
    place = columns.index(symbol) if symbol in columns else -1
    if place not in one.moves or not one.root:
        return None
    R = np.zeros((len(one.root), len(one.moves)))
    for i, row in enumerate(one.root):
        R[i, i:] = row
    x, e = R[:, one.moves.index(place)], R @ _residual_weights(law)[list(one.moves)]
    return (float(x @ x), float(x @ e), float(e @ e)) if x @ x > 0 else None


def _residual_weights(law: "LawSection") -> Array:
    """Weights of the columns of the sums, whose product with a row is its residual but for the constant."""
    return np.append(-law.theta[1:], 1.0)


def _wander(law: "LawSection", given: Wander | None, least: float = 0.0) -> tuple[Wander, float, str]:
    """Slow wander about a law, which is that scatter within edges correlated from row to row; and the other scatter."""
    name = law.response
    if given is not None:
        return given, 0.0, f"given: {name} wanders by {given.words}"
    e = law.edges
    within = e.sd_within if e is not None and e.sd_within is not None else law.residual_se or 0.0
    if law.error == "additive":
        within = within / typical_response(law)
    rows = e.rows_per_edge if e is not None and e.rows_per_edge else 2.0
    times = next(((f.low, f.high) for f in law.factors if f.symbol == "t"), (0.0, 10.0))
    minutes = SPACING * max(times[1] - times[0], 0.1) / max(rows - 1, 1.0)
    check = law.checks.get(ORDER)
    if check is None or check.statistic is None or e is None or not e.df_within:
        share, how = WANDER_SHARE, f"assumed, {100 * WANDER_SHARE:g} % of the variance within edges"
    else:  # the correlation one spacing apart, and from it the share at no distance
        lag, how = above_zero(check.statistic, 1.0) / e.df_within**0.5, "estimated from the correlation of rows"
        share = min(lag * exp(1 / SPACING), 1.0)
    wander = Wander(max(within * share**0.5, least), minutes)
    taken = f" (at least {100 * least:g} % is taken)" if least else ""
    return wander, within * (1 - share) ** 0.5, f"{how}: {name} wanders by {wander.words}{taken}"


def typical_response(law: "LawSection") -> float:
    """The response at the middle of the tests."""
    middle = [(f.low * f.high) ** 0.5 if f.low > 0 else (f.low + f.high) / 2 for f in law.factors]
    columns = np.append(law.formula.columns(np.array(middle)), np.zeros(len(law.by.shifts) if law.by else 0))
    return float(law.formula.response_of(law.theta, columns))


def _correlation(
    wear: "LawSection", loads: Sequence["LawSection"], given: Assumptions
) -> tuple[Array, tuple[str, ...]]:
    """Correlation matrix of the levels of an edge, and where it comes from."""
    laws, found, notes = (wear, *loads), np.eye(1 + len(loads)), []
    for i, one in enumerate(laws):
        for j in range(i + 1, len(laws)):
            other, r = laws[j], level_correlation(one, laws[j])
            named = f"correlation of the levels of an edge in {one.response} and {other.response}"
            if given.level_correlation is not None and i == 0:
                r, how = given.level_correlation, f"given: {named} {given.level_correlation:.2g}"
            elif r is None:
                r, how = 0.0, f"assumed: {named} 0"
            else:
                how = f"estimated: {named} {r:.2g}"
            found[i, j] = found[j, i] = float(np.clip(r, -LARGEST_CORRELATION, LARGEST_CORRELATION))
            notes.append(how)
    values, vectors = np.linalg.eigh(found)
    near = (vectors * np.maximum(values, 1e-3)) @ vectors.T
    size = np.sqrt(np.diag(near))
    return near / size / size[:, None], tuple(notes)


def level_correlation(one: "LawSection", other: "LawSection") -> float | None:
    """Correlation of the levels of an edge in two laws, shrunk towards 0 by its standard error; None where unknown."""
    means = [_edge_means(law) for law in (one, other)]
    names = sorted(set(means[0]) & set(means[1]))
    scatter = [law.edges.sd_between if law.edges is not None else None for law in (one, other)]
    free = len(names) - max(len(one.factors), len(other.factors))
    if free < FEWEST_EDGES or not all(scatter):
        return None
    a, b = (np.array([of[name] for name in names]) for of in means)
    r = float(np.corrcoef(a, b)[0, 1])
    doubt = (1 - r * r) ** 2 / free
    return max(1.0 - doubt / (r * r), 0.0) * r + 0.0 if r else 0.0  # not -0


def _edge_means(law: "LawSection") -> Mapping[str, float]:
    """Mean residual of each edge."""
    if law.sums is None:
        return {}
    weights = _residual_weights(law)
    return {one.edge: float(np.array(one.mean) @ weights - law.theta[0]) for one in law.sums.edges if one.edge}
