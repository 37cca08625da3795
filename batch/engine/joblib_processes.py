"""Tasks in processes of this machine, by loky as joblib includes it.

It is loky's executor and not `joblib.Parallel`, whose unordered generator goes on submitting tasks while no result is
taken, so that results accumulate in memory; and its own pool, not the one that joblib shares within this process, so
that it can be ended here.
"""

import pickle
import re
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from queue import SimpleQueue
from time import monotonic, sleep
from typing import Any, TypeVar

from ...core.errors import FitmodelsError, UsageError
from ...core.threads import ONE_THREAD
from .base import KEPT, Run, uninterrupted

T = TypeVar("T")
R = TypeVar("R")

AHEAD = 2  # tasks of a process: one running and one waiting; loky accepts no more
TAKEN_IN = 5.0  # s; usually a thousandth of that
IDLE = 60.0  # s after which a process without a task ends, as one whose batch was killed must; others are started
FEEDER = "QueueFeederThread"  # as multiprocessing.queues names it
# glibc returns memory of arrays to the system and gets it again for the next block, which takes a tenth of the time.
KEEP_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(1 << 25), "MALLOC_TRIM_THRESHOLD_": str(1 << 28)}


@dataclass(frozen=True, slots=True)
class Processes(Run):
    """Processes of this machine; made by `processes`.

    Attributes
    ----------
    jobs : int
    executor : concurrent.futures.Executor
    under_way : set of Future
        Tasks that a process may still run.
    begun : threading.Event
        Set with the first task.
    """

    jobs: int
    executor: Executor
    under_way: "set[Future[Any]]" = field(default_factory=set)
    begun: threading.Event = field(default_factory=threading.Event)

    def __call__(self, work: Callable[[T], R], tasks: Iterable[T]) -> Generator[tuple[int, R], None, None]:
        """Position and result of each task, in the order of completion."""
        numbered = enumerate(tasks)
        positions: dict[Future[bytes], int] = {}
        done: SimpleQueue[Future[bytes]] = SimpleQueue()
        try:
            while True:
                for position, task in islice(numbered, AHEAD * self.jobs - len(positions)):
                    positions[self._submit(work, task, done)] = position
                if not positions:
                    return
                future = done.get()  # a wait that may be interrupted: concurrent.futures.wait would leave locks taken
                self.under_way.discard(future)
                yield positions.pop(future), pickle.loads(future.result())  # noqa: S301  from our own process
        except BrokenProcessPool as error:
            raise FitmodelsError(_ended(error, self.jobs)) from None

    def _submit(self, work: Callable[[T], R], task: T, done: "SimpleQueue[Future[bytes]]") -> "Future[bytes]":
        with uninterrupted():  # loky starts its processes, and the thread that restarts them, when work comes in
            future = self.executor.submit(_pickled, work, pickle.dumps(task, pickle.HIGHEST_PROTOCOL))
            self.under_way.add(future)
            self.begun.set()
            future.add_done_callback(done.put)
        return future

    def started(self) -> bool:
        """Whether a task was submitted."""
        return self.begun.is_set()

    def busy(self) -> bool:
        """Whether a process still runs a task; known as soon as loky has accepted the submitted ones.

        Killing them before would end loky's thread with a KeyError, or an InvalidStateError over a cancelled task, and
        this process would wait for that thread for ever.
        """
        until = monotonic() + TAKEN_IN
        while any(not (future.running() or future.done()) for future in self.under_way) and monotonic() < until:
            sleep(0.001)
        return any(not future.done() for future in self.under_way)

    def describe(self) -> str:
        """Description of the engine."""
        return f"{self.jobs} processes (joblib)"


def _pickled(work: Callable[[T], R], task: bytes) -> bytes:
    """The pickled result of a pickled task; loky's own pickler takes three times as long, as it is of Python."""
    return pickle.dumps(work(pickle.loads(task)), pickle.HIGHEST_PROTOCOL)  # noqa: S301  from the process that started


@contextmanager
def processes(jobs: int) -> Iterator[Processes]:
    """Open processes that start with the first task; those that are still at one are killed at the end."""
    try:
        from joblib.externals.loky import ProcessPoolExecutor  # type: ignore[import-untyped]
    except ImportError:
        raise UsageError("joblib is not installed: pip install 'fitmodels[batch]', or run with --jobs 1.") from None
    with warnings.catch_warnings(), _feeders_joined():
        # loky renews a process that has grown by 0.3 GB; as an error this warning would end loky's thread
        warnings.filterwarnings("ignore", "A worker stopped while some jobs were given", UserWarning)
        with uninterrupted():
            executor = ProcessPoolExecutor(jobs, timeout=IDLE, env=ONE_THREAD | KEEP_MEMORY)
        run = Processes(jobs, executor)
        try:
            yield run
        finally:
            with uninterrupted():  # a second Ctrl-C waits until all is closed
                executor.shutdown(wait=True, kill_workers=run.busy())


@contextmanager
def _feeders_joined() -> Iterator[None]:
    """Wait in the end for the threads that fed loky's queues in the block, as its shutdown does not always.

    Such a thread signs off the semaphores of its queue at its very end; where the process ends before, loky's tracker
    of resources complains on standard error.
    """
    before = set(threading.enumerate())
    try:
        yield
    finally:
        for thread in set(threading.enumerate()) - before:
            if thread.name == FEEDER:
                thread.join(TAKEN_IN)


def _ended(error: BrokenProcessPool, jobs: int) -> str:
    codes = re.search(r"\{([^{}]+)\}", str(error))
    how = f" ({codes[1]})" if codes else ""
    return (
        f"one of the {jobs} processes was ended from outside{how}, as the system does when memory runs out: {KEPT}; "
        "use fewer --jobs if memory ran out."
    )
