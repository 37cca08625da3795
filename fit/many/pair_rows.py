"""Rows of all pairs, sorted by pair and by edge, in logarithms, and the screening of the pairs for the batched fit."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ...core.arrays import Array, Flags, Ints, numbers_of_runs
from ...core.errors import UsageError
from ...core.rounding import label_of
from ...datasets.runs import UNNAMED
from ..edges import SAME
from ..rows import CONSTANT, FEWEST, HARDLY

# Margin of a threshold: beyond it rounding cannot have decided.
MARGIN = 1.001


@dataclass(frozen=True, slots=True)
class PairRows:
    """Rows of K pairs that a power law can use, and the columns they came from.

    Attributes
    ----------
    names : DataFrame, K rows
        The columns that name the pairs, pairs in the order in which the rows name them.
    raw : mapping of str to ndarray, shape (M,)
        Response and factors, all M rows.
    edge : Categorical of str, shape (M,), or None
    number : ndarray of int, shape (M,)
        Pair of each row.
    source : ndarray of int, shape (N,)
        Usable rows, sorted by pair and edge, otherwise in their order.
    logs : ndarray, shape (k + 1, N)
        Logarithms of the factors and, last, of the response.
    bounds : ndarray of int, shape (K + 1,)
        Where each pair begins among the N.
    edge_starts : ndarray of int, shape (E,), or None
        Where each edge of each pair begins.
    """

    names: pd.DataFrame
    raw: Mapping[str, Array]
    edge: "pd.Categorical[str] | None"
    number: Ints
    source: Ints
    logs: Array
    bounds: Ints
    edge_starts: Ints | None

    @property
    def counts(self) -> Ints:
        """Usable rows of each pair, shape (K,)."""
        return np.diff(self.bounds)

    def ends(self) -> tuple[Array, Array]:
        """Least and greatest value of the factors and, last, of the response, shapes (K, k + 1); NaN without rows."""
        here = np.flatnonzero(self.counts)
        least, most = np.full((2, len(self.counts), len(self.raw)), np.nan)
        if here.size:
            in_order = len(self.source) == len(self.number) and bool(np.all(self.source[1:] > self.source[:-1]))
            usable = (values if in_order else values[self.source] for values in self.raw.values())
            of_columns = _ends(usable, self.bounds[here])
            least[here], most[here] = of_columns[0].T, of_columns[1].T
        return least, most

    @property
    def edge_bounds(self) -> Ints:
        """Position of the first edge of each pair among ``edge_starts``, shape (K + 1,)."""
        starts = self.bounds[:-1] if self.edge_starts is None else self.edge_starts
        return np.searchsorted(starts, self.bounds)


def sorted_rows(
    frame: pd.DataFrame | Mapping[str, object],
    response: str,
    factors: Sequence[str],
    pair: str | Sequence[str],
    edge: str | None,
) -> PairRows:
    """Check the columns and sort the rows; rows without a positive response and factors are not among the usable."""
    table = frame if isinstance(frame, pd.DataFrame) else pd.DataFrame(dict(frame))
    keys = [pair] if isinstance(pair, str) else list(pair)
    _check(table, response, factors, keys, edge)
    raw = {name: _numbers(table, name) for name in (*factors, response)}
    number, names = _numbered(table, keys)
    edges = None if edge is None else _edges(table[edge])
    logs = np.empty((len(raw), len(table)))
    with np.errstate(divide="ignore", invalid="ignore"):
        for values, into in zip(raw.values(), logs, strict=True):
            np.log(values, out=into)
    usable = np.logical_and.reduce([np.isfinite(column) for column in logs])  # above zero and finite
    key = number if edges is None else number * max(len(edges.categories), 1) + edges.codes
    source = np.flatnonzero(usable)
    key = key[source]
    if sort := bool(np.any(key[1:] < key[:-1])):
        order = np.argsort(key, kind="stable")
        source, key = source[order], key[order]
    rows: Ints | slice = source if sort or len(source) < len(table) else slice(None)
    return PairRows(
        names=names,
        raw=raw,
        edge=edges,
        number=number,
        source=source,
        logs=logs if isinstance(rows, slice) else np.take(logs, rows, axis=1),
        bounds=np.searchsorted(number[rows], np.arange(len(names) + 1)),
        edge_starts=None if edges is None else _changes(key),
    )


def _check(table: pd.DataFrame, response: str, factors: Sequence[str], keys: list[str], edge: str | None) -> None:
    if isinstance(factors, str) or not factors:
        raise UsageError(f"factors={factors!r}: it is a list of one or more names, for instance ['V', 'f'].")
    if not keys:
        raise UsageError("pair=[]: name the column or columns that identify a pair, for instance 'tool'.")
    if response in factors:
        raise UsageError(f"{response} is the response and cannot be its own factor; leave it out of the factors.")
    for name in (response, *factors, *keys, *([] if edge is None else [edge])):
        if name not in table:
            raise UsageError(f"no column {name!r}; there are {', '.join(map(str, table.columns))}.")
    both = [name for name in keys if name in (response, *factors)]
    if both:
        raise UsageError(
            f"{both[0]} names the pair and is a factor or the response: it is constant in each pair; leave it out."
        )


def _numbers(table: pd.DataFrame, name: str) -> Array:
    if not pd.api.types.is_numeric_dtype(table[name]):
        raise UsageError(f"column {name!r} holds text; a law needs numbers.")
    return table[name].to_numpy(dtype=float, na_value=np.nan)


def _numbered(table: pd.DataFrame, keys: list[str]) -> tuple[Ints, pd.DataFrame]:
    """Number of the pair of each row, in order of appearance, and the names of the pairs."""
    number, first = _codes(table[keys[0]], keys[0])
    for name in keys[1:]:
        codes, levels = _codes(table[name], name)
        number, first = numbers_of_runs(number * max(len(levels), 1) + codes)
    names = pd.DataFrame({name: _named(table[name].iloc[first], name).reset_index(drop=True) for name in keys})
    return number, names


def _codes(column: "pd.Series[Any]", name: str) -> tuple[Ints, Ints]:
    """Number of the name of each row, in order of appearance, and the first row of each name."""
    whole = isinstance(column.dtype, np.dtype) and column.dtype.kind in "iu"
    return numbers_of_runs(column.to_numpy() if whole else pd.factorize(_named(column, name))[0])


def _named(column: "pd.Series[str]", name: str) -> "pd.Series[str]":
    """A column that names pairs, with a placeholder where it is empty."""
    missing = column.isna() | (column == "")
    return column.astype(object).where(~missing, UNNAMED.get(name, "unnamed")) if missing.any() else column


def _edges(column: "pd.Series[str]") -> "pd.Categorical[str]":
    """The edges, shape (M,), their names in alphabetical order, as ``Runs.labels`` writes them."""
    codes, levels = pd.factorize(column, use_na_sentinel=False)
    texts = np.array([_text(level) for level in levels], dtype=object)
    again, names = pd.factorize(texts, sort=True)
    return pd.Categorical.from_codes(again[codes], categories=pd.Index(names, dtype=object))


def _text(level: object) -> str:
    return "" if pd.isna(level) else label_of(level)  # type: ignore[call-overload]


def _changes(key: Ints) -> Ints:
    """Positions where a sorted key takes a new value."""
    return np.flatnonzero(np.concatenate([np.ones(min(len(key), 1), dtype=bool), key[1:] != key[:-1]]))


@dataclass(frozen=True, slots=True)
class Screening:
    """Varying factors of each pair, and the pairs that a batched fit takes.

    Attributes
    ----------
    constant, within : ndarray, shape (K, k)
        Factors that do not change in a pair, and those that change within its edges.
    level : ndarray, shape (K, k)
        First value of each factor, in logarithms.
    largest : ndarray, shape (K,)
        Largest ``|ln y|``.
    plain : ndarray, shape (K,)
        Pairs that a batched fit takes.
    """

    constant: Flags
    within: Flags
    level: Array
    largest: Array
    plain: Flags


def screen(rows: PairRows) -> Screening:
    """Screen all pairs in one pass over the rows; pairs without rows are not plain."""
    K, k = len(rows.names), len(rows.logs) - 1
    here = np.flatnonzero(rows.counts)
    found = Screening(
        np.zeros((K, k), dtype=bool), np.zeros((K, k), dtype=bool), np.zeros((K, k)), np.zeros(K),
        np.zeros(K, dtype=bool),
    )  # fmt: skip
    if not here.size:
        return found
    starts, counts = rows.bounds[here], rows.counts[here]
    first = _first_rows(rows, starts, counts)
    least, most = _ends(rows.logs, starts)
    reach = np.maximum(most - rows.logs[:, first], rows.logs[:, first] - least)
    level = rows.logs[:k, first].T
    share = reach[:k].T / np.maximum(1.0, np.abs(level))
    constant = share <= CONSTANT
    hardly = ~constant & (reach[:k].T < MARGIN * HARDLY)
    close = (((share > CONSTANT / MARGIN) & (share < CONSTANT * MARGIN)) | hardly).any(axis=1)
    copied = (_copies(rows.logs, first, counts) > 1) & (counts >= 2 * FEWEST)
    p = 1 + k - constant.sum(axis=1)
    found.plain[here] = (counts > p) & (p > 1) & (reach[k] > 0) & ~close & ~copied
    if len(rows.source) < len(rows.number):
        infinite = np.logical_or.reduce([np.isinf(values) for values in rows.raw.values()])
        found.plain[rows.number[infinite]] = False
    found.constant[here], found.level[here], found.within[here] = constant, level, _within(rows, starts)
    found.largest[here] = np.maximum(np.abs(least[k]), np.abs(most[k]))
    return found


def _ends(columns: Iterable[Array], starts: Ints) -> tuple[Array, Array]:
    """Least and greatest value of each column in each pair, shapes (columns, pairs)."""
    ends = [[np.minimum.reduceat(column, starts), np.maximum.reduceat(column, starts)] for column in columns]
    least, most = np.array(ends).swapaxes(0, 1)
    return least, most


def _copies(logs: Array, first: Ints, counts: Ints) -> Ints:
    """Rows of each pair that are equal to its first one, which is among them."""
    pair = np.repeat(np.arange(len(first)), counts)
    rows = np.flatnonzero(logs[-1] == np.repeat(logs[-1, first], counts))  # a response is rarely measured twice
    for column in logs[:-1]:
        rows = rows[column[rows] == column[first[pair[rows]]]]
    return np.bincount(pair[rows], minlength=len(first))


def _first_rows(rows: PairRows, starts: Ints, counts: Ints) -> Ints:
    """Positions of the first row of each pair in the table, from which changes are measured as in a single fit."""
    return np.flatnonzero(rows.source == np.repeat(np.minimum.reduceat(rows.source, starts), counts))


def _within(rows: PairRows, starts: Ints) -> Flags:
    """Whether each factor changes within the edges of a pair, shape (pairs with rows, k); see ``edges``."""
    within = np.zeros((len(starts), len(rows.logs) - 1), dtype=bool)
    if rows.edge_starts is not None:
        lengths = np.diff(rows.edge_starts, append=rows.logs.shape[1])
        for j, column in enumerate(rows.logs[:-1]):
            about = np.abs(column - np.repeat(column[rows.edge_starts], lengths))
            if about.any():
                change = np.maximum.reduceat(about, starts)
                within[:, j] = change > SAME * np.maximum.reduceat(np.abs(column), starts)
    return within
