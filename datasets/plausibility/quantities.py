"""Numeric columns of a file of tests with their values as written, the unit named and the plausible ranges.

Settings of a plan are judged by the same ranges, before they are cut.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from ...core.arrays import Array
from ...core.errors import UsageError
from ...core.rounding import format_decimal
from ..doubts import Doubt
from ..draft import Draft
from ..headers import parse_header
from ..options import Process, ReadOptions
from ..units import canonical, convert, same_dimension
from ..vocabulary import ROLES, understood_unit
from .ranges import INCH, Plausible, Range, candidate_units, plausible, process_of

AGAINST = "units given against the file"  # beginning of what is assumed
SAMPLE = 20000  # values of a long column that settle its unit


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


def headers_against(draft: Draft, options: ReadOptions) -> dict[str, str]:
    """Units that headers name, by role, where the user gave another unit of the role."""
    found = {}
    for column, use in zip(draft.columns, draft.uses, strict=True):
        text = column.unit_cell.strip("[]() ") or parse_header(column.name).unit_text
        if use.role is None or use.role not in options.units or not (text and use.unit):
            continue
        unit = understood_unit(use.role, text)
        fits = unit is not None and same_dimension(unit, ROLES[use.role].unit)
        if unit and fits and unit_factor(unit, use.role) != unit_factor(use.unit, use.role):
            found[use.role] = unit
    return found


def state_given_units(draft: Draft, options: ReadOptions, found: list[Quantity]) -> None:
    """State the units that the user gave against headers, and doubt them where those of the headers are usual."""
    headers = headers_against(draft, options)
    if headers:
        each = (f"{role}, the header says {unit}, --unit {role}={options.units[role]} is used"
                for role, unit in headers.items())  # fmt: skip
        draft.assumed.append(f"{AGAINST}: {'; '.join(each)}")
    for one in found:
        unit = headers.get(one.role)
        if unit is None or not one.lies_in(one.ranges.unusual) or _is_remedy(one, unit, found):
            continue
        if one.lies_in(one.ranges.usual, unit_factor(unit, one.role)):
            sentence = f"{one.role} {one.shown(unit)}, as the header names it, is usual; {one.shown(one.unit)} is used"
            draft.doubts.append(Doubt((one.role,), f"{sentence}, as --unit has it", f"--unit {one.role}={unit}"))


def _is_remedy(one: Quantity, header: str, found: list[Quantity]) -> bool:
    """Whether a check proposes the unit given: daN for a force, or the system of all other conditions of the file."""
    if (one.role, header, one.unit) == ("Fc", "N", "daN"):
        return True
    others = [x.unit in INCH for x in found if x.unit and x is not one and ROLES[x.role].kind == "condition"]
    is_inch = one.unit in INCH
    return ROLES[one.role].kind == "condition" and is_inch != (header in INCH) and set(others) == {is_inch}


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


def planned_doubts(settings: Mapping[str, Array], process: Process | None, given: Collection[str]) -> tuple[str, ...]:
    """Sentences on the settings of a plan that are unusual in a process; ``given`` ones may be in another unit.

    Raises
    ------
    UsageError
        Settings cannot be.

    >>> planned_doubts({"f": np.array([0.004, 0.016])}, "turning", ["f"])[0]  # doctest: +ELLIPSIS
    'f 0.004 to 0.016 mm/rev is unusual (usual 0.05 to 0.8 mm/rev); 0.004 to 0.016 in/rev would be usual...'
    """
    columns = [_planned(role, x, ranges) for role, x in settings.items() if (ranges := plausible(role, process))]
    units = {one.role: _usual_units(one) for one in columns if one.role in given}
    _refuse_planned(columns, units)
    inch = _in_inch(columns, units)
    return tuple(
        f"{one.role} {one.shown(one.unit)} is unusual ({one.usual}){_in_other_unit(one, units)}"
        for one in columns
        if one.role in inch or _is_unusual(one, units)
    )


def _in_inch(columns: list[Quantity], units: Mapping[str, list[str]]) -> list[str]:
    """Settings that would be usual in inch units, where several would and the cutting speed is possible in sfm."""
    metric = any(one.role == "V" and not one.lies_in(one.ranges.usual, unit_factor("sfm", "V")) for one in columns)
    inch = [role for role, others in units.items() if not INCH.isdisjoint(others)]
    return inch if len(inch) > 1 and not metric else []


def _refuse_planned(columns: list[Quantity], units: Mapping[str, list[str]]) -> None:
    """Refuse settings of a plan that cannot be."""
    for one in columns:
        if not one.lies_in(one.ranges.hard):
            other = _in_other_unit(one, units) if one.role in units else "; it follows from other settings"
            raise UsageError(f"{one.role} {one.shown(one.unit)} cannot be ({one.usual}){other}.")


def _planned(role: str, values: Array, ranges: Plausible) -> Quantity:
    ends = float(values.min()), float(values.max())
    return Quantity(role, 0, ends, ends, ROLES[role].unit, given=False, factor=1.0, ranges=ranges)


def _usual_units(one: Quantity) -> list[str]:
    """Other units in which settings that are not usual would be."""
    others = () if one.lies_in(one.ranges.usual) else candidate_units(one.role)[1:]
    return [unit for unit in others if one.lies_in(one.ranges.usual, unit_factor(unit, one.role))]


def _is_unusual(one: Quantity, units: Mapping[str, list[str]]) -> bool:
    """Whether settings are beyond the unusual, or are long times that would be usual in another unit."""
    long = one.role == "t" and units.get("t") and one.bulk[1] > one.ranges.usual[1]
    return bool(long) or not one.lies_in(one.ranges.unusual)


def _in_other_unit(one: Quantity, units: Mapping[str, list[str]]) -> str:
    """The unit in which settings would be usual, and how to write it; empty where there is none."""
    if not units.get(one.role):
        return ""
    unit, low = units[one.role][0], format_decimal(one.span[0])
    return f"; {one.shown(unit)} would be usual, written {low}{unit}"
