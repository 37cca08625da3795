"""The card for programs: card.json under a versioned schema, written and read back strictly.

``python -m fitmodels.cards.forms.card_json`` prints the schema, as it is kept in ``cards/schema/card-1.json``.
"""

import json
import os
import sys
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from ...core.errors import ParameterError
from ...parameters.file_format import parse_strict_json
from ...parameters.json_schema import DIALECT
from ...parameters.messages import schema_message, short
from ..content.parts import Card

SCHEMA: Final = "fitmodels.card/1"
FILE: Final = "card-1.json"
LARGEST = 50_000_000  # bytes
CURE = "Write the card again from its params.json."


def as_json(card: Card) -> str:
    """The card as JSON: fields in the order they are declared, numbers with value and text.

    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> as_json(compose(parameters.collect(tool="GC435", work="709M40"))).splitlines()[1]
    ' "schema": "fitmodels.card/1",'
    """
    return card.model_dump_json(by_alias=True, indent=1) + "\n"


def read_card(path: str | os.PathLike[str]) -> Card:
    """Read a card.json.

    Parameters
    ----------
    path : path-like
        At most 50 MB, UTF-8.

    Raises
    ------
    ParameterError
        No such file, no JSON, another schema, or something that the schema does not know: the sentence says where.

    Examples
    --------
    >>> try:
    ...     read_card("nowhere.json")
    ... except ParameterError as error:
    ...     print(error)
    nowhere.json: cannot be read: no such file or directory; give the path of a card.json written by fitmodels.
    """
    name = str(path)
    data = parse_strict_json(_bytes(Path(path), name), name)
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        seen = short(data.get("schema")) if isinstance(data, dict) else short(data)
        raise ParameterError(f"{name}: its schema is {seen}, not '{SCHEMA}'; give the path of a card.json.")
    try:
        return Card.model_validate(data)
    except ValidationError as error:
        raise ParameterError(f"{name}: {schema_message(error, data)}. {CURE}") from None


def json_schema() -> dict[str, Any]:
    """The schema of card.json, made from the classes.

    >>> json_schema()["properties"]["schema"]
    {'const': 'fitmodels.card/1', 'type': 'string'}
    """
    made = Card.model_json_schema(by_alias=True, mode="serialization")
    _tidied(made)
    made["properties"]["schema"] = {"const": SCHEMA, "type": "string"}
    return {"$schema": DIALECT, "$id": SCHEMA, **made}


def published() -> dict[str, Any]:
    """The schema as it is published with the package."""
    schema: dict[str, Any] = json.loads(files("fitmodels.cards").joinpath("schema", FILE).read_text(encoding="utf-8"))
    return schema


def schema_text() -> str:
    """The schema as it stands in its file."""
    return json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n"


def _bytes(path: Path, name: str) -> bytes:
    cure = "give the path of a card.json written by fitmodels"
    try:
        size = path.stat().st_size
        if size > LARGEST:
            raise ParameterError(f"{name}: {size} bytes; a card has at most {LARGEST}.")
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        why = (getattr(error, "strerror", None) or str(error)).lower()
        raise ParameterError(f"{name}: cannot be read: {why}; {cure}.") from None


def _tidied(schema: Any) -> None:  # noqa: ANN401
    """Every name stands in a schema as a title too, and docstrings with their line breaks."""
    if isinstance(schema, dict):
        if isinstance(schema.get("title"), str):
            del schema["title"]
        if isinstance(told := schema.get("description"), str):
            schema["description"] = " ".join(told.split("\n\n")[0].split())
    inner = schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ()
    for each in inner:
        _tidied(each)


if __name__ == "__main__":
    sys.stdout.write(schema_text())
