"""The command reference, generated from the program: ``{commands}`` renders the parser of every command."""

import argparse
import re
from collections.abc import Iterator
from importlib import import_module
from typing import TYPE_CHECKING

from docutils import nodes
from docutils.parsers.rst import Directive

if TYPE_CHECKING:
    from sphinx.application import Sphinx


def parsers() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Every command and its parser, the main job first."""
    from fitmodels.cli import COMMANDS

    for name in ("wear", *COMMANDS):
        yield name, import_module(f"fitmodels.cli.{name.replace('-', '_')}").parser()


class Commands(Directive):
    """One section per command: description, example, arguments and options."""

    def run(self) -> list[nodes.Node]:
        """The sections."""
        return [self._section(name, parser) for name, parser in parsers()]

    def _section(self, name: str, parser: argparse.ArgumentParser) -> nodes.section:
        title = "fitmodels FILE" if name == "wear" else f"fitmodels {name}"
        section = nodes.section(ids=[f"command-{name}"], names=[f"command-{name}"])
        section += nodes.title(title, title)
        self.state.document.note_explicit_target(section, section)
        section += list(_paragraphs(parser.description or ""))
        example = getattr(parser, "example", "")
        if example:
            section += nodes.literal_block(example, f"$ {example}", language="console")
        for group in parser._action_groups:
            if group._group_actions:
                section += nodes.rubric("", _heading(group))
                section += _options(group._group_actions, parser)
        return section


def _paragraphs(text: str) -> Iterator[nodes.Node]:
    """Paragraphs; indented lines are kept as a table."""
    for part in text.split("\n\n"):
        if all(line.startswith("  ") for line in part.splitlines() if line):
            yield nodes.literal_block(part, part, language="text")
        else:
            yield _paragraph(" ".join(part.split()))


def _paragraph(text: str) -> nodes.paragraph:
    """A paragraph with options as literals, so that two hyphens do not become a dash."""
    out = nodes.paragraph()
    for part in re.split(r"((?<![\w>])--?[A-Za-z][\w-]*)", text):
        out += nodes.literal(part, part) if part.startswith("-") else nodes.Text(part)
    return out


def _heading(group: argparse._ArgumentGroup) -> str:
    return {"positional arguments": "Arguments", "options": "Options"}.get(group.title, str(group.title).capitalize())


def _options(actions: list[argparse.Action], parser: argparse.ArgumentParser) -> nodes.definition_list:
    out = nodes.definition_list(classes=["options"])
    for action in actions:
        item = nodes.definition_list_item()
        term = nodes.term()
        for number, word in enumerate(_spellings(action)):
            term += [nodes.Text(", ")] if number else []
            term += nodes.literal(word, word)
        item += term
        item += nodes.definition("", _paragraph(_help(action, parser)))
        out += item
    return out


def _spellings(action: argparse.Action) -> list[str]:
    value = action.metavar or (
        "{" + ",".join(map(str, action.choices)) + "}" if action.choices else action.dest.upper()
    )
    value = value if isinstance(value, str) else " ".join(value)
    if not action.option_strings:
        return [f"{value} [{value} ...]" if action.nargs == "+" else f"[{value} ...]" if action.nargs == "*" else value]
    return [word if action.nargs == 0 else f"{word} {value}" for word in action.option_strings]


def _help(action: argparse.Action, parser: argparse.ArgumentParser) -> str:
    from fitmodels.cli.arguments import with_default

    text = with_default(action).replace("%(prog)s", parser.prog).replace("%%", "%")
    more = ["may be given several times"] if isinstance(action, argparse._AppendAction) else []
    more += ["required"] if action.option_strings and action.required else []
    return f"{text} ({'; '.join(more)})".strip() if more else text


def setup(app: "Sphinx") -> dict[str, bool]:
    """Register ``{commands}``."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
