"""A law's numbers: what it is given is checked, then laid out in the terms of its linear form.

=============  ======================  ==========================  =============  ======
form           equation                parameters theta            terms          link
=============  ======================  ==========================  =============  ======
power          R = c0 prod x_j^b_j     ln c0, x_1 ... x_k, shifts  1, ln x_j, 1   ln
exponential    R = a exp(b F)          ln a, b, shifts             1, F, 1        ln
load_line      I = A + B fm + k1 VB    A, B, k1, shifts            1, fm, VB, 1   none
feed_line      fm = fm0 + slope VB     fm0, slope, shifts          1, VB, 1       none
=============  ======================  ==========================  =============  ======

An exponent is called by its factor's symbol, a shift ``material[2]``. A shift's term is 1 at its
level and 0 elsewhere, so that it multiplies a logarithmic law by exp(shift) and moves a line. Link
and terms give both the prediction and the gradient of its interval.
"""

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import ParameterError
from .errors import short

if TYPE_CHECKING:
    from .sections.law import LawSection

Array = NDArray[np.float64]

LOGARITHMIC = ("power", "exponential")
# the coefficients of each form, the constant first; a power law adds its factors' symbols
COEFFICIENTS: Mapping[str, tuple[str, ...]] = {
    "power": ("c0",),
    "exponential": ("a", "b"),
    "load_line": ("A", "B", "k1"),
    "feed_line": ("fm0", "slope"),
}


def coefficient_names(form: str, symbols: Iterable[str]) -> tuple[str, ...]:
    """Names of a form's coefficients: the constant, then one for each factor in order."""
    return COEFFICIENTS[form] + (tuple(symbols) if form == "power" else ())


def parameter_names(law: "LawSection") -> tuple[str, ...]:
    """Names of theta: the constant by its logarithm where the law is logarithmic, shifts last."""
    constant, *others = coefficient_names(law.form, (factor.symbol for factor in law.factors))
    head = f"ln {constant}" if law.form in LOGARITHMIC else constant
    return (head, *others, *(law.by.names if law.by else ()))


def theta(law: "LawSection") -> Array:
    """Give the parameters, shape (p,), in the order of `parameter_names`."""
    constant, *others = coefficient_names(law.form, (factor.symbol for factor in law.factors))
    first = law.coefficients[constant]
    head = math.log(first) if law.form in LOGARITHMIC else first
    shifts = law.by.shifts.values() if law.by else ()
    return np.array([head, *(law.coefficients[name] for name in others), *shifts])


def terms(law: "LawSection", level: str | None, given: Mapping[str, ArrayLike]) -> Array:
    """Lay out the terms, shape (..., p), at the given factors; refuse what the law cannot take."""
    values = checked_values(law, given)
    columns = [np.log(x) if law.form == "power" else x for x in values]
    shape = values[0].shape if values else ()
    at = _level(law, level)
    shifts = [np.full(shape, float(other == at)) for other in (law.by.shifts if law.by else ())]
    return np.stack([np.ones(shape), *columns, *shifts], axis=-1)


def checked_values(law: "LawSection", given: Mapping[str, ArrayLike]) -> list[Array]:
    """Put the factors in the law's order, broadcast to one shape."""
    symbols = [factor.symbol for factor in law.factors]
    for name in given:
        if name not in symbols:
            has = f"its factors are {', '.join(symbols)}" if symbols else "it has none"
            raise ParameterError(f"the law of {law.response} has no factor {short(name)}; {has}.")
    for factor in law.factors:
        if factor.symbol not in given:
            raise ParameterError(
                f"the law of {law.response} needs {factor.symbol} ({factor.quantity}, {factor.unit}); "
                f"give {factor.symbol}=..."
            )
    values = [_number(law, factor.symbol, factor.unit, given[factor.symbol]) for factor in law.factors]
    try:
        return list(np.broadcast_arrays(*values))
    except ValueError:
        shapes = ", ".join(f"{name} {value.shape}" for name, value in zip(symbols, values, strict=True))
        raise ParameterError(f"the factors do not broadcast to one shape: {shapes}.") from None


def _number(law: "LawSection", symbol: str, unit: str, given: ArrayLike) -> Array:
    try:
        value = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(f"{symbol} = {short(given)} is not a number; give it in {unit or 'its unit'}.") from None
    bad = ~np.isfinite(value) | ((value <= 0) if law.form == "power" else False)
    if bad.any():
        wanted = "positive" if law.form == "power" else "finite"
        seen = float(value[bad].flat[0]) if value.ndim else float(value)
        raise ParameterError(f"{symbol} = {seen:g} {unit}: the {law.form} law of {law.response} needs {wanted} values.")
    return value


def _level(law: "LawSection", level: str | None) -> str | None:
    if law.by is None:
        if level is not None:
            raise ParameterError(f"the law of {law.response} has no levels; leave {short(level)} out.")
        return None
    known = ", ".join([law.by.reference, *law.by.shifts])
    if level is None:
        raise ParameterError(f"the law of {law.response} is by {law.by.column}: say which level ({known}).")
    if str(level) != law.by.reference and str(level) not in law.by.shifts:
        seen = f"{law.by.column} {short(str(level))}"
        raise ParameterError(f"the law of {law.response} has no {seen}; it has {known}.")
    return str(level)


def response(law: "LawSection", eta: Array) -> Array:
    """Invert the link."""
    with np.errstate(over="ignore", under="ignore"):  # `as_given` refuses what overflows
        return np.exp(eta) if law.form in LOGARITHMIC else eta


def as_given(law: "LawSection", value: Array) -> Array | float:
    """Return a float for a single point, an array otherwise; refuse a number too large to be one."""
    if not np.isfinite(value).all():
        raise ParameterError(
            f"the law of {law.response} is not finite there; give factors near its domain (see inside)."
        )
    return value if value.ndim else float(value)
