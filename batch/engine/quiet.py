"""Dask's own words, which are meant for whoever operates a cluster: not on our standard error."""

import logging
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

CHATTER = ("distributed", "tornado")
MUTE = logging.CRITICAL + 1
FOR_CHILDREN = {"DASK_LOGGING__DISTRIBUTED": "critical"}  # read when a worker of our own imports distributed


@contextmanager
def quiet() -> Iterator[None]:
    """Mute the loggers of Dask, which write to standard error, while the block runs.

    What matters is told by our own sentences; workers elsewhere log where they always do.
    """
    import dask
    import distributed  # makes the loggers

    settings = {"distributed.admin.large-graph-warning-threshold": "1 GiB"}  # tasks are handed over a few at a time
    with warnings.catch_warnings(), dask.config.set(settings), _muted():
        # versions are compared by ourselves; Dask's own list of all packages is no sentence
        warnings.simplefilter("ignore", distributed.versions.VersionMismatchWarning)
        yield


@contextmanager
def _muted() -> Iterator[None]:
    names = [name for name in logging.root.manager.loggerDict if name.split(".")[0] in CHATTER]
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
