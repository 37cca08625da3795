"""Columns of a file of tests compared with each other: specific force, power, roughness, metric and inch units."""

from typing import NamedTuple

import numpy as np

from ...core.arrays import Array, Ints
from ...core.errors import DataError
from ...core.rounding import format_decimal
from ..columns import ColumnUse
from ..derived.rules import known_of
from ..doubts import Doubt
from ..draft import CORRECTS, Draft, numbers_of
from ..options import ReadOptions
from ..vocabulary import ROLES
from .quantities import Quantity, table_process, take_unit, unit_factor
from .ranges import FORCES, INCH, KC, candidate_units
from .stray_values import places

KC_USUAL, KC_LIMITS, KC_POSSIBLE = KC.usual, KC.unusual, KC.hard
RISE, KC_OF_1_MM = 0.25, 250  # usual exponent of the thickness; N/mm2 at a chip of 1 mm, 350 of soft aluminium
LARGEST_DRILL = 32.0  # mm: workpieces that are turned are larger
ROUGHNESS_LIMITS = (2.0, 15)  # Rz/Ra; usual 3 to 10
ROUGHNESS_POSSIBLE = (1.0, 50)
SPECIFIC_USUAL, SPECIFIC_POSSIBLE = (100, 6000), (10, 30000)  # N/mm2, of any force; small at thrust of sharp edges
FORCE_POSSIBLE = (0.1, 10)  # of a resultant to that of its components; beyond, a unit is wrong and no axis is missing
DEVIATION = 8.0  # of a row from the median of the ratio
FEWEST = 5
MOST_ABOVE = 0.9  # share of rows with Ff or Fp above Fc
MAIN_FORCE = {"f": 0.75, "d": 1.0}  # usual exponents of a cutting force: Kienzle's 1 - mc, and 1
SPARE = 2  # rows beyond the coefficients of a force
CLEARLY = 0.2  # by which the exponents of another force are nearer to these
PROFILES = {"Ra": 32, "Rz": 8}  # roughness of the geometry: 1000 f^2/(32 re) and 1000 f^2/(8 re) um, re the nose radius
DOMINANT = 4.0  # um of geometric Rz above which edge build-up, wear and chatter add a smaller part
ROUGHER, SMOOTHER = 3.0, 0.6  # of the geometric roughness: Ra of no sound test in every row, and wiper inserts alone
NEAR = 0.02  # by which an engagement may exceed the tool

_BASIC = ("V", "f", "fz", "fm", "d", "ae", "D")  # conditions that show the system of a laboratory
_SHARED = ("min", "1/min")  # in both systems


class _Ratio(NamedTuple):
    """A ratio of columns: where its median is usual, implausible beyond ``limits``, impossible beyond ``possible``."""

    roles: tuple[str, ...]
    name: str
    limits: tuple[float, float]
    possible: tuple[float, float]
    usual: tuple[float, float]
    unit: str


_KC_OF_FORCE = _Ratio(("Fc", "f", "d"), "kc = Fc/(f d)", KC_LIMITS, KC_POSSIBLE, KC_USUAL, "N/mm2")
_KC_OF_POWER = _Ratio(("P", "V", "f", "d"), "kc = 60000 P/(V f d)", KC_LIMITS, KC_POSSIBLE, KC_USUAL, "N/mm2")
_ROUGHNESSES = _Ratio(("Rz", "Ra"), "Rz/Ra", ROUGHNESS_LIMITS, ROUGHNESS_POSSIBLE, (3, 10), "")


def check_columns(draft: Draft, options: ReadOptions) -> None:
    """Doubt columns that contradict each other, and refuse an engagement that exceeds the tool.

    Raises
    ------
    DataError
        The width of cut exceeds the diameter of the mill, or the depth of cut the radius of the drill, in most rows.
    """
    measured = {use.role for use in draft.uses if use.role}
    values = {role: np.asarray(draft.data[role], dtype=float) for role in measured if ROLES[role].unit}
    turning = table_process(draft, options) in (None, "turning") and measured.isdisjoint(("ae", "fz", "fm", "z"))
    if turning and {"f", "d"} <= measured:
        area = values["f"] * values["d"]
        if "Fc" in measured:
            _compare(draft, _KC_OF_FORCE, _over(values["Fc"], area), options)
            _doubt_low_kc(draft, _over(values["Fc"], area), values["f"], options)
        elif {"P", "V"} <= measured:
            kc = _over(60000 * values["P"], values["V"] * area)
            _compare(draft, _KC_OF_POWER, kc, options)
        _compare_specific_force(draft, values, area, options)
    if {"Rz", "Ra"} <= measured:
        _compare(draft, _ROUGHNESSES, _over(values["Rz"], values["Ra"]), options)
    if turning and "Fc" in measured:
        _compare_components(draft, values)
    if turning and "f" in measured:
        _compare_geometry(draft, values, options)
    _compare_force(draft, values, options)
    _compare_torque(draft, options)
    _compare_engagement(draft, options)


def _doubt_low_kc(draft: Draft, kc: Array, f: Array, options: ReadOptions) -> None:
    """Doubt a force whose specific force, at a chip of 1 mm, is below that of any metal: daN named N."""
    known = np.isfinite(kc) & (f > 0)
    use = next(use for use in draft.uses if use.role == "Fc")
    if np.count_nonzero(known) < FEWEST or "Fc" in options.units or use.unit not in ("", "N"):
        return
    middle, at_1_mm = float(np.median(kc[known])), float(np.median(kc[known] * f[known] ** RISE))
    if at_1_mm < KC_OF_1_MM and KC_USUAL[0] <= 10 * middle <= KC_USUAL[1]:
        draft.doubts[:] = [one for one in draft.doubts if one.columns != _KC_OF_FORCE.roles or one.lines]
        sentence = (
            f"{_KC_OF_FORCE.name} is {format_decimal(middle)} N/mm2 (usual {KC_USUAL[0]} to {KC_USUAL[1]}): Fc, f "
            f"or d is in another unit or exchanged; with Fc in daN it is {format_decimal(10 * middle)}"
        )
        draft.doubts.append(Doubt(("Fc", "f", "d"), sentence, "--unit Fc=daN"))


def _compare_torque(draft: Draft, options: ReadOptions) -> None:
    """Doubt the torque of a drill whose specific force is implausible; without a process, of diameters of drills."""
    process = table_process(draft, options)
    tool = next((one for one in ("Dc", "D") if one in draft.data), "")
    if not tool or not {"M", "f"} <= draft.data.keys() or process not in (None, "drilling"):
        return
    M, f, D = (np.asarray(draft.data[role], dtype=float) for role in ("M", "f", tool))
    if process is None and ("d" in draft.data or not float(np.nanmax(D, initial=0.0)) <= LARGEST_DRILL):
        return
    name = f"kc = 8000 M/(f {tool}^2)"
    of = _Ratio(("M", "f", tool), name, KC_LIMITS, KC_POSSIBLE, KC_USUAL, "N/mm2")
    _compare(draft, of, _over(8000 * M, f * D**2), options)


def _above_cutting_force(values: dict[str, Array], role: str) -> tuple[int, int] | None:
    """The number of rows with more of a force than of Fc, and of all; None unless they are nearly all."""
    both = np.isfinite(values["Fc"]) & np.isfinite(values[role])
    count, known = int(np.sum(values[role][both] > values["Fc"][both])), int(np.sum(both))
    return (count, known) if known >= FEWEST and count > MOST_ABOVE * known else None


def _compare_components(draft: Draft, values: dict[str, Array]) -> None:
    """Doubt a feed or passive force above the cutting force in nearly all rows: exchanged names.

    A passive force exceeds it in finishing and hard turning, and is doubted where it depends on feed and depth as a
    cutting force does, and the column of the cutting force does not.
    """
    above = {role: found for role in ("Ff", "Fp") if role in values and (found := _above_cutting_force(values, role))}
    off = {role: _off_main_force(values, role) for role in ("Fc", *above)}
    if not off.get("Fp", -np.inf) + CLEARLY < off["Fc"]:
        above.pop("Fp", None)
    if not above:
        return
    role = min(above, key=lambda one: off[one])
    number = {use.role: use.number for use in draft.uses if use.role}
    sentence = f"{role} exceeds Fc in {above[role][0]} of {above[role][1]} rows"
    if role == "Fp":
        sentence += " and depends on f and d as a cutting force does"
    remedy = f'--map "Fc=col{number[role]}" --map "{role}=col{number["Fc"]}"'
    draft.doubts.append(Doubt(("Fc", role), f"{sentence}: the two columns may be exchanged", remedy))


def _off_main_force(values: dict[str, Array], role: str) -> float:
    """By how much the exponents of feed and depth differ from those of a cutting force; infinite where unknown."""
    held = {name: values[name] for name in ("f", "d", "V") if name in values}
    names: list[str] = [name for name, x in held.items() if np.fmax.reduce(x) > np.fmin.reduce(x)]  # not empty
    if not set(MAIN_FORCE) <= set(names):
        return np.inf
    X = np.column_stack([values[role], *(values[name] for name in names)])
    X = np.log(X[(np.isfinite(X) & (X > 0)).all(axis=1)])
    A = np.column_stack([np.ones(len(X)), X[:, 1:]])
    if len(X) < A.shape[1] + SPARE or np.linalg.matrix_rank(A) < A.shape[1]:
        return np.inf
    found = np.linalg.lstsq(A, X[:, 0], rcond=None)[0]
    return float(sum(abs(found[1 + names.index(name)] - usual) for name, usual in MAIN_FORCE.items()))


def _compare_specific_force(draft: Draft, values: dict[str, Array], area: Array, options: ReadOptions) -> None:
    """Doubt the largest force of a file without Fc where no cutting process has its ratio to the area of the chip."""
    held = {role: values[role][np.isfinite(values[role])] for role in FORCES if role in values and role != "Fc"}
    forces = {role: float(np.median(numbers)) for role, numbers in held.items() if numbers.size}
    if "Fc" in values or not forces:
        return
    role = max(forces, key=lambda name: forces[name])
    name = f"{role}/(f d)"
    of = _Ratio((role, "f", "d"), name, SPECIFIC_POSSIBLE, SPECIFIC_POSSIBLE, SPECIFIC_USUAL, "N/mm2")
    _compare(draft, of, _over(values[role], area), options)


def _compare_geometry(draft: Draft, values: dict[str, Array], options: ReadOptions) -> None:
    """Doubt a roughness against that which feed and nose radius leave: Rz named Ra, or Ra named Rz."""
    known = known_of(draft.data, draft.notes, options)
    roles = [role for role in PROFILES if role in values and role not in (*options.map, *options.units)]
    if len(roles) != 1 or not known.has("re"):
        return
    role, f, re = roles[0], values["f"], np.asarray(known.value("re"), dtype=float)
    highest = np.where(f <= re, _over(1000 * f**2, PROFILES["Rz"] * re * np.ones(len(f))), np.nan)
    ratio = _over(values[role], highest * PROFILES["Rz"] / PROFILES[role])
    ratio = ratio[(highest >= DOMINANT) & np.isfinite(ratio)]
    if len(ratio) < FEWEST:
        return
    number = next(use.number for use in draft.uses if use.role == role)
    _doubt_geometry(draft, role, ratio, number)


def _doubt_geometry(draft: Draft, role: str, ratio: Array, number: int) -> None:
    """Doubt a roughness by its ``ratio`` to that of the geometry."""
    low, high, middle = float(ratio.min()), float(ratio.max()), float(np.median(ratio))
    formula = f"{role}/(1000 f^2/({PROFILES[role]} re))"
    if role == "Ra" and low >= ROUGHER and high <= ROUGHER * PROFILES["Ra"] / PROFILES["Rz"]:
        head = f"{formula} is {format_decimal(low)} to {format_decimal(high)} in {len(ratio)} rows (usual 1 to 2)"
        sentence = f"{head}, and the values are usual for Rz: Rz under the name of Ra, another nose radius, or chatter"
        draft.doubts.append(Doubt(("Ra",), sentence, f'--map "Rz=col{number}"'))
    elif np.mean(ratio < SMOOTHER) > MOST_ABOVE:
        head = f"{formula} is {format_decimal(middle)} in the middle of {len(ratio)} rows, where the geometry gives 1"
        named = role == "Rz" and middle * PROFILES["Ra"] / PROFILES["Rz"] >= SMOOTHER
        other = "Ra under the name of Rz, " if named else ""
        sentence = f"{head}: {other}another nose radius or unit, or a wiper insert, whose finish is smoother"
        draft.doubts.append(Doubt((role,), sentence, f'--map "Ra=col{number}"' if named else ""))


def _compare_engagement(draft: Draft, options: ReadOptions) -> None:
    """Width of cut against the diameter of a mill, depth of cut against the radius of a drill."""
    process = table_process(draft, options)
    role, share, of = {"milling": ("ae", 1.0, "diameter"), "drilling": ("d", 0.5, "radius")}.get(
        process or "", ("", 0, "")
    )
    if not role or role not in draft.data:
        return
    known = known_of(draft.data, draft.notes, options)
    tool = next((one for one in ("Dc", "D") if known.has(one)), None)
    if tool is None:
        return
    most = share * np.broadcast_to(np.asarray(known.value(tool), dtype=float), len(draft.lines))
    size = np.asarray(draft.data[role], dtype=float)
    wrong = np.flatnonzero(size > most * (1 + NEAR))
    if not wrong.size:
        return
    i = int(wrong[0])
    head = (
        f"{role} {format_decimal(float(size[i]))} mm exceeds the {of} of the tool, {format_decimal(float(most[i]))} mm"
    )
    if wrong.size > 0.5 * np.count_nonzero(np.isfinite(size)):
        hole = "; the depth of a hole is no depth of cut" if process == "drilling" else ""
        raise DataError(
            f"{head}, in {wrong.size} of {len(size)} rows, which cannot be{hole}: correct the unit (--unit {role}=..., "
            f"--unit {tool}=...), or leave the column out with --map {role}=none."
        )
    sentence = f"{places(draft, wrong)}: {head}: {role} or {tool} is wrong there"
    draft.doubts.append(Doubt((role, tool), sentence, lines=numbers_of(draft, wrong)))


def _over(above: Array, below: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = above / below
    return np.where(np.isfinite(ratio) & (ratio > 0), ratio, np.nan)


def _compare(draft: Draft, of: _Ratio, ratio: Array, options: ReadOptions) -> None:
    """Doubt a ratio of columns whose median is implausible, or that is far from its median in a few rows."""
    roles, name, unit = of.roles, of.name, of.unit
    known = ratio[~np.isnan(ratio)]
    if len(known) < FEWEST:
        return
    middle = float(np.sort(known)[len(known) // 2])
    low, high = map(format_decimal, of.usual)
    if not of.limits[0] <= middle <= of.limits[1]:
        sentence = (
            f"{name} is {format_decimal(middle)} {unit}".rstrip()
            + f" (usual {low} to {high}): {_one_of(roles)} is in another unit or exchanged"
        )
        draft.doubts.append(_of_ratio(draft, roles, sentence, of.possible[0] <= middle <= of.possible[1], options))
        return
    with np.errstate(invalid="ignore"):
        odd = np.flatnonzero((ratio > middle * DEVIATION) | (ratio < middle / DEVIATION))
    if 0 < len(odd) <= len(known) // 3 and not _explained(draft, roles, odd):
        sentence = (
            f"{places(draft, odd)}: {name} is {format_decimal(float(ratio[odd[0]]))} {unit}".rstrip()
            + f", {format_decimal(middle)} in the middle of all rows: {_one_of(roles)} is wrong there"
        )
        draft.doubts.append(Doubt(roles, sentence, lines=numbers_of(draft, odd)))


def _of_ratio(draft: Draft, roles: tuple[str, ...], sentence: str, possible: bool, options: ReadOptions) -> Doubt:
    """The doubt on columns that contradict each other: an impossible ratio is settled by the units of all of them."""
    known = any(doubt.unsettled and not set(roles).isdisjoint(doubt.columns) for doubt in draft.doubts)
    if possible or known or options.units.keys() >= set(roles):
        return Doubt(roles, sentence)
    units = " ".join(f"--unit {role}={ROLES[role].unit}" for role in roles)
    return Doubt(roles, f"{sentence}; if all units are right, confirm them with {units}", unsettled=True)


def _explained(draft: Draft, roles: tuple[str, ...], rows: Ints) -> bool:
    """Whether a correction of one of these columns in the same rows is proposed already."""
    lines = set(numbers_of(draft, rows))
    proposed = [doubt for doubt in draft.doubts if CORRECTS in doubt.remedy]
    return any(lines == set(doubt.lines) and not set(roles).isdisjoint(doubt.columns) for doubt in proposed)


def _one_of(roles: tuple[str, ...]) -> str:
    return f"{', '.join(roles[:-1])} or {roles[-1]}"


def _compare_force(draft: Draft, values: dict[str, Array], options: ReadOptions) -> None:
    """Doubt a resultant force that is not the root of the squares of its three components."""
    if not {"F", "Fx", "Fy", "Fz"} <= set(values):
        return
    ratio = _over(values["F"], np.sqrt(values["Fx"] ** 2 + values["Fy"] ** 2 + values["Fz"] ** 2))
    known = ratio[~np.isnan(ratio)]
    if len(known) >= FEWEST and not 0.8 < float(np.median(known)) < 1.25:
        middle = float(np.median(known))
        sentence = f"F is {format_decimal(middle)} times sqrt(Fx^2 + Fy^2 + Fz^2): one of the four is in another unit"
        possible = FORCE_POSSIBLE[0] <= middle <= FORCE_POSSIBLE[1]
        draft.doubts.append(_of_ratio(draft, ("F", "Fx", "Fy", "Fz"), sentence, possible, options))


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
