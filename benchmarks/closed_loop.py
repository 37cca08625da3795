"""Recognition of feedback, and errors of |G| identified from loop data, over plants, noises, delays and references.

    python benchmarks/closed_loop.py [--draws 10] [--file RESULTS.json]

Five plants under a digital PI (the published plant; lag 0.3 s; lag 0.5 s with delay 4; two lags; a mode of 1.5 Hz with
damping 0.3), 750 samples at 50 Hz. The PI uses the output of the same sample or of the one before. Noise of 30 dB is
white or autoregressive (0.8) at the sensor, or enters through the poles of the plant. The error is the largest
| |G| / |G true| - 1 | at 40 frequencies from 0.1 to 2 Hz. Aims: chirp loops found in at least 95 %, at most 1 % false
alarms; median error at most 5 %, 90 % quantile 15 %. Results are kept in the file, from which an interrupted study is
continued.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from fitmodels.core.errors import IdentError
from fitmodels.datasets import Record
from fitmodels.ident import Model, identify
from fitmodels.ident.closed_loop import checked_feedback, feedback
from scipy.signal import cont2discrete, lfilter

T, N, SNR = 0.02, 750, 30.0
BAND = np.geomspace(0.1, 2.0, 40)
REFERENCES = ("chirp", "prbs", "steps", "irregular", "constant")
NOISES = ("white", "ar", "equation")
OPEN_SNR = (60.0, 30.0, 10.0)


def lag(tau, delay):
    pole = np.exp(-T / tau)
    return np.r_[np.zeros(delay + 1), 1 - pole], np.array([1.0, -pole])


def held(num, den):
    b, a, _ = cont2discrete((num, den), T)
    return b.ravel(), a


W = 2 * np.pi * 1.5
PLANTS = {  # b, a, Kp and integral time in s of the PI
    "published": (np.array([0, 0.0611, -0.1338, 0.0752]), np.array([1, -2.0311, 1.2104, -0.1655]), (0.5, 1.2)),
    "lag": (*lag(0.3, 0), (1.5, 0.3)),
    "lag, delay 4": (*lag(0.5, 4), (1.5, 0.5)),
    "two lags": (*held([1], [0.03, 0.4, 1]), (1.5, 0.35)),
    "mode": (*held([W * W], [1, 0.6 * W, W * W]), (0.3, 0.4)),
}


def signals(kind, draws, rng):
    """References, shape (draws, N), about 0."""
    if kind == "chirp":
        t = np.arange(N) * T
        return np.tile(np.sin(2 * np.pi * (0.1 + 1.9 / (2 * N * T) * t) * t), (draws, 1))
    if kind == "prbs":
        return np.repeat(np.sign(rng.standard_normal((draws, N // 10 + 1))), 10, axis=1)[:, :N]
    if kind == "steps":
        return np.repeat(rng.choice([-1.0, 0.0, 1.0], (draws, N // 100 + 1)), 100, axis=1)[:, :N]
    return lfilter([0.3], [1, -0.7], rng.standard_normal((draws, N)), axis=1) * (kind == "irregular")


def noises(kind, a, draws, rng):
    """Noise of standard deviation 1, shape (draws, N)."""
    den = {"white": [1.0], "ar": [1.0, -0.8], "equation": a}[kind]
    h = lfilter([1.0], den, np.r_[1.0, np.zeros(2999)])
    return lfilter([1.0], den, rng.standard_normal((draws, N + 300)), axis=1)[:, 300:] / np.sqrt(h @ h)


def simulated(plant, r, noise, late):
    """u and y of all draws at once, about the operating point y = 1."""
    b, a, (kp, ti) = PLANTS[plant]
    o = len(b) + len(a) + 8
    rest = a.sum() / b.sum()
    u, x, y = np.full((len(r), N + o), rest), np.ones((len(r), N + o)), np.ones((len(r), N + o))
    total = np.full(len(r), rest)
    for t in range(o, N + o):
        x[:, t] = u[:, t - len(b) + 1 : t] @ b[:0:-1] - x[:, t - len(a) + 1 : t] @ a[:0:-1]
        y[:, t] = x[:, t] + noise[:, t - o]
        error = 1 + r[:, t - o] - y[:, t - late]
        total = total + kp * T / ti * error
        u[:, t] = kp * error + total
    return u[:, o:], y[:, o:]


def records(plant, reference, noise, late, draws, named=False):
    """Records in closed loop."""
    rng = np.random.default_rng(
        [2026, list(PLANTS).index(plant), REFERENCES.index(reference), NOISES.index(noise), late]
    )
    r = signals(reference, draws, rng)
    v = noises(noise, PLANTS[plant][1], draws, rng)
    moving = simulated(plant, r, np.zeros_like(v), late)[1].std(axis=1)
    size = (moving if reference != "constant" else np.ones(draws)) * 10 ** (-SNR / 20)
    u, y = simulated(plant, r, size[:, None] * v, late)
    return [Record(u=u[k], y=y[k], sample_time=T, reference=r[k] + 1 if named else None) for k in range(draws)]


def open_records(plant, kind, noise, snr, draws):
    """Records in open loop with the same signals as input."""
    rng = np.random.default_rng([7, list(PLANTS).index(plant), REFERENCES.index(kind), NOISES.index(noise), int(snr)])
    b, a, _ = PLANTS[plant]
    u = signals(kind, draws, rng)
    x = lfilter(b, a, u, axis=1)
    y = x + noises(noise, a, draws, rng) * x.std(axis=1)[:, None] * 10 ** (-snr / 20)
    return [Record(u=u[k], y=y[k], sample_time=T) for k in range(draws)]


def state(rec):
    """State of the test, or "refused" where the reference is constant."""
    try:
        return checked_feedback(rec.centred()).state
    except IdentError:
        return "refused"


def recognition(draws):
    """Share of each state, by reference and delay of the controller, and of inputs in open loop."""
    out = {}
    for reference in REFERENCES:
        for late in (0, 1):
            found = [state(r) for p in PLANTS for n in NOISES for r in records(p, reference, n, late, draws)]
            out[f"loop, {reference}, controller delay {late}"] = shares(found)
        if reference != "constant":
            cells = [(p, n, snr) for p in PLANTS for n in NOISES for snr in OPEN_SNR]
            found = [feedback(r).state for p, n, snr in cells for r in open_records(p, reference, n, snr, draws)]
            out[f"open, {reference}"] = shares(found)
    return out


def shares(states):
    return {s: states.count(s) / len(states) for s in ("found", "refused", "undecided", "none")} | {"n": len(states)}


def gain_error(model, plant):
    b, a, _ = PLANTS[plant]
    true = Model(b=b, a=a, nk=int(np.flatnonzero(b)[0]), sample_time=T)
    return float(np.abs(np.abs(model.response(BAND)) / np.abs(true.response(BAND)) - 1).max())


def cell(plant, reference, noise, late, named, draws):
    """Errors of the direct and of the two-stage estimate, and levels of the verdict; 9 for a refusal."""
    out = {"direct": [], "two-stage": [], "level": []}
    for rec in records(plant, reference, noise, late, draws, named):
        try:
            found = identify(rec)
        except IdentError:
            out["direct"].append(9.0)
            out["level"].append(3)
            continue
        out["direct"].append(gain_error(found.model, plant))
        out["level"].append(found.verdict.level)
        if found.loop.two_stage is not None:
            out["two-stage"].append(gain_error(found.loop.two_stage, plant))
    return out


def quantiles(values):
    return "{:6.1f} {:6.1f}".format(*(100 * np.quantile(values, [0.5, 0.9]))) if values else "     -      -"


def study(draws, path):
    kept = json.loads(path.read_text()) if path.exists() else {}
    key = f"recognition {draws}"
    if key not in kept:
        kept[key] = recognition(draws)
        path.write_text(json.dumps(kept))
    print(f"feedback, share of records (noise {SNR:g} dB in the loop; 60, 30 and 10 dB in open loop)")
    for name, found in kept[key].items():
        shown = ", ".join(f"{s} {100 * found[s]:.1f} %" for s in ("found", "refused", "undecided", "none") if found[s])
        print(f"  {name:<38}{found['n']:>5}  {shown}")
    print("\nlargest error of |G| in %, median and 90 %, over plants, noises and controller delay 0 and 1")
    print(f"  {'reference':<24}{'direct':>14}  {'two-stage':>14}  usable, reservations, do not use, refused")
    for reference in REFERENCES[:4]:
        for named in (False, True):
            rows = []
            for plant in PLANTS:
                for noise in NOISES:
                    for late in (0, 1):
                        name = f"{plant} {reference} {noise} {late} {named} {draws}"
                        if name not in kept:
                            kept[name] = cell(plant, reference, noise, late, named, draws)
                            path.write_text(json.dumps(kept))
                            print(f"\r{name:<70}", end="", file=sys.stderr, flush=True)
                        rows.append(kept[name])
            direct, two, level = ([v for row in rows for v in row[k]] for k in ("direct", "two-stage", "level"))
            label = f"{reference}, {'recorded' if named else 'not recorded'}"
            levels = " ".join(f"{np.mean(np.equal(level, k)):6.2f}" for k in range(4))
            print(f"\r  {label:<24}{quantiles(direct):>14}  {quantiles(two):>14}  {levels}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--file", type=Path, default=Path("closed_loop.json"))
    given = parser.parse_args()
    study(given.draws, given.file)
