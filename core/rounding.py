"""Numbers as text, rounded by their uncertainty, and names in a sentence."""

import math
from collections.abc import Sequence
from numbers import Integral, Real

PLAIN = 1e5  # from here on a number without an uncertainty has an exponent
EXACT = 1e-5  # relative uncertainty below which seven digits show it


def decimals(uncertainty: float, digits: int = 2) -> int:
    """Decimals that show an uncertainty to so many significant digits.

    >>> decimals(0.0213), decimals(213.0)
    (3, -1)
    """
    if not (math.isfinite(uncertainty) and uncertainty > 0):
        return 6
    place = math.floor(math.log10(uncertainty))
    shown = round(uncertainty, digits - 1 - place)  # 0.0999 becomes 0.10, one place up
    return digits - 1 - math.floor(math.log10(shown))


def format_plain(value: float, digits: int = 4) -> str:
    """A number without an uncertainty, to ``digits`` significant digits, from 1000 to 1e5 without an exponent.

    >>> format_plain(0.00076234), format_plain(1234567.0), format_plain(0.0)
    ('0.0007623', '1.235e+06', '0')
    >>> format_plain(4549.3, 3), format_plain(31027.0, 2), format_plain(999.7), format_plain(999.7, 3)
    ('4550', '31000', '999.7', '1000')
    """
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < PLAIN else text


def format_decimal(value: float) -> str:
    """A number to four significant digits, without an exponent where a person would write none.

    >>> format_decimal(26420.0), format_decimal(0.2), format_decimal(1 / 3)
    ('26420', '0.2', '0.3333')
    """
    return f"{float(f'{value:.4g}'):.12g}"


def format_rounded(value: float, uncertainty: float | None) -> tuple[str, str]:
    """Value and uncertainty, both to the decimals of two significant digits of the uncertainty.

    >>> format_rounded(0.577123, 0.0213)
    ('0.577', '0.021')
    >>> format_rounded(55354.2, 8123.0)
    ('55400', '8100')
    >>> format_rounded(1.5, None)
    ('1.5', '')
    """
    if uncertainty is None or not math.isfinite(uncertainty):
        return format_plain(value, 6), ""
    if uncertainty <= abs(value) * EXACT:
        return format_plain(value, 7), format_plain(uncertainty, 1)
    places = decimals(uncertainty)
    if places > 6 or abs(value) >= 1e7:
        return _scientific(value, uncertainty, places)
    if places < 0:
        return f"{round(value, places) + 0.0:.0f}", f"{round(uncertainty, places):.0f}"
    return f"{round(value, places) + 0.0:.{places}f}", f"{uncertainty:.{places}f}"  # + 0.0: there is no -0


def _scientific(value: float, uncertainty: float, places: int) -> tuple[str, str]:
    power = math.floor(math.log10(max(abs(value), uncertainty)))
    digits = max(places + power, 0)
    return f"{value / 10**power:.{digits}f}e{power}", f"{uncertainty / 10**power:.{digits}f}e{power}"


def p_value(p: float) -> str:
    """A p value as it is read: three decimals, or below the last of them.

    >>> p_value(0.0412), p_value(1e-9)
    ('0.041', '<0.001')
    """
    return "" if not math.isfinite(p) else "<0.001" if p < 0.001 else f"{p:.3f}"


def label_of(value: object) -> str:
    """A value as the text of a label: a whole number without a decimal point, others with all their digits.

    >>> label_of(1.0), label_of(2.5), label_of(12345678901234567), label_of("01")
    ('1', '2.5', '12345678901234567', '01')
    """
    if not isinstance(value, Real) or isinstance(value, Integral):
        return str(value)
    number = float(value)
    return str(int(number)) if number.is_integer() else repr(number)


def format_probability(value: float) -> str:
    """A probability as text, with three decimals; never 0 or 1, which an estimate does not give.

    >>> format_probability(7e-11), format_probability(0.0512), format_probability(0.9996)
    ('< 0.001', '0.051', '> 0.999')
    """
    return "< 0.001" if value < 0.001 else "> 0.999" if value > 0.999 else f"{value:.3f}"


def count(n: int, what: str, several: str = "") -> str:
    """A number of things, with the noun in the right number.

    >>> count(1, "row"), count(0, "edge"), count(2, "analysis", "analyses")
    ('1 row', '0 edges', '2 analyses')
    """
    return f"{n} {what}" if n == 1 else f"{n} {several or f'{what}s'}"


def listed(names: Sequence[str], most: int = 6) -> str:
    """The names with commas, of many the first and the number of the others.

    >>> listed(["a", "b", "c"], 2)
    'a, b and 1 more'
    """
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def middle_of(low: float, high: float, *, logs: bool) -> float:
    """Middle of a range, to three digits where those lie inside it: a number that a person would set.

    >>> middle_of(0.06, 0.6, logs=True), middle_of(1.5, 3.0, logs=False), middle_of(100.4, 100.4, logs=True)
    (0.19, 2.25, 100.4)
    """
    exact = (low * high) ** 0.5 if logs and low > 0 else (low + high) / 2
    short = float(f"{exact:.3g}")
    return short if low <= short <= high else exact


def join_words(names: Sequence[str]) -> str:
    """All names, the last after ``and``.

    >>> join_words(["a", "b", "c"]), join_words(["a"]), join_words([])
    ('a, b and c', 'a', '')
    """
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)


def with_error(value: float, error: float | None, unit: str = "") -> str:
    """A value with its standard error, rounded by it, and its unit.

    >>> with_error(0.577123, 0.0213), with_error(95.1089, 0.0213, "kg"), with_error(2.0, None, "A")
    ('0.577 ± 0.021', '95.109 ± 0.021 kg', '2 A')
    """
    number, plus = format_rounded(value, error)
    return " ".join(filter(None, (f"{number} ± {plus}" if plus else number, unit)))


def with_unit(symbol: str, unit: str) -> str:
    """A symbol with its unit in brackets, where it has one."""
    return f"{symbol} [{unit}]" if unit else symbol
