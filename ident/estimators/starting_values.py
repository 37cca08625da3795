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
from .filters import EDGE, filtered, is_stable, reflected
from .free_simulation import impulse_response_columns

HIGH_ORDER = 20
FEWEST_ROWS = 4  # per coefficient of the high-order model
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
    beside: Array | None = None,
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
    if beside is not None:
        level = np.hstack([level, beside[t]])
    Phi = np.hstack([-y[t[:, None] - np.arange(1, order + 1)], u[t[:, None] - np.arange(first, span + 1)], level])
    R = np.linalg.qr(np.column_stack([Phi, y[t]]), mode="r")
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
    long = [s for s in stretches if s.stop - s.start > skipped + 2 * nf + nb + 2]
    rows = sum(s.stop - s.start - skipped for s in long)
    theta, square = np.zeros(nf + nb), np.inf
    if not long:
        return theta, square
    for _ in range(steps):
        parts = [_projected(_equation(u[s], x[s], f, orders, skipped), nf + nb + 1) for s in long]
        R = parts[0] if len(parts) == 1 else np.vstack(parts)
        theta = np.linalg.lstsq(R[:, :-1], R[:, -1], rcond=1e-12)[0]
        e = R[:, -1] - R[:, :-1] @ theta
        square = float(e @ e) / rows
        f = reflected(np.concatenate([np.ones(1), theta[:nf]]))
    return np.concatenate([f[1:], theta[nf:]]), square


def _projected(part: Array, kept: int) -> Array:
    """Triangle of the last ``kept`` columns, orthogonal to the columns before them."""
    R = np.linalg.qr(part, mode="r")
    return np.asarray(R[len(part[0]) - kept :, len(part[0]) - kept :])


def _equation(u: Array, x: Array, f: Array, orders: tuple[int, int, int], skipped: int) -> Array:
    """Free columns, regressors -xf(t - i), uf(t - j), and xf(t) of one segment, both signals filtered by 1 / f."""
    from scipy.signal import lfilter

    nf, nb, nk = orders
    uf, xf = lfilter(np.ones(1), f, np.stack([u, x]))
    free = impulse_response_columns(f, len(u) - skipped, nf, True)
    out = np.empty((1 + nf + nf + nb + 1, len(u) - skipped))
    out[: 1 + nf] = free.T
    shifted_rows(out[1 + nf : 1 + 2 * nf], -xf, 1, skipped)
    shifted_rows(out[1 + 2 * nf : -1], uf, nk, skipped)
    out[-1] = xf[skipped:]
    return out.T


def shifted_rows(out: Array, x: Array, lag: int, first: int) -> None:
    """Write x(t - lag), x(t - lag - 1) ... for t from ``first`` into the rows of ``out``; zero before the start."""
    n = out.shape[1]
    for k in range(len(out)):
        at = first - lag - k
        if at >= 0:
            out[k] = x[at : at + n]
        else:
            out[k, : min(-at, n)] = 0.0
            out[k, min(-at, n) :] = x[: max(n + at, 0)]
