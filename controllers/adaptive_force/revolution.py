"""What the law is fed: force and F_d averaged over the same revolution, so that the teeth drop out."""

from collections import deque
from dataclasses import dataclass, field


@dataclass(slots=True)
class Revolution:
    """The last ``samples`` steps of force, F_d and F_d', as means and as their rates of change.

    The mean is that of the straight lines between the samples, so that its rate is exactly what came in less what went
    out, over the time: a ripple with a whole number of periods in it is gone from both.

    Attributes
    ----------
    samples : int
        Steps of the law in a revolution; 1 feeds the law with the force as it comes.
    step_time : float
        s.

    Examples
    --------
    >>> last = Revolution(samples=4, step_time=0.005)
    >>> for k in range(6):
    ...     last.push(100.0 + 10 * k, 0.0, 0.0)
    >>> last.full, last.force, last.force_rate
    (True, 130.0, 2000.0)
    """

    samples: int
    step_time: float
    _rows: deque[tuple[float, float, float]] = field(init=False)
    _sums: list[float] = field(init=False)

    def __post_init__(self) -> None:
        self._rows = deque(maxlen=self.samples + 1)
        self._sums = [0.0, 0.0]

    @property
    def full(self) -> bool:
        """Whether a whole revolution is known."""
        return len(self._rows) == self.samples + 1

    def clear(self) -> None:
        """Forget the past."""
        self._rows.clear()
        self._sums = [0.0, 0.0]

    def push(self, force: float, wanted: float, wanted_rate: float) -> None:
        """Take a step's force, F_d and F_d'."""
        rows = self._rows
        if len(rows) == self.samples + 1:
            gone, after = rows[0], rows[1]
            self._sums[0] -= (gone[0] + after[0]) / 2
            self._sums[1] -= (gone[1] + after[1]) / 2
        if rows:
            self._sums[0] += (rows[-1][0] + force) / 2
            self._sums[1] += (rows[-1][1] + wanted) / 2
        rows.append((force, wanted, wanted_rate))

    def want(self, value: float) -> None:
        """Set F_d of the whole revolution to a value, at rest."""
        self._rows = deque(((force, value, 0.0) for force, _, _ in self._rows), maxlen=self.samples + 1)
        self._sums[1] = value * (len(self._rows) - 1)

    @property
    def force(self) -> float:
        """Mean force."""
        return self._sums[0] / self.samples

    @property
    def force_rate(self) -> float:
        """Rate of the mean force, 1/s."""
        return self._rate(0)

    @property
    def wanted(self) -> tuple[float, float, float]:
        """F_d'', F_d', F_d, each as its mean."""
        return self._rate(2), self._rate(1), self._sums[1] / self.samples

    def _rate(self, column: int) -> float:
        return (self._rows[-1][column] - self._rows[0][column]) / (self.samples * self.step_time)
