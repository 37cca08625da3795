"""The controller as it runs, a sample at a time: form, limits, anti-windup, and entry into and exit from the cut."""

from collections import deque

from .gains import PiGains

_WEIGHTS = {"backward": (1.0, 0.0), "forward": (0.0, 1.0), "trapezoidal": (0.5, 0.5)}


class Controller:
    """A PI with its filters, limits and memory.

    Each ``step`` takes a reference and a measurement and returns the command that is sent (before the delay).

    Parameters
    ----------
    gains : PiGains
    idle : float
        Command outside the cut, unit_u; limits and rate hold there too.
    quantum : float
        Step to which the command is rounded when it is sent, unit_u; 0 for none.
    last : float
        Command that was sent before the first sample, unit_u.

    Attributes
    ----------
    limited : int
        1 while a limit or the rate holds the command down, -1 while it holds it up, else 0.

    Examples
    --------
    >>> pi = Controller(PiGains(2.0, 10.0, 0.1, high=3.0))
    >>> [pi.step(1.0, y) for y in (0.0, 0.0, 1.0)]
    [3.0, 3.0, 2.0]
    """

    def __init__(self, gains: PiGains, idle: float = 0.0, quantum: float = 0.0, last: float = 0.0) -> None:
        self.gains, self.idle, self.quantum = gains, idle, quantum
        above, below = gains.feedback
        self.gain, self.hold = (float(above.sum()), -float(below[1])) if gains.filter_time else (1.0, 0.0)
        length = {name: gains.average if gains.average_of == name else 1 for name in ("measurement", "command")}
        self.seen = deque([0.0] * length["measurement"], length["measurement"])
        self.sent = deque([last] * length["command"], length["command"])
        self.filtered = 0.0
        self.kp, self.ki = gains.kp, gains.ki_per_sample
        self.now, self.before = _WEIGHTS[gains.integration]
        self.tracking = min(1.0, gains.sample_time / (gains.tracking_time or abs(gains.ti) or gains.sample_time))
        self.total, self.error = 0.0, 0.0
        self.asked = self.last = last
        self.limited = 0
        self.cutting = True

    def step(self, reference: float, measurement: float, engaged: bool = True) -> float:
        """One sample; outside the cut the command is ``idle``, and back in it goes on from the last one sent."""
        error = reference - self._see(measurement)
        if not engaged:
            self.asked = self.idle
        elif not self.cutting:
            self._enter(error)
        else:
            self.asked = self._ask(error)
        self.cutting, self.error = engaged, error
        return self._send(engaged)

    def _see(self, measurement: float) -> float:
        self.seen.append(measurement)
        mean = sum(self.seen) / len(self.seen)
        self.filtered = self.gain * mean + self.hold * self.filtered
        return self.filtered

    def _enter(self, error: float) -> None:
        """Memory such that the first command in the cut is the last one before it."""
        self.asked = self.last
        self.total = self.last - self.kp * error if self.gains.form == "position" else 0.0

    def _ask(self, error: float) -> float:
        change = self.ki * (self.now * error + self.before * self.error)
        base = self.asked if self.gains.anti_windup == "none" else self.last
        if self.gains.form == "incremental":
            return base + self.kp * (error - self.error) + change
        if not (self.gains.anti_windup == "clamping" and change * self.limited > 0):
            self.total += change
        return self.kp * error + self.total + (base if self.gains.form == "incremental_sum" else 0.0)

    def _send(self, engaged: bool) -> float:
        """Limits, then the anti-windup that looks at them, then average and rounding."""
        g, u = self.gains, self.asked
        if g.rate is not None:
            most = g.rate * g.sample_time
            u = min(max(u, self.last - most), self.last + most)
        if g.high is not None:
            u = min(u, g.high)
        if g.low is not None:
            u = max(u, g.low)
        self.limited = (self.asked > u) - (self.asked < u)
        if engaged and g.anti_windup == "back_calculation":
            self.total += self.tracking * (u - self.asked)
        self.last = u
        self.sent.append(u)
        mean = sum(self.sent) / len(self.sent)
        return round(mean / self.quantum) * self.quantum if self.quantum else mean
