"""Batches of loops (many gains, one or several plants), their stability and noise gain.

Every integration rule is the backward one with another kp: a forward sum corresponds to kp' = kp - ki T, a trapezoidal
one to half of that change. A PI is thus ``kp' + ki T / (1 - z^-1)``, in the form incremental_sum with a further sum.

Source of the stability test and the noise gain: Åström 1970, Introduction to Stochastic Control Theory,
chapter 5, theorems 2.1 and 2.2 (the Jury table, and the variance of a signal from two such tables).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Array, Flags, Ints
from ...core.errors import IdentError, UsageError
from ..model import Model
from .gains import PiGains, basis

_LACK = {"backward": 0.0, "forward": 1.0, "trapezoidal": 0.5}


@dataclass(frozen=True, slots=True)
class Loops:
    """Batch of m loops.

    Attributes
    ----------
    b, a : ndarray, shape (., 1) or (., m)
        Plants, in powers of z^-1; one column if common to all loops.
    kp, ki : ndarray, shape (m,)
    kind : PiGains
        Controller apart from its gains; its own ki is 0 exactly if the whole batch has no integral action.
    """

    b: Array
    a: Array
    kp: Array
    ki: Array
    kind: PiGains

    def __len__(self) -> int:
        return len(self.kp)

    def __getitem__(self, which: slice | Ints | Flags) -> "Loops":
        shared = self.shared
        b, a = (p if shared else p[:, which] for p in (self.b, self.a))
        return Loops(b, a, self.kp[which], self.ki[which], self.kind)

    @property
    def shared(self) -> bool:
        """Whether all loops have the same plant."""
        return bool(self.a.shape[1] == 1 and self.b.shape[1] == 1)

    @property
    def integral(self) -> Array:
        """Ki T, shape (m,)."""
        return self.ki * self.kind.sample_time

    @property
    def proportional(self) -> Array:
        """Gain kp' of the equivalent backward rule, shape (m,)."""
        return self.kp - _LACK[self.kind.integration] * self.integral

    @property
    def weighted(self) -> Array:
        """Gain of the reference in the equivalent backward rule, shape (m,); ``proportional`` for a weight of 1."""
        return self.kind.setpoint_weight * self.kp - _LACK[self.kind.integration] * self.integral

    @property
    def characteristic(self) -> Array:
        """Denominator of every closed transfer function in z^-1, shape (n + 1, m)."""
        of_kp, of_ki, den = basis(self.kind)
        hn, hd = self.kind.feedback
        forward = columns(self.b, self.kind.command_path, hn)
        own = columns(self.a, den, hd)
        return _sum(own, self.kp * columns(forward, of_kp), self.ki * columns(forward, of_ki))

    @property
    def noise_numerator(self) -> Array:
        """Numerator of measurement noise to command, without its sign; shape (., m)."""
        of_kp, of_ki, _ = basis(self.kind)
        through = columns(self.a, self.kind.command_path, self.kind.feedback[0])
        return _sum(self.kp * columns(through, of_kp), self.ki * columns(through, of_ki))

    @property
    def final(self) -> Array:
        """Final value of the unit step response of a stable loop, shape (m,)."""
        if basis(self.kind)[2].sum() == 0:
            return np.ones(len(self))
        b, a = self.b.sum(axis=0), self.a.sum(axis=0)
        return np.asarray(self.kind.setpoint_weight * self.kp * b / (a + self.kp * b), dtype=np.float64)

    @property
    def integrals(self) -> tuple[Array, Array] | None:
        """Integrals over all time of 1 - y (unit step of the reference) and of y (unit step of load), each shape (m,).

        The integral of the measured error is the final command less its proportional part over ki (Åström & Hägglund
        2006, section 4.4), and zero with a further sum; the measurement lags by the mean delay of its filter. None
        without integral action.
        """
        if self.kind.ki == 0:
            return None
        T, m = self.kind.sample_time, len(self)
        lag = T * (mean_delay(self.kind.feedback[0]) - mean_delay(self.kind.feedback[1]))
        if self.kind.form == "incremental_sum":
            return np.full(m, -lag), np.zeros(m)
        at_rest = self.a.sum(axis=0) / self.b.sum(axis=0)  # command per output
        held_back = (1.0 - self.kind.setpoint_weight) * self.kp
        return np.asarray((at_rest + held_back) / self.ki - lag), np.asarray(1.0 / self.ki)


def loops_of(model: Model | Sequence[Model], kp: ArrayLike, ki: ArrayLike, kind: PiGains) -> Loops:
    """Loops of m pairs of gains with one model, or of every pair with every model (models slowest)."""
    p, i = (np.atleast_1d(np.asarray(v, dtype=np.float64)) for v in (kp, ki))
    if p.ndim != 1 or p.shape != i.shape or not (np.isfinite(p).all() and np.isfinite(i).all()):
        raise UsageError(f"kp {p.shape}, ki {i.shape}: two arrays of finite numbers of the same length.")
    models = [model] if isinstance(model, Model) else list(model)
    if not models:
        raise UsageError("no model: give at least one plant.")
    for one in models:
        check_pair(one, kind)
    b, a = (_stacked([getattr(one, name) for one in models]) for name in ("b", "a"))
    if len(models) == 1:
        return Loops(b, a, p, i, kind)
    pairs, n = len(p), len(models)
    return Loops(np.repeat(b, pairs, axis=1), np.repeat(a, pairs, axis=1), np.tile(p, n), np.tile(i, n), kind)


def split(loops: Loops) -> list[tuple[Ints, Loops]]:
    """Loops with and without integral action separately, with their indices: an unused sum would be a pole at 1."""
    parts = []
    for value, mask in ((1.0, loops.ki != 0), (0.0, loops.ki == 0)):
        if mask.any():
            where = np.flatnonzero(mask)
            parts.append((where, replace(loops[where], kind=replace(loops.kind, kp=1.0, ki=value))))
    return parts


def check_pair(model: Model, gains: PiGains) -> None:
    """Raise IdentError unless sample times agree and the loop contains at least one sample of delay."""
    if abs(model.sample_time - gains.sample_time) > 1e-9 * model.sample_time:
        raise IdentError(
            f"gains at {gains.sample_time:g} s, model at {model.sample_time:g} s: identify the model at the sample "
            "time of the controller, or run the controller at that of the model."
        )
    if model.b[0] != 0 and gains.delay == 0:
        raise IdentError(
            f"b starts with {model.b[0]:g} (nk 0) and the controller has no delay: the loop is algebraic. "
            "Give the controller delay=1, or identify with nk=1."
        )


def mean_delay(p: Array) -> float:
    """Derivative of a polynomial in z^-1 at 1, over its value there: samples."""
    return float(np.arange(len(p)) @ p / p.sum())


def columns(p: Array, *polynomials: Array) -> Array:
    """Products of every column of p (n, m) with 1-D polynomials."""
    for q in polynomials:
        out = np.zeros((len(p) + len(q) - 1, p.shape[1]))
        for i, c in enumerate(q.tolist()):
            if c != 0:
                out[i : i + len(p)] += c * p
        p = out
    return p


def _sum(*parts: Array) -> Array:
    out = np.zeros((max(len(p) for p in parts), max(p.shape[1] for p in parts)))
    for p in parts:
        out[: len(p)] += p
    return out


def _stacked(polynomials: list[Array]) -> Array:
    out = np.zeros((max(len(p) for p in polynomials), len(polynomials)))
    for k, p in enumerate(polynomials):
        out[: len(p), k] = p
    return out


def stable_columns(a: Array) -> Flags:
    """Whether every root of each column a_0 + a_1 z^-1 + ... lies inside the unit circle; a (n + 1, m), a_0 = 1.

    >>> stable_columns(np.array([[1.0, 1.0], [-0.5, -1.0]])).tolist()
    [True, False]
    """
    good = np.ones(a.shape[1], dtype=bool)
    with np.errstate(all="ignore"):  # unstable columns continue with meaningless numbers
        while len(a) > 1:
            alpha = a[-1] / a[0]
            good &= np.abs(alpha) < 1
            a = a[:-1] - alpha * a[:0:-1]
    return good


def noise_size(b: Array, a: Array) -> Array:
    """Standard deviation of b/a driven by unit white noise, by column; stable a only, shape (m,).

    >>> noise_size(np.array([[1.0], [0.0]]), np.array([[1.0], [-0.6]])).tolist()
    [1.25]
    """
    n = max(len(a), len(b))
    a, b = (np.vstack([p, np.zeros((n - len(p), p.shape[1]))]) for p in (a, b))
    first, total = a[0], np.zeros(a.shape[1])
    while True:
        total = total + b[-1] ** 2 / a[0]
        if len(a) == 1:
            return np.asarray(np.sqrt(total / first), dtype=np.float64)
        turned = a[:0:-1]
        alpha, beta = a[-1] / a[0], b[-1] / a[0]
        a, b = a[:-1] - alpha * turned, b[:-1] - beta * turned
