"""Records of a folder -> figures of each cut, kept record by record so that an interrupted run can continue."""

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import is_positive
from ...core.bounded import sha256_of, stored_json
from ...core.errors import DataError
from ...core.journal import recover, write_files
from ...core.progress import Meter
from ...core.version import __version__
from ..vocabulary import ROLES
from .cuts import CutsFound, find_cuts
from .faults import air_faults, cut_faults
from .joining import Assignment, Plan, assignment, count_mismatch, on_days_of, read_plan, rows_by_time, start_times
from .options import ReduceOptions
from .recording import Recording, read_recordings, record_files
from .statistics import ChannelFigures, channel_figures, peak_window

LOW = 0.2  # deviation of idle levels between records
SIGNIFICANT = 3.0  # standard errors
SHORTEST_WINDOW = 10  # samples
_OF_CUTS = re.compile(r"\bair\b|left out")  # in notes that explain the number of cuts
Speed = Callable[[int, float | None], float | None]


@dataclass(frozen=True, slots=True)
class ReducedCut:
    """Figures of one cut.

    Attributes
    ----------
    begin, duration : float, s
        From the first sample of the record, and from entry to exit.
    clock : float or None, s
        Time of day at which it begins.
    window : tuple of float, s
        The part that the figures are of.
    samples : int
        Of that part.
    peak_of : str
        What each peak is the largest value of: ``revolution``, or a length of time.
    figures : mapping of channel to mapping
        mean, peak, sd, se, idle and drift, in the unit of the channel.
    remarks : tuple of str
    """

    begin: float
    duration: float
    clock: float | None
    window: tuple[float, float]
    samples: int
    peak_of: str
    figures: Mapping[str, Mapping[str, float]]
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ReducedRecord:
    """Cuts of one record, and how they were found.

    Attributes
    ----------
    name, file : str
    rate : float, Hz
    length : float, s
    signal : str
        Channel on which the cuts were found.
    levels : mapping of str to float
        Median of that signal in each state: off, idle, cut.
    cuts : tuple of ReducedCut
    notes : tuple of str
    """

    name: str
    file: str
    rate: float
    length: float
    signal: str
    levels: Mapping[str, float]
    cuts: tuple[ReducedCut, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Reduction:
    """Cuts of all records with their rows of the plan.

    Attributes
    ----------
    records : tuple of ReducedRecord
    plan : Plan
    rows : tuple of int
        Row of the plan of each cut, in the order of the records.
    how : str
        How cuts and rows were joined.
    resumed : int
        Files that an earlier run had reduced.
    """

    records: tuple[ReducedRecord, ...]
    plan: Plan
    rows: tuple[int, ...]
    how: str
    resumed: int


def reduce_folder(
    folder: Path, plan_file: Path, how: ReduceOptions, kept: Path, *, besides: Sequence[Path] = (),
    meter: Meter | None = None,
) -> Reduction:  # fmt: skip
    """Reduce the records of a folder and join their cuts to the rows of a plan.

    Parameters
    ----------
    folder : Path
        Folder of the records, or one record.
    plan_file : Path
        Table of tests, a row a cut.
    how : ReduceOptions
    kept : Path
        Folder of the pictures and of the figures of each record; a record found there unchanged is not read again.
    besides : files in the folder that are no records
    meter : Meter, optional
        Receives progress.

    Raises
    ------
    DataError
        A record cannot be read or contains no cut (all of them are named), or cuts and rows do not correspond.
    """
    recover(kept)
    plan = read_plan(plan_file, how)
    files = record_files(folder, (plan_file, *besides))
    joined = assignment(plan, files, how.join)
    turn = 60 / float(np.nanmin(plan.n)) if np.isfinite(plan.n).any() else 0.0
    if meter is not None:
        meter.expect(len(files))
    records: list[ReducedRecord] = []
    refused: list[DataError] = []
    resumed = 0
    for path in files:
        if meter is not None:
            meter.say(f"reducing {path.name}")
        speed, key_part = _speeds(plan, joined, path, sum(len(r.cuts) for r in records))
        try:
            found, again = _reduced(path, how, turn, speed, key_part, kept)
        except DataError as refusal:
            refused.append(refusal)
            found, again = [], False
        records += found
        resumed += again
        if meter is not None:
            (meter.skip if again else meter.advance)(1)
    refused += _idle_only(records)
    if refused:
        raise _refusal(refused, len(files), kept)
    return Reduction(tuple(records), plan, _rows(plan, joined, records), joined.how, resumed)


def _refusal(refused: Sequence[DataError], files: int, kept: Path) -> DataError:
    if len(refused) == 1:
        return refused[0]
    return DataError(
        f"{len(refused)} of {files} records cannot be reduced: "
        + " ".join(f"({k}) {e}" for k, e in enumerate(refused[:5], 1))
        + (f" The others are kept in {kept}." if len(refused) < files else "")
    )  # fmt: skip


def _idle_only(records: Sequence[ReducedRecord]) -> list[DataError]:
    """Refusals of records in which a spindle starts and stops without a cut: their load is the idle level of others."""
    idles: dict[str, list[float]] = {}
    for record in records:
        if "off" in record.levels:
            idles.setdefault(record.signal, []).append(record.levels["idle"])
    out = []
    for record in records:
        if "off" in record.levels or record.signal not in idles:
            continue
        idle, load = float(np.median(idles[record.signal])), record.levels["cut"]
        if abs(record.levels["idle"]) < LOW * abs(idle) and abs(load - idle) < LOW * abs(idle):
            out.append(
                DataError(
                    f"{record.name} contains no cut: its load, {record.signal} {load:.3g}, is the idle level of the "
                    f"other records, {idle:.3g}. Take it out of the folder, with its row of the plan."
                )
            )
    return out


def _speeds(plan: Plan, joined: Assignment, path: Path, before: int) -> tuple[Speed, str]:
    """Spindle speed of the k-th cut of a file, and what it depends on."""
    n = plan.n
    if joined.rows is not None:
        own = n[list(joined.rows[path.name])]
    elif joined.how != "time":
        own = n[list(plan.order[before:])]
    else:
        starts = start_times(plan)

        def by_clock(k: int, clock: float | None) -> float | None:
            if clock is None or starts is None:
                return None
            return _known(float(n[int(np.nanargmin(np.abs(starts - on_days_of(starts, clock))))]))

        return by_clock, hashlib.sha256(n.tobytes() + starts.tobytes()).hexdigest() if starts is not None else ""
    return lambda k, clock: _known(float(own[k])) if k < len(own) else None, str(own[:1000].tolist())


def _known(n: float) -> float | None:
    return n if is_positive(n) else None


def _rows(plan: Plan, joined: Assignment, records: Sequence[ReducedRecord]) -> tuple[int, ...]:
    """Row of the plan of each cut, in the order of the records."""
    cuts = [(record, cut) for record in records for cut in record.cuts]
    if joined.rows is not None:
        counts = dict.fromkeys(joined.rows, 0)
        for record, _ in cuts:
            counts[record.file] += 1
        found = [(name, counts[name], len(rows)) for name, rows in joined.rows.items()]
        if any(a != b for _, a, b in found):
            raise count_mismatch(plan, found, joined.how, _notes(records))
        return tuple(row for name in dict.fromkeys(record.file for record in records) for row in joined.rows[name])
    if len(cuts) != len(plan):
        raise count_mismatch(
            plan, [(record.name, len(record.cuts), -1) for record in records], joined.how, _notes(records)
        )
    if joined.how != "time":
        return plan.order
    starts = start_times(plan)
    untimed = next((record.name for record, cut in cuts if cut.clock is None), None)
    if untimed is not None or starts is None:
        raise DataError(f"{untimed} has no time of day: give --join order, or name the records in a column 'record'.")
    begins = [(record.name, on_days_of(starts, float(cut.clock or 0.0))) for record, cut in cuts]
    return tuple(rows_by_time(starts, begins, plan.table.lines.tolist()))


def _notes(records: Sequence[ReducedRecord]) -> list[str]:
    return [f"{record.name}: {note}" for record in records for note in record.notes if _OF_CUTS.search(note)]


def _reduced(
    path: Path, how: ReduceOptions, turn: float, speed: Speed, key_part: str, kept: Path
) -> tuple[list[ReducedRecord], bool]:
    """The records of a file, and whether an earlier run had reduced them."""
    key = _key(path, how, turn, key_part)
    store = kept / f"{path.name}.json"
    held = _held(store, key)
    if held is not None:
        return held, True
    records: list[ReducedRecord] = []
    pictures: dict[str, bytes] = {}
    count = 0
    for recording in read_recordings(path, how):
        try:
            found = find_cuts(recording, how, turn)
            record, figures = _record(recording, path.name, found, speed, count)
        except DataError:
            write_files(kept, _picture(recording, None, ()))
            raise
        pictures |= _picture(recording, found, figures)
        records.append(record)
        count += len(record.cuts)
    plain = [asdict(record) for record in records]
    stored = json.dumps({"key": key, "sha256": _digest(plain), "records": plain}, indent=1)
    write_files(kept, {store.name: stored.encode(), **pictures})
    return records, False


def _picture(
    recording: Recording, found: CutsFound | None, figures: Sequence[Mapping[str, ChannelFigures]]
) -> dict[str, bytes]:
    """Name of the file of a record's picture, and its content."""
    from .pictures import record_picture

    name = recording.name.replace(", record ", "-")
    return {f"{name}.png": record_picture(recording, found, figures)}


def _key(path: Path, how: ReduceOptions, turn: float, key_part: str) -> str:
    """Hash of all that the figures of a file depend on."""
    key = json.dumps([__version__, sha256_of(path), asdict(how), turn, key_part], default=dict, sort_keys=True)
    return hashlib.sha256(key.encode()).hexdigest()


def _held(store: Path, key: str) -> list[ReducedRecord] | None:
    """Records of a former run with the same file and options; None where there are none."""
    held = stored_json(store, finite=False)
    if not isinstance(held, dict) or held.get("key") != key or held.get("sha256") != _digest(held.get("records")):
        return None  # of another file, or changed since it was written
    try:
        return [
            ReducedRecord(
                **{**record, "cuts": tuple(_cut_of(cut) for cut in record["cuts"]), "notes": tuple(record["notes"])}
            )
            for record in held["records"]
        ]
    except (KeyError, TypeError, ValueError):
        return None


def _digest(records: object) -> str:
    """SHA-256 of records as JSON has them."""
    return hashlib.sha256(json.dumps(records).encode()).hexdigest()


def _cut_of(held: Mapping[str, Any]) -> ReducedCut:
    a, b = held["window"]
    return ReducedCut(**{**held, "window": (a, b), "remarks": tuple(held["remarks"])})


def _record(
    recording: Recording, file: str, found: CutsFound, speed: Speed, before: int
) -> tuple[ReducedRecord, list[dict[str, ChannelFigures]]]:
    """Figures of every cut of a recording; ``before`` counts the cuts of the file before it."""
    step = recording.sample_time
    cuts, drawn = [], []
    for k, cut in enumerate(found.cuts):
        clock = None if recording.begin is None else recording.begin + cut.span[0] * step
        window, peak_of = peak_window(recording, speed(before + k, clock))
        each = {name: channel_figures(values, cut, window, step) for name, values in recording.channels.items()}
        remarks = air_faults(cut, found.levels)
        samples = cut.window[1] - cut.window[0]
        if samples < SHORTEST_WINDOW:
            remarks.append(f"only {samples} samples between entry and exit")
        for name, figures in each.items():
            remarks += cut_faults(name, recording, cut, figures, window, ROLES[name].unit)
        cuts.append(
            ReducedCut(
                round(cut.span[0] * step, 6), round((cut.span[1] - cut.span[0]) * step, 6), clock,
                (round(cut.window[0] * step, 6), round(cut.window[1] * step, 6)), samples, peak_of,
                {name: _stored(f) for name, f in each.items()}, tuple(remarks),
            )
        )  # fmt: skip
        drawn.append(each)
    if found.signal in recording.channels and not any(_significant(each[found.signal]) for each in drawn):
        raise DataError(
            f"{recording.name} contains no cut that exceeds its noise: the load found on {found.signal} is "
            f"{drawn[0][found.signal].mean:.3g} {ROLES[found.signal].unit}, with a standard error of "
            f"{drawn[0][found.signal].se:.2g}. Does the record begin and end in the air? Look at the picture; take the "
            "record out of the folder, with its row of the plan, or name another channel with --channel."
        )
    record = ReducedRecord(
        recording.name, file, 1 / step, len(recording) * step, found.signal, dict(found.levels), tuple(cuts),
        (*recording.notes, *found.remarks),
    )  # fmt: skip
    return record, drawn


def _significant(figures: ChannelFigures) -> bool:
    return not abs(figures.mean) <= SIGNIFICANT * figures.se


def _stored(figures: ChannelFigures) -> dict[str, float]:
    names = ("mean", "peak", "sd", "se", "idle", "drift")
    return {name: float(getattr(figures, name)) for name in names}
