"""Common to all kinds of sources: suffixes, limits, blocks of pairs, names in a sentence."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from ...core.arrays import Ints
from ...core.rounding import listed
from ...datasets.tables.workbook import SUFFIXES, TEXTS

PARQUET = (".parquet", ".pq", ".parq")
LAB = (*TEXTS, *SUFFIXES)
LARGE = 60_000_000  # bytes of a text file; read whole it takes ten times as much memory
SHOWN = 3  # names in a sentence


def is_large(path: Path) -> bool:
    """Whether a text file is too large to be read whole."""
    return path.suffix.lower() not in SUFFIXES and path.is_file() and path.stat().st_size > LARGE


def some_names(names: Iterable[str]) -> str:
    """The first of several names.

    >>> some_names(["a", "b"]), some_names("abcde")
    ('a, b', 'a, b, c and 2 more')
    """
    return listed(list(names), SHOWN)


STREAMED = 8  # a pair of more rows than eight blocks is streamed: two millions by default


def packed(rows: Sequence[int] | Ints, most_rows: int, most_pairs: int) -> tuple[range, ...]:
    """Cut pairs into blocks of at most ``most_rows`` rows and ``most_pairs`` pairs, with about as many rows each.

    Parameters
    ----------
    rows : sequence of int
        Rows of each pair.
    most_rows, most_pairs : int
        A pair of more than ``most_rows`` rows is a block of its own.

    Returns
    -------
    tuple of range
        Pairs of each block, one after the other.

    Examples
    --------
    >>> packed([10, 10, 10, 90, 10], most_rows=25, most_pairs=64)
    (range(0, 2), range(2, 3), range(3, 4), range(4, 5))
    >>> packed([10] * 5, most_rows=40, most_pairs=64)
    (range(0, 3), range(3, 5))
    """
    ends = np.cumsum(np.asarray(rows, dtype=np.intp))
    blocks = _cut(ends, most_rows, most_pairs)
    if len(blocks) < 2:
        return blocks
    largest = int(np.diff(ends, prepend=0).max())
    even = int(ends[-1]) // len(blocks) + min(largest, most_rows)  # processes end together
    return _cut(ends, min(most_rows, even), most_pairs)


def _cut(ends: Ints, most_rows: int, most_pairs: int) -> tuple[range, ...]:
    """Ranges of pairs, whose rows end at ``ends``, one block after the other as full as it may be."""
    blocks, start, before = [], 0, 0
    while start < len(ends):
        full = int(np.searchsorted(ends, before + most_rows, side="right"))
        stop = min(max(full, start + 1), start + most_pairs, len(ends))
        blocks.append(range(start, stop))
        start, before = stop, int(ends[stop - 1])
    return tuple(blocks)
