"""Edges inferred from the order of the tests: a new one where the settings change or time does not rise."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .draft import Draft
from .edge_columns import Array, Codes, Flags, differs
from .vocabulary import ROLES

LEAST = 1.7  # mean rows of an edge; fewer: nearly every row is a test of its own
SPARE = 1.3  # times the least number of edges that the settings allow: a file in hardly more pieces is in order
ORDERED = 3.0  # mean rows of an edge of one or two settings in order; rows in any order rise in half of the steps
SLIPS = 0.1  # share of the edges that a slip in a single cell may have split
TOGETHER = 0.9  # share of edges that begin at the usual time
UNKNOWN = (
    "Standard errors cannot be defended without the edges: add a column edge to the file, or, if every row is of an "
    "edge of its own"
)
SECONDARY = {"n": ("V",), "fm": ("f", "fz", "V"), "fz": ("f",)}  # settings that follow from others


@dataclass(frozen=True, slots=True)
class Inferred:
    """Edges by the design.

    Attributes
    ----------
    codes : ndarray, shape (n,), or None
        Edge of each row, from 0; None where the rows do not settle it.
    in_order : bool
        Whether they follow from the order of the rows; otherwise from the settings alone.
    sentence : str
        How the edges were found, or why not.
    shifted : mapping of str to ndarray
        Settings that change one row before or after time begins anew, with the lines of these changes.
    """

    codes: Codes | None
    in_order: bool
    sentence: str
    shifted: Mapping[str, NDArray[np.intp]] = field(default_factory=dict)


def settings_of(conditions: Mapping[str, Array]) -> dict[str, Array]:
    """Conditions that are set, without those that follow from others: the spindle speed where V is there.

    >>> sorted(settings_of({"V": np.ones(2), "n": np.array([1.0, 2.0])}))
    ['V']
    """
    return {
        role: values
        for role, values in conditions.items()
        if not any(other in conditions for other in SECONDARY.get(role, ())) and not np.isnan(values).all()
    }


def edges_by_design(draft: Draft) -> Inferred | None:
    """Edges of the rows; None where there is nothing to infer, as where each row is a test of its own."""
    t, settings, labels = _columns(draft)
    n = len(t)
    if n < 4 or not settings or np.isnan(t).mean() > 0.5:
        return None
    t = _filled(t)
    cell = _cells(settings, labels)
    chains = _chains(cell, t)
    if n / chains.sum() < LEAST:
        return None
    starts = _starts(t, settings, labels)
    shifted = {role: rows for role, x in settings.items() if len(rows := _shifted_rows(t, x)) > 1}
    for rows in shifted.values():
        starts[rows] = t[rows] <= t[rows - 1]
    starts = _mended(starts, t, settings, labels)
    codes = np.cumsum(starts) - 1
    count = int(codes[-1]) + 1
    sizes = np.bincount(codes)
    names = [*settings, *(role for role in ("tool", "work") if role in draft.data)]
    least = int(chains.sum())
    if n / count >= (LEAST if len(chains) > 2 or count <= max(SPARE * least, least + 1) else ORDERED):
        rule = f"a new edge where {_listed(names, 'or')} changes or t does not rise"
        found = _found(count, sizes, f"the order of the tests ({rule})")
        return Inferred(codes, True, found, {role: draft.lines[rows] for role, rows in shifted.items()})
    if _numbered_in_order(draft):
        return None  # a randomised plan in the order of its tests: t would rise if rows shared edges
    paired = int(((t[1:] == t[:-1]) & ~_changes(settings, labels)).sum())
    if paired and n / (count - paired) >= LEAST:
        what = f"{paired} rows have the settings and the time of the row above"
        which = "are these readings of one edge, or edges side by side?"
        return Inferred(None, False, f"no column names the edges, and {what}: {which} {UNKNOWN}")
    if (chains == 1).all():
        codes = pd.factorize(cell)[0].astype(np.intp)
        rule = f"rows of equal {_listed(names, 'and')} are an edge: no time repeats in them"
        return Inferred(codes, False, _found(len(chains), np.bincount(codes), f"the settings ({rule})"))
    what = (
        f"at {int((chains > 1).sum())} of {len(chains)} settings of {_listed(names, 'and')} up to {int(chains.max())} "
        "rows have the same time, so which rows share an edge is unknown"
    )
    return Inferred(
        None, False, f"no column names the edges, and the rows are not in the order of the tests: {what}. {UNKNOWN}"
    )


def _found(count: int, sizes: NDArray[np.intp], by: str) -> str:
    low, high = int(sizes.min()), int(sizes.max())
    rows = f"{low} rows" if low == high else f"{low} to {high} rows"
    what = f"{count} edges of {rows}" if count > 1 else f"1 edge of {rows}"
    return f"edges inferred from {by}: {what}; --edge none takes the rows as independent"


def _columns(draft: Draft) -> tuple[Array, dict[str, Array], list[NDArray[np.intp]]]:
    """Time, settings and codes of the labels that an edge has one of."""
    conditions = {role: values for role, values in draft.numbers().items() if ROLES[role].kind == "condition"}
    labels = [pd.factorize(np.asarray(draft.data[role]))[0] for role in ("tool", "work") if role in draft.data]
    return np.asarray(draft.data["t"], dtype=float), settings_of(conditions), labels


def _listed(names: list[str], word: str) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {word} {names[-1]}"


def _filled(t: Array) -> Array:
    """Missing times as the last one known, so that a row without time stays with the row above."""
    known = ~np.isnan(t)
    if known.all():
        return t
    last = np.maximum.accumulate(np.where(known, np.arange(len(t)), 0))
    return t[last]


def _cells(settings: Mapping[str, Array], labels: list[NDArray[np.intp]]) -> NDArray[np.intp]:
    """Number of the setting of each row."""
    cell = np.zeros(len(next(iter(settings.values()))), dtype=np.intp)
    levels: list[NDArray[np.intp]] = list(labels)
    for x in settings.values():
        found = np.unique(x)
        found = found[~np.isnan(found)]
        group = np.concatenate([[0], np.cumsum(differs(found[1:], found[:-1]))]).astype(np.intp)
        levels.append(group[np.minimum(np.searchsorted(found, x), len(found) - 1)])
    for level in levels:
        cell = np.unique(cell * (int(level.max()) + 2) + level + 1, return_inverse=True)[1]
    return cell


def _chains(cell: NDArray[np.intp], t: Array) -> NDArray[np.intp]:
    """Least number of edges with rising time at each setting: the largest number of rows of one time."""
    order = np.lexsort((t, cell))
    c, s = cell[order], t[order]
    new = np.concatenate([[True], (c[1:] != c[:-1]) | (s[1:] != s[:-1])])
    at = np.flatnonzero(new)
    times = np.diff(at, append=len(c))
    chains = np.zeros(int(cell.max()) + 1, dtype=np.intp)
    np.maximum.at(chains, c[at], times)
    return chains


def _starts(t: Array, settings: Mapping[str, Array], labels: list[NDArray[np.intp]]) -> Flags:
    start = np.ones(len(t), dtype=bool)
    start[1:] = (t[1:] <= t[:-1]) | _changes(settings, labels)
    return start


def _changes(settings: Mapping[str, Array], labels: list[NDArray[np.intp]]) -> Flags:
    """Whether the setting of each row but the first differs from that of the row above."""
    changed = np.zeros(len(next(iter(settings.values()))) - 1, dtype=bool)
    for x in settings.values():
        changed |= differs(x[1:], x[:-1])
    for label in labels:
        changed |= label[1:] != label[:-1]
    return changed


def _shifted_rows(t: Array, x: Array) -> NDArray[np.intp]:
    """Rows at which a setting changes while time rises, one row beside a row at which time begins anew.

    The row between has the setting of the other edge, as it has where a column is shifted by one row.
    """
    begins = np.append(np.append(True, t[1:] <= t[:-1]), True)
    if len(t) < 3 * begins.sum():
        return np.empty(0, dtype=np.intp)
    rows = np.flatnonzero(differs(x[2:], x[1:-1]) & ~begins[2:-1]) + 2
    rows = rows[rows < len(t) - 1]
    after = begins[rows - 1] & ~differs(x[rows - 1], x[rows - 2])
    before = begins[rows + 1] & ~differs(x[rows], x[rows + 1])
    return rows if len(rows) and (after.all() or before.all()) else np.empty(0, dtype=np.intp)


def _mended(start: Flags, t: Array, settings: Mapping[str, Array], labels: list[NDArray[np.intp]]) -> Flags:
    """Starts without those that a slip in a single cell of a setting or time makes; the checks name that cell."""
    at = np.flatnonzero(start)
    if len(at) < 4:
        return start
    false: list[tuple[int, ...]] = []
    end = np.append(at[1:], len(t)) - 1
    usual = float(np.median(t[at]))
    together = (t[at] <= usual * (1 + 1e-9)).mean() >= TOGETHER - SLIPS
    for k in np.flatnonzero(end == at)[: len(at)]:  # edges of one row
        i = int(at[k])
        joins_above = k > 0 and t[i] > t[i - 1]
        joins_below = i + 1 < len(t) and t[i + 1] > t[i]
        if joins_above and joins_below and _alike(i - 1, i + 1, settings, labels):
            false.append((i, i + 1))
        elif i + 1 < len(t) and _alike(i, i + 1, settings, labels):
            continue  # time falls after it: below
        elif together and joins_above and t[i] > usual and not (joins_below and t[i + 1] > usual):
            false.append((i,))
        elif together and joins_below and t[i] <= usual < t[i + 1]:
            false.append((i + 1,))
    length = np.diff(at, append=len(t))
    for k in range(1, len(at)):
        i = int(at[k])
        if t[i] > t[i - 1] or not _alike(i - 1, i, settings, labels):
            continue
        low = (together or length[k - 1] >= 3) and i + 1 < len(t) and t[i + 1] > t[i - 1] and not 0.5 < t[i] / usual < 2
        high = length[k - 1] >= 3 and t[i - 2] < t[i]
        first_high = together and length[k - 1] == 1 and t[i] > usual
        if low or high or first_high:
            false.append((i,))
    if not false or len(set(false)) > max(2, SLIPS * len(at)):
        return start
    mended = start.copy()
    mended[[i for joined in false for i in joined]] = False
    return mended


def _alike(i: int, j: int, settings: Mapping[str, Array], labels: list[NDArray[np.intp]]) -> bool:
    same = all(not differs(x[i : i + 1], x[j : j + 1])[0] for x in settings.values())
    return same and all(label[i] == label[j] for label in labels)


def _numbered_in_order(draft: Draft) -> bool:
    """Whether a column numbers the rows as they were run, each once and rising."""
    from .edge_columns import may_be_edge, meant_by

    for column, use in zip(draft.columns, draft.uses, strict=True):
        if column.is_numeric and may_be_edge(use) and (use.role or meant_by(use.name)) in ("run", "edge", "other"):
            values = column.values  # noqa: PD011  a Column, not a Series
            if len(values) == len(draft.lines) and (values[1:] > values[:-1]).all():
                return True
    return False
