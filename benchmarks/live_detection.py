"""Chipping, and batches of work material, in simulated edges: shares found, delays, false alarms, overruns before.

    python benchmarks/live_detection.py [--edges 1000] [--pool 300] [--runs 1000] [--seed 2026]

The laws are fitted to the bundled set GC435 on 709M40, criterion AW 0.3 mm. The hidden truth of each edge is of another
generator (Philox) than any of the estimate, which draws nothing: parameters and scatter of edges from posterior draws,
own levels and time exponent, wander of wear and loads of 1 to 3 %, noise of a window of 10 s of 1 to 5 % whose stated
standard error is wrong by 20 %, 10 % outlying windows, changes of feed every 3 to 10 min.

Chipping: at a random moment between a fifth and four fifths of the life the wear is multiplied at once, and loads with
it by their hidden exponents. Batch: each edge of a pool is watched with loads as they are, 8 % higher and 8 % lower
throughout, and used until the cut at whose end the probability of being past the criterion exceeds 5 %; a run draws 20
edges of the usual batch, then up to 60 of the other, with one error of the laws that is common to the run, as large as
the laws state theirs.

Every figure is from simulation.
"""

import argparse
from dataclasses import dataclass, replace

import numpy as np
from fitmodels import datasets, fit, parameters
from fitmodels.core.progress import progress_bar
from fitmodels.live.detection import BatchDetector, Detection
from fitmodels.live.edge_estimate import EdgeEstimate
from fitmodels.live.edge_scatter import Wander
from fitmodels.live.live_laws import LiveLaws
from fitmodels.live.samples import LoadMean, Window
from fitmodels.parameters.draws import Draws
from scipy.signal import lfilter

CRITERION, RISK = 0.3, 0.05
STEP = 1 / 6  # min
LONGEST = 120.0  # min, median life by the law of the conditions that are drawn
WEAR, LOADS = "AW", ("P", "Fxz")
FACTORS = (1.2, 1.5, 2.0)
SHIFTS = (0.0, 0.08, -0.08)
SOON = 3.0  # min


def fitted():
    """Parameter file and draws of the bundled set."""
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    given = ["V", "f", "d", "t"]
    laws = [fit.power_law(runs, WEAR, given), *(fit.power_law(runs, name, [*given, WEAR]) for name in LOADS)]
    draws = {law.response: (post := fit.posterior(law, seed=1)) and Draws(post.names, post.draws) for law in laws}
    return parameters.collect(laws=laws), draws


@dataclass
class Truth:
    """Hidden truth of one edge, and what its machine gives, in steps of 10 s."""

    conditions: list
    wear: np.ndarray
    loads: dict
    se: dict
    exponents: dict
    cuts: np.ndarray
    life: float


def theta(rng, draws, name):
    """Parameters by name, with the scatter between edges, of one posterior draw."""
    own = dict(zip(draws[name].names, draws[name].values[rng.integers(len(draws[name].values))], strict=True))
    own["between"] = own["sd"] * np.sqrt(own["icc"] / (1 - own["icc"]))
    return own


def settings(rng, pf):
    """Conditions inside the tested region whose median life by the law is not above the longest."""
    law = pf.laws[WEAR]
    c = law.coefficients
    ranges = {factor.symbol: (factor.low, factor.high) for factor in law.factors}
    while True:
        at = {name: float(np.exp(rng.uniform(*np.log(ranges[name])))) for name in ("V", "f", "d")}
        life = (CRITERION / law.predict(**at, t=1.0).value) ** (1 / c["t"])
        if 4.0 < life < LONGEST and law.inside(**at, t=6.0):
            return at


def wandering(rng, n, wander):
    """Ornstein-Uhlenbeck process in steps of 10 s, shape (n,)."""
    kept = wander.kept(STEP)
    noise = rng.standard_normal(n) * wander.sd * np.sqrt(1 - kept**2)
    noise[0] = rng.standard_normal() * wander.sd
    return lfilter([1.0], [1.0, -kept], noise)


def grown(wear, at, law, minutes):
    """Wear after minutes at conditions, from a wear: dw/dt of the law at that wear."""
    m = law["t"]
    C = np.exp(law["ln c0"] + sum(law[name] * np.log(at[name]) for name in ("V", "f", "d")))
    return C * ((wear / C) ** (1 / m) + minutes) ** m


def true_edge(rng, pf, draws, share=0.05):
    """Truth of one edge until 1.35 times its life."""
    at = settings(rng, pf)
    law = theta(rng, draws, WEAR)
    delta = law["t"] * share * rng.standard_normal()
    level = law["between"] * rng.standard_normal()
    law["ln c0"] += level - delta * np.log(np.sqrt(2.0 * 20.0))  # levels are those in the middle of the tested times
    law["t"] += delta
    conditions, smooth, w, f, left = [], [], 0.0, at["f"], 0.0
    while w < CRITERION * 1.35 ** law["t"]:  # well past the criterion
        if left <= 0:
            left, at = rng.uniform(3.0, 10.0), {**at, "f": float(f * np.exp(rng.uniform(-0.25, 0.25)))}
        w, left = grown(w, at, law, STEP), left - STEP
        conditions.append(at)
        smooth.append(w)
    smooth, n = np.array(smooth), len(smooth)
    wear = smooth * np.exp(wandering(rng, n, Wander(rng.uniform(0.01, 0.03), rng.uniform(1.0, 4.0))))
    loads, se, exponents = {}, {}, {}
    for name in LOADS:
        own, noise = theta(rng, draws, name), rng.uniform(0.01, 0.05)
        X = np.array([[np.log(c[s]) for s in ("V", "f", "d")] for c in conditions])
        ln = own["ln c0"] + X @ [own[s] for s in ("V", "f", "d")] + own["t"] * np.log(STEP * np.arange(1, n + 1))
        ln = ln + own[WEAR] * np.log(wear) + own["between"] * rng.standard_normal()
        ln += wandering(rng, n, Wander(rng.uniform(0.01, 0.03), rng.uniform(0.5, 3.0)))
        ln += noise * rng.standard_normal(n)
        outlying = rng.random(n) < 0.1
        loads[name] = ln + outlying * rng.choice([-1, 1], n) * rng.uniform(0.1, 0.5, n)
        exponents[name] = own[WEAR]
        se[name] = noise * np.exp(0.2 * rng.standard_normal())
    cuts = np.cumsum(rng.uniform(0.5, 3.0, int(n * STEP / 0.5) + 2))
    past = np.flatnonzero(wear >= CRITERION)
    return Truth(conditions, wear, loads, se, exponents, cuts, STEP * (past[0] + 1))


def window(truth, k, names):
    """Window k of an edge."""
    loads = {name: LoadMean(float(truth.loads[name][k]), truth.se[name], 500) for name in names}
    return Window(60 * STEP * k, 60 * STEP * (k + 1), STEP, truth.conditions[k], loads)


def chip(truth, k, factor):
    """Multiply the wear from step k on, and loads by their exponents."""
    truth.wear[k:] *= factor
    for name, exponent in truth.exponents.items():
        truth.loads[name][k:] += exponent * np.log(factor)


def watched(truth, laws, detection, last):
    """Steps of alarms by kind until a step."""
    edge, found = EdgeEstimate(laws, CRITERION), []
    for k in range(last):
        one = window(truth, k, laws.loads)
        edge.add(one)
        for alarm in detection.add(edge):
            found.append((k, alarm.kind))
            if alarm.kind == "chipping":
                edge.reopen()
    return found


def chipping(args, pf, draws, names, factor, step):
    """Print shares of chipped edges found, delays, and false alarms before."""
    laws = LiveLaws.of(pf, draws, wear=WEAR, loads=names)
    rng = np.random.Generator(np.random.Philox([args.seed, round(100 * factor)]))
    delays, false, minutes, tools = [], 0, 0.0, 0
    for i in range(args.edges):
        step.say(f"chipping x {factor}: {i + 1} of {args.edges}")
        truth = true_edge(rng, pf, draws)
        n = round(truth.life / STEP)
        at = int(rng.uniform(0.2, 0.8) * n)
        chip(truth, at, factor)
        alarms = watched(truth, laws, Detection(), min(len(truth.wear), at + round(2 * SOON / STEP)))
        false += sum(k < at and kind != "tool" for k, kind in alarms)
        tools += sum(kind == "tool" for k, kind in alarms)
        minutes += at * STEP
        after = [(k - at + 1) * STEP for k, kind in alarms if k >= at and kind == "chipping"]
        delays.append(after[0] if after else np.inf)
    delays = np.array(delays)
    median = np.median(delays)
    print(
        f"{' + '.join(names):9s} x {factor:3.1f}   {np.mean(delays <= SOON):6.3f}   {60 * median:7.0f} s   "
        f"{60 * false / minutes:7.3f}      {tools / args.edges:7.4f}",
        flush=True,
    )


def used_edge(truth, laws, shift):
    """Deviations of an edge from its laws at the change at the risk, and whether it overran, with its loads shifted."""
    edge, starts = EdgeEstimate(laws, CRITERION), set(np.floor(truth.cuts / STEP).astype(int))
    for k in range(len(truth.wear)):
        if k in starts:
            end = truth.cuts[int(np.searchsorted(truth.cuts, STEP * k + 1e-9, side="right"))]
            ahead = STEP * (np.floor(end / STEP) - k)
            if edge.probability_past(max(ahead, STEP), truth.conditions[k]) > RISK:
                break
        one = window(truth, k, laws.loads)
        edge.add(replace(one, loads={name: replace(m, ln=m.ln + np.log1p(shift)) for name, m in one.loads.items()}))
    deviations = {name: edge.law_deviation(name) for name in laws.loads}
    return deviations, bool(k > 0 and truth.wear[k - 1] >= CRITERION), min(k * STEP / truth.life, 1.0)


def run(rng, usual, other):
    """False alarms in 20 usual edges; edges of the other batch until its alarm (inf: none of 60), and overruns."""
    detector, common = BatchDetector(), rng.standard_normal()
    false = 0

    def finish(edge):
        return detector.finish({name: replace(d, value=d.value + common * d.sd_law) for name, d in edge.items()})

    for i in rng.integers(len(usual), size=20):
        false += finish(usual[i][0]) != 0
    overruns = 0
    for j, i in enumerate(rng.integers(len(other), size=60)):
        overruns += other[i][1]
        if finish(other[i][0]):
            return false, j + 1, overruns
    return false, np.inf, overruns


def batches(args, pf, draws, names, step):
    """Print false alarms, delays and overruns of shifted batches."""
    laws = LiveLaws.of(pf, draws, wear=WEAR, loads=names)
    rng, pools = np.random.Generator(np.random.Philox([args.seed, 8])), {shift: [] for shift in SHIFTS}
    for i in range(args.pool):
        step.say(f"batches: {i + 1} of {args.pool}")
        truth = true_edge(rng, pf, draws)
        for shift, pool in pools.items():
            pool.append(used_edge(truth, laws, shift))
    for shift in SHIFTS[1:]:
        found = np.array([run(rng, pools[0.0], pools[shift]) for _ in range(args.runs)])
        over, used = (np.mean([edge[i] for edge in pools[shift]]) for i in (1, 2))
        print(
            f"{' + '.join(names):9s} {100 * shift:+3.0f} %   {found[:, 0].sum() / 20 / args.runs:6.3f}      "
            f"{np.median(found[:, 1]):5.0f} {np.quantile(found[:, 1], 0.9):6.0f}       {over:6.3f}         "
            f"{found[:, 2].mean():6.2f}           {used:5.3f}", flush=True
        )  # fmt: skip
    over, used = (np.mean([edge[i] for edge in pools[0.0]]) for i in (1, 2))
    print(
        f"{' + '.join(names):9s}  usual batch: share that overran {over:.3f}, share of life used {used:.3f}", flush=True
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--edges", type=int, default=1000)
    parser.add_argument("--pool", type=int, default=300, help="edges of which runs are drawn")
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--factors", type=float, nargs="*", default=FACTORS, help="of the wear, of chipping")
    args = parser.parse_args()
    pf, draws = fitted()
    print(f"SIMULATED: {args.edges} edges, seed {args.seed}")
    print("loads     wear    within 3 min   median   false an hour   another tool, an edge")
    with progress_bar(lines=False) as step:
        for names in (("P", "Fxz"), ("P",)):
            for factor in args.factors:
                chipping(args, pf, draws, names, factor, step)
        print(f"\nSIMULATED: {args.pool} edges with each shift, {args.runs} runs; stated risk {RISK:.0%}")
        print("                 false alarms  edges until found  share that overran  edges that overran  share of")
        print("loads     batch  an edge       median  90 %       (all edges)         before it is found  life used")
        for names in (("P", "Fxz"), ("P",)):
            batches(args, pf, draws, names, step)


if __name__ == "__main__":
    main()
