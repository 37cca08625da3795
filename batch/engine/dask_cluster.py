"""A Dask cluster, on this machine or at an address; Dask's own messages are not shown."""

import logging
import os
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from itertools import islice
from math import inf
from time import monotonic, sleep
from typing import TypeVar

from ...core.errors import FitmodelsError, UsageError
from .base import KEPT, Run, uninterrupted
from .dask_scheduler import OfDask, no_answer, refuse_other_versions, scheduler_address

LOGGERS = ("distributed", "tornado")
MUTE = logging.CRITICAL + 1
FOR_CHILDREN = {"DASK_LOGGING__DISTRIBUTED": "critical"}  # read when a worker of our own imports distributed


@contextmanager
def quiet() -> Iterator[None]:
    """Disable the loggers of Dask, which write to standard error, while the block runs.

    Our own messages report what matters; remote workers log as usual.
    """
    import dask
    import distributed  # makes the loggers

    settings = {"distributed.admin.large-graph-warning-threshold": "1 GiB"}  # few tasks are submitted at a time
    with warnings.catch_warnings(), dask.config.set(settings), _muted():
        # refuse_other_versions compares versions instead
        warnings.simplefilter("ignore", distributed.versions.VersionMismatchWarning)
        yield


@contextmanager
def _muted() -> Iterator[None]:
    names = [name for name in logging.root.manager.loggerDict if name.split(".")[0] in LOGGERS]
    levels = {name: logging.getLogger(name).level for name in names}
    for name in names:
        if levels[name] != logging.NOTSET:
            logging.getLogger(name).setLevel(MUTE)
    try:
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


@contextmanager
def in_environment(values: dict[str, str]) -> Iterator[None]:
    """Set variables of the environment that processes started in the block find; afterwards it is as it was.

    A nanny of Dask adds some of its own, which would slow whatever is started from this process later.
    """
    before = dict(os.environ)
    os.environ.update(values)
    try:
        yield
    finally:
        for name in set(os.environ) - set(before):
            del os.environ[name]
        os.environ.update(before)


T = TypeVar("T")
R = TypeVar("R")

AHEAD = 4  # tasks of a thread: it works on while results are transferred
ANSWER = 5.0  # s in which a scheduler answers
OLD = 2.0  # s for which the number of threads is kept: workers come and go
ARRIVAL = 10.0  # s in which the first worker joins
RETURN = 60.0  # s in which one joins again after all have left
OTHER_COPY = "Error during deserialization of the task graph"  # message of a scheduler that cannot import its parts
# By default Dask workers return memory to the system after every task, which makes a fit up to half slower.
NO_TRIMMING = {"distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None}
GLANCE = 0.005  # s between looks for a result


@dataclass(frozen=True, slots=True)
class Cluster(Run):
    """A Dask cluster; made by `cluster`.

    Attributes
    ----------
    client : distributed.Client
    address : str
        As the user wrote it.
    """

    client: OfDask
    address: str

    def __call__(self, work: Callable[[T], R], tasks: Iterable[T]) -> Generator[tuple[int, R], None, None]:
        """Position and result of each task, in the order of completion."""
        numbered = enumerate(tasks)
        positions: dict[OfDask, int] = {}  # by future: whoever holds one holds its result
        arriving = import_module("distributed").as_completed(
            loop=self.client.loop, with_results=True, raise_errors=False
        )
        threads = CachedNumber(self._threads)
        try:
            while True:
                with uninterrupted():
                    free = max(AHEAD * threads(), AHEAD) - len(positions)
                    fresh = list(islice(numbered, max(free, 0)))
                    futures = self._submit(work, [task for _, task in fresh])
                    positions.update(zip(futures, (position for position, _ in fresh), strict=True))
                    arriving.update(futures)
                    del futures
                if not positions:
                    return
                for future, result in self._next(arriving, threads):
                    position = positions.pop(future)
                    self._check(future, result)
                    future.release()
                    yield position, result
        finally:
            with uninterrupted():
                for future in positions:  # Dask forgets the tasks that have not begun
                    future.release()

    def _submit(self, work: Callable[[T], R], tasks: list[T]) -> list[OfDask]:
        try:
            return list(self.client.map(work, tasks, pure=False)) if tasks else []
        except import_module("distributed.client").ClosedClientError:
            raise FitmodelsError(_lost_scheduler(self.address)) from None

    def _next(self, arriving: OfDask, threads: "CachedNumber") -> list[tuple[OfDask, OfDask]]:
        """Wait for results, but only for a limited time for workers; Dask itself waits without limit."""
        seen = monotonic()
        while True:
            with uninterrupted():
                if arriving.has_ready():
                    return list(arriving.next_batch())
                if threads():
                    seen = monotonic()
            if monotonic() - seen > RETURN:
                raise FitmodelsError(_no_workers(self.address))
            sleep(GLANCE)

    def _threads(self) -> int:
        """Threads of all workers."""
        try:
            return int(self.client.scheduler_info(0)["total_threads"])
        except OSError:
            raise FitmodelsError(_lost_scheduler(self.address)) from None

    def _check(self, future: OfDask, result: OfDask) -> None:
        """Raise the exception of a task, or one for a lost task.

        A received result is valid, even if its worker is lost by now and the future is marked so.
        """
        if future.status not in ("error", "cancelled"):
            return
        error = result[1] if isinstance(result, tuple) else result
        if isinstance(error, import_module("distributed").KilledWorker):
            raise FitmodelsError(_killed_workers(error)) from None
        if str(error).startswith(OTHER_COPY):
            raise UsageError(_other_copy(self.address)) from None
        if future.status == "error":
            raise error
        raise FitmodelsError(_lost_scheduler(self.address))

    def describe(self) -> str:
        """Description of the engine."""
        workers = self.client.scheduler_info(0)["n_workers"]
        name = "local Dask cluster" if self.address == "local" else f"Dask cluster {self.address}"
        return f"{name}, {workers} worker{'s' * (workers != 1)}"


@dataclass(slots=True)
class CachedNumber:
    """A number that is requested again when it is older than `OLD` seconds."""

    ask: Callable[[], int]
    answer: int = 0
    since: float = -inf

    def __call__(self) -> int:
        """The number."""
        if monotonic() - self.since > OLD:
            self.answer, self.since = self.ask(), monotonic()
        return self.answer


@contextmanager
def cluster(jobs: int, address: str, report: Callable[[str], None]) -> Iterator[Cluster]:
    """Open a Dask cluster of ``jobs`` processes on this machine (``local``), or the one at an address."""
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise UsageError("dask is not installed: pip install 'fitmodels[dask]'.") from None
    with quiet(), ExitStack() as stack:
        if address == "local":
            report(f"starting a Dask cluster of {jobs} processes")
            client = stack.enter_context(_local(jobs))
        else:
            report(f"connecting to the Dask scheduler {address}")
            client = stack.enter_context(_elsewhere(address))
            _wait_for_workers(client, address, report)
        refuse_other_versions(client, address)
        yield Cluster(client, address)


@contextmanager
def _local(jobs: int) -> Iterator[OfDask]:
    import dask

    distributed = import_module("distributed")
    with ExitStack() as stack:
        stack.enter_context(in_environment(FOR_CHILDREN))  # a nanny starts workers again: they read it, too
        stack.enter_context(dask.config.set(NO_TRIMMING))
        with uninterrupted():  # nor for the thread that starts them again
            processes = distributed.LocalCluster(
                n_workers=jobs, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0", silence_logs=MUTE
            )
        stack.enter_context(processes)
        with uninterrupted():
            client = stack.enter_context(distributed.Client(processes, set_as_default=False))
        try:
            yield client
        finally:
            with uninterrupted():  # a second Ctrl-C waits until all is closed
                with suppress(Exception):  # a worker that is just being started again would complain of an end
                    client.wait_for_workers(jobs, timeout=ANSWER)
                stack.close()


@contextmanager
def _elsewhere(address: str) -> Iterator[OfDask]:
    where = scheduler_address(address, ANSWER)
    try:
        with uninterrupted():
            client = import_module("distributed").Client(where, timeout=ANSWER, set_as_default=False)
    except (OSError, ImportError) as error:
        raise UsageError(no_answer(address, " ".join(str(error).split()))) from None
    try:
        yield client
    finally:
        with uninterrupted():  # a second Ctrl-C waits until all is closed
            client.close()


def _wait_for_workers(client: OfDask, address: str, report: Callable[[str], None]) -> None:
    report(f"waiting for a worker of the Dask scheduler {address}")
    try:
        client.wait_for_workers(1, timeout=ARRIVAL)
    except TimeoutError:
        raise UsageError(
            f"the Dask scheduler {address} has no workers, and none came within {ARRIVAL:g} s: start one or more with "
            f"'dask worker {client.scheduler.address}', on machines that have this fitmodels."
        ) from None


def _killed_workers(error: OfDask) -> str:
    return (
        f"one task ended {error.allowed_failures + 1} Dask workers in succession (the last was "
        f"{error.last_worker.address}), as happens when it needs more memory than a worker may have: {KEPT}; "
        "use workers with more memory ('dask worker --memory-limit')."
    )


def _lost_scheduler(address: str) -> str:
    return f"the connection to the Dask scheduler {address} is lost: {KEPT}, once a scheduler and workers run."


def _no_workers(address: str) -> str:
    return f"all workers of the Dask scheduler {address} have been gone for {RETURN:g} s: {KEPT}, once workers run."


def _other_copy(address: str) -> str:
    return (
        f"the Dask cluster {address} cannot unpack the tasks: its scheduler and workers have another copy of fitmodels "
        "with the same version number; install the same copy there and start them again."
    )
