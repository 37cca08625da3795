"""Menus of the columns of a file: roles and units, the plausible ones first, from the JSON of ``fitmodels look``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from ..core.errors import UsageError
from ..datasets.units import SPELLINGS, canonical, same_dimension
from ..datasets.vocabulary import ROLES

LANGUAGES = ("de", "fr", "es")


@dataclass(frozen=True, slots=True)
class Choice:
    """An entry of a menu."""

    value: str
    label: str
    chosen: bool = False


@dataclass(frozen=True, slots=True)
class ColumnMenus:
    """A column of the file with its menus.

    Attributes
    ----------
    number : int
        From 1.
    header : str
    role : str
        Symbol; empty where it has none.
    roles, units : tuple of Choice
    doubted : bool
    """

    number: int
    header: str
    role: str
    roles: tuple[Choice, ...]
    units: tuple[Choice, ...]
    doubted: bool


@lru_cache(maxsize=128)
def units_of(symbol: str) -> tuple[str, ...]:
    """Units in which a role may be given, its own first.

    >>> units_of("V")
    ('m/min', 'm/s', 'sfm', 'mm/min', 'mm/s', 'in/min')
    """
    own = ROLES[symbol].unit
    return (own, *(unit for unit in SPELLINGS if unit != own and same_dimension(unit, own))) if own else ()


def role_label(symbol: str, language: str = "en") -> str:
    """Symbol and quantity of a role, in a language where the vocabulary has it.

    >>> role_label("V"), role_label("V", "de"), role_label("Fxz", "fr")
    ('V cutting speed', 'V Schnittgeschwindigkeit', 'Fxz thrust force')
    >>> role_label("edge")
    'cutting edge'
    """
    role = ROLES[symbol]
    local = dict(zip(LANGUAGES, role.local, strict=False))
    quantity = local.get(language) or role.quantity
    return quantity if symbol in quantity.split() else f"{symbol} {quantity}"


def language_of(accepted: str) -> str:
    """The first language of an ``Accept-Language`` that the vocabulary has; English otherwise.

    >>> language_of("de-CH,de;q=0.9,en;q=0.8"), language_of("it")
    ('de', 'en')
    """
    for part in accepted.split(","):
        code = part.partition(";")[0].strip()[:2].lower()
        if code in (*LANGUAGES, "en"):
            return code
    return "en"


def column_menus(look: Mapping[str, Any], language: str = "en") -> tuple[ColumnMenus, ...]:
    """Columns of a reading with their menus.

    Parameters
    ----------
    look : mapping
        The JSON of ``fitmodels look``, of a file that was read or refused.
    language : str
    """
    columns = look.get("columns", ())
    taken = {one["role"] for one in columns if one["role"]}
    doubted = {name for doubt in look.get("doubts", ()) for name in doubt["columns"]}
    return tuple(_menus(one, look.get("units", {}), taken, doubted, language) for one in columns)


def _menus(
    column: Mapping[str, Any], units: Mapping[str, str], taken: set[str], doubted: set[str], language: str
) -> ColumnMenus:
    role = column["role"] or ""
    given = canonical(column["unit"]) or ""
    first = [str(column["suggestion"])] if column.get("suggestion") else []
    fitting = [name for name in ROLES if name not in taken and given in units_of(name)]
    every = dict.fromkeys([*([role] if role else []), *first, *fitting, *ROLES])
    roles = [Choice(name, role_label(name, language), name == role) for name in every if name in ROLES]
    if not role:
        roles = [Choice("", "not used", chosen=True), *roles]
    own = (given or units.get(role, "")) if role else ""
    listed = tuple(Choice(unit, unit, unit == own) for unit in units_of(role)) if role else ()
    if listed and not any(one.chosen for one in listed):
        listed = (Choice("", column["unit"] or "as in the file", chosen=True), *listed)
    return ColumnMenus(
        column["number"], column["header"], role, tuple(roles), listed, bool({role, column["header"]} & doubted)
    )


SINGLE = {
    "edge": "--edge", "tool": "--tool", "work": "--work", "criterion": "--criterion", "decimal": "--decimal",
    "by": "--by", "input": "--input", "output": "--output", "rate": "--rate", "sheet": "--sheet",
}  # fmt: skip
OF_ROLE = {"value": "--value", "form": "--form"}


def option_of_change(form: Mapping[str, str], columns: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Option of the command and its value for one change of a menu or field; the value is empty where none is set.

    Parameters
    ----------
    form : mapping of str
        ``set``: role, unit, value, form or one of ``SINGLE``; ``column`` or ``of``, and ``to``.
    columns : sequence of mapping
        Columns of the reading.

    Raises
    ------
    UsageError
        There is no such menu, column, role or unit.

    Examples
    --------
    >>> option_of_change({"set": "unit", "of": "VB", "to": "um"}, [])
    ('--unit', 'VB=um')
    >>> option_of_change({"set": "role", "column": "2", "to": "V"}, [{"number": 2}])
    ('--map', 'V=col2')
    """
    what, to, of = (form.get(name, "").strip() for name in ("set", "to", "of"))
    if any(ord(sign) < 32 for sign in to + of) or len(to + of) > 200:
        raise UsageError("a value has up to 200 characters and no line breaks.")
    if what == "role":
        number = form.get("column", "")
        if to not in ROLES or not any(str(one.get("number")) == number for one in columns):
            raise UsageError(f"there is no role {to!r} or no column {number!r}: reload the page.")
        return "--map", f"{to}=col{number}"
    if what == "unit":
        if of not in ROLES or (to and to not in units_of(of)):
            raise UsageError(f"{of} has no unit {to!r}: reload the page.")
        return "--unit", f"{of}={to}"
    if what in OF_ROLE and of and "=" not in of and not of.startswith("-"):
        return OF_ROLE[what], f"{of}={to}"
    if what in SINGLE:
        if to.startswith("-"):
            raise UsageError(f"{to!r} begins like an option: give another {what}.")
        return SINGLE[what], to
    raise UsageError("a field is empty, or there is no such menu: fill in both fields, or reload the page.")
