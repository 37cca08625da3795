"""Starting values of output-error and Box-Jenkins estimates: low orders fitted to the output of a high-order ARX model.

An ARX model of high order approximates plant and noise model without bias, in open loop and in closed loop, and needs
no iteration. Its simulated output holds little of the noise; a model of low order is fitted to it by the iteration of
Steiglitz & McBride 1965, doi 10.1109/TAC.1965.1098181: least squares on the equation, both sides filtered by 1 / f of
the step before.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array
from .filters import EDGE, filtered, is_stable, recursive, reflected
from .free_responses import back_substituted, free_space
from .regressors import r_of

HIGH_ORDER = 20
FEWEST_ROWS = 4  # per coefficient of the high-order model
INDEPENDENT = 1e-12  # share of the largest pivot
SMALL = 1e-9  # singular values below this share are rounding of the regressors of a slow input


@dataclass(frozen=True, slots=True)
class HighOrder:
    """High-order ARX model of a record.

    Attributes
    ----------
    a, b : ndarray
        Polynomials; b from lag 0.
    x : ndarray, shape (N,)
        Simulated output, from rest.
    rows : int
    loss : float
        Mean square of the one-step errors.
    stable : bool
        Whether its poles lay inside the unit circle.
    """

    a: Array
    b: Array
    x: Array
    rows: int
    loss: float
    stable: bool


def high_order_arx(
    u: Array,
    y: Array,
    stretches: Sequence[slice],
    first: int = 0,
    order: int = HIGH_ORDER,
    delay: int = 0,
    additional: Array | None = None,
) -> HighOrder:
    """Least squares on ``order`` past outputs and the inputs of lags ``first`` ... ``order + delay``, with a constant.

    An unstable model is replaced by one whose poles are reflected into the unit circle.
    """
    order = max(min(order, len(y) // (2 * FEWEST_ROWS) - 1), 1)
    span = order + delay
    long = [s for s in stretches if s.stop - s.start > span + 1]
    t = np.concatenate([np.arange(s.start + span, s.stop) for s in long]) if long else np.arange(span, len(y))
    level = np.zeros((len(t), len(long)))
    for k, s in enumerate(long):
        level[(t >= s.start) & (t < s.stop), k] = 1.0
    if additional is not None:
        level = np.hstack([level, additional[t]])
    Phi = np.hstack([-y[t[:, None] - np.arange(1, order + 1)], u[t[:, None] - np.arange(first, span + 1)], level])
    R = r_of(np.column_stack([Phi, y[t]]))
    theta = np.linalg.lstsq(R[:, :-1], R[:, -1], rcond=SMALL)[0]
    e = R[:, -1] - R[:, :-1] @ theta
    a = np.r_[1.0, theta[:order]]
    stable, a = is_stable(a, EDGE), reflected(a)
    b = np.r_[np.zeros(first), theta[order : order + span + 1 - first]]
    return HighOrder(a, b, filtered(b, a, u, stretches), len(t), float(e @ e) / len(t), stable)


def steiglitz_mcbride(
    u: Array, x: Array, stretches: Sequence[slice], orders: tuple[int, int, int], skipped: int, f: Array, steps: int = 1
) -> tuple[Array, float]:
    """Theta = f_1 ..., b_nk ... after ``steps`` of the iteration from the denominator ``f``, and its mean square error.

    Each segment has a free initial state and a constant; its first ``skipped`` samples are left out. The error is that
    of the equation of the last step.
    """
    nf, nb, _ = orders
    theta, square = np.zeros(nf + nb), np.inf
    for _ in range(steps):
        R, rows = _triangle(u, x, f, stretches, orders, skipped)
        if rows <= 2 * (nf + nb):
            return theta, square
        theta, square = solved(R)
        square /= rows
        f = reflected(np.concatenate([np.ones(1), theta[:nf]]))
    return np.concatenate([f[1:], theta[nf:]]), square


def _triangle(
    u: Array, x: Array, f: Array, stretches: Sequence[slice], orders: tuple[int, int, int], skipped: int
) -> tuple[Array, int]:
    """Triangle of the regressors -xf(t - i), uf(t - j) and of xf(t), both signals filtered by 1 / f, and the rows."""
    nf, nb, nk = orders
    parts = []
    for group in by_length(stretches, skipped + nf + 2):
        uf, xf = recursive([1.0], f, np.stack([stacked(u, group), stacked(x, group)]), axis=-1)
        rows = np.empty((nf + nb + 1, len(uf), uf.shape[1] - skipped))
        shifted_rows(rows[:nf], -xf, 1, skipped)
        shifted_rows(rows[nf:-1], uf, nk, skipped)
        rows[-1] = xf[:, skipped:]
        free_space(f, np.ones(1), rows.shape[2], nf, True).project_out(rows.reshape(-1, rows.shape[2]))
        parts.append(rows.reshape(len(rows), -1))
    if not parts:
        return np.zeros((0, nf + nb + 1)), 0
    together = parts[0] if len(parts) == 1 else np.hstack(parts)
    return triangle_of(together), together.shape[1]


def solved(R: Array) -> tuple[Array, float]:
    """Coefficients of the last column of a triangle by the others, and the residual sum of squares."""
    p = R.shape[1] - 1
    own = np.abs(R.diagonal()[:p])
    if len(R) == p + 1 and own.min() > INDEPENDENT * own.max():
        return back_substituted(R[:p, :p], R[:p, p]), float(R[p, p]) ** 2
    R = np.asarray(np.triu(R), dtype=np.float64)
    theta = np.asarray(np.linalg.lstsq(R[:, :p], R[:, p], rcond=INDEPENDENT)[0], dtype=np.float64)
    e = R[:, p] - R[:, :p] @ theta
    return theta, float(e @ e)


def triangle_of(rows: Array) -> Array:
    """R of the QR decomposition of the transpose of rows (p, n), by LAPACK directly; not zero below the diagonal."""
    from scipy.linalg.lapack import dgeqrf

    return np.asarray(dgeqrf(rows.T, overwrite_a=1)[0][: len(rows)])


def by_length(stretches: Sequence[slice], shortest: int) -> list[tuple[slice, ...]]:
    """Segments longer than ``shortest`` samples, those of one length together."""
    found: dict[int, list[slice]] = {}
    for s in stretches:
        if s.stop - s.start > shortest:
            found.setdefault(s.stop - s.start, []).append(s)
    return [tuple(group) for group in found.values()]


def stacked(x: Array, group: tuple[slice, ...]) -> Array:
    """Signals of segments of one length, shape (segments, length)."""
    return x[group[0]][None] if len(group) == 1 else np.stack([x[s] for s in group])


def shifted_rows(out: Array, x: Array, lag: int, first: int) -> None:
    """Write x(t - lag), x(t - lag - 1) ... (S, n) for t from ``first`` into out (k, S, n - first); zero before it."""
    n = out.shape[2]
    for k in range(len(out)):
        at = first - lag - k
        if at >= 0:
            out[k] = x[:, at : at + n]
        else:
            out[k, :, : min(-at, n)] = 0.0
            out[k, :, min(-at, n) :] = x[:, : max(n + at, 0)]
