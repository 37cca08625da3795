"""Tests of residuals against statsmodels, against matrices written out, and at their level on sound laws.

References: statsmodels ``normal_ad`` and ``het_breuschpagan``; Durbin & Watson 1950, Biometrika 37, 409, for the exact
moments. What R's lmtest, nortest, olsrr and plm print is in test_published_figures.py.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.fit.checks.autocorrelation import serial_correlation
from fitmodels.fit.checks.residual_tests import Residuals, anderson_darling, normality, residual_sets, spread
from fitmodels.fit.checks.strata import split
from statsmodels.stats.diagnostic import het_breuschpagan, normal_ad

NAMES = ["V", "f", "t"]
THETA = np.array([-2.0, 0.5, 0.2, 0.3])
REPEATS = 300
LEVEL = (0.015, 0.095)  # 5 % in 300 repeats, 3.5 standard errors


def design(edges=24, per_edge=6, seed=0):
    rng = np.random.default_rng(seed)
    at = np.repeat(np.arange(edges), per_edge)
    frame = pd.DataFrame({"V": rng.uniform(50, 200, edges)[at], "f": rng.uniform(0.1, 0.5, edges)[at]})
    frame["t"] = np.tile(np.arange(1.0, per_edge + 1), edges)
    frame["edge"] = [f"E{g:02d}" for g in at]
    frame["AW"] = np.exp(rng.normal(size=len(at)))
    return fit.power_law(datasets.runs_from_frame(frame, judge=False), "AW", NAMES), at


def with_noise(law, noise):
    """The law refitted to a response with this noise in its logarithm."""
    Z = law.formula.design(law.X, law.shifts)
    y = Z @ THETA + noise
    found = fit.linear(Z, y)
    r = y - Z @ found.params
    return law.with_rows(
        theta=found.params, cov_theta=found.cov_params, observed=np.exp(y), fitted=np.exp(Z @ found.params),
        residuals=r, rss=float(r @ r), tss=found.tss,
    )  # fmt: skip


def noise_of(rng, at, icc=0.5, rho=0.0):
    e = rng.normal(size=len(at))
    for i in np.flatnonzero(np.diff(at) == 0) + 1:
        e[i] = rho * e[i - 1] + np.sqrt(1 - rho**2) * e[i]
    return 0.1 * (e + np.sqrt(icc / (1 - icc)) * rng.normal(size=at.max() + 1)[at])


@pytest.mark.parametrize("n", [8, 25, 300])
@pytest.mark.parametrize("power", [0.0, 0.3, 0.6])
def test_anderson_darling_is_statsmodels(n, power):
    x = np.random.default_rng(n).normal(size=n)
    x = np.exp(power * x) if power else x
    statistic, p = anderson_darling(x)
    reference = normal_ad(x)
    assert statistic == pytest.approx(reference[0], rel=1e-9)
    assert p == pytest.approx(reference[1], rel=1e-7, abs=1e-13)


def test_breusch_pagan_of_rows_is_statsmodels():
    rng = np.random.default_rng(2)
    frame = pd.DataFrame({"V": rng.uniform(50, 200, 60), "f": rng.uniform(0.1, 0.5, 60)})
    frame["AW"] = 0.01 * frame["V"] ** 0.5 * np.exp(0.002 * frame["V"] * rng.normal(size=60))
    law = fit.power_law(datasets.runs_from_frame(frame), "AW", ["V", "f"])
    rows, edges = residual_sets(law, split(law))
    found = spread(law, rows)
    LM, p, _, _ = het_breuschpagan(law.residuals, law.formula.design(law.X, law.shifts))
    assert found.statistic == pytest.approx(LM, rel=1e-9)
    assert found.pvalue == pytest.approx(p, rel=1e-8)
    assert (found.df, found.term, found.rises, found.concern > 0) == (2, "V", True, True)
    assert not edges
    assert "rises with V" in found.verdict


@pytest.mark.parametrize("per_edge", [3, 6])
def test_moments_of_the_lag_are_those_of_the_matrices(per_edge):
    """M and A written out: mean tr(MA)/v, variance 2 (v tr(MAMA) - tr(MA)^2) / (v^2 (v + 2))."""
    law, at = design(8, per_edge)
    n = len(at)
    same = at[:, None] == at[None, :]
    A = 0.5 * (same & (np.abs(np.subtract.outer(np.arange(n), np.arange(n))) == 1))
    inside = np.column_stack([np.eye(8)[at], np.log(law.X[:, 2])])
    M = np.eye(n) - inside @ np.linalg.pinv(inside)
    v, MA = np.trace(M), M @ A
    found = serial_correlation(law, split(law))
    rest = M @ law.residuals
    assert found.correlation == pytest.approx(rest @ A @ rest / (rest @ rest), rel=1e-9)
    assert found.expected == pytest.approx(np.trace(MA) / v, rel=1e-9)
    variance = 2 * (v * np.trace(MA @ MA) - np.trace(MA) ** 2) / (v**2 * (v + 2))
    assert found.sd == pytest.approx(np.sqrt(variance), rel=1e-9)
    assert found.order == "t"


def test_rows_are_put_in_order_of_time():
    law, at = design()
    law = with_noise(law, noise_of(np.random.default_rng(3), at, rho=0.8))
    mixed_up = np.random.default_rng(4).permutation(law.nobs)
    shuffled = law.with_rows(
        X=law.X[mixed_up], observed=law.observed[mixed_up], fitted=law.fitted[mixed_up],
        residuals=law.residuals[mixed_up], edge=law.edge[mixed_up], shifts=law.shifts[mixed_up],
    )  # fmt: skip
    found, again = (serial_correlation(one, split(one)) for one in (law, shuffled))
    assert again.correlation == pytest.approx(found.correlation, rel=1e-9)
    assert again.pvalue == pytest.approx(found.pvalue, rel=1e-6)
    assert (found.concern, found.noted) == (0, True)
    assert "Positive autocorrelation" in found.verdict


@pytest.mark.parametrize("per_edge", [2, 3, 6])
def test_sound_laws_are_rejected_as_often_as_the_level_says(per_edge):
    law, at = design(24, per_edge)
    rng = np.random.default_rng(per_edge)
    p = {"serial": [], "rows": [], "edges": [], "spread": [], "spread of edges": []}
    for _ in range(REPEATS):
        one = with_noise(law, noise_of(rng, at))
        strata = split(one)
        rows, edges = residual_sets(one, strata)
        p["serial"].append(getattr(serial_correlation(one, strata), "pvalue", None))
        p["rows"].append(normality(rows).pvalue)
        p["edges"].append(normality(edges).pvalue)
        p["spread"].append(spread(one, rows).pvalue)
        p["spread of edges"].append(spread(one, edges).pvalue)
    if per_edge == 2:
        assert set(p.pop("serial")) == {None}
    for name, values in p.items():
        assert LEVEL[0] <= np.mean(np.array(values) < 0.05) <= LEVEL[1], name


def test_what_is_wrong_is_found():
    law, at = design()
    rng = np.random.default_rng(9)
    V = np.log(law.X[:, 0])
    uneven = with_noise(law, 0.1 * np.exp(2 * (V - V.mean())) * rng.normal(size=len(at)))
    found = spread(uneven, residual_sets(uneven, split(uneven))[0])
    assert (found.term, found.rises, found.concern) == ("V", True, 1)
    outliers = with_noise(law, 0.05 * rng.standard_t(2, size=len(at)))
    tails = normality(residual_sets(outliers, split(outliers))[0])
    assert (tails.concern, tails.noted) == (0, True)
    assert "prediction intervals are approximate" in tails.verdict
    odd = np.where(np.arange(24) == 5, 1.0, 0.02 * rng.normal(size=24))[at]
    one_edge = with_noise(law, odd + 0.02 * rng.normal(size=len(at)))
    rows, edges = residual_sets(one_edge, split(one_edge))
    assert normality(edges).noted
    assert not normality(rows).noted


def test_a_uniform_scatter_cannot_be_compared():
    law, _ = design()
    flat = Residuals("rows", np.tile([1.0, -1.0], 12), ("V",), np.arange(24.0)[:, None], 22)
    assert "all equal in size" in str(spread(law, flat))
    assert "no factor changes" in str(spread(law, replace(flat, terms=np.ones((24, 1)))))
    assert "too few" in str(spread(law, replace(flat, free=3)))
    assert "the test needs 8" in str(normality(replace(flat, free=7)))
