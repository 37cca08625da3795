"""Rows of the results table: power laws as stacks over all pairs at once, other laws pair by pair."""

from collections.abc import Collection, Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...datasets import Runs
from ...datasets.vocabulary import ROLES
from ...fit.defaults import Asked, asked_laws, fit_asked
from ..how import How
from ..outcome import Cell
from ..plan import Pair
from .failures import Failed, tried
from .pairs_of_rows import PairsOfRows, only_held
from .table_rows import row_of, row_without, rows_of_many

Ints = NDArray[np.intp]
LawRows = list[dict[str, Cell]]

PAIR = "pair of the row"


def laws_of_pairs(of: PairsOfRows, how: How) -> list[LawRows]:
    """For each pair a row for each law that its columns ask for, the columns that hold anything of it.

    Parameters
    ----------
    of : PairsOfRows
    how : How

    Returns
    -------
    list of K lists
        A law that the rows of a pair do not allow has its reason. No pair raises.
    """
    found: list[LawRows] = [[] for _ in of.pairs]
    for held, pairs in of.patterns():
        for asked in asked_laws(held.__contains__):
            if asked.kind == "power" and how.error == "multiplicative":
                new = _stack(of, asked, pairs, "edge" if "edge" in held else None)
            else:
                new = _one_by_one(of, asked, pairs, how)
            for i, row in zip(pairs.tolist(), new, strict=True):
                found[i].append(row)
    return found


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
            return _no_measurement(name, runs.lines[at[0]], runs.data[name].iloc[at[0]])
    return ""


def unit_of(units: Mapping[str, str], symbol: str) -> str:
    """Unit of a response; the usual one where nobody says."""
    return units.get(symbol, ROLES[symbol].unit if symbol in ROLES else "")


def _stack(of: PairsOfRows, asked: Asked, pairs: Ints, edge: str | None) -> LawRows:
    """Rows of a power law of some pairs, in their order."""
    unit = unit_of(of.rows.units, asked.response)
    made = tried(lambda: _of_stack(of, asked, pairs, edge, unit))
    if not isinstance(made, Failed):
        return made
    if made.expected or len(pairs) == 1:
        return [row_without(asked, unit, made.reason) for _ in pairs]
    return [row for i in pairs for row in _stack(of, asked, pairs[pairs == i], edge)]  # one of them is at fault


def _of_stack(of: PairsOfRows, asked: Asked, pairs: Ints, edge: str | None, unit: str) -> LawRows:
    from ...fit import many_power_laws

    names = [asked.response, *asked.factors]
    mine = np.zeros(len(of.pairs), dtype=bool)
    mine[pairs] = True
    rows = np.flatnonzero(mine[of.number])
    table = of.rows.frame[[*names, *([edge] if edge else [])]].iloc[rows].assign(**{PAIR: of.number[rows]})
    order = pd.unique(of.number[rows])
    laws = many_power_laws(table, asked.response, asked.factors, pair=PAIR, edge=edge)
    made = rows_of_many(laws, unit, _infinite_pairs(of, names, rows, order))
    return [made[i] for i in np.argsort(order)]


def _infinite_pairs(of: PairsOfRows, names: list[str], rows: Ints, order: Ints) -> dict[int, str]:
    """Pairs, by their position, that hold an infinite value, and the line where it stands in their file."""
    at: dict[int, str] = {}
    place = np.empty(len(of.pairs), dtype=np.intp)
    place[order] = np.arange(len(order))
    for name in names:
        values = of.rows.frame[name].to_numpy(dtype=float, na_value=np.nan)
        for row in rows[np.isinf(values[rows])]:
            at.setdefault(int(place[of.number[row]]), _no_measurement(name, of.rows.lines[row], values[row]))
    return at


def _no_measurement(name: str, line: int, value: float) -> str:
    return f"column {name!r} line {line}: {value:g} is no measurement; leave the row out."


def _one_by_one(of: PairsOfRows, asked: Asked, pairs: Ints, how: How) -> LawRows:
    unit = unit_of(of.rows.units, asked.response)
    wanted = {of.pairs[i] for i in pairs}
    runs: dict[Pair, Runs] = {pair: runs for pair, runs in of.rows.runs() if pair in wanted}
    return [_one(runs[of.pairs[i]], asked, unit, how) for i in pairs]


def _one(runs: Runs, asked: Asked, unit: str, how: How) -> dict[str, Cell]:
    def fitted() -> dict[str, Cell]:
        held = only_held(runs)
        if why := infinite(held, (asked.response, *asked.factors)):
            return row_without(asked, unit, why)
        return row_of(fit_asked(held, asked, error=how.error), asked)

    made = tried(fitted)
    return row_without(asked, unit, made.reason) if isinstance(made, Failed) else made
