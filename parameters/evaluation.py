"""Evaluation of a law section: values and intervals at given factors, and whether they lie in the tested region.

Half-widths are those of `core.intervals`, which the fit uses too: a file gives the same intervals as the fit.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Array, Flags
from ..core.calls import check_share
from ..core.errors import ParameterError
from ..core.formula import Formula
from ..core.intervals import (
    KNOWN_LEVEL,
    Centre,
    Edge,
    Kind,
    Scatter,
    between_and_within,
    interval_label,
    one_component,
    value_and_ends,
)
from ..datasets import region
from .messages import short
from .sections.base import Covariance, NoCovariance
from .sections.law_fields import LawFields
from .sections.law_parts import Edges, Region


@dataclass(frozen=True, slots=True)
class IntervalOptions:
    """Options of an interval, as `LawSection.interval` documents them."""

    kind: Kind = "mean"
    level: float = 0.95
    edge: Edge = "new"
    coverage: float = 0.95
    centre: Centre = "median"

    def __post_init__(self) -> None:
        for name, given, known in (
            ("kind", self.kind, Kind),
            ("edge", self.edge, Edge),
            ("centre", self.centre, Centre),
        ):
            if given not in get_args(known):
                words = ", ".join(map(repr, get_args(known)))
                raise ParameterError(f"{name} = {short(given)}: it is one of {words}.")
        for name, share in (("level", self.level), ("coverage", self.coverage)):
            if isinstance(share, str):
                raise ParameterError(
                    f"{name} = {short(share)}: a coverage is between 0 and 1, as 0.95 (a level of the law is by=)."
                )
            check_share(name, share, ParameterError)


@dataclass(frozen=True, slots=True)
class Band:
    """Value and ends of an interval in the unit of the law, in the shape of the factors.

    ``of`` describes the interval; ``edge`` is new, same or independent rows; ``centre`` is the quantity that the value
    estimates; ``factors`` are the values of the factors, in the order of the law.
    """

    value: Array
    low: Array
    high: Array
    of: str
    edge: str
    centre: Centre
    factors: list[Array]


@dataclass(frozen=True, slots=True)
class _Spread:
    """Edge of the row (new, same, independent rows), scatter of rows, degrees of freedom of t, and its description."""

    edge: str
    scatter: Scatter
    df: float
    words: str | None


def point_values(law: LawFields, level: str | None, given: Mapping[str, ArrayLike]) -> Array | float:
    """Values of the equation: medians of a multiplicative law, means of an additive one."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        return as_given(law, response(law, terms(law, level, given)))


@dataclass(frozen=True, slots=True)
class Equation:
    """The equation of a law at one of its levels, for very many evaluations: factors are not checked.

    Attributes
    ----------
    formula : Formula
    theta : ndarray, shape (p,)
        As `LawFields.theta`.
    shifts : ndarray, shape (number of shifts,)
        1 at the level.
    """

    formula: Formula
    theta: Array
    shifts: Array

    def values(self, X: Array) -> Array:
        """The response at factors (..., k), in the order and units of the law; what is not finite stays so."""
        with np.errstate(all="ignore"):
            columns = self.formula.columns(X)
            shifts = np.broadcast_to(self.shifts, (*columns.shape[:-1], len(self.shifts)))
            return self.formula.response_of(self.theta, np.concatenate([columns, shifts], axis=-1))

    def sampled(self, X: Array, theta: Array, drawn: Array | None = None, place: int = 0) -> Array:
        """The response of S draws of the parameters, (S, p), at factors (G, k), shape (S, G).

        ``drawn``, (S, G), are values of the factor number ``place`` that differ from draw to draw, as a wear does.
        Columns are products of transformed factors, so that only the powers of this one are taken draw by draw.
        """
        formula, m = self.formula, len(self.theta) - len(self.shifts)
        product, added = theta[:, :m], None
        if not formula.linearisable:  # the last factor is added to the product of the others
            last = len(formula.factors)
            at = drawn if drawn is not None and place == last - 1 else X[:, last - 1]
            added, product = theta[:, last, None] * at, np.delete(product, last, axis=1)
        with np.errstate(all="ignore"):
            eta = (theta[:, m:] @ self.shifts)[:, None]
            u, columns = (np.ones(1), formula.columns(X)) if drawn is None else formula.apart(X, drawn, place)
            degrees = np.array([0, *(term.degrees[place] for term in formula.all_terms)])
            if added is not None:
                columns, degrees = columns[:, :-1], degrees[:-1]
            for d in np.unique(degrees):
                eta = eta + product[:, degrees == d] @ columns[:, degrees == d].T * u**d
            value = np.exp(eta) if formula.logarithmic else np.asarray(eta)
            return value if added is None else value + added


def equation_of(law: LawFields, level: str | None) -> Equation:
    """The equation of a law at a level, which is needed where the law has levels."""
    at = _level(law, level)
    return Equation(law.formula, law.theta, np.array([float(name == at) for name in (law.by.shifts if law.by else ())]))


def region_contains(law: LawFields, level: str | None, given: Mapping[str, ArrayLike]) -> Flags:
    """Whether each point lies in the tested region of the law."""
    return contains_values(law, level, checked_values(law, given))


def contains_values(law: LawFields, level: str | None, values: list[Array]) -> Flags:
    """Whether each point lies in the tested region, for the factors as `checked_values` gives them."""
    if law.region is None:
        pairs = zip(values, law.factors, strict=True)
        return np.asarray(np.logical_and.reduce([(value >= f.low) & (value <= f.high) for value, f in pairs]))
    known = () if law.by is None else (law.by.reference, *law.by.shifts)
    if level is not None and level not in known:
        has = ", ".join(known) or "nothing"
        raise ParameterError(f"the law of {law.response} has no level {short(level)}; it has {has}.")
    return np.asarray(region.inside(region_facts(law.region), together(values), level))


def region_facts(tested: Region) -> region.Facts:
    """The region as `fitmodels.datasets.region` evaluates it."""
    return {**vars(tested), "spaces": [vars(space) for space in tested.spaces]}


def interval_band(law: LawFields, asked: IntervalOptions, by: str | None, factors: Mapping[str, ArrayLike]) -> Band:
    """Value and ends at the given factors, by the delta method.

    Raises
    ------
    ParameterError
        A factor or level that the law cannot take, or the file lacks what this interval needs.
    """
    covariance, multiplies = _covariance(law), law.error == "multiplicative"
    centre: Centre = asked.centre if multiplies else "mean"
    moves = asked.kind == "mean" and multiplies and centre != "median"
    spread = _spread(law, covariance, asked, parts=moves or asked.kind == "tolerance")
    smearing = _smearing(law, spread) if centre == "smeared" else 1.0
    with np.errstate(all="ignore"):  # `as_given` refuses what is not finite
        values = checked_values(law, factors)
        Z = _terms_of(law, by, values)
        median = response(law, Z)
        G = error_gradient(law, Z, median)
        variance = np.zeros(median.shape) if spread.edge == "same" else _quadratic(law, G)
        value, low, high = value_and_ends(
            asked.kind, median, variance, spread.df, spread.scatter, level=asked.level, coverage=asked.coverage,
            centre=centre, smearing=smearing, multiplies=multiplies,
        )  # fmt: skip
    row = "row" if law.life is None else "life"
    of = interval_label(asked.kind, asked.level, asked.coverage, spread.words, row)
    return Band(value, low, high, of, spread.edge, centre, values)


def _covariance(law: LawFields) -> Covariance:
    if isinstance(law.uncertainty, NoCovariance):
        reason = law.uncertainty.reason.removeprefix("no interval: ").rstrip(".")
        raise ParameterError(f"the law of {law.response} has no interval: {reason}.")
    return law.uncertainty


def covariance_of(law: LawFields) -> Array:
    """Covariance of the parameters in the order of ``parameter_names``; ParameterError where there is none."""
    covariance = _covariance(law)
    order = [covariance.of.index(name) for name in law.parameter_names]
    return np.asarray(np.array(covariance.matrix)[np.ix_(order, order)], dtype=float)


def _quadratic(law: LawFields, G: Array) -> Array:
    C = covariance_of(law)
    return np.asarray(np.einsum("...i,ij,...j->...", G, C, G), dtype=float)


def _spread(law: LawFields, covariance: Covariance, asked: IntervalOptions, *, parts: bool) -> _Spread:
    """Scatter by edge where the file holds its components, otherwise of independent rows."""
    e, df = law.edges, float(covariance.df)
    if e is None or law.deviations is None:
        if law.residual_se is None and (asked.kind != "mean" or asked.centre != "median"):
            words = f"no {asked.kind} interval" if asked.kind != "mean" else f"no {asked.centre} of its own"
            raise ParameterError(f"the law of {law.response} has no residual standard error: {words}.")
        lives = "lognormal" if law.life is None else law.life.distribution
        return _Spread("independent rows", one_component(law.residual_se or 0.0, df, lives), df, None)
    if asked.edge == "same":
        (within,) = _held(law, e, "df_within", of="an interval for the same edge")
        return _Spread("same", one_component(law.deviations[1], within), within, KNOWN_LEVEL)
    if not parts:
        return _Spread("new", Scatter(float(np.hypot(*law.deviations)), ()), df, "a new edge")
    what = "a tolerance interval" if asked.kind == "tolerance" else f"the interval of a {asked.centre}"
    m, between, within = _held(law, e, "rows_per_edge", "df_between", "df_within", of=what)
    return _Spread("new", between_and_within(*law.deviations, m, between, within), df, "a new edge")


def _smearing(law: LawFields, spread: _Spread) -> float:
    if spread.edge == "same" and law.edges is not None:
        return _held(law, law.edges, "smearing_within", of="the smeared mean")[0]
    return _held(law, law, "smearing", of="the smeared mean")[0]


def _held(law: LawFields, section: Edges | LawFields, *names: str, of: str) -> list[float]:
    """Fields that files of earlier versions lack."""
    values = [getattr(section, name) for name in names]
    lacking = [name for name, value in zip(names, values, strict=True) if value is None]
    if lacking:
        where = "" if section is law else "edges."
        fields = ", ".join(f"{where}{name}" for name in lacking)
        raise ParameterError(
            f"the law of {law.response} lacks {fields} in this file, which {of} needs; fit the data again to add it."
        )
    return [float(value) for value in values]


def terms(law: LawFields, level: str | None, given: Mapping[str, ArrayLike]) -> Array:
    """Terms of the linear form at the given factors, shape (..., p).

    Raises
    ------
    ParameterError
        A factor or a level that the law cannot take.
    """
    return _terms_of(law, level, checked_values(law, given))


def _terms_of(law: LawFields, level: str | None, values: list[Array]) -> Array:
    shape = values[0].shape if values else ()
    columns = law.formula.columns(together(values)) if values else np.ones((1,))
    at = _level(law, level)
    if law.by is None:
        return columns
    shifts = [np.full((*shape, 1), float(other == at)) for other in law.by.shifts]
    return np.concatenate([columns, *shifts], axis=-1)


def checked_values(law: LawFields, given: Mapping[str, ArrayLike]) -> list[Array]:
    """The factors in the order of the law, broadcast to one shape."""
    symbols = [factor.symbol for factor in law.factors]
    for name in given:
        if name not in symbols:
            has = f"its factors are {', '.join(symbols)}" if symbols else "it has none"
            raise ParameterError(f"the law of {law.response} has no factor {short(name)}; {has}.")
    for factor in law.factors:
        if factor.symbol not in given:
            raise ParameterError(
                f"the law of {law.response} needs {factor.symbol} ({factor.quantity}, {factor.unit}); "
                f"give {factor.symbol}=..."
            )
    logs = law.formula.logs
    values = [_number(law, f.symbol, f.unit, given[f.symbol], log) for f, log in zip(law.factors, logs, strict=True)]
    if all(value.shape == values[0].shape for value in values):
        return values
    try:
        return list(np.broadcast_arrays(*values))
    except ValueError:
        shapes = ", ".join(f"{name} {value.shape}" for name, value in zip(symbols, values, strict=True))
        raise ParameterError(f"the factors do not broadcast to one shape: {shapes}.") from None


def together(values: list[Array]) -> Array:
    """Factors of one shape as one array, shape (..., k)."""
    return np.stack(values, axis=-1) if values[0].ndim else np.array(values)


def _number(law: LawFields, symbol: str, unit: str, given: ArrayLike, log: bool) -> Array:
    if type(given) is float and math.isfinite(given) and (given > 0 or not log):
        return np.array(given)
    try:
        value = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(f"{symbol} = {short(given)} is not a number; give it in {unit or 'its unit'}.") from None
    bad = ~np.isfinite(value) | ((value <= 0) if log else False)
    if bad.any():
        wanted = "positive" if log else "finite"
        seen = float(value[bad].flat[0]) if value.ndim else float(value)
        raise ParameterError(f"{symbol} = {seen:g} {unit}: the {law.form} law of {law.response} needs {wanted} values.")
    return value


def _level(law: LawFields, level: str | None) -> str | None:
    if law.by is None:
        if level is not None:
            raise ParameterError(f"the law of {law.response} has no levels; leave {short(level)} out.")
        return None
    known = ", ".join([law.by.reference, *law.by.shifts])
    if level is None:
        raise ParameterError(f"the law of {law.response} is by {law.by.column}: give by= one of its levels ({known}).")
    if str(level) != law.by.reference and str(level) not in law.by.shifts:
        seen = f"{law.by.column} {short(str(level))}"
        raise ParameterError(f"the law of {law.response} has no {seen}; it has {known}.")
    return str(level)


def response(law: LawFields, Z: Array) -> Array:
    """Response for the terms Z of the law, shape (...,); `as_given` refuses what overflows."""
    return law.formula.response_of(law.theta, Z)


def error_gradient(law: LawFields, Z: Array, median: Array) -> Array:
    """Derivative of the prediction by theta on the scale of the errors, shape (..., p)."""
    if law.error == "additive":
        return law.formula.derivative(law.theta, Z)
    return Z if law.formula.linearisable else law.formula.derivative(law.theta, Z) / median[..., None]


def as_given(law: LawFields, value: Array) -> Array | float:
    """A float for a single point, an array otherwise; ParameterError where a value is not finite."""
    if not np.isfinite(value).all():
        raise ParameterError(
            f"the law of {law.response} is not finite at these factors; give factors near its domain (see inside)."
        )
    return value if value.ndim else float(value)
