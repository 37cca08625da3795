"""Separable least squares for step responses: shape and delay by search, gain and initial levels by projection."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array
from ...core.errors import IdentError
from ..estimators.filters import squares
from .step_shapes import SHAPES, Stretch, guesses, unit_response

RESPONDS = 0.1  # share of the output variance that the best response must explain


@dataclass(frozen=True, slots=True)
class StepSolution:
    """Result of the search: residuals e (N,), J (N, p) of ``names``, initial levels, bounds of the segments."""

    gain: float
    shape: list[float]
    delay: float
    names: tuple[str, ...]
    e: Array
    J: Array
    levels: list[float]
    ends: list[int]
    loss: float
    size: float


def search(order: int, runs: Sequence[Stretch], delay: float | None) -> StepSolution:
    """The least-squares response, from several starts."""
    from scipy.optimize import least_squares

    y = np.concatenate([centred(run.y) for run in runs])
    size = squares(y)
    if len(y) < 4 * (order + 2):
        raise IdentError(f"{len(y)} samples for {order + 2} coefficients: {4 * (order + 2)} or more.")
    if size == 0:
        raise IdentError("the output is constant while the input steps. Check the sensor and the column read.")
    longest = max(float(run.time[-1] - run.at[0]) for run in runs)
    free = delay is None

    def unpack(p: Array) -> tuple[list[float], float]:
        return np.exp(p[:order]).tolist(), float(p[order]) * longest if free else float(delay or 0.0)

    def error(p: Array) -> Array:
        x = basis(order, runs, *unpack(p))
        return np.asarray((y - gain_of(x, y) * x) / np.sqrt(size), dtype=np.float64)

    # shapes within a factor 100 of the record's length and spacing: beyond, they are not identifiable
    dt = min(float(np.diff(run.time).min()) for run in runs)
    time = (np.log(1e-2 * dt), np.log(1e2 * longest))
    low, high = [time[0]], [time[1]]
    if order == 2:
        low, high = [-time[1], np.log(0.01)], [-time[0], np.log(1e3)]
    low, high = low + [0.0] * free, high + [0.95] * free
    ends = []
    for shape, late in guesses(order, runs, delay):
        start = np.r_[np.log(shape), [late / longest] * free]
        start = np.clip(start, np.add(low, 1e-6), np.subtract(high, 1e-6))
        ends.append(least_squares(error, start, bounds=(low, high), max_nfev=15))
    best = min(ends, key=lambda end: float(end.cost))
    best = least_squares(error, best.x, bounds=(low, high), xtol=1e-13, ftol=1e-13, gtol=1e-13, max_nfev=100)
    shape, late = unpack(best.x)
    return _found(order, runs, y, shape, late, free and late > 1e-6 * longest)


def _found(order: int, runs: Sequence[Stretch], y: Array, shape: list[float], late: float, free: bool) -> StepSolution:
    x = basis(order, runs, shape, late)
    gain = gain_of(x, y)
    e = y - gain * x
    if squares(e) > (1 - RESPONDS) * squares(y):
        raise IdentError(
            "the output does not respond to the steps: the best response explains "
            f"{100 * (1 - squares(e) / squares(y)):.2g} % of its variance, {100 * RESPONDS:.0f} % are needed. "
            "Use larger steps, or check the columns read."
        )
    whole = np.r_[shape, late]
    columns = [x]
    for k in range(order + free):
        pace = shape[0] if order == 1 else 1 / shape[0]
        h = 1e-5 * (whole[k] if k < order else 0.1 * pace)
        moved = (whole + h * np.eye(len(whole))[k], whole - h * np.eye(len(whole))[k])
        up, down = (basis(order, runs, at[:order].tolist(), float(at[order])) for at in moved)
        columns.append(gain * (up - down) / (2 * h))
    names = ("gain", *SHAPES[order], *(("delay",) if free else ()))
    ends = np.cumsum([0, *(len(run.y) for run in runs)]).tolist()
    levels = [float((run.y - gain * raw(order, run, shape, late)).mean()) for run in runs]
    return StepSolution(gain, shape, late, names, e, np.column_stack(columns), levels, ends, squares(e), squares(y))


def raw(order: int, run: Stretch, shape: Sequence[float], late: float) -> Array:
    """Response (n,) of one segment to its edges, gain 1, from rest at zero."""
    out = np.zeros(len(run.time))
    for at, size in zip(run.at, run.size, strict=True):
        begin = int(np.searchsorted(run.time, at + late))
        out[begin:] += size * unit_response(order, run.time[begin:] - at - late, shape)
    return out


def basis(order: int, runs: Sequence[Stretch], shape: Sequence[float], late: float) -> Array:
    """``raw`` of every segment less its mean, which projects the initial levels out."""
    return np.concatenate([centred(raw(order, run, shape, late)) for run in runs])


def centred(x: Array) -> Array:
    """Less its mean."""
    return np.asarray(x - x.mean())


def gain_of(x: Array, y: Array) -> float:
    """Least-squares gain."""
    return float(x @ y) / max(float(x @ x), np.finfo(float).tiny)
