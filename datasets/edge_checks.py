"""Contradictions within cutting edges: settings that change, time or wear that falls, single cells that stand out."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.rounding import format_plain
from .doubts import Doubt
from .draft import Draft
from .edge_columns import Array, Codes, Flags, differs
from .merged_cells import lines_text
from .vocabulary import ROLES

MOST_ROWS = 100_000  # of a table whose edges are checked cell by cell
FEW = 0.3  # share of the edges above which something is a property of the tests, not a slip
JUMP = 3.0  # factor of a cell against its neighbours above which a digit or decimal mark may have slipped
STEADY = 1.5  # factor between two neighbours of which a third cell is judged
FALL = 0.8  # of the wear before
SPREADS = 4.0  # robust standard deviations of the steps of wear that a fall must exceed
LATE = 5.0  # times the largest other step of time in its edge
FACTORS = ((25.4, "in and mm"), (60.0, "min and s"), (3.2808, "m and ft"), (10.0, ""), (100.0, ""), (1000.0, ""))
SLIPPED = "a digit or decimal mark may have slipped"
LISTED = 3  # cells that a sentence names


@dataclass(frozen=True, slots=True)
class _Edges:
    """Rows by edge, in the order of the file.

    Attributes
    ----------
    order : ndarray of int, shape (n,)
        Rows sorted by edge.
    same : ndarray of bool, shape (n - 1,)
        Whether a sorted row is of the edge of the one before.
    codes : ndarray of int, shape (n,)
        Edge of each row of the file.
    several : int
        Number of edges of two rows or more.
    """

    order: NDArray[np.intp]
    same: Flags
    codes: Codes
    several: int


def check_edges(draft: Draft) -> None:
    """Add a doubt for each contradiction within the edges of a draft, and for rows that occur twice."""
    if len(draft.lines) > MOST_ROWS or len(draft.lines) < 3:
        return
    numbers = draft.numbers()
    copies = _copies(draft, numbers)
    draft.doubts += _of_copies(draft, copies)
    if "edge" not in draft.data:
        return
    edges = _edges(draft)
    if edges.several == 0:
        return
    for role, values in numbers.items():
        if ROLES[role].kind == "condition":
            draft.doubts += _of_setting(draft, edges, role, values)
    if "t" in numbers:
        draft.doubts += _of_time(draft, edges, numbers["t"], copies)
    for role, values in numbers.items():
        if ROLES[role].kind in ("wear", "load", "surface"):
            draft.doubts += _of_response(draft, edges, role, values, numbers.get("t"))


def _edges(draft: Draft) -> _Edges:
    codes = pd.factorize(np.asarray(draft.data["edge"]))[0].astype(np.intp)
    for role in ("tool", "work"):
        if role in draft.data:
            label = pd.factorize(np.asarray(draft.data[role]))[0]
            codes = np.unique(codes * (int(label.max()) + 2) + label + 1, return_inverse=True)[1]
    order = np.argsort(codes, kind="stable")
    same = np.asarray(codes[order][1:] == codes[order][:-1])
    several = int((same & np.concatenate([[True], ~same[:-1]])).sum())
    return _Edges(order, same, codes, several)


def _copies(draft: Draft, numbers: dict[str, Array]) -> Flags:
    """Rows all of whose cells stand in a row before."""
    n = len(draft.lines)
    copy = np.zeros(n, dtype=bool)
    if len(numbers) < 3 or not any(ROLES[role].kind in ("wear", "load", "surface") for role in numbers):
        return copy
    keys = np.nan_to_num(np.vstack(list(numbers.values())), nan=-1e300)
    order = np.lexsort(keys)
    equal = (keys[:, order[1:]] == keys[:, order[:-1]]).all(axis=0)
    for i in np.flatnonzero(equal):
        a, b = sorted((int(order[i]), int(order[i + 1])))
        texts = (column.values for column in draft.columns)  # noqa: PD011  a Column, not a Series
        copy[b] = all(cells[a] == cells[b] or (cells[a] != cells[a] and cells[b] != cells[b]) for cells in texts)
    return copy


def _of_copies(draft: Draft, copies: Flags) -> Iterator[Doubt]:
    """Rows that occur twice, unless so many do that the file repeats each measurement."""
    if copies.any() and copies.mean() < FEW and ("t" in draft.data or "edge" in draft.data):
        which = lines_text(draft.lines[copies])
        repeat = "repeats an earlier row" if copies.sum() == 1 else "repeat earlier rows"
        yield Doubt(
            tuple(role for role in draft.data if role in ROLES),
            f"{which} {repeat} in every cell, and would count twice in a fit; remove what was copied",
        )


def _of_setting(draft: Draft, edges: _Edges, role: str, values: Array) -> Iterator[Doubt]:
    """Cells of a setting that differ from the rest of their edge."""
    x = values[edges.order]
    moved = edges.same & differs(x[1:], x[:-1])
    if not moved.any():
        return
    at_fault = np.unique(edges.codes[edges.order][1:][moved])
    if len(at_fault) > max(1, FEW * edges.several):
        return  # tests with changing conditions
    cells = []
    for code in at_fault:
        rows = np.flatnonzero(edges.codes == code)
        there = rows[~np.isnan(values[rows])]
        usual = float(np.median(values[there]))
        odd = there[differs(values[there], np.full(len(there), usual))]
        name = draft.data["edge"][rows[0]]
        if len(there) == 2 or 2 * len(odd) > len(there):
            some = ", ".join(
                f"{format_plain(v)} (line {draft.lines[i]})" for v, i in zip(values[there], there, strict=True)
            )
            cells.append(f"edge {name} has {some}")
        else:
            others = f"the other rows of edge {name} have {format_plain(usual)}"
            cells += [f"line {draft.lines[i]} has {format_plain(values[i])} where {others}"
                      f"{_factor_words(values[i], usual)}" for i in odd]  # fmt: skip
    yield Doubt((role,), f"{role} changes within an edge: {_some(cells)}; correct the cell, or the name of the edge")


def _factor_words(value: float, usual: float) -> str:
    """A factor between a cell and the rest that points to a unit or a slipped mark.

    >>> _factor_words(2540.0, 100.0), _factor_words(130.0, 100.0)
    (', a factor of 25.4 as between in and mm', '')
    """
    if not (value > 0 and usual > 0):
        return ""
    ratio = max(value / usual, usual / value)
    for factor, units in FACTORS:
        if abs(ratio / factor - 1) < 0.02:
            return f", a factor of {factor:g}" + (f" as between {units}" if units else ": a decimal mark or a digit")
    return ""


def _of_time(draft: Draft, edges: _Edges, t: Array, copies: Flags) -> Iterator[Doubt]:
    """Times that fall or repeat within an edge, stand far above the others, or run on from edge to edge."""
    order, same = edges.order, edges.same
    x = t[order]
    falls, repeats = same & (x[1:] < x[:-1]), same & (x[1:] == x[:-1]) & ~copies[order][1:]
    sorted_codes = edges.codes[order][1:]
    if falls.any() and len(np.unique(sorted_codes[falls])) <= max(1, FEW * edges.several):
        cells = [
            f"{format_plain(x[i + 1])} min at line {draft.lines[order[i + 1]]} after {format_plain(x[i])} in edge "
            f"{draft.data['edge'][order[i]]}"
            for i in np.flatnonzero(falls)
        ]
        yield Doubt(
            ("t", "edge"), f"t falls within an edge: {_some(cells)}; correct the time, or begin a new edge there"
        )
    if repeats.any() and len(np.unique(sorted_codes[repeats])) <= max(1, FEW * edges.several):
        cells = [
            f"{format_plain(x[i])} min at lines {draft.lines[order[i]]} and {draft.lines[order[i + 1]]} of edge "
            f"{draft.data['edge'][order[i]]}"
            for i in np.flatnonzero(repeats)
        ]
        yield Doubt(
            ("t", "edge"), f"t repeats within an edge: {_some(cells)}; correct the time or the name of the edge"
        )
    yield from _late(draft, edges, t)
    yield from _begun(draft, edges, t)
    yield from _running_on(edges, t)


def _late(draft: Draft, edges: _Edges, t: Array) -> Iterator[Doubt]:
    """A last time that is far from the others of its edge."""
    rows = np.flatnonzero(np.concatenate([~edges.same, [True]]))  # last of each edge, as sorted
    x = t[edges.order]
    step = np.concatenate([[np.nan], np.where(edges.same, np.diff(x), np.nan)])
    cells = []
    for last, first in zip(rows, np.concatenate([[0], rows[:-1] + 1]), strict=True):
        others = step[first + 1 : last]
        if last - first >= 3 and step[last] > LATE * np.nanmax(others, initial=np.inf if np.isnan(others).all() else 0):
            cells.append(
                f"{format_plain(x[last])} min at line {draft.lines[edges.order[last]]} after "
                f"{format_plain(x[last - 1])}"
            )
    if cells and len(cells) <= max(1, FEW * edges.several):
        yield Doubt(("t",), f"t jumps at the end of an edge: {_some(cells)}; {SLIPPED}")


def _begun(draft: Draft, edges: _Edges, t: Array) -> Iterator[Doubt]:
    """A first time that is far from the one at which nearly all edges begin."""
    rows = edges.order[np.concatenate([[True], ~edges.same])]
    usual = float(np.nanmedian(t[rows]))
    odd = rows[(t[rows] > 0) & ((t[rows] > JUMP * usual) | (t[rows] < usual / JUMP))]
    alike = np.abs(t[rows] - usual) <= 0.01 * usual
    if usual > 0 and len(odd) and 1 - alike.mean() <= FEW and len(odd) <= max(1, FEW * len(rows)):
        cells = [f"{format_plain(t[i])} min at line {draft.lines[i]}" for i in odd]
        yield Doubt(
            ("t",), f"t begins at {format_plain(usual)} min in most edges, but at {_some(cells)}; correct the time"
        )


def _running_on(edges: _Edges, t: Array) -> Iterator[Doubt]:
    """Time that does not begin anew with an edge."""
    begin = np.concatenate([[True], ~edges.same])
    first, last = t[edges.order[begin]], t[edges.order[np.append(begin[1:], True)]]
    place = np.argsort(edges.order[begin], kind="stable")
    if edges.several >= 3 and 2 * edges.several > len(place) and (first[place][1:] > last[place][:-1]).all():
        yield Doubt(
            ("t",),
            f"t runs on from edge to edge, to {format_plain(float(np.nanmax(t)))} min: each edge begins above the last "
            "time of the one before. Is it the time of the machine? A law needs the time in cut of the edge, from its "
            "first cut",
        )


def _of_response(draft: Draft, edges: _Edges, role: str, values: Array, t: Array | None) -> Iterator[Doubt]:
    """Single cells that jump against their neighbours, and wear that falls."""
    clock = np.arange(len(values), dtype=float) if t is None else t
    order = np.lexsort((clock, edges.codes))
    order = order[(values[order] > 0) & ~np.isnan(clock[order])]
    if len(order) < 3:
        return
    code, y = edges.codes[order], np.log(values[order])
    same = code[1:] == code[:-1]
    step = np.where(same, np.diff(y), np.nan)
    slipped = _slips(y, step, np.log(np.maximum(clock[order], 1e-9)), grows=ROLES[role].kind == "wear")
    unit = draft.units.get(role, "")
    if slipped.any():
        cells = [_slip_words(draft, values, order, step, int(i), unit) for i in np.flatnonzero(slipped)]
        if len(cells) <= max(1, FEW * edges.several):
            yield Doubt((role,), f"{role} jumps within an edge: {_some(cells)}; {SLIPPED}")
    if ROLES[role].kind != "wear" or not np.isfinite(step).any():
        return
    centre = float(np.nanmedian(step))
    spread = 1.4826 * float(np.nanmedian(np.abs(step - centre)))
    falls = (step < np.log(FALL)) & (step < centre - SPREADS * spread) & ~slipped[1:] & ~slipped[:-1]
    if falls.any() and falls.sum() <= max(2, FEW * edges.several):
        cells = [
            f"from {format_plain(values[order[i]])} to {format_plain(values[order[i + 1]])} {unit} at line "
            f"{draft.lines[order[i + 1]]}"
            for i in np.flatnonzero(falls)
        ]
        yield Doubt((role,), f"{role} falls by more than 20 % along an edge: {_some(cells)}; wear does not heal: check "
                    "these lines")  # fmt: skip


def _slips(y: Array, step: Array, log_t: Array, *, grows: bool) -> Flags:
    """Cells that stand out by the factor from both neighbours, or at an end from two that agree."""
    n, jump, steady = len(y), np.log(JUMP), np.log(STEADY)
    before, after = np.concatenate([[np.nan], step]), np.concatenate([-step, [np.nan]])  # against the neighbours
    both = (np.minimum(before, after) > jump) | (np.maximum(before, after) < -jump)
    next_but = np.concatenate([np.abs(step[1:]), [np.nan, np.nan]])[:n]  # step between the two that follow
    last_but = np.concatenate([[np.nan, np.nan], np.abs(step[:-1])])[:n]
    first = np.isnan(before) & (np.abs(after) > jump) & (next_but < steady)
    last = np.isnan(after) & (np.abs(before) > jump) & (last_but < steady)
    if grows:  # wear is low at first, and may rise fast at last
        later = np.concatenate([np.diff(log_t), [np.nan]])
        first &= (after > 0) | (-after > jump + 1.5 * later)
        last &= (before < 0) | (before > jump + steady)
    return np.asarray(both | first | last)


def _slip_words(draft: Draft, values: Array, order: NDArray[np.intp], step: Array, i: int, unit: str) -> str:
    beside = [k for k, s in ((i - 1, i - 1), (i + 1, i)) if 0 <= s < len(step) and np.isfinite(step[s])]
    around = " and ".join(format_plain(values[order[k]]) for k in beside)
    row = order[i]
    return f"line {draft.lines[row]} has {format_plain(values[row])} {unit}, its neighbours in edge " \
           f"{draft.data['edge'][row]} {around}"  # fmt: skip


def _some(cells: list[str]) -> str:
    more = len(cells) - LISTED
    return "; ".join(cells[:LISTED]) + (f"; and {more} more" if more > 0 else "")
