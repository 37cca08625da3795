"""The regressor matrix row by row, where it is wanted itself: for residuals, and for QR in blocks."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...datasets.records.record import Record
from .gram import Lags

Array = NDArray[np.float64]

# Rows of one block: 41 columns of it are 2.7 MB, whatever the length of the record.
BLOCK = 8192


@dataclass(frozen=True, slots=True)
class Triangle:
    """R of the QR decomposition of the columns of ``lags``, (p, p) or fewer rows; its R'R is their Gram matrix."""

    matrix: Array
    rows: int
    lags: Lags


def r_of(matrix: Array) -> Array:
    """R of a QR decomposition, of one matrix or a stack of them."""
    return np.asarray(np.linalg.qr(matrix, mode="r"), dtype=np.float64)


def arx_regressors(rec: Record, na: int, nb: int, nk: int) -> tuple[Array, Array, NDArray[np.intp]]:
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
        Sample of each row; the first max(na, nk + nb - 1) samples of every stretch have none.

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


def triangle(rec: Record, lags: Lags, stretches: Sequence[slice] | None = None) -> Triangle:
    """QR of all columns in blocks of rows, so that memory stays constant.

    It keeps the digits that products of columns lose by squaring the condition number.
    Source: Demmel, Grigori, Hoemmen & Langou 2012, doi 10.1137/080731992 (sequential TSQR).
    """
    r, rows = np.zeros((0, len(lags.all))), 0
    for block in _blocks(rec, lags, rec.stretches if stretches is None else stretches):
        rows += len(block)
        r = r_of(np.concatenate([r, block]))
    return Triangle(r, rows, lags)


def _blocks(rec: Record, lags: Lags, stretches: Sequence[slice]) -> Iterator[Array]:
    lag = lags.all
    for s in stretches:
        for begin in range(s.start + lags.span, s.stop, BLOCK):
            end = min(begin + BLOCK, s.stop)
            block = np.empty((end - begin, len(lag)), order="F")
            for k, at in enumerate(lag):
                block[:, k] = (rec.y if k <= lags.y else rec.u)[begin - at : end - at]
            yield block
