"""Constant load: a PI on spindle load steers the feed override, inside the cut alone.

Source: Tai, Tsai & Li 2023, IEEE Access, doi 10.1109/ACCESS.2023.3330587, in the arithmetic of LinuxCNC's HAL
components (near, wcomp, lowpass, comp, timedelay, pid, sum2, mux2, limit2), so that this replay is what the HAL export
does. A moving average, which HAL lacks, is taken of the load before the comparator or of the command before its limits,
as the file says.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

from ..datasets.errors import UsageError

if TYPE_CHECKING:
    from ..parameters import ParameterFile
    from ..parameters.export.loop import Loop


@dataclass(slots=True)
class ConstantLoad:
    """The controller of CLM-2023; its command is the feed override, feed over programmed feed.

    Outside the cut, switched off, or with a load that is unknown it does nothing: the override is 1.

    Attributes
    ----------
    loop : Loop
        Gains, limits and settings; see `fitmodels.parameters.export.loop.Loop`.
    enabled : bool
        The operator's switch.
    command : float
        The last command. A limiter starts at 0, as LinuxCNC's does, and ramps.
    cutting : bool
        Whether the loop is closed.
    news : tuple of str
        What changed in the last step: ``cut``, ``air``, ``at low``, ``at high``, ``free``, ``load unknown``,
        ``load known``.

    Examples
    --------
    >>> from fitmodels.parameters.export.loop import Loop
    >>> loop = Loop(
    ...     kp=0.0, ki=8000.0, sample_time=0.02, reference=0.24, feed_low=600.0, feed_high=1000.0,
    ...     feed_programmed=1000.0, unit_load="A", unit_feed="mm/min", filter_time=0.0, engage_at=0.15,
    ...     hysteresis=0.02, engage_after=0.04, disengage_after=0.2, back_off=1.0, recover=0.5, load_low=-1.0,
    ...     load_high=10.0)
    >>> controller = ConstantLoad(loop, command=1.0)
    >>> [round(controller.step(0.3, 0.02), 3) for _ in range(4)]
    [1.0, 0.99, 0.981, 0.971]
    """

    loop: "Loop"
    enabled: bool = True
    command: float = 0.0
    cutting: bool = field(default=False, init=False)
    news: tuple[str, ...] = field(default=(), init=False)
    _filtered: float = field(default=0.0, init=False)
    _load: float = field(default=0.0, init=False)
    _kept: deque[float] = field(init=False)
    _above: bool = field(default=False, init=False)
    _loaded: bool = field(default=False, init=False)
    _waited: int = field(default=0, init=False)
    _sum: float = field(default=0.0, init=False)
    _limited: int = field(default=0, init=False)
    _falling: bool = field(default=False, init=False)
    _known: bool = field(default=True, init=False)
    _gain: float = field(default=1.0, init=False)
    _half: float = field(default=0.0, init=False)
    _middle: float = field(default=0.0, init=False)
    _low: float = field(default=0.0, init=False)
    _high: float = field(default=1.0, init=False)
    _p: float = field(default=0.0, init=False)
    _i: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        loop = self.loop
        self._gain = -math.expm1(-loop.sample_time / loop.filter_time) if loop.filter_time else 1.0
        of_command = loop.average_of == "command"
        self._kept = deque([1.0 if of_command else 0.0] * loop.average, maxlen=loop.average)
        self._low, self._high, self._p, self._i = loop.low, max(loop.high, 1.0), loop.p, loop.i  # properties take time
        self._middle, self._half = (loop.low + loop.high) / 2, (loop.high - loop.low) / 2

    @classmethod
    def from_parameters(cls, pf: "ParameterFile") -> Self:
        """Make the controller from the file and nothing else.

        Raises
        ------
        GateError
            The file has no gains or no settings of the loop, or its gains fail the check.
        """
        from ..parameters.export.view import view

        return cls(view(pf).needed_loop())

    @property
    def reference(self) -> float:
        """Load that is held, in the unit of the load."""
        return self.loop.reference

    def step(self, measurement: float, dt: float) -> float:
        """Answer a load with a feed override.

        Raises
        ------
        UsageError
            ``dt`` is not the period that the gains and the filter were made for.
        """
        loop = self.loop
        if abs(dt - loop.sample_time) > 1e-9 * dt:
            raise UsageError(f"a step of {dt:g} s: the loop was made for {loop.sample_time:g} s; replay it at that.")
        before = self._known, self.cutting, self._limited
        self._known = loop.load_low < measurement < loop.load_high  # false for NaN too
        self._filtered += ((measurement if self._known else 0.0) - self._filtered) * self._gain
        self._load = self._averaged(self._filtered) if loop.average_of == "measurement" else self._filtered
        self._engage()
        self.cutting = self.enabled and self._known and self._loaded
        target = self._middle + self._pi(dt) if self.cutting else self._idle()
        self._limit(self._averaged(target) if loop.average_of == "command" else target, dt)
        now = self._known, self.cutting, self._limited
        self.news = () if now == before else _told(before, now)
        return self.command

    def _averaged(self, value: float) -> float:
        if self.loop.average == 1:
            return value
        self._kept.append(value)
        return sum(self._kept) / self.loop.average

    def _engage(self) -> None:
        """Comparator with hysteresis, then a delay for each direction, in whole samples."""
        over = self._load - self.loop.engage_at
        if abs(over) > self.loop.hysteresis / 2:
            self._above = over > 0
        if self._above == self._loaded:
            self._waited = 0
            return
        self._waited += 1
        if self._waited >= (self.loop.engage_samples if self._above else self.loop.disengage_samples):
            self._loaded, self._waited = self._above, 0

    def _pi(self, dt: float) -> float:
        """The law of LinuxCNC's pid: the sum is held while the output is clipped and the error pushes further."""
        e = self.loop.reference - self._load
        if e * self._limited <= 0:
            self._sum += e * dt
        out = 1 - self._middle + self._p * e + self._i * self._sum
        self._limited = (out > self._half) - (out < -self._half)
        return min(max(out, -self._half), self._half)

    def _idle(self) -> float:
        self._sum, self._limited = 0.0, 0
        return 1.0

    def _limit(self, target: float, dt: float) -> None:
        """Hard limits, then the rate: another one downwards than upwards."""
        if target != self.command:
            self._falling = target < self.command
        most = (self.loop.back_off if self._falling else self.loop.recover) * dt
        target = min(max(target, self._low), self._high)
        self.command = min(max(target, self.command - most), self.command + most)


def _told(before: tuple[bool, bool, int], now: tuple[bool, bool, int]) -> tuple[str, ...]:
    words = (
        ("load unknown", "load known"),
        ("air", "cut"),
        ("free", "at high", "at low"),  # the third by index -1
    )
    return tuple(said[int(new)] for said, old, new in zip(words, before, now, strict=True) if old != new)
