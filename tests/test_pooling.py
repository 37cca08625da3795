"""Partial pooling gives the published posteriors, the textbook's limits, and better estimates than pairs alone.

References: the eight schools (Rubin 1981, J. Educational Statistics 6, 377; Gelman et al. 2013, Bayesian Data Analysis,
table 5.3, from 200 draws); the thirteen trials of BCG vaccine (Colditz et al. 1994; REML as printed by Viechtbauer
2010, J. Statistical Software 36(3), section 3); statsmodels' ``combine_effects``; brute-force integration.
"""

import numpy as np
import pandas as pd
import pytest
from fitmodels.core.errors import UsageError
from fitmodels.fit.many.batched import many_power_laws
from fitmodels.fit.many.pooling import moderated, pooled_exponents
from fitmodels.fit.many.random_effects import (
    family,
    given,
    half_t,
    moments,
    of_pairs,
    quantiles,
    reml,
    tau_quantile,
    thinned,
)
from hypothesis import given as for_any
from hypothesis import settings
from hypothesis import strategies as st
from scipy.stats import norm, t
from statsmodels.stats.meta_analysis import combine_effects

SCHOOLS = np.array([28.0, 8, -3, 7, -1, 1, 18, 12]), np.array([15.0, 10, 16, 11, 9, 11, 10, 18])
# Quantiles .025, .25, .5, .75, .975 of each school as printed.
TABLE_5_3 = np.array([
    [-2, 7, 10, 16, 31], [-5, 3, 8, 12, 23], [-11, 2, 7, 11, 19], [-7, 4, 8, 11, 21],
    [-9, 1, 5, 10, 18], [-7, 2, 6, 10, 28], [-1, 7, 10, 15, 26], [-6, 3, 8, 13, 33],
])  # fmt: skip
# Vaccinated: ill, well; not vaccinated: ill, well.
BCG = np.array([
    [4, 119, 11, 128], [6, 300, 29, 274], [3, 228, 11, 209], [62, 13536, 248, 12619], [33, 5036, 47, 5761],
    [180, 1361, 372, 1079], [8, 2537, 10, 619], [505, 87886, 499, 87892], [29, 7470, 45, 7232], [17, 1699, 65, 1600],
    [186, 50448, 141, 27197], [5, 2493, 3, 2338], [27, 16886, 29, 17825],
], dtype=float)  # fmt: skip


def log_risk_ratios():
    a, b, c, d = BCG.T
    return np.log(a / (a + b) / (c / (c + d))), 1 / a - 1 / (a + b) + 1 / c - 1 / (c + d)


def as_table(b, se, **more):
    return pd.DataFrame({"params_V": b, "bse_V": se, **more})


def test_the_eight_schools_have_their_published_quantiles():
    """Printed from 200 draws: an inner quantile is within 1.6, a tail one within 3 but for the two it draws widest."""
    b, se = SCHOOLS
    of = family(b, se**2, half_t(3.0, np.inf))
    mean, variance, _ = of_pairs(of)
    ours = np.column_stack([quantiles(of, mean, variance, p) for p in (0.025, 0.25, 0.5, 0.75, 0.975)])
    off = np.abs(ours - TABLE_5_3)
    assert off[:, 1:4].max() < 1.6
    assert np.sort(off[:, [0, 4]].ravel())[:-2].max() < 3
    assert np.median(off) < 0.5


def test_bcg_trials_have_the_published_reml_estimates():
    """Printed: tau^2 0.3132, estimate -0.7145, standard error 0.1798."""
    b, v = log_risk_ratios()
    tau = reml(b, v)
    at = given(np.array([tau]), b, v)
    found = (tau**2, at.mean[0], at.variance[0] ** 0.5)
    np.testing.assert_allclose(found, (0.3132, -0.7145, 0.1798), atol=6e-5)


@pytest.mark.parametrize("method", ["dl", "pm"])
def test_given_its_tau_the_family_is_that_of_statsmodels(method):
    """DerSimonian-Laird's and Paule-Mandel's tau^2 lie in our interval; given either, mean and error are the same."""
    b, v = log_risk_ratios()
    theirs = combine_effects(b, v, method_re=method)
    at = given(np.sqrt([theirs.tau2]), b, v)
    np.testing.assert_allclose(
        (at.mean[0], at.variance[0] ** 0.5), (theirs.mean_effect_re, theirs.sd_eff_w_re), rtol=1e-9
    )
    of = pooled_exponents(as_table(b, v**0.5), "V").families.iloc[0]
    assert of["tau_low"] ** 2 < theirs.tau2 < of["tau_high"] ** 2
    assert abs(of["tau_reml"] ** 2 - theirs.tau2) < 0.06


def test_brute_force_gives_the_same():
    """Four pairs, integrated over a plain grid of mu and tau."""
    b, se = np.array([0.2, 0.5, 0.6, 1.1]), np.array([0.1, 0.2, 0.05, 0.3])
    mu, tau = np.meshgrid(np.linspace(-6, 7, 1001), np.sinh(np.linspace(1e-4, 7, 1201)) / 20, indexing="ij")
    density = t.pdf(tau / 0.3, 3) * np.hypot(tau, 1 / 20)  # tau = sinh(x) / 20
    for b_i, se_i in zip(b, se, strict=True):
        density = density * norm.pdf(b_i, mu, np.hypot(tau, se_i))
    density /= density.sum()
    pull = se[0] ** 2 / (se[0] ** 2 + tau**2)
    beta, spread = b[0] + pull * (mu - b[0]), (1 - pull) * se[0] ** 2
    mean = np.sum(density * beta)
    found = pooled_exponents(as_table(b, se), "V")
    row, of = found.table.iloc[0], found.families.iloc[0]
    assert row["pooled"] == pytest.approx(mean, rel=1e-4)
    assert row["pooled_se"] == pytest.approx(np.sum(density * (spread + (beta - mean) ** 2)) ** 0.5, rel=5e-4)
    assert of["mean"] == pytest.approx(np.sum(density * mu), rel=1e-4)
    at = np.searchsorted(np.cumsum(density.sum(axis=0)), [0.025, 0.5, 0.975])
    np.testing.assert_allclose(of[["tau_low", "tau", "tau_high"]].to_numpy(), tau[0, at], rtol=1e-2)
    low = np.sum(density * norm.cdf(row["pooled_low"], beta, np.sqrt(spread)))
    new = np.sum(density * norm.cdf(of["new_high"], mu, tau))
    np.testing.assert_allclose((low, new), (0.025, 0.975), atol=2e-4)


def test_pairs_that_agree_share_one_exponent_and_pairs_that_differ_keep_theirs():
    """The two ends of the model: complete pooling and none."""
    se = np.full(40, 0.1)
    alike = pooled_exponents(as_table(0.5 + 0.001 * np.arange(40), se), "V").table
    assert (alike["shrinkage"] > 0.85).all()
    assert np.ptp(alike["pooled"]) < 0.2 * np.ptp(alike["estimate"])
    apart = pooled_exponents(as_table(np.linspace(-30, 30, 40), se), "V", tau_scale=np.inf).table
    np.testing.assert_allclose(
        apart[["pooled", "pooled_low", "pooled_high"]], apart[["estimate", "low", "high"]], atol=2e-3
    )


def test_few_edges_count_for_less_and_their_interval_alone_is_that_of_t():
    b = np.array([0.3, 0.5, 0.5, 0.5, 0.5, 0.7])
    found = pooled_exponents(as_table(b, np.full(6, 0.05), df=[23, 23, 23, 23, 23, 3]), "V").table
    np.testing.assert_allclose(found["high"] - b, 0.05 * t.ppf(0.975, [23, 23, 23, 23, 23, 3]))
    assert found["shrinkage"].iloc[-1] > 1.5 * found["shrinkage"].iloc[0]
    wide = pooled_exponents(as_table(b * 1e3, np.full(6, 0.05), df=3), "V", tau_scale=np.inf).table
    np.testing.assert_allclose(wide["pooled_high"], wide["high"], rtol=1e-4)


@settings(max_examples=20, deadline=None)
@for_any(shift=st.floats(-5, 5), size=st.floats(0.01, 100), seed=st.integers(0, 999))
def test_shift_and_scale_pass_through(shift, size, seed):
    """Exponents times a number, errors and prior too, plus a number: everything moves with them."""
    rng = np.random.default_rng(seed)
    b, se = rng.normal(0, 0.2, 9), rng.uniform(0.02, 0.3, 9)
    one = pooled_exponents(as_table(b, se), "V")
    other = pooled_exponents(as_table(shift + size * b, size * se), "V", tau_scale=0.3 * size)
    names = ["pooled", "pooled_low", "pooled_high"]
    tolerance = 1e-6 * (size + abs(shift))
    np.testing.assert_allclose(other.table[names], shift + size * one.table[names], atol=tolerance)
    np.testing.assert_allclose(other.families["tau"], size * one.families["tau"], rtol=1e-5)


def test_the_pooled_estimate_lies_between_its_own_and_the_familys():
    rng = np.random.default_rng(4)
    found = pooled_exponents(as_table(rng.normal(0.5, 0.2, 30), rng.uniform(0.05, 0.4, 30)), "V")
    ends = np.sort(np.column_stack([found.table["estimate"], np.full(30, found.families["mean"].iloc[0])]), axis=1)
    assert ((found.table["pooled"] > ends[:, 0] - 0.01) & (found.table["pooled"] < ends[:, 1] + 0.01)).all()
    assert (found.table["pooled_se"] < found.table["se"]).all()


def test_pooling_errs_less_and_its_intervals_hold():
    """60 families of 12 pairs with 4 to 24 edges, from rows to intervals; the study is benchmarks/pooling.py."""
    rng = np.random.default_rng(11)
    counts = np.tile([4, 6, 8, 12, 16, 24] * 2, 60)
    truth = 0.577 + 0.08 * rng.standard_normal(len(counts))
    pair = np.repeat(np.arange(len(counts)), counts * 4)
    edge = np.repeat(np.arange(counts.sum()), 4)
    V = rng.uniform(*np.log((50, 200)), counts.sum())[edge]
    level = 0.07 * rng.standard_normal(counts.sum())[edge] + 0.07 * rng.standard_normal(len(edge))
    rows = {"pair": pair, "edge": edge, "V": np.exp(V), "AW": np.exp(truth[pair] * V + level)}
    table = many_power_laws(rows, "AW", ["V"], pair="pair", edge="edge").table.assign(group=np.arange(720) // 12)
    found = pooled_exponents(table, "V", by="group").table
    alone, pooled = (np.mean((found[name] - truth) ** 2) for name in ("estimate", "pooled"))
    assert pooled < 0.5 * alone
    inside = (found["pooled_low"] < truth) & (truth < found["pooled_high"])
    assert 0.93 < inside.mean() < 0.98  # Monte Carlo error 0.008


def test_errors_of_a_family_are_moderated_as_far_as_it_is_of_one_kind():
    """sigma^2 drawn as d0 s0^2 / chi^2(d0): d0 = 8 comes back; pairs that scatter alike share one error."""
    rng = np.random.default_rng(5)
    df, design = rng.choice([3.0, 7, 23], 4000), rng.uniform(0.5, 2, 4000)
    sigma2 = 0.04 * 8 / rng.chisquare(8, 4000)
    se = np.sqrt(sigma2 * rng.chisquare(df) / df * design)
    found, got = moderated(se, df, design)
    np.testing.assert_allclose(got - df, 8, rtol=0.15)
    ratio = np.log(found**2 / design / sigma2)
    assert np.mean(ratio[df == 3] ** 2) < 0.4 * np.mean(np.log(se**2 / design / sigma2)[df == 3] ** 2)
    alike, most = moderated(np.sqrt(0.04 * rng.chisquare(df[:30]) / df[:30] * design[:30]), df[:30], design[:30])
    assert np.ptp(np.log(alike**2 / design[:30])) < 0.5
    assert (most >= 23).all()


def test_families_are_pooled_apart_and_what_cannot_be_says_why():
    b = np.array([0.5, 0.6, 0.55, 0.9, 0.8, np.nan, 0.5, 0.7])
    group = ["P", "P", "P", "K", "K", "P", None, "P"]
    table = as_table(b, [0.05, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05, np.nan], group=group).set_axis(list("abcdefgh"))
    found = pooled_exponents(table, "V", by="group")
    assert list(found.families.index) == ["P"]
    assert list(found.table.index) == list("abcdefgh")
    said = found.table["reason"]
    assert (said["a":"c"] == "").all()
    assert said["d":"e"].str.contains("fewer than 3 pairs").all()
    assert [said["f"], said["g"]] == ["no exponent of V", "no family is named"]
    assert "no standard error" in said["h"]
    alone = pooled_exponents(table.loc["a":"c"], "V").table
    np.testing.assert_allclose(alone["pooled"], found.table["pooled"]["a":"c"])


def test_a_family_too_small_to_moderate_keeps_its_errors():
    table = as_table([0.5, 0.6, 0.7], [0.1, 0.1, 0.1], df=[3, 4, 5])
    used = pooled_exponents(table, "V").table
    assert used["se_used"].tolist() == [0.1, 0.1, 0.1]
    assert used["df_used"].tolist() == [3, 4, 5]


def test_it_has_a_display():
    reported = pooled_exponents(as_table(*SCHOOLS), "V").summary()
    assert "8 pairs in 1 families" in reported
    assert "half-t" in reported


def test_its_picture_shows_every_pair_alone_and_pooled():
    found = pooled_exponents(as_table(*SCHOOLS), "V")
    alone, pooled = found.plot().get_lines()[:2]
    np.testing.assert_allclose(np.sort(alone.get_ydata()), np.sort(found.table["estimate"]))
    np.testing.assert_allclose(np.sort(pooled.get_ydata()), np.sort(found.table["pooled"]))


def test_tau_quantiles_rise():
    b, v = log_risk_ratios()
    of = family(b, v, half_t(3.0, 0.3))
    found = [tau_quantile(of, p) for p in np.linspace(0.001, 0.999, 40)]
    assert (np.diff(found) > 0).all()


@pytest.mark.parametrize("spread", [0.0, 0.02, 0.1, 3.0])
@pytest.mark.parametrize("uneven", [0.0, 1.5])
def test_few_nodes_of_tau_tell_the_pairs_of_a_large_family_what_all_of_them_do(spread, uneven):
    rng = np.random.default_rng(17)
    v = np.square(0.1 * np.exp(uneven * rng.standard_normal(60)))
    of = family(0.5 + spread * rng.standard_normal(60) + np.sqrt(v) * rng.standard_normal(60), v, half_t(3.0, 0.3))
    few = thinned(of)
    assert len(few.tau) < len(of.tau) / 5
    (mean, variance, _), (rough, roughly, _) = of_pairs(of), of_pairs(few)
    se = moments(of, mean, variance)[1]
    for p in (0.0005, 0.025, 0.5, 0.975):
        off = quantiles(few, rough, roughly, p) - quantiles(of, mean, variance, p)
        assert np.abs(off / se).max() < 1e-6


@pytest.mark.parametrize("p", [0.001, 0.025, 0.5, 0.975])
def test_quantiles_are_where_the_mixture_has_their_share(p):
    """Against scipy's normal summed over the nodes, for pairs whose errors differ a thousandfold."""
    rng = np.random.default_rng(2)
    of = family(rng.normal(0.5, 0.3, 12), np.square(np.geomspace(1e-3, 1.0, 12)), half_t(3.0, np.inf))
    mean, variance, _ = of_pairs(of)
    found = quantiles(of, mean, variance, p)
    np.testing.assert_allclose(of.weight @ norm.cdf(found, mean, np.sqrt(variance)), p, rtol=1e-7)


def test_a_pair_of_next_to_no_error_does_not_hide_how_exponents_differ():
    b = np.array([0.2, 0.5, 0.6, 1.1, 0.7])
    one, other = (pooled_exponents(as_table(b, [0.1, 0.1, tiny, 0.1, 0.1]), "V") for tiny in (1e-5, 1e-12))
    names = ["mean", "mean_se", "tau", "tau_low", "tau_high", "tau_reml", "new_low", "new_high"]
    np.testing.assert_allclose(other.families[names], one.families[names], rtol=5e-3)
    np.testing.assert_allclose(other.table["pooled"], one.table["pooled"], rtol=1e-4)


def test_rows_that_a_law_meets_exactly_are_left_apart_without_a_warning():
    table = as_table([0.5, 0.6, 0.7, 0.5], [0.1, 0.1, 0.1, 0.0], row_bse_V=[0.1, 0.1, 0.1, 0.0], df=5)
    found = pooled_exponents(table.assign(scale_se=[0.2, 0.2, 0.2, 0.0]), "V").table
    assert found["pooled"].notna().tolist() == [True, True, True, False]
    assert "no standard error" in found["reason"].iloc[3]


def test_a_family_of_thousands_is_that_of_its_parts():
    """Pairs go through in blocks; the same pairs four times over keep one estimate each."""
    rng = np.random.default_rng(3)
    b, se = rng.normal(0.5, 0.2, 2500), rng.uniform(0.05, 0.3, 2500)
    found = pooled_exponents(as_table(np.tile(b, 4), np.tile(se, 4)), "V").table["pooled"].to_numpy().reshape(4, -1)
    np.testing.assert_allclose(found, np.broadcast_to(found[0], found.shape), rtol=1e-9)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"factor": "f"}, "no column 'params_f'"),
        ({"by": "grade"}, "no column 'grade'"),
        ({"level": 95}, "level 95 of an interval"),
        ({"tau_scale": 0}, "above zero"),
    ],
)
def test_what_cannot_be_asked_is_said_before_the_fit(asked, said):
    with pytest.raises(UsageError, match=said):
        pooled_exponents(as_table(*SCHOOLS), **({"factor": "V"} | asked))
