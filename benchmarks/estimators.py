"""Time of an estimate and of a whole identification: the published plant, one chirp, 20 dB of sensor noise.

    python benchmarks/estimators.py

Processor time on one core; other processes influence it little. Aims: SRIV, output error and Box-Jenkins on 750 samples
below 10, 10 and 20 ms; `identify` (disturbances, structure, estimate with alternatives, validation) on 750 samples at
most .2 s, on 100 000 at most 1 s.
"""

import time
from statistics import median

import numpy as np
from fitmodels.datasets.records.record import Record
from fitmodels.ident import identify
from fitmodels.ident.estimators.instrumental import sriv
from fitmodels.ident.estimators.plant_and_noise import box_jenkins
from fitmodels.ident.estimators.prediction_error import armax, output_error
from fitmodels.ident.model import Model

PLANT = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)
# call and aims in ms by number of samples
ESTIMATORS = {
    "sriv(rec, 3, 3)": (lambda rec: sriv(rec, 3, 3), {750: 10}),
    "output_error(rec, 3, 3)": (lambda rec: output_error(rec, 3, 3), {750: 10}),
    "armax(rec, 3, 3, 3)": (lambda rec: armax(rec, 3, 3, 3), {}),
    "box_jenkins(rec, 3, 3, 2)": (lambda rec: box_jenkins(rec, 3, 3, 2), {750: 20}),
    "identify(rec)": (identify, {750: 200, 100_000: 1000}),
}


def chirp(n):
    t = np.arange(n) * 0.02
    return 2.5 * np.sin(2 * np.pi * (0.1 + (2.0 - 0.1) / (2 * t[-1]) * t) * t)


def record(n, seed):
    u = chirp(n)
    x = PLANT.simulate(u)
    noise = 0.1 * np.std(x) * np.random.default_rng(seed).standard_normal(n)
    return Record(u=u, y=x + noise, sample_time=0.02)


def milliseconds(estimate, records):
    estimate(records[0])
    times = []
    for rec in records:
        start = time.process_time()
        estimate(rec)
        times.append(1e3 * (time.process_time() - start))
    return median(times), max(times)


if __name__ == "__main__":
    for n, draws in ((750, 50), (10_000, 10), (100_000, 3)):
        records = [record(n, seed) for seed in range(draws)]
        for name, (estimate, aims) in ESTIMATORS.items():
            middle, most = milliseconds(estimate, records)
            aim = aims.get(n)
            goal = f"   aim {aim} ms: ratio {middle / aim:.2f}" if aim else ""
            print(f"{n:>7} samples  {name:<25} {middle:8.1f} ms   (maximum {most:.1f} ms of {draws} draws){goal}")
