"""The edge in use and the settings of a watch, and windows as records of its journal."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from math import exp
from typing import TYPE_CHECKING, Any, Final

from ..core.errors import UsageError
from .edge_summary import EdgeSummary
from .samples import LoadMean, Window

if TYPE_CHECKING:
    from ..parameters.sections.costs import CostsSection
    from .edge_estimate import EdgeEstimate

GAUGE_SD: Final = 0.03  # of ln wear, of a gauge reading that is taken in again
FAR_CONDITIONS: Final = "{}: the laws say nothing of the wear there. Check the unit, or fit laws to such tests."
UNREAD_CONDITIONS: Final = (
    "{} is not read: contact is counted at the last value, without the loads, and the wear is not known. Check its "
    "signal, and gauge the edge once it is read again."
)


@dataclass(frozen=True, slots=True)
class WatchSettings:
    """Settings of a watch.

    Attributes
    ----------
    criterion : float or None
        Wear at which the edge is worn out, in the unit of the wear law; None: that of the parameter file.
    risk : float
        Largest probability of being past the criterion at the end of the next cut.
    costs : CostsSection or None
        Given: the edge is changed at least cost in place of a risk.
    level : float
        Of the intervals.
    next_cut : float or None
        Minutes of the next cut; None: the median of the cuts of this watch.
    """

    criterion: float | None = None
    risk: float = 0.05
    costs: "CostsSection | None" = None
    level: float = 0.90
    next_cut: float | None = None


@dataclass(slots=True)
class Edge:
    """The edge in use, besides its estimate.

    Attributes
    ----------
    number : int
    tool : str
        Name that the source gives the tool; empty where it gives none.
    gauges : int
        Readings of its wear that were taken in.
    summary : EdgeSummary
        Contact, conditions and loads, from which the laws can learn.
    """

    number: int = 1
    tool: str = ""
    gauges: int = 0
    summary: EdgeSummary = field(default_factory=lambda: EdgeSummary("1"))

    @property
    def minutes(self) -> float:
        """Time of contact, min."""
        return self.summary.minutes

    def as_json(self) -> dict[str, Any]:
        """Exact copy as data of JSON."""
        return {"number": self.number, "tool": self.tool, "gauges": self.gauges, "summary": self.summary.as_json()}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> "Edge":
        """The edge that `as_json` wrote."""
        return cls(data["number"], data["tool"], data["gauges"], EdgeSummary.from_json(data["summary"]))


def by_time_alone(found: "EdgeEstimate", edge: Edge, window: Window) -> "EdgeEstimate":
    """A new estimate after the last gauge reading and the contact of an edge, without any of its loads.

    Parameters
    ----------
    found : EdgeEstimate
        Of a new edge; it is advanced.
    edge : Edge
        As it was before the window.
    window : Window
    """
    marks, done = edge.summary.marks, 0.0
    if marks:
        for cell in marks[-1].cells:
            found.advance(cell.minutes, {name: exp(value) for name, value in cell.ln.items()})
        found.gauge(marks[-1].wear, GAUGE_SD)
        done = marks[-1].minutes
    share = 1.0 - done / edge.minutes if edge.minutes > 0 else 0.0
    for cell in edge.summary.cells:
        found.advance(cell.minutes * share, {name: exp(value) for name, value in cell.ln.items()})
    found.advance(window.contact, window.conditions)
    return found


def check_identity(state: Mapping[str, Any], identity: Mapping[str, Any], *, cut: bool) -> None:
    """Refuse the snapshot of another tool, work material or, once the edge has cut, parameter file (UsageError)."""
    of, names = state["identity"], {"tool": "the tool", "work": "the work material"}
    if cut or state["edge"]["summary"]["minutes"]:
        names["content"] = "the parameter file"
    for name, what in names.items():
        if of.get(name) != identity.get(name):
            raise UsageError(
                f"the journal is of another edge: {what} there is {of.get(name)!r}, and here {identity.get(name)!r}. "
                "Give the same parameter file, begin a new edge with it first (--new-edge), or give another folder "
                "with --journal."
            )


def window_record(window: Window) -> dict[str, Any]:
    """A window as a record of the journal.

    Examples
    --------
    >>> window = Window(0.0, 10.0, 0.2, {"V": 120.0}, {"P": LoadMean(0.5, 0.01, 500)}, cut=3)
    >>> window_of(window_record(window)) == window
    True
    """
    return {"kind": "window", "time": window.end, **asdict(window)}


def window_of(record: Mapping[str, Any]) -> Window:
    """The window of a record of the journal."""
    loads = {name: LoadMean(**mean) for name, mean in record["loads"].items()}
    start, end, contact = (float(record[name]) for name in ("start", "end", "contact"))
    return Window(start, end, contact, dict(record["conditions"]), loads, int(record["cut"]))
