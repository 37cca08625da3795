"""Tasks in this process, one after the other."""

from collections.abc import Callable, Generator, Iterable
from typing import TypeVar

from .run import Run

T = TypeVar("T")
R = TypeVar("R")


class Here(Run):
    """One task at a time, when its result is asked for.

    Examples
    --------
    >>> list(Here()(abs, [-1, 2]))
    [(0, 1), (1, 2)]
    """

    def __call__(self, work: Callable[[T], R], tasks: Iterable[T]) -> Generator[tuple[int, R], None, None]:
        """Give position and result of each task."""
        for position, task in enumerate(tasks):
            yield position, work(task)

    def describe(self) -> str:
        """Tell where the tasks run."""
        return "this process"
