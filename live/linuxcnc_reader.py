"""Readings of a LinuxCNC machine as JSON lines: run by the machine's own python3.

It imports nothing but Python and LinuxCNC's ``hal``, connects no pin and writes none. The first line of its standard
input names the pins, signals or parameters to read and the readings per second; it ends with that input:

    {"pins": ["hm2_5i25.0.spindle.load", "spindle.0.speed-out-abs"], "own": ["state", "tool"], "rate": 50}

Answers: a line of JSON with ``time`` (s since 1970), the value of each pin, ``state`` and ``tool`` for each reading; a
line with ``error`` where it cannot begin; a line with ``halted`` while the realtime part of LinuxCNC does not run.
"""

from __future__ import annotations  # the machine's Python may be 3.9

import json
import os
import sys
import threading
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from typing import TextIO

Hal = Any  # the module hal of LinuxCNC, which has no types
STALE = 1.0  # s without a change of the times of the realtime thread
BEATS = ("servo-thread.time", "motion.servo.last-period", "motion-controller.time")
FEED = (2, 3)  # motion.motion-type of straight and of circular feed
NAME = "fitmodels-reader-"


class Reader:
    """Values of pins, and whether the realtime thread that drives them runs.

    Parameters
    ----------
    hal : module
        ``hal`` of LinuxCNC, or an object with its ``get_value``.
    pins : list of str
        Pins, signals or parameters.
    own : list of str
        ``"state"`` and ``"tool"``, where they are those of LinuxCNC.
    """

    def __init__(self, hal: Hal, pins: Sequence[str], own: Sequence[str] = ()) -> None:
        self._hal, self._pins, self._own = hal, pins, own
        self._beats = [pin for pin in BEATS if self.get(pin) is not None]
        self._last: list[Any] | None = None
        self._changed = float("-inf")

    def get(self, name: str) -> bool | float | None:
        """Value of a pin, signal or parameter; None where there is none."""
        try:
            value: bool | float = self._hal.get_value(name)
        except (RuntimeError, self._hal.error):
            return None
        return value

    def missing(self) -> list[str]:
        """Pins that HAL does not have."""
        return [pin for pin in self._pins if self.get(pin) is None]

    def halted(self, now: float) -> bool:
        """Whether the realtime thread has not run for a moment; False where HAL does not show that."""
        beats = [self.get(pin) for pin in self._beats]
        if beats != self._last:
            self._last, self._changed = beats, now
        return bool(self._beats) and now - self._changed > STALE

    def state(self) -> str | None:
        """State that the machine reports: off, idle, feed; None where it does not."""
        on, motion = self.get("spindle.0.on"), self.get("motion.motion-type")
        if on is None or motion is None:
            return None
        if not on:
            return "off"
        return "feed" if motion in FEED and self.get("motion.current-vel") else "idle"

    def read(self) -> dict[str, Any]:
        """One reading: values of the pins, state and tool."""
        values: dict[str, Any] = {pin: self.get(pin) for pin in self._pins}
        if "state" in self._own:
            values["state"] = self.state()
        if "tool" in self._own and (tool := self.get("iocontrol.0.tool-number")):
            values["tool"] = f"T{tool}"
        return {name: value for name, value in values.items() if value is not None}


def _wait(lines: Iterator[str], ended: threading.Event) -> None:
    """Set an event at the end of the input."""
    for _ in lines:
        pass
    ended.set()


def run(hal: Hal, lines: Iterator[str], out: TextIO) -> int:
    """Report readings until the input ends."""

    def send(answer: dict[str, Any]) -> None:
        out.write(json.dumps(answer) + "\n")
        out.flush()

    asked = json.loads(next(lines, "{}"))
    component = hal.component(f"{NAME}{os.getpid()}")  # hal answers nothing before there is one
    component.ready()
    reader = Reader(hal, asked["pins"], asked["own"])
    missing = reader.missing()
    if missing:
        send({"error": f"HAL has no pin, signal or parameter {', '.join(missing)}"})
        return 1
    ended = threading.Event()
    threading.Thread(target=_wait, args=(lines, ended), daemon=True).start()
    due = time.monotonic()
    while not ended.wait(max(due - time.monotonic(), 0.0)):
        due = max(due + 1 / asked["rate"], time.monotonic() - 0.1)
        if reader.halted(time.monotonic()):
            send({"halted": True})
            due = time.monotonic() + STALE
        else:
            send({"time": time.time(), **reader.read()})
    return 0


def main() -> int:
    """Run in the machine's Python; the last line says why it ended early."""
    try:
        import hal  # type: ignore[import-not-found, unused-ignore]
    except ImportError as error:
        sys.stdout.write(json.dumps({"error": f"this Python has no LinuxCNC: {error}"}) + "\n")
        return 1
    try:
        return run(hal, iter(sys.stdin.readline, ""), sys.stdout)
    except (RuntimeError, hal.error, ValueError, KeyError, OSError) as error:
        sys.stdout.write(json.dumps({"error": f"LinuxCNC does not run here, or HAL refuses: {error}"}) + "\n")
        return 1


if __name__ == "__main__":
    sys.exit(main())
