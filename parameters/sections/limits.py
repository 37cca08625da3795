"""What the machine, the tool and the work allow."""

from typing import Self

from pydantic import model_validator

from ..errors import short
from .base import NotNegative, Positive, Section, Text


class Bound(Section):
    """The largest value allowed, with its unit, and of what where there are several (``Fxz`` of the forces).

    Examples
    --------
    >>> Bound(value=7.0, unit="kW").value
    7.0
    """

    value: Positive
    unit: Text
    of: str | None = None


class Range(Section):
    """What a machine can be set to, from ``low`` to ``high``.

    Examples
    --------
    >>> Range(low=50.0, high=200.0, unit="m/min").high
    200.0
    """

    low: NotNegative
    high: Positive
    unit: Text

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low > self.high:
            raise ValueError(f"the range in {short(self.unit)} has low {self.low:g} above high {self.high:g}")
        return self


class LimitsSection(Section):
    """Limits that a controller or a choice of V and f keeps to; each may be left out.

    Attributes
    ----------
    power, force, wear : Bound or None
        Power of the spindle, force on tool or work, and the wear criterion at which an edge is worn out.
    feed, feed_rate, speed, spindle_speed : Range or None
        What the machine can be set to: f, fm, V and n.

    Examples
    --------
    >>> limits = LimitsSection(power={"value": 7.0, "unit": "kW"}, force={"value": 1500.0, "unit": "N", "of": "Fxz"})
    >>> limits.force.value, limits.wear
    (1500.0, None)
    """

    power: Bound | None = None
    force: Bound | None = None
    wear: Bound | None = None
    feed: Range | None = None
    feed_rate: Range | None = None
    speed: Range | None = None
    spindle_speed: Range | None = None
