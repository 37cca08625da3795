"""Exponents of families of pairs (all, an ISO group, a grade, a coolant) and of each pair, by partial pooling."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from ..core.calls import check_share
from ..core.errors import UsageError
from ..core.verdict import DO_NOT_USE, LEVELS
from ..fit import pooled_exponents
from ..fit.many.pooling import WHOLE, PooledExponents
from .engine import SERIAL, Run
from .law_rows import group_column
from .pair_table import is_iso_513, iso_family

LAW = ("response", "factor", "grouping", "family")
ENDS = ("mean", "mean_se", "mean_low", "mean_high", "tau", "tau_low", "tau_high", "new_low", "new_high")
FAMILIES = (*LAW, "pairs", *ENDS)
NAMED = ("tool", "work")
ALONE = ("estimate", "se", "df", "low", "high")
WITH = ("pooled", "pooled_se", "pooled_low", "pooled_high", "shrinkage")
PAIRS = (*NAMED, *LAW, *ALONE, *WITH, "new_low", "new_high", "reason")
TEXTS = (*NAMED, *LAW, "reason")
DESIGN = ("row_bse", "bse", "params")  # of each factor


@dataclass(frozen=True, slots=True)
class Comparison:
    """Exponents over pairs and families; exponents have no unit.

    Attributes
    ----------
    families : DataFrame
        A row a law, factor, grouping and family: ``response, factor, grouping, family, pairs``; the family's
        ``mean`` with ``mean_se, mean_low, mean_high``; ``tau``, the standard deviation of exponents in the family,
        with ``tau_low, tau_high``; ``new_low, new_high``, the interval for a new pair.
    pairs : DataFrame
        A row a law, factor, grouping and pair that has this exponent: ``tool, work, response, factor, grouping,
        family``; ``estimate, se, df, low, high`` alone; ``pooled, pooled_se, pooled_low, pooled_high`` with its
        family and ``shrinkage`` towards the mean of the family, between 0 and 1; the family's ``new_low, new_high``;
        ``reason`` why it is not pooled, empty otherwise.
    level : float
        Of every interval.
    """

    families: pd.DataFrame
    pairs: pd.DataFrame
    level: float = 0.95


def compare(
    results: pd.DataFrame, groups: Sequence[str] = (), *, level: float = 0.95, workers: Run = SERIAL
) -> Comparison:
    """Pool each exponent of each power law over all pairs, then over the families of each grouping.

    Parameters
    ----------
    results : DataFrame
        A row a pair and law: ``tool, work``, the columns of ``groups``, ``response, form, reason``, and those of
        ``ManyLaws.table``. Laws of another form than power, laws whose verdict is not to use them, and c0, whose unit
        depends on the exponents, are left out.
    groups : sequence of str
        Headers of the columns that name families, each in the column that `group_column` gives it; under a header
        such as ``iso513`` a value ``P20`` belongs to the family ``P steel``.
    level : float
    workers : Run
        Each exponent is a task of its processes, where they run already.

    Raises
    ------
    UsageError
        A grouping that the results do not hold; a level outside 0 to 1.

    Examples
    --------
    >>> results = pd.DataFrame({
    ...     "tool": ["a", "b", "c", "d"], "work": "steel", "response": "AW", "form": "power", "reason": "", "df": 23,
    ...     "params_V": [0.45, 0.55, 0.60, 0.9], "bse_V": [0.05, 0.05, 0.05, 0.3],
    ... })
    >>> made = compare(results)
    >>> made.families[["factor", "family", "pairs"]].values.tolist()
    [['V', 'all pairs', 4]]
    >>> made.pairs["pooled"].round(2).tolist()
    [0.48, 0.55, 0.58, 0.6]
    """
    _check(results, groups, level)
    asked: list[_Exponent] = []

    def tables() -> Iterator[tuple[pd.DataFrame, str, str | None]]:
        for one, table in _exponents(results, groups):
            asked.append(one)
            yield table, one.factor, None if one.grouping == WHOLE else f"family {one.grouping}"

    found = workers.where(False).map(partial(_pooled, level=level), tables())
    families = [_families(one, made) for one, made in zip(asked, found, strict=True)]
    pairs = [_pairs(one, made) for one, made in zip(asked, found, strict=True)]
    return Comparison(_stacked(families, FAMILIES), _stacked(pairs, PAIRS), level)


def largest_families(families: pd.DataFrame, most: int) -> pd.DataFrame:
    """At most ``most`` rows, in the order of the table: all pairs together first, then the largest families."""
    size = families["pairs"].astype(float).where(families["grouping"] != WHOLE, np.inf)
    return families.loc[size.sort_values(ascending=False, kind="stable").index[:most]].sort_index()


def family_names(values: pd.Series, header: str) -> pd.Series:
    """Family of each pair by its column, missing where that is empty."""
    texts = values.astype(object).where(values.notna(), "").astype(str).str.strip()
    name = iso_family if is_iso_513(header) else str
    return texts.map({text: name(text) or None for text in texts.unique()}).astype(object)


def _check(results: pd.DataFrame, groups: Sequence[str], level: float) -> None:
    check_share("level", level)
    missing = [name for name in groups if group_column(name) not in results]
    if missing and len(results):
        raise UsageError(
            f"no column {missing[0]!r} to group the pairs by; there are {', '.join(map(str, results.columns))}."
        )


@dataclass(frozen=True, slots=True)
class _Exponent:
    """An exponent that is pooled by a grouping, and the names of the pairs that have it."""

    response: str
    factor: str
    grouping: str
    named: pd.DataFrame

    def law(self) -> dict[str, object]:
        """The first columns of its rows in both tables."""
        return {"response": self.response, "factor": self.factor, "grouping": self.grouping}


def _pooled(task: tuple[pd.DataFrame, str, str | None], level: float) -> PooledExponents:
    table, factor, by = task
    return pooled_exponents(table, factor, by=by, level=level)


def _exponents(results: pd.DataFrame, groups: Sequence[str]) -> Iterator[tuple[_Exponent, pd.DataFrame]]:
    """Each exponent and grouping, and the numbers of the pairs that have it."""
    if not len(results) or "response" not in results:
        return
    laws = results["reason"].isna() | (results["reason"] == "")
    if "form" in results:
        laws &= results["form"] == "power"
    if "verdict" in results:
        laws &= results["verdict"] != LEVELS[DO_NOT_USE]
    for response, rows in results[laws].groupby("response", sort=False):
        for factor in _factors(rows):
            table = _table(rows, factor, groups)
            for grouping in (WHOLE, *groups) if len(table) else ():
                one = _Exponent(str(response), factor, grouping, table[list(NAMED)])
                yield one, table.drop(columns=list(NAMED))


def _factors(rows: pd.DataFrame) -> list[str]:
    names = [str(name).removeprefix("params_") for name in rows if str(name).startswith("params_")]
    return [name for name in names if name != "c0" and f"bse_{name}" in rows]


def _table(rows: pd.DataFrame, factor: str, groups: Sequence[str]) -> pd.DataFrame:
    """Pairs with this exponent, all numbers as floats, and their families."""
    names = [*(f"{part}_{factor}" for part in DESIGN), "scale_se", "df"]
    held = {name: pd.to_numeric(rows[name], errors="coerce").to_numpy(dtype=float) for name in names if name in rows}
    table = pd.DataFrame({name: rows[name].astype(str).to_numpy() for name in NAMED} | held)
    if "by_edge" in rows:
        table["by_edge"] = rows["by_edge"].isin([True, "True", "true"]).to_numpy()
    for header in groups:
        table[f"family {header}"] = family_names(rows[group_column(header)], header).to_numpy()
    known: pd.Series[bool] = table[f"params_{factor}"].notna()
    return table[known]


def _families(one: _Exponent, made: PooledExponents) -> pd.DataFrame:
    if not len(made.families):
        return pd.DataFrame(columns=list(FAMILIES))
    law = one.law() | {"family": made.families.index}
    values = made.families[["pairs", *ENDS]].reset_index(drop=True)
    return pd.DataFrame(law).join(values.astype({"pairs": int}))[list(FAMILIES)]


def _pairs(one: _Exponent, made: PooledExponents) -> pd.DataFrame:
    table = made.table
    law = one.law() | {"family": table["family"]}
    new = made.families.reindex(columns=["new_low", "new_high"])
    ends = {name: table["family"].map(new[name].to_dict()).astype(float) for name in new}
    parts = [one.named, pd.DataFrame(law), table[[*ALONE, *WITH, "reason"]], pd.DataFrame(ends)]
    return pd.concat(parts, axis=1)[list(PAIRS)]


def _stacked(frames: Sequence[pd.DataFrame], columns: Sequence[str]) -> pd.DataFrame:
    """Frames concatenated; without any, an empty one with the same columns and types."""
    some = [frame for frame in frames if len(frame)]
    if some:
        return pd.concat(some, ignore_index=True)
    kinds = {name: object if name in TEXTS else int if name == "pairs" else float for name in columns}
    return pd.DataFrame({name: pd.Series(dtype=kind) for name, kind in kinds.items()})
