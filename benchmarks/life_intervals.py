"""Coverage of intervals of censored tool lives: exponents and one new life, at 12 and 24 lives with run-outs.

    python benchmarks/life_intervals.py [--draws 400] [--seed 1]

A factorial of V, f and d with repeated centre tests; true exponents -3.6, -1.2 and -.8, lives cut off at 60 min. Beside
the intervals of the law stand those of plain maximum likelihood (normal quantiles, scale not corrected) and of least
squares with run-outs as lives and without them. Nominal 95 %.
"""

import argparse

import numpy as np
from fitmodels import datasets, fit
from fitmodels.core.censored import fit_censored
from fitmodels.core.errors import FitError
from fitmodels.core.progress import progress_bar
from scipy.special import ndtri

TRUTH = np.array([20.28, -3.6, -1.2, -0.8])
STOPPED = 60.0  # min
SCALE = 0.15
AT = {"V": 147.0, "f": 0.212, "d": 1.58}


def design(n):
    """Conditions, shape (n, 3): factorial, then centre tests; 24 are two of 12."""
    corners = [(V, f, d) for V in (120, 180) for f in (0.15, 0.3) for d in (1.0, 2.5)]
    return np.array((corners + [tuple(AT.values())] * 4) * (n // 12))


def lives(rng, X, distribution):
    """Lives whose median follows the law, shape (n,)."""
    eta = np.column_stack([np.ones(len(X)), np.log(X)]) @ TRUTH
    W = rng.standard_normal(len(X)) if distribution == "lognormal" else np.log(rng.exponential(size=len(X)) / np.log(2))
    return np.exp(eta + SCALE * W)


def runs_of(X, T, cut):
    """Runs of a table whose run-outs are marked."""
    import pandas as pd

    marked = [f"{min(t, STOPPED):.6g}" + ("+" if c else "") for t, c in zip(T, cut, strict=True)]
    frame = pd.DataFrame({"V": X[:, 0], "f": X[:, 1], "d": X[:, 2], "T": marked})
    return datasets.runs_from_frame(frame, judge=False)


def plain_covers(X, T, cut, distribution):
    """Whether plain Wald intervals cover each exponent, shape (3,)."""
    Z = np.column_stack([np.ones(len(X)), np.log(X)])
    found = fit_censored(Z, np.log(np.minimum(T, STOPPED)), cut.astype(np.int8), distribution)
    se = np.sqrt(np.diag(found.covariance))[1:4]
    return np.abs(found.beta[1:] - TRUTH[1:]) <= ndtri(0.975) * se


def study(n, distribution, draws, seed, step):
    """Counts of coverage of one size and distribution."""
    rng = np.random.default_rng(seed)
    X = design(n)
    corrected, plain, new, lower, slope, naive, dropped, ended, refused = [], [], [], [], [], [], [], [], 0
    for draw in range(draws):
        T = lives(rng, X, distribution)
        cut = T > STOPPED
        step(f"{distribution}, {n} lives: {draw + 1} of {draws}")
        runs = runs_of(X, T, cut)
        try:
            law = fit.life_law(runs, ["V", "f", "d"], distribution)
        except FitError:
            refused += 1
            continue
        band = law.conf_int().iloc[1:].to_numpy()
        corrected.append((band[:, 0] <= TRUTH[1:]) & (band[:, 1] >= TRUTH[1:]))
        plain.append(plain_covers(X, T, cut, distribution))
        one = law.predict(AT, "prediction").to_frame().iloc[0]
        life = lives(rng, np.array([tuple(AT.values())]), distribution)[0]
        new.append(one["low"] <= life <= one["high"])
        lower.append(life < one["low"])
        slope.append(law.params["V"])
        ended.append(int((~cut).sum()))
        Z = np.column_stack([np.ones(n), np.log(X)])
        naive.append(np.linalg.lstsq(Z, np.log(np.minimum(T, STOPPED)), rcond=None)[0][1])
        dropped.append(np.linalg.lstsq(Z[~cut], np.log(T[~cut]), rcond=None)[0][1])
    return {
        "corrected": np.mean(corrected), "plain": np.mean(plain), "new": np.mean(new), "lower": np.mean(lower),
        "slope": np.mean(slope), "naive": np.mean(naive), "dropped": np.mean(dropped), "ended": np.mean(ended),
        "refused": refused, "n": len(new),
    }  # fmt: skip


def main():
    """Print a table of coverages."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    print(f"nominal 95 %, {args.draws} draws each, seed {args.seed}; exponent of V: truth {TRUTH[1]}")
    print(
        "lives  distribution  ended  refused  exponents  plain ML  new life  below it  V: law  run-outs=lives  left out"
    )
    with progress_bar(lines=False) as step:
        for n in (12, 24):
            for distribution in ("lognormal", "weibull"):
                r = study(n, distribution, args.draws, args.seed, step.say)
                print(
                    f"{n:5d}  {distribution:12s}  {r['ended']:5.1f}  {r['refused']:7d}  {r['corrected']:9.3f}  "
                    f"{r['plain']:8.3f}  {r['new']:8.3f}  {r['lower']:8.3f}  {r['slope']:6.2f}  {r['naive']:14.2f}  "
                    f"{r['dropped']:8.2f}"
                )


if __name__ == "__main__":
    main()
