"""Expected and realised narrowing of the interval of a tool life by further tests, in simulated designs.

    python benchmarks/next_tests.py --draws 200

Each draw simulates a central composite design of V, f and d, fits the wear law, plans further tests for the decision
and states the expected width of its interval; then the planned tests are simulated, the law is fitted to all of them,
and the realised width and its coverage of the true life are recorded. ``--more 6`` tests are added.
"""

import argparse
import sys
from math import exp, log

import numpy as np
import pandas as pd
from fitmodels import datasets, fit
from fitmodels.fit.decisions import life_decision
from fitmodels.fit.next_tests import next_runs
from fitmodels.fit.optimal_tests import narrowing

RANGES = {"V": (50.0, 200.0), "f": (0.06, 0.6), "d": (1.5, 3.0)}
FACTORS = ["V", "f", "d", "t"]
EXPONENTS = {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.4}
C0, SD, CRITERION, AT = 5e-3, 0.07, 0.3, {"V": 140.0, "f": 0.2, "d": 2.0}


def rows(settings: pd.DataFrame, times: np.ndarray, rng: np.random.Generator) -> pd.DataFrame:
    """Rows of wear of edges, times of shape (edges, readings)."""
    frames = []
    for (_, row), t in zip(settings.iterrows(), times, strict=True):
        eta = log(C0) + sum(b * np.log(t if name == "t" else row[name]) for name, b in EXPONENTS.items())
        wear = np.exp(eta + SD * rng.standard_normal() + SD * rng.standard_normal(len(t)))
        frames.append(pd.DataFrame({**{name: row[name] for name in ("edge", *RANGES)}, "t": t, "AW": wear}))
    return pd.concat(frames, ignore_index=True)


def fitted(frame: pd.DataFrame) -> fit.LawFit:
    """The wear law."""
    return fit.power_law(datasets.runs_from_frame(frame), "AW", FACTORS)


def draw(seed: int, more: int) -> tuple[float, float, float, bool, bool]:
    """Width in ln now, expected and realised; whether the intervals now and then hold the true life."""
    rng = np.random.default_rng(seed)
    plan = datasets.central_composite(RANGES, seed=seed)
    first = rows(plan, np.tile(np.arange(2.0, 13.0, 2.0), (len(plan), 1)), rng)
    law = fitted(first)
    found = life_decision(law, CRITERION, AT)
    added = next_runs(law, more, decision=found, durations=lambda table: np.full(len(table), 24.0), seed=seed)
    stated = narrowing(law, found, added.attrs["readings"])
    times = np.array([test["t"] for test in added.attrs["readings"]])
    both = fitted(pd.concat([first, rows(added, times, rng)], ignore_index=True))
    then = narrowing(both, life_decision(both, CRITERION, AT), added.attrs["readings"])
    known = log(C0) + sum(b * log(AT[name]) for name, b in EXPONENTS.items() if name != "t")
    true = exp((log(CRITERION) - known) / EXPONENTS["t"])
    held = [low <= true <= high for low, high in (stated.now, then.now)]
    return (
        log(stated.now[1] / stated.now[0]),
        log(stated.after[1] / stated.after[0]),
        log(then.now[1] / then.now[0]),
        *held,
    )


def main() -> None:
    """Print the quantiles of realised over expected width, and coverage."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--more", type=int, default=6)
    args = parser.parse_args()
    found = []
    for seed in range(args.draws):
        found.append(draw(seed, args.more))
        if sys.stderr.isatty():
            sys.stderr.write(f"\r{seed + 1} of {args.draws}")
    now, expected, realised, before, after = np.array(found, dtype=float).T
    low, middle, high = np.quantile(realised / expected, [0.1, 0.5, 0.9])
    print(f"{args.draws} draws, {args.more} further tests (simulated)")
    print(
        f"width now {np.median(now):.3f}, expected {np.median(expected):.3f}, realised {np.median(realised):.3f} (ln)"
    )
    print(f"realised over expected: median {middle:.3f}, 80 % of draws {low:.2f} to {high:.2f}")
    print(f"coverage of the true life: {before.mean():.3f} now, {after.mean():.3f} after")


if __name__ == "__main__":
    main()
