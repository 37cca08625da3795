"""Predictions: value, interval, and whether the point lies in the tested region, as numbers and as a sentence."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import log
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .display import Display, Displayable, Plottable, TextTable, by_fields, display_of, plot
from .intervals import Root
from .rounding import format_plain as plain
from .rounding import format_rounded, with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

SIDES = {-1: "below", 1: "above"}
EXTRAPOLATED = 1.05  # times the longest test; below, the ratio rounds to 1 and the last steps of wear are alike
COMBINATION = "the combination is farther from the centre of the tests than any test"  # each factor in its range
MOST_SHOWN = 20  # points of a table


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
    longest : float or None
        Longest test, in ``unit``, of a tool life: a longer life is an extrapolation, and not ``inside``.
    unreached : str
        Why no test shows a tool life, where none reached the criterion; then none is ``inside``.
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
    longest: float | None = None
    unreached: str = ""

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
            **({} if self.longest is None else {"longest_test": self.longest}),
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
            return f"inside the tested region{self._upper_end(i)}"
        beyond, why = self._beyond_tests(i), self._outside(i)
        if not beyond and not why:
            why = [COMBINATION]
        region = [f"outside the tested region: {', and '.join(why)}"] if why else []
        return "; ".join([*beyond, *region, "do not rely on it"])

    def _beyond_tests(self, i: int) -> list[str]:
        """Extrapolation of a tool life in time, and a criterion that no test reached."""
        value, longest = float(_one(self.value, i)), self.longest
        if longest is not None and value > EXTRAPOLATED * longest:
            return [f"EXTRAPOLATED: {value / longest:.2g} times the longest test ({_with(plain(longest), self.unit)})"]
        return [f"EXTRAPOLATED: {self.unreached}"] if self.unreached else []

    def _upper_end(self, i: int) -> str:
        """Places where the upper end of the interval of a tool life is longer than any test."""
        if self.longest is None or float(_one(self.high, i)) <= self.longest:
            return ""
        return f", but the upper end is EXTRAPOLATED: the longest test lasted {_with(plain(self.longest), self.unit)}"

    def _outside(self, i: int) -> list[str]:
        """Factors outside their tested ranges, and those from outside the region of their own law."""
        why = [_beyond_words(g, i, side) for g in self._ranged() if (side := int(_one(g.beyond, i)))]
        return why + [
            f"{g.symbol} comes from outside the region of its own law"
            for g in self.given
            if g.source is not None and not _one(g.source.inside, i)
        ]

    def _ranged(self) -> tuple[GivenFactor, ...]:
        """Factors whose ranges are named."""
        return self.given

    def to_frame(self) -> "DataFrame":
        """A row per point."""
        from pandas import DataFrame

        return DataFrame({k: np.atleast_1d(getattr(self, k)) for k in ("value", "low", "high", "inside")})


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

    def _ranged(self) -> tuple[GivenFactor, ...]:
        """All but a time beyond the longest test, which is named by its ratio."""
        return tuple(g for g in self.given if g.symbol != "t" or self.longest is None or np.any(np.less(g.beyond, 0)))

    def _rounded(self, i: int) -> tuple[str, ...]:
        value, low, high = (float(np.ravel(number)[i]) for number in (self.value, self.low, self.high))
        if np.isfinite(high):
            return super(LifePrediction, self)._rounded(i)
        return plain(value, 2), plain(low, 2), "an upper end that is not bounded, in"


P = TypeVar("P", bound=Prediction)


def within_tests(found: P, longest: float | None, unreached: str = "") -> P:
    """The prediction of a tool life, ``inside`` only where a test lasted as long and one reached the criterion."""
    if longest is None:
        return found
    inside = np.asarray(found.inside) & ~(np.asarray(found.value) > EXTRAPOLATED * longest) & (not unreached)
    return replace(found, inside=single(inside), longest=longest, unreached=unreached)


def compared_time(life: Any, longest: float) -> Array:  # noqa: ANN401
    """Time at which a life is compared with the tests: that of the longest test if it is longer by less than 5 %.

    >>> compared_time([12.0, 16.3, 24.0], 16.0).tolist()
    [12.0, 16.0, 24.0]
    """
    t = np.asarray(life, dtype=float)
    return np.where(t > EXTRAPOLATED * longest, t, np.minimum(t, longest))


def unreached_words(criterion: float, largest: float | None, unit: str) -> str:
    """That no test reached the wear criterion; empty where one did or the largest wear is not known.

    >>> unreached_words(0.3, 0.221, "mm")
    'no test reached the criterion 0.3 mm (largest wear 0.221 mm)'
    """
    if largest is None or criterion <= largest:
        return ""
    return (
        f"no test reached the criterion {_with(f'{criterion:g}', unit)} (largest wear {_with(f'{largest:.3g}', unit)})"
    )


def beyond_scatter(interval: tuple[float, float] | None, expected: float | None) -> bool:
    """Whether lives by the wear curves differ from those by the wear law by more than scatter makes.

    Parameters
    ----------
    interval : (float, float) or None
        Of the ratio of the former to the latter.
    expected : float or None
        The ratio that scatter alone makes. Scatter, which the residuals of a bent curve overstate, only shortens the
        lives by the curves.

    Examples
    --------
    >>> beyond_scatter((1.2, 1.3), 0.9), beyond_scatter((0.8, 0.95), 0.9), beyond_scatter((0.9, 1.1), 0.9)
    (True, False, False)
    """
    if interval is None or expected is None:
        return False
    low, high = interval
    return not (low <= 1 <= high or expected <= high <= 1)


def doubt_of_curves(ratio: float | None, interval: tuple[float, float] | None, expected: float | None, of: Root) -> str:
    """Reason of the wear curves against the interval ``of`` the life of a new edge, in ln; empty where there is none.

    Examples
    --------
    >>> doubt_of_curves(1.27, (1.2, 1.3), 0.9, Root(2.5, 2.45, 2.55, 0.0))
    'lives read from the wear curves are 27 % longer than those of the wear law, outside its interval'
    >>> doubt_of_curves(1.27, (1.2, 1.3), 0.9, Root(2.5, 2.0, 3.0, 0.0))
    ''
    """
    if ratio is None or interval is None or not beyond_scatter(interval, expected):
        return ""
    low, high = (of.value + log(end) for end in interval)
    if of.low <= low and high <= of.high:
        return ""
    size, more = 100 * abs(ratio - 1), "longer" if ratio > 1 else "shorter"
    return f"lives read from the wear curves are {size:.2g} % {more} than those of the wear law, outside its interval"


def single(array: NDArray[Any]) -> Any:  # noqa: ANN401
    """A number where the array has no dimension."""
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


def _figure(found: Prediction, ax: "Axes | None" = None) -> "Axes":
    """Each point with its interval."""
    from .plotting import whiskers

    rows = {str(k + 1): (value, low, high) for k, (value, low, high) in enumerate(_ends(found))}
    return whiskers(rows, ax, label=with_unit(found.response, found.unit), title=found.of)


def _display(found: Prediction) -> Display:
    """The sentence of one point; a table of several."""
    if not np.ndim(found.value):
        return by_fields(found)
    header = (*(with_unit(g.symbol, g.unit) for g in found.given), with_unit(found.response, found.unit), "low", "high")
    rows = tuple(_row(found, i) for i in range(min(np.size(found.value), MOST_SHOWN)))
    n, outside = np.size(found.value), int((~np.ravel(found.inside)).sum())
    where = f"{outside} outside the tested region: do not rely on them" if outside else "all inside the tested region"
    more = (f"The first {MOST_SHOWN} of {n} points; to_frame() has all.",) if n > MOST_SHOWN else ()
    head = f"{found.response} at {n} points; {found.of}; {where}"
    return Display(head, table=TextTable((*header, "inside"), rows), sentences=more)


def _row(found: Prediction, i: int) -> tuple[str, ...]:
    """Factors, value, interval and place of one of several points."""
    given = (plain(float(_one(factor.value, i)), 6) for factor in found.given)
    value, low, high = found._rounded(i)
    high = high if np.isfinite(_one(found.high, i)) else "unbounded"
    return (*given, value, low, high, "yes" if _one(found.inside, i) else "NO")


def _ends(found: Prediction) -> list[tuple[float, ...]]:
    """Value, low and high of each point."""
    columns = (np.ravel(np.asarray(v, dtype=float)).tolist() for v in (found.value, found.low, found.high))
    return list(zip(*columns, strict=True))


plot.register(Prediction, _figure)
display_of.register(Prediction, _display)
