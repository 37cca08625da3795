"""Step responses: edges of the input, unit responses with starting values, and detection of a rate limit.

    order 1    1 / (T s + 1)                           T
    order 2    1 / (s^2 / wn^2 + 2 zeta s / wn + 1)    wn, zeta

Starting values: area method and overshoot, Astrom & Hagglund 1995, PID Controllers, sections 2.4 and 2.5. A response of
straight ramps indicates a rate limit, which no time constant describes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import MAD, Array, Ints
from ...core.display import Displayable
from ...core.errors import IdentError
from ...datasets import Record
from ..estimators.filters import ROUNDING, squares

PLATEAU = 8  # samples between edges, on average: below it the input is not a sequence of steps
INTEGRATES = (0.1, 0.67)  # largest loss by the integral of the input: of the output, and of that of the lag
DRIFTS = 0.5  # of the squares of the residuals, explained by a straight line in time
EDGE = 6.0  # standard deviations of the noise of the input: a larger change is a step
LEFTOVER = 0.05  # rms deviation from the plateaus as a share of the range: noise of a measured input


@dataclass(frozen=True, slots=True, repr=False)
class Stretch(Displayable):
    """One run of steps: time (n,) s, output y (n,), edges at times ``at`` (k,) s by ``size`` (k,)."""

    time: Array
    y: Array
    at: Array
    size: Array


def stretches_of(rec: Record) -> list[Stretch]:
    """The segments that contain an edge; IdentError if the input is constant or not a sequence of steps."""
    span = float(np.ptp(rec.u))
    if span == 0:
        raise IdentError(f"input {rec.input} is {rec.u[0]:g} throughout: no step. Record from before the step on.")
    runs = [run for s in rec.stretches if (run := _stretch(rec.u[s], rec.y[s], rec.sample_time, span)) is not None]
    edges = sum(len(run.at) for run in runs)
    off = _off_plateaus(rec, span)
    if off > LEFTOVER or not edges or edges * PLATEAU > len(rec):
        why = f"it changes {edges} times in {len(rec)} samples" if off <= LEFTOVER else "it varies between its edges"
        raise IdentError(
            f"input {rec.input} is not made of steps: {why} (at most one change in {PLATEAU} samples, "
            f"and {LEFTOVER:.0%} of its range off the plateaus). Identify a transfer function instead: identify, or "
            "fitmodels ident without --as step."
        )
    kept = [run for run in runs if run.time[-1] - run.at[0] > 0.5 * PLATEAU * rec.sample_time]
    if not kept:
        raise IdentError(
            f"input {rec.input} steps in the last {PLATEAU // 2} samples only: nothing of the response is in the "
            "record. Record on until the output is at rest."
        )
    return kept


def _off_plateaus(rec: Record, span: float) -> float:
    """Root mean square distance of the input from its plateaus, as a share of its range."""
    left = np.concatenate([rec.u[s] - _plateaus(rec.u[s], span) for s in rec.stretches])
    return float(np.sqrt(np.mean(left**2))) / span


def one_step(time: Array, y: Array, step: float, at: float) -> Stretch:
    """A response to one step of the input, given as times and values."""
    time, y = (np.asarray(x, dtype=np.float64) for x in (time, y))
    if time.ndim != 1 or time.shape != y.shape or len(time) < PLATEAU:
        raise IdentError(
            f"times have shape {time.shape}, values {y.shape}: one row of each, with {PLATEAU} values or more."
        )
    if not (np.isfinite(time).all() and np.isfinite(y).all() and (np.diff(time) > 0).all()):
        raise IdentError("times and values of a step response: finite numbers, and times that rise.")
    if not (np.isfinite(step) and step != 0):
        raise IdentError(f"step {step!r}: the change of the input, not zero.")
    if not time[0] <= at < time[-PLATEAU // 2]:
        raise IdentError(f"the step at {at:g} s lies outside the record, {time[0]:g} to {time[-1]:g} s: give at=.")
    return Stretch(time, y, np.array([float(at)]), np.array([float(step)]))


def _edges(u: Array, span: float) -> Ints:
    """Samples at which the input changes by more than noise."""
    return np.flatnonzero(np.abs(np.diff(u)) > max(EDGE * _noise(u), 1e-6 * span)) + 1


def _noise(u: Array) -> float:
    """Standard deviation of the noise of an input, from the median of its changes; 0 for one sample."""
    return MAD * float(np.median(np.abs(np.diff(u)))) / math.sqrt(2) if u.size > 1 else 0.0


def _plateaus(u: Array, span: float) -> Array:
    """Mean of the input between edges."""
    parts = np.split(u, _edges(u, span))
    return np.concatenate([np.full(len(part), part.mean()) for part in parts])


def without_noise(u: Array) -> Array:
    """An input that steps between levels, each sample at its level; any other input as it is.

    Levels that differ by less than the noise of a sample are one.

    >>> without_noise(np.repeat([0.0, 5.0, 0.0], 40) + np.tile([-0.1, 0.1], 60)).round(9)[[0, 39, 40, 119]].tolist()
    [0.0, 0.0, 5.0, 0.0]
    """
    span = float(np.ptp(u))
    mean = _plateaus(u, span)
    off = u - mean
    if not 0 < np.sqrt(np.mean(off**2)) <= LEFTOVER * span or len(_edges(u, span)) * PLATEAU > len(u):
        return u
    order = np.argsort(mean, kind="stable")
    number = np.cumsum(np.diff(mean[order], prepend=mean[order[0]]) > EDGE * _noise(u))
    level = np.bincount(number, u[order]) / np.bincount(number)
    out = np.empty_like(u)
    out[order] = level[number]
    return out


def _stretch(u: Array, y: Array, dt: float, span: float) -> Stretch | None:
    at = _edges(u, span)
    if not at.size:
        return None
    level = _plateaus(u, span)
    time = dt * np.arange(len(u), dtype=np.float64)
    return Stretch(time, y, time[at], level[at] - level[at - 1])


SHAPES = {1: ("time_constant",), 2: ("natural_frequency", "damping")}


def unit_response(order: int, t: Array, shape: Sequence[float]) -> Array:
    """Response at times t (n,) after the delay; zero before.

    >>> unit_response(1, np.array([-1.0, 0.5]), [0.5]).round(3).tolist()
    [0.0, 0.632]
    """
    t = np.maximum(t, 0.0)
    if order == 1:
        return np.asarray(-np.expm1(-t / shape[0]))
    wn, zeta = shape
    if zeta > 1 + 1e-3:
        slow, fast = time_constants(wn, zeta)
        return np.asarray(-(slow * np.expm1(-t / slow) - fast * np.expm1(-t / fast)) / (slow - fast))
    damp = np.exp(-zeta * wn * t)
    x = (zeta**2 - 1) * (wn * t) ** 2
    # cosh(sqrt x) and sinh(sqrt x) / sqrt x, also for x < 0: no division by zero at zeta = 1
    root = np.sqrt(x.astype(np.complex128))
    sine = np.where(np.abs(x) < 1e-8, 1 + x / 6, np.real(np.sinh(root) / np.where(root == 0, 1, root)))
    return np.asarray(1 - damp * (np.real(np.cosh(root)) + zeta * wn * t * sine))


def time_constants(wn: float, zeta: float) -> tuple[float, float]:
    """Slow and fast time constant of a second order with zeta >= 1, s; their product is 1 / wn^2."""
    slow = (zeta + np.sqrt(max(zeta**2 - 1, 0.0))) / wn
    return float(slow), float(1 / (wn**2 * slow))


def integral_loss(runs: Sequence[Stretch]) -> float:
    """Sum of squares of the output about a line of each run and the integral of the input, with one gain of it.

    >>> t = np.arange(50.0)
    >>> round(integral_loss([Stretch(t, 3 + 0.5 * np.maximum(t - 10, 0), np.array([10.0]), np.array([1.0]))]), 9)
    0.0
    """
    columns, outputs = [], []
    for run in runs:
        line = np.column_stack([np.ones(len(run.time)), run.time])
        pair = np.column_stack([np.maximum(run.time[:, None] - run.at, 0.0) @ run.size, run.y])
        left = pair - line @ np.linalg.lstsq(line, pair)[0]
        columns.append(left[:, 0])
        outputs.append(left[:, 1])
    x, y = np.concatenate(columns), np.concatenate(outputs)
    return max(float(y @ y - (x @ y) ** 2 / max(float(x @ x), 1e-300)), 0.0)


def refuse_integral(runs: Sequence[Stretch], loss: float, size: float) -> None:
    """Raise IdentError where the integral of the input describes the output better than a lag of this ``loss``."""
    if integral_loss(runs) < min(INTEGRATES[0] * size, INTEGRATES[1] * loss):
        raise IdentError(
            "the output keeps moving while the input is held, as the integral of the input does: it has no time "
            "constant. Identify it without --as step (identify in Python), or record its speed."
        )


def guesses(order: int, runs: Sequence[Stretch], delay: float | None) -> list[tuple[list[float], float]]:
    """Starting values: ([T] or [wn, zeta], delay) each."""
    z, t, dt = _longest(runs)
    area = max(float(np.trapezoid(1 - z, t)), dt)  # mean residence time: delay and time constants together
    T = float(math.e * np.trapezoid(z[t <= area], t[t <= area])) if (t <= area).sum() > 1 else area
    dead = min(max(area - T, 0.0), 0.9 * area)
    delays = [dead, dead / 2, 0.0] if delay is None else [delay]
    out: list[tuple[list[float], float]] = []
    for late in delays:
        lag = max(area - late, dt)
        if order == 1:
            out.append(([lag], late))
        else:
            out += [([2 * zeta / lag, zeta], late) for zeta in (0.5, 1.0, 2.0)]
            out += _from_overshoot(z, t, late)
    return out


def drift(runs: Sequence[Stretch], fitted: Sequence[Array], unit: str) -> str:
    """Advice where a straight line in time is most of what is left of the output; empty otherwise."""
    total, left, largest = 0.0, 0.0, (0.0, 0.0)
    for run, model in zip(runs, fitted, strict=True):
        e = run.y - model - (run.y - model).mean()
        line = np.polyval(np.polyfit(run.time, e, 1), run.time)
        total, left = total + squares(e), left + squares(e - line)
        largest = max(largest, (float(abs(line[-1] - line[0])), float(run.time[-1] - run.time[0])))
    if left > (1 - DRIFTS) * total:
        return ""
    size = f"{largest[0]:.2g} {unit}".rstrip()
    return (
        f"the output drifts by {size} within {largest[1]:.3g} s. Warm up the machine, or correct the offset of the "
        "sensor, and record again; or identify a transfer function (without --as), which estimates a drift as well"
    )


def overshoot(runs: Sequence[Stretch]) -> float:
    """Overshoot of the longest response, as a fraction of the step."""
    return max(float(_longest(runs)[0].max()) - 1, 0.0)


def _from_overshoot(z: Array, t: Array, late: float) -> list[tuple[list[float], float]]:
    """Starting values: zeta from the height of the first peak, wn from its time."""
    peak = int(np.argmax(z))
    over = float(z[peak]) - 1
    if over < 0.01 or t[peak] <= late:
        return []
    decrement = np.log(over) / np.pi
    zeta = float(min(max(-decrement / np.hypot(1, decrement), 0.02), 0.95))
    return [([float(np.pi / (t[peak] - late) / np.sqrt(1 - zeta**2)), zeta], late)]


def _longest(runs: Sequence[Stretch]) -> tuple[Array, Array, float]:
    """Response to the edge with the longest plateau after it, scaled to 0 ... 1; times from the edge; spacing."""
    best = (np.zeros(2), np.arange(2.0), 1.0)
    for run in runs:
        ends = [*run.at[1:], run.time[-1] + 1e-9]
        for at, end in zip(run.at, ends, strict=True):
            inside = (run.time >= at) & (run.time < end)
            y, t = run.y[inside], run.time[inside] - at
            if len(y) < 4 or (t[-1] <= best[1][-1] and len(best[0]) > 2):
                continue
            before = run.y[run.time <= at]
            start = float(before[-3:].mean()) if before.size else float(y[0])
            final = float(np.mean(y[-max(len(y) // 10, 1) :]))
            if final != start:
                best = ((y - start) / (final - start), t, float(np.median(np.diff(t))))
    return best


BETTER = 0.5  # ratio of the squared errors of ramps and linear fit below which a rate limit is reported


def ramp_rate(runs: Sequence[Stretch], gain: float, levels: Sequence[float], loss: float) -> float | None:
    """Rate limit, unit_y/s, where ramps describe the record clearly better than the linear fit; otherwise None.

    Parameters
    ----------
    runs : sequence of Stretch
    gain : float
        unit_y per unit_u, of the linear fit; starting value for the ramps.
    levels : sequence of float
        Output before the first edge of each segment.
    loss : float
        Squared error of the linear fit.
    """
    from scipy.optimize import minimize

    run = runs[0]
    dt = float(np.median(np.diff(run.time)))
    steep = float(np.percentile(np.abs(np.diff(run.y)) / np.diff(run.time), 90))
    if not steep > 0 or loss <= ROUNDING * sum(float(run.y @ run.y) for run in runs):
        return None

    def error(p: Array) -> float:
        rate, late, own = steep * np.exp(p[0]), dt * abs(p[1]), gain * np.exp(p[2])
        return sum(
            float(np.sum((run.y - ramps(run, own, level, rate, late)) ** 2))
            for run, level in zip(runs, levels, strict=True)
        )

    # initial steps of rate, delay and gain: a factor 1.6, two samples, a tenth
    simplex = np.array([[0.0, 1.0, 0.0], [0.5, 1.0, 0.0], [0.0, 3.0, 0.0], [0.0, 1.0, 0.1]])
    best = minimize(error, simplex[0], method="Nelder-Mead", options={"maxiter": 150, "initial_simplex": simplex})
    return steep * float(np.exp(best.x[0])) if float(best.fun) < BETTER * loss else None


def ramps(run: Stretch, gain: float, level: float, rate: float, delay: float) -> Array:
    """Rate-limited output (n,) that follows gain times the input from ``level`` after a delay.

    >>> run = Stretch(np.arange(5.0), np.zeros(5), at=np.array([1.0]), size=np.array([2.0]))
    >>> ramps(run, gain=1.0, level=0.0, rate=0.8, delay=0.0).round(9).tolist()
    [0.0, 0.0, 0.8, 1.6, 2.0]
    """
    out = np.full(len(run.time), level)
    here = target = level
    begins = run.at + delay
    for k, begin in enumerate(begins):
        target += gain * run.size[k]
        after = run.time >= begin
        out[after] = here + np.clip(target - here, -rate * (run.time[after] - begin), rate * (run.time[after] - begin))
        if k + 1 < len(begins):
            reach = rate * (begins[k + 1] - begin)
            here += float(np.clip(target - here, -reach, reach))
    return out
