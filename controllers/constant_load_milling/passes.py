"""The passes of a replay: what each drew, cut and wore once the loop had settled."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.display import Displayable
from ..loop import Array, Trace

SETTLE = 4.0  # s, the settling time that the paper asks for
RECORDED = ("feed", "wear", "length", "in_cut", "number", "kind")  # what a replay records for this


@dataclass(frozen=True, slots=True, repr=False)
class Pass(Displayable):
    """One pass; loads and feeds are those after the loop has settled, None where it was too short for that.

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
        Whether the tool came out of the cut.
    limited : bool
        Whether the command rested on the lower limit in it, if only for a sample.
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
        s of each pass that do not count.
    """
    cut = np.flatnonzero(trace.recorded["in_cut"] > 0)
    if not cut.size:
        return ()
    starts = np.flatnonzero(np.diff(trace.recorded["number"][cut])) + 1
    return tuple(_pass(trace, rows, rest, settle) for rows in np.split(cut, starts))


def _pass(
    trace: Trace, rows: "np.ndarray[tuple[int], np.dtype[np.intp]]", rest: Sequence[float], settle: float
) -> Pass:
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
        limited=bool((trace.command[rows] <= rest[kind]).any()),
    )  # fmt: skip


def _mean(values: Array) -> float | None:
    return float(values.mean()) if values.size else None
