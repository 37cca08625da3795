"""Step responses of many stable loops, simulated together, and their metrics (rise time, settling time, overshoot ...).

One simulation yields all signals: z, the response to a unit step of load at the plant input. The response of the
controller to it, with opposite sign, is H y of the reference step without setpoint weight; y itself is F z, because
y = F G S r and z = G S, and the command is F S r (F: the controller with the setpoint weight).
The recursion runs inside the closed loop, so that an unstable plant does not amplify rounding.
"""

from collections.abc import Callable

import numpy as np

from ...core.arrays import Array, Ints
from .loops import Loops

WIDTH = 4096  # loops simulated at once: the rows in use fit in the cache
STORED = 2_500_000  # numbers stored per signal: fewer loops at once for long steps
BLOCK = 16  # samples between two evaluations


def step_figures(loops: Loops, n: int) -> dict[str, Array]:
    """Metrics of the first ``n`` samples, one value per loop; all loops must be stable."""
    width = min(WIDTH, max(STORED // n, 1))
    parts = [_figures(loops[slice(k, k + width)], n) for k in range(0, len(loops), width)]
    return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}


def _figures(loops: Loops, n: int) -> dict[str, Array]:
    run = _Run(loops, n)
    metrics = StepMetrics(run.y[run.pad - 1 :], loops.final, loops.kind.sample_time, loops.integrals)
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        command = run.advance(start, stop)
        metrics.update(start, stop, command, run.z[run.pad + start : run.pad + stop])
    return metrics.figures()


class _Run:
    """The signals of m loops, each (pad + n, m) with ``pad`` rows of zeros before the step.

    z output under load, f its filtered measurement, q the negative controller output, w its part that reaches the plant
    (H y of the reference step without weight), y output of the reference step.
    """

    def __init__(self, loops: Loops, n: int) -> None:
        kind, m = loops.kind, len(loops)
        self.pad = max(len(loops.a), len(loops.b), kind.average + kind.delay) + 1
        self.gain, self.pole = 1.0, 0.0
        if kind.filter_time:
            self.pole = float(-kind.feedback[1][1])
            self.gain = 1 - self.pole
        seen = kind.average if kind.average_of == "measurement" else 1
        sent = kind.average if kind.average_of == "command" else 1
        self.bare = kind.filter_time == 0 and seen == 1
        self.shared = self.bare and kind.setpoint_weight == 1  # y is w
        self.late = kind.delay

        def signal() -> Array:
            return np.zeros((self.pad + n, m))

        self.z = signal()
        self.f = self.z if self.bare else signal()
        self.q = signal()
        straight = sent == 1 and not self.late
        self.w = self.q if straight else signal()
        self.plain = self.q if self.shared else signal()  # the response to z itself, for y
        self.y = self.w if self.shared else self.plain if straight else signal()
        self.answer = _pi(loops, loops.proportional)
        self.second, self.asked = _pi(loops, loops.weighted), _pi(loops, loops.weighted)
        self.see, self.send, self.send_y, self.command = (_mean(k, m) for k in (seen, sent, sent, sent))
        self.plant = _plant(loops, m)
        self.v = np.zeros((BLOCK + sent, m))  # unaveraged command, the rows before the block first
        self.c = np.zeros((BLOCK + 1, m))  # command sent, one row before the block first
        self.sent = sent

    def advance(self, start: int, stop: int) -> Array:
        """Advance from start to stop; return the command, with one row before."""
        for k in range(self.pad + start, self.pad + stop):
            if self.late:
                self.send(self.q, k - self.late, self.w[k])
            self.plant(self.z, self.w, k, k - self.pad)
            self._see(k)
            self.answer(self.f[k], self.q[k])
            if not self.late and self.w is not self.q:
                self.send(self.q, k, self.w[k])
            if not self.shared:
                self.second(self.z[k], self.plain[k])
                if self.y is not self.plain:
                    self.send_y(self.plain, k - self.late, self.y[k])
        error = 1.0 - self.w[self.pad + start : self.pad + stop]
        return self._commands(error)

    def _see(self, k: int) -> None:
        if self.bare:
            return
        self.see(self.z, k, self.f[k])
        if self.pole:
            self.f[k] *= self.gain
            self.f[k] += self.pole * self.f[k - 1]

    def _commands(self, error: Array) -> Array:
        rows, v, c, lead = len(error), self.v, self.c, self.sent
        for k in range(rows):
            self.asked(error[k], v[lead + k])
        if lead == 1:
            out = v[: rows + 1].copy()
            v[0] = v[rows]
            return out
        for k in range(rows):
            self.command(v, lead + k, c[k + 1])
        out = c[: rows + 1].copy()
        c[0], v[:lead] = c[rows], v[rows : rows + lead].copy()
        return out


def _pi(loops: Loops, kp: Array) -> Callable[[Array, Array], None]:
    """The PI of each loop with proportional gains kp (m,): a row in, a row out."""
    ki = loops.integral
    total, whole, spare = (np.zeros(len(loops)) for _ in range(3))
    integral, twice = loops.kind.ki != 0, loops.kind.form == "incremental_sum"

    def step(x: Array, out: Array) -> None:
        np.multiply(x, kp, out=out)
        if integral:
            np.add(total, x, out=total)
            np.multiply(total, ki, out=spare)
            np.add(out, spare, out=out)
        if twice:
            np.add(whole, out, out=whole)
            out[:] = whole

    return step


def _mean(samples: int, m: int) -> Callable[[Array, int, Array], None]:
    """Moving average of row k of a signal and the rows before it, written to ``out``."""
    total = np.zeros(m)

    def step(rows: Array, k: int, out: Array) -> None:
        if samples == 1:
            out[:] = rows[k]
            return
        np.add(total, rows[k], out=total)
        np.subtract(total, rows[k - samples], out=total)
        np.multiply(total, 1.0 / samples, out=out)

    return step


def _plant(loops: Loops, m: int) -> Callable[[Array, Array, int, int], None]:
    """z_k = sum of b (1 - w) - sum of a z over the past; the load step starts at sample 0."""
    nb, na = len(loops.b), len(loops.a) - 1
    back, by_a, load = loops.b[::-1].copy(), loops.a[:0:-1].copy(), np.cumsum(loops.b, axis=0)
    one, two = np.empty(m), np.empty(m)
    mix = _mix_shared if loops.shared else _mix_own

    def step(z: Array, w: Array, k: int, sample: int) -> None:
        mix(back, w[k - nb + 1 : k + 1], one)
        mix(by_a, z[k - na : k], two)
        np.add(one, two, out=one)
        np.subtract(load[min(sample, nb - 1)], one, out=z[k])

    return step


def _mix_shared(coefficients: Array, rows: Array, out: Array) -> None:
    np.dot(coefficients[:, 0], rows, out=out)


def _mix_own(coefficients: Array, rows: Array, out: Array) -> None:
    np.sum(coefficients * rows, axis=0, out=out)


BAND = 0.02  # of the final value


class StepMetrics:
    """Running metrics of m loops.

    ``y`` (1 + n, m) is the output of the reference step, preceded by one row; it is filled during the simulation.
    ``final`` (m,) is its final value, ``T`` the sample time, ``whole`` the integrals of error and output over all time
    after a step of reference and of load, each (m,), or None where they diverge.
    """

    def __init__(self, y: Array, final: Array, T: float, whole: tuple[Array, Array] | None) -> None:
        m = len(final)
        self.y, self.T, self.n = y, T, len(y) - 1
        self.final, self.whole = final, whole
        self.scale = None if (final == 1).all() else np.divide(1.0, final, out=np.ones(m), where=final != 0)
        self.top, self.bottom = np.full(m, -np.inf), np.full(m, np.inf)
        self.times = {level: np.full(m, np.inf) for level in (0.1, 0.9)}
        self.outside = np.zeros((2, m), dtype=np.intp)  # first and last sample of the last block outside the band
        self.travel, self.peak, self.iae, self.load_iae, self.load_peak = (np.zeros(m) for _ in range(5))
        self.error_sum, self.load_sum = np.zeros(m), np.zeros(m)

    def update(self, start: int, stop: int, command: Array, load: Array) -> None:
        """Update by samples start to stop; command has one row before them."""
        y = self._scaled(self.y[1 + start : 1 + stop])
        high, low = y.max(axis=0), y.min(axis=0)
        left = (high > 1 + BAND) | (low < 1 - BAND)
        self.outside[:, left] = np.array([[start], [stop - 1]])
        np.maximum(self.top, high, out=self.top)
        np.minimum(self.bottom, low, out=self.bottom)
        for level in self.times:
            self._crossings(level, high, start, stop)
        self._sums(start, stop, command, load)

    def _sums(self, start: int, stop: int, command: Array, load: Array) -> None:
        self.travel += np.abs(np.diff(command, axis=0)).sum(axis=0)
        np.maximum(self.peak, np.maximum(command.max(axis=0), -command.min(axis=0)), out=self.peak)
        missing = 1.0 - self.y[1 + start : 1 + stop]
        self.error_sum += missing.sum(axis=0)
        self.iae += np.abs(missing, out=missing).sum(axis=0)
        self.load_sum += load.sum(axis=0)
        size = np.abs(load)
        self.load_iae += size.sum(axis=0)
        np.maximum(self.load_peak, size.max(axis=0), out=self.load_peak)

    def _scaled(self, y: Array, which: Ints | slice = slice(None)) -> Array:
        return y if self.scale is None else y * self.scale[which]

    def _crossings(self, level: float, high: Array, start: int, stop: int) -> None:
        """First crossing of a level, by linear interpolation."""
        times = self.times[level]
        new = np.flatnonzero((high >= level) & np.isinf(times))
        if not new.size:
            return
        y = self._scaled(self.y[start : 1 + stop, new], new)
        first = np.argmax(y[1:] >= level, axis=0)
        before, after = y[first, np.arange(len(new))], y[first + 1, np.arange(len(new))]
        times[new] = np.maximum((start + first - 1 + (level - before) / (after - before)) * self.T, 0.0)

    def _settling(self) -> Array:
        """Settling time, by linear interpolation after the last sample outside the band."""
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

    def _absolute(self) -> tuple[Array, Array]:
        """Integrals of |error| and of |output under load|, with the size of what follows the last sample."""
        error, load = self.iae * self.T, self.load_iae * self.T
        if self.whole is None:
            return error, load
        rest = (v - self.T * s for v, s in zip(self.whole, (self.error_sum, self.load_sum), strict=True))
        return error + np.abs(next(rest)), load + np.abs(next(rest))

    def figures(self) -> dict[str, Array]:
        """All metrics by name."""
        dead = self.final == 0
        iae, load_iae = self._absolute()
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
            "disturbance_iae": load_iae,
            "iae": iae,
        }
