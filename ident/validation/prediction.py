"""Free-run simulation and k-step-ahead prediction of a record by a model.

    simulation    y(t) = b/a u(t) + response of 1/a to the initial state + constant
    prediction    y = G u + H e,    e_k = (1 + h_1 q^-1 + ... + h_(k-1) q^-(k-1)) e

Initial state and constant (of an integrating model with a slope) are estimated by least squares in each segment. H is
1/a for arx, c/a for armax, 1/d for box_jenkins and 1 for every other structure, whose prediction over any horizon is
the simulation. Source: Ljung 1999, section 3.2.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from ...core.arrays import Array, Ints
from ...core.errors import IdentError
from ...datasets.records.record import Record
from ..estimators.filters import filtered, lagged
from ..estimators.free_simulation import FreeRun, free_responses, orthonormal, projected_out, regressor_columns
from ..estimators.prediction_error import equation_rows, innovations
from ..model import Model

Offset = Literal["estimate", "training"]


def simulated(
    model: Model, rec: Record, state: bool = True, offset: Offset = "estimate", additional: Array | None = None
) -> Array:
    """Simulated output, shape (N,), in the frame of ``rec.y``.

    Parameters
    ----------
    model : Model
        Stable, or with one pole at exactly 1 (``integrating``).
    rec : Record
    state : bool
        Estimate the initial state of each segment; otherwise it starts from rest at the operating point.
    offset : {"estimate", "training"}
        Constant of each segment, of an integrating model with a slope: estimated, or the operating point of the
        training record.
    additional : ndarray, shape (N, k), optional
        Disturbances of the output (lines, drift), estimated in each segment.

    Raises
    ------
    IdentError
        A pole at radius 1 or more: the simulation grows without bound. Another sample time.

    Examples
    --------
    >>> from fitmodels.datasets import Record
    >>> model = Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1)
    >>> u = np.sin(np.arange(50.0))
    >>> y = model.simulate(u)[20:] + 3.0  # starts from an unknown state, about an offset of 3
    >>> float(np.abs(simulated(model, Record(u=u[20:], y=y, sample_time=0.1)) - y).max()) < 1e-12
    True
    """
    check_frame(model, rec)
    at_u, at_y = operating_points(model, rec)
    run = FreeRun(rec.u - at_u, rec.y, rec.stretches, model.na, model.nb, model.nk, state)
    y = filtered(model.b, model.a, run.u, run.stretches)
    if offset == "training":
        y += at_y
    left = rec.y - y
    return rec.y - projected_out(left, free_columns(run, model, offset == "estimate", additional))


def free_columns(
    run: FreeRun, model: Model, constant: bool, additional: Array | None = None
) -> list[tuple[slice, Array]]:
    """Orthonormal columns, by segment, of the free initial state, constant, or both, and of additional regressors.

    With the constant of an integrating model comes a slope: the input at which its output rests is not known.
    """
    found = _of_start(run, model, constant)
    if additional is None or not additional.shape[1]:
        return found
    held = {s.start: columns for s, columns in found}
    out = []
    for s in run.stretches:
        columns = held.get(s.start, np.empty((0, 0)))
        columns = np.pad(columns, ((0, s.stop - s.start - len(columns)), (0, 0)))
        out.append(
            (s, orthonormal(np.column_stack([columns, additional[s][:, np.abs(additional[s]).max(axis=0) > 0]])))
        )
    return out


def _of_start(run: FreeRun, model: Model, constant: bool) -> list[tuple[slice, Array]]:
    if run.free and run.states:
        found = free_responses(replace(run, constant=constant), model.a)
    elif constant:
        found = [(s, np.full((s.stop - s.start, 1), (s.stop - s.start) ** -0.5)) for s in run.stretches]
    else:
        return []
    if not (constant and model.integrating):
        return found
    return [(s, orthonormal(np.column_stack([columns, np.linspace(-1, 1, len(columns))]))) for s, columns in found]


def operating_points(model: Model, rec: Record) -> tuple[Array, Array]:
    """Operating point of the model relative to the offsets of the record, for each sample: u and y, shape (N,)."""
    length = [s.stop - s.start for s in rec.stretches]
    offsets = np.asarray(rec.offsets)
    if model.operating_point is None:
        return np.zeros(len(rec)), np.zeros(len(rec))
    at = np.asarray(model.operating_point) - offsets
    return np.repeat(at[:, 0], length), np.repeat(at[:, 1], length)


def check_frame(model: Model, rec: Record) -> None:
    """Raise IdentError unless the model can simulate the record."""
    if abs(rec.sample_time / model.sample_time - 1) > 1e-3:
        raise IdentError(
            f"the record is sampled every {rec.sample_time:g} s, the model every {model.sample_time:g} s: resample "
            f"the record (rec.resampled({1 / model.sample_time:g}))."
        )
    for what, here, there in (("input", rec.unit_u, model.unit_u), ("output", rec.unit_y, model.unit_y)):
        if here and there and here != there:
            raise IdentError(f"{what} of the record is in {here}, of the model in {there}: convert one of them.")
    if not (model.stable or model.integrating):
        raise IdentError(
            f"unstable: a pole at radius {model.radius:.4g}, so the simulation grows without bound however well the "
            "model predicts one step ahead. Try nk = 0, lower orders, or output error."
        )


def fit_percent(y: Array, yhat: Array, stretches: tuple[slice, ...]) -> float:
    """100 (1 - |y - yhat| / |y - mean of each stretch|), %: 100 is perfect, 0 no better than the mean."""
    total = sum(float(np.sum((y[s] - y[s].mean()) ** 2)) for s in stretches)
    if total == 0:
        raise IdentError("the output does not vary in this record: its fit in per cent is undefined. Check the sensor.")
    return float(100 * (1 - np.sqrt(np.sum((y - yhat) ** 2) / total)))


BY_EQUATION = ("arx", "armax")  # structures whose noise passes through 1/a


def has_noise_model(model: Model) -> bool:
    """Whether H differs from 1; otherwise a prediction is the simulation."""
    return any(len(polynomial) > 1 for polynomial in model.noise)


@dataclass(frozen=True, slots=True)
class OneStep:
    """One-step prediction errors of a model on a record, with their sensitivities.

    Attributes
    ----------
    e : ndarray, shape (N,)
        For the rows with all regressors, the free offset (and initial state) projected out.
    J : ndarray, shape (N, p)
        d prediction / d coefficient: a, b, and c for armax, d for box_jenkins.
    rows : ndarray of int, shape (N,)
        Sample index of each row.
    stretches : tuple of slice
        Of ``e``.
    free : list of (slice, ndarray)
        Orthonormal columns of what was estimated in each segment.
    """

    e: Array
    J: Array
    rows: Ints
    stretches: tuple[slice, ...]
    free: list[tuple[slice, Array]]


def one_step(model: Model, rec: Record, simulated: Array, additional: Array | None = None) -> OneStep:
    """One-step errors; without a noise model, the errors of the simulation ``simulated`` (N,).

    ``additional`` (N, k) are regressors of the output, which a noise model of the equation does not separate.
    """
    if model.structure not in BY_EQUATION:
        return _whitened(model, rec, simulated, additional)
    y, Phi, stretches = equation_rows(rec.centred(), model.na, model.nb, model.nk)
    span = max(model.na, model.nk + model.nb - 1)
    rows = np.concatenate([np.arange(min(s.start + span, s.stop), s.stop) for s in rec.stretches])
    e, J = innovations(np.r_[model.theta, model.c[1:]], y, Phi, stretches)
    level = filtered([1.0], model.c, np.ones(len(e)), stretches)  # effect of a constant of y on e
    q = [(s, level[s, None] / np.linalg.norm(level[s])) for s in stretches]
    return OneStep(projected_out(e[:, None], q)[:, 0], projected_out(J, q), rows, stretches, q)


def _whitened(model: Model, rec: Record, simulated: Array, additional: Array | None) -> OneStep:
    """Simulation errors filtered by d, without the first samples of each segment, whose past is not known."""
    at_u, _ = operating_points(model, rec)
    run = FreeRun(rec.u - at_u, rec.y, rec.stretches, model.na, model.nb, model.nk, True)
    q = free_columns(run, model, True, additional)
    J = regressor_columns(run, *(filtered([1.0], model.a, x, rec.stretches) for x in (simulated, run.u)))
    e, nd = rec.y - simulated, len(model.d) - 1
    if not nd:
        return OneStep(e, projected_out(J, q), np.arange(len(rec)), rec.stretches, q)
    rows = np.concatenate([np.arange(s.start + nd, s.stop) for s in rec.stretches])
    ends = np.cumsum([0, *(s.stop - s.start - nd for s in rec.stretches)]).tolist()
    stretches = tuple(slice(a, b) for a, b in pairwise(ends))
    white = filtered(model.d, [1.0], np.column_stack([e, J]), rec.stretches)
    J = np.column_stack([white[:, 1:], -lagged(e, range(1, nd + 1), rec.stretches)])
    free = []
    for (s, columns), to in zip(q, stretches, strict=True):
        whole = np.zeros((to.stop - to.start + nd, columns.shape[1]))
        whole[: s.stop - s.start] = columns
        free.append((to, orthonormal(filtered(model.d, [1.0], whole, (slice(0, len(whole)),))[nd:])))
    return OneStep(projected_out(white[rows, 0], free), projected_out(J[rows], free), rows, stretches, free)


def k_steps(model: Model, step: OneStep, k: int) -> Array:
    """k-step-ahead errors, shape (N,); the first k - 1 of each segment span fewer steps."""
    if k == 1 or not has_noise_model(model):
        return step.e
    pulse = np.zeros(k)
    pulse[0] = 1.0
    h = filtered(*model.noise, pulse, (slice(0, k),))
    return filtered(h, [1.0], step.e, step.stretches)


def lagged_inputs(rec: Record, step: OneStep, lags: range) -> Array:
    """Inputs u(t - lag) at the rows of ``step``, shape (N, lags); lags below zero are future inputs; zero outside."""
    u = np.concatenate([rec.u[s] - rec.u[s].mean() for s in rec.stretches])
    past = [lag for lag in lags if lag >= 0]
    out = np.zeros((len(rec), len(lags)))
    if past:
        out[:, -len(past) :] = lagged(u, range(past[0], past[-1] + 1), rec.stretches)
    for column, lag in enumerate(lags):
        if lag < 0:
            for s in rec.stretches:
                out[s.start : max(s.stop + lag, s.start), column] = u[min(s.start - lag, s.stop) : s.stop]
    return out[step.rows]
