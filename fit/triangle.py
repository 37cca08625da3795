"""Triangular factors of blocks of rows (TSQR): least squares of any number of rows in constant memory.

Columns are taken about the mean of their level of a category (about their mean, where there is none). The means
are merged pair by pair, and the difference of two means becomes one more row of the triangle: nothing is squared, so
that ill-conditioned columns keep their digits.

Sources: Demmel, Grigori, Hoemmen & Langou 2012, SIAM J. Sci. Comput. 34, A206 (TSQR); Chan, Golub & LeVeque 1983,
The American Statistician 37, 242 (means).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .least_squares import LinearFit, linear, sums_by

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Triangle:
    """Number, means and triangular factor of rows.

    Attributes
    ----------
    n : ndarray, shape (L,), rows of each level
    mean : ndarray, shape (L, q), of each column in each level; 0 where it has no row
    R : ndarray, shape (min(m, q), q), ``R'R = C'C`` with C the columns about the means of their levels
    """

    n: Array
    mean: Array
    R: Array


def triangle_of(W: Array, level: Index | None = None, levels: int = 1) -> Triangle:
    """Triangle of columns W, shape (m, q), whose rows are of levels numbered 0 to ``levels - 1``."""
    if level is None or levels == 1:
        n, mean = np.array([float(len(W))]), W.mean(axis=0)
        mean = mean + (W - mean).mean(axis=0)  # adds back what rounding took
        return Triangle(n, mean[None], np.asarray(np.linalg.qr(W - mean, mode="r")))
    n = np.bincount(level, minlength=levels).astype(float)
    means = sums_by(level, W, levels) / np.maximum(n, 1)[:, None]
    return Triangle(n, means, np.asarray(np.linalg.qr(W - means[level], mode="r")))


def merged(a: Triangle, b: Triangle) -> Triangle:
    """Triangle of the rows of both; ``b`` may have further levels.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> W = rng.normal(size=(90, 3))
    >>> two = merged(triangle_of(W[:20]), triangle_of(W[20:]))
    >>> bool(np.allclose(two.R.T @ two.R, 89 * np.cov(W.T), rtol=1e-12)), float(two.n[0])
    (True, 90.0)
    """
    more = len(b.n) - len(a.n)
    na, mean = np.pad(a.n, (0, more)), np.pad(a.mean, ((0, more), (0, 0)))
    n = na + b.n
    share = b.n / np.maximum(n, 1)
    apart = b.mean - mean
    R = np.linalg.qr(np.vstack([a.R, b.R, np.sqrt(na * share)[:, None] * apart]), mode="r")
    return Triangle(n, mean + share[:, None] * apart, np.asarray(R))


@dataclass(frozen=True, slots=True)
class Summary:
    """All rows in as few as there are columns: k factors, s indicators of levels, the response last.

    Attributes
    ----------
    n, k : int
        Rows, factors.
    mean : ndarray, shape (k + s + 1,)
    R : ndarray, shape (r, k + s + 1), ``R'R = C'C`` with C the columns about their means
    """

    n: int
    k: int
    mean: Array
    R: Array

    def of(self, keep: Sequence[int]) -> "Summary":
        """With the factors ``keep`` alone."""
        columns = [*keep, *range(self.k, len(self.mean))]
        return Summary(self.n, len(keep), self.mean[columns], self.R[:, columns])


def summary(triangle: Triangle, levels: Index) -> Summary:
    """Summary of rows of these levels, the reference first; the triangle's last column is the response."""
    k, n = triangle.mean.shape[1] - 1, triangle.n[levels]
    shifts = np.eye(len(levels))[:, 1:]
    means = np.hstack([triangle.mean[levels, :k], shifts, triangle.mean[levels, k:]])
    mean = n @ means / n.sum()
    none = np.zeros((len(triangle.R), shifts.shape[1]))
    about = np.hstack([triangle.R[:, :k], none, triangle.R[:, k:]])
    R: Array = np.asarray(np.linalg.qr(np.vstack([np.sqrt(n)[:, None] * (means - mean), about]), mode="r"))
    return Summary(int(n.sum()), k, mean, R[: int(n.sum()) - 1])


def least_squares(rows: Summary) -> LinearFit:
    """Fit of the response on (1, factors, indicators), as of all rows.

    The first row holds the means. It alone has a constant, so that a QR eliminates the constant from the other columns
    without rounding.

    Examples
    --------
    >>> x = np.arange(6.0)
    >>> y = 2 + 3 * x + np.array([0.1, -0.1, 0, 0, -0.1, 0.1])
    >>> fit = least_squares(summary(triangle_of(np.column_stack([x, y])), np.array([0])))
    >>> fit.params.round(6).tolist(), fit.nobs, fit.df_resid
    ([2.0, 3.0], 6, 4)
    """
    A = np.zeros((1 + len(rows.R), 1 + len(rows.mean)))
    A[0] = rows.n**0.5 * np.append(1.0, rows.mean)
    A[1:, 1:] = rows.R
    p = A.shape[1] - 1
    fit = linear(A[:, :p], A[:, p])
    tss = float(rows.R[:, -1] @ rows.R[:, -1])
    return replace(fit, tss=tss, nobs=rows.n, df_model=p - 1, df_resid=rows.n - p)


def equivalent_columns(rows: Summary) -> Array:
    """Few rows, shape (r + 1, k + s + 1), with mean 0 and the sums of squares and products of all rows."""
    from scipy.linalg import helmert

    return np.asarray(helmert(len(rows.R) + 1).T @ rows.R)
