"""Validation of a model on a record it was not fitted to: simulation, k-step prediction, residuals, poles.

The simulation is decisive: one step ahead, even a model that repeats the last sample does well.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...core.arrays import Array, Ints
from ...core.display import Plottable
from ...core.errors import IdentError
from ...core.verdict import DO_NOT_USE, RESERVATIONS, USABLE
from ...datasets.records.record import Record
from ...datasets.units import is_unit, same_dimension
from ..closed_loop import feedback
from ..estimators.bias_checks import response_error
from ..model import Model
from .prediction import BY_EQUATION, check_frame, fit_percent, k_steps, lagged_inputs, one_step, simulated
from .residual_tests import LAGS, ResidualTest, independence, residual_whiteness

GOOD, POOR = 80.0, 50.0  # % of fit: R2 0.96 and 0.75
SIGNIFICANT = 0.001  # p below which the residuals depend on the input
FIT, DEPEND = "the simulation fit", "residuals depend"
CERTAIN = 3.0  # standard errors below zero of a gain that is named as negative
LOADS = ("A", "mA", "W", "kW", "N", "kN", "Nm", "%")  # units of a load, which rises with the feed
SURE = 2.0  # standard errors between the static gain and zero
NARROW = 2.0  # highest over lowest excited frequency below which the input has one frequency
FLAT = 1.41  # between the gain at rest and at the lowest excited frequency, 3 dB
OPTIMISM = 15.0  # % of fit between one-step prediction and simulation: then the one-step fit is optimistic


@dataclass(frozen=True, slots=True, repr=False)
class Validation(Plottable):
    """Validation of a model on one record.

    Attributes
    ----------
    fit : float
        Simulation fit 100 (1 - |y - yhat| / |y - mean|), %, initial state and offset estimated in each segment; of an
        integrating model about the line of each segment, its slope estimated too.
    rsquared : float
        1 - |y - yhat|^2 / |y - mean|^2 of the simulation.
    fit_training_means, fit_zero_state : float
        Simulation fit about the operating point of the training record, and from rest (offset estimated).
    k_step_fit : dict of int to float
        Fit of the k-step-ahead prediction, %; models without a noise model predict by simulation.
    whiteness, independence : ResidualTest
        Of the one-step errors (simulation errors without a noise model); of present and past inputs.
    future_inputs : ResidualTest
        Residuals and future inputs: correlated in closed loop.
    feedback : str or None
        See `closed_loop.feedback`; None for a record with its reference.
    remarks : tuple of str
        On poles, step response and omitted segments.
    held_out : bool
        False for the record that the model was fitted to.
    y, yhat : ndarray, shape (N,)
        Measured and simulated, about the record's own offsets.
    time : ndarray, shape (N,), s
    starts : tuple of int
    verdict : str
        One sentence.
    concern : int
        0 none, 1 read the remarks, 2 do not tune on this model.
    reservations : tuple of (int, str)
        The clauses behind ``concern``, each with its level.
    """

    fit: float
    rsquared: float
    fit_training_means: float
    fit_zero_state: float
    k_step_fit: dict[int, float]
    whiteness: ResidualTest
    independence: ResidualTest
    future_inputs: ResidualTest
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
    reservations: tuple[tuple[int, str], ...] = ()

    @property
    def fit_reservations(self) -> tuple[tuple[int, str], ...]:
        """The reservations about figures of the fit and about residuals, without those about poles and feedback."""
        return tuple(item for item in self.reservations if item[1] not in (*self.remarks, self.feedback))


def validate(
    model: Model,
    other: Record,
    steps: Sequence[int] = (1, 5, 10),
    lags: int = LAGS,
    *,
    additional: Array | None = None,
) -> Validation:
    """Validate a model by simulating a record.

    Parameters
    ----------
    model : Model
    other : Record
        Not used for the fit, with the same sample time and units; raw or centred.
    steps : sequence of int
        Prediction horizons, samples.
    lags : int
        Number of lags of the residual correlations.
    additional : ndarray, shape (N, k), optional
        Additional regressors (lines, drift), estimated in each segment simultaneously with the initial state.

    Returns
    -------
    Validation

    Raises
    ------
    IdentError
        A pole at radius 1 or more, another rate or unit, too short a record, a constant output.

    Notes
    -----
    Coloured residuals are no defect of an output-error model: its standard errors allow for coloured noise.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> rng = np.random.default_rng(1)
    >>> u, e = rng.standard_normal((2, 300))
    >>> model = Model(b=[0.0, 0.5], a=[1.0, -0.8], nk=1, sample_time=0.02)
    >>> other = datasets.Record(u=u, y=model.simulate(u) + 3 + 0.1 * e, sample_time=0.02)
    >>> print(validate(model, other).verdict)
    simulates the record with 83 % fit (R2 0.9727); residuals are independent of u
    """
    check_frame(model, other)
    original = other
    other, remarks, kept = long_stretches(model, other, steps)
    additional = None if additional is None else additional[kept]
    raw, other = other, without_slope(other) if model.integrating else other
    y, s = other.y, other.stretches
    yhat = simulated(model, other, additional=additional)
    step = one_step(model, other, yhat, additional)
    held_out = model.record is None or model.record != other.sha256
    cov = model.cov_params if held_out else None
    loop = feedback(original)
    # a controller without delay feeds e(t) into u(t), which a model with a delay does not use
    first = int(loop.state != "none" and model.nk > 0)
    past, future = range(first, lags + 1), range(-lags, 0)
    left = y - yhat
    mean = np.concatenate([np.full(k.stop - k.start, y[k].mean()) for k in s])
    k_step_fit = {
        k: fit_percent(y[step.rows], y[step.rows] - k_steps(model, step, k), step.stretches) for k in sorted(set(steps))
    }
    found = Validation(
        fit=fit_percent(y, yhat, s),
        rsquared=float(1 - left @ left / ((y - mean) @ (y - mean))),
        fit_training_means=fit_percent(raw.y, simulated(model, raw, True, "training", additional), s),
        fit_zero_state=fit_percent(y, simulated(model, other, False, additional=additional), s),
        k_step_fit=k_step_fit,
        whiteness=residual_whiteness(step, cov, not held_out, lags),
        independence=independence(step, lagged_inputs(other, step, past), first, cov, not held_out),
        future_inputs=independence(step, lagged_inputs(other, step, future), -lags, cov, not held_out),
        feedback=loop.sentence if loop.found and original.reference is None else None,
        remarks=remarks + plausibility_remarks(model, max(k.stop - k.start for k in s) * other.sample_time),
        held_out=held_out,
        y=y,
        yhat=yhat,
        time=np.arange(len(other), dtype=np.float64) * other.sample_time,
        starts=other.starts,
        labels=(other.output, other.unit_y),
    )
    return with_verdict(found, other.input, model.structure in BY_EQUATION)


def without_slope(rec: Record) -> Record:
    """The record without the line in the output of each segment, which an integrating model does not explain.

    >>> rec = without_slope(Record(u=[0.0, 1.0, 0.0, 1.0], y=[0.0, 1.0, 2.0, 3.0], sample_time=0.1))
    >>> bool(np.allclose(rec.y, 0))
    True
    """
    y = rec.y.copy()
    for s in rec.stretches:
        line = np.column_stack([np.ones(s.stop - s.start), np.linspace(-1, 1, s.stop - s.start)])
        y[s] -= line @ np.linalg.lstsq(line, y[s], rcond=None)[0]
    return replace(rec, y=y)


def with_verdict(found: Validation, name: str, by_equation: bool) -> Validation:
    """The validation with its verdict in one sentence, its reservations and its level of concern.

    ``by_equation``: the poles of the noise are those of the plant, so that a one-step fit can hide a poor plant.
    """
    where = "the record" if found.held_out else "its own estimation record"
    text = f"simulates {where} with {found.fit:.0f} % fit (R2 {found.rsquared:.4g})"
    nearest = min(found.k_step_fit)
    reservations = _fit_reservations(found)
    if by_equation and found.k_step_fit[nearest] - found.fit > OPTIMISM:
        optimistic = f"the {nearest}-step-ahead fit of {found.k_step_fit[nearest]:.0f} % is optimistic"
        text += f"; {optimistic}"
        reservations.append((RESERVATIONS, f"{optimistic}, the simulation fit is {found.fit:.0f} %"))
    left = float(np.std(found.y - found.yhat))
    if left <= ROUNDED * float(np.std(found.y)):
        text += f"; residuals are rounding, too small to test whether they are independent of {name}"
    elif found.independence.pvalue < SIGNIFICANT:
        depend = f"{DEPEND} on {name} (p {found.independence.pvalue:.1g}): check orders, delay and nonlinearity"
        text += f"; {depend}"
        reservations.append((RESERVATIONS, depend))
    else:
        text += f"; residuals are independent of {name}"
    if found.feedback:
        text = f"{text}; recorded in closed loop"
        reservations.append((RESERVATIONS, found.feedback))
    if found.fit < POOR:
        text += ". Do not tune a controller on it"
    reservations += [(RESERVATIONS, remark) for remark in found.remarks]
    concern = max((level for level, _ in reservations), default=USABLE)
    return replace(found, verdict=text, reservations=tuple(reservations), concern=concern)


def _fit_reservations(found: Validation) -> list[tuple[int, str]]:
    if found.fit >= GOOD:
        return []
    level, limit = (RESERVATIONS, GOOD) if found.fit >= POOR else (DO_NOT_USE, POOR)
    return [(level, f"{FIT} is {found.fit:.0f} %, below {limit:.0f} %")]


def states_of(model: Model) -> int:
    """Number of initial states of a segment."""
    return max(model.na, model.nk + model.nb - 1)


def long_stretches(model: Model, rec: Record, steps: Sequence[int]) -> tuple[Record, tuple[str, ...], Ints]:
    """The segments long enough for a simulation, a remark on those left out, and the samples kept."""
    if not steps or any(k != int(k) or k < 1 for k in steps):
        raise IdentError(f"steps {list(steps)!r}: whole numbers of 1 or more.")
    states = states_of(model) + 1
    fewest = 3 * states + 5
    kept = [k for k, s in enumerate(rec.stretches) if s.stop - s.start >= fewest]
    if not kept:
        longest = max(s.stop - s.start for s in rec.stretches)
        raise IdentError(
            f"the longest segment has {longest} samples: with {states} initial states and offset, the validation needs "
            f"{fewest} samples. Record longer."
        )
    if len(kept) == len(rec.starts):
        return rec, (), np.arange(len(rec))
    parts = [rec.stretches[k] for k in kept]
    u, y = (np.concatenate([v[s] for s in parts]) for v in (rec.u, rec.y))
    starts = tuple(int(b) for b in np.cumsum([0, *(s.stop - s.start for s in parts)])[:-1])
    left_out = len(rec.starts) - len(kept)
    remark = f"{left_out} segment{'s' * (left_out > 1)} of fewer than {fewest} samples left out"
    rows = np.concatenate([np.arange(s.start, s.stop) for s in parts])
    return replace(rec, u=u, y=y, starts=starts, offsets=np.asarray(rec.offsets)[kept], reference=None), (remark,), rows


ROUNDED = 1e-8  # of the standard deviation of y: residuals below are rounding, and are not tested
RINGING = 0.1  # damping ratio below which a mode is remarked upon
AT_ZERO = 1e-6  # radius of a pole that is a delay
ALTERNATING = 0.3  # radius of a negative real pole that is remarked upon


def settling_time(model: Model, share: float = 0.02) -> float:
    """Seconds after which the step response stays within ``share`` of its final value; infinite if it never does.

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


def plausibility_remarks(model: Model, longest: float) -> tuple[str, ...]:
    """Remarks on implausible poles and settling; ``longest`` is the longest segment in seconds."""
    remarks = []
    settling = 0.0 if model.integrating else settling_time(model)
    if settling > longest:
        ends = f"settles in {settling:.3g} s but" if math.isfinite(settling) else "does not settle, and"
        remarks.append(
            f"the step response {ends} the longest segment lasts {longest:.3g} s: its static gain "
            f"({model.dc_gain:.4g}) is an extrapolation"
        )
    for p in model.poles[(np.abs(model.poles) > AT_ZERO) & (model.poles != 1)]:
        s = np.log(p) / model.sample_time
        damping, hertz = -s.real / abs(s), abs(s) / (2 * np.pi)
        if p.imag > 0 and damping < RINGING:
            remarks.append(
                f"lightly damped mode at {hertz:.3g} Hz (damping ratio {damping:.2g}): verify it on a measured response"
            )
        if p.imag == 0 and p.real < -ALTERNATING:
            remarks.append(
                f"negative real pole at {p.real:.2g}, alternating every sample: order too high or delay wrong"
            )
    remarks += [
        f"pole {p:.3g} and zero {z:.3g} nearly cancel: a lower order may suffice"
        for p in model.poles[np.abs(model.poles) > AT_ZERO]
        for z in model.zeros
        if abs(p - z) < 0.01 * (1 - min(abs(p), 0.99)) and p.imag >= 0
    ]
    return tuple(remarks)


def _unit_of_gain(model: Model) -> str:
    return f" {model.unit_y}/{model.unit_u}" if model.unit_u and model.unit_y else ""


def gain_reservations(model: Model) -> list[tuple[int, str]]:
    """Reservations about the stability and the static gain of a model."""
    if model.integrating:
        return _of_integrator(model)
    if not model.stable:
        radius = float(np.abs(model.poles).max())
        return [(DO_NOT_USE, f"the model is not stable, a pole at radius {radius:.6g}: record it in closed loop")]
    gain, error = model.dc_gain, float(response_error(model, np.zeros(1))[0])
    unit = _unit_of_gain(model)
    if gain < -CERTAIN * error and (model.unit_y in LOADS or _same_quantity(model)):
        words = f"the static gain is negative, {gain:.3g}{unit}: {model.output} falls when {model.input} rises"
        return [(RESERVATIONS, f"{words}; check the sign of the sensor and the columns")]
    if abs(gain) >= SURE * error:
        return []
    return [
        (
            DO_NOT_USE,
            f"the static gain, {gain:.3g}{unit}, has a standard error of {error:.2g}, so its sign is not known: record "
            "longer or with more amplitude",
        )
    ]


def _same_quantity(model: Model) -> bool:
    """Whether input and output have units of one dimension, as a command and its actual value."""
    u, y = model.unit_u, model.unit_y
    return bool(u and y) and is_unit(u) and is_unit(y) and same_dimension(u, y)


def _of_integrator(model: Model) -> list[tuple[int, str]]:
    """Reservation where the gain of an integrating model is not known at the lowest excited frequency."""
    f = np.array([model.band[0] if model.band else 0.01 / model.sample_time])
    gain, error = float(np.abs(model.response(f))[0]), float(response_error(model, f)[0])
    if gain >= SURE * error:
        return []
    words = f"the gain at {f[0]:.3g} Hz, {gain:.3g}, has a standard error of {error:.2g}: record longer or with more"
    return [(DO_NOT_USE, f"{words} amplitude")]


def band_reservations(model: Model) -> list[tuple[int, str]]:
    """Reservations about what a model says outside the excited band: its gain at rest, or all but one frequency."""
    if model.band is None:
        return []
    low, high = model.band
    if high < NARROW * low:
        words = (
            f"the input excites {low:.3g} to {high:.3g} Hz alone, so that all else is an extrapolation, gain at rest, "
            "delay and settling time among it: record a chirp, steps or a binary input"
        )
        return [(RESERVATIONS, words)]
    if model.integrating or not model.stable:
        return []
    rest, there = abs(model.dc_gain), float(np.abs(model.response(np.array([low])))[0])
    if max(rest, there) <= FLAT * min(rest, there):
        return []
    unit = f" {model.unit_y}/{model.unit_u}" if model.unit_u and model.unit_y else ""
    words = (
        f"the static gain of {model.dc_gain:.3g}{unit} is an extrapolation: the input excites nothing below "
        f"{low:.3g} Hz, where the gain is {there:.3g}{unit}. Begin at a lower frequency, or record steps with it"
    )
    return [(RESERVATIONS, words)]
