"""Edges inferred from the order of the tests: a new one where the settings change or time does not rise."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..draft import Draft
from ..vocabulary import ROLES
from .columns import Array, Codes, differs
from .slips import TestOrder, shifted_rows, without_slips

LEAST = 1.7  # mean rows of an edge; fewer: nearly every row is a test of its own
WIDEST = 0.1  # relative width of a level of a setting
LARGE = 50_000  # rows by which it is decided whether there is anything to infer
SPARE = 1.3  # times the least number of edges that the settings allow: a file in hardly more pieces is in order
ORDERED = 3.0  # mean rows of an edge of one or two settings in order; rows in any order rise in half of the steps
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
    tests, n = _tests_in_order(draft), len(draft.lines)
    if n < 4 or not tests.settings or np.isnan(tests.time).mean() > 0.5:
        return None
    some = tests.first(LARGE)
    cell = _cells(some)
    chains = _chains(cell, some.time)
    if len(cell) / chains.sum() < LEAST:
        return None
    starts = np.append(True, (tests.time[1:] <= tests.time[:-1]) | tests.changes())
    shifted = {role: rows for role, x in tests.settings.items() if len(rows := shifted_rows(tests.time, x)) > 1}
    for rows in shifted.values():
        starts[rows] = tests.time[rows] <= tests.time[rows - 1]
    starts = without_slips(starts, tests)
    codes = np.cumsum(starts) - 1
    count, least = int(codes[-1]) + 1, int(chains.sum())
    names = [*tests.settings, *(role for role in ("tool", "work") if role in draft.data)]
    if n / count >= (LEAST if len(chains) > 2 or count <= max(SPARE * least, least + 1) else ORDERED):
        rule = f"a new edge where {_listed(names, 'or')} changes or t does not rise"
        found = _found(np.bincount(codes), f"the order of the tests ({rule})")
        return Inferred(codes, True, found, {role: draft.lines[rows] for role, rows in shifted.items()})
    return _out_of_order(draft, tests, cell, chains, count, names)


def _out_of_order(
    draft: Draft, tests: TestOrder, cell: Codes, chains: Codes, count: int, names: list[str]
) -> Inferred | None:
    """Edges of rows that do not stand in the order of the tests, or why they are unknown."""
    if _numbered_in_order(draft):
        return None  # a randomised plan in the order of its tests: t would rise if rows shared edges
    n, what = len(tests.time), "no column names the edges, and"
    paired = int(((tests.time[1:] == tests.time[:-1]) & ~tests.changes()).sum())
    if paired and n / (count - paired) >= LEAST:
        repeats = f"{paired} rows have the settings and the time of the row above"
        which = "are these readings of one edge, or edges side by side?"
        return Inferred(None, False, f"{what} {repeats}: {which} {UNKNOWN}")
    if (chains == 1).all() and len(cell) == n:
        codes = pd.factorize(cell)[0].astype(np.intp)
        rule = f"rows of equal {_listed(names, 'and')} are an edge: no time repeats in them"
        return Inferred(codes, False, _found(np.bincount(codes), f"the settings ({rule})"))
    shared = (
        f"at {int((chains > 1).sum())} of {len(chains)} settings of {_listed(names, 'and')} up to {int(chains.max())} "
        "rows have the same time, so which rows share an edge is unknown"
    )
    return Inferred(None, False, f"{what} the rows are not in the order of the tests: {shared}. {UNKNOWN}")


def _found(sizes: NDArray[np.intp], by: str) -> str:
    count, low, high = len(sizes), int(sizes.min()), int(sizes.max())
    rows = f"{low} rows" if low == high else f"{low} to {high} rows"
    what = f"{count} edges of {rows}" if count > 1 else f"1 edge of {rows}"
    return f"edges inferred from {by}: {what}; --edge none takes the rows as independent"


def _tests_in_order(draft: Draft) -> TestOrder:
    """Time, settings and codes of the labels that an edge has one of."""
    conditions = {role: values for role, values in draft.numbers().items() if ROLES[role].kind == "condition"}
    labels = tuple(draft.codes(role)[0] for role in ("tool", "work") if role in draft.data)
    return TestOrder(_filled(np.asarray(draft.data["t"], dtype=float)), settings_of(conditions), labels)


def _listed(names: list[str], word: str) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {word} {names[-1]}"


def _filled(t: Array) -> Array:
    """Missing times as the last one known, so that a row without time stays with the row above."""
    known = ~np.isnan(t)
    if known.all():
        return t
    last = np.maximum.accumulate(np.where(known, np.arange(len(t)), 0))
    return t[last]


def _cells(tests: TestOrder) -> Codes:
    """Number of the setting of each row; values within the tolerance are one level, unless levels overlap."""
    levels: list[Codes] = list(tests.labels)
    for x in tests.settings.values():
        found = np.unique(x)
        found = found[~np.isnan(found)]
        new = np.append(True, differs(found[1:], found[:-1]))
        low, high = found[new], found[np.append(new[1:], True)]
        if (np.abs(high - low) > WIDEST * np.abs(high)).any():
            new[:] = True
        level = np.cumsum(new) - 1
        levels.append(level[np.minimum(np.searchsorted(found, x), len(found) - 1)])
    cell = np.zeros(len(tests.time), dtype=np.intp)
    for one in levels:
        cell = np.unique(cell * (int(one.max()) + 2) + one + 1, return_inverse=True)[1]
    return cell


def _chains(cell: Codes, t: Array) -> Codes:
    """Least number of edges with rising time at each setting: the largest number of rows of one time."""
    order = np.lexsort((t, cell))
    c, s = cell[order], t[order]
    new = np.concatenate([[True], (c[1:] != c[:-1]) | (s[1:] != s[:-1])])
    at = np.flatnonzero(new)
    times = np.diff(at, append=len(c))
    chains = np.zeros(int(cell.max()) + 1, dtype=np.intp)
    np.maximum.at(chains, c[at], times)
    return chains


def _numbered_in_order(draft: Draft) -> bool:
    """Whether a column numbers the rows as they were run, each once and rising."""
    from .columns import may_be_edge, meant_by

    for column, use in zip(draft.columns, draft.uses, strict=True):
        if column.is_numeric and may_be_edge(use) and (use.role or meant_by(use.name)) in ("run", "edge", "other"):
            values = column.values  # noqa: PD011  a Column, not a Series
            if len(values) == len(draft.lines) and (values[1:] > values[:-1]).all():
                return True
    return False
