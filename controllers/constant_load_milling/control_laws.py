"""The two control laws of constant load, from load error to feed override, and the settings of a file for them.

Position form, as LinuxCNC's HAL runs it: pid about the limits' middle, sum2, mux2, limit2. Incremental form, as Tai,
Tsai & Li 2023 word eq. 16:

    u_k = u_(k-1) + Kp e_k + Ki sum(e)

"U0 is the last control signal" makes Kp an integral gain and Ki one of the integral. The limits are inside the
recursion, so it does not wind up; the sum of Ki holds while a limit is active and the error pushes further.
"""

from collections import deque
from typing import TYPE_CHECKING

from ...core.errors import GateError, ParameterError

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.exports.loop import LoadLoop
    from ...parameters.sections.load_line import LoadLineSection


def line_of(pf: "ParameterFile") -> "LoadLineSection":
    """Settings of milling at constant load.

    Raises
    ------
    ParameterError
        The file has none.
    """
    if pf.load_line is None:
        raise ParameterError(
            "the file has no settings of milling at constant load; set them with `fitmodels settings params.json`."
        )
    return pf.load_line


def loop_of(pf: "ParameterFile") -> "LoadLoop":
    """Gains, limits and settings.

    Raises
    ------
    GateError
        The file has no gains or no settings of the loop, or fails the check.
    """
    from ...parameters.exports.loop import loop_settings
    from ...parameters.exports.names import plain
    from ...parameters.exports.view import require_check

    require_check(pf)
    found = loop_settings(pf, own_form=True)
    if found.loop is None:
        raise GateError(f"the parameter file of {plain(pf.identity.tool)} on {plain(pf.identity.work)} {found.lacking}")
    return found.loop


class PositionLaw:
    """PI in position form with clamping; outside the cut, without a valid load or switched off, the override is 1.

    Attributes
    ----------
    command : float
        Feed override in force. A limiter starts at 0, as LinuxCNC's does, and ramps.
    limited : int
        1 or -1 while the PI is clipped at its upper or lower limit, else 0.
    """

    __slots__ = ("_back_off", "_falling", "_half", "_high", "_i", "_kept", "_low", "_middle", "_p", "_recover", "_sum",
                 "_time", "command", "limited")  # fmt: skip

    def __init__(self, loop: "LoadLoop", command: float) -> None:
        self.command, self.limited = command, 0
        self._sum, self._falling, self._time = 0.0, False, loop.sample_time
        self._low, self._high, self._p, self._i = loop.low, max(loop.high, 1.0), loop.p, loop.i  # properties take time
        self._middle, self._half = (loop.low + loop.high) / 2, (loop.high - loop.low) / 2
        self._back_off, self._recover = loop.back_off * loop.sample_time, loop.recover * loop.sample_time
        average = loop.average if loop.average_of == "command" else 1
        self._kept = deque([1.0] * average, maxlen=average)

    def closed(self, error: float) -> float:
        """In the cut; pid holds its sum while its output is clipped and the error pushes further."""
        if error * self.limited <= 0:
            self._sum += error * self._time
        half = self._half
        out = 1.0 - self._middle + self._p * error + self._i * self._sum
        self.limited = (out > half) - (out < -half)
        return self._limited(self._middle + min(max(out, -half), half))

    def outside(self) -> float:
        """Out of the cut: the programmed feed."""
        self._sum, self.limited = 0.0, 0
        return self._limited(1.0)

    invalid = off = outside

    def _limited(self, target: float) -> float:
        """Moving average, limits, then a rate limit that differs downwards and upwards."""
        kept, last = self._kept, self.command
        if len(kept) > 1:
            kept.append(target)
            target = sum(kept) / len(kept)
        if target != last:
            self._falling = target < last
        most = self._back_off if self._falling else self._recover
        target = min(max(target, self._low), self._high)
        self.command = command = min(max(target, last - most), last + most)
        return command


class IncrementalLaw:
    """Eq. 16 inside its feed limits, the sent command a moving average of u.

    Out of the cut u keeps its last value; without a valid load it goes to the lower limit, where the load
    stays below the reference until the tool is worn; switched off it goes to the programmed feed.

    Attributes
    ----------
    command : float
        Feed override in force.
    limited : int
        1 or -1 while u is clipped at its upper or lower limit, else 0.
    """

    __slots__ = ("_back_off", "_high", "_i", "_kept", "_last", "_low", "_p", "_recover", "_sum", "command", "limited")

    def __init__(self, loop: "LoadLoop", command: float) -> None:
        self._low, self._high, self._p, self._i = loop.low, loop.high, loop.p, loop.i * loop.sample_time
        self._back_off, self._recover = loop.back_off * loop.sample_time, loop.recover * loop.sample_time
        self.command = self._last = min(max(command, loop.low), loop.high)
        self._sum, self.limited = 0.0, 0
        average = loop.average if loop.average_of == "command" else 1
        self._kept = deque([self._last] * average, maxlen=average)

    def closed(self, error: float) -> float:
        """In the cut."""
        if error * self.limited <= 0:
            self._sum += error
        unlimited = self._last + self._p * error + self._i * self._sum
        return self._limited(unlimited, self._low, self._high)

    def outside(self) -> float:
        """Out of the cut: the last command is held."""
        self._sum = 0.0
        return self._limited(self._last, self._low, self._high)

    def invalid(self) -> float:
        """The load is unknown or stuck: the lower limit."""
        self._sum = 0.0
        return self._limited(self._low, self._low, self._high)

    def off(self) -> float:
        """Switched off: the programmed feed."""
        self._sum = 0.0
        return self._limited(1.0, self._low, max(self._high, 1.0))

    def _limited(self, unlimited: float, low: float, high: float) -> float:
        last, kept = self._last, self._kept
        u = min(max(unlimited, low, last - self._back_off), high, last + self._recover)
        self.limited = (unlimited > high) - (unlimited < low)
        self._last = u
        if len(kept) == 1:
            self.command = u
        else:
            kept.append(u)
            self.command = min(max(sum(kept) / len(kept), low), high)  # a mean rounds
        return self.command
