"""Lagged regressors: their rows, their Gram matrix in one pass over the data, and their QR triangle in blocks.

Every (na, nb, nk) is a sub-block of one Gram matrix. The products of u and y at lags i and j, summed over the rows,
depend on i - j except for a few rows at both ends: each difference of lags is summed once over the interior, and the
ends are added from their own few rows. The matrix of regressors (N x p) is never built, and memory is independent of N.

The sums are small matrix products. With x cut into rows of M samples, X' Z of two such cuts holds the products of every
sample of a row with its neighbours, each read from memory once for M lags; the sums along its diagonals are the lagged
sums.

Centre records first (``rec.centred()``): a mean makes all columns nearly collinear. Source: Ljung 1999, System
Identification, section 10.1 (the covariance method).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...core.arrays import Array, Ints
from ...datasets.records.record import Record

# Samples in a row of the cut: products of 8 columns are the narrowest that run at the speed of wide ones.
M = 8
# Samples in one product: two pieces of this length fit in the cache, and their sums remain accurate.
PIECE = 65_536


@dataclass(frozen=True, slots=True)
class Lags:
    """Lagged samples that form the columns: y(t) ... y(t - y), then u(t - first) ... u(t - last)."""

    y: int
    first: int
    last: int

    @property
    def span(self) -> int:
        """Largest lag: rows start after that many samples of each segment."""
        return max(self.y, self.last)

    @property
    def all(self) -> Ints:
        """Lag of each column."""
        return np.concatenate([np.arange(self.y + 1), np.arange(self.first, self.last + 1)])

    def columns(self, na: int, nb: int, nk: int) -> Ints:
        """Columns of the regressors of one order, y(t) last, shape (na + nb + 1,)."""
        u = self.y + 1 + nk - self.first
        return np.concatenate([np.arange(1, na + 1), np.arange(u, u + nb), [0]])


@dataclass(frozen=True, slots=True)
class Gram:
    """Sums of products of the columns of ``lags`` over ``rows`` rows; Gram matrices of two records add.

    Attributes
    ----------
    matrix : ndarray, shape (p, p)
    rows : int
    lags : Lags
    """

    matrix: Array
    rows: int
    lags: Lags

    def __add__(self, other: "Gram") -> "Gram":
        return Gram(self.matrix + other.matrix, self.rows + other.rows, self.lags)

    def __sub__(self, other: "Gram") -> "Gram":
        return Gram(self.matrix - other.matrix, self.rows - other.rows, self.lags)

    def block(self, na: int, nb: int, nk: int) -> Array:
        """Products of the regressors of one order, y(t) last, shape (na + nb + 1, na + nb + 1)."""
        columns = self.lags.columns(na, nb, nk)
        return self.matrix[columns[:, None], columns]


def gram(rec: Record, lags: Lags) -> Gram:
    """Gram matrix of a whole record; no row crosses a segment boundary.

    Examples
    --------
    >>> rec = Record(u=[1.0, 2.0, 3.0, 4.0], y=[0.0, 1.0, 2.0, 3.0], sample_time=0.1)
    >>> g = gram(rec, Lags(y=0, first=1, last=1))
    >>> g.rows, g.matrix.tolist()
    (3, [[14.0, 14.0], [14.0, 14.0]])
    """
    total = Gram(np.zeros((len(lags.all),) * 2), 0, lags)
    for part in grams(rec, lags):
        total += part
    return total


def grams(rec: Record, lags: Lags) -> Iterator[Gram]:
    """Gram matrix of each segment; a segment no longer than the largest lag has no row."""
    for s in rec.stretches:
        rows = s.stop - s.start - lags.span
        if rows > 0:
            yield Gram(_products(rec.u[s], rec.y[s], lags), rows, lags)


def _products(u: Array, y: Array, lags: Lags) -> Array:
    n, span = len(u), lags.span
    first = span + 1  # one more than necessary, so that a lag of -1 stays inside
    count = (n - first - span - M) // M * M
    if count < M:
        phi = _rows(u, y, lags, np.arange(span, n))
        return np.asarray(phi.T @ phi)
    place, mirror = _places(lags)
    # lags of x with itself start at -1, not 0: numpy would use the symmetric product, slower at this width
    terms = ((y, y, -1, lags.y), (u, u, -1, lags.last - lags.first), (u, y, lags.first - lags.y, lags.last))
    sums = _sums(terms, first, count)
    lower = sums[place] + _ends(u, y, lags, first, first + count)
    return np.asarray(lower.ravel()[mirror])


@lru_cache(maxsize=64)
def _places(lags: Lags) -> tuple[Ints, Ints]:
    """Index of each entry among the three rows of sums (below the diagonal), and of its mirror image."""
    ny, nu = lags.y + 1, lags.last - lags.first + 1
    y, u = np.arange(ny), np.arange(lags.first, lags.last + 1)
    place = np.zeros((ny + nu, ny + nu), dtype=np.intp)
    place[:ny, :ny] = np.maximum(y[:, None] - y, 0) + 1
    place[ny:, ny:] = np.maximum(u[:, None] - u, 0) + 1 + (ny + 1)
    place[ny:, :ny] = u[:, None] - y - (lags.first - lags.y) + (ny + 1) + (nu + 1)
    i = np.arange(ny + nu)
    return place, np.maximum(i[:, None], i) * (ny + nu) + np.minimum(i[:, None], i)


def _rows(u: Array, y: Array, lags: Lags, t: Ints) -> Array:
    """Rows of the regressor matrix at times t, shape (len(t), p)."""
    return np.concatenate(
        [y[t[:, None] - np.arange(lags.y + 1)], u[t[:, None] - np.arange(lags.first, lags.last + 1)]], axis=1
    )


def _ends(u: Array, y: Array, lags: Lags, first: int, stop: int) -> Array:
    """Sum of the products whose first sample lies before sample ``first`` or from ``stop`` on."""
    n, lag = len(u), lags.all
    head, tail = np.arange(lags.span, first + lags.span), np.arange(stop, n)
    t = np.concatenate([head, tail])
    phi = _rows(u, y, lags, t)
    inside = np.where(np.arange(len(t))[:, None] < len(head), t[:, None] - lag < first, t[:, None] - lag >= stop)
    return np.asarray((phi * inside).T @ phi)


def _sums(terms: Sequence[tuple[Array, Array, int, int]], first: int, count: int) -> Array:
    """Sums of x(s) z(s + l) over s = first ... first + count - 1, l = lo ... hi, for each (x, z, lo, hi) in a row."""
    held = [np.zeros((M, M + hi - lo)) for _, _, lo, hi in terms]
    for begin in range(first, first + count, PIECE):
        size = min(PIECE, first + count - begin)
        for (x, z, lo, _), sums in zip(terms, held, strict=True):
            left = x[begin : begin + size].reshape(-1, M).T
            width = sums.shape[1]
            for c in range(0, width, M):
                right = z[begin + lo + c : begin + lo + c + size].reshape(-1, M)
                sums[:, c : c + M] += left @ right[:, : width - c]
    return np.concatenate([_diagonals(sums, sums.shape[1] - M + 1) for sums in held])


def _diagonals(held: Array, n: int) -> Array:
    """Sums of held[i, i + k] over i, for k = 0 ... n - 1."""
    row, column = held.strides
    return np.asarray(np.lib.stride_tricks.as_strided(held, (M, n), (row + column, column)).sum(axis=0))


# Rows of one block: 41 columns of it are 2.7 MB, whatever the length of the record.
BLOCK = 8192


@dataclass(frozen=True, slots=True)
class LagTriangle:
    """R of the QR decomposition of the columns of ``lags``, (p, p) or fewer rows; its R'R is their Gram matrix."""

    matrix: Array
    rows: int
    lags: Lags


def r_of(matrix: Array) -> Array:
    """R of a QR decomposition, of one matrix or a stack of them."""
    return np.asarray(np.linalg.qr(matrix, mode="r"), dtype=np.float64)


def arx_regressors(rec: Record, na: int, nb: int, nk: int) -> tuple[Array, Array, Ints]:
    """Regressors and output of ``y = phi theta + e``, theta = a_1 ... a_na, b_nk ... b_(nk+nb-1).

    Parameters
    ----------
    rec : Record
    na, nb, nk : int

    Returns
    -------
    phi : ndarray, shape (rows, na + nb)
        -y(t-1) ... -y(t-na), u(t-nk) ... u(t-nk-nb+1): ``y - phi @ model.theta`` are the one-step residuals.
    y : ndarray, shape (rows,)
    t : ndarray of int, shape (rows,)
        Sample of each row; the first max(na, nk + nb - 1) samples of every segment have none.

    Examples
    --------
    >>> rec = Record(u=[1.0, 2.0, 3.0], y=[0.0, 1.0, 2.0], sample_time=0.1)
    >>> phi, y, t = arx_regressors(rec, 1, 1, 1)
    >>> phi.tolist(), y.tolist(), t.tolist()
    ([[-0.0, 1.0], [-1.0, 2.0]], [1.0, 2.0], [1, 2])
    """
    span = max(na, nk + nb - 1)
    t = np.concatenate([np.arange(min(s.start + span, s.stop), s.stop) for s in rec.stretches])
    phi = np.empty((len(t), na + nb))
    for k in range(na):
        np.negative(rec.y[t - k - 1], out=phi[:, k])
    for k in range(nb):
        phi[:, na + k] = rec.u[t - nk - k]
    return phi, rec.y[t], t


def triangle(rec: Record, lags: Lags, stretches: Sequence[slice] | None = None) -> LagTriangle:
    """QR of all columns in blocks of rows, in constant memory.

    More accurate than the Gram matrix, whose condition number is squared.
    Source: Demmel, Grigori, Hoemmen & Langou 2012, doi 10.1137/080731992 (sequential TSQR).
    """
    r, rows = np.zeros((0, len(lags.all))), 0
    for block in _blocks(rec, lags, rec.stretches if stretches is None else stretches):
        rows += len(block)
        r = r_of(np.concatenate([r, block]))
    return LagTriangle(r, rows, lags)


def _blocks(rec: Record, lags: Lags, stretches: Sequence[slice]) -> Iterator[Array]:
    lag = lags.all
    for s in stretches:
        for begin in range(s.start + lags.span, s.stop, BLOCK):
            end = min(begin + BLOCK, s.stop)
            block = np.empty((end - begin, len(lag)), order="F")
            for k, at in enumerate(lag):
                block[:, k] = (rec.y if k <= lags.y else rec.u)[begin - at : end - at]
            yield block
