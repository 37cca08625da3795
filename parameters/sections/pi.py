"""The PI section: gains with all that a controller needs to run them, and what they were tuned to and reached."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from .base import Count, NotNegative, Number, Positive, Section, Share, Text


class PiSpecification(Section):
    """What was asked of the loop, as limits on the figures of the same name; None leaves a figure free.

    Times in s, the integral time kp/ki among them; overshoot, undershoot and steady error as shares of the step; phase
    margin in degrees at least, gain margin as a factor at least; disturbance, travel, peak_u and noise_gain in the
    units of the gains; these and all others at most.

    Examples
    --------
    >>> PiSpecification(rise_time=2.0, settling_time=4.0).asked
    {'rise_time': 2.0, 'settling_time': 4.0}
    """

    rise_time: Positive | None = None
    settling_time: Positive | None = None
    overshoot: NotNegative | None = None
    undershoot: NotNegative | None = None
    ms: Positive | None = None
    phase_margin: Positive | None = None
    gain_margin: Positive | None = None
    disturbance: Positive | None = None
    travel: Positive | None = None
    peak_u: Positive | None = None
    noise_gain: Positive | None = None
    integral_time: Positive | None = None
    steady_error: NotNegative | None = None

    @property
    def asked(self) -> dict[str, float]:
        """The limits that are asked for, by name."""
        values = {name: getattr(self, name) for name in type(self).model_fields}
        return {name: value for name, value in values.items() if value is not None}


class PiFigures(Section):
    """What the loop does on the file's dynamics, in a unit step of the reference from rest; None is without end.

    Times in s from 10 to 90 % and until within 2 %; overshoot, undershoot and steady error as shares of the step; ms
    and mt the peaks of |1 / (1 + L)| and |L / (1 + L)|; margins in degrees, as a factor, and s of further delay.
    Further figures of the tuner stand under their own names.
    """

    stable: bool = Field(strict=True)
    rise_time: NotNegative | None = None
    settling_time: NotNegative | None = None
    overshoot: Number | None = None
    undershoot: Number | None = None
    steady_error: Number | None = None
    ms: NotNegative | None = None
    mt: NotNegative | None = None
    phase_margin: Number | None = None
    gain_margin: NotNegative | None = None
    delay_margin: NotNegative | None = None
    disturbance_peak: NotNegative | None = None
    travel: NotNegative | None = None
    peak_u: NotNegative | None = None
    noise_gain: NotNegative | None = None
    integral_time: NotNegative | None = None


class PiSection(Section):
    """A digital PI as it runs.

    With e = reference - filtered measurement, T the sample time, S the sum by its rule:

        position          u_k = kp e_k + ki S_k
        incremental       u_k = u_(k-1) + kp (e_k - e_(k-1)) + ki (S_k - S_(k-1))
        incremental_sum   u_k = u_(k-1) + kp e_k + ki S_k
        backward, forward, trapezoidal    S_k = S_(k-1) + T (e_k, e_(k-1), the mean of both)

    Attributes
    ----------
    kp, ki : float
        unit_u per unit_y, and that per second; parallel, kp does not multiply ki.
    sample_time : float
        Seconds.
    form, integration : str
    delay : int
        Whole samples from a measurement to the command that answers it reaching the plant.
    filter_time : float
        s of a one-pole low-pass of the measurement, of gain 1 - exp(-T / filter_time); 0 is none.
    average, average_of
        Samples of a moving average of the ``measurement`` or of the ``command``; 1 is none.
    low, high, rate : float or None
        Limits of the command, unit_u, and of its change, unit_u per second.
    anti_windup, tracking_time
        ``clamping``, ``back_calculation`` with its time in s (None: kp/ki), or ``none``.
    unit_u, unit_y : str
        Of the command and of the measurement.
    scaling_u, scaling_y : float
        unit_u of the gains in one unit_u of the dynamics, and the same of unit_y: 1459 from V to mm/min; 1 where they
        are the same.
    specification, figures : PiSpecification, PiFigures or None
        What they were tuned to, and what they reach on the dynamics of the file.
    probability, draws
        Share of the models that the uncertainty allows on which the whole specification holds, told from ``draws``.
    forced : str or None
        Why they are kept although they miss the specification; None for gains that meet it.
    method : str or None
        How they were chosen.
    notes : tuple of str

    Examples
    --------
    >>> gains = PiSection(kp=0.8, ki=1.6, sample_time=0.02, unit_u="V", unit_y="A")
    >>> gains.form, gains.ti
    ('position', 0.5)
    """

    kp: Number
    ki: Number
    sample_time: Positive
    form: Literal["position", "incremental", "incremental_sum"] = "position"
    integration: Literal["backward", "forward", "trapezoidal"] = "backward"
    delay: Annotated[int, Field(strict=True, ge=0, le=1000)] = 0
    filter_time: NotNegative = 0.0
    average: Annotated[int, Field(strict=True, ge=1, le=1000)] = 1
    average_of: Literal["measurement", "command"] = "measurement"
    low: Number | None = None
    high: Number | None = None
    rate: Positive | None = None
    anti_windup: Literal["clamping", "back_calculation", "none"] = "clamping"
    tracking_time: Positive | None = None
    unit_u: str = ""
    unit_y: str = ""
    scaling_u: Positive = 1.0
    scaling_y: Positive = 1.0
    specification: PiSpecification | None = None
    figures: PiFigures | None = None
    probability: Share | None = None
    draws: Count | None = None
    forced: Text | None = None
    method: str | None = None
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _limits_in_order(self) -> Self:
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError(f"the limits of the command are {self.low:g} to {self.high:g}: low must lie below high")
        return self

    @property
    def ti(self) -> float | None:
        """Integral time kp/ki, s; None without integral action."""
        return self.kp / self.ki if self.ki else None
