"""The state of a watch: what is known of the edge in use, from what was applied to it in order.

`Monitor.apply` takes one record of the journal and changes the state by that record alone, so that the same records
give the same state again. What is shown but not kept (the last reading, the state of the source) is no part of it.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import exp
from statistics import median
from typing import TYPE_CHECKING, Any, Final

from ..core.errors import FitmodelsError, UsageError
from ..core.rounding import format_plain
from .detection import Detection
from .edge_summary import EdgeSummary
from .samples import Window
from .watch_edge import FAR_CONDITIONS, UNREAD_CONDITIONS, Edge, WatchSettings, by_time_alone, check_identity, window_of

if TYPE_CHECKING:
    from .edge_estimate import EdgeEstimate
    from .live_laws import LiveLaws

Record = Mapping[str, Any]

SHOWN: Final = 12  # notes and decisions that are kept
ALARMS: Final = 50
FINISHED: Final = 12  # edges that are kept for learning
PAST: Final = 0.5  # probability of being past the criterion, from which it is an alarm
CUTS: Final = 50  # lengths of the last cuts


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
    label : str
        Beginning of the names of edges in parameter files that learn from them.
    finished : list of dict
        `Edge.as_json` of the edges before, the newest last.
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
        self.uncounted = 0.0  # min of contact at conditions that are not known
        self.distrusted = False  # whether loads do not belong to the laws, so that time alone is used
        self.alarms: list[dict[str, Any]] = []
        self.decisions: list[dict[str, Any]] = []
        self.notes: list[dict[str, Any]] = []
        self.requests: list[str] = []
        self.refused: list[str] = []  # requests that could not be used, and why
        self._messages: list[str] = []
        self.label = ""
        self.finished: list[dict[str, Any]] = []
        self.edge = Edge()
        self.detection = Detection()
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
            self._not_used(record, str(reason))

    def _not_used(self, record: Record, reason: str) -> None:
        """Say why a record was not used; contact at unknown conditions is an alarm, for the wear is then not known."""
        if record["kind"] not in ("window", "cutend", "gap"):
            self.refused.append(f"--{record['kind']} not used: {reason}")
            self.note(self.time, self.refused[-1])
            return
        minutes = float(record.get("contact", record.get("minutes", 0.0)))
        self._unknown(minutes, f"contact is not counted, and the wear is not known: {reason}")

    def _unknown(self, minutes: float, text: str) -> None:
        """Note contact at conditions that are not known: until a gauge reading the wear is not known either."""
        if minutes > 0:
            self.edge.summary.gaps += self.uncounted == 0
            self.uncounted += minutes
            self._alarm({"time": self.time, "kind_of_alarm": "conditions", "text": text})

    def take_messages(self) -> list[str]:
        """Sentences that are new since they were last taken."""
        messages, self._messages = self._messages, []
        return messages

    # what records do -------------------------------------------------------------------------------------------------

    def _window(self, record: Record) -> None:
        window, given = window_of(record), dict(record["conditions"])
        self.open = self.lost = None  # no gap is left open beside a window
        if missing := self.laws.missing(given):
            window = replace(window, conditions=self.estimate.complete(given), loads={})
            self._unknown(window.contact, UNREAD_CONDITIONS.format(", ".join(missing)))
        self._expect(window)
        if self.distrusted:
            self.estimate.advance(window.contact, window.conditions)
        else:
            self.estimate.add(window)
            self._detect(window)
        self.edge.summary.add(window)
        self.conditions = dict(window.conditions)
        if (far := self.laws.far(self.conditions)) and not self.alarmed("conditions"):
            text = FAR_CONDITIONS.format(" and ".join(far.values()))
            self._alarm({"time": self.time, "kind_of_alarm": "conditions", "text": text})
        self.cut_minutes += window.contact
        self._decide()

    def _detect(self, window: Window) -> None:
        """Act on chipping, and on loads that do not belong to the laws: these show no wear any more."""
        for alarm in self.detection.add(self.estimate):
            self._alarm({"time": self.time, "kind_of_alarm": alarm.kind, "text": alarm.text})
            if alarm.kind == "chipping":
                self.estimate.reopen()
            elif not self.distrusted:
                self.distrusted = True
                self.estimate = by_time_alone(self._new_estimate(), self.edge, window)
                self.note(self.time, "loads are not used for this edge any more: its wear follows from time alone.")
        if text := self.detection.unusual(self.estimate):
            self.note(self.time, text)

    def _expect(self, window: Window) -> None:
        """Keep the expected loads at the conditions of a window, and the measured ones."""
        level = self.settings.level
        self.expected = {}
        for name in window.loads.keys() & self.laws.loads.keys():
            found = self.estimate.expected_load(name, window.conditions, level)
            self.expected[name] = (found.median, found.low, found.high)
        self.measured = {name: exp(window.loads[name].ln) for name in self.expected}

    def _cut_end(self, record: Record) -> None:
        contact, lost = float(record["contact"]), bool(record.get("lost"))
        self.open = None
        self.edge.summary.gaps += int(lost or bool(record.get("unseen")))
        self.conditions = dict(record.get("conditions") or self.conditions)
        self._advance(contact)
        self.cut_minutes += contact
        if lost:
            self.lost = {"since": float(record["time"]), "cut": self.cut_minutes, "conditions": dict(self.conditions)}
            self.note(self.time, "the signal was lost in mid-cut: the cut may go on unseen.")
            return
        if self.cut_minutes > 0:
            self.cuts = [*self.cuts[1 - CUTS :], self.cut_minutes]
        self.cut_minutes = 0.0
        self._decide()

    def _contact(self, record: Record) -> None:
        self.open = {"minutes": float(record["minutes"]), "conditions": dict(record["conditions"])}
        self.conditions = dict(record["conditions"])

    def _resumed(self, record: Record) -> None:
        """Count what the process had seen when it ended, and take the signal for lost since then if it was cutting."""
        if self.open is not None:
            self._advance(self.open["minutes"])
            self.cut_minutes += self.open["minutes"]
            since = float(record["since"])
            self.edge.summary.gaps += 1
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

    def _advance(self, minutes: float) -> None:
        if minutes > 0:
            self.estimate.advance(minutes, self.conditions)
            self.edge.summary.advance(minutes, self.conditions)

    def _gauge(self, record: Record) -> None:
        wear, symbol = float(record["wear"]), self.laws.wear.symbol
        before, certain = self.estimate.wear(self.settings.level), bool(record.get("certain"))
        self.edge.summary.require_room()
        self.estimate.gauge(wear, float(record["sd_ln"]), certain=certain)
        if certain:
            self.edge.summary.marks.clear()
        self.edge.summary.measured(symbol, wear)
        self.edge.gauges, self.uncounted = self.edge.gauges + 1, 0.0
        self.decisions = [one for one in self.decisions if one["kind"] != "change"]
        self.alarms = [one for one in self.alarms if one["kind"] != "worn"]
        ends = f"{before.median:.3g} ({before.low:.3g} to {before.high:.3g}) {before.unit}"
        self.note(self.time, f"gauge reading {symbol} {format_plain(wear)} {before.unit} taken in; expected: {ends}.")
        self._decide()

    def _begin_edge(self, record: Record) -> None:
        shifted = self.detection.finish(self.estimate)
        if self.edge.minutes > 0:
            self.finished = [*self.finished[1 - FINISHED :], self.edge.as_json()]
        number = self.edge.number + 1
        self.edge = Edge(number, str(record.get("tool", "")), summary=EdgeSummary(str(number)))
        self.estimate = self._new_estimate()
        self.alarms = [one for one in self.alarms if one["kind"] in ("journal", "batch")]
        self.decisions, self.open, self.lost, self.cut_minutes = [], None, None, 0.0
        self.expected, self.measured = {}, {}
        self.uncounted, self.distrusted = 0.0, False
        self.note(self.time, f"edge {number} begins.")
        for alarm in shifted:
            self._alarm({"time": self.time, "kind_of_alarm": alarm.kind, "text": alarm.text})

    def _tool(self, record: Record) -> None:
        self.edge.tool = str(record["tool"])
        self.note(self.time, f"edge {self.edge.number} is of tool {self.edge.tool}: other tools are not followed.")

    def _used(self, record: Record) -> None:
        """Count what the edge had cut before it was watched, at stated or middle conditions."""
        if self.edge.minutes > 0:
            raise UsageError(f"edge {self.edge.number} has cut for {self.edge.minutes:.3g} min already.")
        known, minutes = {**self.estimate.typical(), **record.get("conditions", {})}, float(record["minutes"])
        given = {name: known[name] for name in self.laws.conditions if name in known}
        self.estimate.advance(minutes, given)
        self.edge.summary.advance(minutes, given)
        self.edge.summary.missed()
        at = ", ".join(f"{name} {format_plain(value)}" for name, value in given.items())
        self.note(self.time, f"{minutes:.3g} min before the watch are counted, at {at}: gauge the edge.")

    def _alarm(self, record: Record) -> None:
        alarm = {"time": record.get("time"), "kind": record["kind_of_alarm"], "text": record["text"], "latched": True}
        if [one["text"] for one in self.alarms if one["kind"] == alarm["kind"]][-1:] == [alarm["text"]]:
            return
        self.alarms = [*self.alarms[1 - ALARMS :], alarm]
        self._messages.append(f"ALARM {alarm['text']}")
        if alarm["kind"] in ("load", "conditions") and not self.laws.missing(self.conditions):
            self._decide()

    def _acknowledge(self, _: Record) -> None:
        self.alarms = []
        self.note(self.time, "alarms acknowledged.")
        if self.decisions and self.decisions[-1]["kind"] == "not known":
            self._decide()

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
        self._messages.append(text)

    def alarmed(self, kind: str) -> bool:
        """Whether an alarm of a kind is active, such as ``"load"``, of a load that is lost."""
        return any(alarm["kind"] == kind for alarm in self.alarms)

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
        from .decision import change_now, doubts_of

        asked, doubts = self.settings, doubts_of(self)
        ahead = self.next_cut or 0.0
        found = change_now(self.estimate, asked.risk, ahead, self.conditions, asked.costs, doubts=doubts)
        last = self.decisions[-1] if self.decisions else None
        text = f"{found.text} Loads are not used: by time alone." if self.distrusted else found.text
        decision = {"time": self.time, "kind": found.kind, "text": text, "probability": found.probability}
        if last is not None and last["kind"] == "change" != found.kind:
            return
        if last is not None and last["kind"] == found.kind:
            self.decisions[-1] = {**decision, "time": last["time"]}
        else:
            self.decisions = [*self.decisions[1 - SHOWN :], decision]
            self._messages.append(text)
        past = float(self.estimate.probability_past())
        if past > PAST:
            criterion = f"{self.laws.wear.symbol} {format_plain(self.estimate.criterion)} {self.laws.wear.unit}"
            text = f"the wear is more likely past {criterion} than not."
            self._alarm({"time": self.time, "kind_of_alarm": "worn", "text": text})

    # the state as JSON -----------------------------------------------------------------------------------------------

    def as_json(self) -> dict[str, Any]:
        """The whole state, for a snapshot."""
        return {
            "identity": self.identity,
            **{name: getattr(self, name) for name in _KEPT},
            "edge": self.edge.as_json(),
            "detection": self.detection.as_json(),
            "estimate": self.estimate.as_json(),
        }

    def restore(self, state: Mapping[str, Any], *, cut: bool = False) -> None:
        """Take a snapshot as the state.

        Parameters
        ----------
        state : mapping
        cut : bool
            Whether the edge has cut after the snapshot: its laws are then to be the same.

        Raises
        ------
        UsageError
            It is of another tool, work material or parameter file.
        """
        from .edge_estimate import EdgeEstimate

        check_identity(state, self.identity, cut=cut)
        for name in _KEPT:
            setattr(self, name, state[name])
        self.expected = {name: (each[0], each[1], each[2]) for name, each in self.expected.items()}
        self.edge, self.detection = Edge.from_json(state["edge"]), Detection.from_json(state["detection"])
        if state["identity"].get("content") != self.identity.get("content"):  # new laws for a new edge
            self.estimate = self._new_estimate()
            return
        self.estimate = EdgeEstimate.from_json(self.laws, state["estimate"])
        if self.settings.criterion is not None:
            self.estimate.criterion = self.settings.criterion


_KEPT: Final = (
    "time", "source", "cuts", "cut_minutes", "open", "air", "lost", "conditions", "alarms", "decisions", "notes",
    "requests", "expected", "measured", "label", "finished", "uncounted", "distrusted",
)  # fmt: skip
_ACTS: Final[Mapping[str, Callable[[Monitor, Record], None]]] = {
    "window": Monitor._window, "cutend": Monitor._cut_end, "contact": Monitor._contact, "resumed": Monitor._resumed,
    "gap": Monitor._gap, "gauge": Monitor._gauge, "used": Monitor._used, "edge": Monitor._begin_edge,
    "tool": Monitor._tool, "alarm": Monitor._alarm, "acknowledge": Monitor._acknowledge, "notice": Monitor._notice,
    "source": Monitor._source, "air": Monitor._air,
}  # fmt: skip
