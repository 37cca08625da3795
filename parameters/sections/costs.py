"""Section of the cost of a part: rates of machine and labour, edges, times, energy, and the cut of one part."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from .base import NotNegative, Positive, Section, Text


class PartCut(Section):
    """What is cut of one part: a volume, or a length turned at a diameter.

    Attributes
    ----------
    volume : float or None
        cm3; the time in cut is volume / (V f d).
    length, diameter : float or None
        mm; the time in cut of one pass is length / (f n).

    Examples
    --------
    >>> PartCut(length=500.0, diameter=100.0).volume is None
    True
    """

    volume: Positive | None = None
    length: Positive | None = None
    diameter: Positive | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        of_length = self.length is not None and self.diameter is not None
        if (self.length is None) != (self.diameter is None) or of_length == (self.volume is not None):
            raise ValueError("give the cut of a part as its volume, or as length and diameter, not as both")
        return self


class CostsSection(Section):
    """Costs and times from which the cost of a part follows; prices in one currency.

    Attributes
    ----------
    currency : str
    machine, labour : float
        Per hour.
    edge : float or None
        Price of one cutting edge; or of an ``insert`` with its ``edges``, never both.
    insert, edges
        Price of an insert, and its number of edges.
    change, handling : float
        min: change of an edge; loading, unloading and idle time of one part.
    energy : float or None
        Price of 1 kWh; ``efficiency`` is the power at the tool over that of the line, 1 where it is not stated.
    cut : PartCut or None
        Of one part; without it the costs are of 1 cm3.
    failure : float or None
        Cost of an edge that reaches its wear criterion before it is changed, beyond that of a planned change.

    Examples
    --------
    >>> CostsSection(currency="EUR", machine=60.0, insert=16.0, edges=4, change=1.5).price_of_edge
    4.0
    """

    currency: Text
    machine: NotNegative
    labour: NotNegative = 0.0
    edge: NotNegative | None = None
    insert: NotNegative | None = None
    edges: Annotated[int, Field(strict=True, ge=1, le=100)] | None = None
    change: NotNegative
    handling: NotNegative = 0.0
    energy: NotNegative | None = None
    efficiency: Annotated[float, Field(strict=True, gt=0, le=1)] | None = None
    cut: PartCut | None = None
    failure: NotNegative | None = None

    @model_validator(mode="after")
    def _complete(self) -> Self:
        of_insert = self.insert is not None and self.edges is not None
        if (self.insert is None) != (self.edges is None) or of_insert == (self.edge is not None):
            raise ValueError("give the price of one edge, or of an insert with its number of edges, not both")
        if self.machine + self.labour == 0:
            raise ValueError("the rates of machine and labour are both zero: time would cost nothing")
        if self.cut is None and self.handling:
            raise ValueError("the handling time is of one part, so the cut of one part must be given")
        return self

    @property
    def price_of_edge(self) -> float:
        """Price of one cutting edge."""
        if self.insert is not None and self.edges is not None:
            return self.insert / self.edges
        return self.edge or 0.0

    @property
    def per_minute(self) -> float:
        """Rates of machine and labour together, per min."""
        return (self.machine + self.labour) / 60

    @property
    def of(self) -> str:
        """What a cost is of: ``part`` or ``cm3``."""
        return "cm3" if self.cut is None else "part"
