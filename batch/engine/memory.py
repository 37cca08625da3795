"""The largest memory that this process has held."""

import sys
from pathlib import Path

STATUS = Path("/proc/self/status")


def largest_memory() -> int:
    """Tell the peak of this process's resident memory, in bytes; 0 where the system (Windows) does not tell it.

    On Linux it is VmHWM of proc_pid_status(5): ``ru_maxrss`` of getrusage(2), which other systems have, begins there
    with the memory of the process that started this one.

    Examples
    --------
    >>> largest_memory() > 1e7
    True
    """
    told = [line for line in STATUS.read_text().splitlines() if line.startswith("VmHWM:")] if STATUS.exists() else []
    if told:
        return int(told[0].split()[1]) * 1024
    try:
        import resource
    except ImportError:
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024  # bytes on macOS, kibibytes elsewhere
