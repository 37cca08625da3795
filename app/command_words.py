"""Words of a command from a filled form, with numbers and units as people type them."""

import re
from collections.abc import Collection, Mapping, Sequence

from ..core.errors import UsageError
from .command_forms import Action, Input, Subject

LONGEST = 200  # characters of a value
DEFAULT = "default"  # a value that settings takes for its default
NUMBERS = re.compile(r"[+-]?\d+(?:[.,]\d+)?(?::[+-]?\d+(?:[.,]\d+)?)*\s*(?:[^\d\s,:][^,:]*)?")  # with a unit
THOUSANDS = re.compile(r"(?<![\d.,])[1-9]\d{0,2},\d{3}(?!\d)")


def command(
    action: Action, of: Subject, given: Mapping[str, str], tests: Sequence[str], emptied: Collection[str] = ()
) -> list[str]:
    """Words of the command of a filled form.

    Parameters
    ----------
    action : Action
    of : Subject
    given : mapping of str
        Values of the fields.
    tests : sequence of str
        The file of tests with the options of its reading.
    emptied : collection of str
        Fields that are empty now and were not: their default is asked for, where the file would keep the former value.

    Raises
    ------
    UsageError
        A needed field is empty, or a value holds what no value holds.

    Examples
    --------
    >>> of = Subject("d", "d-fit/p/params.json")
    >>> limits = Action("limits", "", "", (Input("P", "", "P={}"),), "--force")
    >>> command(limits, of, {"P": "7 kW"}, ["d.csv"])
    ['limits', 'd-fit/p/params.json', 'P=7 kW', '--force']
    """
    first = {"params": [of.params], "tests": list(tests)}.get(action.first, [])
    words, filled = [action.name, *first], {}
    for one in action.inputs:
        value = _value(one, given.get(one.name, ""))
        if not value and one.name in emptied:
            value = DEFAULT
        if value:
            filled[one.name] = value
            words += [part.replace("{}", value) for part in _joined(one.words, value).split(" ")]
    words += _pair(of, tests) if action.name == "next" else []
    return words + [
        part.format(stem=of.stem, to=filled.get("to", ""), params=of.params) for part in action.fixed.split(" ") if part
    ]


def _pair(of: Subject, tests: Sequence[str]) -> list[str]:
    """Options that name the pair of a parameter file whose tests hold others as well."""
    options = (of.content.get("provenance") or {}).get("options") or {}
    pair = options.get("pair") if isinstance(options, Mapping) else None
    if not isinstance(pair, Mapping):
        return []
    return [f"--{role}={pair[role]}" for role in ("tool", "work") if role in pair and f"--{role}" not in tests]


def _joined(words: str, value: str) -> str:
    """``--option={}`` for a value that begins like an option."""
    return words.replace(" ", "=", 1) if value.startswith("-") and words.startswith("--") else words


def _value(one: Input, given: str) -> str:
    value = given.strip()
    if len(value) > LONGEST or re.search(r"[\x00-\x1f\x7f]", value):
        raise UsageError(f"{one.label}: a value has up to {LONGEST} characters and no line breaks.")
    if one.choices and value not in {key for key, _ in one.choices}:
        raise UsageError(f"{one.label}: choose one of {', '.join(label for _, label in one.choices) or 'none'}.")
    if one.needed and not value:
        raise UsageError(f"{one.label} is empty: fill it in{f', such as {one.hint}' if one.hint else ''}.")
    if not one.words.startswith("--") and value.startswith("-") and "=" not in one.words:
        raise UsageError(f"{one.label}: {value} begins like an option.")
    return with_points(value, one.label)


def with_points(value: str, label: str) -> str:
    """A number or range of a field with decimal points; a comma before three digits may separate thousands.

    >>> with_points("0,28 A", "worn"), with_points("0,18:0,22mm", "window"), with_points("3,3,1", "orders")
    ('0.28 A', '0.18:0.22mm', '3,3,1')
    """
    if not NUMBERS.fullmatch(value):
        return value
    if THOUSANDS.search(value):
        raise UsageError(f"{label}: {value} can be read in two ways; write a point before decimals only.")
    return value.replace(",", ".")
