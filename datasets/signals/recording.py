"""Records of forces, power or current: channels on one even time base, lost samples as NaN."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Array
from ...core.errors import DataError, UsageError
from ..records.columns import ColumnHeader, find, heads, in_unit, only_numbers, seconds_in, time_column, times
from ..records.formats import record_tables
from ..tables import Table
from ..tables.workbook import TEXTS
from ..units import canonical, convert, same_dimension
from ..vocabulary import ROLES
from .options import LOADS, ReduceOptions

SUFFIXES = (*TEXTS, ".lvm", ".tdms", ".mat", ".xlsx")
FEWEST = 20  # samples of a record
EVEN = 0.05  # deviation from even times, in steps: no interpolation is needed
LOST = 5.0  # steps without a sample: a gap, not uneven sampling
MOST_LOST = 0.5  # share of the record that may be lost
UNEVEN = 5.0  # ratio of the 99th to the first percentile of the steps


@dataclass(frozen=True, slots=True)
class Recording:
    """Channels of one record at even times.

    Attributes
    ----------
    name : str
        File name, with the group where a file contains several records.
    sample_time : float, s
    channels : mapping of role to ndarray, shape (n,)
        In the unit of the role; NaN where a sample is lost.
    begin : float or None, s
        Time of day of the first sample, where the file contains it.
    notes : tuple of str
    """

    name: str
    sample_time: float
    channels: Mapping[str, Array]
    begin: float | None
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return len(next(iter(self.channels.values())))


def record_files(folder: Path, besides: Sequence[Path] = ()) -> list[Path]:
    """Files of records in a folder in natural order (2 before 10); not hidden ones and not ``besides``.

    Raises
    ------
    UsageError
        There is no such folder, or no record in it.
    """
    if folder.is_file():
        return [folder]
    if not folder.is_dir():
        raise UsageError(f"{folder}: there is no such folder; give the folder of the records.")
    left_out = {os.path.realpath(path) for path in besides}
    files = [
        path
        for path in folder.iterdir()
        if path.suffix.lower() in SUFFIXES and not path.name.startswith(".") and os.path.realpath(path) not in left_out
    ]
    if not files:
        raise UsageError(f"{folder} contains no record: the types read are {', '.join(SUFFIXES)}.")
    return sorted(files, key=lambda path: natural(path.name))


def natural(name: str) -> tuple[tuple[int, int, str], ...]:
    """Sorting key that counts: 2 before 10.

    >>> sorted(["E10", "E2"], key=natural)
    ['E2', 'E10']
    >>> natural("²3")
    ((1, 0, '²'), (0, 3, ''))
    """
    import re

    parts = re.split(r"(\d+)", name.casefold())
    return tuple((0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts if part)


def read_recordings(path: Path, how: ReduceOptions) -> list[Recording]:
    """The records of a file: one, or one a group or segment.

    Raises
    ------
    DataError
        The file cannot be read, contains no channel, or its times cannot be used; the message names the file.
    UsageError
        An option does not go with the file.
    """
    try:
        tables = record_tables(path, decimal=how.decimal, delimiter=how.delimiter, sheet=how.sheet)
        several = len(tables) > 1
        return [
            _recording(table, f"{path.name}, record {k}" if several else path.name, how)
            for k, table in enumerate(tables, start=1)
        ]
    except (DataError, UsageError) as error:
        text = str(error)
        if path.name not in text:
            error.args = (f"{path.name}: {text}",)
        raise


def _recording(table: Table, name: str, how: ReduceOptions) -> Recording:
    known = heads(table.columns)
    clock = find(known, how.map["time"], "map time") if "time" in how.map else _clock(known)
    chosen, notes = _channels(known, clock, how, name)
    values = {}
    for symbol, head in chosen.items():
        values[symbol], more = _values(symbol, head, how)
        notes += more
    if clock is None:
        if how.rate is None:
            raise UsageError(
                f"{name} has no column of times among {', '.join(h.label for h in known[:12])}: give --rate (Hz), or "
                "the column with --map time=COLUMN."
            )
        step, begin = 1 / how.rate, None
    else:
        step, begin, values, more = _even(clock, values, how)
        notes += more
    if len(next(iter(values.values()))) < FEWEST:
        raise DataError(f"{name} has {len(next(iter(values.values())))} samples; a cut needs {FEWEST} or more.")
    return Recording(name, step, values, begin, tuple(notes))


def _clock(known: Sequence[ColumnHeader]) -> ColumnHeader | None:
    """The column of times, which is no load."""
    return time_column([head for head in known if head.role not in LOADS])


def _channels(
    known: Sequence[ColumnHeader], clock: ColumnHeader | None, how: ReduceOptions, name: str
) -> tuple[dict[str, ColumnHeader], list[str]]:
    """Column of each load: as mapped, otherwise by its header."""
    chosen: dict[str, ColumnHeader] = {}
    for symbol, wanted in how.map.items():
        if symbol != "time" and wanted.strip().lower() != "none":
            chosen[symbol] = find(known, wanted, f"map {symbol}")
    taken = {head.column.number for head in chosen.values()} | ({clock.column.number} if clock else set())
    others = []
    for head in known:
        if head.column.number in taken or not head.column.is_numeric:
            continue
        if head.role not in LOADS or head.role in how.map:
            others.append(head.name)
            continue
        if head.role in chosen:
            first = chosen[head.role].column
            raise UsageError(
                f"{name}: columns {first.number} ({first.name!r}) and {head.label} are both {head.role}: choose one "
                f"with --map {head.role}=col{first.number} or --map {head.role}=col{head.column.number}."
            )
        chosen[head.role] = head
    if not chosen:
        raise DataError(
            f"{name} has no column of a force, a torque, power or current among "
            f"{', '.join(head.label for head in known[:12])}: name it with --map, as --map Fc=col2, "
            "or take the file out of the folder."
        )
    return chosen, [f"not read: {', '.join(others)}"] if others else []


def _values(symbol: str, head: ColumnHeader, how: ReduceOptions) -> tuple[Array, list[str]]:
    """Values in the unit of the role, shape (n,), and what was assumed."""
    role = ROLES[symbol]
    if symbol in how.scales:
        only_numbers(head)
        factor = how.scales[symbol]
        return head.column.values * factor, [f"{symbol} is {factor:g} {role.unit} times {head.label}"]
    given = how.units.get(symbol)
    written = canonical(given or head.unit) if given or head.unit else None
    if (given or head.unit) and (written is None or not same_dimension(written, role.unit)):
        raise DataError(
            f"column {head.label} is in {given or head.unit}, and {role.quantity} {symbol} in {role.unit}: give its "
            f"unit with --unit {symbol}={role.unit}, its sensitivity with --scale {symbol}=200 ({role.unit} per "
            f"{given or head.unit}), or leave it out with --map {symbol}=none."
        )
    if written is None:
        only_numbers(head)
        return head.column.values, [f"{symbol}: the unit {role.unit} is assumed, the record names none"]
    values, unit, notes = in_unit(head, given)
    if unit != role.unit:
        values = convert(np.asarray(values, dtype=np.float64), unit, role.unit)
    return values, list(notes)


def _even(
    clock: ColumnHeader, values: dict[str, Array], how: ReduceOptions
) -> tuple[float, float | None, dict[str, Array], list[str]]:
    """Sample time, time of day of the first sample, channels at even times, and notes on what that took."""
    time, scale = times(clock)
    notes = []
    if (given := how.units.get("time")) is not None:
        scale = seconds_in(given)
        if scale is None:
            raise UsageError(f"--unit time={given}: that is not a unit of time; known are s, ms, us, min and h.")
    if scale is None:
        scale = _unnamed_scale(clock, time, how.rate)
        notes.append(f"{clock.label} names no unit: {'s' if scale == 1 else f'{scale:g} s'} is assumed")
    begin = float(time[0] * scale) if not clock.column.is_numeric else None
    time = time * scale
    keep = np.isfinite(time)
    if not keep.all():
        notes.append(f"{np.count_nonzero(~keep)} rows without a time are left out")
        time, values = time[keep], {symbol: v[keep] for symbol, v in values.items()}
    if how.rate is not None:
        return 1 / how.rate, begin, values, [*notes, "times are not used: the rate is given"]
    step, more, values = _on_grid(time, values, clock.label)
    return step, begin, values, [*notes, *more]


def _unnamed_scale(clock: ColumnHeader, time: Array, rate: float | None) -> float:
    rises = np.diff(time[:10_000])
    step = float(np.median(rises[rises > 0])) if (rises > 0).any() else 0.0
    if step >= 1 and rate is None:
        raise UsageError(
            f"times in column {clock.label} rise by {step:g} and name no unit: {step:g} s or {step:g} ms? "
            "Give --unit time=ms, or --rate (Hz)."
        )
    return 1.0


def _on_grid(time: Array, values: dict[str, Array], name: str) -> tuple[float, list[str], dict[str, Array]]:
    """Sample time, notes, and channels at even times: gaps as NaN, moderate jitter by interpolation."""
    steps = np.diff(time)
    if len(time) < FEWEST:
        raise DataError(f"{len(time)} samples with a time; a cut needs {FEWEST} or more.")
    if (steps < 0).any():
        row = int(np.flatnonzero(steps < 0)[0]) + 1
        raise DataError(
            f"{name} falls from {time[row - 1]:g} to {time[row]:g} s in sample {row + 1}: one record a file. Split the "
            "file where it starts again, or give --rate (Hz) if each row is a sample."
        )
    mean = float(time[-1] - time[0]) / (len(time) - 1)
    if mean <= 0:
        raise DataError(f"{name} does not change: give --rate (Hz).")
    off = float(np.abs(time - (time[0] + mean * np.arange(len(time)))).max())
    if off <= EVEN * mean:
        return _nominal(mean), [], values
    same = float(np.mean(steps == 0))
    if same > 0.2:
        quantum = float(np.median(steps[steps > 0]))
        if off > 1.5 * quantum:
            raise DataError(
                f"{name} is written in steps of {quantum:g} s, coarser than the samples, and is not even: give --rate "
                "(Hz), or export more digits."
            )
        return (
            mean,
            [f"{name} is written in steps of {quantum:g} s: samples are taken as even at {1 / mean:.6g} Hz"],
            values,
        )
    return _interpolated(time, steps, values, name)


def _interpolated(
    time: Array, steps: Array, values: dict[str, Array], name: str
) -> tuple[float, list[str], dict[str, Array]]:
    """Samples joined by lines at the median step; NaN where none was taken for five steps."""
    step = _nominal(float(np.median(steps)))
    gaps = np.flatnonzero(steps > LOST * step)
    inner = np.delete(steps, gaps)
    low, high = np.percentile(inner, [1, 99])
    if high > UNEVEN * max(low, 1e-12):
        raise DataError(
            f"{name} is not uniform: its steps range from {low:.4g} to {high:.4g} s, median {step:.4g}. Record at a "
            "fixed rate, or give --rate (Hz) if each row is a sample."
        )
    lost = float(steps[gaps].sum())
    if lost > MOST_LOST * float(time[-1] - time[0]):
        raise DataError(
            f"{name} has {gaps.size} gaps of {lost:.3g} s in all, more than half of the record: several records in one "
            "file? Split it."
        )
    grid = time[0] + step * np.arange(int((time[-1] - time[0]) / step + 1.0 + 1e-6))
    missing = np.zeros(len(grid), dtype=bool)
    for gap in gaps:
        first, last = np.searchsorted(grid, [time[gap] + 0.5 * step, time[gap + 1] - 0.5 * step])
        missing[first:last] = True
    out = {}
    for symbol, column in values.items():
        out[symbol] = np.interp(grid, time, column)
        out[symbol][missing] = np.nan
    notes = [f"{gaps.size} gaps, {lost:.3g} s without samples"] if gaps.size else []
    if high - low > 2 * EVEN * step:
        notes.append(f"sampling is not uniform ({low:.4g} to {high:.4g} s): interpolated at {step:.4g} s")
    return step, notes, out


def _nominal(step: float) -> float:
    """The step, or the one of the whole number of hertz within 0.01 %.

    >>> _nominal(0.00099999999)
    0.001
    """
    rate = round(1 / step)
    return 1 / rate if rate and abs(rate * step - 1) < 1e-4 else step
