"""The table of laws of many pairs: power laws of all pairs at once, other laws pair by pair."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from ...core.arrays import Array, Flags, Ints, Texts, numbers_of_runs
from ...core.rounding import label_of
from ...datasets import Runs
from ...datasets.options import Process
from ...datasets.plausibility.ranges import process_of
from ...datasets.vocabulary import ROLES
from ...fit.defaults import SETTINGS, Asked, Held, fit_asked, requested_laws
from ..law_rows import joined_tables, law_table, row_of, row_without, table_of_many
from ..outcomes import Cell, Failure, attempt
from ..plan import BatchOptions, Pair
from ..rows import NO_LINES, PairRows


@dataclass(frozen=True, slots=True)
class NumberedRows:
    """Rows and the K pairs that they name.

    Attributes
    ----------
    rows : PairRows
        Of these pairs alone.
    pairs : tuple of Pair
        In the order in which the rows name them.
    number : ndarray of int, shape (n,)
        Pair of each row.
    counts : ndarray of int, shape (K,)
    held : mapping of str to ndarray of bool, shape (K,)
        Of each column that has a role, whether it holds anything of a pair.
    ends : mapping of str to (ndarray, ndarray), shapes (K,)
        Of each column of numbers that has a role, least and largest value of each pair, NaN where it holds none.
    """

    rows: PairRows
    pairs: tuple[Pair, ...]
    number: Ints
    counts: Ints
    held: dict[str, Flags]
    ends: dict[str, tuple[Array, Array]]

    def patterns(self) -> Iterator[tuple[Held, Ints]]:
        """Contents of pairs as far as they decide on their laws, and the pairs with the same contents."""
        settings = {name: low < high for name, (low, high) in self.ends.items() if name in SETTINGS}
        names, K = [*self.held, *settings], len(self.pairs)
        flags = np.array([*self.held.values(), *settings.values()], dtype=bool).reshape(len(names), K).T
        processes = self._processes()
        kinds = list(dict.fromkeys(processes))
        keys = np.column_stack([flags, [kinds.index(process) for process in processes]])
        _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        for i, one in enumerate(first):
            held, varying = (frozenset(name for name in found if found[name][one]) for found in (self.held, settings))
            yield Held(held.__contains__, varying.__contains__, processes[one]), np.flatnonzero(which.ravel() == i)

    def _processes(self) -> list[Process | None]:
        of_all = self.rows.process or process_of(map(str, self.rows.frame), self.rows.notes)
        if not (about := self.rows.of_pair):
            return [of_all] * len(self.pairs)
        return [about[pair].process if pair in about else of_all for pair in self.pairs]

    def has(self, i: int, symbol: str) -> bool:
        """Whether a column holds anything of pair i."""
        return symbol in self.held and bool(self.held[symbol][i])


def numbered_rows(rows: PairRows, wanted: Collection[tuple[str, str]]) -> NumberedRows:
    """Number the pairs, leaving out rows of others than the tools and works that are wanted.

    Examples
    --------
    >>> from fitmodels.datasets.runs import Source
    >>> frame = pd.DataFrame({"tool": ["B", "A", "B"], "work": ["W"] * 3, "V": [1.0, np.nan, 2.0]})
    >>> rows = PairRows(frame, np.arange(3), {}, (), Source("", "", 3, ""))
    >>> found = numbered_rows(rows, {("A", "W"), ("B", "W")})
    >>> [str(pair) for pair in found.pairs], found.number.tolist(), found.held["V"].tolist()
    (['B on W', 'A on W'], [0, 1, 0], [True, False])
    """
    number, pairs = _numbered(rows.frame)
    known = np.array([(pair.tool, pair.work) in wanted for pair in pairs], dtype=bool)
    if not known.all():
        rows = _only(rows, known[number])
        number, pairs = _numbered(rows.frame)
    K = len(pairs)
    counts = np.bincount(number, minlength=K)
    columns = {str(name): rows.frame[name] for name in rows.frame if name in ROLES and name not in ("tool", "work")}
    ends = _ends({name: column for name, column in columns.items() if _is_numeric(column)}, number, counts)
    held = {
        name: ~np.isnan(ends[name][0]) if name in ends else np.bincount(number[_there(column)], minlength=K) > 0
        for name, column in columns.items()
    }
    return NumberedRows(rows, pairs, number, counts, held, ends)


def _ends(columns: "Mapping[str, pd.Series[float]]", number: Ints, counts: Ints) -> dict[str, tuple[Array, Array]]:
    """The ``ends`` of `NumberedRows`, each column in one pass over rows that are sorted by pair."""
    order = None if np.all(number[1:] >= number[:-1]) else np.argsort(number, kind="stable")
    starts = np.cumsum(counts) - counts
    found = {}
    for name, column in columns.items():
        values = column.to_numpy(dtype=float, na_value=np.nan)
        values = values if order is None else values[order]
        found[name] = (np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts))
    return found


def without_empty_columns(runs: Runs) -> Runs:
    """Runs without the columns that hold nothing of them, as if they stood in a file of their own.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from fitmodels import datasets
    >>> runs = datasets.read_runs(datasets.bundled("ac2017_table1"))
    >>> without_empty_columns(replace(runs, data=runs.data.assign(VB=np.nan))).has("VB")
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


def texts(column: "pd.Series[str]") -> Texts:
    """Texts of a column of labels, shape (n,), empty where missing; whole numbers as ``1``, not ``1.0``.

    >>> texts(pd.Series([1.0, np.nan])).tolist(), texts(pd.Series(["a", None])).tolist()
    (['1', ''], ['a', ''])
    """
    code, unique = pd.factorize(column)
    return np.array([*map(label_of, unique), ""], dtype=object)[code]


def _numbered(frame: pd.DataFrame) -> tuple[Ints, tuple[Pair, ...]]:
    tools, tool = _codes(frame["tool"])
    works, work = _codes(frame["work"])
    number, first = numbers_of_runs(tools * max(len(work), 1) + works)
    named, made_of = ([str(name) for name in names] for names in (tool, work))
    return number, tuple(Pair(named[tools[i]], made_of[works[i]]) for i in first.tolist())


def _codes(column: "pd.Series[str]") -> tuple[Ints, "pd.Index[str]"]:
    """Number of the text of each row, and the texts; one that is missing is a text of its own."""
    if isinstance(column.dtype, pd.CategoricalDtype) and not column.hasnans:
        return np.asarray(column.cat.codes, dtype=np.intp), column.cat.categories
    return pd.factorize(column, use_na_sentinel=False)


def _there(column: "pd.Series[str]") -> Flags:
    """Mask of the rows in which a column is filled, shape (n,): a number, or a text that is not empty."""
    if _is_numeric(column):
        return column.notna().to_numpy(dtype=bool)
    code, unique = pd.factorize(column)
    return np.array([*(label_of(value) != "" for value in unique), False], dtype=bool)[code]


def _is_numeric(column: "pd.Series[Any]") -> bool:
    return pd.api.types.is_numeric_dtype(column)


NUMBER = "pair of the row"


def _only(rows: PairRows, keep: Flags) -> PairRows:
    """The rows that are kept, with their lines."""
    return replace(rows, frame=rows.frame[keep], lines=None if rows.lines is None else rows.lines[keep])


def laws_of_pairs(of: NumberedRows, options: BatchOptions) -> pd.DataFrame:
    """For each pair a row for each law that its columns ask for, the columns that hold anything of it.

    Parameters
    ----------
    of : NumberedRows
    options : BatchOptions

    Returns
    -------
    DataFrame
        As `law_table`, by pair; a law that the rows of a pair do not allow has its reason. No pair raises.
    """
    found: list[pd.DataFrame] = []
    for (laws, by_edge), groups in _pairs_by_laws(of, options).items():
        pairs = np.sort(np.concatenate(groups))
        for asked in laws:
            if missing := [name for name in (asked.response, *asked.factors) if name not in of.rows.frame]:
                why = f"law {asked.request!r}: there is no column {missing[0]!r}."
                unit = unit_of(of.rows.units, asked.response)
                found.append(law_table((i, row_without(asked, unit, why)) for i in pairs.tolist()))
            elif is_stacked(asked, options):
                found += _stack(of, asked, pairs, "edge" if by_edge else None)
            else:
                found.append(_one_by_one(of, asked, pairs, options))
    return joined_tables(found)


def _pairs_by_laws(of: NumberedRows, options: BatchOptions) -> dict[tuple[tuple[Asked, ...], bool], list[Ints]]:
    """Numbers of pairs by the laws that their columns ask for, and by whether they name edges."""
    alike: dict[tuple[tuple[Asked, ...], bool], list[Ints]] = {}
    for held, pairs in of.patterns():
        alike.setdefault((requested_laws(held, options.laws), held.has("edge")), []).append(pairs)
    return alike


def is_stacked(asked: Asked, options: BatchOptions) -> bool:
    """Whether a law is fitted to many pairs or streamed rows at once: a power law of ln R, not of tool lives."""
    form = options.form_of(asked.response) or asked.form
    return form == asked.form == "power" and asked.response != "T" and options.error == "multiplicative"


def infinite(runs: Runs, names: Collection[str] = ROLES) -> str:
    """The first infinite value of these columns, or nothing; no law can be fitted to it.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from fitmodels import datasets
    >>> runs = datasets.read_runs(datasets.bundled("ac2017_table1"))
    >>> infinite(replace(runs, data=runs.data.assign(V=np.inf)))
    "column 'V' line 7: inf is no measurement; leave the row out."
    """
    numeric = [name for name in names if name in runs.data and pd.api.types.is_numeric_dtype(runs.data[name])]
    for name in numeric:
        at = np.flatnonzero(np.isinf(runs.data[name].to_numpy(dtype=float, na_value=np.nan)))
        if at.size:
            line = runs.lines[at[0]]
            where = f"row {line} of this pair" if runs.source.dialect == NO_LINES else f"line {line}"
            return _no_measurement(name, where, runs.data[name].iloc[at[0]])
    return ""


def unit_of(units: Mapping[str, str], symbol: str) -> str:
    """Unit of a response; the default one where none is given."""
    return units.get(symbol, ROLES[symbol].unit if symbol in ROLES else "")


def _stack(of: NumberedRows, asked: Asked, pairs: Ints, edge: str | None) -> list[pd.DataFrame]:
    """A power law of some pairs."""
    unit = unit_of(of.rows.units, asked.response)
    made = attempt(lambda: _of_stack(of, asked, pairs, edge, unit))
    if not isinstance(made, Failure):
        return [made]
    if made.expected or len(pairs) == 1:
        return [law_table((i, row_without(asked, unit, made.reason)) for i in pairs.tolist())]
    return [table for i in pairs for table in _stack(of, asked, pairs[pairs == i], edge)]  # one of them is at fault


def _of_stack(of: NumberedRows, asked: Asked, pairs: Ints, edge: str | None, unit: str) -> pd.DataFrame:
    from ...fit import many_power_laws

    names = [asked.response, *asked.factors]
    held = {name: of.rows.frame[name] for name in (*names, *([edge] if edge else []))}
    table = pd.DataFrame(held | {NUMBER: of.number}, copy=False)
    rows = np.arange(len(table))
    if len(pairs) < len(of.pairs):
        mine = np.zeros(len(of.pairs), dtype=bool)
        mine[pairs] = True
        rows = np.flatnonzero(mine[of.number])
        table = table.iloc[rows]
    laws = many_power_laws(table, asked.response, asked.factors, pair=NUMBER, edge=edge)
    return table_of_many(laws, unit, pd.unique(of.number[rows]), _infinite_pairs(of, names, rows))


def _infinite_pairs(of: NumberedRows, names: list[str], rows: Ints) -> dict[int, str]:
    """Pairs, by their number, that hold an infinite value, and the line where it stands in their file."""
    at: dict[int, str] = {}
    for name in names:
        if name in of.ends and not np.isinf(of.ends[name]).any():
            continue
        values = of.rows.frame[name].to_numpy(dtype=float, na_value=np.nan)
        infinite = rows[np.isinf(values[rows])]
        pairs, first = np.unique(of.number[infinite], return_index=True)
        for pair, row in zip(pairs.tolist(), infinite[first].tolist(), strict=True):
            if pair not in at:
                at[pair] = _no_measurement(name, _where(of, row), values[row])
    return at


def _where(of: NumberedRows, row: int) -> str:
    """Line or number of a row in its source."""
    if of.rows.lines is not None:
        return f"line {of.rows.lines[row]}"
    return f"row {1 + np.count_nonzero(of.number[:row] == of.number[row])} of this pair"


def _no_measurement(name: str, where: str, value: float) -> str:
    return f"column {name!r} {where}: {value:g} is no measurement; leave the row out."


def _one_by_one(of: NumberedRows, asked: Asked, pairs: Ints, options: BatchOptions) -> pd.DataFrame:
    unit = unit_of(of.rows.units, asked.response)
    runs = dict(of.rows.runs())
    return law_table((i, _one(runs[of.pairs[i]], asked, unit, options)) for i in pairs.tolist())


def _one(runs: Runs, asked: Asked, unit: str, options: BatchOptions) -> dict[str, Cell]:
    def fitted() -> dict[str, Cell]:
        held = without_empty_columns(runs)
        if why := infinite(held, (asked.response, *asked.factors)):
            return row_without(asked, unit, why)
        return row_of(fit_asked(held, asked, error=options.error, forms=options.forms), asked)

    made = attempt(fitted)
    return row_without(asked, unit, made.reason) if isinstance(made, Failure) else made
