"""Common base of the engines, the engine of this process, signals and memory."""

import signal
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from pathlib import Path
from typing import TypeVar


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Block SIGINT until the block ends; processes and threads that start in it never receive it.

    A blocked signal is inherited from the first instruction on: a handler that the child sets, or its own way to treat
    KeyboardInterrupt, comes too late while it still imports. And a KeyboardInterrupt between two lines of joblib or
    Dask may leave a lock taken, for which the thread that is to be ended then waits for ever.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # starting it unblocks SIGINT in the thread that does (Python 3.11, 3.12)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def no_report(words: str) -> None:
    """Receives progress updates and ignores them."""


KEPT = "finished results are kept and the same command continues from there"
STATUS = Path("/proc/self/status")


def largest_memory() -> int:
    """Peak of the resident memory of this process, in bytes; 0 where the system (Windows) does not report it.

    On Linux it is VmHWM of proc_pid_status(5): ``ru_maxrss`` of getrusage(2), which other systems have, begins there
    with the memory of the process that started this one.

    Examples
    --------
    >>> largest_memory() > 1e7
    True
    """
    peaks = [line for line in STATUS.read_text().splitlines() if line.startswith("VmHWM:")] if STATUS.exists() else []
    if peaks:
        return int(peaks[0].split()[1]) * 1024
    try:
        import resource
    except ImportError:
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024  # bytes on macOS, kibibytes elsewhere


T = TypeVar("T")
R = TypeVar("R")


class Run(ABC):
    """Runs a function over tasks; made by `engine`.

    Workers must be able to import the function. Its exceptions are raised here, and its tasks are not repeated. Only
    as many tasks are submitted as keep the workers busy, so that results do not accumulate.
    """

    @abstractmethod
    def __call__(self, work: Callable[[T], R], tasks: Iterable[T]) -> Generator[tuple[int, R], None, None]:
        """Position and result of each task, in the order of completion.

        Closing the iterator stops the work: no more tasks are submitted, and running ones end with the engine.
        """

    @abstractmethod
    def describe(self) -> str:
        """Description of the engine."""

    def started(self) -> bool:
        """Whether its processes run: those of this machine start with the first task, which takes them a second."""
        return True

    def where(self, pays: bool) -> "Run":
        """The engine itself where its processes run already or starting them pays, otherwise `SERIAL`."""
        return self if pays or self.started() else SERIAL

    def map(self, work: Callable[[T], R], tasks: Iterable[T]) -> list[R]:
        """All results in the order of the tasks."""
        return list(self.in_order(work, tasks))

    def in_order(self, work: Callable[[T], R], tasks: Iterable[T]) -> Iterator[R]:
        """Results in the order of the tasks, each as soon as those before it are finished.

        >>> list(SerialRun().in_order(abs, [-1, 2]))
        [1, 2]
        """
        waiting: dict[int, R] = {}
        following = 0
        for position, result in self(work, tasks):
            waiting[position] = result
            while following in waiting:
                yield waiting.pop(following)
                following += 1


class SerialRun(Run):
    """One task at a time in this process, when its result is requested.

    Examples
    --------
    >>> list(SerialRun()(abs, [-1, 2]))
    [(0, 1), (1, 2)]
    """

    def __call__(self, work: Callable[[T], R], tasks: Iterable[T]) -> Generator[tuple[int, R], None, None]:
        """Position and result of each task."""
        for position, task in enumerate(tasks):
            yield position, work(task)

    def describe(self) -> str:
        """Description of the engine."""
        return "this process"


SERIAL = SerialRun()
"""The engine of this process."""
