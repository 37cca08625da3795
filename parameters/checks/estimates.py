"""What was estimated: covariances, the posterior's gate, and an identified model that is stable and has a gain."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..errors import short_name
from ..sections.covariance import Covariance, ModelCovariance, complaint
from .finding import FileFinding

if TYPE_CHECKING:
    from ..file import ParameterFile
    from ..sections.dynamics import DynamicsSection
    from ..sections.posterior import LawPosterior

# Vehtari et al. 2021, doi 10.1214/20-BA1221, section 4.1; Vehtari et al. 2024, Pareto smoothed importance sampling
R_HAT, ESS, K_HAT = 1.01, 400.0, 0.7
SURE = 2.0  # standard errors that a gain at rest lies from zero


def estimates(pf: "ParameterFile") -> Iterator[FileFinding]:
    """Findings on covariances, on the posterior and on the dynamics."""
    yield from _covariances(pf)
    if pf.posterior is not None:
        for name, law in pf.posterior.laws.items():
            if law.reason is None:
                yield _gate(short_name(name), law)
    if pf.dynamics is not None:
        yield from _dynamics(pf.dynamics)


def _covariances(pf: "ParameterFile") -> Iterator[FileFinding]:
    held = [
        (f"laws.{short_name(name)}", law.uncertainty.matrix)
        for name, law in pf.laws.items()
        if isinstance(law.uncertainty, Covariance)
    ]
    for name, section in (("dynamics", pf.dynamics), ("adaptive_force", pf.adaptive_force)):
        if section is not None and isinstance(section.uncertainty, ModelCovariance):
            held.append((name, section.uncertainty.matrix))
    for where, matrix in held:
        size = len(matrix)
        why = complaint(np.array(matrix, dtype=np.float64).reshape(size, size))
        words = f"{where}: {why}." if why else f"{where}: the covariance has no negative variance in any direction."
        yield FileFinding("covariance", why is None, words)


def _gate(name: str, law: "LawPosterior") -> FileFinding:
    shut = []
    if law.r_hat is not None and law.r_hat > R_HAT:
        shut.append(f"R-hat {law.r_hat:.4g} is above {R_HAT:g}")
    if law.ess is None or law.ess < ESS:
        shut.append(f"{'no' if law.ess is None else format(law.ess, '.4g')} effective draws, below {ESS:g}")
    if law.k_hat is not None and law.k_hat > K_HAT:
        shut.append(f"k-hat {law.k_hat:.3g} is above {K_HAT:g}")
    if shut:
        return FileFinding("posterior", False, f"posterior.{name}: {'; '.join(shut)}; draw again.")
    return FileFinding("posterior", True, f"posterior.{name}: the draws pass the gate.")


def _dynamics(model: "DynamicsSection") -> Iterator[FileFinding]:
    with np.errstate(all="ignore"):
        radius = float(np.abs(model.poles).max(initial=0.0))
        gain = model.dc_gain
    if not model.stable:
        yield FileFinding("dynamics", False, f"dynamics: not stable, a pole at radius {radius:.6g}; identify again.")
        return
    yield FileFinding("dynamics", True, f"dynamics: stable, every pole within radius {radius:.6g}.")
    if not np.isfinite(gain) or gain == 0:
        yield FileFinding(
            "dynamics", False, f"dynamics: the gain at rest is {gain:g}, so no controller can hold a load."
        )
        return
    se = _gain_se(model)
    unit = f" {model.unit_y}/{model.unit_u}" if model.unit_u and model.unit_y else ""
    if se is not None and abs(gain) < SURE * se:
        words = f"dynamics: the gain at rest, {gain:.4g}{unit}, has a standard error of {se:.2g}: its sign is not known"
        yield FileFinding("dynamics", False, f"{words}; identify from a longer record or with more amplitude.")
        return
    known = "" if se is None else f", {abs(gain) / se if se else np.inf:.3g} standard errors from zero"
    yield FileFinding("dynamics", True, f"dynamics: the gain at rest is {gain:.4g}{unit}{known}.")


def _gain_se(model: "DynamicsSection") -> float | None:
    """Standard error of b(1)/a(1) by the delta method."""
    held = model.uncertainty
    if not isinstance(held, ModelCovariance):
        return None
    below, gain = float(np.sum(model.a)), model.dc_gain
    slope = np.array([(-gain if name.startswith("a") else 1.0) / below for name in held.of])
    with np.errstate(all="ignore"):
        variance = float(slope @ np.array(held.matrix) @ slope)
    return float(np.sqrt(variance)) if np.isfinite(variance) and variance >= 0 else None
