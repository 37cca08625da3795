"""PI gains from a noisy chirp through `ident.identify` with unknown orders and delay, tested on the true plant.

    OMP_NUM_THREADS=1 python benchmarks/chirp_to_gains.py [draws] [snr ...]

Plant and chirp as in `pi_study.py`. Required: rise 2 s, settling 4 s. Aim: 2.1 s and 4.2 s are met on the true plant in
95 % of the draws at 30 dB and 85 % at 20 dB. Also printed: the frequency of the chosen orders, and the median error of
|G|.
"""

import sys
import time
from collections import Counter

import numpy as np
from fitmodels.core.errors import IdentError
from fitmodels.datasets import Record
from fitmodels.ident import Model, chirp, identify, tune_pi
from fitmodels.ident.pi.loop import loop_of

PLANT = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)
FREQUENCIES = np.array([0.1, 0.5, 1.0, 2.0])


def study(snr: float, draws: int) -> None:
    u = chirp()
    x, rng, met, refused = PLANT.simulate(u), np.random.default_rng(7), 0, 0
    orders, errors, began = Counter(), [], time.perf_counter()
    for _ in range(draws):
        y = x + np.std(x) * 10 ** (-snr / 20) * rng.standard_normal(len(x))
        try:
            model = identify(Record(u=u, y=y, sample_time=0.02)).model
            gains = tune_pi(model, 2.0, 4.0, n=24).gains
        except IdentError:
            refused += 1
            continue
        figures = loop_of(PLANT, gains).figures()
        met += bool(figures.stable and figures.rise_time <= 2.1 and figures.settling_time <= 4.2)
        orders[model.na, model.nb, model.nk] += 1
        errors.append(np.abs(np.abs(model.response(FREQUENCIES) / PLANT.response(FREQUENCIES)) - 1))
    share = met / draws
    error = 100 * np.sqrt(max(share * (1 - share), 0.25 / draws) / draws)
    median = ", ".join(f"{f:g} Hz {100 * e:.2f} %" for f, e in zip(FREQUENCIES, np.median(errors, axis=0), strict=True))
    took = (time.perf_counter() - began) / draws
    print(f"{snr:g} dB: 2.1 s and 4.2 s met in {100 * share:.1f} % +- {error:.1f} of {draws} draws; {refused} refused")
    print(f"   orders (na, nb, nk): {dict(orders.most_common(6))}")
    print(f"   median error of |G|: {median}; {took:.2f} s per draw", flush=True)


if __name__ == "__main__":
    for level in [float(a) for a in sys.argv[2:]] or [30.0, 20.0]:
        study(level, int(sys.argv[1]) if len(sys.argv) > 1 else 200)
