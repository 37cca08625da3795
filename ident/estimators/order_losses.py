"""Losses of every order from one Gram matrix, or from one QR triangle where the Gram matrix is inaccurate.

The regressors of one na and nk are ordered y(t-1) ... y(t-na), u(t-nk) ... u(t-nk-nb+1), y(t). One Cholesky factor of
that block covers every smaller nb: its last row gives the reduction of the sum of squares by each column (Golub & Van
Loan, Matrix Computations, section 5.3). Blocks of all nk are factored together.
"""

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Array, Flags, Ints
from .input_checks import DEPENDENT
from .regressors import Gram, Lags, LagTriangle, r_of

# A scaled pivot below this is rounding in a Gram matrix.
PIVOT = 1e-7
EPS = float(np.finfo(np.float64).eps)
# Residuals of 1e-12 of the output are rounding in double precision: no order fits better than that.
ROUNDING = 1e-24


def losses(total: Gram, na: Sequence[int], nb: int, nk: Sequence[int]) -> Array | None:
    """Residual sums of squares from a Gram matrix, shape (len(nk), len(na), nb), for 1 ... nb; None if inaccurate.

    Inaccurate where a pivot or a residual is rounding, measured by its effect on n ln V.
    """
    scaled, length = _scaled(total.matrix)
    rss = np.empty((len(nk), len(na), nb))
    for i, a in enumerate(na):
        lower = _factor(scaled, _columns(total.lags, a, nb, nk))
        if lower is None:
            return None
        rss[:, i] = 1 - np.cumsum(lower[:, -1, :-1] ** 2, axis=1)[:, a:]
    if rss.min() < 1e3 * EPS * total.rows:
        return None
    return np.asarray(rss * length[0] ** 2)


def losses_of_triangle(r: LagTriangle, na: Sequence[int], nb: int, nk: Sequence[int]) -> Array:
    """Residual sums of squares from the triangle of all columns: sums of squares only, without cancellation.

    Infinite where the regressors of an order are collinear.
    """
    rss = np.empty((len(nk), len(na), nb))
    for i, a in enumerate(na):
        factors = _triangles(r.matrix, _columns(r.lags, a, nb, nk))
        left = np.cumsum(factors[:, ::-1, -1] ** 2, axis=1)[:, ::-1][:, a + 1 : a + nb + 1]
        rss[:, i] = np.where(_collinear(factors)[:, a:], np.inf, left)
    return np.maximum(rss, ROUNDING * float((r.matrix[:, 0] ** 2).sum()))


def left_out(parts: Sequence[Gram | LagTriangle], na: Sequence[int], nb: int, nk: Sequence[int]) -> Array:
    """Leave-one-run-out mean square one-step error, shape (len(nk), len(na), nb)."""
    total = np.zeros((len(nk), len(na), nb))
    triangles = isinstance(parts[0], LagTriangle)
    for k, out in enumerate(parts):
        others = [part.matrix for j, part in enumerate(parts) if j != k]
        trained = _square(r_of(np.concatenate(others))) if triangles else np.sum(others, axis=0)
        for i, a in enumerate(na):
            columns = _columns(out.lags, a, nb, nk)
            total[:, i] += _error(trained, out.matrix, columns, a, triangles)
    return total / sum(part.rows for part in parts)


def _error(trained: Array, out: Array, columns: Ints, a: int, triangles: bool) -> Array:
    """Residual sum of squares on ``out`` of the coefficients of every nb, shape (nk, nb)."""
    if triangles:
        r = _triangles(trained, columns)
        length = np.ones(len(trained))
    else:
        scaled, length = _scaled(trained)
        lower = _factor(scaled, columns)
        if lower is None:
            return np.full((len(columns), columns.shape[1] - 1 - a), np.inf)
        r = lower.transpose(0, 2, 1)
    size = r.shape[2] - 1
    collinear = _collinear(r)
    pivots = np.diagonal(r, axis1=1, axis2=2)[:, :size]
    square = r[:, :size, :size] + np.where(pivots == 0, 1.0, 0.0)[:, :, None] * np.eye(size)
    inverse = np.linalg.inv(square)
    # theta of the first k columns is the sum of k columns of the inverse, each times its component of y
    theta = np.cumsum(inverse * r[:, None, :size, -1], axis=2)[:, :, a:]
    theta = theta * (length[0] / length[columns[:, :size]])[:, :, None]
    whole = np.concatenate([-theta, np.ones((len(columns), 1, theta.shape[2]))], axis=1)
    if triangles:
        error = ((out.T[columns].transpose(0, 2, 1) @ whole) ** 2).sum(axis=1)
    else:
        error = (whole * (out[columns[:, :, None], columns[:, None, :]] @ whole)).sum(axis=1)
    return np.where(collinear[:, a:], np.inf, error)


def _square(r: Array) -> Array:
    """A triangle with rows of zeros, as many as it has columns: few samples leave fewer rows."""
    return np.concatenate([r, np.zeros((max(r.shape[1] - len(r), 0), r.shape[1]))])


def _collinear(factors: Array) -> Flags:
    """Whether the first k columns are collinear, k = 1 ... size, shape (len(factors), size)."""
    length = np.sqrt((factors**2).sum(axis=1))[:, :-1]
    pivots = np.abs(np.diagonal(factors, axis1=1, axis2=2))[:, : length.shape[1]]
    return np.asarray(np.logical_or.accumulate(pivots <= DEPENDENT * length, axis=1))


def _columns(lags: Lags, a: int, nb: int, nk: Sequence[int]) -> Ints:
    columns = np.tile(lags.columns(a, nb, 0), (len(nk), 1))
    columns[:, a:-1] += np.asarray(nk, dtype=np.intp)[:, None]
    return columns


def _scaled(g: Array) -> tuple[Array, Array]:
    length = np.sqrt(np.maximum(np.diag(g), np.finfo(np.float64).tiny))
    return g / np.outer(length, length), length


def _factor(scaled: Array, columns: Ints) -> Array | None:
    """Cholesky factors of all blocks; None where one of them is inaccurate."""
    blocks = scaled[columns[:, :, None], columns[:, None, :]]
    blocks[:, -1, -1] += 1  # only the last row is used, not its pivot, which vanishes for a perfect fit
    try:
        lower: Array = np.asarray(np.linalg.cholesky(blocks), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    return lower if np.diagonal(lower, axis1=1, axis2=2).min() > PIVOT else None


def _triangles(r: Array, columns: Ints) -> Array:
    return r_of(r.T[columns].transpose(0, 2, 1))
