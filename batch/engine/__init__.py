"""A function over tasks: in this process, in joblib's processes or on a Dask cluster, results as they are done.

Nothing here depends on cutting. joblib and Dask schedule and move data; Dask repeats the tasks of a dead worker.
"""

from .base import SERIAL, Run, SerialRun, largest_memory
from .selection import engine

__all__ = ["SERIAL", "Run", "SerialRun", "engine", "largest_memory"]
