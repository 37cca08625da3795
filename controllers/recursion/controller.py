"""Recursive turning as a controller, one interval a step, and its plant, an edge that wears by its laws.

Source: A. M. Alaskari and S. E. Oraby, "Adaptive control simulation to optimize metal removal for rough turning",
Kuwait J. Sci. (accepted June 2017), eq. 4 to 8 and Figure 1.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

import numpy as np

from ...core.display import Displayable
from ...core.errors import UsageError
from ...parameters.file import require_unchanged
from ..sensor_check import SensorCheck
from .from_file import life_laws
from .interval_optimum import Grid, SearchMethod, choose, grid_of
from .laws import LifeLaws, Rules, Times, WearRule, response_at_end, wear_after

if TYPE_CHECKING:
    from ...parameters import ParameterFile

LEAST_SHARE = 0.6  # a reading below this share of the wear that the laws predict is invalid


@dataclass(slots=True, repr=False)
class TurningRecursion(Displayable):
    """The controller of AC-2017; its command is (V, f) of the next interval, m/min and mm/rev.

    The measurement is the wear at the end of an interval. Before the first the tool is out of the cut, (0, 0), and
    when no pair is within the limits it is again: ``worn out``, change the edge. The wear is the larger of the reading
    and the prediction of the laws from the last one: a gauge that reads low makes the controller no faster than its
    plan. An invalid reading (not a number, below .6 of the prediction, unchanged after a cut) is replaced by the
    prediction, as the paper always does, and reported.

    Attributes
    ----------
    laws, rules, grid
        See `life_laws`, `Rules`, `grid_of`.
    how : {"grid", "exact"}
    wear : float
        Wear that the last command was computed for, in its unit.
    minutes : float
        Time in the cut up to the end of the last command, min.
    command : (float, float)
        The last command.
    news : tuple of str
        What changed in the last step: ``wear unknown``, ``wear known``, ``worn out``.

    Examples
    --------
    >>> from fitmodels.controllers import replay
    >>> from fitmodels.controllers.recursion.controller import WearingEdge
    >>> from fitmodels.parameters.published import published
    >>> controller = TurningRecursion.from_parameters(published("AC-2017"))
    >>> trace = replay(controller, WearingEdge(controller.laws), duration=3600, dt=60, until="worn out")
    >>> trace.first("worn out") / 60, trace.command[[0, 1, 13]].tolist()
    (14.0, [[150.0, 0.58], [140.0, 0.58], [200.0, 0.205]])
    """

    laws: LifeLaws
    rules: Rules
    grid: Grid
    how: SearchMethod = "grid"
    wear: float = field(default=0.0, init=False)
    minutes: float = field(default=0.0, init=False)
    command: tuple[float, ...] = field(default=(0.0, 0.0), init=False)
    news: tuple[str, ...] = field(default=(), init=False)
    labels: tuple[str, str] = field(init=False)
    _sensing: SensorCheck = field(init=False)
    _known: bool = field(default=True, init=False)
    _worn: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        # any move counts, and one equal reading is enough: an interval in the cut always adds wear
        self._sensing = SensorCheck(low=-1e-9, high=float("inf"), least_move=1e-12, samples=1)
        self.labels = ("V m/min, f mm/rev", f"{self.laws.wear.response} {self.laws.wear.unit}")

    @classmethod
    def from_parameters(
        cls,
        pf: "ParameterFile",
        *,
        times: Times | None = None,
        wear: WearRule = "clock",
        interval: float = 1.0,
        how: SearchMethod = "grid",
        d: float | None = None,
        by: str | None = None,
        at: Mapping[str, float] | None = None,
    ) -> Self:
        """Make the controller from the file alone.

        Parameters
        ----------
        pf : ParameterFile
        times, wear, interval
            See `Rules`; by default all times count, with the paper's own file only those of the paper.
        how : {"grid", "exact"}
            The published search of a grid, or the exact optimum of each interval.
        d, by, at
            See `life_laws`.

        Raises
        ------
        UsageError
            The file lacks a law or limit of the recursion, or an option is invalid.
        GateError
            The content of the file was changed after it was written.
        """
        require_unchanged(pf)
        laws = life_laws(pf, d=d, by=by, at=at)
        return cls(laws, Rules(times or laws.times, wear, interval), grid_of(laws), how)

    @property
    def reference(self) -> float:
        """The wear criterion, in the unit of the wear."""
        return self.laws.wear.most

    def step(self, measurement: float, dt: float) -> tuple[float, ...]:
        """The pair of the next interval, from the wear at the end of the last one.

        Raises
        ------
        UsageError
            ``dt``, s, is not the interval of the rules.
        """
        own = 60.0 * self.rules.interval
        if not abs(dt - own) <= 1e-9 * own:  # true for NaN too
            raise UsageError(
                f"a step of {dt:g} s: the recursion was made for intervals of {self.rules.interval:g} min."
            )
        if self._worn:
            self.news = ()
            return self.command
        changes = self._take(measurement)
        best = choose(self.laws, self.rules, self.grid, self.how, self.wear, self.minutes)
        if best is None:
            self._worn, self.command = True, (0.0, 0.0)
            self.news = (*changes, "worn out")
        else:
            self.minutes += self.rules.interval
            self.command, self.news = (best.V, best.f), changes
        return self.command

    def _take(self, measurement: float) -> tuple[str, ...]:
        """Take the measurement, or the prediction of the laws where it is invalid."""
        expected = self._expected()
        self._sensing.low = LEAST_SHARE * expected - 1e-9
        known = self._sensing.valid(measurement, expected)
        self.wear = max(measurement, expected) if known else expected
        was, self._known = self._known, known
        return () if was == known else ("wear known" if known else "wear unknown",)

    def _expected(self) -> float:
        V, f = self.command
        if not V:
            return self.wear
        start = self.minutes - self.rules.interval
        return float(wear_after(self.laws, self.rules, V, f, self.wear, start, self.minutes))


@dataclass(slots=True, repr=False)
class WearingEdge(Displayable):
    """An edge in the cut: the command is a pair of speed and feed, the measurement its wear.

    Its laws may differ from the controller's.

    Attributes
    ----------
    laws : LifeLaws
    rules : Rules, optional
        As in `whole_life`.
    gauge_sd : float
        Standard deviation of the wear gauge, in the unit of the wear.
    wear : float
        Wear now.
    minutes : float
        Time in the cut, min.
    removed : float
        Metal removed, mm3.
    power, force : float
        At the end of the last cut; NaN without a law.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers import life_laws
    >>> edge = WearingEdge(life_laws(published("AC-2017")))
    >>> noise = np.random.default_rng(1)
    >>> edge.step((0.0, 0.0), 60.0, noise), round(edge.step((150.0, 0.58), 60.0, noise), 6)
    (0.0, 0.157219)
    """

    laws: LifeLaws
    rules: Rules | None = None
    gauge_sd: float = 0.0
    wear: float = field(default=0.0, init=False)
    minutes: float = field(default=0.0, init=False)
    removed: float = field(default=0.0, init=False)
    power: float = field(default=float("nan"), init=False)
    force: float = field(default=float("nan"), init=False)

    _rules: Rules = field(init=False)

    def __post_init__(self) -> None:
        self._rules = self.rules or Rules(self.laws.times)

    def step(self, command: tuple[float, ...], dt: float, noise: np.random.Generator) -> float:
        """Cut ``dt`` s at (V, f), m/min and mm/rev, and measure the wear; at 0 the tool is out of the cut.

        Raises
        ------
        UsageError
            The command is not a pair.
        """
        if len(command) != 2:
            raise UsageError(f"a command of {len(command)} numbers; give two, V and f.")
        V, f = command
        if V > 0 and f > 0:
            self._cut(V, f, self.minutes + dt / 60.0)
        return self.wear + self.gauge_sd * float(noise.standard_normal()) if self.gauge_sd else self.wear

    def _cut(self, V: float, f: float, end: float) -> None:
        laws, rules = self.laws, self._rules
        self.wear = float(wear_after(laws, rules, V, f, self.wear, self.minutes, end))
        if laws.power is not None:
            self.power = float(response_at_end(laws.power, rules, V, f, end, self.wear))
        if laws.force is not None:
            self.force = float(response_at_end(laws.force, rules, V, f, end, self.wear))
        self.removed += float(laws.mrr(V, f)) * (end - self.minutes)
        self.minutes = end
