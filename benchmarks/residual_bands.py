"""Rejection rate of the residual tests for a correct model: 5 % of the lags with 95 % bands.

    python benchmarks/residual_bands.py [draws]

The published plant (Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 18) is fitted to a record of 750 samples
and validated on another (held out) and on the same one (fitted). Aim: 5 +- 1 % of the lags, and 5 % of the joint tests.
"""

import sys

import numpy as np
from fitmodels.datasets import Record
from fitmodels.ident.estimators.least_squares import arx
from fitmodels.ident.estimators.prediction_error import output_error
from fitmodels.ident.excitation.signals import chirp, prbs
from fitmodels.ident.model import Model
from fitmodels.ident.validation.model_validation import validate
from fitmodels.ident.validation.residual_tests import whiteness
from scipy.signal import lfilter

PLANT = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)
INPUTS = {"chirp": chirp(), "prbs": prbs(2.5, hold=0.2)}
NOISES = {
    "white, ARX": (lambda e: lfilter([1.0], PLANT.a, e) * 0.1, lambda rec: arx(rec, 3, 3)),
    "white, output error": (lambda e: e, lambda rec: output_error(rec, 3, 3)),
    "coloured, output error": (lambda e: lfilter([1.0], [1.0, -0.8], e), lambda rec: output_error(rec, 3, 3)),
}


def run(u, shape, rng):
    x = PLANT.simulate(u)
    return Record(u=u, y=x + 0.0316 * np.std(x) * shape(rng.standard_normal(len(u))), sample_time=0.02)


def study(name, kind, draws):
    shape, estimate = NOISES[name]
    u, rng = INPUTS[kind], np.random.default_rng(2023)
    found = {where: [] for where in ("held out", "fitted")}
    for _ in range(draws):
        first, second = run(u, shape, rng), run(u, shape, rng)
        model = estimate(first)
        for where, rec in (("held out", second), ("fitted", first)):
            v = validate(model, rec)
            tests = (v.whiteness, v.independence, v.coming)
            found[where].append([*(t.flagged for t in tests), *(t.pvalue < 0.05 for t in tests)])
    for where, rows in found.items():
        share = 100 * np.mean(rows, axis=0)
        print(f"{name:<24}{kind:<7}{where:<10}" + "".join(f"{s:9.1f}" for s in share))


if __name__ == "__main__":
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    rng = np.random.default_rng(1)
    print("white noise itself, lags flagged, %:", end="")
    for n in (100, 300, 1000):
        flagged = [whiteness(rng.standard_normal(n), (slice(0, n),)).flagged for _ in range(4000)]
        print(f"  {n} samples {100 * np.mean(flagged):.2f}", end="")
    print("\n")
    print(f"{draws} draws, %{'':27}lags flagged: white    past   coming   joint: white past coming")
    for name in NOISES:
        for kind in INPUTS:
            study(name, kind, draws)
