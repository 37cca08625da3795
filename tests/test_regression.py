"""Power and exponential laws against statsmodels, scipy and their own symmetries."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core import errors
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import curve_fit
from scipy.stats import t as student
from statsmodels.regression.linear_model import OLS

SAME = 1e-9  # the same least-squares problem through two QR routes
REPRODUCIBLE = settings(derandomize=True, deadline=None, max_examples=25)
CONDITIONS = ["V", "f", "d", "t"]


@cache
def gc435():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


@cache
def surf():
    return datasets.read_runs(datasets.bundled("surf_table1"))


def turning(n=24, seed=0, noise=0.05, exponents=(0.577, 0.168, 0.248), c0=7.62e-3):
    """Wear of n edges over the domain of Alaskari & Oraby (doi 10.15242/IIE.E1216006), lognormal scatter."""
    rng = np.random.default_rng(seed)
    X = np.exp(rng.uniform(np.log([50, 0.06, 1.5]), np.log([200, 0.6, 3.0]), size=(n, 3)))
    AW = c0 * np.prod(X**exponents, axis=1) * np.exp(noise * rng.normal(size=n))
    return pd.DataFrame({"V": X[:, 0], "f": X[:, 1], "d": X[:, 2], "AW": AW})


def fitted(frame, factors=("V", "f", "d"), response="AW", *, judge=True, **options):
    return fit.power_law(datasets.runs_from_frame(frame, judge=judge), response, list(factors), **options)


def reference(runs, response, factors):
    logs = np.column_stack([np.ones(len(runs)), *(np.log(runs.values(name)) for name in factors)])
    return OLS(np.log(runs.values(response)), logs).fit(method="qr")


@pytest.mark.parametrize("response", ["AW", "P", "Fxz"])
def test_first_stage_is_statsmodels_ols_of_the_logarithms(response):
    factors = CONDITIONS if response == "AW" else [*CONDITIONS, "AW"]
    law, ols = fit.power_law(gc435(), response, factors, edge=None), reference(gc435(), response, factors)
    np.testing.assert_allclose(law.theta, ols.params, rtol=SAME)
    np.testing.assert_allclose(law.cov_theta, ols.cov_params(), rtol=1e-8, atol=1e-14)
    np.testing.assert_allclose(law.params[1:], ols.params[1:], rtol=SAME)
    np.testing.assert_allclose(law.bse[1:], ols.bse[1:], rtol=SAME)
    np.testing.assert_allclose(law.tvalues[1:], ols.tvalues[1:], rtol=SAME)
    np.testing.assert_allclose(law.pvalues[1:], ols.pvalues[1:], rtol=1e-6, atol=1e-300)
    np.testing.assert_allclose(law.residuals, ols.resid, atol=1e-10)
    np.testing.assert_allclose(np.log(law.fitted), ols.fittedvalues, atol=1e-10)
    assert law.rsquared == pytest.approx(ols.rsquared, rel=SAME)
    assert law.rsquared_adj == pytest.approx(ols.rsquared_adj, rel=SAME)
    assert law.fvalue == pytest.approx(ols.fvalue, rel=SAME)
    assert law.f_pvalue == pytest.approx(ols.f_pvalue, rel=1e-6, abs=1e-300)
    assert law.scale_se == pytest.approx(np.sqrt(ols.scale), rel=SAME)
    assert (law.nobs, law.df_model, law.df_resid) == (239, ols.df_model, ols.df_resid)
    assert law.n_edges is None


def test_the_constant_is_the_exponential_of_its_logarithm():
    """Delta method: the standard error of c0 is c0 times that of ln c0; its interval is the logarithm's."""
    law, ols = fit.power_law(gc435(), "AW", CONDITIONS, edge=None), reference(gc435(), "AW", CONDITIONS)
    assert law.params["c0"] == pytest.approx(np.exp(ols.params[0]), rel=1e-8)
    assert law.bse["c0"] == pytest.approx(np.exp(ols.params[0]) * ols.bse[0], rel=1e-8)
    limits = ols.conf_int(alpha=0.1)
    limits[0] = np.exp(limits[0])
    np.testing.assert_allclose(law.conf_int(0.9), limits, rtol=1e-8)
    assert law.theta_names[0] == "ln c0"


def test_a_category_is_statsmodels_indicator_column():
    frame = turning(30, seed=4)
    frame["work"] = np.tile(["b", "a", "c"], 10)
    law = fitted(frame, by="work")
    assert law.names == ("c0", "V", "f", "d", "work[b]", "work[c]")
    assert law.by.reference == "a"
    logs = np.column_stack([np.ones(30), np.log(frame[["V", "f", "d"]]), frame.work == "b", frame.work == "c"]).astype(
        float
    )
    ols = OLS(np.log(frame.AW.to_numpy()), logs).fit(method="qr")
    np.testing.assert_allclose(law.theta, ols.params, rtol=SAME)
    np.testing.assert_allclose(law.bse[1:], ols.bse[1:], rtol=SAME)
    at = {"V": 100, "f": 0.2, "d": 2}
    low, high = (law.values({**at, "work": name}) for name in ("a", "c"))
    assert high / low == pytest.approx(np.exp(law.params["work[c]"]), rel=1e-12)


def second_stage(runs, response, factors, start):
    """The reference of the second stage: scipy's curve_fit (MINPACK) on c0 prod X^b."""
    X = np.array([runs.values(name) for name in factors])

    def law(X, ln_c0, *b):
        return np.exp(ln_c0 + np.log(X).T @ np.array(b))

    tight = {"ftol": 1e-14, "xtol": 1e-14, "gtol": 1e-14, "maxfev": 20_000}
    return curve_fit(law, X, runs.values(response), p0=start, **tight)


@pytest.mark.parametrize("response", ["AW", "P", "Fxz"])
def test_second_stage_is_curve_fit(response):
    law = fit.power_law(gc435(), response, CONDITIONS, error="additive", edge=None)
    theta, cov = second_stage(gc435(), response, CONDITIONS, law.alternative.theta)
    np.testing.assert_allclose(law.theta, theta, rtol=1e-6, atol=1e-8)
    se = np.sqrt(np.diag(cov))
    np.testing.assert_allclose(law.cov_theta / np.outer(se, se), cov / np.outer(se, se), atol=1e-5)
    scale = np.append(np.exp(theta[0]), np.ones(4))
    np.testing.assert_allclose(law.bse, se * scale, rtol=1e-5)
    residuals = gc435().values(response) - law.values(gc435().data)
    np.testing.assert_allclose(law.residuals, residuals, atol=1e-12 * np.abs(residuals).max())
    assert law.scale_unit == gc435().units[response]


def test_each_error_structure_carries_the_other():
    first, second = (fit.power_law(gc435(), "AW", CONDITIONS, error=e) for e in ("multiplicative", "additive"))
    assert (first.error, first.alternative.error) == ("multiplicative", "additive")
    np.testing.assert_array_equal(first.alternative.theta, second.theta)
    np.testing.assert_array_equal(second.alternative.theta, first.theta)
    assert first.alternative.alternative.error == "multiplicative"
    assert second.rss < np.sum((first.observed - first.fitted) ** 2)


def test_intervals_are_those_of_statsmodels_in_the_logarithm():
    law, ols = fit.power_law(gc435(), "AW", CONDITIONS, edge=None), reference(gc435(), "AW", CONDITIONS)
    new = {"V": [60, 150, 200], "f": 0.3, "d": [1.5, 2, 3], "t": 5}
    logs = np.log([[60, 0.3, 1.5, 5], [150, 0.3, 2, 5], [200, 0.3, 3, 5]])
    frame = ols.get_prediction(np.column_stack([np.ones(3), logs])).summary_frame(alpha=0.05)
    for kind, low, high in (
        ("mean", "mean_ci_lower", "mean_ci_upper"),
        ("prediction", "obs_ci_lower", "obs_ci_upper"),
    ):
        band = law.predict(new, kind).to_frame()[["value", "low", "high"]]
        np.testing.assert_allclose(np.log(band), frame[["mean", low, high]], rtol=1e-8)
    np.testing.assert_allclose(law.values(new), np.exp(frame["mean"]), rtol=1e-8)


def test_intervals_of_the_second_stage_are_the_delta_method():
    law = fit.power_law(gc435(), "Fxz", ["V", "f", "d"], error="additive", edge=None)
    theta, cov = second_stage(gc435(), "Fxz", ["V", "f", "d"], law.theta)
    z = np.array([1, *np.log([120, 0.3, 2])])
    value = np.exp(z @ theta)
    se_mean = value * np.sqrt(z @ cov @ z)
    se_new = np.hypot(se_mean, law.scale_se)
    quantile = student.ppf(0.95, law.df_resid)
    for kind, se in (("mean", se_mean), ("prediction", se_new)):
        band = law.predict({"V": 120, "f": 0.3, "d": 2}, kind, level=0.9).to_frame().iloc[0]
        assert band["value"] == pytest.approx(value, rel=1e-6)
        assert band["high"] - band["value"] == pytest.approx(quantile * se, rel=1e-4)
        assert band["value"] - band["low"] == pytest.approx(quantile * se, rel=1e-4)


def test_exponential_law_is_statsmodels_on_the_force():
    """Ra = a exp(b F), SURF eq. 5: ln Ra on F, the eight controlled cuts of its Table 1."""
    law = fit.exponential_law(surf())
    ols = OLS(np.log(surf().values("Ra")), np.column_stack([np.ones(8), surf().values("F")])).fit(method="qr")
    assert law.params["a"] == pytest.approx(np.exp(ols.params[0]), rel=SAME)
    assert law.params["b"] == pytest.approx(ols.params[1], rel=SAME)
    assert law.bse["b"] == pytest.approx(ols.bse[1], rel=SAME)
    assert law.rsquared == pytest.approx(ols.rsquared, rel=SAME)
    assert law.fvalue == pytest.approx(ols.fvalue, rel=SAME)
    second = law.alternative
    theta, cov = curve_fit(
        lambda F, ln_a, b: np.exp(ln_a + b * F), surf().values("F"), surf().values("Ra"), p0=law.theta
    )
    np.testing.assert_allclose(second.theta, theta, rtol=1e-6)
    np.testing.assert_allclose(second.cov_theta, cov, rtol=1e-4)


def test_an_exponential_law_says_when_forces_repeat():
    frame = pd.DataFrame({"F": np.repeat([450.0, 550, 650, 750], 3), "Ra": np.linspace(1, 3, 12)})
    law = fit.exponential_law(datasets.runs_from_frame(frame))
    assert "F has 4 distinct values in 12 rows" in law.notes[0]
    assert fit.exponential_law(surf()).notes == ()


@REPRODUCIBLE
@given(st.tuples(*[st.floats(-2, 2)] * 3), st.floats(1e-4, 1e4), st.sampled_from(["multiplicative", "additive"]))
def test_exact_data_give_their_exponents_back(exponents, c0, error):
    assume(max(abs(b) for b in exponents) > 1e-9)  # a constant response is refused, see below
    law = fitted(turning(20, noise=0, exponents=exponents, c0=c0), error=error, judge=False)
    np.testing.assert_allclose(law.params[1:], exponents, atol=1e-8)
    assert law.params["c0"] == pytest.approx(c0, rel=1e-7)


def test_a_constant_response_is_refused():
    with pytest.raises(errors.FitError, match=r"AW is 0\.2 in all 20 rows: there is nothing to explain"):
        fitted(turning(20).assign(AW=0.2))


@REPRODUCIBLE
@given(st.integers(0, 10**6), st.floats(1e-3, 1e3), st.sampled_from(["V", "f", "d"]))
def test_another_unit_changes_the_constant_alone(seed, scale, name):
    frame = turning(16, seed=seed)
    plain, scaled = (fitted(one, judge=False) for one in (frame, frame.assign(**{name: frame[name] * scale})))
    np.testing.assert_allclose(scaled.params[1:], plain.params[1:], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(scaled.bse[1:], plain.bse[1:], rtol=1e-7)
    assert scaled.params["c0"] == pytest.approx(plain.params["c0"] * scale ** -plain.params[name], rel=1e-6)
    assert scaled.rsquared == pytest.approx(plain.rsquared, rel=1e-9)
    np.testing.assert_allclose(scaled.alternative.params[1:], plain.alternative.params[1:], rtol=1e-6, atol=1e-8)


@REPRODUCIBLE
@given(st.permutations(range(14)))
def test_the_order_of_the_rows_does_not_matter(order):
    frame = turning(14, seed=3)
    plain, shuffled = fitted(frame), fitted(frame.iloc[order].reset_index(drop=True))
    np.testing.assert_allclose(shuffled.params, plain.params, rtol=1e-9)
    np.testing.assert_allclose(shuffled.cov_params, plain.cov_params, rtol=1e-8, atol=1e-16)
    np.testing.assert_allclose(shuffled.alternative.params, plain.alternative.params, rtol=1e-8)


def test_runs_joined_to_themselves_are_no_new_evidence():
    """Every row twice is a copy, not a second test: same law, same standard errors, and it is said."""
    runs = datasets.runs_from_frame(turning(14, seed=5))
    once, twice = (fit.power_law(r, "AW", ["V", "f", "d"]) for r in (runs, runs.join(runs)))
    np.testing.assert_allclose(twice.params, once.params, rtol=1e-12)
    np.testing.assert_allclose(twice.bse, once.bse, rtol=1e-12)
    assert (once.repeats, twice.repeats, twice.nobs) == (1, 2, 14)
    assert "contains each of 14 measurements 2 times (28 rows)" in twice.notes[0]


def test_a_second_test_of_the_same_plan_shrinks_the_errors():
    first, second = (datasets.runs_from_frame(turning(40, seed=s)) for s in (5, 6))
    one, both = (fit.power_law(r, "AW", ["V", "f", "d"]) for r in (first, first.join(second)))
    assert both.nobs == 80
    assert (both.bse[1:] < one.bse[1:]).all()


@pytest.mark.parametrize("n", [4, 5, 6])
def test_from_as_many_rows_as_parameters_on_there_is_a_law(n):
    law = fitted(turning(n, seed=8))
    assert law.df_resid == n - 4
    if n > 4:
        assert law.no_interval is None
        assert np.isfinite(law.bse).all()
        return
    assert law.no_interval == "no interval: 4 observations fix 4 parameters exactly"
    np.testing.assert_allclose(law.fitted, law.observed, rtol=1e-10)
    np.testing.assert_allclose(law.alternative.params, law.params, rtol=1e-7)
    assert law.bse.isna().all()
    assert (law.scale_se, law.fvalue, law.f_pvalue, law.rsquared_adj) == (None, None, None, None)
    assert "no interval" in law.summary()
    with pytest.raises(errors.FitError, match=r"AW: no interval: 4 observations.*Add observations"):
        law.predict({"V": 100, "f": 0.2, "d": 2}, "mean").to_frame()


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_fewer_rows_than_parameters_are_counted(n, error):
    with pytest.raises(errors.FitError, match=rf"AW: {n} usable rows? for \d parameters.*Measure at least"):
        fitted(turning(n).assign(d=np.linspace(1.5, 3, n)), error=error)


def test_a_hundred_thousand_rows():
    frame = turning(100_000, seed=1, noise=0.2)
    law = fitted(frame)
    Z = np.column_stack([np.ones(len(frame)), np.log(frame[["V", "f", "d"]])])
    np.testing.assert_allclose(law.theta, np.linalg.lstsq(Z, np.log(frame.AW))[0], rtol=1e-9)
    assert law.alternative is not None


def test_rows_without_a_logarithm_are_left_out_and_counted():
    frame = turning(20, seed=2)
    frame.loc[[3, 7], "AW"] = 0.0
    frame.loc[11, "AW"] = -0.01
    frame.loc[15, "V"] = 0.0
    law = fitted(frame)
    assert law.nobs == 16
    assert [(item.reason, item.count, item.lines) for item in law.dropped] == [
        ("AW zero or negative", 3, (3, 7, 11)),
        ("V zero or negative", 1, (15,)),
    ]
    clean = fitted(frame.drop(index=[3, 7, 11, 15]).reset_index(drop=True))
    np.testing.assert_array_equal(law.theta, clean.theta)


def test_additive_errors_keep_zero_and_negative_responses():
    frame = turning(20, seed=2)
    frame.loc[[3, 7], "AW"] = [0.0, -0.01]
    law = fitted(frame, error="additive")
    assert (law.nobs, law.error, law.dropped, law.alternative) == (20, "additive", (), None)
    theta, cov = second_stage(datasets.runs_from_frame(frame), "AW", ["V", "f", "d"], [-5, 0.5, 0.2, 0.2])
    np.testing.assert_allclose(law.theta, theta, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(law.cov_theta, cov, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
def test_no_positive_response_is_a_sentence(error):
    none = r"AW: 0 usable rows for 4 parameters.*20 rows left out: AW zero|AW is 0 in all 20 rows"
    with pytest.raises(errors.FitError, match=none):
        fitted(turning(20).assign(AW=0.0), error=error)


def test_a_level_without_a_positive_response_has_no_start():
    frame = turning(20).assign(work=["a"] * 17 + ["b"] * 3)
    frame.loc[17:, "AW"] = -0.01
    with pytest.raises(errors.FitError, match="17 rows above zero do not identify the parameters"):
        fitted(frame, error="additive", by="work")


def test_an_unequal_scatter_shows_in_the_choice_of_errors():
    """Least squares of the logarithm weighs per cent, of the response newtons: big values rule the second."""
    frame = turning(20, noise=0).assign(AW=lambda x: x.AW + np.linspace(-2e-3, 2e-3, 20))
    law = fitted(frame)
    truth = np.array([0.577, 0.168, 0.248])
    first, second = (np.abs(r.params[1:] - truth).max() for r in (law, law.alternative))
    assert second < first


@pytest.mark.parametrize(
    ("call", "error", "says"),
    [
        (lambda f: fitted(f, ["V", "q"]), errors.UsageError, "no column 'q'; there are V, f, d, AW, note"),
        (lambda f: fitted(f, ["V"], "VB"), errors.UsageError, "no column 'VB'"),
        (lambda f: fitted(f, ["V", "note"]), errors.UsageError, "column 'note' holds text"),
        (lambda f: fitted(f, []), errors.UsageError, "AW: no factor is named"),
        (lambda f: fitted(f, ["AW", "V"]), errors.UsageError, "AW is the response and cannot be its own"),
        (lambda f: fitted(f, by="machine"), errors.UsageError, "no column 'machine'"),
        (lambda f: fitted(f, by="note"), errors.FitError, r"hold one level only \(dry\).*Fit without by"),
        (
            lambda f: fitted(f, error="additiv"),
            errors.UsageError,
            "error='additiv': give 'multiplicative'",
        ),
        (lambda f: fitted(f, error=None), errors.UsageError, "error=None"),
    ],
)
def test_what_cannot_be_asked_is_a_sentence(call, error, says):
    with pytest.raises(error, match=says):
        call(turning(12).assign(note="dry"))


def test_the_exponential_law_refuses_in_the_same_words():
    with pytest.raises(errors.UsageError, match="error='log': give 'multiplicative'"):
        fit.exponential_law(surf(), error="log")
    frame = pd.DataFrame({"Ra": [1.0, 2, 3], "F": [500.0] * 3})
    with pytest.raises(errors.FitError, match=r"Ra on F: F is constant \(500 in all 3 rows\); nothing to fit"):
        fit.exponential_law(datasets.runs_from_frame(frame))


@pytest.mark.parametrize(
    ("new", "options", "error", "says"),
    [
        ({"V": 100}, {}, errors.FitError, "AW needs f, d; given: V"),
        ({}, {}, errors.FitError, "given: nothing"),
        ({"V": 0, "f": 0.2, "d": 2}, {}, errors.FitError, "V 0: a power law needs values above zero"),
        ({"V": [90, 100], "f": [1, 2, 3], "d": 2}, {}, errors.FitError, "V has shape .* a column of [23]"),
        ({"V": 90, "f": 0.2, "d": 2}, {"kind": "typical"}, errors.UsageError, "kind='typical'"),
        ({"V": 90, "f": 0.2, "d": 2}, {"kind": "mean", "level": 95}, errors.UsageError, "between 0 and 1"),
    ],
)
def test_what_cannot_be_predicted_is_a_sentence(new, options, error, says):
    with pytest.raises(error, match=says):
        fitted(turning(12)).predict(new, **options)


def test_a_category_is_asked_for_and_understood_as_a_number():
    frame = turning(12).assign(batch=[1.0, 2.0] * 6)
    law = fitted(frame, by="batch")
    runs = datasets.runs_from_frame(frame)
    np.testing.assert_allclose(law.values(runs.data), law.fitted, rtol=1e-12)
    at = {"V": 100, "f": 0.2, "d": 2}
    assert law.values({**at, "batch": 2}) == law.values({**at, "batch": "2"})
    with pytest.raises(errors.FitError, match=r"fitted by batch: give its level \(1, 2\)"):
        law.values(at)
    with pytest.raises(errors.FitError, match="batch '3' is not among the fitted: 1, 2"):
        law.values({**at, "batch": 3})


def test_the_summary_states_what_was_fitted():
    text = " ".join(fit.power_law(gc435(), "AW", CONDITIONS).summary().split())
    assert text.startswith("Law fit: AW [mm] = ")
    for fact in ("R2 0.89", "239 rows of 24 edges", "power, multiplicative errors (log scale)", "by edge (CR3), df 23"):
        assert fact in text
    assert re.search(r"cluster-robust F\(3, 23\) = \d+\.\d of V, f, d; assuming independent rows it would be \d+", text)
    law = replace(fit.power_law(gc435(), "AW", CONDITIONS), edges=fit.NotAvailable("for a test"))
    assert "F(4, 234) = " in law.summary()
    assert "rows assumed independent, df 234 (for a test)" in " ".join(law.summary().split())


def test_a_fit_leaves_the_runs_as_they_were():
    frame = turning(12)
    runs = datasets.runs_from_frame(frame)
    before = runs.data.copy(deep=True)
    fit.power_law(runs, "AW", ["V", "f", "d"])
    pd.testing.assert_frame_equal(runs.data, before)


@REPRODUCIBLE
@given(st.integers(0, 10**6), st.floats(1e-3, 1e3))
def test_another_unit_of_the_response_scales_constant_and_errors(seed, scale):
    frame = turning(12, seed=seed)
    plain, scaled = (fitted(f, error="additive", judge=False) for f in (frame, frame.assign(AW=frame.AW * scale)))
    np.testing.assert_allclose(scaled.params[1:], plain.params[1:], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(scaled.bse[1:], plain.bse[1:], rtol=1e-6)
    assert scaled.params["c0"] == pytest.approx(scale * plain.params["c0"], rel=1e-6)
    assert scaled.scale_se == pytest.approx(scale * plain.scale_se, rel=1e-6)
