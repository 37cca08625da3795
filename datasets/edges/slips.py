"""Starts of edges in the order of the tests, without those that a slip in a cell or a shifted column makes."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .columns import Array, Codes, Flags, differs

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
    labels: tuple[Codes, ...]

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


def shifted_rows(t: Array, x: Array) -> NDArray[np.intp]:
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
    of_time = _slips_of_time(falls, start, length[np.searchsorted(at, falls) - 1], t, usual, together)
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


def _slips_of_time(
    falls: NDArray[np.intp], start: Flags, before: NDArray[np.intp], t: Array, usual: float, together: bool
) -> NDArray[np.intp]:
    """Rows at which time falls because one time slipped, among the first rows of edges.

    Parameters
    ----------
    falls : ndarray of int, shape (k,)
        First rows of edges with a time not above that of the row above.
    start : ndarray of bool, shape (n,)
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
