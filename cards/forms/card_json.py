"""The card for programs: card.json and its versioned schema.

``python -m fitmodels.cards.forms.card_json`` prints the schema, as it is kept in ``cards/schema/card-8.json``.
"""

import json
import sys
from typing import Any, Final

from ...core.text import escaped
from ...parameters.json_schema import DIALECT
from ..content.card import Card

SCHEMA: Final = "fitmodels.card/8"


def as_json(card: Card) -> str:
    """The card as JSON: fields in the order of their declaration, numbers with value and text.

    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> as_json(compose(parameters.collect(tool="GC435", work="709M40"))).splitlines()[1]
    ' "schema": "fitmodels.card/8",'
    """
    return escaped(card.model_dump_json(by_alias=True, indent=1)) + "\n"


def json_schema() -> dict[str, Any]:
    """The schema of card.json, generated from the classes.

    >>> json_schema()["properties"]["schema"]
    {'const': 'fitmodels.card/8', 'type': 'string'}
    """
    made = Card.model_json_schema(by_alias=True, mode="serialization")
    _tidy(made)
    made["properties"]["schema"] = {"const": SCHEMA, "type": "string"}
    return {"$schema": DIALECT, "$id": SCHEMA, **made}


def schema_text() -> str:
    """The schema as the text of its file."""
    return json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n"


def _tidy(schema: Any) -> None:  # noqa: ANN401
    """Remove titles, which repeat names, and shorten docstrings to their first paragraph on one line."""
    if isinstance(schema, dict):
        if isinstance(schema.get("title"), str):
            del schema["title"]
        if isinstance(description := schema.get("description"), str):
            schema["description"] = " ".join(description.split("\n\n")[0].split())
    inner = schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ()
    for each in inner:
        _tidy(each)


if __name__ == "__main__":
    sys.stdout.write(schema_text())
