"""Intervals of a law's answers: of the law itself, of one new row, and of a share of all rows to come.

An interval is only as good as its label. Each tells what it is of (``mean``, ``prediction``, ``tolerance``), at
which level, for a new edge or for one that was already cut, and whether its value is the median, the mean or
the smeared mean of the response.

Sources: Wallis 1951, Proc. 2nd Berkeley Symposium, 43, and Krishnamoorthy & Mathew 2009, Statistical Tolerance
Regions, sections 1.2 and 3.3 (tolerance in regression); Mee 1984, Technometrics 26, 251 (with a random level);
Duan 1983, J. Am. Stat. Assoc. 78, 605 (smearing); Zhou & Gao 1997, Statistics in Medicine 16, 783 (Cox's interval
of a lognormal mean).
"""

from typing import Literal, get_args

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..datasets.errors import UsageError
from .about import About, edge_numbers, new_edge, same_edge
from .domain import Points
from .errors import FitError
from .lawfit import LawFit, as_table

Array = NDArray[np.float64]
Kind = Literal["mean", "prediction", "tolerance"]
Edge = Literal["new", "same"]
Centre = Literal["median", "mean", "smeared"]

# Quadrature over a standard normal: beyond 6.5 of its deviations lies 1e-10, and 48 nodes keep ten digits.
FARTHEST, NODES = 6.5, 48


def interval(
    law: LawFit,
    new: Points,
    kind: Kind = "mean",
    *,
    edge: Edge = "new",
    level: float = 0.95,
    coverage: float = 0.95,
    centre: Centre = "median",
) -> pd.DataFrame:
    """Interval of a law's answer at new points.

    Parameters
    ----------
    law : LawFit
    new : mapping or DataFrame
        A value or column for each factor; for ``edge="same"`` a column ``edge`` that names edges of the fit.
    kind : {"mean", "prediction", "tolerance"}
        Of the law itself (for the same edge: of the law at that edge's level); of one new row; or limits that
        hold a share ``coverage`` of all rows there with confidence ``level``.
    edge : {"new", "same"}
        Rows of an edge not yet cut, or further rows of an edge of the fit, about the level it has shown. Where
        ``new`` names no edge, "same" takes that level as known and standing at the law: the scatter within an
        edge, no more. Without inference by edge, rows are independent and both are the same.
    level, coverage : float
        Between 0 and 1.
    centre : {"median", "mean", "smeared"}
        What ``value`` is where errors multiply: exp of the logarithm; that times exp(s^2/2); that times the mean
        of exp(residual). The interval of a mean moves with it, the ends for rows do not. Where errors add, all
        three are the mean.

    Returns
    -------
    DataFrame, columns value, low, high in the unit of the response. ``attrs``: kind, level, coverage, edge,
    centre, df (of t; of the scatter for tolerance), sd (on the scale of the errors), method and words.

    Raises
    ------
    UsageError
        An option that does not exist, or a level or coverage that is not between 0 and 1.
    FitError
        A factor is missing, the edge was not fitted, or observations fix the parameters exactly.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.intervals import interval
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> interval(law, {"V": 100, "f": 0.2, "d": 2, "t": 8}, "prediction").attrs["words"]
    '95 % prediction interval for one row of a new edge; the value is the median'
    """
    _check(law, kind, edge, level, coverage, centre)
    table = as_table(law.response, new)
    Z = law.design_of(table)
    at = new_edge(law, Z) if edge == "new" else same_edge(law, Z, table)
    middle: Centre = "mean" if law.error == "additive" else centre
    value = law.law.response_at(law.theta, Z)
    if law.error == "additive":
        value = value + at.shift
        half = _half(at, kind, level, coverage, 0.0)
        ends = {"value": value, "low": value - half, "high": value + half}
    else:
        value = value * np.exp(at.shift)
        factor, unsure = _retransformed(law, at, middle)
        half, moved = _half(at, kind, level, coverage, unsure), factor if kind == "mean" else 1.0
        ends = {"value": value * factor, "low": moved * value * np.exp(-half), "high": moved * value * np.exp(half)}
    band = pd.DataFrame(ends)
    band.attrs.update(_label(at, kind, level, coverage, middle))
    return band


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


def _half(at: About, kind: Kind, level: float, coverage: float, unsure: float) -> Array:
    """Half width on the scale of the errors; ``unsure`` is the variance of the factor to the mean."""
    from scipy.special import stdtrit

    if kind == "tolerance":
        ratio = at.variance / at.sd**2 if at.sd > 0 else np.zeros(len(at.variance))
        return tolerance_factor(ratio, at.df_bound(level), coverage, level) * at.sd
    variance = at.variance + (at.sd**2 if kind == "prediction" else unsure)
    return np.asarray(stdtrit(at.df, (1 + level) / 2) * np.sqrt(np.maximum(variance, 0.0)), dtype=float)


def _retransformed(law: LawFit, at: About, centre: Centre) -> tuple[float, float]:
    """Factor from the median to the centre asked for, and the variance of its logarithm (Cox)."""
    if centre == "median":
        return 1.0, 0.0
    unsure = at.sd**4 / (2 * (at.df_sd + 2))
    return (float(np.exp(at.sd**2 / 2)) if centre == "mean" else _smearing(law, at)), unsure


def _smearing(law: LawFit, at: About) -> float:
    """Mean of exp(residual): over rows; over edges, which count alike; or about each edge's own mean."""
    r = law.residuals
    if at.of == "independent rows":
        return float(np.exp(r).mean())
    number = edge_numbers(law)
    size = np.bincount(number)
    if at.of == "new":
        return float((np.bincount(number, weights=np.exp(r)) / size).mean())
    return float(np.exp(r - (np.bincount(number, weights=r) / size)[number]).mean())


def _label(at: About, kind: Kind, level: float, coverage: float, centre: Centre) -> dict[str, object]:
    of = {
        "mean": {"same": f"the law at the level of {at.edge}"}.get(at.of, "the law"),
        "prediction": "one row" if at.of == "independent rows" else f"one row of {at.edge}",
        "tolerance": f"{100 * coverage:.4g} % of rows" + ("" if at.of == "independent rows" else f" of {at.edge}"),
    }[kind]
    return {
        "kind": kind,
        "level": level,
        "coverage": coverage if kind == "tolerance" else None,
        "edge": at.of,
        "centre": centre,
        "df": at.df_bound(level) if kind == "tolerance" else at.df,
        "sd": at.sd,
        "method": at.method + ("; tolerance factor of Wallis's problem by quadrature" if kind == "tolerance" else ""),
        "words": f"{100 * level:.4g} % {kind} interval for {of}; the value is the {_named(centre)}",
    }


def _named(centre: Centre) -> str:
    return "smeared mean" if centre == "smeared" else centre


def _check(law: LawFit, kind: str, edge: str, level: float, coverage: float, centre: str) -> None:
    for name, given, known in (("kind", kind, Kind), ("edge", edge, Edge), ("centre", centre, Centre)):
        if given not in get_args(known):
            raise UsageError(f"{name}={given!r}: it is one of {', '.join(get_args(known))}.")
    for name, share in (("level", level), ("coverage", coverage)):
        if not 0 < share < 1:
            raise UsageError(f"{name} {share:g} of an interval: it lies between 0 and 1, for instance 0.95.")
    if law.no_interval:
        raise FitError(f"{law.response}: {law.no_interval}. Add observations.")
