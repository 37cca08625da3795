"""The reference of a room: ``.. room:: fit`` documents what the room's ``__all__`` names, by sub-room.

Rooms load their names on first use, so that they are found by asking the room, not by looking at it.
"""

import inspect
import re
from collections import defaultdict
from collections.abc import Iterator
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.addnodes import pending_xref
from sphinx.ext import autosummary

if TYPE_CHECKING:
    from sphinx.application import Sphinx

ROOMS = tuple(f"fitmodels.{room}" for room in ("datasets", "fit", "ident", "parameters", "controllers", "cards"))

SPECIAL, BACKSLASHED = re.compile(r"([*_`])"), r"\\\1"


class Room(Directive):
    """Tables of names, then each name in full."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Put the lines in, as if they stood on the page."""
        room = import_module(f"fitmodels.{self.arguments[0]}")
        self.state_machine.insert_input(list(lines(room)), f"<room {room.__name__}>")
        return []


def lines(room: ModuleType) -> Iterator[str]:
    """The page of a room, in reStructuredText."""
    yield from (inspect.getdoc(room) or "").split("\n\n")[0].splitlines()
    yield from ("", f".. currentmodule:: {room.__name__}", "")
    grouped = groups(room)
    for part in sorted(grouped):
        if len(grouped) > 1:
            title = _title(room, part)
            yield from (title, "-" * len(title), "")
        yield from (".. autosummary::", "   :nosignatures:", "", *(f"   {name}" for name in grouped[part]), "")
        for name in grouped[part]:
            yield from (f".. {_directive(getattr(room, name))}:: {name}", "")


def groups(room: ModuleType) -> dict[str, list[str]]:
    """Public names by sub-room; what stands in the room itself is under ``""``."""
    found: dict[str, list[str]] = defaultdict(list)
    for name in sorted(room.__all__, key=str.lower):
        home = getattr(getattr(room, name), "__module__", None) or room.__name__
        inside = home.removeprefix(f"{room.__name__}.").split(".")
        part = inside[0] if home.startswith(room.__name__) and _is_package(room, inside[0]) else ""
        found[part].append(name)
    return dict(found)


def _is_package(room: ModuleType, part: str) -> bool:
    try:
        return hasattr(import_module(f"{room.__name__}.{part}"), "__path__")
    except ModuleNotFoundError:
        return False


def _title(room: ModuleType, part: str) -> str:
    if not part:
        return "In the room itself"
    doc = (inspect.getdoc(import_module(f"{room.__name__}.{part}")) or "").split("\n\n")[0]
    first = " ".join(doc.split()).split(":")[0].split(". ")[0].rstrip(".")
    return f"{part.replace('_', ' ')}: {first}" if first else part


def _directive(value: object) -> str:
    if inspect.isclass(value):
        return "autoexception" if issubclass(value, BaseException) else "autoclass"
    return "autofunction" if callable(value) else "autodata"


def _short(
    app: "Sphinx", what: str, name: str, obj: object, options: object, *signature: str | None
) -> tuple[str, None] | None:
    """No signature for results, whose fields are listed below it anyway."""
    if what in ("class", "exception") and "Attributes\n" in (obj.__doc__ or ""):
        return "", None
    return None


def _plain(app: "Sphinx", what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Bars in docstrings are absolute values; a mapping has no words of its own, so its keys are named."""
    if isinstance(obj, dict):
        lines[:] = ["A mapping with the keys " + ", ".join(f"``{key}``" for key in obj) + "."]
        return
    for number, line in enumerate(lines):
        if "|" in line and not line.lstrip().startswith((">>>", "...")):
            parts = re.split(r"(``.*?``)", line)
            lines[number] = "".join(part if part.startswith("``") else part.replace("|", r"\|") for part in parts)
    if "Attributes" in lines:
        _listed(lines, lines.index("Attributes"))


def _listed(lines: list[str], start: int) -> None:
    """Attributes as a list: napoleon takes ``low, high : float`` for one name with a type before it."""
    stop = next((n for n in range(start + 2, len(lines)) if lines[n].startswith("---")), len(lines) + 1) - 1
    out = [".. rubric:: Attributes", ""]
    for line, below in zip(lines[start + 2 : stop], [*lines[start + 3 : stop], ""], strict=True):
        names, colon, kind = line.partition(" : ")
        if line[:1].strip() and (colon or below.startswith("    ")):
            known = ", ".join(f"``{name}``" for name in names.split(", "))
            out += ["", f"* {known} ({SPECIAL.sub(BACKSLASHED, kind)})" if colon else f"* {known}", ""]
        elif line[:1].strip():  # behind the list, words again
            out += ["", line]
        else:
            out.append(line[2:])
    lines[start:stop] = [*out, ""]


def _aim(app: "Sphinx", doctree: nodes.document) -> None:
    """Types in docstrings link to the public name of that spelling, in the same room first, or to nothing."""
    for ref in list(doctree.findall(pending_xref)):
        if ref.get("refdomain") != "py" or not ref.get("refspecific"):
            continue
        word, room = ref["reftarget"], ref.get("py:module") or ""
        homes = [home for home in (room, *ROOMS) if home and word in getattr(import_module(home), "__all__", ())]
        if homes and word[:1].isupper():
            ref["reftarget"], ref["refspecific"] = f"{homes[0]}.{word}", False
        else:
            ref.replace_self(ref.children)


def setup(app: "Sphinx") -> dict[str, bool]:
    """Register ``.. room::``."""
    autosummary.WELL_KNOWN_ABBREVIATIONS = (*autosummary.WELL_KNOWN_ABBREVIATIONS, "eq.", "Sci.", "no.")
    app.add_directive("room", Room)
    app.connect("autodoc-process-signature", _short)
    app.connect("autodoc-process-docstring", _plain, priority=400)  # before napoleon
    app.connect("doctree-read", _aim)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
