"""How likely a pair of V and f keeps its limits: over the plane, and for one pair what it risks."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from ...core.display import Displayable
from ...core.errors import UsageError
from .clipping import Array
from .demanded import demanded
from .points import Point, ln
from .sampled import Kind, Sampling, sampling
from .visible import VisibleRegion, visible_region

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...parameters import Draws, LimitsSection, ParameterFile

__all__ = ["Chance", "Kind", "feasibility"]


@dataclass(frozen=True, slots=True, repr=False)
class Chance(Displayable):
    """Probability that every limit of power, force and wear is kept, over V and f.

    Attributes
    ----------
    V, f : ndarray, shape (m,) and (n,)
        m/min and mm/rev, evenly over the machine's ranges.
    probability : ndarray, shape (n, m)
        A row for each f.
    kind : {"prediction", "mean"}
        Of one row of an edge not yet cut, or of the law itself (its median, where errors multiply).
    region : VisibleRegion
        The same laws as they stand.
    sampling : Sampling
        The draws.
    sources : tuple of str
        Where the draws of each law come from.
    """

    V: Array
    f: Array
    probability: Array
    kind: Kind
    region: VisibleRegion
    sampling: Sampling
    sources: tuple[str, ...]

    @property
    def count(self) -> int:
        """Number of draws: a share of them is known to within ``sqrt(p (1 - p) / count)``."""
        return self.sampling.count

    @property
    def of(self) -> str:
        """What is judged, in words."""
        return "one row of a new edge" if self.kind == "prediction" else "the laws without the scatter of rows"

    def at(self, V: float, f: float) -> float:
        """Probability that a pair keeps every limit."""
        return float(self.sampling.keeps(ln(V, f)[None])[0])

    def risks(self, V: float, f: float) -> dict[str, float]:
        """Probability that a pair goes over each limit, by response: over one, whatever the others do."""
        return self.sampling.risks(ln(V, f))

    def best(self, demanded_probability: float = 0.95) -> Point:
        """The pair that removes most metal among those that keep every limit with this probability.

        Raises
        ------
        UsageError
            The probability is not between 0 and 1.
        DataError
            No pair reaches it.
        """
        return demanded(self.region, self.sampling, demanded_probability)

    def plot(self, ax: "Axes | None" = None, *, marks: Mapping[str, Point] | None = None) -> "Axes":
        """Draw the probability over the plane; ``marks`` are further points."""
        from .draw import chance_picture

        return chance_picture(self, ax, marks)


def feasibility(
    pf: "ParameterFile",
    *,
    draws: "Mapping[str, Draws] | None" = None,
    limits: "LimitsSection | Mapping[str, Any] | None" = None,
    d: float = 2.5,
    t: float = 10.0,
    by: str | None = None,
    at: Mapping[str, float] | None = None,
    kind: Kind = "prediction",
    grid: tuple[int, int] = (60, 60),
    most: int = 2000,
    seed: int = 1,
) -> Chance:
    """Work out how likely each pair of V and f keeps the limits.

    Parameters
    ----------
    pf, limits, d, t, by, at
        As in `visible_region`.
    draws : mapping of str to Draws, optional
        Of each law, as `fitmodels.parameters.read_draws` gives them. A law without draws is drawn from its covariance;
        one without that is taken as exactly known: ``sources`` says which.
    kind : {"prediction", "mean"}
        Of one row of an edge not yet cut, with its scatter, or of the laws themselves.
    grid : tuple of int
        Points along V and f.
    most : int
        Draws used.
    seed : int
        Of how draws are put together, and of the scatter.

    Raises
    ------
    UsageError
        As `visible_region`; draws that are not the law's; a law whose scatter is not known.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> chance = feasibility(published("AC-2016"), grid=(12, 12))
    >>> chance.at(154.7, 0.53) < 0.3 < 0.9 < chance.at(100.0, 0.3)
    True
    """
    if kind not in get_args(Kind):
        raise UsageError(f"kind={kind!r}: it is 'prediction', of a new edge, or 'mean', of the laws themselves.")
    if min(grid) < 2 or most < 1:
        raise UsageError(f"grid {grid} with {most} draws: at least 2 points along V and f, and a draw.")
    region = visible_region(pf, limits=limits, d=d, t=t, by=by, at=at)
    drawn = sampling(region, draws or {}, kind, most, seed)
    low, high = np.exp(region.box.low), np.exp(region.box.high)
    V, f = (np.linspace(low[i], high[i], grid[i]) for i in (0, 1))
    x = np.log(np.stack(np.meshgrid(V, f), axis=-1).reshape(-1, 2))
    return Chance(
        V=V,
        f=f,
        probability=drawn.keeps(x).reshape(len(f), len(V)),
        kind=kind,
        region=region,
        sampling=drawn,
        sources=tuple(each.words for each in drawn.laws.values()),
    )
