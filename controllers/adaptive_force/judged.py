"""How a run came out: settling, overshoot and steady error of the force averaged over a revolution."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..loop import Trace

Array = NDArray[np.float64]
BAND = 0.02  # of the set point: the project's limit in steady state
STEADY = 0.25  # the last share of a stretch


@dataclass(frozen=True, slots=True)
class Held:
    """A stretch of a run at one set point.

    Attributes
    ----------
    settling : float or None
        s until the averaged force stays within 2 % of the set point; None where it does not.
    overshoot, undershoot : float
        Largest excursion above and below the set point, as shares of it; of the averaged force.
    steady : float
        Largest error of the last quarter of the stretch, as a share.
    iae : float
        Mean of the absolute error, as a share.
    """

    settling: float | None
    overshoot: float
    undershoot: float
    steady: float
    iae: float


def averaged(values: Array, samples: int) -> Array:
    """Mean of the last ``samples`` intervals of a row (n,), of fewer at its beginning.

    >>> averaged(np.array([0.0, 2.0, 4.0, 6.0]), 2).tolist()
    [0.0, 1.0, 2.0, 4.0]
    """
    total = np.r_[0.0, np.cumsum((values[1:] + values[:-1]) / 2)]
    start = np.maximum(np.arange(len(values)) - samples, 0)
    count = np.arange(len(values)) - start
    return np.where(count > 0, (total - total[start]) / np.maximum(count, 1), values)


def held(trace: "Trace", set_point: float, revolution: float, start: float = 0.0, end: float = np.inf) -> Held:
    """Judge a stretch of a replay that recorded ``force``, the plant's own without ripple.

    Parameters
    ----------
    set_point : float
    revolution : float
        s that the force is averaged over.
    start, end : float
        s.
    """
    dt = float(trace.time[1] - trace.time[0])
    inside = (trace.time >= start - dt / 2) & (trace.time < end - dt / 2)
    share = averaged(trace.recorded["force"], round(revolution / dt))[inside] / set_point - 1
    out = np.flatnonzero(np.abs(share) > BAND)
    last = int(out[-1]) + 1 if len(out) else 0
    return Held(
        settling=last * dt if last < len(share) else None,
        overshoot=max(float(share.max()), 0.0),
        undershoot=max(-float(share.min()), 0.0),
        steady=float(np.abs(share[-round(STEADY * len(share)) :]).max()),
        iae=float(np.abs(share).mean()),
    )
