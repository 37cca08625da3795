from .run_batch import run as run

__all__ = ["run"]
