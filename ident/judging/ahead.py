"""Errors of prediction k steps ahead, from those one step ahead.

    y = G u + H e,    e_k = (1 + h_1 q^-1 + ... + h_(k-1) q^-(k-1)) e

H is 1/a of arx, c/a of armax, and 1 of every other structure, whose prediction at any distance is the free run.
Source: Ljung 1999, section 3.2.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..estimators.filters import filtered, lagged
from ..estimators.free_run import FreeRun, by_a_and_b
from ..estimators.prediction_error import equation_rows, innovations
from ..model import Model
from .simulated_fit import freedom, operating_points

if TYPE_CHECKING:
    from ...datasets import Record

Array = NDArray[np.float64]
PREDICTORS = ("arx", "armax")  # structures with a noise model: the others predict by the free run


@dataclass(frozen=True, slots=True)
class OneStep:
    """One-step errors of a model on a record, and what they are made of.

    Attributes
    ----------
    e : ndarray, shape (N,)
        Of the rows that have all regressors, less what the free offset (and initial state) explain.
    J : ndarray, shape (N, p)
        d prediction / d coefficient: a, b, and c of armax.
    rows : ndarray of int, shape (N,)
        Sample of each.
    stretches : tuple of slice
        Of ``e``.
    free : list of (slice, ndarray)
        Orthonormal columns that were fitted to this record in each stretch.
    """

    e: Array
    J: Array
    rows: NDArray[np.intp]
    stretches: tuple[slice, ...]
    free: list[tuple[slice, Array]]


def one_step(model: Model, rec: "Record", simulated: Array) -> OneStep:
    """Errors one step ahead; of a model without a noise model, those of the free run ``simulated`` (N,)."""
    if model.structure not in PREDICTORS:
        at_u, _ = operating_points(model, rec)
        run = FreeRun(rec.u - at_u, rec.y, rec.stretches, model.na, model.nb, model.nk, True)
        q = freedom(run, model.a, True)
        J = by_a_and_b(run, *(filtered([1.0], model.a, x, rec.stretches) for x in (simulated, run.u)))
        return OneStep(rec.y - simulated, projected(J, q), np.arange(len(rec)), rec.stretches, q)
    y, Phi, stretches = equation_rows(rec.centred(), model.na, model.nb, model.nk)
    span = max(model.na, model.nk + model.nb - 1)
    rows = np.concatenate([np.arange(min(s.start + span, s.stop), s.stop) for s in rec.stretches])
    e, J = innovations(np.r_[model.theta, model.c[1:]], y, Phi, stretches)
    level = filtered([1.0], model.c, np.ones(len(e)), stretches)  # what a constant of y leaves in e
    q = [(s, level[s, None] / np.linalg.norm(level[s])) for s in stretches]
    return OneStep(projected(e[:, None], q)[:, 0], projected(J, q), rows, stretches, q)


def projected(x: Array, free: list[tuple[slice, Array]]) -> Array:
    """X (N, k) less its part along the free columns."""
    out = x.copy()
    for s, q in free:
        out[s] -= q @ (q.T @ x[s])
    return out


def k_steps(model: Model, step: OneStep, k: int) -> Array:
    """Errors k steps ahead, shape (N,); the first k - 1 of each stretch are of fewer steps."""
    if model.structure not in PREDICTORS or k == 1:
        return step.e
    pulse = np.zeros(k)
    pulse[0] = 1.0
    h = filtered(model.c, model.a, pulse, (slice(0, k),))
    return filtered(h, [1.0], step.e, step.stretches)


def lagged_inputs(rec: "Record", step: OneStep, lags: range) -> Array:
    """U(t - lag) at the rows of ``step``, shape (N, lags); negative lags are coming inputs; zero beyond a stretch."""
    u = np.concatenate([rec.u[s] - rec.u[s].mean() for s in rec.stretches])
    past = [lag for lag in lags if lag >= 0]
    out = np.zeros((len(rec), len(lags)))
    if past:
        out[:, -len(past) :] = lagged(u, range(past[0], past[-1] + 1), rec.stretches)
    for column, lag in enumerate(lags):
        if lag < 0:
            for s in rec.stretches:
                out[s.start : s.stop + lag, column] = u[s.start - lag : s.stop]
    return out[step.rows]
