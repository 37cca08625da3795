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
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, WithJsonSchema, model_validator
from pydantic_core import PydanticKnownError

from ...core.verdict import DO_NOT_USE, LEVELS
from ..messages import short
from .base import Count, Covariance, NoCovariance, NotNegative, Number, Positive, Section, Text, VerdictSection
from .law_parts import (
    CompositeLaw,
    DroppedRows,
    Edges,
    Factor,
    LawCheck,
    LawWithoutSuspects,
    LeftOutFactor,
    LevelShifts,
    Published,
    Region,
    Statistics,
)


@dataclass(frozen=True, slots=True)
class EquationForm:
    """Link, terms and coefficients of one form of law.

    Attributes
    ----------
    logarithmic : bool
        Whether the linear form is that of the logarithm of the response.
    log_factors : bool
        Whether the factors enter by their logarithms, and are therefore above zero.
    coefficients : tuple of str, or None
        Names, the constant first; None: ``c0`` and the symbols of the factors.
    """

    logarithmic: bool
    log_factors: bool
    coefficients: tuple[str, ...] | None


# Every form of a parameter file; those that are fitted stand in `fit.laws.FORMS` too.
FORMS: dict[str, EquationForm] = {
    "power": EquationForm(True, True, None),
    "exponential": EquationForm(True, False, ("a", "b")),
    "load_line": EquationForm(False, False, ("A", "B", "k1")),
    "feed_line": EquationForm(False, False, ("fm0", "slope")),
}


def _known(form: str) -> str:
    if form not in FORMS:
        *names, last = map(repr, FORMS)
        raise PydanticKnownError("literal_error", {"expected": f"{', '.join(names)} or {last}"})
    return form


FormName = Annotated[str, AfterValidator(_known), WithJsonSchema({"enum": list(FORMS), "type": "string"})]
# options of predict, interval and get_prediction: no factor can have these names
OPTION_NAMES = ("level", "kind", "by", "edge", "coverage", "centre")


class LawFields(Section):
    """Contents of a law section, without its predictions."""

    form: FormName
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
    verdict: VerdictSection | None = None
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
    without: LawWithoutSuspects | None = None
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        _check_coefficients(self)
        _check_form(self)
        _check_verdict(self)
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
        return FORMS[self.form].coefficients or ("c0", *(factor.symbol for factor in self.factors))

    @property
    def logarithmic(self) -> bool:
        """Whether the law is linear for the logarithm of its response."""
        return FORMS[self.form].logarithmic

    @property
    def log_factors(self) -> bool:
        """Whether the factors enter by their logarithms, and are therefore above zero."""
        return FORMS[self.form].log_factors

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of theta: the constant as its logarithm where the law is logarithmic, shifts last."""
        constant, *others = self.coefficient_names
        head = f"ln {constant}" if self.logarithmic else constant
        return (head, *others, *(self.by.names if self.by else ()))

    @property
    def theta(self) -> NDArray[np.float64]:
        """Parameters, shape (p,), in the order of `parameter_names`."""
        first, *others = (self.coefficients[name] for name in self.coefficient_names)
        head = math.log(first) if self.logarithmic else first
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
    if law.logarithmic and law.coefficients[names[0]] <= 0:
        raise ValueError(f"{names[0]} = {law.coefficients[names[0]]:g} of {law.response} must be positive")
    unknown = set(law.standard_errors) - {*names, *(law.by.names if law.by else ())}
    if unknown:
        raise ValueError(f"the law of {law.response} has no parameter {_listed(sorted(unknown))} for a standard error")


def _check_form(law: LawFields) -> None:
    if not law.logarithmic and law.error == "multiplicative":
        raise ValueError(f"a {law.form} has additive errors")
    if law.error == "multiplicative" and law.residual_se is not None and law.residual_scale != "ln":
        raise ValueError(f"the residual of a multiplicative law is in ln, not in {short(law.residual_scale)}")


def _check_verdict(law: LawFields) -> None:
    """Refuse a verdict that is better than the worst check of the law."""
    worst = max(law.checks, key=lambda name: law.checks[name].concern, default=None)
    if law.verdict is None or worst is None or law.verdict.concern >= min(law.checks[worst].concern, DO_NOT_USE):
        return
    needed = LEVELS[min(law.checks[worst].concern, DO_NOT_USE)]
    raise ValueError(
        f"the verdict on {law.response} is '{law.verdict.level}', but its check {short(worst)} is '{needed}'"
    )


def _listed(names: Iterable[str]) -> str:
    return ", ".join(short(name).strip("'") for name in names) or "nothing"
