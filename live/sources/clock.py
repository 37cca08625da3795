"""Times of a source: stamps as s, gaps, and jumps of its clock."""

import re
import time as times
from collections import deque
from datetime import UTC, datetime
from math import isfinite
from statistics import median

from ...core.errors import DataError, UsageError
from ...core.text import shortened
from ...datasets.records.columns import seconds_in
from ..samples import Notice

JUMP = 2.0  # s by which a clock has to go forward without time having passed
LEAST_GAP = 1.0  # s
GAP = 5.0  # steps without a sample
LATE = 1.0  # s: a row that is so much too early is out of order, and left out
MOST_LATE = 10  # rows in a row, after which the clock was set back
_DOTTED = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})[ T]+(\d{1,2})(:\d\d:\d\d(?:[.,]\d+)?)")  # day first
_DAY = re.compile(r"(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)")
_EPOCHS = {"s": (1e9, 1e10, 1.0), "ms": (1e12, 1e13, 1e-3), "us": (1e15, 1e16, 1e-6)}  # since 1970, from 2001 to 2286


def arrival_time() -> float:
    """Time by a clock that is never set and goes on while the computer is suspended, s."""
    boot = getattr(times, "CLOCK_BOOTTIME", None)
    return times.monotonic() if boot is None else times.clock_gettime(boot)


class Clock:
    """Order of the times of a source: finds gaps, and clocks that were set.

    A gap looks like a clock set forward. With a clock of our own beside it, it is none: a reading may arrive late, but
    never earlier than it was taken, so a clock that gains 2 s on the least delay so far was set.

    Examples
    --------
    >>> clock = Clock()
    >>> [clock.take(t)[0] for t in (0.0, 0.02, 0.04, 0.03, 0.06)]
    [True, True, True, False, True]
    >>> clock.take(7.0)[1].kind, clock.take(1.0)[1].kind
    ('gap', 'clock')
    """

    def __init__(self) -> None:
        self.last: float | None = None
        self._steps: deque[float] = deque(maxlen=25)
        self._delay = -float("inf")  # least delay so far, s
        self._late = 0

    def take(self, time: float, arrival: float | None = None) -> tuple[bool, Notice | None]:
        """Whether a reading is to be used, and what happened before it.

        Parameters
        ----------
        time : float
            s, by the clock of the source.
        arrival : float, optional
            s, by a clock that is never set; only where the reading comes as it was taken.
        """
        last, self.last = self.last, time
        least, self._delay = self._delay, -float("inf")
        if arrival is not None:
            self._delay = arrival - time if least == -float("inf") else min(least, arrival - time)
        if last is None:
            return True, None
        step = time - last
        if step < 0:
            return self._back(last, time)
        self._late = 0
        if step > 0:
            limit = self._limit()
            self._steps.append(step)
            if limit is not None and step > limit:
                set_forward = arrival is not None and arrival - time < least - JUMP
                if set_forward:
                    return True, self._set(last, time)
                return True, Notice(times.time(), "gap", f"no samples for {step:.3g} s")
        return True, None

    def _limit(self) -> float | None:
        """Longest step that is no gap, s; None before three steps were seen."""
        if len(self._steps) < 3:
            return None
        return max(LEAST_GAP, GAP * median(self._steps))

    def _back(self, last: float, time: float) -> tuple[bool, Notice | None]:
        if last - time <= LATE and self._late < MOST_LATE:
            self._late += 1
            self.last = last
            return False, None
        return True, self._set(last, time)

    def _set(self, last: float, time: float) -> Notice:
        self._late, self._delay = 0, -float("inf")
        self._steps.clear()
        how = f"back by {last - time:.3g}" if time < last else f"forward by {time - last:.3g}"
        return Notice(
            times.time(), "clock", f"the clock of the source was set {how} s; the time between does not count"
        )


class Stamps:
    """Time stamps of a source as s: numbers with a unit, ISO 8601, ``31.12.2026 8:15:00``, times of day.

    Parameters
    ----------
    unit : str
        As the source or an option names it; empty: numbers since 1970 by their size, other numbers in s where they
        rise by less than 1.
    name : str
        Of the source, for messages.

    Raises
    ------
    UsageError
        The unit is none of time.

    Examples
    --------
    >>> Stamps("ms", "run.csv").seconds(1500.0), Stamps("", "run.csv").seconds("1970-01-01T00:01:00Z")
    (1.5, 60.0)
    """

    def __init__(self, unit: str, name: str) -> None:
        self._name = name
        self._factor: float | None = None
        self._first: float | None = None
        self.assumed = ""
        if unit:
            self._factor = seconds_in(unit)
            if self._factor is None:
                raise UsageError(
                    f"--unit time={shortened(unit)}: that is not a unit of time; known are s, ms, us, min and h."
                )

    def seconds(self, value: float | str | None) -> float | None:
        """Time in s; None where the value is no time.

        Raises
        ------
        UsageError
            Times rise by 1 or more and name no unit.
        """
        if isinstance(value, float):
            seconds = value * (self._factor if self._factor is not None else self._found(value))
            return seconds if isfinite(seconds) else None
        return None if value is None else self._of_text(value.strip())

    def _found(self, value: float) -> float:
        """Factor of a number without a unit, decided from the first two times."""
        for unit, (low, high, factor) in _EPOCHS.items():
            if low <= value < high:
                self._factor, self.assumed = factor, f"time: {unit} since 1970 is assumed"
                return factor
        if self._first is None:
            self._first = value
        elif (step := value - self._first) > 0:
            if step >= 1:
                raise UsageError(
                    f"{self._name}: times rise by {step:g} and name no unit: {step:g} s or {step:g} ms? Give --unit "
                    "time=s or --unit time=ms."
                )
            self._factor, self.assumed = 1.0, "time: s is assumed, the source names no unit"
        return 1.0

    def _of_text(self, text: str) -> float | None:
        if match := _DAY.fullmatch(text):
            self.assumed = "time: of day; it goes back at midnight"
            return 3600.0 * int(match[1]) + 60.0 * int(match[2]) + float(match[3].replace(",", "."))
        if match := _DOTTED.fullmatch(text):
            text = f"{match[3]}-{match[2]:0>2}-{match[1]:0>2} {match[4]:0>2}{match[5]}"
        try:
            stamp = datetime.fromisoformat(text.replace(",", "."))
        except ValueError:
            return None
        if stamp.tzinfo is None:
            self.assumed = "time: without a zone, UTC is assumed"
            stamp = stamp.replace(tzinfo=UTC)
        return stamp.timestamp()


def no_time(name: str) -> DataError:
    """Error for a source whose readings hold no time."""
    return DataError(
        f"{name} has no column of times: name it with --map time=..., or give --rate (Hz) of a recorded run."
    )
