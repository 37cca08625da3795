"""Step responses of many stable loops, advanced together, and the figures read off them.

One run gives all: z, the response to a unit step of load at the plant input. What the controller answers to it, turned
round, is H y of the reference step; y itself is C z, because y = C G S r and z = G S. The recursion runs inside the
closed loop, so that an unstable plant does not multiply the rounding.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .loops import Loops
from .readings import Readings

Array = NDArray[np.float64]

WIDTH = 4096  # loops advanced at once: the rows in work stay in the cache
HELD = 2_500_000  # numbers held a signal: fewer loops at once where steps are long
BLOCK = 16  # samples between two readings


def step_figures(loops: Loops, n: int) -> dict[str, Array]:
    """Figures of the first ``n`` samples, one value a loop; all loops must be stable."""
    width = min(WIDTH, max(HELD // n, 1))
    parts = [_figures(loops[slice(k, k + width)], n) for k in range(0, len(loops), width)]
    return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}


def _figures(loops: Loops, n: int) -> dict[str, Array]:
    run = _Run(loops, n)
    readings = Readings(run.y[run.pad - 1 :], loops.final, loops.kind.sample_time)
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        command, error = run.advance(start, stop)
        readings.take(start, stop, command, error, run.z[run.pad + start : run.pad + stop])
    return readings.figures()


class _Run:
    """The signals of m loops, each (pad + n, m) with ``pad`` rows of zeros before the step.

    z output under load, f the same as the controller sees it, q the controller's answer turned round, w what of it
    reaches the plant (H y of the reference step), y output of the reference step.
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
        self.late = kind.delay

        def signal() -> Array:
            return np.zeros((self.pad + n, m))

        self.z = signal()
        self.f = self.z if self.bare else signal()
        self.q = signal()
        straight = sent == 1 and not self.late
        self.w = self.q if straight else signal()
        self.plain = self.q if self.bare else signal()  # the answer to z itself, for y
        self.y = self.w if self.bare else self.plain if straight else signal()
        self.answer, self.second, self.asked = _pi(loops), _pi(loops), _pi(loops)
        self.see, self.send, self.send_y, self.command = (_mean(k, m) for k in (seen, sent, sent, sent))
        self.plant = _plant(loops, m)
        self.v = np.zeros((BLOCK + sent, m))  # command asked for, the rows before the block first
        self.c = np.zeros((BLOCK + 1, m))  # command sent, one row before the block first
        self.sent = sent

    def advance(self, start: int, stop: int) -> tuple[Array, Array]:
        """Samples start to stop: the command sent, one row more before them, and 1 - H y."""
        for k in range(self.pad + start, self.pad + stop):
            if self.late:
                self.send(self.q, k - self.late, self.w[k])
            self.plant(self.z, self.w, k, k - self.pad)
            self._see(k)
            self.answer(self.f[k], self.q[k])
            if not self.late and self.w is not self.q:
                self.send(self.q, k, self.w[k])
            if not self.bare:
                self.second(self.z[k], self.plain[k])
                if self.y is not self.plain:
                    self.send_y(self.plain, k - self.late, self.y[k])
        error = 1.0 - self.w[self.pad + start : self.pad + stop]
        return self._commands(error), error

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


def _pi(loops: Loops) -> Callable[[Array, Array], None]:
    """The PI of each loop: a row in, a row out."""
    kp, ki = loops.proportional, loops.integral
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
    """z_k = sum of b (1 - w) - sum of a z, both over the past; the step of load begins at sample 0."""
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
