"""Simulated cuts with or without control, their steady-state metrics, and the eight simulations of Table 1."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ...core.arrays import Array
from ...core.display import Plottable
from ...core.errors import UsageError
from ...parameters.exports.loop import STUCK_AFTER
from ...parameters.published.roughness import FEED, TableRow, surf, table1
from ..loop import Trace, replay
from .controller import ConstantRoughness
from .plant import DISTURBANCE, TurningForce
from .reference import law_of, settings_of

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from .reference import Reading


DURATION = 15.0  # s, SURF
SETTLED = 3.0  # s after the start or a change: the law acts after 0.3 s, and its loop settles in 8 tc = 0.8 s


@dataclass(slots=True)
class _Constant:
    """Constant feed, with the reference of the control."""

    control: ConstantRoughness
    command: float
    labels: tuple[str, str]

    @property
    def reference(self) -> float:
        return self.control.reference

    def step(self, measurement: float, dt: float) -> float:
        self.control.step(measurement, dt)
        return self.command


@dataclass(frozen=True, slots=True, repr=False)
class TurningRun(Plottable):
    """A simulated cut.

    Attributes
    ----------
    trace : Trace
        Command the feed command; recorded ``feed``, the servo's output, and ``force``.
    Ra, required : ndarray, shape (n,)
        Roughness by the file's law at each sample's force, and the required roughness, um.
    low, high : float
        Limits of the feed command.
    """

    trace: Trace
    Ra: Array
    required: Array
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class SteadyCut:
    """Metrics of a segment of a cut: roughness in um, force in N, feed in mm/rev.

    Attributes
    ----------
    Ra, Ra_sd : float
        Mean and standard deviation over samples.
    error : float
        Mean of |Ra - required| over samples.
    F, f : float
        Mean force, and mean feed at the servo's output.
    ripple, command_ripple : float
        Peak-to-peak feed at the servo's output, and of the command.
    at_low, at_high : float
        Shares of the samples in which the command rests on a limit.
    """

    Ra: float
    Ra_sd: float
    error: float
    F: float
    f: float
    ripple: float
    command_ripple: float
    at_low: float
    at_high: float


def turn(
    pf: "ParameterFile",
    *,
    control: bool = True,
    feed: Literal["servo", "command"] = "servo",
    constant_feed: float | None = None,
    schedule: Sequence[tuple[float, float]] = (),
    duration: float = DURATION,
    seed: int = 1,
    disturbance: float = DISTURBANCE,
    hold: float | None = None,
    engaged: Callable[[float], float] = lambda t: 1.0,
) -> TurningRun:
    """Simulate a cut of the file: the plant is a reconstruction, see `TurningForce`.

    Parameters
    ----------
    pf : ParameterFile
    control : bool
        False: constant feed.
    feed : {"servo", "command"}
        What f(t-1) of the law is.
    constant_feed : float, optional
        mm/rev without control; by default the programmed one.
    schedule : sequence of (float, float)
        s, and the required roughness from then on.
    duration, seed
        s, and of the disturbance.
    disturbance, hold, engaged
        Of the plant; ``hold`` is by default one revolution; 0 draws anew every 10 ms.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> cut = turn(published("SURF"), duration=6.0, disturbance=0.0)
    >>> round(steady(cut).Ra, 3), round(steady(cut).f, 3)
    (1.6, 0.201)
    """
    section, law = settings_of(pf), law_of(pf)
    noisy = STUCK_AFTER if disturbance else 0.0  # a force without disturbance repeats to the last bit
    made = ConstantRoughness.from_parameters(pf, schedule=schedule, feed=feed, stuck_after=noisy).approached()
    start = made.command if constant_feed is None or control else constant_feed
    more: dict[str, Any] = {} if hold is None else {"hold": hold}
    plant = TurningForce.from_parameters(pf, disturbance=disturbance, engaged=engaged, feed=start, **more)
    controller = made if control else _Constant(made, start, made.labels)
    trace = replay(controller, plant, duration=duration, dt=made.sample_time, seed=seed, record=("feed", "force"))
    required = np.full(len(trace.time), section.roughness)
    for time, Ra in schedule:
        required[trace.time > time - 1e-9] = Ra
    given: dict[str, Any] = {law.factors[0].symbol: trace.recorded["force"]}
    return TurningRun(trace, np.asarray(law.values(**given)), required, made.low, made.high)


def steady(cut: TurningRun, start: float = SETTLED, end: float = np.inf) -> SteadyCut:
    """Metrics of the segment from ``start`` to ``end``, s.

    Raises
    ------
    UsageError
        No sample lies in the segment.
    """
    time, command = cut.trace.time, cut.trace.command
    part = (time >= start - 1e-9) & (time < end - 1e-9)
    if not part.any():
        raise UsageError(f"a steady cut from {start:g} to {end:g} s: the run of {time[-1]:g} s has no sample in it.")
    Ra, feed, u = cut.Ra[part], cut.trace.recorded["feed"][part], command[part]
    return SteadyCut(
        Ra=float(Ra.mean()),
        Ra_sd=float(Ra.std()),
        error=float(np.abs(Ra - cut.required[part]).mean()),
        F=float(cut.trace.recorded["force"][part].mean()),
        f=float(feed.mean()),
        ripple=float(np.ptp(feed)),
        command_ripple=float(np.ptp(u)),
        at_low=float((u <= cut.low).mean()),
        at_high=float((u >= cut.high).mean()),
    )


@dataclass(frozen=True, slots=True)
class TableSimulation:
    """A row of Table 1 as printed, the reference force of its file, and the steady state of both simulated cuts.

    Without control the feed is the one that the table prints; with control the programmed one, from which the override
    goes to 150 %.
    """

    row: TableRow
    force: float
    controlled: SteadyCut
    without: SteadyCut

    @property
    def error(self) -> float:
        """Mean roughness with control, relative to the required one."""
        return self.controlled.Ra / self.row.Ra_ref - 1

    @property
    def error_without(self) -> float:
        """Mean roughness without control, relative to the required one."""
        return self.without.Ra / self.row.Ra_ref - 1


def simulated_table(
    force_from: "Reading" = "inverse",
    *,
    feed: float | None = FEED,
    seed: int = 1,
    **more: Any,  # noqa: ANN401
) -> tuple[TableSimulation, ...]:
    """Simulate all eight rows.

    Parameters
    ----------
    force_from : {"inverse", "regression"}
        Reading of the reference force, each with its law; see `fitmodels.parameters.published.roughness.surf`.
    feed : float or None
        Programmed feed, mm/rev; None takes each row's feed without control, the one recommended for it.
    seed, **more
        As of `turn`.

    Examples
    --------
    >>> found = simulated_table(duration=6.0)
    >>> max(abs(run.error) for run in found) < 0.03
    True
    """
    found = []
    for row in table1():
        pf = surf(row.number, force_from=force_from, feed=row.f_without if feed is None else feed)
        without = turn(pf, control=False, constant_feed=row.f_without, seed=seed, **more)
        controlled = steady(turn(pf, seed=seed, **more))
        section = pf.roughness
        found.append(TableSimulation(row, np.nan if section is None else section.force, controlled, steady(without)))
    return tuple(found)
