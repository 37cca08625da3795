"""Numeric columns of a file of tests with their values as written, the unit named and the plausible ranges."""

from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from numpy.typing import NDArray

from ...core.rounding import format_decimal
from ..draft import Draft
from ..options import Process, ReadOptions
from ..units import canonical, convert
from ..vocabulary import ROLES
from .ranges import Plausible, Range, plausible, process_of

SAMPLE = 20000  # values of a long column that settle its unit

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Quantity:
    """A numeric column with a role, and what its values show.

    Attributes
    ----------
    role : str
    place : int
        Index of the column in the file.
    bulk, span : tuple of float
        Most of the values without stray ones, and all of them, as written in the file; zeros and signs left out.
    unit : str
        Unit named in the file or by the user; "" where none is.
    given : bool
        Whether the user named the unit.
    factor : float
        Ratio of that unit (of the role's unit where none is named) to the unit of the role.
    ranges : Plausible
    """

    role: str
    place: int
    bulk: Range
    span: Range
    unit: str
    given: bool
    factor: float
    ranges: Plausible

    def lies_in(self, ranges: Range, factor: float | None = None) -> bool:
        """Whether most of the values, times a factor, lie in a range given in the unit of the role."""
        ratio = self.factor if factor is None else factor
        return ranges[0] <= self.bulk[0] * ratio * (1 + 1e-9) and self.bulk[1] * ratio <= ranges[1] * (1 + 1e-9)

    def shown(self, unit: str) -> str:
        """The values as written, with a unit."""
        low, high = map(format_decimal, self.span)
        return f"{low if low == high else f'{low} to {high}'} {unit}".rstrip()

    @property
    def usual(self) -> str:
        """The usual range in words."""
        low, high = self.ranges.usual
        return f"usual {format_decimal(low)} to {format_decimal(high)} {ROLES[self.role].unit}"


def table_process(draft: Draft, options: ReadOptions) -> Process | None:
    """Process given by the user, or found from the roles, headers and notes of the file."""
    if options.process is not None:
        return options.process
    return process_of((*draft.data, *options.constants), (*draft.notes, *(use.name for use in draft.uses)))


def numeric_columns(draft: Draft, options: ReadOptions, process: Process | None) -> list[Quantity]:
    """Numeric columns of the file whose ranges are known, in the order of the file; coded levels are left out."""
    found = []
    for place, use in enumerate(draft.uses):
        ranges = plausible(use.role, process) if use.role else None
        if use.role is None or ranges is None or use.role in options.ranges:
            continue
        values = np.abs(np.asarray(draft.columns[place].values, dtype=float)[:: len(draft.lines) // SAMPLE + 1])
        values = np.sort(values[values > 0])
        if not values.size:
            continue
        factor = unit_factor(use.unit, use.role) if use.unit else 1.0
        kind = ROLES[use.role].kind
        bulk = _bulk(values, 0.5 if kind in ("time", "wear") else 0.1)
        span = float(values[0]), float(values[-1])
        found.append(Quantity(use.role, place, bulk, span, use.unit, use.role in options.units, factor, ranges))
    return found


def unit_factor(unit: str, role: str) -> float:
    """Ratio of a unit to the unit of a role; of a temperature, the ratio of differences.

    >>> unit_factor("um", "VB")
    0.001
    """
    home = ROLES[role].unit
    return 1.0 if unit == home else float(np.diff(convert(np.array([0.0, 1.0]), unit, home))[0])


def _bulk(ordered: Array, low: float) -> Range:
    """Most of the values: one stray value among any number leaves it unchanged; wear and time begin near zero."""
    last = len(ordered) - 1
    ends = float(ordered[ceil(low * last)]), float(ordered[int(0.9 * last)])
    return min(ends), max(ends)


def take_unit(draft: Draft, one: Quantity, unit: str) -> None:
    """Convert a column whose numbers were taken in the unit of its role, and are in another."""
    uses = list(draft.uses)
    uses[one.place] = replace(uses[one.place], unit=canonical(unit) or unit, converted=True)
    draft.uses = tuple(uses)
    draft.data[one.role] = convert(np.asarray(draft.data[one.role], dtype=float), unit, ROLES[one.role].unit)
