"""Intervals of a law's answers: of the law itself, of one new row, and of a share of all rows to come.

An interval is only as good as its label. Each tells what it is of (``mean``, ``prediction``, ``tolerance``), at
which level, for a new edge or for one that was already cut, and whether its value is the median, the mean or
the smeared mean of the response.

How wide they are is worked out in ``datasets.widths``, which names its sources: the parameter file goes there too.
"""

from typing import get_args

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.errors import FitError, UsageError
from ..core.intervals import (
    Centre,
    Edge,
    Kind,
    centre_factor,
    half_width,
    interval_ends,
    interval_label,
    log_mean_variance,
)
from .about import About, new_edge, same_edge, smearing
from .domain import Points, domain
from .lawfit import LawFit, as_table

Array = NDArray[np.float64]


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
    DataFrame, columns value, low, high in the unit of the response, and inside: whether the point lies in the
    region of the design; where its settings are too few to span one, whether it lies in every factor's range.
    ``attrs``: kind, level, coverage, edge, centre, df (of t; of the scatter for tolerance), sd (on the scale of the
    errors), method and words.

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
    '95 % prediction interval for one row of a new edge; the value is the median; inside: in the region of the design'
    """
    _check(law, kind, edge, level, coverage, centre)
    table = as_table(law.response, new)
    Z = law.design_of(table)
    at = new_edge(law, Z) if edge == "new" else same_edge(law, Z, table)
    multiplies = law.error == "multiplicative"
    middle: Centre = centre if multiplies else "mean"
    median = law.law.response_at(law.theta, Z)
    median = median * np.exp(at.shift) if multiplies else median + at.shift
    smear = smearing(law, at.of) if middle == "smeared" else 1.0
    factor = centre_factor(middle, at.sd, smear) if multiplies else 1.0
    factor_variance = log_mean_variance(at.scatter) if multiplies and middle != "median" else 0.0
    half = half_width(
        kind, at.variance, at.df, at.scatter, level=level, coverage=coverage, factor_variance=factor_variance
    )
    low, high = interval_ends(median * factor if kind == "mean" else median, half, multiplies=multiplies)
    inside, region = _inside(law, table)
    band = pd.DataFrame({"value": median * factor, "low": low, "high": high, "inside": inside})
    band.attrs.update(_label(at, kind, level, coverage, middle, region))
    return band


def _inside(law: LawFit, table: pd.DataFrame) -> tuple[NDArray[np.bool_], str]:
    """Which points lie where the law was tested, shape (n,), and where that is, in words."""
    try:
        place = domain(law)
    except FitError:
        points = table[list(law.factors)].to_numpy(dtype=float)
        low, high = np.array(list(law.domain.values())).T
        inside = ((points >= low) & (points <= high)).all(axis=1)
        return inside, "in the range of every factor (too few settings to span a region)"
    return place.inside(table), "in the region of the design"


def _label(at: About, kind: Kind, level: float, coverage: float, centre: Centre, region: str) -> dict[str, object]:
    value = "smeared mean" if centre == "smeared" else centre
    return {
        "kind": kind,
        "level": level,
        "coverage": coverage if kind == "tolerance" else None,
        "edge": at.of,
        "centre": centre,
        "df": at.scatter.df_bound(level) if kind == "tolerance" else at.df,
        "sd": at.sd,
        "method": at.method + ("; tolerance factor of Wallis's problem by quadrature" if kind == "tolerance" else ""),
        "words": f"{interval_label(kind, level, coverage, at.edge)}; the value is the {value}; inside: {region}",
    }


def _check(law: LawFit, kind: str, edge: str, level: float, coverage: float, centre: str) -> None:
    for name, given, known in (("kind", kind, Kind), ("edge", edge, Edge), ("centre", centre, Centre)):
        if given not in get_args(known):
            raise UsageError(f"{name}={given!r}: it is one of {', '.join(get_args(known))}.")
    for name, share in (("level", level), ("coverage", coverage)):
        if not 0 < share < 1:
            raise UsageError(f"{name} {share:g} of an interval: it lies between 0 and 1, for instance 0.95.")
    if law.no_interval:
        raise FitError(f"{law.response}: {law.no_interval}. Add observations.")
