"""Predictive scale and intervals of a law: of the law itself, of one new row, and tolerance limits.

=============  ====================================  =================================================
for            variance of the centre                scatter of a row, and its degrees of freedom
=============  ====================================  =================================================
a new edge     CR3 covariance by edge, t(G - 1)      between and within edges, Satterthwaite
the same edge  best linear prediction of its level   within edges, rows - edges - parameters within
rows           covariance of independent rows        residual standard error, n - p
=============  ====================================  =================================================

Each interval is labelled with its kind (``mean``, ``prediction``, ``tolerance``), its level, whether it is for a new
edge or one that was already cut, and whether its value is the median, the mean or the smeared mean of the response.
The half-widths are computed in ``core.intervals``, which names its sources; the parameter file uses it too.

Source of the second row: Henderson 1975, Biometrics 31, 423 (prediction of a random level).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, get_args

import numpy as np
import pandas as pd

from ..core.arrays import Array, Flags, Ints
from ..core.calls import Conditions, check_share
from ..core.censored import LifeDistribution
from ..core.errors import FitError, UsageError
from ..core.intervals import (
    KNOWN_LEVEL,
    Centre,
    Edge,
    Kind,
    Scatter,
    between_and_within,
    interval_label,
    one_component,
    unknown_scatter,
    value_and_ends,
)
from ..core.predictions import GivenFactor, Prediction, within_tests
from ..core.rounding import label_of
from .available import NotAvailable
from .edges import EdgeInference
from .fitted_rows import FittedRows
from .laws import Error, LawForm
from .least_squares import linear, sums_by
from .region import DesignRegion
from .rows import By, Points, as_table

ROUNDING = 1e-9  # of a factor at the end of its range


class Fitted(Protocol):
    """The part of a `LawFit` that predictions need."""

    @property
    def formula(self) -> LawForm: ...  # noqa: D102
    @property
    def error(self) -> Error: ...  # noqa: D102
    @property
    def theta(self) -> Array: ...  # noqa: D102
    @property
    def domain(self) -> Mapping[str, tuple[float, float]]: ...  # noqa: D102
    @property
    def edges(self) -> EdgeInference | NotAvailable: ...  # noqa: D102
    @property
    def rows(self) -> FittedRows | None: ...  # noqa: D102
    @property
    def region(self) -> DesignRegion: ...  # noqa: D102
    @property
    def units(self) -> Mapping[str, str]: ...  # noqa: D102
    @property
    def by(self) -> By | None: ...  # noqa: D102
    @property
    def life(self) -> LifeDistribution | None: ...  # noqa: D102
    @property
    def nobs(self) -> int: ...  # noqa: D102
    @property
    def n_edges(self) -> int | None: ...  # noqa: D102
    @property
    def df_resid(self) -> int: ...  # noqa: D102
    @property
    def scale_se(self) -> float | None: ...  # noqa: D102
    @property
    def no_interval(self) -> str | None: ...  # noqa: D102
    @property
    def not_least_squares(self) -> str: ...  # noqa: D102
    @property
    def design(self) -> Array: ...  # noqa: D102
    @property
    def residuals(self) -> Array: ...  # noqa: D102
    @property
    def observed(self) -> Array: ...  # noqa: D102
    @property
    def free(self) -> Flags: ...  # noqa: D102
    def covariance(self) -> Array: ...  # noqa: D102
    def gradient_at(self, Z: Array) -> Array: ...  # noqa: D102
    def design_of(self, new: pd.DataFrame) -> Array: ...  # noqa: D102


@dataclass(frozen=True, slots=True)
class PredictiveScale:
    """Centre, variance and degrees of freedom of predicted rows, on the scale of the law's errors.

    Attributes
    ----------
    of : {"new", "same", "independent rows"}
    edge : str or None
        Edge of the rows, in words; None where rows are independent.
    method : str
        Source of the variances.
    shift, variance : ndarray, shape (n,)
        Level of the edge above the law, and variance of the centre.
    scatter : Scatter
        Of a row about the centre.
    df : float
        Degrees of freedom of t.
    """

    of: str
    edge: str | None
    method: str
    shift: Array
    variance: Array
    scatter: Scatter
    df: float

    @property
    def sd(self) -> float:
        """Standard deviation of a row about the centre."""
        return self.scatter.sd


def new_edge(law: Fitted, Z: Array) -> PredictiveScale:
    """Predictive scale of rows of a new edge, or of independent rows where there is no inference by edge.

    Parameters
    ----------
    law : LawFit, with a degree of freedom
    Z : ndarray, shape (n, p), design of the points
    """
    G = law.gradient_at(Z)
    variance = np.einsum("ij,jk,ik->i", G, law.covariance(), G)
    none = np.zeros(len(Z))
    if not isinstance(law.edges, EdgeInference):
        sd, df = law.scale_se or 0.0, float(law.df_resid)
        method = f"rows taken as independent ({law.edges.reason})"
        lives = "lognormal" if law.life is None else law.life.name
        return PredictiveScale("independent rows", None, method, none, variance, one_component(sd, df, lives), df)
    method = "jackknife by edge (CR3), scatter between and within edges"
    levels = law.edges.mixed
    scatter = between_and_within(
        levels.sd_between,
        levels.sd_within,
        law.edges.rows_per_edge,
        float(law.edges.df_between),
        float(law.edges.df_within),
    )  # fmt: skip
    return PredictiveScale("new", "a new edge", method, none, variance, scatter, float(law.edges.df))


def edge_sd(law: Fitted) -> float:
    """Standard deviation of new edges about their law on the scale of its errors; infinite where it is not known."""
    if isinstance(law.edges, EdgeInference):
        return law.edges.mixed.sd_between
    return float("inf") if no_edge_interval(law) else law.scale_se or 0.0


def no_edge_interval(law: Fitted) -> str:
    """Reason why there is no interval of one new edge; empty where there is one."""
    if isinstance(law.edges, EdgeInference) or law.life is not None:  # each life is of an edge of its own
        return ""
    return unknown_scatter(None, law.scale_se, law.nobs, law.n_edges, law.edges.reason)


def same_edge(law: Fitted, Z: Array, table: pd.DataFrame) -> PredictiveScale:
    """Predictive scale of further rows of edges that were cut, about the predicted level of each.

    The level is predicted as ``lambda_g`` times the mean residual of its ``n_g`` rows, ``lambda_g = s_b^2 /
    (s_b^2 + s_w^2 / n_g)``. Law and level together are then a weighted sum of all rows, whose variance about
    the truth follows from the two variances exactly. Where ``table`` names no edge the level is taken as
    known, and as standing at the law.
    """
    inference = law.edges
    if not isinstance(inference, EdgeInference):
        return new_edge(law, Z)
    sd, df, none = inference.mixed.sd_within, float(inference.df_within), np.zeros(len(Z))
    if "edge" not in table:
        return PredictiveScale("same", KNOWN_LEVEL, "scatter within edges alone", none, none, one_component(sd, df), df)
    at = _known(law, inference, table)
    free, number = law.free, _edge_numbers(law)
    A = law.gradient_at(law.design)[:, free]
    size = np.bincount(number).astype(float)
    means = sums_by(number, np.column_stack([A, law.residuals]), len(size)) / size[:, None]
    weight = (inference.mixed.sd_between**2 / (inference.mixed.sd_between**2 + sd**2 / size))[at] if sd > 0 else none
    centre, M = means[at, :-1], linear(A, law.residuals).cov_unscaled
    q = law.gradient_at(Z)[:, free] - weight[:, None] * centre
    within = np.einsum("ij,jk,ik->i", q, M, q + 2 * weight[:, None] * centre) + weight**2 / size[at]
    sums = (q @ M @ means[:, :-1].T) * size  # of the weights, in each edge
    sums[np.arange(len(at)), at] += weight - 1
    variance = sd**2 * within + inference.mixed.sd_between**2 * np.einsum("ij,ij->i", sums, sums)
    method = "best linear prediction of the edge's level, scatter within edges"
    return PredictiveScale("same", "the same edge", method, weight * means[at, -1], variance, one_component(sd, df), df)


def smearing(law: Fitted, of: str) -> float:
    """Mean of exp(residual): over rows; over edges with equal weight; or about each edge's own mean.

    ``of`` is "independent rows", "new" or "same", as in ``PredictiveScale``.
    """
    if law.not_least_squares:
        raise FitError(f"{law.formula.response}: {law.not_least_squares}, so residuals give no smeared mean.")
    r = law.residuals
    if of == "independent rows":
        return float(np.exp(r).mean())
    number = _edge_numbers(law)
    size = np.bincount(number)
    if of == "new":
        return float((np.bincount(number, weights=np.exp(r)) / size).mean())
    return float(np.exp(r - (np.bincount(number, weights=r) / size)[number]).mean())


def _edge_numbers(law: Fitted) -> Ints:
    if law.rows is None:
        raise FitError(f"the law of {law.formula.response} was fitted to a stream; levels of its edges need the rows.")
    return law.rows.edge_numbers


def _known(law: Fitted, edges: EdgeInference, table: pd.DataFrame) -> Ints:
    """Number of each point's edge among those of the fit."""
    number = {name: g for g, name in enumerate(edges.edges)}
    asked = [label_of(v) for v in table["edge"]]
    strange = next((name for name in asked if name not in number), None)
    if strange is not None:
        some = ", ".join(edges.edges[:6]) + (", ..." if edges.n_edges > 6 else "")
        raise FitError(
            f"{law.formula.response}: edge {strange!r} is not among the {edges.n_edges} of the fit ({some}); for an "
            "edge not yet cut ask for edge='new'."
        )
    return np.array([number[name] for name in asked], dtype=np.intp)


def interval(
    law: Fitted,
    new: Points,
    kind: Kind = "mean",
    *,
    edge: Edge = "new",
    level: float = 0.95,
    coverage: float = 0.95,
    centre: Centre = "median",
) -> pd.DataFrame:
    """Interval of a law at new points.

    Parameters
    ----------
    law : LawFit
    new : mapping or DataFrame
        A value or column for each factor; for ``edge="same"`` a column ``edge`` that names edges of the fit.
    kind : {"mean", "prediction", "tolerance"}
        Of the law itself (for the same edge: of the law at that edge's level); of one new row; or limits that
        contain a share ``coverage`` of all rows there with confidence ``level``.
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
    >>> from fitmodels.fit.prediction import interval
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> interval(law, {"V": 100, "f": 0.2, "d": 2, "t": 8}, "prediction").attrs["words"]
    '95 % prediction interval for one row of a new edge; the value is the median; inside: in the region of the design'
    """
    _check(law, kind, edge, level, coverage, centre)
    table = as_table(law.formula.response, new)
    Z = law.design_of(table)
    at = new_edge(law, Z) if edge == "new" else same_edge(law, Z, table)
    multiplies = law.error == "multiplicative"
    middle: Centre = centre if multiplies else "mean"
    median = law.formula.response_at(law.theta, Z)
    median = median * np.exp(at.shift) if multiplies else median + at.shift
    value, low, high = value_and_ends(
        kind, median, at.variance, at.df, at.scatter, level=level, coverage=coverage, centre=middle,
        smearing=smearing(law, at.of) if middle == "smeared" else 1.0, multiplies=multiplies,
    )  # fmt: skip
    inside, region = inside_of(law, table)
    band = pd.DataFrame({"value": value, "low": low, "high": high, "inside": inside})
    band.attrs.update(_label(at, kind, level, coverage, middle, region))
    return band


def predicted(law: Fitted, given: Conditions, *, kind: Kind, **options: Any) -> Prediction:  # noqa: ANN401
    """The interval of a law at conditions as `core.predictions` checks them; options as of `interval`."""
    table = as_table(law.formula.response, given)
    return of_band(law, given, table, interval(law, table, kind, **options))


def of_band(law: Fitted, given: Conditions, table: pd.DataFrame, band: pd.DataFrame) -> Prediction:
    """The prediction of a band as `interval` returns it."""
    one = not any(np.ndim(value) for value in given.values())

    def cells(column: Any) -> Any:  # noqa: ANN401
        values = np.asarray(column)
        return values[0].item() if one else values

    factors = []
    for name, (low, high) in law.domain.items():
        x, slack = table[name].to_numpy(dtype=float), ROUNDING * max(abs(low), abs(high))
        beyond = (x > high + slack).astype(np.intp) - (x < low - slack)
        factors.append(GivenFactor(name, law.units.get(name, ""), cells(x), low, high, cells(beyond)))
    levels = [] if law.by is None else list(dict.fromkeys(map(str, table[law.by.column])))
    facts = band.attrs
    found = Prediction(
        response=law.formula.response, unit=law.units.get(law.formula.response, ""),
        value=cells(band["value"]), low=cells(band["low"]), high=cells(band["high"]), inside=cells(band["inside"]),
        of=facts["words"].split(";")[0], kind=facts["kind"], edge=facts["edge"], centre=facts["centre"],
        level=facts["level"], coverage=facts["coverage"], given=tuple(factors),
        by=None if law.by is None else (law.by.column, ", ".join(levels)), error=law.error,
    )  # fmt: skip
    return within_tests(found, float(law.observed.max()) if law.life is not None else None)


def inside_of(law: Fitted, table: pd.DataFrame) -> tuple[Flags, str]:
    """Whether each point lies in the tested region, shape (n,), and the region in words."""
    try:
        region = law.region
    except FitError:
        points = table[list(law.formula.factors)].to_numpy(dtype=float)
        low, high = np.array(list(law.domain.values())).T
        inside = ((points >= low) & (points <= high)).all(axis=1)
        why = "too few settings to span a region" if law.rows is not None else "a stream keeps no rows"
        return inside, f"in the range of every factor ({why})"
    return region.inside(table), "in the region of the design"


def _label(
    at: PredictiveScale, kind: Kind, level: float, coverage: float, centre: Centre, region: str
) -> dict[str, object]:
    value = "smeared mean" if centre == "smeared" else centre
    return {
        "kind": kind,
        "level": level,
        "coverage": coverage if kind == "tolerance" else None,
        "edge": at.of,
        "centre": centre,
        "df": at.scatter.df_bound(level) if kind == "tolerance" else at.df,
        "sd": at.sd,
        "method": at.method + ("; tolerance factor (Wallis) by quadrature" if kind == "tolerance" else ""),
        "words": f"{interval_label(kind, level, coverage, at.edge)}; the value is the {value}; inside: {region}",
    }


def _check(law: Fitted, kind: str, edge: str, level: float, coverage: float, centre: str) -> None:
    for name, given, known in (("kind", kind, Kind), ("edge", edge, Edge), ("centre", centre, Centre)):
        if given not in get_args(known):
            raise UsageError(f"{name}={given!r}: it is one of {', '.join(get_args(known))}.")
    for name, share in (("level", level), ("coverage", coverage)):
        check_share(name, share)
    if not isinstance(getattr(law, "formula", None), LawForm):
        raise UsageError(f"an interval of a {type(law).__name__}: give a law, for instance of fit.power_law.")
    if law.no_interval:
        raise FitError(f"{law.formula.response}: {law.no_interval}. Add observations.")
