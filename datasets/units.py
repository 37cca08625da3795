"""Units: the laboratories' spellings, and exact conversion between them.

General unit libraries read ``Nm`` as a number times a metre and ``mm/U`` as millimetres per enzyme unit without a
warning. So every text is looked up in the table of this field, and each canonical unit is defined in rational numbers.
Turns, teeth and the hardness scales are dimensions of their own here: feed (mm/rev), feed per tooth (mm/tooth) and
feed rate (mm/min) do not mix.

Factors: BIPM, The International System of Units, 9th ed.; NIST Special Publication 811 (2008), appendix B.
"""

import re
import unicodedata
from collections.abc import Mapping
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..core.arrays import Array
from ..core.errors import DataError, UsageError
from ..core.suggestions import closest

__all__ = ["SPELLINGS", "canonical", "convert", "is_unit", "same_dimension", "suggest"]

_M = ("m", "metre", "meter", "mètre", "metro")
_MM = ("mm", "MM", "millimetre", "millimeter", "millimetres", "millimeters", "millimètre", "milímetro")
_CM = ("cm", "CM", "centimetre", "centimeter", "Zentimeter")
_IN = ("in", "IN", "inch", "inches", "zoll", "pouce", "pouces", "pulgada", "pulgadas", '"', "''")
_FT = ("ft", "foot", "feet", "sf")
_S = ("s", "sec", "secs", "Sek", "second", "seconds", "Sekunden", "seconde", "secondes", "seg", "segundos")
_MIN = ("min", "mn", "mins", "minute", "minutes", "Minuten", "minuto", "minutos")
_REV = ("rev", "r", "U", "Umdr", "Umdrehung", "tr", "tour", "vuelta", "rot", "revolution", "revolución")
_TOOTH = ("tooth", "z", "Zahn", "dent", "diente")


def _cubed(lengths: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{a}3" for a in lengths)


def _ratio(above: tuple[str, ...], below: tuple[str, ...]) -> tuple[str, ...]:
    """Spell a quotient as ``a/b``; ``a b-1`` is rewritten to it."""
    return tuple(f"{a}/{b}" for a in above for b in below)


SPELLINGS: Mapping[str, tuple[str, ...]] = {
    "m/min": _ratio(_M, _MIN),
    "m/s": _ratio(_M, _S),
    "sfm": ("sfm", "sfpm", "fpm", *_ratio(_FT, _MIN)),
    "mm/rev": ("mmpr", *_ratio(_MM, _REV)),
    "in/rev": ("ipr", *_ratio(_IN, _REV)),
    "um/rev": _ratio(("um", "micron", "microns"), _REV),
    "mm/tooth": _ratio(_MM, _TOOTH),
    "um/tooth": _ratio(("um", "micron", "microns"), _TOOTH),
    "in/tooth": ("ipt", *_ratio(_IN, _TOOTH)),
    "mm/min": _ratio(_MM, _MIN),
    "mm/s": _ratio(_MM, _S),
    "in/min": ("ipm", *_ratio(_IN, _MIN)),
    "1/min": ("rpm", "1/min", "/min", "min-1", "mn-1", *_ratio(_REV, _MIN)),
    "rev/s": ("rps", *_ratio(_REV, _S)),
    "mm": _MM,
    "um": ("um", "micron", "microns", "micrometre", "micrometer", "Mikrometer", "micromètre", "mkm", "μ"),
    "mm/100": ("mm/100", "1/100 mm", "1/100mm", "0.01 mm", "0.01mm", "0,01 mm", "0,01mm", "Hundertstel mm"),
    "cm": _CM,
    "m": _M,
    "in": _IN,
    "mil": ("mil", "mils", "thou"),
    "uin": ("uin", "microinch", "microinches", "micro inch"),
    "mm2": ("mm2", "sq mm", "qmm"),
    "N": ("N", "newton", "newtons"),
    "kN": ("kN", "KN", "kilonewton"),
    "daN": ("daN", "decanewton"),
    "lbf": ("lbf", "lb", "lbs", "pound-force"),
    "kgf": ("kgf", "kp", "kilopond"),
    "W": ("W", "watt", "watts"),
    "kW": ("kW", "KW", "kw", "kilowatt", "kilowatts"),
    "hp": ("hp", "HP", "horsepower"),
    "PS": ("PS", "ch", "CV"),
    "Nm": ("Nm", "NM", "N m", "N-m", "newton metre", "newton meter"),
    "Ncm": ("Ncm", "N cm", "N-cm"),
    "Nmm": ("Nmm", "N mm", "N-mm"),
    "ft lbf": ("ft lbf", "lbf ft", "ft-lbf", "lbf-ft", "ft lb", "ft-lb"),
    "in lbf": ("in lbf", "lbf in", "in-lbf", "lbf-in", "in lb", "in-lb"),
    "A": ("A", "amp", "amps", "ampere", "ampère", "amperio"),
    "mA": ("mA", "milliampere"),
    "V": ("V", "volt", "volts", "voltio"),
    "mV": ("mV", "millivolt"),
    "s": _S,
    "ms": ("ms", "msec", "millisecond", "milliseconds"),
    "min": _MIN,
    "h": ("h", "hr", "hrs", "hour", "hours", "Stunde", "Stunden", "heure", "heures", "hora", "horas", "Std"),
    "Hz": ("Hz", "hertz"),
    "kHz": ("kHz", "kilohertz"),
    "mm3/min": _ratio(_cubed(_MM), _MIN),
    "mm3/s": _ratio(_cubed(_MM), _S),
    "cm3/min": _ratio((*_cubed(_CM), "ccm", "cc"), _MIN),
    "in3/min": _ratio((*_cubed(_IN), "cu in"), _MIN),
    "MPa": ("MPa", "megapascal"),
    "N/mm2": _ratio(("N",), ("mm2",)),
    "bar": ("bar",),
    "HRC": ("HRC", "Rockwell C"),
    "HB": ("HB", "HBW", "BHN", "Brinell"),
    "HV": ("HV", "Vickers"),
    "%": ("%", "percent", "per cent", "Prozent", "pour cent", "por ciento"),
    "1": ("1", "-", "", "dimensionless"),
    "deg": ("°", "deg", "degree", "degrees", "degré", "degrés", "grado", "grados"),
    "degC": ("degC", "°C", "deg C", "celsius"),
    "degF": ("degF", "°F", "deg F", "fahrenheit"),
    "K": ("K", "kelvin"),
}
"""The canonical unit -> the spellings met in English, German, French and Spanish files."""

ZERO_POINT: Mapping[str, float] = {"degC": 0.0, "degF": 32.0, "K": 273.15}
"""Reading of each scale of temperature at 0 degC."""

_DEFINITIONS = """
mm = [length]             ; m = 1000 * mm        ; cm = 10 * mm      ; um = mm / 1000
in = 25.4 * mm            ; ft = 12 * in         ; mil = in / 1000   ; uin = mil / 1000
s = [time]                ; min = 60 * s         ; h = 60 * min      ; ms = s / 1000
kg = [mass]               ; N = kg * m / s ** 2  ; kN = 1000 * N     ; daN = 10 * N
kgf = 9.80665 * N         ; lbf = 4.4482216152605 * N
Nm = N * m                ; Ncm = N * cm         ; Nmm = N * mm
W = Nm / s                ; kW = 1000 * W        ; hp = 550 * ft * lbf / s ; PS = 75 * kgf * m / s
A = [current]             ; mA = A / 1000        ; V = W / A         ; mV = V / 1000
MPa = N / mm ** 2         ; bar = MPa / 10       ; degC = [temperature] ; deg = [angle]
degF = 5 / 9 * degC       ; K = degC
rev = [revolution]        ; tooth = [tooth]      ; sfm = ft / min
Hz = 1 / s                ; kHz = 1000 / s       ; percent = 1 / 100
HRC = [hardness_rockwell] ; HB = [hardness_brinell] ; HV = [hardness_vickers]
"""

_SIGNS = str.maketrans({"º": "°", "˚": "°", "″": '"', "”": '"', "“": '"', "′": "'"} | dict.fromkeys("·⋅∙•×", "*"))
_MINUS_AND_MU = str.maketrans({"−": "-", "–": "-", "—": "-", "‐": "-", "μ": "u"} | dict.fromkeys("[](){}", " "))
_REWRITES = (
    (r"\b(?:per|pro|par|por|je)\b(?!\s*ci?ent)", "/"),
    (r"\*\*|\^", ""),
    (r"(?<=[^\W\d])\.(?=[^\W\d])", "*"),
    (r"(?<=[^\W\d])\.", ""),
    (r"(?:(?<!\s)\s+)?([/*])\s*", r"\1"),
    (r"(?<=\w)\s+(?=-?\d)", ""),
    (r"\s+", "*"),
    (r"(?<=.)\*([^\W\d]+)-1$", r"/\1"),
)
_PLAIN = re.compile(r"(?!.*\b(?:per|pro|par|por|je)\b)[A-Za-z0-9/]+")  # spellings that no rewriting changes
_PROSE = re.compile(r"^\W*(?:in|en|units?|einheit|unité|unidad|/)(?:\s*+[:=])?\s++(?=\S)", re.IGNORECASE)


@lru_cache(maxsize=4096)  # of quotients the parts come again and again
def _key(text: str) -> str:
    """Bring a spelling to the form compared: no brackets, ``*`` for blanks, plain digits, u for micro."""
    if _PLAIN.fullmatch(text):
        return text
    key = unicodedata.normalize("NFKC", text.translate(_SIGNS)).translate(_MINUS_AND_MU).strip()
    for pattern, replacement in _REWRITES:
        key = re.sub(pattern, replacement, key)
    return key


_BY_KEY: dict[str, str] = {
    "/".join(map(_key, spelling.split("/"))): unit for unit, spellings in SPELLINGS.items() for spelling in spellings
}
_BY_FOLDED: dict[str, str] = {key.casefold(): unit for key, unit in _BY_KEY.items() if sum(map(str.isalpha, key)) >= 3}


def _look_up(text: str) -> str | None:
    key = _key(text)
    if key in _BY_KEY:
        return _BY_KEY[key]
    # Case is ignored in spellings of three letters and more (RPM, Inch, MM/MIN), never inside a word (mPa).
    words = re.findall(r"[^\W\d]+", key)
    if all(word.isupper() or word.islower() or word.istitle() for word in words):
        return _BY_FOLDED.get(key.casefold())
    return None


@lru_cache(maxsize=4096)  # a header is asked about many times
def canonical(text: str) -> str | None:
    """Canonical unit of a laboratory's spelling, None when it is not listed.

    Blanks, brackets, raised digits, both micro signs and a leading "in" are accepted; case is ignored where safe.

    >>> canonical("[m·min⁻¹]"), canonical("in mm/U"), canonical("mN")
    ('m/min', 'mm/rev', None)
    """
    found = _look_up(text)
    if found is None and (prose := _PROSE.match(text)):
        found = _look_up(text[prose.end() :])
    return found


def is_unit(text: str) -> bool:
    """Whether a text is a listed spelling of a unit.

    >>> is_unit("U/min"), is_unit("furlong")
    (True, False)
    """
    return canonical(text) is not None


class _Quantity(NamedTuple):
    """A unit as a multiple of base units: an exact factor, and the power of each dimension that it has."""

    factor: Fraction
    powers: Mapping[str, int]


@lru_cache(maxsize=1)
def _defined() -> dict[str, _Quantity]:
    """The units of ``_DEFINITIONS`` by name; each is defined by those before it."""
    units: dict[str, _Quantity] = {}
    for definition in re.split(r"[;\n]", _DEFINITIONS.strip()):
        name, expression = (part.strip() for part in definition.split("="))
        units[name] = _evaluated(expression, units)
    return units


def _evaluated(expression: str, units: Mapping[str, _Quantity]) -> _Quantity:
    """A product or quotient of numbers, dimensions in brackets and ``units``, each with a whole power or none."""
    factor, powers = Fraction(1), dict[str, int]()
    for sign, word, exponent in re.findall(r"(^|[*/])\s*(\[?[\w.]+\]?)(?:\s*\*\*\s*(\d+))?\s*", expression):
        power = int(exponent or 1) * (-1 if sign == "/" else 1)
        if word[0] == "[":
            one = _Quantity(Fraction(1), {word: 1})
        else:
            one = _Quantity(Fraction(word), {}) if word[0].isdigit() else units[word]
        factor *= one.factor**power
        for dimension, own in one.powers.items():
            powers[dimension] = powers.get(dimension, 0) + own * power
    return _Quantity(factor, {dimension: power for dimension, power in powers.items() if power})


@lru_cache(maxsize=256)
def _quantity(unit: str) -> _Quantity:
    """A canonical unit in base units."""
    expression = {"1/min": "rev / min", "%": "percent"}.get(unit) or re.sub(r"(?<=[a-z])(?=\d)", "**", unit)
    return _evaluated(re.sub(r"(?<=\w) (?=\w)", "*", expression), _defined())


def _listed(text: str) -> str:
    unit = canonical(text)
    if unit is None:
        raise UsageError(f"unit {text!r} is not listed; {suggest(text)}")
    return unit


def same_dimension(unit_a: str, unit_b: str) -> bool:
    """Whether two units measure the same kind of quantity, so that one converts into the other.

    Raises UsageError for a unit that is not listed.

    >>> same_dimension("sfm", "m/min"), same_dimension("mm/rev", "mm/min")
    (True, False)
    """
    a, b = _listed(unit_a), _listed(unit_b)
    return a == b or _quantity(a).powers == _quantity(b).powers


def convert(values: Array, from_unit: str, to_unit: str) -> Array:
    """Values of one unit in another.

    values : ndarray, any shape, in ``from_unit``; the result has its shape, in ``to_unit``, and is the same
    object when the units are the same. Factors are exact ratios (BIPM; NIST SP 811, appendix B).
    Raises UsageError for a unit that is not listed, DataError when the two do not measure the same.

    >>> import numpy as np
    >>> convert(np.array([1.0, 2.0]), "inch", "mm")
    array([25.4, 50.8])
    """
    a, b = _listed(from_unit), _listed(to_unit)
    if a == b:
        return values
    if not same_dimension(a, b):
        raise DataError(
            f"values in {from_unit!r} cannot be converted to {to_unit!r}, which measures another quantity; "
            f"correct the unit in the header or map the column to another role."
        )
    factor = _quantity(a).factor / _quantity(b).factor
    if a in ZERO_POINT:
        return np.asarray((values - ZERO_POINT[a]) * float(factor) + ZERO_POINT[b], dtype=np.float64)
    return np.asarray(values * float(factor.numerator) / float(factor.denominator), dtype=np.float64)


def suggest(text: str) -> str:
    """Closing phrase of a message on an unlisted unit: the most similar one, or examples.

    >>> suggest("mm/revv")
    'did you mean mm/rev?'
    """
    near = closest(_key(text), _BY_KEY, cutoff=0.7) if text else None
    if near:
        return f"did you mean {_BY_KEY[near]}?"
    return "known are for example m/min, sfm, mm/rev, mm/min, 1/min, mm, um, in, N, kW, Nm, A, s and min."
