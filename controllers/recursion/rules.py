"""How wear adds up and which times count: equations 4 to 7 of AC-2017 and what else they can be read as."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ...core.display import Displayable
from ...core.errors import UsageError
from .laws import Array, LifeLaws, Terms, Times

WearRule = Literal["clock", "wear_state"]


@dataclass(frozen=True, slots=True, repr=False)
class Rules(Displayable):
    """How a life is computed.

    Attributes
    ----------
    times : {"published", "full"}
        Whether the factors t^-0.049 and t^-0.173 of eq. 2 and 3 count: ``full`` keeps the laws as they were fitted.
        Eq. 6 and 7, and so the paper's tables and its sequence, leave them out (``published``).
    wear : {"clock", "wear_state"}
        ``clock`` is eq. 4: after a change of V and f the increment is that of a fresh edge at that time of the clock.
        ``wear_state`` is the other reading: the increment of an edge that reached the same wear at the new V and f,
        AW_i^(1/h) = AW_{i-1}^(1/h) + AW(V, f, 1)^(1/h) (t_i - t_{i-1}), h the exponent of t. Not in the paper.
    interval : float
        Length of an interval, min.

    Examples
    --------
    >>> Rules(times="published").wear
    'clock'
    """

    times: Times = "full"
    wear: WearRule = "clock"
    interval: float = 1.0

    def __post_init__(self) -> None:
        for name, value, known in (("times", self.times, get_args(Times)), ("wear", self.wear, get_args(WearRule))):
            if value not in known:
                raise UsageError(f"{name}={value!r}: it is {' or '.join(map(repr, known))}.")
        if not 0 < self.interval < np.inf:
            raise UsageError(f"an interval of {self.interval!r} min: it lies above zero.")


def wear_after(
    laws: LifeLaws, rules: Rules, V: ArrayLike, f: ArrayLike, before: ArrayLike, start: float, end: float
) -> Array:
    """Wear at ``end`` of an edge with wear ``before`` at ``start`` (min) that cuts at V and f between; eq. 4 and 5.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers.recursion import life_laws
    >>> laws = life_laws(published("AC-2017"))
    >>> round(float(wear_after(laws, Rules(), 140.0, 0.58, 0.157219, 1.0, 2.0)), 5)
    0.18518
    """
    first, h = laws.wear(V, f), laws.wear.t  # first: wear of a fresh edge after one minute
    if rules.wear == "clock":
        return np.asarray(before + first * (end**h - start**h), dtype=np.float64)
    return np.asarray((np.asarray(before) ** (1 / h) + first ** (1 / h) * (end - start)) ** h, dtype=np.float64)


def told(terms: Terms, rules: Rules, V: ArrayLike, f: ArrayLike, end: ArrayLike, AW: ArrayLike) -> Array:
    """Power or force at the end of an interval with the wear reached there; eq. 6 and 7 where times are published."""
    return terms(V, f, end if rules.times == "full" else 1.0, AW)
