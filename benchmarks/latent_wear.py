"""Bias and coverage of the exponent of wear when the wear is measured with error.

    python benchmarks/latent_wear.py [DATA_SETS]

24 edges of 6 rows; true wear scatters by .1 in ln within an edge, its exponent in the law of power is .35. For
measurement errors of .05 and .1 in ln: the mean exponent of the plain fit, of the closed-form correction and of
latent wear, each with its Monte Carlo error; coverage of 95 % intervals (Monte Carlo error at 100 data sets: .022);
share of data sets that pass the convergence checks, and seconds per data set.
"""

import sys
import time

import numpy as np
import pandas as pd
from fitmodels import datasets, fit
from fitmodels.fit.available import NotAvailable
from fitmodels.fit.bayes.joint_posterior import latent_wear

TRUE, EDGES, ROWS = 0.35, 24, 6


def cut(gauge, rng):
    at, t = np.repeat(np.arange(EDGES), ROWS), np.tile(2.0 * np.arange(1, ROWS + 1), EDGES)
    V, f = (np.exp(rng.uniform(-0.7, 0.7, EDGES))[at] * middle for middle in (100, 0.2))
    u, v = (0.05 * rng.normal(size=EDGES)[at] for _ in range(2))
    w = 7.62e-3 * V**0.577 * f**0.168 * t**0.245 * np.exp(u + 0.1 * rng.normal(size=len(t)))
    P = 0.14 * V**0.82 * f**0.627 * t**-0.049 * w**TRUE * np.exp(v + 0.06 * rng.normal(size=len(t)))
    AW = w * np.exp(gauge * rng.normal(size=len(t)))
    edge = [f"E{g}" for g in at]
    return datasets.runs_from_frame(pd.DataFrame({"edge": edge, "V": V, "f": f, "t": t, "AW": AW, "P": P}), judge=False)


def one(gauge, rng):
    """(plain, closed form, latent) exponents, whether intervals cover, convergence checks passed, seconds."""
    runs = cut(gauge, rng)
    wear, power = fit.power_law(runs, "AW", ["V", "f", "t"]), fit.power_law(runs, "P", ["V", "f", "t", "AW"])
    start = time.perf_counter()
    joint = latent_wear(wear, [power], gauge)
    seconds = time.perf_counter() - start
    row, plain = joint.table().loc["P: AW"], power.conf_int().loc["AW"]
    closed = joint.closed_form[0]
    corrected = np.nan if isinstance(closed, NotAvailable) else closed.params["AW"]
    holds = (plain["low"] <= TRUE <= plain["high"], row["low"] <= TRUE <= row["high"])
    return (power.params["AW"], corrected, row["mean"]), holds, joint.convergence.passed, seconds, joint.method


def main(data_sets):
    print(f"true exponent {TRUE}, {data_sets} data sets of {EDGES} edges x {ROWS} rows")
    for gauge in (0.05, 0.1):
        rng = np.random.default_rng([4, int(100 * gauge)])
        found = [one(gauge, rng) for _ in range(data_sets)]
        values = np.array([row[0] for row in found])
        error = np.nanstd(values, axis=0, ddof=1) / np.sqrt(data_sets)
        held, opened, seconds = (np.mean([row[k] for row in found], axis=0) for k in (1, 2, 3))
        print(f"measurement error {gauge:g} in ln")
        names = ("plain fit", "closed form", "latent wear")
        for name, value, mc in zip(names, np.nanmean(values, axis=0), error, strict=True):
            print(f"  {name:<12} mean {value:.3f} +- {mc:.3f}")
        chains, slowest = sum(row[4] == "emcee" for row in found), max(row[3] for row in found)
        print(
            f"  coverage of 95 % intervals: plain {held[0]:.2f}, latent {held[1]:.2f}; converged {100 * opened:.0f} %"
        )
        print(f"  {seconds:.2f} s per data set, at most {slowest:.2f} s; {chains} sampled by chains")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
