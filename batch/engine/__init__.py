"""A function over tasks: in this process, in joblib's processes or on a Dask cluster, results as they are done.

Nothing here knows of cutting. joblib and Dask schedule and move data; Dask runs again what a dead worker had.
"""

from ...core.progress import Meter, grouped, progress_bar
from ...core.threads import cores
from .base import Run, largest_memory
from .selection import engine

__all__ = ["Meter", "Run", "cores", "engine", "grouped", "largest_memory", "progress_bar"]
