"""A table of tests while it is being read, completed or judged by each step, and its marked numbers (<0.05, 0.24*)."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .columns import ColumnUse, Values
from .derived.rules import Derived
from .doubts import Doubt
from .edges.columns import Codes, numbered
from .tables import Column
from .tables.numerals import Mark
from .units import canonical, convert, same_dimension
from .vocabulary import MARK, ROLES

_WORDS = {"<": "at most", ">": "at least", "~": "approximate", "*": "footnote"}


@dataclass(slots=True)
class Draft:
    """Columns, values by role in the role's unit, and what was assumed, corrected or doubted so far.

    Attributes
    ----------
    columns : tuple of Column
        Columns of the file as written.
    uses : tuple of ColumnUse
        Use of each column, in the same order.
    data : dict
        Role symbol -> values, shape (n,); a step adds, replaces or converts them.
    units : dict
        Unit of each role in ``data`` that has one.
    lines : ndarray of int, shape (n,)
        Line of each row in the file.
    notes : tuple of str
        Free text of the file.
    assumed, warnings : list of str
        Assumptions made; what was left out or corrected.
    doubts : list of Doubt
    derived : list of Derived
        Quantities computed from others.
    """

    columns: tuple[Column, ...]
    uses: tuple[ColumnUse, ...]
    data: dict[str, Values]
    units: dict[str, str]
    lines: NDArray[np.intp]
    notes: tuple[str, ...] = ()
    assumed: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    doubts: list[Doubt] = field(default_factory=list)
    derived: list[Derived] = field(default_factory=list)
    coded: dict[str, tuple[Values, Codes, list[str]]] = field(default_factory=dict, repr=False)

    def numbers(self) -> dict[str, NDArray[np.float64]]:
        """Values of the roles that have a unit, as floats."""
        with_unit = [role for role in self.data if role in ROLES and ROLES[role].unit]
        return {role: np.asarray(self.data[role], dtype=float) for role in with_unit}

    def keep(self, rows: NDArray[np.bool_]) -> None:
        """Leave out the other rows; ``rows`` has shape (n,)."""
        place = np.cumsum(rows) - 1
        self.columns = tuple(
            replace(
                column, values=column.values[rows],
                marks=tuple((int(place[row]), mark) for row, mark in column.marks if rows[row]),
            )
            for column in self.columns
        )  # fmt: skip
        self.data = {role: values[rows] for role, values in self.data.items()}
        self.lines = self.lines[rows]

    def codes(self, role: str) -> tuple[Codes, list[str]]:
        """Codes of the rows of a label, and its names; computed once for each array."""
        labels = self.data[role]
        known = self.coded.get(role)
        if known is None or known[0] is not labels:
            known = (labels, *numbered(np.asarray(labels, dtype=object)))
            self.coded[role] = known
        return known[1], known[2]


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
