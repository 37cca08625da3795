"""PI gains with all options of the controller, and their exact conversions.

With e = reference - filtered measurement, sample time T and S the running sum of the integration rule, the forms are

    position          u_k = kp e_k + ki S_k
    incremental       u_k = u_(k-1) + kp (e_k - e_(k-1)) + ki (S_k - S_(k-1))
    incremental_sum   u_k = u_(k-1) + kp e_k + ki S_k

With a setpoint weight w, kp multiplies w reference - filtered measurement instead of e (Åström & Hägglund 2006,
Advanced PID Control, section 3.4): the response to the reference changes, the loop and its response to load do not. The
rules are backward ``S_k = S_(k-1) + T e_k``, forward ``S_k = S_(k-1) + T e_(k-1)``, trapezoidal the mean of both.
Position and incremental (velocity) form are the same linear controller and differ under limits: the incremental form
continues from the limited command. ``incremental_sum`` is CLM-2023 eq. 16 taken literally, "U0 is the last control
signal" (doi 10.1109/ACCESS.2023.3330587): the last command is a further integrator, so that kp acts as an integral
gain. Its kp and ki are per sample: at another sample time it is another controller.
"""

import math
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, Literal, Self, get_args

import numpy as np

from ...core.arrays import Array
from ...core.display import Plottable
from ...core.errors import UsageError

Form = Literal["position", "incremental", "incremental_sum"]
Integration = Literal["backward", "forward", "trapezoidal"]
AntiWindup = Literal["clamping", "back_calculation", "none"]
Averaged = Literal["measurement", "command"]


def check_gains(gains: "PiGains") -> None:
    """Raise UsageError for invalid gains."""
    _check_numbers(gains)
    _check_names(gains)
    _check_limits(gains)


def above_zero(name: str, value: object) -> None:
    """Raise UsageError unless a value is a finite number above zero."""
    if not _finite(value) or not value > 0:  # type: ignore[operator]
        raise UsageError(f"{name} {value!r}: a finite number above zero.")


def _check_numbers(gains: "PiGains") -> None:
    for name in ("kp", "ki"):
        if not _finite(getattr(gains, name)):
            raise UsageError(f"{name} {getattr(gains, name)!r}: a gain is a finite number.")
    for name in ("sample_time", "tracking_time", "rate"):
        value = getattr(gains, name)
        if not (name != "sample_time" and value is None):
            above_zero(name, value)
    if not _finite(gains.filter_time) or gains.filter_time < 0:
        raise UsageError(f"filter_time {gains.filter_time!r} s: 0 for no filter, or above.")
    for name, least in (("delay", 0), ("average", 1)):
        value = getattr(gains, name)
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
            raise UsageError(f"{name} {value!r}: a whole number of samples, {least} or more.")


def _finite(value: object) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(float(value))


def _check_names(gains: "PiGains") -> None:
    kinds: dict[str, Any] = {
        "form": Form, "integration": Integration, "anti_windup": AntiWindup, "average_of": Averaged
    }  # fmt: skip
    for name, kind in kinds.items():
        value, allowed = getattr(gains, name), get_args(kind)
        if value not in allowed:
            raise UsageError(f"{name} {value!r} of PI gains: one of {', '.join(allowed)}.")


def _check_limits(gains: "PiGains") -> None:
    low, high = gains.low, gains.high
    if any(v is not None and not _finite(v) for v in (low, high)):
        raise UsageError(f"limits low {low!r}, high {high!r}: finite numbers, or None for no limit.")
    if low is not None and high is not None and not low < high:
        raise UsageError(f"limits low {low!r}, high {high!r}: low lies below high.")
    weight = gains.setpoint_weight
    if not _finite(weight) or not 0 <= weight <= 1:
        raise UsageError(f"setpoint_weight {weight!r}: a share of the reference, from 0 to 1.")
    if weight != 1 and gains.form == "incremental_sum":
        raise UsageError(
            f"setpoint_weight {weight:g} in the form incremental_sum: its kp integrates, so that the load would not "
            "reach the reference. Give 1, or another form."
        )


TimeUnit = Literal["s", "min"]

_RULE: dict[str, Array] = {
    "backward": np.array([1.0]),
    "forward": np.array([0.0, 1.0]),
    "trapezoidal": np.array([0.5, 0.5]),
}
_DIFFERENCE = np.array([1.0, -1.0])
_SECONDS = {"s": 1.0, "min": 60.0}


@dataclass(frozen=True, slots=True, repr=False)
class PiGains(Plottable):
    """A digital PI controller: gains in parallel form, filters, limits, anti-windup.

    Attributes
    ----------
    kp : float
        unit_u per unit_y (per sample in the form ``incremental_sum``).
    ki : float
        unit_u per unit_y per second, parallel: kp does not multiply it.
    sample_time : float
        Seconds.
    form : str
        ``position``, ``incremental`` (velocity), or ``incremental_sum``; see the module docstring.
    integration : str
        ``backward``, ``forward`` or ``trapezoidal``.
    delay : int
        Whole samples between a measurement and the resulting command at the plant.
    filter_time : float
        Seconds, time constant of a first-order low-pass filter of the measurement,
        ``f_k = f_(k-1) + (1 - exp(-T / filter_time)) (y_k - f_(k-1))`` (as LinuxCNC's lowpass); 0 for none.
    average : int
        Samples of a moving average; 1 for none.
    average_of : str
        Averaged signal: ``measurement``, or ``command`` (as in CLM-2023).
    low, high : float or None
        Limits of the command, unit_u.
    rate : float or None
        Largest change of the command, unit_u per second.
    anti_windup : str
        At a limit: ``clamping`` stops integration while the last command was limited and the error has the same sign
        (as LinuxCNC's pid), ``back_calculation`` tracks the limited command, ``none`` continues integration. The
        incremental forms continue from the limited command, with ``none`` from the unlimited one.
    tracking_time : float or None
        Seconds, of back-calculation; by default kp/ki.
    unit_u, unit_y : str
    setpoint_weight : float
        Share of the reference in the proportional part, 0 to 1; below 1 a step of the reference overshoots less.

    Examples
    --------
    >>> gains = PiGains.standard(kp=0.8, ti=0.5, sample_time=0.02, unit_u="V", unit_y="A")
    >>> gains.ki, gains.ki_per_sample
    (1.6, 0.032)
    >>> fed = gains.in_units("mm/min", 1459.0)
    >>> fed.kp, fed.unit_u, fed.ti
    (1167.2, 'mm/min', 0.5)
    """

    kp: float
    ki: float
    sample_time: float
    form: Form = "position"
    integration: Integration = "backward"
    delay: int = 0
    filter_time: float = 0.0
    average: int = 1
    average_of: Averaged = "measurement"
    low: float | None = None
    high: float | None = None
    rate: float | None = None
    anti_windup: AntiWindup = "clamping"
    tracking_time: float | None = None
    unit_u: str = ""
    unit_y: str = ""
    setpoint_weight: float = 1.0

    def __post_init__(self) -> None:
        check_gains(self)

    @classmethod
    def standard(cls, kp: float, ti: float, sample_time: float, *, time_unit: TimeUnit = "s", **rest: Any) -> Self:  # noqa: ANN401
        """From the standard form kp (e + 1/ti integral e); ti in s or min, infinite for no integral action.

        Errors: UsageError for a ti that is not above zero.
        """
        if not ti > 0:
            raise UsageError(
                f"ti {ti!r} {time_unit}: an integral time lies above zero; infinite for no integral action."
            )
        return cls(kp, kp / (ti * _seconds(time_unit)), sample_time, **rest)

    @classmethod
    def from_per_sample(cls, kp: float, ki_per_sample: float, sample_time: float, **rest: Any) -> Self:  # noqa: ANN401
        """From a ki that multiplies the plain sum of errors, unit_u per unit_y per sample.

        >>> PiGains.from_per_sample(160.0, 0.006, 0.02).ki
        0.3
        """
        above_zero("sample_time", sample_time)
        return cls(kp, ki_per_sample / sample_time, sample_time, **rest)

    @classmethod
    def from_per_minute(cls, kp: float, ki_per_minute: float, sample_time: float, **rest: Any) -> Self:  # noqa: ANN401
        """From a ki in unit_u per unit_y per minute."""
        return cls(kp, ki_per_minute / 60.0, sample_time, **rest)

    @property
    def ti(self) -> float:
        """Integral time kp/ki, s; infinite without integral action."""
        return self.kp / self.ki if self.ki else math.inf

    @property
    def ti_minutes(self) -> float:
        """Integral time, min."""
        return self.ti / 60.0

    @property
    def ki_per_sample(self) -> float:
        """Ki T, unit_u per unit_y per sample."""
        return self.ki * self.sample_time

    @property
    def ki_per_minute(self) -> float:
        """ki, unit_u per unit_y per minute."""
        return self.ki * 60.0

    def in_units(
        self, unit_u: str | None = None, factor: float = 1.0, unit_y: str | None = None, factor_y: float = 1.0
    ) -> Self:
        """The same controller in other units; limits and rate go with the command.

        Parameters
        ----------
        unit_u, unit_y : str or None
            New units; by default unchanged.
        factor, factor_y : float
            New units per old unit: 1459 from V to mm/min where 1 V is 1459 mm/min. Above zero.
        """
        above_zero("factor", factor)
        above_zero("factor_y", factor_y)
        by = factor / factor_y
        low, high, rate = (None if v is None else v * factor for v in (self.low, self.high, self.rate))
        return replace(
            self, kp=self.kp * by, ki=self.ki * by, low=low, high=high, rate=rate,
            unit_u=self.unit_u if unit_u is None else unit_u, unit_y=self.unit_y if unit_y is None else unit_y,
        )  # fmt: skip

    @property
    def forward(self) -> tuple[Array, Array]:
        """Negative filtered measurement to command at the plant, num and den in z^-1: form, average, delay."""
        of_kp, of_ki, den = basis(self)
        return product(summed(self.kp * of_kp, self.ki * of_ki), self.command_path), den

    @property
    def of_reference(self) -> tuple[Array, Array]:
        """Reference to command at the plant, num and den in z^-1; ``forward`` for a setpoint weight of 1."""
        of_kp, of_ki, den = basis(self)
        weighted = self.setpoint_weight * self.kp
        return product(summed(weighted * of_kp, self.ki * of_ki), self.command_path), den

    @property
    def command_path(self) -> Array:
        """Average of the command and delay, in z^-1."""
        average = _average(self.average if self.average_of == "command" else 1)
        return np.concatenate([np.zeros(self.delay), average])

    @property
    def feedback(self) -> tuple[Array, Array]:
        """Measurement to the signal compared with the reference, num and den in z^-1: low-pass and average."""
        gain = -math.expm1(-self.sample_time / self.filter_time) if self.filter_time else 1.0
        average = _average(self.average if self.average_of == "measurement" else 1)
        return gain * average, np.array([1.0, gain - 1.0] if self.filter_time else [1.0])

    @property
    def transfer_function(self) -> tuple[Array, Array]:
        """Negative measurement to command, num and den in z^-1: the controller in the loop.

        >>> num, den = PiGains(2.0, 1.0, 0.5).transfer_function
        >>> num.tolist(), den.tolist()
        ([2.5, -2.0], [1.0, -1.0])
        """
        (num, den), (above, below) = self.forward, self.feedback
        return product(num, above), product(den, below)


def basis(gains: PiGains) -> tuple[Array, Array, Array]:
    """Polynomials P, Q, D in z^-1 with (kp P + ki Q) / D the PI; without an integrator for ki = 0."""
    extra = _DIFFERENCE if gains.form == "incremental_sum" else np.ones(1)
    if gains.ki == 0:
        return np.ones(1), np.zeros(1), extra
    return _DIFFERENCE, gains.sample_time * _RULE[gains.integration], product(_DIFFERENCE, extra)


def product(*polynomials: Array) -> Array:
    """Product of polynomials in z^-1."""
    return np.asarray(reduce(np.convolve, polynomials), dtype=np.float64)


def summed(*polynomials: Array) -> Array:
    """Sum of polynomials in z^-1 of any lengths."""
    out = np.zeros(max(len(p) for p in polynomials))
    for p in polynomials:
        out[: len(p)] += p
    return out


def _average(samples: int) -> Array:
    return np.full(samples, 1.0 / samples)


def _seconds(unit: str) -> float:
    if unit not in _SECONDS:
        raise UsageError(f"time_unit {unit!r}: s or min.")
    return _SECONDS[unit]
