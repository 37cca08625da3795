"""From load error to feed override as LinuxCNC's HAL does it: pid about the limits' middle, sum2, mux2, limit2."""

from collections import deque
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...parameters.export.loop import LoadLoop


class PositionLaw:
    """PI in position form with clamping; outside the cut, blind or switched off, the override is 1.

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

    def held(self, error: float) -> float:
        """In the cut; pid holds its sum while its output is clipped and the error pushes further."""
        if error * self.limited <= 0:
            self._sum += error * self._time
        half = self._half
        out = 1.0 - self._middle + self._p * error + self._i * self._sum
        self.limited = (out > half) - (out < -half)
        return self._sent(self._middle + min(max(out, -half), half))

    def outside(self) -> float:
        """Out of the cut: the programme's feed."""
        self._sum, self.limited = 0.0, 0
        return self._sent(1.0)

    blind = off = outside

    def _sent(self, target: float) -> float:
        """The average, hard limits, then the rate: another one downwards than upwards."""
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
