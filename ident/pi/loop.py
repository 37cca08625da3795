"""Linear closed loop of a PI and a model: poles, responses, figures of merit.

    y = G (u + input load) + output load,    u = F r - C H y

G is the model, C the PI with its delay and an average of the command, H the low-pass and an average of the measurement;
F is C with the setpoint weight; L = G C H. Figures refer to the unit step of the reference from rest, unless stated
otherwise.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array
from ...core.display import Displayable, Plottable
from ..estimators.filters import is_stable
from ..model import Model
from .figures_of_merit import figures_on_grid
from .gains import PiGains, product, summed
from .loops import check_pair

Fraction = tuple[Array, Array]

RECOVERED = 0.05  # of the peak after a step of load
DECAYED = 1e-6  # share of a transient that is neglected
SHORTEST, LONGEST = 50, 50_000  # samples of a step whose duration is not given


@dataclass(frozen=True, slots=True, repr=False)
class FiguresOfMerit(Displayable):
    """Figures of merit of a closed loop.

    Times are in seconds, linearly interpolated between samples. Fractions refer to the final value of the step, which
    is 1 with integral action. Events beyond the duration have infinite times. An unstable loop has infinite errors,
    phase and delay margin 0, gain margin 1.

    Attributes
    ----------
    stable : bool
    rise_time : float
        From 10 to 90 % of the final value, first crossings, s.
    settling_time : float
        Until the step stays within 2 % of its final value, s.
    overshoot, undershoot : float
        Above the final value, and below zero, as fractions of the final value.
    steady_error : float
        1 less the final value.
    ms, mt : float
        Peaks of |S| = 1/|1 + L| and of |T| = |L|/|1 + L|.
    phase_margin : float
        Degrees; smallest over all crossovers; infinite without one.
    gain_margin : float
        The factor nearest 1 (as a ratio) that brings the loop to the stability limit; below 1 for a reduction of the
        gain; infinite if there is none.
    crossover : float
        Gain crossover of the phase margin, |L| = 1, rad/s; 0 without one.
    delay_margin : float
        Additional delay that brings the loop to the stability limit, s; smallest over all crossovers.
    travel : float
        Sum of |change of the command| in a unit reference step, its first jump from 0 included, unit_u per unit_y.
    peak_u : float
        Largest |command| in it, unit_u per unit_y.
    noise_gain : float
        Standard deviation of the command per standard deviation of white measurement noise, unit_u per unit_y.
    disturbance_peak : float
        Largest |y| after a unit step of load at the plant input, unit_y per unit_u.
    disturbance_iae : float
        Integral of |y| after the same step, unit_y s per unit_u. What follows the duration counts by its integral,
        which is known: exact where y keeps its sign there, otherwise too small.
    iae : float
        Integral of |reference - y| of a unit reference step, s; likewise.
    """

    stable: bool
    rise_time: float
    settling_time: float
    overshoot: float
    undershoot: float
    steady_error: float
    ms: float
    mt: float
    phase_margin: float
    gain_margin: float
    crossover: float
    delay_margin: float
    travel: float
    peak_u: float
    noise_gain: float
    disturbance_peak: float
    disturbance_iae: float
    iae: float

    @property
    def crossover_hz(self) -> float:
        """Crossover, Hz."""
        return self.crossover / (2 * np.pi)


@dataclass(frozen=True, slots=True, repr=False)
class Loop(Plottable):
    """A closed loop and its transfer functions in z^-1."""

    model: Model
    gains: PiGains

    @property
    def open(self) -> Fraction:
        """L = G C H, num and den."""
        (pn, pd), (hn, hd) = self.gains.forward, self.gains.feedback
        return product(self.model.b, pn, hn), product(self.model.a, pd, hd)

    @property
    def characteristic(self) -> Array:
        """The denominator of every closed transfer function."""
        return summed(*self.open)

    @property
    def closed(self) -> Fraction:
        """Reference to output, num and den."""
        (pn, _), (_, hd) = self.gains.of_reference, self.gains.feedback
        return product(self.model.b, pn, hd), self.characteristic

    @property
    def sensitivity(self) -> Fraction:
        """S = 1 / (1 + L), num and den."""
        return self.open[1], self.characteristic

    @property
    def command(self) -> Fraction:
        """Reference to command, num and den."""
        (pn, _), (_, hd) = self.gains.of_reference, self.gains.feedback
        return product(self.model.a, pn, hd), self.characteristic

    @property
    def noise_to_command(self) -> Fraction:
        """Measurement noise to command, num and den."""
        (pn, _), (hn, _) = self.gains.forward, self.gains.feedback
        return -product(self.model.a, pn, hn), self.characteristic

    @property
    def load(self) -> Fraction:
        """Load at the plant input to output, num and den."""
        (_, pd), (_, hd) = self.gains.forward, self.gains.feedback
        return product(self.model.b, pd, hd), self.characteristic

    @property
    def load_to_command(self) -> Fraction:
        """Load at the plant input to command at the plant, num and den."""
        (pn, _), (hn, _) = self.gains.forward, self.gains.feedback
        return -product(self.model.b, pn, hn), self.characteristic

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Roots of the characteristic polynomial, in z."""
        return np.asarray(np.roots(np.trim_zeros(self.characteristic, "b")), dtype=np.complex128)

    @property
    def radius(self) -> float:
        """Largest modulus of a pole."""
        return float(np.abs(self.poles).max(initial=0.0))

    @property
    def stable(self) -> bool:
        """Whether every pole lies inside the unit circle."""
        return is_stable(self.characteristic)

    def step(self, n: int) -> Array:
        """Output in a unit step of the reference from rest, shape (n,), unit_y per unit_y."""
        return _run(self.closed, n)

    def command_step(self, n: int) -> Array:
        """Command at the plant in a unit step of the reference, shape (n,), unit_u per unit_y."""
        return _run(self.command, n)

    def disturbance_step(self, n: int) -> tuple[Array, Array]:
        """Output in a unit step of load at the plant input and at the plant output, each shape (n,)."""
        return _run(self.load, n), _run(self.sensitivity, n)

    def command_after_load(self, n: int) -> Array:
        """Command at the plant in a unit step of load at the plant input, shape (n,), unit_u per unit_u."""
        return _run(self.load_to_command, n)

    def figures(self, duration: float | None = None) -> FiguresOfMerit:
        """All figures; steps of ``duration`` s, by default until the slowest pole has decayed."""
        length = _decay_time(self) if duration is None else duration
        table = figures_on_grid(self.model, [self.gains.kp], [self.gains.ki], self.gains, length)
        return FiguresOfMerit(**{f.name: table[f.name][0].item() for f in fields(FiguresOfMerit)})


def loop_of(model: Model, gains: PiGains) -> Loop:
    """Closed loop of a model and PI gains.

    Errors: IdentError for other sample times, and for a loop without a sample of delay.
    """
    check_pair(model, gains)
    return Loop(model, gains)


def _run(fraction: Fraction, n: int) -> Array:
    """Response to a unit step from rest."""
    from scipy.signal import lfilter

    return np.asarray(lfilter(*fraction, np.ones(n)), dtype=np.float64)


def _decay_time(loop: Loop) -> float:
    """Seconds until the slowest pole has decayed to ``DECAYED``, within bounds."""
    T, radius = loop.model.sample_time, loop.radius
    if not 0 < radius < 1:
        return SHORTEST * T
    return float(np.clip(np.log(DECAYED) / np.log(radius), SHORTEST, LONGEST)) * T


@dataclass(frozen=True, slots=True, repr=False)
class LoadStep(Displayable):
    """Response to a step of load at the plant input that would change the output by 1 without control.

    For a plant without a finite static gain it is a unit step of load.

    Attributes
    ----------
    size : float
        Of the step, unit_u.
    time : ndarray, shape (n,), s
    output : ndarray, shape (n,), unit_y
        Deviation from the reference.
    command : ndarray, shape (n,), unit_u
        Change of the command at the plant.
    """

    size: float
    time: Array
    output: Array
    command: Array

    @property
    def peak(self) -> float:
        """Largest deviation of the output, unit_y."""
        return float(np.abs(self.output).max())

    @property
    def recovery(self) -> float:
        """Time after which the deviation stays below 5 % of its peak, s; infinite beyond the simulation."""
        left = np.flatnonzero(np.abs(self.output) > RECOVERED * self.peak)
        return float(self.time[left[-1] + 1]) if left.size and left[-1] + 1 < len(self.time) else np.inf

    @property
    def travel(self) -> float:
        """Sum of the changes of the command, unit_u."""
        return float(np.abs(np.diff(self.command, prepend=0.0)).sum())


def load_step(loop: Loop, duration: float | None = None) -> LoadStep:
    """Simulated response to a step of load, over ``duration`` s or until the slowest pole has decayed.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1)
    >>> found = load_step(loop_of(model, PiGains(0.5, 2.0, 0.1)))
    >>> round(found.peak, 3), round(found.recovery, 1), round(found.travel, 3)
    (0.575, 2.3, 1.0)
    """
    T, gain = loop.model.sample_time, abs(loop.model.dc_gain)
    n = round((_decay_time(loop) if duration is None else duration) / T) + 1
    size = 1 / gain if 0 < gain < np.inf else 1.0
    output, command = loop.disturbance_step(n)[0], loop.command_after_load(n)
    return LoadStep(size, T * np.arange(n, dtype=np.float64), size * output, size * command)
