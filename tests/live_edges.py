"""Laws of the bundled set and windows of an edge that follows them, for the tests of a watch."""

from functools import lru_cache
from math import log

import numpy as np
from fitmodels import datasets, fit, parameters
from fitmodels.live.live_laws import LiveLaws
from fitmodels.live.monitor import Monitor
from fitmodels.live.samples import LoadMean, Sample, Window
from fitmodels.live.watch_edge import WatchSettings, window_record

CONDITIONS = {"V": 150.0, "f": 0.2, "d": 2.0}
IDENTITY = {"tool": "GC435", "work": "709M40", "content": "abc", "simulated": True}


@lru_cache(maxsize=1)
def parameter_file():
    """A parameter file with laws of wear and of power."""
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    factors = ["V", "f", "d", "t"]
    return parameters.collect(laws=[fit.power_law(runs, "AW", factors), fit.power_law(runs, "P", [*factors, "AW"])])


@lru_cache(maxsize=1)
def laws():
    return LiveLaws.of(parameter_file())


def monitor(**settings):
    return Monitor(laws(), WatchSettings(**{"criterion": 0.3, **settings}), IDENTITY)


def records(n, per_cut=6, seed=1, start=0.0, drift=0.0):
    """Records of windows of 10 s whose power is that of the law, with 1 % noise, and of the ends of cuts."""
    noise, truth, time = np.random.default_rng(seed), monitor(), start
    for k in range(n):
        time += 10.0
        mean = truth.estimate.expected_load("P", CONDITIONS).median if truth.edge.minutes > 0 else 2.0
        load = {"P": LoadMean(log(mean) + drift * k + noise.normal(0, 0.01), 0.01, 500)}
        record = window_record(Window(time - 10, time, 1 / 6, CONDITIONS, load, 1 + k // per_cut))
        truth.apply(record)
        yield record
        if k % per_cut == per_cut - 1:
            yield {"kind": "cutend", "time": time, "contact": 0.02, "cut": 1 + k // per_cut, "lost": False}


def samples(cuts=3, cut=60.0, air=8.0, rate=10.0, start=0.0, idle=0.8, seed=2, tool="", state=True, scale=1.0):
    """Samples of a machine whose power follows its law: air, and cuts of ``cut`` s."""
    noise, truth, time = np.random.default_rng(seed), monitor(), start
    steps = round(rate * (air + cut))
    for _ in range(cuts):
        for k in range(steps):
            cutting = k >= rate * air
            power = idle
            if cutting:
                truth.estimate.advance(1 / rate / 60, CONDITIONS)
                power += scale * truth.estimate.expected_load("P", CONDITIONS).median
            said = ("feed" if cutting else "idle") if state else "unknown"
            yield Sample(round(time, 6), {"P": power * (1 + noise.normal(0, 0.01))}, CONDITIONS, said, tool)
            time += 1 / rate
    for _ in range(round(rate * air)):
        said = "idle" if state else "unknown"
        yield Sample(round(time, 6), {"P": idle * (1 + noise.normal(0, 0.01))}, CONDITIONS, said, tool)
        time += 1 / rate
