"""Wear and remaining life of simulated edges beside a running machine: errors, coverage, overruns, life used.

    python benchmarks/live_edges.py [--edges 1000] [--tests 0] [--seed 2026] [--wander 1]

The laws are those of the bundled set GC435 on 709M40, criterion AW 0.3 mm; the hidden truth of each edge has the
parameters of all laws and the scatter between edges from one draw of their posterior. With ``--tests 25`` the truth is
that of the published laws themselves (AC-2016), and 25 files are fitted to tests of 24 edges of it, whose wear is read
with a gauge error of 3 %: this weakens the coefficient of wear in the laws of load, so that intervals are too wide.

Truth and readings come from another generator (Philox) than any of the estimate, which draws nothing, and wear is
integrated in steps of 30 s. Every edge has its own levels, an own time exponent (sd 5 %), wander of wear and loads of 1
to 3 % over 1 to 4 and 0.5 to 3 min, noise of a window of 1 to 5 % whose stated standard error is wrong by 20 %, 10 %
outlying windows, changes of feed every 3 to 10 min. Cuts last 0.5 to 3 min; the edge is changed before the cut at whose
end the probability of being past the criterion exceeds the risk.

With FITMODELS_DATA also the NASA milling data, one case left out at a time: coverage of 90 % intervals of wear.
Every figure but those is from simulation.
"""

import argparse
import json
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from fitmodels import datasets, fit, parameters
from fitmodels.core.progress import progress_bar
from fitmodels.datasets import gc435
from fitmodels.live.edge_estimate import EdgeEstimate
from fitmodels.live.edge_scatter import Wander
from fitmodels.live.live_laws import LiveLaws
from fitmodels.live.samples import LoadMean, Window
from fitmodels.parameters.draws import Draws
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from watched_edge import filter_and_regression

CRITERION = 0.3
STEP = 0.5  # min
LONGEST = 120.0  # min, median life by the published law of the conditions that are drawn
WEAR, LOADS = "AW", ("P", "Fxz")
MODES = {"P + Fxz": LOADS, "Fxz": ("Fxz",), "P": ("P",), "law alone": ()}
PUBLISHED = {law.response: {"ln c0": np.log(law.c0), **law.exponents, "level": law.sd_edge} for law in gc435.LAWS}
EXPONENT_SHARE, GAUGE = 0.05, 0.03
MIDDLE = np.log(np.sqrt(2.0 * 20.0))  # ln t at which the level of an edge is defined


@dataclass
class Truth:
    """Hidden truth of one edge, and what its machine gives, in steps of 30 s."""

    conditions: list
    wear: np.ndarray
    smooth: np.ndarray
    loads: dict
    se: dict
    cuts: np.ndarray
    life: float
    law: dict
    wander: Wander


def wandering(rng, n, wander, start=None):
    """Ornstein-Uhlenbeck process in steps of 30 s, shape (n,)."""
    kept = wander.kept(STEP)
    noise = rng.standard_normal(n) * wander.sd * np.sqrt(1 - kept**2)
    noise[0] = rng.standard_normal() * wander.sd if start is None else start
    return lfilter([1.0], [1.0, -kept], noise)


def grown(wear, at, law, minutes):
    """Wear after minutes at conditions, from a wear: dw/dt of the law at that wear."""
    C = np.exp(law["ln c0"] + sum(law[name] * np.log(at[name]) for name in ("V", "f", "d")))
    return C * ((wear / C) ** (1 / law["t"]) + minutes) ** law["t"]


def laws_of_edge(rng, draws=None):
    """Laws of one edge with its levels and time exponent: the published ones, or from one draw of each posterior."""
    found = {name: dict(law) for name, law in PUBLISHED.items()}
    for name, of in (draws or {}).items():
        found[name] = dict(zip(of.names, of.to_frame().iloc[rng.integers(len(of.values))], strict=True))
        found[name]["level"] = found[name]["sd"] * np.sqrt(found[name]["icc"] / (1 - found[name]["icc"]))
    for law in found.values():
        law["ln c0"] += law["level"] * rng.standard_normal()
    wear = found[WEAR]
    delta = wear["t"] * EXPONENT_SHARE * rng.standard_normal()
    wear["ln c0"] -= delta * MIDDLE
    wear["t"] += delta
    return found


def true_loads(rng, laws, conditions, wear, more=1.0):
    """Values of ln load of one edge at each step, without noise, by symbol."""
    X, n = np.log([[c[s] for s in ("V", "f", "d")] for c in conditions]), len(wear)
    ln_t = np.log(STEP * np.arange(1, n + 1))
    found = {}
    for name in LOADS:
        law, wander = laws[name], Wander(more * rng.uniform(0.01, 0.03), rng.uniform(0.5, 3.0))
        ln = law["ln c0"] + X @ [law[s] for s in ("V", "f", "d")] + law["t"] * ln_t + law[WEAR] * np.log(wear)
        found[name] = ln + wandering(rng, n, wander)
    return found


def true_wander(rng):
    """Wander of the wear of one edge."""
    return Wander(rng.uniform(0.01, 0.03), rng.uniform(1.0, 4.0))


def test_rows(rng):
    """Tests of 24 edges of the truth, a row each 2 min, as a laboratory records them."""
    rows, plan = [], gc435.gc435_rows(int(rng.integers(1, 1000))).groupby("edge")[["V", "f", "d"]].first()
    for name, *at in plan.itertuples():
        laws, at = laws_of_edge(rng), dict(zip(("V", "f", "d"), at, strict=True))
        smooth = grown(0.0, at, laws[WEAR], STEP * np.arange(1, 41))
        wear = smooth * np.exp(wandering(rng, 40, true_wander(rng)))
        loads = true_loads(rng, laws, [at] * 40, wear)
        for k in range(3, 40, 4):
            read = {WEAR: wear[k] * np.exp(GAUGE * rng.standard_normal())}
            read |= {load: np.exp(loads[load][k] + 0.02 * rng.standard_normal()) for load in LOADS}
            rows.append({"edge": name, **at, "t": STEP * (k + 1), **read})
            if wear[k] > CRITERION:
                break
    return pd.DataFrame(rows)


def fitted(runs):
    """Parameter file and posterior draws of the laws of tests."""
    given = ["V", "f", "d", "t"]
    laws = [fit.power_law(runs, WEAR, given), *(fit.power_law(runs, name, [*given, WEAR]) for name in LOADS)]
    posteriors = [fit.posterior(law, seed=1) for law in laws]
    draws = {post.response: Draws(post.names, post.draws) for post in posteriors}
    return parameters.collect(laws=laws), draws


def settings(rng, pf):
    """Conditions inside the tested region whose life by the published law is not above the longest."""
    region, law = pf.laws[WEAR], PUBLISHED[WEAR]
    while True:
        at = {name: float(np.exp(rng.uniform(*np.log(ends)))) for name, ends in gc435.DOMAIN.items()}
        life = (CRITERION / grown(0.0, at, law, 1.0)) ** (1 / law["t"])
        if 4.0 < life < LONGEST and region.inside(**at, t=6.0):
            return at


def true_edge(rng, pf, draws=None, more=1.0):
    """Truth of one edge until about 1.35 times its life."""
    at, laws = settings(rng, pf), laws_of_edge(rng, draws)
    law = laws[WEAR]
    conditions, smooth, w, f, left = [], [], 0.0, at["f"], 0.0
    while w < CRITERION * 1.35 ** law["t"]:
        if left <= 0:
            left, at = rng.uniform(3.0, 10.0), {**at, "f": float(f * np.exp(rng.uniform(-0.25, 0.25)))}
        w, left = grown(w, at, law, STEP), left - STEP
        conditions.append(at)
        smooth.append(w)
    smooth, n, wander = np.array(smooth), len(smooth), true_wander(rng)
    wear = smooth * np.exp(wandering(rng, n, wander))
    loads, se = true_loads(rng, laws, conditions, wear, more), {}
    for name in LOADS:
        noise, outlying = rng.uniform(0.01, 0.05), rng.random(n) < 0.1
        loads[name] = loads[name] + noise * rng.standard_normal(n)
        loads[name] += outlying * rng.choice([-1, 1], n) * rng.uniform(0.1, 0.5, n)
        se[name] = noise * np.exp(0.2 * rng.standard_normal())
    cuts = np.cumsum(rng.uniform(0.5, 3.0, int(n * STEP / 0.5) + 2))
    past = np.flatnonzero(wear >= CRITERION)
    life = STEP * (past[0] + 1) if len(past) else STEP * n
    return Truth(conditions, wear, smooth, loads, se, cuts, life, law, wander)


def remaining(rng, truth, k):
    """Minutes until the wear first passes the criterion at the conditions of step k."""
    n, at = 3 * len(truth.wear) + 200, truth.conditions[k]
    wear = grown(truth.smooth[k], at, truth.law, STEP * np.arange(n))
    wander = wandering(rng, n, truth.wander, np.log(truth.wear[k] / truth.smooth[k]))
    past = np.flatnonzero(wear * np.exp(wander) >= CRITERION)
    return STEP * past[0] if len(past) else np.inf


def watch(rng, truth, laws, gauge=None):
    """Watch one edge: rows at tenths of its life; (minutes, probability, step) of cuts; seconds; bytes of a snapshot.

    A row is (share of the life, error of ln wear, wear covered, life covered, true life below the interval, width).
    """
    edge, names = EdgeEstimate(laws, CRITERION), tuple(laws.loads)
    marks = {round(share * truth.life / STEP): share for share in np.arange(0.1, 1.01, 0.1)}
    rows, cuts, seconds, starts = [], [], 0.0, set(np.floor(truth.cuts / STEP).astype(int))
    ends = truth.cuts
    for k in range(len(truth.wear)):
        if k in starts or k == 0:
            j = int(np.searchsorted(ends, STEP * k + 1e-9, side="right"))
            ahead = STEP * (np.floor(ends[j] / STEP) - k)
            cuts.append((STEP * k, edge.probability_past(max(ahead, STEP), truth.conditions[k]), k))
        loads = {name: LoadMean(float(truth.loads[name][k]), truth.se[name], 500) for name in names}
        begin = time.perf_counter()
        edge.add(Window(60 * STEP * k, 60 * STEP * (k + 1), STEP, truth.conditions[k], loads))
        seconds += time.perf_counter() - begin
        if gauge is not None and k + 1 == round(truth.life / 3 / STEP):
            edge.gauge(float(truth.wear[k] * np.exp(gauge * rng.standard_normal())), gauge)
        if k + 1 in marks:
            found, life, true = edge.wear(), edge.life(truth.conditions[k]), remaining(rng, truth, k)
            error = np.log(found.median / truth.wear[k])
            rows.append(
                (marks[k + 1], error, found.low <= truth.wear[k] <= found.high, life.low <= true <= life.high,
                 life.low > true, np.log(found.high / found.low))
            )  # fmt: skip
    return rows, cuts, seconds / len(truth.wear), len(json.dumps(edge.as_json()))


def changes(truths, cuts, risk):
    """Whether the wear is past the criterion at a change at a risk, and the share of life used; (n,), (n,)."""
    over, used = [], []
    for truth, of in zip(truths, cuts, strict=True):
        k, minutes = next(((k, m) for m, p, k in of if p > risk), (len(truth.wear), STEP * len(truth.wear)))
        over.append(k > 0 and bool(truth.wear[k - 1] >= CRITERION))
        used.append(min(minutes, truth.life) / truth.life)
    return np.array(over), np.array(used)


def at_equal_risk(truths, cuts, target):
    """Share of life used at the threshold at which the target share of edges overran, by bisection (hindsight)."""
    low, high = 1e-4, 0.6
    for _ in range(40):
        middle = (low * high) ** 0.5
        low, high = (low, middle) if changes(truths, cuts, middle)[0].mean() > target else (middle, high)
    return changes(truths, cuts, low)[1].mean()


def agreement(laws):
    """Largest difference between the filter, through JSON at every tenth window, and one regression, in sd."""
    found = filter_and_regression(laws)
    return np.abs((found.filter_mean - found.mean) / np.sqrt(np.diag(found.covariance))).max()


def nasa(folder, use):
    """Rows (case, error of ln VB, covered, width) of NASA milling, one case left out, with or without the current."""
    data = pd.read_csv(folder / "nasa_milling" / "nasa_mill_runs.csv")
    data["I"] = (
        data.smcAC_mid_std + 0.00419
    ) / 0.25309  # the direct current, which saturates, from the alternating one
    data = data[(data.VB > 0) & (data.time > 0)].rename(columns={"DOC": "d", "feed": "f", "time": "t", "case": "edge"})
    data, rows = data[["edge", "material", "f", "d", "t", "VB", "I"]].astype({"edge": str, "material": str}), []
    for case in data.edge.unique():
        runs = datasets.runs_from_frame(data[data.edge != case], judge=False)
        laws = [
            fit.power_law(runs, "VB", ["f", "d", "t"], by="material"),
            fit.power_law(runs, "I", ["f", "d", "VB"], by="material"),
        ]
        mine = data[data.edge == case].sort_values("t")
        found = LiveLaws.of(
            parameters.collect(laws=laws), by=mine.material.iloc[0], loads=["I"] if use else [], wear="VB"
        )
        edge, last = EdgeEstimate(found, 0.5), 0.0
        for row in mine.itertuples():
            loads = {"I": LoadMean(float(np.log(row.I)), 0.02, 9)}
            edge.add(Window(60 * last, 60 * row.t, row.t - last, {"f": row.f, "d": row.d}, loads))
            last, wear = row.t, edge.wear()
            rows.append(
                (case, np.log(wear.median / row.VB), wear.low <= row.VB <= wear.high, np.log(wear.high / wear.low))
            )
    return pd.DataFrame(rows, columns=["case", "error", "covered", "width"])


def report_nasa(folder):
    """Print the lines of NASA milling."""
    for use in (True, False):
        found = nasa(folder, use)
        rms, title = np.sqrt((found.error**2).mean()), "with the motor current" if use else "law alone"
        print(
            f"NASA milling, one of {found.case.nunique()} cases left out, {len(found)} readings, {title}: rms of ln VB "
            f"{rms:.3f}, coverage of 90 % {found.covered.mean():.3f}, mean ln width {found.width.mean():.2f}"
        )


def report(name, rows, truths, cuts):
    """Print one line of the table."""
    table = np.array([row for of in rows for row in of], dtype=float)
    over, _ = changes(truths, cuts, 0.05)
    equal = at_equal_risk(truths, cuts, 0.05)
    error = np.abs(np.expm1(table[:, 1]))
    print(
        f"{name:22s} {100 * np.median(error):7.1f} {table[:, 2].mean():9.3f} {table[:, 3].mean():9.3f} "
        f"{over.mean():9.3f} {changes(truths, cuts, 0.05)[1].mean():7.3f} {equal:11.3f}", flush=True
    )  # fmt: skip
    return equal, table


def main():
    """Print the table of simulated edges."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--edges", type=int, default=1000)
    parser.add_argument("--tests", type=int, default=0, help="simulated sets of tests, among which edges are divided")
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--wander", type=float, default=1.0, help="factor of the true wander of loads")
    parser.add_argument("--modes", default=",".join([*MODES, "gauge"]))
    args = parser.parse_args()
    asked, truths, files = args.modes.split(","), [], []
    with progress_bar(lines=False) as step:
        for k in range(max(args.tests, 1)):
            step.say(f"tests and laws: {k + 1}")
            rng = np.random.Generator(np.random.Philox([args.seed, k]))
            bundled = datasets.read_runs(datasets.bundled("gc435_709m40"))
            pf, draws = fitted(datasets.runs_from_frame(test_rows(rng), judge=False) if args.tests else bundled)
            files.append((pf, draws))
            hidden = None if args.tests else draws
            edges = -(-args.edges // max(args.tests, 1))
            truths += [(k, true_edge(rng, pf, hidden, args.wander)) for _ in range(edges)]
        truths = truths[: args.edges]
        print_table(args, asked, truths, files, step)
    print(f"filter through JSON against one regression: {agreement(LiveLaws.of(*files[0], wear=WEAR)):.1e} sd")
    if folder := os.environ.get("FITMODELS_DATA"):
        report_nasa(Path(folder))


def print_table(args, asked, truths, files, step):
    """Watch all edges with each set of loads, and print a line of each."""
    lives = np.array([truth.life for _, truth in truths])
    print(f"SIMULATED: {len(truths)} edges, {len(files)} parameter file(s), seed {args.seed}; lives (10, 50, 90 %) "
          f"{np.quantile(lives, [0.1, 0.5, 0.9]).round(1)} min")  # fmt: skip
    print(f"Monte Carlo error of a share of 5 %: {np.sqrt(0.05 * 0.95 / len(truths)):.3f}")
    print("loads                  error % cov. wear cov. life overrun at .05    used used at equal overrun")
    equal = {}
    for name in (name for name in [*MODES, "gauge"] if name in asked):
        laws = [LiveLaws.of(pf, draws, wear=WEAR, loads=MODES.get(name, LOADS)) for pf, draws in files]
        found = []
        for i, (k, truth) in enumerate(truths):
            step.say(f"{name}: {i + 1} of {len(truths)}")
            own = np.random.Generator(np.random.Philox([args.seed, 1000 + i]))
            found.append(watch(own, truth, laws[k], 0.02 if name == "gauge" else None))
        rows, cuts, seconds, sizes = zip(*found, strict=True)
        title = "P + Fxz, gauged once" if name == "gauge" else name
        equal[name], table = report(title, rows, [truth for _, truth in truths], cuts)
        if name == "P + Fxz":
            marks = [np.isclose(table[:, 0], share) for share in (0.2, 0.5, 0.8, 1.0)]
            shares = [table[mark, 2:5].mean(axis=0).round(3).tolist() for mark in marks]
            print(f"  coverage (wear, life, true life below the interval) at .2 .5 .8 1.0 of the life: {shares}")
            print(f"  update of two loads {1e3 * np.mean(seconds):.2f} ms; snapshot {min(sizes)} to {max(sizes)} bytes")
    if {"P + Fxz", "law alone"} <= set(equal):
        gain = equal["P + Fxz"] / equal["law alone"] - 1
        print(f"share of life used at equal overrun, two loads against the law alone: {100 * gain:+.0f} %")


if __name__ == "__main__":
    main()
