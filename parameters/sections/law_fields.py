"""Fields of a law section, checked against the form of its equation.

=============  ======================  ==========================  =============  ======
form           equation                parameters theta            terms          link
=============  ======================  ==========================  =============  ======
power          R = c0 prod x_j^b_j     ln c0, x_1 ... x_k, shifts  1, ln x_j, 1   ln
exponential    R = a exp(b F)          ln a, b, shifts             1, F, 1        ln
load_line      I = A + B fm + k1 VB    A, B, k1, shifts            1, fm, VB, 1   none
feed_line      fm = fm0 + slope VB     fm0, slope, shifts          1, VB, 1       none
=============  ======================  ==========================  =============  ======

An exponent has the name of its factor's symbol, a shift ``material[2]``. The term of a shift is 1 at its level and 0
elsewhere, so that it multiplies a logarithmic law by exp(shift) and moves a line. Link and terms give both the
prediction and the gradient of its interval.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ..messages import short
from .base import Count, Covariance, NoCovariance, NotNegative, Number, Positive, Section, Text
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

LOGARITHMIC = ("power", "exponential")
# the coefficients of each form, the constant first; a power law adds the symbols of its factors
COEFFICIENTS: Mapping[str, tuple[str, ...]] = {
    "power": ("c0",),
    "exponential": ("a", "b"),
    "load_line": ("A", "B", "k1"),
    "feed_line": ("fm0", "slope"),
}
# options of predict, interval and get_prediction: no factor can have these names
OPTION_NAMES = ("level", "kind", "by", "edge", "coverage", "centre")


def coefficient_names(form: str, symbols: Iterable[str]) -> tuple[str, ...]:
    """Names of a form's coefficients: the constant, then one for each factor in order."""
    return COEFFICIENTS[form] + (tuple(symbols) if form == "power" else ())


class LawFields(Section):
    """Contents of a law section, without its predictions."""

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
    alternative: "LawFields | None" = None
    published: Published | None = None
    composite: CompositeLaw | None = None
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        _check_coefficients(self)
        _check_form(self)
        names = self.parameter_names
        if isinstance(self.uncertainty, Covariance) and set(self.uncertainty.of) != set(names):
            found = _listed(self.uncertainty.of)
            raise ValueError(f"the covariance of {self.response} is of {found}; it must be of {_listed(names)}")
        other = self.alternative
        if other and (other.response != self.response or other.error == self.error or other.alternative):
            raise ValueError(f"the alternative must be one law of {self.response} with the other error structure")
        return self

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Names of the coefficients, the constant first."""
        return coefficient_names(self.form, (factor.symbol for factor in self.factors))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of theta: the constant as its logarithm where the law is logarithmic, shifts last."""
        constant, *others = self.coefficient_names
        head = f"ln {constant}" if self.form in LOGARITHMIC else constant
        return (head, *others, *(self.by.names if self.by else ()))

    @property
    def theta(self) -> NDArray[np.float64]:
        """Parameters, shape (p,), in the order of `parameter_names`."""
        first, *others = (self.coefficients[name] for name in self.coefficient_names)
        head = math.log(first) if self.form in LOGARITHMIC else first
        return np.array([head, *others, *(self.by.shifts.values() if self.by else ())])


def _check_coefficients(law: LawFields) -> None:
    symbols = [factor.symbol for factor in law.factors]
    if len(set(symbols)) < len(symbols):
        raise ValueError(f"the law of {law.response} names a factor twice: {_listed(symbols)}")
    reserved = [symbol for symbol in symbols if symbol in (*OPTION_NAMES, "c0")]
    if reserved:
        raise ValueError(f"no factor can be called {reserved[0]}; give it another symbol")
    names = law.coefficient_names
    if set(law.coefficients) != set(names) or len(names) != 1 + len(symbols):
        given = f"{_listed(symbols)} has the coefficients {_listed(law.coefficients)}"
        raise ValueError(f"the {law.form} law of {law.response} in {given}, not {_listed(names)}")
    if law.form in LOGARITHMIC and law.coefficients[names[0]] <= 0:
        raise ValueError(f"{names[0]} = {law.coefficients[names[0]]:g} of {law.response} must be positive")
    unknown = set(law.standard_errors) - {*names, *(law.by.names if law.by else ())}
    if unknown:
        raise ValueError(f"the law of {law.response} has no parameter {_listed(sorted(unknown))} for a standard error")


def _check_form(law: LawFields) -> None:
    if law.form not in LOGARITHMIC and law.error == "multiplicative":
        raise ValueError(f"a {law.form} has additive errors")
    if law.error == "multiplicative" and law.residual_se is not None and law.residual_scale != "ln":
        raise ValueError(f"the residual of a multiplicative law is in ln, not in {short(law.residual_scale)}")


def _listed(names: Iterable[str]) -> str:
    return ", ".join(short(name).strip("'") for name in names) or "nothing"
