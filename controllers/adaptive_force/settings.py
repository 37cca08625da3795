"""ForceSettings of the adaptive force controller from a parameter file, validated on entry."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.display import Displayable
from ...core.errors import GateError, UsageError

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.sections.force_control import AdaptiveForceSection

TEETH = 2  # assumed
NEEDED = (
    "g1", "g2", "g3", "Kd", "lam", "unit_u", "reference_time", "reference_damping", "sample_time", "average_time",
    "low", "high", "force_low", "force_high",
)  # fmt: skip


@dataclass(frozen=True, slots=True, repr=False)
class ForceSettings(Displayable):
    """Settings of the adaptive_force section, complete and in its units.

    Attributes
    ----------
    samples : int
        Steps of the law in ``average_time``.
    set_point : float
        Set point of the force at ``depth``.
    """

    m: float
    alpha: float
    beta: float
    g1: float
    g2: float
    g3: float
    Kd: float
    lam: float
    reference_time: float
    reference_damping: float
    sample_time: float
    samples: int
    low: float
    high: float
    force_low: float
    force_high: float
    set_point: float
    depth: float
    labels: tuple[str, str]

    def steps_in(self, dt: float) -> int:
        """Number of steps of the law in a call; UsageError unless it is whole."""
        steps, step = round(dt / self.sample_time), self.sample_time
        if steps < 1 or abs(dt - steps * step) > 1e-6 * dt:
            raise UsageError(f"a step of {dt:g} s: the law takes whole steps of {step:g} s; replay it at a multiple.")
        return steps


def settings_for(pf: "ParameterFile", depth: float) -> ForceSettings:
    """Settings for a depth of cut, one of the file's set points.

    Raises
    ------
    GateError
        The file fails the check, verdicts apart, lacks a setting, or has no set point for this depth.
    """
    from ...parameters.checks import check

    if why := lacking(pf):
        raise GateError(why)
    failed = check(pf).inconsistent
    if failed:
        raise GateError(f"the file fails the check: {failed[0].words}")
    section = _section(pf)
    held = {name: getattr(section, name) for name in ForceSettings.__dataclass_fields__ if hasattr(section, name)}
    samples = round((section.average_time or 0.0) / held["sample_time"])
    return ForceSettings(
        **{**held, "depth": depth}, samples=samples, set_point=_set_point(section, depth),
        labels=(f"feed command, {section.unit_u}", f"force, {section.unit_force}"),
    )  # fmt: skip


def lacking(pf: "ParameterFile") -> str:
    """Reason why a file cannot drive the adaptive controller, with the remedy; empty where it can."""
    section = pf.adaptive_force
    if section is None:
        return "the file has no adaptive_force section: give collect(adaptive_force=...) its estimates and settings."
    missing = [name for name in NEEDED if getattr(section, name) in (None, "")]
    if not section.set_points:
        missing.append("set_points")
    if missing:
        return f"adaptive_force: {', '.join(missing)} not stated; derive them: fitmodels adaptive-force."
    low, high, step, average = (getattr(section, n) for n in ("low", "high", "sample_time", "average_time"))
    if not 0 < low < high:
        return f"adaptive_force: the command's limits are {low:g} to {high:g} {section.unit_u}; 0 < low < high."
    if abs(average / step - round(average / step)) > 1e-6 or average < step:
        return f"adaptive_force: average_time {average:g} s is not a multiple of the step of {step:g} s."
    if not section.force_low < min(p.force for p in section.set_points):  # type: ignore[operator]
        return "adaptive_force: force_low does not lie below every set point; no reading would be valid."
    if not section.force_high > max(p.force for p in section.set_points):  # type: ignore[operator]
        return "adaptive_force: force_high does not lie above every set point; no reading would be valid."
    return ""


def machine(pf: "ParameterFile") -> tuple[float, float, float]:
    """Plant parameters m, c and k per unit of depth, for d = 1 and the drive as the slower pole.

    Raises
    ------
    GateError
        Missing estimates or their depth, or complex or unstable poles.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> [round(x, 1) for x in machine(published("LYAP"))]
    [0.1, 50.1, 20.0]
    """
    section = pf.adaptive_force
    if section is None or section.depth is None:
        raise GateError(
            "adaptive_force: no estimates with the depth they come from, so the plant is unknown; add them."
        )
    poles = np.roots([section.m, section.alpha, section.beta])
    if np.abs(poles.imag).max() > 0 or poles.max() >= 0:
        raise GateError("adaptive_force: m, alpha, beta give complex or unstable poles; identify them again.")
    slow, fast = sorted(-poles.real)
    m = 1 / slow  # of d = 1
    return float(m), float(fast), float(m / section.m / section.depth)


def tooth_frequency(pf: "ParameterFile") -> float:
    """Tooth frequency, Hz, of an assumed two flutes: the section has no number of flutes."""
    average = _section(pf).average_time
    return TEETH / average if average else 100.0


def _section(pf: "ParameterFile") -> "AdaptiveForceSection":
    if pf.adaptive_force is None:
        raise GateError(lacking(pf))
    return pf.adaptive_force


def _set_point(section: "AdaptiveForceSection", depth: float) -> float:
    found = {point.depth: point.force for point in section.set_points}
    if depth not in found:
        there = ", ".join(f"{known:g}" for known in found)
        raise GateError(
            f"adaptive_force: no set point for a depth of {depth:g} {section.unit_depth}; there are {there}: add it."
        )
    return found[depth]
