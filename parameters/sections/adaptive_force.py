"""Adaptive force control in milling: estimates to start from, rates, and the forces asked for.

With F~ = F - F_d, E = F~' + lambda F~ (a Lyapunov design for drive m x'' + d x' = f and process F' + c F = k v):

    k u = m F_d'' + alpha F_d' + beta F_d - Kd E,    m' = -g1 E F_d'',  alpha' = -g2 E F_d',  beta' = -g3 E F_d
"""

from typing import Annotated

from pydantic import Field

from .base import NotNegative, Number, Positive, Section
from .covariance import ModelCovariance, NoCovariance


class SetPoint(Section):
    """The force asked for at a depth of cut.

    Examples
    --------
    >>> SetPoint(depth=1.0, force=150.0).force
    150.0
    """

    depth: Positive
    force: Positive


class AdaptiveForceSection(Section):
    """Everything an adaptive force controller starts with.

    Attributes
    ----------
    m, alpha, beta : float
        Estimates divided by k, for a command in unit_u and a force in unit_force; times in s.
    uncertainty : ModelCovariance or NoCovariance or None
        Of m, alpha, beta.
    g1, g2, g3 : float
        Rates of adaptation; 0 freezes an estimate.
    Kd : float
        Gain, in the units of alpha.
    lam : float
        lambda of E, 1/s.
    set_points : tuple of SetPoint
        Forces by depth, in unit_force and unit_depth.
    reference_time, reference_damping : float or None
        s and damping ratio of the second-order model that makes F_d from a set point.
    sample_time : float or None
        s of a step of the law.
    average_time : float or None
        s over which the force is averaged, a revolution of the spindle; adaptation stands still while the command is
        limited.
    low, high : float or None
        Limits of the command, unit_u.
    depth : float or None
        Of the run that the estimates come from, unit_depth.
    force_low, force_high : float or None
        A reading at or beyond these is none, unit_force.
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
    g1: NotNegative
    g2: NotNegative
    g3: NotNegative
    Kd: Positive
    lam: Positive
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
    notes: tuple[str, ...] = ()
