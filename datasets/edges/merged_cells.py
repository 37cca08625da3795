"""Blank cells below the first row of a block, as merged cells of a sheet leave them, filled from the cell above."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Flags, Ints
from ..draft import Draft
from ..vocabulary import ROLES
from .columns import may_be_edge

FOLLOWED = 0.7  # share of the filled cells that are followed by a blank where a column names only the first row
DITTO = frozenset({"", '"', "''", "”", "〃", "ditto", "do.", "dto.", "dito", "idem", "id."})  # as above
LISTED = 5  # lines in a sentence


def fill_down(draft: Draft) -> None:
    """Fill cells that are blank because only the first row of their block is filled, and say so."""
    for i, (column, use) in enumerate(zip(draft.columns, draft.uses, strict=True)):
        role = None if use.role is None else ROLES[use.role]
        label = may_be_edge(use) if role is None else role.symbol in ("edge", "tool", "work")
        if not label and (role is None or (role.kind != "condition" and role.symbol != "D")):
            continue
        values = column.values
        if not column.is_numeric and DITTO.isdisjoint(values.tolist()):
            continue
        blank = np.isnan(values) if column.is_numeric else _blank_texts(values)
        if not blank.any() or len(blank) < 3 or blank.all():
            continue
        blocks = _names_blocks(values, blank, label=label)
        of_edge = role is None or role.symbol == "edge"
        fill = blank & ~_leading(blank) if blocks else _enclosed(values, blank) & of_edge
        if not fill.any():
            continue
        above = np.maximum.accumulate(np.where(blank, 0, np.arange(len(blank))))
        source = np.where(fill, above, np.arange(len(blank)))
        columns = list(draft.columns)
        columns[i] = replace(column, values=values[source])
        draft.columns = tuple(columns)
        if use.role is not None:
            draft.data[use.role] = draft.data[use.role][source]
        draft.warnings.append(
            f"column {column.name!r}: {int(fill.sum())} blank cells filled from above "
            f"({lines_text(draft.lines[fill])}): "
            + ("only the first row of each block has a value" if blocks else "the cells above and below are equal")
        )


def _blank_texts(values: NDArray[Any]) -> Flags:
    return np.asarray([value in DITTO for value in values.tolist()], dtype=bool)


def _leading(blank: Flags) -> Flags:
    """The blanks above the first filled cell."""
    return np.asarray(np.arange(len(blank)) < np.flatnonzero(~blank)[0], dtype=bool)


def _names_blocks(values: NDArray[Any], blank: Flags, *, label: bool) -> bool:
    """Whether only the first row of each block is filled.

    At least half of the rows are blank then; names do not stand twice one below the other, and of the values of a
    condition most are followed by a blank.
    """
    filled = np.flatnonzero(~blank)
    if blank[0] or blank.sum() < len(filled):
        return False
    inner = filled[filled < len(blank) - 1]
    after = blank[inner + 1]
    if label:
        repeats = ~after & (values[inner] == values[np.minimum(inner + 1, len(blank) - 1)])
        return not bool(repeats.any())
    return bool(after.mean() >= FOLLOWED)


def _enclosed(values: NDArray[Any], blank: Flags) -> Flags:
    """Isolated blanks between two cells of the same name."""
    n = len(blank)
    above = np.maximum.accumulate(np.where(blank, -1, np.arange(n)))
    below = np.minimum.accumulate(np.where(blank, n, np.arange(n))[::-1])[::-1]
    both = blank & (above >= 0) & (below < n)
    same = np.zeros(n, dtype=bool)
    same[both] = values[above[both]] == values[below[both]]
    return same


def lines_text(lines: Sequence[int] | Ints) -> str:
    """Lines of a file for a sentence, the first few of many.

    >>> lines_text([4]), lines_text([4, 7]), lines_text(range(2, 30))
    ('line 4', 'lines 4 and 7', 'lines 2, 3, 4, 5, 6 and 23 more')
    """
    shown = [str(int(line)) for line in lines]
    if len(shown) == 1:
        return f"line {shown[0]}"
    if len(shown) > LISTED + 1:
        return f"lines {', '.join(shown[:LISTED])} and {len(shown) - LISTED} more"
    return f"lines {', '.join(shown[:-1])} and {shown[-1]}"
