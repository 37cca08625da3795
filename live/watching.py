"""The loop of a watch: from the source through cuts to the monitor, its journal, and what shows it."""

import os
import secrets
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

from ..core.errors import FitmodelsError, UsageError
from ..core.files import cause
from ..core.rounding import count
from .facts import Facts, Reading, advice_of, clock, facts_of
from .monitor import Monitor
from .samples import CUT_UNREAD, FED_UNREAD, CutEnd, Notice, Sample, Window
from .watch_edge import window_record
from .watch_journal import WatchJournal, read_newest, remove_request, requests, restore

if TYPE_CHECKING:
    from .advice import Bounds
    from .cuts import Cuts

SHOWN_EACH: Final = 0.5  # s between two descriptions that are shown
CONTACT_EACH: Final = 5.0  # s of the source between two records of an open cut
CONDITIONS_EACH: Final = 1.0  # s of the source between two looks at the conditions
ASKED_EACH: Final = 1.0  # s between two looks for requests and for the parameter file
REQUESTS: Final[Mapping[str, tuple[str, ...]]] = {
    "gauge": ("wear", "sd_ln"), "used": ("minutes",), "tool": (), "edge": (), "acknowledge": (),
}  # fmt: skip
UNREAD: Final = 5.0  # s without a load in mid-cut or feed, after which it is an alarm
OPTIONAL: Final = ("request", "tool", "certain", "conditions")  # fields that a request may have besides
OUTLETS: Final = {"JsonLines": "--stream", "Page": "--page", "OpcUaServer": "--serve"}
SAID: Final = ("connected", "lost", "gap", "bad", "clock", "replaced", "refused")  # notices that are kept


class Outlet(Protocol):
    """Something that shows or passes on what a watch finds."""

    def show(self, facts: Facts) -> None:
        """Take the description of now, at most twice a second."""

    def report(self, facts: Callable[[], Facts], sentences: Sequence[str], time: float | None) -> None:
        """Take sentences that are new after a record: decisions, alarms, notes; often there are none."""

    def close(self) -> None:
        """End."""


class Watch:
    """A watch of one source.

    Parameters
    ----------
    monitor : Monitor
    cuts : Cuts
    name : str
        Of the source, as people read it.
    journal : WatchJournal or None
        None: nothing is kept.
    outlets : iterable of Outlet
    params : Path or None
        The parameter file, to notice that it was replaced.
    """

    def __init__(
        self, monitor: Monitor, cuts: "Cuts", name: str, *, journal: WatchJournal | None = None,
        outlets: Iterable[Outlet] = (), params: Path | None = None,
    ) -> None:  # fmt: skip
        self.monitor, self.cuts, self.journal, self.outlets = monitor, cuts, journal, list(outlets)
        self.now = Reading(source={"name": name, "state": "starting", "text": "", "age": None})
        self.params, self._stamp = params, _stamp(params)
        self._heard = self._shown = self._asked = time.monotonic()
        self._contact: float | None = None
        self.bounds: Bounds | None = None  # of the advice; None: no advice
        self._fault = ""
        self._other_tool = ""
        self._windows = 0  # of the open cut
        self._at: Mapping[str, float] = {}  # last conditions that the laws can use
        self._at_time = float("-inf")
        self._read = float("inf")  # s, last sample with a load, or out of feed

    def run(self, source: Iterable[Sample | Notice], stopped: Callable[[], bool] = lambda: False) -> None:
        """Watch until the source ends or ``stopped`` gives true; the journal is complete then."""
        try:
            for item in source:
                self.take(item)
                if stopped():
                    break
            self._end()
        finally:
            self.show()
            if self.journal is not None:
                self.journal.close()

    def take(self, item: Sample | Notice) -> None:
        """Take in one item of the source."""
        if isinstance(item, Sample):
            self._sample(item)
        else:
            self._notice(item)
        instant = time.monotonic()
        if instant - self._asked >= ASKED_EACH:
            self._asked = instant
            self.look_around()
        if instant - self._shown >= SHOWN_EACH:
            self.show()

    def record(self, kind: str, **facts: Any) -> None:  # noqa: ANN401
        """Write a record to the journal and change the state by it; what follows from it is reported."""
        record = {"kind": kind, **facts}
        if self.journal is not None:
            self.journal.append(record)
        self.monitor.apply(record)
        messages = self.monitor.take_messages()
        if self.journal is not None:
            for each in messages:
                self.journal.append({"kind": "said", "time": self.monitor.time, "text": each})
        self._each(lambda outlet: outlet.report(self.facts, messages, self.monitor.time))
        if self.journal is not None:
            if kind == "edge":
                self.journal.rotate(self.monitor.as_json())
            self._check_journal(self.journal)

    def facts(self) -> Facts:
        """The description of now."""
        age = time.monotonic() - self._heard
        self.now.conditions = dict(self.cuts.conditions)
        self.now.source = {**self.now.source, "age": round(age, 1)}
        if self.journal is not None:
            journal = self.journal
            self.now.journal = {"file": journal.path.name, "records": journal.records, "fault": journal.fault}
        return facts_of(self.monitor, self.now)

    def show(self) -> None:
        """Show the description of now."""
        self._shown = time.monotonic()
        if self.outlets:
            facts = self.facts()
            self._each(lambda outlet: outlet.show(facts))

    # items of the source ---------------------------------------------------------------------------------------------

    def _sample(self, sample: Sample) -> None:
        self._heard = time.monotonic()
        if self._is_other_tool(sample):
            return
        usable = bool(sample.loads.keys() - self.cuts.lost.unread) and not sample.bad
        if self.monitor.lost is not None and usable:
            minutes, text = self.monitor.gap_minutes(sample.time)
            self.record("gap", time=sample.time, minutes=minutes, text=text)
        elif self.monitor.lost is not None and sample.time > self.monitor.lost["since"] + UNREAD:
            self._lose_load(sample, CUT_UNREAD.format(UNREAD))
        if usable or sample.state != "feed":
            self._read = sample.time
        elif sample.time > self._read + UNREAD:
            self._lose_load(sample, FED_UNREAD.format(UNREAD))
        self.now.time, self.now.loads = sample.time, sample.loads
        if usable:
            self.now.source = {**self.now.source, "state": "connected", "text": ""}
        elif sample.bad:
            self.now.source = {**self.now.source, "state": "bad", "text": sample.bad}
        found = self.cuts.add(sample)
        if not found and abs(sample.time - self._at_time) >= CONDITIONS_EACH:
            self._at_time = sample.time
            if not self.monitor.laws.missing(self.cuts.conditions):
                self._at = self.cuts.conditions
        self._found(found)
        self._note_contact(sample.time)

    def _lose_load(self, sample: Sample, text: str) -> None:
        """Say that no load is read, unless the alarm is active already."""
        if not self.monitor.alarmed("load"):
            self._say_notice(Notice(sample.time, "load", text))

    def _notice(self, notice: Notice) -> None:
        if notice.kind == "idle":
            self._found(self.cuts.add(notice))
            return
        text = "" if notice.kind == "connected" else notice.text
        self.now.source = {**self.now.source, "state": "ended" if notice.kind == "end" else notice.kind, "text": text}
        if notice.kind in SAID:
            self._say_notice(notice)
        self._found(self.cuts.add(notice))
        if notice.kind == "clock" and self.monitor.lost is not None:
            text = "the clock jumped in mid-cut: the jump itself is not counted as cutting."
            self.record("gap", time=self.monitor.time, minutes=0.0, text=text)

    def _say_notice(self, notice: Notice) -> None:
        stamp = self.now.time
        prefix = "" if notice.kind in ("refused", "load") else f"{notice.kind}: "
        text = f"{prefix}{notice.text}" if notice.text else notice.kind
        if notice.kind == "load" or (notice.kind in ("refused", "lost") and self.now.state in ("entry", "cutting")):
            self.record("alarm", time=stamp, kind_of_alarm=notice.kind, text=text, latched=True)
            self.now.advice = advice_of(self.monitor, self.bounds)
        else:
            self.record("notice", time=stamp, text=text)

    def _found(self, found: Iterable[Window | CutEnd | Notice]) -> None:
        """Take in what the search for cuts has found."""
        for each in found:
            if isinstance(each, Window):
                self.record(**window_record(each))
                self._windows += 1
                self._contact = each.end
            elif isinstance(each, CutEnd):
                self.record("cutend", **asdict(each), conditions={} if self._windows else dict(self._at))
                self._windows = 0
                self._contact = None
                self.now.advice = advice_of(self.monitor, self.bounds)
            else:
                self._say_notice(each)
        cutting = self.cuts.state in ("entry", "cutting")
        if cutting and self.now.state not in ("entry", "cutting"):
            self.record("air", levels=self.cuts.as_json())
        self.now.state = self.cuts.state
        self.now.open = float(self.cuts.contact)

    def _note_contact(self, stamp: float) -> None:
        """Keep the minutes of an open cut each few seconds, so that the end of the process loses none."""
        if self.now.open <= 0:
            return
        if self._contact is None or stamp < self._contact:
            self._contact = stamp
        if stamp - self._contact >= CONTACT_EACH:
            self._contact = stamp
            self.record("contact", time=stamp, minutes=self.now.open, conditions=dict(self.cuts.conditions))

    def _is_other_tool(self, sample: Sample) -> bool:
        """Whether the source names another tool than that of the edge: its cuts are not those of the edge."""
        if not sample.tool:
            return bool(self._other_tool)
        if not self.monitor.edge.tool:
            self.record("tool", time=sample.time, tool=sample.tool)
            return False
        other = sample.tool if sample.tool != self.monitor.edge.tool else ""
        if other != self._other_tool:
            self._other_tool = other
            edge = f"edge {self.monitor.edge.number} (tool {self.monitor.edge.tool})"
            if other:
                left = self.cuts.add(Notice(sample.time, "replaced"))  # its cut has ended, and is not lost
                self._found(replace(each, lost=False) if isinstance(each, CutEnd) else each for each in left)
                text = f"the source names tool {other}: {edge} is not followed until its tool is back."
            else:
                text = f"tool {self.monitor.edge.tool} is back: {edge} is followed again."
            self.record("notice", time=sample.time, text=text)
        if other:
            self.now.time, self.now.loads, self.now.state = sample.time, sample.loads, "idle"
        return bool(other)

    # beside the source -----------------------------------------------------------------------------------------------

    def look_around(self) -> None:
        """Take in requests, notice a replaced parameter file, and write what waits."""
        if self.journal is not None:
            self.journal.write_waiting()
            self._check_journal(self.journal)
            for path, request in requests(self.journal.folder):
                self.record(**request_record(request, self.monitor.time))
                self.journal.synchronise()
                remove_request(path)
        stamp = _stamp(self.params)
        if stamp != self._stamp:
            self._stamp = stamp
            what = "was removed" if stamp is None else "was replaced"
            text = f"{self.params} {what}: this watch goes on with the laws that it has read. Start again for new ones."
            self.record("notice", time=self.monitor.time, text=text)

    def _check_journal(self, journal: WatchJournal) -> None:
        """Begin a new file where one is full; say once when the disk refuses, and when it takes records again."""
        if journal.fault != self._fault:
            self._fault, before = journal.fault, self._fault
            if journal.fault and not before:
                text = f"{journal.folder}: the journal cannot be written: {journal.fault}; watching goes on without it."
                self.record("alarm", time=self.monitor.time, kind_of_alarm="journal", text=text, latched=True)
            elif not journal.fault:
                text = f"the journal is written again; lost meanwhile: {count(journal.lost, 'record')}."
                journal.lost = 0
                self.record("notice", time=self.monitor.time, text=text)
                journal.rotate(self.monitor.as_json())
        elif journal.full:
            journal.rotate(self.monitor.as_json())

    def _end(self) -> None:
        self._found(self.cuts.close())
        self.look_around()
        self.now.state = "stopped"

    def _each(self, act: Callable[[Outlet], None]) -> None:
        """Let each outlet act; one that fails is left out from then on, and reported."""
        for outlet in list(self.outlets):
            try:
                act(outlet)
            except (OSError, FitmodelsError) as failure:
                self.outlets.remove(outlet)
                name = OUTLETS.get(type(outlet).__name__, "the output")
                why = cause(failure) if isinstance(failure, OSError) else failure
                self.monitor.note(self.monitor.time, f"{name} failed and is left out: {why}.")


def _stamp(path: Path | None) -> tuple[int, int] | None:
    """Size and time of a file; None where there is none."""
    with suppress(OSError):
        if path is not None:
            status = os.stat(path)  # noqa: PTH116  follows links
            return status.st_size, status.st_mtime_ns
    return None


def request_record(request: Mapping[str, Any], time: float | None) -> dict[str, Any]:
    """The record of a request that was left in the folder of a journal; of one that is not known, a notice."""
    kind, given = str(request.get("kind")), request.get("conditions", {})
    needed = REQUESTS.get(kind)
    named = isinstance(request.get("tool", ""), str) and isinstance(given, dict)
    if kind == "tool":
        named = named and bool(request.get("tool"))
    numbers = [*(request.get(name) for name in needed or ()), *(given.values() if named else ())]
    positive = all(isinstance(value, int | float) and isfinite(value) and value > 0 for value in numbers)
    if needed is None or not named or not positive:
        return {"kind": "notice", "time": time, "text": "a request in the folder of the journal is not known."}
    return {"kind": kind, "time": time, **{name: request[name] for name in (*needed, *OPTIONAL) if name in request}}


def take_requests(folder: Path, monitor: Monitor) -> None:
    """Restore a monitor from the journal of a folder, and take in the requests that are left there.

    Parameters
    ----------
    folder : Path
        Holds a journal, and is locked by the caller.
    monitor : Monitor
    """
    journal, newest = WatchJournal(folder), read_newest(folder)
    if newest is None:
        return
    restore(newest, monitor)
    left = list(requests(folder))
    if not left:
        return
    journal.resume(newest)
    for _, request in left:
        record = request_record(request, monitor.time)
        journal.append(record)
        monitor.apply(record)
        if record["kind"] == "edge":
            journal.rotate(monitor.as_json())
    journal.close()
    if journal.fault:
        raise UsageError(f"{folder}: the journal cannot be written: {journal.fault}; nothing was taken in.")
    for path, _ in left:
        remove_request(path)


def open_journal(folder: Path, monitor: Monitor, source: str) -> tuple[WatchJournal, float | None]:
    """The journal of a folder, with its state restored into a monitor; a new one begins with the state of now.

    Parameters
    ----------
    folder : Path
        Exists and is locked by the caller.
    monitor : Monitor
    source : str
        Words of the source.

    Returns
    -------
    journal : WatchJournal
    after : float or None
        Time of the last record where the source is the same: a file is read on from there.

    Raises
    ------
    UsageError
        The journal is of another tool, work material or parameter file, or cannot be written.
    """
    journal = WatchJournal(folder)
    newest = read_newest(folder)
    after = None
    begun: list[dict[str, Any]] = []
    if newest is None:
        monitor.label = f"{folder.resolve().name}-{secrets.token_hex(2)}"
        journal.rotate(monitor.as_json())
    else:
        restore(newest, monitor)
        journal.resume(newest)
        if newest.missing or newest.records[0]["state"]["identity"] != monitor.identity:
            journal.rotate(monitor.as_json())
        after = monitor.time if monitor.source == source else None
        text = f"the journal was taken up again; its last record is of {clock(monitor.time)}."
        begun.append({"kind": "resumed", "time": monitor.time, "since": monitor.time, "text": text})
    for record in (*begun, {"kind": "source", "source": source}):
        journal.append(record)
        monitor.apply(record)
    if journal.fault:
        raise UsageError(f"{folder}: the journal cannot be written: {journal.fault}; choose another folder.")
    return journal, after
