"""Validation errors of the schema as one sentence, and values shortened for messages."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

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
        path += f"[{step}]" if isinstance(step, int) else f".{short_name(step)}"
    return path.removeprefix(".")


def _holds(here: object, step: str | int) -> bool:
    if isinstance(step, str):
        return isinstance(here, Mapping) and step in here
    return isinstance(here, list | tuple) and step < len(here)


def short_name(text: str, limit: int = 40) -> str:
    """A name shortened for a message, on one line."""
    text = "".join(c if c.isprintable() else "?" for c in text[: limit + 1])
    return text if len(text) <= limit else text[: limit - 3] + "..."


def short(value: object, limit: int = 40) -> str:
    """A value shortened for a message: text in quotes, anything else as in JSON."""
    if isinstance(value, str):
        return f"'{short_name(value, limit)}'"
    if isinstance(value, list | tuple | Mapping):
        return "an object" if isinstance(value, Mapping) else "a list"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return short_name(repr(value), limit)
