"""Roles and units of the columns of a table of tests; a column that does not fit its role is an error."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Array, Texts
from ..core.display import Displayable
from ..core.errors import DataError, UsageError
from ..core.suggestions import closest, did_you_mean
from .headers import logarithm_of, parse_header, unrecognised
from .tables import STOPPED, Column, is_number, rows_to_leave_out
from .tables.numerals import fraction
from .units import canonical, convert, same_dimension, suggest
from .vocabulary import (
    ROLES,
    Role,
    role_of,
    role_of_mean,
    role_of_peak,
    role_of_unit,
    suggest_role,
    understood_unit,
)

# Least and greatest values of roles whose names have other meanings, in any unit: mm or in, and degrees
SIZES = {"re": (1e-3, 50.0), "kappa": (5.0, 180.0), "lead": (-60.0, 90.0), "sigma": (60.0, 180.0)}
LARGEST = 1e30  # in any unit of the field; its reciprocal is the smallest
_FACTOR_LABEL = re.compile(r"[A-K]\s*[:.)=-]\s*(?P<name>\w.*)")  # A: Speed, B - Feed, in plans
_BOUND = re.compile(r"\s*[<>≤≥]")
_DATE = re.compile(  # 2024-02-01, 1-Feb, 01. Feb, 01.02.2024, Feb-01
    r"\d{4}-\d\d-\d\d|\d{1,2}(?:[.-]\s?|\s)[A-Za-zäéû]{3,4}\.?(?:[.\s-]\d{2,4})?|\d{1,2}([./])\d{1,2}\1\d{2,4}|"
    r"[A-Za-zäéû]{3,4}\.?[\s-]\d{2,4}"
)
_WITH_UNIT = re.compile(r"[+-]?\d[\d.,]*\s*(?:[^\W\d_]|[%°\"'])\D*")
NONE = "none"  # --map P=none: no column of this file is the power
DECIDED = ("edge", "tool", "run")  # roles that several columns may claim: `edges` decides by their content

Values = Array | Texts


@dataclass(frozen=True, slots=True, repr=False)
class ColumnUse(Displayable):
    """Use of one column of the file.

    Attributes
    ----------
    number : int
        Position in the file, from 1.
    header, name : str
        The header as written, and without its unit.
    role : str or None
        Symbol of the role it was given; None: not used.
    unit : str
        Unit as understood; empty where none was written.
    converted : bool
        Whether the numbers were converted to the unit of the role.
    suggestion : str or None
        Role whose name is similar to an unused header.
    """

    number: int
    header: str
    name: str
    role: str | None
    unit: str
    converted: bool
    suggestion: str | None


@dataclass(frozen=True, slots=True)
class _Claim:
    column: Column
    name: str
    unit_text: str
    role: str | None
    mapped: bool  # by --map, not by the header


_LARGEST = re.compile(r"max", re.IGNORECASE)  # VBmax, VB max., VBBmax, maximum flank wear


def assign(
    columns: tuple[Column, ...], mapping: Mapping[str, str], units: Mapping[str, str]
) -> tuple[tuple[ColumnUse, ...], dict[str, Values], tuple[str, ...]]:
    """Uses of the columns, values by role in the role's unit, and what was assumed about units."""
    _known_roles((*mapping, *units))
    claims = _claims(columns, mapping, units)
    _refuse_two_tables(claims)
    chosen = _one_each(claims)
    uses: list[ColumnUse] = []
    data: dict[str, Values] = {}
    assumed: list[str] = []
    _only_readable([claim for claim in claims if claim.role is not None and chosen.get(claim.role) is claim])
    for claim in claims:
        role = ROLES[claim.role] if claim.role is not None and chosen.get(claim.role) is claim else None
        unit, converted = "", False
        if role is not None:
            data[role.symbol], unit, converted = _values(claim, role)
            if unit and unit != canonical(claim.unit_text):
                assumed.append(f"{role.symbol}: {claim.unit_text} is taken as {unit}")
            if not claim.mapped and _of_peak(claim) == role.symbol:
                assumed.append(f"{role.symbol}: {claim.name!r} is read; it is a peak or effective value, not a mean")
            if role.symbol == "VB" and _LARGEST.search(claim.name):
                assumed.append(
                    f"VB: {claim.name!r} is the largest width of the land: --criterion 0.6 (ISO 3685, where 0.3 mm is "
                    "for the mean width)"
                )
        column, near = claim.column, suggest_role(claim.name) if role is None else None
        symbol = role.symbol if role is not None else None
        uses.append(ColumnUse(column.number, column.name, claim.name, symbol, unit, converted, near))
    if not data:
        raise DataError(unrecognised(columns))
    return tuple(uses), data, tuple(assumed)


def recognised(columns: tuple[Column, ...]) -> tuple[tuple[str | None, str], ...]:
    """Role of each column by its header alone, None where it has none, and the text of its unit."""
    return tuple((claim.role, claim.unit_text) for claim in _claims(columns, {}, {}))


def _known_roles(symbols: tuple[str, ...]) -> None:
    for symbol in symbols:
        if symbol not in ROLES:
            hint = f"did you mean {near}? " if (near := closest(symbol, ROLES)) else ""
            raise UsageError(f"{symbol!r} is no role of a column; {hint}The roles are {', '.join(ROLES)}.")


def _claims(columns: tuple[Column, ...], mapping: Mapping[str, str], units: Mapping[str, str]) -> list[_Claim]:
    wanted = {symbol: name for symbol, name in mapping.items() if name.strip().lower() != NONE}
    assigned = {_find(columns, name).number: symbol for symbol, name in wanted.items()}
    if len(assigned) < len(wanted):
        raise UsageError("--map gives one column to two roles; each role needs a column of its own.")
    claims = []
    for column in columns:
        header = parse_header(column.name)
        text = column.unit_cell or header.unit_text
        role = assigned.get(column.number) or role_of(header.name, canonical(text) if text else None)
        if role is not None and role in mapping and role not in wanted:
            role = None
        if role is not None and column.number not in assigned and not _may_be(role, column):
            role = None
        if role is not None and role in units:
            text = units[role]
        claims.append(_Claim(column, header.name, text, role, column.number in assigned))
    claims = _named_otherwise(claims, mapping, units)
    missing = [symbol for symbol in units if all(claim.role != symbol for claim in claims)]
    if missing:
        raise UsageError(f"--unit {missing[0]}={units[missing[0]]}: no column has the role {missing[0]}.")
    return claims


def _may_be(role: str, column: Column) -> bool:
    """Whether the cells allow a role whose names have other meanings: z a coordinate, Re a strength, nose a remark."""
    if role in ("VBC", "VBN"):
        return column.is_numeric or bool(column.bad)
    if role not in ("z", "Dc", "lf", "lc", "theta", *SIZES):
        return True
    if not column.is_numeric or column.bad:
        return False
    values = np.asarray(column.values, dtype=float)
    if role in SIZES:
        return not np.any((values < SIZES[role][0]) | (values > SIZES[role][1]))
    return role != "z" or not np.any((values < 1) | (values % 1 > 0))


def _named_otherwise(claims: list[_Claim], mapping: Mapping[str, str], units: Mapping[str, str]) -> list[_Claim]:
    """The claims, with free roles for headers that are a unit, a mean (before a maximum), or a name and a remark."""
    means = {role_of_mean(claim.name, None) for claim in claims if claim.role is None} - mapping.keys()
    claims = [replace(one, role=None) if one.role in means and _LARGEST.search(one.name) else one for one in claims]
    named = {claim.role for claim in claims} | set(mapping)
    found = [_otherwise(claim) if claim.role is None else (None, claim.unit_text) for claim in claims]
    done = []
    peaks = [_of_peak(claim) if claim.role is None else None for claim in claims]
    taken = named | {role for role, _ in found}
    for claim, (role, text), peak in zip(claims, found, peaks, strict=True):
        if peak is not None and peak not in taken and peaks.count(peak) == 1:
            done.append(replace(claim, unit_text=units.get(peak, claim.unit_text), role=peak))
        elif role is not None and role not in named and [one for one, _ in found].count(role) == 1:
            done.append(replace(claim, unit_text=units.get(role, text), role=role))
        else:
            done.append(claim)
    return done


def _otherwise(claim: _Claim) -> tuple[str | None, str]:
    """Role and unit of a header that is no name: a mean, a name after a letter of a plan or before a comma, a unit."""
    text = claim.unit_text
    unit = canonical(text) if text else None
    if (role := role_of_mean(claim.name, unit)) is not None:
        return role, text
    if label := _FACTOR_LABEL.fullmatch(claim.name):
        return role_of(label["name"], unit), text
    name, comma, _ = claim.name.partition(",")
    if comma:
        return role_of(name, unit), text
    return role_of_unit(claim.name), text or claim.name


def _of_peak(claim: _Claim) -> str | None:
    return role_of_peak(claim.name, canonical(claim.unit_text) if claim.unit_text else None)


def check_edge_option(columns: tuple[Column, ...], name: str | None) -> None:
    """Refuse a column of edges that is not there, in the words of --edge."""
    if name is not None and name.strip().lower() != NONE:
        _find(columns, name, "--edge")


def _find(columns: tuple[Column, ...], name: str, option: str = "--map") -> Column:
    """The column of this header, this name without unit, or ``col7``; the header counts first."""
    wanted = name.strip()
    for test in (
        lambda c: c.name == wanted,
        lambda c: parse_header(c.name).name == wanted,
        lambda c: wanted == f"col{c.number}",
    ):
        found = [column for column in columns if test(column)]
        if len(found) == 1:
            return found[0]
        if found:
            places = " or ".join(f"col{c.number}" for c in found)
            raise UsageError(f"column {wanted!r} occurs {len(found)} times in the file: give {places}.")
    hint = did_you_mean(wanted, [c.name for c in columns], names="The columns are ")
    raise UsageError(f"{option} names a column {wanted!r} that the file does not have. {hint}")


def _refuse_two_tables(claims: list[_Claim]) -> None:
    """Refuse columns of two tables that stand side by side: their rows are of different tests."""
    start = _second_table(claims)
    if not start or len({number < start for number in _used(claims)}) < 2:
        return
    first = [claim for claim in claims if claim.column.name and claim.column.number < start]
    second = [claim for claim in claims if claim.column.name][len(first) :]
    raise DataError(
        f"columns {first[0].column.number} to {first[-1].column.number} and columns {second[0].column.number} to "
        f"{second[-1].column.number} are two tables side by side: the same names stand in both above other values. "
        f"Save each as a file or sheet of its own, or read one of them: {_alone(first, second)} or "
        f"{_alone(second, first)}."
    )


def _used(claims: list[_Claim]) -> list[int]:
    """Numbers of the columns with a role, of a role that --map names those that it names."""
    mapped = {claim.role for claim in claims if claim.mapped}
    return [claim.column.number for claim in claims if claim.role and (claim.mapped or claim.role not in mapped)]


def _second_table(claims: list[_Claim]) -> int:
    """Number of the column where a second table begins: names of settings stand again there; 0 without one."""
    first: dict[str, _Claim] = {}
    again: dict[str, tuple[Column, Column]] = {}
    for claim in filter(_is_setting, claims):
        before = first.setdefault(claim.column.name, claim)
        if before is not claim:
            again[claim.column.name] = before.column, claim.column
    if len(again) < 2 or all(np.array_equal(one.labels(), other.labels()) for one, other in again.values()):
        return 0
    numbers = np.array([(one.number, other.number) for one, other in again.values()])
    start = int(numbers[:, 1].min())
    return start if numbers[:, 0].max() < start else 0


def _is_setting(claim: _Claim) -> bool:
    role = role_of(claim.name, canonical(claim.unit_text) if claim.unit_text else None)
    return role is not None and ROLES[role].kind == "condition"


def _alone(claims: list[_Claim], others: list[_Claim]) -> str:
    """Options that read the columns of one of two tables."""
    own = {claim.role: claim.column.number for claim in claims if claim.role}
    found = {claim.role: claim.column.number for claim in others if claim.role}
    given = [f"--map {role}=col{number}" for role, number in own.items() if role in found]
    return " ".join([*given, *(f"--map {role}={NONE}" for role in found if role not in own)])


def _one_each(claims: list[_Claim]) -> dict[str, _Claim]:
    """The column of each role: one assigned by --map takes precedence over one recognised by its header."""
    chosen: dict[str, _Claim] = {}
    for claim in sorted(claims, key=lambda c: not c.mapped):
        if claim.role is None:
            continue
        first = chosen.setdefault(claim.role, claim)
        if first is not claim and not first.mapped and claim.role not in DECIDED:
            a, b = first.column, claim.column
            raise DataError(
                f"columns {a.number} ({a.name!r}) and {b.number} ({b.name!r}) both read as {ROLES[claim.role].quantity}"
                f" {claim.role}: choose one with --map {claim.role}=col{a.number} or --map {claim.role}=col{b.number}."
            )
    return chosen


def _values(claim: _Claim, role: Role) -> tuple[Values, str, bool]:
    """Values in the unit of the role, the unit that was written, and whether they were converted."""
    column = claim.column
    if role.kind == "label":
        return column.labels(), "", False
    if claim.mapped and logarithm_of(column.name) and role.kind != "time":  # "log time" is that of a log
        raise DataError(f"column {column.name!r} ({role.symbol}): write the values, not their logarithms.")
    _only_numbers(column, role)
    _only_measurable(column, role)
    if not claim.unit_text:
        return column.values, "", False
    unit = understood_unit(role.symbol, claim.unit_text)
    if unit == "1":  # a dash in the units row, or coded levels
        return column.values, "", False
    if unit is None:
        raise DataError(
            f"column {column.name!r}: unit {claim.unit_text!r} is not in the table of units; {suggest(claim.unit_text)}"
            f" If the numbers are in {role.unit}, give --unit {role.symbol}={role.unit}."
        )
    if not same_dimension(unit, role.unit):
        raise DataError(
            f"column {column.name!r} reads as {role.quantity} {role.symbol} (in {role.unit}), but its unit "
            f"is {unit}: correct the unit with --unit {role.symbol}={role.unit}, give the role to another "
            f"column with --map {role.symbol}=..., or to none with --map {role.symbol}={NONE}."
        )
    if unit == role.unit:
        return column.values, unit, False
    return convert(np.asarray(column.values, dtype=float), unit, role.unit), unit, True


def _unreadable(column: Column, role: Role) -> str:
    name = f"column {column.name!r} ({role.quantity} {role.symbol})"
    remedy = _remedy(column.bad[0][1], role) or "Write a number, or leave the cell empty."
    return f"{name} contains text instead of numbers: {column.bad_cells()}. {remedy}"


def _only_readable(claims: list[_Claim]) -> None:
    """Refuse columns of numbers with cells that are none, all at once, and name the option that leaves them out."""
    roles = [(claim.column, ROLES[claim.role]) for claim in claims if claim.role]
    bad = [(column, role) for column, role in roles if column.bad and role.kind != "label"]
    if not bad:
        return
    words = [_unreadable(column, role) for column, role in bad]
    raise DataError(" ".join([*words, *rows_to_leave_out([column for column, _ in bad])]))


def _only_numbers(column: Column, role: Role) -> None:
    if not column.is_numeric:
        shown = next((str(v) for v in column.values if v != ""), "")
        remedy = _remedy(shown, role)
        raise DataError(
            f"column {column.name!r} reads as {role.quantity} {role.symbol} but holds text, for instance {shown!r}. "
            + (f"{remedy} Or give" if remedy else "Give")
            + f" the role to another column with --map {role.symbol}=..., or to none with --map {role.symbol}={NONE}."
        )


def _remedy(text: str, role: Role) -> str:
    """Remedy for a cell that is not a number, where its text shows one."""
    if is_number(text):
        return "It has another decimal mark than the rest of the file: use one throughout."
    if role.symbol == "T" and (STOPPED.search(text) or text.strip().endswith("+") or _BOUND.match(text)):
        return (
            "Write the time after which a test was stopped, with a plus (60+), and at least one life that ended: "
            "run-outs alone give no law."
        )
    if _BOUND.match(text):
        return "Write a number, or leave the cell empty: a value known only by its bound cannot be fitted."
    if role.kind != "time" and _DATE.fullmatch(text):
        return "A spreadsheet has turned a number into a date (1.2 into 1 February): type the number again."
    if fraction(text) is not None:
        return f"Write {fraction(text):g} for {text.strip()}, or name the unit inch in the header: {role.symbol} [in]."
    if _WITH_UNIT.fullmatch(text) or "±" in text:
        return f"Write the number alone in the cell, and its unit in the header, as {role.symbol} [{role.unit}]."
    if role.kind == "time":
        return (
            f"Write it as a number of {role.unit}, counted from the start of the edge, not as a date or a clock time."
        )
    return ""


def _only_measurable(column: Column, role: Role) -> None:
    """Refuse magnitudes that no gauge shows: their powers would overflow."""
    size = np.abs(column.values)
    odd = np.flatnonzero((size > LARGEST) | ((size < 1 / LARGEST) & (size > 0)))
    if odd.size:
        value = column.values[odd[0]]
        raise DataError(
            f"column {column.name!r} ({role.quantity} {role.symbol}), row {odd[0] + 1} of the data: "
            f"{value:g} is not a plausible measurement, its magnitude lies outside {1 / LARGEST:g} to {LARGEST:g}. "
            "Correct it, or leave the cell empty."
        )
