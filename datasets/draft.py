"""A table of tests while it is being read: each step of the reading completes or judges it."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .columns import ColumnUse, Values
from .derived.rules import Derived
from .doubts import Doubt
from .edges.columns import Codes, numbered
from .tables import Column
from .vocabulary import ROLES


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

    def codes(self, role: str) -> tuple[Codes, list[str]]:
        """Codes of the rows of a label, and its names; computed once for each array."""
        labels = self.data[role]
        known = self.coded.get(role)
        if known is None or known[0] is not labels:
            known = (labels, *numbered(np.asarray(labels, dtype=object)))
            self.coded[role] = known
        return known[1], known[2]
