"""Laws of the bundled set and windows of an edge that follows them, for the tests of a watch."""

import json
from functools import lru_cache
from math import log
from typing import NamedTuple

import numpy as np
from fitmodels import datasets, fit, parameters
from fitmodels.live.edge_estimate import EdgeEstimate
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


class BothPosteriors(NamedTuple):
    """Mean and covariance of what stays of an edge, by the filter and by one regression on all windows."""

    filter_mean: np.ndarray
    filter_covariance: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray


def filter_and_regression(laws, windows=120, step=0.5, noise=0.03):
    """Posteriors of an edge whose windows are random, with a change of feed; the filter through JSON at each tenth."""
    edge, rng, rows, y, kind = EdgeEstimate(laws, 0.3), np.random.default_rng(5), [], [], []
    prior, scatter, of = edge._state.P.copy(), laws.scatter, edge._state.of_load
    for k in range(windows):
        at = {**CONDITIONS, "f": 0.2 if k < windows / 2 else 0.3}
        edge.advance(step, at)
        for name in laws.loads:
            _, H = edge._state.load_row(name, edge._exposure, at)
            rows.append(H)
            y.append(float(rng.normal(0, noise)))
            edge._state.update(H, y[-1], noise**2)
            kind.append((name, step * k, H[edge._state.w]))
        if k % 10 == 0:
            edge = EdgeEstimate.from_json(laws, json.loads(json.dumps(edge.as_json())))
    moving = [edge._state.w, *(place for one in of.values() for place in one[2:])]
    stays = np.setdiff1d(np.arange(len(prior)), moving)
    H, prior = np.array(rows)[:, stays], prior[np.ix_(stays, stays)]
    S = H @ prior @ H.T + noise**2 * np.eye(len(y))
    for i, (a, s, k) in enumerate(kind):
        for j, (b, t, m) in enumerate(kind):
            S[i, j] += k * m * scatter.wear_wander.sd**2 * scatter.wear_wander.kept(abs(s - t))
            for wander in (scatter.load_wander[a], scatter.load_rest[a]) if a == b else ():
                S[i, j] += wander.sd**2 * wander.kept(abs(s - t))
    gain = np.linalg.solve(S, H @ prior).T
    filtered = edge._state.x[stays], edge._state.P[np.ix_(stays, stays)]
    return BothPosteriors(*filtered, gain @ np.array(y), prior - gain @ H @ prior)
