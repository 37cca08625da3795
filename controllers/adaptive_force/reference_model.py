"""The set point made smooth: a second-order model, since the law asks for F_d' and F_d''.

F_d'' + 2 zeta/T F_d' + F_d/T^2 = set point / T^2
"""

import math
from dataclasses import dataclass, field


@dataclass(slots=True)
class ReferenceModel:
    """F_d on its way to a set point, exact at its steps.

    Attributes
    ----------
    time, damping : float
        T in s, and zeta.
    step_time : float
        s.
    value, rate : float
        F_d and F_d'.

    Examples
    --------
    >>> model = ReferenceModel(time=0.1, damping=1.0, step_time=0.1)
    >>> for _ in range(40):
    ...     model.advance(200.0)
    >>> round(model.value, 3), abs(model.second(200.0)) < 1e-6
    (200.0, True)
    """

    time: float
    damping: float
    step_time: float
    value: float = 0.0
    rate: float = 0.0
    _phi: tuple[float, float, float, float] = field(init=False)

    def __post_init__(self) -> None:
        self._phi = _transition(1 / self.time, self.damping, self.step_time)

    def advance(self, target: float) -> None:
        """One step, the target held."""
        a, b, c, d = self._phi
        off, rate = self.value - target, self.rate
        self.value = target + a * off + b * rate
        self.rate = c * off + d * rate

    def second(self, target: float) -> float:
        """F_d'' now."""
        return ((target - self.value) / self.time - 2 * self.damping * self.rate) / self.time

    def midway(self, target: float, dt: float) -> tuple[float, float, float]:
        """F_d'', F_d', F_d at half of ``dt`` from now: what a command that is held for it answers best."""
        second, half = self.second(target), dt / 2
        value, rate = self.value + self.rate * half + second * half**2 / 2, self.rate + second * half
        return ((target - value) / self.time - 2 * self.damping * rate) / self.time, rate, value

    def restart(self, value: float) -> None:
        """Begin again, at rest at a value."""
        self.value, self.rate = value, 0.0


def _transition(omega: float, zeta: float, h: float) -> tuple[float, float, float, float]:
    """exp([[0, 1], [-omega^2, -2 zeta omega]] h), by its closed form at every damping."""
    shift = zeta * omega
    s2 = shift**2 - omega**2
    if abs(s2) * h**2 < 1e-10:  # critical: sinh(s h) / s is h to rounding
        even, odd = 1.0, h
    elif s2 > 0:
        s = math.sqrt(s2)
        even, odd = math.cosh(s * h), math.sinh(s * h) / s
    else:
        s = math.sqrt(-s2)
        even, odd = math.cos(s * h), math.sin(s * h) / s
    fade = math.exp(-shift * h)
    return (
        fade * (even + shift * odd), fade * odd, -fade * omega**2 * odd, fade * (even - shift * odd),
    )  # fmt: skip
