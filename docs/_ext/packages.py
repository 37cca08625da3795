"""The reference of a package: ``.. package:: fit`` documents its public names and the classes its functions return.

Packages import their names on first use; names are therefore taken from ``__all__`` and not from the module's contents.
"""

import re
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

from docutils import nodes
from docutils.parsers.rst import Directive
from reference_text import PACKAGES, lines, returned
from sphinx.addnodes import pending_xref
from sphinx.ext import autosummary

if TYPE_CHECKING:
    from sphinx.application import Sphinx


SPECIAL, BACKSLASHED = re.compile(r"([*_`])"), r"\\\1"


class Package(Directive):
    """Tables of names, then each name in full."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Insert the reStructuredText of the package into the page."""
        package = import_module(f"fitmodels.{self.arguments[0]}")
        self.state_machine.insert_input(list(lines(package)), f"<package {package.__name__}>")
        return []


def _omit_signature(
    app: "Sphinx", what: str, name: str, obj: object, options: object, *signature: str | None
) -> tuple[str, None] | None:
    """No signature for classes whose attributes are listed."""
    if what in ("class", "exception") and "Attributes\n" in (obj.__doc__ or ""):
        return "", None
    return None


def _escape(app: "Sphinx", what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Bars in docstrings are absolute values; a mapping without a docstring is described by its keys."""
    if isinstance(obj, dict):
        lines[:] = ["A mapping with the keys " + ", ".join(f"``{key}``" for key in obj) + "."]
        return
    for number, line in enumerate(lines):
        if "|" in line and not line.lstrip().startswith((">>>", "...")):
            parts = re.split(r"(``.*?``)", line)
            lines[number] = "".join(part if part.startswith("``") else part.replace("|", r"\|") for part in parts)
    if "Attributes" in lines:
        _list_attributes(lines, lines.index("Attributes"))


def _list_attributes(lines: list[str], start: int) -> None:
    """Attributes as a list: napoleon takes ``low, high : float`` for one name with a type before it."""
    stop = next((n for n in range(start + 2, len(lines)) if lines[n].startswith("---")), len(lines) + 1) - 1
    out = [".. rubric:: Attributes", ""]
    for line, below in zip(lines[start + 2 : stop], [*lines[start + 3 : stop], ""], strict=True):
        names, colon, kind = line.partition(" : ")
        if line[:1].strip() and (colon or below.startswith("    ")):
            known = ", ".join(f"``{name}``" for name in names.split(", "))
            out += ["", f"* {known} ({SPECIAL.sub(BACKSLASHED, kind)})" if colon else f"* {known}", ""]
        elif line[:1].strip():  # text after the list
            out += ["", line]
        else:
            out.append(line[2:])
    lines[start:stop] = [*out, ""]


@cache
def _documented() -> dict[str, dict[str, str]]:
    """Full names of documented objects by short name, for each package."""
    found: dict[str, dict[str, str]] = {}
    for name in PACKAGES:
        package = import_module(f"fitmodels.{name}")
        results = {kind.__name__: f"{kind.__module__}.{kind.__qualname__}" for kind in returned(package)}
        found[package.__name__] = results | {public: f"{package.__name__}.{public}" for public in package.__all__}
    return found


def _link_types(app: "Sphinx", doctree: nodes.document) -> None:
    """Types in docstrings link to the documented name of that spelling, in the same package first, or to nothing."""
    for reference in list(doctree.findall(pending_xref)):
        if reference.get("refdomain") != "py" or not reference.get("refspecific"):
            continue
        word, package = reference["reftarget"], reference.get("py:module") or ""
        candidates = [_documented().get(package, {}), *_documented().values()]
        target = next((names[word] for names in candidates if word in names), None)
        if target and word[:1].isupper():
            reference["reftarget"], reference["refspecific"] = target, False
        else:
            reference.replace_self(reference.children)


def setup(app: "Sphinx") -> dict[str, bool]:
    """Register ``.. package::``."""
    autosummary.WELL_KNOWN_ABBREVIATIONS = (*autosummary.WELL_KNOWN_ABBREVIATIONS, "eq.", "Sci.", "no.")
    app.add_directive("package", Package)
    app.connect("autodoc-process-signature", _omit_signature)
    app.connect("autodoc-process-docstring", _escape, priority=400)  # before napoleon
    app.connect("doctree-read", _link_types)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
