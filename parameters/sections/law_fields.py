"""Fields of a law section, checked against its formula (`core.formula`).

An exponent has the name of its factor's symbol, a term of second order ``V^2`` or ``V*f``, a shift ``material[2]``. The
column of a shift is 1 at its level and 0 elsewhere, so that it multiplies a logarithmic law by exp(shift) and moves a
line. Link and columns give both the prediction and the gradient of its interval.
"""

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, WithJsonSchema, model_validator
from pydantic_core import PydanticKnownError

from ...core.arrays import Array
from ...core.formula import FORMS, Formula, Term
from ...core.verdict import DO_NOT_USE, LEVELS
from ..messages import short
from .base import Count, Covariance, NoCovariance, NotNegative, Number, Positive, Section, Text, VerdictSection
from .edge_sums import LawSums
from .law_parts import (
    CompositeLaw,
    DroppedRows,
    Edges,
    Factor,
    LawCheck,
    LawWithoutSuspects,
    LeftOutFactor,
    LevelShifts,
    LifeSection,
    Published,
    Region,
    Statistics,
    TermSection,
)


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
    terms: tuple[TermSection, ...] = ()
    centres: dict[str, Number] = Field(default_factory=dict)
    fixed: dict[str, Number] = Field(default_factory=dict)
    life: LifeSection | None = None
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
    sums: LawSums | None = None
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
        if self.region is not None and len(self.region.centre) != len(self.factors):
            found = f"{len(self.region.centre)} factors, the law {len(self.factors)}"
            raise ValueError(f"the region of {self.response} has {found}")
        columns = (*self.parameter_names[1:], self.response)
        if self.sums is not None and self.sums.edges and self.sums.columns != columns:
            found = _listed(self.sums.columns)
            raise ValueError(f"the sums of {self.response} are of {found}; they must be of {_listed(columns)}")
        other = self.alternative
        if other and (other.response != self.response or other.error == self.error or other.alternative):
            raise ValueError(f"the alternative must be one law of {self.response} with the other error structure")
        return self

    @property
    def formula(self) -> Formula:
        """The equation: its form, terms and centres, which give columns, names of the coefficients and text."""
        symbols = tuple([factor.symbol for factor in self.factors])
        if not (self.terms or self.centres or self.fixed):
            return _first_order(self.form, self.response, symbols)
        terms = tuple(Term(term.name, tuple(term.powers.get(symbol, 0) for symbol in symbols)) for term in self.terms)
        centres = tuple(self.centres[symbol] for symbol in symbols) if self.centres else ()
        return Formula(self.form, self.response, symbols, terms, centres, tuple(self.fixed.items()))

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Names of the coefficients, the constant first."""
        return self.formula.names

    @property
    def logarithmic(self) -> bool:
        """Whether the law is linear for the logarithm of its response."""
        return FORMS[self.form].log_response

    @property
    def log_factors(self) -> bool:
        """Whether every factor enters by its logarithm, and is therefore above zero."""
        return self.formula.log_factors

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of theta: the constant as its logarithm where the law is logarithmic, shifts last."""
        constant, *others = self.coefficient_names
        head = f"ln {constant}" if self.logarithmic else constant
        return (head, *others, *(self.by.names if self.by else ()))

    @property
    def theta(self) -> Array:
        """Parameters, shape (p,), in the order of `parameter_names`."""
        first, *others = (self.coefficients[name] for name in self.coefficient_names)
        head = math.log(first) if self.logarithmic else first
        return np.array([head, *others, *(self.by.shifts.values() if self.by else ())])

    @property
    def deviations(self) -> tuple[float, float] | None:
        """Standard deviations between and within edges; None where the file does not hold both."""
        e = self.edges
        return None if e is None or e.sd_between is None or e.sd_within is None else (e.sd_between, e.sd_within)


_first_order = lru_cache(maxsize=256)(Formula)  # of first order, with nothing but names


def _check_coefficients(law: LawFields) -> None:
    symbols = [factor.symbol for factor in law.factors]
    if len(set(symbols)) < len(symbols):
        raise ValueError(f"the law of {law.response} names a factor twice: {_listed(symbols)}")
    reserved = [symbol for symbol in symbols if symbol in (*OPTION_NAMES, "c0")]
    if reserved:
        raise ValueError(f"no factor can be called {reserved[0]}; give it another symbol")
    _check_formula(law, symbols)
    names = law.coefficient_names
    if set(law.coefficients) != set(names) or len(set(names)) < len(names):
        given = f"{_listed(symbols)} has the coefficients {_listed(law.coefficients)}"
        raise ValueError(f"the {law.form} law of {law.response} in {given}, not {_listed(names)}")
    if law.logarithmic and law.coefficients[names[0]] <= 0:
        raise ValueError(f"{names[0]} = {law.coefficients[names[0]]:g} of {law.response} must be positive")
    unknown = set(law.standard_errors) - {*names, *(law.by.names if law.by else ())}
    if unknown:
        raise ValueError(f"the law of {law.response} has no parameter {_listed(sorted(unknown))} for a standard error")


def _check_formula(law: LawFields, symbols: list[str]) -> None:
    named = {*law.centres, *law.fixed, *(symbol for term in law.terms for symbol in term.powers)}
    if strange := sorted(named - set(symbols)):
        raise ValueError(f"the law of {law.response} has no factor {_listed(strange)}; it has {_listed(symbols)}")
    if law.centres and (missing := [symbol for symbol in symbols if symbol not in law.centres]):
        raise ValueError(f"the law of {law.response} has no centre of {_listed(missing)}")
    if fault := law.formula.fault:
        raise ValueError(f"{law.response}: {fault}")
    moved = [symbol for symbol, value in law.fixed.items() if law.coefficients.get(symbol) != value]
    if moved:
        raise ValueError(f"{moved[0]} of the law of {law.response} is fixed at {law.fixed[moved[0]]:g}, not its value")


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
