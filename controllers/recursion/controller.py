"""Recursive turning: before each interval the pair of speed and feed that removes most metal within the limits.

Source: A. M. Alaskari and S. E. Oraby, "Adaptive control simulation to optimize metal removal for rough turning",
Kuwait J. Sci. (accepted June 2017), eq. 4 to 8 and Figure 1.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

from ...core.display import Displayable
from ...core.errors import UsageError
from ..sensing import Sensing
from .choice import How, choose
from .from_file import life_laws
from .grid import Grid, grid_of
from .laws import LifeLaws, Times
from .rules import Rules, WearRule, wear_after

if TYPE_CHECKING:
    from ...parameters import ParameterFile

HEALED = 0.5  # wear does not heal: a reading below this share of the last wear is none


@dataclass(slots=True, repr=False)
class TurningRecursion(Displayable):
    """The controller of AC-2017; its command is (V, f) of the next interval, m/min and mm/rev.

    It answers the wear at the end of an interval. Before the first the tool is out of the cut, (0, 0), and when no pair
    keeps within the limits it stops there again: ``worn out``, change the edge. A wear that cannot be believed (no
    number, below half of the last one, the very same after a cut) is put in from the laws, as the paper does always.

    Attributes
    ----------
    laws, rules, grid
        See `life_laws`, `Rules`, `grid_of`.
    how : {"grid", "exact"}
    wear : float
        Wear that the last command stands on, in the unit of the wear.
    minutes : float
        Time of cut, commands given counted, min.
    command : (float, float)
        The last command.
    news : tuple of str
        What changed in the last step: ``wear unknown``, ``wear known``, ``worn out``.

    Examples
    --------
    >>> from fitmodels.controllers import replay
    >>> from fitmodels.controllers.recursion import WearingEdge
    >>> from fitmodels.parameters.published import published
    >>> controller = TurningRecursion.from_parameters(published("AC-2017"))
    >>> trace = replay(controller, WearingEdge(controller.laws), duration=3600, dt=60, until="worn out")
    >>> trace.first("worn out") / 60, trace.command[[0, 1, 13]].tolist()
    (14.0, [[150.0, 0.58], [140.0, 0.58], [200.0, 0.205]])
    """

    laws: LifeLaws
    rules: Rules
    grid: Grid
    how: How = "grid"
    wear: float = field(default=0.0, init=False)
    minutes: float = field(default=0.0, init=False)
    command: tuple[float, ...] = field(default=(0.0, 0.0), init=False)
    news: tuple[str, ...] = field(default=(), init=False)
    labels: tuple[str, str] = field(init=False)
    _sensing: Sensing = field(init=False)
    _known: bool = field(default=True, init=False)
    _worn: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        # any move counts, and one equal reading is enough: an interval in the cut always adds wear
        self._sensing = Sensing(low=-1e-9, high=float("inf"), least_move=1e-12, samples=1)
        self.labels = ("V m/min, f mm/rev", f"{self.laws.wear.response} {self.laws.wear.unit}")

    @classmethod
    def from_parameters(
        cls,
        pf: "ParameterFile",
        *,
        times: Times | None = None,
        wear: WearRule = "clock",
        interval: float = 1.0,
        how: How = "grid",
        d: float | None = None,
        by: str | None = None,
        at: Mapping[str, float] | None = None,
    ) -> Self:
        """Make the controller from the file and nothing else.

        Parameters
        ----------
        pf : ParameterFile
        times, wear, interval
            See `Rules`; unless given, all times count, but with the paper's own file those that it counts.
        how : {"grid", "exact"}
            The published search of a grid, or the exact optimum of each interval.
        d, by, at
            See `life_laws`.

        Raises
        ------
        UsageError
            The file lacks what the recursion needs, or an option is none.
        """
        laws = life_laws(pf, d=d, by=by, at=at)
        return cls(laws, Rules(times or laws.times, wear, interval), grid_of(laws), how)

    @property
    def reference(self) -> float:
        """The wear criterion, in the unit of the wear."""
        return self.laws.wear.most

    def step(self, measurement: float, dt: float) -> tuple[float, ...]:
        """Answer the wear at the end of an interval with the pair of the next.

        Raises
        ------
        UsageError
            ``dt``, s, is not the interval of the rules.
        """
        if abs(dt - 60.0 * self.rules.interval) > 1e-9 * dt:
            raise UsageError(
                f"a step of {dt:g} s: the recursion was made for intervals of {self.rules.interval:g} min."
            )
        if self._worn:
            self.news = ()
            return self.command
        said = self._take(measurement)
        best = choose(self.laws, self.rules, self.grid, self.how, self.wear, self.minutes)
        if best is None:
            self._worn, self.command = True, (0.0, 0.0)
            self.news = (*said, "worn out")
        else:
            self.minutes += self.rules.interval
            self.command, self.news = (best.V, best.f), said
        return self.command

    def _take(self, measurement: float) -> tuple[str, ...]:
        """Believe the measurement, or put in what the laws expect."""
        expected = self._expected()
        self._sensing.low = HEALED * self.wear - 1e-9
        known = self._sensing.believes(measurement, expected)
        self.wear = max(measurement, 0.0) if known else expected
        was, self._known = self._known, known
        return () if was == known else ("wear known" if known else "wear unknown",)

    def _expected(self) -> float:
        V, f = self.command
        if not V:
            return self.wear
        start = self.minutes - self.rules.interval
        return float(wear_after(self.laws, self.rules, V, f, self.wear, start, self.minutes))
