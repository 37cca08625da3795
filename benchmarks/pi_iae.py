"""Least load IAE and least IAE found by the tuning of PI gains, against an independent global search.

    python benchmarks/pi_iae.py [words of plant names]

Plants at 50 Hz: those of the identification bank that a PI can stabilise (lags, delays, a lightly damped drive, an
integrator, non-minimum phase, fifth order), and delay-dominated ones (delay up to 100 times the time constant).
Limits: Ms <= 1.6, with and without overshoot <= 2 %, and the integral time that the tuning assumes. The search is
differential evolution over log Kp, log Ki of a loop written here again (scipy's lfilter, roots of the characteristic
polynomial, |S| on 6000 frequencies), then Nelder-Mead from its end and from the tuned gains. Aim: the objective of the
tuned gains is within 5 % of the best, and no limit is violated.
"""

import sys
import time
from dataclasses import dataclass

import numpy as np
from fitmodels.ident.model import Model
from fitmodels.ident.pi.tuning import tune_pi
from scipy.optimize import differential_evolution, minimize
from scipy.signal import cont2discrete, lfilter

T = 0.02
AIMS = ("disturbance_iae", "iae")
OVERSHOOT = 0.02
MS = 1.6
THETA = np.unique(np.r_[np.geomspace(1e-6, np.pi, 3000), np.linspace(1e-3, np.pi, 3000)])
Z = np.exp(-1j * THETA)
SLACK = 1e-3  # relative: Ms lies on its limit


def discrete(num, den, delay=0):
    """Numerator and denominator in z^-1 of num(s)/den(s) behind a hold and whole samples of delay."""
    b, a, _ = cont2discrete((num, den), T, method="zoh")
    return np.r_[np.zeros(delay), np.ravel(b)], a


def lag(constant, delay=0):
    pole = np.exp(-T / constant)
    return np.r_[np.zeros(delay + 1), 1 - pole], np.array([1.0, -pole])


def fractional_lag():
    """Lag of .2 s with a delay of 2.5 samples: the modified z-transform."""
    pole, half = np.exp(-T / 0.2), np.exp(-T / 0.4)
    return np.array([0, 0, 0, 1 - half, half - pole]), np.array([1.0, -pole])


def fifth_order():
    return discrete([1.0], np.poly(-np.ones(5)))


PLANTS = {
    "CLM-2023 eq. 18": (np.array([0.0, 0.0611, -0.1338, 0.0752]), np.array([1.0, -2.0311, 1.2104, -0.1655])),
    "lag .2 s, delay 2.5 samples": fractional_lag(),
    "(.6 q^-2 - .2 q^-3)/(1 - .5 q^-1)": (np.array([0, 0, 0.6, -0.2]), np.array([1.0, -0.5])),
    "lightly damped drive": discrete([400.0], [1.0, 4.0, 400.0]),
    "integrator with friction": discrete([1.0], [1.0, 2.0, 0.0]),
    "lag 1 s, delay 12 samples": lag(1.0, 12),
    "non-minimum phase, third order": discrete([-0.3, 1.0], np.poly([-1.0, -2.0, -5.0]) / 10),
    "1/(s + 1)^5": fifth_order(),
    "lag .2 s, delay 10 samples": lag(0.2, 10),
    "lag .1 s, delay 50 samples": lag(0.1, 50),
    "lag .02 s, delay 25 samples": lag(0.02, 25),
    "lag .02 s, delay 100 samples": lag(0.02, 100),
    "delay 20 samples alone": (np.r_[np.zeros(20), 2.0], np.array([1.0])),
    "two lags .1 s, delay 40 samples": (
        np.convolve(lag(0.1, 40)[0], lag(0.1)[0]), np.convolve(lag(0.1)[1], lag(0.1)[1])
    ),
    "integrator, delay 20 samples": (np.r_[np.zeros(21), T], np.array([1.0, -1.0])),
}  # fmt: skip


@dataclass(frozen=True)
class Found:
    """Objective, Ms, overshoot, and gains."""

    aim: float
    ms: float
    overshoot: float
    kp: float
    ki: float

    def worst(self, limits):
        values = self.ms, self.overshoot, self.kp / self.ki
        return max(0.0, *(v / limit - 1 for v, limit in zip(values, limits, strict=True)))


def added(one, other):
    n = max(len(one), len(other))
    return np.pad(one, (0, n - len(one))) + np.pad(other, (0, n - len(other)))


class Loops:
    """Loops of one plant with a PI in backward integration."""

    def __init__(self, b, a):
        self.b, self.a = b, a
        self.free = np.convolve(a, [1.0, -1.0])
        with np.errstate(all="ignore"):
            self.plant = np.polyval(b[::-1], Z) / np.polyval(a[::-1], Z)

    def at(self, kp, ki, aim):
        """The loop at two gains; None where it is unstable."""
        pi = np.array([kp + ki * T, -kp])
        closed = added(self.free, np.convolve(self.b, pi))
        radius = np.abs(np.roots(np.trim_zeros(closed, "b"))).max()
        if radius >= 1 - 1e-5:
            return None
        n = int(np.clip(np.log(1e-5) / np.log(radius), 200, 60000))
        reference = lfilter(np.convolve(self.b, pi), closed, np.ones(n))
        if aim == "iae":
            value = T * np.abs(1 - reference).sum()
        else:
            value = T * np.abs(lfilter(np.convolve(self.b, [1.0, -1.0]), closed, np.ones(n))).sum()
        ms = 1 / np.abs(1 + self.plant * np.polyval(pi[::-1], Z) / (1 - Z)).min()
        return Found(value, ms, max(reference.max() - 1, 0.0), kp, ki)

    def cost(self, x, aim, limits, sign, scale):
        """Logarithm of the objective, with a penalty for violated limits; x = log10 of gains."""
        found = self.at(sign * 10 ** x[0], sign * 10 ** x[1], aim)
        if found is None:
            return 1e3
        return np.log(found.aim / scale) + 50 * found.worst(limits)


def best(loops, aim, limits, starts):
    """The best of two global searches and of local ones from them and from given gains; else the least violation."""
    sign = np.sign(starts[0][1])
    kp, ki = (max(abs(s[k]) for s in starts) for k in (0, 1))
    box = [(np.log10(max(kp, ki * T)) - 4, np.log10(max(kp, ki * T)) + 1.5), (np.log10(ki) - 2, np.log10(ki) + 1.5)]
    scale = loops.at(*starts[0], aim).aim
    ends = [
        differential_evolution(
            loops.cost, box, (aim, limits, sign, scale), popsize=24, maxiter=60, tol=1e-6, polish=False, rng=seed
        ).x
        for seed in (1, 2)
    ]
    ends += [np.log10(np.maximum(np.abs(s), 10.0 ** np.array([b[0] for b in box]))) for s in starts]
    found = []
    for end in ends:
        local = minimize(
            loops.cost, end, (aim, limits, sign, scale), "Nelder-Mead", options={"xatol": 1e-6, "maxiter": 400}
        )
        found.append(loops.at(*(sign * 10**local.x), aim))
    found = [f for f in found if f is not None]
    held = [f for f in found if f.worst(limits) <= SLACK]
    return min(held, key=lambda f: f.aim) if held else min(found, key=lambda f: f.worst(limits))


def compare(name, aim, overshoot):
    """Ratio of the tuned objective to the best; prints a line."""
    b, a = PLANTS[name]
    loops = Loops(b, a)
    begin = time.perf_counter()
    model = Model(b=b, a=a, nk=int(np.flatnonzero(b)[0]), sample_time=T)
    pi = tune_pi(model, aim=aim, overshoot=OVERSHOOT if overshoot else None, n=60)
    seconds = time.perf_counter() - begin
    limits = MS, OVERSHOOT if overshoot else np.inf, pi.specification.integral_time
    tuned = loops.at(pi.kp, pi.ki, aim)
    if tuned is None:
        print(f"{name}, {aim}: the tuned loop is unstable   <-- misses the aim")
        return np.inf
    found = best(loops, aim, limits, [(pi.kp, pi.ki)])
    over, least = tuned.worst(limits), found.worst(limits)
    ratio = tuned.aim / found.aim if least <= SLACK else (1 + over) / (1 + least)
    mark = "" if ratio <= 1.05 and over <= least + SLACK else "   <-- misses the aim"
    mark += "" if least <= SLACK else "   (no gains meet the limits: ratio of the violated one)"
    kind = "overshoot <= 2 %" if overshoot else "Ms alone"
    print(
        f"{name:34} {aim:15} {kind:16} {ratio:6.3f}  tuned {tuned.kp:8.4g} {tuned.ki:8.4g} Ms {tuned.ms:.3f} "
        f"os {100 * tuned.overshoot:4.1f} %  best {found.kp:8.4g} {found.ki:8.4g} Ms {found.ms:.3f} "
        f"os {100 * found.overshoot:4.1f} %  {seconds:.1f} s{mark}",
        flush=True,
    )
    return ratio if over <= least + SLACK else np.inf


def main(words):
    names = [n for n in PLANTS if not words or any(w in n for w in words)]
    ratios = {(n, aim, o): compare(n, aim, o) for n in names for aim in AIMS for o in (True, False)}
    worst = max(ratios, key=lambda key: ratios[key])
    good = sum(r <= 1.05 for r in ratios.values())
    print(f"\n{good} of {len(ratios)} within 5 % of the best; worst {ratios[worst]:.3f}: {', '.join(map(str, worst))}")


if __name__ == "__main__":
    main(sys.argv[1:])
