"""Lack of fit against printed analyses of variance, and its level on sound laws measured edge by edge.

References: R's package rsm on ChemReact1 (data: vignette article-JSS, after Lenth 2009, J. Statistical Software
32(7); p of lack of fit 0.01034 of the first-order fit and 0.005221 with the interaction, as GitHub rwepa/DataDemo,
R_Design_Of_Experiments.R, notes its output); the data of the help page of ``pureErrorAnova`` in R's package alr3;
statsmodels' F test of a law within the means of its settings, on all of these and on the turning forces (Exp1, whose
README has the same figures). An analysis printed by R's olsrr is in test_published_figures.py.
"""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.fit.checks.check import format_p
from fitmodels.fit.checks.model_checks import curvature, lack_of_fit
from fitmodels.fit.checks.strata import split
from fitmodels.fit.checks.within_edges import lack_of_fit_within
from scipy.linalg import qr
from statsmodels.regression.linear_model import OLS

EXACT = 1e-9
NAMES = ["V", "f", "d", "t"]
THETA = np.array([-4.0, 0.577, 0.168, 0.248, 0.3])


def straight(X, y):
    """A power law that is the linear regression of y on the columns of X."""
    X = np.asarray(X, dtype=float)
    frame = pd.DataFrame({name: np.exp(x) for name, x in zip(NAMES, X.T, strict=False)})
    frame["AW"] = np.exp(np.asarray(y) - np.mean(y))
    return fit.power_law(datasets.runs_from_frame(frame, judge=False), "AW", NAMES[: X.shape[1]])


def by_statsmodels(law):
    """Sum of squares about the settings' means; F, p and degrees of freedom of the law within them."""
    Z, y = law.design, np.log(law.observed)
    setting = np.unique(np.round(Z, 9), axis=0, return_inverse=True)[1].ravel()
    means = OLS(y, np.eye(setting.max() + 1)[setting]).fit()
    return means.ssr, *means.compare_f_test(OLS(y, Z).fit())


def assert_as_statsmodels(law):
    found, (pure, F, p, df) = form_of(law), by_statsmodels(law)
    assert (found.ss_pure, found.statistic) == pytest.approx((pure, F), rel=1e-8)
    assert found.pvalue == pytest.approx(2 * min(p, 1 - p), rel=1e-8)
    assert found.df[0] == df


def form_of(law):
    return lack_of_fit(law, split(law))


def composite(counts, seed=0):
    """Law and edge of each row for 8 factorial, 4 centre and 6 axial edges twice; one count of rows an edge."""
    corner = np.array(list(product([-1, 1], repeat=3)), dtype=float)
    axis = 2 * np.repeat(np.vstack([np.eye(3), -np.eye(3)]), 2, axis=0)
    coded = np.vstack([corner, np.zeros((4, 3)), axis])
    at = np.repeat(np.arange(24), counts)
    t = np.concatenate([2.0 * np.arange(1, m + 1) for m in counts])
    levels = np.array([100.0, 0.2, 2.0]) * np.array([1.4, 1.4, 1.2]) ** coded
    frame = pd.DataFrame(levels[at], columns=["V", "f", "d"]).assign(t=t, edge=[f"E{g:02d}" for g in at])
    frame["AW"] = np.exp(np.random.default_rng(seed).normal(size=len(t)))
    return fit.power_law(datasets.runs_from_frame(frame, judge=False), "AW", NAMES), at


def with_response(law, log_y):
    """The law refitted to another response."""
    Z = law.design
    found = fit.linear(Z, log_y)
    r = log_y - Z @ found.params
    return law.with_rows(
        theta=found.params, cov_theta=found.cov_params, observed=np.exp(log_y),
        fitted=np.exp(Z @ found.params), residuals=r, rss=float(r @ r), tss=found.tss,
    )  # fmt: skip


def test_chemical_reaction_of_the_rsm_vignette():
    time, temperature = np.array([80, 80, 90, 90, 85, 85, 85.0]), np.array([170, 180, 170, 180, 175, 175, 175.0])
    x1, x2 = (time - 85) / 5, (temperature - 175) / 5
    yields = [80.5, 81.5, 82.0, 83.5, 83.9, 84.3, 84.0]
    first = form_of(straight(np.column_stack([x1, x2]), yields))
    assert (first.units, first.df) == ("rows", (2, 2))
    assert first.pvalue / 2 == pytest.approx(0.01034, abs=5e-6)  # printed of one tail
    crossed = straight(np.column_stack([x1, x2, x1 * x2]), yields)
    interaction = form_of(crossed)
    assert_as_statsmodels(crossed)
    assert interaction.df == (1, 2)
    assert interaction.pvalue / 2 == pytest.approx(0.005221, abs=5e-7)


def test_the_data_of_pure_error_anova():
    x = [1, 1, 1, 2, 3, 3, 4, 4, 4, 4]
    y = [2.55, 2.75, 2.57, 2.40, 4.19, 4.70, 3.81, 4.87, 2.93, 4.52]
    law = straight(np.column_stack([x]), y)
    assert_as_statsmodels(law)
    found = form_of(law)
    assert found.df == (2, 6)
    assert found.ss_lack + found.ss_pure == pytest.approx(law.rss, rel=1e-9)
    assert (found.settings, found.replicated, found.concern) == (4, 3, 0)


@pytest.mark.parametrize(("response", "F", "p"), [("Fx", 2.41, 0.030), ("Ra", 1.40, 0.40)])
def test_turning_forces_and_roughness(measurements, response, F, p):
    path = measurements / "turning_forces" / "exp1_runs.csv"
    law = fit.power_law(datasets.read_runs(path, map={"Ra": "Ra_mean"}), response, ["d", "V", "f"])
    assert_as_statsmodels(law)
    found = form_of(law)
    assert found.df == (23, 27)
    assert found.statistic == pytest.approx(F, abs=0.005)
    assert found.pvalue == pytest.approx(p, abs=0.001 if p < 0.1 else 0.01)


def test_the_milling_plan_has_its_edges_twice(measurements):
    runs = datasets.read_runs(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    found = form_of(fit.power_law(runs, "VB", ["t", "f", "d"], by="material"))
    assert (found.units, found.settings, found.df) == ("edges", 8, (4, 7))


@pytest.mark.parametrize("icc", [0.0, 0.5])
def test_balanced_edges_are_tested_by_their_means(icc):
    """With equal edges the test is the textbook's on edge means, whatever the variance split."""
    law, at = composite([6] * 24)
    rng = np.random.default_rng(5)
    noise = rng.normal(size=len(at)) + np.sqrt(icc / (1 - icc)) * rng.normal(size=24)[at]
    law = with_response(law, law.design @ THETA + 0.1 * noise)
    mean = np.log(law.observed).reshape(24, 6).mean(axis=1)
    by_means = form_of(straight(np.log(law.X[::6, :3]), mean))
    found = form_of(law)
    assert found.df == by_means.df == (11, 9)
    assert found.statistic == pytest.approx(by_means.statistic, rel=EXACT)
    assert found.pvalue == pytest.approx(by_means.pvalue, rel=1e-8)


@pytest.mark.parametrize("counts", [[6] * 24, [3, 9, 6, 4, 8, 6, 2, 10] * 3], ids=["balanced", "unbalanced"])
@pytest.mark.parametrize("icc", [0.0, 0.2, 0.5, 0.69])
def test_sound_laws_are_rejected_as_often_as_the_level_says(icc, counts):
    """400 laws, 5 %: the binomial lies within .02 and .085 but for 2 in 1000; the rows' F would reject nearly all."""
    law, at = composite(counts)
    signal = law.design @ THETA
    rng = np.random.default_rng(435)
    between = np.sqrt(icc / (1 - icc))
    laws = (
        with_response(law, signal + 0.1 * (rng.normal(size=len(at)) + between * rng.normal(size=24)[at]))
        for _ in range(400)
    )
    assert 0.02 < np.mean([form_of(one).pvalue < 0.05 for one in laws]) < 0.085


def test_a_bent_law_is_found():
    law, at = composite([6] * 24)
    Z = law.design
    rng = np.random.default_rng(6)
    bend = 0.8 * (Z[:, 1] - Z[:, 1].mean()) ** 2
    found = form_of(with_response(law, Z @ THETA + bend + 0.05 * rng.normal(size=len(at))))
    assert found.concern == 1
    assert "compare forms (fitmodels compare)" in found.verdict


def test_repeats_that_are_none_are_found():
    """A factor that is not in the file doubles the wear of one of each pair of repeats: F far below one."""
    law, at = composite([6] * 24)
    rng = np.random.default_rng(8)
    another = np.r_[np.zeros(8), np.tile([0.35, -0.35], 8)]
    found = form_of(with_response(law, law.design @ THETA + (another + 0.05 * rng.normal(size=24))[at]))
    assert (found.concern, found.statistic < 0.1) == (1, True)
    assert "a factor that is not in the law" in found.verdict


def largest_square(x, y):
    """Largest F of the square of one column of x, added alone, and its p times the number of columns."""
    line = np.column_stack([np.ones(len(x)), x])
    found = [
        OLS(y, np.column_stack([line, square])).fit().compare_f_test(OLS(y, line).fit())
        for square in ((x - x.mean(axis=0)) ** 2).T
    ]
    F, p, _ = max(found)
    return F, min(1.0, len(found) * p)


@pytest.mark.parametrize("icc", [0.0, 0.5])
def test_curvature_is_the_partial_f_of_a_square_on_edge_means(icc):
    law, at = composite([6] * 24)
    rng = np.random.default_rng(11)
    noise = rng.normal(size=len(at)) + np.sqrt(icc / (1 - icc)) * rng.normal(size=24)[at]
    law = with_response(law, law.design @ THETA + 0.1 * noise)
    expected = largest_square(np.log(law.X[::6, :3]), np.log(law.observed).reshape(24, 6).mean(axis=1))
    found = curvature(law, split(law))
    assert found.df == (1, 19)
    assert (found.statistic, found.pvalue) == pytest.approx(expected, rel=1e-7)


def test_curvature_of_rows_is_the_partial_f_of_a_square():
    rng = np.random.default_rng(12)
    x = rng.normal(size=(30, 2))
    y = x @ [0.5, 0.2] + 0.3 * x[:, 1] ** 2 + 0.1 * rng.normal(size=30)
    law = straight(x, y)
    found = curvature(law, split(law))
    assert (found.statistic, found.pvalue) == pytest.approx(largest_square(x, y), rel=1e-7)
    assert (found.concern, found.term) == (1, "f")


@pytest.mark.parametrize("icc", [0.0, 0.5])
def test_curvature_of_sound_laws_is_rejected_at_most_as_often_as_the_level_says(icc):
    """300 laws, 5 %: less than .09 but for 2 in 1000."""
    law, at = composite([3, 9, 6, 4, 8, 6, 2, 10] * 3)
    signal, rng = law.design @ THETA, np.random.default_rng(436)
    between = np.sqrt(icc / (1 - icc))
    laws = (
        with_response(law, signal + 0.1 * (rng.standard_t(4, size=len(at)) + between * rng.standard_t(4, size=24)[at]))
        for _ in range(300)
    )
    assert 0.005 < np.mean([curvature(one, split(one)).pvalue < 0.05 for one in laws]) < 0.09


def test_two_levels_have_no_curvature():
    law = straight(np.array(list(product([-1, 1], repeat=3)) * 2), np.random.default_rng(1).normal(size=16))
    assert "no factor has three levels" in str(curvature(law, split(law)))


def test_a_unit_scales_nothing():
    law, at = composite([6] * 24)
    rescaled = with_response(law.with_rows(X=law.X * np.array([1000 / 60, 25.4, 0.1, 60])), np.log(law.observed) + 3)
    assert form_of(rescaled).statistic == pytest.approx(form_of(law).statistic, rel=1e-7)
    assert len(at) == law.nobs


def test_additive_errors_are_tested_too():
    law, _ = composite([6] * 24)
    rng = np.random.default_rng(7)
    signal = np.exp(law.design @ THETA)
    law = with_response(law, np.log(signal * (1 + 0.05 * rng.normal(size=law.nobs))))
    found = form_of(law.alternative)
    assert found.df == (11, 9)
    assert found.pvalue > 0.01


@pytest.mark.parametrize(
    ("p", "words"),
    [(0.0004, "p < .001"), (0.01504, "p = .015"), (0.2, "p = .20"), (1.0, "p = 1.00"), (0.0999, "p = .100")],
)
def test_p_is_reported_as_papers_print_it(p, words):
    assert format_p(p) == words


def changed_on_tools(rng, curved):
    """Six tools, two for each depth, each with V and f in nine steps; a force with a level of its own for each tool."""
    rows = [(e, V, f, d) for e, d in enumerate(np.repeat([0.25, 0.5, 0.8], 2)) for V in (310, 350, 390)
            for f in (0.07, 0.1, 0.13)]  # fmt: skip
    frame = pd.DataFrame(rows, columns=["edge", "V", "f", "d"])
    level = 0.1 * rng.standard_normal(6)[frame["edge"]]
    bend = curved * np.log(frame["f"] / 0.1) ** 2
    frame["Fx"] = 2000 * frame["f"] ** 0.75 * frame["d"] * np.exp(level + bend + 0.05 * rng.standard_normal(len(frame)))
    frame["edge"] = [f"E{e}" for e in frame["edge"]]
    return fit.power_law(datasets.runs_from_frame(frame, judge=False), "Fx", NAMES[:3])


def test_conditions_changed_on_an_edge_are_tested_within_edges():
    """F, degrees of freedom and p are those of statsmodels for levels of edges with V and f, and with all settings."""
    law = changed_on_tools(np.random.default_rng(1), 0.0)
    found = lack_of_fit_within(law)
    edges = np.eye(6)[np.unique(law.edge, return_inverse=True)[1]]
    setting = np.unique(np.round(law.design, 9), axis=0, return_inverse=True)[1].ravel()
    y = np.log(law.observed)
    settings = np.column_stack([edges, np.eye(27)[setting]])
    basis = settings[:, np.sort(qr(settings, pivoting=True)[2][: np.linalg.matrix_rank(settings)])]
    F, p, df = OLS(y, basis).fit().compare_f_test(OLS(y, np.column_stack([edges, law.design[:, 1:3]])).fit())
    assert (found.statistic, found.df) == (pytest.approx(F, rel=EXACT), (int(df), 24))
    assert found.pvalue == pytest.approx(2 * min(p, 1 - p), rel=1e-6)
    assert lack_of_fit_within(changed_on_tools(np.random.default_rng(1), 1.0)).concern == 1


def test_the_test_within_edges_keeps_its_level():
    """Seed 2, 200 draws: a share of rejections at 10 % outside .05 to .16 has a probability below 1 %."""
    rng = np.random.default_rng(2)
    share = np.mean([lack_of_fit_within(changed_on_tools(rng, 0.0)).pvalue < 0.1 for _ in range(200)])
    assert 0.05 <= share <= 0.16


def test_naming_the_tools_does_not_hide_the_lack_of_fit_of_measured_forces(measurements):
    """Six tools with the depth changed between them: V and f are judged on each tool."""
    runs = datasets.read_runs(measurements / "turning_forces" / "exp1_runs.csv", edge="Tool_ID")
    law = fit.power_law(runs, "Fz", NAMES[:3])
    assert lack_of_fit_within(law).pvalue < 0.001
    assert lack_of_fit_within(fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", NAMES)) is None


@pytest.mark.parametrize("scatter", [0.08, 1.0])
def test_a_maximum_of_life_is_a_wrong_form_and_no_scatter_where_repeats_agree(scatter):
    """Below the speed of the longest life built-up edge shortens it: more tests at the ends were the remedy."""
    V = np.repeat([80.0, 100, 125, 150, 180, 220, 260], 2)
    T = 40 * np.exp(-((np.log(V / 145) / 0.4) ** 2) + np.random.default_rng(3).normal(0, scatter, 14))
    runs = datasets.runs_from_frame(pd.DataFrame({"V": V, "f": 0.2, "T": T}))
    found = fit.judge(fit.life_law(runs, ["V"]), runs=runs)
    first = found.verdict.reasons[0]
    assert found.verdict.level == 2
    assert first.startswith("Lack of fit" if scatter < 0.1 else "R2")
    assert found.checks["form"].concern == (2 if scatter < 0.1 else 0)
