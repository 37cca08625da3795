"""Small facts of a fitted law: its equation in words, the range of a factor, numbers that can be had."""

import math
from typing import TYPE_CHECKING, Any

from ..sections.law_fields import LOGARITHMIC, coefficient_names

if TYPE_CHECKING:
    import pandas as pd

    from ...fit import LawFit, StreamedLaw


def equation(law: "LawFit | StreamedLaw") -> str:
    """Tell the equation, its numbers at six digits: at the reference level, then what each level changes."""
    constant, *slopes = (float(law.params[name]) for name in coefficient_names(law.form, law.factors))
    if law.form == "power":
        right = " ".join([_six(constant), *(f"{x}^{_six(b)}" for x, b in zip(law.factors, slopes, strict=True))])
    elif law.form == "exponential":
        right = f"{_six(constant)} exp({_six(slopes[0])} {law.factors[0]})"
    else:
        signed = ("-" if b < 0 else "+" for b in slopes)
        terms = (f"{s} {_six(abs(b))} {x}" for s, b, x in zip(signed, slopes, law.factors, strict=True))
        right = " ".join([_six(constant), *terms])
    text = f"{law.response} = {right}"
    if law.by is None:
        return text
    levels = [_level(law, level, float(law.params[f"{law.by.column}[{level}]"])) for level in law.by.levels]
    return "; ".join([f"{text} for {law.by.column} {law.by.reference}", *levels])


def _level(law: "LawFit | StreamedLaw", level: str, shift: float) -> str:
    if law.form in LOGARITHMIC:
        return f"times {_six(math.exp(shift))} for {level}"
    return f"{'minus' if shift < 0 else 'plus'} {_six(abs(shift))} for {level}"


def _six(value: float) -> str:
    return f"{value:.6g}"


def factor(law: "LawFit | StreamedLaw", symbol: str) -> dict[str, Any]:
    """One factor: symbol, words, unit, and its range among the rows used."""
    low, high = law.domain[symbol]
    ends = {"low": float(low), "high": float(high)}
    return {"symbol": symbol, "quantity": quantity_of(symbol), "unit": law.units[symbol], **ends}


def finite(values: "pd.Series[float]") -> dict[str, float]:
    """The finite ones of some values, by name."""
    return {str(name): float(value) for name, value in values.items() if math.isfinite(value)}


def known(value: float | None) -> float | None:
    """Keep a finite number; NaN or infinity is one that cannot be had."""
    return float(value) if value is not None and math.isfinite(value) else None


def quantity_of(symbol: str) -> str:
    """What a symbol stands for, in words; the symbol itself where nobody knows."""
    from ...datasets.vocabulary import ROLES

    role = ROLES.get(symbol)
    return role.quantity if role is not None else symbol
