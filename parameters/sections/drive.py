"""Section of a feed drive: inertia and friction, identified from its force and its motion."""

from typing import Annotated, Final, Self

from pydantic import Field, model_validator

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
