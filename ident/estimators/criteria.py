"""What an order costs: information criteria and final prediction error of a least-squares fit.

``loss`` is rss / n in unit_y squared, n the rows that every order shares, k = na + nb. The first three are -2 ln
likelihood of normal residuals, less what all orders share; fpe and mdl are in the unit of the loss.
Sources: Akaike 1969, 1974; Schwarz 1978; Hurvich & Tsai 1989; Rissanen 1978 in the form of Ljung 1999, section 16.4.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def aic(loss: Array, k: Array, n: int) -> Array:
    """Akaike's: n ln V + 2 k."""
    return np.asarray(n * np.log(loss) + 2 * k)


def aicc(loss: Array, k: Array, n: int) -> Array:
    """AIC with its small-sample term 2 k (k + 1) / (n - k - 1)."""
    return np.asarray(aic(loss, k, n) + 2 * k * (k + 1) / np.maximum(n - k - 1, 0.5))


def bic(loss: Array, k: Array, n: int) -> Array:
    """Schwarz's: n ln V + k ln n."""
    return np.asarray(n * np.log(loss) + k * np.log(n))


def fpe(loss: Array, k: Array, n: int) -> Array:
    """V (1 + k / n) / (1 - k / n): the loss to expect on new data of the same kind."""
    return np.asarray(loss * (n + k) / (n - k))


def mdl(loss: Array, k: Array, n: int) -> Array:
    """V (1 + k ln n / n)."""
    return np.asarray(loss * (1 + k * np.log(n) / n))


CRITERIA: dict[str, Callable[[Array, Array, int], Array]] = {
    "aic": aic,
    "aicc": aicc,
    "bic": bic,
    "fpe": fpe,
    "mdl": mdl,
}
