"""A model judged by a record that it was not fitted to: simulated, k steps ahead, by its residuals, by its poles.

The free run is what counts: one step ahead a model that only repeats the last sample does well.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.display import Displayable
from ...core.errors import IdentError
from ..model import Model
from .ahead import k_steps, lagged_inputs, one_step
from .feedback import feedback_detected
from .plausibility import implausible
from .residual_tests import LAGS, ResidualTest, independence, whiteness_of
from .simulated_fit import check_frame, fit_percent, simulated

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...datasets import Record

Array = NDArray[np.float64]
GOOD, POOR = 80.0, 50.0  # % of fit: R2 0.96 and 0.75
CERTAIN = 0.001  # p below which residuals tell of something that the model lacks
LOSES = 15.0  # % of fit between one step ahead and the free run: then the one-step figure flatters


@dataclass(frozen=True, slots=True, repr=False)
class Validation(Displayable):
    """What a record says of a model.

    Attributes
    ----------
    fit : float
        100 (1 - |y - yhat| / |y - mean|), %, of the free run with initial state and offset estimated in each stretch.
    rsquared : float
        1 - |y - yhat|^2 / |y - mean|^2 of the same.
    fit_training_means, fit_zero_state : float
        The same about the operating point of the training record, and from rest (offset estimated).
    ahead : dict of int to float
        Fit k steps ahead, %. Models without a noise model predict at every distance by the free run.
    whiteness, independence : ResidualTest
        Of one-step errors (of the free run, where there is no noise model); of inputs now and before.
    coming : ResidualTest
        Residuals with coming inputs: correlated in a closed loop.
    feedback : str or None
        See `feedback_detected`.
    remarks : tuple of str
        Poles and step; notes.
    held_out : bool
        False where the record is the one that the model was fitted to.
    y, yhat : ndarray, shape (N,)
        Measured and simulated, about the record's own offsets.
    time : ndarray, shape (N,), s
    starts : tuple of int
    verdict : str
        One sentence.
    concern : int
        0 none, 1 look at the remarks, 2 do not tune on it.
    """

    fit: float
    rsquared: float
    fit_training_means: float
    fit_zero_state: float
    ahead: dict[int, float]
    whiteness: ResidualTest
    independence: ResidualTest
    coming: ResidualTest
    feedback: str | None
    remarks: tuple[str, ...]
    held_out: bool
    y: Array = field(repr=False)
    yhat: Array = field(repr=False)
    time: Array = field(repr=False)
    starts: tuple[int, ...] = (0,)
    labels: tuple[str, str] = ("y", "")
    verdict: str = ""
    concern: int = 0

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Measured and simulated output over time."""
        from ..draw import simulated_fit

        return simulated_fit(self, ax)


def validate(model: Model, other: "Record", steps: Sequence[int] = (1, 5, 10), lags: int = LAGS) -> Validation:
    """Judge a model by simulating a record.

    Parameters
    ----------
    model : Model
    other : Record
        One that the model was not fitted to, at the same sample time and in the same units; as it is, or centred.
    steps : sequence of int
        Distances of prediction, samples.
    lags : int
        Of the residual correlations.

    Returns
    -------
    Validation

    Raises
    ------
    IdentError
        A pole at radius 1 or more, another rate or unit, too short a record, an output that stands still.

    Notes
    -----
    Whiteness is no fault of an output-error model: its noise may have a colour, and its errors allow for that.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> rng = np.random.default_rng(1)
    >>> u, e = rng.standard_normal((2, 300))
    >>> model = Model(b=[0.0, 0.5], a=[1.0, -0.8], nk=1, sample_time=0.02)
    >>> other = datasets.Record(u=u, y=model.simulate(u) + 3 + 0.1 * e, sample_time=0.02)
    >>> print(validate(model, other).verdict)
    simulates the record with 83 % fit (R2 0.9727); residuals hold nothing more of u
    """
    check_frame(model, other)
    other, remarks = long_enough(model, other, steps)
    y, s = other.y, other.stretches
    yhat = simulated(model, other)
    step = one_step(model, other, yhat)
    held_out = model.record is None or model.record != other.sha256
    cov = model.cov_params if held_out else None
    past, coming = range(lags + 1), range(-lags, 0)
    left = y - yhat
    mean = np.concatenate([np.full(k.stop - k.start, y[k].mean()) for k in s])
    ahead = {
        k: fit_percent(y[step.rows], y[step.rows] - k_steps(model, step, k), step.stretches) for k in sorted(set(steps))
    }
    found = Validation(
        fit=fit_percent(y, yhat, s),
        rsquared=float(1 - left @ left / ((y - mean) @ (y - mean))),
        fit_training_means=fit_percent(y, simulated(model, other, True, "training"), s),
        fit_zero_state=fit_percent(y, simulated(model, other, False), s),
        ahead=ahead,
        whiteness=whiteness_of(step, cov, not held_out, lags),
        independence=independence(step, lagged_inputs(other, step, past), 0, cov, not held_out),
        coming=independence(step, lagged_inputs(other, step, coming), -lags, cov, not held_out),
        feedback=feedback_detected(other),
        remarks=remarks + implausible(model, max(k.stop - k.start for k in s) * other.sample_time),
        held_out=held_out,
        y=y,
        yhat=yhat,
        time=np.arange(len(other), dtype=np.float64) * other.sample_time,
        starts=other.starts,
        labels=(other.output, other.unit_y),
    )
    return told(found, other.input)


def told(found: Validation, name: str) -> Validation:
    """The verdict in words, with how much it is of concern."""
    where = "the record" if found.held_out else "its own record, which proves little,"
    text = f"simulates {where} with {found.fit:.0f} % fit (R2 {found.rsquared:.4g})"
    concern = 0 if found.fit >= GOOD else 1 if found.fit >= POOR else 2
    nearest = min(found.ahead)
    if found.ahead[nearest] - found.fit > LOSES:
        text += (
            f", while {nearest} step{'s' * (nearest > 1)} ahead it reads {found.ahead[nearest]:.0f} %, which flatters"
        )
        concern = max(concern, 1)
    if found.independence.pvalue < CERTAIN:
        text += (
            f"; residuals still hold some of {name} (p {found.independence.pvalue:.1g}): orders, delay or bent machine"
        )
        concern = max(concern, 1)
    else:
        text += f"; residuals hold nothing more of {name}"
    if found.feedback:
        text, concern = f"{text}; recorded in a closed loop", max(concern, 1)
    if found.fit < POOR:
        text += ". Do not tune on it"
    return replace(found, verdict=text, concern=max(concern, int(bool(found.remarks))))


def long_enough(model: Model, rec: "Record", steps: Sequence[int]) -> tuple["Record", tuple[str, ...]]:
    """The stretches that can judge a free run, and a remark on those that are left out."""
    if not steps or any(k != int(k) or k < 1 for k in steps):
        raise IdentError(f"steps {list(steps)!r}: whole numbers of 1 or more.")
    states = max(model.na, model.nk + model.nb - 1) + 1
    fewest = 3 * states + 5
    kept = [k for k, s in enumerate(rec.stretches) if s.stop - s.start >= fewest]
    if not kept:
        longest = max(s.stop - s.start for s in rec.stretches)
        raise IdentError(
            f"the longest stretch has {longest} samples: initial state and offset are {states} numbers, and judging a "
            f"free run takes {fewest} samples. Record longer."
        )
    if len(kept) == len(rec.starts):
        return rec, ()
    parts = [rec.stretches[k] for k in kept]
    u, y = (np.concatenate([v[s] for s in parts]) for v in (rec.u, rec.y))
    starts = tuple(int(b) for b in np.cumsum([0, *(s.stop - s.start for s in parts)])[:-1])
    left_out = len(rec.starts) - len(kept)
    remark = f"{left_out} stretch{'es' * (left_out > 1)} of fewer than {fewest} samples left out"
    return replace(rec, u=u, y=y, starts=starts, offsets=np.asarray(rec.offsets)[kept]), (remark,)
