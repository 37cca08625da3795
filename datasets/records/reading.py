"""Read a file of samples as a `Record`: sample time from the times, gaps by their length, every assumption noted."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from ...core.arrays import Array, Ints
from ...core.errors import DataError, UsageError
from ...core.rounding import count
from ...core.suggestions import closest
from ..runs import disclaimers
from ..tables import Table
from .columns import ColumnHeader, choose, find, heads, in_unit, is_counter, is_label, time_column, times
from .formats import record_tables
from .gaps import without_short
from .record import Record, join_records
from .sampling import FEWEST, sample_time_of
from .timing import RecordOptions, Samples, timed, untimed

File: TypeAlias = str | os.PathLike[str] | Table
ROLES = ("time", "input", "output")
DEVIATIONS = re.compile("deviation|abweichung", re.IGNORECASE)  # of a note: signals are those from an operating point
PARTIAL = 0.2  # share of rows with one of two signals, beyond which one is sampled more slowly: its rows are the record


def read_record(
    path: File | Sequence[File],
    input: str | int | None = None,  # noqa: A002  the option of the command is --input
    output: str | int | None = None,
    *,
    time: str | int | None = None,
    rate: float | None = None,
    sample_time: float | None = None,
    units: Mapping[str, str] | None = None,
    resample: float | None = None,
    offsets: tuple[float, float] | None = None,
    decimal: Literal["point", "comma"] | None = None,
    delimiter: str | None = None,
    sheet: str | None = None,
    reference: str | int | None = None,
) -> Record:
    r"""Read one or more recorded runs of a machine.

    Columns are named by header, name without unit, number (``3`` or ``col3``) or role of the vocabulary (``I``).
    Empty cells, lost samples, a column named ``run`` or ``stretch``, and each further file begin a new stretch,
    which no model looks across. Assumptions, conversions and omissions are listed in ``notes``.

    Parameters
    ----------
    path : path of a file (text, .xlsx, .lvm, .tdms or .mat), a Table that was read already, or several of these
    input, output : column of each; left out, the first and the second of just two signals
    time : column of times; left out, the one recognised by its header, or the only one that rises evenly
    rate, sample_time : Hz or s, one of them, for a file without times or with too coarse ones
    units : mapping of ``time``, ``input``, ``output`` to a unit, where the file names none, or the wrong one
    resample : Hz to which the samples are brought, through an anti-alias filter where that is slower; uneven
        samples are joined by lines first, and refused without it
    offsets : operating point (input, output) to subtract; none by default (see `Record.centred`)
    reference : column of the set point of the controller, of a record in closed loop
    decimal, delimiter, sheet : see :func:`fitmodels.datasets.read_table`; ``sheet`` also names a group of a .tdms file

    Raises
    ------
    DataError
        The file cannot be read, has text where numbers belong, or is not evenly sampled.
    UsageError
        A column or unit does not exist, or the choice is ambiguous.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp(), "run.csv")
    >>> _ = path.write_text("Zeit [ms];u [V];y [um]\n" + "".join(f"{20 * k};{k % 3};{k / 2}\n" for k in range(12)))
    >>> rec = read_record(path)
    >>> rec.rate, rec.input, rec.unit_y, rec.y[-1].item()
    (50.0, 'u', 'mm', 0.0055)
    """
    asked = RecordOptions(
        input, output, time, sample_time_of(rate, sample_time), units or {}, resample, offsets, reference
    )
    files = [path] if isinstance(path, (str, os.PathLike, Table)) else list(path)
    tables = [
        table
        for file in files
        for table in (
            [file]
            if isinstance(file, Table)
            else record_tables(file, decimal=decimal, delimiter=delimiter, sheet=sheet)
        )
    ]
    if not tables:
        raise UsageError("no file to read; name at least one.")
    records = [_record(table, asked) for table in tables]
    first = records[0]
    for table, other in zip(tables, records, strict=True):
        if (other.input, other.output) != (first.input, first.output):
            raise DataError(
                f"{table.path.name} gives {other.input} and {other.output}, {tables[0].path.name} gives {first.input} "
                f"and {first.output}: runs of one record hold the same signals. Name them with --input and --output."
            )
    return first if len(records) == 1 else join_records(records)


def _record(table: Table, asked: RecordOptions) -> Record:
    """One table as a record."""
    known = heads(table.columns)
    clock = find(known, asked.time, "time") if asked.time is not None else time_column(known)
    r = find(known, asked.reference, "reference") if asked.reference is not None else None
    others = [head for head in known if r is None or head.column.number != r.column.number]
    u, y, presumed = choose(others if asked.input is None or asked.output is None else known, clock, *asked.signals)
    if clock is not None and clock.column.number in {head.column.number for head in (u, y, r) if head is not None}:
        if asked.time is not None:
            raise UsageError(f"--time means column {clock.label}, which is input, output or reference too.")
        clock = None  # named as a signal: a ramp is not the time
    given = _units(asked.units, known, {"time": clock, "input": u, "output": y})
    (u_values, unit_u, u_notes), (y_values, unit_y, y_notes) = in_unit(u, given[1]), in_unit(y, given[2])
    if clock is None and asked.sample_time is None:
        names = ", ".join(repr(c.name) for c in table.columns[:12])
        raise UsageError(
            f"{table.path.name} has no column of times among {names}: give --rate (Hz) or --sample-time (s), or which "
            "column it is with --time."
        )
    r_values = () if r is None else (in_unit(r, None)[0],)
    samples, notes = _samples(table, clock, np.column_stack([u_values, y_values, *r_values]), known)
    if clock is not None:
        record = timed(clock, samples, asked, given[0])
    else:
        record = untimed(samples, asked, asked.sample_time or 0.0)
    said = dict.fromkeys((*disclaimers(table.notes), *filter(DEVIATIONS.search, table.notes)))
    declared = (f"from the file: {note.strip('#;%. ')}" for note in said)
    found = (
        *declared,
        *(text.rstrip(".") for text in table.warnings),
        *presumed,
        *u_notes,
        *y_notes,
        *notes,
        *record.notes,
    )
    checked = (
        *(
            note
            for head, x, unit in zip((u, y), samples.values.T[:2], (unit_u, unit_y), strict=True)
            for note in signal_findings(head.name, x[np.isfinite(x)], unit)
        ),
        *standing_output(y.name, samples.values.T[1], samples.values.T[0], samples.lines),
    )
    record = replace(
        record,
        input=u.name, output=y.name, unit_u=unit_u, unit_y=unit_y,
        source=table.path.name, sha256=table.sha256, notes=(*found, *checked),
    )  # fmt: skip
    record = without_short(record)
    return record.less(*asked.offsets) if asked.offsets is not None else record


def _units(
    units: Mapping[str, str], known: Sequence[ColumnHeader], chosen: Mapping[str, ColumnHeader | None]
) -> list[str | None]:
    """Unit given for time, input and output, under that word or the name of the column."""
    out: dict[str, str] = {}
    for word, unit in units.items():
        role = word
        if word not in ROLES:
            if near := closest(word, ROLES, cutoff=0.6):
                raise UsageError(f"--unit {word}={unit}: did you mean {near}?")
            number = find(known, word, "unit").column.number
            role = {head.column.number: r for r, head in chosen.items() if head}.get(number, "")
        if not role or chosen[role] is None:
            raise UsageError(f"--unit {word}={unit}: that column is not used as {', '.join(ROLES)}.")
        out[role] = unit
    return [out.get(role) for role in ROLES]


def _samples(
    table: Table, clock: ColumnHeader | None, values: Array, known: Sequence[ColumnHeader]
) -> tuple[Samples, list[str]]:
    """Rows with a time and a signal; a row left out makes a gap in the time, and an empty cell one in its signal."""
    time = times(clock)[0] if clock is not None else np.arange(len(values), dtype=np.float64)
    full = np.isfinite(time) & np.isfinite(values).all(axis=1)
    notes = []
    if not full.all():
        first = int(table.lines[np.flatnonzero(~full)[0]])
        notes.append(
            f"{count(int(np.count_nonzero(~full)), 'row lacks', 'rows lack')} a number, the first in line {first}"
        )
    if np.count_nonzero(full) < FEWEST:
        raise DataError(
            f"{table.path.name} has {np.count_nonzero(full)} full rows of time, input and output; a record needs "
            f"{FEWEST} to determine its sample time, and hundreds to identify a machine."
        )
    partial = np.isfinite(time) & np.isfinite(values).any(axis=1)
    keep = partial if np.count_nonzero(partial & ~full) <= PARTIAL * np.count_nonzero(full) else full
    changed = np.zeros(len(values), dtype=bool)
    for head in known:
        if is_label(head) and not is_counter(head):
            labels = head.column.labels()
            changed[1:] |= labels[1:] != labels[:-1]
    runs = np.cumsum(changed)[keep]
    time, values, lines = time[keep], values[keep], table.lines[keep]
    again = np.zeros(len(time), dtype=bool)
    if clock is not None:
        same = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
        again[1:] = (np.diff(time) == 0) & same.all(axis=1) & (np.diff(runs) == 0)
        if np.count_nonzero(again) > 0.2 * len(again):
            again[:] = False  # a time that does not change, not duplicate rows
    if again.any():
        rows = count(int(np.count_nonzero(again)), "row is a duplicate", "rows are duplicates")
        notes.append(f"{rows}, the first in line {lines[again][0]}: kept once")
    places = (np.flatnonzero(keep) - np.cumsum(again))[~again]
    cuts = np.flatnonzero(np.diff(runs[~again])) + 1
    if cuts.size:
        notes.append(f"{cuts.size + 1} runs are distinguished by their labels: each is a separate segment")
    return Samples(time[~again], values[~again], lines[~again], places, cuts), notes


STANDS = 6  # equal samples in succession: fewer are not sought
STANDING_CHANCE = 1e-5  # of such a succession anywhere in the record
MOVES = 0.02  # of its range by which the input moves meanwhile


def standing_output(name: str, y: Array, u: Array, lines: Ints) -> tuple[str, ...]:
    """A note on an output, shape (n,), that stood still once while the input moved, as a sensor that was not read.

    Neighbours of a coarse or settled output are often equal, and then a long succession is no finding.

    >>> t = np.arange(200)
    >>> y = np.where((t > 90) & (t < 101), 0.5, np.sin(t))
    >>> standing_output("y", y, np.sin(t - 1.0), t + 2)
    ('y is 0.5 in 10 successive samples from line 93 on while the input moves: these were probably not measured',)
    """
    known = np.isfinite(y) & np.isfinite(u)
    y, u, lines = y[known], u[known], lines[known]
    first, length = _standing(y)
    inside = 0 < first < len(y) - length
    if not (inside and np.ptp(u[first : first + length]) > MOVES * np.ptp(u)):
        return ()
    return (
        f"{name} is {y[first]:g} in {length} successive samples from line {lines[first]} on while the input moves: "
        "these were probably not measured",
    )


def _standing(y: Array) -> tuple[int, int]:
    """First sample and length of the longest succession of equal samples; 0, 0 where it may come by chance."""
    equal = np.diff(y) == 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], equal, [False]]).astype(int)))
    begins, lengths = edges[::2], edges[1::2] - edges[::2] + 1
    if not begins.size:
        return 0, 0
    k = int(np.argmax(lengths))
    first, length = int(begins[k]), int(lengths[k])
    share = max((np.count_nonzero(equal) - length + 1) / max(len(y) - length, 1), 1 / len(y))
    rare = length >= max(STANDS, 2 * np.delete(lengths, k).max(initial=1))
    return (first, length) if rare and len(y) * share ** (length - 1) < STANDING_CHANCE else (0, 0)


FLAT = 4  # samples in a row at the extreme: fewer come by chance where readings are coarse
STEEP = 4.0  # quanta a sample: a signal that settles at its extreme comes in slower than that
REACH = 6.0  # quanta by which the signal would have passed the extreme, had it gone on for half the flat time
LEVELS = 16  # a signal of no more distinct values switches between levels on purpose


def signal_findings(name: str, values: Array, unit: str = "") -> tuple[str, ...]:
    """Notes on one signal, shape (n,), that is constant or looks clipped.

    >>> signal_findings("u", np.ones(50))
    ('u is constant at 1: without variation it carries no information',)
    """
    low, high = float(values.min()), float(values.max())
    tail = f" {unit}" if unit else ""
    if low == high:
        return (f"{name} is constant at {low:g}{tail}: without variation it carries no information",)
    if _is_staircase(values):
        return ()
    out = []
    for extreme, which in ((high, "largest"), (low, "smallest")):
        places, samples = clipped(values, extreme)
        if places:
            out.append(
                f"{name} looks clipped: {count(places, 'time')} it runs into its {which} value {extreme:g}{tail} "
                f"and stays there, {samples} samples in all; a linear model does not saturate: lower the level or "
                "widen the range"
            )
    return tuple(out)


def clipped(values: Array, extreme: float) -> tuple[int, int]:
    """Number of times that a signal, shape (n,), runs into its extreme value and stays there, and of samples there.

    Coarse readings are constant at the crest of a slow sine, and so is a settled machine. Neither
    comes in with a slope that would have carried it well past the extreme.

    >>> wave = np.sin(np.arange(200) / 5)
    >>> clipped(wave.round(2), 1.0), clipped(np.minimum(wave, 0.7), 0.7)[0]
    ((0, 0), 7)
    """
    sign = 1.0 if extreme >= values.max() else -1.0
    at = np.concatenate([[False], values == extreme, [False]])
    begins, ends = np.flatnonzero(~at[:-1] & at[1:]), np.flatnonzero(at[:-1] & ~at[1:])
    lengths = ends - begins
    steps = np.abs(np.diff(values))
    quantum = float(steps[steps > 1e-9 * np.ptp(values)].min())
    before = np.maximum(begins - 3, 0)
    slope = sign * (extreme - values[before]) / np.maximum(begins - before, 1)
    hit = (lengths >= FLAT) & (begins > 0) & (slope > STEEP * quantum) & (slope * lengths / 2 > REACH * quantum)
    return int(hit.sum()), int(lengths[hit].sum())


def _is_staircase(values: Array) -> bool:
    """Whether a signal steps between levels: few of them, or mostly standing still off its extremes."""
    inner = (values[1:] > values.min()) & (values[1:] < values.max())
    if not inner.any() or np.count_nonzero(np.diff(values)[inner] == 0) > 0.5 * np.count_nonzero(inner):
        return True
    some = values[:: max(1, len(values) // 10_000)]
    return len(np.unique(some)) <= LEVELS and len(np.unique(values)) <= LEVELS
