"""Time-domain simulation of the PI and its loop: limits, anti-windup, rounding, noise, interruptions of the cut."""

import math
from collections import deque
from dataclasses import dataclass, replace
from operator import mul
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.arrays import Array, Flags
from ...core.display import Displayable, Plottable, as_columns
from ...core.errors import UsageError
from ...core.verdict import DO_NOT_USE, RESERVATIONS
from ..model import Model
from .gains import PiGains
from .loops import check_pair
from .specification import Specification
from .step_metrics import StepMetrics

if TYPE_CHECKING:
    from pandas import DataFrame

_WEIGHTS = {"backward": (1.0, 0.0), "forward": (0.0, 1.0), "trapezoidal": (0.5, 0.5)}


class PiController:
    """A PI controller with its filters, limits and state.

    Each ``step`` takes a reference and a measurement and returns the command (before the delay).

    Parameters
    ----------
    gains : PiGains
    idle : float
        Command outside the cut, unit_u; limits and rate apply there too.
    quantum : float
        Resolution of the command, unit_u; 0 for none.
    last : float
        Command before the first sample, unit_u.

    Attributes
    ----------
    limited : int
        1 while an upper limit or the rate is active, -1 for a lower one, otherwise 0.

    Examples
    --------
    >>> pi = PiController(PiGains(2.0, 10.0, 0.1, high=3.0))
    >>> [pi.step(1.0, y) for y in (0.0, 0.0, 1.0)]
    [3.0, 3.0, 2.0]
    """

    def __init__(self, gains: PiGains, idle: float = 0.0, quantum: float = 0.0, last: float = 0.0) -> None:
        self.gains, self.idle, self.quantum = gains, idle, quantum
        above, below = gains.feedback
        self.gain, self.hold = (float(above.sum()), -float(below[1])) if gains.filter_time else (1.0, 0.0)
        length = {name: gains.average if gains.average_of == name else 1 for name in ("measurement", "command")}
        self.seen = deque([0.0] * length["measurement"], length["measurement"])
        self.sent = deque([last] * length["command"], length["command"])
        self.filtered = 0.0
        self.kp, self.ki = gains.kp, gains.ki_per_sample
        self.now, self.before = _WEIGHTS[gains.integration]
        self.tracking = min(1.0, gains.sample_time / (gains.tracking_time or abs(gains.ti) or gains.sample_time))
        self.total, self.error, self.weighted = 0.0, 0.0, 0.0
        self.asked = self.last = last
        self.limited = 0
        self.cutting = True

    def step(self, reference: float, measurement: float, engaged: bool = True) -> float:
        """One sample; outside the cut the command is ``idle``, on re-entry it continues from the last one."""
        seen = self._see(measurement)
        error, weighted = reference - seen, self.gains.setpoint_weight * reference - seen
        if not engaged:
            self.asked = self.idle
        elif not self.cutting:
            self._enter(weighted)
        else:
            self.asked = self._ask(error, weighted)
        self.cutting, self.error, self.weighted = engaged, error, weighted
        return self._send(engaged)

    def _see(self, measurement: float) -> float:
        self.seen.append(measurement)
        mean = sum(self.seen) / len(self.seen)
        self.filtered = self.gain * mean + self.hold * self.filtered
        return self.filtered

    def _enter(self, weighted: float) -> None:
        """Initialise the state so that the first command in the cut equals the last one before it (bumpless)."""
        self.asked = self.last
        self.total = self.last - self.kp * weighted if self.gains.form == "position" else 0.0

    def _ask(self, error: float, weighted: float) -> float:
        change = self.ki * (self.now * error + self.before * self.error)
        base = self.asked if self.gains.anti_windup == "none" else self.last
        if self.gains.form == "incremental":
            return base + self.kp * (weighted - self.weighted) + change
        if not (self.gains.anti_windup == "clamping" and change * self.limited > 0):
            self.total += change
        return self.kp * weighted + self.total + (base if self.gains.form == "incremental_sum" else 0.0)

    def _send(self, engaged: bool) -> float:
        """Apply limits, anti-windup, average and rounding."""
        g, u = self.gains, self.asked
        if g.rate is not None:
            most = g.rate * g.sample_time
            u = min(max(u, self.last - most), self.last + most)
        if g.high is not None:
            u = min(u, g.high)
        if g.low is not None:
            u = max(u, g.low)
        self.limited = (self.asked > u) - (self.asked < u)
        if engaged and g.anti_windup == "back_calculation":
            self.total += self.tracking * (u - self.asked)
        self.last = u
        self.sent.append(u)
        mean = sum(self.sent) / len(self.sent)
        return round(mean / self.quantum) * self.quantum if self.quantum else mean


@dataclass(frozen=True, slots=True, repr=False)
class LoopTrace(Plottable):
    """Simulation of a loop in time; every array has shape (n,).

    Attributes
    ----------
    time : ndarray, s
    reference, output, measurement : ndarray, unit_y
        ``output`` is noise-free; ``measurement`` adds the noise and is fed back.
    command : ndarray, unit_u
        Before the delay of ``gains.delay`` samples.
    limited : ndarray of int
        1 where an upper limit or the rate is active, -1 for a lower one, otherwise 0.
    engaged : ndarray of bool
        In the cut.
    unit_u, unit_y : str
    """

    time: Array
    reference: Array
    output: Array
    measurement: Array
    command: Array
    limited: NDArray[np.int8]
    engaged: Flags
    unit_u: str = ""
    unit_y: str = ""

    @property
    def saturated(self) -> Flags:
        """Samples at which a limit or the rate is active."""
        return np.asarray(self.limited != 0)

    def to_frame(self) -> "DataFrame":
        """One row per sample, time in s."""
        return as_columns(
            self, "time", "reference", "output", "measurement", "command", "limited", "engaged"
        ).set_index("time")


def simulate_loop(
    model: Model,
    gains: PiGains,
    reference: ArrayLike,
    *,
    load: ArrayLike = 0.0,
    load_at: Literal["output", "input"] = "output",
    engaged: ArrayLike | None = None,
    idle: float = 0.0,
    noise: float = 0.0,
    quantum: float = 0.0,
    rng: int | np.random.Generator | None = None,
) -> LoopTrace:
    """Simulate a loop from rest, with the delay, limits, rate and anti-windup of the gains.

    Without limits, rounding, noise and interruptions of the cut it equals the linear ``Loop.step``.

    Parameters
    ----------
    model : Model
        Plant.
    gains : PiGains
    reference : array-like, shape (n,), unit_y
    load : array-like, shape (n,), or float
        Disturbance at the plant output (unit_y, as wear raises a current) or input (unit_u).
    load_at : str
        ``output`` or ``input``.
    engaged : array-like of bool, shape (n,), or None
        In the cut; by default always. Outside it neither command nor load reaches the plant, the command is ``idle``,
        and re-entry is bumpless.
    idle : float
        Command outside the cut, unit_u.
    noise : float
        Standard deviation of white measurement noise, unit_y.
    quantum : float
        Resolution of the command, unit_u (an override in whole per cent); 0 for none.
    rng : int or Generator, or None
        Seed of the noise; required with noise.

    Raises
    ------
    UsageError, IdentError
        Inconsistent shapes or numbers; another sample time, a loop without delay.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1)
    >>> trace = simulate_loop(model, PiGains(0.5, 2.0, 0.1, high=0.6), np.ones(4))
    >>> trace.command.round(3).tolist(), trace.saturated.tolist()
    ([0.6, 0.55, 0.6, 0.559], [True, False, True, False])
    """
    check_pair(model, gains)
    r = np.asarray(reference, dtype=np.float64)
    if r.ndim != 1 or not np.isfinite(r).all():
        raise UsageError(f"reference of shape {r.shape}: one array of finite numbers, one per sample.")
    n = len(r)
    loads, cut = _row("load", load, n), _engaged(engaged, n)
    for name, value in (("noise", noise), ("quantum", quantum)):
        if not (value >= 0 and np.isfinite(value)):
            raise UsageError(f"{name} {value!r}: 0 for none, or above.")
    if not np.isfinite(idle):
        raise UsageError(f"idle {idle!r}: the command outside the cut is a finite number.")
    if load_at not in ("output", "input"):
        raise UsageError(f"load_at {load_at!r}: output or input.")
    if noise and rng is None:
        raise UsageError(f"noise {noise:g} without rng: give a seed, so that the simulation is reproducible.")
    e = noise * np.random.default_rng(rng).standard_normal(n) if noise else np.zeros(n)
    inside, outside = (loads, np.zeros(n)) if load_at == "input" else (np.zeros(n), loads)
    controller = PiController(gains, idle, quantum, last=0.0 if n == 0 or cut[0] else idle)
    y, u, limited = _run(model, controller, r, inside * cut, outside * cut, cut, e)
    time = np.arange(n, dtype=np.float64) * model.sample_time
    return LoopTrace(time, r, y, y + e, u, limited, cut, gains.unit_u or model.unit_u, gains.unit_y or model.unit_y)


def _run(
    model: Model, controller: PiController, r: Array, inside: Array, outside: Array, cut: Flags, e: Array
) -> tuple[Array, Array, NDArray[np.int8]]:
    """Output, command, and whether it was limited."""
    b, a = model.b.tolist(), model.a[1:].tolist()
    past_x, past_y = deque([0.0] * len(b), len(b)), deque([0.0] * len(a), len(a))
    delay = controller.gains.delay
    waiting = deque([controller.last] * delay)
    out, sent, limited = np.empty(len(r)), np.empty(len(r)), np.empty(len(r), dtype=np.int8)
    # b_0 u of this sample acts only with a delay of the command, which is then known before the measurement
    for k, (ref, load, more, on, off) in enumerate(
        zip(*(v.tolist() for v in (r, inside, outside, cut, e)), strict=True)
    ):
        arriving = waiting.popleft() if delay else 0.0
        past_x.appendleft((arriving + load) * on)
        y = sum(map(mul, b, past_x)) - sum(map(mul, a, past_y))
        past_y.appendleft(y)
        u = controller.step(ref, y + more + off, on)
        if delay:
            waiting.append(u)
        else:
            past_x[0] = (u + load) * on
        out[k], sent[k], limited[k] = y + more, u, controller.limited
    return out, sent, limited


@dataclass(frozen=True, slots=True, repr=False)
class LimitedStep(Displayable):
    """Step of the reference with the limits and the rate of the command.

    Attributes
    ----------
    step : float
        Size, unit_y.
    figures : dict of float
        ``rise_time``, ``settling_time`` (s), ``overshoot`` and ``undershoot`` (shares of the step), by name.
    limited : bool
        Whether a limit or the rate was active.
    reached : bool
        Whether the output lies within 2 % of the reference at the end.
    reach : float
        Largest change of the output at rest between the limits of the command, unit_y.
    given : bool
        Whether the size is that of the application; otherwise it is 1.
    """

    step: float
    figures: dict[str, float]
    limited: bool
    reached: bool
    reach: float
    given: bool


LONGEST_STEP = 20_000  # samples of a step with limits


def limited_step(model: Model, gains: PiGains, size: float | None, duration: float) -> LimitedStep | None:
    """A step of the reference with the limits and the rate of the command; None for gains without them.

    With two limits the command has their whole range for the step, as from the lower one upwards; with one limit, or
    on a plant that integrates, the step starts from the operating point of the model, or from 0.

    Parameters
    ----------
    model : Model
    gains : PiGains
    size : float or None
        Of the step, unit_y; None for 1.
    duration : float
        Of the step without limits, s; the time that the rate needs is added.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1)
    >>> found = limited_step(model, PiGains(0.5, 2.0, 0.1, low=0.0, high=0.6), None, 5.0)
    >>> found.reached, found.reach
    (False, 0.6)
    """
    step = 1.0 if size is None else size
    low, high = _range_of_command(model, gains)
    if (low, high, gains.rate) == (None, None, None):
        return None
    change = step / abs(model.dc_gain) if model.dc_gain else math.inf
    seconds = duration + (3 * change / gains.rate if gains.rate and math.isfinite(change) else 0.0)
    n = min(math.ceil(seconds / gains.sample_time), LONGEST_STEP)
    run = simulate_loop(model, replace(gains, low=low, high=high), np.full(n, step))
    metrics = StepMetrics(np.r_[0.0, run.output][:, None] / step, np.ones(1), gains.sample_time, None)
    metrics.update(0, n, np.zeros((n + 1, 1)), np.zeros((n, 1)))
    found = metrics.figures()
    figures = {name: float(found[name][0]) for name in ("rise_time", "settling_time", "overshoot", "undershoot")}
    reach = math.inf if low is None or high is None else (high - low) * abs(model.dc_gain)
    reached = math.isfinite(figures["settling_time"])
    return LimitedStep(step, figures, bool(run.saturated.any()), reached, reach, size is not None)


def against_limits(
    run: LimitedStep | None, gains: PiGains, specification: Specification, output: str
) -> list[tuple[int, str]]:
    """Level and sentence where the limits or the rate of the command make a step miss the specification."""
    if run is None or not run.limited:
        return []
    y, u = (f" {unit}" if unit else "" for unit in (gains.unit_y, gains.unit_u))
    named = (("low", gains.low, u), ("high", gains.high, u), ("rate", gains.rate, f"{u}/s"))
    limits = ", ".join(f"{name} {value:.4g}{unit}" for name, value, unit in named if value is not None)
    step = f"With the limits of the command ({limits}) a step of the {output} by {run.step:.4g}{y}"
    if not run.reached:
        most = f": between them it changes by {run.reach:.4g}{y} at most" if run.reach < run.step else ""
        words = f"{step} is not reached{most}. Widen the limits, or take smaller steps."
        return [(DO_NOT_USE if run.given else RESERVATIONS, words)]
    limited = {name: value for name, _, value in specification.active() if name in run.figures}
    misses = Specification(**limited).misses({"stable": True, **run.figures})
    words = (
        f"{step} misses the specification: {'; '.join(misses)}. It holds without these limits only: widen them, take "
        "smaller steps, or specify what they allow."
    )
    return [(RESERVATIONS, words)] if misses else []


def _range_of_command(model: Model, gains: PiGains) -> tuple[float | None, float | None]:
    """Limits of the command relative to the command before the step; None where there is none."""
    low, high = gains.low, gains.high
    if low is not None and high is not None and math.isfinite(model.dc_gain):
        return (0.0, high - low) if model.dc_gain > 0 else (low - high, 0.0)
    inside = [
        start
        for start in (*(model.operating_point or ())[:1], 0.0)
        if (low is None or low < start) and (high is None or start < high)
    ]
    if not inside:
        return None, None
    return None if low is None else low - inside[0], None if high is None else high - inside[0]


def _row(name: str, values: ArrayLike, n: int) -> Array:
    row = np.asarray(values, dtype=np.float64)
    if row.shape not in ((), (n,)) or not np.isfinite(row).all():
        raise UsageError(f"{name} of shape {row.shape}: one finite number, or one for each of the {n} samples.")
    return np.array(np.broadcast_to(row, n))


def _engaged(values: ArrayLike | None, n: int) -> Flags:
    row = np.ones(n, dtype=bool) if values is None else np.asarray(values)
    if row.shape != (n,) or row.dtype != np.bool_:
        raise UsageError(f"engaged of shape {row.shape}, {row.dtype}: True or False for each of the {n} samples.")
    return row
