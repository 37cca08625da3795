"""Ctrl-C goes to all processes of a terminal, at any moment: it is the parent's affair, between two steps."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let SIGINT wait until the block ends; processes and threads that start in it never meet it.

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
