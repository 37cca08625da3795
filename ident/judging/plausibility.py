"""Poles and step of a model against what a machine can be and what the record can have shown."""

import numpy as np

from ..model import Model

RINGING = 0.1  # damping ratio below which an axis would be heard
FAST = 0.3  # radius of a pole at or near half the sample rate that is more than a fitting of noise


def settling_time(model: Model, share: float = 0.02) -> float:
    """Seconds after which the step response stays within ``share`` of its end; infinite where it never does.

    >>> round(settling_time(Model(b=[0.0, 0.1], a=[1.0, -0.9], nk=1, sample_time=0.1)), 6)
    3.8
    """
    if not model.stable:
        return float("inf")
    end, n = model.dc_gain, 256
    while True:
        step = model.simulate(np.ones(n))
        away = np.flatnonzero(np.abs(step - end) > share * max(abs(end), 1e-12 * np.abs(step).max()))
        settled = int(away[-1]) + 1 if away.size else 0
        if settled < n // 2 or n > 4_000_000:
            return settled * model.sample_time if settled < n else float("inf")
        n *= 4


def implausible(model: Model, longest: float) -> tuple[str, ...]:
    """What speaks against the poles and the step, in sentences; ``longest`` is the longest stretch in seconds."""
    told = []
    settling = settling_time(model)
    if settling > longest:
        told.append(
            f"the step settles in {settling:.3g} s and the longest stretch has {longest:.3g} s: the gain at rest "
            f"({model.dc_gain:.4g}) is a guess beyond the record"
        )
    for p in model.poles[np.abs(model.poles) > 0]:
        s = np.log(p) / model.sample_time
        damping, hertz = -s.real / abs(s), abs(s) / (2 * np.pi)
        if p.imag > 0 and damping < RINGING:
            told.append(f"a mode at {hertz:.3g} Hz rings (damping {damping:.2g}): see that a run shows it")
        if p.imag == 0 and p.real < -FAST:
            told.append(
                f"a pole at {p.real:.2g} alternates from sample to sample: an order too high, or the delay is wrong"
            )
    told += [
        f"pole {p:.3g} and zero {z:.3g} nearly cancel: one order less may do"
        for p in model.poles
        for z in model.zeros
        if abs(p - z) < 0.01 * (1 - min(abs(p), 0.99)) and p.imag >= 0
    ]
    return tuple(told)
