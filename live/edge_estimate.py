"""Wear and remaining life of one cutting edge from its time of contact and its loads, by a Kalman filter.

The state is constant but for the wanders: deviations of the parameters of all laws from their means, this edge's own
level and time exponent, and its own level in each load. With the deviations written d,

    ln wear   = m ln S + (d ln wear / d theta) d_theta + u + delta (ln t_e - ln t_0) + wander
    ln load_j = its law at these means + k_j (deviation of ln wear) + columns d_theta_j + u_j + wander_j

linear at fixed means, so that the filter equals one regression on all windows and its intervals stay honest where load
cannot separate the level of wear from its own. t_e is the time at the present conditions that gives the same wear, t_0
the middle of the tested times, about which the level of an edge is defined.

Source: Anderson & Moore 1979, Optimal Filtering, ch. 3 and 5; weights of outliers: Lange, Little & Taylor 1989, J. Am.
Stat. Assoc. 84, 881.
"""

from collections.abc import Mapping
from math import exp, inf, log
from typing import Any

import numpy as np

from ..core.arrays import Array, is_positive
from ..core.errors import UsageError
from .edge_state import EdgeState, Innovation, Interval, LawDeviation, LoadTrust
from .exposure import Exposure
from .live_laws import TIME, LiveLaws
from .samples import Window

BEFORE_TESTS = 0.5  # of the shortest tested time: earlier loads say nothing, as wear in the run-in follows no law
NOISE_DF = 4.0  # of the Student t that weights outlying windows
LEAST_SE = 0.002  # of ln load: a smaller one is not believed
REOPENED = 0.4  # sd of ln wear after chipping
BACK = 1.5  # min of contact; loads of up to twice this time are taken back after chipping
FAR_GAUGE = 6.0  # standard deviations
SCHEMA = "fitmodels.live-edge/1"
GRID = np.concatenate([[0.0], np.geomspace(1e-4, 1e6, 500)])  # min, of the remaining life


class EdgeEstimate:
    """Estimate of wear and remaining life of one edge; see the module for its model.

    Parameters
    ----------
    laws : LiveLaws
    criterion : float, optional
        Wear at the end of life in the unit of the wear law; that of the file by default.

    Raises
    ------
    UsageError
        No criterion, or one that is not above zero.

    Examples
    --------
    >>> from fitmodels import datasets, fit, parameters
    >>> from fitmodels.live.live_laws import LiveLaws
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> found = [fit.power_law(runs, "AW", ["V", "f", "d", "t"]), fit.power_law(runs, "P", ["V", "f", "d", "t", "AW"])]
    >>> edge = EdgeEstimate(LiveLaws.of(parameters.collect(laws=found)), criterion=0.3)
    >>> edge.advance(10.0, {"V": 150.0, "f": 0.2, "d": 2.0})
    >>> before = edge.wear()
    >>> edge.gauge(1.1 * before.median, sd_ln=0.03)
    >>> after = edge.wear()
    >>> after.high / after.low < before.high / before.low
    True
    """

    def __init__(self, laws: LiveLaws, criterion: float | None = None) -> None:
        self.laws = laws
        found = laws.criterion if criterion is None else criterion
        if found is None or not is_positive(found):
            raise UsageError(f"wear criterion {found}: give one above zero in {laws.wear.unit}, such as 0.3.")
        self.criterion = float(found)
        self.minutes = 0.0
        self.gauged = 0
        self.windows = 0
        self.reopened = 0
        self.innovations: dict[str, Innovation] = {}
        self._exposure = Exposure(np.zeros((0, len(laws.wear.theta))))
        self._last: dict[str, float] = {}
        self._assumed: dict[str, str] = {}
        self._state = EdgeState(laws)
        self._prior = self._state.P
        self._trust = LoadTrust()
        self._before = [(0.0, self._state.copy())] * 2  # minutes and state, BACK minutes ago and earlier

    def advance(self, minutes: float, conditions: Mapping[str, float]) -> None:
        """Add cutting without a usable load.

        Parameters
        ----------
        minutes : float
            Of contact.
        conditions : mapping of float
            V in m/min, f in mm/rev, d in mm, others in the units of the laws. One that is missing keeps its last value,
            and that is noted.

        Raises
        ------
        UsageError
            The time is negative or not finite, or a condition is missing that was never known.
        """
        if not (minutes >= 0 and np.isfinite(minutes)):
            raise UsageError(f"{minutes:g} min of contact: give a finite time of 0 or more.")
        given = self.complete(conditions)
        self._last = given
        if minutes == 0:
            return
        self._exposure.add(self.laws.wear.columns({**given, TIME: 1.0}), minutes)
        self._state.advance(minutes)
        self.minutes += minutes
        if self.minutes - self._before[1][0] >= BACK:
            self._before = [self._before[1], (self.minutes, self._state.copy())]

    def complete(self, conditions: Mapping[str, float]) -> dict[str, float]:
        """The conditions that the laws need; those that are missing have their last values."""
        given = {
            name: float(conditions[name]) for name in self.laws.conditions if is_positive(conditions.get(name, 0.0))
        }
        for name in self.laws.missing(conditions):
            if name not in self._last:
                raise UsageError(
                    f"{name} is not known, and the law of {self.laws.wear.symbol} or of a load needs it: give it by "
                    f"the source, or as a constant ({name}=...)."
                )
            given[name] = self._last[name]
            if conditions:
                self._assumed[name] = f"assumed: {name} was not read for a time and was taken as its last value."
        return given

    def add(self, window: Window) -> None:
        """Take in a window: its time of contact, and its loads.

        Loads without a law, and those that are not finite, are left out. A load in the run-in, before half of the
        shortest tested time, is not used: there the wear follows no law.
        """
        self.advance(window.contact, window.conditions)
        self.windows += 1
        self.innovations = {}
        if self.minutes < BEFORE_TESTS * self.laws.tested[0]:
            self._assumed["run-in"] = (
                f"Loads of the first {BEFORE_TESTS * self.laws.tested[0]:g} min were not used: no test was that short."
            )
            return
        rows = self._state.wear_rows(self._exposure, np.zeros(1), self._last)
        for name in self.laws.loads:
            mean = window.loads.get(name)
            if mean is None or not (np.isfinite(mean.ln) and np.isfinite(mean.se)):
                continue
            expected, H = self._state.load_row(name, self._exposure, self._last, rows)
            variance = max(mean.se, LEAST_SE) ** 2
            seen = self._state.innovation(H, mean.ln - expected, variance)
            self.innovations[name] = seen
            sd = max((float(H @ self._prior @ H) + variance) ** 0.5, seen.sd)  # of a new edge
            if self._trust.believes(name, mean.ln - expected, sd):
                self._state.update(H, mean.ln - expected, variance, NOISE_DF)
                self._state.adapt(name, seen)

    def gauge(self, wear: float, sd_ln: float, *, certain: bool = False) -> None:
        """Take in one gauge reading of the wear of this edge.

        Parameters
        ----------
        wear : float
            In the unit of the wear law.
        sd_ln : float
            Standard deviation of the reading's logarithm.
        certain : bool
            Take it in however far it is from the estimate: the level of wear, which an earlier reading may have set
            wrongly, is opened before.

        Raises
        ------
        UsageError
            The reading is not above zero, the edge has not cut, or the reading is so far from the estimate that a wrong
            unit or edge is likely.
        """
        unit, symbol = self.laws.wear.unit, self.laws.wear.symbol
        if not (is_positive(wear) and is_positive(sd_ln)):
            raise UsageError(
                f"gauge reading {symbol} {wear:g} {unit} with sd {sd_ln:g} of its ln: give numbers above zero."
            )
        if self.minutes == 0:
            raise UsageError(
                "the edge has not cut yet; for a used one give the minutes that it cut before (--used 8min)."
            )
        if certain:
            self._state.open_level(REOPENED)
        ln_wear, H = self._now()
        value = log(wear) - ln_wear - float(H @ self._state.x)
        sd = (float(H @ self._state.P @ H) + sd_ln**2) ** 0.5
        if abs(value) > FAR_GAUGE * sd and not certain:
            raise UsageError(
                f"gauge reading {symbol} {wear:g} {unit} is {exp(value):.3g} times the estimate, {abs(value) / sd:.2g} "
                f"standard deviations from it (limit {FAR_GAUGE:g}): check unit and edge. After a change of the edge "
                "give --new-edge; if this reading is right and an earlier one was not, --certain."
            )
        self._state.update(H, log(wear) - ln_wear, sd_ln**2)
        self._before = [(self.minutes, self._state.copy())] * 2
        self.gauged += 1

    def reopen(self) -> None:
        """Open the level of wear again after chipping: from then on it is known by what follows.

        The loads of the last minutes, in which chipping was not yet seen, are taken back: they had been explained by
        levels and wander of the loads.
        """
        then, state = self._before[0]
        self._state = state.copy()
        self._state.advance(self.minutes - then)
        self._state.open_level(REOPENED)
        self._before = [(self.minutes, self._state.copy())] * 2
        self.reopened += 1

    def _now(self) -> tuple[float, Array]:
        """Ln wear at the mean parameters, and its derivatives, now."""
        ln_wear, H = self._state.wear_rows(self._exposure, np.zeros(1), self._last or self.typical())
        return float(ln_wear[0]), H[0]

    def typical(self) -> dict[str, float]:
        """Middle of the tested conditions."""
        return {name: (low * high) ** 0.5 for name, (low, high) in self.laws.wear.ranges.items()}

    def _quantile(self, level: float) -> float:
        """Quantile of Student's t with the degrees of freedom of the scatter between edges."""
        from scipy.special import stdtrit

        if not 0 < level < 1:
            raise UsageError(f"level {level:g}: give a probability between 0 and 1, such as 0.9.")
        return float(stdtrit(self.laws.df, (1 + level) / 2))

    def _interval(self, mean: float, variance: float, unit: str, level: float) -> Interval:
        half = self._quantile(level) * max(variance, 0.0) ** 0.5
        return Interval(exp(mean), exp(mean - half), exp(mean + half), unit, level)

    def wear(
        self, level: float = 0.90, minutes: float = 0.0, conditions: Mapping[str, float] | None = None
    ) -> Interval:
        """Wear now or after further minutes of contact, in the unit of the law."""
        ln_wear, variance, _ = self._ahead(np.array([minutes]), conditions)
        return self._interval(float(ln_wear[0]), float(variance[0]), self.laws.wear.unit, level)

    def probability_past(self, minutes: float = 0.0, conditions: Mapping[str, float] | None = None) -> float:
        """Probability that the wear is past the criterion, now or after a further cut of so many minutes."""
        return float(self._past(np.array([minutes]), conditions)[0])

    def _ahead(self, minutes: Array, conditions: Mapping[str, float] | None) -> tuple[Array, Array, Array]:
        """Mean and variance of ln wear, (R,), and its derivatives, (R, n), after further minutes (R,) of contact."""
        if not (np.isfinite(minutes) & (minutes >= 0)).all():
            raise UsageError("further minutes of contact must be finite and 0 or more.")
        given = self.complete(conditions or {}) if conditions or self._last else self.typical()
        ln_wear, H = self._state.wear_rows(self._exposure, minutes, given)
        wander = self.laws.scatter.wear_wander
        kept = np.exp(-minutes / wander.minutes)
        H[:, self._state.w] = kept
        variance = ((H @ self._state.P) * H).sum(axis=1) + (1 - kept**2) * wander.sd**2
        return ln_wear + H @ self._state.x, variance, H

    def _past(self, minutes: Array, conditions: Mapping[str, float] | None) -> Array:
        """Probability to be past the criterion after further minutes (R,)."""
        from scipy.special import stdtr

        mean, variance, H = self._ahead(minutes, conditions)
        growth = self.laws.wear.theta[self._state.time] * np.exp(-H[:, self._state.time])
        highest = mean + self.laws.scatter.wear_wander.highest(growth)
        z = (highest - log(self.criterion)) / np.sqrt(np.maximum(variance, 1e-12))
        return np.asarray(stdtr(self.laws.df, z))

    def life(
        self, conditions: Mapping[str, float] | None = None, level: float = 0.90, minutes: float = 0.0
    ) -> Interval:
        """Remaining minutes of contact until the criterion, at the given conditions or the last ones.

        They count from now, or from further minutes of contact on. The probability of a shorter life is that of being
        past the criterion after so many minutes.
        """
        self._quantile(level)
        past = np.maximum.accumulate(self._past(minutes + GRID, conditions))
        ends = (0.5, (1 - level) / 2, (1 + level) / 2)
        median, low, high = (0.0 if past[0] >= p else inf if past[-1] < p else _crossing(past, p) for p in ends)
        return Interval(median, low, high, "min", level)

    def expected_load(self, symbol: str, conditions: Mapping[str, float], level: float = 0.90) -> Interval:
        """Mean load of a window that would be read now."""
        mean, sd = self.expected_ln(symbol, conditions)
        return self._interval(mean, sd * sd, self.laws.loads[symbol].unit, level)

    def expected_ln(self, symbol: str, conditions: Mapping[str, float]) -> tuple[float, float]:
        """Mean and standard deviation of the ln load of a window that would be read now, without its own noise."""
        if symbol not in self.laws.loads:
            raise UsageError(f"no law of the load {symbol}; there are {', '.join(self.laws.loads) or 'none'}.")
        expected, H = self._state.load_row(symbol, self._exposure, self.complete(conditions))
        return expected + float(H @ self._state.x), float(H @ self._state.P @ H) ** 0.5

    def law_deviation(self, symbol: str) -> LawDeviation:
        """Deviation of the ln of a load of this edge from its law."""
        return self._state.law_deviation(symbol, self._exposure, self._last or self.typical())

    def level_correlations(self) -> dict[str, float]:
        """Correlation of ln wear with the own level of this edge in each load, after what was seen.

        Near -1 the load shows how the wear changes, not how great it is.
        """
        _, H = self._now()
        PH = self._state.P @ H
        variance = float(H @ PH)
        return {
            name: float(PH[u] / (variance * self._state.P[u, u]) ** 0.5) if variance > 0 else 0.0
            for name, (_, u, _, _) in self._state.of_load.items()
        }

    @property
    def distrusted(self) -> Mapping[str, str]:
        """Loads that are not used for this edge any more, with the reason."""
        return self._trust.distrusted

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on this edge: assumptions, extrapolations, and properties that loads cannot show."""
        found = [*self.distrusted.values(), *self._assumed.values(), *self.laws.beyond(self._last, self.minutes)]
        if self.criterion > self.laws.largest_wear * (1 + 1e-6):
            most = f"{self.laws.largest_wear:.3g} {self.laws.wear.unit}"
            found.append(f"EXTRAPOLATED: the criterion {self.criterion:g} is beyond the largest wear tested ({most}).")
        strong = [f"{name} {r:.2f}" for name, r in self.level_correlations().items() if r < -0.7]
        if strong and not self.gauged and self.windows:
            found.append(
                f"Load shows change, not level: gauge {self.laws.wear.symbol} once (correlation of the levels of wear "
                f"and load {', '.join(strong)})."
            )
        if self.reopened:
            found.append("After chipping the level of wear was opened again: gauge the edge.")
        return tuple(found)

    def as_json(self) -> dict[str, Any]:
        """Exact snapshot of the estimate; the laws are not in it."""
        return {
            "schema": SCHEMA,
            "laws": self.laws.fingerprint,
            "criterion": self.criterion,
            "minutes": self.minutes,
            "gauged": self.gauged,
            "windows": self.windows,
            "reopened": self.reopened,
            "last": dict(self._last),
            "assumed": dict(self._assumed),
            "trust": self._trust.as_json(),
            "exposure": self._exposure.as_json(),
            "before": [{"minutes": then, **state.as_json()} for then, state in self._before],
            **self._state.as_json(),
        }

    @classmethod
    def from_json(cls, laws: LiveLaws, data: Mapping[str, Any]) -> "EdgeEstimate":
        """The estimate of a snapshot, which was made with the same laws.

        Raises
        ------
        UsageError
            The snapshot has another schema, or is of other laws.
        """
        if data.get("schema") != SCHEMA:
            raise UsageError(f"snapshot of schema {data.get('schema')!r}: it must be {SCHEMA}; start a new journal.")
        if data.get("laws") != laws.fingerprint:
            raise UsageError(
                f"snapshot of the laws {data.get('laws')}, these are {laws.fingerprint}: of another parameter file or "
                f"version, after {data.get('minutes')!s:.5} min; start a new journal with --used, and gauge the edge."
            )
        try:
            return cls._restored(laws, data)
        except (KeyError, TypeError, ValueError) as error:
            raise UsageError(f"snapshot that cannot be read ({error!r}): start a new journal.") from None

    @classmethod
    def _restored(cls, laws: LiveLaws, data: Mapping[str, Any]) -> "EdgeEstimate":
        found = cls(laws, float(data["criterion"]))
        exposure, before = data["exposure"], data["before"]
        minutes = np.array(exposure["minutes"], dtype=float)
        settings = np.array(exposure["settings"], dtype=float).reshape(len(minutes), len(laws.wear.theta))
        if not (np.isfinite(settings).all() and np.isfinite(minutes).all()):
            raise ValueError("values that are not finite")
        found._state.restore(data)
        states = [found._state.copy() for _ in before]
        for state, one in zip(states, before, strict=True):
            state.restore(one)
        found._before = [(float(one["minutes"]), state) for one, state in zip(before, states, strict=True)]
        found._exposure = Exposure(settings, minutes)
        found.minutes, found._last = float(data["minutes"]), {k: float(v) for k, v in data["last"].items()}
        found.gauged, found.windows, found.reopened = (int(data[key]) for key in ("gauged", "windows", "reopened"))
        found._assumed, trust = dict(data["assumed"]), data["trust"]
        found._trust = LoadTrust({k: int(n) for k, n in trust["far"].items()}, dict(trust["distrusted"]))
        return found


def _crossing(past: Array, p: float) -> float:
    """Minutes at which a probability that rises over the grid reaches p."""
    i = int(np.searchsorted(past, p))
    share = (p - past[i - 1]) / (past[i] - past[i - 1])
    return float(GRID[i - 1] + share * (GRID[i] - GRID[i - 1]))
