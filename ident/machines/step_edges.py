"""Where an input steps, by how much, and whether it is made of steps at all."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.display import Displayable
from ...core.errors import IdentError
from ...datasets import Record

Array = NDArray[np.float64]
PLATEAU = 8  # samples between edges, on average: below it the input is a signal, not steps
LEFTOVER = 0.05  # of the input's range may stay beside its plateaus: noise of a measured input


@dataclass(frozen=True, slots=True, repr=False)
class Stretch(Displayable):
    """One run of steps: time (n,) s, output y (n,), edges at times ``at`` (k,) s by ``size`` (k,)."""

    time: Array
    y: Array
    at: Array
    size: Array


def stretches_of(rec: Record) -> list[Stretch]:
    """The stretches that hold an edge, or IdentError: the input is constant, or no steps."""
    span = float(np.ptp(rec.u))
    if span == 0:
        raise IdentError(f"input {rec.input} is {rec.u[0]:g} throughout: no step. Record from before the step on.")
    runs = [run for s in rec.stretches if (run := _stretch(rec.u[s], rec.y[s], rec.sample_time, span)) is not None]
    edges = sum(len(run.at) for run in runs)
    left = np.concatenate([rec.u[s] - _plateaus(rec.u[s], span) for s in rec.stretches])
    off = float(np.sqrt(np.mean(left**2))) / span
    if off > LEFTOVER or not edges or edges * PLATEAU > len(rec):
        why = f"it changes {edges} times in {len(rec)} samples" if off <= LEFTOVER else "it moves between its edges"
        raise IdentError(
            f"input {rec.input} is not made of steps: {why} (at most one change in {PLATEAU} samples, "
            f"and {LEFTOVER:.0%} of its range beside the plateaus). Fit arx or output_error instead."
        )
    return runs


def one_step(time: Array, y: Array, step: float, at: float) -> Stretch:
    """A response given as times and values, at any times, to one step of the input."""
    time, y = (np.asarray(x, dtype=np.float64) for x in (time, y))
    if time.ndim != 1 or time.shape != y.shape or len(time) < PLATEAU:
        raise IdentError(f"times have shape {time.shape}, values {y.shape}: one row of each, {PLATEAU} or more.")
    if not (np.isfinite(time).all() and np.isfinite(y).all() and (np.diff(time) > 0).all()):
        raise IdentError("times and values of a step response: finite numbers, and times that rise.")
    if not (np.isfinite(step) and step != 0):
        raise IdentError(f"step {step!r}: the change of the input, not zero.")
    if not time[0] <= at < time[-PLATEAU // 2]:
        raise IdentError(f"the step at {at:g} s lies outside the record, {time[0]:g} to {time[-1]:g} s: give at=.")
    return Stretch(time, y, np.array([float(at)]), np.array([float(step)]))


def _edges(u: Array, span: float) -> NDArray[np.intp]:
    """Samples whose input differs from the one before by more than noise does."""
    change = np.abs(np.diff(u))
    noise = 1.4826 * float(np.median(change)) / np.sqrt(2) if change.size else 0.0
    return np.flatnonzero(change > max(6 * noise, 1e-6 * span)) + 1


def _plateaus(u: Array, span: float) -> Array:
    """The input as its mean between edges."""
    parts = np.split(u, _edges(u, span))
    return np.concatenate([np.full(len(part), part.mean()) for part in parts])


def _stretch(u: Array, y: Array, dt: float, span: float) -> Stretch | None:
    at = _edges(u, span)
    if not at.size:
        return None
    level = _plateaus(u, span)
    time = dt * np.arange(len(u), dtype=np.float64)
    return Stretch(time, y, time[at], level[at] - level[at - 1])
