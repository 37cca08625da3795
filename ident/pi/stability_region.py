"""Stability region of the gains: the box that contains it, from the stability boundary (D-decomposition).

A pole crosses the unit circle at exp(jw) where C(exp(jw)) G(exp(jw)) = -1, two real equations linear in the two gains
(Neimark 1949). Their curve over w, with the lines where a pole crosses at 1 (ki = 0) and at -1, bounds every stable
region.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array
from ...core.display import Displayable
from ...core.errors import IdentError
from ..model import Model
from .gains import PiGains, basis
from .loops import loops_of, stable_columns

FREQUENCIES = 3000
DECADES = 6.0  # of gain searched below the largest; more for ki, which falls with the square of the bandwidth
DECADES_KI = 10.0
NO_GAIN = 1e-9  # of the sum of |b|: a static gain below it is rounding
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, repr=False)
class GainRange(Displayable):
    """Largest gains of the stability region, both of one sign.

    Attributes
    ----------
    kp, ki : float
        With the sign of the loop; ki per second.
    """

    kp: float
    ki: float


def gain_range(model: Model, template: PiGains) -> GainRange:
    """The box 0 ... kp, 0 ... ki that contains the stable loops with integral action, gains of one sign.

    Parameters
    ----------
    model : Model
    template : PiGains
        Controller apart from its gains: form, integration, delay, filter.

    Raises
    ------
    IdentError
        No PI with gains of one sign stabilises this model.
    """
    if abs(float(model.b.sum())) <= NO_GAIN * float(np.abs(model.b).sum()):
        raise IdentError(
            "the model has a static gain of zero (its b sums to zero): the integrator would diverge. "
            "Control another signal."
        )
    rest = sign_at_rest(model)
    for sign in (rest, -rest):
        for kp, ki in boxes(model, template, sign):
            found = largest_stable(model, template, sign * kp, sign * ki)
            if found is not None:
                return found
    raise IdentError(no_stable_gain(model))


def no_stable_gain(model: Model) -> str:
    """Error message for a model that no PI stabilises."""
    poles = int((np.abs(model.poles) >= 1 - 1e-9).sum())
    why = (
        f"{poles} of its poles lie at radius 1 or beyond (largest {model.radius:.4g})" if poles else "its delay is long"
    )
    return f"no PI with gains of one sign stabilises this model: {why}. Shorten the delay, or use another controller."


def boxes(model: Model, template: PiGains, sign: float) -> list[tuple[float, float]]:
    """Extents of the arcs of the boundary within the quadrant of ``sign``, from the lowest frequency on."""
    kp, ki = (sign * x for x in boundary(model, template))
    inside = np.flatnonzero((kp >= 0) & (ki >= 0) & np.isfinite(kp) & np.isfinite(ki))
    arcs = np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1)
    found = [(float(kp[arc].max()), float(ki[arc].max())) for arc in arcs if len(arc)]
    return [(p, i) for p, i in found if i > 0]


def boundary(model: Model, template: PiGains) -> tuple[Array, Array]:
    """Gains (kp, ki) with a pole at exp(jw), w from low to the Nyquist frequency; the last two have a pole at -1."""
    one = replace(template, kp=1.0, ki=1.0)
    over_kp, over_ki, den = basis(one)
    (above, below), path = one.feedback, one.command_path
    w = np.geomspace(1e-7, np.pi * (1 - 1e-9), FREQUENCIES)
    z = np.exp(-1j * np.r_[w, np.pi])  # z^-1

    def at(p: Array) -> NDArray[np.complex128]:
        return np.asarray(np.polyval(p[::-1], z), dtype=np.complex128)

    with np.errstate(all="ignore"):
        plant = at(model.b) * at(path) * at(above) / (at(model.a) * at(below) * at(den))
        x, p, q = -1 / plant, at(over_kp), at(over_ki)
        det = p.real * q.imag - p.imag * q.real
        cross = x.real * q.imag - x.imag * q.real
        # rounding of a difference that cancels: the boundary of an integrator is kp = 0
        kp = np.where(np.abs(cross) <= ROUNDING * np.abs(x) * np.abs(q), 0.0, cross / det)
        ki = (p.real * x.imag - p.imag * x.real) / det
        ends_kp, ends_ki = (x[-1] / p[-1]).real, (x[-1] / q[-1]).real
    return np.r_[kp[:-1], ends_kp, 0.0], np.r_[ki[:-1], 0.0, ends_ki]


def largest_stable(model: Model, template: PiGains, kp: float, ki: float) -> GainRange | None:
    """The stable part of a box, or None; on a logarithmic grid, then on a linear one."""
    for p, i in ((decades(kp), decades(ki, DECADES_KI)), (even(kp), even(ki))):
        p = np.r_[0.0, p] if kp else np.zeros(1)
        loops = loops_of(model, *grid(p, i), replace(template, kp=1.0, ki=1.0))
        stable = stable_columns(loops.characteristic)
        if stable.any():
            rows, columns = np.nonzero(stable.reshape(len(p), len(i)))
            top = (p[min(rows.max() + 1, len(p) - 1)], i[min(columns.max() + 1, len(i) - 1)])
            return GainRange(float(top[0]), float(top[1]))
    return None


def grid(kp: Array, ki: Array) -> tuple[Array, Array]:
    """All pairs of two arrays of gains as two flat arrays; kp changes slowest."""
    return np.repeat(kp, len(ki)), np.tile(ki, len(kp))


def decades(largest: float, span: float = DECADES, n: int = 50) -> Array:
    """``n`` logarithmically spaced values up to ``largest``, of its sign; zeros for zero."""
    return largest * np.logspace(-span, 0, n)


def even(largest: float, n: int = 40) -> Array:
    """``n`` evenly spaced values up to ``largest``, without zero."""
    return np.linspace(0, largest, n + 1)[1:]


def sign_at_rest(model: Model) -> float:
    """Sign of the gain at rest, 1 or -1, once poles and zeros at z = 1 are removed."""
    num, den, _ = model.transfer_function
    return float(np.sign(without_roots(num, 1.0) * without_roots(den, 1.0))) or 1.0


def without_roots(p: Array, at: float) -> float:
    """A polynomial at a point, with its roots there divided out."""
    while len(p) > 1 and abs(np.polyval(p, at)) <= 1e-12 * np.abs(p).sum():
        p = np.asarray(np.polydiv(p, [1.0, -at])[0], dtype=np.float64)
    return float(np.polyval(p, at))
