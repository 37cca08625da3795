"""Validation errors of the schema and differences of sections as one sentence, and values shortened for messages."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from math import isclose
from typing import TYPE_CHECKING, Any

from ..core.rounding import count
from ..core.text import shortened

if TYPE_CHECKING:
    from pydantic import ValidationError
    from pydantic_core import ErrorDetails

LISTED = 2  # errors listed in full; the others are counted

# pydantic's kinds of error in terms of JSON
WORDS = {
    "model_type": "should be an object",
    "model_attributes_type": "should be an object",
    "dict_type": "should be an object",
    "tuple_type": "should be a list",
    "float_type": "should be a number",
    "int_type": "should be a whole number",
    "int_from_float": "should be a whole number",
    "string_type": "should be text",
    "string_too_short": "should not be empty",
    "bool_type": "should be true or false",
}


def schema_message(error: "ValidationError", data: object) -> str:
    """The first validation errors of ``data``, each with its JSON path, as one clause."""
    details = error.errors(include_url=False, include_context=False)
    clauses = [_one(detail, data) for detail in details[:LISTED]]
    if len(details) > LISTED:
        clauses.append(f"and {len(details) - LISTED} more")
    return "; ".join(clauses)


def _one(detail: "ErrorDetails", data: object) -> str:
    where = json_path(detail["loc"], data) or "the file"
    if detail["type"] == "missing":
        return f"{where} is missing"
    if detail["type"] == "value_error":
        return f"{where}: {detail['msg'].removeprefix('Value error, ')}"
    if detail["type"].startswith("union_tag"):
        return f"{where} needs a known kind, 'covariance' or 'none'"
    words = WORDS.get(detail["type"]) or detail["msg"].removeprefix("Input ")
    seen = detail["input"]
    return f"{where} {words[0].lower()}{words[1:]}, not {short(seen)}"


def json_path(location: Sequence[str | int], data: object) -> str:
    """``laws.AW.factors[0].low`` of a pydantic location.

    The location also names the branch of a union, which is not in the file: a step that leads
    nowhere in ``data`` is left out unless it is the last.
    """
    path, here = "", data
    for place, step in enumerate(location):
        known = _holds(here, step)
        if not known and place < len(location) - 1:
            continue
        if known:
            here = here[step]  # type: ignore[index]
        path += f"[{step}]" if isinstance(step, int) else f".{shortened(step)}"
    return path.removeprefix(".")


def _holds(here: object, step: str | int) -> bool:
    if isinstance(step, str):
        return isinstance(here, Mapping) and step in here
    return isinstance(here, list | tuple) and step < len(here)


def short(value: object, limit: int = 40) -> str:
    """A value shortened for a message: text in quotes, anything else as in JSON."""
    if isinstance(value, str):
        return f"'{shortened(value, limit)}'"
    if isinstance(value, list | tuple | Mapping):
        return "an object" if isinstance(value, Mapping) else "a list"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return shortened(repr(value), limit)


ROUNDING = 1e-9  # relative difference of numbers that two computers, or two orders of the rows, give for the same data
SHOWN = 4  # fields of a difference that are named; the others are counted
FIRST = ("form", "unit", "coefficients", "criterion", "kp", "ki", "b", "a", "reference", "worn")
LIMIT = {"value", "low", "high", "unit", "of"}


def difference(one: object, two: object, a: str, b: str) -> str:
    """Difference of two contents of a section, each with the name of its file: limits, or the first fields that do.

    >>> difference({"kp": 1.0, "ki": 2.0}, {"kp": 1.5, "ki": 2.0}, "a.json", "b.json")
    'kp 1 in a.json; kp 1.5 in b.json'
    >>> difference({"value": 7.0, "unit": "kW"}, {"value": 5e3, "unit": "W"}, "a.json", "b.json")
    'at most 7 kW in a.json, at most 5000 W in b.json; the tighter one is that of b.json'
    """
    if not (isinstance(one, Mapping) and isinstance(two, Mapping)):
        return f"{short(one)} in {a}, {short(two)} in {b}"
    if set(one) <= LIMIT and set(two) <= LIMIT:
        return f"{limit_words(one)} in {a}, {limit_words(two)} in {b}{tighter(one, two, a, b)}"
    names = sorted({*one, *two}, key=lambda key: (FIRST.index(key) if key in FIRST else len(FIRST), key))
    differ = list(_fields(one, two, names))
    shown = [(key, *_values(x, y)) for key, x, y in differ[:SHOWN]]
    more = len(differ) - SHOWN
    further = f" ({count(more, 'more field')} differ{'' if more > 1 else 's'})" if more > 0 else ""
    held = (", ".join(f"{key} {values[side]}" for key, *values in shown) for side in (0, 1))
    return f"{next(held)} in {a}; {next(held)} in {b}{further}"


def agree(one: object, two: object, near: float = ROUNDING, scale: float = 0.0) -> bool:
    """Whether two contents hold the same, numbers within rounding: of each other, in a list of its largest.

    >>> agree({"b": [1.0, 1e-17]}, {"b": [1.0 + 1e-12, 0.0]}), agree(0.3, 0.3001), agree(0.3, "0.3")
    (True, False, False)
    """
    if isinstance(one, Mapping) and isinstance(two, Mapping):
        return one.keys() == two.keys() and all(agree(one[key], two[key], near) for key in one)
    if isinstance(one, list | tuple) and isinstance(two, list | tuple):
        return len(one) == len(two) and _lists_agree(one, two, near)
    if isinstance(one, float) and isinstance(two, float):
        return isclose(one, two, rel_tol=near, abs_tol=near * scale)
    return bool(one == two)


def _lists_agree(one: Sequence[object], two: Sequence[object], near: float) -> bool:
    largest = max((abs(x) for x in (*one, *two) if isinstance(x, float)), default=0.0)
    return all(agree(x, y, near, largest) for x, y in zip(one, two, strict=True))


def _values(x: object, y: object) -> tuple[str, str]:
    """Two values that differ, numbers at six digits where these differ."""
    if isinstance(x, list | tuple) and isinstance(y, list | tuple):
        return count(len(x), "entry", "entries"), count(len(y), "entry", "entries")
    if isinstance(x, float) and isinstance(y, float) and f"{x:.6g}" != f"{y:.6g}":
        return f"{x:.6g}", f"{y:.6g}"
    return short(x), short(y)


def in_unit(value: float, unit: str, to: str) -> float | None:
    """A value in another unit, to 12 digits; None where the units are of other dimensions.

    >>> in_unit(220.0, "um", "mm")
    0.22
    """
    import numpy as np

    from ..datasets.units import convert, is_unit, same_dimension

    if unit == to:
        return value
    if not (is_unit(unit) and is_unit(to) and same_dimension(unit, to)):
        return None
    return float(f"{float(convert(np.array(value), unit, to)):.12g}")


def _fields(a: Mapping[str, Any], b: Mapping[str, Any], names: Iterable[str]) -> Iterator[tuple[str, Any, Any]]:
    """Name and values of each field that differs, a list counted once."""
    for key in names:
        name, x, y = _entry(key, a.get(key), b.get(key))
        if isinstance(x, dict) and isinstance(y, dict):
            inside = _fields(x, y, dict.fromkeys([*x, *y]))
            yield from inside if name == key else islice(inside, 1)
        elif not agree(x, y):
            yield name, x, y


def _entry(name: str, x: object, y: object) -> tuple[str, object, object]:
    """Of lists of one length the first entry that differs, with its name and place; anything else as it is."""
    while isinstance(x, list | tuple) and isinstance(y, list | tuple) and len(x) == len(y) and not agree(x, y):
        place = next(i for i, (one, two) in enumerate(zip(x, y, strict=True)) if not agree(one, two))
        name, x, y = f"{name}[{place}]", x[place], y[place]
    return name, x, y


def limit_words(limit: Mapping[str, Any]) -> str:
    """A limit of one end or two in words.

    >>> limit_words({"low": 50.0, "high": 200.0, "unit": "m/min"})
    'from 50 to 200 m/min'
    """
    if "value" in limit:
        return f"at most {limit['value']:g} {limit['unit']}" + (f" of {limit['of']}" if limit.get("of") else "")
    ends = [f"{word} {limit[end]:g}" for word, end in (("from", "low"), ("to", "high")) if limit[end] is not None]
    return f"{' '.join(ends)} {limit['unit']}"


def tighter(a: Mapping[str, Any], b: Mapping[str, Any], one: str, two: str) -> str:
    """Words on the tighter one of two limits, where that can be said of all their ends."""
    if a.get("of") != b.get("of"):
        return ""
    signs = {sign for key, sign in (("value", 1), ("high", 1), ("low", -1)) for sign in _sign(a, b, key, sign)}
    return f"; the tighter one is that of {two if signs == {1} else one}" if len(signs) == 1 else ""


def _sign(a: Mapping[str, Any], b: Mapping[str, Any], key: str, sign: int) -> list[int]:
    """The sign where the end of the second limit is tighter, its reverse where that of the first is; none if equal."""
    x, y = a.get(key), b.get(key)
    if x is None or y is None:
        return [] if x is y else [sign if x is None else -sign]
    other = in_unit(y, b["unit"], a["unit"])
    return [] if other is None or x == other else [sign if x > other else -sign]
