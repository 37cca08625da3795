"""Predictions of a law section: value, interval, and whether the point lies in the tested region, in one sentence."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.display import Displayable, Plottable
from ..core.errors import ParameterError
from ..core.intervals import Root, solved_for
from ..core.rounding import format_plain as plain
from ..core.rounding import format_rounded
from ..datasets import region
from .evaluation import (
    IntervalOptions,
    as_given,
    checked_values,
    covariance_of,
    interval_band,
    region_contains,
    terms,
)
from .sections.base import NoCovariance
from .sections.law_fields import LawFields
from .sections.law_parts import ToolLifeSection

if TYPE_CHECKING:
    from pandas import DataFrame


SIDES = {-1: "below", 1: "above"}


@dataclass(frozen=True, slots=True, repr=False)
class GivenFactor(Displayable):
    """Value of a factor at which a law was evaluated.

    Attributes
    ----------
    symbol, unit : str
    value : float or ndarray
        In ``unit``.
    low, high : float
        The tested range.
    beyond : int or ndarray of int
        -1 below the lowest tested, 1 above the highest, 0 between them.
    source : Prediction or None
        Prediction of another law that the value was taken from, where it was not given.
    """

    symbol: str
    unit: str
    value: Any
    low: float
    high: float
    beyond: Any
    source: "Prediction | None" = None


@dataclass(frozen=True, slots=True, repr=False)
class Prediction(Plottable):
    """Prediction of a law at one point or at arrays of points.

    Attributes
    ----------
    response, unit : str
    value, low, high : float or ndarray
        In ``unit``.
    inside : bool or ndarray of bool
        Whether the point lies in the tested region. Outside it the law extrapolates: run a test there, or stay
        inside.
    of : str
        Description of the interval.
    kind, edge, centre : str
        Of the interval: mean, prediction or tolerance; new, same or independent rows; what ``value`` estimates.
    level, coverage : float
        ``coverage`` is None unless the interval is a tolerance interval.
    given : tuple of GivenFactor
        The factors, in the order of the law.
    by : tuple of str, or None
        Column and level, where the law has levels.
    error : str
        ``multiplicative`` or ``additive``.
    """

    response: str
    unit: str
    value: Any
    low: Any
    high: Any
    inside: Any
    of: str
    kind: str
    edge: str
    centre: str
    level: float
    coverage: float | None
    given: tuple[GivenFactor, ...]
    by: tuple[str, str] | None
    error: str

    @property
    def words(self) -> str:
        """One sentence per point, each on its own line, numbers rounded by their uncertainty."""
        return "\n".join(self._sentence(i) for i in range(np.size(self.value)))

    def facts(self) -> dict[str, Any]:
        """Plain numbers and texts for JSON."""
        return {
            "response": self.response,
            "value": _plain(self.value),
            "low": _plain(self.low),
            "high": _plain(self.high),
            "unit": self.unit,
            "interval": self.kind,
            "level": self.level,
            "coverage": self.coverage,
            "edge": self.edge,
            "value_is": self.centre,
            "inside": _plain(self.inside),
            "given": {
                g.symbol: {
                    "value": _plain(g.value),
                    "unit": g.unit,
                    "low": g.low,
                    "high": g.high,
                    "beyond": _plain(g.beyond),
                    "from_law": g.source.response if g.source else None,
                }
                for g in self.given
            },
            "by": None if self.by is None else dict([self.by]),
            "words": self.words,
        }

    def _sentence(self, i: int) -> str:
        value, low, high = self._rounded(i)
        at = ", ".join(self._at(i))
        taken = [g.symbol for g in self.given if g.source]
        less = f" (the variance of {', '.join(taken)} is not included)" if taken else ""
        ends = _with(f"{low} to {high}", self.unit)
        return (
            f"{self.response} {_with(value, self.unit)}{self._named()}{f' at {at}' if at else ''}; "
            f"{self.of} {ends}{less}; {self._where(i)}."
        )

    def _rounded(self, i: int) -> tuple[str, ...]:
        """Value and ends, rounded by half the width, or by the lower end where that is smaller."""
        value, low, high = (float(np.ravel(number)[i]) for number in (self.value, self.low, self.high))
        width = min((high - low) / 2, low) if low > 0 else (high - low) / 2
        return tuple(format_rounded(number, width)[0] for number in (value, low, high))

    def _named(self) -> str:
        if self.error == "additive" or self.centre == "median":
            return ""
        return " (smeared mean)" if self.centre == "smeared" else " (mean)"

    def _at(self, i: int) -> Iterator[str]:
        for g in self.given:
            if g.source is None:
                yield f"{g.symbol} {_with(plain(_one(g.value, i), 6), g.unit)}"
            else:
                yield f"{g.symbol} {_with(g.source._rounded(i)[0], g.unit)} from its own law"
        if self.by is not None:
            yield " ".join(self.by)

    def _where(self, i: int) -> str:
        if _one(self.inside, i):
            return "inside the tested region"
        why = [_beyond_words(g, i, side) for g in self.given if (side := int(_one(g.beyond, i)))]
        why += [
            f"{g.symbol} comes from outside the region of its own law"
            for g in self.given
            if g.source is not None and not _one(g.source.inside, i)
        ]
        cause = ", and ".join(why) or "the combination is farther from the centre of the tests than any test"
        return f"outside the tested region: {cause}; do not rely on it"

    def to_frame(self) -> "DataFrame":
        """A row per point."""
        from pandas import DataFrame

        return DataFrame({k: np.atleast_1d(getattr(self, k)) for k in ("value", "low", "high", "inside")})


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
    values = checked_values(law, at)
    inside = region_contains(law, by, at)
    for source in taken.values():
        inside = inside & source.inside
    given = tuple(
        GivenFactor(f.symbol, f.unit, _item(value), f.low, f.high, _item(beyond), taken.get(f.symbol))
        for f, value, beyond in zip(law.factors, values, _beyond(law, values), strict=True)
    )
    return Prediction(
        response=law.response,
        unit=law.unit,
        value=as_given(law, found.value),
        low=as_given(law, found.low),
        high=as_given(law, found.high),
        inside=_item(inside),
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


@dataclass(frozen=True, slots=True, repr=False)
class LifePrediction(Prediction):
    """Tool life at a wear criterion by inverting the wear law; ``high`` is infinite where it is not bounded."""

    def facts(self) -> dict[str, Any]:
        """Plain numbers and texts for JSON; an end that is not bounded is None."""
        found = super(LifePrediction, self).facts()
        return {**found, **{end: None if np.isinf(found[end]) else found[end] for end in ("low", "high")}}

    def _at(self, i: int) -> Iterator[str]:
        for g in self.given:
            if g.symbol != "t":
                yield f"{g.symbol} {_with(plain(_one(g.value, i), 6), g.unit)}"

    def _rounded(self, i: int) -> tuple[str, ...]:
        value, low, high = (float(np.ravel(number)[i]) for number in (self.value, self.low, self.high))
        if np.isfinite(high):
            return super(LifePrediction, self)._rounded(i)
        return plain(value, 2), plain(low, 2), "an upper end that is not bounded, in"


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
    from scipy.special import stdtrit

    extra, of = edge_scatter(law, life) if asked.kind == "prediction" else (0.0, "the law")
    root = life_root(law, life.criterion, values, float(stdtrit(law.uncertainty.df, (1 + asked.level) / 2)), extra)
    with np.errstate(over="ignore", under="ignore"):
        value, low, high = (float(np.exp(end)) for end in (root.value, root.low, root.high))
    at = {**values, "t": value}
    inside = bool(region_contains(law, None, at))
    given = tuple(
        GivenFactor(f.symbol, f.unit, at[f.symbol], f.low, f.high, _item(beyond))
        for f, beyond in zip(law.factors, _beyond(law, checked_values(law, at)), strict=True)
    )
    words = f"time at which {law.response} reaches {life.criterion:g} {life.unit_of_wear}"
    return LifePrediction(
        response="T", unit=life.unit, value=value, low=low, high=high, inside=inside,
        of=f"{words}; {100 * asked.level:g} % interval of {of}, by Fieller's theorem,", kind=asked.kind, edge="new",
        centre="median", level=asked.level, coverage=None, given=given, by=None, error="multiplicative",
    )  # fmt: skip


def life_root(law: LawFields, criterion: float, factors: Mapping[str, float], quantile: float, extra: float) -> Root:
    """Logarithm of the time at which a wear law reaches the criterion; ``extra`` is the variance about the law."""
    z = terms(law, None, {**factors, "t": 1.0})
    return solved_for(
        law.theta, covariance_of(law), z, law.parameter_names.index("t"), float(np.log(criterion)), quantile, extra
    )


def edge_scatter(law: LawFields, life: ToolLifeSection) -> tuple[float, str]:
    """Variance of ln wear of one new edge about its law, of one row where edges are not known, and its words."""
    e = law.edges
    sd, of = (law.residual_se, "one row") if e is None or e.sd_between is None else (e.sd_between, "one new edge")
    if sd is None:
        raise ParameterError(f"the law of {law.response} has no residual standard error: no interval of one edge.")
    return (sd if law.error == "multiplicative" else sd / life.criterion) ** 2, of


def _beyond(law: LawFields, values: list[NDArray[np.float64]]) -> list[NDArray[np.intp]]:
    """For each factor, -1 below its tested range, 1 above it: by the criterion of `region_contains`."""
    if law.region is None:
        pairs = zip(values, law.factors, strict=True)
        return [(value > f.high).astype(np.intp) - (value < f.low) for value, f in pairs]
    U = region.coded(law.region.model_dump(), np.stack(values, axis=-1))
    return list(np.moveaxis(np.where(np.abs(U) > 1 + region.ROUNDING, np.sign(U), 0).astype(np.intp), -1, 0))


def _item(array: NDArray[Any]) -> Any:  # noqa: ANN401
    return array if array.ndim else array.item()


def _one(number: Any, i: int) -> Any:  # noqa: ANN401
    return np.ravel(number)[i]


def _plain(number: Any) -> Any:  # noqa: ANN401
    return np.asarray(number).tolist()


def _with(number: str, unit: str) -> str:
    return f"{number} {unit}".rstrip()


def _beyond_words(given: GivenFactor, i: int, side: int) -> str:
    """A factor beyond its tested range, above it where ``side`` is positive."""
    value = _with(plain(_one(given.value, i), 6 if given.source is None else 3), given.unit)
    end, which = (given.high, "highest") if side > 0 else (given.low, "lowest")
    return f"{given.symbol} {value} is {SIDES[side]} {_with(plain(end), given.unit)}, the {which} tested"
