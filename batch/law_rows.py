"""Laws as rows of a table: one row for each law, in columns of numbers, texts and flags known by their names."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from ..core.arrays import Array, Flags, Ints
from ..fit.defaults import Asked
from .outcomes import Cell, cell

if TYPE_CHECKING:
    from ..fit import LawFit
    from ..fit.many.many_laws import ManyLaws

PAIR = "pair"  # number of the pair of a row
LAW = ("response", "form", "unit", "reason")
ENDS = ("from", "to")  # of each factor among the rows of the law: ``from_V``
OF_RESPONSE = ("response_from", "response_to")
NO_ENDS = (None, None)
WHOLE = (
    "nobs", "n_edges", "df", "df_resid", "rsquared", "rsquared_adj", "fvalue", "f_pvalue", "scale_se", *OF_RESPONSE,
)  # fmt: skip
PARTS = ("params", "bse", "row_bse", "low", "high", "tvalues", "pvalues")  # of each parameter: ``params_V``
NOTES = ("by_edge", "dropped", "left_out", "edge_reason")

COUNTS = frozenset({"nobs", "n_edges", "df", "df_resid", "dropped"})
FLAGS = frozenset({"by_edge", "simulated"})
TEXTS = frozenset({*LAW, "verdict", "left_out", "edge_reason", "no_posterior"})

BEFORE, AFTER = (
    ("verdict", "simulated", *WHOLE),
    (*NOTES, "no_posterior"),
)  # of a law: columns before and after its parameters
PARAMETER = re.compile(f"({'|'.join((*PARTS, *ENDS))})_(.+)", re.DOTALL)

Column: TypeAlias = Any  # an array or series of floats or texts, or of integers or flags that may be missing


def law_table(rows: Iterable[tuple[int, Mapping[str, Cell]]]) -> pd.DataFrame:
    """Make a table of rows, each given with the number of its pair.

    Returns
    -------
    DataFrame
        ``pair``, the columns of `LAW` and every other that a row has: Int64 for `COUNTS`, boolean for `FLAGS`, text
        for `TEXTS`, float for all others. Missing and non-finite values are NA, NaN or empty.

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
    """Cells as a column of the type of its name.

    >>> column("params_V", [0.5, None, float("inf")]).tolist(), column("reason", ["", None]).tolist()
    ([0.5, nan, nan], ['', ''])
    """
    cells = [cell(value) for value in values]
    if name in TEXTS:
        return texts("" if value is None else str(value) for value in cells)
    if name in COUNTS or name in FLAGS:
        return pd.array(np.array(cells, dtype=object), dtype="Int64" if name in COUNTS else "boolean")
    return np.array([np.nan if value is None else value for value in cells], dtype=float)


def texts(values: Iterable[str]) -> Column:
    """Texts, shape (n,), of dtype object.

    >>> texts(["AW", ""]).dtype
    dtype('O')
    """
    return pd.Series(list(values), dtype=object)


def counts(values: ArrayLike, there: ArrayLike = True) -> Column:
    """Whole numbers, shape (n,), NA where not ``there``.

    >>> counts([24, 0], [True, False]).tolist()
    [24, <NA>]
    """
    whole = np.asarray(values, dtype=np.int64)
    return pd.arrays.IntegerArray(whole, ~np.broadcast_to(np.asarray(there, dtype=bool), whole.shape))


def flags(values: ArrayLike) -> Column:
    """Flags, shape (n,), none of them missing.

    >>> flags([True, False]).dtype
    BooleanDtype
    """
    found = np.asarray(values, dtype=bool)
    return pd.arrays.BooleanArray(found, np.zeros(found.shape, dtype=bool))


def finite(values: ArrayLike) -> Array:
    """Doubles, shape (n,), NaN where they are not finite.

    >>> finite([1.0, float("inf")]).tolist()
    [1.0, nan]
    """
    found = np.array(values, dtype=np.float64)
    found[~np.isfinite(found)] = np.nan
    return found


def joined_tables(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Join tables, by pair; the rows of a pair keep their order.

    Examples
    --------
    >>> one, other = law_table([(1, {"response": "AW"})]), law_table([(0, {"response": "P", "no_posterior": "none"})])
    >>> joined_tables([one, other])[["pair", "response", "no_posterior"]].to_dict("list")
    {'pair': [0, 1], 'response': ['P', 'AW'], 'no_posterior': ['none', '']}
    """
    if len(tables) < 2:
        return _by_pair(tables[0]) if tables else law_table(())
    names = list(dict.fromkeys(str(name) for table in tables for name in table))
    return _by_pair(pd.concat([_with_columns(table, names) for table in tables], ignore_index=True))


def group_column(header: str) -> str:
    """Column of the results for a grouping: its header, unless the table has its own column of that name.

    Examples
    --------
    >>> group_column("grade"), group_column("form")
    ('grade', 'group form')
    """
    own = header in {"tool", "work", *LAW, *BEFORE, *AFTER} or header.startswith("posterior")
    return f"group {header}" if own or PARAMETER.fullmatch(header) else header


def _by_pair(table: pd.DataFrame) -> pd.DataFrame:
    pairs = table[PAIR].to_numpy()
    if np.all(pairs[1:] >= pairs[:-1]):
        return table
    return table.iloc[np.argsort(pairs, kind="stable")].reset_index(drop=True)


def _with_columns(table: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """The table with these columns in this order, empty where it has none."""
    if list(table) == list(names):
        return table
    return pd.DataFrame({name: table[name] if name in table else column(name, [None] * len(table)) for name in names})


def renumbered(table: pd.DataFrame, numbers: Sequence[int] | Ints) -> pd.DataFrame:
    """The table with pair i as pair ``numbers[i]``.

    >>> renumbered(law_table([(0, {"nobs": 9}), (1, {"nobs": 8})]), [5, 3])["pair"].tolist()
    [5, 3]
    """
    return table.assign(**{PAIR: np.asarray(numbers, dtype=np.intp)[table[PAIR].to_numpy()]})


def fitted(table: pd.DataFrame) -> Flags:
    """Mask of the rows that are laws, shape (n,); the others have a reason."""
    return (table["reason"] == "").to_numpy(dtype=bool)


LEVEL = 0.95


def table_of_many(laws: "ManyLaws", unit: str, pairs: Ints, reasons: Mapping[int, str]) -> pd.DataFrame:
    """The laws of a stack.

    Parameters
    ----------
    laws : ManyLaws
    unit : str
        Of the response.
    pairs : ndarray of int, shape (K,)
        Their numbers.
    reasons : mapping of int to str
        More specific reasons of pairs, by number, that have no law.

    Examples
    --------
    >>> from fitmodels import fit
    >>> V = np.array([50.0, 80, 125, 200])
    >>> table = {"tool": ["A"] * 4, "V": V, "AW": V**0.5 * [1, 1.1, 1, 1.1]}
    >>> made = table_of_many(fit.many_power_laws(table, "AW", ["V"], pair="tool"), "mm", np.array([7]), {})
    >>> made[["pair", "response", "nobs", "params_V", "reason"]].round(3).values.tolist()
    [[7, 'AW', 4, 0.542, '']]
    """
    table, there, K = laws.columns() | laws.ends(LEVEL), laws.fitted, len(laws)
    same = {"response": laws.response, "form": "power", "unit": unit}
    columns: dict[str, Column] = {name: texts([text] * K) for name, text in same.items()}
    columns["reason"] = texts(reasons.get(i, why) for i, why in zip(pairs.tolist(), table["reason"], strict=True))
    for name in WHOLE:
        columns[name] = counts(table[name], there) if name in COUNTS else finite(table[name])
    columns["nobs"] = counts(table["nobs"])
    columns["n_edges"] = counts(table["n_edges"], table["n_edges"] > 0)
    for name in NOTES:
        values = table[name]
        columns[name] = counts(values) if name in COUNTS else flags(values) if name in FLAGS else texts(values)
    columns |= {name: finite(table[name]) for name in _columns_of(laws.names, laws.factors)}
    return pd.DataFrame({PAIR: pairs, **columns})


def row_of(law: "LawFit", asked: Asked) -> dict[str, Cell]:
    """The row of one law; a requested factor that was left out has its columns too.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("clm2023_end_milling"))
    >>> row = row_of(fit.load_law(runs), Asked("I", ("fm", "VB"), "load_line"))
    >>> row["response"], row["form"], row["nobs"]
    ('fm', 'feed_line', 7)
    """
    from ..fit.edges import EdgeInference

    by_edge = isinstance(law.edges, EdgeInference)
    row: dict[str, Cell] = {
        "response": law.response, "form": law.form, "unit": law.units.get(law.response, ""), "reason": "",
        **{name: cell(getattr(law, name)) for name in WHOLE if name not in OF_RESPONSE},
        **dict(zip(OF_RESPONSE, law.response_range or NO_ENDS, strict=True)),
        "by_edge": by_edge,
        "dropped": sum(item.count for item in law.dropped),
        "left_out": "; ".join(f"{item.factor} {item.reason}" for item in law.left_out),
        "edge_reason": "" if isinstance(law.edges, EdgeInference) else law.edges.reason,
    }  # fmt: skip
    ends = law.conf_int(LEVEL)
    held = {name: getattr(law, name) for name in PARTS if name not in ends} | {name: ends[name] for name in ends}
    power = law.form == "power"
    for name in ("c0", *asked.factors) if power else law.names:
        row |= {f"{part}_{name}": cell(held[part].get(name)) for part in PARTS}
    for name in asked.factors if power else law.factors:
        row |= {f"{end}_{name}": value for end, value in zip(ENDS, law.domain.get(name, NO_ENDS), strict=True)}
    return row


def _columns_of(parameters: Sequence[str], factors: Sequence[str]) -> list[str]:
    """Columns of the parameters of a law and of the ends of its factors."""
    of_parameters = [f"{part}_{name}" for name in parameters for part in PARTS]
    return of_parameters + [f"{end}_{name}" for name in factors for end in ENDS]


def row_without(asked: Asked, unit: str, reason: str) -> dict[str, Cell]:
    """The row of a law that could not be fitted, with the reason.

    Examples
    --------
    >>> row_without(Asked("AW", ("V",)), "mm", "too few rows")["params_V"] is None
    True
    """
    row: dict[str, Cell] = {
        "response": asked.response, "form": asked.form, "unit": unit, "reason": reason,
        **dict.fromkeys(WHOLE), "nobs": 0, "by_edge": False, "dropped": 0, "left_out": "", "edge_reason": "",
    }  # fmt: skip
    return row | dict.fromkeys(_columns_of(("c0", *asked.factors), asked.factors) if asked.form == "power" else ())


def refusals(table: pd.DataFrame) -> dict[int, list[str]]:
    """Sentences on the laws that could not be fitted, by number of the pair; equal reasons are joined.

    Examples
    --------
    >>> rows = [{"response": "AW", "reason": "AW: too few rows."}, {"response": "P", "reason": "P is 1."}]
    >>> refusals(law_table((4, row) for row in rows))
    {4: ['AW is not fitted: too few rows.', 'P is not fitted: P is 1.']}
    """
    found: dict[int, dict[str, list[str]]] = {}
    without = table[~fitted(table)]
    for pair, response, reason in zip(*(without[name] for name in (PAIR, "response", "reason")), strict=True):
        found.setdefault(pair, {}).setdefault(reason.removeprefix(f"{response}: "), []).append(response)
    return {pair: [_refused(of, why) for why, of in each.items()] for pair, each in found.items()}


def reasons(table: pd.DataFrame) -> dict[int, str]:
    """Reason of each pair without any law, by its number.

    >>> rows = [{"response": "AW", "reason": "too few rows."}, {"response": "P", "reason": ""}]
    >>> reasons(law_table([(0, rows[0]), (0, rows[1]), (1, rows[0])]))
    {1: 'AW is not fitted: too few rows.'}
    """
    with_law = set(table[PAIR][fitted(table)].tolist())
    return {pair: " ".join(words) for pair, words in refusals(table).items() if pair not in with_law}


def _refused(responses: Sequence[str], why: str) -> str:
    return f"{', '.join(responses)} {'are' if len(responses) > 1 else 'is'} not fitted: {why}"
