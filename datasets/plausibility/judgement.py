"""Plausibility of a file of tests: what cannot be is refused, what is unusual or contradictory is doubted."""

import re
from dataclasses import replace

import numpy as np

from ...core.arrays import Array, Ints
from ...core.errors import DataError
from ...core.rounding import format_decimal
from ..columns import NONE, ColumnUse
from ..design import looks_numbered
from ..doubts import Doubt
from ..draft import CORRECTS, Draft, correction
from ..edges.checks import ANOTHER_ORDER
from ..edges.rows import FEW
from ..options import Process, ReadOptions
from ..vocabulary import ROLES, roles_named
from .cross_checks import check_columns, check_systems
from .mixed_units import check_mixed_units
from .quantities import Quantity, numeric_columns, state_given_units, table_process, take_unit, unit_factor
from .ranges import INCH, candidate_units, plausible, widest
from .stray_values import check_cells, check_levels, places
from .unused_columns import check_uses

_POSITIVE = ("wear", "load", "surface", "condition", "time")
_NO_FACTOR = ("load", "surface")  # results that other laws do not need
_RESULTS = ("load", "surface", "other")  # exchanged among each other, conditions with time and wear
CLOSE = 10  # values that are merely uncommon do not decide between units of a smaller ratio
NEGATIVE = 0.95  # share of the values of a column whose sign is reversed
# Standard speeds of spindles, 1/min: series R20 of ISO 3, DIN 804; those that plans of cutting speeds have as well
SPINDLE_SPEEDS = (280, 315, 355, 400, 450, 500, 560, 630, 710, 800, 900, 1000, 1120, 1250, 1400, 1600, 1800, 2000, 2240)
ROUND_SPEEDS = (400, 450, 500, 800, 900, 1000, 1600, 1800, 2000)
FEWEST_LEVELS = 3
# Values of a column in two units, the ratio between two groups of them, and by which their medians may be off
FEWEST_OF_UNITS, GAP_OF_UNITS, NEARLY = 8, 4.0, 3.0
# Materials and tools that are turned at more than 600 m/min
_FAST = re.compile(
    r"alu|\bal[ -]?(?:si|mg|cu|\d{4})|magnes|brass|messing|\bc?bn\b|\bp[ck]d\b|dia?mant|diamond|[ck][eé]ram|cerám"
)
_AXES = ("Fx", "Fy", "Fz")  # their sign depends on the axes of the dynamometer, and resultants do not


def settle_units(draft: Draft, options: ReadOptions) -> None:
    """Settle the unit of every column by its values, and refuse or doubt those that no unit makes plausible.

    Raises
    ------
    DataError
        Values cannot be in the unit that the file names, or the file names no unit and several or none fit.
    """
    process = table_process(draft, options)
    found = numeric_columns(draft, options, process)
    exchanged, named = _exchanges(found), draft.uses
    for one in found:
        if ROLES[one.role].kind == "wear":
            _refuse_two_units(draft, one)
        if one.unit:
            _judge_named(draft, one, exchanged)
        elif not _doubt_revolutions(draft, one, options, process) and not one.lies_in(one.ranges.usual):
            _judge_unnamed(draft, one, exchanged)
    check_systems(draft, found if draft.uses is named else numeric_columns(draft, options, process), named)
    state_given_units(draft, options, found)
    _state_unnamed(draft)
    check_cells(draft, options)


def check_signs(draft: Draft, options: ReadOptions) -> None:
    """Refuse a condition or a wear that is negative throughout, and doubt other results, which then have no law.

    Raises
    ------
    DataError
        Laws need the column: a condition, a time, a wear, or the only result of the file.
    """
    results = {use.role for use in draft.uses if use.role and ROLES[use.role].kind in ("wear", *_NO_FACTOR)}
    for place, use in enumerate(draft.uses):
        kind = ROLES[use.role].kind if use.role else ""
        if use.role is None or kind not in _POSITIVE or use.role in options.ranges:
            continue
        values = np.asarray(draft.columns[place].values, dtype=float)  # as written
        known = values[np.isfinite(values) & (values != 0)]
        if not known.size or np.mean(known < 0) < NEGATIVE:
            continue
        sentence, remedy = _reversed(use, known), f"--correct 'all:{use.role}*-1'"
        if use.role not in _AXES and (kind not in _NO_FACTOR or results == {use.role}):
            raise DataError(f"column {draft.columns[place].name!r}: {sentence}; read it with {remedy}.")
        sentence += f", so that no law of {use.role} is fitted"
        concerned = use.role if use.role in _AXES else use.header
        draft.doubts.append(Doubt((concerned,), sentence, remedy.replace("'", "")))
        if use.role not in _AXES:
            _give_no_role(draft, place)
            results.remove(use.role)


def _reversed(use: ColumnUse, known: Array) -> str:
    """In how many rows a column is negative, and between which values."""
    share = "all" if (known < 0).all() else f"{np.count_nonzero(known < 0)} of {known.size}"
    low, high = format_decimal(float(known.min())), format_decimal(float(known[known < 0].max()))
    shown = f"{low if low == high else f'{low} to {high}'} {use.unit}".rstrip()
    return f"{use.role} is negative in {share} rows ({shown}): reversed sign"


def _give_no_role(draft: Draft, place: int) -> None:
    """Take its role from a column: it is not used."""
    use = draft.uses[place]
    draft.uses = (*draft.uses[:place], replace(use, role=None, suggestion=None), *draft.uses[place + 1 :])
    draft.data.pop(str(use.role), None)
    draft.units.pop(str(use.role), None)


def check_values(draft: Draft, options: ReadOptions) -> None:
    """Doubt values and columns of a complete draft that contradict each other, and columns that are not used."""
    if len(draft.lines):
        check_levels(draft, options)
        check_mixed_units(draft)
        check_columns(draft, options)
        check_uses(draft, options)
        draft.doubts[:] = _causes_first(draft.doubts)


def _causes_first(doubts: list[Doubt]) -> list[Doubt]:
    """Doubts with a correction first, without loads that are of another order where a condition is to be corrected."""
    causes = [one for one in doubts if CORRECTS in one.remedy]
    kinds = [{ROLES[role].kind for role in one.columns if role in ROLES} for one in causes]
    lines = {line for one, of in zip(causes, kinds, strict=True) if "condition" in of for line in one.lines}
    others = [one for one in doubts if one not in causes]
    return [*causes, *(one for one in others if ANOTHER_ORDER not in one.sentence or not lines.issuperset(one.lines))]


def _state_unnamed(draft: Draft) -> None:
    """State the units in which columns without a unit were taken."""
    unnamed = [
        f"{use.role} {ROLES[use.role].unit}"
        for use in draft.uses
        if use.role and not use.unit and ROLES[use.role].unit not in ("", "1")
    ]
    if unnamed:
        draft.assumed.append(f"units that the file does not name: {', '.join(unnamed)}")


def _exchanges(found: list[Quantity]) -> dict[str, Quantity]:
    """Role -> the other column of each pair that would be usual with headers exchanged, and is not as it stands."""
    partners: dict[str, list[Quantity]] = {}
    for i, a in enumerate(found):
        for b in found[i + 1 :]:
            if (ROLES[a.role].kind in _RESULTS) != (ROLES[b.role].kind in _RESULTS):
                continue
            if a.lies_in(a.ranges.unusual) and b.lies_in(b.ranges.unusual):
                continue
            if b.lies_in(a.ranges.usual, a.factor) and a.lies_in(b.ranges.usual, b.factor):
                partners.setdefault(a.role, []).append(b)
                partners.setdefault(b.role, []).append(a)
    return {role: others[0] for role, others in partners.items() if len(others) == 1}


def _exchange_options(draft: Draft, a: Quantity, b: Quantity) -> str:
    """Options that exchange two columns; the units stay with the names."""
    given = []
    for one, other in ((a, b), (b, a)):
        given.append(f'--map "{one.role}=col{draft.columns[other.place].number}"')
    for one, other in ((a, b), (b, a)):
        if other.unit:  # the header that it would take names the unit of the other
            given.append(f'--unit "{one.role}={one.unit or ROLES[one.role].unit}"')
    return " ".join(given)


def _other_role(draft: Draft, one: Quantity) -> str:
    """Option that gives the column to another role of its name in which it is usual: a feed rate under "feed"."""
    use = draft.uses[one.place]
    for role in roles_named(use.name):
        ranges = plausible(role, None)
        if role != one.role and role not in draft.data and ranges and one.lies_in(ranges.usual, 1.0):
            unit = f" --unit {role}={ROLES[role].unit}" if one.unit else ""
            return f"as {ROLES[role].quantity}, --map {role}=col{use.number}{unit}"
    return ""


def _judge_named(draft: Draft, one: Quantity, exchanged: dict[str, Quantity]) -> None:
    """Refuse values that cannot be in the unit named, doubt unusual ones."""
    units = [
        u
        for u in _units_in_use(draft, one)
        if u != one.unit and one.lies_in(one.ranges.usual, unit_factor(u, one.role))
    ]
    if one.lies_in(one.ranges.unusual):
        _doubt_long_times(draft, one, units)
        return
    other = exchanged.get(one.role)
    possible = one.lies_in(one.ranges.hard) or (one.given and one.lies_in(widest(one.role).hard))
    head = f"{one.role} {one.shown(one.unit)}"
    swap = f"columns {one.role} and {other.role} may be exchanged" if other else ""
    if possible:
        remedy = _exchange_options(draft, one, other) if other else f"--unit {one.role}={units[0]}" if units else ""
        why = f"; {swap}" if swap else f"; {one.shown(units[0])} would be usual" if units else ""
        far = not one.given and (other is not None or _is_unit_error(draft, one))
        sentence = f"{head} is unusual ({one.usual}){why}" + (_confirmation(one.role, one.unit) if far else "")
        draft.doubts.append(Doubt((one.role,), sentence, remedy, unsettled=far))
        return
    header = draft.columns[one.place].name
    can = " or ".join(f"{one.shown(unit)} can: --unit {one.role}={unit}" for unit in units[:2])
    swap = f"{swap}: {_exchange_options(draft, one, other)}" if other else ""
    can = " or ".join(filter(None, (swap, can, _other_role(draft, one))))
    raise DataError(f"column {header!r}: {head} cannot be ({one.usual}); {can or _correct(one)}.")


def _doubt_long_times(draft: Draft, one: Quantity, units: list[str]) -> None:
    """Doubt times in the cut that are long in the unit named and usual in another: seconds named minutes."""
    if ROLES[one.role].kind == "time" and units and not one.given and one.bulk[0] * one.factor > one.ranges.usual[1]:
        sentence = f"{one.role} {one.shown(one.unit)} is long ({one.usual}); {one.shown(units[0])} would be usual"
        draft.doubts.append(Doubt((one.role,), sentence, f"--unit {one.role}={units[0]}"))


def _confirmation(role: str, unit: str) -> str:
    return f"; if the values are in {unit}, confirm it with --unit {role}={unit}"


def _is_unit_error(draft: Draft, one: Quantity) -> bool:
    """Whether another unit of a ratio of 10 or more makes the values usual, or a conversion that was made twice."""
    units = _units_in_use(draft, one)
    steps = [unit_factor(unit, one.role) / one.factor for unit in units]
    steps += [one.factor / unit_factor(unit, one.role) for unit in units if unit not in INCH]
    far = [step for step in steps if not 1 / CLOSE < step < CLOSE]
    return any(one.lies_in(one.ranges.usual, one.factor * step) for step in far)


def _correct(one: Quantity) -> str:
    units = " or ".join(f"--unit {one.role}={unit}" for unit in candidate_units(one.role)[:2] if unit != one.unit)
    return (
        f"correct the unit ({units or 'in the header'}), give the role to another column with "
        f"--map {one.role}=..., or to none with --map {one.role}={NONE}"
    )


def _is_metric(draft: Draft) -> bool:
    """Whether the file names metric units of conditions, and no inch units."""
    named = {use.unit for use in draft.uses if use.role and use.unit and ROLES[use.role].kind == "condition"}
    return bool(named - {"1/min", "rev/s"}) and named.isdisjoint(INCH)


def _units_in_use(draft: Draft, one: Quantity) -> list[str]:
    """Units that a column may be in, that of the role first; wear and loads of a metric file are not in inch units."""
    inch_out = ROLES[one.role].kind in ("wear", "load") and _is_metric(draft)
    return [unit for unit in candidate_units(one.role) if not (inch_out and unit in INCH)]


def _doubt_unnamed(draft: Draft, one: Quantity, unit: str) -> None:
    """Doubt the default unit, which is taken, where another unit would make the values usual."""
    home, factor = ROLES[one.role].unit, unit_factor(unit, one.role)
    head = f"{one.role} {one.shown(home)} is unusual ({one.usual}), its unit is not named"
    sentence = f"{head}; {one.shown(unit)} would be usual"
    far = not 1 / CLOSE < factor < CLOSE
    if far:
        sentence += _confirmation(one.role, home)
    draft.doubts.append(Doubt((one.role,), sentence, f"--unit {one.role}={unit}", unsettled=far))


def _refuse_two_units(draft: Draft, one: Quantity) -> None:
    """Refuse a wear that is a thousand or a hundred times as large in some rows as in the others, with their lines.

    Both groups are measured at the same times: a wear of new edges beside that of worn ones is no other unit.
    """
    x = np.asarray(draft.columns[one.place].values, dtype=float)
    with np.errstate(invalid="ignore", divide="ignore"):
        y = np.where(x > 0, np.log(x), np.nan)
    levels = np.sort(y[np.isfinite(y)])
    if len(levels) < FEWEST_OF_UNITS or float(np.diff(levels).max()) < np.log(GAP_OF_UNITS):
        return
    cut = levels[int(np.diff(levels).argmax())]
    _refuse_groups(draft, one, x, y, (np.flatnonzero(y <= cut), np.flatnonzero(y > cut)))


def _refuse_groups(draft: Draft, one: Quantity, x: Array, y: Array, groups: tuple[Ints, Ints]) -> None:
    """Refuse small and large values, ``y`` their logarithms, where the groups are a ratio of units apart."""
    (low, high), levels = groups, y[np.isfinite(y)]
    share = min(len(low), len(high)) / len(levels)
    if share < FEW and one.lies_in(one.ranges.unusual):  # few edges of another order are doubted by name
        return
    times = np.asarray(draft.data["t"], dtype=float) if "t" in draft.data else np.ones(len(x))
    apart, later = (float(np.nanmedian(of[high])) / max(float(np.nanmedian(of[low])), 1e-12) for of in (x, times))
    factor = next((step for step in (1000.0, 100.0) if 1 / NEARLY < apart / step < NEARLY), 0.0)
    usual = [_between(one.ranges.usual, float(np.median(x[rows])) * one.factor) for rows in (low, high)]
    if not factor or not 1 / NEARLY < later < NEARLY or sum(usual) != 1 or len(np.unique(y[low])) < FEWEST_LEVELS:
        return
    wrong, step = (high, 1 / factor) if usual[0] else (low, factor)
    shown = [" to ".join(format_decimal(float(end)) for end in (x[at].min(), x[at].max())) for at in (low, high)]
    cause = "um and mm, two units" if factor > CLOSE**2 else "a decimal mark, or mm and hundredths of mm"
    raise DataError(
        f"column {draft.columns[one.place].name!r}: {one.role} is {shown[0]} in {len(low)} rows and {shown[1]} in "
        f"{len(high)} rows ({places(draft, high)}), {factor:g} times as large: {cause}; read it with "
        f"{correction(draft, wrong, one.role, step) or 'one unit in all rows'}."
    )


def _between(ends: tuple[float, float], value: float) -> bool:
    return ends[0] <= value <= ends[1]


def _as_revolutions(draft: Draft, one: Quantity, options: ReadOptions, process: Process | None) -> bool:
    """Whether the numbers of a speed are possible in m/min, and those of a spindle, which is not known."""
    spindle = plausible("n", process)
    if spindle is None or "n" in {*draft.data, *options.constants}:
        return False
    return one.lies_in(spindle.usual) and one.lies_in(one.ranges.unusual)


def _is_fast(draft: Draft, options: ReadOptions) -> bool:
    """Whether names or notes are of a material or a tool that is turned at high speed."""
    labels = {str(label) for role in ("tool", "work") for label in draft.data.get(role, ())}
    return bool(_FAST.search(" ".join([options.tool or "", options.work or "", *labels, *draft.notes]).casefold()))


def _fastest(one: Quantity, process: Process | None) -> float:
    """Largest usual cutting speed of a process, of turning where none is named, m/min."""
    return (plausible("V", process or "turning") or one.ranges).usual[1]


def _in_series(levels: Array) -> bool:
    return len(levels) >= FEWEST_LEVELS and bool(np.isin(levels.round(), SPINDLE_SPEEDS).all())


def _doubt_revolutions(draft: Draft, one: Quantity, options: ReadOptions, process: Process | None) -> bool:
    """Whether a speed without a unit may be that of the spindle, which then is doubted, and stays in m/min."""
    if one.role != "V" or not _as_revolutions(draft, one, options, process) or _is_fast(draft, options):
        return False
    values = np.unique(np.asarray(draft.columns[one.place].values, dtype=float))
    levels, least, standard = values[values > 0], _fastest(one, process), _in_series(values[values > 0])
    either = "n" in roles_named(draft.uses[one.place].name)  # "speed" may be either
    if not (np.median(levels) > least or (either and standard and not np.isin(levels, ROUND_SPEEDS).all())):
        return False
    _doubt_spindle(draft, one, least, standard=standard)
    return True


def _doubt_spindle(draft: Draft, one: Quantity, least: float, *, standard: bool) -> None:
    """Doubt a speed that may be that of the spindle; ``least`` m/min are unusual."""
    usual = f"usual {format_decimal(one.ranges.usual[0])} to {format_decimal(least)} m/min"
    spindles = "standard spindle speeds" if standard else "usual spindle speeds"
    sentence = f"V {one.shown('')} has no unit and is taken as m/min ({usual}); in 1/min these are {spindles}"
    sentence += _confirmation("V", "m/min")
    draft.doubts.append(Doubt(("V",), sentence, f"--map n=col{draft.columns[one.place].number}"))


def _judge_unnamed(draft: Draft, one: Quantity, exchanged: dict[str, Quantity]) -> None:
    """Take the default unit while it is plausible, otherwise the only plausible one, otherwise ask."""
    home, *others = _units_in_use(draft, one)
    usual = [unit for unit in others if one.lies_in(one.ranges.usual, unit_factor(unit, one.role))]
    head = f"{one.role} {one.shown('')}"
    if one.lies_in(one.ranges.unusual):
        far = [unit for unit in usual if not 1 / CLOSE < unit_factor(unit, one.role) < CLOSE]
        if far:
            _doubt_unnamed(draft, one, far[0])
        return
    other = exchanged.get(one.role)
    if other is not None and usual not in ([], ["mil"]) and other.lies_in(other.ranges.unusual):
        other = None  # a unit of this column alone explains it
    options = usual or [unit for unit in others if one.lies_in(one.ranges.unusual, unit_factor(unit, one.role))]
    role = _other_role(draft, one)
    options = [unit for unit in options if not (role and unit == "um/rev")]  # rare beside a feed rate
    strange = options == ["mil"] or (len(options) == 1 and options[0] in INCH and _is_metric(draft))
    if strange and other is None and one.lies_in(one.ranges.hard, 1.0):  # a rare unit, or inch in a metric file
        _doubt_unnamed(draft, one, options[0])
        return
    if len(options) == 1 and other is None and not role:
        take_unit(draft, one, options[0])
        sentence = (
            f"{head} has no unit and is taken as {options[0]}, since {one.shown(home)} is implausible ({one.usual})"
        )
        draft.doubts.append(Doubt((one.role,), sentence, f"--unit {one.role}={options[0]}"))
        return
    kind = ROLES[one.role].kind
    small = kind == "wear" and _is_metric(draft) and one.lies_in(one.ranges.hard, 1.0)
    if other is None and not options and not role and (small or kind not in ("condition", "time", "wear")):
        sentence = f"{head} {home} is unusual ({one.usual}), its unit is not named"
        if _is_unit_error(draft, one):
            draft.doubts.append(Doubt((one.role,), sentence + _confirmation(one.role, home), unsettled=True))
        else:
            draft.doubts.append(Doubt((one.role,), sentence, f"--unit {one.role}={home}"))
        return
    if other is not None:
        choices = [f"exchange the columns {one.role} and {other.role}, {_exchange_options(draft, one, other)}"]
    else:
        choices = [*([role] if role else ()), *(f"--unit {one.role}={unit}" for unit in options)]
        if one.lies_in(one.ranges.hard, 1.0):
            choices.append(f"--unit {one.role}={home} if they are right")
        if kind == "condition" and looks_numbered(np.asarray(draft.columns[one.place].values, dtype=float)):
            choices.append("the value of each level, low:middle:high, as --range if they are the numbers of levels")
    header = draft.columns[one.place].name
    raise DataError(
        f"column {header!r}: {head} has no unit and is implausible in {home} ({one.usual}): "
        f"{' or '.join(choices) if choices else _correct(one)}."
    )
