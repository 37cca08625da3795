"""State of one edge as a Gaussian distribution: parts, prior, change in time, and update by a reading."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import exp, inf, log
from typing import Any

import numpy as np

from ..core.arrays import Array
from .edge_scatter import FAST
from .exposure import SOONEST, Exposure
from .live_laws import TIME, LiveLaws

FAR_LOW, FAR_HIGH = -4.0, 6.0  # sd of edges, between which a load is believed; one that is too low is unsafe
FAR_WINDOWS = 6  # in turn, after which it is not believed again
MEDIAN = 0.6745  # of the absolute value of a standard normal
ADAPTED = 0.025  # change of the ln of the fast wander with a window
MOST_WANDER = 0.5


@dataclass(frozen=True, slots=True)
class Interval:
    """Median and equal-tailed interval of a quantity, in its unit, at a level between 0 and 1."""

    median: float
    low: float
    high: float
    unit: str
    level: float


@dataclass(frozen=True, slots=True)
class Innovation:
    """Deviation of a ln load from what was expected before it was seen, and the standard deviation of that."""

    value: float
    sd: float


@dataclass(frozen=True, slots=True)
class LawDeviation:
    """Deviation of the ln of a load of one edge from its law, with what is usual for a new edge.

    Attributes
    ----------
    value : float
        As far as it is known, without wander.
    sd_edge, sd_law : float
        Standard deviations between edges, and of the law, which is alike in all edges.
    slope : float
        Derivative of the ln load by the ln wear.
    """

    value: float
    sd_edge: float
    sd_law: float
    slope: float

    @property
    def sd(self) -> float:
        """Standard deviation of the value of a new edge."""
        return float((self.sd_edge**2 + self.sd_law**2) ** 0.5)


@dataclass(slots=True)
class LoadTrust:
    """Trust in the loads of an edge: those that its laws do not describe carry no information on the wear.

    Attributes
    ----------
    far : dict of int
        Windows in turn that were far from the law, by symbol.
    distrusted : dict of str
        Reason, by symbol, why a load is not used for this edge any more.

    Examples
    --------
    >>> trust = LoadTrust()
    >>> [trust.believes("P", difference, 0.1) for difference in (0.2, -0.7)]
    [True, False]
    """

    far: dict[str, int] = field(default_factory=dict)
    distrusted: dict[str, str] = field(default_factory=dict)

    def believes(self, name: str, difference: float, sd: float) -> bool:
        """Whether a window is used: its ln load differs from the law by a difference that edges with this sd show."""
        z = difference / sd
        self.far[name] = 0 if FAR_LOW < z < FAR_HIGH else self.far.get(name, 0) + 1
        if self.far[name] == FAR_WINDOWS and name not in self.distrusted:
            times = (
                f"{exp(min(difference, 700.0)):.3g} times what its law gives, {abs(z):.2g} standard deviations of edges"
            )
            self.distrusted[name] = (
                f"{name} is {times}: it is not used for the wear of this edge; check its unit and scale, tool and work."
            )
        return self.far[name] == 0 and name not in self.distrusted

    def as_json(self) -> dict[str, Any]:
        """Exact copy."""
        return {"far": dict(self.far), "distrusted": dict(self.distrusted)}


class EdgeState:
    """Deviations of one edge from the mean laws: mean ``x``, shape (n,), and covariance ``P``, shape (n, n).

    Parts of the state are, of wear: deviations of the parameters, of the time exponent (``delta``), the level ``u`` and
    the wander ``w``; of each load: deviations of the parameters, the level, the slow and the fast wander (``of_load``).
    ``fast`` holds the standard deviation of the fast wander of each load, as far as its windows have shown it.
    """

    def __init__(self, laws: LiveLaws) -> None:
        self.laws = laws
        at = len(laws.wear.theta)
        self.of_wear = slice(0, at)
        self.delta, self.u, self.w = at, at + 1, at + 2
        at += 3
        self.of_load: dict[str, tuple[slice, int, int, int]] = {}
        for name, law in laws.loads.items():
            p = len(law.theta)
            self.of_load[name] = slice(at, at + p), at + p, at + p + 1, at + p + 2
            at += p + 3
        self.time = 1 + laws.wear.formula.factors.index(TIME)
        low, high = laws.tested
        self.middle = (log(low) + log(high)) / 2 if low > 0 else log(high / 2)
        self.fast = {name: wander.sd for name, wander in laws.scatter.load_rest.items()}
        self.x, self.P = np.zeros(at), self._prior(at)

    def as_json(self) -> dict[str, Any]:
        """Exact copy as lists."""
        return {"fast": dict(self.fast), "mean": self.x.tolist(), "covariance": self.P.tolist()}

    def restore(self, data: Mapping[str, Any]) -> None:
        """Take the values of a copy; KeyError, TypeError or ValueError where it is none of this state."""
        x, P = np.array(data["mean"], dtype=float), np.array(data["covariance"], dtype=float)
        if x.shape != self.x.shape or P.shape != self.P.shape:
            raise ValueError(f"{len(x)} states, and {len(self.x)} are needed")
        if not (np.isfinite(x).all() and np.isfinite(P).all()):
            raise ValueError("values that are not finite")
        self.x, self.P, self.fast = x, P, {name: float(data["fast"][name]) for name in self.laws.loads}

    def copy(self) -> "EdgeState":
        """The state as it is now; updates make new arrays."""
        other = object.__new__(EdgeState)
        other.__dict__.update(self.__dict__, fast=dict(self.fast))
        return other

    def open_level(self, sd: float) -> None:
        """Open the level of wear."""
        self.P = self.P.copy()
        self.P[self.u, self.u] += sd * sd

    def _prior(self, size: int) -> Array:
        laws, known = self.laws, self.laws.scatter
        P = np.zeros((size, size))
        P[self.of_wear, self.of_wear] = laws.wear.covariance
        P[self.delta, self.delta] = known.exponent_sd**2
        P[self.w, self.w] = known.wear_wander.sd**2
        for name, law in laws.loads.items():
            theta, _, slow, fast = self.of_load[name]
            P[theta, theta] = law.covariance
            P[slow, slow], P[fast, fast] = known.load_wander[name].sd ** 2, self.fast[name] ** 2
        levels = [self.u, *(of[1] for of in self.of_load.values())]
        sd = np.array([laws.wear.sd_level, *(law.sd_level for law in laws.loads.values())])
        shown = np.array([True, *(law.shows_wear for law in laws.loads.values())])
        together = np.outer(shown, shown) | np.eye(len(shown), dtype=bool)
        P[np.ix_(levels, levels)] = np.where(together, known.correlation, 0.0) * np.outer(sd, sd)
        return P

    def advance(self, minutes: float) -> None:
        """Let the wanders go on for minutes of contact."""
        known, kept, added = self.laws.scatter, np.ones(len(self.x)), np.zeros(len(self.x))
        wanders = [(self.w, known.wear_wander, known.wear_wander.sd)]
        for name, (_, _, slow, fast) in self.of_load.items():
            wanders.append((slow, known.load_wander[name], known.load_wander[name].sd))
            wanders.append((fast, known.load_rest[name], self.fast[name]))
        for place, wander, sd in wanders:
            kept[place] = wander.kept(minutes)
            added[place] = (1 - kept[place] ** 2) * sd * sd
        self.x = self.x * kept
        self.P = self.P * kept * kept[:, None] + np.diag(added)

    def adapt(self, name: str, seen: Innovation) -> None:
        """Follow the size of the deviations of a load: half of them are below .67 sd, whatever the outliers."""
        step = ADAPTED if abs(seen.value) > MEDIAN * seen.sd else -ADAPTED
        self.fast[name] = float(np.clip(self.fast[name] * exp(step), FAST.sd, MOST_WANDER))

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

    def load_row(
        self,
        name: str,
        exposure: Exposure,
        given: Mapping[str, float],
        wear_rows: tuple[Array, Array] | None = None,
    ) -> tuple[float, Array]:
        """Value of the ln load at the mean laws, and its derivatives by the state, (n,); ``wear_rows`` where known."""
        law, wear = self.laws.loads[name], self.laws.wear
        ln_wear, rows = wear_rows or self.wear_rows(exposure, np.zeros(1), given)
        at = {**given, TIME: max(float(exposure.minutes.sum()), SOONEST), wear.symbol: exp(ln_wear[0])}
        columns = law.columns(at)
        theta, u, slow, fast = self.of_load[name]
        H = (law.slope(wear.symbol, at) if law.shows_wear else 0.0) * rows[0]
        H[theta] = columns
        H[u] = H[slow] = H[fast] = 1.0
        return float(columns @ law.theta), H

    def law_deviation(self, name: str, exposure: Exposure, given: Mapping[str, float]) -> LawDeviation:
        """Deviation of the ln load of this edge from its law."""
        _, H = self.load_row(name, exposure, given)
        _, u, slow, fast = self.of_load[name]
        H[[self.w, slow, fast]] = 0.0
        own = np.zeros(len(H))
        own[[self.delta, self.u, u]] = H[[self.delta, self.u, u]]
        prior = self._prior(len(H))
        edge = float(own @ prior @ own)
        law = max(float(H @ prior @ H) - edge, 0.0)
        return LawDeviation(float(H @ self.x), edge**0.5, law**0.5, float(H[self.u]))

    def innovation(self, H: Array, difference: float, variance: float) -> Innovation:
        """Deviation of a reading from what the state expects; ``difference`` is from its value at the mean laws."""
        return Innovation(difference - float(H @ self.x), (float(H @ self.P @ H) + variance) ** 0.5)

    def update(self, H: Array, difference: float, variance: float, df: float = inf) -> None:
        """Take in one reading, in Joseph's form, which keeps the covariance positive.

        ``difference`` is the reading less its value at the mean laws. With finite ``df`` a reading that is far off
        counts less, as under Student t noise.
        """
        PH = self.P @ H
        prior = float(H @ PH)
        value = difference - float(H @ self.x)
        if df < inf:
            variance *= max(1.0, (df + value * value / (prior + variance)) / (df + 1.0))
        gain = PH / (prior + variance)
        A = np.eye(len(H)) - np.outer(gain, H)
        self.x = self.x + gain * value
        P = A @ self.P @ A.T + variance * np.outer(gain, gain)
        self.P = (P + P.T) / 2
