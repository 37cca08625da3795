"""The table of laws of many pairs: power laws as stacks over all pairs at once, other laws pair by pair."""

from collections.abc import Collection, Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...datasets import Runs
from ...datasets.vocabulary import ROLES
from ...fit.defaults import Asked, asked_laws, fit_asked
from ..failures import Failed, tried
from ..how import How
from ..law_table import below_each_other, law_table
from ..outcome import Cell
from ..rows import NO_LINES
from .pairs_of_rows import PairsOfRows, only_held
from .table_rows import row_of, row_without, table_of_many

Ints = NDArray[np.intp]

NUMBER = "pair of the row"


def laws_of_pairs(of: PairsOfRows, how: How) -> pd.DataFrame:
    """For each pair a row for each law that its columns ask for, the columns that hold anything of it.

    Parameters
    ----------
    of : PairsOfRows
    how : How

    Returns
    -------
    DataFrame
        As `law_table`, by pair; a law that the rows of a pair do not allow has its reason. No pair raises.
    """
    found: list[pd.DataFrame] = []
    for held, pairs in of.patterns():
        for asked in asked_laws(held.__contains__):
            if asked.kind == "power" and how.error == "multiplicative":
                found += _stack(of, asked, pairs, "edge" if "edge" in held else None)
            else:
                found.append(_one_by_one(of, asked, pairs, how))
    return below_each_other(found)


def infinite(runs: Runs, names: Collection[str] = ROLES) -> str:
    """Which value of these columns is infinite, or nothing; no law can be fitted to it.

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
    """Unit of a response; the usual one where nobody says."""
    return units.get(symbol, ROLES[symbol].unit if symbol in ROLES else "")


def _stack(of: PairsOfRows, asked: Asked, pairs: Ints, edge: str | None) -> list[pd.DataFrame]:
    """A power law of some pairs."""
    unit = unit_of(of.rows.units, asked.response)
    made = tried(lambda: _of_stack(of, asked, pairs, edge, unit))
    if not isinstance(made, Failed):
        return [made]
    if made.expected or len(pairs) == 1:
        return [law_table((i, row_without(asked, unit, made.reason)) for i in pairs.tolist())]
    return [table for i in pairs for table in _stack(of, asked, pairs[pairs == i], edge)]  # one of them is at fault


def _of_stack(of: PairsOfRows, asked: Asked, pairs: Ints, edge: str | None, unit: str) -> pd.DataFrame:
    from ...fit import many_power_laws

    names = [asked.response, *asked.factors]
    table = of.rows.frame[[*names, *([edge] if edge else [])]].assign(**{NUMBER: of.number})
    rows = np.arange(len(table))
    if len(pairs) < len(of.pairs):
        mine = np.zeros(len(of.pairs), dtype=bool)
        mine[pairs] = True
        rows = np.flatnonzero(mine[of.number])
        table = table.iloc[rows]
    laws = many_power_laws(table, asked.response, asked.factors, pair=NUMBER, edge=edge)
    return table_of_many(laws, unit, pd.unique(of.number[rows]), _infinite_pairs(of, names, rows))


def _infinite_pairs(of: PairsOfRows, names: list[str], rows: Ints) -> dict[int, str]:
    """Pairs, by their number, that hold an infinite value, and the line where it stands in their file."""
    at: dict[int, str] = {}
    for name in names:
        values = of.rows.frame[name].to_numpy(dtype=float, na_value=np.nan)
        infinite = rows[np.isinf(values[rows])]
        pairs, first = np.unique(of.number[infinite], return_index=True)
        for pair, row in zip(pairs.tolist(), infinite[first].tolist(), strict=True):
            if pair not in at:
                at[pair] = _no_measurement(name, _where(of, row), values[row])
    return at


def _where(of: PairsOfRows, row: int) -> str:
    """Where a row stands, as whoever made the source can find it."""
    if of.rows.lines is not None:
        return f"line {of.rows.lines[row]}"
    return f"row {1 + np.count_nonzero(of.number[:row] == of.number[row])} of this pair"


def _no_measurement(name: str, where: str, value: float) -> str:
    return f"column {name!r} {where}: {value:g} is no measurement; leave the row out."


def _one_by_one(of: PairsOfRows, asked: Asked, pairs: Ints, how: How) -> pd.DataFrame:
    unit = unit_of(of.rows.units, asked.response)
    runs = dict(of.rows.runs())
    return law_table((i, _one(runs[of.pairs[i]], asked, unit, how)) for i in pairs.tolist())


def _one(runs: Runs, asked: Asked, unit: str, how: How) -> dict[str, Cell]:
    def fitted() -> dict[str, Cell]:
        held = only_held(runs)
        if why := infinite(held, (asked.response, *asked.factors)):
            return row_without(asked, unit, why)
        return row_of(fit_asked(held, asked, error=how.error), asked)

    made = tried(fitted)
    return row_without(asked, unit, made.reason) if isinstance(made, Failed) else made
