"""Leaving out, by row against statsmodels and a textbook, by edge against refits; collinearity against statsmodels.

References: statsmodels ``OLSInfluence`` and ``variance_inflation_factor``; Montgomery 2013, Design and Analysis of
Experiments, 8th edition, example 10.1, viscosity of a polymer: PRESS 5207.7 and R2 0.92697, held to in GitHub
nasa/UQPCE, tests/test_uqpce/test_statistics.py; its F 82.5 and p 4.0997e-08 as the package scisuit prints them in its
README. Rows of R's ``influence.measures`` and VIF of R's olsrr are in test_published_figures.py.
"""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.fit.checks.deletion_diagnostics import deletion, influence, precision, press
from fitmodels.fit.checks.model_checks import collinearity
from fitmodels.fit.checks.strata import split
from hypothesis import given, settings
from hypothesis import strategies as st
from statsmodels.regression.linear_model import OLS
from statsmodels.stats.outliers_influence import OLSInfluence, variance_inflation_factor

REFIT = 1e-8  # two refits of the same rows
NAMES = ["V", "f", "d", "t"]
VISCOSITY = [
    (80, 8, 2256), (93, 9, 2340), (100, 10, 2426), (82, 12, 2293), (90, 11, 2330), (99, 8, 2368), (81, 8, 2250),
    (96, 10, 2409), (94, 12, 2364), (93, 11, 2379), (97, 13, 2440), (95, 11, 2364), (100, 8, 2404), (85, 12, 2317),
    (86, 9, 2309), (87, 12, 2328),
]  # fmt: skip


def straight(X, y):
    """A power law that is the linear regression of y on the columns of X."""
    X = np.asarray(X, dtype=float)
    frame = pd.DataFrame({name: np.exp(x) for name, x in zip(NAMES, X.T, strict=False)})
    frame["AW"] = np.exp(np.asarray(y) - np.mean(y))
    return fit.power_law(datasets.runs_from_frame(frame, judge=False), "AW", NAMES[: X.shape[1]])


def left_out(law):
    strata = split(law)
    left = deletion(law, strata)
    return left, press(law, left), influence(law, strata, left)


@pytest.fixture(scope="module")
def viscosity():
    x1, x2, y = np.array(VISCOSITY, dtype=float).T
    return straight(np.column_stack([(x1 - 90) / 10, (x2 - 10) / 2]), y / 100)


@pytest.fixture(scope="module")
def bundled():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


def test_press_and_analysis_of_variance_of_the_textbook(viscosity):
    _, of_press, found = left_out(viscosity)
    assert of_press.press * 1e4 == pytest.approx(5207.7, abs=0.05)
    y = np.array(VISCOSITY)[:, 2]
    assert of_press.predicted_rsquared == pytest.approx(1 - 5207.7 / (16 * y.var()), abs=2e-6)
    assert viscosity.rsquared == pytest.approx(0.92697, abs=5e-6)
    assert viscosity.fvalue == pytest.approx(82.5, abs=0.05)
    assert viscosity.f_pvalue == pytest.approx(4.0997e-08, abs=5e-13)
    assert found.units == "rows"
    assert found.concern < 2  # Cook below the median of F


@pytest.mark.parametrize("seed", [1, 2])
def test_rows_are_statsmodels(seed):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(30, 3))
    y = X @ [1.0, -0.5, 0.2] + 0.3 * rng.standard_t(4, size=30)
    law = straight(X, y)
    reference = OLSInfluence(OLS(y, np.column_stack([np.ones(30), X])).fit())
    left, of_press, found = left_out(law)
    np.testing.assert_allclose(found.leverage, reference.hat_matrix_diag, rtol=REFIT)
    np.testing.assert_allclose(found.cook, reference.cooks_distance[0], rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(found.dfbetas, reference.dfbetas, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(left.predicted, reference.resid_press, rtol=REFIT)
    assert of_press.press == pytest.approx(float(reference.ess_press), rel=REFIT)


def test_edges_left_out_are_refits_without_them(bundled):
    law = fit.power_law(bundled, "P", [*NAMES, "AW"])
    left, of_press, _ = left_out(law)
    total = 0.0
    for g, name in enumerate(left.names):
        kept = bundled.labels("edge") != name
        refit = fit.power_law(datasets.runs_from_frame(bundled.data[kept].drop(columns="point")), "P", [*NAMES, "AW"])
        np.testing.assert_allclose(law.theta + left.moved[g], refit.theta, rtol=1e-7, atol=1e-9)
        here = law.edge == name
        predicted = np.log(law.observed[here]) - law.formula.design(law.X[here], law.shifts[here]) @ refit.theta
        np.testing.assert_allclose(left.predicted[here], predicted, rtol=1e-6, atol=1e-9)
        total += float(predicted @ predicted)
    assert of_press.press == pytest.approx(total, rel=REFIT)
    assert (of_press.units, left.leverage.sum()) == ("edges", pytest.approx(6))


def test_leaving_out_rows_of_an_edge_would_flatter(bundled):
    law = fit.power_law(bundled, "AW", NAMES)
    frame = bundled.data.drop(columns=["point", "edge"])
    by_row = left_out(fit.power_law(datasets.runs_from_frame(frame, edge="none"), "AW", NAMES))[1]
    assert left_out(law)[1].predicted_rsquared < by_row.predicted_rsquared < law.rsquared


def spoilt(bundled, edge, factor):
    frame = bundled.data.drop(columns="point")
    frame.loc[(bundled.labels("edge") == edge), "AW"] *= factor
    return datasets.runs_from_frame(frame)


def test_the_edge_of_most_influence_is_named(bundled):
    law = fit.power_law(bundled, "AW", NAMES)
    lone = int(np.argmax(law.X[:, 0]))
    found = left_out(fit.power_law(spoilt(bundled, law.edge[lone], 8.0), "AW", NAMES))[2]
    assert found.names[int(np.argmax(found.cook))] == law.edge[lone]
    assert law.edge[lone] == found.names[int(np.abs(found.dfbetas).max(axis=1).argmax())]
    assert f"The largest influence is that of edge {law.edge[lone]}" in found.verdict
    assert "V moves by" in found.verdict


def lone_edge(edges, speed):
    """A law of edges at one speed, give or take 3 %, and one edge at another."""
    rng = np.random.default_rng(1)
    at = np.repeat(np.arange(edges), 5)
    V = np.r_[100 * rng.uniform(0.97, 1.03, edges - 1), speed][at]
    frame = pd.DataFrame({"V": V, "t": np.tile([2.0, 4, 6, 8, 10], edges), "edge": [f"E{g}" for g in at]})
    frame["AW"] = 0.01 * V**0.6 * frame["t"] ** 0.3 * np.exp(0.05 * rng.normal(size=edges)[at])
    return fit.power_law(datasets.runs_from_frame(frame, judge=False), "AW", ["V", "t"])


@pytest.mark.parametrize("edges", [6, 24])
def test_an_edge_on_which_a_factor_depends_is_a_reservation(edges):
    found = left_out(lone_edge(edges, 200.0))[2]
    assert found.concern == 1
    assert f"Edge E{edges - 1} alone carries 9" in found.verdict
    assert "of the information on V" in found.verdict
    assert left_out(lone_edge(edges, 101.0))[2].concern == 0


def test_information_is_the_ratio_of_variances_with_and_without_a_unit(bundled):
    law = fit.power_law(bundled, "AW", NAMES)
    left, kept = left_out(law)[0], law.edge != law.edge[0]
    bread = [np.diag(np.linalg.inv(Z.T @ Z)) for Z in (law.design, law.design[kept])]
    g = left.names.index(str(law.edge[0]))
    np.testing.assert_allclose(left.information[g], 1 - bread[0] / bread[1], rtol=1e-7)
    rows = left_out(law.with_rows(edge=None))[0]
    bread[1] = np.diag(np.linalg.inv(law.design[1:].T @ law.design[1:]))
    np.testing.assert_allclose(rows.information[0], 1 - bread[0] / bread[1], rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("icc", [0.0, 0.8])
def test_twelve_sound_edges_are_not_accused(icc):
    """A factorial of 8 and 4 centre edges: some edge always has a Cook's distance that textbooks call large."""
    corner = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)] + [[0, 0, 0]] * 4)
    at = np.repeat(np.arange(12), 6)
    frame = pd.DataFrame(np.exp(0.5 * corner)[at], columns=["V", "f", "d"]).assign(t=np.tile(np.arange(1.0, 7), 12))
    largest = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        noise = np.sqrt(icc) * rng.normal(size=12)[at] + np.sqrt(1 - icc) * rng.normal(size=72)
        wear = frame["V"] ** 0.6 * frame["t"] ** 0.3 * np.exp(0.1 * noise)
        runs = datasets.runs_from_frame(frame.assign(AW=wear, edge=[f"E{g}" for g in at]), judge=False)
        found = left_out(fit.power_law(runs, "AW", NAMES))[2]
        assert found.concern == 0
        largest.append(found.statistic)
    assert np.median(largest) > 0.4


def test_cook_by_edge_is_measured_against_edges(bundled):
    """Against the error of rows taken as independent it would be larger by the inflation of their F."""
    law = fit.power_law(bundled, "AW", NAMES)
    left, _, found = left_out(law)
    rows = np.einsum("gj,jk,gk->g", left.moved, np.linalg.inv(law.cov_theta), left.moved) / 5
    assert 2 < rows.sum() / found.cook.sum() < 8


def test_adequate_precision_of_rows_is_the_books(viscosity):
    """Range of predictions over sqrt(p s^2 / n)."""
    found = precision(viscosity, split(viscosity))
    range_ = np.ptp(np.log(viscosity.fitted))
    assert found.statistic == pytest.approx(range_ / np.sqrt(3 * viscosity.scale_se**2 / 16), rel=1e-12)
    assert not found.by_edge
    noise = straight(np.random.default_rng(3).normal(size=(40, 2)), np.random.default_rng(4).normal(size=40))
    assert precision(noise, split(noise)).concern == 2


def test_edges_that_differ_cost_precision(bundled):
    law = fit.power_law(bundled, "AW", NAMES)
    by_row = np.ptp(np.log(law.fitted)) / np.sqrt(5 * law.scale_se**2 / law.nobs)
    found = precision(law, split(law))
    assert found.by_edge
    assert found.statistic < by_row


def test_a_law_that_predicts_worse_than_the_mean():
    law = straight([[0.0], [0.1], [0.2], [0.3], [4.0]], [0.0, 1.0, 0.0, 1.0, 0.2])
    of_press = left_out(law)[1]
    assert of_press.predicted_rsquared < 0
    assert of_press.concern == 2
    assert "do not use the law" in of_press.verdict


@pytest.mark.parametrize("factors", [NAMES, [*NAMES, "AW"]])
def test_variance_inflation_is_statsmodels(bundled, factors):
    law = fit.power_law(bundled, "P", factors)
    Z = law.formula.design(law.X, law.shifts)
    found = collinearity(law)
    reference = [variance_inflation_factor(Z, j) for j in range(1, Z.shape[1])]
    np.testing.assert_allclose(found.vif, reference, rtol=1e-9)
    centred = Z[:, 1:] - Z[:, 1:].mean(axis=0)
    assert found.condition == pytest.approx(np.linalg.cond(centred / np.linalg.norm(centred, axis=0)), rel=1e-9)


def test_wear_among_the_factors_is_no_reservation_while_its_interval_is_narrow(bundled):
    found = collinearity(fit.power_law(bundled, "P", [*NAMES, "AW"]))
    assert (found.concern, found.statistic > 5) == (0, True)
    assert {"V", "AW"} <= set(found.entangled)


@pytest.mark.parametrize(("apart", "words"), [(0.02, "f, d vary together"), (0.3, "No multicollinearity")])
def test_feed_and_depth_that_vary_together_are_named(apart, words):
    rng = np.random.default_rng(4)
    x = rng.normal(size=(40, 3))
    x[:, 2] = x[:, 1] + apart * 10 * rng.normal(size=40) if apart > 0.1 else x[:, 1] + apart * rng.normal(size=40)
    law = straight(x, x @ [0.5, 0.2, 0.3] + 0.05 * rng.normal(size=40))
    found = collinearity(law)
    assert words in found.verdict
    assert found.concern == (apart < 0.1)


def test_a_factor_that_is_a_product_of_others_is_a_reservation():
    """The depth is ten times the feed in each test: the exponent of the feed is that of both."""
    rng = np.random.default_rng(4)
    x = rng.normal(size=(30, 2))
    law = straight(np.column_stack([x, x[:, 1] + np.log(10)]), x @ [0.5, 0.4] + 0.05 * rng.normal(size=30))
    found = collinearity(law)
    assert (law.left_out[0].factor, law.left_out[0].confounded, found.concern) == ("d", True, 1)
    assert "Factor d was left out: an exact product of others (f^1)" in found.verdict
    one = straight(np.column_stack([x[:, 0], 2 * x[:, 0], 3 * x[:, 0]]), 0.5 * x[:, 0] + 0.05 * rng.normal(size=30))
    assert collinearity(one).verdict.startswith("Factors f was left out: an exact product")
    assert "; d was left out: an exact product" in collinearity(one).verdict
    constant = straight(np.column_stack([x, np.ones(30)]), x @ [0.5, 0.4] + 0.05 * rng.normal(size=30))
    assert (constant.left_out[0].confounded, collinearity(constant).concern) == (False, 0)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(0.001, 1000), min_size=2, max_size=2))
def test_units_move_neither_inflation_nor_cook(scale):
    rng = np.random.default_rng(8)
    frame = pd.DataFrame({"V": rng.uniform(50, 200, 12), "f": rng.uniform(0.1, 0.5, 12)})
    frame["AW"] = 0.1 * frame["V"] ** 0.5 * rng.lognormal(0, 0.1, 12)
    one = fit.power_law(datasets.runs_from_frame(frame, judge=False), "AW", ["V", "f"])
    other = fit.power_law(datasets.runs_from_frame(frame * [*scale, 1.0], judge=False), "AW", ["V", "f"])
    np.testing.assert_allclose(collinearity(one).vif, collinearity(other).vif, rtol=1e-7)
    np.testing.assert_allclose(left_out(one)[2].cook, left_out(other)[2].cook, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(left_out(one)[2].dfbetas[:, 1:], left_out(other)[2].dfbetas[:, 1:], rtol=1e-5, atol=1e-8)
