"""Least squares by Levenberg-Marquardt: damped Gauss-Newton steps that stay where the model is stable.

Source: Marquardt 1963, doi 10.1137/0111030; damping by the gain ratio as in Nielsen 1999 (IMM-REP-1999-05).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .filters import ROUNDING, squares

Array = NDArray[np.float64]
Evaluate = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True, slots=True)
class Minimum:
    """Where the search ended.

    Attributes
    ----------
    theta : ndarray, shape (p,)
    e : ndarray, shape (N,)
        Error there.
    J : ndarray, shape (N, p)
        d (prediction) / d theta = -d e / d theta.
    steps : int
        Steps accepted.
    converged : bool
    reason : str
        Why it ended, in words.
    """

    theta: Array
    e: Array
    J: Array
    steps: int
    converged: bool
    reason: str


def damped_step(J: Array, e: Array, damping: float) -> tuple[Array, float]:
    """Step of theta and the fall of the loss that the linear model promises; columns are scaled to length 1."""
    H, g = J.T @ J, J.T @ e
    scale = np.sqrt(np.maximum(np.diag(H), np.finfo(float).tiny))
    H = H / np.outer(scale, scale)
    g = g / scale
    step = np.linalg.solve(H + damping * np.eye(len(g)), g)
    return step / scale, float(step @ (damping * step + g))


def minimise(
    theta: Array,
    evaluate: Evaluate,
    allowed: Callable[[Array], bool],
    size: float,
    tol: float = 1e-12,
    max_steps: int = 100,
) -> Minimum:
    """Theta that makes e'e least, from a start that is allowed.

    Parameters
    ----------
    theta : ndarray, shape (p,)
        Start.
    evaluate : callable
        theta -> e (N,), J (N, p).
    allowed : callable
        theta -> whether the model may be run there (stable, invertible); a step that leaves is shortened.
    size : float
        Squares of the data: the loss is zero below ``ROUNDING`` of it.
    tol : float
        The search has converged when the next step promises less than this part of the loss.
    max_steps : int
        Trials, accepted or not.
    """
    e, J = evaluate(theta)
    loss, damping, grow, steps, shut = squares(e), 1e-4, 2.0, 0, False
    for _ in range(max_steps):
        if loss <= ROUNDING * size:
            return Minimum(theta, e, J, steps, True, "the model passes through the data")
        step, promised = damped_step(J, e, damping)
        if promised <= tol * loss and (damping < 1 or not shut):
            return Minimum(theta, e, J, steps, True, "no step lowers the loss any more")
        trial = theta + step
        if shut_now := not allowed(trial):
            gain = -1.0
        else:
            e_trial, J_trial = evaluate(trial)
            lower = squares(e_trial)
            gain = (loss - lower) / promised
        shut = shut_now or (shut and gain <= 0)
        if gain > 0:
            theta, e, J, loss, steps = trial, e_trial, J_trial, lower, steps + 1
            damping, grow = damping * max(1 / 3, 1 - (2 * min(gain, 1) - 1) ** 3), 2.0
        else:
            damping, grow = damping * grow, grow * 2
        if damping > 1e12:
            edge = "the lowest loss lies where the model is not stable" if shut else "rounding hides the slope"
            return Minimum(theta, e, J, steps, not shut, edge)
    return Minimum(theta, e, J, steps, False, f"stopped after {max_steps} trials")
