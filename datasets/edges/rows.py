"""Rows of a draft sorted by cutting edge, for the checks within edges, and single tests that are copies of others."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import comb

import numpy as np

from ...core.arrays import Array, Flags, Ints, Texts
from ..doubts import Doubt
from ..draft import Draft, numbers_of
from ..vocabulary import ROLES, UNNAMED
from .merged_cells import lines_text

FEW = 0.3  # share of the edges above which something is a property of the tests, not a slip
LISTED = 3  # cells that a sentence names


@dataclass(frozen=True, slots=True)
class EdgeRows:
    """Rows by edge, in the order of the file within each.

    Attributes
    ----------
    names : ndarray of str, shape (n,)
        Edge of each row of the file.
    codes : ndarray of int, shape (n,)
        Number of the edge of each row of the file; edges of two tools or work materials are two.
    order : ndarray of int, shape (n,)
        Rows sorted by edge.
    same : ndarray of bool, shape (n - 1,)
        Whether a sorted row is of the edge of the one before.
    first : ndarray of int, shape (g,)
        Place in ``order`` of the first row of each edge.
    sizes : ndarray of int, shape (g,)
        Rows of each edge.
    several : int
        Number of edges of two rows or more.
    """

    names: Texts
    codes: Ints
    order: Ints
    same: Flags
    first: Ints
    sizes: Ints
    several: int

    @property
    def together(self) -> bool:
        """Whether the rows of each edge follow each other in the file."""
        return int((self.codes[1:] != self.codes[:-1]).sum()) == len(self.first) - 1

    @property
    def few(self) -> float:
        """Number of edges up to which something is a slip."""
        return max(1.0, FEW * self.several)

    def edges_of(self, pairs: Flags) -> int:
        """Number of edges with a marked pair of neighbours, of shape (n - 1,) as sorted."""
        return len(set(self.codes[self.order[1:][pairs]].tolist()))


def by_edge(draft: Draft) -> EdgeRows:
    """The rows of a draft that has edges."""
    names = np.asarray(draft.data["edge"], dtype=object)
    codes = draft.codes("edge")[0]
    for role in ("tool", "work"):
        if role in draft.data:
            label = draft.codes(role)[0]
            if label.any():
                codes = np.unique(codes * (int(label.max()) + 2) + label + 1, return_inverse=True)[1]
    order = np.argsort(codes, kind="stable")
    same = np.asarray(codes[order][1:] == codes[order][:-1])
    first = np.flatnonzero(np.concatenate([[True], ~same])).astype(np.intp)
    sizes = np.diff(first, append=len(order))
    return EdgeRows(names, codes, order, same, first, sizes, int((sizes > 1).sum()))


def median(values: Array) -> float:
    """The upper median; a third of the time of numpy's on few values.

    >>> median(np.array([3.0, 1.0, 2.0]))
    2.0
    """
    return float(np.sort(values)[len(values) // 2]) if len(values) else float("nan")


def listed(cells: Iterable[str]) -> str:
    """The first cells of a sentence, and the number of the others.

    >>> listed(["a", "b", "c", "d"])
    'a; b; c; and 1 more'
    """
    texts = list(cells)
    more = len(texts) - LISTED
    return "; ".join(texts[:LISTED]) + (f"; and {more} more" if more > 0 else "")


SCATTER = 0.02  # of a reading, from one test to the next at the same settings, at least: the smallest in cutting
CHANCE = 1e-3  # that as many readings are equal by chance


def equal_readings(settings: Array, readings: Array) -> Flags:
    """Rows with the settings and readings of an earlier row, where there are more than chance explains; shape (n,).

    Readings of two tests at the same settings are equal with a probability that follows from the smallest step between
    readings and their scatter.

    Parameters
    ----------
    settings, readings : ndarray, shape (n, k) and (n, m)

    Examples
    --------
    >>> V, F = np.repeat([[100.0], [150.0], [200.0]], 2, axis=0), np.array([[512.0, 512, 731, 731, 733, 733]]).T
    >>> equal_readings(V, F).tolist(), bool(equal_readings(V, F.round(-2)).any())
    ([False, True, False, True, False, True], False)
    """
    none = np.zeros(len(settings), dtype=bool)
    known = np.isfinite(readings).all(axis=1) & (readings > 0).all(axis=1)
    if not known.any():
        return none
    setting = np.unique(np.nan_to_num(settings, nan=-1.0), axis=0, return_inverse=True)[1].ravel()
    rows = np.column_stack([setting, readings])
    first = np.unique(rows[known], axis=0, return_index=True)[1]
    again = none.copy()
    again[np.delete(np.flatnonzero(known), first)] = True
    equal, pairs = int(again.sum()), int(known.sum()) - len(np.unique(setting[known]))
    step = np.array([np.diff(np.unique(one[known])).min(initial=np.inf) for one in readings.T])
    same = np.minimum(step / (2 * np.sqrt(np.pi) * SCATTER * np.median(readings[known], axis=0)), 1.0)
    p = float(np.prod(same))
    chance = sum(comb(pairs, k) * p**k * (1 - p) ** (pairs - k) for k in range(equal, pairs + 1))
    return again if equal and chance < CHANCE else none


def _settings_of(draft: Draft, measured: tuple[str, ...]) -> list[Array]:
    """Codes of each column that is no reading, and in which values repeat."""
    labels = [np.unique(column.values.astype(str), return_inverse=True)[1].ravel() for column in draft.columns]
    roles = [None if use.role is None else ROLES[use.role] for use in draft.uses]
    given = [codes for codes, role in zip(labels, roles, strict=True) if role is None or role.kind not in measured]
    return [codes.astype(float) for codes in given if len(np.unique(codes)) < len(codes)]


def of_equal_tests(draft: Draft, numbers: dict[str, Array], measured: tuple[str, ...]) -> Iterator[Doubt]:
    """Single tests with the readings of an earlier test at the same settings, in more rows than chance explains."""
    computed = {one.role for one in draft.derived}
    read = [values for role, values in numbers.items() if ROLES[role].kind in measured and role not in computed]
    kept = _settings_of(draft, measured)
    if not kept or not read:
        return
    copies = equal_readings(np.column_stack(kept), np.column_stack(read))
    if copies.any():
        yield Doubt(
            tuple(role for role in draft.data if role in ROLES),
            f"{lines_text(draft.lines[copies])} repeat{'s' * int(copies.sum() == 1)} the settings and readings of "
            "earlier rows, and would count twice in a fit; tests that are repeated differ: remove what was copied",
            lines=numbers_of(draft, copies),
        )


def of_repeated_pairs(draft: Draft) -> Flags:
    """Whether each row is of a pair of tool and work all of whose rows the file contains twice, or more often."""
    cells = [np.unique(column.values.astype(str), return_inverse=True)[1].ravel() for column in draft.columns]
    row, size = np.unique(np.column_stack(cells), axis=0, return_inverse=True, return_counts=True)[1:]
    pair = np.zeros(len(draft.lines), dtype=np.intp)
    for role in (role for role in UNNAMED if role in draft.data):
        codes, names = draft.codes(role)
        pair = pair * len(names) + codes
    number = np.unique(pair, return_inverse=True)[1]
    least = np.zeros(number.max() + 1, dtype=np.intp)
    np.gcd.at(least, number, size[row.ravel()])
    return np.asarray(least[number] > 1)
