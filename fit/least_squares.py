"""Plain linear least squares: one QR of the centred, column-scaled matrix; sums and products of columns by group.

Every law is fitted by it. Centring takes the constant out of the other columns,
scaling makes their lengths one, and a Householder QR never squares the condition number; together they
keep the digits that the normal equations and a pseudo-inverse lose on ill-conditioned designs.

Source: Golub & Van Loan, Matrix Computations, section 5.3 (QR of the augmented matrix [X y]).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Array, Ints
from ..core.display import Plottable
from ..core.errors import FitError

# A scaled column whose part outside the span of the columns before it is shorter than this is no column
# of its own. Filip's tenth power, the hardest certified set, keeps 6e-8; an exact copy keeps about 1e-16.
DEPENDENT = 1e-13


@dataclass(frozen=True, slots=True, repr=False)
class LinearFit(Plottable):
    """A linear least-squares fit ``y = X params + e`` and its row statistics.

    Attributes
    ----------
    params : ndarray, shape (k,)
        Coefficients in the order of the columns of X.
    cov_unscaled : ndarray, shape (k, k)
        ``(X'X)^-1``; times ``scale`` it is the covariance of the parameters.
    rss : float
        Residual sum of squares.
    tss : float
        Sum of squares of y about its mean (about zero where X has no constant column).
    nobs, df_model, df_resid : int
        Rows, slopes, and rows less columns.
    """

    params: Array
    cov_unscaled: Array
    rss: float
    tss: float
    nobs: int
    df_model: int
    df_resid: int

    @property
    def scale(self) -> float:
        """Residual variance; NaN where no degree of freedom is left."""
        return self.rss / self.df_resid if self.df_resid > 0 else float("nan")

    @property
    def cov_params(self) -> Array:
        """Covariance of the parameters, shape (k, k)."""
        return self.scale * self.cov_unscaled

    @property
    def bse(self) -> Array:
        """Standard errors, shape (k,)."""
        return np.asarray(np.sqrt(self.scale * np.diag(self.cov_unscaled)), dtype=float)

    @property
    def rsquared(self) -> float:
        """Share of ``tss`` that the fit explains; 1 where y does not vary and is met exactly."""
        return 1.0 - self.rss / self.tss if self.tss > 0 else float(self.rss == 0)

    @property
    def fvalue(self) -> float:
        """F of all slopes together against the residual; infinite for an exact fit, NaN without df."""
        if self.df_model == 0 or self.df_resid == 0:
            return float("nan")
        if self.rss == 0:
            return float("inf")
        return (self.tss - self.rss) / self.df_model / self.scale


def linear(X: ArrayLike, y: ArrayLike) -> LinearFit:
    """Fit ``y = X b`` by least squares.

    Parameters
    ----------
    X : array, shape (n, k)
        Regressors. A constant column in any position is the intercept; without one there is none.
    y : array, shape (n,)

    Raises
    ------
    FitError
        Fewer rows than columns, values that are not finite, or a column that the others already hold.

    Examples
    --------
    >>> fit = linear([[1, 1.0], [1, 2.0], [1, 3.0], [1, 4.0]], [2.0, 4.1, 5.9, 8.0])
    >>> fit.params.round(3).tolist()
    [0.05, 1.98]
    """
    X, y = _checked(X, y)
    n, k = X.shape
    constant = _constant_column(X)
    others = [j for j in range(k) if j != constant]
    W, means, lengths = _standardised(X[:, others], centre=constant is not None)
    y_mean = float(_mean(y)) if constant is not None else 0.0
    unit = [np.full((n, 1), n**-0.5)] if constant is not None else []
    R: Array = np.asarray(np.linalg.qr(np.hstack([*unit, W, (y - y_mean)[:, None]]), mode="r"))
    _refuse_dependent(R[:k, :k], ([constant] if constant is not None else []) + others)
    T = _back_to_columns(means, lengths, n, constant, others)
    if constant is not None:  # its column need not hold ones
        T[constant] /= X[0, constant]
    inverse = _upper_inverse(R[:k, :k])
    params = T @ (inverse @ R[:k, k])
    if constant is not None:
        params[constant] += y_mean / X[0, constant]
    root = T @ inverse
    rss = float(R[k, k] ** 2) if n > k else 0.0
    return LinearFit(
        params=params,
        cov_unscaled=root @ root.T,
        rss=rss,
        tss=float(np.sum((y - y_mean) ** 2)),
        nobs=n,
        df_model=k - (constant is not None),
        df_resid=n - k,
    )


def _checked(X: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    try:
        A: Array = np.asarray(X, dtype=float)
        v: Array = np.asarray(y, dtype=float)
    except (TypeError, ValueError):
        raise FitError("X or y holds something else than numbers; give arrays of the shapes (n, k) and (n,).") from None
    if A.ndim != 2 or v.shape != (len(A),):
        raise FitError(f"X has shape {A.shape} and y {v.shape}; they need the shapes (n, k) and (n,).")
    if not A.size:
        raise FitError(f"X has shape {A.shape}: a fit needs at least one row and one column.")
    if len(A) < A.shape[1]:
        raise FitError(
            f"{len(A)} rows for {A.shape[1]} parameters: add rows or leave out {A.shape[1] - len(A)} columns."
        )
    with np.errstate(invalid="ignore"):  # inf - inf
        finite = np.isfinite(A.sum()) and np.isfinite(v.sum())  # a sum shows NaN and infinity in one pass
    if not finite:
        raise FitError("X or y holds NaN or infinity: leave those rows out before fitting.")
    return A, v


def _constant_column(X: Array) -> int | None:
    """Position of the first constant, non-zero column."""
    for j in np.flatnonzero((X[0] == X[-1]) & (X[0] != 0)):
        if np.all(X[:, j] == X[0, j]):
            return int(j)
    return None


def _mean(a: Array) -> Array:
    """Mean in two passes: the second adds back what rounding took from the first."""
    first = a.mean(axis=0)
    return np.asarray(first + (a - first).mean(axis=0))


def _standardised(X: Array, centre: bool) -> tuple[Array, Array, Array]:
    means = _mean(X) if centre else np.zeros(X.shape[1])
    W = X - means
    lengths = np.sqrt(np.einsum("ij,ij->j", W, W))
    lengths[lengths == 0] = 1.0
    W /= lengths
    return W, means, lengths


def _refuse_dependent(R: Array, order: list[int]) -> None:
    short = np.flatnonzero(np.abs(np.diag(R)) < DEPENDENT)
    if short.size:
        raise FitError(f"column {order[short[0]]} of X is a linear combination of the columns before it: leave it out.")


def _upper_inverse(R: Array) -> Array:
    """Inverse of an upper triangular matrix by back substitution, column by column."""
    k = len(R)
    inverse = np.zeros((k, k))
    for i in range(k - 1, -1, -1):
        inverse[i, i] = 1.0
        inverse[i] = (inverse[i] - R[i, i + 1 :] @ inverse[i + 1 :]) / R[i, i]
    return inverse


def _back_to_columns(means: Array, lengths: Array, n: int, constant: int | None, others: list[int]) -> Array:
    """Matrix that takes the coefficients of the standardised columns to those of X."""
    k = len(others) + (constant is not None)
    T = np.zeros((k, k))
    first = k - len(others)
    T[others, np.arange(first, k)] = 1.0 / lengths
    if constant is not None:
        T[constant, 0] = n**-0.5
        T[constant, 1:] = -means / lengths
    return T


def sums_by(group: Ints, A: Array, G: int) -> Array:
    """Sum of each column of A over the rows of each of G groups (edges, levels), shape (G, k).

    Examples
    --------
    >>> sums_by(np.array([0, 1, 1]), np.array([[1.0], [2.0], [3.0]]), 2).tolist()
    [[1.0], [5.0]]
    """
    sums = np.empty((G, A.shape[1]))
    for j, column in enumerate(A.T):
        sums[:, j] = np.bincount(group, weights=column, minlength=G)
    return sums


def products_by(group: Ints, A: Array, G: int) -> Array:
    """Sums of products ``A_g' A_g`` of the rows of each of G groups, shape (G, k, k)."""
    k = A.shape[1]
    out = np.empty((G, k, k))
    for i in range(k):
        for j in range(i + 1):
            out[:, i, j] = out[:, j, i] = np.bincount(group, weights=A[:, i] * A[:, j], minlength=G)
    return out


@dataclass(frozen=True, slots=True)
class Grams:
    """Gram matrices of G groups of rows with q columns, about the means of the groups.

    Attributes
    ----------
    size : ndarray, shape (G,)
        Rows of each group.
    first, mean : ndarray, shape (q, G)
        First value of each column, and its mean.
    square : ndarray, shape (q, q, G)
        Sums of products about the means.
    about : ndarray, shape (q, N)
        The columns less the means of their groups.
    """

    size: Array
    first: Array
    mean: Array
    square: Array
    about: Array


def grams_by(W: Array, starts: Ints) -> Grams:
    """Gram matrices of groups of rows that stand together.

    A column that is constant in a group has sums of exactly zero, and its level takes no digits of the changes.

    Parameters
    ----------
    W : ndarray, shape (q, N)
        Columns.
    starts : ndarray of int, shape (G,)
        Where each group begins among the N rows.

    Examples
    --------
    >>> found = grams_by(np.array([[1.0, 3.0, 5.0], [2.0, 4.0, 7.0]]), np.array([0, 2]))
    >>> found.mean.tolist(), found.square[:, :, 0].tolist()
    ([[2.0, 5.0], [3.0, 7.0]], [[2.0, 2.0], [2.0, 2.0]])
    """
    count, first = np.diff(np.append(starts, W.shape[1])), W[:, starts]
    about = np.empty(W.shape)
    for column, opening, into in zip(W, first, about, strict=True):
        np.subtract(column, np.repeat(opening, count), out=into)
    return grams_about(first, about, starts, [i for i, column in enumerate(about) if column.any()])


def grams_about(first: Array, about: Array, starts: Ints, moves: Sequence[int]) -> Grams:
    """Gram matrices of groups of rows about their first row, shapes (q, G) and (q, N); changes ``about`` in place.

    ``moves`` are the columns of ``about``, in their order, without those that are zero throughout.

    Examples
    --------
    >>> found = grams_about(np.array([[1.0, 5.0]]), np.array([[0.0, 2.0, 0.0]]), np.array([0, 2]), [0])
    >>> found.mean.tolist(), found.square.tolist(), found.about.tolist()
    ([[2.0, 5.0]], [[[2.0, 0.0]]], [[-1.0, 1.0, 0.0]])
    """
    (q, N), G = about.shape, len(starts)
    count, product = np.diff(np.append(starts, N)), np.empty(N)
    mean, square = first.copy(), np.zeros((q, q, G))
    for k, i in enumerate(moves):
        column = about[i]
        offset = np.add.reduceat(column, starts) / count
        column -= np.repeat(offset, count)
        mean[i] += offset
        for j in moves[: k + 1]:
            np.multiply(column, about[j], out=product)
            square[i, j] = square[j, i] = np.add.reduceat(product, starts)
    return Grams(count.astype(float), first, mean, square, about)
