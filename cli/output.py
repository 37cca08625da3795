"""Where words go: results to standard output, progress to standard error, neither in the other's way."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Show what is going on, with the time it takes; the line goes when the work is done.

    >>> with progress() as step:
    ...     step("fitting")
    """
    if not sys.stderr.isatty():
        yield lambda what: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    bar = Progress(
        TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn(),
        console=Console(stderr=True), transient=True,
    )  # fmt: skip
    with bar:
        task = bar.add_task("", total=None)
        yield lambda what: bar.update(task, description=what)
