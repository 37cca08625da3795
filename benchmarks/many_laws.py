"""Time of laws of 10 000 simulated pairs: batched, compared with a loop of statsmodels OLS with the same statistics.

    OMP_NUM_THREADS=1 python benchmarks/many_laws.py [PAIRS] [PAIRS_OF_THE_LOOP]

Each pair has 24 edges of 6 rows and its own exponents of V, f, d and t. Same statistics: coefficients, their standard
errors, t and p by rows and by edge (CR3), R2, adjusted R2, F, p of F, residual standard error. Both start from one
DataFrame of all rows. The loop runs over some pairs, between two of our runs, and is extrapolated. Aim: ratio 20.
"""

import resource
import sys
import time

import numpy as np
import pandas as pd
from fitmodels import fit
from fitmodels.fit.many.batched import many_power_laws
from statsmodels.formula.api import ols
from statsmodels.regression.linear_model import OLS

FACTORS = ["V", "f", "d", "t"]
ENDS = {"V": (50, 200), "f": (0.06, 0.6), "d": (1.5, 3)}
FAMILY, SPREAD = np.array([0.577, 0.168, 0.248, 0.245]), 0.08
EDGES, SUBTESTS = 24, 6


def simulated(pairs, seed=1):
    """Rows of all pairs, and their true exponents, shape (pairs, 4)."""
    rng = np.random.default_rng(seed)
    truth = FAMILY + SPREAD * rng.standard_normal((pairs, 4))
    shape = (pairs, EDGES, SUBTESTS)
    logs = [np.broadcast_to(rng.uniform(*np.log(ends), (pairs, EDGES, 1)), shape) for ends in ENDS.values()]
    logs.append(np.broadcast_to(np.log(2.0 * np.arange(1, SUBTESTS + 1)), shape))
    noise = 0.07 * (rng.standard_normal((pairs, EDGES, 1)) + rng.standard_normal(shape))
    y = sum(b[:, None, None] * x for b, x in zip(truth.T, logs, strict=True)) - 4.9 + noise
    tool = np.repeat(np.array([f"T{i:05d}" for i in range(pairs)], dtype=object), EDGES * SUBTESTS)
    edge = np.tile(np.repeat(np.array([f"E{g:02d}" for g in range(EDGES)], dtype=object), SUBTESTS), pairs)
    columns = {name: np.exp(x).ravel() for name, x in zip(FACTORS, logs, strict=True)}
    return pd.DataFrame({"tool": tool, "edge": edge, **columns, "AW": np.exp(y).ravel()}), truth


def by_statsmodels(frame):
    """The same statistics, pair by pair, shape (pairs, statistics)."""
    out = []
    for _, rows in frame.groupby("tool", sort=False):
        Z = np.column_stack([np.ones(len(rows)), np.log(rows[FACTORS].to_numpy())])
        law = OLS(np.log(rows["AW"].to_numpy()), Z).fit()
        edge = pd.factorize(rows["edge"])[0]
        by_edge = law.get_robustcov_results("cluster-crv3", groups=edge, use_t=True)
        out.append(_statistics(law, by_edge))
    return np.array(out)


def by_formulas(frame):
    """The same with a formula for each pair, as the documentation of statsmodels writes it: most users' loop."""
    formula = f"np.log(AW) ~ {' + '.join(f'np.log({name})' for name in FACTORS)}"
    out = []
    for _, rows in frame.groupby("tool", sort=False):
        law = ols(formula, rows).fit()
        by_edge = law.get_robustcov_results("cluster-crv3", groups=pd.factorize(rows["edge"])[0], use_t=True)
        out.append(_statistics(law, by_edge))
    return np.array(out)


def _statistics(law, by_edge):
    whole = [law.rsquared, law.rsquared_adj, law.fvalue, law.f_pvalue, law.scale**0.5]
    parts = (law.bse, by_edge.params, by_edge.bse, by_edge.tvalues, by_edge.pvalues)
    return np.concatenate([*(np.asarray(part)[1:] for part in parts), whole])


def ours(frame):
    table = many_power_laws(frame, "AW", FACTORS, pair="tool", edge="edge").table
    parts = ("row_bse", "params", "bse", "tvalues", "pvalues")
    names = [f"{part}_{name}" for part in parts for name in FACTORS]
    return table[[*names, "rsquared", "rsquared_adj", "fvalue", "f_pvalue", "scale_se"]].to_numpy(dtype=float)


def clocked(call, *given):
    wall, own = time.perf_counter(), time.process_time()
    result = call(*given)
    return result, time.perf_counter() - wall, time.process_time() - own


def main(pairs, looped):
    frame, truth = simulated(pairs)
    some = frame.iloc[: looped * EDGES * SUBTESTS]
    ours(some)
    by_statsmodels(some.iloc[: 5 * EDGES * SUBTESTS])
    runs = [clocked(ours, frame)]
    theirs, wall, own = clocked(by_statsmodels, some)
    runs += [clocked(ours, frame) for _ in range(2)]
    found, our_wall, our_own = sorted(runs, key=lambda run: run[1])[1]
    scale = pairs / looped
    print(f"{pairs} pairs of {EDGES} edges x {SUBTESTS} rows, Python {sys.version.split()[0]}, numpy {np.__version__}")
    print(f"fit.many_power_laws            {our_wall:8.2f} s   ({our_own:.2f} s of processor; median of 3)")
    print(f"loop of statsmodels OLS        {scale * wall:8.2f} s   ({scale * own:.2f} s; from {looped} pairs)")
    print(f"ratio                          {scale * wall / our_wall:8.1f}     ({scale * own / our_own:.1f})   aim 20")
    apart = np.max(np.abs(found[:looped] / theirs - 1))
    print(f"largest relative difference of a statistic, {looped} pairs: {apart:.1e}")
    off = np.abs(found[:, 4:8] - truth) / found[:, 8:12]
    print(f"true exponents within 95 % intervals by edge: {100 * np.mean(off < 2.0687):.1f} % (t of 23)")
    _loop_of_power_law(some.iloc[: 50 * EDGES * SUBTESTS], pairs, our_wall)
    print(f"largest memory of the process {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB")


def _loop_of_power_law(some, pairs, our_wall):
    """For comparison: the fit of single pairs, with a random intercept by edge."""
    from fitmodels import datasets

    def loop():
        for _, rows in some.groupby("tool", sort=False):
            fit.power_law(datasets.runs_from_frame(rows.reset_index(drop=True), judge=False), "AW", FACTORS)

    _, wall, _ = clocked(loop)
    whole = wall * pairs / some["tool"].nunique()
    print(f"loop of fit.power_law          {whole:8.2f} s   ({whole / our_wall:.0f} times as long; from 50 pairs)")


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:]]
    main(*(given + [10_000, 500][len(given) :]))
