"""Inference by edge against statsmodels, and what it says where it cannot be had.

References: statsmodels' CRV3 covariance (``cov_type="cluster-crv3"``) and its MixedLM with Powell's method, whose
optimum is known to about four digits of a standard error.
"""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core.errors import FitError
from fitmodels.fit.edges import fit_random_level, left_out_moves
from fitmodels.fit.regression import edge_inference
from statsmodels.regression.linear_model import OLS
from statsmodels.regression.mixed_linear_model import MixedLM

EXACT = 1e-9
POWELL = 2e-3  # of a standard error
FACTORS = {"AW": ["V", "f", "d", "t"], "P": ["V", "f", "d", "t", "AW"], "Fxz": ["V", "f", "d", "t", "AW"]}


def bundled():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


def rows(law):
    return law.formula.design(law.X, law.shifts), np.log(law.observed), np.unique(law.edge, return_inverse=True)[1]


@pytest.mark.parametrize("response", FACTORS)
def test_the_jackknife_is_statsmodels_crv3(response):
    law = fit.power_law(bundled(), response, FACTORS[response])
    edges = edge_inference(law)
    Z, y, group = rows(law)
    reference = OLS(y, Z).fit(cov_type="cluster-crv3", cov_kwds={"groups": group}, use_t=True)
    np.testing.assert_allclose(edges.cov_theta, reference.cov_params(), rtol=1e-6)
    np.testing.assert_allclose(edges.bse, reference.bse, rtol=1e-7)
    assert edges.df == 23


@pytest.mark.parametrize("response", FACTORS)
@pytest.mark.filterwarnings("ignore::statsmodels.tools.sm_exceptions.ConvergenceWarning")
def test_the_random_level_is_statsmodels_mixedlm(response):
    law = fit.power_law(bundled(), response, FACTORS[response])
    ours = edge_inference(law).mixed
    Z, y, group = rows(law)
    reference = MixedLM(y, Z, group).fit(reml=True, method="powell")
    np.testing.assert_allclose(ours.theta, reference.fe_params, rtol=1e-5)
    np.testing.assert_allclose(ours.bse, reference.bse_fe, rtol=POWELL)
    assert ours.sd_between**2 == pytest.approx(reference.cov_re[0, 0], rel=1e-5)
    assert ours.sd_within**2 == pytest.approx(reference.scale, rel=1e-5)


def test_a_leaving_out_is_a_refit_without_the_edge():
    runs = bundled()
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    edges = edge_inference(law)
    for g in (0, 11, 23):
        kept = runs.labels("edge") != edges.edges[g]
        without = datasets.runs_from_frame(runs.data[kept].drop(columns="point"))
        refit = fit.power_law(without, "AW", ["V", "f", "d", "t"])
        np.testing.assert_allclose(law.theta + edges.moved[g], refit.theta, rtol=EXACT)


def test_what_changes_within_edges_is_distinguished_from_what_does_not():
    edges = edge_inference(fit.power_law(bundled(), "P", ["V", "f", "d", "t", "AW"]))
    assert edges.within == (False, False, False, False, True, True)
    assert edges.f_df == 3
    assert edges.inflation == pytest.approx(edges.row_fvalue / edges.fvalue)
    assert 0 <= edges.f_pvalue < 1e-6


def test_a_law_in_natural_units_is_reported_between_edges_by_the_same_factors():
    law = fit.power_law(bundled(), "AW", ["V", "f", "d", "t"], error="additive")
    assert law.edges.within == (False, False, False, False, True)


def test_edge_means_of_a_balanced_design_are_the_random_level():
    """With equal edges the variance between edges follows from the means alone (analysis of variance)."""
    rng = np.random.default_rng(3)
    G, m = 12, 5
    x, edge = rng.normal(size=G), np.repeat(np.arange(G), m)
    y = 1 + 0.5 * x[edge] + rng.normal(0, 0.4, G)[edge] + rng.normal(0, 0.2, G * m)
    ours = fit_random_level(np.column_stack([np.ones(G * m), x[edge]]), y, edge, np.array([False, False]))
    means = OLS(y.reshape(G, m).mean(axis=1), np.column_stack([np.ones(G), x])).fit()
    np.testing.assert_allclose(ours.theta, means.params, rtol=1e-9)
    np.testing.assert_allclose(ours.bse, means.bse, rtol=1e-5)
    np.testing.assert_array_equal(ours.df, G - 2)


def test_no_variance_between_edges_is_none():
    rng = np.random.default_rng(4)
    edge = np.repeat(np.arange(10), 4)
    y = rng.normal(size=40)
    y -= np.bincount(edge, weights=y)[edge] / 4  # edges with equal means: less than chance would give
    ours = fit_random_level(np.ones((40, 1)), y, edge, np.array([False]))
    assert (ours.sd_between, ours.icc) == (0.0, 0.0)


def wear(edges, per_edge=4, noise=0.05, seed=1, settings=None):
    rng = np.random.default_rng(seed)
    V, f = rng.uniform(50, 200, edges), rng.uniform(0.1, 0.5, edges)
    if settings is not None:
        V, f = settings
    t = np.tile(np.arange(1.0, per_edge + 1), edges)
    at = np.repeat(np.arange(edges), per_edge)
    AW = 0.01 * V[at] ** 0.5 * f[at] ** 0.2 * t**0.3 * np.exp(noise * rng.normal(size=len(t)))
    frame = pd.DataFrame({"edge": [f"E{g}" for g in at], "V": V[at], "f": f[at], "t": t, "AW": AW})
    return fit.power_law(datasets.runs_from_frame(frame), "AW", ["V", "f", "t"])


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (lambda: wear(3), "3 edges for 3 parameters estimated between edges: cut at least 1 more"),
        (lambda: wear(8, per_edge=1), "each of the 8 rows is a separate edge"),
        (lambda: wear(8, noise=0.0), "meets every row exactly"),
        (
            lambda: wear(6, settings=(np.array([80.0, 80, 80, 80, 80, 160]), np.linspace(0.1, 0.5, 6))),
            "edge E5 alone identifies a parameter of the law",
        ),
        (
            lambda: fit.power_law(datasets.read_runs(datasets.bundled("ac2017_table1")), "AW", ["V", "f"]),
            "no edge column: rows are taken as independent",
        ),
    ],
)
def test_what_cannot_be_had_is_said(law, words):
    edges = edge_inference(law())
    assert isinstance(edges, fit.NotAvailable)
    assert not edges
    assert words in str(edges)


@pytest.mark.parametrize("covariance", [np.full((2, 2), np.inf), -np.eye(2), np.eye(2) * 1e308])
def test_a_covariance_beyond_the_range_of_numbers_is_refused(covariance):
    Z = np.column_stack([np.ones(6), np.arange(6) * 1e160])
    with pytest.raises(FitError, match="too extreme"):
        left_out_moves(Z, np.ones(6), covariance, np.arange(6) // 2, 3)


# The edge bootstrap


def wear_law(error="multiplicative", factors=("V", "f", "d", "t")):
    return fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", list(factors), error=error)


def test_a_draw_is_the_refit_of_its_edges():
    """The same multinomial draw, refitted row by row."""
    whole = wear_law()
    boot = fit.edge_bootstrap(whole, 5, seed=9)
    weights = np.random.default_rng(9).multinomial(24, np.full(24, 1 / 24), size=5)
    names = whole.edges.edges
    for drawn, theta in zip(weights, boot.draws, strict=True):
        rows = np.concatenate(
            [np.flatnonzero(whole.edge == e) for e, k in zip(names, drawn, strict=True) for _ in range(k)]
        )
        Z, y = whole.formula.design(whole.X[rows]), np.log(whole.observed[rows])
        np.testing.assert_allclose(theta, fit.linear(Z, y).params, rtol=1e-7)


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
def test_its_spread_is_near_the_jackknifes(error):
    """CR3 is known to be larger than the bootstrap by a few to thirty per cent with two dozen edges."""
    whole = wear_law(error)
    ratio = fit.edge_bootstrap(whole, 2000).bse / np.sqrt(np.diag(whole.covariance()))
    assert ratio.between(0.6, 1.05).all()


def test_the_same_seed_gives_the_same_draws():
    one, again, other = (fit.edge_bootstrap(wear_law(), 50, seed=s).draws for s in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)


def test_intervals_widen_with_the_level():
    boot = fit.edge_bootstrap(wear_law(), 500)
    narrow, wide = boot.interval(0.5), boot.interval(0.95)
    assert (wide["low"] < narrow["low"]).all()
    assert (wide["high"] > narrow["high"]).all()


def test_without_edges_it_says_why():
    runs = datasets.runs_from_frame(pd.DataFrame({"V": [50.0, 80, 120, 200], "AW": [0.1, 0.12, 0.16, 0.2]}))
    assert "no edge column" in str(fit.edge_bootstrap(fit.power_law(runs, "AW", ["V"])))
