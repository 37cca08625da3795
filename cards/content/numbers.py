"""Numbers of a card with their texts, and facts as text."""

import math
from collections.abc import Iterable

from ...core.rounding import format_plain, format_rounded, p_value
from .parts import FactPart, NumberPart

LEVEL = 0.95  # of all intervals of a card
NONE = NumberPart()
INFINITE = NumberPart(text="infinite")
UNBOUNDED = NumberPart(text="not bounded")
LARGE = 1e7  # from here on a number is shown with its power of ten


def number(value: float | None, uncertainty: float | None, unit: str = "") -> NumberPart:
    """A number to the decimals that its uncertainty supports.

    >>> number(0.577123, 0.0213, "mm").text
    '0.577'
    """
    if value is None or not math.isfinite(value):
        return NONE
    return NumberPart(value=value, text=format_rounded(value, uncertainty)[0], unit=unit)


def spread(value: float, uncertainty: float | None, unit: str = "") -> NumberPart:
    """The uncertainty of a value, to its own two digits.

    >>> spread(0.577123, 0.0213).text
    '0.021'
    """
    if uncertainty is None or not math.isfinite(uncertainty):
        return NONE
    return NumberPart(value=uncertainty, text=format_rounded(value, uncertainty)[1], unit=unit)


def figure(value: float | None, digits: int = 4, unit: str = "") -> NumberPart:
    """A number without an uncertainty, to so many significant digits."""
    if value is None or not math.isfinite(value):
        return NONE
    text = format_plain(value, digits)
    if "e+" in text and abs(value) < LARGE:
        text = f"{float(text):.0f}"  # 1170, not 1.17e+03
    return NumberPart(value=value, text=text, unit=unit)


def places(value: float | None, decimals: int, unit: str = "") -> NumberPart:
    """A number to so many decimals.

    >>> places(0.98765, 3).text
    '0.988'
    """
    if value is None or not math.isfinite(value):
        return NONE
    return NumberPart(value=value, text=f"{round(value, decimals) + 0.0:.{decimals}f}", unit=unit)


def count(value: float | None, unit: str = "") -> NumberPart:
    """A count."""
    return NONE if value is None else NumberPart(value=value, text=f"{value:.15g}", unit=unit)


def percent(share: float | None, digits: int = 3) -> NumberPart:
    """A share, in per cent.

    >>> percent(0.95).text
    '95'
    """
    return NONE if share is None else figure(100 * share, digits, "%")


def probability(p: float | None) -> NumberPart:
    """A p value: three decimals, or below the last of them."""
    return NONE if p is None or not math.isfinite(p) else NumberPart(value=p, text=p_value(p))


def fact(name: str, value: NumberPart, words: str = "") -> tuple[FactPart, ...]:
    """A number under its name; nothing where there is neither number nor text nor words.

    >>> fact("edges", NONE)
    ()
    """
    return (FactPart(name=name, number=value, words=words),) if value.text or words else ()


def fact_text(item: FactPart) -> str:
    """A fact in a sentence: name, value with unit, explanation.

    >>> fact_text(FactPart(name="p", number=probability(1e-9), words="by edge"))
    'p < 0.001 (by edge)'
    >>> fact_text(FactPart(name="form", number=NONE, words="position"))
    'form: position'
    """
    value = quantity(item.number)
    if not value:
        return f"{item.name}: {item.words}"
    relation = f"< {value[1:]}" if value.startswith("<") else f"= {value}"
    return f"{item.name} {relation}" + (f" ({item.words})" if item.words else "")


def fact_line(facts: Iterable[FactPart]) -> str:
    """Facts one after the other."""
    return "; ".join(map(fact_text, facts))


def quantity(value: NumberPart) -> str:
    """Text and unit, as in a sentence.

    >>> quantity(figure(0.15, unit="mm"))
    '0.15 mm'
    """
    return f"{value.text} {value.unit}".rstrip()


def between(low: NumberPart, high: NumberPart) -> str:
    """Both ends of an interval, or nothing."""
    return f"{low.text} … {high.text}" if low.text else ""


def ends_words(low: NumberPart, high: NumberPart) -> str:
    """Both ends of an interval in words; an end without a value is not bounded.

    >>> ends_words(figure(24.4), figure(42.7, unit="min")), ends_words(figure(24.4, unit="min"), UNBOUNDED)
    ('24.4 to 42.7 min', 'at least 24.4 min, not bounded above')
    """
    if high.value is not None:
        return f"{low.text} to {quantity(high)}"
    return f"at least {quantity(low)}, {UNBOUNDED.text} above" if low.value else UNBOUNDED.text


def sentence(text: str) -> str:
    """A clause as a sentence: a capital first, a full stop last."""
    text = text.strip()
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) else ".")
