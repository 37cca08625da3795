"""Coverage of the confidence bands of gain and step response, and of measured frequency responses, over many records.

    python benchmarks/bands.py [draws]
    python benchmarks/bands.py measured [draws] [samples ...]

Output error on the published plant (Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 17 and 18) with 30 dB of
sensor noise. Aim: 95 % bands of |G| at 0.1, 0.5, 1 and 2 Hz and of the step cover 93 to 97 %.

``measured``: frequency responses without a model, over plants with and without narrow notches and resonances, sweeps,
pseudo-random and white inputs, lengths, and white or coloured noise at 30 dB; by the method that is chosen and by the
impulse response alone. Aims: 95 % bars cover 92 to 98 % over all records of 3000 samples and more, and at most 1 s for
1e5 samples. In 750 samples (15 s) features of 0.02 to 0.1 Hz are not resolved by any method: a note of the result.
"""

import sys
import time

import numpy as np
from fitmodels.datasets import Record
from fitmodels.ident.estimators.prediction_error import output_error
from fitmodels.ident.excitation.predicted_precision import predicted_errors
from fitmodels.ident.excitation.signals import chirp
from fitmodels.ident.model import Model
from fitmodels.ident.responses.confidence_bands import response_band, step_band
from fitmodels.ident.responses.frequency import frequency_response
from fitmodels.ident.responses.spectra import excited_band
from scipy.signal import lfilter

PLANT = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)
FREQUENCIES = np.array([0.1, 0.5, 1.0, 2.0])
TIMES = np.array([5, 10, 25, 50, 100, 150])  # samples of 0.02 s


def study(draws, measured):
    u, rng = chirp(), np.random.default_rng(2023)
    x = PLANT.simulate(u)
    sd = np.std(x) * 10 ** (-30 / 20)
    g, step = PLANT.response(FREQUENCIES), PLANT.simulate(np.ones(151))[TIMES]
    gain, phase, by_step, errors, raw = [], [], [], [], []
    for k in range(draws):
        rec = Record(u=u, y=x + sd * rng.standard_normal(len(x)), sample_time=0.02)
        model = output_error(rec, 3, 3)
        band, steps = response_band(model, FREQUENCIES), step_band(model, 3.0)
        gain.append((band.gain_low <= np.abs(g)) & (np.abs(g) <= band.gain_high))
        turn = np.degrees(np.angle(model.response(FREQUENCIES) / g))
        phase.append(np.abs(turn) <= band.phase_high - band.phase)
        by_step.append((steps.low[TIMES] <= step) & (step <= steps.high[TIMES]))
        errors.append(100 * (band.gain / np.abs(g) - 1))
        if k < measured:
            found = frequency_response(rec, FREQUENCIES)
            raw.append((found.gain_low <= np.abs(g)) & (np.abs(g) <= found.gain_high))
    predicted = predicted_errors(PLANT, u, sd, frequency=FREQUENCIES).response
    at = "".join(f"{f:9.1f} Hz" for f in FREQUENCIES)
    print(f"{draws} draws of output error{'':20}{at}")
    for name, rows in (("|G| covered, %", gain), ("phase covered, %", phase)):
        print(f"{name:<44}" + "".join(f"{100 * c:12.1f}" for c in np.mean(rows, axis=0)))
    print(f"{'standard deviation of |G|, %':<44}" + "".join(f"{s:12.3f}" for s in np.std(errors, axis=0)))
    print(f"{'predicted by predicted_errors, %':<44}" + "".join(f"{s:12.3f}" for s in predicted.gain_se))
    if raw:
        print(
            f"{f'measured response, {len(raw)} draws, |G| covered, %':<44}"
            + "".join(f"{100 * c:12.1f}" for c in np.mean(raw, axis=0))
        )
    print(f"{'step':<44}" + "".join(f"{t * 0.02:10.1f} s" for t in TIMES))
    print(f"{'step covered, %':<44}" + "".join(f"{100 * c:12.1f}" for c in np.mean(by_step, axis=0)))


def pair(hertz, radius):
    """Polynomial of a complex pair of roots at a frequency, for a sample time of 0.02 s."""
    return np.real(np.poly(radius * np.exp(2j * np.pi * hertz * 0.02 * np.array([1, -1]))))


PLANTS = {  # numerator, denominator, frequencies of narrow features in Hz
    "published": (PLANT.b, PLANT.a, ()),
    "lag with delay": ([0, 0, 0, 0.1], [1, -0.9], ()),
    "notch": (0.2 * np.r_[0, pair(1.0, 0.999)], np.convolve(pair(1.0, 0.9), [1, -0.3]), (1.0,)),
    "resonance": ([0, 0.1], np.convolve(pair(1.5, 0.995), [1, -0.5]), (1.5,)),
    "sharp resonance": ([0, 0.1], np.convolve(pair(1.5, 0.999), [1, -0.5]), (1.5,)),
}
HISTORY = 2000  # samples before the record, so that random inputs do not start from rest


def excited(name, n, rng):
    if name == "sweep":
        return np.r_[np.zeros(HISTORY), chirp(duration=n * 0.02)[:n]]
    if name == "random, held 10":
        return np.repeat(rng.choice([-1.0, 1.0], (n + HISTORY) // 10 + 1), 10)[: n + HISTORY]
    return rng.standard_normal(n + HISTORY)


def one(plant, name, n, colour, seed):
    """Coverage and median error (%) of all figures and of those near a narrow feature, for both methods."""
    b, a, features = PLANTS[plant]
    rng = np.random.default_rng([seed, n])
    u = excited(name, n, rng)
    x, u = lfilter(b, a, u)[-n:], u[-n:]
    noise = lfilter([np.sqrt(1 - colour**2)], [1, -colour], rng.standard_normal(n + 100))[-n:]
    rec = Record(u=u, y=x + 10**-1.5 * np.std(x) * noise, sample_time=0.02)
    low, high = excited_band(rec)
    near = np.concatenate([c * np.array([0.97, 0.98, 0.99, 1.0, 1.01, 1.02, 1.03]) for c in features] or [[]])
    f = np.r_[near, np.geomspace(low, high, 25)]
    z = np.exp(-2j * np.pi * f * 0.02)
    g = np.abs(np.polyval(np.asarray(b)[::-1], z) / np.polyval(np.asarray(a)[::-1], z))
    out = []
    for method in ("auto", "impulse"):
        began = time.process_time()
        found = frequency_response(rec, f, method=method)
        took = time.process_time() - began
        inside = (found.gain_low <= g) & (g <= found.gain_high)
        error = 100 * np.median(np.abs(found.gain / g - 1))
        sharp = inside[: len(near)].mean() if len(near) else np.nan
        out.append((inside.mean(), sharp, error, found.method == "local", took))
    return np.array(out)


def measured_responses(draws, sizes):
    print(f"{draws} draws of {'':44}chosen: cover sharp  error  local  CPU s   impulse: cover sharp  error  CPU s")
    total = {n: [] for n in sizes}
    for n, name in [(n, name) for n in sizes for name in ("sweep", "random, held 10", "white")]:
        for plant in PLANTS:
            for colour in (0.0, 0.8):
                found = np.array([one(plant, name, n, colour, seed) for seed in range(draws)])
                total[n].append(found[:, :, :2].mean(axis=0))
                (c, s, e, local, took), (c2, s2, e2, _, took2) = found.mean(axis=0)
                print(
                    f"{n:6} {name:16} {plant:16} noise AR({colour:.1f})      {100 * c:6.1f}{100 * s:6.1f}{e:7.2f}"
                    f"{100 * local:7.0f}{took:7.2f}            {100 * c2:6.1f}{100 * s2:6.1f}{e2:7.2f}{took2:7.2f}",
                    flush=True,
                )
    for n, rows in total.items():
        mean, narrow = np.mean(rows, axis=0)[:, 0], np.nanmean(np.array(rows)[:, :, 1], axis=0)
        print(f"{n} samples: cover {100 * mean[0]:.1f} %, at narrow features {100 * narrow[0]:.1f} %; by the impulse "
              f"response alone {100 * mean[1]:.1f} and {100 * narrow[1]:.1f} %")  # fmt: skip
    for n in (10_000, 100_000, 1_000_000):
        u = np.random.default_rng(1).standard_normal(n)
        rec = Record(u=u, y=PLANT.simulate(u), sample_time=0.02)
        began = time.process_time()
        frequency_response(rec)
        print(f"{n} samples: {time.process_time() - began:.2f} s of one core")


if __name__ == "__main__":
    if sys.argv[1:2] == ["measured"]:
        given = [int(word) for word in sys.argv[2:]]
        measured_responses(given[0] if given else 40, given[1:] or [750, 3000, 10_000])
    else:
        draws = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
        study(draws, measured=draws // 10)
