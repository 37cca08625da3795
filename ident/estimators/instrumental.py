"""Refined instrumental variables (SRIV): the transfer function without a noise model, unbiased by sensor noise.

    y(t) = x(t) + e(t),    x = b(q) / a(q) u

Each iteration filters u and y by 1 / a of the previous one and solves Z'Phi theta = Z'y with the simulated, noise-free
x in the instruments Z. Source: Young 2011, Recursive Estimation and Time-Series Analysis, section 7.4; Ljung 1999,
section 7.6; first steps with a given filter: Steiglitz & McBride 1965, doi 10.1109/TAC.1965.1098181.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ...core.arrays import Array
from ...core.threads import one_thread
from ...datasets.records.record import Record
from ..model import Model
from .build_model import convergence_note, output_error_model
from .filters import ROUNDING, filtered, is_stable, lagged, reflected, squares
from .free_simulation import (
    FreeRun,
    free_responses,
    free_run,
    projected_out,
    regressor_columns,
    sensitivities,
    simulation_error,
    with_initial_states,
)
from .input_checks import checked_record

Initial = Literal["auto", "zero", "estimate", "offset"]
POLES = (0.5, 0.8, 0.95)  # of the prefilters 1 / (1 - p q^-1)^na for the starting values, in addition to none
SAME = 1e-3  # two starts whose losses differ by less than this share have found one minimum
PATIENCE = 8  # steps; under strongly coloured noise Z'Phi may cycle, where Z'Z converges


@dataclass(frozen=True, slots=True)
class Iterate:
    """A stable theta (na + nb,) and the sum of squares of its simulation error."""

    theta: Array
    loss: float


def point(run: FreeRun, theta: Array) -> Iterate:
    """Theta with its poles reflected into the unit circle, and its loss."""
    stable = np.r_[reflected(np.r_[1.0, theta[: run.na]])[1:], theta[run.na :]]
    return Iterate(stable, squares(simulation_error(run, stable)))


def prefiltered(run: FreeRun, pole: float) -> Array:
    """Least squares on u and y filtered by 1 / (1 - pole q^-1)^na; pole 0: plain ARX."""
    den = np.real(np.poly(np.full(max(run.na, 1), pole)))
    return equation_fit(run, run.y, den)


def equation_fit(run: FreeRun, y: Array, den: Array) -> Array:
    """Theta of a y = b u by least squares, both sides filtered by 1 / den, initial states projected out."""
    yf = filtered([1.0], den, y, run.stretches)
    Phi = regressor_columns(run, yf, filtered([1.0], den, run.u, run.stretches))
    free = free_responses(run, den)
    return np.asarray(
        np.linalg.lstsq(projected_out(Phi, free), projected_out(yf, free), rcond=None)[0], dtype=np.float64
    )


def reduced(run: FreeRun) -> Array:
    """Least squares on the output of a long estimated impulse response: a reduced high-order model."""
    order = min(max(8 * (run.na + run.nb), 20), len(run.y) // 4)
    Phi = lagged(run.u, range(run.nk, run.nk + order), run.stretches)
    x = Phi @ np.linalg.lstsq(Phi, run.y, rcond=1e-6)[0]
    return equation_fit(run, x, np.ones(1))


def instrumental_step(run: FreeRun, theta: Array, symmetric: bool = False) -> Array:
    """Step of theta; the gradient Z'e is exact, so that the stationary point is unbiased.

    ``symmetric`` replaces Z'Phi by Z'Z (Young's symmetric form): the same stationary point, always a descent direction.
    """
    e, Z = sensitivities(run, theta)
    a = run.polynomials(theta)[1]
    Phi = Z if symmetric else regressor_columns(run, *(filtered([1.0], a, x, run.stretches) for x in (run.y, run.u)))
    scale = np.linalg.norm(Z, axis=0)
    scale[scale == 0] = 1.0
    Z = Z / scale
    return np.asarray(np.linalg.lstsq(Z.T @ Phi / scale, Z.T @ e, rcond=1e-14)[0] / scale, dtype=np.float64)


def stride(run: FreeRun, start: Iterate, steps: int) -> Iterate:
    """The best of a few full steps, including steps that increase the loss."""
    best = here = start
    for _ in range(steps):
        here = point(run, here.theta + instrumental_step(run, here.theta))
        if not np.isfinite(here.loss):
            break
        best = min(best, here, key=lambda p: p.loss)
    return best


def refine(run: FreeRun, start: Iterate, max_steps: int, tol: float) -> tuple[Iterate, int, bool]:
    """Descent steps until none reduces the loss, or theta changes by less than ``tol``."""
    here, symmetric = start, False
    for k in range(max_steps):
        symmetric = symmetric or k >= PATIENCE
        there = downhill(run, here, symmetric)
        if there is None and not symmetric:
            symmetric = True
            there = downhill(run, here, symmetric)
        if there is None:
            return here, k, stationary(run, here)
        moved = np.abs(there.theta - here.theta).max() / max(np.abs(here.theta).max(), np.finfo(float).tiny)
        fell = 1 - there.loss / here.loss
        here = there
        if moved < tol or fell < tol**1.5:
            return here, k + 1, True
    return here, max_steps, False


def downhill(run: FreeRun, here: Iterate, symmetric: bool) -> Iterate | None:
    """One step, halved until the loss is lower; None if it never is."""
    step = instrumental_step(run, here.theta, symmetric)
    for half in range(12):
        there = point(run, here.theta + step / 2**half)
        if there.loss < here.loss:
            return there
    return None


def stationary(run: FreeRun, at: Iterate) -> bool:
    """Whether the error is orthogonal to every sensitivity, or no more than rounding."""
    e, Z = sensitivities(run, at.theta)
    along = np.linalg.qr(Z)[0].T @ e
    return squares(along) <= 1e-6 * at.loss or at.loss <= 1e4 * ROUNDING * squares(run.y)


def starts(run: FreeRun) -> Iterator[Array]:
    """Starting values: ARX, ARX of filtered data, a reduced long impulse response; each computed on demand."""
    yield prefiltered(run, 0.0)
    for pole in POLES:
        yield prefiltered(run, pole)
    yield reduced(run)


def search(run: FreeRun) -> Iterate:
    """The best of several starts; stops early when two have found the same lowest loss."""
    found: list[Iterate] = []
    for theta in starts(run):
        found.append(stride(run, point(run, theta), 4))
        lowest = sorted(p.loss for p in found)[:2]
        if len(found) > 1 and lowest[1] <= lowest[0] * (1 + SAME):
            break
    return min(found, key=lambda p: p.loss)


@one_thread
def sriv(
    rec: Record | Sequence[Record],
    na: int,
    nb: int,
    nk: int = 1,
    *,
    initial: Initial = "auto",
    max_steps: int = 60,
    tol: float = 1e-9,
) -> Model:
    """Transfer function by refined instrumental variables: consistent under coloured noise on y.

    Parameters
    ----------
    rec : Record or sequence of Record
        With its operating point removed (``rec.centred()``), recorded in open loop: feedback biases the estimate.
    na, nb, nk : int
        Order of a, number of coefficients of b, samples of delay.
    initial : {"auto", "zero", "estimate", "offset"}
        Initial state of each segment: at rest, estimated, estimated where BIC favours it, or estimated together with
        a constant, for an unknown operating point.
    max_steps, tol : int, float
        Largest number of steps, and the relative change of theta at convergence; of the loss,
        ``tol**1.5``.

    Returns
    -------
    Model
        Stable; ``notes`` state convergence and the treatment of the initial state.

    Raises
    ------
    IdentError
        Invalid orders, or larger than the record allows; too short a record; constant u or y.

    Notes
    -----
    Poles outside the unit circle are reflected into it during the iteration; of several starting points, the lowest
    simulation error is taken.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> u = np.sin(0.002 * np.arange(300.0) ** 2)
    >>> y = Model(b=[0.0, 0.5], a=[1.0, -0.8], nk=1, sample_time=0.02).simulate(u)
    >>> sriv(datasets.Record(u=u, y=y, sample_time=0.02), na=1, nb=1).theta.round(9).tolist()
    [-0.8, 0.5]
    """
    rec = checked_record(rec, {"na": na, "nb": nb}, nk)
    run, best, steps, converged = estimate(free_run(rec, na, nb, nk), initial, max_steps, tol)
    notes = (convergence_note(steps, converged, "instrumental variable"), *unstable_arx_note(run, best.loss))
    return output_error_model(rec, run, best.theta, "sriv", notes)


def estimate(run: FreeRun, initial: Initial, max_steps: int, tol: float) -> tuple[FreeRun, Iterate, int, bool]:
    """Starting values, choice of the initial state, and refinement."""
    run = replace(run, free=initial in ("estimate", "offset"), constant=initial == "offset")
    best = search(run)
    if initial == "auto" and (freed := with_initial_states(run, best.theta)).free:
        run, best = freed, search(freed)
    return run, *refine(run, best, max_steps, tol)


def unstable_arx_note(run: FreeRun, loss: float) -> tuple[str, ...]:
    """A note where the unstable ARX model simulates y more closely than the best stable model."""
    theta = prefiltered(run, 0.0)
    with np.errstate(all="ignore"):
        unstable = not is_stable(run.polynomials(theta)[1])
        if not unstable or not squares(simulation_error(run, theta)) < loss:
            return ()
    radius = np.abs(np.roots(run.polynomials(theta)[1])).max()
    return (
        f"an unstable model (a pole at radius {radius:.4g}) simulates the output better than the best stable one: "
        "the plant is unstable. Identify it in closed loop, or over shorter runs.",
    )
