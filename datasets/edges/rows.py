"""Rows of a draft sorted by cutting edge, for the checks within edges."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..draft import Draft
from .columns import Array, Codes, Flags

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

    names: NDArray[np.object_]
    codes: Codes
    order: NDArray[np.intp]
    same: Flags
    first: NDArray[np.intp]
    sizes: NDArray[np.intp]
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
