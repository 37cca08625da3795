"""Apache Arrow, for the modules beside this one; without it they say in one sentence how to get it."""

from ...core.errors import UsageError

try:
    import pyarrow as pa  # type: ignore[import-untyped]
    import pyarrow.compute as pc  # type: ignore[import-untyped]
    import pyarrow.parquet as pq  # type: ignore[import-untyped]
except ImportError:
    raise UsageError("pyarrow is not installed: pip install 'fitmodels[batch]'.") from None

__all__ = ["UNREADABLE", "pa", "pc", "pq", "why"]

UNREADABLE = (pa.ArrowException, OSError, ValueError, MemoryError)
"""What a damaged file may raise: a size that the damage made enormous ends as MemoryError."""


def why(error: BaseException) -> str:
    r"""The first line of what Arrow says, short enough for a sentence.

    >>> why(OSError("Corrupt snappy compressed data.\nIn file.cc"))
    'Corrupt snappy compressed data'
    """
    first = (str(error).strip() or type(error).__name__).splitlines()[0].rstrip(". ")
    return first if len(first) <= 200 else f"{first[:200]} ..."
