"""A free run of a model over a record, laid on it with the initial state and the offset that fit best.

y(t) = b/a u(t) + response of 1/a to the unknown past + constant,    both by least squares in each stretch
"""

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.errors import IdentError
from ..estimators.filters import filtered
from ..estimators.free_run import FreeRun, free_responses, without
from ..model import Model

if TYPE_CHECKING:
    from ...datasets import Record

Array = NDArray[np.float64]
Offset = Literal["estimate", "training"]


def simulated(model: Model, rec: "Record", state: bool = True, offset: Offset = "estimate") -> Array:
    """Simulated output, shape (N,), in the frame of ``rec.y``.

    Parameters
    ----------
    model : Model
        Stable.
    rec : Record
    state : bool
        Estimate the initial state of each stretch; else it starts from rest at the operating point.
    offset : {"estimate", "training"}
        The constant of each stretch is estimated, or is the operating point that the model was fitted about.

    Raises
    ------
    IdentError
        A pole at radius 1 or more: a free run grows without bound. Another sample time.

    Examples
    --------
    >>> from fitmodels.datasets import Record
    >>> model = Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1)
    >>> u = np.sin(np.arange(50.0))
    >>> y = model.simulate(u)[20:] + 3.0  # begins somewhere under way, about 3
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
    return rec.y - without(left, freedom(run, model.a, offset == "estimate"))


def freedom(run: FreeRun, a: Array, constant: bool) -> list[tuple[slice, Array]]:
    """Orthonormal columns, by stretch, of what is free: the initial state, a constant, or both."""
    if run.free and run.states:
        return free_responses(replace(run, constant=constant), a)
    if not constant:
        return []
    return [(s, np.full((s.stop - s.start, 1), (s.stop - s.start) ** -0.5)) for s in run.stretches]


def operating_points(model: Model, rec: "Record") -> tuple[Array, Array]:
    """The model's operating point in the frame of the record, for each sample: u and y, shape (N,) each."""
    length = [s.stop - s.start for s in rec.stretches]
    offsets = np.asarray(rec.offsets)
    if model.operating_point is None:
        return np.zeros(len(rec)), np.zeros(len(rec))
    at = np.asarray(model.operating_point) - offsets
    return np.repeat(at[:, 0], length), np.repeat(at[:, 1], length)


def check_frame(model: Model, rec: "Record") -> None:
    """A model that can be run over a record, or IdentError."""
    if abs(rec.sample_time / model.sample_time - 1) > 1e-3:
        raise IdentError(
            f"the record is sampled every {rec.sample_time:g} s, the model every {model.sample_time:g} s: bring the "
            f"record to the model's rate (rec.resampled({1 / model.sample_time:g}))."
        )
    for what, here, there in (("input", rec.unit_u, model.unit_u), ("output", rec.unit_y, model.unit_y)):
        if here and there and here != there:
            raise IdentError(f"{what} of the record is in {here}, of the model in {there}: bring them to one unit.")
    if not model.stable:
        raise IdentError(
            f"unstable: a pole at radius {model.radius:.4g}, so a free run grows without bound however well the model "
            "predicts one step ahead. Try nk = 0, lower orders, or output error."
        )


def fit_percent(y: Array, yhat: Array, stretches: tuple[slice, ...]) -> float:
    """100 (1 - |y - yhat| / |y - mean of each stretch|), %: 100 is perfect, 0 no better than the mean."""
    total = sum(float(np.sum((y[s] - y[s].mean()) ** 2)) for s in stretches)
    if total == 0:
        raise IdentError("the output does not vary in this record: a fit in percent of nothing.")
    return float(100 * (1 - np.sqrt(np.sum((y - yhat) ** 2) / total)))
