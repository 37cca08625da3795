"""Free simulation of a model along a record, and its sensitivities to the coefficients.

A segment starts at rest, or with an initial state that is estimated and projected out: the past acts on y through
``max(na, nb + nk - 1)`` numbers a segment, and y is linear in them. It is also linear in a constant: the mean of a run
that has not settled is not its operating point.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Array, Flags
from ...datasets.records.record import Record
from .filters import ROUNDING, filtered, impulse_response, lagged, squares

NEARLY_ALIKE = 1e-10  # share of a column orthogonal to those before it: below, it is dependent


@dataclass(frozen=True, slots=True)
class FreeRun:
    """Data of an output-error estimation: u, y (N,), segments, orders, and the free parameters of each segment.

    A free ``constant`` requires free initial states (``free``).
    """

    u: Array
    y: Array
    stretches: tuple[slice, ...]
    na: int
    nb: int
    nk: int
    free: bool = False
    constant: bool = False

    @property
    def states(self) -> int:
        """Number of initial states of a segment."""
        return max(self.na, self.nb + self.nk - 1)

    @property
    def hidden(self) -> int:
        """Number of initial states and constants estimated in addition to theta."""
        states = sum(min(self.states, s.stop - s.start) for s in self.stretches) if self.free else 0
        return states + self.constant * len(self.stretches)

    def polynomials(self, theta: Array) -> tuple[Array, Array]:
        """The full polynomials b and a of theta = a_1 ..., b_nk ..."""
        return np.r_[np.zeros(self.nk), theta[self.na :]], np.r_[1.0, theta[: self.na]]


def free_run(rec: Record, na: int, nb: int, nk: int, free: bool = False) -> FreeRun:
    """The record as data of an output-error estimation."""
    return FreeRun(rec.u, rec.y, rec.stretches, na, nb, nk, free)


def free_responses(run: FreeRun, a: Array) -> list[tuple[slice, Array]]:
    """Orthonormal columns of the initial-state response in each segment, and the samples it spans."""
    if not run.free:
        return []
    h = impulse_response(a, max(s.stop - s.start for s in run.stretches))
    out = []
    for s in run.stretches:
        n = min(len(h) + run.states, s.stop - s.start)
        part = np.pad(h, (0, run.states))[:n]
        columns = lagged(part, range(min(run.states, n)), (slice(0, n),))
        if run.constant:
            n = s.stop - s.start
            columns = np.column_stack([np.ones(n), np.pad(columns, ((0, n - len(columns)), (0, 0)))])
        out.append((slice(s.start, s.start + n), orthonormal(columns)))
    return out


def constants(run: FreeRun, theta: Array) -> Array:
    """The constant of each segment, shape (segments,), estimated with the initial state from y less simulation."""
    b, a = run.polynomials(theta)
    left = run.y - filtered(b, a, run.u, run.stretches)
    out = []
    for s, states in free_responses(replace(run, constant=False), a):
        whole = slice(s.start, next(t.stop for t in run.stretches if t.start == s.start))
        columns = np.zeros((whole.stop - whole.start, states.shape[1] + 1))
        columns[:, 0], columns[: len(states), 1:] = 1.0, states
        out.append(np.linalg.lstsq(columns, left[whole], rcond=None)[0][0])
    return np.array(out)


def orthonormal(columns: Array) -> Array:
    """Orthonormal columns of the same span; NaN where an unstable model has overflowed."""
    if not columns.shape[1]:
        return columns
    if not np.isfinite(columns).all():
        return np.full((len(columns), 1), np.nan)
    return orthonormal_factors(columns)[0]


def orthonormal_factors(columns: Array) -> tuple[Array, Array, Flags]:
    """Q (N, k) of the same span, triangle R (k, k), and which of the columns are kept as independent: columns = Q R."""
    several = columns[:, : len(columns)]  # a segment of n samples has n directions at most
    Q, R = np.linalg.qr(several)
    kept = np.zeros(columns.shape[1], dtype=np.bool_)
    own = kept[: len(R)] = np.abs(np.diag(R)) > NEARLY_ALIKE * np.sqrt((R * R).sum(axis=0))
    return (Q, R, kept) if kept.all() else (Q[:, own], R[np.ix_(own, own)], kept)


def projected_out(x: Array, free: list[tuple[slice, Array]]) -> Array:
    """Array x (N,) or (N, k) with its component along the free responses removed."""
    if not free:
        return x
    out = x.copy(order="K")
    for s, q in free:
        out[s] -= q @ (q.T @ x[s])
    return out


def simulation_error(run: FreeRun, theta: Array) -> Array:
    """Measured less simulated output, shape (N,)."""
    b, a = run.polynomials(theta)
    return projected_out(run.y - filtered(b, a, run.u, run.stretches), free_responses(run, a))


def sensitivities(run: FreeRun, theta: Array) -> tuple[Array, Array]:
    """Simulation error e (N,) and d yhat / d theta (N, na + nb), initial states projected out of both.

    d yhat / d a_i = -q^-i / A yhat and d yhat / d b_j = q^-j / A u (Ljung 1999, section 10.3).
    """
    b, a = run.polynomials(theta)
    free = free_responses(run, a)
    uf = filtered([1.0], a, run.u, run.stretches)
    e = projected_out(run.y - filtered(b, [1.0], uf, run.stretches), free)
    J = regressor_columns(run, filtered([1.0], a, run.y - e, run.stretches), uf)
    return e, projected_out(J, free)


def regressor_columns(run: FreeRun, yf: Array, uf: Array) -> Array:
    """Columns -yf(t - 1) ... -yf(t - na), uf(t - nk) ..., shape (N, na + nb)."""
    out = np.empty((len(yf), run.na + run.nb), order="F")
    out[:, : run.na] = lagged(-yf, range(1, run.na + 1), run.stretches)
    out[:, run.na :] = lagged(uf, range(run.nk, run.nk + run.nb), run.stretches)
    return out


def with_initial_states(run: FreeRun, theta: Array) -> FreeRun:
    """The run with free initial states where BIC favours them, otherwise unchanged.

    The reduction of the loss is predicted by one Gauss-Newton step in theta and the initial states. For a start from
    rest they are retained in about one of 10 000 records.
    """
    e, J = sensitivities(replace(run, free=False), theta)
    freed = replace(run, free=True)
    free = free_responses(freed, run.polynomials(theta)[1])
    n, hidden, loss = len(e), freed.hidden, squares(e)
    if not 0 < loss < np.inf or n <= hidden + J.shape[1] + 1 or loss <= ROUNDING * squares(run.y):
        return run
    q = np.linalg.qr(J)[0]
    along = np.concatenate([E.T @ e[s] for s, E in free])
    shared = np.hstack([q[s].T @ E for s, E in free])  # (p, hidden): component that theta can absorb
    rest = np.linalg.pinv(np.eye(len(shared)) - shared @ shared.T, rcond=1e-10, hermitian=True)
    fall = along @ along + (shared @ along) @ rest @ (shared @ along)
    return freed if n * np.log(max(1 - fall / loss, 1e-300)) < -hidden * np.log(n) else run
