"""Tables of coefficients: every estimate with its standard error, t, p and interval, of laws and of models."""

import math

import numpy as np

from ...core.rounding import EXACT
from ...parameters import LawSection
from ...parameters.sections.base import Covariance, ModelCovariance
from ...parameters.sections.dynamics import DynamicsSection
from .numbers import NONE, figure, number, probability, spread
from .parts import CoefficientPart, NumberPart

LEVEL = 0.95
WIDEST = 100.0  # half width, in ln, of an interval of a constant: a wider one says nothing
NORMAL = 1.96  # quantile that the intervals of a model are told with


def law_coefficients(law: LawSection, level: float = LEVEL) -> tuple[CoefficientPart, ...]:
    """A line for each coefficient, the constant first and the shifts of a category last.

    The constant of a power or exponential law has no t: it is positive by its form, and its value only says
    which units were used.
    """
    printed = law.published.coefficients if law.published is not None and not lacking(law) else {}
    other = {} if law.alternative is None else _values(law.alternative)
    half = _half_widths(law, level)
    lines = []
    for name, value in _values(law).items():
        se = law.standard_errors.get(name)
        scale = law.form in ("power", "exponential") and name == next(iter(law.coefficients))
        t = value / se if se and not scale else None
        low, high = _ends(value, half.get(name), se, scale)
        lines.append(
            CoefficientPart(
                name=name,
                estimate=number(value, se),
                se=spread(value, se),
                t=figure(t),
                p=NONE if t is None else probability(_two_sided(t, degrees(law))),
                low=low,
                high=high,
                row_se=spread(value, law.row_standard_errors.get(name)),
                other=number(other.get(name), se),
                printed=figure(printed.get(name), 6),
            )
        )
    return tuple(lines)


def model_coefficients(d: DynamicsSection) -> tuple[CoefficientPart, ...]:
    """A line for each coefficient of a model, with its 95 % interval."""
    errors: dict[str, float] = {}
    if isinstance(d.uncertainty, ModelCovariance):
        errors = dict(zip(d.uncertainty.of, np.sqrt(np.diag(np.array(d.uncertainty.matrix))).tolist(), strict=True))
    lines = []
    for name, value in zip(d.names, [*d.a[1:], *d.b[d.nk :]], strict=True):
        se = errors.get(name)
        low, high = (value - NORMAL * se, value + NORMAL * se) if se else (None, None)
        blank = dict.fromkeys(("t", "p", "row_se", "other", "printed"), NONE)
        lines.append(
            CoefficientPart(
                name=name,
                estimate=number(value, se),
                se=spread(value, se),
                low=number(low, se),
                high=number(high, se),
                **blank,
            )
        )
    return tuple(lines)


def between(low: NumberPart, high: NumberPart) -> str:
    """Both ends of an interval, or nothing."""
    return f"{low.text} … {high.text}" if low.text else ""


def lacking(law: LawSection) -> list[str]:
    """Factors of the printed law that the fit does without."""
    printed = law.published.coefficients if law.published is not None else {}
    return [name for name in printed if name not in law.coefficients]


def degrees(law: LawSection) -> int:
    """Degrees of freedom of the law's t."""
    return law.uncertainty.df if isinstance(law.uncertainty, Covariance) else law.df


def _values(law: LawSection) -> dict[str, float]:
    shifts = {} if law.by is None else {f"{law.by.column}[{k}]": v for k, v in law.by.shifts.items()}
    return {**law.coefficients, **shifts}


def _half_widths(law: LawSection, level: float) -> dict[str, float]:
    """Half width of the interval of each parameter, on the scale it was fitted."""
    cov = law.uncertainty
    if not isinstance(cov, Covariance):
        return {}
    from scipy.special import stdtrit

    q = float(stdtrit(cov.df, (1 + level) / 2))
    se = np.sqrt(np.diag(np.array(cov.matrix)))
    return {name.removeprefix("ln "): float(q * s) for name, s in zip(cov.of, se, strict=True)}


def _ends(value: float, half: float | None, se: float | None, is_scale: bool) -> tuple[NumberPart, NumberPart]:
    if half is None or not se or (is_scale and half > WIDEST) or half <= abs(value) * EXACT:
        return NONE, NONE
    low, high = (value * math.exp(-half), value * math.exp(half)) if is_scale else (value - half, value + half)
    return number(low, se), number(high, se)


def _two_sided(t: float, df: int) -> float:
    from scipy.special import stdtr

    return float(2 * stdtr(max(df, 1), -abs(t)))
