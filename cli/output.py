"""Results to standard output, as text through rich or as JSON; messages to standard error."""

import json
import sys
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import RenderableType

NARROWEST, WIDEST = 100, 120  # columns: a table of laws needs the first, a sentence no more than the second


class Printer:
    """Standard output through rich: colours at a terminal, plain text in a pipe, no blanks at line ends."""

    def __init__(self) -> None:
        from rich.console import Console

        self._console = Console(markup=False, highlight=False, emoji=False)
        self._console.width = min(max(self._console.width, NARROWEST), WIDEST)

    def show(self, block: "RenderableType") -> None:
        """Print one block."""
        with self._console.capture() as captured:
            self._console.print(block, crop=False)  # commands may be longer than a line
        sys.stdout.write("\n".join(line.rstrip() for line in captured.get().split("\n")))


def print_lines(lines: Iterable[str]) -> None:
    """Print lines of text."""
    from rich.text import Text

    out = Printer()
    for line in lines:
        out.show(Text(line))


def print_json(schema: str, facts: Mapping[str, Any], version: int = 1) -> None:
    """Print facts as JSON, with the schema ``fitmodels.<schema>/<version>`` first."""
    report = {"schema": f"fitmodels.{schema}/{version}", **facts}
    print(json.dumps(report, indent=2, ensure_ascii=False, allow_nan=False))  # noqa: T201


def complain(sentence: str) -> None:
    """Print on standard error what went wrong."""
    sys.stderr.write(f"fitmodels: {sentence}\n")
