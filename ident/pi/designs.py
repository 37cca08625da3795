"""PI gains in closed form, to compare with: two gains for a crossover and a phase margin.

They know no specification: `tune_pi` does. Rules from a lag and a delay are in lag_designs.py.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.display import Displayable
from ...core.errors import IdentError
from ..model import Model

Array = NDArray[np.float64]
Plant = Model | tuple[ArrayLike, ArrayLike]
Integration = Literal["forward", "backward", "trapezoidal"]
# Least lag that the integral keeps at the crossover, rad, where the demanded margin leaves it none. Reconstructed from
# the vendor's published 43.9973 degrees, where a gain alone has 45: 45 degrees - 0.0175 rad.
LEAST_LAG = 0.0175
RULE = {"forward": (0.0, 1.0), "backward": (1.0, 0.0), "trapezoidal": (0.5, 0.5)}


@dataclass(frozen=True, slots=True, repr=False)
class Design(Displayable):
    """Gains of one closed-form rule, Kp + Ki / s in parallel form.

    Attributes
    ----------
    kp : float
        Unit of input per unit of output.
    ki : float
        The same, per second.
    crossover : float or None
        rad/s.
    phase_margin : float or None
        Degrees that the gains leave; below the demanded margin where that was out of reach.
    notes : tuple of str
    """

    kp: float
    ki: float
    crossover: float | None = None
    phase_margin: float | None = None
    notes: tuple[str, ...] = ()


def pi_by_margin(
    plant: Plant, crossover: float, phase_margin: float = 60.0, *, integration: Integration = "backward"
) -> Design:
    """The two gains that put the crossover where it is asked and leave the phase margin that is asked.

        C(jw) = exp(j (phase_margin - 180 degrees)) / G(jw) at w = crossover

    Parameters
    ----------
    plant : Model or (num, den)
        A model in z, or two polynomials in s, highest power first.
    crossover : float
        rad/s.
    phase_margin : float
        Degrees. A PI only lags: where it asks for a lead, the gains keep the least integral (0.0175 rad of lag) and
        the margin is what that leaves, told in ``notes``.
    integration : {"forward", "backward", "trapezoidal"}
        Of the sum, for a model in z.

    Raises
    ------
    IdentError
        A crossover or margin that cannot be, a crossover at which no PI leaves any margin, or an unstable loop.

    Examples
    --------
    >>> fast = pi_by_margin(([1.0], [1.0, 3.0, 3.0, 1.0]), crossover=0.5205, phase_margin=60)
    >>> round(fast.kp, 2), round(fast.ki, 3)
    (1.14, 0.454)
    """
    if not 0 < phase_margin < 180:
        raise IdentError(f"phase_margin {phase_margin:g} degrees: it lies between 0 and 180, usually 45 to 70.")
    rest = sign_at_rest(plant)
    designs = [by_sign(plant, crossover, phase_margin, integration, sign) for sign in (rest, -rest)]
    for design in designs:  # an unstable plant may need the other sign than its gain at rest has
        if design.phase_margin and closes_stable(plant, design.kp, design.ki, integration):
            return design
    first = designs[0]
    if not first.phase_margin:
        raise IdentError(
            f"crossover {crossover:g} rad/s: the plant lags so much there that no phase margin is left, and a PI adds "
            "to it. Ask for a lower crossover."
        )
    raise IdentError(
        f"crossover {crossover:g} rad/s with {first.phase_margin:.1f} degrees (Kp {first.kp:.4g}, Ki {first.ki:.4g} "
        "per second) closes an unstable loop: the gain passes 1 again, or the plant itself is unstable. Ask for "
        "another crossover."
    )


def by_sign(plant: Plant, crossover: float, asked: float, integration: Integration, sign: float) -> Design:
    """The gains of one sign; phase margin None where a PI of that sign leaves none."""
    g, lag_of_plant, integral = at_crossover(plant, crossover, integration, sign)
    lowest = float(np.angle(integral))  # -90 degrees, but for the rule of integration
    wanted = np.radians(asked) - np.pi + lag_of_plant
    phase = float(np.clip(wanted, lowest, -LEAST_LAG))
    margin = float(np.degrees(np.pi + phase - lag_of_plant))
    c = sign * np.exp(1j * phase) / abs(g)
    ki = float(c.imag / integral.imag)
    kp = 0.0 if phase == lowest else float(c.real) - ki * float(integral.real)
    if margin <= 0:
        return Design(kp, ki, float(crossover))
    return Design(kp, ki, float(crossover), margin, margin_notes(wanted, phase, asked, margin))


def margin_notes(wanted: float, phase: float, asked: float, margin: float) -> tuple[str, ...]:
    """What is said where the demanded margin is not the margin that is had."""
    if wanted > phase:
        return (f"phase margin {asked:g} degrees is out of reach at this crossover: {margin:.2f} is what a PI leaves.",)
    if wanted < phase:
        return (f"an integral alone leaves {margin:.2f} degrees, more than the {asked:g} asked for.",)
    return ()


def at_crossover(
    plant: Plant, crossover: float, integration: Integration, sign: float
) -> tuple[complex, float, complex]:
    """G, the lag of ``sign`` times G in rad, and the unit integral, at the crossover."""
    discrete = isinstance(plant, Model)
    highest = np.pi / plant.sample_time if isinstance(plant, Model) else np.inf
    if not 0 < crossover < highest:
        limit = f" and below {highest:.4g}, half the sample rate" if discrete else ""
        raise IdentError(f"crossover {crossover:g} rad/s: it lies above zero{limit}.")
    w = np.geomspace(1e-4 * crossover, crossover, 2000)
    if isinstance(plant, Model):
        z = np.exp(1j * w[-1] * plant.sample_time)
        late, early = RULE[integration]
        g, integral = plant.response(w / (2 * np.pi)), plant.sample_time * (late * z + early) / (z - 1)
    else:
        num, den = (np.asarray(p, dtype=np.float64) for p in plant)
        g, integral = np.polyval(num, 1j * w) / np.polyval(den, 1j * w), 1 / (1j * w[-1])
    if not np.isfinite(g).all() or g[-1] == 0:
        raise IdentError(f"the plant has no response at the crossover, {crossover:g} rad/s.")
    phase = np.unwrap(np.angle(sign * g))
    phase -= 2 * np.pi * np.round((phase[0] + np.pi / 2) / (2 * np.pi))  # begins within -270 to 90 degrees
    return complex(g[-1]), float(-phase[-1]), complex(integral)


def sign_at_rest(plant: Plant) -> float:
    """1 for a plant that ends by rising with its input, -1 for one that falls; poles at rest taken off."""
    if isinstance(plant, Model):
        at, (num, den) = 1.0, (p for p in plant.transfer_function[:2])
    else:
        at, (num, den) = 0.0, (np.asarray(p, dtype=np.float64) for p in plant)
    return float(np.sign(without_roots(num, at) * without_roots(den, at))) or 1.0


def without_roots(p: Array, at: float) -> float:
    """A polynomial at a point, divided by (x - at) as often as that is zero there."""
    while len(p) > 1 and abs(np.polyval(p, at)) <= 1e-12 * np.abs(p).sum():
        p = np.asarray(np.polydiv(p, [1.0, -at])[0], dtype=np.float64)
    return float(np.polyval(p, at))


def closes_stable(plant: Plant, kp: float, ki: float, integration: Integration) -> bool:
    """Whether the characteristic polynomial of the loop has its roots on the stable side."""
    if isinstance(plant, Model):
        num, den, dt = plant.transfer_function
        late, early = (ki * dt * share for share in RULE[integration])
        closed = np.polyadd(np.polymul(den, [1.0, -1.0]), np.polymul(num, [kp + late, early - kp]))
        return bool(np.abs(np.roots(closed)).max(initial=0.0) < 1)
    num, den = (np.asarray(p, dtype=np.float64) for p in plant)
    closed = np.polyadd(np.polymul(den, [1.0, 0.0]), np.polymul(num, [kp, ki]))
    return bool(np.roots(closed).real.max(initial=-np.inf) < 0)
