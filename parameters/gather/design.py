"""The runs behind the laws become the design section, in a few passes over their columns."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..sections.base import Section
from .dynamics import as_data
from .law_facts import quantity_of
from .plan import kind_of_plan
from .scan import Array, Index, Labels, Numbers, labels, numbers, stands
from .understood import understood

if TYPE_CHECKING:
    from ...datasets import Runs
    from ..sections.law import LawSection

NAMED = 10  # short edges that are named
ISO_3685 = 0.3  # mm, average flank wear


def design_section(
    design: "Runs | Section | Mapping[str, Any]",
    laws: "Mapping[str, LawSection]",
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
    columns = {role: labels(runs, role) for role in ("edge", "tool", "work") if runs.has(role)}
    values = {symbol: numbers(runs.values(symbol)) for symbol in _factors(runs, laws)}
    by = next((law.by.column for law in laws.values() if law.by is not None), None)
    level = None if by is None or not runs.has(by) else columns.get(by) or labels(runs, by)
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
        "understood": understood(runs, laws, lambda role: (columns.get(role) or labels(runs, role)).names),
    }


def criterion_of(
    life: Mapping[str, Any] | None, limits: Mapping[str, Any] | None, options: Mapping[str, Any]
) -> dict[str, Any] | None:
    """The wear criterion of a file: that of its tool life, or of its limits."""
    if life is not None:
        value = float(life["criterion"])
        usual = "" if value != ISO_3685 else "average flank wear of ISO 3685"
        source = "as given" if "criterion" in options else usual
        return {"wear": life["wear"], "value": value, "unit": life["unit_of_wear"], "source": source}
    wear = (limits or {}).get("wear")
    if not isinstance(wear, Mapping) or not wear.get("of"):  # a limit of wear in general, or one the schema refuses
        return None
    return {"wear": wear["of"], "value": wear["value"], "unit": wear["unit"], "source": "limit of the file"}


def _factors(runs: "Runs", laws: "Mapping[str, LawSection]") -> list[str]:
    """Conditions and time, and other factors of a law that are no response."""
    from ...datasets.vocabulary import ROLES

    usual = [s for s, role in ROLES.items() if role.kind == "condition" or s == "t"]
    asked = {f.symbol: None for law in laws.values() for f in law.factors if f.symbol not in laws}
    return [symbol for symbol in dict.fromkeys((*usual, *asked)) if runs.has(symbol)]


def _factor(runs: "Runs", symbol: str, x: Numbers) -> dict[str, Any]:
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
    edge: Labels,
    level: Labels | None,
    values: Mapping[str, Numbers],
    criterion: Mapping[str, Any] | None,
) -> tuple[dict[str, Any], str | None]:
    """What the edges are like, and the plan of their settings."""
    held = {symbol: x.numbers[edge.first] for symbol, x in values.items() if stands(x, edge)}
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


def _setting(codes: list[Index], n: int) -> Index:
    """Number of the setting of each edge, from 0."""
    import pandas as pd

    setting = np.zeros(n, dtype=np.intp)
    for code in codes:
        setting = pd.factorize(setting * (int(code.max(initial=0)) + 2) + code + 1)[0]
    return setting


def _worn(runs: "Runs", edge: Labels, criterion: Mapping[str, Any] | None) -> NDArray[np.bool_] | None:
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


def _levels(level: Labels, edge: Labels | None) -> list[dict[str, Any]]:
    at = None if edge is None else np.bincount(level.codes[edge.first] + 1, minlength=len(level.names) + 1)[1:]
    return [
        {"level": name, "rows": int(rows), "edges": None if at is None else int(at[i])}
        for i, (name, rows) in enumerate(zip(level.names, level.counts, strict=True))
    ]


def _left_out(laws: "Mapping[str, LawSection]") -> list[dict[str, Any]]:
    """Rows that laws do without, the same ones told once."""
    found: dict[tuple[str, int, tuple[int, ...]], list[str]] = {}
    for name, law in laws.items():
        for rows in law.dropped_rows:
            found.setdefault((rows.reason, rows.count, rows.lines), []).append(name)
    return [
        {"reason": reason, "count": count, "lines": list(lines), "laws": names}
        for (reason, count, lines), names in found.items()
    ]
