"""Level of the tests of terms of a response surface, of the selection of terms, and of the intervals of its curvatures.

    python benchmarks/surface_level.py [--draws 1000] [--others 300] [--plan CCD24 ...]

Rows of a central composite design in V, f, d with several times of each edge are drawn without any effect, so that
each rejection is false, whatever the term. Whole-plot terms (V, f, d, their squares and products) and sub-plot terms
(t, t^2 and its products) stand apart. Beside the tests of ``fit.response_surface`` stand those by edge of the law (CR3)
and those of the plain analysis of rows, which takes rows as independent. ``icc``: share of the variance between edges.
``slopes``: edges also differ in their slope over ln t, which the random level does not hold.

Aim: 3 to 7 % at nominal 5 %, for each term where all edges have the same times. Monte Carlo error of a share p of n
draws: sqrt(p (1 - p) / n), .7 % at 5 % and 1000 draws.
"""

import argparse
from itertools import product

import numpy as np
import pandas as pd
from fitmodels import datasets, fit
from fitmodels.core.formula import Formula, second_order_terms
from fitmodels.fit.edges import left_out_moves
from fitmodels.fit.surface.split_plot import edge_model
from fitmodels.fit.surface.term_selection import select_terms
from scipy.special import stdtr

FACTORS = ("V", "f", "d", "t")
TERMS = second_order_terms(FACTORS)
WHOLE = np.array([not term.degrees[3] for term in TERMS])
COLUMNS = {term.name: [1 + j] for j, term in enumerate(TERMS)}
DEGREES = {term.name: term.degrees for term in TERMS}
LEVEL, LOW, HIGH = 0.05, 0.03, 0.07
MIDDLE, HALF = np.log([100.0, 0.19, 2.1]), np.log([2.0, 3.2, 1.4])
FORMULA = Formula("second_order", "AW", FACTORS, TERMS, (100.0, 0.19, 2.1, 6.0))


def plans():
    """Coded settings of each plan, a row for each edge."""
    cube = np.array(list(product((-0.5, 0.5), repeat=3)))
    axial = np.vstack([np.eye(3), -np.eye(3)])
    return {
        "CCD24": np.vstack([cube, np.zeros((4, 3)), axial, axial]),
        "CCD20": np.vstack([cube * 1.189, np.zeros((6, 3)), axial]),
        "CCD16": np.vstack([cube, np.zeros((2, 3)), axial]),
    }


TIMES = {
    "6 equal": lambda rng, G: np.full(G, 6),
    "3 to 10": lambda rng, G: rng.integers(3, 11, G),
    "2 to 20": lambda rng, G: rng.integers(2, 21, G),
}


def drawn(rng, settings, counts, icc, heavy=False, slope_sd=0.0):
    """Factors (n, 4), ln AW and edge of each row, without any effect."""
    G = len(settings)
    m = counts(rng, G)
    edge, t = np.repeat(np.arange(G), m), np.concatenate([2.0 * np.arange(1, n + 1) for n in m])

    def unit(n):
        return rng.standard_t(4, n) / np.sqrt(2.0) if heavy else rng.standard_normal(n)

    y = np.sqrt(icc) * unit(G)[edge] + np.sqrt(1 - icc) * unit(len(edge)) + slope_sd * unit(G)[edge] * np.log(t / 6)
    return np.column_stack([np.exp(MIDDLE + settings * HALF)[edge], t]), np.log(0.2) + 0.1 * y, edge


def runs_of(X, y, edge):
    """The same rows as a table that the package reads."""
    frame = pd.DataFrame(X, columns=["V [m/min]", "f [mm/rev]", "d [mm]", "t [min]"])
    frame.insert(0, "edge", [f"E{g:02d}" for g in edge])
    return datasets.runs_from_frame(frame.assign(**{"AW [mm]": np.exp(y)}), judge=False)


def p_values(X, y, edge):
    """P of each term by stratum, by edge (CR3) and of independent rows, shape (14, 3); the model of the strata."""
    Z = FORMULA.columns(X)
    model, rows = edge_model(Z, y, edge), edge_model(Z, y)
    each = np.eye(Z.shape[1])[1:]
    own = [model.tested(c[None, :])[1] for c in each]
    plain = [rows.tested(c[None, :])[1] for c in each]
    G, unscaled = int(edge.max()) + 1, np.linalg.inv(Z.T @ Z)
    moved = left_out_moves(Z, y - Z @ rows.beta, unscaled, edge, G)
    by_edge = np.full(len(own), np.nan)
    if not isinstance(moved, int):
        se = np.sqrt((G - 1) / G * np.einsum("gj,gj->j", moved, moved))
        by_edge = 2 * stdtr(G - 1, -np.abs(rows.beta / se))[1:]
    return np.column_stack([own, by_edge, plain]), model


def scenario(name, settings, counts, draws, seed, chosen=100, **how):
    """Prints the levels of a scenario, and how often AICc keeps terms of second order in some of its draws."""
    rng, total, kept = np.random.default_rng(seed), np.zeros((len(TERMS), 3)), []
    for draw in range(draws):
        p, model = p_values(*(rows := drawn(rng, settings, counts, **how)))
        total += p < LEVEL
        if draw < chosen:
            names = select_terms(model, COLUMNS, DEGREES).kept
            kept.append(sum(len(term) > 1 for term in names))
    share = 100 * total / draws
    parts = []
    for kind, which in (("whole", WHOLE), ("sub", ~WHOLE)):
        own, by_edge, plain = share[which].T
        parts.append(
            f"{kind}-plot {own.mean():4.1f} ({own.min():4.1f} to {own.max():4.1f}), by edge {by_edge.mean():4.1f}, "
            f"plain rows {plain.mean():4.1f}"
        )
    kept = np.array(kept)
    words = f"AICc keeps second order in {100 * np.mean(kept > 0):.0f} %, {kept.mean():.1f} of 10 terms"
    print(f"{name:38} {'; '.join(parts)}; {words}", flush=True)
    return share[:, 0] / 100, rows


def public_function_agrees(rows):
    """Largest difference of the p-values from those of ``fit.response_surface`` for the same rows."""
    table = fit.response_surface(runs_of(*rows), "AW", FACTORS).anova()
    p = p_values(*rows)[0]
    names = [term.name for term in TERMS if term.order == 2]  # those of first order depend on the centres
    at = [1 + j - 1 for j, term in enumerate(TERMS) if term.order == 2]
    return float(np.abs(table.loc[names, ["p", "p by edge"]].to_numpy() - p[at, :2]).max())


def curvature_intervals(settings, draws, seed):
    """Prints how often the intervals of three true curvatures contain them, and the shapes that are stated."""
    rng, truth = np.random.default_rng(seed), np.array([0.12, 0.08, 0.04])
    covered, shapes, optima = [], [], 0
    for _ in range(draws):
        X, y, edge = drawn(rng, settings, TIMES["6 equal"], 0.3)
        found = fit.response_surface(runs_of(X, y + (settings[edge] ** 2) @ truth, edge), "AW", FACTORS).canonical()
        covered.append((found.low <= truth) & (truth <= found.high))
        shapes.append(found.shape)
        optima += found.optimum
    share, counts = 100 * np.mean(covered, axis=0), pd.Series(shapes).value_counts(normalize=True).round(2).to_dict()
    print(
        f"curvatures {truth.tolist()}, row sd .08, edge sd .05: 95 % intervals cover {np.round(share, 1).tolist()} %; "
        f"shapes {counts}; a minimum stated as proven in {optima} of {draws}",
        flush=True,
    )


def study(draws, names, others):
    """All scenarios; the last line counts the levels outside the aim."""
    print(f"{draws} draws; false rejections of terms in % at nominal 5 %: mean (least to largest term)")
    equal, unequal = [], []
    for number, (plan, times, icc) in enumerate(product(plans(), TIMES, (0.0, 0.3, 0.7))):
        if not names or plan in names:
            levels, rows = scenario(
                f"{plan}, times {times}, icc {icc}", plans()[plan], TIMES[times], draws, number, icc=icc
            )
            (equal if times == "6 equal" else unequal).append(levels)
    settings, six = plans()["CCD24"], TIMES["6 equal"]
    scenario("CCD24, times 6 equal, icc 0.3, t errors", settings, six, others, 90, icc=0.3, heavy=True)
    scenario("CCD24, times 6 equal, icc 0.3, slopes", settings, six, others, 91, icc=0.3, slope_sd=0.6)
    print(f"fit.response_surface on the last rows: p-values differ by at most {public_function_agrees(rows):.1g}")
    curvature_intervals(settings, others, 92)
    for name, levels in (("equal times", equal), ("unequal times", unequal)):
        own = np.array(levels)
        for kind, which in (("whole-plot", WHOLE), ("sub-plot", ~WHOLE)):
            part = own[:, which]
            within = np.sum((part >= LOW) & (part <= HIGH))
            print(
                f"{name}, {kind} terms: {within} of {part.size} levels within 3 to 7 %, mean {100 * part.mean():.2f} %"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--draws", type=int, default=1000)
    parser.add_argument("--others", type=int, default=300, help="draws of the scenarios beside the aim")
    parser.add_argument("--plan", action="append", choices=list(plans()))
    given = parser.parse_args()
    study(given.draws, given.plan, given.others)
