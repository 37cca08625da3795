"""Control by consent: reference and upper feed limit of the exported constant-load controller, behind its heartbeat.

Nothing is written to a machine unless all of this holds:

1. The user asks for it (``--write``) and repeats the range (``--consent``, `consent_words`).
2. HAL holds the controller that `fitmodels.controllers` exports from this parameter file: every setting is compared.
3. In this session of the program the controller was seen to trip: its heartbeat stops, it latches its fault, the
   heartbeat comes back, the fault stays until the operator's reset.

Then reference and upper limit of the feed are written, inside the range of the file and never above it. The lower
limit, to which a fault lowers the feed, is not written. Where the program dies or hangs, its heartbeat ends and the
controller goes to its own safe state. `ControlSession` needs no LinuxCNC; `live.linuxcnc_control` connects it with one.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from ..core.errors import UsageError
from ..core.rounding import listed
from ..datasets.units import convert
from .controller import (
    CHANGED,
    READINGS,
    STATUS,
    Controller,
    Value,
    controller_of,
    differences,
    is_same,
    require_consent,
    write_order,
)
from .linuxcnc_control import HalLink, Link, Runner

if TYPE_CHECKING:
    from ..parameters import ParameterFile
    from ..parameters.exports.loop import LoadLoop
    from .watching import Watch

Phase = Literal["checking", "waiting", "tripping", "latched", "writing", "suspended", "refused", "lost"]

STEADY: Final = 0.5  # s without a fault before the heartbeat is stopped, and of latched fault after it came back
TRIP_MARGIN: Final = 0.3  # s after the heartbeat's time, for 20 readings of the pins a second
TRIALS: Final = 3  # a fault that goes without a reset so often is not latched
SILENT: Final = 1.0  # s without values of the pins: the machine is lost


def open_control(pf: "ParameterFile", consent: str, reference: float | None, python: str) -> "Runner[ControlSession]":
    """Connection with the controller of a parameter file on this machine.

    Parameters
    ----------
    consent : str
        `consent_words`.
    reference : float or None
        Load that the controller holds, unit_load; None: that of the file.
    python : str
        Of LinuxCNC.

    Raises
    ------
    GateError, UsageError
        No such controller, or no consent.
    """
    controller = controller_of(pf)
    require_consent(controller, consent)
    low, high = controller.reference
    if reference is not None and not low <= reference <= high:
        unit = controller.loop.unit_load
        raise UsageError(f"reference {reference:g} {unit}: give {low:.4g} to {high:.4g} {unit}, the range of the file.")
    pins = (*STATUS, *READINGS, *controller.settings)
    link = HalLink(pins, controller.limits(), controller.heartbeat, python)
    session = ControlSession(controller, link)
    session.request(reference=reference)
    return Runner(session)


class ControlOutlet:
    """Control as an outlet of a watch: signs of life go to the session, its sentences to the records of the watch.

    Parameters
    ----------
    runner : Runner
    watch : Watch
        Its description gets the facts of the session; what changes is recorded, the end of writing as an alarm.
    """

    def __init__(self, runner: "Runner[ControlSession]", watch: "Watch") -> None:
        self._runner, self._watch = runner, watch
        self._phase = ""

    def show(self, facts: Mapping[str, Any]) -> None:
        """Take a sign of life of the main loop, and pass on what changed."""
        session, watch = self._runner.session, self._watch
        self._follow(facts)
        watch.now.control = session.facts()
        phase = str(watch.now.control["phase"])
        for text in self._runner.take():
            watch.record("notice", time=watch.monitor.time, text=f"control: {text}")
        if phase != self._phase and phase in ("suspended", "refused", "lost"):
            text = f"control: {watch.now.control['text']}"
            watch.record("alarm", time=watch.monitor.time, kind_of_alarm="control", text=text, latched=True)
        self._phase = phase

    def _follow(self, facts: Mapping[str, Any]) -> None:
        """Ask for the highest feed that was advised as the upper limit of the feed."""
        session, n = self._runner.session, facts["conditions"].get("n")
        feeds = [one for one in facts["advice"] if one["kind"] == "feed" and "f" in one.get("settings", {})]
        if feeds and n:
            unit = session.controller.loop.unit_feed
            session.request(high=float(convert(np.array([feeds[-1]["settings"]["f"] * n]), "mm/min", unit)[0]))

    def report(self, facts: Callable[[], Mapping[str, Any]], sentences: Sequence[str], time: float | None) -> None:
        """Nothing: `show` follows."""

    def close(self) -> None:
        """End the heartbeat."""
        self._runner.close()


@dataclass(slots=True)
class ControlSession:
    """State machine between `Monitor` and a machine: check, trip of the heartbeat, writing.

    `step` is called some 20 times a second (`live.linuxcnc_control.Runner`); the heartbeat lasts half a second longer
    than its calls.

    Attributes
    ----------
    phase : str
        ``"checking"``, ``"waiting"`` (for an armed controller without fault, out of a cut), ``"tripping"``,
        ``"latched"`` (waits for the operator's reset), ``"writing"``, ``"suspended"`` (a fault, or switched off),
        ``"refused"`` and ``"lost"``, which are final.
    trip : float
        s from the end of the heartbeat to the fault; NaN before it was seen.
    """

    controller: Controller
    link: Link
    phase: Phase = "checking"
    text: str = "the settings of the controller are compared with the file"
    trip: float = math.nan
    _since: float = math.nan
    _trials: int = 0
    _latch_seen: bool = False
    _wanted: dict[str, float] = field(default_factory=dict)
    _written: dict[str, float] = field(default_factory=dict)
    _written_at: float = math.nan

    def __post_init__(self) -> None:
        self._wanted = {"reference": self.controller.reference[1], "high": self.controller.high[1]}

    def request(self, reference: float | None = None, high: float | None = None) -> str:
        """Ask for a reference (unit_load) or an upper limit of the feed (unit_feed), and return what is taken.

        Values outside of the range of the controller are brought to its end; NaN is refused.
        """
        taken = []
        for name, value, unit in (
            ("reference", reference, self.controller.loop.unit_load), ("high", high, self.controller.loop.unit_feed),
        ):  # fmt: skip
            if value is None:
                continue
            if not math.isfinite(value):
                raise UsageError(f"{name} {value} {unit} is no number; give one, or none to leave it as it is.")
            low, most = getattr(self.controller, name)
            used = min(max(value, low), most)
            self._wanted[name] = used
            bounded = "" if used == value else f" (asked for {value:.6g}, range {low:.6g} to {most:.6g})"
            taken.append(f"{'feed limit' if name == 'high' else name} {used:.6g} {unit}{bounded}")
        return ", ".join(taken)

    def step(self, now: float) -> tuple[str, ...]:
        """Advance to a time (s, monotonic clock); returns what changed, in sentences."""
        if self.phase in ("refused", "lost"):
            return ()
        before = self.text
        read = self.link.values()
        if problem := self.link.problem():
            self._end("lost", f"connection with the controller lost: {problem}")
        elif read is None or now - read[0] > SILENT:
            if read is not None:
                self._end("lost", f"no values of the controller's pins for {now - read[0]:.1f} s")
        else:
            self._go_on(now, read[1])
        if self.phase not in ("refused", "lost"):
            self.link.send(self.phase != "tripping", {})
        return (self.text,) if self.text != before else ()

    def _go_on(self, now: float, values: Mapping[str, Any]) -> None:
        """Advance by the values of the pins; all of them are needed once they were checked."""
        missing = [pin for pin in (*STATUS, *CHANGED) if pin not in values]
        if missing and self.phase != "checking":
            self._end("lost", f"HAL no longer gives {listed(missing, 3)}")
        else:
            getattr(self, f"_{self.phase}")(now, values)

    def fail(self, reason: str) -> tuple[str, ...]:
        """End as lost for a reason; returns the sentence on it."""
        self._end("lost", reason)
        return (self.text,)

    def close(self) -> None:
        """End: the heartbeat stops, and the controller goes to its safe state."""
        if self.phase not in ("refused", "lost"):
            safe = "the controller goes to fault, its lower limit of the feed, until it is reset"
            self._go("lost", math.nan, f"ended with the program: without its heartbeat {safe}")
        self.link.close()

    def facts(self) -> dict[str, object]:
        """JSON-able description for every view."""
        c, loop, (_, values) = self.controller, self.controller.loop, self.link.values() or (math.nan, {})

        def range_of(value: Value | None, name: str, ends: tuple[float, float], unit: str) -> dict[str, object]:
            return {"value": value, "wanted": self._wanted[name], "low": ends[0], "high": ends[1], "unit": unit}

        flags = ("fault", "overload", "worn", "cut")
        return {
            "phase": self.phase, "text": self.text, "trip_seconds": None if math.isnan(self.trip) else self.trip,
            "reference": range_of(values.get("fm.pid.command"), "reference", c.reference, loop.unit_load),
            "feed_limit": range_of(_feed(values.get("fm.limit.max"), loop), "high", c.high, loop.unit_feed),
            "load": values.get("fm-filtered"), "feed": _feed(values.get("fm-feed"), loop),
            **{name: bool(values.get(f"fm-{name}")) for name in flags},
        }  # fmt: skip

    def _go(self, phase: Phase, now: float, text: str) -> None:
        self.phase, self._since, self.text = phase, now, text

    def _end(self, phase: Phase, reason: str) -> None:
        self._go(phase, math.nan, f"{reason}. Nothing more is written; start again to write.")
        self.link.close()

    def _checking(self, now: float, values: Mapping[str, Value]) -> None:
        wrong = differences(self.controller, values)
        if wrong:
            return self._end("refused", f"HAL does not hold the controller of this file: {'; '.join(wrong[:5])}")
        return self._wait()

    def _wait(self, reason: str = "") -> None:
        self._go(
            "waiting", math.nan,
            f"{reason}waiting to see the controller trip: enable it, start the spindle, stay out of the cut and clear "
            "its fault (fm-reset)",
        )  # fmt: skip

    def _waiting(self, now: float, values: Mapping[str, Value]) -> None:
        ready = values["fm-armed"] and not any(
            values[name] for name in ("fm-fault", "fm-overload", "fm-dead", "fm-cut")
        )
        if not ready:
            self._since = math.nan
        elif math.isnan(self._since):
            self._since = now
        elif now - self._since >= max(STEADY, 2 * self.controller.heartbeat):
            self._go("tripping", now, "the heartbeat is stopped; the controller must go to fault")

    def _tripping(self, now: float, values: Mapping[str, Value]) -> None:
        after, most = now - self._since, self.controller.heartbeat + TRIP_MARGIN
        if values["fm-fault"] and values["fm-dead"]:
            self.trip = after
            self._go("latched", now, f"the controller tripped {after:.2f} s after its heartbeat; the fault must stay")
        elif values["fm-fault"] or values["fm-cut"] or not values["fm-armed"]:
            self._wait("a cut, another fault, or the end of the enable came before the trip; ")
        elif after > most:
            self._end("refused", f"the controller did not trip within {most:.2f} s of its heartbeat's end")

    def _latched(self, now: float, values: Mapping[str, Value]) -> None:
        if values["fm-fault"]:
            if not self._latch_seen and not values["fm-dead"] and now - self._since >= STEADY:
                self._latch_seen = True
                self.text = "the fault is latched; the operator's reset (fm-reset) begins writing"
        elif self._latch_seen:
            self._written, self._written_at = {pin: values[pin] for pin in CHANGED}, now
            proof = f"proved: tripped after {self.trip:.2f} s, latched, reset"
            self._go("writing", now, f"{proof}; writing within the limits")
        else:
            self._trials += 1
            if self._trials >= TRIALS:
                return self._end("refused", f"the fault went {TRIALS} times before it could be seen to be latched")
            self._wait("the fault was cleared before it could be seen to be latched; ")
        return None

    def _writing(self, now: float, values: Mapping[str, Value]) -> None:
        if reason := _stopped(values):
            return self._go("suspended", now, f"writing is suspended: {reason}")
        changed = [pin for pin, value in self._written.items() if not is_same(values.get(pin), value)]
        if changed and now - self._written_at > SILENT:
            pin = changed[0]
            was = self._written[pin]
            return self._end("refused", f"{pin} is {values.get(pin)}, but {was:.6g} before; it was changed elsewhere")
        return self._write(now, values)

    def _write(self, now: float, values: Mapping[str, Value]) -> None:
        wanted = self.controller.pins(**self._wanted)
        if values["fm-cut"]:  # the feed limit is five settings, which a closed loop would meet one by one
            wanted = {"fm.pid.command": wanted["fm.pid.command"]}
        new = {
            pin: wanted[pin]
            for pin in write_order(wanted, self._written)
            if not is_same(self._written[pin], wanted[pin])
        }
        if new:
            self._written |= new
            self._written_at = now
            self.link.send(True, new)
            loop = self.controller.loop
            self.text = (
                f"written: reference {self._wanted['reference']:.6g} {loop.unit_load}"
                + (f", feed limit {self._wanted['high']:.6g} {loop.unit_feed}" if "fm.limit.max" in new else "")
            )  # fmt: skip

    def _suspended(self, now: float, values: Mapping[str, Value]) -> None:
        if not _stopped(values):
            self._go("writing", now, "the controller runs again; writing within the limits")


def _stopped(values: Mapping[str, Value]) -> str:
    for name, text in (("fm-fault", "the controller is in fault"), ("fm-overload", "the controller has an overload")):
        if values[name]:
            return f"{text}; the operator clears it (fm-reset)"
    return "" if values["fm-enable"] else "the controller is switched off (fm-enable)"


def _feed(override: Value | None, loop: "LoadLoop") -> float | None:
    return None if override is None else override * loop.feed_programmed
