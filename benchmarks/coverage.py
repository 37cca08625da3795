"""Coverage of 95 % intervals: the reported interval compared with three others.

Also the rejection rate of the test of lack of fit for a correct law.

    python benchmarks/coverage.py [REPETITIONS]

The design is that of the published tests: 24 edges (8 factorial, 4 centre, 6 axial twice) with 6 sub-tests
each, within-edge standard deviation 0.1 in logs, by intraclass correlation (ICC) of the edges, and once with
serial correlation .8 between the sub-tests of an edge. Monte Carlo error at 4000 repetitions: 0.0034.
"""

import sys
from dataclasses import replace

import numpy as np
from fitmodels import datasets, fit
from fitmodels.fit.checks.model_checks import lack_of_fit
from fitmodels.fit.checks.strata import split
from fitmodels.fit.regression import edge_inference
from scipy.special import stdtrit

EXPONENTS = {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}
SD, SUBTESTS = 0.1, 6
CASES = [(0.0, 0.0), (0.2, 0.0), (0.5, 0.0), (0.69, 0.0), (0.5, 0.8)]


def design():
    plan = datasets.central_composite({"V": (50, 200), "f": (0.06, 0.6), "d": (1.5, 3)}, seed=1, digits=None)
    laws = [datasets.SimulatedLaw("AW", "mm", 7.62e-3, EXPONENTS, 0.0, 0.0, digits=15)]
    return datasets.simulate(plan, laws, interval=2.0, t_max=2.0 * SUBTESTS, criterion=None, seed=1)


def noise(rng, edges, icc, serial):
    rows = np.empty((edges, SUBTESTS))
    rows[:, 0] = rng.standard_normal(edges)
    for k in range(1, SUBTESTS):
        rows[:, k] = serial * rows[:, k - 1] + np.sqrt(1 - serial**2) * rng.standard_normal(edges)
    return SD * (rows + np.sqrt(icc / (1 - icc)) * rng.standard_normal(edges)[:, None]).ravel()


def intervals(law):
    """Standard errors and degrees of freedom of the four methods, each (p,)."""
    edges = edge_inference(law)
    G, n, p = edges.n_edges, law.nobs, len(law.theta)
    Z = law.formula.design(law.X, law.shifts)
    score = np.array([Z[law.edge == e].T @ law.residuals[law.edge == e] for e in dict.fromkeys(law.edge)])
    bread = law.cov_theta / law.scale_se**2
    cr1 = G / (G - 1) * (n - 1) / (n - p) * bread @ score.T @ score @ bread
    yield "as reported (jackknife by edge)", law.theta, np.sqrt(np.diag(edges.cov_theta)), edges.df
    yield "random intercept (REML)", edges.mixed.theta, edges.mixed.bse, edges.mixed.df
    yield "CR1, t(23)", law.theta, np.sqrt(np.diag(cr1)), G - 1
    yield "OLS, independent rows (papers)", law.theta, np.sqrt(np.diag(law.cov_theta)), n - p


def main(repetitions):
    frame = design()
    runs = datasets.runs_from_frame(frame, judge=False)
    truth = np.array(list(EXPONENTS.values()))
    median = frame["AW"].to_numpy()
    print(f"coverage of 95 % intervals, {repetitions} repetitions, {frame['edge'].nunique()} edges x {SUBTESTS}")
    print(f"{'':34}" + "".join(f"{name:>7}" for name in EXPONENTS))
    for icc, serial in CASES:
        rng = np.random.default_rng([1, int(100 * icc), int(100 * serial)])
        hits, rejected = {}, 0
        for _ in range(repetitions):
            AW = median * np.exp(noise(rng, frame["edge"].nunique(), icc, serial))
            law = fit.power_law(replace(runs, data=runs.data.assign(AW=AW)), "AW", list(EXPONENTS))
            rejected += lack_of_fit(law, split(law)).pvalue < 0.05
            for name, theta, se, df in intervals(law):
                reach = stdtrit(np.broadcast_to(df, len(theta))[1:], 0.975) * se[1:]
                inside = np.abs(theta[1:] - truth) <= reach
                hits[name] = hits.get(name, 0) + inside
        print(f"ICC {icc:g}" + (f", serial correlation {serial:g}" if serial else ""))
        for name, count in hits.items():
            print(f"  {name:<32}" + "".join(f"{c / repetitions:7.3f}" for c in count))
        print(f"  lack of fit rejects this correct law in {100 * rejected / repetitions:.1f} % (aim 3 to 7, nominal 5)")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 4000)
