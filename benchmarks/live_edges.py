"""Wear and remaining life of simulated edges beside a running machine: errors, coverage, overruns, life used.

    python benchmarks/live_edges.py [--edges 1000] [--seed 2026] [--wander 1]

With FITMODELS_DATA also the NASA milling data, one case left out at a time: coverage of 90 % intervals of wear.

The laws are fitted to the bundled set GC435 on 709M40 (itself simulated), criterion AW 0.3 mm. The hidden truth of each
edge comes from another generator (Philox) than any of the estimate, which draws nothing, and is integrated in steps of
10 s: parameters of all laws and scatter of edges from one posterior draw each, own levels, own time exponent (sd 5 %),
wander of wear and loads of 1 to 3 % over 1 to 4 and 0.5 to 3 min, noise of a window of 1 to 5 % whose stated standard
error is wrong by 20 %, 10 % outlying windows, changes of feed every 3 to 10 min. Cuts last 0.5 to 3 min; the edge is
changed before the cut at whose end the probability of being past the criterion exceeds the risk.

Every figure but those of NASA is from simulation.
"""

import argparse
import json
import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from fitmodels import datasets, fit, parameters
from fitmodels.core.progress import progress_bar
from fitmodels.live.edge_estimate import EdgeEstimate
from fitmodels.live.edge_scatter import Wander
from fitmodels.live.live_laws import LiveLaws
from fitmodels.live.samples import LoadMean, Window
from fitmodels.parameters.draws import Draws
from scipy.signal import lfilter

CRITERION = 0.3
STEP = 1 / 6  # min
LONGEST = 120.0  # min, median life by the law of the conditions that are drawn
WEAR, LOADS = "AW", ("P", "Fxz")
MODES = {"P + Fxz": LOADS, "Fxz": ("Fxz",), "P": ("P",), "law alone": ()}


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
    smooth: np.ndarray
    loads: dict
    se: dict
    cuts: np.ndarray
    life: float
    law: dict
    wander: Wander


def theta(rng, draws, name):
    """Parameters by name, with the scatter between edges, of one posterior draw."""
    table = draws[name].to_frame()
    own = table.iloc[rng.integers(len(table))].to_dict()
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


def true_edge(rng, pf, draws, more=1.0, share=0.05):
    """Truth of one edge until 1.3 times its life."""
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
    wander = Wander(rng.uniform(0.01, 0.03), rng.uniform(1.0, 4.0))
    wear = smooth * np.exp(wandering(rng, n, wander))
    loads, se = {}, {}
    for name in LOADS:
        own, noise = theta(rng, draws, name), rng.uniform(0.01, 0.05)
        X = np.array([[np.log(c[s]) for s in ("V", "f", "d")] for c in conditions])
        ln = own["ln c0"] + X @ [own[s] for s in ("V", "f", "d")] + own["t"] * np.log(STEP * np.arange(1, n + 1))
        ln = ln + own[WEAR] * np.log(wear) + own["between"] * rng.standard_normal()
        ln += wandering(rng, n, Wander(more * rng.uniform(0.01, 0.03), rng.uniform(0.5, 3.0)))
        ln += noise * rng.standard_normal(n)
        outlying = rng.random(n) < 0.1
        loads[name] = ln + outlying * rng.choice([-1, 1], n) * rng.uniform(0.1, 0.5, n)
        se[name] = noise * np.exp(0.2 * rng.standard_normal())
    cuts = np.cumsum(rng.uniform(0.5, 3.0, int(n * STEP / 0.5) + 2))
    past = np.flatnonzero(wear >= CRITERION)
    return Truth(conditions, wear, smooth, loads, se, cuts, STEP * (past[0] + 1), law, wander)


def remaining(rng, truth, k):
    """Minutes until the wear first passes the criterion at the conditions of step k."""
    n, at = 3 * len(truth.wear) + 600, truth.conditions[k]
    wear = grown(truth.smooth[k], at, truth.law, STEP * np.arange(n))
    start, kept = np.log(truth.wear[k] / truth.smooth[k]), truth.wander.kept(STEP)
    noise = rng.standard_normal(n) * truth.wander.sd * np.sqrt(1 - kept**2)
    noise[0] = start
    past = np.flatnonzero(wear * np.exp(lfilter([1.0], [1.0, -kept], noise)) >= CRITERION)
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
    edge, rng, rows, y, kind = EdgeEstimate(laws, CRITERION), np.random.default_rng(5), [], [], []
    prior, scatter, of = edge._state.P.copy(), laws.scatter, edge._state.of_load
    for k in range(120):
        at = {"V": 150.0, "f": 0.2 if k < 60 else 0.3, "d": 2.0}
        edge.advance(STEP, at)
        for name in LOADS:
            _, H = edge._state.load_row(name, edge._exposure, at)
            value = float(rng.normal(0, 0.03))
            edge._state.update(H, value, 0.03**2)
            rows.append(H)
            y.append(value)
            kind.append((name, STEP * k, H[edge._state.w]))
        if k % 10 == 0:
            edge = EdgeEstimate.from_json(laws, json.loads(json.dumps(edge.as_json())))
    moving = [edge._state.w, *(place for one in of.values() for place in one[2:])]
    stays = np.setdiff1d(np.arange(len(prior)), moving)
    H, prior = np.array(rows)[:, stays], prior[np.ix_(stays, stays)]
    S = H @ prior @ H.T + 0.03**2 * np.eye(len(y))
    for i, (a, s, k) in enumerate(kind):
        for j, (b, t, m) in enumerate(kind):
            S[i, j] += k * m * scatter.wear_wander.sd**2 * scatter.wear_wander.kept(abs(s - t))
            for wander in (scatter.load_wander[a], scatter.load_rest[a]) if a == b else ():
                S[i, j] += wander.sd**2 * wander.kept(abs(s - t))
    mean = np.linalg.solve(S, H @ prior).T @ np.array(y)
    return np.abs((edge._state.x[stays] - mean) / np.sqrt(np.diag(edge._state.P)[stays])).max()


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
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--wander", type=float, default=1.0, help="factor of the true wander of loads")
    parser.add_argument("--modes", default=",".join([*MODES, "gauge"]))
    args = parser.parse_args()
    pf, draws = fitted()
    rng = np.random.Generator(np.random.Philox(args.seed))
    truths = [true_edge(rng, pf, draws, args.wander) for _ in range(args.edges)]
    lives = np.array([truth.life for truth in truths])
    print(f"SIMULATED: {args.edges} edges, seed {args.seed}; lives {np.quantile(lives, [0.1, 0.5, 0.9]).round(1)} min")
    print(f"Monte Carlo error of a share of 5 %: {np.sqrt(0.05 * 0.95 / args.edges):.3f}")
    print("loads                  error % cov. wear cov. life overrun at .05    used used at equal overrun")
    asked, equal = args.modes.split(","), {}
    with progress_bar(lines=False) as step:
        for name in [*MODES, "gauge"]:
            if name not in asked:
                continue
            laws = LiveLaws.of(pf, draws, wear=WEAR, loads=MODES.get(name, LOADS))
            found = []
            for i, truth in enumerate(truths):
                step.say(f"{name}: {i + 1} of {args.edges}")
                own = np.random.Generator(np.random.Philox([args.seed, i]))
                found.append(watch(own, truth, laws, 0.02 if name == "gauge" else None))
            rows, cuts, seconds, sizes = zip(*found, strict=True)
            title = "P + Fxz, gauged once" if name == "gauge" else name
            equal[name], table = report(title, rows, truths, cuts)
            if name == "P + Fxz":
                cost = (1e3 * np.mean(seconds), np.min(sizes), np.max(sizes))
                shares = [
                    table[np.isclose(table[:, 0], s), 2:5].mean(axis=0).round(3).tolist() for s in (0.2, 0.5, 0.8, 1.0)
                ]
    if {"P + Fxz", "law alone"} <= set(equal):
        gain = equal["P + Fxz"] / equal["law alone"] - 1
        print(f"share of life used at equal overrun, two loads against the law alone: {100 * gain:+.0f} %")
    if "P + Fxz" in equal:
        print(f"coverage (wear, life, true life below the interval) at .2 .5 .8 1.0 of the life: {shares}")
        print(f"update of two loads {cost[0]:.2f} ms; snapshot {cost[1]} to {cost[2]} bytes whatever the time")
    print(f"filter through JSON against one regression: {agreement(LiveLaws.of(pf, draws, wear=WEAR)):.1e} sd")
    if folder := os.environ.get("FITMODELS_DATA"):
        report_nasa(Path(folder))


if __name__ == "__main__":
    main()
