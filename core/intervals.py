"""Half-widths of mean, prediction and tolerance intervals from variances and degrees of freedom.

A fitted law has these numbers from its rows, a parameter file from its sections; both use these functions, so that
the file gives the same intervals as the fit.

Sources: Wallis 1951, Proc. 2nd Berkeley Symposium, 43, and Krishnamoorthy & Mathew 2009, Statistical Tolerance
Regions, sections 1.2 and 3.3 (tolerance in regression); Mee 1984, Technometrics 26, 251 (with a random level);
Zhou & Gao 1997, Statistics in Medicine 16, 783 (Cox's interval of a lognormal mean).
"""

from dataclasses import dataclass
from math import gamma, inf, log
from typing import Literal

import numpy as np

from .arrays import Array
from .censored import Distribution, standard_deviation, standard_quantile

Kind = Literal["mean", "prediction", "tolerance"]
Edge = Literal["new", "same"]
Centre = Literal["median", "mean", "smeared"]

KNOWN_LEVEL = "an edge whose own level is known and is the value"

# Quadrature over a standard normal: beyond 6.5 of its deviations lies 1e-10, and 48 nodes keep ten digits.
FARTHEST, NODES = 6.5, 48


def t_quantile(df: float, level: float = 0.95) -> float:
    """Quantile of Student's t for a two-sided interval, on one degree of freedom at least.

    >>> round(t_quantile(23), 3), t_quantile(0) == t_quantile(1)
    (2.069, True)
    """
    from scipy.special import stdtrit

    return float(stdtrit(max(df, 1), (1 + level) / 2))


@dataclass(frozen=True, slots=True)
class Scatter:
    """Standard deviation of single rows about their law, on the scale of its errors.

    Attributes
    ----------
    sd : float
        Standard deviation of a row.
    parts : tuple of (float, float)
        Mean squares that ``sd^2`` is the sum of, each with its degrees of freedom.
    distribution : {"lognormal", "weibull"}
        Of multiplicative errors; that of a Weibull life reaches farther below its median than above.

    Examples
    --------
    >>> Scatter(0.1, ((0.01, 19.0),)).df
    19.0
    """

    sd: float
    parts: tuple[tuple[float, float], ...]
    distribution: Distribution = "lognormal"

    def sides(self, share: float) -> tuple["Scatter", "Scatter"]:
        """Normal scatters whose quantiles at ``(1 - share)/2`` and ``(1 + share)/2`` are those of the distribution."""
        if self.distribution == "lognormal":
            return self, self
        median, scale = standard_quantile(self.distribution, 0.5), self.sd / standard_deviation(self.distribution, 1.0)
        ratios = [
            scale * abs(standard_quantile(self.distribution, p) - median) / abs(standard_quantile("lognormal", p))
            for p in ((1 - share) / 2, (1 + share) / 2)
        ]
        low, high = (one_component(ratio, self.df) for ratio in ratios)
        return low, high

    @property
    def df(self) -> float:
        """Degrees of freedom of ``sd`` (Satterthwaite)."""
        total = sum(part for part, _ in self.parts)
        return total * total / sum(part * part / df for part, df in self.parts) if total > 0 else self.parts[0][1]

    def df_bound(self, level: float) -> float:
        """Degrees of freedom at which chi-square bounds ``sd`` from above as the modified large-sample bound does.

        Satterthwaite's take the estimated split as the true one and are too many where edges were alike by
        luck; the bound of Graybill & Wang 1980, J. Am. Stat. Assoc. 75, 869, keeps its level.
        """
        from scipy.optimize import brentq
        from scipy.special import chdtri

        total = sum(part for part, _ in self.parts)
        if len(self.parts) == 1 or total <= 0:
            return self.parts[0][1]
        wide = sum((part * (df / chdtri(df, level) - 1)) ** 2 for part, df in self.parts) ** 0.5 / total
        low, high = min(df for _, df in self.parts), sum(df for _, df in self.parts)

        def excess(df: float) -> float:
            return float(df / chdtri(df, level) - 1 - wide)

        return float(brentq(excess, low, high)) if excess(low) > 0 > excess(high) else low


def one_component(sd: float, df: float, distribution: Distribution = "lognormal") -> Scatter:
    """Scatter of independent rows, or of rows within an edge."""
    return Scatter(sd, ((sd * sd, df),), distribution)  # sd**2 of a number that a file holds by mistake may raise


def between_and_within(
    sd_between: float, sd_within: float, rows_per_edge: float, df_between: float, df_within: float
) -> Scatter:
    """Scatter of a row of a new edge: its variance is ``MS_between / m + (1 - 1/m) MS_within``.

    m is the harmonic mean of the rows an edge has.

    Examples
    --------
    >>> both = between_and_within(0.3, 0.4, 5.0, 20.0, 99.0)
    >>> round(both.sd, 6), round(sum(part for part, _ in both.parts), 6)
    (0.5, 0.25)
    """
    inner = sd_within * sd_within
    parts = (sd_between * sd_between + inner / rows_per_edge, df_between), ((1 - 1 / rows_per_edge) * inner, df_within)
    return Scatter(float(np.hypot(sd_between, sd_within)), parts)


def half_width(
    kind: Kind,
    variance: Array,
    df: float,
    scatter: Scatter,
    *,
    level: float,
    coverage: float = 0.95,
    factor_variance: float = 0.0,
) -> Array:
    """Half width of an interval on the scale of the errors, in the shape of ``variance``.

    Parameters
    ----------
    kind : {"mean", "prediction", "tolerance"}
    variance : ndarray
        Variance with which the centre is known, its t with ``df`` degrees of freedom.
    scatter : Scatter
        Of the rows; its parts are needed for "tolerance" alone.
    level, coverage : float
        Between 0 and 1.
    factor_variance : float
        Variance of the factor from the median to the mean, of :func:`log_mean_variance`.

    Examples
    --------
    >>> rows = one_component(0.1, 10.0)
    >>> [half_width(kind, np.array(0.0), 10.0, rows, level=0.95).round(3).item() for kind in ("prediction", "mean")]
    [0.223, 0.0]
    """
    from scipy.special import stdtrit

    variance = np.maximum(variance, 0.0)
    if kind == "tolerance":
        ratio = variance / (scatter.sd * scatter.sd) if scatter.sd > 0 else np.zeros_like(variance)
        k = tolerance_factor(np.ravel(ratio), scatter.df_bound(level), coverage, level)
        return np.reshape(k, np.shape(ratio)) * scatter.sd
    more = scatter.sd * scatter.sd if kind == "prediction" else factor_variance
    return np.asarray(stdtrit(df, (1 + level) / 2) * np.sqrt(variance + more), dtype=float)


def value_and_ends(
    kind: Kind,
    median: Array,
    variance: Array,
    df: float,
    scatter: Scatter,
    *,
    level: float,
    coverage: float,
    centre: Centre,
    smearing: float,
    multiplies: bool,
) -> tuple[Array, Array, Array]:
    """Value and ends of an interval in the unit of the response; a mean interval moves with the centre.

    Parameters
    ----------
    kind, variance, df, scatter, level, coverage
        As for :func:`half_width`.
    median : ndarray
        Of the law, in the unit of the response.
    centre : {"median", "mean", "smeared"}
        Quantity that the value estimates; of additive errors it is the mean.
    smearing : float
        Mean of exp(residual), used where the centre is smeared.
    multiplies : bool
        Whether errors are multiplicative.
    """
    if not multiplies:
        half = half_width(kind, variance, df, scatter, level=level, coverage=coverage)
        return median, median - half, median + half
    factor_variance = log_mean_variance(scatter) if kind == "mean" and centre != "median" else 0.0
    down, up = (
        half_width(kind, variance, df, side, level=level, coverage=coverage, factor_variance=factor_variance)
        for side in scatter.sides(coverage if kind == "tolerance" else level)
    )
    value = median * centre_factor(centre, scatter, smearing)
    middle = value if kind == "mean" else median
    return value, middle * np.exp(-down), middle * np.exp(up)


def centre_factor(centre: Centre, scatter: Scatter, smearing: float) -> float:
    """Factor from the median to the requested centre, for multiplicative errors.

    ``smearing`` is the mean of exp(residual): Duan 1983, J. Am. Stat. Assoc. 78, 605.
    """
    if centre == "smeared":
        return smearing
    if centre == "median":
        return 1.0
    if scatter.distribution == "weibull":
        scale = scatter.sd / standard_deviation("weibull", 1.0)
        return float(gamma(1 + scale) / log(2) ** scale)
    return float(np.exp(scatter.sd * scatter.sd / 2))


def log_mean_variance(scatter: Scatter) -> float:
    """Variance of the logarithm of the factor from the median to the mean (Cox)."""
    square = scatter.sd * scatter.sd
    return square * square / (2 * (scatter.df + 2))


@dataclass(frozen=True, slots=True)
class Root:
    """Estimate of u in ``a + b u = 0`` and its interval, whose ends are infinite where it is not bounded.

    ``g`` is the squared half width of the interval of b over b squared: from 1 on, b may be zero and an end is open.
    """

    value: float
    low: float
    high: float
    g: float


def unknown_scatter(
    between: float | None, rows: float | None, n: int, edges: int | None, reason: str | None = None
) -> str:
    """Reason why the scatter of new edges about a law is not known; empty where it is.

    Rows that name no edges, or each an edge of its own, scatter about their law as edges do. Several rows of an edge do
    not: what they scatter says nothing of the next edge.

    Parameters
    ----------
    between, rows : float or None
        Standard deviations between edges, and of rows about the law; 0 of a law that meets every row.
    n, edges : int, and int or None
        Number of rows, and of edges that they name.
    reason : str, optional
        Why there is none between edges.

    Examples
    --------
    >>> unknown_scatter(None, 0.1, 9, 1, "1 edge"), unknown_scatter(None, 0.1, 9, None)
    ('the scatter between edges is not known (1 edge)', '')
    """
    if between is not None or rows == 0 or edges is None or edges >= n:
        return ""
    return f"the scatter between edges is not known{f' ({reason})' if reason else ''}"


def edge_words(unknown: str, *, known: bool) -> str:
    """Whose life an interval holds: of one new edge, not bounded for a reason, or of one row where no edge is named.

    >>> edge_words("", known=True), edge_words("", known=False)
    ('one new edge', 'one row')
    """
    return f"one new edge, not bounded since {unknown}" if unknown else "one new edge" if known else "one row"


def fieller(a: float, b: float, covariance: tuple[float, float, float], quantile: float) -> Root:
    """Interval of the root u of ``a + b u = 0`` for normal a and b (Fieller 1954, J. R. Statist. Soc. B 16, 175).

    Parameters
    ----------
    a, b : float
        Estimates; b is not zero.
    covariance : (float, float, float)
        Variance of a, covariance of a and b, variance of b.
    quantile : float
        Of Student's t.

    Examples
    --------
    >>> found = fieller(-2.0, 1.0, (0.01, 0.0, 0.01), 2.0)
    >>> round(found.value, 6), round(found.low, 4), round(found.high, 4), round(found.g, 4)
    (2.0, 1.6194, 2.5473, 0.04)
    """
    aa, ab, bb = (quantile * quantile * value for value in covariance)
    value, g = -a / b, bb / (b * b)
    quadratic, linear, constant = b * b - bb, a * b - ab, a * a - aa
    inner = linear * linear - quadratic * constant
    if quadratic > 0:
        half = max(inner, 0.0) ** 0.5 / quadratic
        return Root(value, -linear / quadratic - half, -linear / quadratic + half, g)
    if inner <= 0 or quadratic == 0:
        return Root(value, -inf, inf, g)
    ends = sorted((-linear + sign * inner**0.5) / quadratic for sign in (-1, 1))
    return Root(value, -inf, ends[0], g) if value <= ends[0] else Root(value, ends[1], inf, g)


def solved_for(
    theta: Array, covariance: Array, z: Array, at: int, target: float, quantile: float, extra: float = 0.0
) -> Root:
    """Value u of column ``at`` with which the linear predictor ``z theta + u theta[at]`` reaches a target.

    Parameters
    ----------
    theta, covariance : ndarray, shape (p,) and (p, p)
    z : ndarray, shape (p,)
        The other columns, with 0 at ``at``.
    target, quantile : float
        Of the predictor, and of Student's t.
    extra : float
        Variance of the predictor about the law, that of a new edge.

    Examples
    --------
    >>> found = solved_for(np.array([1.0, 2.0]), np.diag([0.0, 0.01]), np.array([1.0, 0.0]), 1, 3.0, 2.0)
    >>> round(found.value, 6), round(found.low, 4), round(found.high, 4)
    (1.0, 0.9091, 1.1111)
    """
    row = covariance[at]
    moments = (float(z @ covariance @ z) + extra, float(z @ row), float(row[at]))
    return fieller(float(z @ theta) - target, float(theta[at]), moments, quantile)


def interval_label(kind: Kind, level: float, coverage: float, edge: str | None, row: str = "row") -> str:
    """Description of an interval; ``edge`` names its edge, None where rows are independent; a row may be a life.

    Examples
    --------
    >>> interval_label("tolerance", 0.9, 0.95, "a new edge")
    '90 % tolerance interval for 95 % of rows of a new edge'
    """
    of_edge = "" if edge is None else f" of {edge}"
    of = {
        "mean": "the law" if edge in (None, "a new edge") else f"the law at the level of {edge}",
        "prediction": f"one {row}{of_edge}",
        "tolerance": f"{100 * coverage:.4g} % of {'lives' if row == 'life' else f'{row}s'}{of_edge}",
    }[kind]
    return f"{100 * level:.4g} % {kind} interval for {of}"


def tolerance_factor(ratio: Array, df: float, coverage: float, level: float) -> Array:
    """Standard deviations either side that hold ``coverage`` of a normal population with confidence ``level``.

    With the centre off by ``sqrt(ratio) z`` standard deviations, k of them hold the share where ``k^2 s^2 >= q(z)``,
    the coverage quantile of a chi-square with 1 degree of freedom and non-centrality ``ratio z^2``; k solves
    ``E_z P(chi2_df >= df q(z) / k^2) = level``, by quadrature over z and Newton's method on ln k.

    Parameters
    ----------
    ratio : ndarray, shape (n,)
        Variance with which the centre is known over that of the population, ``1/n`` for a mean of n.
    df : float
        Degrees of freedom of the standard deviation.

    Examples
    --------
    >>> tolerance_factor(np.array([1 / 20]), 19, 0.95, 0.95).round(3).tolist()  # Howe approximates 2.752
    [2.76]
    """
    from scipy.special import chdtri, chndtrix, gammaincc, gammaln

    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    z = FARTHEST * (nodes + 1) / 2
    weights = weights * np.exp(-(z**2) / 2)
    weights /= weights.sum()
    q = chndtrix(coverage, 1.0, np.asarray(ratio, dtype=float)[:, None] * z**2)
    u = np.log(chndtrix(coverage, 1.0, ratio) / chdtri(df, level))  # ln(k^2 / df), Wallis' approximation
    for _ in range(50):
        x = q / np.exp(u)[:, None]
        slope = np.exp(df / 2 * np.log(x / 2) - x / 2 - gammaln(df / 2)) @ weights
        step = (gammaincc(df / 2, x / 2) @ weights - level) / slope
        u = u - np.clip(step, -1.0, 1.0)
        if np.all(np.abs(step) < 1e-10):
            break
    return np.asarray(np.sqrt(df * np.exp(u)), dtype=float)
