"""Tasks on several processes, results in their order."""

import gc
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context
from threading import current_thread, main_thread
from typing import TypeVar

from ...core.errors import FitmodelsError

T = TypeVar("T")
R = TypeVar("R")

FEW = 50  # pieces that are done here before another process has begun
AT_ONCE = 4  # pieces handed to a process: enough that the way costs nothing, few enough that none waits at the end


def each(work: Callable[[T], R], pieces: Sequence[T], jobs: int, progress: Callable[[int], None]) -> list[R]:
    """Results of ``work`` for each piece; ``progress`` receives the number done.

    Parameters
    ----------
    work : callable
        Of a module, so that another process finds it.
    pieces : sequence
    jobs : int
        Processes; with one, or few pieces, all is done here.
    progress : callable

    Raises
    ------
    FitmodelsError
        A process was ended from outside, as it is where memory runs out.

    Examples
    --------
    >>> each(abs, [-2, 1], 1, lambda done: None)
    [2, 1]
    """
    if jobs == 1 or len(pieces) < FEW:
        return _here(work, pieces, progress)
    # begun afresh: a copy of a process with threads may hang
    pool = ProcessPoolExecutor(min(jobs, len(pieces)), get_context("spawn"), gc.disable)
    results: list[R] = []
    try:
        with _ignoring_interrupts():
            begun = pool.map(partial(_done, work), pieces, chunksize=AT_ONCE)
        for result in begun:
            results.append(result)
            progress(len(results))
    except BrokenProcessPool:
        raise FitmodelsError(
            "a process that writes cards was ended from outside, perhaps for lack of memory; "
            f"nothing was written. Run it again with --jobs 1 instead of {jobs}."
        ) from None
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
    return results


def _here(work: Callable[[T], R], pieces: Sequence[T], progress: Callable[[int], None]) -> list[R]:
    results: list[R] = []
    for piece in pieces:
        results.append(_done(work, piece))
        progress(len(results))
    return results


def _done(work: Callable[[T], R], piece: T) -> R:
    """The result; what a page leaves behind, which refers to itself, is freed at once, as the collector is off."""
    result = work(piece)
    gc.collect(0)
    return result


@contextmanager
def _ignoring_interrupts() -> Iterator[None]:
    """Processes started inside ignore an interrupt from the keyboard: the process that waits for them ends them."""
    if current_thread() is not main_thread():
        yield
        return
    heard = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, heard)
