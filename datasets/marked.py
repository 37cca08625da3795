"""Marked numbers (<0.05, >0.3, ~0.2, 0.24*) of a draft, kept in a column of text beside their role."""

import numpy as np

from .doubts import Doubt
from .draft import Draft
from .tables import Column
from .tables.marks import Mark
from .units import canonical, convert, same_dimension
from .vocabulary import MARK, ROLES

_WORDS = {"<": "at most", ">": "at least", "~": "approximate", "*": "footnote"}


def mark_column(role: str) -> str:
    """Name of the column that holds the marks of a role.

    >>> mark_column("VB")
    'VB mark'
    """
    return role + MARK


def keep_marks(draft: Draft) -> None:
    """Add a column of marks for each role with marked numbers, in the role's unit, and a doubt that names them.

    The numbers themselves are nan: a plain fit leaves these rows out.
    """
    for column, use in zip(draft.columns, draft.uses, strict=True):
        if not column.marks or use.role is None or ROLES[use.role].kind == "label" or use.role not in draft.data:
            continue
        role = use.role
        texts = np.full(len(draft.lines), "", dtype=object)
        factor = _factor(column, np.asarray(draft.data[role], dtype=float))
        for row, mark in column.marks:
            texts[row] = _converted(mark, role, factor)
        draft.data[mark_column(role)] = texts
        cells = [f"line {draft.lines[row]} {mark.text!r}" for row, mark in column.marks]
        listed = ", ".join(cells[:4]) + (f" and {len(cells) - 4} more" if len(cells) > 4 else "")
        kinds = ", ".join(dict.fromkeys(_WORDS[mark.sign] for _, mark in column.marks))
        n = len(cells)
        values = f"{n} marked value{'s' * (n > 1)} ({kinds}) {'are' if n > 1 else 'is'}"
        draft.doubts.append(
            Doubt((role,), f"{role}: {values} left out of the fit and kept as {mark_column(role)!r}: {listed}")
        )


def _factor(column: Column, values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """Factor by which the numbers of the column were converted."""
    written = np.asarray(column.values, dtype=float)
    both = np.isfinite(written) & np.isfinite(values) & (written != 0) & (values != 0)
    return float(np.median(values[both] / written[both])) if both.any() else 1.0


def _converted(mark: Mark, role: str, factor: float) -> str:
    """The mark in the role's unit; a unit beside the number counts before that of the column."""
    unit = canonical(mark.unit) if mark.unit else None
    if unit is not None and same_dimension(unit, ROLES[role].unit):
        factor = float(convert(np.array([1.0]), unit, ROLES[role].unit)[0])
    return mark.describe(factor)
