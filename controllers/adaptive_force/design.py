"""Design rule of the adaptive force controller: Kd, lambda and rates from the estimates, and the margins of the loop.

At a constant set point F_d the law (5) with beta^' = -g3 E F_d is a PI controller of E = F~' + lambda F~, and drive and
cut (2.3) have two poles, p <= q:

    u = -(Kd + g3 F_d^2 / s) (s + lambda) F~,        F / u = 1 / ((m/k) (s + p)(s + q))

    lambda = p                      cancels the slower pole
    g3 = Kd q / F_max^2             cancels the faster one at the largest set point
    Kd = (m/k) / (2 theta)          crossover at 1 / (2 theta), with m/k of the deepest cut (k grows with the depth)
    g2 = g3 T^2, g1 = g3 T^4        the sizes of F_d' and F_d'' against F_d, T the time of the reference model
    T = 2 / lambda                  at least 10 theta; damping 1

theta is the dead time: half of the averaging time, half a step, and the delay. Of dead time alone, the loop
exp(-theta s) / (2 theta s) that is left has a phase margin of 61 degrees and a gain margin of pi (internal model
control, Rivera, Morari & Skogestad 1986, doi 10.1021/i200032a041, with a filter time of theta). Alpha + Kd > lambda m,
which the proof of `stability` needs, holds by itself, as alpha is m (p + q).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array
from ...core.errors import UsageError

LARGEST_RATIO: Final = 1e9  # of the poles
SEPARATE: Final = 1e-6  # relative: poles nearer to each other are set apart by this much
FREQUENCIES: Final = 4000  # of the frequency response from a thousandth of the slower pole to half the sample rate
OF_DRAWS: Final = 600  # the same for each draw of the estimates
LEAST_GAIN_MARGIN, LEAST_PHASE_MARGIN = 2.0, 30.0  # below: refused
LARGEST_RATES: Final = 10.0  # of m and alpha, times those of the rule: refused above
SETTLED, SETTLED_REFERENCE = 3.91, 5.83  # time constants until within 2 %: of first order, of the reference model
SLOWEST_REFERENCE: Final = 10.0  # dead times: the least time of the reference model


@dataclass(frozen=True, slots=True)
class Timing:
    """Timing of the law.

    Attributes
    ----------
    sample_time : float
        s of a step.
    samples : int
        Steps over which the force is averaged.
    delay : float
        s between reading and feed, beyond averaging and holding.
    """

    sample_time: float
    samples: int
    delay: float = 0.0

    @property
    def dead_time(self) -> float:
        """Dead time of the loop, s: half of the averaging time, half a step, and the delay."""
        return self.sample_time * (self.samples + 1) / 2 + self.delay


class ForceGains(NamedTuple):
    """Gains and rates of the law, and the time of its reference model, in the units of the section."""

    Kd: float
    lam: float
    g1: float
    g2: float
    g3: float
    reference_time: float


class Margins(NamedTuple):
    """Margins of a loop: factor of its gain, degrees of phase, and further dead time in s that it withstands."""

    gain: float
    phase: float
    dead_time: float

    @property
    def stable(self) -> bool:
        """Whether the loop is stable."""
        return self.gain > 1


def poles_of(ratios: Array) -> NDArray[np.complex128]:
    """The poles p and q, 1/s, the slower first, shape (n, 2), of estimates (n, 3) of m/k, (mc+d)/k, dc/k.

    Examples
    --------
    >>> poles_of(np.array([[2e-3, 0.125, 1.25]])).real.round(1).tolist()
    [[12.5, 50.0]]
    """
    a, b, c = (ratios[:, j].astype(np.complex128) for j in range(3))
    root = np.sqrt(b**2 - 4 * a * c)
    return np.column_stack([(b - root) / (2 * a), (b + root) / (2 * a)])


def design_gains(ratios: Sequence[float], force: float, timing: Timing) -> ForceGains:
    """Gains by the rule of this module.

    Parameters
    ----------
    ratios : sequence of 3 floats
        m/k, (mc+d)/k, dc/k at the deepest cut, in s^2, s and 1 times unit of the command per unit of the force.
    force : float
        Largest set point, F_max.
    timing : Timing

    Raises
    ------
    UsageError
        An estimate that is not positive (a force that falls while the feed rises), or complex poles.

    Examples
    --------
    >>> gains = design_gains((1e-3, 0.0625, 0.625), 320.0, Timing(0.001, 20, delay=0.001))
    >>> round(gains.Kd, 4), round(gains.lam, 2), f"{gains.g3:.3g}", round(gains.reference_time, 3)
    (0.0435, 12.5, '2.12e-05', 0.16)
    """
    refuse_no_plant(ratios)
    p, q = (float(x) for x in poles_of(np.array([ratios]))[0].real)
    theta = timing.dead_time
    Kd = ratios[0] / (2 * theta)
    g3, T = Kd * q / force**2, max(2 / p, SLOWEST_REFERENCE * theta)
    return ForceGains(Kd, p, g3 * T**4, g3 * T**2, g3, T)


def refuse_no_plant(ratios: Sequence[float]) -> None:
    """Raise UsageError where estimates are those of no drive and cut.

    Raises
    ------
    UsageError
        An estimate is not positive, or the poles are complex or too far apart.
    """
    named = ", ".join(f"{name} {value:.4g}" for name, value in zip(("m", "alpha", "beta"), ratios, strict=True))
    if not min(ratios) > 0:
        raise UsageError(
            f"adaptive_force: the estimates {named} are not all positive: the force of the record falls when the feed "
            "rises, or its columns are exchanged. Check the sign of the force and the columns, and identify it again."
        )
    if ratios[1] * ratios[1] < 4 * ratios[0] * ratios[2]:
        raise UsageError(
            f"adaptive_force: the estimates {named} give complex poles, which no drive and cut of (2.1) and (2.2) has; "
            "identify a record with a faster change of the feed."
        )
    if ratios[1] * ratios[1] > LARGEST_RATIO * ratios[0] * ratios[2]:
        raise UsageError(
            f"adaptive_force: the estimates {named} give poles further apart than a factor of {LARGEST_RATIO:g}, which "
            "no drive and cut has; identify the record again."
        )


def loop_response(
    ratios: Array, gains: ForceGains, force: float, timing: Timing, omega: Array
) -> NDArray[np.complex128]:
    """Frequency response (n, w) of the sampled open loop at a constant set point, at ``omega`` (w,), rad/s.

    Parameters
    ----------
    ratios : ndarray, shape (n, 3)
    gains : ForceGains
    force : float
        Set point.
    timing : Timing
    omega : ndarray, shape (w,)

    Notes
    -----
    The plant is held over a step (zero-order hold), mean and rate of the force are those of `signals.Revolution`, the
    adaptation of beta^ is the trapezoidal sum of the controller.
    """
    h, N = timing.sample_time, timing.samples
    back = np.exp(-1j * omega * h)  # z^-1
    mean = (1 + back) / 2 * (1 - back**N) / (1 - back) / N
    rate = (1 - back**N) / (N * h)
    law = gains.Kd + gains.g3 * force**2 * h / 2 * (1 + back) / (1 - back)
    p, q = poles_of(ratios).T
    q = np.where(np.abs(q - p) < SEPARATE * np.abs(q), q * (1 + SEPARATE), q)

    def held(pole: NDArray[np.complex128]) -> NDArray[np.complex128]:
        after = np.exp(-pole * h)
        step: NDArray[np.complex128] = ((1 - after) / pole)[:, None] * back / (1 - after[:, None] * back)
        return step

    plant = (held(p) - held(q)) / ((q - p) * ratios[:, 0])[:, None]
    response: NDArray[np.complex128] = law * (rate + gains.lam * mean) * np.exp(-1j * omega * timing.delay) * plant
    return response


def loop_margins(ratios: Array, gains: ForceGains, force: float, timing: Timing) -> list[Margins]:
    """Margins of the sampled loop at a constant set point, for each of n estimates (n, 3).

    Examples
    --------
    >>> ratios, timing = (1e-3, 0.0625, 0.625), Timing(0.001, 20, delay=0.001)
    >>> gains = design_gains(ratios, 320.0, timing)
    >>> found = loop_margins(np.array([ratios]), gains, 320.0, timing)[0]
    >>> round(found.gain, 1), round(found.phase), round(1e3 * found.dead_time)
    (4.4, 62, 26)
    """
    slowest = min(float(np.abs(poles_of(ratios)).min()), gains.lam)
    count = FREQUENCIES if len(ratios) == 1 else OF_DRAWS
    omega = np.geomspace(1e-3 * slowest, 0.9999 * np.pi / timing.sample_time, count)
    return [_margins(omega, row) for row in loop_response(ratios, gains, force, timing, omega)]


def small_margins(found: Margins) -> str:
    """Sentences on margins of a loop that are too small, with the remedy; empty where they suffice.

    Examples
    --------
    >>> small_margins(Margins(4.4, 62.0, 0.026)), small_margins(Margins(1.1, 5.0, 0.001))[:43]
    ('', 'the loop would have a gain margin of 1.1 an')
    """
    if found.gain >= LEAST_GAIN_MARGIN and found.phase >= LEAST_PHASE_MARGIN:
        return ""
    return (
        f"the loop would have a gain margin of {found.gain:.2g} and a phase margin of {found.phase:.0f} degrees; at "
        f"least {LEAST_GAIN_MARGIN:g} and {LEAST_PHASE_MARGIN:g} are needed. Lower Kd or the rates, shorten the sample "
        "time, or leave the gains to the design rule."
    )


def fast_rates(ratios: Array, gains: ForceGains, force: float) -> str:
    """Sentences on rates of m and alpha, which no margin holds; empty where they follow from that of beta.

    Examples
    --------
    >>> ratios = np.array([1e-3, 0.0625, 0.625])
    >>> gains = design_gains(ratios.tolist(), 320.0, Timing(0.001, 20, delay=0.001))
    >>> fast_rates(ratios, gains, 320.0), fast_rates(ratios, gains._replace(g2=20 * gains.g2), 320.0)[:33]
    ('', 'the rate g2 is 20 times g3 times ')
    """
    T, q = gains.reference_time, float(np.abs(poles_of(ratios[None])).max())
    g3 = max(gains.g3, gains.Kd * q / force**2)
    for name, rate, power in (("g1", gains.g1, 4), ("g2", gains.g2, 2)):
        if rate > LARGEST_RATES * g3 * T**power:
            times = f"{rate / (g3 * T**power):.3g} times g3 times reference_time^{power}"
            return f"the rate {name} is {times}, at most {LARGEST_RATES:g}: lower it, or leave it to the design rule."
    return ""


def _margins(omega: Array, L: NDArray[np.complex128]) -> Margins:
    """Smallest margins over all crossings, between frequencies by straight lines."""
    gain, phase, dead = np.inf, np.inf, np.inf
    for i in np.flatnonzero((L.imag[:-1] * L.imag[1:] <= 0) & (L.real[:-1] < 0) & (L.real[1:] < 0)):
        share = L.imag[i] / (L.imag[i] - L.imag[i + 1]) if L.imag[i] != L.imag[i + 1] else 0.0
        gain = min(gain, -1 / float(L.real[i] + share * (L.real[i + 1] - L.real[i])))
    size = np.log(np.maximum(np.abs(L), 1e-300))
    for i in np.flatnonzero(size[:-1] * size[1:] < 0):
        share = size[i] / (size[i] - size[i + 1])
        at = float(omega[i] * (omega[i + 1] / omega[i]) ** share)
        angle = float(np.angle(-(L[i] + share * (L[i + 1] - L[i])))) % (2 * np.pi)
        phase, dead = min(phase, float(np.degrees(angle))), min(dead, angle / at)
    return Margins(float(gain), float(phase), float(dead))


def settling_time(ratios: Array, gains: ForceGains, force: float) -> float:
    """Time in s until the force has settled within 2 % of a set point, from the reference model and the slowest pole.

    Examples
    --------
    >>> ratios = np.array([1e-3, 0.0625, 0.625])
    >>> round(settling_time(ratios, design_gains(ratios.tolist(), 320.0, Timing(0.001, 20, 0.001)), 320.0), 2)
    0.98
    """
    r0, r1, r2 = ratios
    integral = gains.g3 * force**2
    loop = np.array([r0, r1 + gains.Kd, r2 + gains.Kd * gains.lam + integral, integral * gains.lam])
    slowest = float((-np.roots(loop).real).min())
    if not slowest > 0:
        return np.inf
    return float(np.hypot(SETTLED_REFERENCE * gains.reference_time, SETTLED / slowest))


def largest_step(ratios: Array, gains: ForceGains, force: float, timing: Timing) -> float:
    """The largest step, s, at which the loop is stable with these gains; a whole part of the averaging time.

    A longer step delays the feed by as much more.

    Examples
    --------
    >>> ratios, timing = (1e-3, 0.0625, 0.625), Timing(0.001, 20, delay=0.001)
    >>> largest_step(np.array([ratios]), design_gains(ratios, 320.0, timing), 320.0, timing)
    0.02
    """
    average = timing.sample_time * timing.samples
    for samples in range(1, timing.samples):
        step = average / samples
        longer = Timing(step, samples, timing.delay + step - timing.sample_time)
        if loop_margins(ratios, gains, force, longer)[0].stable:
            return step
    return timing.sample_time
