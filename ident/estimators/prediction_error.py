"""Output error and ARMAX by the prediction error method, minimised by Levenberg-Marquardt.

    output error    y = b/f u + e            the simulation error is minimised
    ARMAX           a y = b u + c e          the one-step error e is minimised

Sources: Ljung 1999, System Identification, sections 4.2 and 10.2-10.3; Marquardt 1963, doi 10.1137/0111030; damping by
the gain ratio as in Nielsen 1999 (IMM-REP-1999-05).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...core.arrays import Array
from ...core.threads import one_thread
from ...datasets.records.record import Record
from ..model import Model
from .build_model import convergence_note, output_error_model, record_facts
from .filters import (
    EDGE,
    ROUNDING,
    filtered,
    inverse_of_squares,
    is_stable,
    lagged,
    reflected,
    solved_step,
    squares,
    whitening,
)
from .free_simulation import FreeRun, free_run, sensitivities
from .input_checks import check_identifiable, checked_record, not_centred, short_stretches
from .instrumental import Initial, estimate, unstable_arx_note
from .regressors import arx_regressors

TINY = float(np.finfo(np.float64).tiny)
Evaluate = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True, slots=True)
class Minimum:
    """Result of the minimisation.

    Attributes
    ----------
    theta : ndarray, shape (p,)
    e : ndarray, shape (N,)
        Error at the minimum.
    J : ndarray, shape (N, p)
        d (prediction) / d theta = -d e / d theta.
    steps : int
        Steps accepted.
    converged : bool
    reason : str
        Reason for stopping.
    """

    theta: Array
    e: Array
    J: Array
    steps: int
    converged: bool
    reason: str


def damped_step(J: Array, e: Array, damping: float) -> tuple[Array, float]:
    """Step of theta and the predicted reduction of the loss; columns are scaled to length 1."""
    H, g = J.T @ J, J.T @ e
    scale = np.sqrt(np.maximum(H.diagonal(), TINY))
    H = H / (scale[:, None] * scale)
    g = g / scale
    H.flat[:: len(g) + 1] += damping
    step = solved_step(H, g)
    return step / scale, float(step @ (damping * step + g))


def minimise(
    theta: Array,
    evaluate: Evaluate,
    allowed: Callable[[Array], bool],
    size: float,
    tol: float = 1e-12,
    max_steps: int = 100,
    damping: float = 1e-4,
) -> Minimum:
    """Minimise e'e by Levenberg-Marquardt, restricted to admissible theta.

    Parameters
    ----------
    theta : ndarray, shape (p,)
        Start.
    evaluate : callable
        theta -> e (N,), J (N, p).
    allowed : callable
        theta -> whether the model is admissible (stable, invertible); steps that leave the region are shortened.
    size : float
        Sum of squares of the data: losses below ``ROUNDING`` of it count as zero.
    tol : float
        Converged when the predicted reduction is below this share of the loss.
    max_steps : int
        Largest number of trials, accepted or not.
    damping : float
        Of the first step, relative to sensitivities of length 1. It falls to a third at best in each step, so a small
        one spares steps from a good start.
    """
    e, J = evaluate(theta)
    loss, grow, steps, outside = squares(e), 2.0, 0, False
    for _ in range(max_steps):
        if loss <= ROUNDING * size:
            return Minimum(theta, e, J, steps, True, "exact fit")
        step, promised = damped_step(J, e, damping)
        if promised <= tol * loss and (damping < 1 or not outside):
            return Minimum(theta, e, J, steps, True, "no step reduces the loss further")
        trial = theta + step
        if outside_now := not allowed(trial):
            gain = -1.0
        else:
            e_trial, J_trial = evaluate(trial)
            lower = squares(e_trial)
            gain = (loss - lower) / promised
        outside = outside_now or (outside and gain <= 0)
        if gain > 0:
            theta, e, J, loss, steps = trial, e_trial, J_trial, lower, steps + 1
            damping, grow = damping * max(1 / 3, 1 - (2 * min(gain, 1) - 1) ** 3), 2.0
        else:
            damping, grow = damping * grow, grow * 2
        if damping > 1e12:
            edge = "the lowest loss lies at the stability limit" if outside else "the gradient is below rounding"
            return Minimum(theta, e, J, steps, not outside, edge)
    return Minimum(theta, e, J, steps, False, f"stopped after {max_steps} trials")


@one_thread
def output_error(
    rec: Record | Sequence[Record],
    nb: int,
    nf: int,
    nk: int = 1,
    *,
    initial: Initial = "auto",
    max_steps: int = 100,
    tol: float = 1e-12,
) -> Model:
    """Transfer function with the least-squares simulation error; consistent under coloured noise on y.

    Parameters
    ----------
    rec : Record or sequence of Record
        With its operating point removed (``rec.centred()``), recorded in open loop: feedback biases the estimate.
    nb, nf, nk : int
        Number of coefficients of b, order of f (``Model.a``), samples of delay.
    initial : {"auto", "zero", "estimate", "offset"}
        Initial state of each segment: at rest, estimated, estimated where BIC favours it, or estimated together with
        a constant, for an unknown operating point.
    max_steps, tol : int, float
        Largest number of trials; converged when the predicted reduction is below ``tol`` of the loss.

    Returns
    -------
    Model
        Stable; ``notes`` state convergence and the treatment of the initial state.

    Raises
    ------
    IdentError
        Invalid orders, or larger than the record allows; too short a record; constant u or y.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> u = np.sin(0.002 * np.arange(300.0) ** 2)
    >>> y = Model(b=[0.0, 0.5], a=[1.0, -0.8], nk=1, sample_time=0.02).simulate(u)
    >>> output_error(datasets.Record(u=u, y=y, sample_time=0.02), nb=1, nf=1).theta.round(9).tolist()
    [-0.8, 0.5]
    """
    rec = checked_record(rec, {"nb": nb, "nf": nf}, nk)
    run, start, _, _ = estimate(free_run(rec, nf, nb, nk), initial, max_steps=8, tol=1e-3)
    end = free_run_minimum(run, start.theta, max_steps, tol)
    return output_error_model(
        rec, run, end.theta, "output_error", (search_note(end), *unstable_arx_note(run, squares(end.e)))
    )


def free_run_minimum(run: FreeRun, theta: Array, max_steps: int, tol: float) -> Minimum:
    """Levenberg-Marquardt on the simulation error, restricted to stable models."""

    def stable(theta: Array) -> bool:
        return is_stable(run.polynomials(theta)[1], EDGE)

    return minimise(theta, lambda th: sensitivities(run, th), stable, squares(run.y), tol, max_steps)


def search_note(end: Minimum) -> str:
    """Convergence of the minimisation, for ``notes``."""
    return f"{convergence_note(end.steps, end.converged, 'Levenberg-Marquardt')}: {end.reason}"


@one_thread
def armax(
    rec: Record | Sequence[Record], na: int, nb: int, nc: int, nk: int = 1, *, max_steps: int = 100, tol: float = 1e-12
) -> Model:
    """Transfer function and noise polynomial with the least one-step prediction error.

    Parameters
    ----------
    rec : Record or sequence of Record
        With its operating point removed (``rec.centred()``).
    na, nb, nc, nk : int
        Order of a, number of coefficients of b, order of c, samples of delay.
    max_steps, tol : int, float
        Largest number of trials; converged when the predicted reduction is below ``tol`` of the loss.

    Returns
    -------
    Model
        ``c`` is invertible; ``cov_params`` is the covariance of a and b, allowing for the estimation of c. ``notes``
        state convergence, and an unstable simulation.

    Raises
    ------
    IdentError
        Invalid orders, or larger than the record allows; too short a record; constant u or y.

    Notes
    -----
    The first max(na, nb + nk - 1) samples of each segment are not predicted, and the innovations before them are taken
    as zero.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> u = np.sin(0.002 * np.arange(300.0) ** 2)
    >>> e = 0.01 * np.random.default_rng(1).standard_normal(300)
    >>> whole = [slice(0, 300)]
    >>> y = filtered([0.0, 0.5], [1.0, -0.8], u, whole) + filtered([1.0, 0.5], [1.0, -0.8], e, whole)
    >>> armax(datasets.Record(u=u, y=y, sample_time=0.02), na=1, nb=1, nc=1).theta.round(2).tolist()
    [-0.8, 0.5]
    """
    orders = {"na": na, "nb": nb, "nc": nc}
    rec = checked_record(rec, orders, nk)
    y, Phi, stretches = equation_rows(rec, na, nb, nk)
    residual = y - Phi @ np.linalg.lstsq(Phi, y, rcond=None)[0]
    noiseless = squares(residual) <= 1e4 * ROUNDING * squares(y)
    order = 0 if noiseless else nc
    starts = noise_starts(y, Phi, stretches, order)
    ends = [innovations_minimum(y, Phi, stretches, order, start, max_steps, tol) for start in starts]
    end = min(ends, key=lambda end: squares(end.e))
    check_identifiable(end.J, orders)
    variance = squares(end.e) / max(len(y) - len(end.theta), 1)
    a, b, c = np.split(end.theta, [na, na + nb])
    model = Model(
        b=np.r_[np.zeros(nk), b], a=np.r_[1.0, a], c=np.r_[1.0, c, np.zeros(nc - order)], nk=nk, structure="armax",
        cov_params=variance * inverse_of_squares(end.J)[: na + nb, : na + nb], noise_variance=variance,
        **{**record_facts(rec), "n": len(y)},
        notes=(search_note(end), *rec.notes, *not_centred(rec), *short_stretches(rec, max(na, nk + nb - 1))),
    )  # fmt: skip
    more = ["noise-free record: c is set to 1"] if order < nc else []
    more += [] if model.stable else [f"the simulation is unstable: a pole has modulus {model.radius:.4g}"]
    return replace(model, notes=(*model.notes, *more))


def equation_rows(rec: Record, na: int, nb: int, nk: int) -> tuple[Array, Array, tuple[slice, ...]]:
    """Output y, its regressors -y(t - i), u(t - j), and the segments of the samples with all regressors."""
    Phi, y, t = arx_regressors(rec, na, nb, nk)
    ends = np.r_[0, np.searchsorted(t, [s.stop for s in rec.stretches])].tolist()
    return y, Phi, tuple(slice(a, b) for a, b in pairwise(ends) if b > a)


def innovations(theta: Array, y: Array, Phi: Array, stretches: tuple[slice, ...]) -> tuple[Array, Array]:
    """One-step error e = (y - Phi theta) / c and d yhat / d theta = [Phi, e(t - k)] / c, from rest in each segment."""
    p = Phi.shape[1]
    c = np.r_[1.0, theta[p:]]
    e = filtered([1.0], c, y - Phi @ theta[:p], stretches)
    past = lagged(e, range(1, len(c)), stretches)
    return e, filtered([1.0], c, np.hstack([Phi, past]), stretches)


def noise_starts(y: Array, Phi: Array, stretches: tuple[slice, ...], nc: int) -> list[Array]:
    """Starting values: ARX, and ARX with its whitened residuals as regressors (Hannan & Rissanen 1982)."""
    first = np.linalg.lstsq(Phi, y, rcond=None)[0]
    residual = y - Phi @ first
    white = filtered(whitening(residual, stretches)[0], [1.0], residual, stretches)
    both = np.hstack([Phi, lagged(white, range(1, nc + 1), stretches)])
    second = np.linalg.lstsq(both, y, rcond=None)[0]
    p = len(first)
    return [np.r_[first, np.zeros(nc)], np.r_[second[:p], reflected(np.r_[1.0, second[p:]])[1:]]][: 1 + (nc > 0)]


def innovations_minimum(
    y: Array, Phi: Array, stretches: tuple[slice, ...], nc: int, start: Array, max_steps: int, tol: float
) -> Minimum:
    """Levenberg-Marquardt on the one-step error, restricted to stable 1 / c."""

    def invertible(theta: Array) -> bool:
        return is_stable(np.r_[1.0, theta[len(theta) - nc :]], EDGE)

    return minimise(start, lambda th: innovations(th, y, Phi, stretches), invertible, squares(y), tol, max_steps)
