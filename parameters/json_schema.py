"""JSON Schema of the parameter file, generated from the classes and shipped with the package.

``python -m fitmodels.parameters.json_schema`` prints it; a test compares it with ``schema/parameters-10.json``.
Constraints that a schema cannot express (a covariance is positive semi-definite, b begins with nk zeros) are checked by
the reader only.
"""

import json
import sys
from typing import Any, Final

from .file import ParameterFile
from .file_format import SCHEMA

DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"


def build_schema() -> dict[str, Any]:
    """The schema generated from the classes.

    Examples
    --------
    >>> build_schema()["properties"]["identity"]
    {'$ref': '#/$defs/IdentitySection'}
    """
    made = ParameterFile.model_json_schema()
    _first_paragraphs(made)
    comment = "Unknown fields and sections are kept. The reader checks more than a schema can say."
    return {
        "$schema": DIALECT,
        "$id": SCHEMA,
        "$comment": comment,
        **made,
        "required": ["schema_version", *made["required"]],
    }


def schema_text() -> str:
    """Text of the schema file."""
    return json.dumps(build_schema(), indent=1, ensure_ascii=False) + "\n"


def _first_paragraphs(schema: Any) -> None:  # noqa: ANN401
    """Keep the first paragraph of each description and drop titles, which repeat the names."""
    if isinstance(schema, dict):
        if isinstance(schema.get("title"), str):
            del schema["title"]
        if isinstance(text := schema.get("description"), str):
            schema["description"] = " ".join(text.split("\n\n")[0].split())
        for inner in schema.values():
            _first_paragraphs(inner)
    elif isinstance(schema, list):
        for inner in schema:
            _first_paragraphs(inner)


if __name__ == "__main__":
    sys.stdout.write(schema_text())
