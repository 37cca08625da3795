"""The control laws, from a load or force to a feed override, and the settings of a file for constant load.

Position form, as LinuxCNC's pid runs it about the middle of the limits, from the feed at entry. Incremental form, as
Tai, Tsai & Li 2023 word eq. 16:

    u_k = u_(k-1) + Kp e_k + Ki sum(e)

"U0 is the last control signal" makes Kp an integral gain and Ki one of the integral. The limits are inside the
recursion, so it does not wind up; the sum of Ki holds while a limit is active and the error pushes further.

Constant roughness scales the feed by reference over measured force, adaptive force control estimates the process; see
`fitmodels.controllers.roughness` and `fitmodels.controllers.adaptive_force`. Both follow the machine in every sample.
"""

import math
from typing import TYPE_CHECKING

from ...core.errors import GateError, ParameterError
from ..adaptive_force.signals import ReferenceModel, Revolution

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.exports.loop import LoadLoop
    from ...parameters.sections.load_line import LoadLineSection


def line_of(pf: "ParameterFile") -> "LoadLineSection":
    """Settings of milling at constant load.

    Raises
    ------
    ParameterError
        The file has none.
    """
    if pf.load_line is None:
        raise ParameterError(
            "the file has no settings of milling at constant load; set them with `fitmodels settings params.json`."
        )
    return pf.load_line


def loop_of(pf: "ParameterFile") -> "LoadLoop":
    """Gains, limits and settings.

    Raises
    ------
    GateError
        The file has no gains or no settings of the loop, or fails the check.
    """
    from ...parameters.exports.loop import loop_settings
    from ...parameters.exports.names import plain
    from ...parameters.exports.view import require_check

    require_check(pf)
    found = loop_settings(pf, own_form=True)
    if found.loop is None:
        raise GateError(f"the parameter file of {plain(pf.identity.tool)} on {plain(pf.identity.work)} {found.lacking}")
    return found.loop


def low_pass_gain(loop: "LoadLoop", time: float) -> float:
    """Gain of a one-pole low-pass of a time constant, s; 1 without one."""
    return -math.expm1(-loop.sample_time / time) if time else 1.0


def _holds(law: "PositionLaw | IncrementalLaw", error: float, *, slow: bool) -> bool:
    """Whether the sum holds: the output is clipped, or the feed slowed from outside, and the error pushes further."""
    return not error * law.limited <= 0 or (slow and error > 0)


class PositionLaw:
    """PI in position form with clamping, from the override at entry.

    Attributes
    ----------
    limited : int
        1 or -1 while the PI is clipped at its upper or lower limit, else 0.
    """

    __slots__ = ("_bias", "_half", "_i", "_middle", "_p", "_sum", "_time", "limited")

    def __init__(self, loop: "LoadLoop") -> None:
        self._p, self._i, self._time = loop.p, loop.i, loop.sample_time  # properties take time
        self._middle, self._half = (loop.low + loop.high) / 2, (loop.high - loop.low) / 2
        self.enter(self._middle)

    def enter(self, override: float) -> None:
        """Begin at an override."""
        self._bias, self._sum, self.limited = override - self._middle, 0.0, 0

    def target(self, error: float, *, slow: bool = False) -> float:
        """Override for an error; the sum holds while the output is clipped, or the feed slow, and the error pushes."""
        if not _holds(self, error, slow=slow):
            self._sum += error * self._time
        half = self._half
        out = self._bias + self._p * error + self._i * self._sum
        self.limited = (out > half) - (out < -half)
        return self._middle + min(max(out, -half), half)


class IncrementalLaw:
    """Eq. 16 inside its feed limits and rates.

    Attributes
    ----------
    limited : int
        1 or -1 while u is clipped at its upper or lower limit, else 0.
    """

    __slots__ = ("_back_off", "_high", "_i", "_last", "_low", "_p", "_recover", "_sum", "limited")

    def __init__(self, loop: "LoadLoop") -> None:
        self._low, self._high, self._p, self._i = loop.low, loop.high, loop.p, loop.i * loop.sample_time
        self._back_off, self._recover = loop.back_off * loop.sample_time, loop.recover * loop.sample_time
        self.enter(loop.low)

    def enter(self, override: float) -> None:
        """Begin at an override."""
        self._last, self._sum, self.limited = override, 0.0, 0

    def target(self, error: float, *, slow: bool = False) -> float:
        """Override for an error; it does not rise while the feed is slowed from outside."""
        last = self._last
        if not _holds(self, error, slow=slow):
            self._sum += error
        unlimited, most = last + self._p * error + self._i * self._sum, last if slow else last + self._recover
        self._last = min(max(unlimited, self._low, last - self._back_off), self._high, most)
        self.limited = (unlimited > self._high) - (unlimited < self._low)
        return self._last


class RatioLaw:
    """The feed of the servo, by a first-order model of it, times reference over measured force.

    From entry, where the force still builds up, the feed rises at ``recover`` until the law first asks for less.

    Attributes
    ----------
    limited : int
        1 or -1 while the override is clipped at its upper or lower limit, else 0.
    """

    __slots__ = ("_high", "_low", "_rise", "_servo", "_share", "_soft", "_u", "limited")

    def __init__(self, loop: "LoadLoop") -> None:
        self._low, self._high, self._servo, self.limited = loop.low, loop.high, loop.low, 0
        self._share = low_pass_gain(loop, loop.servo_time)
        self._u, self._rise, self._soft = loop.low, loop.recover * loop.sample_time, True

    def track(self, u: float, force: float, reference: float, *, closed: bool) -> None:
        """Advance the model of the servo by a sample under the last override."""
        self._u = u
        self._servo += (u - self._servo) * self._share

    def enter(self) -> None:
        """Begin at the feed of the servo."""
        self.limited, self._soft = 0, True

    def target(self, measured: float, reference: float, *, known: bool) -> float:
        """Override for a force."""
        wanted = self._servo * reference / measured
        self.limited = (wanted > self._high) - (wanted < self._low)
        inside = min(max(wanted, self._low), self._high)
        self._soft = self._soft and inside > self._u
        return min(inside, self._u + self._rise) if self._soft else inside


class AdaptiveLaw:
    """The adaptive law on the force of the last revolution.

    E = F~' + lambda F~ with F~ = F - F_d, and u = m F_d'' + alpha F_d' + beta F_d - Kd E. The estimates follow their
    law by the trapezoidal rule, unless the last command was limited or a reading is missing.

    Attributes
    ----------
    m, alpha, beta : float
        Estimates over k.
    error, error_rate : float
        F~ and F~'.
    adapting : bool
        Whether the estimates were updated in the last sample.
    limited : int
        1 or -1 while the override is clipped at its upper or lower limit, else 0.
    model, revolution
        The reference model, and the last revolution of force and F_d.
    """

    __slots__ = (
        "_E", "_begins", "_loop", "_w", "adapting", "alpha", "beta", "error", "error_rate", "limited", "m", "model",
        "revolution",
    )  # fmt: skip

    def __init__(self, loop: "LoadLoop") -> None:
        self._loop, self.limited, self.adapting, self._begins = loop, 0, False, False
        self.m, self.alpha, self.beta = loop.m, loop.alpha, loop.beta
        self.error = self.error_rate = self._E = 0.0
        self._w = (0.0, 0.0, 0.0)
        self.model = ReferenceModel(loop.model_time, loop.model_damping, loop.sample_time)
        self.revolution = Revolution(loop.average, loop.sample_time)
        for _ in range(loop.average + 1):
            self.revolution.push(0.0, 0.0, 0.0)

    def track(self, u: float, force: float, reference: float, *, closed: bool) -> None:
        """Advance reference model and revolution by a sample."""
        if closed:
            self.model.advance(reference)
        self.revolution.push(force, self.model.value, self.model.rate)

    def enter(self) -> None:
        """Begin with F_d at the measured force."""
        self.model.restart(self.revolution.force)
        self.revolution.want(self.revolution.force)
        self.limited, self._begins = 0, True

    def target(self, measured: float, reference: float, *, known: bool) -> float:
        """Override for the last revolution."""
        loop = self._loop
        self._adapt(known=known)
        second, rate, value = self.model.midway(reference, loop.sample_time)
        feed = self.m * second + self.alpha * rate + self.beta * value - loop.Kd * self._E
        wanted = feed / loop.feed_programmed
        self.limited = (wanted > loop.high) - (wanted < loop.low)
        return min(max(wanted, loop.low), loop.high)

    def _adapt(self, *, known: bool) -> None:
        loop, w, old = self._loop, self.revolution.wanted, self._w
        self.error, self.error_rate = self.revolution.force - w[2], self.revolution.force_rate - w[1]
        E = self.error_rate if self._begins else self.error_rate + loop.lam * self.error
        self.adapting = known and not self.limited and not self._begins
        if self.adapting:
            step = (self._E + E) / 2 * loop.sample_time
            self.m -= loop.g1 * step * (w[0] + old[0]) / 2
            self.alpha -= loop.g2 * step * (w[1] + old[1]) / 2
            self.beta -= loop.g3 * step * (w[2] + old[2]) / 2
        self._E, self._w, self._begins = E, w, False


def law_of_loop(loop: "LoadLoop") -> PositionLaw | IncrementalLaw | RatioLaw | AdaptiveLaw:
    """The control law of a loop, at its start."""
    if loop.law == "ratio":
        return RatioLaw(loop)
    if loop.law == "adaptive":
        return AdaptiveLaw(loop)
    return IncrementalLaw(loop) if loop.form == "incremental_sum" else PositionLaw(loop)
