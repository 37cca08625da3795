"""Both ends of the pipe between ``fitmodels watch --write`` and the HAL of a LinuxCNC machine.

As a script, run by the machine's own python3, it is a HAL component with a heartbeat that writes pins within limits; it
imports nothing but Python and LinuxCNC's ``hal``. As a module it holds the other end: `HalLink` and `Runner`. Commands
are JSON lines on the script's standard input; the first one configures it:

    {"pins": [...], "limits": {"fm.pid.command": [0.18, 0.24]}, "heartbeat": 0.2, "deadline": 0.5}
    {"beat": true}
    {"beat": true, "set": {"fm.pid.command": 0.22}}

Each ``beat`` keeps the heartbeat going for ``deadline`` s. Values of the pins are JSON lines on its standard output, 20
a second. It ends with its input; the heartbeat then stays as it is, which the controller takes for dead.
"""

from __future__ import annotations  # the machine's Python may be 3.9

import json
import math
import os
import random
import subprocess
import sys
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from typing import TextIO

Hal = Any  # the module hal of LinuxCNC, which has no types
PERIOD = 0.05  # s between two reports, and between two commands
DEADLINE = 0.5  # s that the heartbeat goes on after the last command
STALL = 2.0  # s without a sign of the main loop, after which no more commands are sent
SIGNAL, SOURCE = "fm-heartbeat", "fm-source-heartbeat"
NAME = "fitmodels-watch-"


class Refused(Exception):  # noqa: N818  it ends the script in a sentence
    """Reason why the script cannot run here."""


class Writer:
    """Values that may be written: those of the configuration, within its limits.

    Parameters
    ----------
    hal : module
        ``hal`` of LinuxCNC, or an object with its ``set_p``.
    limits : mapping
        Pin -> (lowest, highest).
    """

    def __init__(self, hal: Hal, limits: Mapping[str, tuple[float, float]]) -> None:
        self._hal, self._limits = hal, limits

    def write(self, values: Mapping[str, Any]) -> None:
        """Write every value, or none where one is outside of its limits (ValueError)."""
        for pin, value in values.items():
            low, high = self._limits.get(pin, (1.0, 0.0))
            if not (isinstance(value, float) and math.isfinite(value) and low <= value <= high):
                raise ValueError(f"{pin} = {value!r} is outside of {low!r} to {high!r}: nothing was written")
        for pin, value in values.items():
            self._hal.set_p(pin, repr(value))


class Beat:
    """A heartbeat that lives while commands arrive, and while the load's own heartbeat does where there is one.

    Examples
    --------
    >>> beat = Beat(deadline=0.5, heartbeat=0.2)
    >>> beat.command(0.0, True)
    >>> [beat.step(now, False) for now in (0.1, 0.12, 0.2, 0.6, 0.7)]
    [True, True, False, False, False]
    """

    def __init__(self, deadline: float, heartbeat: float, follows: bool = False) -> None:
        self._deadline, self._heartbeat, self._follows = deadline, heartbeat, follows
        self._command = self._source_change = -math.inf
        self._source: bool | None = None
        self._changed = -math.inf
        self.value = False

    def command(self, now: float, on: bool) -> None:
        """Take a command in: on keeps the heartbeat going, off stops it."""
        self._command = now if on else -math.inf

    def step(self, now: float, source: bool) -> bool:
        """Value of the heartbeat now: it changes five times in ``heartbeat`` while all is alive."""
        if self._source is not None and source != self._source:
            self._source_change = now
        self._source = source
        alive = now - self._command <= self._deadline
        if self._follows and now - self._source_change > self._heartbeat:
            alive = False
        if alive and now - self._changed >= self._heartbeat / 5:
            self.value, self._changed = not self.value, now
        return self.value


def connect(hal: Hal) -> tuple[Any, bool]:
    """Component with its pins on the controller's signals, and whether the load has a heartbeat of its own.

    Raises
    ------
    Refused
        HAL has no controller, or its heartbeat has another writer.
    """
    name = f"{NAME}{os.getpid()}"
    component = hal.component(name)  # hal answers nothing before there is one
    component.newpin("heartbeat", hal.HAL_BIT, hal.HAL_OUT)
    component.newpin("source-heartbeat", hal.HAL_BIT, hal.HAL_IN)
    component.ready()
    signals = {each["NAME"]: each["DRIVER"] or "" for each in hal.get_info_signals()}
    if SIGNAL not in signals:
        raise Refused(f"HAL has no signal {SIGNAL}; load the HAL export of the parameter file first")
    driver = signals[SIGNAL]
    if driver.startswith(NAME) and not _lives(driver[len(NAME) :].split(".")[0]):
        hal.disconnect(driver)
    elif driver:
        raise Refused(f"{SIGNAL} is written by {driver}; connect that pin to a signal {SOURCE} instead")
    hal.connect(f"{name}.heartbeat", SIGNAL)
    follows = bool(signals.get(SOURCE))
    if follows:
        hal.connect(f"{name}.source-heartbeat", SOURCE)
    return component, follows


def _lives(pid: str) -> bool:
    try:
        os.kill(int(pid), 0)
    except PermissionError:
        return True
    except (OSError, ValueError):
        return False
    return True


class Program:
    """The component between two pipes."""

    def __init__(self, hal: Hal, lines: Iterator[str], out: TextIO) -> None:
        self._hal, self._lines, self._out = hal, lines, out
        config = json.loads(next(lines, "{}"))
        self._pins, self._heartbeat = config["pins"], config["heartbeat"]
        self._component, follows = connect(hal)
        self._beat = Beat(config["deadline"], self._heartbeat, follows)
        self._writer = Writer(hal, config["limits"])
        self._ended = threading.Event()
        self._send({"connected": True, "source_heartbeat": follows})

    def _send(self, answer: dict[str, Any]) -> None:
        self._out.write(json.dumps(answer) + "\n")
        self._out.flush()

    def _read(self) -> None:
        """Take commands in until the input ends."""
        try:
            for line in self._lines:
                command = json.loads(line)
                self._beat.command(time.monotonic(), command.get("beat") is True)
                try:
                    self._writer.write(command.get("set", {}))
                except (ValueError, RuntimeError, self._hal.error) as error:
                    self._send({"refused": str(error)})
        except (ValueError, AttributeError, OSError):
            pass  # a command that was cut off: the program ends, and with it the heartbeat
        finally:
            self._ended.set()

    def _values(self) -> dict[str, Any]:
        """Value of each pin or signal; absent ones are left out."""
        out = {}
        for pin in self._pins:
            try:
                out[pin] = self._hal.get_value(pin)
            except (RuntimeError, self._hal.error):
                continue
        return out

    def run(self) -> None:
        """Beat and report until the input ends."""
        threading.Thread(target=self._read, daemon=True).start()
        next_report, rng = 0.0, random.Random()  # noqa: S311  times, no secret
        # The load's heartbeat may change in each servo period: seen at irregular times it never looks still.
        while not self._ended.wait(rng.uniform(0.003, 0.007)):
            now = time.monotonic()
            self._component["heartbeat"] = self._beat.step(now, self._component["source-heartbeat"])
            if now >= next_report:
                next_report = now + PERIOD
                self._send({"values": self._values()})


def main() -> int:
    """Run in the machine's Python; the last line says why it ended early."""
    try:
        import hal  # type: ignore[import-not-found, unused-ignore]
    except ImportError as error:
        sys.stdout.write(json.dumps({"error": f"this Python has no LinuxCNC: {error}"}) + "\n")
        return 1
    try:
        Program(hal, iter(sys.stdin.readline, ""), sys.stdout).run()
    except (Refused, RuntimeError, hal.error, ValueError, KeyError, OSError) as error:
        sys.stdout.write(json.dumps({"error": str(error)}) + "\n")
        return 1
    return 0


class Link(Protocol):
    """Connection with a machine."""

    def values(self) -> tuple[float, Mapping[str, Any]] | None:
        """Time of the last values in s (monotonic clock), and value by pin or signal; None before the first."""

    def problem(self) -> str:
        """Reason why the connection ended; empty while it lasts."""

    def send(self, beat: bool, pins: Mapping[str, float]) -> None:
        """Keep the heartbeat going, or stop it, and write pins."""

    def close(self) -> None:
        """End the connection, and the heartbeat with it."""


class HalLink:
    """The script in the machine's Python, and the last values that it reported.

    Parameters
    ----------
    pins : iterable of str
        Pins and signals to read.
    limits : mapping
        Lowest and highest value of each pin that may be written.
    heartbeat : float
        s after which the controller takes its heartbeat for dead.
    python : str
        Python of LinuxCNC.
    """

    def __init__(
        self,
        pins: Iterable[str],
        limits: Mapping[str, tuple[float, float]],
        heartbeat: float,
        python: str = "/usr/bin/python3",
    ) -> None:
        self._problem = ""
        self._last: tuple[float, dict[str, Any]] | None = None
        self._process: subprocess.Popen[str] | None = None
        try:
            self._process = subprocess.Popen(  # noqa: S603  the user names the program
                [python, "-u", __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                text=True, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            self._problem = f"{python} does not run: {error.strerror}; name the machine's Python"
            return
        config = {"pins": list(pins), "limits": dict(limits), "heartbeat": heartbeat, "deadline": DEADLINE}
        self._put(config)
        self._reader = threading.Thread(target=self._read, args=(self._process.stdout,), daemon=True)
        self._reader.start()

    def values(self) -> tuple[float, dict[str, Any]] | None:
        """Time of the last values in s (monotonic clock), and value by pin or signal; None before the first."""
        return self._last

    def problem(self) -> str:
        """Reason why the connection ended; empty while it lasts."""
        return self._problem

    def send(self, beat: bool, pins: Mapping[str, float]) -> None:
        """Keep the heartbeat going, or stop it, and write pins."""
        self._put({"beat": beat, "set": dict(pins)} if pins else {"beat": beat})

    def close(self) -> None:
        """End the script, and the heartbeat with it."""
        process, self._process = self._process, None
        if process is not None and process.stdin is not None:
            try:
                process.stdin.close()
                process.wait(2.0)
            except (OSError, subprocess.TimeoutExpired):
                process.kill()
                process.wait()
            self._reader.join(2.0)

    def _put(self, message: dict[str, Any]) -> None:
        if self._process is None or self._process.stdin is None:
            return
        try:
            self._process.stdin.write(json.dumps(message) + "\n")
            self._process.stdin.flush()
        except (OSError, ValueError):
            self._problem = self._problem or "the script in the machine's Python ended"

    def _read(self, lines: TextIO) -> None:
        try:
            with lines:
                for line in lines:
                    self._take(json.loads(line))
        except (ValueError, OSError):
            pass
        self._problem = self._problem or "the script in the machine's Python ended"

    def _take(self, answer: dict[str, Any]) -> None:
        if "values" in answer:
            self._last = (time.monotonic(), answer["values"])
        elif "connected" not in answer:
            self._problem = self._problem or answer.get("error") or answer.get("refused") or "unknown answer"


class Session(Protocol):
    """The object that `Runner` steps: `live.control.ControlSession`."""

    def step(self, now: float) -> tuple[str, ...]:
        """Advance to a time, s by the monotonic clock; returns sentences on what changed."""

    def fail(self, reason: str) -> tuple[str, ...]:
        """End for a reason; returns sentences on it."""

    def facts(self) -> dict[str, object]:
        """JSON-able description."""

    def close(self) -> None:
        """End."""


Stepped = TypeVar("Stepped", bound=Session)


class Runner(Generic[Stepped]):
    """A thread that steps a session 20 times a second while the main loop gives signs of life.

    Where the main loop hangs for `STALL` s, the session is not stepped, the heartbeat ends and the controller trips.
    Any error of a step ends the session.
    """

    def __init__(self, session: Stepped) -> None:
        self.session = session
        self._texts: deque[str] = deque()
        self._alive, self._ended = time.monotonic(), threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def take(self) -> tuple[str, ...]:
        """Sign of life of the main loop; returns what changed since the last call, in sentences."""
        self._alive = time.monotonic()
        return tuple(self._texts.popleft() for _ in range(len(self._texts)))

    def close(self) -> None:
        """End; the controller trips by its heartbeat."""
        self._ended.set()
        self._thread.join(2.0)
        self.session.close()

    def _run(self) -> None:
        while not self._ended.wait(PERIOD):
            now = time.monotonic()
            if now - self._alive > STALL:
                continue
            try:
                self._texts.extend(self.session.step(now))
            except Exception as error:
                name = type(error).__name__
                self._texts.extend(self.session.fail(f"the program has an error of its own, {name}: {error}"))
                return


if __name__ == "__main__":
    sys.exit(main())
