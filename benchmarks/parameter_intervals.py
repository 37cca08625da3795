"""Coverage of the 95 % intervals of coefficients by `ident.identify`, four kinds of noise, orders given and chosen.

    python benchmarks/parameter_intervals.py [draws]

Systems of the kind (.6 q^-2 - .2 q^-3) / (1 - .5 q^-1), 750 samples, input a PRBS with a clock of two samples, noise at
20 dB. With orders chosen the coefficients are compared where the true orders were chosen; bands of |G| and of the step
response, which include the uncertainty of orders, are compared in all draws. Aim: 92 to 97 %, pooled.
"""

import sys

import numpy as np
from fitmodels.core.errors import IdentError
from fitmodels.datasets import Record
from fitmodels.ident import Model, identify, prbs
from fitmodels.ident.responses.confidence_bands import response_band, step_band
from scipy.signal import lfilter

T, N, BURN = 0.02, 750, 500
SYSTEMS = {
    "(.6 q^-2 - .2 q^-3)/(1 - .5 q^-1)": ([0.0, 0.0, 0.6, -0.2], [1.0, -0.5]),
    "(.3 q^-1 + .2 q^-2)/(1 - 1.2 q^-1 + .5 q^-2)": ([0.0, 0.3, 0.2], [1.0, -1.2, 0.5]),
    "(.5 q^-3)/(1 - .8 q^-1)": ([0.0, 0.0, 0.0, 0.5], [1.0, -0.8]),
}
NOISES = {  # numerator and denominator of the noise model; a is that of the plant
    "ARX": lambda a: ([1.0], a),
    "ARMAX": lambda a: ([1.0, 0.5], a),
    "OE": lambda a: ([1.0], [1.0]),
    "Box-Jenkins": lambda a: ([1.0, 0.5], [1.0, -0.8]),
}
FREQUENCIES = np.geomspace(0.2, 20.0, 15)
TIMES = np.arange(3, 40, 3)


def record_of(plant, noise, rng):
    u = prbs(1.0, N * T, 1 / T, hold=2 * T, seed=int(rng.integers(1, 1000)))
    x = plant.simulate(u)
    v = lfilter(*NOISES[noise](plant.a), rng.standard_normal(N + BURN))[BURN:]
    pulse = lfilter(*NOISES[noise](plant.a), np.eye(1, BURN)[0])
    return Record(u=u, y=x + 0.1 * np.std(x) * v / np.sqrt(pulse @ pulse), sample_time=T)


def inside(model, plant):
    """Which coefficients lie within 1.96 standard errors of the true ones; empty for other orders."""
    if (model.na, model.nb, model.nk) != (plant.na, plant.nb, plant.nk) or model.cov_params is None:
        return []
    return np.abs(model.theta - plant.theta) <= 1.959964 * np.sqrt(np.diag(model.cov_params))


def of_bands(model, plant):
    """Shares of frequencies and of times at which the 95 % bands hold the true response."""
    gain, true = response_band(model, FREQUENCIES), np.abs(plant.response(FREQUENCIES))
    step, truth = step_band(model, 40 * T), plant.simulate(np.ones(41))[TIMES]
    return (
        np.mean((gain.gain_low <= true) & (true <= gain.gain_high)),
        np.mean((step.low[TIMES] <= truth + 1e-12) & (truth - 1e-12 <= step.high[TIMES])),
    )


def study(draws):
    given, chosen, bands = [], [], []
    print(f"{'system, noise':60} {'given':>7} {'true orders':>12} {'chosen':>7} {'|G|':>6} {'step':>6}   (%)")
    for system, (b, a) in SYSTEMS.items():
        plant = Model(b=b, a=a, nk=int(np.flatnonzero(b)[0]), sample_time=T)
        for noise in NOISES:
            first, second, both, same = [], [], [], 0
            for k in range(draws):
                rec = record_of(plant, noise, np.random.default_rng([21, k]))
                try:
                    first.extend(inside(identify(rec, orders=(plant.na, plant.nb, plant.nk)).model, plant))
                    model = identify(rec).model
                except IdentError as error:
                    print(f"draw {k}: {error}")
                    continue
                second.extend(inside(model, plant))
                same += len(inside(model, plant)) > 0
                both.append(of_bands(model, plant))
            gain, step = 100 * np.mean(both, axis=0)
            of_second = 100 * np.mean(second) if second else np.nan
            print(
                f"{system + ', ' + noise:60} {100 * np.mean(first):7.1f} {100 * same / draws:12.0f} {of_second:7.1f} "
                f"{gain:6.1f} {step:6.1f}",
                flush=True,
            )
            given += first
            chosen += second
            bands += both
    gain, step = 100 * np.mean(bands, axis=0)
    print(
        f"pooled: orders given {100 * np.mean(given):.1f} %, chosen {100 * np.mean(chosen):.1f} %, bands of |G| "
        f"{gain:.1f} %, of the step {step:.1f} % (aim 92 to 97)"
    )


if __name__ == "__main__":
    study(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
