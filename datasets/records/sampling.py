"""The time axis of a record: its step, how even it is, and where it breaks off.

A discrete-time model ignores the time between samples. A sample late by ``e`` has the error ``e dy/dt``: for a sine
sampled ten times a period, a scatter of the steps of 1 % (rms) is an error of 0.6 % of its amplitude, as sensor
noise at 44 dB would be. Up to there a record counts as evenly sampled.
"""

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array, Flags, Ints, is_positive
from ...core.errors import DataError, UsageError
from ...core.rounding import count

EVEN = 0.01  # rms scatter of the steps, as a share of the step: see above
REGULAR = 0.1  # a step this far from the sample time, or from a whole number of them, is no regular one
FEW = 0.01  # share of steps that may fall out of the beat, each a break, before the whole is called uneven
COARSE = 0.5  # times written more coarsely than this share of the step do not distinguish rounding from lost samples
FEWEST = 10  # rows; the step of fewer is not reliable


@dataclass(frozen=True, slots=True)
class TimeAxis:
    """Sample time and breaks of a column of times.

    Attributes
    ----------
    sample_time : float, s
    starts : ndarray of int, shape (stretches,)
        First row of each stretch.
    lost : ndarray of int, shape (rows,)
        Samples lost before each row; -1 where a run begins, or the step is not a whole number of samples.
    jitter : float
        Largest deviation of a regular step, as a share of the sample time.
    missing : int
        Samples that were lost, where the time goes on by a whole number of steps.
    notes : tuple of str
    """

    sample_time: float
    starts: Ints
    lost: Ints
    jitter: float
    missing: int
    notes: tuple[str, ...]


def resolution(time: Array) -> float:
    """The decimal place to which times, shape (n,), are written; 0.0 when they are finer than a thousandth of a step.

    >>> resolution(np.array([0.0, 0.01, 0.03, 0.04]))
    0.01
    """
    since = time - time[0]
    step = float(np.median(np.abs(np.diff(time)))) or float(np.ptp(time))
    digits = 4 * float(
        np.spacing(np.abs(time).max())
    )  # what a float keeps of a date in seconds is a fifth of a microsecond
    for place in range(12):
        scaled = since * 10.0**place
        if 10.0**-place < 0.001 * step or np.abs(scaled).max() > 1e12:
            break
        if np.abs(scaled - np.rint(scaled)).max() < 1e-6 + digits * 10.0**place:
            return float(10.0**-place)
    return 0.0


def nominal(value: float, slack: float) -> float:
    """The shortest decimal number within ``slack`` of a sample time (or the sample time of such a rate).

    >>> nominal(0.0010000000003, 1e-9), nominal(1 / 120, 1e-9) * 120
    (0.001, 1.0)
    """
    for digits in range(12):
        for rounded in (float(f"{value:.{digits}e}"), 1 / float(f"{1 / value:.{digits}e}")):
            if abs(rounded - value) <= max(slack, 1e-12 * value):
                return rounded
    return value


def run_starts(time: Array, cuts: Ints, name: str, lines: Ints) -> Ints:
    """First row of each run: row 0, ``cuts``, and where the time falls back to the start of the run.

    Raises
    ------
    DataError
        The time falls otherwise.

    >>> run_starts(np.array([0.0, 1.0, 2.0, 0.0, 1.0]), np.array([], int), "t", np.arange(5)).tolist()
    [0, 3]
    """
    steps = np.diff(time)
    falls = np.flatnonzero(steps < 0) + 1
    if 2 * falls.size > steps.size:
        raise DataError(
            f"{name} falls from row to row, from {time[0]:g} to {time[-1]:g}: the newest sample is first. "
            "Sort the rows by time."
        )
    starts = np.union1d(np.array([0], dtype=np.intp), cuts)
    rises = steps[steps > 0]
    step = float(np.median(rises)) if rises.size else 0.0
    restarts: list[int] = []
    for row in np.setdiff1d(falls, starts):
        begin = max(int(starts[np.searchsorted(starts, row) - 1]), restarts[-1] if restarts else 0)
        if time[row] > time[begin] + step:
            raise DataError(
                f"{name} falls from {time[row - 1]:g} to {time[row]:g} in line {lines[row]}, and not back to the start "
                "of a run: sort the rows by time, or mark the runs in a column named run."
            )
        restarts.append(int(row))
    return np.union1d(starts, np.array(restarts, dtype=np.intp))


def time_axis(
    time: Array, seconds: float, name: str, lines: Ints, cuts: Ints, expected: float | None = None
) -> TimeAxis:
    """Measure the sample time and find the breaks.

    Parameters
    ----------
    time : ndarray, shape (n,), finite
    seconds : float
        Seconds in the unit of ``time``.
    name : str
        Name of the column in messages.
    lines : ndarray of int, shape (n,)
        Line of each row in the file.
    cuts : ndarray of int
        Rows that begin a run for another reason.
    expected : float, optional, s
        Sample time that is known: it distinguishes lost samples from coarse times.

    Raises
    ------
    DataError
        Too few rows, times that fall or repeat, or steps too uneven for a model of samples.

    >>> axis = time_axis(np.array([0, 10, 20, 30, 60, 70, 80, 90, 100, 110.0]), 1e-3, "t", np.arange(10), np.array([]))
    >>> axis.sample_time, axis.starts.tolist(), axis.missing
    (0.01, [0, 4], 2)
    """
    if len(time) < FEWEST:
        raise DataError(f"{len(time)} rows of numbers: the step of fewer than {FEWEST} samples cannot be determined.")
    starts = run_starts(time, cuts.astype(np.intp), name, lines)
    inside = np.ones(len(time) - 1, dtype=bool)
    inside[starts[1:] - 1] = False
    steps = np.diff(time)
    if not inside.any():
        raise DataError(f"{name}: every row is a separate run, so there is no step to measure.")
    _refuse_repeats(steps, inside, name, lines)
    place = resolution(time)
    T, single = _step(steps[inside], place, name, None if expected is None else expected / seconds)
    off = np.abs(steps / T - np.rint(steps / T))
    loose = np.maximum(REGULAR, 1.01 * place / T if place < COARSE * T else 0.0)
    regular = np.zeros_like(inside)
    regular[inside] = single
    lost = inside & ~regular & (off <= loose) & (np.rint(steps / T) > 1)
    stray = inside & ~regular & ~lost
    deviation = np.abs(steps[regular] / T - 1)
    worst = float(deviation.max(initial=0.0))
    rounded = EVEN / 10 < worst <= 1.01 * place / T <= 1.01 * COARSE
    scatter = float(np.sqrt(np.mean(deviation**2)))
    if np.count_nonzero(stray) > FEW * np.count_nonzero(inside) or (scatter > EVEN and not rounded):
        raise DataError(_uneven(steps[inside] * seconds, name))
    T = nominal(T * seconds, (place if rounded else worst * T) * seconds / np.count_nonzero(regular))
    before = np.full(len(time), -1)
    before[1:] = np.where(lost, np.rint(steps * seconds / T) - 1, np.where(inside & ~stray, 0, -1))
    missing = int(before[1:][lost].sum())
    notes = [_step_note(name, T, worst, place * seconds if rounded else 0.0)]
    notes += _break_notes(name, lines, lost, stray, missing, len(starts) - 1 - len(cuts))
    return TimeAxis(T, np.flatnonzero(before), before, worst, missing, tuple(notes))


def _refuse_repeats(steps: Array, inside: Flags, name: str, lines: Ints) -> None:
    same = np.flatnonzero((steps == 0) & inside)
    if same.size > 0.2 * steps.size:
        raise DataError(
            f"{name} does not change in {same.size} of {steps.size} steps: it is written too coarsely for the sample "
            "time. Give --rate (Hz) instead, or export more digits."
        )
    if same.size:
        raise DataError(
            f"{name} is the same in lines {lines[same[0]]} and {lines[same[0] + 1]}, with other values "
            f"({same.size} such pairs): correct the times, or give --rate (Hz) if each row is a sample."
        )


def _step(steps: Array, place: float, name: str, expected: float | None) -> tuple[float, Flags]:
    """Mean of the steps of one sample, and which they are; the median alone would be wrong for rounded times."""
    T = expected or float(np.median(steps))
    whole = np.abs(steps / T - np.rint(steps / T)) < EVEN
    if expected is None and place > COARSE * T and np.count_nonzero(whole & (steps > 1.5 * T)) > 0.05 * steps.size:
        raise DataError(
            f"{name} is written in steps of {place:g}, no finer than its samples: whether some are lost cannot be "
            "determined. Give --rate (Hz) instead, or export more digits."
        )
    for _ in range(2):
        width = max(REGULAR * T, 1.01 * place if place <= COARSE * T else 0.0)
        single = np.abs(steps - T) <= width
        if not single.any():
            raise DataError(_uneven(steps, name))
        T = float(steps[single].mean())
    return T, single


def _uneven(steps: Array, name: str) -> str:
    low, middle, high = np.percentile(steps, [1, 50, 99])
    return (
        f"{name} is not uniform: its steps range from {low:.4g} to {high:.4g}, median {middle:.4g}, but a "
        "discrete model needs one step. Record at a fixed rate, or give --resample (Hz) to interpolate."
    )


def _step_note(name: str, T: float, worst: float, place: float) -> str:
    rate = f"{name}: sampled every {T:.6g} s ({1 / T:.6g} Hz)"
    if place:
        return f"{rate}, uniform within the {place:g} s resolution of the times"
    return (
        f"{rate}; the steps differ from that by {100 * worst:.2g} % at most" if worst > 1e-6 else f"{rate}, uniformly"
    )


def _break_notes(name: str, lines: Ints, lost: Flags, stray: Flags, missing: int, restarts: int) -> list[str]:
    notes = []
    if restarts > 0:
        notes.append(f"{name} starts again {count(restarts, 'time')}: each is a separate run")
    for places, what, then in (
        (lost, f"{count(missing, 'sample is', 'samples are')} missing", ""),
        (stray, "the step is not a whole number of samples", ": a new segment begins after each"),
    ):
        rows = np.flatnonzero(places) + 1
        if rows.size:
            shown = ", ".join(str(lines[row]) for row in rows[:3]) + (", ..." if rows.size > 3 else "")
            notes.append(f"{what}, in {count(rows.size, 'place')} (line {shown}){then}")
    return notes


def sample_time_of(rate: float | None, sample_time: float | None) -> float | None:
    """Seconds, from a rate in Hz or a sample time in s.

    >>> sample_time_of(50.0, None)
    0.02
    """
    if rate is not None and sample_time is not None and not np.isclose(rate * sample_time, 1.0, rtol=1e-6):
        raise UsageError(f"rate {rate:g} Hz and sample_time {sample_time:g} s do not agree: give one of them.")
    for option, value in (("rate", rate), ("sample_time", sample_time)):
        if value is not None and not is_positive(value):
            raise UsageError(f"{option} {value!r}: it must be above zero, for instance a rate of 50 Hz.")
    return 1.0 / rate if rate is not None else sample_time
