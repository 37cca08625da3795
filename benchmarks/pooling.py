"""Separate and pooled exponents of simulated families: errors, and coverage of the intervals of both.

    OMP_NUM_THREADS=1 python benchmarks/pooling.py [FAMILIES]

Each family has 24 pairs with 4, 6, 8, 12, 16 or 24 edges of 6 rows. A pair's exponents of V and t are normal about
those of its family with standard deviation tau; ln AW scatters between edges and within, by 0.07 each in every pair
or, with unequal scatter, by 0.07 times lognormal factors (standard deviation 0.4 in logs). Every pair is fitted from
its rows by ``fit.many_power_laws`` with standard errors by edge, every family pooled by ``fit.pooled_exponents`` with
its own prior. Printed by tau and by edges of a pair: root mean squared error of both, ratio of the mean squared
errors, coverage of 95 % intervals, and the median length of the pooled intervals relative to the others; then
coverage for the families. At tau 0 the central interval of tau does not contain it.
"""

import sys
import time

import numpy as np
import pandas as pd
from fitmodels.fit.many.batched import many_power_laws
from fitmodels.fit.many.pooling import pooled_exponents

EDGES, SUBTESTS, EACH = (4, 6, 8, 12, 16, 24), 6, 4  # pairs of a family with each number of edges
MEANS, SD = {"V": 0.577, "t": 0.245}, 0.07
CASES = (
    (0.0, 0.0),
    (0.03, 0.0),
    (0.1, 0.0),
    (0.3, 0.0),
    (0.03, 0.4),
    (0.1, 0.4),
    (0.3, 0.4),
)  # tau, sd of the log scatter


def simulated(families, tau, unequal, rng):
    """Rows of all pairs, and the pairs with their true exponents."""
    counts = np.tile(np.repeat(EDGES, EACH), families)
    pairs = pd.DataFrame({"pair": np.arange(len(counts)), "group": np.repeat(np.arange(families), len(EDGES) * EACH)})
    for name, mean in MEANS.items():
        pairs[name] = mean + tau * rng.standard_normal(len(pairs))
    of_edge = np.repeat(pairs["pair"], counts).to_numpy()
    of_row = np.repeat(of_edge, SUBTESTS)
    V = np.repeat(rng.uniform(*np.log((50, 200)), len(of_edge)), SUBTESTS)
    t = np.tile(np.log(2.0 * np.arange(1, SUBTESTS + 1)), len(of_edge))
    between, within = SD * np.exp(unequal * rng.standard_normal((2, len(pairs))))
    level = np.repeat(between[of_edge] * rng.standard_normal(len(of_edge)), SUBTESTS)
    level += within[of_row] * rng.standard_normal(len(of_row))
    y = pairs["V"].to_numpy()[of_row] * V + pairs["t"].to_numpy()[of_row] * t - 4.9 + level
    edge = np.repeat(np.arange(len(of_edge)), SUBTESTS)
    rows = pd.DataFrame({"pair": of_row, "edge": edge, "V": np.exp(V), "t": np.exp(t), "AW": np.exp(y)})
    return rows, pairs.assign(edges=counts)


def share(inside):
    return f"{100 * np.mean(inside):6.1f} %"


def print_pairs(rows, truth, edges):
    print(f"    {'edges':>6} {'rmse':>11} {'pooled':>8} {'mse ratio':>10} {'coverage':>12} {'pooled':>9}  length")
    for count in (*EDGES, None):
        pick = np.ones(len(rows), dtype=bool) if count is None else edges == count
        some, beta = rows[pick], truth[pick]
        alone, pooled = (np.mean(np.square(some[name] - beta)) for name in ("estimate", "pooled"))
        inside = share((some["low"] <= beta) & (beta <= some["high"]))
        within = share((some["pooled_low"] <= beta) & (beta <= some["pooled_high"]))
        length = ((some["pooled_high"] - some["pooled_low"]) / (some["high"] - some["low"])).median()
        print(f"    {count or 'all':>6} {alone**0.5:11.4f} {pooled**0.5:8.4f} {pooled / alone:10.2f} {inside:>12}"
              f" {within:>9} {length:7.2f}")  # fmt: skip


def print_families(families, mean, tau, rng):
    new = mean + tau * rng.standard_normal(len(families))
    cover = [share((families[f"{name}_low"] <= value) & (value <= families[f"{name}_high"]))
             for name, value in (("mean", mean), ("tau", tau), ("new", new))]  # fmt: skip
    middle = families["tau"].median()
    print(f"    families: mean {cover[0]}, tau {cover[1]} (median estimate {middle:.3f}), new pair {cover[2]}")


def main(families):
    began = time.perf_counter()
    error = 100 * np.sqrt(0.95 * 0.05 / (families * len(EDGES) * EACH))
    print(
        f"{families} families of {len(EDGES) * EACH} pairs; Monte Carlo error of coverage over all {error:.2f} points"
    )
    for tau, unequal in CASES:
        rng = np.random.default_rng([7, int(1000 * tau), int(10 * unequal)])
        rows, pairs = simulated(families, tau, unequal, rng)
        laws = many_power_laws(rows, "AW", list(MEANS), pair="pair", edge="edge")
        table = laws.table.assign(group=pairs["group"])
        for name, mean in MEANS.items():
            found = pooled_exponents(table, name, by="group")
            print(
                f"exponent of {name}, tau {tau:g}, scatter of pairs {'unequal' if unequal else 'equal'}; {found.prior}"
            )
            print_pairs(found.table, pairs[name], pairs["edges"].to_numpy())
            print_families(found.families, mean, tau, rng)
    print(f"{laws.one_by_one} of {len(laws)} pairs fitted individually; {time.perf_counter() - began:.0f} s in all")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
