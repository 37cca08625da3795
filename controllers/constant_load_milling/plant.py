"""The milling process: a tool that cuts passes of a length, leaves the cut between them, and wears in it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

import numpy as np

from ...core.display import Displayable
from ...core.errors import UsageError
from .cut_model import CutModel, unit_factor

if TYPE_CHECKING:
    from ...parameters import ParameterFile

PASS = 150.0  # mm, section II.E
GAP = 2.0  # s out of the cut between two passes: assumed, not in the paper
DRAWN = 256  # samples of noise at a time, for speed


@dataclass(slots=True, repr=False)
class MillingCut(Displayable):
    """A plant: feed override in, spindle load out.

    The length follows the feed at once, the load through the drive's dynamics, which continue out of the cut. Out of
    the cut the load is A, or ``idle``.

    Attributes
    ----------
    cuts : sequence of CutModel
        Kinds of cut, of one drive: the first's shape is used.
    programmed : float
        Feed at override 1, in the unit of the cuts.
    passes : sequence of (int, float)
        Kind and length in mm of each pass, repeated.
    gap : float
        s out of the cut between passes.
    noise : float
        Standard deviation of the sensor, in the unit of the load.
    idle : float or None
        Load out of the cut.
    wear : float
        Of the tool, in the unit of the cuts; its initial value may be above 0.
    length, in_cut, number, kind, feed
        mm that were cut; 1 in the cut, else 0; pass (from 1) and kind of cut; feed in force.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> mill = MillingCut.from_parameters(published("CLM-2023"))
    >>> noise = np.random.default_rng(1)
    >>> load = [mill.step(1.0, 0.02, noise) for _ in range(200)][-1]
    >>> print(f"{load:.3f} A, {mill.wear:.1f} um, {mill.length:.1f} mm")
    0.241 A, 5.2 um, 66.7 mm
    """

    cuts: Sequence[CutModel]
    programmed: float
    passes: Sequence[tuple[int, float]] = ((0, PASS),)
    gap: float = GAP
    noise: float = 0.0
    idle: float | None = None
    wear: float = 0.0
    length: float = field(default=0.0, init=False)
    in_cut: float = field(default=1.0, init=False)
    number: int = field(default=1, init=False)
    kind: int = field(default=0, init=False)
    feed: float = field(default=0.0, init=False)
    _b: tuple[float, ...] = field(init=False)
    _a: tuple[float, ...] = field(init=False)
    _state: list[float] = field(init=False)
    _left: float = field(default=0.0, init=False)
    _worn: float = field(default=0.0, init=False)
    _rate: float = field(default=0.0, init=False)
    _speed: float = field(default=1.0 / 60.0, init=False)
    _cut: CutModel = field(init=False)
    _taps: range = field(init=False)
    _drawn: list[float] = field(default_factory=list, init=False)
    _even: bool = field(default=True, init=False)
    _steady: bool = field(default=True, init=False)

    def __post_init__(self) -> None:
        if not self.cuts or not self.passes or not all(
            0 <= kind < len(self.cuts) and length > 0 for kind, length in self.passes
        ):  # fmt: skip
            raise UsageError(f"passes {list(self.passes)[:5]}: each has a kind of cut and a length above zero.")
        if not (self.gap >= 0 and self.noise >= 0 and self.wear >= 0 and self.programmed > 0):
            raise UsageError(
                f"gap {self.gap:g} s, noise {self.noise:g}, wear {self.wear:g}, programmed feed {self.programmed:g}: "
                "none is below zero, and the feed is above it."
            )
        drive = self.cuts[0]
        if drive.b[0] != 0:
            raise UsageError(
                "the drive responds in the sample of its command; a plant needs a delay of at least one sample."
            )
        size = max(len(drive.b) - 1, len(drive.a))
        self._b = (*drive.b[1:], *[0.0] * (size + 1 - len(drive.b)))  # the replay adds the sample of delay
        self._a = (*drive.a, *[0.0] * (size - len(drive.a)))
        self._state, self._taps = [0.0] * size, range(1, len(self._b))
        self._speed = unit_factor(drive.unit_feed, "mm/s")
        self._begin()

    @classmethod
    def from_parameters(
        cls,
        pf: "ParameterFile",
        *,
        pass_length: float = PASS,
        gap: float = GAP,
        noise: float | None = None,
        cut: CutModel | None = None,
    ) -> Self:
        """Make the plant of a file; ``noise`` is by default the sensor's, ``cut`` by default the file's.

        Raises
        ------
        ParameterError, GateError
            See `CutModel.from_parameters` and `ConstantLoad.from_parameters`.
        """
        from .control_laws import loop_of

        cut = CutModel.from_parameters(pf) if cut is None else cut
        load = "I" if pf.load_line is None else pf.load_line.load
        known = [s.sd for s in pf.identity.sensors if (s.symbol, s.unit) == (load, cut.unit_load) and s.sd is not None]
        sd = (known[0] if known else 0.0) if noise is None else noise
        return cls((cut,), loop_of(pf).feed_programmed, ((0, pass_length),), gap, sd)

    def step(self, command: float, dt: float, noise: np.random.Generator) -> float:
        """Load at the sample, for the override in force before it."""
        if self._left <= 0:
            self._turn()
        self.feed = feed = command * self.programmed
        s, b, a = self._state, self._b, self._a
        driven = b[0] * feed + s[0]
        for i in self._taps:  # transposed direct form II
            s[i - 1] = b[i] * feed - a[i] * driven + s[i]
        cut = self._cut
        if self.in_cut:
            moved = feed * self._speed * dt
            self.length += moved
            self._left -= moved
            self._worn += (self._rate if self._steady else self._rate_at(feed)) * dt
            self.wear = wear = self._worn if self._even else self._worn**cut.n
            load = cut.A + cut.B * driven + cut.k1 * wear
        else:
            load = cut.A if self.idle is None else self.idle
            self._left -= dt
        if not self.noise:
            return load
        if not self._drawn:
            self._drawn = (self.noise * noise.standard_normal(DRAWN)).tolist()
        return load + self._drawn.pop()

    def _turn(self) -> None:
        """Leave the cut, with the next kind of cut already selected, or enter the next pass."""
        if self.in_cut and self.gap:
            self.in_cut, self._left = 0.0, self.gap
            self.kind = self.passes[self.number % len(self.passes)][0]
        else:
            self.number += 1
            self._begin()

    def _begin(self) -> None:
        """Begin a pass; ``_worn`` is wear^(1/n), which grows by c0^(1/n) a second at any feed history."""
        self.kind, self._left = self.passes[(self.number - 1) % len(self.passes)]
        self._cut, self.in_cut = self.cuts[self.kind], 1.0
        self._even, self._steady = self._cut.n == 1.0, self._cut.m == 0.0
        self._worn = self.wear ** (1 / self._cut.n)
        self._rate = self._cut.c0 ** (1 / self._cut.n)

    def _rate_at(self, feed: float) -> float:
        cut = self._cut
        rate: float = (cut.c0 * max(feed, 1e-9) ** cut.m) ** (1 / cut.n)
        return rate
