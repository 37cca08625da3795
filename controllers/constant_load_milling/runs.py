"""Simulated tool runs from the first pass to the tool change, at constant load and at constant feed."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array, Ints
from ...core.display import Displayable, Plottable
from ...core.errors import UsageError
from ...parameters.messages import in_unit
from ..loop import Trace, replay
from .control_laws import line_of
from .controller import ConstantLoad
from .cut_model import CutModel
from .plant import GAP, PASS, MillingCut

if TYPE_CHECKING:
    from ...parameters import ParameterFile

SETTLE = 4.0  # s, the settling time that the paper requires
RECORDED = ("feed", "wear", "length", "in_cut", "number", "kind")  # recorded by a replay for this


@dataclass(frozen=True, slots=True, repr=False)
class Pass(Displayable):
    """One pass; loads and feeds are means after settling, None where the pass was too short.

    Attributes
    ----------
    number, kind : int
        From 1; and which cut.
    start, length : float
        mm of cutting length.
    time : float
        s in the cut.
    mean_load, spread : float or None
        Mean, and largest less smallest, in the unit of the load.
    mean_feed : float or None
    wear : float
        At its end.
    whole : bool
        Whether the pass was completed.
    limited : bool
        Whether the command was on the lower limit after settling, if only for a sample.
    """

    number: int
    kind: int
    start: float
    length: float
    time: float
    mean_load: float | None
    spread: float | None
    mean_feed: float | None
    wear: float
    whole: bool
    limited: bool


def passes_of(trace: Trace, rest: Sequence[float], settle: float = SETTLE) -> tuple[Pass, ...]:
    """Passes of a trace that recorded `RECORDED`.

    Parameters
    ----------
    trace : Trace
    rest : sequence of float
        Override at or below which the command rests on the lower limit, for each kind of cut.
    settle : float
        s at the start of each pass that are excluded.
    """
    cut = np.flatnonzero(trace.recorded["in_cut"] > 0)
    if not cut.size:
        return ()
    starts = np.flatnonzero(np.diff(trace.recorded["number"][cut])) + 1
    return tuple(_pass(trace, rows, rest, settle) for rows in np.split(cut, starts))


def _pass(trace: Trace, rows: Ints, rest: Sequence[float], settle: float) -> Pass:
    r, dt = trace.recorded, float(trace.time[1]) if len(trace.time) > 1 else 0.0
    kind = int(r["kind"][rows[0]])
    held = rows[trace.time[rows] - trace.time[rows[0]] >= settle]
    load, feed = trace.measurement[held], r["feed"][held]
    start = float(r["length"][rows[0] - 1]) if rows[0] else 0.0
    last = int(rows[-1])
    return Pass(
        number=int(r["number"][rows[0]]), kind=kind, start=start,
        length=float(r["length"][last]) - start, time=len(rows) * dt,
        mean_load=_mean(load), spread=float(np.ptp(load)) if load.size else None, mean_feed=_mean(feed),
        wear=float(r["wear"][last]), whole=last + 1 < len(trace.time),
        limited=bool((trace.command[held] <= rest[kind]).any()),
    )  # fmt: skip


def _mean(values: Array) -> float | None:
    return float(values.mean()) if values.size else None


CHANGE = "change tool"
LONGEST = 4 * 3600.0  # s of machine time
BEYOND = 2.0  # times the end of the tool-change window: a loop without a change by then never gives one


@dataclass(frozen=True, slots=True, repr=False)
class ToolRun(Plottable):
    """Simulated run of one tool.

    Attributes
    ----------
    trace : Trace
        With feed, wear, length, in_cut, number and kind recorded.
    passes : tuple of Pass
    reference : float
    worn : bool
        Whether the run ended with a tool change.
    wear, length, time : float
        At its end: wear, mm of cutting length, s in the cut.
    removed : float or None
        mm3.
    rested : float
        s in the cut on the lower limit.
    """

    trace: Trace
    passes: tuple[Pass, ...]
    reference: float
    worn: bool
    wear: float
    length: float
    time: float
    removed: float | None
    rested: float

    @property
    def mean_feed(self) -> float:
        """Cutting length over time in the cut, mm/min."""
        return 60.0 * self.length / self.time

    @property
    def rate(self) -> float | None:
        """Material removal rate over the time in the cut, mm3/s."""
        return None if self.removed is None else self.removed / self.time

    @property
    def regulated(self) -> tuple[Pass, ...]:
        """Completed, long enough passes before the one in which the command first reached the lower limit."""
        first = next((p.number for p in self.passes if p.limited), np.inf)
        return tuple(p for p in self.passes if p.whole and p.number < first and p.mean_load is not None)

    @property
    def worst_mean(self) -> float | None:
        """Largest share by which the mean load of a regulated pass deviates from the reference; None without one."""
        off = [p.mean_load / self.reference - 1 for p in self.regulated if p.mean_load is not None]
        return max(off, key=abs) if off else None


def constant_load_run(
    pf: "ParameterFile",
    *,
    plant: MillingCut | None = None,
    pass_length: float = PASS,
    gap: float = GAP,
    seed: int = 1,
    settle: float = SETTLE,
) -> ToolRun:
    """Replay a sharp tool at constant load until the command has been on the lower limit for the dwell.

    Parameters
    ----------
    pf : ParameterFile
        Controller and plant are made from it alone.
    plant : MillingCut, optional
        By default the file's; another one simulates a mismatch.
    pass_length, gap : float
        mm of a pass, s out of the cut between two.
    seed : int
        Of the sensor's noise, where there is any.
    settle : float
        s at the start of each pass that are excluded from its means.

    Raises
    ------
    GateError, ParameterError
        The file cannot drive it; see `ConstantLoad.from_parameters` and `CutModel.from_parameters`.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> run = constant_load_run(published("CLM-2023"))
    >>> run.worn, len(run.passes), f"{run.wear:.0f} um, {run.length:.0f} mm"
    (True, 14, '205 um, 2094 mm')
    """
    controller = ConstantLoad.from_parameters(pf, running=True)
    mill = MillingCut.from_parameters(pf, pass_length=pass_length, gap=gap) if plant is None else plant
    cut, loop = mill.cuts[0], controller.loop
    duration = longest(cut, BEYOND * line_of(pf).window[1], loop.feed_low, gap, pass_length)
    trace = replay(
        controller, mill, duration=duration, dt=loop.sample_time, seed=seed, record=RECORDED, until=CHANGE
    )  # fmt: skip
    return run_of(trace, loop.reference, (controller.rest,), (cut.area,), settle)


def constant_feed_run(
    pf: "ParameterFile", feed: float | None = None, wear: float | None = None, *, plant: MillingCut | None = None
) -> ToolRun:
    """Replay a sharp tool at one feed until its wear reaches the criterion.

    Parameters
    ----------
    pf : ParameterFile
    feed : float, optional
        In the unit of the feed limits; by default that of the wear tests, or else the lower feed limit.
    wear : float, optional
        By default the file's criterion, or else the wear of the lower limit.
    plant : MillingCut, optional

    Raises
    ------
    UsageError
        A feed or wear that is not above zero.
    ParameterError
        The file has no cut to simulate.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> run = constant_feed_run(published("CLM-2023"))
    >>> f"{run.mean_feed:.0f} mm/min, {run.length:.0f} mm, {run.rate:.2f} mm3/s"
    '700 mm/min, 1800 mm, 3.27 mm3/s'
    """
    mill = MillingCut.from_parameters(pf) if plant is None else plant
    cut, line = mill.cuts[0], line_of(pf)
    at = feed if feed is not None else cut.tested_feed or line.lower.value
    until = wear if wear is not None else criterion(pf)
    if not (at > 0 and until > 0):
        raise UsageError(f"a feed of {at:g} to a wear of {until:g}: give both above zero.")
    fixed = FixedFeed(at / mill.programmed, mill, until, line.reference)
    trace = replay(
        fixed, mill, duration=longest(cut, 1.1 * until, at, mill.gap, mill.passes[0][1]), dt=cut.sample_time,
        record=RECORDED, until=CHANGE,
    )  # fmt: skip
    return run_of(trace, line.reference, (-1.0,), (cut.area,), SETTLE)


def criterion(pf: "ParameterFile") -> float:
    """Wear at which a tool is worn out at constant feed: the file's criterion, or the wear of the lower limit."""
    line, life = line_of(pf), pf.tool_life
    found = None if life is None else in_unit(life.criterion, life.unit_of_wear, line.unit_wear)
    return line.lower.wear if found is None else found


@dataclass(slots=True)
class FixedFeed:
    """Controller with one override until the tool is worn: a program without control."""

    command: float
    mill: MillingCut
    wear: float
    reference: float
    news: tuple[str, ...] = field(default=(), init=False)

    def step(self, measurement: float, dt: float) -> float:
        """The constant override."""
        if self.mill.wear >= self.wear * (1 - 1e-12):
            self.news = (CHANGE,)
        return self.command


def run_of(
    trace: Trace, reference: float, rest: Sequence[float], areas: Sequence[float | None], settle: float
) -> ToolRun:
    """The run of a trace; ``rest`` and ``areas``: lower-limit override and cross-section, mm2, of each kind of cut."""
    found = passes_of(trace, rest, settle)
    dt = float(trace.time[1]) if len(trace.time) > 1 else 0.0
    removed = [p.length * area for p in found if (area := areas[p.kind]) is not None]
    on_limit = trace.command <= np.asarray(rest)[trace.recorded["kind"].astype(int)]
    return ToolRun(
        trace=trace, passes=found, reference=reference, worn=trace.first(CHANGE) is not None,
        wear=float(trace.recorded["wear"][-1]), length=float(trace.recorded["length"][-1]),
        time=sum(p.time for p in found), removed=sum(removed) if len(removed) == len(found) else None,
        rested=float((on_limit & (trace.recorded["in_cut"] > 0)).sum() * dt),
    )  # fmt: skip


def longest(cut: CutModel, wear: float, feed: float, gap: float, length: float) -> float:
    """Time in s until a wear is reached at a feed, with the time out of the cut."""
    in_cut = (wear / (cut.c0 * feed**cut.m)) ** (1 / cut.n)
    speed = feed * 4 / 60  # higher feeds shorten the passes: upper bound of the span of limits
    return float(min(in_cut * (1 + gap * speed / length) + 60.0, LONGEST))
