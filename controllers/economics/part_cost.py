"""Cost and time of a part as sums of power functions of V and f.

With a tool life ``T = K V^-p f^-q`` the cost of a part is

    C = Cm th + Cm tm + (Cm tc + Ct) tm / T + energy,    tm = k / (V f),

Cm the rate of machine and labour, th handling, tm the time in cut, tc the change of an edge, Ct its price. Each term is
the exponential of a linear function of ln V and ln f, so C is convex there, and so is every power law that limits it: a
local optimum is the global one (a geometric programme; Boyd et al. 2007, doi 10.1007/s11081-007-9001-7). Without
limits the speed of least cost at a feed has ``T = (p - 1)(tc + Ct/Cm)`` (Taylor; Gilbert 1950).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import log, pi
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array, Flags
from ...core.display import Displayable
from ..region.half_planes import HalfPlane
from ..region.log_planes import LogPlane

if TYPE_CHECKING:
    from ...parameters.sections.costs import CostsSection

BISECTIONS = 60  # of a segment: the machine's range to 1e-16 of it
NEWTON = 40


@dataclass(frozen=True, slots=True, repr=False)
class PowerSum(Displayable):
    """A constant plus terms ``exp(intercept + slopes . (ln V, ln f))``, of one law or for each of S draws.

    Attributes
    ----------
    names : tuple of str
        Of the terms, m of them.
    intercepts : ndarray, shape (..., m)
        Minus infinity for a term that is zero.
    slopes : ndarray, shape (..., m, 2)
    constant : float
    """

    names: tuple[str, ...]
    intercepts: Array
    slopes: Array
    constant: float = 0.0

    def terms(self, x: Array) -> Array:
        """Each term at points (..., 2), shape (..., m)."""
        with np.errstate(over="ignore"):  # infinite far outside the tests
            return np.asarray(np.exp(self.intercepts + np.einsum("...mi,...i->...m", self.slopes, x)))

    def value(self, x: Array) -> Array:
        """The sum at points (..., 2), shape (...,)."""
        return np.asarray(self.constant + self.terms(x).sum(axis=-1))

    def parts(self, x: Array) -> dict[str, float]:
        """The constant and the terms at one point (2,), by name, of one law."""
        return {"handling": self.constant, **dict(zip(self.names, self.terms(x).tolist(), strict=True))}

    def slope(self, x: Array, along: Array) -> Array:
        """Derivative at points (..., 2) along directions (..., 2), shape (...,)."""
        steep = np.einsum("...mi,...i->...m", self.slopes, along)
        return np.asarray((self.terms(x) * steep).sum(axis=-1))

    def at(self, rows: Flags | int) -> "PowerSum":
        """The sums of some draws, or the sum of one."""
        return PowerSum(self.names, self.intercepts[rows], self.slopes[rows], self.constant)


def time_in_cut(costs: "CostsSection", d: float) -> float:
    """Logarithm of k in ``tm = k / (V f)``, min at m/min and mm/rev; of 1 cm3 without the cut of a part."""
    cut = costs.cut
    if cut is not None and cut.length is not None and cut.diameter is not None:
        return log(pi * cut.diameter * cut.length / 1000)
    return log((1.0 if cut is None or cut.volume is None else cut.volume) / d)


def cost_of_part(costs: "CostsSection", d: float, life: LogPlane, power: LogPlane | None = None) -> PowerSum:
    """Cost of a part, or of 1 cm3, in the currency, over ln V and ln f.

    Parameters
    ----------
    costs : CostsSection
    d : float
        Depth of cut, mm.
    life : LogPlane
        Tool life, min.
    power : LogPlane, optional
        Mean power over the life of an edge, kW; the energy counts where it has a price.
    """
    rate, change = costs.per_minute, costs.per_minute * costs.change
    found = {"machine": rate, "change of edges": change, "edges": costs.price_of_edge}
    sums = _sum(found, time_in_cut(costs, d), life, costs.handling * rate)
    if costs.energy is None or power is None:
        return sums
    price = _ln(costs.energy / 60 / (costs.efficiency or 1.0))
    return PowerSum(
        (*sums.names, "energy"),
        _joined(sums.intercepts, price + time_in_cut(costs, d) + power.intercept),
        _joined(sums.slopes, power.slopes - 1.0, axis=-2),
        sums.constant,
    )


def time_of_part(costs: "CostsSection", d: float, life: LogPlane) -> PowerSum:
    """Time of a part with handling and changes of edges, min, over ln V and ln f."""
    found = {"machine": 1.0, "change of edges": costs.change, "edges": 0.0}
    return _sum(found, time_in_cut(costs, d), life, costs.handling)


def cost_of_edge(costs: "CostsSection", minutes: float, removed: float) -> tuple[float, float]:
    """Cost per cm3, and cm3 per min, of an edge that removes so many mm3 in so many min, with its change.

    Examples
    --------
    >>> from fitmodels.parameters.sections.costs import CostsSection
    >>> costs = CostsSection(currency="USD", machine=30.0, edge=3.0, change=2.0)
    >>> [round(value, 6) for value in cost_of_edge(costs, 14.0, 2213750.0)]
    [0.004969, 138.359375]
    """
    whole = minutes + costs.change
    return (costs.per_minute * whole + costs.price_of_edge) / (removed / 1000), removed / 1000 / whole


def _sum(weights: Mapping[str, float], k: float, life: LogPlane, constant: float) -> PowerSum:
    """Time in cut by its weight, and the edges worn in it by theirs."""
    per_cut, *per_edge = (_ln(weight) for weight in weights.values())
    shape = np.shape(life.intercept)
    intercepts = [np.full(shape, per_cut + k), *(each + k - life.intercept for each in per_edge)]
    slopes = [np.full((*shape, 2), -1.0), *(-1.0 - life.slopes for _ in per_edge)]
    return PowerSum(tuple(weights), np.stack(intercepts, axis=-1), np.stack(slopes, axis=-2), constant)


def _ln(value: float) -> float:
    return log(value) if value > 0 else -np.inf


def _joined(held: Array, more: Array, axis: int = -1) -> Array:
    return np.concatenate([held, np.expand_dims(np.broadcast_to(more, held.sum(axis=axis).shape), axis)], axis=axis)


@dataclass(frozen=True, slots=True, repr=False)
class Sides(Displayable):
    """Half planes ``a . x <= b`` over ln V and ln f for each of S draws.

    Attributes
    ----------
    a : ndarray, shape (S, m, 2)
    b : ndarray, shape (S, m)
    """

    a: Array
    b: Array

    @classmethod
    def of(cls, planes: Sequence[HalfPlane]) -> "Sides":
        """Half planes of one law as those of a single draw."""
        return cls(np.array([[each.a for each in planes]]), np.array([[each.b for each in planes]]))

    def beyond(self, x: Array) -> Array:
        """Largest excess over a side at points (S, 2), shape (S,)."""
        return np.asarray((np.einsum("smi,si->sm", self.a, x) - self.b).max(axis=-1))


def least(cost: PowerSum, sides: Sides) -> Array:
    """The point of least cost within the sides, for each draw, shape (S, 2); NaN where they exclude each other.

    The sum is convex, so it is least where its gradient vanishes, if that lies within the sides, and else on a side,
    where its derivative along the side is found zero by bisection. Exact but for rounding.

    Examples
    --------
    >>> cost = PowerSum(("machine", "edges"), np.log([[100.0, 1e-7]]), np.array([[[-1.0, -1.0], [3.0, 0.5]]]))
    >>> square = Sides(np.array([[[1.0, 0], [-1, 0], [0, 1], [0, -1]]]), np.log([[400.0, 1 / 50, 0.4, 1 / 0.1]]))
    >>> np.exp(least(cost, square))[0].round(3).tolist()
    [190.523, 0.4]
    """
    found = [_along(cost, sides, i) for i in range(sides.a.shape[1])]
    found.append(_within(cost, sides))
    points = np.stack(found)
    with np.errstate(invalid="ignore", over="ignore"):
        each = np.stack([cost.value(x) for x in found])
    best = np.argmin(np.where(np.isfinite(each), each, np.inf), axis=0)
    return np.asarray(points[best, np.arange(points.shape[1])])


def _along(cost: PowerSum, sides: Sides, i: int) -> Array:
    """Least cost on side i within the others, shape (S, 2); NaN where no point of it is within them."""
    a, b = sides.a[:, i], sides.b[:, i]
    size = np.einsum("si,si->s", a, a)
    start, along = a * (b / size)[:, None], np.stack([-a[:, 1], a[:, 0]], axis=-1) / np.sqrt(size)[:, None]
    rest = [j for j in range(sides.a.shape[1]) if j != i]
    rise = np.einsum("smi,si->sm", sides.a[:, rest], along)
    left = sides.b[:, rest] - np.einsum("smi,si->sm", sides.a[:, rest], start)
    flat = np.abs(rise) < 1e-12 * np.abs(sides.a[:, rest]).max(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = left / rise
    low = np.where(~flat & (rise < 0), ends, -np.inf).max(axis=-1)
    high = np.where(~flat & (rise > 0), ends, np.inf).min(axis=-1)
    empty = (low > high + 1e-12) | (flat & (left < -1e-9)).any(axis=-1) | ~np.isfinite(high - low)
    low, high = np.where(empty, 0.0, low), np.where(empty, 0.0, np.maximum(low, high))
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        up = cost.slope(start + middle[:, None] * along, along) > 0
        low, high = np.where(up, low, middle), np.where(up, middle, high)
    return np.where(empty[:, None], np.nan, start + ((low + high) / 2)[:, None] * along)


def _within(cost: PowerSum, sides: Sides) -> Array:
    """The point within the sides where the gradient vanishes, shape (S, 2), by Newton's method; NaN without one."""
    x = np.zeros((len(cost.intercepts), 2))
    with np.errstate(all="ignore"):
        for _ in range(NEWTON):
            terms = cost.terms(x)
            gradient = np.einsum("sm,smi->si", terms, cost.slopes)
            curvature = np.einsum("sm,smi,smj->sij", terms, cost.slopes, cost.slopes)
            det = curvature[:, 0, 0] * curvature[:, 1, 1] - curvature[:, 0, 1] ** 2
            step = (
                np.stack(
                    [
                        curvature[:, 1, 1] * gradient[:, 0] - curvature[:, 0, 1] * gradient[:, 1],
                        curvature[:, 0, 0] * gradient[:, 1] - curvature[:, 0, 1] * gradient[:, 0],
                    ],
                    axis=-1,
                )
                / det[:, None]
            )
            x = x - np.clip(step, -1.0, 1.0)
        terms = cost.terms(x)
        rest = np.abs(np.einsum("sm,smi->si", terms, cost.slopes)).max(axis=-1) / terms.sum(axis=-1)
        kept = (rest < 1e-9) & (sides.beyond(x) <= 1e-12)
    return np.where(kept[:, None], x, np.nan)
