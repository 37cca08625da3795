"""The state of a watch: what is known of the edge in use, from what was applied to it in order.

`Monitor.apply` takes one record of the journal and changes the state by that record alone, so that the same records
give the same state again. What is shown but not kept (the last reading, the state of the source) is no part of it.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from statistics import median
from typing import TYPE_CHECKING, Any, Final

from ..core.errors import FitmodelsError, UsageError
from ..core.rounding import format_plain
from .samples import LoadMean, Window

if TYPE_CHECKING:
    from ..parameters.sections.costs import CostsSection
    from .edge_estimate import EdgeEstimate
    from .live_laws import LiveLaws

Record = Mapping[str, Any]

SHOWN: Final = 12  # notes and decisions that are kept
ALARMS: Final = 50
PAST: Final = 0.5  # probability of being past the criterion, from which it is an alarm
CUTS: Final = 50  # lengths of the last cuts


@dataclass(frozen=True, slots=True)
class WatchSettings:
    """What was asked of a watch.

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
    """What is known of the edge in use besides its estimate.

    Attributes
    ----------
    number : int
    tool : str
        Name that the source gives the tool; empty where it gives none.
    minutes : float
        Time of contact, min.
    gauges : list of dict
        ``minutes`` and ``wear`` of each reading.
    """

    number: int = 1
    tool: str = ""
    minutes: float = 0.0
    gauges: list[dict[str, float]] = field(default_factory=list)


class Monitor:
    """The state of a watch.

    Parameters
    ----------
    laws : LiveLaws
    settings : WatchSettings
    identity : mapping
        Of the tool, the work material and the parameter file; a journal goes on with the same only.

    Attributes
    ----------
    edge : Edge
    estimate : EdgeEstimate
        Wear and levels of the edge.
    alarms : list of dict
        ``time``, ``kind``, ``text`` and ``latched``, the newest last; latched ones stay until a new edge begins or
        they are acknowledged.
    decisions : list of dict
        ``time``, ``kind``, ``text`` and ``probability``, the newest last.
    notes : list of dict
        ``time`` and ``text`` of what was assumed or happened.
    """

    def __init__(self, laws: "LiveLaws", settings: WatchSettings, identity: Mapping[str, Any]) -> None:
        self.laws, self.settings, self.identity = laws, settings, dict(identity)
        self.time: float | None = None
        self.source = ""
        self.cuts: list[float] = []
        self.cut_minutes = 0.0  # of the open cut, as far as it is applied
        self.open: dict[str, Any] | None = None  # contact that no window holds yet
        self.air: dict[str, Any] | None = None  # idle levels, as the search for cuts had them before the last cut
        self.lost: dict[str, Any] | None = None  # since when the signal is lost in mid-cut
        self.conditions: dict[str, float] = {}
        self.alarms: list[dict[str, Any]] = []
        self.decisions: list[dict[str, Any]] = []
        self.notes: list[dict[str, Any]] = []
        self.requests: list[str] = []
        self._said: list[str] = []
        self.edge = Edge()
        self.estimate: EdgeEstimate = self._new_estimate()
        self.expected: dict[str, tuple[float, float, float]] = {}
        self.measured: dict[str, float] = {}

    def _new_estimate(self) -> "EdgeEstimate":
        from .edge_estimate import EdgeEstimate

        return EdgeEstimate(self.laws, self.settings.criterion)

    def apply(self, record: Record) -> None:
        """Change the state by one record of the journal; kinds that only report are passed over."""
        kind = str(record.get("kind"))
        act = _ACTS.get(kind)
        if act is None:
            return
        if key := record.get("request"):
            if key in self.requests:
                return
            self.requests = [*self.requests[-99:], key]
        if isinstance(record.get("time"), int | float):
            self.time = float(record["time"])
        try:
            act(self, record)
        except FitmodelsError as reason:
            self.note(self.time, f"{kind} not used: {reason}")

    def take_said(self) -> list[str]:
        """Sentences that are new since they were last taken."""
        said, self._said = self._said, []
        return said

    # what records do -------------------------------------------------------------------------------------------------

    def _window(self, record: Record) -> None:
        window = window_of(record)
        self._returned()
        self.open = None
        self._expect(window)
        self.estimate.add(window)
        self.conditions = dict(window.conditions)
        self.cut_minutes += window.contact
        self.edge.minutes += window.contact
        self._decide()

    def _expect(self, window: Window) -> None:
        """Keep the expected loads at the conditions of a window, and the measured ones."""
        from math import exp

        level = self.settings.level
        self.expected = {}
        for name in window.loads.keys() & self.laws.loads.keys():
            found = self.estimate.expected_load(name, window.conditions, level)
            self.expected[name] = (found.median, found.low, found.high)
        self.measured = {name: exp(window.loads[name].ln) for name in self.expected}

    def _cut_end(self, record: Record) -> None:
        contact, lost = float(record["contact"]), bool(record.get("lost"))
        self.open = None
        self._advance(contact)
        self.cut_minutes += contact
        if lost:
            self.lost = {"since": float(record["time"]), "cut": self.cut_minutes, "conditions": dict(self.conditions)}
            self.note(self.time, "the signal was lost in mid-cut: the cut may go on unseen.")
            return
        self._finish_cut()
        self._decide()

    def _finish_cut(self) -> None:
        if self.cut_minutes > 0:
            self.cuts = [*self.cuts[1 - CUTS :], self.cut_minutes]
        self.cut_minutes = 0.0

    def _contact(self, record: Record) -> None:
        self.open = {"minutes": float(record["minutes"]), "conditions": dict(record["conditions"])}
        self.conditions = dict(record["conditions"])

    def _resumed(self, record: Record) -> None:
        """Count what the process had seen when it ended, and take the signal for lost since then if it was cutting."""
        if self.open is not None:
            self._advance(self.open["minutes"])
            self.cut_minutes += self.open["minutes"]
            since = float(record["since"])
            self.lost = {"since": since, "cut": self.cut_minutes, "conditions": dict(self.conditions)}
            self.open = None
        self.note(self.time, str(record["text"]))

    def _gap(self, record: Record) -> None:
        if self.lost is not None:
            self.conditions = dict(self.lost["conditions"])
        self._advance(float(record["minutes"]))
        self.cut_minutes += float(record["minutes"])
        self.lost = None
        self.note(self.time, str(record["text"]))
        self._decide()

    def _returned(self) -> None:
        """Close a gap that no record closed; none is left open beside a window."""
        self.lost = None

    def _advance(self, minutes: float) -> None:
        if minutes > 0:
            self.estimate.advance(minutes, self.conditions)
            self.edge.minutes += minutes

    def _gauge(self, record: Record) -> None:
        self.estimate.gauge(float(record["wear"]), float(record["sd_ln"]))
        self.edge.gauges.append({"minutes": self.edge.minutes, "wear": float(record["wear"])})
        self.decisions = [one for one in self.decisions if one["kind"] != "change"]
        self.note(self.time, f"gauge reading {format_plain(float(record['wear']))} {self.laws.wear.unit} taken in.")
        self._decide()

    def _begin_edge(self, record: Record) -> None:
        self.edge = Edge(self.edge.number + 1, str(record.get("tool", "")))
        self.estimate = self._new_estimate()
        self.alarms = [one for one in self.alarms if one["kind"] in ("journal",)]
        self.decisions, self.open, self.lost, self.cut_minutes = [], None, None, 0.0
        self.expected, self.measured = {}, {}
        self.note(self.time, f"edge {self.edge.number} begins.")

    def _tool(self, record: Record) -> None:
        self.edge.tool = str(record["tool"])

    def _alarm(self, record: Record) -> None:
        alarm = {"time": record.get("time"), "kind": record["kind_of_alarm"], "text": record["text"], "latched": True}
        same = [one for one in self.alarms if one["kind"] == alarm["kind"]]
        if same and same[-1]["text"] == alarm["text"]:
            return
        self.alarms = [*self.alarms[1 - ALARMS :], alarm]
        self._said.append(f"ALARM {alarm['text']}")

    def _acknowledge(self, _: Record) -> None:
        self.alarms = []
        self.note(self.time, "alarms acknowledged.")

    def _notice(self, record: Record) -> None:
        self.note(self.time, str(record["text"]))

    def _air(self, record: Record) -> None:
        self.air = dict(record["levels"])

    def _source(self, record: Record) -> None:
        self.source = str(record["source"])

    # what follows from the state -------------------------------------------------------------------------------------

    def note(self, time: float | None, text: str) -> None:
        """Keep a note; the same text again renews its time."""
        others = [one for one in self.notes if one["text"] != text]
        self.notes = [*others[1 - SHOWN :], {"time": time, "text": text}]
        if len(others) == len(self.notes) - 1:
            self._said.append(text)

    @property
    def next_cut(self) -> float | None:
        """Minutes of the next cut: as asked, or the median of the cuts so far; None before the first one ended."""
        if self.settings.next_cut is not None:
            return self.settings.next_cut
        return median(self.cuts) if self.cuts else None

    def gap_minutes(self, time: float) -> tuple[float, str]:
        """Minutes of cutting that are assumed while the signal was lost in mid-cut, and the sentence that says so.

        The whole gap counts as cutting, at the conditions before it, but not beyond the longest cut so far.
        """
        assert self.lost is not None  # noqa: S101  asked only then
        elapsed = (time - self.lost["since"]) / 60
        rest = max(self.cuts) - self.lost["cut"] if self.cuts else None
        if elapsed < 0:
            counted = max(rest or 0.0, 0.0)
            why = f"the clock was set back meanwhile; {counted:.3g} min are counted as cutting. Gauge the edge"
        elif rest is None or elapsed <= rest:
            counted, why = elapsed, "all of it is counted as cutting"
        else:
            counted = max(rest, 0.0)
            why = f"{counted:.3g} min are counted as cutting, up to the longest cut so far ({max(self.cuts):.3g} min)"
        return counted, f"no signal for {max(elapsed, 0.0):.3g} min in mid-cut: {why}."

    def _decide(self) -> None:
        """Decide on the moment to change; a decision to change stays until an edge begins or a gauge reading."""
        from .decision import change_now

        asked = self.settings
        found = change_now(self.estimate, asked.risk, self.next_cut or 0.0, self.conditions, asked.costs)
        last = self.decisions[-1] if self.decisions else None
        decision = {"time": self.time, "kind": found.kind, "text": found.text, "probability": found.probability}
        if last is not None and last["kind"] == "change" != found.kind:
            return
        if last is not None and last["kind"] == found.kind:
            self.decisions[-1] = {**decision, "time": last["time"]}
        else:
            self.decisions = [*self.decisions[1 - SHOWN :], decision]
            self._said.append(found.text)
        past = float(self.estimate.probability_past())
        if past > PAST:
            criterion = f"{self.laws.wear.symbol} {format_plain(self.estimate.criterion)} {self.laws.wear.unit}"
            self._alarm(
                {
                    "time": self.time,
                    "kind_of_alarm": "worn",
                    "text": f"the wear is more likely past {criterion} than not.",
                }
            )

    # the state as JSON -----------------------------------------------------------------------------------------------

    def as_json(self) -> dict[str, Any]:
        """The whole state, for a snapshot."""
        kept = {name: getattr(self, name) for name in _KEPT}
        return {
            "identity": self.identity,
            **kept,
            "edge": asdict(self.edge),
            "estimate": self.estimate.as_json(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take a snapshot as the state.

        Raises
        ------
        UsageError
            It is of another tool, work material or parameter file.
        """
        from .edge_estimate import EdgeEstimate

        self._check_identity(state["identity"])
        for name in _KEPT:
            setattr(self, name, state[name])
        self.expected = {name: (each[0], each[1], each[2]) for name, each in self.expected.items()}
        self.edge = Edge(**state["edge"])
        self.estimate = EdgeEstimate.from_json(self.laws, state["estimate"])
        if self.settings.criterion is not None:
            self.estimate.criterion = self.settings.criterion

    def _check_identity(self, of: Mapping[str, Any]) -> None:
        for name, what in (("tool", "the tool"), ("work", "the work material"), ("content", "the parameter file")):
            if of.get(name) != self.identity.get(name):
                raise UsageError(
                    f"the journal is of another edge: {what} there is {of.get(name)!r}, and here "
                    f"{self.identity.get(name)!r}. Give the same parameter file, or another folder with --journal."
                )


_KEPT: Final = (
    "time", "source", "cuts", "cut_minutes", "open", "air", "lost", "conditions", "alarms", "decisions", "notes",
    "requests", "expected", "measured",
)  # fmt: skip
_ACTS: Final[Mapping[str, Callable[[Monitor, Record], None]]] = {
    "window": Monitor._window,
    "cutend": Monitor._cut_end,
    "contact": Monitor._contact,
    "resumed": Monitor._resumed,
    "gap": Monitor._gap,
    "gauge": Monitor._gauge,
    "edge": Monitor._begin_edge,
    "tool": Monitor._tool,
    "alarm": Monitor._alarm,
    "acknowledge": Monitor._acknowledge,
    "notice": Monitor._notice,
    "source": Monitor._source,
    "air": Monitor._air,
}


def window_record(window: Window) -> dict[str, Any]:
    """A window as a record of the journal.

    Examples
    --------
    >>> window = Window(0.0, 10.0, 0.2, {"V": 120.0}, {"P": LoadMean(0.5, 0.01, 500)}, cut=3)
    >>> window_of(window_record(window)) == window
    True
    """
    return {"kind": "window", "time": window.end, **asdict(window)}


def window_of(record: Record) -> Window:
    """The window of a record of the journal."""
    loads = {name: LoadMean(**mean) for name, mean in record["loads"].items()}
    start, end, contact = (float(record[name]) for name in ("start", "end", "contact"))
    return Window(start, end, contact, dict(record["conditions"]), loads, int(record["cut"]))
