"""Responses to initial states and constants of segments, projected out of errors and sensitivities.

The response of 1/f to an initial state decays, so its columns are short; the constant is orthogonalised against them in
closed form. All segments of one length have the same columns and are treated together.
"""

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array, Flags
from .filters import impulse_response
from .free_simulation import NEARLY_ALIKE, orthonormal_factors

DEPENDENT = 1e-16  # squared share of the constant orthogonal to the responses: below, it is dependent


@dataclass(frozen=True, slots=True)
class FreeSpace:
    """Span of the free columns of a segment, each filtered by the noise polynomial d.

    Attributes
    ----------
    columns : ndarray, shape (length, k)
        Responses to the initial state, and additional regressors, not filtered.
    Q, R : ndarray, shape (L, m), (m, m)
        Orthonormal columns of the filtered responses, L as short as these, and their triangle.
    kept : ndarray of bool, shape (k,)
        Columns that are independent.
    level : float
        Value of the filtered constant; 0 without a constant.
    along : ndarray, shape (m,)
        Component of the constant along Q.
    rest : float
        Squared length of its component orthogonal to Q.
    """

    columns: Array
    Q: Array
    R: Array
    kept: Flags
    level: float
    along: Array
    rest: float

    def coefficients(self, x: Array) -> tuple[Array, Array]:
        """Coefficients (S, k) of the columns and (S,) of the constant that fit filtered signals x (S, rows)."""
        by_q, by_level = self._components(x)
        c = np.zeros((len(x), len(self.kept)))
        if by_q.shape[1]:
            c[:, self.kept] = back_substituted(self.R, (by_q - by_level[:, None] * self.along).T).T
        return c, by_level

    def project_out(self, x: Array) -> None:
        """Remove the component of the rows of x (M, rows) along the span, in place."""
        by_q, by_level = self._components(x)
        if self.level:
            x -= (self.level * by_level)[:, None]
        if by_q.shape[1]:
            x[:, : len(self.Q)] -= (by_q - by_level[:, None] * self.along) @ self.Q.T

    def _components(self, x: Array) -> tuple[Array, Array]:
        """Along Q, and along the rest of the constant relative to its squared length."""
        by_q = x[:, : len(self.Q)] @ self.Q
        if not self.rest:
            return by_q, np.zeros(len(x))
        return by_q, (self.level * x.sum(axis=1) - by_q @ self.along) / self.rest

    def response(self, c: Array, level: Array, out: Array) -> None:
        """Add the unfiltered response of coefficients to signals ``out`` (S, length)."""
        out += level[:, None]
        if c.shape[1]:
            out[:, : len(self.columns)] += c @ self.columns.T


def free_space(
    f: Array, d: Array, length: int, states: int, constant: bool, additional: Array | None = None
) -> FreeSpace:
    """The free columns of a segment of ``length`` samples, of which the first len(d) - 1 have no filtered value."""
    nd = len(d) - 1
    columns = _responses(f, length, states, nd)
    if additional is not None:
        columns = np.hstack([np.pad(columns, ((0, length - len(columns)), (0, 0))), additional])
    filtered = columns[nd:].copy(order="F")
    for k in range(1, nd + 1):
        filtered += d[k] * columns[nd - k : len(columns) - k]
    level = float(d.sum()) if constant else 0.0
    if columns.shape[1]:
        Q, R, kept = factors(filtered)
    else:
        Q, R, kept = np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0, dtype=np.bool_)
    along = level * Q.sum(axis=0)
    rest = level**2 * (length - nd) - float(along @ along)
    if not rest > DEPENDENT * max(level**2 * (length - nd), NEARLY_ALIKE**2):
        level, rest = 0.0, 0.0
        along = np.zeros(len(along))
    return FreeSpace(columns, Q, R, kept, level, along, rest)


def factors(columns: Array) -> tuple[Array, Array, Flags]:
    """`orthonormal_factors` of columns (n, k) in Fortran order by LAPACK directly: half the time for a few columns."""
    from scipy.linalg.lapack import dgeqrf, dorgqr

    n, k = columns.shape
    if n >= k:
        packed, tau, _, _ = dgeqrf(columns)
        R = packed[:k]
        own = np.abs(R.diagonal())
        if own.min() > NEARLY_ALIKE * np.sqrt((columns * columns).sum(axis=0).max()):  # all are independent
            return dorgqr(packed, tau)[0], R, np.ones(k, dtype=np.bool_)
    return orthonormal_factors(columns)


def back_substituted(R: Array, right: Array) -> Array:
    """R^-1 right, R upper triangular; what lies below its diagonal is not read."""
    from scipy.linalg.lapack import dtrtrs

    return np.asarray(dtrtrs(R, right)[0], dtype=np.float64)


def _responses(f: Array, length: int, states: int, nd: int) -> Array:
    """Impulse response of 1 / f delayed by 0 ... states - 1 samples, until it and its filtered values have decayed."""
    if not states:
        return np.zeros((min(nd, length), 0))
    h = impulse_response(f, length)
    out = np.zeros((min(len(h) + states + nd, length), states), order="F")
    for k in range(min(states, length)):
        part = h[: len(out) - k]
        out[k : k + len(part), k] = part
    return out
