"""What every engine offers, wherever its tasks run."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


class Run(ABC):
    """Runs a function over tasks; made by `engine`.

    The function is one that workers can import. What it raises comes out here as it is, and no task is tried again
    for it. Only as many tasks are under way as keep the workers busy, so that results wait for whoever takes them.
    """

    @abstractmethod
    def __call__(self, work: Callable[[T], R], tasks: Iterable[T]) -> Generator[tuple[int, R], None, None]:
        """Give the position of a task and its result, in the order in which they are done.

        Closing the iterator stops the work: no more tasks are handed out, and those at hand end with the engine.
        """

    @abstractmethod
    def describe(self) -> str:
        """Tell where the tasks run."""

    def map(self, work: Callable[[T], R], tasks: Iterable[T]) -> list[R]:
        """Give all results in the order of the tasks."""
        results = dict(self(work, tasks))
        return [results[position] for position in range(len(results))]
