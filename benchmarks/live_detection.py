"""Chipping, and batches of work material, in simulated edges: shares found, delays, false alarms, overruns before.

    python benchmarks/live_detection.py [--edges 1000] [--runs 100] [--seed 2026]

Edges are those of live_edges.py (hidden truth of another generator than that of the estimate, scatter between edges,
wander, 1 to 5 % noise, 10 % outlying windows, changes of feed). Chipping: at a random moment between a fifth and four
fifths of the life the wear is multiplied at once, and loads with it by their hidden exponents. Batch: 20 edges of the
usual batch, then 30 with loads 8 % higher, or lower, throughout; each edge is used until the change at the risk of 5 %.
Every figure is from simulation.
"""

import argparse

import live_edges
import numpy as np
from fitmodels.core.progress import progress_bar
from fitmodels.live.decision import change_now  # noqa: F401
from fitmodels.live.detection import Detection
from fitmodels.live.edge_estimate import EdgeEstimate
from fitmodels.live.live_laws import LiveLaws
from fitmodels.live.samples import LoadMean, Window

STEP, RISK = live_edges.STEP, 0.05
FACTORS = (1.2, 1.5, 1.7, 2.0)
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


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--edges", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=2026)
    args = parser.parse_args()
    pf, draws = live_edges.fitted()
    print(f"SIMULATED: {args.edges} edges, seed {args.seed}")
    print("loads     wear    within 3 min   median   false an hour   another tool, an edge")
    with progress_bar(lines=False) as step:
        for names in (("P", "Fxz"), ("P",)):
            for factor in FACTORS:
                chipping(args, pf, draws, names, factor, step)


if __name__ == "__main__":
    main()
