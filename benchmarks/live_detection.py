"""Chipping, and batches of work material, in simulated edges: shares found, delays, false alarms, overruns before.

    python benchmarks/live_detection.py [--edges 1000] [--pool 300] [--runs 1000] [--seed 2026]

Edges are those of live_edges.py (hidden truth of another generator than any of the estimate, scatter between edges,
wander, 1 to 5 % noise, 10 % outlying windows, changes of feed). Chipping: at a random moment between a fifth and four
fifths of the life the wear is multiplied at once, and loads with it by their hidden exponents. Batch: each edge of a
pool is watched with loads as they are, 8 % higher and 8 % lower throughout, and used until the cut at whose end the
probability of being past the criterion exceeds 5 %; a run draws 20 edges of the usual batch, then up to 60 of the
other, with one error of the laws that is common to the run, as large as the laws state theirs.

Every figure is from simulation.
"""

import argparse
from dataclasses import replace

import live_edges
import numpy as np
from fitmodels.core.progress import progress_bar
from fitmodels.live.detection import BatchDetector, Detection
from fitmodels.live.edge_estimate import EdgeEstimate
from fitmodels.live.live_laws import LiveLaws
from fitmodels.live.samples import LoadMean, Window

STEP, RISK = live_edges.STEP, 0.05
FACTORS = (1.2, 1.5, 2.0)
SHIFTS = (0.0, 0.08, -0.08)
SOON = 3.0  # min


def window(truth, k, names):
    """Window k of an edge."""
    loads = {name: LoadMean(float(truth.loads[name][k]), truth.se[name], 500) for name in names}
    return Window(60 * STEP * k, 60 * STEP * (k + 1), STEP, truth.conditions[k], loads)


def chip(truth, exponents, k, factor):
    """Multiply the wear from step k on, and loads by their exponents."""
    truth.wear[k:] *= factor
    for name, exponent in exponents.items():
        truth.loads[name][k:] += exponent * np.log(factor)


def watched(truth, laws, detection, last):
    """Steps of alarms by kind until a step."""
    edge, found = EdgeEstimate(laws, live_edges.CRITERION), []
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
    laws = LiveLaws.of(pf, draws, wear=live_edges.WEAR, loads=names)
    rng = np.random.Generator(np.random.Philox([args.seed, round(100 * factor)]))
    delays, false, minutes, tools = [], 0, 0.0, 0
    for i in range(args.edges):
        step.say(f"chipping x {factor}: {i + 1} of {args.edges}")
        truth = live_edges.true_edge(rng, pf, draws)
        exponents = {name: live_edges.theta(rng, draws, name)[live_edges.WEAR] for name in names}
        n = round(truth.life / STEP)
        at = int(rng.uniform(0.2, 0.8) * n)
        chip(truth, exponents, at, factor)
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
    edge, starts = EdgeEstimate(laws, live_edges.CRITERION), set(np.floor(truth.cuts / STEP).astype(int))
    for k in range(len(truth.wear)):
        if k in starts:
            end = truth.cuts[int(np.searchsorted(truth.cuts, STEP * k + 1e-9, side="right"))]
            ahead = STEP * (np.floor(end / STEP) - k)
            if edge.probability_past(max(ahead, STEP), truth.conditions[k]) > RISK:
                break
        one = window(truth, k, laws.loads)
        edge.add(replace(one, loads={name: replace(m, ln=m.ln + np.log1p(shift)) for name, m in one.loads.items()}))
    deviations = {name: edge.law_deviation(name) for name in laws.loads}
    return deviations, bool(k > 0 and truth.wear[k - 1] >= live_edges.CRITERION), min(k * STEP / truth.life, 1.0)


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
    laws = LiveLaws.of(pf, draws, wear=live_edges.WEAR, loads=names)
    rng, pools = np.random.Generator(np.random.Philox([args.seed, 8])), {shift: [] for shift in SHIFTS}
    for i in range(args.pool):
        step.say(f"batches: {i + 1} of {args.pool}")
        truth = live_edges.true_edge(rng, pf, draws)
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
    pf, draws = live_edges.fitted()
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
