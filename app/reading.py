"""Menus of the columns of a file: roles and units, the plausible ones first, from the JSON of ``fitmodels look``."""

import math
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from markupsafe import Markup, escape

from ..core.errors import UsageError
from ..datasets.corrections import parse_correction
from ..datasets.edges.columns import names_edge
from ..datasets.options import OPTIONS
from ..datasets.units import SPELLINGS, canonical, same_dimension
from ..datasets.vocabulary import ROLES
from .cells import MOST, Cells, lines_in
from .command_words import with_points
from .messages import FIELDS
from .options import pairs

LABELS = {option.removeprefix("--"): label for option, (label, _) in FIELDS.items()}
UNNAMED = ("several", "unnamed-tool", "unnamed-work")
LANGUAGES = ("de", "fr", "es")


@dataclass(frozen=True, slots=True)
class Choice:
    """An entry of a menu; with its language where that is not English."""

    value: str
    label: str
    chosen: bool = False
    language: str = ""


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


def local_quantity(symbol: str, language: str) -> str:
    """Quantity of a role in another language than English; empty where the vocabulary has none.

    >>> local_quantity("V", "de"), local_quantity("Fxz", "fr"), local_quantity("V", "en")
    ('Schnittgeschwindigkeit', '', '')
    """
    local = ROLES[symbol].local if symbol in ROLES else ()
    return dict(zip(LANGUAGES, local, strict=False)).get(language) or ""


def role_label(symbol: str, language: str = "en") -> str:
    """Symbol and quantity of a role, in a language where the vocabulary has it.

    >>> role_label("V"), role_label("V", "de"), role_label("Fxz", "fr")
    ('V cutting speed', 'V Schnittgeschwindigkeit', 'Fxz thrust force')
    >>> role_label("edge")
    'cutting edge'
    """
    quantity = local_quantity(symbol, language) or ROLES[symbol].quantity
    return quantity if symbol in quantity.split() else f"{symbol} {quantity}"


def localised(label: str, symbol: str, language: str) -> Markup:
    """A label with the quantity of its symbol in another language, marked as such, where the vocabulary has it.

    >>> localised("cutting speed today, m/min", "V", "de")
    Markup('<span lang="de">Schnittgeschwindigkeit</span> today, m/min')
    """
    local = local_quantity(symbol, language)
    if not local or ROLES[symbol].quantity not in label:
        return escape(label)
    before, _, after = label.partition(ROLES[symbol].quantity)
    return escape(before) + Markup('<span lang="{}">{}</span>').format(language, local) + escape(after)


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
    roles = [
        Choice(name, role_label(name, language), name == role, language if local_quantity(name, language) else "")
        for name in every
        if name in ROLES
    ]
    roles = [*roles, Choice("", "not used")] if role else [Choice("", "not used", chosen=True), *roles]
    own = (given or units.get(role, "")) if role else ""
    listed = tuple(Choice(unit, micro(unit), unit == own) for unit in units_of(role)) if role else ()
    if listed and not any(one.chosen for one in listed):
        listed = (Choice("", column["unit"] or "as in the file", chosen=True), *listed)
    return ColumnMenus(
        column["number"], column["header"], role, tuple(roles), listed, bool({role, column["header"]} & doubted)
    )


def micro(text: str) -> str:
    """A text or unit with micrometres as the page writes them.

    >>> micro("um"), micro("mm/rev")
    ('µm', 'mm/rev')
    """
    return re.sub(r"\bum\b", "µm", text)


SINGLE = {
    name: f"--{name}"
    for name in (
        "edge", "tool", "work", "criterion", "gauge-sd", "by", "process", "decimal", "delimiter", "sheet", "hidden",
        "correct", "input", "output", "reference", "time", "rate", "sample-time", "resample",
    )
}  # fmt: skip
TEXTS = ("--correct", "--value", "--range", "--edge", "--decimal", "--delimiter")  # the reading refuses a wrong one
OF_ROLE = {"value": "--value", "range": "--range", "form": "--form"}


@dataclass(frozen=True, slots=True)
class Field:
    """A field that says what a file does not: its name, label, example, what it holds, and the choices of a menu."""

    name: str
    label: str
    hint: str = ""
    value: str = ""
    choices: tuple[str, ...] = ()


def fields_of(look: Mapping[str, Any], options: Sequence[str] = ()) -> tuple[Field, ...]:
    """Fields of a file of tests that set what the menus of its columns do not."""
    given = {name: value for name, value in pairs(options) if OPTIONS[name].once in ("once", "edge")}
    tool, work = ("" if (name := str(look.get(key) or "")) in UNNAMED else name for key in ("tool", "work"))
    return (
        Field("tool", LABELS["tool"], "e.g. GC4035", tool),
        Field("work", LABELS["work"], "e.g. 42CrMo4", work),
        Field("edge", f"{LABELS['edge']} (none: do not infer)", "e.g. Test", given.get("--edge", "")),
        Field("criterion", f"{LABELS['criterion']}, mm", "empty: 0.3", given.get("--criterion", "")),
        Field("gauge-sd", f"{LABELS['gauge-sd']}, mm", "e.g. 0.005", given.get("--gauge-sd", "")),
        Field("by", LABELS["by"], "e.g. coolant", given.get("--by", "")),
        Field("correct", f"{LABELS['correct']} a quantity of lines or edges", "e.g. lines 24:VB/10"),
        Field("process", LABELS["process"], choices=("turning", "milling", "drilling", "grinding")),
        Field("decimal", LABELS["decimal"], choices=("point", "comma")),
        Field("delimiter", LABELS["delimiter"], "e.g. ;"),
    )


def sheets_of(look: Mapping[str, Any]) -> tuple[Choice, ...]:
    """The menu of the sheets of a workbook with several; those that a refusal names where none was chosen.

    >>> [one.value for one in sheets_of({"refused": "several sheets: give one of --sheet 'A 1' (3 rows), --sheet B"})]
    ['', 'A 1', 'B']
    """
    read, others = look.get("sheets") or (), look.get("other_sheets") or ()
    if not read and look.get("refused"):
        found = re.findall(r"--sheet (?:'([^']+)'|([^\s'(]+))", look["refused"])
        others = [(quoted or plain).rstrip(".,;") for quoted, plain in found]
    if len(read) + len(others) < 2:
        return ()
    several = [Choice("", "all, joined" if read else "choose one", chosen=True)] if len(read) != 1 else []
    return (*several, *(Choice(one, one, chosen=len(read) == 1 and one in read) for one in (*read, *others)))


def offered(look: Mapping[str, Any]) -> list[str]:
    """Options of the commands that a refused reading names, without those that hold a malformed correction.

    >>> offered({"commands": [{"command": f"fitmodels a.csv {one}"} for one in ("--correct 31", "--unit VB=um")]})
    ['--unit VB=um']
    """
    every = [shlex.split(one["command"])[2:] for one in look.get("commands") or ()]
    return [shlex.join(words) for words in every if words and _is_well_formed(words)]


def _is_well_formed(options: Sequence[str]) -> bool:
    """Whether each correction among options is one."""
    try:
        for name, value in pairs(options):
            if name == "--correct":
                parse_correction(value)
    except UsageError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class NamedRow:
    """A row that a doubt or a correction names: its line, cells, and whether it is in doubt."""

    line: int
    cells: tuple[str, ...]
    doubted: bool


def named_rows(look: Mapping[str, Any], cells: Cells | None, options: Sequence[str]) -> list[NamedRow]:
    """Rows of doubts and corrections: those in doubt that are not among the first ones, and every corrected one."""
    if cells is None:
        return []
    corrections = [value for name, value in pairs(options) if name == "--correct"]
    doubted = dict.fromkeys(line for doubt in look.get("doubts") or () for line in cells.lines_of_doubt(doubt))
    corrected = dict.fromkeys(line for text in corrections for line in lines_in(text.partition(":")[0]))
    wanted = {
        line: line in doubted for line in (*doubted, *corrected) if line in corrected or line not in look["lines"]
    }
    found = (NamedRow(line, tuple(cells.row_after(corrections, line)), of) for line, of in sorted(wanted.items()))
    return [row for row in found if row.cells][:MOST]


AS_ASKED = ("left out as asked", "corrected as asked")


def assumptions(look: Mapping[str, Any], options: Sequence[str]) -> list[str]:
    """Assumptions, without those that were asked for; numbers of tests that were taken as edges among them."""
    found = [words for words in look.get("assumed", ()) if not words.startswith(AS_ASKED)]
    for one in look.get("columns", ()):
        is_asked = "--edge" in options or any(word.startswith("edge=") for word in options)
        is_named = names_edge(one["header"])
        if one["role"] == "edge" and not (is_asked or is_named) and not any("edges" in words for words in found):
            found.append(f"column {one['header']!r} numbers the cutting edges: rows of equal number are of one edge")
    return found


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
        column = next((one for one in columns if str(one.get("number")) == number), None)
        if column is None or (to or column.get("role")) not in ROLES:
            raise UsageError(f"there is no role {to!r} or no column {number!r}: reload the page.")
        return "--map", f"{to}=col{number}" if to else f"{column['role']}=none"
    if what == "unit":
        if of not in ROLES or (to and to not in units_of(of)):
            raise UsageError(f"{of} has no unit {to!r}: reload the page.")
        return "--unit", f"{of}={to}"
    if what in OF_ROLE and of and "=" not in of and not of.startswith("-"):
        return OF_ROLE[what], f"{of}={to if what == 'form' else with_points(to, of)}"
    if what in SINGLE:
        if what == "correct" and to:
            parse_correction(to)
        if what in ("criterion", "gauge-sd"):
            to = _length(to, LABELS[what])
        if to.startswith("-"):
            raise UsageError(f"{to!r} begins like an option: give another {what}.")
        return SINGLE[what], to
    raise UsageError("a field is empty, or there is no such menu: fill in both fields, or reload the page.")


def _length(text: str, label: str) -> str:
    """A length of a field in mm, with a decimal point."""
    value = with_points(text, label)
    try:
        is_length = not value or 0 < float(value) < math.inf
    except ValueError:
        is_length = False
    if not is_length:
        raise UsageError(f"{label}: {text[:40]!r} is no length above zero in mm; write digits with a decimal point.")
    return value
