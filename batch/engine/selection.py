"""Selection of the engine of a batch."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ...core.errors import UsageError
from .base import SERIAL, Run, no_report


@contextmanager
def engine(jobs: int = 1, dask: str | None = None, report: Callable[[str], None] = no_report) -> Iterator[Run]:
    """Open an engine; its processes and connections end with the block, whatever ends that.

    Parameters
    ----------
    jobs : int
        Processes on this machine; 1 is this process. A cluster at an address has its own number.
    dask : str, optional
        ``local`` for a Dask cluster on this machine, a scheduler's ``host:port`` or the path of its scheduler file.
    report : callable
        Receives progress updates.

    Raises
    ------
    UsageError
        ``jobs`` below one, a package that is not installed, a scheduler that does not answer or has no workers, a
        worker with another fitmodels, Python or numpy.
    FitmodelsError
        While it runs: a process was ended from outside, a task ends every worker it meets, the scheduler is gone.

    Examples
    --------
    >>> with engine() as run:
    ...     run.map(abs, [-1, 2]), run.describe()
    ([1, 2], 'this process')
    """
    if jobs < 1:
        raise UsageError(f"--jobs {jobs}: the number of processes is 1 or more.")
    if dask is not None:
        from .dask_cluster import cluster

        with cluster(jobs, dask, report) as run:
            yield run
    elif jobs > 1:
        from .joblib_processes import processes

        with processes(jobs) as run:
            yield run
    else:
        yield SERIAL
