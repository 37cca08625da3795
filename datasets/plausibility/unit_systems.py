"""Metric and inch units in one file: a column without a unit is settled by its values or asked about."""

from ...core.errors import DataError
from ..columns import ColumnUse
from ..doubts import Doubt
from ..draft import Draft
from ..vocabulary import ROLES
from .quantities import Quantity, take_unit, unit_factor
from .ranges import INCH, candidate_units

_BASIC = ("V", "f", "fz", "fm", "d", "ae", "D")  # conditions that show the system of a laboratory
_SHARED = ("min", "1/min")  # in both systems


def check_systems(draft: Draft, found: list[Quantity], before: tuple[ColumnUse, ...]) -> None:
    """Settle columns without a unit in a file of inch units, and doubt a file that names units of both systems.

    ``before`` are the uses of the columns with the units that the file names: wear alone whose unit was found from its
    values does not show that the file is in inches.

    Raises
    ------
    DataError
        A column without a unit is plausible in both systems.
    """
    stated = {use.role for use in before if use.unit}
    inch = [one for one in found if one.unit in INCH and (one.role in stated or ROLES[one.role].kind != "wear")]
    basic = [one for one in inch if one.role in _BASIC]
    metric = [one for one in found if one.unit and one.unit not in INCH and one.role in _BASIC]
    if basic and metric and not (_given(basic) or _given(metric)):
        _doubt_mixture(draft, basic, metric)
    if not inch or (metric and not basic):
        return
    asked = [one for one in found if not one.unit and _inch_unit(one) and not _settled(draft, one)]
    if asked:
        named = ", ".join(f"{one.role} {one.unit}" for one in inch)
        each = "; ".join(
            f"{one.role} {one.shown('')}: --unit {one.role}={_inch_unit(one)} "
            f"or --unit {one.role}={ROLES[one.role].unit}"
            for one in asked
        )
        verb = "has no unit" if len(asked) == 1 else "have no unit"
        raise DataError(
            f"the file is in inch units ({named}), and {', '.join(one.role for one in asked)} {verb}. Give it: {each}."
        )
    power = next((one for one in found if one.role == "P" and not one.unit), None)
    if power is not None:
        sentence = f"P {power.shown('kW')} has no unit in a file of inch units, and may be in hp"
        draft.doubts.append(Doubt(("P",), sentence, "--unit P=hp"))


def _given(those: list[Quantity]) -> bool:
    return all(one.given for one in those)


def _doubt_mixture(draft: Draft, basic: list[Quantity], metric: list[Quantity]) -> None:
    few = min((basic, metric), key=len)
    other = "in inch" if few is basic else "in metric"
    listed = ", ".join(f"{one.role} {one.unit}" for one in (*basic, *metric))
    remedy = " ".join(f"--unit {one.role}={ROLES[one.role].unit if few is basic else _inch_unit(one)}" for one in few)
    sentence = f"units of both systems in one file: {listed}; {', '.join(one.role for one in few)} alone {other} units"
    draft.doubts.append(Doubt(tuple(one.role for one in few), sentence, remedy))


def _inch_unit(one: Quantity) -> str:
    return next((unit for unit in candidate_units(one.role) if unit in INCH), "")


def _settled(draft: Draft, one: Quantity) -> bool:
    """Whether only one of the two systems is plausible for a column without a unit; inch values are converted."""
    unit, home = _inch_unit(one), ROLES[one.role].unit
    factor = unit_factor(unit, one.role)
    if one.lies_in(one.ranges.usual) and not one.lies_in(one.ranges.unusual, factor):
        taken, other = home, unit
    elif one.lies_in(one.ranges.usual, factor) and not one.lies_in(one.ranges.unusual):
        taken, other = unit, home
        take_unit(draft, one, unit)
    else:
        return False
    if one.role in _BASIC or taken == unit:
        sentence = (
            f"{one.role} {one.shown('')} has no unit in a file of inch units and is taken as {taken}, "
            f"since {one.shown(other)} is implausible ({one.usual})"
        )
        draft.doubts.append(Doubt((one.role,), sentence, f"--unit {one.role}={taken}"))
    return True
