"""Rows of many pairs, looked over once: whose each row is, and which columns hold anything of each pair."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...datasets import Runs
from ...datasets.vocabulary import ROLES
from ..plan import Pair
from ..rows import Rows

Ints = NDArray[np.intp]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class PairsOfRows:
    """Rows and the K pairs that they name.

    Attributes
    ----------
    rows : Rows
        Of these pairs alone.
    pairs : tuple of Pair
        In the order in which the rows name them.
    number : ndarray of int, shape (n,)
        Pair of each row.
    counts : ndarray of int, shape (K,)
    held : mapping of str to ndarray of bool, shape (K,)
        Of each column that has a role, whether it holds anything of a pair.
    """

    rows: Rows
    pairs: tuple[Pair, ...]
    number: Ints
    counts: Ints
    held: dict[str, Flags]

    def patterns(self) -> Iterator[tuple[frozenset[str], Ints]]:
        """Symbols that hold something, and the pairs for which it is just these."""
        names = list(self.held)
        held = np.array([self.held[name] for name in names], dtype=bool).reshape(len(names), len(self.pairs)).T
        patterns, which = np.unique(held, axis=0, return_inverse=True)
        for i, pattern in enumerate(patterns):
            yield frozenset(np.array(names)[pattern].tolist()), np.flatnonzero(which.ravel() == i)

    def has(self, i: int, symbol: str) -> bool:
        """Whether a column holds anything of pair i."""
        return symbol in self.held and bool(self.held[symbol][i])


def looked_over(rows: Rows, wanted: Collection[Pair]) -> PairsOfRows:
    """Number the pairs, leaving out rows of other ones.

    Examples
    --------
    >>> from fitmodels.datasets.runs import Source
    >>> frame = pd.DataFrame({"tool": ["B", "A", "B"], "work": ["W"] * 3, "V": [1.0, np.nan, 2.0]})
    >>> found = looked_over(Rows(frame, np.arange(3), {}, (), Source("", "", 3, "")), {Pair("A", "W"), Pair("B", "W")})
    >>> [str(pair) for pair in found.pairs], found.number.tolist(), found.held["V"].tolist()
    (['B on W', 'A on W'], [0, 1, 0], [True, False])
    """
    number, pairs = _numbered(rows.frame)
    known = np.array([pair in wanted for pair in pairs], dtype=bool)
    if not known.all():
        keep = known[number]
        rows = replace(rows, frame=rows.frame[keep], lines=None if rows.lines is None else rows.lines[keep])
        number, pairs = _numbered(rows.frame)
    K = len(pairs)
    there = {name: _there(rows.frame[name]) for name in rows.frame if name in ROLES and name not in ("tool", "work")}
    held = {str(name): np.bincount(number[flags], minlength=K) > 0 for name, flags in there.items()}
    return PairsOfRows(rows, pairs, number, np.bincount(number, minlength=K), held)


def only_held(runs: Runs) -> Runs:
    """Runs without the columns that hold nothing of them, as if they stood in a file of their own.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from fitmodels import datasets
    >>> runs = datasets.read_runs(datasets.bundled("ac2017_table1"))
    >>> only_held(replace(runs, data=runs.data.assign(VB=np.nan))).has("VB")
    False
    """
    empty = [name for name in runs.data if name in ROLES and not _there(runs.data[name]).any()]
    if not empty:
        return runs
    return replace(
        runs,
        data=runs.data.drop(columns=empty),
        units={name: unit for name, unit in runs.units.items() if name not in empty},
        columns=tuple(replace(use, role=None) if use.role in empty else use for use in runs.columns),
    )


def texts(column: "pd.Series[str]") -> NDArray[np.object_]:
    """Texts of a column of labels, shape (n,), empty where missing; whole numbers as ``1``, not ``1.0``.

    >>> texts(pd.Series([1.0, np.nan])).tolist(), texts(pd.Series(["a", None])).tolist()
    (['1', ''], ['a', ''])
    """
    code, unique = pd.factorize(column)
    return np.array([*map(_text, unique), ""], dtype=object)[code]


def _numbered(frame: pd.DataFrame) -> tuple[Ints, tuple[Pair, ...]]:
    tools, tool = pd.factorize(frame["tool"], use_na_sentinel=False)
    works, work = pd.factorize(frame["work"], use_na_sentinel=False)
    number, keys = pd.factorize(tools.astype(np.int64) * max(len(work), 1) + works)
    at = np.divmod(keys, max(len(work), 1))
    named, made_of = ([str(name) for name in names] for names in (tool, work))
    return number, tuple(Pair(named[i], made_of[j]) for i, j in zip(*(part.tolist() for part in at), strict=True))


def _text(value: object) -> str:
    number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    return f"{float(value):.15g}" if number else str(value)  # type: ignore[arg-type]


def _there(column: "pd.Series[str]") -> Flags:
    """Where a column holds something, shape (n,): a number, or a text that is not empty."""
    known = column.notna().to_numpy(dtype=bool)
    if pd.api.types.is_numeric_dtype(column):
        return known
    return np.asarray(known & (texts(column) != ""), dtype=bool)
