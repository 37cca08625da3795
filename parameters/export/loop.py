"""The PI loop on load in the units of the machine: what a controller is made from.

Position form, its sum by the rectangle that ends now, e = reference - filtered load:

    feed = feed_programmed + kp e + ki * sum(e) * sample_time,    clipped to feed_low ... feed_high

No export writes the other form, ``incremental_sum``, which goes on from the last feed:

    feed = last feed + kp e + ki * sum(e) * sample_time
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LoadLoop:
    """The PI loop on load: gains, limits and settings, each in the unit that its comment says.

    A command of a controller is ``feed / feed_programmed``, the feed override: ``low`` and ``high`` are its limits.
    """

    kp: float  # unit_feed per unit_load
    ki: float  # unit_feed per unit_load and second
    sample_time: float  # s, period of the thread
    reference: float  # unit_load
    feed_low: float  # unit_feed, above zero
    feed_high: float  # unit_feed
    feed_programmed: float  # unit_feed: F of the programme, at which the override is 1
    unit_load: str
    unit_feed: str
    filter_time: float  # s, time constant of the one-pole low-pass on the load; 0: none
    engage_at: float  # unit_load of the filtered load: the middle of the hysteresis
    hysteresis: float  # unit_load, the whole width
    engage_after: float  # s above the threshold until the loop takes over
    disengage_after: float  # s below the threshold until the feed is the programme's again
    back_off: float  # override per second, downwards
    recover: float  # override per second, upwards
    load_low: float  # unit_load: a reading at or outside these two is no reading
    load_high: float  # unit_load
    average: int = 1  # samples of a moving average; 1: none
    average_of: str = "measurement"  # or "command"
    form: str = "position"  # or "incremental_sum", its kp per sample

    @property
    def low(self) -> float:
        """Smallest override, above zero."""
        return self.feed_low / self.feed_programmed

    @property
    def high(self) -> float:
        """Largest override of the loop."""
        return self.feed_high / self.feed_programmed

    @property
    def p(self) -> float:
        """Kp in override per unit of load."""
        return self.kp / self.feed_programmed

    @property
    def i(self) -> float:
        """Ki in override per unit of load and second."""
        return self.ki / self.feed_programmed

    @property
    def engage_samples(self) -> int:
        """``engage_after`` in whole samples, at least one."""
        return max(round(self.engage_after / self.sample_time), 1)

    @property
    def disengage_samples(self) -> int:
        """``disengage_after`` in whole samples, at least one."""
        return max(round(self.disengage_after / self.sample_time), 1)
