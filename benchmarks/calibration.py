"""Simulation-based calibration of each posterior method (Talts et al. 2018, arXiv 1804.06788).

Parameters are drawn from the priors, tests from the parameters, and a posterior from the tests. For a correct
posterior the rank of each true parameter among its draws is uniform. Printed for each method and parameter: p of a
chi-square test of the ranks in ten bins; by chance one in a hundred is below 0.01.

    python benchmarks/calibration.py [SETS]
"""

import sys
import time

import numpy as np
import pandas as pd
from fitmodels import datasets, fit
from fitmodels.fit.bayes.priors import Beta, HalfT, Normal, Priors
from scipy.stats import chi2

EDGES, ROWS, BINS, RANKS = 10, 4, 10, 99


def priors(edges: bool, natural: bool) -> Priors:
    of = {"level": Normal(np.log(0.2), 0.3), "V": Normal(0.6, 0.4), "t": Normal(0.3, 0.2)}
    of["sd"] = HalfT(8.0, 0.02 if natural else 0.15)
    return Priors(of | ({"icc": Beta(2.0, 2.0)} if edges else {}), "calibration")


def tests(rng, of, edges: bool, natural: bool, student: bool):
    """Simulated tests and their true parameters."""
    V = np.repeat(np.exp(rng.uniform(np.log(50), np.log(200), EDGES)), ROWS)
    t = np.tile([2.0, 5.0, 9.0, 15.0], EDGES)
    true = {name: float(prior.draw(rng, 1)[0]) for name, prior in of.items()}
    logs = np.log(np.column_stack([V, t]))
    eta = true["level"] + (logs - logs.mean(axis=0)) @ [true["V"], true["t"]]
    share = true.get("icc", 0.0)
    noise = true["sd"] * rng.normal(size=len(V))
    noise += np.repeat(true["sd"] * np.sqrt(share / (1 - share)) * rng.normal(size=EDGES), ROWS)
    if student:
        true["nu"] = float(rng.gamma(2.0, 10.0))
        noise *= np.sqrt(true["nu"] / np.repeat(rng.chisquare(true["nu"], EDGES), ROWS))
    with np.errstate(over="ignore"):
        wear = np.exp(eta) + noise if natural else np.exp(eta + noise)
    frame = pd.DataFrame({"V": V, "t": t, "AW": wear, "edge": np.repeat([f"e{i}" for i in range(EDGES)], ROWS)})
    true["ln c0"] = true.pop("level") - logs.mean(axis=0) @ [true["V"], true["t"]]
    return frame, true


def study(label: str, sets: int, *, method: str, edges: bool, natural: bool, errors: str = "normal") -> None:
    rng, began = np.random.default_rng(20), time.perf_counter()
    of = priors(edges, natural)
    ranks: dict[str, list[int]] = {}
    done = failed = 0
    while done < sets:
        frame, true = tests(rng, of.of, edges, natural, errors == "student")
        if not (np.isfinite(frame["AW"]) & (frame["AW"] > 0)).all():
            continue  # not a valid measurement; rare at this scatter
        law = fit.power_law(
            datasets.runs_from_frame(frame, judge=False), "AW", ["V", "t"],
            error="additive" if natural else "multiplicative", edge="edge" if edges else None,
        )  # fmt: skip
        post = fit.posterior(law, seed=done, priors=of, method=method, errors=errors, draws=2000)
        failed += not post.convergence.passed
        few = post.draws[np.linspace(0, len(post.draws) - 1, RANKS).astype(int)]
        for name, draws in zip(post.names, few.T, strict=True):
            ranks.setdefault(name, []).append(int((draws < true[name]).sum()))
        done += 1
    pvalues = []
    for name, of_name in ranks.items():
        counts = np.bincount(np.array(of_name) * BINS // (RANKS + 1), minlength=BINS)
        p = chi2(BINS - 1).sf(((counts - sets / BINS) ** 2 / (sets / BINS)).sum())
        pvalues.append(f"{name} {p:.3f}")
    took = time.perf_counter() - began
    print(
        f"{label:<44} {sets} sets, {took:5.0f} s, convergence checks failed {failed}:  p " + "  ".join(pvalues),
        flush=True,
    )


if __name__ == "__main__":
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    study("exact, independent rows", n, method="exact", edges=False, natural=False)
    study("exact, levels of edges", n, method="exact", edges=True, natural=False)
    study("importance, natural units", n, method="importance", edges=False, natural=True)
    study("importance, natural units, levels of edges", n, method="importance", edges=True, natural=True)
    study(
        "importance, Student errors, levels of edges",
        n,
        method="importance",
        edges=True,
        natural=False,
        errors="student",
    )
    study("emcee, levels of edges", n // 2, method="emcee", edges=True, natural=False)
    study("emcee, natural units, levels of edges", n // 2, method="emcee", edges=True, natural=True)
