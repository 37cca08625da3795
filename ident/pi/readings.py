"""What is read off step responses as they run: a block of samples of many loops at a time."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Columns = NDArray[np.intp]
BAND = 0.02  # of the final value


class Readings:
    """Running figures of m loops.

    ``y`` (1 + n, m) is the output of the reference step with the row before the step first; it fills as the loops run.
    ``final`` (m,) is where it ends, ``T`` the sample time.
    """

    def __init__(self, y: Array, final: Array, T: float) -> None:
        m = len(final)
        self.y, self.T, self.n = y, T, len(y) - 1
        self.final = final
        self.scale = None if (final == 1).all() else np.divide(1.0, final, out=np.ones(m), where=final != 0)
        self.top, self.bottom = np.full(m, -np.inf), np.full(m, np.inf)
        self.times = {level: np.full(m, np.inf) for level in (0.1, 0.9)}
        self.outside = np.zeros((2, m), dtype=np.intp)  # the last block that left the band: its first and last sample
        self.travel, self.peak, self.iae, self.load_iae, self.load_peak = (np.zeros(m) for _ in range(5))

    def take(self, start: int, stop: int, command: Array, error: Array, load: Array) -> None:
        """Samples start to stop; command has one row more, the one before."""
        y = self._scaled(self.y[1 + start : 1 + stop])
        high, low = y.max(axis=0), y.min(axis=0)
        left = (high > 1 + BAND) | (low < 1 - BAND)
        self.outside[:, left] = np.array([[start], [stop - 1]])
        np.maximum(self.top, high, out=self.top)
        np.minimum(self.bottom, low, out=self.bottom)
        for level in self.times:
            self._crossings(level, high, start, stop)
        self._sums(y if self.scale is not None else None, start, stop, command, error, load)

    def _sums(self, y: Array | None, start: int, stop: int, command: Array, error: Array, load: Array) -> None:
        self.travel += np.abs(np.diff(command, axis=0)).sum(axis=0)
        np.maximum(self.peak, np.maximum(command.max(axis=0), -command.min(axis=0)), out=self.peak)
        self.iae += np.abs(1.0 - self.y[1 + start : 1 + stop]).sum(axis=0)
        size = np.abs(load)
        self.load_iae += size.sum(axis=0)
        np.maximum(self.load_peak, size.max(axis=0), out=self.load_peak)

    def _scaled(self, y: Array, which: Columns | slice = slice(None)) -> Array:
        return y if self.scale is None else y * self.scale[which]

    def _crossings(self, level: float, high: Array, start: int, stop: int) -> None:
        """First crossing of a level, on the straight line between two samples."""
        times = self.times[level]
        new = np.flatnonzero((high >= level) & np.isinf(times))
        if not new.size:
            return
        y = self._scaled(self.y[start : 1 + stop, new], new)
        first = np.argmax(y[1:] >= level, axis=0)
        before, after = y[first, np.arange(len(new))], y[first + 1, np.arange(len(new))]
        times[new] = np.maximum((start + first - 1 + (level - before) / (after - before)) * self.T, 0.0)

    def _settling(self) -> Array:
        """When the line between the last sample outside the band and the next one enters it."""
        m = self.outside.shape[1]
        rows = int((self.outside[1] - self.outside[0]).max()) + 2
        at = np.minimum(self.outside[0] + np.arange(rows)[:, None], self.n - 1)
        y = self._scaled(self.y[1 + at, np.arange(m)])
        out = np.abs(y - 1) > BAND
        last = rows - 1 - np.argmax(out[::-1], axis=0)
        sample = self.outside[0] + last
        never, always = sample >= self.n - 1, ~out.any(axis=0)
        here, there = y[last, np.arange(m)], y[np.minimum(last + 1, rows - 1), np.arange(m)]
        edge = np.where(here > 1, 1 + BAND, 1 - BAND)
        with np.errstate(divide="ignore", invalid="ignore"):
            times = (sample + (edge - here) / (there - here)) * self.T
        return np.where(never, np.inf, np.where(always, 0.0, times))

    def figures(self) -> dict[str, Array]:
        """All of them, by name."""
        dead = self.final == 0
        return {
            "rise_time": np.where(
                np.isinf(self.times[0.9]), np.inf, self.times[0.9] - np.minimum(self.times[0.1], 1e300)
            ),
            "settling_time": self._settling(),
            "overshoot": np.where(dead, 0.0, np.maximum(self.top - 1, 0.0)),
            "undershoot": np.where(dead, 0.0, np.maximum(-self.bottom, 0.0)),
            "steady_error": 1.0 - self.final,
            "travel": self.travel,
            "peak_u": self.peak,
            "disturbance_peak": self.load_peak,
            "disturbance_iae": self.load_iae * self.T,
            "iae": self.iae * self.T,
        }
