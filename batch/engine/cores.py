"""How many processes this machine is good for."""

import os


def cores() -> int:
    """Cores that this process may use.

    Examples
    --------
    >>> cores() >= 1
    True
    """
    if hasattr(os, "sched_getaffinity"):  # Linux: fewer than there are, under taskset or a batch system
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
