"""File formats from the published schemas: ``{schema} parameters`` renders one, with the docstrings of its classes."""

import json
import re
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from docutils import nodes
from docutils.parsers.rst import Directive

if TYPE_CHECKING:
    from sphinx.application import Sphinx

# schema -> its package, its file in it, and the module of the classes of its parts
SCHEMAS = {
    "parameters": ("parameters", "schema/parameters-10.json", "fitmodels.parameters"),
    "card": ("cards", "schema/card-8.json", "fitmodels.cards.content.parts"),
}
WHOLES = {"parameters": ("fitmodels.parameters", "ParameterFile"), "card": ("fitmodels.cards.content.card", "Card")}
LIMITS = {"minimum": "≥", "maximum": "≤", "exclusiveMinimum": ">", "exclusiveMaximum": "<"}
Kind = Mapping[str, Any]

WHOLE = 2**63  # a bound that only expresses the size of a machine word


class Schema(Directive):
    """One table for the whole file and one for each part."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The tables."""
        name = self.arguments[0]
        package, path, home = SCHEMAS[name]
        schema = json.loads(files(f"fitmodels.{package}").joinpath(path).read_text("utf-8"))
        module, (of, of_class) = import_module(home), WHOLES[name]
        whole = self._section(
            name, "The whole file", schema, descriptions(getattr(import_module(of), of_class, None)), name
        )
        parts = [
            self._section(f"{name}-{part.lower()}", part, body, descriptions(getattr(module, part, None)), name)
            for part, body in schema["$defs"].items()
            if body.get("properties")
        ]
        return [whole, *parts]

    def _section(self, anchor: str, title: str, body: Kind, texts: Mapping[str, str], name: str) -> nodes.section:
        section = nodes.section(ids=[f"schema-{anchor}"], names=[f"schema-{anchor}"])
        section += nodes.title(title, title)
        self.state.document.note_explicit_target(section, section)
        if body.get("description"):
            section += nodes.paragraph("", body["description"].replace("``", ""))
        section += _table(list(_rows(body, texts, name)))
        return section


def _rows(body: Kind, texts: Mapping[str, str], name: str) -> Iterator[tuple[list[nodes.Node], ...]]:
    needed = set(body.get("required", ()))
    for field, kind in body["properties"].items():
        mark = [nodes.Text(" "), nodes.emphasis("", "required")] if field in needed else []
        yield [nodes.literal(field, field), *mark], list(_kind(kind, name)), [nodes.Text(texts.get(field, ""))]


def _kind(kind: Kind, name: str) -> Iterator[nodes.Node]:
    """Type of a field as text, with links to other parts."""
    if "$ref" in kind:
        part = kind["$ref"].rpartition("/")[2]
        if part == "JsonValue":
            yield nodes.Text("any JSON")
        else:
            yield nodes.reference(part, part, internal=True, refid=f"schema-{name}-{part.lower()}")
    elif either := kind.get("anyOf") or kind.get("oneOf"):
        for number, one in enumerate(either):
            yield from [nodes.Text(" or ")] if number else []
            yield from _kind(one, name)
    elif "enum" in kind or "const" in kind:
        for number, value in enumerate(kind.get("enum") or [kind["const"]]):
            yield from [nodes.Text(", ")] if number else []
            yield nodes.literal("", json.dumps(value))
    elif kind.get("type") == "array":
        yield nodes.Text("list of ")
        yield from _kind(kind.get("items") or {"type": "values"}, name)
    elif isinstance(kind.get("additionalProperties"), dict):
        yield nodes.Text("object by name of ")
        yield from _kind(kind["additionalProperties"], name)
    else:
        bounds = [f"{sign} {kind[word]:g}" for word, sign in LIMITS.items() if abs(kind.get(word, WHOLE)) < WHOLE]
        yield nodes.Text(" ".join([str(kind.get("type", "any")).replace("null", "nothing"), ", ".join(bounds)]).strip())


def descriptions(part: object) -> dict[str, str]:
    """Description of each field in the ``Attributes`` of a class.

    >>> class A:
    ...     '''Two numbers.
    ...
    ...     Attributes
    ...     ----------
    ...     low, high : float
    ...         The ends.
    ...     '''
    >>> descriptions(A)
    {'low': 'The ends.', 'high': 'The ends.'}
    """
    doc = re.sub(r"^    ", "", getattr(part, "__doc__", None) or "", flags=re.M)
    _, _, after = doc.partition("Attributes\n----------\n")
    found: dict[str, str] = {}
    for entry in re.finditer(
        r"^(?P<names>\w[\w, ]*) : (?P<kind>.*)\n(?P<text>(?:    .*\n|\n(?=    ))*)", after, flags=re.M
    ):
        text = " ".join(entry["text"].split()).replace("``", "")
        found |= dict.fromkeys(re.split(r", *", entry["names"]), text)
    return found


def _table(rows: list[tuple[list[nodes.Node], ...]]) -> nodes.table:
    heads = ("field", "type", "description")
    group = nodes.tgroup(cols=len(heads))
    group += [nodes.colspec(colwidth=width) for width in (24, 28, 48)]
    group += nodes.thead("", nodes.row("", *(nodes.entry("", nodes.paragraph("", head)) for head in heads)))
    body = nodes.tbody()
    for row in rows:
        body += nodes.row("", *(nodes.entry("", nodes.paragraph("", "", *cell)) for cell in row))
    group += body
    return nodes.table("", group, classes=["schema"])


def setup(app: "Sphinx") -> dict[str, bool]:
    """Register ``{schema}``."""
    app.add_directive("schema", Schema)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
