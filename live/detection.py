"""Whether the laws still hold: chipping of an edge, another tool, another batch of work material.

Chipping and another tool show in the innovations of the estimate, the deviations of loads from what was expected: a
CUSUM of them, weighted by how much each load grows with wear, with their scatter learned as they come. A batch shows
over edges only, because within one edge a load that is higher throughout cannot be distinguished from wear: a CUSUM of
the deviations of finished edges from the laws.

In simulation (benchmarks/live_detection.py), with two loads wear that is 1.5 times as great at once is found within
3 min in 99 % of edges, after 40 s (median), with .02 false alarms an hour; with power alone in 70 to 80 %. A batch with
loads 8 % higher or lower is found after 5 edges (median), with .01 false alarms an edge.

Source: Page 1954, Biometrika 41, 100; Hawkins 1987, J. R. Stat. Soc. D 36, 299 (baseline learned as the edges come).
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, sqrt
from statistics import median
from typing import TYPE_CHECKING, Any, Literal

from ..core.arrays import MAD

if TYPE_CHECKING:
    from .edge_estimate import EdgeEstimate
    from .edge_state import LawDeviation

SLACK = 0.5  # standard deviations, half of the shift that is found soonest
LIMIT = 7.0  # of the CUSUM of windows
CLIPPED = 2.0  # standard deviations that a window counts as, at most: three outlying ones in a row give no alarm
SETTLING = 24  # windows after an alarm
MEMORY = 60  # windows from which the scatter of a load is learned
ASSUMED = 10.0  # windows that the scatter of the model counts as
BATCH_LIMIT = 3.5  # of the CUSUM of edges
USUAL_SLOPE = 0.3  # of ln load by ln wear, of a load whose law does not show it
FIRST = 5  # windows of an edge
OTHER = 5.0  # standard deviations of these from what was expected that show another tool
CHECKED = (5, 10, 20, 40)  # windows after which the deviation from the laws is compared
FOREIGN = 3.5  # its standard deviations
UNUSUAL = 2.3  # those that are said, after this number of windows:
UNUSUAL_AT = 15
EDGE_CLIPPED, BASELINE_CLIPPED = 3.0, 2.0  # standard deviations that an edge counts as, at most

CHIPPED = (
    "loads rose at once ({} in the last window): the edge may have chipped. Look at it and gauge it; its level of wear "
    "is open again."
)
DROPPED = (
    "loads fell at once ({} in the last window): a new edge is in use (--new-edge), less is cut than the conditions "
    "say, or the edge broke. Look at it."
)
TOOL = (
    "loads are far from their laws since this edge began ({}): another tool, work material, setting or unit "
    "than those of the parameter file."
)
RARE = (
    "{} is {:.0f} % {} its law in this edge ({:.2g} standard deviations of edges){}. Check depth of cut, work material "
    "and unit, and gauge the edge."
)
TAKEN = ", which is taken in part as {} wear"
SHIFTED = (
    "loads of the last edges are {} than it is, if the work material or the tools are of another batch (the last edge "
    "against its laws: {}). Measure the wear of an edge and learn from it."
)

AlarmKind = Literal["chipping", "drop", "tool", "batch"]


@dataclass(frozen=True, slots=True)
class Alarm:
    """A law that no longer holds.

    Attributes
    ----------
    kind : str
        ``"chipping"`` (loads rose at once), ``"drop"`` (they fell), ``"tool"`` (they are far from the laws from the
        beginning of an edge), ``"batch"`` (those of several edges are shifted).
    text : str
        What was seen, with values, and what to do.
    """

    kind: AlarmKind
    text: str


class ChippingDetector:
    """Two-sided CUSUM of the standardized deviations of loads.

    Examples
    --------
    >>> detector = ChippingDetector()
    >>> quiet, chipped = [0.4, -0.9, -0.2, 0.8] * 5, [4.0] * 5
    >>> [detector.add({"P": z}, {"P": 1.0}) for z in [*quiet, *chipped]][-2:]
    [0, 1]
    """

    def __init__(self) -> None:
        self.up = self.down = 0.0
        self.held = 0  # windows after an alarm, in which the estimate settles
        self.past: dict[str, deque[float]] = {}

    def add(self, deviations: Mapping[str, float], weights: Mapping[str, float]) -> int:
        """Take in a window: 1 where loads have risen, -1 where they have fallen, else 0.

        Parameters
        ----------
        deviations : mapping of str to float
            Of the ln of loads from what was expected, in standard deviations.
        weights : mapping of str to float
            Deviation of each load at a given change of wear, in standard deviations.
        """
        total = norm = 0.0
        for name, value in deviations.items():
            past = self.past.setdefault(name, deque(maxlen=MEMORY))
            z = value / _scale(past)
            past.append(value)
            weight = max(weights.get(name, 0.0), 0.0)
            total += weight * _clipped(z, CLIPPED)
            norm += weight * weight
        if norm == 0:
            return 0
        if self.held:
            self.held -= 1
            return 0
        step = total / sqrt(norm)
        self.up, self.down = max(0.0, self.up + step - SLACK), max(0.0, self.down - step - SLACK)
        found = 1 if self.up > LIMIT else -1 if self.down > LIMIT else 0
        if found:
            self.up, self.down, self.held = 0.0, 0.0, SETTLING
        return found

    def as_json(self) -> dict[str, Any]:
        """Exact snapshot."""
        past = {name: list(past) for name, past in self.past.items()}
        return {"up": self.up, "down": self.down, "held": self.held, "past": past}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> "ChippingDetector":
        """The detector of a snapshot."""
        found = cls()
        found.up, found.down, found.held = float(data["up"]), float(data["down"]), int(data["held"])
        found.past = {name: deque(past, maxlen=MEMORY) for name, past in data["past"].items()}
        return found


def _scale(past: deque[float]) -> float:
    """Scatter of standardized deviations: 1 by the model, corrected by what was seen."""
    if len(past) < 2:
        return 1.0
    seen = MAD * median(abs(value) for value in past)
    return sqrt((ASSUMED + len(past) * seen**2) / (ASSUMED + len(past)))


class BatchDetector:
    """Two-sided CUSUM of the deviations of finished edges from their laws, about a baseline that is learned.

    Of several loads it uses the one that differs least between edges, as their deviations have the wear in common. The
    baseline starts at zero with the uncertainty of the laws: a shift that is there from the first edge is an error of
    the laws as far as these allow it.

    Examples
    --------
    >>> from fitmodels.live.edge_state import LawDeviation
    >>> detector = BatchDetector()
    >>> [detector.finish({"P": LawDeviation(d, 0.05, 0.02, 0.3)}) for d in [0.01, -0.02] * 5 + [0.1] * 6]
    [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0]
    """

    def __init__(self) -> None:
        self.up = self.down = 0.0
        self.load = ""
        self.baseline = self.variance = 0.0

    def finish(self, deviations: Mapping[str, "LawDeviation"]) -> int:
        """Take in a finished edge by load: 1 where loads are higher than before, -1 where they are lower, else 0."""
        known = {name: one for name, one in deviations.items() if one.sd_edge > 0}
        if not self.load and known:
            self.load = min(known, key=lambda name: known[name].sd_edge)
            self.variance = known[self.load].sd_law ** 2
        if self.load not in known:
            return 0
        value, own = known[self.load].value - self.baseline, known[self.load].sd_edge ** 2
        z = _clipped(value / sqrt(self.variance + own), EDGE_CLIPPED)
        gain = self.variance / (self.variance + own)
        self.baseline += gain * _clipped(value, BASELINE_CLIPPED * sqrt(own))
        self.variance *= 1 - gain
        self.up, self.down = max(0.0, self.up + z - SLACK), max(0.0, self.down - z - SLACK)
        found = 1 if self.up > BATCH_LIMIT else -1 if self.down > BATCH_LIMIT else 0
        if found:  # the baseline of the new batch is open
            self.up = self.down = 0.0
            self.variance = own
        return found

    def as_json(self) -> dict[str, Any]:
        """Exact snapshot."""
        return dict(vars(self))

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> "BatchDetector":
        """The detector of a snapshot."""
        found = cls()
        vars(found).update({name: data[name] for name in vars(found)})
        return found


def _clipped(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


class Detection:
    """Detection of events besides the estimate of an edge, over windows and over edges.

    Examples
    --------
    >>> Detection.from_json(Detection().as_json()).windows
    0
    """

    def __init__(self) -> None:
        self.chipping, self.batch = ChippingDetector(), BatchDetector()
        self.windows = 0  # with loads, of this edge
        self.far = 0  # of its first windows, those far from what was expected
        self.foreign = False  # whether another tool was seen
        self.slopes: dict[str, float] = {}  # of ln load by ln wear, as the edge began

    def add(self, estimate: "EdgeEstimate") -> list[Alarm]:
        """Alarms of the window that the estimate has just taken in; after ``"chipping"`` reopen its level."""
        found = {name: one for name, one in estimate.innovations.items() if one.sd > 0}
        if not found:
            return []
        self.windows += 1
        for name in found.keys() - self.slopes.keys():
            slope = estimate.law_deviation(name).slope
            self.slopes[name] = slope if slope > 0 else USUAL_SLOPE
        z = {name: one.value / one.sd for name, one in found.items()}
        if self.windows <= FIRST:
            self.far += any(abs(value) > OTHER for value in z.values())
        if self.foreign:
            return []
        side = self.chipping.add(z, {name: self.slopes[name] / one.sd for name, one in found.items()})
        early = side < 0 and self.windows <= 2 * FIRST  # lower from the beginning: nothing fell
        if early or (self.windows in CHECKED and not estimate.reopened and self._is_foreign(estimate)):
            self.foreign = True
            off = {name: max(one.value, estimate.law_deviation(name).value, key=abs) for name, one in found.items()}
            return [Alarm("tool", TOOL.format(_texts(off)))]
        if not side:
            return []
        text = _texts({name: one.value for name, one in found.items()})
        return [Alarm("chipping", CHIPPED.format(text)) if side > 0 else Alarm("drop", DROPPED.format(text))]

    def unusual(self, estimate: "EdgeEstimate") -> str:
        """A sentence on loads that are unusually far from their laws, once for an edge; empty where none is."""
        if self.windows != UNUSUAL_AT or not estimate.innovations or self.foreign or estimate.gauged:
            return ""
        for name in self.slopes:
            of = estimate.law_deviation(name)
            if abs(of.value) > UNUSUAL * of.sd:
                side, wear = ("above", "more") if of.value > 0 else ("below", "less")
                taken = TAKEN.format(wear) * estimate.laws.loads[name].shows_wear
                return RARE.format(name, 100 * abs(exp(of.value) - 1), side, abs(of.value) / of.sd, taken)
        return ""

    def _is_foreign(self, estimate: "EdgeEstimate") -> bool:
        """Whether the first windows were far from what was expected, or what they gave is far from the laws."""
        of_laws = [estimate.law_deviation(name) for name in self.slopes]
        return self.far >= FIRST - 1 or any(abs(one.value) > FOREIGN * one.sd for one in of_laws)

    def finish(self, estimate: "EdgeEstimate") -> list[Alarm]:
        """Alarms at the end of an edge; the next window is of a new edge."""
        used, foreign = self.windows, self.foreign
        self.windows, self.far, self.foreign, self.slopes = 0, 0, False, {}
        self.chipping = ChippingDetector()
        if used < FIRST or foreign:
            return []
        loads = estimate.laws.loads
        found = {name: estimate.law_deviation(name) for name in loads if loads[name].shows_wear}
        side = self.batch.finish(found)
        if not side:
            return []
        what = "higher than before: wear is taken as more" if side > 0 else "lower than before: wear is taken as less"
        return [Alarm("batch", SHIFTED.format(what, _texts({name: one.value for name, one in found.items()})))]

    def as_json(self) -> dict[str, Any]:
        """Exact snapshot."""
        chipping, batch = self.chipping.as_json(), self.batch.as_json()
        edge = {"windows": self.windows, "far": self.far, "foreign": self.foreign, "slopes": dict(self.slopes)}
        return {**edge, "chipping": chipping, "batch": batch}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> "Detection":
        """The detection of a snapshot."""
        found = cls()
        found.windows, found.far = int(data["windows"]), int(data["far"])
        found.foreign, found.slopes = bool(data["foreign"]), dict(data["slopes"])
        found.chipping = ChippingDetector.from_json(data["chipping"])
        found.batch = BatchDetector.from_json(data["batch"])
        return found


def _texts(values: Mapping[str, float]) -> str:
    """Deviations of ln loads in words.

    >>> _texts({"P": -0.06, "Fc": 6.9})
    'P -5.82 %, Fc 992 times as much'
    """
    times = {name: exp(min(value, 30.0)) for name, value in values.items()}
    return ", ".join(
        f"{name} {100 * (x - 1):+.3g} %" if 0.5 < x < 2 else f"{name} {x:.3g} times as much"
        for name, x in times.items()
    )
