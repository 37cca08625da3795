"""Pairs are packed into blocks: in a fixed order, by their rows alone, so that numbers do not depend on the workers."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.intp]

STREAMED = 8  # a pair of more than eight blocks' rows is not held whole: two millions by default


def packed(rows: Sequence[int] | Ints, most_rows: int, most_pairs: int) -> tuple[range, ...]:
    """Cut pairs into blocks of at most ``most_rows`` rows and ``most_pairs`` pairs.

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
    """
    cuts, held = [0], 0
    for i, n in enumerate(np.asarray(rows).tolist()):
        if i > cuts[-1] and (held + n > most_rows or i - cuts[-1] >= most_pairs):
            cuts.append(i)
            held = 0
        held += n
    ends = [*cuts[1:], len(rows)]
    return tuple(range(start, stop) for start, stop in zip(cuts, ends, strict=True) if stop > start)
