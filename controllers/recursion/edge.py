"""The plant: an edge that wears by its laws, cut after cut."""

from dataclasses import dataclass, field

import numpy as np

from ...core.display import Displayable
from ...core.errors import UsageError
from .laws import LifeLaws
from .rules import Rules, told, wear_after


@dataclass(slots=True, repr=False)
class WearingEdge(Displayable):
    """An edge in the cut: it answers a pair of speed and feed with its wear.

    Its laws may be other ones than the controller's: those of a draw, see `drawn_laws`.

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
        Time it has cut.
    removed : float
        Metal removed, mm3.
    power, force : float
        At the end of the last cut; NaN where the laws have none.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers.recursion import life_laws
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
        """Cut ``dt`` s at (V, f), m/min and mm/rev, and tell the wear; at 0 the tool is out of the cut.

        Raises
        ------
        UsageError
            The command is no pair.
        """
        if len(command) != 2:
            raise UsageError(f"a command of {len(command)} numbers; an edge is cut with two, V and f.")
        V, f = command
        if V > 0 and f > 0:
            self._cut(V, f, self.minutes + dt / 60.0)
        return self.wear + self.gauge_sd * float(noise.standard_normal()) if self.gauge_sd else self.wear

    def _cut(self, V: float, f: float, end: float) -> None:
        laws, rules = self.laws, self._rules
        self.wear = float(wear_after(laws, rules, V, f, self.wear, self.minutes, end))
        if laws.power is not None:
            self.power = float(told(laws.power, rules, V, f, end, self.wear))
        if laws.force is not None:
            self.force = float(told(laws.force, rules, V, f, end, self.wear))
        self.removed += float(laws.mrr(V, f)) * (end - self.minutes)
        self.minutes = end
