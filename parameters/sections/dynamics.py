"""Sections of the identified dynamics, which simulate from the file alone, and of the PI gains tuned on them.

    y(t) = b(q) / a(q) u(t) + noise,    b(q) = b_nk q^-nk + ...,    a(q) = 1 + a_1 q^-1 + ...

Source: Ljung 1999, System Identification, section 4.2. ``nk`` counts as MATLAB does; Octave's arx counts one less.
"""

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from ...core.arrays import Array
from ...core.display import Plottable
from ...core.errors import ParameterError
from .base import (
    Count,
    ModelCovariance,
    NoCovariance,
    NotNegative,
    Number,
    Polynomial,
    Positive,
    Section,
    Sha256,
    Share,
    Text,
    VerdictSection,
    check_polynomials,
    coefficient_names,
)

MOST_ALTERNATIVES = 100
INTEGRATOR = 1e-14  # of the sum of |a|: a(1) below it is rounding of zero, a pole at exactly 1


class AlternativeModel(Section):
    """Another structure that the record supports, as b(q)/a(q), with its weight.

    Attributes
    ----------
    weight : float
        Between 0 and 1; the weight of the model itself is one minus the sum over its alternatives.
    structure, b, a, nk, uncertainty
        As in the dynamics.

    Examples
    --------
    >>> none = {"kind": "none", "reason": "given"}
    >>> AlternativeModel(weight=0.2, b=[0.0, 0.0, 0.5], a=[1.0, -0.5], nk=2, uncertainty=none).names
    ('a1', 'b2')
    """

    LINEAR_PART: ClassVar[str] = "linear part without the"  # structure, before the name of a nonlinearity of the input

    weight: Annotated[float, Field(strict=True, gt=0, lt=1)]
    structure: Text = "given"
    b: Polynomial
    a: Polynomial
    nk: Count
    uncertainty: Annotated[ModelCovariance | NoCovariance, Field(discriminator="kind")]

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        check_polynomials(self.b, self.a, self.nk, self.uncertainty)
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients that were estimated: a1 ..., then b<nk> ..."""
        return coefficient_names(self.b, self.a, self.nk)


class DynamicsSection(Plottable, Section):
    """An identified model of the feed drive and the cut.

    Attributes
    ----------
    structure : str
        How it was estimated: ``arx``, ``sriv``, ``output_error``, ``armax``, ``box_jenkins``; ``given``.
    b, a, c, d : tuple of float
        Whole polynomials in z^-1: b keeps its nk leading zeros; a and the noise polynomials start with 1. With white e,
        the noise is e/a (arx), c/a e (armax), e/d (box_jenkins).
    nk : int
        Samples of delay.
    sample_time : float
        Seconds.
    input, output, unit_u, unit_y : str
    uncertainty : ModelCovariance or NoCovariance
        Of a1 ... and the coefficients of b from b<nk> on.
    noise_variance : float or None
        In unit_y squared.
    n, record_sha256
        Samples it was fitted to, and the checksum of their record.
    operating_point : tuple of float or None
        Mean input and output that were subtracted before the fit.
    band : tuple of float or None
        Hz that the record excited; the model is not supported outside.
    held_out_fit : float or None
        Per cent of the output of samples that were not fitted that a free run explains, 100 (1 - rms error / rms);
        ``held_out_sha256`` is the checksum of their record.
    held_out_on : str or None
        Samples and model of ``held_out_fit``: the same structure fitted without them, where one record was divided.
    own_fit : float or None
        The same of this model on the record that it was fitted to, in per cent.
    alternatives : tuple of AlternativeModel
        Other structures that the record supports, with their weights. Draws of the uncertainty are of this mixture.
    verdict : VerdictSection or None
        How far the model can be used, by its validation; None where it was not validated.
    notes : tuple of str

    Examples
    --------
    >>> given = {"kind": "none", "reason": "given"}
    >>> model = DynamicsSection(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1, uncertainty=given)
    >>> model.simulate([1.0, 1.0, 1.0]).tolist(), model.dc_gain, model.stable
    ([0.0, 0.5, 0.75], 1.0, True)
    """

    structure: Text = "given"
    b: Polynomial
    a: Polynomial
    c: Polynomial = (1.0,)
    d: Polynomial = (1.0,)
    nk: Count
    sample_time: Positive
    input: str = "u"
    output: str = "y"
    unit_u: str = ""
    unit_y: str = ""
    uncertainty: Annotated[ModelCovariance | NoCovariance, Field(discriminator="kind")]
    noise_variance: NotNegative | None = None
    n: Count | None = None
    record_sha256: Sha256 | None = None
    operating_point: tuple[Number, Number] | None = None
    band: tuple[NotNegative, NotNegative] | None = None
    held_out_fit: Number | None = None
    held_out_sha256: Sha256 | None = None
    held_out_on: Text | None = None
    own_fit: Number | None = None
    alternatives: Annotated[tuple[AlternativeModel, ...], Field(max_length=MOST_ALTERNATIVES)] = ()
    verdict: VerdictSection | None = None
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        check_polynomials(self.b, self.a, self.nk, self.uncertainty)
        if self.c[0] != 1 or self.d[0] != 1:
            raise ValueError(f"c and d start with 1, not with {self.c[0]:g} and {self.d[0]:g}")
        if sum(other.weight for other in self.alternatives) >= 1:
            raise ValueError("the weights of the alternatives sum to 1 or more, which leaves none for the model")
        if self.band is not None and not self.band[0] < self.band[1]:
            raise ValueError(f"the band {self.band[0]:g} to {self.band[1]:g} Hz has its ends in the wrong order")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients that were estimated: a1 ..., then b<nk> ..."""
        return coefficient_names(self.b, self.a, self.nk)

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Roots of a, in z; that of an integrator is exactly 1."""
        roots = np.r_[1.0, np.roots(np.cumsum(self.a)[:-1])] if self._pole_at_one else np.roots(self.a)
        return np.asarray(roots, dtype=np.complex128)

    @property
    def stable(self) -> bool:
        """Whether every pole lies inside the unit circle."""
        return bool((np.abs(self.poles) < 1).all())

    @property
    def integrating(self) -> bool:
        """Whether one pole lies at exactly 1, but for rounding, and all others inside the unit circle.

        >>> given = {"kind": "none", "reason": "given"}
        >>> DynamicsSection(b=[0.0, 0.5], a=[1.0, -1.0], nk=1, sample_time=0.1, uncertainty=given).integrating
        True
        """
        return self._pole_at_one and bool((np.abs(self.poles[1:]) < 1).all())

    @property
    def _pole_at_one(self) -> bool:
        return len(self.a) > 1 and abs(float(np.sum(self.a))) <= INTEGRATOR * float(np.sum(np.abs(self.a)))

    @property
    def dc_gain(self) -> float:
        """Response to a constant input of 1, unit_y per unit_u; infinite for an integrator."""
        above, below = float(np.sum(self.b)), 0.0 if self._pole_at_one else float(np.sum(self.a))
        return above / below if below else float(np.copysign(np.inf, above))

    def without_integrator(self) -> Self:
        """The section of the change of the output: a divided by 1 - q^-1, without covariance and alternatives.

        >>> given = {"kind": "none", "reason": "given"}
        >>> model = DynamicsSection(b=[0.0, 0.5], a=[1.0, -1.5, 0.5], nk=1, sample_time=0.1, uncertainty=given)
        >>> model.without_integrator().a
        (1.0, -0.5)
        """
        a = tuple(float(x) for x in np.cumsum(self.a)[:-1])
        none = NoCovariance(kind="none", reason="the model without its integrator")
        return self.model_copy(update={"a": a, "uncertainty": none, "alternatives": ()})

    def response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """G at frequencies in Hz, complex, the shape of ``frequency``."""
        z = np.exp(-2j * np.pi * np.asarray(frequency, dtype=np.float64) * self.sample_time)
        return np.asarray(np.polyval(self.b[::-1], z) / np.polyval(self.a[::-1], z), dtype=np.complex128)

    def simulate(self, u: ArrayLike) -> Array:
        """Free run from rest.

        Parameters
        ----------
        u : array_like, shape (n,)
            Input in unit_u, less the operating point; a value each sample_time.

        Returns
        -------
        ndarray, shape (n,)
            Output in unit_y, less the operating point.

        Raises
        ------
        ParameterError
            The input is not a row of finite numbers, or the simulation diverges.
        """
        from scipy.signal import lfilter

        given = np.asarray(u, dtype=np.float64)
        if given.ndim != 1 or not np.isfinite(given).all():
            raise ParameterError(f"an input of shape {given.shape}: a simulation takes a row of finite numbers.")
        with np.errstate(all="ignore"):
            out = np.asarray(lfilter(self.b, self.a, given), dtype=np.float64)
        if not np.isfinite(out).all():
            raise ParameterError("the simulation diverges: the model is not stable, or the input far too large.")
        return out


class PiSpecification(Section):
    """Requirements on the loop, as limits on the figures of the same name; None leaves a figure free.

    Times in s, the integral time kp/ki among them; overshoot, undershoot and steady-state error as shares of the step;
    phase margin in degrees at least, gain margin as a factor at least; disturbance, travel, peak_u and noise_gain in
    the units of the gains; these and all others at most.

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
        """The limits that are set, by name."""
        values = {name: getattr(self, name) for name in type(self).model_fields}
        return {name: value for name, value in values.items() if value is not None}


class PiFigures(Section):
    """Figures of merit of the loop for a unit step of the reference from rest; None is infinite.

    Times in s from 10 to 90 % and until within 2 %; overshoot, undershoot and steady-state error as shares of the step;
    ms and mt the peaks of |1 / (1 + L)| and |L / (1 + L)|; margins in degrees, as a factor, and s of further delay.
    Further figures of the tuner have their own names.
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
    """A digital PI controller.

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
    setpoint_weight : float
        Share of the reference in the proportional part, kp (setpoint_weight r - y); 1 is the usual PI.
    scaling_u, scaling_y : float
        unit_u of the gains in one unit_u of the dynamics, and the same of unit_y: 1459 from V to mm/min; 1 where they
        are the same.
    specification, figures : PiSpecification, PiFigures or None
        Requirements of the tuning, and figures of merit on the dynamics of the file.
    probability, draws
        Share of the models that the uncertainty allows on which the whole specification holds, from ``draws``.
    probability_interval : tuple of float or None
        95 % Monte Carlo interval of that share.
    required_probability : float or None
        Share that was required; None for gains tuned on the estimate alone.
    missed : dict of float
        Share of the draws that violate each limit, by the name of the limit.
    verdict : VerdictSection or None
        How far the gains can be used; None where they were not judged.
    forced : str or None
        Reason for keeping gains that miss the specification; None for gains that meet it.
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
    setpoint_weight: Share = 1.0
    scaling_u: Positive = 1.0
    scaling_y: Positive = 1.0
    specification: PiSpecification | None = None
    figures: PiFigures | None = None
    probability: Share | None = None
    draws: Count | None = None
    probability_interval: tuple[Share, Share] | None = None
    required_probability: Share | None = None
    missed: dict[str, Share] = Field(default_factory=dict)
    verdict: VerdictSection | None = None
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
