"""Progress of long work: a bar at a terminal, a line now and then elsewhere, nothing for work that is soon over.

All of it goes to standard error, or under the running cell of a notebook.
"""

import shutil
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import Event, Thread
from time import monotonic
from typing import TYPE_CHECKING, Any

from .text import one_line

if TYPE_CHECKING:
    from rich.progress import Progress

PATIENCE = 2.0  # s before anything is shown
BETWEEN_LINES = 15.0  # s, where there is no terminal
RECENT = 30.0  # s that the rate looks back
FEWEST = 8  # steps that it looks back at least: some take minutes


def grouped(n: int) -> str:
    """A count as it is read: blanks between thousands above 9999.

    >>> grouped(3400), grouped(10000), grouped(100000000)
    ('3400', '10 000', '100 000 000')
    """
    return str(n) if n < 10_000 else f"{n:,}".replace(",", " ")


@dataclass(slots=True)
class Meter:
    """Count of the work that is done; made by `progress_bar`.

    Attributes
    ----------
    total : int
        0 until it is known, see `expect`.
    unit : str
        In the plural: pairs.
    done : int
    words : str
        Description of the present step.
    clock : callable
        Time in s.
    """

    total: int
    unit: str
    done: int = 0
    words: str = ""
    clock: Callable[[], float] = monotonic
    _steps: deque[tuple[float, int]] = field(default_factory=deque)  # time, and how many were done by it

    def __post_init__(self) -> None:
        self._steps.append((self.clock(), 0))

    def expect(self, total: int) -> None:
        """Set the total; the rate counts from now on."""
        self.total = total
        self._start_again()

    def skip(self, n: int) -> None:
        """Count ``n`` as done by an earlier run, without effect on the rate."""
        self.done += n
        self._start_again()

    def advance(self, n: int, words: str = "") -> None:
        """Count ``n`` as done just now."""
        self.done += n
        self.words = words or self.words
        now = self.clock()
        self._steps.append((now, self.done))
        while len(self._steps) > FEWEST + 1 and self._steps[1][0] <= now - RECENT:
            self._steps.popleft()

    def say(self, words: str) -> None:
        """Describe the present step."""
        self.words = words

    def _start_again(self) -> None:
        self._steps.clear()
        self._steps.append((self.clock(), self.done))

    def rate(self) -> float:
        """Units per second over the recent past; 0 before the first is done."""
        since, before = self._steps[0]
        elapsed = self.clock() - since
        return (self.done - before) / elapsed if elapsed > 0 else 0.0

    def counted(self) -> str:
        """Number done of the total.

        >>> Meter(10_000, "pairs", done=3400).counted()
        '3400 of 10 000 pairs'
        """
        return f"{grouped(self.done)} of {grouped(self.total)} {self.unit}" if self.total else ""

    def pace(self) -> str:
        """Rate and time left, where known."""
        rate = self.rate()
        if not (self.total and rate):
            return ""
        left = (self.total - self.done) / rate
        return f"{_rate(rate, self.unit)}, {_time(left)} left" if left > 0 else _rate(rate, self.unit)

    def line(self) -> str:
        """Description, number and rate in one line."""
        facts = ", ".join(part for part in (self.counted(), self.pace()) if part)
        return ": ".join(part for part in (self.words, facts) if part)


def _rate(rate: float, unit: str) -> str:
    """Three digits are enough.

    >>> _rate(285.31, "pairs"), _rate(12345.6, "pairs"), _rate(0.05, "pairs")
    ('285 pairs/s', '12 346 pairs/s', '3 pairs/min')
    """
    if rate < 0.1:
        return f"{60 * rate:.2g} {unit}/min"
    return f"{grouped(round(rate)) if rate >= 100 else f'{rate:.2g}'} {unit}/s"


def _time(seconds: float) -> str:
    """A time that is left.

    >>> _time(22.6), _time(250), _time(4320)
    ('23 s', '4 min', '1 h 12 min')
    """
    if seconds < 99.5:
        return f"{max(round(seconds), 1)} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{grouped(hours)} h {minutes:02d} min" if hours else f"{minutes} min"


@contextmanager
def progress_bar(total: int = 0, unit: str = "", *, lines: bool = True) -> Iterator[Meter]:
    """Show on standard error how far the work is, once it has taken two seconds.

    Parameters
    ----------
    total : int
        0 where it is not known yet, see `Meter.expect`.
    unit : str
        What is counted, in the plural.
    lines : bool
        Whether a line is written now and then where standard error is no terminal.

    Examples
    --------
    >>> with progress_bar(10_000, "pairs") as meter:
    ...     meter.skip(3000)  # kept from an earlier run
    ...     meter.advance(400)
    >>> meter.counted()
    '3400 of 10 000 pairs'
    """
    meter = Meter(total, unit)
    ended = Event()
    terminal = sys.stderr.isatty()
    watcher = Thread(target=_bar if terminal else _lines, args=(meter, ended), name="progress", daemon=True)
    if terminal or lines:
        watcher.start()
    try:
        yield meter
    finally:
        ended.set()
        if watcher.is_alive():
            watcher.join()


def _lines(meter: Meter, ended: Event) -> None:
    pause = PATIENCE
    while not ended.wait(pause):
        line = meter.line()
        if line:
            sys.stderr.write(f"{one_line(line)}\n")
            sys.stderr.flush()
        pause = BETWEEN_LINES


def _bar(meter: Meter, ended: Event) -> None:
    if ended.wait(PATIENCE):
        return
    with _columns() as bar:
        task = bar.add_task("", total=None, counted="", pace="")
        while not ended.wait(0.1):
            bar.update(
                task, description=one_line(meter.words), total=meter.total or None, completed=meter.done,
                counted=meter.counted(), pace=meter.pace(),
            )  # fmt: skip


def _columns() -> "Progress":
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    size = shutil.get_terminal_size()  # rich fails where COLUMNS or LINES is a digit that is no number
    console = Console(stderr=True, width=size.columns, height=size.lines)
    text = [TextColumn(f"{{task.{name}}}", markup=False) for name in ("description", "fields[counted]", "fields[pace]")]
    return Progress(text[0], BarColumn(), *text[1:], TimeElapsedColumn(), console=console, transient=True)


def status_line() -> Callable[[str], None]:
    """A function that writes one line in place of the former: under the notebook cell, or at the terminal."""
    return _notebook_line() or _terminal_line


def _terminal_line(text: str) -> None:
    if sys.stderr.isatty():
        sys.stderr.write(f"\x1b[2K{one_line(text)}\r")  # the cursor goes back: what is written next stands in its place
        sys.stderr.flush()


def _notebook_line() -> Any:  # noqa: ANN401
    """A line under the running cell; None outside a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if shell is None or not hasattr(shell, "kernel"):
        return None
    from IPython import display  # type: ignore[import-not-found, unused-ignore]

    show: Any = display.display

    class Line:
        def __init__(self) -> None:
            self.text, self.handle = "", None

        def __repr__(self) -> str:
            return self.text

        def __call__(self, text: str) -> None:
            self.text = text
            if self.handle is None:
                self.handle = show(self, display_id=True)
            else:
                self.handle.update(self)

    return Line()
