"""Coverage of the intervals of the speed of least cost and of its cost; error against another optimiser.

    python benchmarks/economics.py [--draws 300] [--seed 1]

Simulated wear tests: 24 edges of a central composite design with 6 sub-tests each, the published wear law, standard
deviation .1 within edges in logarithms, by intraclass correlation (ICC). The speed of least cost lies inside the range
of V, with the feed at its limit. Nominal 95 %, aim 92 to 97 %; the Monte Carlo error of 300 draws is 1.3 points.
"""

import argparse
from dataclasses import replace

import numpy as np
from fitmodels import datasets, fit, parameters
from fitmodels.controllers.economics.optimum import economic_settings
from fitmodels.core.progress import progress_bar
from fitmodels.parameters.draws import Draws
from fitmodels.parameters.sections.costs import CostsSection

EXPONENTS = {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}
C0, SD, SUBTESTS = 7.62e-3, 0.1, 6
LIMITS = {"wear": 0.3, "feed": (0.1, 0.4), "speed": (50.0, 200.0)}
COSTS = CostsSection(currency="EUR", machine=60.0, edge=40.0, change=5.0)
DEPTH = 2.0


def tests():
    """Runs of the design without scatter, and the edge of each row."""
    plan = datasets.central_composite({"V": (50, 200), "f": (0.06, 0.6), "d": (1.5, 3)}, seed=1, digits=None)
    laws = [datasets.SimulatedLaw("AW", "mm", C0, EXPONENTS, 0.0, 0.0, digits=15)]
    frame = datasets.simulate(plan, laws, interval=2.0, t_max=2.0 * SUBTESTS, criterion=None, seed=1)
    return datasets.runs_from_frame(frame, judge=False)


def truth():
    """Speed of least cost, cost there, and the cost at any speed, of the true law at the largest feed."""
    h, p = EXPONENTS["t"], EXPONENTS["V"] / EXPONENTS["t"]
    at = C0 * 0.4 ** EXPONENTS["f"] * DEPTH ** EXPONENTS["d"]

    def life(V):
        return (0.3 / (at * V ** EXPONENTS["V"])) ** (1 / h)

    def cost(V):
        cut = 1 / (V * 0.4 * DEPTH)
        return cut * (1.0 + (5.0 + 40.0) / life(V))

    best = (0.3 / at) ** (1 / EXPONENTS["V"]) * ((p - 1) * 45.0) ** (-1 / p)
    return best, cost


def study(icc, draws, seed, step):
    """Shares of draws whose intervals contain the true speed of least cost, and the true cost at the chosen setting."""
    runs, (best, cost) = tests(), truth()
    _, edge = np.unique(runs.labels("edge"), return_inverse=True)
    rng = np.random.default_rng([seed, int(100 * icc)])
    median = runs.values("AW")
    found = {"speed, posterior": [], "cost, posterior": [], "speed, covariance": [], "cost, covariance": []}
    lost, width = [], []
    for draw in range(draws):
        step(f"ICC {icc:g}: {draw + 1} of {draws}")
        scatter = (
            rng.standard_normal(len(median)) + np.sqrt(icc / (1 - icc)) * rng.standard_normal(edge.max() + 1)[edge]
        )
        law = fit.power_law(replace(runs, data=runs.data.assign(AW=median * np.exp(SD * scatter))), "AW", [*EXPONENTS])
        pf = parameters.collect(laws=[law], limits=LIMITS)
        post = fit.posterior(law, draws=2000, seed=draw)
        held = {"AW": Draws(post.names, post.draws)}
        for kind, of in (("posterior", held), ("covariance", None)):
            at = economic_settings(pf, COSTS, d=DEPTH, draws=of).least_cost
            low, high = at.bands["V"]
            found[f"speed, {kind}"].append(low <= best <= high)
            low, high = at.bands["cost"]
            found[f"cost, {kind}"].append(low <= cost(at.V) <= high)
        width.append(np.ptp(at.bands["V"]) / best)
        lost.append(cost(at.V) / cost(best) - 1)
    return {name: np.mean(each) for name, each in found.items()}, np.median(width), np.mean(lost)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    print(f"true speed of least cost {truth()[0]:.1f} m/min; {args.draws} draws, coverage in per cent")
    with progress_bar() as step:
        for icc in (0.0, 0.3, 0.7):
            shares, width, lost = study(icc, args.draws, args.seed, step.say)
            words = "; ".join(f"{name} {100 * share:.1f}" for name, share in shares.items())
            print(f"ICC {icc:g}: {words}; width of the interval of V {width:.0%}; cost lost {lost:.2%}", flush=True)


if __name__ == "__main__":
    main()
