"""Types of arrays, the scale of a median absolute deviation, and the usual check of a number."""

from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.intp]
Flags = NDArray[np.bool_]
Texts = NDArray[np.object_]
MAD = 1.4826  # standard deviation of a normal distribution per median absolute deviation


def numbers_of_runs(keys: NDArray[np.integer[Any]]) -> tuple[Ints, Ints]:
    """Number of the value of each of n whole numbers, in order of appearance, and where each of K values is first.

    As ``pandas.factorize``, but equal values that stand together are looked up once: an eighth of the time for rows in
    order of their pairs.

    Returns
    -------
    numbers : ndarray of int, shape (n,)
    first : ndarray of int, shape (K,)

    Examples
    --------
    >>> numbers, first = numbers_of_runs(np.array([7, 7, 3, 7]))
    >>> numbers.tolist(), first.tolist()
    ([0, 0, 1, 0], [0, 2])
    """
    import pandas as pd

    changes = np.ones(len(keys), dtype=bool)
    np.not_equal(keys[1:], keys[:-1], out=changes[1:])
    starts = np.flatnonzero(changes)
    numbers, unique = pd.factorize(keys[starts])
    first = np.empty(len(unique), dtype=np.intp)
    first[numbers[::-1]] = starts[::-1]
    return np.repeat(numbers, np.diff(starts, append=len(keys))), first


def is_positive(value: float) -> bool:
    """Whether a number is finite and above zero.

    >>> is_positive(0.1), is_positive(0.0), is_positive(float('nan'))
    (True, False, False)
    """
    return bool(value > 0 and isfinite(value))
