"""Predictions of a law section: value, interval, and whether the point lies in the tested region."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Array, Ints
from ..core.errors import ParameterError
from ..core.intervals import Root, edge_words, solved_for, t_quantile, unknown_scatter
from ..core.predictions import (
    GivenFactor,
    LifePrediction,
    Prediction,
    compared_time,
    doubt_of_curves,
    single,
    unreached_words,
    within_tests,
)
from ..datasets import region
from .evaluation import (
    IntervalOptions,
    as_given,
    checked_values,
    contains_values,
    covariance_of,
    interval_band,
    region_facts,
    terms,
    together,
)
from .sections.base import NoCovariance
from .sections.law_fields import LawFields
from .sections.law_parts import ToolLifeSection

LEVEL = 0.95  # of the interval that the wear curves are compared with


def predict_with_interval(
    law: LawFields,
    asked: IntervalOptions,
    by: str | None,
    factors: Mapping[str, ArrayLike],
    sources: Mapping[str, Prediction] | None = None,
) -> Prediction:
    """Prediction of a law; ``sources`` holds predictions of other laws in place of factors that were not given.

    Raises
    ------
    ParameterError
        As ``LawSection.interval``.
    """
    taken = dict(sources or {})
    by = None if by is None else str(by)
    at = {**factors, **{name: source.value for name, source in taken.items()}}
    found = interval_band(law, asked, by, at)
    values = found.factors
    inside = contains_values(law, by, values)
    for source in taken.values():
        inside = inside & source.inside
    given = tuple(
        GivenFactor(f.symbol, f.unit, single(value), f.low, f.high, single(beyond), taken.get(f.symbol))
        for f, value, beyond in zip(law.factors, values, _beyond(law, values), strict=True)
    )
    prediction = Prediction(
        response=law.response,
        unit=law.unit,
        value=as_given(law, found.value),
        low=as_given(law, found.low),
        high=as_given(law, found.high),
        inside=single(inside),
        of=found.of,
        kind=asked.kind,
        edge=found.edge,
        centre=found.centre,
        level=asked.level,
        coverage=asked.coverage if asked.kind == "tolerance" else None,
        given=given,
        by=None if law.by is None or by is None else (law.by.column, by),
        error=law.error,
    )
    return within_tests(prediction, None if law.life is None else law.life.longest)


def predict_life(
    law: LawFields, life: ToolLifeSection, asked: IntervalOptions, factors: Mapping[str, ArrayLike]
) -> LifePrediction:
    """Tool life at the criterion by inverting the wear law, with Fieller's interval.

    Parameters
    ----------
    law : LawSection
        The wear law that the tool life was solved from.
    life : ToolLifeSection
    asked : IntervalOptions
        ``mean`` of the law, ``prediction`` of one new edge.
    factors : mapping
        A number for each factor but t.

    Raises
    ------
    ParameterError
        A factor is missing or unknown, the law has no covariance, or a tolerance interval is asked for.
    """
    symbols = [f.symbol for f in law.factors]
    if law.form != "power" or law.by is not None or "t" not in symbols or law.coefficients["t"] <= 0:
        raise ParameterError(
            f"the law of {law.response} is no power law of wear that grows with t: it has no tool life."
        )
    if asked.kind == "tolerance":
        raise ParameterError("a tolerance interval of tool life is not offered: ask for prediction (of one new edge).")
    if isinstance(law.uncertainty, NoCovariance):
        raise ParameterError(f"the law of {law.response} has no interval: {law.uncertainty.reason}.")
    values = {name: float(np.asarray(value)) for name, value in factors.items()}
    checked_values(law, {**values, "t": 1.0})
    extra, of = edge_scatter(law, life) if asked.kind == "prediction" else (0.0, "the law")
    root = life_root(law, life.criterion, values, t_quantile(law.uncertainty.df, asked.level), extra)
    with np.errstate(over="ignore", under="ignore"):
        value, low, high = (float(np.exp(end)) for end in (root.value, root.low, root.high))
    at = {**values, "t": value}
    found_at = checked_values(law, {**at, "t": compared_time(value, life.t_observed)})
    inside = bool(contains_values(law, None, found_at))
    given = tuple(
        GivenFactor(f.symbol, f.unit, at[f.symbol], f.low, f.high, single(beyond))
        for f, beyond in zip(law.factors, _beyond(law, found_at), strict=True)
    )
    words = f"time at which {law.response} reaches {life.criterion:g} {life.unit_of_wear}"
    found = LifePrediction(
        response="T", unit=life.unit, value=value, low=low, high=high, inside=inside,
        of=f"{words}; {100 * asked.level:g} % interval of {of}, by Fieller's theorem,", kind=asked.kind, edge="new",
        centre="median", level=asked.level, coverage=None, given=given, by=None, error="multiplicative",
    )  # fmt: skip
    return within_tests(found, life.t_observed, unreached_words(life.criterion, life.wear_observed, life.unit_of_wear))


def life_root(law: LawFields, criterion: float, factors: Mapping[str, float], quantile: float, extra: float) -> Root:
    """Logarithm of the time at which a wear law reaches the criterion; ``extra`` is the variance about the law."""
    z = terms(law, None, {**factors, "t": 1.0})
    return solved_for(
        law.theta, covariance_of(law), z, law.parameter_names.index("t"), float(np.log(criterion)), quantile, extra
    )


def edge_scatter(law: LawFields, life: ToolLifeSection) -> tuple[float, str]:
    """Variance of ln wear of one new edge about its law, infinite where it is not known, and whose it is in words."""
    unknown = no_edge_interval(law, life)
    of = edge_words(unknown, known=law.n_edges is not None)
    return (float("inf") if unknown else _variance(law, life)), of


def no_edge_interval(law: LawFields, life: ToolLifeSection) -> str:
    """Reason why there is no interval of one new edge; empty where there is one.

    The scatter between edges is not known; or the lives read from the wear curves contradict the law, and at the middle
    of the tests lie outside the interval that its scatter gives.
    """
    between, reason = (None, None) if law.edges is None else (law.edges.sd_between, law.edges.reason)
    unknown, curves = unknown_scatter(between, law.residual_se, law.n, law.n_edges, reason), life.curves
    if unknown or curves is None or curves.ratio is None or isinstance(law.uncertainty, NoCovariance):
        return unknown
    t = t_quantile(law.uncertainty.df, LEVEL)
    root = life_root(law, life.criterion, life.typical_at, t, _variance(law, life))
    return doubt_of_curves(curves.ratio, curves.ratio_interval, curves.expected, root)


def _variance(law: LawFields, life: ToolLifeSection) -> float:
    """Variance of ln wear of one new edge about its law, of one row where edges are not named."""
    between = None if law.edges is None else law.edges.sd_between
    sd = law.residual_se if between is None else between
    if sd is None:
        raise ParameterError(f"the law of {law.response} has no residual standard error: no interval of one edge.")
    return (sd if law.error == "multiplicative" else sd / life.criterion) ** 2


def _beyond(law: LawFields, values: list[Array]) -> list[Ints]:
    """For each factor, -1 below its tested range, 1 above it: by the criterion of `contains_values`."""
    if law.region is None:
        pairs = zip(values, law.factors, strict=True)
        return [(value > f.high).astype(np.intp) - (value < f.low) for value, f in pairs]
    U = region.coded(region_facts(law.region), together(values))
    return list(np.moveaxis(np.where(np.abs(U) > 1 + region.ROUNDING, np.sign(U), 0).astype(np.intp), -1, 0))
