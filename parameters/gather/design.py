"""Design section: factors, edges and kind of plan of the runs behind the laws, in a few passes over their columns.

Source of the plans: Montgomery 2017, Design and Analysis of Experiments, chapters 5 and 8 (factorials), 11.4 (central
composite and Box-Behnken designs).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import comb, prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array, Flags, Ints
from ...core.rounding import label_of
from ...datasets.vocabulary import USUAL_CRITERION
from ..sections.base import Section
from ..sections.law import LawSection
from ..sections.origin import FEW
from .control import as_data
from .description import reading_notes
from .law import quantity_of

if TYPE_CHECKING:
    from ...datasets import Runs


GLANCE = 4096  # changes compared first: most measured columns show more than FEW levels there
SAME = 1e-9  # of a factor's largest: what a setting may differ by within an edge
NAMED = 10  # short edges that are named


@dataclass(frozen=True, slots=True)
class LabelColumn:
    """A column of names: number of each row's name, -1 where it is missing; first row of each name.

    ``starts`` are the rows where the name differs from the row above.
    """

    codes: Ints
    names: list[str]
    first: Ints
    starts: Ints

    @property
    def counts(self) -> Ints:
        """Rows of each name."""
        return np.bincount(self.codes[self.codes >= 0], minlength=len(self.names))


@dataclass(frozen=True, slots=True)
class NumberColumn:
    """A factor: its numbers (n,), the rows where it differs from the row above, and its levels where they are few."""

    numbers: Array
    starts: Ints
    levels: Array


def design_section(
    design: "Runs | Section | Mapping[str, Any]",
    laws: Mapping[str, LawSection],
    criterion: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The section of the tests that laws were fitted to.

    Parameters
    ----------
    design : Runs, or a section as it is
    laws : mapping of LawSection
        By response.
    criterion : mapping, optional
        Wear at which an edge is worn out: wear, value, unit, source.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> section = design_section(datasets.read_runs(datasets.bundled("gc435_709m40")), {})
    >>> section["plan"], section["edges"]["edges"], section["edges"]["replicated"]
    ('central composite', 24, 7)
    """
    if isinstance(design, Section | Mapping):
        return as_data(design)
    runs = design
    columns = {role: label_column(runs, role) for role in ("edge", "tool", "work") if runs.has(role)}
    values = {symbol: number_column(runs.values(symbol)) for symbol in _factors(runs, laws)}
    by = next((law.by.column for law in laws.values() if law.by is not None), None)
    level = None if by is None or not runs.has(by) else columns.get(by) or label_column(runs, by)
    edge = columns.get("edge")
    edges, plan = (
        _edges(runs, edge, level, values, criterion)
        if edge and edge.names
        else (None, _plan({symbol: (x.numbers, x.levels) for symbol, x in values.items()}))
    )
    return {
        "rows": len(runs),
        "factors": [_factor(runs, symbol, x) for symbol, x in values.items() if np.isfinite(np.fmin.reduce(x.numbers))],
        "plan": plan,
        "edges": edges,
        "by": by if level else None,
        "levels": _levels(level, edge) if level else [],
        "left_out": _left_out(laws),
        "criterion": None if criterion is None else dict(criterion),
        "understood": reading_notes(runs, laws, lambda role: (columns.get(role) or label_column(runs, role)).names),
    }


def reading_section(design: object) -> dict[str, Any] | None:
    """Doubts of runs whose values were judged; None of others, and of a section.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> reading_section(datasets.read_runs(datasets.bundled("gc435_709m40"))), reading_section({})
    ({'doubts': []}, None)
    """
    from ...datasets import Runs

    if not (isinstance(design, Runs) and design.judged):
        return None
    kept = ("columns", "sentence", "remedy")
    return {"doubts": [{name: getattr(doubt, name) for name in kept} for doubt in design.doubts]}


def criterion_of(
    life: Mapping[str, Any] | None, limits: Mapping[str, Any] | None, options: Mapping[str, Any]
) -> dict[str, Any] | None:
    """The wear criterion of a file: that of its tool life, or of its limits."""
    if life is not None:
        value = float(life["criterion"])
        usual = "" if value != USUAL_CRITERION else "average flank wear of ISO 3685"
        source = "as given" if "criterion" in options else usual
        return {"wear": life["wear"], "value": value, "unit": life["unit_of_wear"], "source": source}
    wear = (limits or {}).get("wear")
    if not isinstance(wear, Mapping) or not wear.get("of"):  # a limit of wear in general, or one the schema refuses
        return None
    return {"wear": wear["of"], "value": wear["value"], "unit": wear["unit"], "source": "limit of the file"}


def _factors(runs: "Runs", laws: Mapping[str, LawSection]) -> list[str]:
    """Conditions and time, and other factors of a law that are no response."""
    from ...datasets.vocabulary import ROLES

    usual = [s for s, role in ROLES.items() if role.kind == "condition" or s == "t"]
    asked = {f.symbol: None for law in laws.values() for f in law.factors if f.symbol not in laws}
    return [symbol for symbol in dict.fromkeys((*usual, *asked)) if runs.has(symbol)]


def _factor(runs: "Runs", symbol: str, x: NumberColumn) -> dict[str, Any]:
    return {
        "symbol": symbol,
        "quantity": quantity_of(symbol),
        "unit": runs.units.get(symbol, ""),
        "low": float(np.fmin.reduce(x.numbers)),
        "high": float(np.fmax.reduce(x.numbers)),
        "levels": x.levels.tolist(),
    }


def _edges(
    runs: "Runs",
    edge: LabelColumn,
    level: LabelColumn | None,
    values: Mapping[str, NumberColumn],
    criterion: Mapping[str, Any] | None,
) -> tuple[dict[str, Any], str | None]:
    """Facts of the edges, and the plan of their settings."""
    held = {symbol: x.numbers[edge.first] for symbol, x in values.items() if constant_by_edge(x, edge)}
    rank = [np.unique(x, return_inverse=True)[1] for x in held.values()]
    setting = _setting([*rank, *([level.codes[edge.first]] if level else [])], len(edge.names))
    alike, counts = np.bincount(setting), edge.counts
    worn = _worn(runs, edge, criterion)
    short = counts < np.median(counts) / 2
    if worn is not None:
        short &= ~worn
    facts = {
        "edges": len(edge.names),
        "rows_least": int(counts.min()),
        "rows_median": float(np.median(counts)),
        "rows_most": int(counts.max()),
        "set_by_edge": list(held),
        "settings": len(alike) if held else 0,
        "replicated": int((alike > 1).sum()) if held else 0,
        "replicated_edges": int(alike[alike > 1].sum()) if held else 0,
        "short": int(short.sum()),
        "short_edges": [edge.names[i] for i in np.flatnonzero(short)[:NAMED]],
        "worn": None if worn is None else int(worn.sum()),
    }
    return facts, _plan({symbol: (x, values[symbol].levels) for symbol, x in held.items()})


def _setting(codes: list[Ints], n: int) -> Ints:
    """Number of the setting of each edge, from 0."""
    import pandas as pd

    setting = np.zeros(n, dtype=np.intp)
    for code in codes:
        setting = pd.factorize(setting * (int(code.max(initial=0)) + 2) + code + 1)[0]
    return setting


def _worn(runs: "Runs", edge: LabelColumn, criterion: Mapping[str, Any] | None) -> Flags | None:
    if criterion is None or not runs.has(criterion["wear"]):
        return None
    if runs.units.get(criterion["wear"]) != criterion["unit"]:
        return None
    there = edge.codes[(runs.values(criterion["wear"]) >= criterion["value"]) & (edge.codes >= 0)]
    return np.asarray(np.bincount(there, minlength=len(edge.names)) > 0)


def _plan(values: Mapping[str, tuple[Array, Array]]) -> str | None:
    """Kind of plan of the conditions that change, time apart, each with its levels."""
    few = [pair for symbol, pair in values.items() if symbol != "t"]
    if any(not len(levels) for _, levels in few):
        return None
    index = [np.searchsorted(levels, x) for x, levels in few if len(levels) > 1]
    if not index or any(np.isnan(x).any() for x, _ in few):
        return None
    setting = _setting(index, len(index[0]))
    _, first = np.unique(setting, return_index=True)
    return kind_of_plan(np.column_stack(index)[first])


def _levels(level: LabelColumn, edge: LabelColumn | None) -> list[dict[str, Any]]:
    at = None if edge is None else np.bincount(level.codes[edge.first] + 1, minlength=len(level.names) + 1)[1:]
    return [
        {"level": name, "rows": int(rows), "edges": None if at is None else int(at[i])}
        for i, (name, rows) in enumerate(zip(level.names, level.counts, strict=True))
    ]


def _left_out(laws: Mapping[str, LawSection]) -> list[dict[str, Any]]:
    """Rows that laws leave out, the same ones listed once."""
    found: dict[tuple[str, int, tuple[int, ...]], list[str]] = {}
    for name, law in laws.items():
        for rows in law.dropped_rows:
            found.setdefault((rows.reason, rows.count, rows.lines), []).append(name)
    return [
        {"reason": reason, "count": count, "lines": list(lines), "laws": names}
        for (reason, count, lines), names in found.items()
    ]


def number_column(x: Array) -> NumberColumn:
    """A factor (n,), NaN where missing, scanned.

    >>> number_column(np.array([2.0, 2.0, np.nan, 1.0])).levels.tolist()
    [1.0, 2.0]
    """
    starts = _starts(x)
    return NumberColumn(x, starts, _few(x[starts]))


def _few(x: Array) -> Array:
    """The different values, rising, where they are few; else none."""
    import pandas as pd

    if len(pd.unique(x[:GLANCE])) > FEW + 1:  # a missing value is none of them
        return np.empty(0)
    found = pd.unique(x)
    found = np.sort(found[~np.isnan(found)])
    return found if len(found) <= FEW else np.empty(0)


def _starts(column: NDArray[Any]) -> Ints:
    """Rows that differ from the row above, the first row included."""
    return np.concatenate([[0], 1 + np.flatnonzero(column[1:] != column[:-1])]).astype(np.intp)[: len(column)]


def label_column(runs: "Runs", name: str) -> LabelColumn:
    """A column of names by its role or its header, scanned; whole numbers are written as ``1``, not ``1.0``.

    >>> from fitmodels import datasets
    >>> edge = label_column(datasets.read_runs(datasets.bundled("gc435_709m40")), "edge")
    >>> edge.names[:2], edge.first[:2].tolist(), edge.counts[:2].tolist()
    (['E02', 'E11'], [0, 10], [10, 10])
    """
    import pandas as pd

    role = next((use.role for use in runs.columns if use.name == name and use.role in runs.data), None)
    column = runs.data[name if name in runs.data or role is None else role].to_numpy()
    column = column if column.dtype.kind == "f" else column.astype(object, copy=False)
    starts = _starts(column)
    codes, found = pd.factorize(column[starts])
    names = [label_of(v) for v in found]
    if "" in names:  # an empty cell is no name
        empty = names.index("")
        names.pop(empty)
        codes = np.where(codes == empty, -1, codes - (codes > empty))
    first = np.zeros(len(names), dtype=np.intp)
    known = codes >= 0
    first[codes[known][::-1]] = starts[known][::-1]  # of several writes the last counts
    return LabelColumn(np.repeat(codes, np.diff(starts, append=len(column))), names, first, starts)


def constant_by_edge(x: NumberColumn, edge: LabelColumn) -> bool:
    """Whether a factor is constant on every edge: compared where edge or factor change, the other rows repeat."""
    first = x.numbers[edge.first]
    limit = SAME * np.fmax.reduce(np.abs(first), initial=0.0)
    for at in (x.starts[:GLANCE], edge.starts, x.starts):  # most varying factors show it in the first rows
        known = at[(edge.codes[at] >= 0) & ~np.isnan(x.numbers[at])]
        if not (np.abs(x.numbers[known] - first[edge.codes[known]]) <= limit).all():
            return False
    return True


def kind_of_plan(levels: Ints) -> str | None:
    """The kind of plan, in words; None where it is none of the known kinds.

    Parameters
    ----------
    levels : ndarray of int, shape (m, k)
        Distinct settings: position of each factor's level, from 0, in rising order of the levels.

    Examples
    --------
    >>> kind_of_plan(np.array([[0, 0], [0, 1], [1, 0], [1, 1]]))
    'full factorial, 2 x 2 levels'
    >>> kind_of_plan(np.array([[0, 0], [0, 1], [1, 2]])) is None
    True
    """
    if levels.ndim != 2 or levels.shape[1] < 2 or len(levels) < 3:
        return None
    counts = (levels.max(axis=0) + 1).tolist()
    if min(counts) < 2:
        return None
    for found in (_full(levels, counts), _composite(levels, counts), _box_behnken(levels, counts)):
        if found is not None:
            return found
    return _one_at_a_time(levels) or _orthogonal(levels, counts)


def _full(levels: Ints, counts: list[int]) -> str | None:
    return f"full factorial, {' x '.join(map(str, counts))} levels" if len(levels) == prod(counts) else None


def _composite(levels: Ints, counts: list[int]) -> str | None:
    if set(counts) not in ({5}, {3}):
        return None
    k, faces = len(counts), counts[0] == 3
    z = np.abs(levels - counts[0] // 2)
    factorial = (z == 1).all(axis=1)
    axial = ((z > 0).sum(axis=1) == 1) & (z.max(axis=1) == (1 if faces else 2))
    covered = factorial | axial | (z == 0).all(axis=1)
    corners = int(factorial.sum())
    if not covered.all() or axial.sum() != 2 * k or corners not in (2**k, 2 ** (k - 1)) or corners < 4:
        return None
    return ("face-centred " if faces else "") + "central composite" + (", half the corners" if corners < 2**k else "")


def _box_behnken(levels: Ints, counts: list[int]) -> str | None:
    k = len(counts)
    if set(counts) != {3} or not 3 <= k <= 5:
        return None
    moved = (levels != 1).sum(axis=1)
    fits = np.isin(moved, (0, 2)).all() and (moved == 2).sum() == 4 * comb(k, 2)
    return "Box-Behnken" if fits else None


def _one_at_a_time(levels: Ints) -> str | None:
    base = np.array([np.bincount(column).argmax() for column in levels.T])
    moved = (levels != base).sum(axis=1)
    return "one factor at a time" if (moved <= 1).all() and (moved == 0).any() else None


def _orthogonal(levels: Ints, counts: list[int]) -> str | None:
    """Every pair of factors has each pair of levels equally often."""
    for i, first in enumerate(counts):
        for j in range(i + 1, len(counts)):
            times = np.bincount(levels[:, i] * counts[j] + levels[:, j], minlength=first * counts[j])
            if times.min() != times.max():
                return None
    return f"orthogonal array of {len(levels)} settings"
