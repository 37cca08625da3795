"""The law section: one fitted equation with its domain, its uncertainty and its statistics."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from ...core.errors import ParameterError
from ...core.intervals import Centre, Edge, Kind
from ...datasets import region
from ..errors import short
from ..evaluate import (
    LOGARITHMIC,
    as_given,
    checked_values,
    coefficient_names,
    parameter_names,
    response,
    terms,
    theta,
)
from ..intervals import IntervalOptions, band
from ..prediction import Prediction, tell
from .base import Count, NotNegative, Number, Positive, Section, Text
from .covariance import Covariance, NoCovariance
from .law_parts import (
    CompositeLaw,
    DroppedRows,
    Edges,
    Factor,
    LawCheck,
    LeftOutFactor,
    LevelShifts,
    Published,
    Region,
    Statistics,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# arguments of predict, interval and tell: no factor can be called so
KEPT = ("level", "kind", "by", "edge", "coverage", "centre")

EXAMPLE: Mapping[str, object] = {  # the law of the examples below
    "form": "power",
    "response": "AW",
    "quantity": "flank wear",
    "unit": "mm",
    "equation": "AW = 0.01 V^0.5",
    "error": "multiplicative",
    "coefficients": {"c0": 0.01, "V": 0.5},
    "factors": [{"symbol": "V", "quantity": "cutting speed", "unit": "m/min", "low": 50.0, "high": 200.0}],
    "uncertainty": {
        "kind": "covariance",
        "of": ["ln c0", "V"],
        "matrix": [[0.9, -0.19], [-0.19, 0.0405]],
        "df": 6,
    },
    "residual_se": 0.1,
    "residual_scale": "ln",
    "n": 8,
    "df": 6,
}


class LawSection(Section):
    """One fitted equation, able to predict from the file alone.

    Attributes
    ----------
    form, error : str
        ``power``, ``exponential``, ``load_line`` or ``feed_line``; ``multiplicative`` or ``additive``.
    response, quantity, unit, equation : str
        Symbol, words, unit, and the equation with its numbers at six digits, for people.
    coefficients : dict of float
        c0 and each factor's exponent; or a, b; or A, B, k1; or fm0, slope: for the units of
        ``response`` and ``factors`` and the reference level of ``by``.
    factors : tuple of Factor
        Symbol, unit and domain of each.
    by : By or None
        Levels that share the exponents, and the shift of each from the reference.
    uncertainty : Covariance or NoCovariance
        Covariance of ``ln c0`` (``ln a``), the exponents and the shifts; of A, B, k1 as they are.
    residual_se : float or None
        Standard deviation about the law, in ``residual_scale``: ``ln`` or the response's unit.
    smearing : float or None
        Mean of exp(residual) where errors multiply: over edges, which count alike, or over independent rows.
    n, df : int
        Observations and residual degrees of freedom, rows taken as independent.
    n_edges : int or None
        Cutting edges among the observations, where the data name them.
    statistics, standard_errors, left_out, dropped_rows, notes
        What the fit has to say of itself; standard errors are those of ``coefficients`` and shifts.
    alternative : Law or None
        The same law fitted with the other error structure.
    region : Region or None
        Where the design lies: the window of operation.
    edges : Edges or None
        What the cutting edges say: variance split, and F of what only edges can tell.
    checks : dict of LawCheck
        Adequacy of the law, check by check.
    verdicts : tuple of str
        What the checks say, worst first, in at most six plain sentences.
    checked_rows : int or None
        Rows that were checked: of very many an even choice.
    row_standard_errors : dict of float
        Standard errors with rows taken as independent, as the papers print them, where others are by edge.
    published : Published or None
        What a paper prints for the same response, tool and work.
    composite : Composite or None
        The law with its wear put in from the wear law.

    Examples
    --------
    >>> law = LawSection.model_validate(EXAMPLE)
    >>> round(law.predict(V=100.0), 9)
    0.1
    """

    form: Literal["power", "exponential", "load_line", "feed_line"]
    response: Text
    quantity: str
    unit: str
    equation: str
    error: Literal["multiplicative", "additive"]
    coefficients: dict[str, Number]
    factors: tuple[Factor, ...]
    by: LevelShifts | None = None
    uncertainty: Annotated[Covariance | NoCovariance, Field(discriminator="kind")]
    residual_se: NotNegative | None = None
    residual_scale: str
    smearing: Positive | None = None
    n: Count
    df: Count
    n_edges: Count | None = None
    statistics: Statistics = Statistics()
    region: Region | None = None
    edges: Edges | None = None
    checks: dict[str, LawCheck] = Field(default_factory=dict)
    verdicts: tuple[str, ...] = ()
    checked_rows: Count | None = None
    row_standard_errors: dict[str, NotNegative] = Field(default_factory=dict)
    standard_errors: dict[str, NotNegative] = Field(default_factory=dict)
    left_out: tuple[LeftOutFactor, ...] = ()
    dropped_rows: tuple[DroppedRows, ...] = ()
    alternative: "LawSection | None" = None
    published: Published | None = None
    composite: CompositeLaw | None = None
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        _check_coefficients(self)
        _check_form(self)
        if isinstance(self.uncertainty, Covariance) and set(self.uncertainty.of) != set(parameter_names(self)):
            names = f"{_listed(self.uncertainty.of)}; it must be of {_listed(parameter_names(self))}"
            raise ValueError(f"the covariance of {self.response} is of {names}")
        other = self.alternative
        if other and (other.response != self.response or other.error == self.error or other.alternative):
            raise ValueError(f"the alternative must be one law of {self.response} with the other error structure")
        return self

    def predict(self, by: str | None = None, **factors: ArrayLike) -> Any:  # noqa: ANN401
        """Tell the response at the given factors, from the coefficients alone.

        Of a multiplicative law this is the median of the response, not its mean; of an additive law
        it is the mean.

        Parameters
        ----------
        by : str, optional
            Level of the ``by`` column; needed where the law has one.
        **factors : float or array_like
            Every factor of the law by its symbol, in the unit of the file; they broadcast.

        Returns
        -------
        float or ndarray
            In the law's unit: a float when every factor is one number.

        Raises
        ------
        ParameterError
            A factor is missing, unknown, or not a number the law can take; the level is unknown.

        Examples
        --------
        >>> law = LawSection.model_validate(EXAMPLE)
        >>> law.predict(V=[100.0, 200.0]).round(6).tolist()
        [0.1, 0.141421]
        """
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            return as_given(self, response(self, terms(self, by, factors) @ theta(self)))

    def interval(
        self,
        level: float = 0.95,
        kind: Kind = "mean",
        by: str | None = None,
        *,
        edge: Edge = "new",
        coverage: float = 0.95,
        centre: Centre = "median",
        **factors: ArrayLike,
    ) -> tuple[Any, Any]:
        """Two-sided interval of the response by the delta method, as ``fit.interval`` gives it.

        A multiplicative law's is computed in logs and brought back; an additive law's is symmetric and may
        reach below zero.

        Parameters
        ----------
        level : float
            Confidence, between 0 and 1.
        kind : {"mean", "prediction", "tolerance"}
            Of the law itself; of one new row; or limits that hold a share ``coverage`` of all rows there.
        by : str, optional
            Level of the ``by`` column; needed where the law has one.
        edge : {"new", "same"}
            Rows of an edge not yet cut, or of one whose own level is known and stands at the law: the scatter
            within an edge, no more. Without inference by edge both are the same.
        coverage : float
            Of a tolerance interval, between 0 and 1.
        centre : {"median", "mean", "smeared"}
            What a "mean" interval bounds where errors multiply; it leaves the ends for rows alone.
        **factors : float or array_like
            As in `predict`.

        Returns
        -------
        low, high : float or ndarray
            In the law's unit.

        Raises
        ------
        ParameterError
            As in `predict`; or the file holds no covariance, and its reason is told; or it is an earlier one
            and lacks what this interval needs.

        Examples
        --------
        >>> law = LawSection.model_validate(EXAMPLE)
        >>> low, high = law.interval(V=100.0)
        >>> print(f"{low:.3f} {high:.3f}")
        0.079 0.126
        """
        found = band(self, IntervalOptions(kind, level, edge, coverage, centre), by, factors)
        return as_given(self, found.low), as_given(self, found.high)

    def tell(
        self,
        kind: Kind = "prediction",
        level: float = 0.95,
        by: str | None = None,
        *,
        edge: Edge = "new",
        coverage: float = 0.95,
        centre: Centre = "median",
        **factors: ArrayLike,
    ) -> Prediction:
        """Value, interval, and whether the point lies in the tested region: in numbers and in a sentence.

        Parameters
        ----------
        kind, level, by, edge, coverage, centre, **factors
            As in `interval`; ``centre`` is what the value is, where errors multiply.

        Raises
        ------
        ParameterError
            As in `interval`.

        Examples
        --------
        >>> law = LawSection.model_validate(EXAMPLE)
        >>> print(law.tell(V=100.0).words)
        AW 0.100 mm at V 100 m/min; 95 % prediction interval for one row 0.071 to 0.140 mm; inside the tested region.
        """
        return tell(self, IntervalOptions(kind, level, edge, coverage, centre), by, factors)

    def inside(self, by: str | None = None, **factors: ArrayLike) -> Any:  # noqa: ANN401
        """Tell which points lie in the region of the design: a law says nothing about where nobody cut.

        Inside is within every factor's range and, where the file holds the region, no further out by leverage
        and coded radius than the design's furthest point.

        Parameters
        ----------
        by : str, optional
            Level of the ``by`` column; its reference level unless given.
        **factors : float or array_like
            As in `predict`.

        Returns
        -------
        bool or ndarray of bool
            A bool when every factor is one number.

        Raises
        ------
        ParameterError
            A factor is missing, unknown, or not a number the law can take.

        Examples
        --------
        >>> law = LawSection.model_validate(EXAMPLE)
        >>> law.inside(V=[100.0, 300.0]).tolist()
        [True, False]
        """
        values = checked_values(self, factors)
        if self.region is not None:
            inside = np.asarray(region.inside(self.region.model_dump(), np.stack(values, axis=-1), self._level_of(by)))
        else:
            pairs = zip(values, self.factors, strict=True)
            inside = np.logical_and.reduce([(value >= f.low) & (value <= f.high) for value, f in pairs])
        return inside if np.ndim(inside) else bool(inside)

    def _level_of(self, by: str | None) -> str | None:
        known = () if self.by is None else (self.by.reference, *self.by.shifts)
        if by is not None and by not in known:
            raise ParameterError(f"the law of {self.response} has no level {short(by)}; it has {_listed(known)}.")
        return by

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Each coefficient but the constant, within two standard errors."""
        from ..draw import law_picture

        return law_picture(self, ax)


def _check_coefficients(law: LawSection) -> None:
    symbols = [factor.symbol for factor in law.factors]
    if len(set(symbols)) < len(symbols):
        raise ValueError(f"the law of {law.response} names a factor twice: {_listed(symbols)}")
    kept = [symbol for symbol in symbols if symbol in (*KEPT, "c0")]
    if kept:
        raise ValueError(f"no factor can be called {kept[0]}; give it another symbol")
    names = coefficient_names(law.form, symbols)
    if set(law.coefficients) != set(names) or len(names) != 1 + len(symbols):
        given = f"{_listed(symbols)} has the coefficients {_listed(law.coefficients)}"
        raise ValueError(f"the {law.form} law of {law.response} in {given}, not {_listed(names)}")
    if law.form in LOGARITHMIC and law.coefficients[names[0]] <= 0:
        raise ValueError(f"{names[0]} = {law.coefficients[names[0]]:g} of {law.response} must be positive")
    unknown = set(law.standard_errors) - {*names, *(law.by.names if law.by else ())}
    if unknown:
        raise ValueError(f"the law of {law.response} has no parameter {_listed(sorted(unknown))} for a standard error")


def _check_form(law: LawSection) -> None:
    if law.form not in LOGARITHMIC and law.error == "multiplicative":
        raise ValueError(f"a {law.form} has additive errors")
    if law.error == "multiplicative" and law.residual_se is not None and law.residual_scale != "ln":
        raise ValueError(f"the residual of a multiplicative law is in ln, not in {short(law.residual_scale)}")


def _listed(names: Iterable[str]) -> str:
    return ", ".join(short(name).strip("'") for name in names) or "nothing"
