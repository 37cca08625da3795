"""Sections of milling at constant load (settings, engagement of the loop) and of the limits of machine and tool.

Source: Tai, Tsai & Li 2023, IEEE Access, doi 10.1109/ACCESS.2023.3330587, section II.E and eq. 15.
"""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ..messages import in_unit, short
from .base import NotNegative, Number, Positive, Section, Share, Text


class LimitInterval(Section):
    """Interval of a feed limit at ``level``, and its method.

    Examples
    --------
    >>> LimitInterval(low=580.0, high=640.0, level=0.95, method="Fieller").high
    640.0
    """

    kind: Literal["interval"] = "interval"
    low: Number
    high: Number
    level: Annotated[float, Field(strict=True, gt=0, lt=1)] = 0.95
    method: str

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low > self.high:
            raise ValueError(f"the interval has low {self.low:g} above high {self.high:g}")
        return self


class NoInterval(Section):
    """Absence of an interval of a feed limit, with the reason."""

    kind: Literal["none"] = "none"
    reason: Text


class FeedLimit(Section):
    """A limit of the feed: the feed at the reference load and this wear.

    Examples
    --------
    >>> FeedLimit(value=605.0, wear=0.22, interval={"kind": "none", "reason": "3 points, 3 parameters"}).value
    605.0
    """

    value: Number
    wear: NotNegative
    interval: Annotated[LimitInterval | NoInterval, Field(discriminator="kind")]


class Engagement(Section):
    """Engagement of the loop: thresholds, delays and rates; each may be left to the machine.

    Attributes
    ----------
    feed_programmed : float or None
        programmed F, at which the override is 1, in the unit of the feed limits.
    filter_corner : float or None
        Hz of a one-pole low-pass on the load.
    engage_at, hysteresis : float or None
        Filtered load at the middle of the hysteresis, and its whole width, in the unit of the load.
    engage_after : float or None
        s above the threshold until the loop engages; it disengages in the sample that falls below.
    back_off, recover : float or None
        Override per second downwards and upwards.
    idle : float or None
        Load of the running spindle in air.
    load_low, load_high : float or None
        A reading at or outside these two is invalid. Zero is the reading of a lost sensor: ``load_low`` lies above it
        and below the idle load.
    arm_after : float or None
        s that the spindle runs before the load is monitored.
    lost_after, stuck_after, heartbeat : float or None
        s with invalid readings, of equal readings in the cut, and without a change of the heartbeat, after which a
        fault is latched; 0 of the last two: not monitored.
    overload_after : float or None
        s of a mean load above that of a worn tool, after which the feed is inhibited.
    on_fault : str or None
        What a fault does: feed to the ``lower limit``, or ``stop`` by inhibiting it.
    feed_forward : float or None
        Share of the load line's correction of the feed that the loop starts with.
    sample_time : float or None
        s, period of the thread.

    Examples
    --------
    >>> Engagement(engage_at=0.15, hysteresis=0.02).engage_after is None
    True
    """

    feed_programmed: Positive | None = None
    filter_corner: Positive | None = None
    engage_at: Number | None = None
    hysteresis: NotNegative | None = None
    engage_after: NotNegative | None = None
    back_off: Positive | None = None
    recover: Positive | None = None
    idle: Positive | None = None
    load_low: Number | None = None
    load_high: Number | None = None
    arm_after: NotNegative | None = None
    lost_after: Positive | None = None
    stuck_after: NotNegative | None = None
    heartbeat: NotNegative | None = None
    overload_after: Positive | None = None
    on_fault: Literal["lower limit", "stop"] | None = None
    feed_forward: Share | None = None
    sample_time: Positive | None = None


class LoadLineSection(Section):
    """Settings of CLM-2023: reference load, feed limits and the wear at which the tool is changed.

    The tool is changed when the feed command rests on the lower limit.

    Attributes
    ----------
    reference : float
        Load that the loop holds, unit_load: ``worn`` times ``safety_factor``, rounded to ``rounded_to`` where that is
        not None.
    worn : float
        Load that a worn tool withstands without chipping, unit_load.
    safety_factor : float
        Above 0, at most 1.
    upper, lower : FeedLimit
        Feed at the reference with a sharp tool and at the wear limit, unit_feed.
    window : tuple of float
        Wear between which the tool should be changed, unit_wear.
    probability : float or None
        That the wear lies in the window when the lower limit is reached; ``probability_of`` is its basis.
    dwell : float or None
        s that the command stays at the lower limit before the tool counts as worn.
    law, by
        The law the limits come from, by the symbol of its response, and its level.
    load : str
        Symbol of the load; ``I`` is the spindle current.
    engagement : Engagement or None
    notes : tuple of str

    Examples
    --------
    >>> exact = {"kind": "none", "reason": "3 points, 3 parameters"}
    >>> line = LoadLineSection(
    ...     reference=0.24, worn=0.28, safety_factor=0.85, rounded_to=0.01, unit_load="A", unit_feed="mm/min",
    ...     upper={"value": 1000.0, "wear": 0.0, "interval": exact},
    ...     lower={"value": 605.0, "wear": 0.22, "interval": exact},
    ...     window=(0.18, 0.22), unit_wear="mm", law="I")
    >>> line.lower.wear
    0.22
    """

    reference: Number
    worn: Number
    safety_factor: Annotated[float, Field(strict=True, gt=0, le=1)]
    rounded_to: Positive | None = None
    load: Text = "I"
    unit_load: str
    upper: FeedLimit
    lower: FeedLimit
    unit_feed: str
    window: tuple[NotNegative, NotNegative]
    unit_wear: str
    probability: Share | None = None
    probability_of: str = ""
    dwell: NotNegative | None = None
    law: Text
    by: str | None = None
    engagement: Engagement | None = None
    notes: tuple[str, ...] = ()


class Bound(Section):
    """The largest value allowed, with its unit; ``of`` names the quantity where there are several (``Fxz``).

    Examples
    --------
    >>> Bound(value=7.0, unit="kW").value
    7.0
    """

    value: Positive
    unit: Text
    of: str | None = None


LEAST_SHARE = 1e-9  # of the upper end of a range


class Range(Section):
    """Range of a machine setting, from ``low`` to ``high``.

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
        if 0 < self.low < LEAST_SHARE * self.high:
            raise ValueError(
                f"the range in {short(self.unit)} from {self.low:g} to {self.high:g} is none of a machine; give 0 for "
                "no lower limit"
            )
        return self


class ResponseLimit(Section):
    """Smallest and largest value allowed of a response, at least one of them, with the unit.

    Examples
    --------
    >>> ResponseLimit(high=3.2, unit="um").low is None
    True
    """

    low: Positive | None = None
    high: Positive | None = None
    unit: Text

    @model_validator(mode="after")
    def _bounded(self) -> Self:
        if self.low is None and self.high is None:
            raise ValueError("the limit has neither a low nor a high end; give one")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"the limit in {short(self.unit)} has low {self.low:g} above high {self.high:g}")
        return self


class LimitsSection(Section):
    """Limits that a controller or a choice of V and f keeps to; each may be left out.

    Attributes
    ----------
    power, force, wear : Bound or None
        Power of the spindle, force on tool or work, and the wear criterion at which an edge is worn out.
    responses : dict of ResponseLimit
        Limits of other responses by their symbols, such as ``Ra`` at most 3.2 um or ``T`` at least 15 min; files of
        schema version 5 and earlier have none.
    feed, feed_rate, speed, spindle_speed : Range or None
        Ranges of the machine settings f, fm, V and n.

    Examples
    --------
    >>> limits = LimitsSection(power={"value": 7.0, "unit": "kW"}, force={"value": 1500.0, "unit": "N", "of": "Fxz"})
    >>> limits.force.value, limits.wear
    (1500.0, None)
    """

    power: Bound | None = None
    force: Bound | None = None
    wear: Bound | None = None
    responses: dict[Text, ResponseLimit] = Field(default_factory=dict)
    feed: Range | None = None
    feed_rate: Range | None = None
    speed: Range | None = None
    spindle_speed: Range | None = None

    @property
    def on_responses(self) -> bool:
        """Whether a response is limited, and not only settings of the machine."""
        return bool(self.power or self.force or self.wear or self.responses)

    def response_range(self, symbol: str, unit: str) -> tuple[float, float]:
        """Lowest and highest value allowed of a response, in a unit of its kind; 0 and infinity where none is stated.

        Examples
        --------
        >>> LimitsSection(responses={"I": {"high": 250.0, "unit": "mA"}}).response_range("I", "A")
        (0.0, 0.25)
        """
        stated = self.responses.get(symbol)
        ends: list[tuple[float | None, float | None, str]] = [
            (None, bound.value, bound.unit) for bound in self._bounds() if bound.of == symbol
        ]
        ends += [] if stated is None else [(stated.low, stated.high, stated.unit)]
        lows = [in_unit(low, of, unit) for low, _, of in ends if low is not None]
        highs = [in_unit(high, of, unit) for _, high, of in ends if high is not None]
        return (
            max((low for low in lows if low is not None), default=0.0),
            min((high for high in highs if high is not None), default=math.inf),
        )

    def feed_range(self, unit: str, spindle_speed: float | None) -> tuple[float, float] | None:
        """Lowest and highest feed by ``feed`` and ``feed_rate`` together, in a unit of either.

        Parameters
        ----------
        unit : str
        spindle_speed : float or None
            1/min, by which a feed per revolution and a feed rate convert into each other.

        Returns
        -------
        tuple of float or None
            0 and infinity where neither is stated; None where one does not convert.

        Examples
        --------
        >>> limits = LimitsSection(feed_rate={"low": 10.0, "high": 90.0, "unit": "mm/min"})
        >>> limits.feed_range("mm/rev", 900.0), limits.feed_range("mm/rev", None)
        ((0.0111111111111, 0.1), None)
        """
        low, high = 0.0, math.inf
        for limit in (self.feed, self.feed_rate):
            if limit is None:
                continue
            ends = [feed_in(value, limit.unit, unit, spindle_speed) for value in (limit.low, limit.high)]
            if ends[0] is None or ends[1] is None:
                return None
            low, high = max(low, ends[0]), min(high, ends[1])
        return low, high

    def not_applied(self, *applied: str) -> tuple[str, ...]:
        """Names of the limits stated besides those applied, as ``limits.power`` and ``limits.responses.Ra``.

        Examples
        --------
        >>> limits = LimitsSection(power={"value": 7.0, "unit": "kW"}, responses={"Ra": {"high": 3.2, "unit": "um"}})
        >>> limits.not_applied("responses.Ra")
        ('limits.power',)
        """
        names = ("power", "force", "wear", "feed", "feed_rate", "speed", "spindle_speed")
        stated = [name for name in names if getattr(self, name) is not None]
        stated += [f"responses.{symbol}" for symbol in self.responses]
        return tuple(f"limits.{name}" for name in stated if name not in applied)

    def names_of(self, symbol: str) -> tuple[str, ...]:
        """Names of the limits of a response, as `not_applied` takes them."""
        stated = (("power", self.power), ("force", self.force), ("wear", self.wear))
        named = (name for name, bound in stated if bound is not None and bound.of == symbol)
        return (*named, f"responses.{symbol}")

    def _bounds(self) -> list[Bound]:
        return [bound for bound in (self.power, self.force, self.wear) if bound is not None]


def is_feed(unit: str) -> bool:
    """Whether a unit is one of a feed: per minute, per revolution or per tooth.

    >>> is_feed("mm/rev"), is_feed("m/min"), is_feed("V")
    (True, True, False)
    """
    return any(in_unit(1.0, unit, feed) is not None for feed in ("mm/min", "mm/rev", "mm/tooth"))


def feed_in(value: float, unit: str, to: str, spindle_speed: float | None) -> float | None:
    """A feed per revolution or a feed rate in a unit of either; None where it does not convert.

    >>> feed_in(90.0, "mm/min", "mm/rev", 900.0)
    0.1
    """
    if (direct := in_unit(value, unit, to)) is not None or not spindle_speed:
        return direct
    for start, end, times in (("mm/rev", "mm/min", spindle_speed), ("mm/min", "mm/rev", 1 / spindle_speed)):
        if (own := in_unit(value, unit, start)) is not None:
            return in_unit(float(f"{own * times:.12g}"), end, to)
    return None


def not_applied_words(limits: "LimitsSection | None", control: str, *applied: str) -> tuple[str, ...]:
    """A sentence on the limits that a control does not apply; none where it applies all.

    >>> not_applied_words(LimitsSection(power={"value": 7.0, "unit": "kW"}), "The roughness control")[0]
    'The roughness control does not apply limits.power: keep to it by the choice of its feeds and of the cut.'
    """
    names = () if limits is None else limits.not_applied(*applied)
    if not names:
        return ()
    them = "it" if len(names) == 1 else "them"
    return (f"{control} does not apply {', '.join(names)}: keep to {them} by the choice of its feeds and of the cut.",)
