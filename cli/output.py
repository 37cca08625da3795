"""Where words go: results to standard output, progress to standard error, neither in the other's way."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import RenderableType

PATIENCE = 2.0  # seconds before anything is shown of what is going on
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


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Show at a terminal what is going on once it has taken two seconds; the line goes when the work is done.

    >>> with progress() as step:
    ...     step("fitting")
    """
    said = [""]
    ended = Event()
    watcher = Thread(target=_watch, args=(said, ended), daemon=True)
    if sys.stderr.isatty():
        watcher.start()
    try:
        yield said.append
    finally:
        ended.set()
        if watcher.is_alive():
            watcher.join()


def _watch(said: list[str], ended: Event) -> None:
    if ended.wait(PATIENCE):
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(said[-1], total=None)
        while not ended.wait(0.1):
            bar.update(task, description=said[-1])
