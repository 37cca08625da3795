"""Types of arrays, and the usual check of a number."""

from math import isfinite

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def is_positive(value: float) -> bool:
    """Whether a number is finite and above zero.

    >>> is_positive(0.1), is_positive(0.0), is_positive(float('nan'))
    (True, False, False)
    """
    return bool(value > 0 and isfinite(value))
