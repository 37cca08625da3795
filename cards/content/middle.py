"""The middle of a law's tested region, where a card tells what the law says."""

from collections.abc import Mapping

from ...parameters import LawSection
from .numbers import figure, quantity


def middle(law: LawSection) -> dict[str, float]:
    """Middle of each factor's range: geometric where the law takes logarithms of it.

    >>> from fitmodels.parameters.sections.law import EXAMPLE
    >>> middle(LawSection.model_validate(EXAMPLE))
    {'V': 100.0}
    """
    return {f.symbol: middle_of(f.low, f.high, logs=law.form == "power") for f in law.factors}


def middle_of(low: float, high: float, *, logs: bool) -> float:
    """Middle of a range, to three digits where those lie inside it: a number that a person would set."""
    exact = (low * high) ** 0.5 if logs and low > 0 else (low + high) / 2
    short = float(f"{exact:.3g}")
    return short if low <= short <= high else exact


def at_words(law: LawSection, at: Mapping[str, float], by: str | None = None, digits: int = 6) -> str:
    """``V 100 m/min, f 0.19 mm/rev``."""
    parts = [f"{f.symbol} {quantity(figure(at[f.symbol], digits, f.unit))}" for f in law.factors if f.symbol in at]
    return ", ".join([*parts, *([f"{law.by.column} {by}"] if law.by is not None and by is not None else [])])


def reference(law: LawSection) -> str | None:
    """The level at which a law with levels is told."""
    return None if law.by is None else law.by.reference
