"""Laws, one or a stack of them, as rows of the table of laws; and the sentences for those that there are not."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...fit.defaults import Asked
from ..law_table import COUNTS, NOTES, PAIR, PARTS, TRUTHS, WHOLE, Column, counts, finite, fitted, texts, truths
from ..outcome import Cell, cell

if TYPE_CHECKING:
    from ...fit import LawFit
    from ...fit.many.laws_of_pairs import ManyLaws

Ints = NDArray[np.intp]

LEVEL = 0.95
FORMS = {"power": "power", "load": "load_line", "exponential": "exponential"}


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
        Better words for why a pair, by its number, has no law.

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
        columns[name] = counts(values) if name in COUNTS else truths(values) if name in TRUTHS else texts(values)
    columns |= {name: finite(table[name]) for each in laws.names for part in PARTS for name in [f"{part}_{each}"]}
    return pd.DataFrame({PAIR: pairs, **columns})


def row_of(law: "LawFit", asked: Asked) -> dict[str, Cell]:
    """The row of one law; a factor that was asked for and left out has its columns too.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("clm2023_end_milling"))
    >>> row = row_of(fit.load_law(runs), Asked("I", ("fm", "VB"), "load"))
    >>> row["response"], row["form"], row["nobs"]
    ('fm', 'feed_line', 7)
    """
    from ...fit.edges import EdgeInference

    by_edge = isinstance(law.edges, EdgeInference)
    row: dict[str, Cell] = {
        "response": law.response, "form": law.form, "unit": law.units.get(law.response, ""), "reason": "",
        **{name: cell(getattr(law, name)) for name in WHOLE},
        "by_edge": by_edge,
        "dropped": sum(item.count for item in law.dropped),
        "left_out": "; ".join(f"{item.factor} {item.reason}" for item in law.left_out),
        "edge_reason": "" if isinstance(law.edges, EdgeInference) else law.edges.reason,
    }  # fmt: skip
    ends = law.conf_int(LEVEL)
    held = {name: getattr(law, name) for name in PARTS if name not in ends} | {name: ends[name] for name in ends}
    names = law.names if asked.kind != "power" else ("c0", *asked.factors)
    for name in names:
        row |= {f"{part}_{name}": cell(held[part].get(name)) for part in PARTS}
    return row


def row_without(asked: Asked, unit: str, reason: str) -> dict[str, Cell]:
    """The row of a law that there is not, and why.

    Examples
    --------
    >>> row_without(Asked("AW", ("V",)), "mm", "too few rows")["params_V"] is None
    True
    """
    row: dict[str, Cell] = {
        "response": asked.response, "form": FORMS[asked.kind], "unit": unit, "reason": reason,
        **dict.fromkeys(WHOLE), "nobs": 0, "by_edge": False, "dropped": 0, "left_out": "", "edge_reason": "",
    }  # fmt: skip
    names = ("c0", *asked.factors) if asked.kind == "power" else ()
    return row | {f"{part}_{name}": None for name in names for part in PARTS}


def refusals(table: pd.DataFrame) -> dict[int, list[str]]:
    """Sentences of each pair that lacks a law it could have, by its number; a reason of several is said once.

    Examples
    --------
    >>> from fitmodels.batch.law_table import law_table
    >>> rows = [{"response": "AW", "reason": "AW: too few rows."}, {"response": "P", "reason": "P is 1."}]
    >>> refusals(law_table((4, row) for row in rows))
    {4: ['AW is not fitted: too few rows.', 'P is not fitted: P is 1.']}
    """
    said: dict[int, dict[str, list[str]]] = {}
    without = table[~fitted(table)]
    for pair, response, reason in zip(*(without[name] for name in (PAIR, "response", "reason")), strict=True):
        said.setdefault(pair, {}).setdefault(reason.removeprefix(f"{response}: "), []).append(response)
    return {pair: [_refused(of, why) for why, of in each.items()] for pair, each in said.items()}


def reasons(table: pd.DataFrame) -> dict[int, str]:
    """Why a pair has no law at all, by its number.

    >>> from fitmodels.batch.law_table import law_table
    >>> rows = [{"response": "AW", "reason": "too few rows."}, {"response": "P", "reason": ""}]
    >>> reasons(law_table([(0, rows[0]), (0, rows[1]), (1, rows[0])]))
    {1: 'AW is not fitted: too few rows.'}
    """
    with_law = set(table[PAIR][fitted(table)].tolist())
    return {pair: " ".join(words) for pair, words in refusals(table).items() if pair not in with_law}


def _refused(responses: Sequence[str], why: str) -> str:
    return f"{', '.join(responses)} {'are' if len(responses) > 1 else 'is'} not fitted: {why}"
