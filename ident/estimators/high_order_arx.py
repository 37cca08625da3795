"""Least-squares ARX of high order: innovations of a record without a choice of structure, and F tests of further terms.

    y(t) = level + sum a_i y(t-i) + sum b_j u(t-j) + additional(t) + e(t)

Twenty lags of y and up to sixty of u whiten the usual plants under sensor noise as well as under equation noise, so
that the F test of a further term (a sine, a polynomial, a function of u) holds its level without knowledge of the
plant. The term is tested jointly with the lags: twenty lags of y absorb a sine almost completely, and the residuals
alone show none.

Source: Soderstrom & Stoica 1989, System Identification, section 11.5 (F test of nested regressions).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array, Ints
from ...datasets.records.record import Record, join_records
from .regressors import r_of

Y_LAGS, U_LAGS = 20, (20, 40, 60)
SAMPLES_PER_LAG = 30  # of y: shorter records have fewer lags
FEWEST_LAGS = 4
ROWS_PER_COLUMN = 3  # of the regression: many short segments leave fewer rows
MOST_ROWS, PARTS = 4000, 8  # of longer records the middle part, or parts of it
DEPENDENT = 1e-7  # of its length: a lag of u beyond is a combination of the lags before (a slow chirp has about ten)
EXACT = 1e-12  # of the variance of y: innovations below are rounding or the printed digits of a simulation


@dataclass(frozen=True, slots=True)
class LongArx:
    """Least-squares fit of high order.

    Attributes
    ----------
    rows : ndarray of int, shape (m,)
        Samples with a complete regressor.
    q : ndarray, shape (m, p)
        Orthonormal columns of the regressors.
    left : ndarray, shape (m,)
        Innovations e, unit of y.
    a, b : ndarray
        Polynomials in q^-1: a y = b u + level + additional + e.
    lags : ndarray of int
        Lags of u in the regression.
    additional : ndarray, shape (k,)
        Coefficients of the further columns.
    """

    rows: Ints
    q: Array
    left: Array
    a: Array
    b: Array
    lags: Ints
    additional: Array

    @property
    def free(self) -> int:
        """Degrees of freedom of the innovations."""
        return int(self.q.shape[0] - self.q.shape[1])

    @property
    def rss(self) -> float:
        """Sum of squares of the innovations."""
        return float(self.left @ self.left)

    def orthogonal(self, x: Array) -> Array:
        """Part of columns x (m, k) that the regression does not explain."""
        return np.asarray(x - self.q @ (self.q.T @ x))

    def f_test(self, x: Array) -> tuple[float, float]:
        """Probability (p value) of adding columns x (m, k), and the share of the sum of squares that they remove."""
        return self.tested(self.orthogonal(x), np.linalg.norm(x, axis=0))

    def tested(self, x: Array, length: Array) -> tuple[float, float]:
        """`f_test` of columns that are orthogonal to the regression; ``length`` (k,) before that."""
        from scipy.special import fdtrc

        there = np.linalg.norm(x, axis=0) > 1e-9 * length
        if not there.any():
            return 1.0, 0.0
        q, r = np.linalg.qr(x[:, there] / length[there])
        size = np.abs(np.diag(r))
        c = q[:, size > 1e-3 * size.max()].T @ self.left
        fell, count = float(c @ c), len(c)
        rest = max(self.rss - fell, 1e-300)
        return float(fdtrc(count, self.free - count, fell / count / (rest / (self.free - count)))), fell / self.rss


def middle(rec: Record) -> Record:
    """The middle part of a record of more than 4000 samples."""
    if len(rec) <= MOST_ROWS:
        return rec
    start = (len(rec) - MOST_ROWS) // 2
    return rec.part(start, start + MOST_ROWS)


def spread(rec: Record) -> Record:
    """Evenly spaced parts of a record of more than 4000 samples: of a long sweep each has another frequency."""
    size = MOST_ROWS // PARTS
    starts = [s.start + k for s in rec.stretches for k in range(0, s.stop - s.start - size + 1, size)]
    if len(rec) <= MOST_ROWS or len(starts) < PARTS:
        return middle(rec)
    chosen = [starts[k] for k in np.linspace(0, len(starts) - 1, PARTS).round().astype(int)]
    return join_records([rec.part(k, k + size) for k in chosen])


def input_lags(rec: Record, y_lags: int, least: int = 0) -> Ints:
    """Lags of u that the regression needs: up to 1, 2 or 3 times ``y_lags``, by BIC, without dependent ones.

    In closed loop ``least`` is 1: the present u of a controller determines the present y, so that the innovations would
    be the steps of its reference.
    """
    near, most = y_lags, y_lags * len(U_LAGS)
    if max(s.stop - s.start for s in rec.stretches) < 3 * most:
        most = near
    t = rows_of(rec, most)
    first, further = np.arange(least, near + 1), np.arange(near + 1, most + 1)
    held = np.column_stack(
        [levels(rec, t), lagged_rows(rec.u, first, t), lagged_rows(rec.y, 1 + np.arange(y_lags), t),
         lagged_rows(rec.u, further, t), rec.y[t]]
    )  # fmt: skip
    r = r_of(held)
    own = np.abs(np.diag(r)) > DEPENDENT * np.sqrt((r * r).sum(axis=0))
    start = held.shape[1] - most - y_lags - 2 + least
    base = start + len(first) + y_lags
    first = first[own[start : start + len(first)]]
    further = further[own[base:-1]]
    left = np.cumsum(r[::-1, -1] ** 2)[::-1]
    n, ends = len(t), range(near, most + 1, y_lags)
    bic = [n * np.log(max(left[base + end - near], 1e-300)) + np.log(n) * (further <= end).sum() for end in ends]
    return np.concatenate([first, further[further <= ends[int(np.argmin(bic))]]])


def order_of(rec: Record) -> int:
    """Lags of y for the length of a record and of its segments; 0 where they are too short."""
    lengths = np.diff([*rec.starts, len(rec)])
    for order in range(min(len(rec) // SAMPLES_PER_LAG, Y_LAGS), FEWEST_LAGS - 1, -1):
        rows = np.maximum(lengths - order, 0)
        if rows.sum() > ROWS_PER_COLUMN * (2 * order + 2 + np.count_nonzero(rows)):
            return order
    return 0


def long_arx(rec: Record, y_lags: int, lags: Ints, additional: Array | None = None, span: int = 0) -> LongArx:
    """The regression of high order with columns ``additional`` (N, k); the first ``span`` samples have no row."""
    from scipy.linalg import solve_triangular

    t, x = _columns(rec, y_lags, lags, additional, span)
    q, r = np.linalg.qr(x)
    c = q.T @ rec.y[t]
    diagonal = np.abs(np.diag(r))
    r[np.diag_indices(len(r))] += np.where(diagonal < 1e-14 * diagonal.max(), 1e-14 * diagonal.max(), 0.0)
    theta = solve_triangular(r, c)
    b = np.zeros(_longest(lags) + 1)
    end, count = theta.size - y_lags, 0 if additional is None else additional.shape[1]
    start = end - count - len(lags)
    b[lags] = theta[start : start + len(lags)]
    return LongArx(
        rows=t,
        q=q,
        left=rec.y[t] - q @ c,
        a=np.r_[1.0, -theta[end:]],
        b=b,
        lags=lags,
        additional=theta[end - count : end],
    )


def rss_of(rec: Record, y_lags: int, lags: Ints, additional: Array | None = None) -> float:
    """Sum of squares of the innovations of `long_arx`."""
    t, x = _columns(rec, y_lags, lags, additional)
    return float(r_of(np.column_stack([x, rec.y[t]]))[-1, -1] ** 2)


def _columns(rec: Record, y_lags: int, lags: Ints, additional: Array | None, span: int = 0) -> tuple[Ints, Array]:
    """Samples with a complete regressor (m,), and the regressors (m, p): levels, u, ``additional``, y."""
    t = rows_of(rec, max(y_lags, _longest(lags), span))
    extra = np.empty((len(t), 0)) if additional is None else additional[t]
    past = lagged_rows(rec.y, 1 + np.arange(y_lags), t)
    return t, np.column_stack([levels(rec, t), lagged_rows(rec.u, lags, t), extra, past])


def _longest(lags: Ints) -> int:
    """The longest lag of u; 0 where the input is constant in all rows, as after a step at the start of a record."""
    return int(lags.max(initial=0))


def rows_of(rec: Record, span: int) -> Ints:
    """Samples of all stretches after the first ``span`` of each."""
    return np.concatenate([np.arange(min(s.start + span, s.stop), s.stop) for s in rec.stretches])


def levels(rec: Record, t: Ints) -> Array:
    """One column for each stretch with rows: 1 within it."""
    stretch = np.searchsorted(rec.starts, t, side="right") - 1
    return np.asarray(stretch[:, None] == np.unique(stretch), dtype=np.float64)


def lagged_rows(x: Array, lags: Ints, t: Ints) -> Array:
    """x(t - lag), shape (rows, lags)."""
    return np.asarray(x[t[:, None] - lags])


def golden(function: Callable[[float], float], low: float, high: float, steps: int) -> float:
    """Minimum of a function between two limits by golden section.

    >>> round(golden(lambda x: (x - 0.3) ** 2, 0.0, 1.0, 30), 4)
    0.3
    """
    ratio = (np.sqrt(5) - 1) / 2
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    at_a, at_b = function(a), function(b)
    for _ in range(steps):
        if at_a < at_b:
            high, b, at_b = b, a, at_a
            a = high - ratio * (high - low)
            at_a = function(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + ratio * (high - low)
            at_b = function(b)
    return float(low + high) / 2


def offsets_of(rec: Record) -> Array:
    """Operating point of u and y at every sample, shape (N, 2)."""
    assert rec.offsets is not None  # noqa: S101  set by the record
    return np.repeat(rec.offsets, np.diff([*rec.starts, len(rec)]), axis=0)
