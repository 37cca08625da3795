"""Exact draws: against sums over a grid that share no line with them, and against a published posterior."""

import itertools

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.fit.bayes.density import law_density
from fitmodels.fit.bayes.exact_draws import exact
from fitmodels.fit.bayes.priors import Beta, HalfT, Normal, Priors, reference, weak

# posteriordb (Magnusson, Buerkner, Vehtari and others), reference posterior mesquite-logmesquite_logvash: names, mean
# and its Monte Carlo error, mean square and its Monte Carlo error, from 10 chains of Stan, in
# posterior_database/reference_posteriors/summary_statistics. Model: ln weight normal about beta_1 + beta_2 ln(canopy
# volume) + beta_3 ln(canopy area) + beta_4 ln(canopy shape) + beta_5 ln(total height) + beta_6 group, all priors flat.
LOGVASH = {
    "mean": [5.30991111507012, 0.387176661998672, 0.409639357840118, -0.317463628740241, 0.423455262770221,
             -0.538554434725468, 0.339394677467625],
    "mcse": [0.00170214365369495, 0.00283123880856243, 0.00300454732258275, 0.00229449766480208, 0.00316864280389917,
             0.00122004008151179, 0.000394183487010364],
    "square": [28.2239575, 0.2319784, 0.2577602, 0.152931, 0.2826166, 0.3050584, 0.1167351],
    "mcse square": [0.018123324, 0.002506001, 0.002803515, 0.001638207, 0.003160605, 0.00133147, 0.000278471],
}  # fmt: skip
LOGVOLUME = {
    "mean": [5.17084758450824, 0.722008519434549, 0.426670305955934],
    "mcse": [0.000873165446265347, 0.000563651945878131, 0.000480101525987333],
}

# Mesquite bushes: two diameters of the canopy, total and canopy height (m), leaf weight (g). Gelman & Hill 2007, Data
# Analysis Using Regression, section 4.6, as in the ROS-Examples repository, Mesquite/data/mesquite.dat.
MESQUITE = """
MCD 1.80 1.15 1.30 1.00 401.3; MCD 1.70 1.35 1.35 1.33 513.7; MCD 2.80 2.55 2.16 0.60 1179.2
MCD 1.30 0.85 1.80 1.20 308.0; MCD 3.30 1.90 1.55 1.05 855.2; MCD 1.40 1.40 1.20 1.00 268.7
MCD 1.50 0.50 1.00 0.90 155.5; MCD 3.90 2.30 1.70 1.30 1253.2; MCD 1.80 1.35 0.80 0.60 328.0
MCD 2.10 1.60 1.20 0.80 614.6; MCD 0.80 0.63 0.90 0.60 60.2; MCD 1.30 0.95 1.35 0.95 269.6
MCD 1.20 0.90 1.40 1.20 448.4; MCD 1.50 0.70 1.00 0.70 120.4; MCD 2.80 1.70 1.70 1.20 378.7
MCD 1.40 0.85 1.50 1.10 266.4; MCD 1.50 0.60 0.65 0.64 138.9; MCD 2.40 2.40 1.50 1.20 1020.8
MCD 1.90 1.55 1.70 1.20 635.7; MCD 2.30 1.60 1.70 1.30 621.8; MCD 2.10 1.70 1.50 1.00 579.8
MCD 2.40 1.30 1.50 0.90 326.8; MCD 1.00 0.40 1.20 1.00 66.7; MCD 1.30 0.60 0.70 0.50 68.0
MCD 1.10 0.70 1.20 0.90 153.1; MCD 1.30 1.20 0.80 0.60 256.4; ALS 2.50 2.30 1.70 1.40 723.0
ALS 5.20 4.00 3.00 2.50 4052.0; ALS 2.00 1.60 1.70 1.40 345.0; ALS 1.60 1.60 1.60 1.30 330.9
ALS 1.40 1.00 1.50 1.10 163.5; ALS 3.20 1.90 1.90 1.50 1160.0; ALS 1.90 1.80 1.10 0.80 386.6
ALS 2.40 2.40 1.60 1.10 693.5; ALS 2.50 1.80 2.00 1.30 674.4; ALS 2.10 1.50 1.25 0.85 217.5
ALS 2.40 2.20 2.00 1.50 771.3; ALS 2.40 1.70 1.30 1.20 341.7; ALS 1.90 1.20 1.45 1.15 125.7
ALS 2.70 2.50 2.20 1.50 462.5; ALS 1.30 1.10 0.70 0.70 64.5; ALS 2.90 2.70 1.90 1.90 850.6
ALS 2.10 1.00 1.80 1.50 226.0; ALS 4.10 3.80 2.00 1.50 1745.1; ALS 2.80 2.50 2.20 1.50 908.0
ALS 1.27 1.00 0.92 0.62 213.5
"""

DRAWS = 100_000
SE = 4.5  # Monte Carlo standard errors: one comparison in 100 000 lies beyond


@pytest.fixture(scope="module")
def mesquite():
    rows = [row.split() for row in MESQUITE.replace("\n", ";").split(";") if row.strip()]
    site, *numbers = zip(*rows, strict=True)
    a, b, height, canopy, weight = (np.array(column, dtype=float) for column in numbers)
    table = pd.DataFrame(
        {
            "V": a * b * canopy,
            "f": a * b,
            "d": a / b,
            "t": height,
            "P": weight,
            "work": [f"{s == 'MCD':d}" for s in site],
        }
    )
    return datasets.runs_from_frame(table, judge=False)


def test_published_posterior_of_mesquite_bushes(mesquite):
    law = fit.power_law(mesquite, "P", ["V", "f", "d", "t"], by="work")
    density = law_density(law, reference(law, edges=False))
    draws = density.parameters(exact(density, np.random.default_rng(1), DRAWS).phi)
    if LOGVASH["mean"][5] * draws[:, 5].mean() < 0:  # which site counts as 1
        draws[:, 0] += draws[:, 5]
        draws[:, 5] *= -1
    ours = np.hypot(LOGVASH["mcse"], draws.std(axis=0) / np.sqrt(DRAWS))
    assert np.all(np.abs(draws.mean(axis=0) - LOGVASH["mean"]) < SE * ours)
    squares = draws**2
    ours = np.hypot(LOGVASH["mcse square"], squares.std(axis=0) / np.sqrt(DRAWS))
    assert np.all(np.abs(squares.mean(axis=0) - LOGVASH["square"]) < SE * ours)


def test_published_posterior_of_their_volume_alone(mesquite):
    law = fit.power_law(mesquite, "P", ["V"])
    density = law_density(law, reference(law, edges=False))
    draws = density.parameters(exact(density, np.random.default_rng(2), DRAWS).phi)
    ours = np.hypot(LOGVOLUME["mcse"], draws.std(axis=0) / np.sqrt(DRAWS))
    assert np.all(np.abs(draws.mean(axis=0) - LOGVOLUME["mean"]) < SE * ours)


def few_runs(edges=5, rows=3, seed=3):
    rng = np.random.default_rng(seed)
    V = np.repeat(np.exp(rng.uniform(4, 5, edges)), rows)
    level = np.repeat(rng.normal(0, 0.2, edges), rows)
    wear = np.exp(np.log(0.2) + 1.3 * (np.log(V) - 4.5) + level + rng.normal(0, 0.2, edges * rows))
    labels = np.repeat([f"e{i}" for i in range(edges)], rows)
    return datasets.runs_from_frame(pd.DataFrame({"V": V, "AW": wear, "edge": labels}))


def moments_by_sum(density, phi):
    """Moments of level, slope, sd (and icc) by a plain sum over a grid of all of them, laid where draws ``phi`` are."""
    middle, sd = phi.mean(axis=0), phi.std(axis=0)
    sizes = (27, 27, 35, 41)[: phi.shape[1]]
    axes = [m + 7 * s * np.linspace(-1, 1, size) for m, s, size in zip(middle, sd, sizes, strict=True)]
    points = np.array(list(itertools.product(*axes)))
    log_density = density.log_prior(points) + density.log_likelihood(points)
    weight = np.exp(log_density - log_density.max())
    weight /= weight.sum()
    reported = density.parameters(points)
    mean = weight @ reported
    return mean, np.sqrt(weight @ (reported - mean) ** 2)


@pytest.mark.slow
@pytest.mark.parametrize("edges", [False, True], ids=["independent rows", "edges have levels"])
@pytest.mark.parametrize("strength", ["weak", "strong", "flat"])
def test_moments_equal_a_sum_over_all_parameters(edges, strength):
    law = fit.power_law(few_runs(), "AW", ["V"])
    priors = {
        "weak": weak(law, edges),
        "strong": Priors(
            {"level": Normal(-1.0, 0.1), "V": Normal(0.5, 0.2), "sd": HalfT(3.0, 0.1), "icc": Beta(2.0, 3.0)}, "strong"
        ),
        "flat": reference(law, edges),
    }[strength]
    if not edges:
        priors = Priors({name: prior for name, prior in priors.of.items() if name != "icc"}, priors.name)
    density = law_density(law, priors)
    phi = exact(density, np.random.default_rng(4), DRAWS).phi
    mean, sd = moments_by_sum(density, phi)
    draws = density.parameters(phi)
    assert np.abs((draws.mean(axis=0) - mean) / sd).max() < 0.015, density.parameter_names
    assert draws.std(axis=0) / sd == pytest.approx(np.ones(len(sd)), abs=0.02)


def test_flat_priors_give_the_t_intervals_of_least_squares():
    """Flat on ln sd would give n - p degrees of freedom; flat on sd one less (Gelman et al. 2013, section 14.2)."""
    from scipy.stats import t

    law = fit.power_law(few_runs(12, 1), "AW", ["V"], edge=None)
    density = law_density(law, reference(law, edges=False))
    slope = exact(density, np.random.default_rng(5), DRAWS).phi[:, 1]
    n, p = law.nobs, 2
    scale = law.row_bse["V"] * np.sqrt((n - p) / (n - p - 1))
    expected = law.params["V"] + scale * t(n - p - 1).ppf([0.025, 0.5, 0.975])
    assert np.quantile(slope, [0.025, 0.5, 0.975]) == pytest.approx(expected, abs=0.03 * scale)


def test_same_seed_same_draws_bit_for_bit():
    law = fit.power_law(few_runs(), "AW", ["V"])
    density = law_density(law, weak(law, edges=True))
    a, b, c = (exact(density, np.random.default_rng(seed)).phi for seed in (7, 7, 8))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


@pytest.mark.parametrize("rows", [100, 2_000, 200_000])
def test_any_number_of_rows_is_resolved(rows):
    rng = np.random.default_rng(6)
    V = np.exp(rng.uniform(4, 5, rows))
    table = pd.DataFrame({"V": V, "AW": 0.001 * V * np.exp(rng.normal(0, 0.1, rows))})
    law = fit.power_law(datasets.runs_from_frame(table), "AW", ["V"])
    density = law_density(law, weak(law, edges=False))
    sd = np.exp(exact(density, np.random.default_rng(1)).phi[:, 2])
    assert sd.mean() == pytest.approx(law.scale_se, rel=0.2 / np.sqrt(rows))
    assert sd.std() == pytest.approx(law.scale_se / np.sqrt(2 * rows), rel=0.15)


def test_a_share_near_zero_and_near_one_is_drawn():
    rng = np.random.default_rng(9)
    for between, within, expected in ((0.0, 0.2, 0.0), (0.5, 0.001, 1.0)):
        V = np.repeat(np.exp(np.linspace(4, 5, 30)), 6)
        ln = 1.1 * np.log(V) - 6 + np.repeat(rng.normal(0, between, 30), 6) + rng.normal(0, within, 180)
        table = pd.DataFrame({"V": V, "AW": np.exp(ln), "edge": np.repeat([f"e{i}" for i in range(30)], 6)})
        law = fit.power_law(datasets.runs_from_frame(table), "AW", ["V"])
        density = law_density(law, weak(law, edges=True))
        icc = density.parameters(exact(density, np.random.default_rng(1)).phi)[:, 3]
        assert np.median(icc) == pytest.approx(expected, abs=0.08)
        assert (icc > 0).all()
        assert (icc < 1).all()
