"""Plant of SURF, feed command -> servo -> force with random disturbance, and the linear theory of its loop.

F(s)/fc(s) = kc a / ((tc s + 1)(ts s + 1))        reconstructed: the equation is missing in the copy used

The feed law linearized in the logarithms of feed and force, with small letters for relative deviations, servo
`f' ts + f = c`, process `x' tc + x = f`, and the law

    servo reading      c = f - (x + e)     f = -e (tc s + 1) / (tc ts s^2 + ts s + 1)     stable for every tc and ts
    command reading    c' = -(x + e) / T   stable only while 1/T < 1/tc + 1/ts

so that f(t-1) must be the servo's output: at T = 10 ms the other reading is an integrator of gain 100/s against a limit
of 17.9/s. Derived here; the paper prints no analysis.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ...core.display import Displayable
from ...core.errors import ParameterError, UsageError
from .reference import settings_of

if TYPE_CHECKING:
    from ...parameters import ParameterFile

DISTURBANCE = 0.1  # SURF: the force undergoes random changes up to 10 %


@dataclass(slots=True, repr=False)
class TurningForce(Displayable):
    """Servo and cutting process, two lags in a row, exact for a command held over each step (zero-order hold).

    The force is multiplied by 1 + e, with e uniform from -``disturbance`` to +``disturbance`` and held for ``hold``.
    The paper states random changes of the force by up to 10 %, without distribution or time: a reconstruction. Held for
    a revolution, as where each revolution meets new stock, the disturbance lies in the band of the loop and is harder
    than one drawn at every sample. It is a change of the force itself, so it affects the surface.

    Attributes
    ----------
    gain : float
        kc a, N per mm/rev.
    tc, ts : float
        Time constants of process and servo, s.
    disturbance, hold : float
        Share of the force, and s between two draws; 0 draws at every sample.
    engaged : callable
        Time in s -> share of the depth in the work: 0 tool out of it, 1 in it, 10 ten times as stiff.
    feed : float
        The servo's output, mm/rev.
    force : float
        With its disturbance, N.

    Examples
    --------
    >>> plant = TurningForce(gain=2781.0, tc=0.1, ts=0.13, disturbance=0.0)
    >>> noise = np.random.default_rng(1)
    >>> [round(plant.step(0.2, 0.1, noise)) for _ in range(3)]
    [121, 290, 409]
    """

    gain: float
    tc: float
    ts: float
    disturbance: float = DISTURBANCE
    hold: float = 0.0
    engaged: Callable[[float], float] = field(default=lambda t: 1.0)
    feed: float = 0.0
    force: float = field(default=0.0, init=False)
    _clean: float = field(default=0.0, init=False)
    _drawn: int = field(default=-1, init=False)
    _factor: float = field(default=1.0, init=False)
    _samples: int = field(default=0, init=False)
    _dt: float = field(default=0.0, init=False)
    _decays: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0), init=False)

    @classmethod
    def from_parameters(cls, pf: "ParameterFile", **more: Any) -> Self:  # noqa: ANN401
        """The cut of a file, entered at the programmed feed; the disturbance is by default held for one revolution.

        Parameters
        ----------
        pf : ParameterFile
            Its roughness section with force_per_feed, process_time, servo_time and feed.
        **more
            Any other attribute.

        Raises
        ------
        ParameterError
            The file lacks one of them.
        """
        section = settings_of(pf)
        needed = section.force_per_feed, section.process_time, section.servo_time, section.feed
        if None in needed:
            names = ("force_per_feed", "process_time", "servo_time", "feed")
            lacking = [name for name, value in zip(names, needed, strict=True) if value is None]
            raise ParameterError(f"The roughness section lacks {', '.join(lacking)}: add it for a simulated cut.")
        own: dict[str, Any] = dict(zip(("gain", "tc", "ts", "feed"), needed, strict=True))
        return cls(**{**own, "hold": own["tc"], **more})

    def step(self, command: float, dt: float, noise: np.random.Generator) -> float:
        """Force, N, after ``dt`` s of a commanded feed."""
        if dt != self._dt:
            self._dt, self._decays = dt, decays(self.tc, self.ts, dt)
        of_process, of_servo, between = self._decays
        t = self._samples * dt
        self._samples += 1
        stiff = self.gain * self.engaged(t)
        lag = self.feed - command
        self._clean = of_process * self._clean + stiff * (command * (1 - of_process) + lag * between)
        self.feed = command + lag * of_servo
        if self.disturbance:
            self._draw(t, noise)
        self.force = self._clean * self._factor
        return self.force

    def _draw(self, t: float, noise: np.random.Generator) -> None:
        turn = int(t / self.hold + 1e-9) if self.hold else self._samples
        if turn != self._drawn:
            self._drawn, self._factor = turn, 1 + noise.uniform(-self.disturbance, self.disturbance)


def decays(tc: float, ts: float, dt: float) -> tuple[float, float, float]:
    """Decay factors over a step: of the process, of the servo, and of a servo lag in the force (a share of kc a).

    Examples
    --------
    >>> [round(share, 4) for share in decays(0.1, 0.13, 0.01)]
    [0.9048, 0.926, 0.0915]
    """
    of_process, of_servo = (math.exp(-dt / lag) if lag else 0.0 for lag in (tc, ts))
    if abs(ts - tc) > 1e-7 * (ts + tc):
        return of_process, of_servo, ts * (of_servo - of_process) / (ts - tc)
    return of_process, of_servo, dt / ts * of_servo if ts else 0.0


@dataclass(frozen=True, slots=True)
class LoopTheory:
    """Characteristics of the linear loop.

    Attributes
    ----------
    natural_frequency : float
        rad/s, 1/sqrt(tc ts), with the servo reading.
    damping : float
        sqrt(ts/tc)/2.
    crossover : float
        Hz: slower force changes are attenuated, faster ones amplified.
    enlarged : float
        Largest amplification of a force change.
    gain, limit : float
        1/s: of the integrator of the command reading, and the stability limit of the continuous loop.
    servo_radius, command_radius : float
        Largest pole of the sampled loop in either reading; below 1 is stable.
    """

    natural_frequency: float
    damping: float
    crossover: float
    enlarged: float
    gain: float
    limit: float
    servo_radius: float
    command_radius: float


def loop_theory(tc: float, ts: float, dt: float) -> LoopTheory:
    """Linear theory of the loop with a process lag ``tc``, a servo lag ``ts`` and a sample every ``dt`` s.

    Raises
    ------
    UsageError
        One of them is not above zero.

    Examples
    --------
    >>> figures = loop_theory(60 / 610, 0.13, 0.01)
    >>> round(figures.gain), round(figures.limit, 1), round(figures.servo_radius, 2), round(figures.command_radius, 2)
    (100, 17.9, 0.95, 1.04)
    """
    if not min(tc, ts, dt) > 0:
        raise UsageError(f"lags of {tc:g} and {ts:g} s sampled every {dt:g} s: give all above zero.")
    both = tc * ts
    return LoopTheory(
        natural_frequency=both**-0.5,
        damping=math.sqrt(ts / tc) / 2,
        crossover=1 / (2 * math.pi * math.sqrt(2 * both)),
        enlarged=_enlarged(tc, ts),
        gain=1 / dt,
        limit=1 / tc + 1 / ts,
        servo_radius=_radius(tc, ts, dt, integrator=False),
        command_radius=_radius(tc, ts, dt, integrator=True),
    )


def _enlarged(tc: float, ts: float) -> float:
    """Peak of |F/e| = |1 - 1/(tc ts s^2 + ts s + 1)| over frequency."""
    s = 1j * np.geomspace(0.01, 100, 4001) / math.sqrt(tc * ts)
    return float(np.abs(1 - 1 / (tc * ts * s**2 + ts * s + 1)).max())


def _radius(tc: float, ts: float, dt: float, *, integrator: bool) -> float:
    """Spectral radius over (f, x, c): the command that answers a sample, then a step of servo and process."""
    of_process, of_servo, between = decays(tc, ts, dt)
    answer = np.array([[1.0, 0, 0], [0, 1, 0], [0, -1, 1] if integrator else [1, -1, 0]])
    held = np.array([[of_servo, 0, 1 - of_servo], [between, of_process, 1 - of_process - between], [0, 0, 1]])
    return float(np.abs(np.linalg.eigvals(held @ answer)).max())
