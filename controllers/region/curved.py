"""Region and optimum within limits that are curves in ln V and ln f.

Half planes give a polygon and its best corner exactly (`half_planes`). Where a limit is a curve, the corners are
solved for from the crossings of two limits on a grid, and the best pair is searched with SLSQP from the best points of
that grid and from the corners. What is found keeps every limit to a part in 10^9. A region narrower than a cell of the
grid, 1/160 of the machine's ranges, is found by minimising its worst excess.
"""

from collections.abc import Callable, Collection, Sequence

import numpy as np

from ...core.arrays import Array, Flags
from .half_planes import SAME, HalfPlane
from .surfaces import CurvedLimit, RegionLimit

Limit = HalfPlane | CurvedLimit | RegionLimit
Cost = Callable[[Array], Array]

AXES = (("V", "m/min"), ("f", "mm/rev"))
CELLS = 160  # along each axis
MOST = 40  # starts for the corners of two limits
STARTS = 3  # of the search: the best of corners and grid
ZOOMS, FINE = 14, 21  # rounds and points along each axis of a refined minimum
STEP = 1e-6  # of a logarithm, central differences: good to 1e-10 of it
APART = 1e-7  # of a logarithm: two vertices are one


def worst(limits: Sequence[Limit], x: Array) -> Array:
    """Excess over the limit that is exceeded most, (..., 2) -> (...,); negative where all are kept."""
    return np.asarray(np.maximum.reduce([each.beyond(x) for each in limits]))


def gradient(limit: Limit, x: Array) -> Array:
    """Derivative of ``beyond`` by ln V and ln f at points (..., 2), in the same shape."""
    if isinstance(limit, HalfPlane):
        return np.broadcast_to(np.array(limit.a), x.shape)
    steps = STEP * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    found = limit.beyond(x[..., None, :] + steps)
    return np.asarray((found[..., :2] - found[..., 2:]) / (2 * STEP))


def grid(low: Array, high: Array, cells: int = CELLS) -> Array:
    """Points over a box, shape (cells + 1, cells + 1, 2): rows along ln f, columns along ln V."""
    axes = [np.linspace(low[i], high[i], cells + 1) for i in (0, 1)]
    return np.stack(np.meshgrid(*axes), axis=-1)


def vertices(limits: Sequence[Limit], low: Array, high: Array) -> Array:
    """Corners and best pair of the region within limits, clockwise, shape (n, 2); empty where no pair is feasible."""
    x = grid(low, high)
    over = np.stack([each.beyond(x) for each in limits])
    start = _least(lambda at: worst(limits, at), x, over.max(axis=0))
    if float(worst(limits, start)) > SAME:
        return np.zeros((0, 2))
    corners = _corners(limits, x, over)
    feasible = x[over.max(axis=0) <= 0]
    best = minimum(lambda at: -at.sum(axis=-1), limits, (low, high), [*corners, start], feasible)
    found = _distinct(np.array([*corners, best]).reshape(-1, 2))
    return _clockwise(found if len(found) else start[None])


def least_costs(
    cost: Cost, limits: Sequence[Limit], box: tuple[Array, Array], best: Array, losses: Sequence[float]
) -> list[Array]:
    """The feasible pair of least cost for each loss of removal rate against the best pair, as a share of it."""
    x = grid(*box).reshape(-1, 2)
    feasible = x[worst(limits, x) <= 0]
    rates, starts, out = feasible.sum(axis=-1), [best], []
    for loss in losses:
        most = float(best.sum() + np.log1p(-loss))
        enough = HalfPlane("MRR", "mm3/min", "least", 0.0, (-1.0, -1.0), -most)
        found = minimum(cost, (*limits, enough), box, starts, feasible[rates >= most])
        starts = [best, found]
        out.append(found)
    return out


def minimum(
    cost: Cost, limits: Sequence[Limit], box: tuple[Array, Array], starts: Sequence[Array], feasible: Array
) -> Array:
    """The feasible point of least cost, shape (2,): the best of SLSQP from the best of the candidates.

    Parameters
    ----------
    cost : callable
        (..., 2) -> (...,).
    limits : sequence of limits
    box : two arrays, shape (2,)
        Smallest and largest ln V and ln f.
    starts : sequence of arrays, shape (2,)
        Candidates.
    feasible : ndarray, shape (n, 2)
        Points of a grid that keep the limits; the best of them are candidates too.
    """
    inner = (
        feasible[np.argsort(cost(feasible), kind="stable")[[0, *range(1, len(feasible), len(feasible) // 8 + 1)]]]
        if len(feasible)
        else feasible
    )
    candidates = np.concatenate([np.array(starts).reshape(-1, 2), inner[:STARTS]])
    order = np.argsort(cost(candidates), kind="stable")
    found = [each for at in candidates[order[:STARTS]] if (each := _searched(cost, limits, box, at)) is not None]
    points = np.concatenate([np.array(found).reshape(-1, 2), candidates])
    over = worst(limits, points)
    kept = points[over <= SAME]
    return np.asarray(kept[int(np.argmin(cost(kept)))] if len(kept) else points[int(np.argmin(over))])


def _searched(cost: Cost, limits: Sequence[Limit], box: tuple[Array, Array], start: Array) -> Array | None:
    """End of one search, moved inside by less than a part in 10^9 where rounding left it outside."""
    from scipy.optimize import Bounds, minimize

    curves = [each for each in limits if not isinstance(each, HalfPlane)]
    planes = [each for each in limits if isinstance(each, HalfPlane)]

    def excess(x: Array) -> Array:
        flat = [each.beyond(x)[..., None] for each in planes]
        return np.concatenate([*(each.parts(x) for each in curves), *flat], axis=-1)

    low, high = box
    with np.errstate(all="ignore"):
        found = minimize(  # type: ignore[call-overload]  # stubs want a constraint of their own class
            lambda x: float(cost(x)), np.clip(start, low, high), jac=lambda x: _slope(cost, x), method="SLSQP",
            bounds=Bounds(low, high),
            constraints={"type": "ineq", "fun": lambda x: -excess(x), "jac": lambda x: -_slope(excess, x)},
            options={"ftol": 1e-13, "maxiter": 100},
        )  # fmt: skip
    end = np.clip(np.asarray(found.x, dtype=np.float64), low, high)
    if not np.isfinite(end).all():
        return None
    shares = np.array([0.0, *np.geomspace(1e-12, 1e-3, 19)])[:, None]  # towards the start, which keeps the limits
    points = end + shares * (start - end)
    kept = np.flatnonzero(worst(limits, points) <= SAME)
    return points[kept[0]] if len(kept) else None


def _slope(of: Cost, x: Array) -> Array:
    """Derivative at one point (2,), shape (2,) of a number or (m, 2) of m numbers, by central differences."""
    steps = STEP * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    found = of(x + steps)
    return np.asarray(((found[:2] - found[2:]) / (2 * STEP)).T)


def _least(of: Cost, x: Array, values: Array) -> Array:
    """The point of least value: the best of a grid (rows, columns, 2), refined by grids around it."""
    at = x[np.unravel_index(int(np.argmin(values)), values.shape)]
    low, high = x[0, 0], x[-1, -1]
    half = 2 * (high - low) / (x.shape[0] - 1)
    for _ in range(ZOOMS):
        near = grid(np.maximum(at - half, low), np.minimum(at + half, high), FINE - 1)
        found = of(near)
        at = near[np.unravel_index(int(np.argmin(found)), found.shape)]
        half = half / 4
    return np.asarray(at)


def _corners(limits: Sequence[Limit], x: Array, over: Array) -> list[Array]:
    """Feasible points where two limits meet, each solved for from the cells in which both change sign."""
    changes = [_changes(each) for each in over]
    found: list[Array] = []
    for i, first in enumerate(limits):
        for j in range(i + 1, len(limits)):
            cells = np.argwhere(changes[i] & changes[j])
            cells = cells[:: max(1, len(cells) // MOST)]
            starts = x[cells[:, 0], cells[:, 1]] / 2 + x[cells[:, 0] + 1, cells[:, 1] + 1] / 2
            found += _solved(first, limits[j], starts)
    if not found:
        return []
    points = _distinct(np.array(found))
    box = np.logical_and(points >= x[0, 0] - SAME, points <= x[-1, -1] + SAME).all(axis=1)
    points = points[box]
    return list(points[worst(limits, points) <= SAME]) if len(points) else []


def _changes(over: Array) -> Flags:
    """Cells in which a limit changes sign, with their neighbours, shape (rows - 1, columns - 1)."""
    corners = np.stack([over[:-1, :-1], over[1:, :-1], over[:-1, 1:], over[1:, 1:]])
    found = (corners.min(axis=0) <= SAME) & (corners.max(axis=0) >= -SAME)
    wide = np.pad(found, 1)
    rows, columns = found.shape
    return np.asarray(np.logical_or.reduce([wide[i : i + rows, j : j + columns] for i in range(3) for j in range(3)]))


def _solved(first: Limit, second: Limit, starts: Array) -> list[Array]:
    """Common zeros of two limits by Newton's method from several starts; those that do not converge are left out."""
    if not len(starts):
        return []
    x = starts.copy()
    with np.errstate(all="ignore"):
        for _ in range(15):
            value = np.stack([first.beyond(x), second.beyond(x)], axis=-1)
            slopes = np.stack([gradient(first, x), gradient(second, x)], axis=-2)
            determinant = np.linalg.det(slopes)
            usable = np.abs(determinant) > 1e-12
            move = np.zeros_like(x)
            if usable.any():
                move[usable] = np.linalg.solve(slopes[usable], value[usable][..., None])[..., 0]
            x = x - np.clip(move, -0.1, 0.1)
            if float(np.abs(move).max()) < 1e-13:
                break
    value = np.stack([first.beyond(x), second.beyond(x)], axis=-1)
    near = (np.abs(value).max(axis=-1) <= SAME / 2) & (np.abs(x - starts).max(axis=-1) < 0.5)
    return list(_distinct(x[near])) if near.any() else []


def _distinct(points: Array) -> Array:
    """Points without repetitions, to a part in 10^7; the first of equals is kept."""
    kept: list[Array] = []
    for point in points:
        if not any(float(np.abs(point - other).max()) <= APART for other in kept):
            kept.append(point)
    return np.array(kept).reshape(-1, 2)


def _clockwise(points: Array) -> Array:
    middle = points.mean(axis=0)
    angle = np.arctan2(points[:, 1] - middle[1], points[:, 0] - middle[0])
    return np.asarray(points[np.argsort(-angle, kind="stable")])


def curved_conflict(limits: Sequence[Limit], low: Array, high: Array, responses: Collection[str]) -> str:
    """Sentence on an empty region: limits that exclude each other, and the best value that the others allow.

    ``limits`` are those of responses, spindle and tests; the machine's ranges are the box from ``low`` to ``high``.
    """
    x = grid(low, high)
    among = list(limits)
    for each in limits:
        rest = [other for other in among if other is not each]
        if rest and _excess(rest, x) > SAME:
            among = rest
    ends = ((name, unit, np.exp(low[i]), np.exp(high[i])) for i, (name, unit) in enumerate(AXES))
    box = " and ".join(f"{name} {a:.4g} to {b:.4g} {unit}" for name, unit, a, b in ends)
    names = [each.words for each in among]
    head = f"no pair within {box} keeps {' and '.join(names)}"
    for each in among:
        if isinstance(each, RegionLimit) or each.symbol not in responses:
            continue
        others = [other for other in among if other is not each]
        kept = x[worst(others, x) <= SAME] if others else x.reshape(-1, 2)
        if len(kept):
            sign = 1.0 if each.side == "most" else -1.0
            best = float(np.exp(sign * each.beyond(kept).min())) * each.value
            return f"{head}: {each.symbol} is {best:.4g} {each.unit} there at best."
    return f"{head}."


def _excess(limits: Sequence[Limit], x: Array) -> float:
    """The least of the worst excess over a box, given as a grid: not above zero where a pair keeps all limits."""
    at = _least(lambda near: worst(limits, near), x, worst(limits, x))
    return float(worst(limits, at))
