"""State of one edge as a Gaussian distribution: parts, prior, change in time, and update by a reading."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, inf, log

import numpy as np

from ..core.arrays import Array
from .exposure import SOONEST, Exposure
from .live_laws import TIME, LiveLaws


@dataclass(frozen=True, slots=True)
class Innovation:
    """Deviation of a ln load from what was expected before it was seen, and the standard deviation of that."""

    value: float
    sd: float


class EdgeState:
    """Deviations of one edge from the mean laws: mean ``x``, shape (n,), and covariance ``P``, shape (n, n).

    Its parts are, of wear: deviations of the parameters, of the time exponent (``delta``), the level ``u`` and the
    wander ``w``; of each load: deviations of the parameters, the level and the wander (``of_load``).
    """

    def __init__(self, laws: LiveLaws) -> None:
        self.laws = laws
        at = len(laws.wear.theta)
        self.of_wear = slice(0, at)
        self.delta, self.u, self.w = at, at + 1, at + 2
        at += 3
        self.of_load: dict[str, tuple[slice, int, int]] = {}
        for name, law in laws.loads.items():
            p = len(law.theta)
            self.of_load[name] = slice(at, at + p), at + p, at + p + 1
            at += p + 2
        self.time = 1 + laws.wear.formula.factors.index(TIME)
        low, high = laws.tested
        self.middle = (log(low) + log(high)) / 2 if low > 0 else log(high / 2)
        self.x, self.P = np.zeros(at), self._prior(at)

    def _prior(self, size: int) -> Array:
        laws, known = self.laws, self.laws.assumptions
        P = np.zeros((size, size))
        P[self.of_wear, self.of_wear] = laws.wear.covariance
        P[self.delta, self.delta] = (known.exponent_share * laws.wear.theta[self.time]) ** 2
        P[self.u, self.u] = laws.wear.sd_level**2
        P[self.w, self.w] = known.wear_wander.sd**2
        for name, law in laws.loads.items():
            theta, u, o = self.of_load[name]
            P[theta, theta], P[u, u], P[o, o] = law.covariance, law.sd_level**2, known.load_wander.sd**2
            P[u, self.u] = P[self.u, u] = known.level_correlation * law.sd_level * laws.wear.sd_level
        return P

    def advance(self, minutes: float) -> None:
        """Let the wanders go on for minutes of contact."""
        known = self.laws.assumptions
        self._spread(self.w, known.wear_wander.kept(minutes), known.wear_wander.sd)
        for _, _, place in self.of_load.values():
            self._spread(place, known.load_wander.kept(minutes), known.load_wander.sd)

    def _spread(self, place: int, kept: float, sd: float) -> None:
        self.x[place] *= kept
        self.P[place, :] *= kept
        self.P[:, place] *= kept
        self.P[place, place] += (1 - kept * kept) * sd * sd

    def wear_rows(self, exposure: Exposure, more: Array, given: Mapping[str, float]) -> tuple[Array, Array]:
        """Values of ln wear at the mean laws, (R,), and derivatives by the state, (R, n), after minutes (R,)."""
        wear = self.laws.wear
        z = wear.columns({**given, TIME: 1.0})
        ln_wear, mean, ln_time = exposure.ln_wear(wear.theta, self.time, more, z)
        H = np.zeros((len(more), len(self.x)))
        H[:, self.of_wear] = mean
        H[:, self.time] = ln_time
        H[:, self.delta] = ln_time - self.middle
        H[:, self.u] = H[:, self.w] = 1.0
        return ln_wear, H

    def load_row(self, name: str, exposure: Exposure, given: Mapping[str, float]) -> tuple[float, Array]:
        """Value of the ln load at the mean laws, and its derivatives by the state, (n,)."""
        law, wear = self.laws.loads[name], self.laws.wear
        ln_wear, rows = self.wear_rows(exposure, np.zeros(1), given)
        at = {**given, TIME: max(float(exposure.minutes.sum()), SOONEST), wear.symbol: exp(ln_wear[0])}
        columns = law.columns(at)
        theta, u, o = self.of_load[name]
        H = law.slope(wear.symbol, at) * rows[0]
        H[theta] = columns
        H[u] = H[o] = 1.0
        return float(columns @ law.theta), H

    def update(self, H: Array, difference: float, variance: float, df: float = inf) -> Innovation:
        """Take in one reading, in Joseph's form, which keeps the covariance positive.

        ``difference`` is the reading less its value at the mean laws. With finite ``df`` a reading that is far off
        counts less, as under Student t noise.
        """
        PH = self.P @ H
        prior = float(H @ PH)
        value = difference - float(H @ self.x)
        found = Innovation(value, (prior + variance) ** 0.5)
        if df < inf:
            variance *= max(1.0, (df + value * value / (prior + variance)) / (df + 1.0))
        gain = PH / (prior + variance)
        A = np.eye(len(H)) - np.outer(gain, H)
        self.x = self.x + gain * value
        P = A @ self.P @ A.T + variance * np.outer(gain, gain)
        self.P = (P + P.T) / 2
        return found
