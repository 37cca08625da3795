"""Are residuals normal: Anderson and Darling's test.

Sources: Anderson & Darling 1954, J. Am. Stat. Assoc. 49, 765, with the p-values of D'Agostino & Stephens 1986,
Goodness-of-Fit Techniques, table 4.9.
"""

from dataclasses import dataclass

import numpy as np

from ...core.display import Displayable
from ..available import NotAvailable
from .check import concern_of, p_in_words
from .columns import Array
from .residuals import Residuals

FEWEST = 8  # values below which the p-value of Anderson and Darling's statistic is not known
# Anderson-Darling for normality, mean and variance estimated: (upper end, a, b, c) of p = exp(a + b A + c A^2),
# or of 1 - p where A is below .34 (table 4.9).
STEPHENS = ((0.2, -13.436, 101.14, -223.73), (0.34, -8.318, 42.796, -59.938), (0.6, 0.9177, -4.279, -1.38))
STEPHENS_TAIL, STEPHENS_END = (1.2937, -5.709, 0.0186), 13.0


@dataclass(frozen=True, slots=True, repr=False)
class Normality(Displayable):
    """Anderson-Darling test of residuals, mean and variance estimated.

    Attributes
    ----------
    of : str
        Which residuals, as in :class:`Residuals`.
    nobs : int
    statistic : float
        ``A^2``; the p-value is that of ``A^2 (1 + 0.75/n + 2.25/n^2)``.
    pvalue : float
    """

    of: str
    nobs: int
    statistic: float
    pvalue: float

    @property
    def null(self) -> str:
        """What the test takes for granted until it rejects it."""
        return f"residuals of {self.of} are normal on the scale of the fit"

    @property
    def df(self) -> None:
        """None: the statistic has a distribution of its own."""
        return

    @property
    def concern(self) -> int:
        """0 fine, 1 below .05, 2 below .001. Cause: outliers or the wrong error structure."""
        return concern_of(self.pvalue)

    @property
    def brief(self) -> str:
        """The finding in a few words."""
        return f"normal residuals of {self.of} {p_in_words(self.pvalue)}"

    @property
    def verdict(self) -> str:
        """One sentence: what was found and what to do."""
        found = f"Anderson-Darling {self.statistic:.2f}, {p_in_words(self.pvalue)}, {self.nobs} residuals"
        if self.concern:
            return (
                f"Residuals of {self.of} are not normal ({found}): look for outliers; prediction intervals are the "
                "least to be trusted."
            )
        return f"Residuals of {self.of} look normal ({found})."


def normality(residuals: Residuals) -> Normality | NotAvailable:
    """Anderson-Darling test of a set of residuals."""
    n = len(residuals.values)
    if residuals.free < FEWEST:
        return NotAvailable(
            f"residuals of {residuals.of} have {residuals.free} degrees of freedom: their shape shows from {FEWEST} on"
        )
    statistic, p = anderson_darling(residuals.values)
    return Normality(residuals.of, n, statistic, p)


def anderson_darling(x: Array) -> tuple[float, float]:
    """``A^2`` and p-value of the Anderson-Darling test of normality, mean and variance estimated.

    Parameters
    ----------
    x : ndarray, shape (n,), n at least 8, not all equal

    Examples
    --------
    >>> A, p = anderson_darling(np.array([1.0, 2, 3, 4, 5, 6, 7, 8, 9, 40]))
    >>> round(A, 2), p < 0.001
    (1.74, True)
    """
    from scipy.special import log_ndtr

    n = len(x)
    z = np.sort((x - x.mean()) / x.std(ddof=1))
    A2 = -n - float(((2 * np.arange(1, n + 1) - 1) * (log_ndtr(z) + log_ndtr(-z[::-1]))).sum()) / n
    A = A2 * (1 + 0.75 / n + 2.25 / n**2)
    for end, a, b, c in STEPHENS:
        if end > A:
            p = float(np.exp(a + b * A + c * A**2))
            return A2, 1 - p if end < 0.6 else p
    a, b, c = STEPHENS_TAIL
    shown = min(A, STEPHENS_END)  # beyond it the parabola would turn up again
    return A2, float(np.exp(a + b * shown + c * shown**2))
