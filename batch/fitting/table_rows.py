"""Laws as rows of the results table: mappings of plain cells, None where there is no number."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...fit.defaults import Asked
from ..outcome import NOTES, PARTS, WHOLE, Cell, cell

if TYPE_CHECKING:
    from ...fit import LawFit, ManyLaws, StreamedLaw

LawRow: TypeAlias = Mapping[str, Cell]

LEVEL = 0.95
FORMS = {"power": "power", "load": "load_line", "exponential": "exponential"}


def rows_of_many(laws: "ManyLaws", unit: str, reasons: Mapping[int, str] | None = None) -> list[dict[str, Cell]]:
    """A row for each pair of a stack, in its order.

    Parameters
    ----------
    laws : ManyLaws
    unit : str
        Of the response.
    reasons : mapping of int to str, optional
        Better words for why a pair, by its position, has no law.

    Examples
    --------
    >>> from fitmodels import fit
    >>> V = np.array([50.0, 80, 125, 200])
    >>> table = {"tool": ["A"] * 4, "V": V, "AW": V**0.5 * [1, 1.1, 1, 1.1]}
    >>> row = rows_of_many(fit.many_power_laws(table, "AW", ["V"], pair="tool"), "mm")[0]
    >>> row["response"], row["nobs"], round(row["params_V"], 3), row["reason"]
    ('AW', 4, 0.542, '')
    """
    table, ends = laws.table, laws.conf_int(LEVEL)
    there = laws.fitted
    reason = laws.estimates.reason.tolist()
    for i, words in (reasons or {}).items():
        reason[i] = words
    K = len(laws)
    columns: dict[str, list[Any]] = {
        "response": [laws.response] * K, "form": ["power"] * K, "unit": [unit] * K, "reason": reason,
    }  # fmt: skip
    columns |= {name: cells(table[name].to_numpy(), there) for name in WHOLE}
    columns["nobs"] = table["nobs"].tolist()
    columns["n_edges"] = cells(table["n_edges"].to_numpy(), table["n_edges"].to_numpy() > 0)
    columns |= {name: table[name].tolist() for name in NOTES}
    for name in laws.names:
        for part in PARTS:
            held = ends if part in ("low", "high") else table
            columns[f"{part}_{name}"] = cells(held[f"{part}_{name}"].to_numpy())
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def row_of(law: "LawFit | StreamedLaw", asked: Asked) -> dict[str, Cell]:
    """The row of one law; a factor that was asked for and left out has its columns too.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("clm2023_end_milling"))
    >>> row = row_of(fit.load_law(runs), Asked("I", ("fm", "VB"), "load"))
    >>> row["response"], row["form"], row["nobs"]
    ('fm', 'feed_line', 7)
    """
    from ...fit import EdgeInference

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


def cells(values: NDArray[Any], there: NDArray[np.bool_] | None = None) -> list[Cell]:
    """Numbers, shape (K,), as plain cells; None where one is not finite or not ``there``.

    >>> cells(np.array([1.0, np.nan]))
    [1.0, None]
    """
    known = np.isfinite(values) if there is None else np.isfinite(values) & there
    plain: list[Cell] = values.tolist()
    if not known.all():
        for i in np.flatnonzero(~known):
            plain[i] = None
    return plain


def reason_of(rows: Sequence[LawRow]) -> str:
    """Why a pair has no law at all; empty where it has one.

    >>> reason_of([{"response": "AW", "reason": "AW: too few rows."}, {"response": "P", "reason": "P is 1."}])
    'AW is not fitted: too few rows. P is not fitted: P is 1.'
    """
    if not rows or not all(row["reason"] for row in rows):
        return ""
    return " ".join(refusals(rows))


def refusals(rows: Iterable[LawRow]) -> list[str]:
    """A sentence for each law that there is not; the same reason of several is said once."""
    said: dict[str, list[str]] = {}
    for row in rows:
        if row["reason"]:
            said.setdefault(str(row["reason"]).removeprefix(f"{row['response']}: "), []).append(str(row["response"]))
    return [f"{', '.join(of)} {'are' if len(of) > 1 else 'is'} not fitted: {why}" for why, of in said.items()]
