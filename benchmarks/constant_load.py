"""Time of a million steps of the constant-load loop: controller, milling model and replay, in pure Python.

    python benchmarks/constant_load.py

The file is CLM-2023's end milling, with the wear rate divided by a thousand so that the tool lasts the million
samples of 20 ms, 5.6 hours of milling in passes of 150 mm. Aim: under 10 s, 10 us per step.
"""

import sys
import time
from dataclasses import replace

import numpy as np
from fitmodels.controllers.constant_load_milling.controller import ConstantLoad
from fitmodels.controllers.constant_load_milling.cut_model import CutModel
from fitmodels.controllers.constant_load_milling.plant import MillingCut
from fitmodels.controllers.constant_load_milling.runs import RECORDED, constant_load_run
from fitmodels.controllers.loop import replay
from fitmodels.parameters.published import published

STEPS, PERIOD = 1_000_000, 0.02


def timed(record, noise):
    pf = published("CLM-2023")
    own = CutModel.from_parameters(pf)
    cut = replace(own, c0=1e-3 * own.c0)
    controller, mill = ConstantLoad.from_parameters(pf), MillingCut.from_parameters(pf, cut=cut, noise=noise)
    start, busy = time.perf_counter(), time.process_time()
    trace = replay(controller, mill, duration=STEPS * PERIOD, dt=PERIOD, record=record)
    seconds = time.perf_counter() - start
    if len(trace.time) != STEPS:
        sys.exit(f"the tool was changed after {len(trace.time)} steps, before a million")
    return seconds, time.process_time() - busy


def main():
    print(f"Python {sys.version.split()[0]}, numpy {np.__version__}")
    for label, record, noise in (
        ("loop alone", (), 0.0),
        ("with feed, wear, length and pass recorded", RECORDED, 0.0),
        ("with sensor noise too", RECORDED, 0.003),
    ):
        seconds, busy = timed(record, noise)
        print(
            f"a million steps, {label:<42} {seconds:5.2f} s   {seconds / STEPS * 1e6:4.1f} us per step   "
            f"{STEPS * PERIOD / seconds:6.0f} times real time   {busy:5.2f} s of CPU   aim < 10 s"
        )
    for name in ("CLM-2023", "CLM-2023-slot"):
        start = time.perf_counter()
        run = constant_load_run(published(name))
        print(f"{name:<14} a complete tool life, {len(run.trace.time)} steps: {time.perf_counter() - start:.3f} s")


if __name__ == "__main__":
    main()
