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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from ...core.display import Displayable
from ...core.errors import IdentError, ParameterError, UsageError
from ...core.verdict import DO_NOT_USE
from .reference import settings_of

if TYPE_CHECKING:
    from ...datasets import Record
    from ...ident.physical_models.force_process import ForceProcess
    from ...ident.physical_models.step_response import StepFit
    from ...parameters import ParameterFile

FORCES = ("N", "kN")
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


@dataclass(frozen=True, slots=True)
class Cut:
    """The user's statements on the cut, in um, mm/rev, 1/min, mm, N and s; None is derived or assumed.

    Attributes
    ----------
    roughness, spindle_speed : float
        Required roughness, um, and 1/min.
    feed, depth, nose_radius, chip_thickness : float or None
        Programmed feed, mm/rev; depth and nose radius, mm; largest chip thickness, mm.
    threshold, wait : float or None
        N, and s above it.
    override, valid : (float, float) or None
        Shares of the programmed feed; smallest and largest valid reading, N.
    sample_time, servo_time, process_time : float or None
        s.
    kc, force_per_feed : float or None
        Specific cutting force, N/mm2; or kc a, N per mm/rev.
    conditions : mapping
        Other factors of the force law, in its units; a level of its category as text.
    """

    roughness: float
    spindle_speed: float
    feed: float | None = None
    depth: float | None = None
    nose_radius: float | None = None
    chip_thickness: float | None = None
    threshold: float | None = None
    wait: float | None = None
    override: tuple[float, float] | None = None
    valid: tuple[float, float] | None = None
    sample_time: float | None = None
    servo_time: float | None = None
    process_time: float | None = None
    kc: float | None = None
    force_per_feed: float | None = None
    conditions: Mapping[str, float | str] = field(default_factory=dict)

    @property
    def revolution(self) -> float:
        """S."""
        return 60.0 / self.spindle_speed


@dataclass(frozen=True, slots=True)
class Measured:
    """Values from step records, None where no record has them, each with its source.

    Attributes
    ----------
    servo_time, process_time : float or None
        s.
    force_per_feed : float or None
        N per mm/rev.
    sources : dict of str
        By the fields of the section.
    """

    servo_time: float | None = None
    process_time: float | None = None
    force_per_feed: float | None = None
    sources: dict[str, str] = field(default_factory=dict)


class _Response(NamedTuple):
    """Lags of a response, the slower first, its delay and time to 63.2 %, s; its gain, and its fit in words."""

    lags: tuple[float, ...]
    delay: float
    time_to_63: float
    gain: float
    words: str


def measured_from(records: "Sequence[Record]", cut: Cut) -> Measured:
    """Time constants of servo and process, and kc a, from recorded runs of the feed command.

    A record whose output is a force shows servo and process in a row, two lags: of steps with their delay, of any other
    command by the force process of LYAP. Any other output shows the servo alone, whose time constant is the time to
    63.2 % of a step, delay included.

    Raises
    ------
    UsageError
        Two records of one kind, a response that falls when the feed rises, one that oscillates, or a poor fit.
    """
    found, kinds = Measured(), set()
    for rec in sorted(
        records, key=lambda one: one.unit_y in FORCES
    ):  # the servo first: its lag identifies that of the cut
        of_force = rec.unit_y in FORCES
        if of_force in kinds:
            raise UsageError(f"two records of the {'force' if of_force else 'servo'}: give one of each.")
        kinds.add(of_force)
        seen = _response(rec, of_force=of_force)
        if of_force:
            found = _of_force(found, seen, rec, cut)
        else:
            words = f"time to 63.2 % of the step, delay {seen.delay:.3g} s included; {seen.words}"
            found = replace(found, servo_time=seen.time_to_63, sources={"servo_time": words})
    return found


def _response(rec: "Record", *, of_force: bool) -> _Response:
    """The response of a record, refused where it falls, oscillates or is not explained."""
    from ...ident.physical_models.force_process import force_process_fit
    from ...ident.physical_models.step_response import step_response_fit

    fit: StepFit | ForceProcess
    name = f"record {rec.source or rec.output}"
    try:
        fit = step_response_fit(rec, 2 if of_force else 1)
        gain, delay, time, lags = fit.gain, fit.delay, fit.time_to_63, fit.time_constants
    except IdentError:  # no steps
        if not of_force:
            raise
        fit = force_process_fit(rec.centred(), proportional=False)
        gain, delay, time = 1 / float(fit.ratios[2]), 0.0, math.nan
        lags = () if np.abs(fit.poles.imag).max() > 0 else tuple(-1 / fit.poles.real)
    if not gain > 0:
        raise UsageError(
            f"{name}: the {rec.output} falls as the {rec.input} rises (gain {gain:.4g}); check the sign of the sensor, "
            "and which column is the command (--input, --output)."
        )
    if not lags or not min(lags) > 0:
        raise UsageError(f"{name}: the {rec.output} oscillates or is not stable, which no two lags explain.")
    if fit.verdict.level == DO_NOT_USE:
        raise UsageError(f"{name}: {' '.join(fit.verdict.reasons)}")
    words = " ".join([f"{name}, fit {fit.fit:.1f} %", *fit.verdict.reasons])
    return _Response(tuple(map(float, lags)), delay, time, gain, words)


def _of_force(found: Measured, seen: _Response, rec: "Record", cut: Cut) -> Measured:
    """Process time and kc a of a record of force, and the servo where nothing else states it."""
    known = cut.servo_time if cut.servo_time is not None else found.servo_time
    near = cut.revolution if known is None else known
    first, second = sorted(seen.lags, key=lambda lag: abs(math.log(lag / near)))
    servo, process = (second, first) if known is None else (first, second)
    chosen = "the one nearer one revolution" if known is None else "the one farther from that of the servo"
    both = f"{chosen} of the lags {seen.lags[0]:.3g} and {seen.lags[1]:.3g} s, delay {seen.delay:.3g} s included"
    sources = {**found.sources, "process_time": f"{both}; {seen.words}"}
    if known is None:
        sources["servo_time"] = f"the lag farther from one revolution; {seen.words}"
    if (gain := _per_revolution(seen.gain, rec, cut)) is not None:
        sources["force_per_feed"] = f"gain of the {seen.words}"
    return Measured(servo if known is None else found.servo_time, process + seen.delay, gain, sources)


def _per_revolution(gain: float, rec: "Record", cut: Cut) -> float | None:
    """Gain of a record of force, N per mm/rev; None where its command is no feed."""
    from ...datasets.units import convert, same_dimension

    newton = gain * float(convert(np.array([1.0]), rec.unit_y, "N")[0])
    if rec.unit_u == "mm/rev":
        return newton
    if rec.unit_u and same_dimension(rec.unit_u, "mm/min"):
        return newton * cut.spindle_speed / float(convert(np.array([1.0]), rec.unit_u, "mm/min")[0])
    return None
