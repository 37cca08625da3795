"""Time of contact of one edge by setting, and the wear that a wear law gives for it."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..core.arrays import Array

MOST_SETTINGS = 64  # kept apart; beyond, the nearest are joined
SAME_SETTING = 0.005  # distance in the logarithms of the conditions
SOONEST = 1e-3  # min of contact, below which a new edge is not described


@dataclass(slots=True)
class Exposure:
    """Minutes of contact of one edge at each of its settings, in constant memory.

    Attributes
    ----------
    settings : ndarray, shape (n, p)
        Columns of the wear law at each setting and t = 1.
    minutes : ndarray, shape (n,)

    Examples
    --------
    >>> edge = Exposure(np.zeros((0, 2)))
    >>> edge.add(np.array([1.0, 0.0]), 2.0), edge.add(np.array([1.0, 0.001]), 1.0)
    (None, None)
    >>> edge.minutes.tolist()
    [3.0]
    """

    settings: Array
    minutes: Array = field(default_factory=lambda: np.zeros(0))

    def add(self, z: Array, minutes: float) -> None:
        """Add minutes at a setting, joined with the nearest one where it is the same or too many are kept."""
        if len(self.minutes):
            distance = np.abs(self.settings - z).max(axis=1)
            i = int(np.argmin(distance))
            if distance[i] <= SAME_SETTING or len(self.minutes) >= MOST_SETTINGS:
                total = self.minutes[i] + minutes
                self.settings[i] += (z - self.settings[i]) * (minutes / total)
                self.minutes[i] = total
                return
        self.settings = np.vstack([self.settings, z])
        self.minutes = np.append(self.minutes, minutes)

    def ln_wear(self, theta: Array, time: int, more: Array, z: Array) -> tuple[Array, Array, Array]:
        """Logarithm of the wear after further minutes (R,) at the setting z, and what its derivatives consist of.

        Parameters
        ----------
        theta : ndarray, shape (p,)
            Parameters of the wear law, its time exponent m at the position ``time``.
        more : ndarray, shape (R,)
        z : ndarray, shape (p,)

        Returns
        -------
        ln_wear : ndarray, shape (R,)
            ``m ln S``.
        mean : ndarray, shape (R, p)
            Mean of the settings with the weights of their parts of S: the derivatives by all parameters but m.
        ln_time : ndarray, shape (R,)
            ln of the minutes at the mean setting that give the same wear: the derivative by m.
        """
        m = theta[time]
        settings = np.vstack([self.settings, z])
        first = max(SOONEST - float(self.minutes.sum()), 0.0)  # a new edge has cut for a moment
        with np.errstate(divide="ignore"):
            before = np.broadcast_to(np.log(self.minutes), (len(more), len(self.minutes)))
            parts = np.concatenate([before, np.log(more + first)[:, None]], axis=1)
        parts = parts + settings @ theta / m  # the column of ln t is 0, as t = 1
        top = parts.max(axis=1)
        share = np.exp(parts - top[:, None])
        total = share.sum(axis=1)
        mean = (share / total[:, None]) @ settings
        ln_S = top + np.log(total)
        return m * ln_S, mean, ln_S - mean @ theta / m

    def as_json(self) -> dict[str, Any]:
        """Exact copy as lists."""
        return {"settings": self.settings.tolist(), "minutes": self.minutes.tolist()}
