"""LinuxCNC as a source: a script in the machine's own Python reads the pins of HAL and sends JSON lines.

Loads are named by their pins (``--map P=PIN``). Spindle speed and feed are LinuxCNC's own, unless other pins are named;
a rapid is no feed, and the number of the tool in the spindle names the tool. Nothing is written to HAL.
"""

import json
import queue
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, Final, Self

from ...core.errors import DataError, UsageError
from ..samples import Notice, Sample
from .clock import arrival_time
from .options import SourceOptions
from .rows import Lines

PINS: Final = {"n": "spindle.0.speed-out-abs", "fm": "motion.feed-mm-per-minute"}
UNITS: Final = {"n": "1/min", "fm": "mm/min"}
RATE: Final = 50.0  # readings a second
IDLE: Final = 0.5  # s without a reading, after which the monitor gets its turn
BEGIN: Final = 10.0  # s for the first reading
AGAIN: Final = 2.0  # s between two attempts to read a machine that was lost
SCRIPT: Final = Path(__file__).resolve().parent.parent / "linuxcnc_reader.py"


class LinuxCnc:
    """Readings of the LinuxCNC that runs on this machine.

    Parameters
    ----------
    options : SourceOptions

    Raises
    ------
    UsageError
        No pin is named for any load, or HAL does not have a named one.
    DataError
        LinuxCNC does not run here, or its Python is another one.
    """

    def __init__(self, options: SourceOptions) -> None:
        self._options = options
        self._pins = _pins(options)
        own = {symbol: UNITS[symbol] for symbol, pin in self._pins.items() if pin == PINS.get(symbol)}
        known = replace(
            options, map={**options.map, **self._pins}, units={"time": "s", **own, **options.units}, rate=None
        )
        self._lines = Lines("linuxcnc", known)
        self._answers: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._process: subprocess.Popen[str] | None = None
        self._lost = ""
        self._start()
        self._items = self._read(self._begin())

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Sample | Notice:
        return next(self._items)

    def close(self) -> None:
        """End the script."""
        self._stop()

    def _read(self, line: str | None) -> Iterator[Sample | Notice]:
        """Samples and notices; a machine that was lost is tried again every 2 s."""
        last = time.monotonic()
        while True:
            if line is None:
                yield from self._ended()
            else:
                last = last if "halted" in line[:12] else time.monotonic()
                yield from self._taken(line)
            while True:
                try:
                    line = self._answers.get(timeout=IDLE)
                    break
                except queue.Empty:
                    yield from self._silent(time.monotonic() - last)

    def _start(self) -> None:
        """Start the script; what it answers goes to a queue."""
        python = self._options.python
        try:
            process = subprocess.Popen(  # noqa: S603  the user names the program
                [python, "-u", str(SCRIPT)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL, text=True, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            raise DataError(f"{python} does not run: {error.strerror}; name the machine's Python: --python.") from None
        self._process = process
        assert process.stdin is not None  # noqa: S101  two pipes were asked for
        assert process.stdout is not None  # noqa: S101
        try:
            own = [name for name in ("state", "tool") if name not in self._options.map]
            asked = {"pins": list(self._pins.values()), "own": own, "rate": self._options.rate or RATE}
            process.stdin.write(json.dumps(asked) + "\n")
            process.stdin.flush()
        except OSError:
            pass  # it ended already; its answer says why
        threading.Thread(target=_forward, args=(process.stdout, self._answers), daemon=True).start()

    def _begin(self) -> str:
        """The first answer, a reading."""
        try:
            line = self._answers.get(timeout=BEGIN)
        except queue.Empty:
            line = None
        said = _answer(line)
        if "error" in said or not said:
            self._stop()
            reason = said.get("error", f"no reading within {BEGIN:g} s")
            if "no pin" in str(reason):
                raise UsageError(f"--from linuxcnc: {reason}; `halcmd show pin` lists them.")
            raise DataError(f"--from linuxcnc: {reason}. Start LinuxCNC first; its Python is named by --python.")
        return line or ""

    def _taken(self, line: str) -> Iterator[Sample | Notice]:
        said = _answer(line)
        if "error" in said or "halted" in said:
            reason = said.get("error", "its realtime thread does not run")
            yield from self._loss(f"linuxcnc: {reason}")
            return
        if self._lost:
            self._lost = ""
            yield Notice(time.time(), "connected", "linuxcnc gives readings again")
        yield from self._lines.take(line, arrival_time())

    def _silent(self, seconds: float) -> Iterator[Notice]:
        yield Notice(time.time(), "idle")
        if seconds > self._options.silent:
            yield from self._loss(f"linuxcnc: no reading for {seconds:.1f} s")

    def _ended(self) -> Iterator[Notice]:
        """The script ended: it is started again after a while."""
        yield from self._loss("linuxcnc ended, or the script that reads it")
        self._stop()
        for _ in range(round(AGAIN / IDLE)):
            time.sleep(IDLE)
            yield Notice(time.time(), "idle")
        self._start()

    def _loss(self, text: str) -> Iterator[Notice]:
        if not self._lost:
            self._lost = text
            yield Notice(time.time(), "lost", text)

    def _stop(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        try:
            if process.stdin is not None:
                process.stdin.close()
            process.wait(2.0)
        except (OSError, subprocess.TimeoutExpired):
            process.kill()
            process.wait()


def _pins(options: SourceOptions) -> dict[str, str]:
    """Pin of each quantity."""
    named = {symbol: pin for symbol, pin in options.map.items() if pin != "none"}
    if not any(symbol in options.loads for symbol in named):
        load = next(iter(options.loads), "P")
        raise UsageError(
            f"--from linuxcnc: no pin is named for a load ({', '.join(options.loads)}): give --map {load}=PIN, such as "
            "the current or load of the spindle drive; `halcmd show pin` lists them."
        )
    found = {symbol: pin for symbol, pin in PINS.items() if symbol not in options.map}
    if {"V", "n"} & named.keys():
        found.pop("n", None)
    if {"f", "fm", "fz"} & named.keys():
        found.pop("fm", None)
    return {**found, **named}


def _answer(line: str | None) -> dict[str, Any]:
    try:
        said = json.loads(line or "{}")
    except ValueError:
        return {}
    return said if isinstance(said, dict) else {}


def _forward(lines: IO[str], answers: "queue.SimpleQueue[str | None]") -> None:
    """Put the lines of the script into a queue, None at their end."""
    try:
        with lines:
            for line in lines:
                answers.put(line.rstrip("\n"))
    except (OSError, ValueError):
        pass
    answers.put(None)
