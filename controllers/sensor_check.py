"""Validity check of a sensor reading, which every controller applies before it uses one."""

from dataclasses import dataclass, field

from ..core.display import Displayable

CREEP = 10.0  # least moves: a fifth of the feed's range where the least move is 2 % of it
KNOWN, UNKNOWN, STUCK = "known", "unknown", "stuck"


@dataclass(slots=True, repr=False)
class SensorCheck(Displayable):
    """Check that a reading is a finite number within its range and not stuck while the command moves.

    A sensor is stuck where ``samples`` readings in a row are equal to the last bit while the command moved by more than
    ``least_move`` in them, or by `CREEP` times as much on one reading, however long that took. A load that is held
    exactly, or a coarse converter, gives equal readings for long: then the command is constant too, or drifts slowly
    with the wear.

    Attributes
    ----------
    low, high : float
        A reading at or beyond these is invalid.
    least_move : float
        Of the command, in its unit; 0 disables the check for a stuck sensor.
    samples : int
    state : str
        ``known``, ``unknown`` or ``stuck``.

    Examples
    --------
    >>> check = SensorCheck(low=-1.0, high=10.0, least_move=0.05, samples=3)
    >>> check.valid(0.2, 1.0), check.valid(float("nan"), 1.0)
    (True, False)
    >>> [check.valid(0.2, command) for command in (1.0, 1.1, 1.2, 1.3)]
    [True, True, True, False]
    """

    low: float
    high: float
    least_move: float = 0.0
    samples: int = 25
    state: str = field(default=KNOWN, init=False)
    _last: float | None = field(default=None, init=False)
    _same: int = field(default=0, init=False)
    _from: float = field(default=0.0, init=False)
    _count: int = field(default=0, init=False)  # equal readings since the last change
    _since: float = field(default=0.0, init=False)

    def valid(self, reading: float, command: float) -> bool:
        """Whether a reading is valid, given the command in force before it."""
        if not self.low < reading < self.high:  # false for NaN too
            self.state = UNKNOWN
        elif reading != self._last or not self.least_move:
            self.state, self._same, self._from, self._count, self._since = KNOWN, 0, command, 0, command
        else:
            self._same, self._count = self._same + 1, self._count + 1
            crept = abs(command - self._since) > CREEP * self.least_move and self._count >= self.samples
            moved = abs(command - self._from) > self.least_move and self._same >= self.samples
            if moved or crept:
                self.state = STUCK  # until the reading changes
            elif self.state != STUCK and self._same >= self.samples:
                self.state, self._same, self._from = KNOWN, 0, command
        self._last = reading
        return self.state == KNOWN
