"""Conditions of a prediction as they are typed: by symbol or header, or quantities from which a factor follows."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import UsageError
from ..core.suggestions import closest
from .numbers import NUMBER, check_apart, pairs

if TYPE_CHECKING:
    from ..core.predictions import GivenFactor
    from ..parameters import ParameterFile
    from ..parameters.sections.law_parts import Factor

VALUE = re.compile(rf"({NUMBER})\s*+(.*)")
COLUMN = re.compile(  # a line of design.understood
    r"(?P<role>\w+): (?P<quantity>[^,]+), column \d+ '(?P<header>.*)': (?P<low>\S++) to (?P<high>[^\s,]++)"
    r"(?P<unit>[^,]*+)(?:, converted from (?P<written>(?s:.+)))?"
)
UNUSED = ("condition", "other", "time")  # kinds of quantities that may be given to laws without them
AGREE = 0.03  # relative difference of a typed and a computed value at which both are the same setting


@dataclass(frozen=True, slots=True)
class Value:
    """A number from the command line and its unit, "" where none was written."""

    number: float
    unit: str
    text: str


@dataclass(frozen=True, slots=True)
class Column:
    """A column of the fitted file as its parameter file describes it.

    ``written`` is the unit of the file where values were converted, ``constant`` the value, None where it varies.
    """

    role: str
    quantity: str
    header: str
    unit: str
    written: str
    constant: float | None


def typed_conditions(
    pf: "ParameterFile", words: Sequence[str]
) -> tuple[dict[str, Value], list[str], "tuple[GivenFactor, ...]"]:
    """Values by factor of the laws, a sentence for each that was renamed, computed or not used, and those not tested.

    Parameters
    ----------
    pf : ParameterFile
    words : sequence of str
        ``V=120``, ``V=400ft/min``, by symbol, by header of the fitted file (``ap=2``) or by name; quantities that give
        a factor (``n=500 D=80``), and conditions that no law depends on.

    Raises
    ------
    UsageError
        A name is unknown, is given twice, needs a unit, or contradicts the others.
    """
    if not pf.laws:
        raise UsageError("the parameter file has no law; fit one with `fitmodels data.csv`.")
    factors = {f.symbol: f for law in pf.laws.values() for f in law.factors}
    columns = {one.role: one for one in map(_column, pf.design.understood if pf.design else ()) if one is not None}
    given: dict[str, Value] = {}
    remarks: list[str] = []
    for name, value in _numbers(words).items():
        if name in pf.laws and name not in factors:
            raise UsageError(f"{value.text}: {name} is what its law gives, not a condition. {criterion_of(pf, name)}")
        role = _role(name, value, factors, columns.values()) if name not in factors else name
        if role in given:
            raise UsageError(f"{value.text}: {role} is given twice, also as {given[role].text}.")
        given[role] = value
        if role != name:
            _check_unit(value, role, columns.get(role))
        if role != name and role in factors:
            remarks.append(_renamed(value, factors[role], columns.get(role)))
    computed, used = _computed(given, factors, columns)
    left, beyond = _unused(given, {*factors, *used}, factors, columns)
    return given, remarks + computed + left, beyond


def known_level(pf: "ParameterFile", by: str | None) -> None:
    """Refuse a level that no law of the file has."""
    levels = {level: None for law in pf.laws.values() if law.by for level in (law.by.reference, *law.by.shifts)}
    if by is not None and by not in levels:
        there = f"there are {', '.join(levels)}{meant(by, levels)}" if levels else "no law has levels; leave it out"
        raise UsageError(f"--by {by}: {there}.")


def meant(name: str, known: Mapping[str, object]) -> str:
    """A suggestion at the end of an error: the same letters, the role of this name, or the closest name."""
    from ..datasets.vocabulary import roles_named, suggest_role

    roles = [role for role in (*roles_named(name), suggest_role(name)) if role in known]
    found = closest(name, known, 1.0) or next(iter(roles), None) or closest(name, known)
    return f" (did you mean {found}?)" if found else ""


def in_unit(value: Value, factor: "Factor") -> float:
    """The number in the law's unit."""
    from ..datasets.units import canonical, convert, same_dimension, suggest

    if not value.unit or value.unit == factor.unit:
        return value.number
    unit = canonical(value.unit)
    if unit is None:
        raise UsageError(f"{value.text}: unit {value.unit!r} is not listed; {suggest(value.unit)}")
    if not factor.unit:
        raise UsageError(f"{value.text}: {factor.symbol} has no unit in the law; give the number alone.")
    if canonical(factor.unit) is None or not same_dimension(unit, factor.unit):
        raise UsageError(
            f"{value.text}: {factor.symbol} of the law is in {factor.unit}, and {value.unit} measures another "
            f"quantity; give it in {factor.unit}."
        )
    return float(convert(np.array(value.number), unit, factor.unit))


def _numbers(words: Sequence[str]) -> dict[str, Value]:
    out = {}
    for name, text in pairs(list(words), "condition", "V=120 or V=400ft/min").items():
        found = VALUE.fullmatch(text)
        if found is None or found[2].startswith(","):
            raise UsageError(
                f"{name}={text}: give a number with a decimal point, and a unit if it differs: {name}=0.2."
            )
        check_apart(f"{name}={text}", found[2])
        out[name] = Value(float(found[1]), found[2], f"{name}={text}")
    return out


def _column(line: str) -> Column | None:
    """The column that a line of ``design.understood`` describes, None of other lines."""
    found = COLUMN.fullmatch(line)
    if found is None:
        return None
    try:
        low, high = float(found["low"]), float(found["high"])
    except ValueError:
        return None
    constant = low if low == high else None
    unit, written = found["unit"].strip(), found["written"] or ""
    return Column(found["role"], found["quantity"], found["header"], unit, written, constant)


def criterion_of(pf: "ParameterFile", name: str) -> str:
    """Remedy where a response is given as a condition: of the wear of a tool life, its criterion."""
    life = pf.tool_life
    if life is None or life.wear != name:
        return "Leave it out."
    return (
        f"The tool life is that to {name} {life.criterion:g} {life.unit_of_wear}; for another criterion fit the tests "
        "again with --criterion."
    )


def _role(name: str, value: Value, factors: Mapping[str, object], columns: Iterable[Column]) -> str:
    """The role of a name: the header of a column, with or without its unit, or a word of the vocabulary."""
    from ..datasets.headers import parse_header
    from ..datasets.vocabulary import ROLES, roles_named

    headers = {form: one.role for one in columns for form in (one.header, parse_header(one.header).name)}
    roles = (headers[name],) if name in headers else (name,) if name in ROLES else roles_named(name)
    for role in roles:
        if role in factors:
            return role
    if roles and ROLES[roles[0]].kind in UNUSED and ROLES[roles[0]].unit:
        return roles[0]
    raise UsageError(
        f"{value.text}: no law of the file has a factor {name}; they have {', '.join(factors)}{meant(name, factors)}."
    )


def _check_unit(value: Value, role: str, column: Column | None) -> None:
    """Refuse a number without a unit where the column of this name was converted to another unit."""
    if column is not None and column.written and not value.unit:
        raise UsageError(
            f"{value.text}: the fitted file has {column.header!r} in {column.written}, and {role} of the laws is in "
            f"{column.unit}; give the unit, as {value.text}{column.written}."
        )


def _renamed(value: Value, factor: "Factor", column: Column | None) -> str:
    """The factor that a name stands for."""
    of = f", column {column.header!r} of the fitted file" if column is not None else ""
    unit = "" if value.unit or not factor.unit else f" in {factor.unit}"
    return f"{value.text} is taken as {factor.symbol} ({factor.quantity}){unit}{of}."


def _standard(role: str, value: Value) -> float:
    """A typed number in the usual unit of its role."""
    from ..datasets.vocabulary import ROLES
    from ..parameters.sections.law_parts import Factor

    return in_unit(value, Factor(symbol=role, quantity="", unit=ROLES[role].unit, low=0.0, high=0.0))


def _computed(
    given: dict[str, Value], factors: "Mapping[str, Factor]", columns: Mapping[str, Column]
) -> tuple[list[str], set[str]]:
    """Add factors that follow from others (V from n and a diameter), and refuse values that contradict each other.

    Returns
    -------
    tuple of list of str and set of str
        A sentence for each computed factor, and the roles that enter.
    """
    from ..datasets.derived.rules import Known, apply
    from ..datasets.notes import Given
    from ..datasets.vocabulary import FLANK_WEAR, ROLES

    known = {role: Given(role, _standard(role, value), value.text) for role, value in given.items() if role in ROLES}
    for role, column in columns.items():
        if role not in known and role not in factors and role in ("D", "Dc", "z") and column.constant:
            known[role] = Given(role, column.constant, "constant in the fitted file")
    remarks: list[str] = []
    used: set[str] = set()
    for role in factors:
        others = {name: one for name, one in known.items() if name != role and name not in FLANK_WEAR}
        steps = apply(Known({}, others, frozenset(), None, False), {}, targets=(role,))
        if not steps or role not in others:
            continue
        number, formula = others[role].value, steps[-1].equation
        used.update(name for step in steps for name in step.inputs)
        if role in known:
            _consistent(role, known[role].value, number, formula)
            continue
        given[role] = Value(number, ROLES[role].unit, f"{formula} = {number:.4g}{ROLES[role].unit}")
        remarks.append(f"{formula} = {number:.4g} {ROLES[role].unit}, from {_sources(steps[-1].inputs, others)}.")
    return remarks, used


def _sources(inputs: Sequence[str], known: Mapping[str, object]) -> str:
    return " and ".join(str(known[name]) for name in inputs if name in known)


def _consistent(role: str, typed: float, computed: float, formula: str) -> None:
    if abs(typed - computed) > AGREE * abs(computed):
        raise UsageError(
            f"{role}={typed:g} contradicts {formula} = {computed:.4g}: leave out {role}, or what gives it."
        )


def _unused(
    given: dict[str, Value], used: set[str], factors: Mapping[str, object], columns: Mapping[str, Column]
) -> "tuple[list[str], tuple[GivenFactor, ...]]":
    """Remarks on conditions that no law depends on, taken out of ``given``, and those at a value not tested."""
    from ..core.predictions import GivenFactor
    from ..datasets.vocabulary import ROLES

    remarks: list[str] = []
    beyond: list[GivenFactor] = []
    for role in [role for role in given if role not in factors]:
        value = given.pop(role)
        column = columns.get(role)
        tested = column.constant if column is not None else None
        if role in used:
            continue
        if tested is None:
            remarks.append(
                f"{value.text}: no law of the file depends on {role} ({ROLES[role].quantity}); the predictions hold "
                "for the conditions of the tests."
            )
        elif abs((number := _standard(role, value)) - tested) > AGREE * abs(tested):
            side = 1 if number > tested else -1
            beyond.append(GivenFactor(role, ROLES[role].unit, number, tested, tested, side))
            remarks.append(
                f"{value.text}: all tests were cut at {role} {tested:g} {ROLES[role].unit}; no law depends on {role}, "
                "and the predictions are not valid at another value."
            )
    return remarks, tuple(beyond)
