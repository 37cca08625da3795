"""Records and their cuts -> rows of the plan, by name, time of day or order; durations and loads compared with it."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...core.arrays import Array
from ...core.errors import DataError, UsageError
from ...core.rounding import count, listed
from ...core.suggestions import closest
from ..edges.columns import label_test
from ..headers import parse_header
from ..records.columns import DAY, clock_seconds, heads
from ..tables import Column, Table, read_table
from ..units import canonical, convert, is_unit, same_dimension
from ..vocabulary import ROLES
from .options import ReduceOptions
from .recording import natural

NAMES = (
    "record",
    "file",
    "filename",
    "file name",
    "recording",
    "datei",
    "dateiname",
    "aufzeichnung",
    "fichier",
    "archivo",
)
STARTS = ("start", "start time", "started", "clock", "clock time", "beginn", "startzeit", "uhrzeit", "heure", "hora")
TOLERANCE = 60.0  # s by which a cut may begin before the start that the plan states
AGREE = 0.25  # deviation of a duration from the time in the plan
FEWEST = 8  # rows
VARIED = 1.5  # ratio of the largest to the smallest chip cross-section that moves a load beyond its scatter
RISES = 0.3  # rank correlation of a load with the chip cross-section


@dataclass(frozen=True, slots=True)
class Plan:
    """The table of tests.

    Attributes
    ----------
    table : Table
    edges : tuple of str
        Edge of each row, "" where none is named.
    n : ndarray, shape (rows,), 1/min
        Spindle speed, NaN where it is not known.
    order : tuple of int
        Rows in the order in which they were cut: by a column run, otherwise as they stand.
    """

    table: Table
    edges: tuple[str, ...]
    n: Array
    order: tuple[int, ...]

    def __len__(self) -> int:
        return self.table.n_rows


@dataclass(frozen=True, slots=True)
class Assignment:
    """Assignment of cuts to rows: ``rows`` of each file in order, or None where only the order of all counts."""

    how: str
    rows: dict[str, tuple[int, ...]] | None


def read_plan(path: Path, how: ReduceOptions) -> Plan:
    """The table of tests with edge and spindle speed of each row.

    Raises
    ------
    DataError
        It cannot be read as a table.
    """
    table = read_table(path, is_unit=is_unit, is_label=label_test({}))
    known = {head.role: head for head in reversed(heads(table.columns)) if head.role}
    edges = tuple(str(v) for v in known["edge"].column.labels()) if "edge" in known else ("",) * table.n_rows
    run = known["run"].column.numbers() if "run" in known else None
    order = np.arange(table.n_rows)
    if run is not None and np.isfinite(run).all():
        order = np.argsort(run, kind="stable")
    return Plan(table, edges, _speeds(table, how), tuple(order.tolist()))


def _speeds(table: Table, how: ReduceOptions) -> Array:
    """Spindle speed of each row, 1/min: a column n, a constant, or V and D."""
    n, V, D = (_quantity(table, symbol, how) for symbol in ("n", "V", "D"))
    if n is None and V is not None and D is not None:
        n = 1000 * V / (np.pi * D)
    return np.full(table.n_rows, np.nan) if n is None else n


def _quantity(table: Table, symbol: str, how: ReduceOptions) -> Array | None:
    constant = how.constants.get(symbol)
    return column_values(table, symbol) if constant is None else np.full(table.n_rows, float(constant))


def column_values(table: Table, symbol: str) -> Array | None:
    """Values of a role in its unit, shape (rows,); None where the table has no such numbers."""
    head = next((h for h in heads(table.columns) if h.role == symbol and h.column.is_numeric), None)
    if head is None:
        return None
    unit, target = canonical(head.unit) if head.unit else None, ROLES[symbol].unit
    values = np.asarray(head.column.values, dtype=np.float64)
    return convert(values, unit, target) if unit and same_dimension(unit, target) else values


def assignment(plan: Plan, files: Sequence[Path], join: str | None) -> Assignment:
    """Assignment of the cuts of these files to rows.

    Raises
    ------
    DataError
        A row of the plan has no record, or a record has no row.
    UsageError
        The way asked for is not possible.
    """
    if join in (None, "name"):
        column = _text_column(plan, NAMES)
        if column is not None:
            return _by_column(plan, files, column)
        found = _by_edge(plan, files)
        if found is not None:
            return found
        if join == "name":
            raise UsageError(
                "--join name: the plan has no column 'record', and not every file name contains one edge of the plan: "
                "add a column named record with the file of each row."
            )
    if join == "time" or (join is None and start_times(plan) is not None):
        if start_times(plan) is None:
            raise UsageError("--join time: the plan has no column 'start' of times of day as 12:30:00.")
        return Assignment("time", None)
    by_run = plan.order != tuple(range(len(plan)))
    return Assignment("order (of column run of the plan)" if by_run else "order", None)


def _text_column(plan: Plan, names: Sequence[str]) -> Column | None:
    return next((c for c in plan.table.columns if parse_header(c.name).name.casefold().strip() in names), None)


def _by_column(plan: Plan, files: Sequence[Path], column: Column) -> Assignment:
    places = {key.casefold(): path.name for path in files for key in (path.name, path.stem)}
    rows: dict[str, list[int]] = {path.name: [] for path in files}
    for row, text in enumerate(column.labels()):
        wanted = str(text).strip().replace("\\", "/").rsplit("/", 1)[-1].casefold()
        name = places.get(wanted)
        if name is None:
            near = closest(wanted, list(places))
            hint = f"; did you mean {places[near]}?" if near else ""
            raise DataError(
                f"{plan.table.path.name} line {plan.table.lines[row]}: column {column.name!r} names {text!r}, and the "
                f"folder has no such record{hint} Add the record, or take the row out."
            )
        rows[name].append(row)
    without = [name for name, held in rows.items() if not held]
    if without:
        raise DataError(
            f"{count(len(without), 'record is', 'records are')} not named in column {column.name!r} of "
            f"{plan.table.path.name}: {_listed(without)}. Take them out of the folder, or add their rows."
        )
    return Assignment(f"name (column {column.name!r} of the plan)", {k: tuple(v) for k, v in rows.items()})


def _by_edge(plan: Plan, files: Sequence[Path]) -> Assignment | None:
    """Rows of an edge go to the files whose names contain it, in the order of their further numbers."""
    labels = sorted(set(plan.edges) - {""}, key=len, reverse=True)
    if not labels:
        return None
    of_edge: dict[str, list[Path]] = {label: [] for label in labels}
    for path in files:
        found = [label for label in labels if _contains(path.stem, label)]
        if not found or (len(found) > 1 and not all(_contains(found[0], other) for other in found[1:])):
            return None
        of_edge[found[0]].append(path)
    missing = [label for label, held in of_edge.items() if not held]
    if 2 * len(missing) > len(labels):
        return None  # a date or a test number in the names, not the edge
    if missing:
        raise DataError(
            f"no record's name contains the edge {_listed(natural_sorted(missing))} of {plan.table.path.name}. Add "
            "the records, take the rows out, or name the record of each row in a column 'record'."
        )
    rows: dict[str, tuple[int, ...]] = {}
    for label, held in of_edge.items():
        own = [row for row, edge in enumerate(plan.edges) if edge == label]
        ordered = sorted(held, key=lambda path: natural(path.stem))
        if len(ordered) == 1:
            rows[ordered[0].name] = tuple(own)
        elif len(ordered) == len(own):
            rows |= {path.name: (row,) for path, row in zip(ordered, own, strict=True)}
        else:
            raise DataError(
                f"edge {label}: {len(ordered)} records ({_listed([path.name for path in ordered])}) and {len(own)} "
                f"rows in {plan.table.path.name}. One record a row, or one an edge, is needed; otherwise name the "
                "record of each row in a column 'record'."
            )
    return Assignment("name (edge in the file name, sub-tests in order)", rows)


def _contains(stem: str, label: str) -> bool:
    """Whether a name contains an edge as a word, with or without leading zeros: E2 is in E02, not in E21.

    >>> _contains("run-E02_03", "E2"), _contains("E21", "E2"), _contains("test 7-2", "07")
    (True, False, True)
    """
    plain, wanted = (re.sub(r"(?<!\d)0+(?=\d)", "", text) for text in (stem, label))
    return bool(re.search(rf"(?<![0-9A-Za-z]){re.escape(wanted)}(?![0-9A-Za-z])", plain, flags=re.IGNORECASE))


def natural_sorted(names: Sequence[str]) -> list[str]:
    """Names in natural order, 2 before 10."""
    return sorted(names, key=natural)


def start_times(plan: Plan) -> Array | None:
    """Time of day at which each row starts, shape (rows,), s; None where the plan has no such column."""
    column = _text_column(plan, STARTS)
    if column is None or column.is_numeric:
        return None
    return clock_seconds([str(text) for text in column.values])


def on_days_of(starts: Array, clock: float) -> float:
    """A time of day of a record, s, on that day of the plan on which a row starts nearest to it.

    >>> on_days_of(np.array([86310.0, 86430.0]), 32.0), on_days_of(np.array([3600.0]), 3632.0)
    (86432.0, 3632.0)
    """
    days = clock + DAY * np.arange(int(np.nanmax(starts) // DAY) + 2)
    return float(days[np.nanargmin(np.nanmin(np.abs(days[:, None] - starts), axis=1))])


def clock_doubt(clocks: Sequence[float | None]) -> str:
    """A doubt where records that are joined in the order of their names were not recorded in it; else empty.

    >>> clock_doubt([10.0, 86390.0, 86300.0])[:50], clock_doubt([86300.0, 86390.0, 10.0]), clock_doubt([5.0, None])
    ('the records were not recorded in the order of thei', '', '')
    """
    known = [clock for clock in clocks if clock is not None]
    falls = sum(later < earlier for earlier, later in pairwise(known))
    midnight = falls == 1 and known[-1] < known[0]
    if falls == 0 or midnight or len(known) < len(clocks):
        return ""
    return (
        "the records were not recorded in the order of their names, in which they are joined to the rows: name the "
        "record of each row in a column 'record', or give the plan a column 'start'"
    )


def rows_by_time(starts: Array, begins: Sequence[tuple[str, float]], lines: Sequence[int]) -> list[int]:
    """Row of each cut: the last that starts before it, within a tolerance of one minute.

    Raises
    ------
    DataError
        Two cuts belong to one row, or a cut begins before the first row.
    """
    order = np.argsort(starts, kind="stable")
    out: list[int] = []
    for name, begin in begins:
        place = int(np.searchsorted(starts[order], begin + TOLERANCE, side="right")) - 1
        near = [p for p in (place, place - 1) if p >= 0]
        if not near:
            raise DataError(f"{name}: a cut begins at {_clock(begin)}, before the first row of the plan starts.")
        best = min(near, key=lambda p: abs(float(starts[order][p]) - begin))
        row = int(order[best])
        if row in out:
            raise DataError(
                f"{name}: the cut at {_clock(begin)} and {begins[out.index(row)][0]} at "
                f"{_clock(begins[out.index(row)][1])} both belong to line {lines[row]} of the plan (start "
                f"{_clock(float(starts[row]))}): correct the start times, or name the records in a column 'record'."
            )
        out.append(row)
    return out


def _clock(seconds: float) -> str:
    whole = int(seconds) % 86400
    return f"{whole // 3600:02d}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def count_mismatch(plan: Plan, found: Sequence[tuple[str, int, int]], how: str, notes: Sequence[str] = ()) -> DataError:
    """Refusal that lists cuts and rows of each record; ``found`` holds name, cuts and rows (-1: not known)."""
    wrong = [item for item in found if item[1] != item[2]] or list(found)
    texts = [
        f"{name}: {count(cuts, 'cut')}" + (f", {count(rows, 'row')}" if rows >= 0 else "")
        for name, cuts, rows in wrong[:12]
    ]
    listed = "; ".join(texts)
    more = f" and {len(wrong) - 12} more" if len(wrong) > 12 else ""
    total = sum(cuts for _, cuts, _ in found)
    return DataError(
        f"{total} cuts in {len(found)} records, {len(plan)} rows in {plan.table.path.name}, joined by {how}: {listed}"
        f"{more}. {''.join(f'{note}. ' for note in notes[:3])}Look at the pictures; correct the rows, or the search "
        "for cuts with --shortest, --threshold or --channel."
    )


def _listed(names: Sequence[str]) -> str:
    return listed(names, 8)


def duration_remarks(plan: Plan, durations: Array) -> dict[int, str]:
    """Remark of each row whose cut is shorter or longer than its time in the plan, where the others agree.

    ``durations`` has shape (rows,), s.
    """
    t = column_values(plan.table, "t")
    if t is None or not any(plan.edges):
        return {}
    steps = np.full(len(t), np.nan)
    last: dict[str, float] = {}
    for row, edge in enumerate(plan.edges):
        steps[row] = 60 * (t[row] - last.get(edge, 0.0))
        last[edge] = float(t[row])
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = durations / np.where(steps > 0, steps, np.nan)
    agree = np.abs(ratio - 1) <= AGREE
    if np.count_nonzero(agree) < 0.7 * np.count_nonzero(np.isfinite(ratio)):
        return {}
    return {
        int(row): f"the cut lasts {durations[row]:.3g} s, and t rises by {steps[row]:.3g} s"
        for row in np.flatnonzero(np.isfinite(ratio) & ~agree)
    }


def load_doubts(plan: Plan, loads: Sequence[tuple[str, Array]]) -> list[str]:
    """A doubt where the largest load does not rise with feed times depth: cuts and rows may not correspond.

    ``loads`` holds the symbol and the means, shape (rows,), of each channel.
    """
    factors = [column_values(plan.table, symbol) for symbol in ("f", "fz", "fm", "d", "ae")]
    given = [values for values in factors if values is not None]
    if not given or not loads:
        return []
    section = np.prod(given, axis=0)
    name, load = max(loads, key=lambda item: (item[0] not in ("I", "P", "M"), float(np.nanmedian(np.abs(item[1])))))
    if name in ("P", "I", "M") and (V := column_values(plan.table, "V")) is not None and name != "M":
        section = section * V
    known = np.isfinite(section) & np.isfinite(load) & (section > 0)
    if np.count_nonzero(known) < FEWEST or section[known].max() < VARIED * section[known].min():
        return []
    rank = _rank_correlation(section[known], np.abs(load[known]))
    if rank >= RISES:
        return []
    return [
        f"{name} does not rise with feed and depth (rank correlation {rank:.2f}): check in the pictures and in the "
        "column record that cuts and rows correspond"
    ]


def _rank_correlation(x: Array, y: Array) -> float:
    from scipy.stats import rankdata

    return float(np.corrcoef(rankdata(x), rankdata(y))[0, 1])
