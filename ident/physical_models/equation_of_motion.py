"""Equation of motion of a feed drive: data in SI units, filtered rows, their jackknife, and exact simulation.

    M dv/dt = F - offset - Fv v - Fc sign(v);    at rest it stays while |F - offset| <= Fc

Between reversals this is linear: v approaches its final speed exponentially. A sample in which v reaches zero is split
there, and the mass sticks or reverses.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import exp, expm1, log

import numpy as np

from ...core.arrays import Array, Ints
from ...core.display import Displayable
from ...core.errors import IdentError
from ...datasets import Record
from ...datasets.records.record import join_records

MOTION_UNITS = {  # factor to SI, and number of differentiations to a velocity
    "m": (1.0, 1), "mm": (1e-3, 1), "um": (1e-6, 1), "µm": (1e-6, 1), "rad": (1.0, 1), "deg": (np.pi / 180, 1),
    "m/s": (1.0, 0), "mm/s": (1e-3, 0), "m/min": (1 / 60, 0), "mm/min": (1e-3 / 60, 0),
    "rad/s": (1.0, 0), "rpm": (np.pi / 30, 0), "1/min": (np.pi / 30, 0),
}  # fmt: skip
ROTARY = ("rad", "deg", "rad/s", "rpm", "1/min")
FORCE_UNITS = {"N": 1.0, "kN": 1e3, "N m": 1.0, "Nm": 1.0, "N*m": 1.0}
CUTOFF = 0.04  # of the sample rate: decimation by 10, which retains 0.8 of the new Nyquist frequency
HELD = 0.5  # samples by which the mean of a held force is late
FEWEST = 200  # samples of a segment: filter transients would dominate a shorter one


@dataclass(frozen=True, slots=True, repr=False)
class Motion(Displayable):
    """Force and motion at samples.

    Attributes
    ----------
    force, v, a : ndarray, shape (N,)
        N; m/s, low-pass filtered; m/s^2, not filtered. (N m, rad/s and rad/s^2 of a rotary drive.)
    raw : ndarray, shape (N,)
        Unfiltered velocity.
    sample_time, cutoff : float
        s, Hz.
    factor : float or None
        N per unit of the input, if given.
    unit : str
        Of the output as recorded.
    held : bool
        The force is held until the next sample, or measured at the sample.
    stretches : tuple of slice
    notes : tuple of str
    delay : float
        Samples by which the motion follows the force, beyond half a sample of a held force.
    """

    force: Array
    v: Array
    a: Array
    raw: Array
    sample_time: float
    cutoff: float
    factor: float | None
    unit: str
    held: bool
    stretches: tuple[slice, ...]
    notes: tuple[str, ...]
    delay: float = 0.0

    @property
    def lag(self) -> float:
        """Samples from the force to its effect on a second difference, which has two intervals of a held force."""
        return self.delay + HELD * self.held

    @property
    def acting(self) -> Array:
        """Mean force of the interval that follows each sample (N,), N."""
        return np.concatenate([delayed(self.force[s], self.lag - HELD) for s in self.stretches])

    @property
    def speed_unit(self) -> str:
        """rad/s for a rotary drive, otherwise m/s."""
        return "rad/s" if self.unit in ROTARY else "m/s"


@dataclass(frozen=True, slots=True)
class FilteredRows:
    """Filtered rows of F = X theta: X (n, 4) of a, v, sign(v), 1; F (n,) and its change per sample, N; time in s."""

    X: Array
    F: Array
    change: Array
    time: Array
    rate: float
    left_out: int


def motion_of(
    rec: Record | Sequence[Record], factor: float | None, unit: str | None, cutoff: float | None, held: bool
) -> Motion:
    """The record in SI units, its offsets restored: friction depends on the speed, not on its change."""
    rec = rec if isinstance(rec, Record) else join_records(rec)
    gain, size, times = _units(rec, factor, unit)
    rate = rec.rate
    low = CUTOFF * rate if cutoff is None else float(cutoff)
    if not 0 < low < 0.4 * rate:
        raise IdentError(f"cutoff {low:g} Hz of a record at {rate:g} Hz: above zero and below {0.4 * rate:g} Hz.")
    kept = [k for k, s in enumerate(rec.stretches) if s.stop - s.start >= FEWEST]
    if not kept:
        longest = max(s.stop - s.start for s in rec.stretches)
        raise IdentError(f"the longest segment has {longest} samples; a drive needs {FEWEST}. Record longer or faster.")
    assert rec.offsets is not None  # noqa: S101  set by the record
    parts = [
        _of_stretch(
            gain * (rec.u[rec.stretches[k]] + rec.offsets[k, 0]),
            size * (rec.y[rec.stretches[k]] + rec.offsets[k, 1]),
            rec.sample_time, low, times,
        )
        for k in kept
    ]  # fmt: skip
    ends = np.cumsum([0, *(len(part[0]) for part in parts)]).tolist()
    force, v, a, raw = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    if not np.ptp(raw) > 0:
        raise IdentError(f"{rec.output} is constant: the inertia of a drive at rest is not identifiable.")
    left = len(rec.stretches) - len(kept)
    segments = "1 segment" if left == 1 else f"{left} segments"
    notes = (f"{segments} shorter than {FEWEST} samples left out",) if left else ()
    return Motion(
        force, v, a, raw, rec.sample_time, low, factor, unit or rec.unit_y, held,
        tuple(slice(b, e) for b, e in pairwise(ends)), notes,
    )  # fmt: skip


def _units(rec: Record, factor: float | None, unit: str | None) -> tuple[float, float, int]:
    """N per unit of input, SI per unit of output, and number of differentiations to a velocity."""
    if factor is None and rec.unit_u not in FORCE_UNITS:
        raise IdentError(
            f"input {rec.input} is in {rec.unit_u or 'no named unit'!r}: give force= (--force-per-unit), the N (or N "
            "m) of one unit, for instance motor constant times gear ratio for a current. Where another column is the "
            "force, name it as the input."
        )
    if factor is not None and not (np.isfinite(factor) and factor != 0):
        raise IdentError(f"force {factor!r}: N per unit of {rec.input}, not zero.")
    known = unit or rec.unit_y
    if known not in MOTION_UNITS:
        raise IdentError(
            f"output {rec.output} is in {known or 'no named unit'!r}, but a drive needs a position or a speed: name "
            "that column as the output, or give its unit (unit=, or --unit COLUMN=mm), one of "
            f"{', '.join(MOTION_UNITS)}; the inertia scales with it."
        )
    size, times = MOTION_UNITS[known]
    return (FORCE_UNITS[rec.unit_u] if factor is None else float(factor)), size, times


def low_passed(x: Array, dt: float, cutoff: float) -> Array:
    """Zero-phase Butterworth low-pass of order 4 along the first axis."""
    from scipy.signal import butter, sosfiltfilt

    return np.asarray(sosfiltfilt(butter(4, 2 * cutoff * dt, output="sos"), x, axis=0), dtype=np.float64)


def _of_stretch(force: Array, y: Array, dt: float, cutoff: float, times: int) -> tuple[Array, Array, Array, Array]:
    """Force, velocity (filtered), acceleration and velocity by central differences; one-sided at the two ends."""
    v = np.gradient(y, dt) if times else y
    a = np.gradient(v, dt)
    if times:
        a[1:-1] = np.diff(y, 2) / dt**2
    return force, low_passed(v, dt, cutoff), a, v


def rows_of(motion: Motion, slow: float) -> FilteredRows:
    """Filtered columns and force, every k-th row, omitting rows within the filter length of a reversal or an end."""
    dt = motion.sample_time
    k = max(int(0.4 / (motion.cutoff * dt)), 1)
    reach = int(np.ceil(1 / (motion.cutoff * dt)))
    limit = slow * float(np.abs(motion.v).max())
    X, F, change, time, left = [], [], [], [], 0
    for s in motion.stretches:
        v, force = motion.v[s], motion.force[s]
        acting = delayed(force, motion.lag)
        columns = np.column_stack(
            [motion.a[s], motion.raw[s], np.sign(v), np.ones_like(v), acting, np.gradient(acting)]
        )
        smooth = low_passed(columns, dt, motion.cutoff)
        near = np.convolve(np.abs(v) < limit, np.ones(2 * reach + 1), "same") > 0
        near[:reach] = near[-reach:] = True
        at = np.arange(k // 2, len(v), k)
        keep = at[~near[at]]
        left += len(at) - len(keep)
        X.append(smooth[keep, :4])
        F.append(smooth[keep, 4])
        change.append(smooth[keep, 5])
        time.append((s.start + keep) * dt)
    return FilteredRows(
        np.concatenate(X), np.concatenate(F), np.concatenate(change), np.concatenate(time), 1 / (k * dt), left
    )


def delayed(x: Array, samples: float) -> Array:
    """A signal (n,) late by a number of samples, interpolated linearly, constant beyond its ends.

    >>> delayed(np.array([0.0, 2.0, 4.0]), 0.5).tolist()
    [0.0, 1.0, 3.0]
    """
    t = np.arange(len(x), dtype=np.float64)
    return np.interp(t - samples, t, x)


COUNTS = (12, 16, 20, 24)  # of blocks: no movement is in step with all of them


def jackknife(J: Array, e: Array, blocks: Sequence[Ints]) -> Array:
    """Covariance (p, p) of a least-squares estimate with regressors J (N, p) and residuals e (N,).

    Examples
    --------
    >>> e = np.array([1.0, -1.0, 0.5, -0.5])
    >>> jackknife(np.ones((4, 1)), e, [np.array([k]) for k in range(4)]).round(6).item()  # s^2 / n
    0.208333
    """
    scale = np.linalg.norm(J, axis=0)
    J = J / scale
    G = J.T @ J
    moved = np.array([np.linalg.solve(G - J[i].T @ J[i], J[i].T @ e[i]) for i in blocks])
    moved -= moved.mean(axis=0)
    m = len(blocks)
    return np.asarray((m - 1) / m * (moved.T @ moved) / np.outer(scale, scale), dtype=np.float64)


def widest(J: Array, e: Array, time: Array, counts: Sequence[int] = COUNTS) -> Array:
    """Covariance (p, p) with each coefficient's largest standard error over several numbers of blocks.

    Parameters
    ----------
    J, e : ndarray, shape (N, p) and (N,)
    time : ndarray, shape (N,)
        Rising; blocks are equal parts of it.
    counts : sequence of int
        Correlations are those of the last.
    """
    place = (time - time[0]) / ((time[-1] - time[0]) * (1 + 1e-9))
    covs = []
    for count in counts:
        block = np.floor(count * place).astype(int)
        covs.append(jackknife(J, e, [np.flatnonzero(block == b) for b in np.unique(block)]))
    variance = np.array([np.diag(cov) for cov in covs])
    up = np.sqrt(variance.max(axis=0) / np.maximum(variance[-1], np.finfo(float).tiny))
    return covs[-1] * np.outer(up, up)


def velocity_and_travel(
    force: Array, dt: float, M: float, Fv: float, Fc: float, offset: float, v0: float = 0.0
) -> tuple[Array, Array]:
    """Velocity (N,) and displacement (N,) at the samples of ``force`` (N,), each held for ``dt``.

    >>> v, x = velocity_and_travel(np.array([3.0, 3.0, 0.0, 0.0]), 1.0, M=1.0, Fv=0.0, Fc=1.0, offset=0.0)
    >>> v.tolist(), x.tolist()
    ([0.0, 2.0, 4.0, 3.0], [0.0, 1.0, 4.0, 7.5])
    """
    n = len(force)
    speeds, places = np.empty(n), np.empty(n)
    v, x = float(v0), 0.0
    for k, net in enumerate((force - offset).tolist()):
        speeds[k], places[k] = v, x
        v, x = _one_sample(v, x, net, dt, M, Fv, Fc)
    return speeds, places


def _one_sample(v: float, x: float, net: float, dt: float, M: float, Fv: float, Fc: float) -> tuple[float, float]:
    """Velocity and position at the end of a sample."""
    left = dt
    for _ in range(2):  # under a constant force v reaches zero at most once
        if v == 0.0 and abs(net) <= Fc:
            return 0.0, x
        sign = 1.0 if v > 0 or (v == 0.0 and net > 0) else -1.0
        push = net - sign * Fc
        end, moved = _slide(v, push, left, M, Fv)
        if v == 0.0 or end * sign > 0:
            return end, x + moved
        stop = min(_time_to_rest(v, push, M, Fv), left)
        x += _slide(v, push, stop, M, Fv)[1]
        v, left = 0.0, left - stop
    return v, x


def _slide(v: float, push: float, t: float, M: float, Fv: float) -> tuple[float, float]:
    """Velocity and displacement after t under a constant force without reversal; accurate as Fv goes to zero."""
    z = Fv * t / M
    if abs(z) < 1e-5:  # series expansion: the closed form divides by Fv squared
        gain = t * (1 - z / 2 + z * z / 6)
        return v + (push - Fv * v) / M * gain, v * gain + push / M * t * t * (0.5 - z / 6 + z * z / 24)
    gain = -expm1(-z) * M / Fv  # integral of exp(-Fv s / M)
    return v * exp(-z) + push / M * gain, v * gain + push / Fv * (t - gain)


def _time_to_rest(v: float, push: float, M: float, Fv: float) -> float:
    """Time at which v reaches zero."""
    if abs(Fv * v) < 1e-9 * abs(push):
        return -M * v / push
    return M / Fv * log(1 - Fv * v / push)
