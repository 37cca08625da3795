"""The corners of a region: lettered, each with the limits that meet there, and the best of them."""

from dataclasses import dataclass
from string import ascii_uppercase

import numpy as np

from ...core.display import Displayable
from .clipping import TOUCH, Array, HalfPlane
from .points import SAME, plain
from .surfaces import Plane


@dataclass(frozen=True, slots=True, repr=False)
class Corner(Displayable):
    """A corner of the region: ``V`` m/min, ``f`` mm/rev, and ``limits``, the two (or more) that meet there."""

    letter: str
    V: float
    f: float
    limits: tuple[str, ...]


def best_corner(polygon: Array, wear: Plane | None) -> int:
    """Corner of the greatest MRR; of those alike, the one that wears least, or else turns slowest."""
    removed = polygon.sum(axis=1)
    alike = np.flatnonzero(removed >= removed.max() - TOUCH)
    cost = polygon[alike] @ wear.slopes if wear is not None else polygon[alike, 0]
    return int(alike[np.argmin(cost)])


def from_best(polygon: Array, wear: Plane | None) -> Array:
    """Corners clockwise, so turned that the best is the second."""
    if len(polygon) < 2:
        return polygon
    return np.roll(polygon, 1 - best_corner(polygon, wear), axis=0)


def lettered(polygon: Array, limits: tuple[HalfPlane, ...]) -> tuple[Corner, ...]:
    """Corners of a polygon, A to Z, with all limits that meet in each."""
    out = []
    for letter, x in zip(ascii_uppercase, polygon, strict=False):
        meet = tuple(each.name for each in limits if abs(float(each.beyond(x))) <= SAME)
        out.append(Corner(letter, plain(x[0]), plain(x[1]), meet))
    return tuple(out)


def worth(x: Array, limits: tuple[HalfPlane, ...]) -> dict[str, float]:
    """What 1 % more of each limit that holds a corner is worth, in % of MRR: the multipliers of the linear programme.

    Nothing where more than two limits meet, or fewer.
    """
    meet = [each for each in limits if abs(float(each.beyond(x))) <= SAME]
    if len(meet) != 2:
        return {}
    multipliers = np.linalg.solve(np.array([each.a for each in meet]).T, np.ones(2))
    return {each.name: float(value) for each, value in zip(meet, multipliers, strict=True)}
