"""Least squares of any number of rows from a triangular factor of their columns about the means.

The columns of the response are about a first law, whose parameters are added to those of the fit: nothing is squared,
so that ill-conditioned columns and small residuals keep their digits.

Source: Demmel, Grigori, Hoemmen & Langou 2012, SIAM J. Sci. Comput. 34, A206 (TSQR).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Array
from .least_squares import LinearFit, linear


@dataclass(frozen=True, slots=True)
class Summary:
    """All rows in as few as there are columns: k factors, s indicators of levels, the response less a law last.

    Attributes
    ----------
    n, k : int
        Rows, factors.
    mean : ndarray, shape (k + s + 1,)
    R : ndarray, shape (r, k + s + 1), ``R'R = C'C`` with C the columns about their means
    base : ndarray, shape (k + 1,)
        The law that was subtracted from the response: the logarithm of its constant, then the exponents.
    """

    n: int
    k: int
    mean: Array
    R: Array
    base: Array

    def of(self, keep: Sequence[int]) -> "Summary":
        """With the factors ``keep`` alone; the response gets back what the law took for the others."""
        gone = [j for j in range(self.k) if j not in keep]
        back = np.zeros(len(self.mean))
        back[gone], back[-1] = self.base[1:][gone], 1.0
        columns = [*keep, *range(self.k, len(self.mean) - 1)]
        return Summary(
            self.n,
            len(keep),
            np.append(self.mean[columns], self.mean @ back),
            np.column_stack([self.R[:, columns], self.R @ back]),
            np.append(self.base[0], self.base[1:][list(keep)]),
        )


def least_squares(rows: Summary) -> LinearFit:
    """Fit of the response on (1, factors, indicators), as of all rows.

    The first row holds the means. It alone has a constant, so that a QR eliminates the constant from the other columns
    without rounding.

    Examples
    --------
    >>> x = np.array([-2.5, -1.5, -0.5, 0.5, 1.5, 2.5])
    >>> y = 3 * x + np.array([0.1, -0.1, 0, 0, -0.1, 0.1])
    >>> fit = least_squares(Summary(6, 1, np.array([2.5, 2.0]), np.column_stack([x, y]), np.array([7.5, 1.0])))
    >>> fit.params.round(6).tolist(), fit.nobs, fit.df_resid
    ([2.0, 4.0], 6, 4)
    """
    A = np.zeros((1 + len(rows.R), 1 + len(rows.mean)))
    A[0] = rows.n**0.5 * np.append(1.0, rows.mean)
    A[1:, 1:] = rows.R
    p = A.shape[1] - 1
    fit = linear(A[:, :p], A[:, p])
    base = np.append(rows.base, np.zeros(p - 1 - rows.k))
    y = rows.R[:, -1] + rows.R[:, :-1] @ base[1:]
    return replace(fit, params=fit.params + base, tss=float(y @ y), nobs=rows.n, df_model=p - 1, df_resid=rows.n - p)


def equivalent_columns(rows: Summary) -> Array:
    """Few rows, shape (r + 1, k + s + 1), with mean 0 and the sums of squares and products of all rows."""
    from scipy.linalg import helmert

    return np.asarray(helmert(len(rows.R) + 1).T @ rows.R)


def in_rows(A: Array, most: int) -> Array:
    """Triangle of rows A, in at most as many rows as their rank is; of permuted columns where these are more.

    Examples
    --------
    >>> in_rows(np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 6.1]]), 2).shape
    (2, 3)
    """
    if most >= A.shape[1]:
        return np.asarray(np.linalg.qr(A, mode="r"))
    from scipy.linalg import qr

    R, order = qr(A, mode="r", pivoting=True)  # the rows that go hold rounding alone
    found = np.zeros((most, A.shape[1]))
    found[:, order] = R[:most]
    return found


def square_roots(square: Array) -> tuple[Array, Array]:
    """Rows, shape (G, r, q), whose sums of products are ``square``, and their squared singular values, shape (G, r).

    There are as many rows as columns that change in any group. These are scaled to one length first, so that a long one
    does not round away a short one.

    Examples
    --------
    >>> values, rows = square_roots(np.array([[[4.0, 0.0], [0.0, 0.0]]]))
    >>> values.tolist(), np.abs(rows).tolist()
    ([[1.0]], [[[2.0, 0.0]]])
    """
    length = np.sqrt(np.einsum("gii->gi", square))
    moves = np.flatnonzero(length.any(axis=0))
    length[length == 0] = 1.0
    scaled = square / length[:, :, None] / length[:, None, :]
    value, vector = np.linalg.eigh(scaled[:, moves[:, None], moves])
    rows = np.zeros((len(square), len(moves), square.shape[1]))
    rows[:, :, moves] = np.sqrt(np.maximum(value, 0.0))[:, :, None] * vector.transpose(0, 2, 1)
    return value, rows * length[:, None, :]
