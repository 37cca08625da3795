"""Time of the map of PI gains: 200 x 200 pairs with all figures of merit, on one core (processor time).

    OMP_NUM_THREADS=1 python benchmarks/pi_map.py

The plant is CLM-2023 eq. 18 at 50 Hz, steps of 12 s, gains from nearly zero to beyond the stability limit. Parts
are timed for stable loops only; then 500 models with 40 pairs each, as needed for robust tuning.
"""

import time
from statistics import median

import numpy as np
from fitmodels.ident.model import Model
from fitmodels.ident.pi.figures_of_merit import figures_on_grid
from fitmodels.ident.pi.gains import PiGains
from fitmodels.ident.pi.loops import loops_of, noise_size, split, stable_columns
from fitmodels.ident.pi.margins import margin_figures
from fitmodels.ident.pi.step_metrics import step_figures

B, A = [0, 0.0611, -0.1338, 0.0752], [1, -2.0311, 1.2104, -0.1655]  # CLM-2023 eq. 18
MODEL, KIND, DURATION = Model(b=B, a=A, nk=1, sample_time=0.02), PiGains(1.0, 1.0, 0.02), 12.0


def clocked(call, runs=5):
    call()
    times = []
    for _ in range(runs):
        start = time.process_time()  # of this process: independent of other processes
        call()
        times.append(time.process_time() - start)
    return median(times)


def main():
    kp, ki = (g.ravel() for g in np.meshgrid(np.geomspace(0.01, 10, 200), np.geomspace(0.05, 30, 200)))
    for label, kind in (
        ("plain", KIND),
        ("low-pass, average 5, delay 2", PiGains(1.0, 1.0, 0.02, filter_time=0.1, average=5, delay=2)),
    ):
        share = figures_on_grid(MODEL, kp, ki, kind, DURATION)["stable"].mean()
        seconds = clocked(lambda kind=kind: figures_on_grid(MODEL, kp, ki, kind, DURATION))
        print(f"{len(kp)} pairs, {label}: {seconds:.2f} s, {100 * share:.0f} % stable (aim: under 1 s, plain)")
    ((_, loops),) = split(loops_of(MODEL, kp, ki, KIND))
    good = loops[stable_columns(loops.characteristic)]
    for label, call in (
        ("stability", lambda: stable_columns(loops.characteristic)),
        ("noise", lambda: noise_size(good.noise_numerator, good.characteristic)),
        ("margins and peaks", lambda: margin_figures(good)),
        ("steps", lambda: step_figures(good, round(DURATION / 0.02) + 1)),
    ):
        print(f"    {label}: {clocked(call):.3f} s")
    rng = np.random.default_rng(1)
    models = [Model(b=np.r_[0, np.array(B[1:]) * rng.normal(1, 0.02)], a=A, nk=1, sample_time=0.02) for _ in range(500)]
    p, i = np.geomspace(0.1, 2, 40), np.geomspace(0.5, 4, 40)
    print(f"500 models x 40 pairs: {clocked(lambda: figures_on_grid(models, p, i, KIND, DURATION), 3):.2f} s")


if __name__ == "__main__":
    main()
