"""What less metal buys in wear: the Pareto front of removal rate and wear, exact at every point."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.display import Displayable, as_columns
from .clipping import Array
from .points import Point
from .visible import VisibleRegion

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...core.display import Frame

LOSSES = tuple(np.linspace(0.0, 0.5, 101).tolist())


@dataclass(frozen=True, slots=True, repr=False)
class WearFront(Displayable):
    """The pairs that wear least for the metal they remove.

    At a given time wear and wear rate are least at the same pair, so this front is of both.

    Attributes
    ----------
    loss : ndarray, shape (n,)
        Share of the greatest MRR given up.
    V, f, MRR, wear : ndarray, shape (n,)
        m/min, mm/rev, mm3/min, and the unit of the wear.
    wear_rate : ndarray, shape (n,), or None
        um/min; None where the wear law has no t.
    points : tuple of Point
    symbol, unit : str
        Of the wear.
    """

    loss: Array
    V: Array
    f: Array
    MRR: Array
    wear: Array
    wear_rate: Array | None
    points: tuple[Point, ...]
    symbol: str
    unit: str

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Wear over metal removal rate."""
        from .draw import front_picture

        return front_picture(self, ax)

    def to_frame(self) -> "Frame":
        """A row a share of the metal given up."""
        return as_columns(self, "loss", "V", "f", "MRR", "wear")


def wear_front(region: VisibleRegion, losses: Sequence[float] = LOSSES) -> WearFront:
    """The least wear for each share of the greatest MRR that is given up.

    Parameters
    ----------
    region : VisibleRegion
        Of a file with a law of wear.
    losses : sequence of float
        From 0 to below 1.

    Raises
    ------
    UsageError, DataError
        As ``VisibleRegion.least_wear``.

    Examples
    --------
    >>> from fitmodels.controllers.region import visible_region
    >>> from fitmodels.parameters.published import published
    >>> front = wear_front(visible_region(published("AC-2016")), [0.0, 0.05])
    >>> front.V.round(1).tolist(), front.wear.round(4).tolist()
    ([147.9, 136.5], [0.27, 0.2591])
    """
    points = tuple(region.least_wear(float(loss)) for loss in losses)
    symbol = region.wear or ""

    def column(name: str) -> Array:
        return np.array([getattr(point, name) for point in points], dtype=np.float64)

    return WearFront(
        loss=np.asarray(losses, dtype=np.float64),
        V=column("V"),
        f=column("f"),
        MRR=column("MRR"),
        wear=np.array([point.values[symbol] for point in points]),
        wear_rate=None if any(point.wear_rate is None for point in points) else column("wear_rate"),
        points=points,
        symbol=symbol,
        unit=region.planes[symbol].unit,
    )
