"""The most metal for a demanded probability: along every ray of equal f/V the farthest pair, then the best of them.

In ``s = ln V + ln f`` (the removal rate) and ``u = ln f - ln V`` the aim is one coordinate. On each ray the probability
is looked at from one end of the machine's ranges to the other, and where it last falls below the demand it is halved
down to a point. The same draws judge every pair: the answer keeps its limits in that share of them exactly.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.errors import DataError, UsageError
from .clipping import TOUCH, Array
from .points import Point

if TYPE_CHECKING:
    from .sampled import Sampling
    from .visible import VisibleRegion

ROUNDS = ((161, 41), (41, 9), (41, 9), (41, 9))  # rays, and pairs along each: fine first, for draws leave jagged edges
HALVINGS = 24  # of a step along a ray: one part in 10^8
NEXT = 1.5  # steps between rays kept on each side of the best


def demanded(region: "VisibleRegion", sampling: "Sampling", probability: float) -> Point:
    """The pair with the greatest MRR among those that keep every limit with this probability."""
    if not 0 < probability < 1:
        raise UsageError(f"probability = {probability:g}: it lies between 0 and 1, as 0.95.")
    low, high = region.box.low, region.box.high
    u0, u1 = float(low[1] - high[0]), float(high[1] - low[0])
    best: tuple[float, float] | None = None
    for rays, along in ROUNDS:
        u = np.linspace(u0, u1, rays)
        s = _farthest(region, sampling, u, along, probability)
        if np.isneginf(s).all():
            break
        i = int(np.argmax(s))
        if best is None or s[i] > best[0]:
            best = float(s[i]), float(u[i])
        half = NEXT * (u1 - u0) / (rays - 1)
        u0, u1 = max(best[1] - half, float(low[1] - high[0])), min(best[1] + half, float(high[1] - low[0]))
    if best is None:
        raise DataError(_too_much(region, sampling, probability))
    x = np.clip(_pairs(np.array(best[0]), np.array(best[1])), low, high)
    return replace(region.at(*np.exp(x).tolist()), probability=float(sampling.keeps(x[None])[0]))


def _farthest(region: "VisibleRegion", sampling: "Sampling", u: Array, along: int, probability: float) -> Array:
    """The farthest s of each ray that is allowed, shape of ``u``; minus infinity where none is."""
    low, high = region.box.low, region.box.high
    near = np.maximum(2 * low[0] + u, 2 * low[1] - u)
    far = np.maximum(np.minimum(2 * high[0] + u, 2 * high[1] - u), near)  # a rounding error at the ends
    S = near + np.linspace(0.0, 1.0, along)[:, None] * (far - near)
    allowed = _allowed(region, sampling, S, u, probability)
    last = along - 1 - np.argmax(allowed[::-1], axis=0)
    any_allowed, ray = allowed.any(axis=0), np.arange(len(u))
    inside, outside = S[last, ray], S[np.minimum(last + 1, along - 1), ray]
    for _ in range(HALVINGS):
        middle = (inside + outside) / 2
        kept = _allowed(region, sampling, middle, u, probability)
        inside, outside = np.where(kept, middle, inside), np.where(kept, outside, middle)
    return np.where(any_allowed, inside, -np.inf)


def _allowed(
    region: "VisibleRegion", sampling: "Sampling", s: Array, u: Array, probability: float
) -> "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]":
    """Whether pairs are allowed, in the shape of ``s``."""
    x = _pairs(s, np.broadcast_to(u, s.shape)).reshape(-1, 2)
    return np.asarray((_machine(region, x) & (sampling.keeps(x) >= probability)).reshape(s.shape))


def _pairs(s: Array, u: Array) -> Array:
    """(ln V, ln f) from s and u."""
    return np.stack([(s - u) / 2, (s + u) / 2], axis=-1)


def _machine(region: "VisibleRegion", x: Array) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
    """Which pairs the machine can be set to."""
    own = [each for each in region.limits if each.symbol not in region.planes]
    return np.asarray(np.logical_and.reduce([each.beyond(x) <= TOUCH for each in own]))


def _too_much(region: "VisibleRegion", sampling: "Sampling", probability: float) -> str:
    axes = [np.linspace(region.box.low[i], region.box.high[i], 72) for i in (0, 1)]
    x = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    x = x[_machine(region, x)]
    if not len(x):
        return region.conflict or "the machine's own limits leave no pair of V and f."
    keeps = sampling.keeps(x)
    V, f = np.exp(x[int(np.argmax(keeps))])
    return (
        f"no pair of V and f keeps the limits with probability {probability:g}: the most is {keeps.max():.3g}, at V "
        f"{V:.4g} m/min and f {f:.4g} mm/rev; demand less, or raise a limit."
    )
