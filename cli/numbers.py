"""Numbers of options: with units, as shares in percent, as ranges, and as values of names."""

import re
from argparse import ArgumentTypeError

from ..core.errors import UsageError

NUMBER = r"[+-]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][+-]?\d++)?"
WITH_UNIT = re.compile(rf"({NUMBER})\s*+([^\d\s.,+-].*)")


def number(text: str) -> float:
    """A number of an option; a share may be written in percent.

    >>> number("0.05"), number("5 %")
    (0.05, 0.05)
    """
    share = text.strip().endswith("%")
    try:
        value = float(text.strip().removesuffix("%"))
    except ValueError:
        raise ArgumentTypeError(f"{text}: give a number{with_point(text)}") from None
    return value / 100 if share else value


def with_point(text: str) -> str:
    """The remark that a number has a decimal point, for a text with a comma; empty otherwise.

    >>> with_point("0,28"), with_point("0.28 A")
    (' with a decimal point, 0.28', '')
    """
    return f" with a decimal point, {text.replace(',', '.')}" if re.fullmatch(r"[^,]*\d,\d[^,]*", text) else ""


def pairs(words: list[str] | None, option: str, example: str) -> dict[str, str]:
    """``["VB=col7"]`` as a mapping.

    >>> pairs(["VB=col7"], "--map", "VB=col7")
    {'VB': 'col7'}
    """
    out: dict[str, str] = {}
    for word in words or []:
        key, equals, value = word.partition("=")
        if not (equals and key.strip() and value.strip()):
            raise UsageError(f"{option} {word}: write it as {example}.")
        if key.strip() in out:
            raise UsageError(f"{option} {word}: {key.strip()} is given twice.")
        out[key.strip()] = value.strip()
    return out


def check_apart(word: str, unit: str | None) -> None:
    """Refuse a unit that begins with a slash: 40001/min is 4000 1/min or 40001 /min.

    >>> check_apart("n=4000rpm", "rpm")
    """
    if unit is not None and unit.startswith("/"):
        raise UsageError(f"{word}: number and unit {unit} cannot be separated for sure; write rpm, or no unit.")


def ranges(words: list[str] | None, option: str = "--range", most: int = 3) -> dict[str, tuple[float, ...]]:
    """``["V=50:200"]`` as numbers, at most ``most`` of them, in the unit of the quantity, which may be written.

    >>> ranges(["V=50:200", "f=0.004:0.016in/rev"])
    {'V': (50.0, 200.0), 'f': (0.1016, 0.4064)}
    """
    out: dict[str, tuple[float, ...]] = {}
    for key, text in pairs(words, option, "V=50:200").items():
        out[key] = in_units(key, text.split(":")) or ()
        if not 2 <= len(out[key]) <= most:
            raise UsageError(
                f"{option} {key}={text}: give low:high or low:centre:high, with decimal points, as V=50:200"
                f"{_written_unit(key)}."
            )
    return out


def in_units(name: str, texts: list[str]) -> tuple[float, ...] | None:
    """Numbers of a quantity in its unit; a unit after the last is that of all without one. None for other texts.

    >>> in_units("V", ["260", "650sfm"]), in_units("f", ["0.1", "0.2"]), in_units("coolant", ["dry", "flood"])
    ((79.248, 198.12), (0.1, 0.2), None)
    """
    from ..datasets.headers import setting_named
    from ..datasets.vocabulary import ROLES, understood_unit

    symbol = setting_named(name)
    unit = ROLES[symbol].unit if symbol in ROLES else ""
    found = [WITH_UNIT.fullmatch(text.strip()) for text in texts]
    last = found[-1]
    for one, text in zip(found, texts, strict=True):
        check_apart(f"{name}={text}", one[2] if one else None)
    written = [one[2] if one else last[2] if last else "" for one in found]
    numbers = [one[1] if one else text for one, text in zip(found, texts, strict=True)]
    units = [(each and symbol in ROLES and understood_unit(symbol, each)) or each for each in written]
    try:
        return tuple(float(_in_unit(number + each, unit)) for number, each in zip(numbers, units, strict=True))
    except ValueError:
        return None


def _written_unit(name: str) -> str:
    """Remark on the unit of a range, for a quantity that has one."""
    from ..datasets.headers import setting_named
    from ..datasets.vocabulary import ROLES

    role = ROLES.get(setting_named(name))
    return f" or, with a unit of {name}, 50:200{role.unit}" if role is not None and role.unit not in ("", "1") else ""


def values(words: list[str] | None, option: str = "--value") -> dict[str, float]:
    """``["D=80"]`` as numbers.

    >>> values(["D=80"])
    {'D': 80.0}
    """
    out: dict[str, float] = {}
    for key, text in pairs(words, option, "D=80").items():
        try:
            out[key] = float(text)
        except ValueError:
            raise UsageError(f"{option} {key}={text}: give a number with a decimal point, as D=80.") from None
    return out


def constants(words: list[str] | None) -> dict[str, float]:
    """Numbers of ``--value`` in the canonical unit of their quantity, which may be written.

    >>> constants(["d=1.5mm", "D=8cm", "z=2"])
    {'d': 1.5, 'D': 80.0, 'z': 2.0}
    """
    found = pairs(words, "--value", "D=80")
    numbers = {name: in_units(name, [text]) for name, text in found.items()}
    return values([f"{name}={repr(given[0]) if (given := numbers[name]) else text}" for name, text in found.items()])


def measured(text: str, unit: str, option: str, example: str) -> float:
    """A number above zero, in the unit that is asked for; another unit of the same kind is converted.

    >>> measured("1.5mm", "mm", "--depth", "1.5mm"), measured("0.1 in", "mm", "--depth", "1.5mm")
    (1.5, 2.54)
    """
    try:
        value = float(_in_unit(text, unit))
    except ValueError:
        of = f"{f' in {unit}' if unit else ''}{' with a decimal point' if ',' in text else ''}"
        raise UsageError(f"{option} {text}: give a number{of}, for instance {example}.") from None
    if not 0 < value < float("inf"):
        raise UsageError(f"{option} {text}: give a value above zero, for instance {example}.")
    return value


def criterion(text: str) -> float:
    """A wear criterion, mm.

    >>> criterion("0.3"), criterion("VB=0.2mm"), criterion("200um")
    (0.3, 0.2, 0.2)
    """
    from ..datasets.plausibility.ranges import MOST_WEAR

    try:
        value = float(_in_unit(text.rpartition("=")[2], "mm"))
    except ValueError:
        raise ArgumentTypeError(f"{text}: give the wear in mm, for instance 0.2, or with its unit: 200um") from None
    if value > MOST_WEAR:
        words = f"{text}: {value:g} mm of wear is more than the {MOST_WEAR:g} mm that an edge can have"
        raise ArgumentTypeError(f"{words}; give mm, for instance 0.3, or the unit: 300um")
    return value


def _in_unit(text: str, unit: str) -> str:
    """A number written with a unit, in another unit; the text itself where it is no such number."""
    import numpy as np

    from ..datasets.units import canonical, convert, same_dimension

    found = WITH_UNIT.fullmatch(text.strip())
    given = canonical(found[2]) if found else None
    if found is None or given is None or not (given == unit or same_dimension(given, unit)):
        return text
    return f"{float(convert(np.array(float(found[1])), given, unit)):.12g}"
