"""Default depth, time and other factors where a file leaves them open: AC-2016's, or else the middle of the tests."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING

from .probability import Feasibility, feasibility
from .sampled_laws import Kind
from .visible import VisibleRegion, visible_region

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.draws import Draws

USUAL = {"d": 2.5, "t": 10.0}  # of AC-2016
UNITS = {"d": "mm", "t": "min"}


@dataclass(frozen=True, slots=True)
class DefaultSetting:
    """Fixed depth, time, level and factors, with the assumptions made where the file leaves them open."""

    d: float
    t: float
    by: str | None
    at: dict[str, float]
    assumed: tuple[str, ...]

    def region(self, pf: "ParameterFile") -> VisibleRegion:
        """The region at these values."""
        return visible_region(pf, d=self.d, t=self.t, by=self.by, at=self.at)

    def probability(self, pf: "ParameterFile", draws: "Mapping[str, Draws]", seed: int, kind: Kind) -> Feasibility:
        """Probability that pairs keep the limits at these values."""
        return feasibility(pf, draws=draws, d=self.d, t=self.t, by=self.by, at=self.at, kind=kind, seed=seed)


def default_setting(pf: "ParameterFile") -> DefaultSetting:
    """The paper's depth and time where tested, else the middle of the tested range; laws at their reference level."""
    assumed = ["The laws come from simulated tests."] if pf.identity.simulated else []
    chosen = {name: _middle(pf, name, usual, assumed) for name, usual in USUAL.items()}
    laws = [law for law in pf.laws.values() if law.form == "power" or {"V", "f"} & {f.symbol for f in law.factors}]
    by = next((law.by for law in laws if law.by is not None), None)
    if by is not None:
        assumed.append(f"The laws are evaluated at {by.column} {by.reference}, their reference level.")
    known = {"V", "f", "d", "t", *pf.laws}
    others = {
        f.symbol: float(f"{sqrt(f.low * f.high):.4g}")
        for law in laws
        for f in law.factors
        if f.symbol not in known and f.low > 0
    }
    assumed += [f"{name} is fixed at {value:.4g}, the middle of its tested range." for name, value in others.items()]
    return DefaultSetting(chosen["d"], chosen["t"], None if by is None else by.reference, others, tuple(assumed))


def _middle(pf: "ParameterFile", name: str, usual: float, assumed: list[str]) -> float:
    ranges = [(f.low, f.high) for law in pf.laws.values() for f in law.factors if f.symbol == name and f.low > 0]
    low, high = max((low for low, _ in ranges), default=0.0), min((high for _, high in ranges), default=usual)
    straight = all(law.form == "power" for law in pf.laws.values())  # others are limited to their tests
    if (straight and low <= usual <= high) or not 0 < low <= high:
        value, why = usual, "as in AC-2016"
    else:
        value, why = float(f"{sqrt(low * high):.4g}"), "the middle of the tested range"
    if ranges or name == "d":  # the removal rate has the depth, the time matters where a law has it
        assumed.append(f"{name} is {value:.4g} {UNITS[name]}, {why}.")
    return value
