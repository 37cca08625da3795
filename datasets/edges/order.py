"""Edges inferred from the order of the tests, without those that a slip in a cell or a shifted column makes."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from ...core.arrays import Array, Flags, Ints
from ..draft import Draft
from ..vocabulary import ROLES
from .columns import differs

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
SLIPS = 0.1  # share of the edges that a slip in a single cell may have split
TOGETHER = 0.8  # share of the edges that begin at the usual time or before


@dataclass(frozen=True, slots=True)
class TestOrder:
    """Rows in the order of the file.

    Attributes
    ----------
    time : ndarray, shape (n,)
    settings : mapping of str to ndarray, shape (n,)
    labels : tuple of ndarray of int, shape (n,)
        Codes of tool and work material, where the file names them.
    """

    time: Array
    settings: Mapping[str, Array]
    labels: tuple[Ints, ...]

    def first(self, n: int) -> "TestOrder":
        """The first rows."""
        if len(self.time) <= n:
            return self
        settings = {role: x[:n] for role, x in self.settings.items()}
        return TestOrder(self.time[:n], settings, tuple(label[:n] for label in self.labels))

    def changes(self) -> Flags:
        """Whether the setting of each row but the first differs from that of the row above, shape (n - 1,)."""
        changed = np.zeros(len(self.time) - 1, dtype=bool)
        for x in self.settings.values():
            changed |= differs(x[1:], x[:-1])
        for label in self.labels:
            changed |= label[1:] != label[:-1]
        return changed

    def alike(self, i: int, j: int) -> bool:
        """Whether two rows have the same setting."""
        same = not any(differs(x[i : i + 1], x[j : j + 1])[0] for x in self.settings.values())
        return same and all(label[i] == label[j] for label in self.labels)


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

    codes: Ints | None
    in_order: bool
    sentence: str
    shifted: Mapping[str, Ints] = field(default_factory=dict)


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
    draft: Draft, tests: TestOrder, cell: Ints, chains: Ints, count: int, names: list[str]
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


def _found(sizes: Ints, by: str) -> str:
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


def _cells(tests: TestOrder) -> Ints:
    """Number of the setting of each row; values within the tolerance are one level, unless levels overlap."""
    levels: list[Ints] = list(tests.labels)
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


def _chains(cell: Ints, t: Array) -> Ints:
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
        if may_be_edge(use) and (use.role or meant_by(use.name)) in ("run", "edge", "other"):
            values = column.numbers()
            if values is not None and len(values) == len(draft.lines) and (values[1:] > values[:-1]).all():
                return True
    return False


def shifted_rows(t: Array, x: Array) -> Ints:
    """Rows at which a setting changes while time rises, one row beside a row at which time begins anew.

    The row between has the setting of the other edge, as it has where a column is shifted by one row.
    """
    begins = np.concatenate([[True], t[1:] <= t[:-1], [True]])
    if len(t) < 3 * begins.sum():
        return np.empty(0, dtype=np.intp)
    rows = np.flatnonzero(differs(x[2:], x[1:-1]) & ~begins[2:-1]) + 2
    rows = rows[rows < len(t) - 1]
    after = begins[rows - 1] & ~differs(x[rows - 1], x[rows - 2])
    before = begins[rows + 1] & ~differs(x[rows], x[rows + 1])
    return rows if len(rows) and (after.all() or before.all()) else np.empty(0, dtype=np.intp)


def without_slips(start: Flags, tests: TestOrder) -> Flags:
    """Starts of edges, shape (n,), without those that a slip in a single cell of a setting or of the time makes.

    The checks within edges name that cell. Where many starts would go, none goes: the tests are of another kind.
    """
    t, at = tests.time, np.flatnonzero(start)
    most = max(2.0, SLIPS * len(at))
    usual = float(np.sort(t[at])[len(at) // 2])
    together = bool((t[at] <= usual * (1 + 1e-9)).mean() >= TOGETHER)
    length = np.diff(at, append=len(t))
    falls = at[1:][t[at[1:]] <= t[at[1:] - 1]]
    of_time = _slips_of_time(falls, length[np.searchsorted(at, falls) - 1], t, usual, together)
    single = at[length == 1]
    if len(at) < 4 or len(single) > 3 * most or len(of_time) > 3 * most:
        return start
    false = [(i,) for i in of_time.tolist() if tests.alike(i - 1, i)]
    slips = (_slip_of_setting(int(i), tests, usual, together) for i in single)
    joined = {*false, *(slip for slip in slips if slip)}
    if not joined or len(joined) > most:
        return start
    mended = start.copy()
    mended[[i for slip in joined for i in slip]] = False
    return mended


def _slip_of_setting(i: int, tests: TestOrder, usual: float, together: bool) -> tuple[int, ...]:
    """Starts that go if the edge of the one row ``i`` is a row of the edge above or below."""
    t, last = tests.time, len(tests.time) - 1
    above, below = i > 0 and t[i] > t[i - 1], i < last and t[i + 1] > t[i]
    if above and below and tests.alike(i - 1, i + 1):
        return (i, i + 1)
    if not together or (i < last and tests.alike(i, i + 1)):
        return ()  # time falls after it
    if above and t[i] > usual and not (below and t[i + 1] > usual):
        return (i,)
    return (i + 1,) if below and t[i] <= usual < t[i + 1] else ()


def _slips_of_time(falls: Ints, before: Ints, t: Array, usual: float, together: bool) -> Ints:
    """Rows at which time falls because one time slipped, among the first rows of edges.

    Parameters
    ----------
    falls : ndarray of int, shape (k,)
        First rows of edges with a time not above that of the row above.
    before : ndarray of int, shape (k,)
        Rows of the edge above each.
    t : ndarray, shape (n,), min
    usual : float
        Time at which the edges begin, and whether nearly all of them do (``together``).
    """
    if not len(falls):
        return falls
    now, above, above2 = t[falls], t[falls - 1], t[np.maximum(falls - 2, 0)]
    below = t[np.minimum(falls + 1, len(t) - 1)]
    odd = (now < 0.5 * usual) | (now > 2 * usual)
    low = ((before >= 3) | together) & (below > above) & odd
    high = (before >= 3) & (above2 < now)
    first_high = together & (before == 1) & (now > usual)
    return np.asarray(falls[low | high | first_high], dtype=np.intp)
