"""Learning edge by edge against a fit of all rows, its cost and size, and what it gains on a shifted law.

    python benchmarks/live_learning.py [--edges E]

For each law of the bundled set: the file starts with a third of its edges and takes in the others one by one, through
JSON after every edge. Printed: largest difference to the fit of all rows, of coefficients and of posterior draws in
standard deviations, of the jackknife covariance relatively; time of one edge; kB of JSON by edge and law.

Then E edges of a simulation of changed truth (wear +8 %, scatter between edges and 3 % gauge error, changing
conditions), each measured once, in batches of five: error of the wear law at the middle of the tests, the distance of
each batch from the first fit in standard errors, and the error that rows with means over time would add.
"""

import argparse
import json
from time import perf_counter

import numpy as np
from fitmodels import datasets, fit, parameters
from fitmodels.core.text import json_text
from fitmodels.fit.gram_by_edge import edge_triangle, edge_triangles
from fitmodels.live.edge_summary import EdgeSummary, equivalent_row
from fitmodels.live.learning import learn
from fitmodels.parameters.draws import unpacked
from fitmodels.parameters.gather.learned import drift, law_with, learned_law, posterior_with

LAWS = {"AW": ["V", "f", "d", "t"], "P": ["V", "f", "d", "t", "AW"], "Fxz": ["V", "f", "d", "t", "AW"]}
DRAWS = 4000


def part(runs, which):
    """Runs of the edges whose numbers fulfil a condition."""
    table = runs.to_frame()
    names = sorted(table["edge"].unique())
    return datasets.runs_from_frame(table[table["edge"].isin([e for i, e in enumerate(names) if which(i)])])


def recursive_and_batch(runs):
    """One line for each law."""
    print("law  edges  coefficients/se  covariance  posterior/sd  edge to sums us  refit ms  kB an edge")
    few = part(runs, lambda i: i % 3 == 0)
    for name, factors in LAWS.items():
        law = fit.power_law(few, name, factors)
        pf = parameters.collect(laws=[law], posteriors=[fit.posterior(law, draws=DRAWS)])
        section, whole = pf.laws[name], fit.power_law(runs, name, factors)
        later = edge_triangles(fit.power_law(part(runs, lambda i: i % 3), name, factors))
        times = []
        for number, triangle in enumerate(later, start=2):
            began = perf_counter()
            found = learned_law(pf, section, [triangle], number)
            times.append(perf_counter() - began)
            section = type(section).model_validate(json.loads(json_text(found.section.model_dump())))
        again = law_with(pf, section)
        se = np.sqrt(np.diag(whole.covariance()))
        here = posterior_with(pf, again)
        there = fit.posterior(whole, draws=DRAWS, priors=here.priors)
        apart = np.abs((here.draws - there.draws) / there.draws.std(axis=0)).max()
        W = np.column_stack([whole.design[:10, 1:], np.log(whole.observed[:10])])
        began = perf_counter()
        for _ in range(200):
            edge_triangle("E", W)
        micro = (perf_counter() - began) / 200 * 1e6
        kb = len(json_text(section.sums.model_dump())) / 1000 / len(section.sums.edges)
        cov = np.abs(np.array(section.uncertainty.matrix) / whole.covariance() - 1).max()
        print(
            f"{name:4} {len(later):5}  {np.abs((again.theta - whole.theta) / se).max():15.1e}  {cov:10.1e}  "
            f"{apart:12.1e}  {micro:15.0f}  {1e3 * np.median(times):8.0f}  {kb:10.2f}"
        )


def lives(rng, edges, theta, m, between):
    """Edges of a truth, at conditions that change twice in their life, with their wear."""
    for i in range(edges):
        edge, S = EdgeSummary(f"W{i}"), 0.0
        for _ in range(3):
            at = {"V": rng.uniform(60, 180), "f": rng.uniform(0.1, 0.5), "d": rng.uniform(1.5, 3.0)}
            minutes = rng.uniform(2, 8)
            edge.advance(minutes, at)
            S += np.exp((theta[0] + theta[1:4] @ np.log([at["V"], at["f"], at["d"]])) / m) * minutes
        wear = np.exp(m * np.log(S) + rng.normal(0, between) + rng.normal(0, 0.03))
        edge.measured("AW", float(wear))
        yield edge, S**m


def shifted(runs, edges):
    """Learning of a wear law that is 8 % too low."""
    rng = np.random.default_rng(26)
    law = fit.power_law(runs, "AW", LAWS["AW"])
    pf = parameters.collect(laws=[law], posteriors=[fit.posterior(law, draws=1000)])
    theta = law.theta + np.array([np.log(1.08), 0, 0, 0, 0])
    m, between = theta[4], law.edges.mixed.sd_between
    made = list(lives(rng, edges, theta, m, between))
    plain = [np.log(clean) - (theta[0] + theta[1:] @ row_of_means(edge)) for edge, clean in made]
    exact = [np.log(clean) - (theta[0] + theta[1:] @ row_of_law(edge, law)) for edge, clean in made]
    print(
        f"\nWear of a life at changing conditions by the true law at one row: rms error {rms(exact):.1e} at the mean "
        f"weighted by wear, {rms(plain):.1e} at means over time."
    )
    middle = np.concatenate([[1.0], law.design.mean(axis=0)[1:]])
    print(
        "Error at the middle of the tests, %, of the law, which weighs rows, and of its posterior, which weighs edges:"
    )
    print("batch  edges so far     law  posterior  batch against the first fit  in se")
    print(f"file   {law.n_edges:12}  {100 * np.expm1(float(middle @ (law.theta - theta))):+6.1f}")
    for number in range(0, edges, 5):
        new = learn(pf, [edge for edge, _ in made[number : number + 5]], batch=f"B{number // 5 + 1}")
        pf = new.pf
        now, last = law_with(pf, pf.laws["AW"]), [row for row in drift(pf).rows if row.response == "AW"][-1]
        drawn = unpacked(new.draws, "draws")["AW"].values[:, :5].mean(axis=0)
        away, of_draws = (100 * np.expm1(float(middle @ (of - theta))) for of in (now.theta, drawn))
        print(
            f"{last.batch:6} {now.n_edges:12}  {away:+6.1f}  {of_draws:+9.1f}  {100 * last.shift:+26.1f}%  "
            f"{last.shift / last.se:5.1f}"
        )


def rms(values):
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def row_of_means(edge):
    """Logarithms of V, f, d as means over time, and of the minutes."""
    row = equivalent_row(edge.marks[0], {}, 0.0)
    return np.array([row["V"], row["f"], row["d"], np.log(edge.minutes)])


def row_of_law(edge, law):
    """Logarithms of V, f, d, t of the row that learning takes."""
    row = equivalent_row(edge.marks[0], dict(law.params), float(law.params["t"]))
    return np.array([row["V"], row["f"], row["d"], row["t"]])


def main() -> None:
    """Print both studies."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--edges", type=int, default=40, help="edges of the simulation (default: %(default)s)")
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    recursive_and_batch(runs)
    shifted(runs, parser.parse_args().edges)


if __name__ == "__main__":
    main()
