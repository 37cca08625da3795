"""Laws of pairs as a table: a row a law, numbers, texts and truths in columns that are known by their names."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from .outcome import Cell, cell

PAIR = "pair"  # number of the pair of a row
LAW = ("response", "form", "unit", "reason")
WHOLE = ("nobs", "n_edges", "df", "df_resid", "rsquared", "rsquared_adj", "fvalue", "f_pvalue", "scale_se")
PARTS = ("params", "bse", "row_bse", "low", "high", "tvalues", "pvalues")  # of each parameter: ``params_V``
NOTES = ("by_edge", "dropped", "left_out", "edge_reason")

COUNTS = frozenset({"nobs", "n_edges", "df", "df_resid", "dropped"})
TRUTHS = frozenset({"by_edge", "simulated"})
TEXTS = frozenset({*LAW, "left_out", "edge_reason", "no_posterior"})

Ints = NDArray[np.intp]
Column: TypeAlias = Any  # an array or series of doubles or texts, or of whole numbers or truths that may be missing


def law_table(rows: Iterable[tuple[int, Mapping[str, Cell]]]) -> pd.DataFrame:
    """Make a table of rows, each given with the number of its pair.

    Returns
    -------
    DataFrame
        ``pair``, the columns of `LAW` and every other that a row has: Int64 for `COUNTS`, boolean for `TRUTHS`, text
        for `TEXTS`, float for all others. What a row does not have is NA, NaN or empty, and so is what is not finite.

    Examples
    --------
    >>> made = law_table([(3, {"response": "AW", "nobs": 9, "params_V": 0.5}), (4, {"response": "P"})])
    >>> [made[name].tolist() for name in ("pair", "nobs", "params_V")]
    [[3, 4], [9, <NA>], [0.5, nan]]
    """
    given = list(rows)
    names = dict.fromkeys((*LAW, *(name for _, row in given for name in row)))
    pairs = np.array([pair for pair, _ in given], dtype=np.intp)
    return pd.DataFrame({PAIR: pairs, **{name: column(name, [row.get(name) for _, row in given]) for name in names}})


def column(name: str, values: Sequence[object]) -> Column:
    """Cells as a column of the kind that its name says.

    >>> column("params_V", [0.5, None, float("inf")]).tolist(), column("reason", ["", None]).tolist()
    ([0.5, nan, nan], ['', ''])
    """
    cells = [cell(value) for value in values]
    if name in TEXTS:
        return texts("" if value is None else str(value) for value in cells)
    if name in COUNTS or name in TRUTHS:
        return pd.array(np.array(cells, dtype=object), dtype="Int64" if name in COUNTS else "boolean")
    return np.array([np.nan if value is None else value for value in cells], dtype=float)


def texts(values: Iterable[str]) -> Column:
    """Texts, shape (n,): as Python's own, whatever pandas makes of them otherwise.

    >>> texts(["AW", ""]).dtype
    dtype('O')
    """
    return pd.Series(list(values), dtype=object)


def counts(values: ArrayLike, there: ArrayLike = True) -> Column:
    """Whole numbers, shape (n,), NA where they are not ``there``.

    >>> counts([24, 0], [True, False]).tolist()
    [24, <NA>]
    """
    whole = np.asarray(values, dtype=np.int64)
    return pd.arrays.IntegerArray(whole, ~np.broadcast_to(np.asarray(there, dtype=bool), whole.shape))


def truths(values: ArrayLike) -> Column:
    """Truths, shape (n,), none of them missing.

    >>> truths([True, False]).dtype
    BooleanDtype
    """
    found = np.asarray(values, dtype=bool)
    return pd.arrays.BooleanArray(found, np.zeros(found.shape, dtype=bool))


def finite(values: ArrayLike) -> NDArray[np.float64]:
    """Doubles, shape (n,), NaN where they are not finite.

    >>> finite([1.0, float("inf")]).tolist()
    [1.0, nan]
    """
    found = np.array(values, dtype=np.float64)
    found[~np.isfinite(found)] = np.nan
    return found


def below_each_other(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Join tables, by pair; the rows of a pair keep their order.

    Examples
    --------
    >>> one, other = law_table([(1, {"response": "AW"})]), law_table([(0, {"response": "P", "no_posterior": "none"})])
    >>> below_each_other([one, other])[["pair", "response", "no_posterior"]].to_dict("list")
    {'pair': [0, 1], 'response': ['P', 'AW'], 'no_posterior': ['none', '']}
    """
    if len(tables) < 2:
        return _by_pair(tables[0]) if tables else law_table(())
    names = dict.fromkeys(name for table in tables for name in table if name != PAIR)
    pairs = np.concatenate([table[PAIR].to_numpy() for table in tables])
    return _by_pair(pd.DataFrame({PAIR: pairs, **{str(name): _joined(str(name), tables) for name in names}}))


def _by_pair(table: pd.DataFrame) -> pd.DataFrame:
    pairs = table[PAIR].to_numpy()
    if np.all(pairs[1:] >= pairs[:-1]):
        return table
    return table.iloc[np.argsort(pairs, kind="stable")].reset_index(drop=True)


def _joined(name: str, tables: Sequence[pd.DataFrame]) -> "pd.Series[Any]":
    parts = [table[name] if name in table else pd.Series(column(name, [None] * len(table))) for table in tables]
    return pd.concat(parts, ignore_index=True)


def numbered_anew(table: pd.DataFrame, numbers: Sequence[int] | Ints) -> pd.DataFrame:
    """The table with pair i as pair ``numbers[i]``.

    >>> numbered_anew(law_table([(0, {"nobs": 9}), (1, {"nobs": 8})]), [5, 3])["pair"].tolist()
    [5, 3]
    """
    return table.assign(**{PAIR: np.asarray(numbers, dtype=np.intp)[table[PAIR].to_numpy()]})


def fitted(table: pd.DataFrame) -> NDArray[np.bool_]:
    """Which rows are laws, shape (n,); the others have a reason."""
    return (table["reason"] == "").to_numpy(dtype=bool)
