"""Half planes and polygons of ln V and ln f, where every limit on a power law is a half plane.

A polygon is an array of its corners in order, shape (n, 2), columns ln V and ln f; without corners it is empty.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import exp
from typing import Literal

import numpy as np

from ...core.arrays import Array
from ...core.display import Displayable

TOUCH = 1e-11  # of a logarithm: a relative 1e-11 of the response, some hundred times what clipping rounds
SAME = 1e-9  # of a logarithm: a point lies on a limit that it meets to a part in 10^9
FAR = 200.0  # half width of the square that stands for the unbounded plane


@dataclass(frozen=True, slots=True, repr=False)
class ValueLimit(Displayable):
    """A limit on one quantity, without its geometry.

    Attributes
    ----------
    symbol, unit : str
    side : {"most", "least"}
        Whether ``value`` is the largest or the smallest allowed.
    value : float
        In ``unit``.
    """

    symbol: str
    unit: str
    side: Literal["most", "least"]
    value: float

    @property
    def name(self) -> str:
        """Short: ``P 7 kW``."""
        return f"{self.symbol} {self.value:g} {self.unit}"

    @property
    def words(self) -> str:
        """The limit as a phrase: ``P at most 7 kW``."""
        return f"{self.symbol} at {self.side} {self.value:g} {self.unit}"


@dataclass(frozen=True, slots=True, repr=False)
class HalfPlane(ValueLimit):
    """``a . (ln V, ln f) <= b``: one limit.

    Attributes
    ----------
    symbol, unit : str
    side : {"most", "least"}
        Whether ``value`` is the largest or the smallest allowed.
    value : float
        In ``unit``.
    a : tuple of float
    b : float

    Examples
    --------
    >>> HalfPlane("f", "mm/rev", "least", 0.06, (0.0, -1.0), 2.813).words
    'f at least 0.06 mm/rev'
    """

    a: tuple[float, float]
    b: float

    def beyond(self, x: Array) -> Array:
        """Excess of points over the limit, in logarithms: (..., 2) -> (...,); negative is within."""
        return np.asarray(x[..., 0] * self.a[0] + x[..., 1] * self.a[1] - self.b)


def rectangle(low: Array, high: Array) -> Array:
    """Corners, clockwise from the lower left one; fewer where a range is a single value."""
    return _distinct(np.array([[low[0], low[1]], [low[0], high[1]], [high[0], high[1]], [high[0], low[1]]]))


def clip(polygon: Array, plane: HalfPlane) -> Array:
    """Intersection of a convex polygon with a half plane (Sutherland & Hodgman 1974, doi 10.1145/360767.360802).

    Examples
    --------
    >>> square = rectangle(np.zeros(2), np.ones(2))
    >>> clip(square, HalfPlane("P", "kW", "most", 1.0, (1.0, 1.0), 1.0)).tolist()
    [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]]
    """
    over = plane.beyond(polygon)
    kept: list[Array] = []
    for here, there, g, h in zip(polygon, np.roll(polygon, -1, axis=0), over, np.roll(over, -1), strict=True):
        if g <= TOUCH:
            kept.append(here)
        if (g < -TOUCH and h > TOUCH) or (g > TOUCH and h < -TOUCH):
            kept.append(here + g / (g - h) * (there - here))
    return _distinct(np.array(kept).reshape(-1, 2))


def intersect(planes: Sequence[HalfPlane], polygon: Array) -> Array:
    """Intersection of a polygon with all half planes."""
    for plane in planes:
        polygon = clip(polygon, plane)
    return polygon


def conflict(planes: Sequence[HalfPlane]) -> tuple[HalfPlane, ...]:
    """Minimal set of limits that exclude each other: without any one of them the others are feasible.

    It has at most three members, by Helly's theorem in the plane. Those listed first are dropped first.
    """
    needed = list(planes)
    for plane in planes:
        rest = [other for other in needed if other is not plane]
        if not len(intersect(rest, everywhere())):
            needed = rest
    return tuple(needed)


def everywhere() -> Array:
    """A square that contains every feasible region."""
    return rectangle(np.full(2, -FAR), np.full(2, FAR))


def _distinct(polygon: Array) -> Array:
    """The polygon without repeated corners."""
    if len(polygon) < 2:
        return polygon
    apart = np.abs(polygon - np.roll(polygon, 1, axis=0)).max(axis=1) > TOUCH
    return polygon[apart] if apart.any() else polygon[:1]


def conflict_sentence(limits: Sequence[HalfPlane], sides: Sequence[HalfPlane], responses: Collection[str]) -> str:
    """Sentence on an empty region: the limits in conflict and the best value the others allow.

    ``limits`` are those of responses and spindle, ``sides`` those of the machine's ranges.
    """
    among = conflict((*sides, *limits))
    names = [each.words for each in sorted(among, key=lambda each: each in limits)]
    head = f"{names[0]} is never met"
    if len(names) > 1:
        head = f"{', '.join(names[:-1])} and {names[-1]} exclude each other"
    for each in among:
        rest = intersect([other for other in among if other is not each], everywhere())
        if each.symbol in responses and len(rest):
            nearest = exp(float(each.beyond(rest).min())) * each.value
            return f"{head}: {each.symbol} is {nearest:.4g} {each.unit} there at best."
    return f"{head}."
