from .result import Batch as Batch
from .run_batch import run as run

__all__ = ["Batch", "run"]
