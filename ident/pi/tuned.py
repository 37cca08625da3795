"""Gains that were tuned, with everything that they were judged by."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...core.display import Displayable
from ..model import Model
from .feasible import FeasibleMap
from .gains import PiGains
from .loop import Figures
from .robust import Robustness
from .specification import LIMITS, Specification, table_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True, repr=False)
class TunedPi(Displayable):
    """Gains, the loop they close on the model, and what was asked.

    Attributes
    ----------
    gains : PiGains
        As the controller runs them.
    figures : Figures
        Of the loop on the model, run until it has died out.
    specification : Specification
    aim : str
    model : Model
    map : FeasibleMap
    assumed : tuple of str
        Limits that nobody asked for.
    robustness : Robustness or None
        What holds over draws of the covariance, or over several models.
    probability : float or None
        That was demanded.
    """

    gains: PiGains
    figures: Figures
    specification: Specification
    aim: str
    model: Model
    map: FeasibleMap
    assumed: tuple[str, ...] = ()
    robustness: Robustness | None = None
    probability: float | None = None

    @property
    def kp(self) -> float:
        """unit_u per unit_y."""
        return self.gains.kp

    @property
    def ki(self) -> float:
        """unit_u per unit_y per second, parallel form."""
        return self.gains.ki

    @property
    def misses(self) -> tuple[str, ...]:
        """A sentence for each limit that the gains miss, worst first, and for a demanded probability."""
        sentences = self.specification.misses(table_of(self.figures, self.kp, self.ki))
        held = self.robustness
        if self.probability is not None and held is not None and held.probability < self.probability - 2 * held.error:
            sentences.append(
                f"the specification holds with a probability of {held.probability:.1%} (Monte Carlo error "
                f"{held.error:.1%}), below the {self.probability:.1%} asked for"
            )
        return tuple(sentences)

    @property
    def feasible(self) -> bool:
        """Whether everything that was asked is met.

        Where not, `misses` name what fails and the gains are the nearest. Loosen one of those limits, shorten the delay
        or the filter, or (a probability) identify more exactly: a longer record, more amplitude.
        """
        return not self.misses

    @property
    def verdict(self) -> str:
        """One paragraph: gains, what they meet or miss, what was assumed."""
        unit = f" {self.gains.unit_u}/{self.gains.unit_y}" if self.gains.unit_u and self.gains.unit_y else ""
        head = (
            f"Kp {self.kp:.4g}{unit}, Ki {self.ki:.4g}{unit} per second, {self.gains.form} form, "
            f"{self.gains.integration} sum at {self.gains.sample_time:g} s"
        )
        if self.feasible:
            says = f"meets {self.specification}"
        else:
            says = "no gains meet the specification; these come nearest: " + "; ".join(self.misses)
            conflict = self.conflict
            says += f" ({conflict})" if conflict else ""
        assumed = f" Assumed: {'; '.join(self.assumed)}." if self.assumed else ""
        held = f" {self.robustness.verdict}" if self.robustness else ""
        return f"{head}: {says}.{assumed}{held}"

    @property
    def conflict(self) -> str:
        """Which single limit stands against the others on the map; empty where there is none, or two must go."""
        found = {n: v > 0 for n, v in self.specification.violations(self.map.figures).items()}
        stable = self.map.figures["stable"].astype(bool)
        free = []
        for name in found:
            others = [v for other, v in found.items() if other != name]
            blocked = sum(others, start=~stable) > 0 if others else ~stable
            if not blocked.all():
                free.append(name)
        words = " or that on ".join(LIMITS[name].words for name in free)
        return f"without the limit on {words} there are gains" if free and not self.map.any else ""

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """The feasible map with the gains on it."""
        return self.map.plot(ax, (self.kp, self.ki))
