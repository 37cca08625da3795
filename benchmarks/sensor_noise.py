"""Gain error of ARX, instrumental variable and output error for the published plant with noise, from one chirp.

    python benchmarks/sensor_noise.py [draws]

Plant and chirp are eq. 18 and 17 of Tai, Tsai & Li 2023 (doi 10.1109/ACCESS.2023.3330587): 2.5 V, 0.1 to 2 Hz in 15 s
at 50 Hz. Sensor noise is white on y; equation noise is white through 1/a. SNR is power of the noise-free output over
power of the noise. Aims: exact without noise; the median |G| error of the best estimator below 1 % at 40, 30 and 20 dB;
no unstable estimate.
"""

import sys

import numpy as np
from fitmodels.datasets.records.record import Record
from fitmodels.ident.estimators.bias_checks import warn_of_bias
from fitmodels.ident.estimators.instrumental import sriv
from fitmodels.ident.estimators.least_squares import arx
from fitmodels.ident.estimators.prediction_error import output_error
from fitmodels.ident.model import Model
from scipy.signal import lfilter

B, A = [0.0, 0.0611, -0.1338, 0.0752], [1.0, -2.0311, 1.2104, -0.1655]
PLANT = Model(b=B, a=A, nk=1, sample_time=0.02)
FREQUENCIES = np.array([0.1, 0.5, 1.0, 2.0])
ESTIMATORS = {
    "ARX": lambda rec: arx(rec, 3, 3),
    "SRIV": lambda rec: sriv(rec, 3, 3),
    "output error": lambda rec: output_error(rec, 3, 3),
}
NOISES = (("sensor", 40), ("sensor", 30), ("sensor", 20), ("equation", 20))


def chirp():
    t = np.arange(750) * 0.02
    return 2.5 * np.sin(2 * np.pi * (0.1 + (2.0 - 0.1) / (2 * 15) * t) * t)


def noisy(u, kind, snr, rng):
    x = PLANT.simulate(u)
    e = rng.standard_normal(len(x))
    e = lfilter([1.0], A, e) if kind == "equation" else e
    scale = np.std(x) * 10 ** (-snr / 20) / (np.std(e) if kind == "equation" else 1.0)
    return Record(u=u, y=x + scale * e, sample_time=0.02)


def gain_error(model):
    """Relative error of the gain, in %."""
    return 100 * (np.abs(model.response(FREQUENCIES)) / np.abs(PLANT.response(FREQUENCIES)) - 1)


def study(kind, snr, draws):
    u, rng = chirp(), np.random.default_rng(2023)
    errors = {name: [] for name in ESTIMATORS}
    unstable, unfinished, warned = dict.fromkeys(ESTIMATORS, 0), dict.fromkeys(ESTIMATORS, 0), 0
    for _ in range(draws):
        rec = noisy(u, kind, snr, rng)
        models = {name: estimate(rec) for name, estimate in ESTIMATORS.items()}
        for name, model in models.items():
            errors[name].append(gain_error(model))
            unstable[name] += not model.stable
            unfinished[name] += any("not converged" in note for note in model.notes)
        warned += warn_of_bias(models["ARX"], models["output error"], (0.1, 2.0)) is not None
    for name, e in errors.items():
        size, bias = np.median(np.abs(e), axis=0), np.median(e, axis=0)
        cells = " ".join(f"{s:6.2f} ({m:+6.2f})" for s, m in zip(size, bias, strict=True))
        print(f"{kind:<9}{snr:>4}  {name:<13}{cells}   {unstable[name]:>5} {unfinished[name]:>8}")
    print(f"{'':15}{'bias warning':<15}in {warned} of {draws}")


def without_noise(u):
    rec = Record(u=u, y=PLANT.simulate(u), sample_time=0.02)
    for name, estimate in ESTIMATORS.items():
        print(f"noise-free {name:<13} largest coefficient error {np.abs(estimate(rec).theta - PLANT.theta).max():.1e}")


if __name__ == "__main__":
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    print(f"median |error| (median error) of |G| in % over {draws} draws, 750 samples\n")
    without_noise(chirp())
    print("\nnoise     dB  estimator    " + "".join(f"{f:>8.1f} Hz     " for f in FREQUENCIES) + " unstable unfinished")
    for kind, snr in NOISES:
        study(kind, snr, draws)
