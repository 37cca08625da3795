"""Columns of runs, each looked over once: where they change, which names or levels they hold."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..sections.origin import FEW

if TYPE_CHECKING:
    from ...datasets import Runs

Array = NDArray[np.float64]
Index = NDArray[np.intp]
GLANCE = 4096  # changes looked at first: most columns that are measured show more than FEW levels there
SAME = 1e-9  # of a factor's largest: what a setting may differ by within an edge


@dataclass(frozen=True, slots=True)
class Labels:
    """A column of names: number of each row's name, -1 where it is missing; row where each name first stands.

    ``starts`` are the rows where another name stands than in the row above.
    """

    codes: Index
    names: list[str]
    first: Index
    starts: Index

    @property
    def counts(self) -> Index:
        """Rows of each name."""
        return np.bincount(self.codes[self.codes >= 0], minlength=len(self.names))


@dataclass(frozen=True, slots=True)
class Numbers:
    """A factor: its numbers (n,), the rows where another stands than above, and its levels where they are few."""

    numbers: Array
    starts: Index
    levels: Array


def numbers(x: Array) -> Numbers:
    """A factor (n,), NaN where missing, looked over.

    >>> numbers(np.array([2.0, 2.0, np.nan, 1.0])).levels.tolist()
    [1.0, 2.0]
    """
    starts = _starts(x)
    return Numbers(x, starts, _few(x[starts]))


def _few(x: Array) -> Array:
    """The different values, rising, where they are few; else none."""
    import pandas as pd

    if len(pd.unique(x[:GLANCE])) > FEW + 1:  # a missing value is none of them
        return np.empty(0)
    found = pd.unique(x)
    found = np.sort(found[~np.isnan(found)])
    return found if len(found) <= FEW else np.empty(0)


def _starts(column: NDArray[Any]) -> Index:
    """Where something else stands than in the row above, the first row with them."""
    return np.concatenate([[0], 1 + np.flatnonzero(column[1:] != column[:-1])]).astype(np.intp)[: len(column)]


def labels(runs: "Runs", name: str) -> Labels:
    """A column of names by its role or its header, looked over; whole numbers are told as ``1``, not ``1.0``.

    >>> from fitmodels import datasets
    >>> edge = labels(datasets.read_runs(datasets.bundled("gc435_709m40")), "edge")
    >>> edge.names[:2], edge.first[:2].tolist(), edge.counts[:2].tolist()
    (['E02', 'E11'], [0, 10], [10, 10])
    """
    import pandas as pd

    role = next((use.role for use in runs.columns if use.name == name and use.role in runs.data), None)
    column = runs.data[name if name in runs.data or role is None else role].to_numpy()
    column = column if column.dtype.kind == "f" else column.astype(object, copy=False)
    starts = _starts(column)
    codes, found = pd.factorize(column[starts])
    names = [f"{v:.15g}" for v in found] if column.dtype.kind == "f" else list(map(str, found))
    if "" in names:  # an empty cell is no name
        empty = names.index("")
        names.pop(empty)
        codes = np.where(codes == empty, -1, codes - (codes > empty))
    first = np.zeros(len(names), dtype=np.intp)
    known = codes >= 0
    first[codes[known][::-1]] = starts[known][::-1]  # of several writes the last counts
    return Labels(np.repeat(codes, np.diff(starts, append=len(column))), names, first, starts)


def stands(x: Numbers, edge: Labels) -> bool:
    """Whether a factor stays as it is on every edge: judged where edge or factor change, the other rows repeat."""
    first = x.numbers[edge.first]
    limit = SAME * np.fmax.reduce(np.abs(first), initial=0.0)
    for at in (x.starts[:GLANCE], edge.starts, x.starts):  # most that changes shows it at a glance
        known = at[(edge.codes[at] >= 0) & ~np.isnan(x.numbers[at])]
        if not (np.abs(x.numbers[known] - first[edge.codes[known]]) <= limit).all():
            return False
    return True
