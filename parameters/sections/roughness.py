"""Settings of turning at constant roughness through constant force.

The force that gives a roughness is the inverse of the law Ra = a exp(b F), or a regression of force on roughness.
"""

from typing import Literal, Self

from pydantic import model_validator

from .base import NotNegative, Positive, Section, Text


class Roughness(Section):
    """Reference force for a roughness, and what the override may do to hold it.

    Attributes
    ----------
    law : str
        The roughness law of the file, by the symbol of its response.
    roughness : float
        The roughness asked for, unit_roughness.
    force : float
        The reference, unit_force; ``force_from`` says whether it is the law's ``inverse`` or a ``regression`` of force
        on roughness.
    threshold : float
        Force below which there is no cut, and the override is left alone.
    override_low, override_high : float
        Shares of the programmed feed.
    feed, chip_thickness : float or None
        Programmed feed and largest uncut chip thickness, unit_feed.
    sample_time, servo_time : float or None
        s between force samples, and the time constant of the feed drive.
    notes : tuple of str

    Examples
    --------
    >>> Roughness(law="Ra", roughness=1.0, force=420.0, threshold=100.0, override_high=1.5).override_low
    0.0
    """

    law: Text
    roughness: Positive
    unit_roughness: Text = "um"
    force: Positive
    unit_force: Text = "N"
    force_from: Literal["inverse", "regression"] = "inverse"
    threshold: NotNegative
    override_low: NotNegative = 0.0
    override_high: Positive
    feed: Positive | None = None
    chip_thickness: Positive | None = None
    unit_feed: Text = "mm/rev"
    sample_time: Positive | None = None
    servo_time: NotNegative | None = None
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.override_low >= self.override_high:
            raise ValueError(f"the override {self.override_low:g} to {self.override_high:g} leaves no range")
        if self.threshold >= self.force:
            raise ValueError(f"the threshold {self.threshold:g} is not below the reference force {self.force:g}")
        return self
