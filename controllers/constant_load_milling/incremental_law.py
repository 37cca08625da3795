"""From load error to feed override as Tai, Tsai & Li 2023 word eq. 16: the last command, Kp e and Ki times the sum.

    u_k = u_(k-1) + Kp e_k + Ki sum(e)

"U0 is the last control signal" makes Kp an integral gain and Ki one of the integral. Its limits are in the recursion,
so nothing winds up behind them; the sum of Ki holds while a limit does and the error pushes further.
"""

from collections import deque
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...parameters.export.loop import LoadLoop


class IncrementalLaw:
    """Eq. 16 inside its feed limits, the sent command a moving average of u.

    Out of the cut u stays what it was last; blind, with a load that is unknown or stuck, it goes to the lower limit,
    where a tool draws the reference at most until it is worn; switched off to the programme's feed.

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

    def held(self, error: float) -> float:
        """In the cut."""
        if error * self.limited <= 0:
            self._sum += error
        asked = self._last + self._p * error + self._i * self._sum
        return self._sent(asked, self._low, self._high)

    def outside(self) -> float:
        """Out of the cut: the last command of it."""
        self._sum = 0.0
        return self._sent(self._last, self._low, self._high)

    def blind(self) -> float:
        """The load is unknown or stuck: the lower limit."""
        self._sum = 0.0
        return self._sent(self._low, self._low, self._high)

    def off(self) -> float:
        """Switched off: the programme's feed."""
        self._sum = 0.0
        return self._sent(1.0, self._low, max(self._high, 1.0))

    def _sent(self, asked: float, low: float, high: float) -> float:
        last, kept = self._last, self._kept
        u = min(max(asked, low, last - self._back_off), high, last + self._recover)
        self.limited = (asked > high) - (asked < low)
        self._last = u
        if len(kept) == 1:
            self.command = u
        else:
            kept.append(u)
            self.command = min(max(sum(kept) / len(kept), low), high)  # a mean rounds
        return self.command
