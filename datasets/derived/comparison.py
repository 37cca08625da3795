"""Comparison of quantities that a file holds with those computed from its other columns."""

import re
from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations
from math import isfinite

import numpy as np

from ...core.arrays import Array, Flags, Ints
from ...core.errors import DataError
from ...core.rounding import format_plain
from ..columns import NONE
from ..doubts import Doubt
from ..draft import Draft, correction
from ..plausibility.ranges import candidate_units, plausible
from ..vocabulary import ROLES
from .rules import RULES, Derived, Known, Rule, whole

NAMED = 5  # lines that are named
ODD_ROW = {"P": 3.0, "AW": 1.5}  # factor from the median ratio at which a row contradicts the others; otherwise:
ODD = 1.2
SEVERAL = 0.5  # share of odd rows above which the columns contradict each other as a whole
TWICE = 2.0
LEFT_OUT = ("MRR", "P", "D", "Dc", "z", "n", "fm")  # what a law misses least, first
EVEN = 0.25  # relative spread of a ratio that one factor explains
ALMOST = 0.02  # relative distance of a ratio from a known factor
EXACT = 1.05  # largest ratio at which a rule agrees that shows an exchange of columns
NEARLY_ALL = 0.9  # share of the rows in which it agrees then
OTHER_DIAMETER = 2.5  # factor between the diameters of a workpiece that an even ratio may be due to


def compare(draft: Draft, known: Known) -> None:
    """Add a doubt for each rule whose quantity is measured and does not agree with what the rule computes."""
    compared: set[frozenset[str]] = set()
    for rule in RULES:
        roles = frozenset((rule.role, *rule.inputs))
        if not known.peaks.isdisjoint(roles):
            continue
        if roles in compared or rule.role not in known.data or not all(map(known.has, roles)):
            continue
        if rule.role == "MRR" and known.process not in (None, *rule.processes):
            continue
        if not known.allows(replace(rule, processes=())) and rule.role != "MRR":
            continue
        if rule.role == "t":  # the length may be that of a pass, a workpiece or an overhang
            continue
        compared.add(roles)
        doubt = _judged(draft, known, rule)
        if doubt is not None and not _another_agrees(known, rule):
            draft.doubts.append(doubt)


def judge(draft: Draft, known: Known, found: Iterable[Derived]) -> None:
    """Add a doubt for each computed quantity with unusual values, and refuse one that cannot be in any row.

    Raises
    ------
    DataError
    """
    for rule in (rule for one in found for rule in RULES if rule.equation == one.equation.partition(",")[0]):
        milled = rule.role == "f" and known.process is None  # tables of feed rates are of milling more often than not
        ranges = plausible(rule.role, "milling" if milled else known.process)
        if ranges is None or rule.role not in known.data:
            continue
        values = np.asarray(known.value(rule.role))
        with np.errstate(invalid="ignore"):
            off = (values < ranges.unusual[0]) | (values > ranges.unusual[1])
            impossible = (values < ranges.hard[0]) | (values > ranges.hard[1]) | np.isnan(values)
        if not off.any():
            continue
        low, high = _number(np.min(values[off])), _number(np.max(values[off]))
        span = f"{low if low == high else f'{low} to {high}'} {ROLES[rule.role].unit}"
        usual = f"(usual {_number(ranges.usual[0])} to {_number(ranges.usual[1])})"
        at = np.flatnonzero(off)
        whole = len(at) > SEVERAL * len(values)
        where = "" if whole else f" in {len(at)} of {len(values)} rows ({_lines(draft, at)})"
        units = _units_in_range(draft, known, rule, ranges.usual) if whole else []
        causes = " or ".join(_header(draft, role) for role in rule.inputs if role in known.data)
        cure = f"--unit {units[0][0]}={units[0][1]}" if len(units) == 1 else ""
        others = " or ".join(f"--unit {role}={unit}" for role, unit in units) if len(units) > 1 else ""
        head = f"{rule.equation} is {span}{where}"
        if impossible.all():
            remedy = (
                cure or others or f"correct the unit (--unit), or leave the computation out with {_without(rule.role)}"
            )
            raise DataError(f"{head}, which cannot be {usual}: {causes} is in another unit or wrong; {remedy}.")
        columns = (rule.role, *(role for role in rule.inputs if role in known.data))
        there = "" if whole else " there"
        why = f"{causes} is in another unit or wrong{there}{others and '; usual with ' + others}"
        if (role := _negative(known, rule, off)) and not whole:
            why, cure = f"{_header(draft, role)} is negative there: a reversed sign", correction(draft, at, role, -1.0)
        draft.doubts.append(Doubt(columns, f"{head} {usual}: {why}", cure))


def _negative(known: Known, rule: Rule, off: Flags) -> str:
    """The only input that is negative in just these rows, empty where there is none."""
    values = {role: np.asarray(known.value(role)) for role in rule.inputs if role in known.data}
    found = [role for role, x in values.items() if np.ndim(x) and np.array_equal(x < 0, off)]
    return found[0] if len(found) == 1 else ""


def _units_in_range(draft: Draft, known: Known, rule: Rule, usual: tuple[float, float]) -> list[tuple[str, str]]:
    """Columns and units of the inputs with which most computed values would be usual."""
    values = np.asarray(known.value(rule.role))
    low, high = (float(v) for v in np.nanquantile(values, (0.05, 0.95)))
    return [
        (role, unit)
        for role, unit, change in _changes(draft, known, rule)
        if role != rule.role
        and unit in candidate_units(role)
        and usual[0] <= low * change
        and high * change <= usual[1]
    ]


def ratios(known: Known, rule: Rule) -> Array:
    """Measured over computed value of each row, NaN where either is missing or not above zero."""
    with np.errstate(all="ignore"):
        ratio = np.asarray(known.value(rule.role) / rule.function(*map(known.value, rule.inputs)), dtype=np.float64)
    return np.where(np.isfinite(ratio) & (ratio > 0), ratio, np.nan)


def _another_agrees(known: Known, rule: Rule) -> bool:
    """Whether another rule of a removal rate fits, where the process is not known."""
    if rule.role != "MRR" or known.process is not None:
        return False
    others = (other for other in RULES if other.role == "MRR" and all(map(known.has, other.inputs)))
    return any(_agrees(float(np.nanmedian(ratios(known, other))), other) for other in others)


def _agrees(ratio: float, rule: Rule) -> bool:
    low, high = rule.agree
    return low <= ratio <= high


def _judged(draft: Draft, known: Known, rule: Rule) -> Doubt | None:
    """The doubt about a rule; None where measured and computed values agree."""
    ratio = ratios(known, rule)
    seen = ratio[~np.isnan(ratio)]
    if not seen.size:
        return None
    middle = float(np.median(seen))
    low, high = rule.agree
    limit = ODD_ROW.get(rule.role, ODD)
    with np.errstate(invalid="ignore"):
        off = (np.abs(np.log(ratio / middle)) > np.log(limit)) & ~np.isnan(ratio)
    if _agrees(middle, rule):
        if not off.any():
            return None
        return _odd_rows(draft, known, rule, ratio, off)
    spread = [float(v) for v in np.quantile(seen, (0.05, 0.95))]
    if rule.role == "MRR" and known.process is None and spread[1] > spread[0] * (1 + EVEN):
        return None  # of a process with another formula
    constant = spread[1] <= spread[0] * (1 + ALMOST)
    shown = _number(middle) if constant else f"{_number(spread[0])} to {_number(spread[1])}, median {_number(middle)}"
    even = spread[1] <= spread[0] * (1 + EVEN)
    cause, remedy = _cause(draft, known, rule, middle, even)
    another = high > EXACT or (even and 1 / OTHER_DIAMETER < middle < OTHER_DIAMETER)
    swap = "" if another else _exchange(draft, known, rule)
    if swap:
        names = " and ".join(re.findall(r'"(\w+)=col', swap))
        words, units = f"{names} may be exchanged, with which the rule would hold", "would agree" in cause
        cause, remedy = (f"{cause}, or {words}: {swap}", "") if units else (words, swap)
    columns = tuple(role for role in (rule.role, *rule.inputs) if role in known.data)
    return Doubt(
        columns,
        f"{_header(draft, rule.role)} does not agree with {rule.formula} from {_others(draft, known, rule)}: "
        f"the ratio is {shown}{' in all rows' if constant else ''} (usual {low:g} to {high:g}); {cause}",
        remedy,
        unsettled=bool(swap),
    )


def _exchange(draft: Draft, known: Known, rule: Rule) -> str:
    """Options that exchange the two columns with which a rule would hold; empty where there are none."""
    uses = {use.role: use for use in draft.uses if use.role in (rule.role, *rule.inputs) and not use.converted}
    found = []
    for a, b in combinations(uses, 2):
        then = ratios(replace(known, data={**known.data, a: known.data[b], b: known.data[a]}), rule)
        if np.mean((then >= rule.agree[0]) & (then <= rule.agree[1])) > NEARLY_ALL:
            found.append((a, b))
    if len(found) != 1:
        return ""
    ((a, b),) = found
    units = [f'--unit "{one}={ROLES[one].unit}"' for one, other in ((a, b), (b, a)) if uses[other].unit]
    return " ".join([f'--map "{a}=col{uses[b].number}"', f'--map "{b}=col{uses[a].number}"', *units])


def _odd_rows(draft: Draft, known: Known, rule: Rule, ratio: Array, off: Flags) -> Doubt:
    """Doubt about single rows that contradict a rule with which the others agree."""
    at = np.flatnonzero(off)
    rows = "1 row" if len(at) == 1 else f"{len(at)} rows"
    values = " to ".join(dict.fromkeys(_number(v) for v in (np.min(ratio[at]), np.max(ratio[at]))))
    which = "all other rows agree" if len(at) < SEVERAL * len(ratio) else "the other rows agree"
    return Doubt(
        tuple(role for role in (rule.role, *rule.inputs) if role in known.data),
        f"{_header(draft, rule.role)} is {values} times {rule.formula} from {_others(draft, known, rule)} in {rows} "
        f"({_lines(draft, at)}), and {which}; correct these cells",
    )


def _lines(draft: Draft, at: Ints) -> str:
    shown = ", ".join(str(draft.lines[i]) for i in at[:NAMED]) + (", ..." if len(at) > NAMED else "")
    return f"line{'s' * (len(at) > 1)} {shown}"


def _cause(draft: Draft, known: Known, rule: Rule, ratio: float, even: bool) -> tuple[str, str]:
    """The probable cause of a ratio, and the option that would correct it."""
    special = _special(known, rule, ratio) or _per_tooth(draft, known, rule, ratio)
    if special:
        return special
    units = list(_units_that_explain(draft, known, rule, ratio)) if even else []
    if len(units) == 1:
        ((role, unit),) = units
        return f"{_header(draft, role)} in {unit} would agree", f"--unit {role}={unit}"
    if units:
        return f"one of these would agree: {', '.join(f'--unit {role}={unit}' for role, unit in units[:NAMED])}", ""
    roles = (rule.role, *rule.inputs)
    leave = next((role for role in LEFT_OUT if role in roles and role in known.data), roles[-1])
    out = _without(leave)
    if {"D", "Dc"} & set(rule.inputs):
        what = next(role for role in rule.inputs if role in ("D", "Dc"))
        if abs(ratio * TWICE - 1) < ALMOST or abs(ratio / TWICE - 1) < ALMOST:
            return "a radius is taken as a diameter, or the reverse", out
        return f"{what} is not the diameter at the cut, or one of the columns is wrong", out
    return "one of the columns is wrong, or has another meaning", out


def _without(role: str) -> str:
    return f"--map {role}={NONE}"


def _special(known: Known, rule: Rule, ratio: float) -> tuple[str, str] | None:
    """A feed per revolution in the column of the feed per tooth, or the reverse."""
    if "z" not in rule.inputs:
        return None
    z = float(np.nanmedian(known.value("z")))
    if z > 1 and min(abs(ratio / z - 1), abs(ratio * z - 1)) < ALMOST:
        return f"the ratio is z: {rule.role} is probably another feed, per revolution or per tooth", _without(rule.role)
    return None


def _per_tooth(draft: Draft, known: Known, rule: Rule, ratio: float) -> tuple[str, str] | None:
    """A feed that is 1/z of that per revolution, with the option that reads it as the feed per tooth."""
    if rule.role != "f" or "z" in rule.inputs or "fz" in known.data or not (known.has("z") and whole(known.value("z"))):
        return None
    z = float(np.nanmedian(known.value("z")))
    use = next((use for use in draft.uses if use.role == "f"), None)
    if use is None or not z > 1 or abs(ratio * z - 1) >= ALMOST:
        return None
    unit = " --unit fz=mm/tooth" if use.unit and use.unit != "mm" else ""
    words = f"the ratio is 1/z, z {z:g}: f is probably the feed per tooth"
    return words, f'--map "fz={use.name}"{unit}' if " " in use.name else f"--map fz={use.name}{unit}"


def _units_that_explain(draft: Draft, known: Known, rule: Rule, ratio: float) -> Iterable[tuple[str, str]]:
    """Columns and units with which the ratio would be usual; columns without a unit in the file first."""
    low, high = np.sqrt(rule.agree) if rule.agree[1] > TWICE else rule.agree
    for role, unit, change in _changes(draft, known, rule):
        then = ratio * change if role == rule.role else ratio / change
        if isfinite(then) and low <= then <= high:
            yield role, unit


def _changes(draft: Draft, known: Known, rule: Rule) -> Iterable[tuple[str, str, float]]:
    """Columns of a rule, other units, and the factor by which the unit changes the measured or the computed value."""
    from ..units import SPELLINGS, convert, same_dimension

    written = {use.role: use.unit for use in draft.uses if use.role}
    roles = [role for role in (rule.role, *rule.inputs) if role in written and ROLES[role].unit != "1"]
    middle = {role: float(np.nanmedian(known.value(role))) for role in rule.inputs}
    for role in sorted(roles, key=lambda role: bool(written[role])):
        for unit in SPELLINGS:
            if unit == ROLES[role].unit or not same_dimension(unit, ROLES[role].unit):
                continue
            factor = float(convert(np.ones(1), unit, written[role] or ROLES[role].unit)[0])
            if role == rule.role:
                yield role, unit, factor
                continue
            moved = {**middle, role: middle[role] * factor}
            now, then = (rule.function(*(at[name] for name in rule.inputs)) for at in (middle, moved))
            yield role, unit, float(then / now)


def _header(draft: Draft, role: str) -> str:
    header = next((use.name for use in draft.uses if use.role == role), "")
    return f"{role} ({header!r})" if header and header != role else role


def _others(draft: Draft, known: Known, rule: Rule) -> str:
    words = [_header(draft, role) if role in known.data else str(known.given[role]) for role in rule.inputs]
    return " and ".join(words) if len(words) < 3 else ", ".join(words)


def _number(value: float) -> str:
    return format_plain(float(value), 3)
