"""Whether a point lies in the region of a design, from plain numbers and numpy alone.

The numbers are those of ``Domain.facts()``, which a parameter file holds; nothing else is needed to decide whether a
point is inside. Points are coded factor by factor, -1 to +1 over the tested range (in logarithms for a power law); a
space takes its columns from ``z = (1, coded factors, indicators of a category)``, and ``z' M z`` is the leverage.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Array, Flags, Ints

Facts = Mapping[str, Any]

# Levels recorded with three or four digits move the coded ends of a range by about 1e-4.
ROUNDING = 1e-3
# Leverage, and the square of the radius, may exceed the design's largest by this share: a point a little off an
# axial one (f 0.20 for 0.19) adds about 2 %, which does not affect a prediction.
SLACK = 0.05


def coded(facts: Facts, points: ArrayLike) -> Array:
    """Factors coded -1 to +1 over the ranges cut, shape (..., k), from points (..., k) in the units of the law.

    Examples
    --------
    >>> facts = {"logs": True, "centre": [np.log(100)], "half_range": [np.log(2)]}
    >>> coded(facts, [[50.0], [200.0]]).ravel().round(9).tolist()
    [-1.0, 1.0]
    """
    X = np.asarray(points, dtype=float)
    logs = facts["logs"]
    if isinstance(logs, bool):
        logs = np.full(X.shape[-1], logs)
    terms = np.log(X) if all(logs) else np.where(logs, np.log(np.where(logs, X, 1.0)), X)
    return np.asarray((terms - np.asarray(facts["centre"])) / np.asarray(facts["half_range"]), dtype=float)


def radius(facts: Facts, points: ArrayLike) -> Array:
    """Distance from the centre in coded factors, shape (...,)."""
    return np.asarray(np.linalg.norm(coded(facts, points), axis=-1), dtype=float)


def leverages(facts: Facts, points: ArrayLike, level: ArrayLike | None = None) -> Array:
    """Leverage in each space of the design, shape (..., number of spaces).

    Parameters
    ----------
    facts : mapping, of ``Domain.facts()``
    points : array, shape (..., k)
        Factors in the order and units of the law.
    level : text or array of texts, shape (...,), optional
        Level of the category, where the law has one; left out, it is the level of reference.
    """
    U = coded(facts, points)
    return _leverages(facts, U, level_numbers(facts, level, U.shape[:-1]))


def _leverages(facts: Facts, U: Array, at: Ints) -> Array:
    """Leverage in each space at coded points U (..., k) of the level numbers ``at``, shape (...,)."""
    k, levels = U.shape[-1], max(1, len(facts["levels"]))
    z = np.ones((*U.shape[:-1], k + levels))
    z[..., 1 : 1 + k] = U
    z[..., 1 + k :] = at[..., None] == np.arange(1, levels)
    out = np.empty((*U.shape[:-1], len(facts["spaces"])))
    for j, space in enumerate(facts["spaces"]):
        part = z[..., list(space["columns"])]
        out[..., j] = np.einsum("...i,ij,...j->...", part, np.asarray(space["matrix"]), part)
    return out


def inside(facts: Facts, points: ArrayLike, level: ArrayLike | None = None) -> Flags:
    """Whether points lie in the region, shape (...,); arguments as in :func:`leverages`.

    A point is inside when every factor is within its range and neither radius nor leverage exceeds that of the
    outermost point of the design. Every point of the design, and every point between two of them, is inside.

    Examples
    --------
    >>> space = {"columns": [0, 1], "matrix": [[0.5, 0.0], [0.0, 0.5]], "largest": [1.0]}
    >>> facts = {"logs": False, "centre": [0], "half_range": [1], "largest_radius": 1, "levels": [], "spaces": [space]}
    >>> inside(facts, [[0.5], [1.5]]).tolist()
    [True, False]
    """
    return np.asarray((excess(facts, points, level) <= 0).all(axis=-1))


def excess(facts: Facts, points: ArrayLike, level: ArrayLike | None = None) -> Array:
    """Excess of points over each range, the largest radius and the largest leverages, shape (..., k + 1 + spaces).

    A point is inside the region where none is above zero. Arguments as in :func:`leverages`.

    Examples
    --------
    >>> space = {"columns": [0, 1], "matrix": [[0.5, 0.0], [0.0, 0.5]], "largest": [1.0]}
    >>> facts = {"logs": False, "centre": [0], "half_range": [1], "largest_radius": 1, "levels": [], "spaces": [space]}
    >>> (excess(facts, [[2.0]]) > 0).tolist()
    [[True, True, True]]
    """
    U = coded(facts, points)
    at = level_numbers(facts, level, U.shape[:-1])
    radius = np.square(U).sum(axis=-1) - facts["largest_radius"] ** 2 * (1 + SLACK)
    parts = [np.abs(U) - (1 + ROUNDING), radius[..., None]]
    if facts["spaces"]:
        largest = np.stack([np.asarray(space["largest"])[at] for space in facts["spaces"]], axis=-1)
        parts.append(_leverages(facts, U, at) - largest * (1 + SLACK))
    return np.concatenate(parts, axis=-1)


def level_numbers(facts: Facts, level: ArrayLike | None, shape: tuple[int, ...]) -> Ints:
    """Position of each point's level among the levels, 0 for the reference; KeyError names an unknown one."""
    if level is None or not len(facts["levels"]):
        return np.zeros(shape, dtype=np.intp)
    number = {str(name): j for j, name in enumerate(facts["levels"])}
    asked = np.broadcast_to(np.asarray(level, dtype=object), shape)
    return np.array([number[str(name)] for name in asked.ravel()], dtype=np.intp).reshape(shape)
