"""A model judged by a record that it was not fitted to: simulated, k steps ahead, by its residuals, by its poles.

The free run is what counts: one step ahead a model that only repeats the last sample does well.

Poles and step of a model against what a machine can be and what the record can have shown.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.display import Plottable
from ...core.errors import IdentError
from ..estimators.bias_checks import feedback_detected
from ..model import Model
from .prediction import check_frame, fit_percent, k_steps, lagged_inputs, one_step, simulated
from .residual_tests import LAGS, ResidualTest, independence, whiteness_of

if TYPE_CHECKING:
    from ...datasets import Record

Array = NDArray[np.float64]
GOOD, POOR = 80.0, 50.0  # % of fit: R2 0.96 and 0.75
CERTAIN = 0.001  # p below which residuals tell of something that the model lacks
LOSES = 15.0  # % of fit between one step ahead and the free run: then the one-step figure flatters


@dataclass(frozen=True, slots=True, repr=False)
class Validation(Plottable):
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


RINGING = 0.1  # damping ratio below which an axis would be heard
FAST = 0.3  # radius of a pole at or near half the sample rate that is more than a fitting of noise


def settling_time(model: Model, share: float = 0.02) -> float:
    """Seconds after which the step response stays within ``share`` of its end; infinite where it never does.

    >>> round(settling_time(Model(b=[0.0, 0.1], a=[1.0, -0.9], nk=1, sample_time=0.1)), 6)
    3.8
    """
    if not model.stable:
        return float("inf")
    end, n = model.dc_gain, 256
    while True:
        step = model.simulate(np.ones(n))
        away = np.flatnonzero(np.abs(step - end) > share * max(abs(end), 1e-12 * np.abs(step).max()))
        settled = int(away[-1]) + 1 if away.size else 0
        if settled < n // 2 or n > 4_000_000:
            return settled * model.sample_time if settled < n else float("inf")
        n *= 4


def implausible(model: Model, longest: float) -> tuple[str, ...]:
    """What speaks against the poles and the step, in sentences; ``longest`` is the longest stretch in seconds."""
    told = []
    settling = settling_time(model)
    if settling > longest:
        told.append(
            f"the step settles in {settling:.3g} s and the longest stretch has {longest:.3g} s: the gain at rest "
            f"({model.dc_gain:.4g}) is a guess beyond the record"
        )
    for p in model.poles[np.abs(model.poles) > 0]:
        s = np.log(p) / model.sample_time
        damping, hertz = -s.real / abs(s), abs(s) / (2 * np.pi)
        if p.imag > 0 and damping < RINGING:
            told.append(f"a mode at {hertz:.3g} Hz rings (damping {damping:.2g}): see that a run shows it")
        if p.imag == 0 and p.real < -FAST:
            told.append(
                f"a pole at {p.real:.2g} alternates from sample to sample: an order too high, or the delay is wrong"
            )
    told += [
        f"pole {p:.3g} and zero {z:.3g} nearly cancel: one order less may do"
        for p in model.poles
        for z in model.zeros
        if abs(p - z) < 0.01 * (1 - min(abs(p), 0.99)) and p.imag >= 0
    ]
    return tuple(told)
