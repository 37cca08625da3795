"""Results to standard output through rich; messages to standard error."""

import sys
from typing import TYPE_CHECKING

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
            self._console.print(block)
        sys.stdout.write("\n".join(line.rstrip() for line in captured.get().split("\n")))


def complain(sentence: str) -> None:
    """Say on standard error what went wrong."""
    sys.stderr.write(f"fitmodels: {sentence}\n")
