"""Feed drive, and settings of control by force: constant roughness through constant force, and adaptive force.

The force that gives a roughness is the inverse of the law Ra = a exp(b F), or a regression of force on roughness.
"""

import math
import re
from typing import Annotated, Final, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from ...core.arrays import Array
from ..messages import short
from .base import (
    Count,
    ModelCovariance,
    NoCovariance,
    NotNegative,
    Number,
    Positive,
    Section,
    Sha256,
    Text,
    VerdictSection,
)

COEFFICIENTS: Final = ("M", "Fv", "Fc", "offset")
ROUNDING = 0.01  # relative, of a reference force entered by hand with its regression
TESTED: Final = "tested"  # entry of ``sources`` with the ranges of the record that estimates come from
RANGES = re.compile(r"command (\S+) to (\S+)(?: ([^,]*))?, force (\S+) to (\S+)(?: ([^:]*))?")


class ForceRegression(Section):
    """A regression of force on the roughness asked for, F_ref = constant + slope ln Ra, in ``unit``.

    Examples
    --------
    >>> ForceRegression(constant=450.0, slope=260.0).unit
    'N'
    """

    constant: Number
    slope: Positive
    unit: Text = "N"


class RoughnessSection(Section):
    """Reference force for a roughness, and the limits of the feed override that holds it.

    Attributes
    ----------
    law : str
        The roughness law of the file, by the symbol of its response.
    roughness : float
        The roughness asked for, unit_roughness.
    force : float
        The reference, unit_force; ``force_from`` is the ``inverse`` of the law or a ``regression`` of force
        on roughness.
    regression : ForceRegression or None
        The second of these, for a roughness that is changed along the run.
    threshold : float
        Force below which there is no cut, and the override is left alone.
    threshold_time : float or None
        s that the force stays above the threshold before the control acts.
    override_low, override_high : float
        Shares of the programmed feed.
    feed, chip_thickness : float or None
        Programmed feed and largest uncut chip thickness, unit_feed.
    sample_time, servo_time : float or None
        s between force samples, and the time constant of the feed drive.
    force_per_feed, process_time : float or None
        Of the cut that a replay simulates: kc a, unit_force per unit_feed, and the time constant of the process, s.
    force_low, force_high : float or None
        A reading at or beyond these is invalid, unit_force.
    spindle_speed : float or None
        1/min, of the cut; a time per revolution and a feed per minute follow from it.
    depth, nose_radius : float or None
        Depth of the cut and nose radius of the tool, unit_depth.
    sources : dict of str
        Origin of the values, one sentence for each field that was derived or given.
    notes : tuple of str

    Examples
    --------
    >>> RoughnessSection(law="Ra", roughness=1.0, force=420.0, threshold=100.0, override_high=1.5).override_low
    0.0
    """

    law: Text
    roughness: Positive
    unit_roughness: Text = "um"
    force: Positive
    unit_force: Text = "N"
    force_from: Literal["inverse", "regression"] = "inverse"
    regression: ForceRegression | None = None
    threshold: NotNegative
    threshold_time: NotNegative | None = None
    override_low: NotNegative = 0.0
    override_high: Positive
    feed: Positive | None = None
    chip_thickness: Positive | None = None
    unit_feed: Text = "mm/rev"
    sample_time: Positive | None = None
    servo_time: NotNegative | None = None
    force_per_feed: Positive | None = None
    process_time: NotNegative | None = None
    force_low: Number | None = None
    force_high: Number | None = None
    spindle_speed: Positive | None = None
    depth: Positive | None = None
    nose_radius: Positive | None = None
    unit_depth: Text = "mm"
    sources: dict[str, Text] = Field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.override_low >= self.override_high:
            raise ValueError(f"the override {self.override_low:g} to {self.override_high:g} leaves no range")
        if self.threshold >= self.force:
            raise ValueError(f"the threshold {self.threshold:g} is not below the reference force {self.force:g}")
        if self.regression is not None and self.regression.unit != self.unit_force:
            raise ValueError(
                f"the regression is in {short(self.regression.unit)}, the force in {short(self.unit_force)}"
            )
        if self.force_from == "regression" and self.regression is not None:
            implied = self.regression.constant + self.regression.slope * math.log(self.roughness)
            if abs(implied - self.force) > ROUNDING * self.force:
                raise ValueError(f"the reference force {self.force:g} is not that of its regression, {implied:g}")
        return self


class SetPoint(Section):
    """The force asked for at a depth of cut.

    Examples
    --------
    >>> SetPoint(depth=1.0, force=150.0).force
    150.0
    """

    depth: Positive
    force: Positive


class RecordRanges(NamedTuple):
    """Smallest and largest command and force of the record that estimates come from.

    Examples
    --------
    >>> ranges = RecordRanges((100.0, 400.0), (35.5, 250.0))
    >>> RecordRanges.parsed(ranges.words("mm/min", "N", "run.csv")) == ranges
    True
    """

    command: tuple[float, float]
    force: tuple[float, float]

    @classmethod
    def of(cls, command: Array, force: Array) -> Self:
        """The ranges of a record: command and force, shape (n,)."""
        return cls((float(command.min()), float(command.max())), (float(force.min()), float(force.max())))

    def words(self, unit_u: str, unit_force: str, name: str) -> str:
        """The ranges in a sentence, as ``sources`` holds them."""
        (a, b), (c, d) = self
        command = f"{a:.6g} to {b:.6g} {unit_u}".rstrip()
        return f"command {command}, force {c:.6g} to {d:.6g} {unit_force}: smallest and largest values of {name}"

    @classmethod
    def parsed(cls, words: str) -> Self | None:
        """The ranges of such a sentence; None where it is another one."""
        found = RANGES.match(words)
        try:
            a, b, c, d = map(float, found.group(1, 2, 4, 5) if found else ())
        except ValueError:
            return None
        return cls((a, b), (c, d))


class AdaptiveForceSection(Section):
    """Initial estimates and settings of an adaptive force controller; settings that are not stated are None.

    Attributes
    ----------
    m, alpha, beta : float
        Estimates divided by k, for a command in unit_u and a force in unit_force; times in s.
    uncertainty : ModelCovariance or NoCovariance or None
        Of m, alpha, beta.
    g1, g2, g3 : float or None
        Rates of adaptation; 0 freezes an estimate.
    Kd : float or None
        Gain, in the units of alpha.
    lam : float or None
        lambda of E, 1/s.
    set_points : tuple of SetPoint
        Forces by depth, in unit_force and unit_depth.
    reference_time, reference_damping : float or None
        s and damping ratio of the second-order model that makes F_d from a set point.
    sample_time : float or None
        s of a step of the law.
    average_time : float or None
        s over which the force is averaged, a revolution of the spindle; adaptation stops while the command is
        limited.
    low, high : float or None
        Limits of the command, unit_u.
    depth : float or None
        Of the run that the estimates come from, unit_depth.
    force_low, force_high : float or None
        A reading at or beyond these is invalid, unit_force.
    spindle_speed : float or None
        1/min, of the run that the estimates come from.
    sources : dict of str
        Origin of the values, one sentence for each field that was derived or given; ``tested`` holds the ranges of
        command and force of the record.
    verdict : VerdictSection or None
        How far the estimates can be used; None where they were not judged.
    notes : tuple of str

    Examples
    --------
    >>> section = AdaptiveForceSection(m=0.01, alpha=0.2, beta=1.0, g1=0.0, g2=0.0, g3=1e-4, Kd=0.5, lam=10.0,
    ...                         set_points=[{"depth": 1.0, "force": 150.0}])
    >>> section.set_points[0].force
    150.0
    """

    m: Positive
    alpha: Number
    beta: Number
    uncertainty: Annotated[ModelCovariance | NoCovariance, Field(discriminator="kind")] | None = None
    g1: NotNegative | None = None
    g2: NotNegative | None = None
    g3: NotNegative | None = None
    Kd: Positive | None = None
    lam: Positive | None = None
    set_points: Annotated[tuple[SetPoint, ...], Field(max_length=1000)] = ()
    unit_u: str = ""
    unit_force: str = "N"
    unit_depth: str = "mm"
    reference_time: Positive | None = None
    reference_damping: Positive | None = None
    sample_time: Positive | None = None
    average_time: Positive | None = None
    low: Number | None = None
    high: Number | None = None
    depth: Positive | None = None
    force_low: Number | None = None
    force_high: Number | None = None
    spindle_speed: Positive | None = None
    sources: dict[str, Text] = Field(default_factory=dict)
    verdict: VerdictSection | None = None
    notes: tuple[str, ...] = ()

    @property
    def tested(self) -> RecordRanges | None:
        """Ranges of the record that the estimates come from; None where they are not known."""
        return RecordRanges.parsed(self.sources.get(TESTED, ""))

    @property
    def tested_units(self) -> tuple[str, str] | None:
        """Units of command and force of these ranges; None where the ranges are not known."""
        found = RANGES.match(self.sources.get(TESTED, ""))
        return (found[3] or "", found[6] or "") if found else None


class DriveSection(Section):
    """Inertia and friction of a drive: F = M a + Fv v + Fc sign(v) + offset.

    Attributes
    ----------
    M, Fv, Fc, offset : float
        Inertia, viscous friction, Coulomb friction and constant force, in unit_inertia, unit_viscous and unit_force.
    uncertainty : ModelCovariance or NoCovariance
        Of M, Fv, Fc, offset.
    unit_inertia, unit_viscous, unit_force, unit_speed : str
        kg, N s/m, N and m/s; kg m^2, N m s/rad, N m and rad/s of a rotary drive.
    input, output, unit_u, unit_y : str
        Signals of the record.
    force_per_unit : float or None
        unit_force for one unit of the input, where it was given.
    relative_error : float
        Norm of the force that is not explained over that of the force, both low-pass filtered.
    simulated_fit : float or None
        Per cent of the speed that a simulation from the force alone explains, 100 (1 - rms error / rms), on the samples
        fitted; ``held_out_fit`` on the record with checksum ``held_out_sha256``.
    sample_time, cutoff : float or None
        s of the record, and corner of the low-pass, Hz.
    n, record_sha256
        Rows fitted, and the checksum of their record.
    verdict : VerdictSection or None
        How far the values can be used; None where they were not judged.
    notes : tuple of str

    Examples
    --------
    >>> given = {"kind": "none", "reason": "data sheet"}
    >>> DriveSection(M=95.0, Fv=203.0, Fc=20.4, uncertainty=given).unit_inertia
    'kg'
    """

    M: Number
    Fv: Number
    Fc: Number
    offset: Number = 0.0
    uncertainty: Annotated[ModelCovariance | NoCovariance, Field(discriminator="kind")]
    unit_inertia: Text = "kg"
    unit_viscous: Text = "N s/m"
    unit_force: Text = "N"
    unit_speed: Text = "m/s"
    input: str = "F"
    output: str = "x"
    unit_u: str = ""
    unit_y: str = ""
    force_per_unit: Number | None = None
    relative_error: NotNegative | None = None
    simulated_fit: Number | None = None
    sample_time: Positive | None = None
    cutoff: Positive | None = None
    n: Count | None = None
    record_sha256: Sha256 | None = None
    held_out_fit: Number | None = None
    held_out_sha256: Sha256 | None = None
    verdict: VerdictSection | None = None
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _of_its_coefficients(self) -> Self:
        if isinstance(self.uncertainty, ModelCovariance) and set(self.uncertainty.of) != set(COEFFICIENTS):
            raise ValueError(f"the covariance must be of {', '.join(COEFFICIENTS)}")
        return self
