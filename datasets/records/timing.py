"""Rows with or without times -> an even Record: times first, a given rate where they fail, gaps by their length."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Array, Ints, is_positive
from ...core.errors import DataError, UsageError
from ...core.rounding import count
from .columns import ColumnHeader, seconds_in, times
from .gaps import fill_gaps
from .record import Record
from .resampling import GAP, interpolated
from .sampling import TimeAxis, run_starts, time_axis

DELAY_UNCERTAIN = "the delay is uncertain by"  # begins a note on uneven samples that are not much denser than the rate
DENSE = 4.0  # uneven samples in one of the record, beyond which the times between them do not matter
SIGNALS = ("input", "output", "reference")


@dataclass(frozen=True, slots=True)
class RecordOptions:
    """Options of `read_record`: columns, sample time (s), units, rate to resample to (Hz), operating point."""

    input: str | int | None
    output: str | int | None
    time: str | int | None
    sample_time: float | None
    units: Mapping[str, str]
    resample: float | None
    offsets: tuple[float, float] | None
    reference: str | int | None = None

    @property
    def signals(self) -> tuple[str | int | None, str | int | None]:
        """Columns of input and output."""
        return self.input, self.output


@dataclass(frozen=True, slots=True)
class Samples:
    """Rows that hold a time and at least one of both signals.

    Attributes
    ----------
    time : ndarray, shape (n,), in its own unit
    values : ndarray, shape (n, 2), or (n, 3) with a reference
        Input, output and reference; NaN where a cell is empty.
    lines, places : ndarray of int, shape (n,)
        Line in the file, and row counted with those that were left out as gaps.
    cuts : ndarray of int
        Rows that begin a run by their label.
    """

    time: Array
    values: Array
    lines: Ints
    places: Ints
    cuts: Ints


def untimed(samples: Samples, asked: RecordOptions, sample_time: float) -> Record:
    """Rows as evenly spaced samples at the given rate."""
    lost = np.diff(samples.places, prepend=-1) - 1
    lost[[0, *samples.cuts]] = -1
    return _even(samples, TimeAxis(sample_time, np.flatnonzero(lost), lost, 0.0, 0, ()), asked)


def timed(clock: ColumnHeader, samples: Samples, asked: RecordOptions, unit: str | None) -> Record:
    """Rows placed by their times, or by a given rate where the times are not usable."""
    name = f"time {clock.label}" if clock.column.name == f"col{clock.column.number}" else clock.name
    seconds, notes = _scale(clock, samples.time, asked.sample_time, unit)
    try:
        axis = time_axis(samples.time, seconds, name, samples.lines, samples.cuts, asked.sample_time)
    except DataError as refusal:
        if asked.sample_time is not None:
            _agree(float(np.ptp(samples.time)) * seconds / (len(samples.time) - 1), asked.sample_time, name, 0.05)
            even = untimed(samples, asked, asked.sample_time)
            return replace(even, notes=(f"{name} is not used, the rate given is: {refusal}", *even.notes))
        if asked.resample is None:
            raise
        return _uneven(samples, seconds, name, asked.resample, notes)
    if asked.sample_time is not None:
        _agree(axis.sample_time, asked.sample_time, name, 0.01)
        axis = replace(axis, sample_time=asked.sample_time)
    return _even(samples, replace(axis, notes=(*notes, *axis.notes)), asked)


def _scale(
    clock: ColumnHeader, time: Array, sample_time: float | None, unit: str | None
) -> tuple[float, tuple[str, ...]]:
    """Seconds in the unit of the times: given, in the header, what the rate makes of it, or seconds if that is likely.

    A step of 1 or more without a unit may be seconds, milliseconds or a count: it is asked about.
    """
    if unit is not None:
        scale = seconds_in(unit)
        if scale is None:
            raise UsageError(f"--unit time={unit}: that is not a unit of time; known are s, ms, us, min and h.")
        return scale, ()
    scale = times(clock)[1]
    if scale is not None:
        return scale, ()
    rises = np.diff(time)
    step = float(np.median(rises[rises > 0])) if (rises > 0).any() else 0.0
    if sample_time is not None and step:
        for name, scale in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("min", 60.0)):
            if abs(step * scale / sample_time - 1) < 0.01:
                return scale, (f"{clock.label}: times are in {name}, which the rate implies",)
    if step >= 1:
        raise UsageError(
            f"times in column {clock.label} rise by {step:g} and name no unit: {step:g} s or {step:g} ms? "
            "Give --unit time=ms, or --rate (Hz)."
        )
    return 1.0, (f"times in column {clock.label} name no unit: seconds are assumed",)


def _agree(measured: float, given: float, name: str, within: float) -> None:
    if abs(measured / given - 1) > within:
        raise DataError(
            f"{name} gives {measured:.6g} s between samples ({1 / measured:.6g} Hz), --rate gives {given:.6g} s "
            f"({1 / given:.6g} Hz): leave the rate out, or correct the unit with --unit time=..."
        )


def _even(samples: Samples, axis: TimeAxis, asked: RecordOptions) -> Record:
    even = fill_gaps(samples.values, axis.lost, samples.lines, axis.sample_time, SIGNALS[: samples.values.shape[1]])
    u, y, *reference = even.values.T
    record = Record(u, y, axis.sample_time, even.starts, notes=(*axis.notes, *even.notes), reference=_only(reference))
    return record.resampled(asked.resample) if asked.resample is not None else record


def _uncertain(step: float) -> str:
    """Note on the input between uneven samples, a step apart in s."""
    return (
        f"{DELAY_UNCERTAIN} {step / 2:.2g} s beyond its standard error, half of the median step: between uneven "
        "samples the input is not known, and a held command is no straight line. Record at a fixed rate"
    )


def _only(reference: Sequence[Array]) -> Array | None:
    """The reference, if there is one."""
    return reference[0] if reference else None


def _full(samples: Samples) -> Samples:
    """The rows with both signals."""
    keep = np.asarray(np.isfinite(samples.values).all(axis=1))
    begins = np.zeros(len(keep), dtype=np.intp)
    begins[samples.cuts] = 1
    cuts = np.flatnonzero(np.diff(np.cumsum(begins)[keep])) + 1
    return Samples(samples.time[keep], samples.values[keep], samples.lines[keep], samples.places[keep], cuts)


def _uneven(samples: Samples, seconds: float, name: str, rate: float, notes: tuple[str, ...]) -> Record:
    """Uneven samples interpolated linearly at least as densely as they are, then decimated to the rate."""
    if not is_positive(rate):
        raise UsageError(f"--resample {rate!r}: a rate in Hz above zero, for instance 50.")
    samples = _full(samples)
    starts = run_starts(samples.time, samples.cuts, name, samples.lines)
    time = samples.time * seconds
    steps = np.diff(time)
    inside = np.ones(len(steps), dtype=bool)
    inside[starts[1:] - 1] = False
    if (steps[inside] <= 0).any():
        row = int(np.flatnonzero((steps <= 0) & inside)[0])
        raise DataError(f"{name} is the same in lines {samples.lines[row]} and {samples.lines[row + 1]}: correct it.")
    middle = float(np.median(steps[inside]))
    gaps = np.flatnonzero(inside & (steps > GAP * middle)) + 1
    times_denser = max(1, int(np.ceil(1 / (middle * rate) - 1e-6)))
    begins = tuple(np.union1d(starts, gaps).tolist())
    values, begins = interpolated(time, samples.values, begins, rate * times_denser)
    assumptions = (
        f"{name} is not uniform (steps {steps[inside].min():.4g} to {steps[inside].max():.4g} s): samples are "
        f"interpolated linearly at {rate * times_denser:g} Hz",
        *([_uncertain(middle)] if middle * rate * DENSE > 1 else []),
        *([f"{count(gaps.size, 'gap')} of more than {GAP:g} median steps left open"] if gaps.size else []),
    )
    u, y, *reference = values.T
    record = Record(u, y, 1 / (rate * times_denser), begins, notes=(*notes, *assumptions), reference=_only(reference))
    return record.decimated(times_denser) if times_denser > 1 else record
