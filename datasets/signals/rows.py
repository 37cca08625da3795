"""A reduction as the table of tests that the main job reads: the columns of the plan, and figures of each cut."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...core.errors import DataError
from ...core.rounding import count
from ...core.version import __version__
from ..design import round_significant
from ..records.columns import heads
from ..tables import Column
from ..vocabulary import ROLES
from .joining import clock_doubt, duration_remarks, load_doubts
from .options import DRIVEN, LOADS, ReduceOptions
from .reduction import ReducedCut, ReducedRecord, Reduction

DIGITS = 6
OWN = ("samples", "cut duration [s]", "remarks")


def reduced_rows(reduction: Reduction, how: ReduceOptions, folder: Path) -> tuple[pd.DataFrame, list[str], list[str]]:
    """Rows of the plan with the figures of their cuts, the notes of the file, and the remarks of each row.

    Raises
    ------
    DataError
        The plan already has values of a quantity that the records give.
    """
    channels = [
        name for name in LOADS if any(name in cut.figures for record in reduction.records for cut in record.cuts)
    ]
    frame, notes = _of_plan(reduction, channels)
    figures, signs, remarks = _of_cuts(reduction, channels)
    durations = np.zeros(len(reduction.plan))
    for row, (_, cut) in zip(reduction.rows, _cuts(reduction), strict=True):
        durations[row] = cut.duration
    for row, text in duration_remarks(reduction.plan, durations).items():
        remarks[row] = "; ".join(filter(None, (remarks[row], text)))
    means = [(name, figures[f"{name} [{ROLES[name].unit}]"].to_numpy()) for name in channels]
    signs += load_doubts(reduction.plan, means)
    if reduction.how == "order" and (doubt := clock_doubt([cut.clock for _, cut in _cuts(reduction)])):
        signs.append(doubt)
    frame = pd.concat([frame, *_time(reduction), figures], axis=1)
    if doubted := sum(bool(text) for text in remarks):
        frame["remarks"] = remarks
        signs.append(f"remarks on {doubted} of {len(remarks)} rows: see the column remarks, and judge these rows")
    return frame, [*_head(reduction, how, folder), *notes, *signs], remarks


def _of_plan(reduction: Reduction, channels: Sequence[str]) -> tuple[pd.DataFrame, list[str]]:
    """Columns of the plan under their headers with units."""
    table = reduction.plan.table
    notes = [note.lstrip("#% ") for note in table.notes]
    out: dict[str, object] = {}
    for head in heads(table.columns):
        column = head.column
        name = f"{column.name} [{column.unit_cell.strip('[]() ')}]" if column.unit_cell.strip("[]() ") else column.name
        if head.role in channels:
            if column.is_numeric and not np.isfinite(column.values).any():
                continue
            raise DataError(
                f"{table.path.name} has a column {column.name!r} with values, and the records contain {head.role} too: "
                f"take the column out of the plan, or do not read the channel, with --map {head.role}=none."
            )
        if name in (*out, *OWN):
            raise DataError(f"{table.path.name} has a column {name!r}, which the result has too: rename it.")
        out[name] = _cells(column, table.path.name)
    return pd.DataFrame(out), notes


def _cells(column: Column, file: str) -> NDArray[Any]:
    """Cells as they were; texts among numbers are refused."""
    if column.is_numeric and column.bad:
        raise DataError(
            f"{file}, column {column.name!r} contains text among its numbers: {column.bad_cells()}. Write a number, or "
            "leave the cell empty."
        )
    return column.values  # noqa: PD011  a Column, not a Series


def _time(reduction: Reduction) -> list[pd.DataFrame]:
    """Cumulative time in cut of each edge, where the plan has no time but edges."""
    roles = {head.role for head in heads(reduction.plan.table.columns)}
    if "t" in roles or not any(reduction.plan.edges):
        return []
    durations = np.zeros(len(reduction.plan))
    for row, (_, cut) in zip(reduction.rows, _cuts(reduction), strict=True):
        durations[row] = cut.duration / 60
    total = pd.Series(durations).groupby(pd.Series(reduction.plan.edges)).cumsum()
    return [pd.DataFrame({"t [min]": round_significant(total.to_numpy(), DIGITS)})]


def _cuts(reduction: Reduction) -> list[tuple[ReducedRecord, ReducedCut]]:
    return [(record, cut) for record in reduction.records for cut in record.cuts]


def _of_cuts(reduction: Reduction, channels: Sequence[str]) -> tuple[pd.DataFrame, list[str], list[str]]:
    """Figures by row of the plan, notes on reversed signs, and the remarks of each row."""
    n = len(reduction.plan)
    columns: dict[str, NDArray[Any]] = {}
    remarks: list[list[str]] = [[] for _ in range(n)]
    pairs = list(zip(reduction.rows, _cuts(reduction), strict=True))
    for row, (_, cut) in pairs:
        remarks[row] += cut.remarks
    notes = []
    for name in channels:
        held = {key: np.full(n, np.nan) for key in ("mean", "peak", "sd", "idle")}
        for row, (_, cut) in pairs:
            for key, values in held.items():
                values[row] = cut.figures.get(name, {}).get(key, np.nan)
            if name not in cut.figures:
                remarks[row].append(f"{name} is not in the record")
        notes += _signed(name, held, remarks)
        unit = ROLES[name].unit
        columns[f"{name} [{unit}]"] = held["mean"]
        columns[f"{name} peak [{unit}]"] = held["peak"]
        columns[f"{name} sd [{unit}]"] = held["sd"]
        if name in DRIVEN:
            columns[f"{name} idle [{unit}]"] = held["idle"]
    columns = {name: round_significant(values, DIGITS) for name, values in columns.items()}
    by_row = {row: (record, cut) for row, (record, cut) in pairs}
    columns["samples"] = np.array([by_row[row][1].samples for row in range(n)])
    columns["cut duration [s]"] = np.array([by_row[row][1].duration for row in range(n)])
    taken = {column.name for column in reduction.plan.table.columns}
    columns["reduced from" if "record" in taken else "record"] = np.array(
        [by_row[row][0].name for row in range(n)], dtype=object
    )
    return pd.DataFrame(columns), notes, ["; ".join(dict.fromkeys(texts)) for texts in remarks]


def _signed(name: str, held: dict[str, NDArray[Any]], remarks: list[list[str]]) -> list[str]:
    """Reverse a channel that is negative in every cut, in place; name the cuts where only some are."""
    negative = held["mean"] < 0
    if not negative.any():
        return []
    if negative.sum() == np.isfinite(held["mean"]).sum():
        held["mean"], held["peak"] = -held["mean"], -held["peak"]
        return [f"{name} is negative in every cut: its sign is reversed"]
    for row in np.flatnonzero(negative):
        remarks[row].append(f"{name} is negative, in other cuts positive: sign kept")
    return [
        f"{name} is negative in {int(negative.sum())} of {len(negative)} cuts: signs are kept, a power law needs one"
    ]


def _head(reduction: Reduction, how: ReduceOptions, folder: Path) -> list[str]:
    """Notes on source and settings."""
    records = reduction.records
    signals = sorted({record.signal for record in records})
    peaks = sorted({cut.peak_of for record in records for cut in record.cuts})
    rates = sorted({float(f"{record.rate:.6g}") for record in records})
    kinds = [name for name in DRIVEN if any(name in cut.figures for record in records for cut in record.cuts)]
    lines = [
        f"reduced by fitmodels {__version__} from {count(len(records), 'record')} of {folder.name or folder}, a row a "
        f"cut, joined to {reduction.plan.table.path.name} by {reduction.how}",
        f"sampled at {', '.join(f'{rate:g}' for rate in rates[:6])} Hz; cuts found on {', '.join(signals)}; shortest "
        f"cut {how.shortest:g} s, threshold {how.threshold:g} of the largest load",
        f"mean, sd: between entry and exit, a further {100 * how.guard:g} % left out at each end, less the line "
        "through the air before and after",
        "peak: mean of the largest values of each " + " or ".join(_window(kind) for kind in peaks),
    ]
    if kinds:
        lines.append(f"{', '.join(kinds)}: less the idle level, which stands in its own column")
    if "t" not in {head.role for head in heads(reduction.plan.table.columns)} and any(reduction.plan.edges):
        lines.append("t: sum of the durations of the cuts of each edge, with entry and exit")
    return lines


def _window(kind: str) -> str:
    return (
        kind if kind == "revolution" else f"window of {kind}, the spindle speed being unknown or too high for the rate"
    )
