"""Base of all sections: `Section`, its kinds of numbers and text, covariances, and polynomials of models."""

import math
from collections.abc import Sequence
from datetime import datetime
from typing import Annotated, Literal, Self, TypeVar

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from ...core.display import Displayable
from ...core.errors import ParameterError
from ...core.verdict import LEVELS, USABLE, Verdict
from ..messages import short


def _is_a_date(text: str) -> str:
    try:
        datetime.fromisoformat(text)
    except ValueError:
        raise ValueError(f"{short(text)} is not an ISO date such as 2024-05-01") from None
    return text


# strict: a number in quotes, or true for 1, is an error in the file
Number = Annotated[float, Field(strict=True)]
NotNegative = Annotated[float, Field(strict=True, ge=0)]
Positive = Annotated[float, Field(strict=True, gt=0)]
Share = Annotated[float, Field(strict=True, ge=0, le=1)]
Count = Annotated[int, Field(strict=True, ge=0, lt=2**63)]
Text = Annotated[str, Field(min_length=1)]
Name = Annotated[str, Field(min_length=1, max_length=500)]
Level = Literal["usable inside the tested region", "usable with reservations", "do not use for control"]
MOST_COEFFICIENTS = 100  # of a polynomial: roots take time with the cube
Polynomial = Annotated[tuple[Number, ...], Field(min_length=1, max_length=MOST_COEFFICIENTS)]
IsoDate = Annotated[str, AfterValidator(_is_a_date)]
Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


def check_length(count: int, delay: int, sample_time: float) -> None:
    """Raise ParameterError for a model of more coefficients than a file holds, with the rate that it needs.

    Parameters
    ----------
    count : int
        Coefficients of its longest polynomial.
    delay : int
        Samples.
    sample_time : float
        s.
    """
    if count > MOST_COEFFICIENTS:
        every = math.ceil(2 * count / MOST_COEFFICIENTS)
        rate = 1 / (every * sample_time)
        raise ParameterError(
            f"the model has {count} coefficients, its delay of {delay} samples included; a parameter file holds "
            f"{MOST_COEFFICIENTS}. Resample the record to {rate:.3g} Hz (--resample), or, of steps, "
            f"keep one of {every} rows of the file."
        )


class Section(Displayable, BaseModel):
    """A section or part of the file: frozen, without NaN or infinity; unknown fields are kept.

    Examples
    --------
    >>> class Limits(Section):
    ...     feed: Number
    >>> Limits(feed=0.4, later="kept").model_dump()
    {'feed': 0.4, 'later': 'kept'}
    """

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False, defer_build=True)


class VerdictSection(Section):
    """How far a result can be used: one of three levels, a sentence for each reservation, and what was checked.

    ``not_checked`` names each check that was not computed, with its reason.

    Examples
    --------
    >>> VerdictSection(level="usable with reservations", reasons=["The file names no edges."]).concern
    1
    """

    level: Level
    reasons: tuple[Text, ...] = ()
    checked: tuple[Text, ...] = ()
    not_checked: tuple[Text, ...] = ()

    @model_validator(mode="after")
    def _reasons_of_the_level(self) -> Self:
        if (self.concern > USABLE) != bool(self.reasons):
            number = len(self.reasons)
            raise ValueError(f"the verdict '{self.level}' has {number} reasons; only the levels below it have reasons")
        return self

    @classmethod
    def of(cls, verdict: Verdict) -> Self:
        """The section of a verdict; a level without a reason, which no check should give, names itself as one."""
        reasons = tuple(filter(None, verdict.reasons)) or ((f"{verdict.words}.",) if verdict.level else ())
        return cls.model_validate(
            {
                "level": verdict.words,
                "reasons": reasons,
                "checked": verdict.checked,
                "not_checked": verdict.not_checked,
            }
        )

    @property
    def verdict(self) -> Verdict:
        """The verdict that the section holds."""
        return Verdict(self.concern, self.reasons, self.checked, self.not_checked)

    @property
    def concern(self) -> int:
        """0 usable inside the tested region; 1 usable with reservations; 2 do not use for control."""
        return LEVELS.index(self.level)


T = TypeVar("T", bound=Section)
ROUNDING = 1e-9  # of a correlation: a matrix printed by another program keeps about ten digits
MOST = 200  # parameters: checking a matrix takes time with the cube of their number


class Covariance(Section):
    """Covariance of the law's parameters: (p, p), in the order of ``of``, with the ``df`` of its t.

    ``method`` is rows taken as independent, or the jackknife by edge.

    Examples
    --------
    >>> Covariance(of=["ln c0", "V"], matrix=[[0.9, -0.19], [-0.19, 0.0405]], df=6).df
    6
    """

    kind: Literal["covariance"] = "covariance"
    method: str = "rows taken as independent"
    of: Annotated[tuple[str, ...], Field(max_length=MOST)]
    matrix: Annotated[tuple[tuple[Number, ...], ...], Field(max_length=MOST)]
    df: Annotated[int, Field(strict=True, ge=1, lt=2**63)]

    @model_validator(mode="after")
    def _is_a_covariance(self) -> Self:
        return checked(self, self.of, self.matrix)


class ModelCovariance(Section):
    """Covariance of the coefficients of a model, (p, p), in the order of ``of``; ``df`` where it is known.

    Examples
    --------
    >>> ModelCovariance(of=["a1", "b1"], matrix=[[0.04, 0.0], [0.0, 0.01]]).df is None
    True
    """

    kind: Literal["covariance"] = "covariance"
    of: Annotated[tuple[str, ...], Field(max_length=MOST)]
    matrix: Annotated[tuple[tuple[Number, ...], ...], Field(max_length=MOST)]
    df: Count | None = None

    @model_validator(mode="after")
    def _is_a_covariance(self) -> Self:
        return checked(self, self.of, self.matrix)


class NoCovariance(Section):
    """Absence of a covariance, with the reason, for instance as many observations as parameters.

    Examples
    --------
    >>> NoCovariance(reason="4 observations, 4 parameters").kind
    'none'
    """

    kind: Literal["none"] = "none"
    reason: Text


def checked(section: T, of: tuple[str, ...], matrix: tuple[tuple[float, ...], ...]) -> T:
    """The section, if ``matrix`` is a covariance of the parameters ``of``; otherwise ValueError with the reason."""
    size = len(of)
    if len(set(of)) < size:
        raise ValueError("a parameter is named twice in 'of'")
    if len(matrix) != size or any(len(row) != size for row in matrix):
        raise ValueError(f"the matrix must be {size} x {size}, as 'of' names {size} parameters")
    why = covariance_error(np.array(matrix, dtype=np.float64).reshape(size, size))
    if why:
        raise ValueError(why)
    return section


def covariance_error(matrix: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> str | None:
    """Reason why a square matrix is not a covariance, or None; its correlations are tested, independent of units."""
    variance = matrix.diagonal()
    if (variance < 0).any():
        return "a variance on the diagonal is negative"
    deviation = np.sqrt(np.where(variance > 0, variance, 1.0))
    with np.errstate(over="ignore", under="ignore"):
        correlation = matrix / deviation / deviation[:, None]
    if not (np.abs(correlation) <= 1 + ROUNDING).all():
        return "a covariance is larger than its two variances allow"
    if not np.allclose(correlation, correlation.T, rtol=0, atol=ROUNDING):
        return "the matrix is not symmetric"
    if len(matrix) and np.linalg.eigvalsh(correlation)[0] < -len(matrix) * ROUNDING:
        return "the matrix is not a covariance: some combination of the parameters has a negative variance"
    return None


def coefficient_names(b: Sequence[float], a: Sequence[float], nk: int) -> tuple[str, ...]:
    """Names of the estimated coefficients: a1 ..., then b<nk> ...

    >>> coefficient_names([0.0, 0.5], [1.0, -0.5], 1)
    ('a1', 'b1')
    """
    return (*(f"a{i}" for i in range(1, len(a))), *(f"b{j}" for j in range(nk, len(b))))


def check_polynomials(
    b: Sequence[float], a: Sequence[float], nk: int, uncertainty: ModelCovariance | NoCovariance
) -> None:
    """Raise ValueError unless a starts with 1, b with nk zeros, and the covariance is of their coefficients."""
    if a[0] != 1:
        raise ValueError(f"a starts with 1, not with {a[0]:g}")
    if len(b) <= nk or any(b[:nk]):
        raise ValueError(f"b with nk {nk} begins with {nk} zeros, then its coefficients")
    names = coefficient_names(b, a, nk)
    if isinstance(uncertainty, ModelCovariance) and set(uncertainty.of) != set(names):
        raise ValueError(f"the covariance must be of {', '.join(names)}")
