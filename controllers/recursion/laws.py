"""Laws and limits of an edge's life at one depth of cut, and the rules by which wear accumulates.

A law R = c0 V^a f^b d^g t^h AW^k becomes R = C V^a f^b t^h AW^k, with d and all other fixed factors in C. The rules are
equations 4 to 7 of AC-2017 and their alternative readings.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Array
from ...core.display import Displayable
from ...core.errors import UsageError
from ..region.log_planes import ratio

if TYPE_CHECKING:
    from ...parameters.sections.load_line import LimitsSection, Range

SAME: Final = 1e-9  # of a limit
NOT_HELD: Final = "The pairs of V and f are not held by the limits of the machine"
Times = Literal["published", "full"]


@dataclass(frozen=True, slots=True, repr=False)
class Terms(Displayable):
    """One law with the depth substituted, R = exp(ln_c) V^V f^f t^t AW^AW, and the upper limit of R.

    Attributes
    ----------
    response, unit : str
    ln_c, V, f, t, AW : float
        Natural logarithm of the constant, and exponents; 0 for a factor that the law lacks.
    most : float
        Limit of R in ``unit``.
    put_in : tuple of (str, float)
        Terms of the constant besides ln c0: name of a parameter and its multiplier, ``("d", ln 2.5)``.
    """

    response: str
    unit: str
    ln_c: float
    V: float
    f: float
    t: float
    AW: float
    most: float
    put_in: tuple[tuple[str, float], ...] = ()

    def __call__(self, V: ArrayLike, f: ArrayLike, t: ArrayLike = 1.0, AW: ArrayLike = 1.0) -> Array:
        """R at these factors, broadcast; an omitted factor is 1."""
        logs = np.asarray(self.ln_c + self.V * np.log(V) + self.f * np.log(f), dtype=np.float64)
        if self.t:
            logs = logs + self.t * np.log(t)
        if self.AW:
            logs = logs + self.AW * np.log(AW)
        return np.asarray(np.exp(logs), dtype=np.float64)


@dataclass(frozen=True, slots=True, repr=False)
class LifeLaws(Displayable):
    """The laws and limits of an edge's life.

    Attributes
    ----------
    wear : Terms
        AW = C V^a f^b t^h, with the wear criterion as its limit.
    power, force : Terms or None
        None where the file has no law or no limit of it, see ``notes``.
    d : float
        Depth of cut, mm.
    V, f : (float, float)
        Ranges of the machine, m/min and mm/rev.
    Vf : (float, float)
        Range of V f, m/min mm/rev, that the limits of the feed rate allow at the diameter.
    times : {"published", "full"}
        Default of `Rules`: all times, except for the paper's own file.
    notes : tuple of str
        What the file leaves open.
    """

    wear: Terms
    power: Terms | None
    force: Terms | None
    d: float
    V: tuple[float, float]
    f: tuple[float, float]
    times: Times = "full"
    notes: tuple[str, ...] = ()
    Vf: tuple[float, float] = (0.0, math.inf)

    def mrr(self, V: ArrayLike, f: ArrayLike) -> Array:
        """MRR = 1000 V f d, mm3/min (eq. 8)."""
        return 1000.0 * self.d * np.asarray(V, dtype=np.float64) * np.asarray(f, dtype=np.float64)

    @property
    def limited(self) -> tuple[tuple[str, Terms], ...]:
        """Power and force by name, as far as limited."""
        both = (("power", self.power), ("force", self.force))
        return tuple((name, terms) for name, terms in both if terms is not None)


def on_machine(laws: LifeLaws, limits: "LimitsSection", D: float | None) -> LifeLaws:
    """The laws within the limits of spindle speed and feed rate at a diameter D, mm; a note names them without one.

    Raises
    ------
    UsageError
        No speed of the range is within the limits of the spindle.
    """
    n, fm = limits.spindle_speed, limits.feed_rate
    stated = [f"{name} {one.low:g} to {one.high:g} {one.unit}" for name, one in (("n", n), ("fm", fm)) if one]
    if not stated:
        return laws
    if D is None:
        words = f"{NOT_HELD}, {' and '.join(stated)}: these need the diameter, --at D=60mm."
        return replace(laws, notes=(*laws.notes, words))
    around = math.pi * D / 1000  # m in one revolution
    slow, fast = machine_range(n, "1/min", around)
    V = max(laws.V[0], slow), min(laws.V[1], fast)
    if V[0] > V[1]:
        raise UsageError(
            f"on a diameter of {D:g} mm the limits of n allow {slow:.4g} to {fast:.4g} m/min, and the range of V is "
            f"{laws.V[0]:g} to {laws.V[1]:g} m/min: give another diameter, or another range of V or n."
        )
    note = f"V and f keep the limits of the machine, {' and '.join(stated)}, on a diameter of {D:g} mm."
    return replace(laws, V=V, Vf=machine_range(fm, "mm/min", around), notes=(*laws.notes, note))


def held_by_moves(words: Iterable[str]) -> tuple[str, ...]:
    """Sentences on a plan without that on limits that its pairs do not keep, where each move keeps them."""
    return tuple(one for one in words if not one.startswith(NOT_HELD))


def machine_range(given: "Range | None", unit: str, times: float = 1.0) -> tuple[float, float]:
    """Ends of a range of the machine in a unit, multiplied; from 0 without end without one."""
    k = 1.0 if given is None else ratio(given.unit, unit) * times
    return (0.0, math.inf) if given is None else (given.low * k, given.high * k)


WearRule = Literal["clock", "wear_state"]


@dataclass(frozen=True, slots=True, repr=False)
class Rules(Displayable):
    """Rules of wear accumulation and time in the computation of a life.

    Attributes
    ----------
    times : {"published", "full"}
        ``full`` keeps the factors t^-0.049 and t^-0.173 of eq. 2 and 3, the laws as they were fitted.
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
                raise UsageError(f"{name}={value!r}: give {' or '.join(map(repr, known))}.")
        if not 0 < self.interval < np.inf:
            raise UsageError(f"an interval of {self.interval!r} min: give a length above zero.")


def wear_after(
    laws: LifeLaws, rules: Rules, V: ArrayLike, f: ArrayLike, before: ArrayLike, start: float, end: float
) -> Array:
    """Wear at ``end`` of an edge with wear ``before`` at ``start`` (min) that cuts at V and f between; eq. 4 and 5.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers import life_laws
    >>> laws = life_laws(published("AC-2017"))
    >>> round(float(wear_after(laws, Rules(), 140.0, 0.58, 0.157219, 1.0, 2.0)), 5)
    0.18518
    """
    first, h = laws.wear(V, f), laws.wear.t  # first: wear of a fresh edge after one minute
    if rules.wear == "clock":
        return np.asarray(before + first * (end**h - start**h), dtype=np.float64)
    return np.asarray((np.asarray(before) ** (1 / h) + first ** (1 / h) * (end - start)) ** h, dtype=np.float64)


def response_at_end(terms: Terms, rules: Rules, V: ArrayLike, f: ArrayLike, end: ArrayLike, AW: ArrayLike) -> Array:
    """Power or force at the end of an interval with the wear reached there; eq. 6 and 7 where times are published."""
    return terms(V, f, end if rules.times == "full" else 1.0, AW)


def feed_within_limits(laws: LifeLaws, rules: Rules, V: float, f: float, end: float, AW: float) -> float:
    """The largest feed up to f that keeps power and force at the end of an interval; 0 where none does.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers import life_laws
    >>> laws = life_laws(published("AC-2017"))
    >>> [round(feed_within_limits(laws, Rules(laws.times), V, 0.205, 14.0, 0.299), 3) for V in (200.0, 125.0)]
    [0.205, 0.079]
    """
    held = f
    for _, terms in laws.limited:
        share = float(response_at_end(terms, rules, V, f, end, AW)) / terms.most
        if share > 1 + SAME:
            held = min(held, f * share ** (-1 / terms.f) if terms.f > 0 else 0.0)
    return held
