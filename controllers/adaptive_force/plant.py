"""Plant of LYAP: a feed drive, the milling process behind it, and the measured force.

    drive      m x'' + d x' = f_r                                   (2.1)
    process    F' + c F = k v,    v = x' >= 0                       (2.2)

The command f_r is a feed in mm/min and the drive reaches the feed that is commanded, so d is 1 and m a time in s.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

import numpy as np

from ...core.display import Displayable
from ...core.errors import UsageError

if TYPE_CHECKING:
    from ...parameters import ParameterFile

Depth = float | Sequence[tuple[float, float]]
APART = 1e-6  # of the faster pole: closer poles are treated as equal


@dataclass(slots=True, repr=False)
class DriveAndCut(Displayable):
    """The drive and process of LYAP, integrated exactly under a command that is held.

    The paper prints no value of m, d, k, c. These are **assumed**: a drive that follows its command within 0.08 s; a
    force that is built up within one revolution at 3000 rpm (c = 50 1/s); k/c = 0.4 N/(mm/min) for each mm of depth,
    the force of a two-flute 10 mm end mill in tool steel at about 4800 N/mm2 in a slot. So the paper's 150, 200 and
    320 N at 1, 2 and 4 mm are cut at 375, 250 and 200 mm/min, or 0.033 to 0.063 mm a tooth.

    Attributes
    ----------
    depth : float or sequence of (float, float)
        mm; or (time in s, depth from then on), the first at 0.
    m, d, c : float
        s, 1 and 1/s.
    k_per_depth : float
        N/s per mm/min, for each mm: k grows with the depth and c does not (assumed; the paper lets c depend on depth
        and spindle speed without a relation).
    ripple, tooth_frequency : float
        Ripple of the teeth in a reading, as a share of the force, and its frequency, Hz. Only readings have it:
        (2.2) is of the mean force.
    noise : float
        Standard deviation of the sensor, N.
    share : float
        Of the pitch of the teeth in which a reading has a force, a half sine of the same mean; 1: not interrupted.
    force, speed, k : float
        F of (2.2), N; v, mm/min; and the k now in force. Each can be recorded.

    Examples
    --------
    >>> plant = DriveAndCut(depth=2.0)
    >>> noise = np.random.default_rng(1)
    >>> readings = [plant.step(250.0, 0.01, noise) for _ in range(100)]
    >>> round(readings[0], 2), round(readings[-1], 2)
    (5.1, 200.0)
    """

    depth: Depth = 2.0
    m: float = 0.08
    d: float = 1.0
    c: float = 50.0
    k_per_depth: float = 20.0
    ripple: float = 0.0
    tooth_frequency: float = 100.0
    noise: float = 0.0
    share: float = 1.0
    force: float = field(default=0.0, init=False)
    speed: float = field(default=0.0, init=False)
    k: float = field(default=0.0, init=False)
    _time: float = field(default=0.0, init=False)
    _steps: int = field(default=0, init=False)
    _changes: list[tuple[float, float]] = field(init=False)
    _held: tuple[float, ...] = field(default=(), init=False)
    _dt: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        for name in ("m", "d", "c", "k_per_depth", "tooth_frequency"):
            if not (math.isfinite(value := getattr(self, name)) and value > 0):
                raise UsageError(f"{name} {value!r} of a drive and cut: a finite number above zero.")
        self._changes = changes(self.depth)
        self.k = self.k_per_depth * self._changes[0][1]

    @classmethod
    def from_parameters(
        cls, pf: "ParameterFile", depth: Depth, *, ripple: float = 0.0, noise: float = 0.0, share: float = 1.0
    ) -> Self:
        """The plant of the file's estimates; assumed: d is 1, the drive is the slower pole, k goes with the depth.

        Raises
        ------
        GateError
            The file has no estimates, or they give complex or unstable poles.
        """
        from .settings import machine, tooth_frequency

        m, c, k = machine(pf)
        rest = {"ripple": ripple, "tooth_frequency": tooth_frequency(pf), "noise": noise, "share": share}
        return cls(depth, m=m, c=c, k_per_depth=k, **rest)

    def depth_at(self, time: float) -> float:
        """Depth of cut at a time, mm."""
        return next(depth for start, depth in reversed(self._changes) if start <= time + 1e-9)

    def step(self, command: float, dt: float, noise: np.random.Generator) -> float:
        """Measured force after ``dt`` s under a constant command."""
        self.k = self.k_per_depth * self.depth_at(self._time)
        self.move(max(command, 0.0), dt)
        self._steps += 1
        self._time = self._steps * dt
        return self._read(noise)

    def move(self, command: float, dt: float) -> None:
        """Advance (2.1) and (2.2) by ``dt``; the command may be negative."""
        if dt != self._dt:
            self._held, self._dt = _held(self.m, self.d, self.c, dt), dt
        slow, lag, by_end, by_start = self._held
        end = command / self.d
        self.force = self.force * lag + self.k * (end * by_end + (self.speed - end) * by_start)
        self.speed = end + (self.speed - end) * slow

    def _read(self, noise: np.random.Generator) -> float:
        reading = self.force
        if self.ripple:
            reading *= 1 + self.ripple * math.sin(2 * math.pi * self.tooth_frequency * self._time)
        if self.share < 1:
            angle = self.tooth_frequency * self._time % 1.0 / self.share
            reading *= math.pi / 2 / self.share * math.sin(math.pi * angle) if angle < 1 else 0.0
        return reading + self.noise * noise.standard_normal() if self.noise else reading


def changes(depth: Depth) -> list[tuple[float, float]]:
    """Depths with the times they begin at; refused where they are not in order from 0, or not above zero.

    >>> changes([(0.0, 1.0), (5.0, 2.0)])
    [(0.0, 1.0), (5.0, 2.0)]
    """
    found = [(0.0, float(depth))] if isinstance(depth, int | float) else [(float(t), float(a)) for t, a in depth]
    times = [time for time, _ in found]
    if times[:1] != [0.0] or times != sorted(set(times)) or not all(0 < a < math.inf for _, a in found):
        raise UsageError(f"depths {depth!r}: give depths above zero, in the order of their times, the first at 0 s.")
    return found


def _held(m: float, d: float, c: float, dt: float) -> tuple[float, float, float, float]:
    """Transition over dt: exp(-d/m dt), exp(-c dt), and the contributions of steady and decaying speed to F / k."""
    p = d / m
    slow, lag = math.exp(-p * dt), math.exp(-c * dt)
    fading = dt * lag if abs(c - p) < APART * c else (slow - lag) / (c - p)
    return slow, lag, (1 - lag) / c, fading
