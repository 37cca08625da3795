"""Error structure by likelihood: statsmodels' log-likelihoods, known truths, and what is not testable."""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.fit.checks.response_scale import error_structure
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm
from statsmodels.regression.linear_model import OLS

EXACT = 1e-9


def cut(error, *, seed=1, edges=16, per_edge=6, noise=0.15, unit=1.0):
    rng = np.random.default_rng(seed)
    at, t = np.repeat(np.arange(edges), per_edge), np.tile(np.arange(1.0, per_edge + 1), edges)
    V = np.exp(rng.uniform(np.log(50), np.log(200), edges))[at]
    F = 30 * V**0.5 * t**0.4
    e = noise * rng.normal(size=len(t))
    F = F * np.exp(e) if error == "multiplicative" else F + e * F.mean()
    return datasets.runs_from_frame(
        pd.DataFrame({"edge": [f"E{g}" for g in at], "V": V, "t": t, "F": unit * F}), judge=False
    )


def law(error, fitted="multiplicative", **kwargs):
    return fit.power_law(cut(error, **kwargs), "F", ["V", "t"], error=fitted)


def test_likelihoods_are_those_of_the_densities():
    """OLS of statsmodels on ln F less sum ln F; scipy's normal density of the natural residuals."""
    one = law("multiplicative")
    found = error_structure(one)
    logs = OLS(np.log(one.observed), one.formula.design(one.X)).fit()
    assert found.multiplicative == pytest.approx(logs.llf - np.log(one.observed).sum(), rel=EXACT)
    other = one.alternative
    natural = norm(scale=np.sqrt(other.rss / other.nobs)).logpdf(other.residuals).sum()
    assert found.additive == pytest.approx(natural, rel=EXACT)
    assert found.aic_difference == pytest.approx(-2 * (found.multiplicative - found.additive))


@pytest.mark.parametrize("truth", ["multiplicative", "additive"])
@pytest.mark.parametrize("fitted", ["multiplicative", "additive"])
def test_the_truth_is_preferred_whichever_was_fitted(truth, fitted):
    found = error_structure(law(truth, fitted))
    assert (found.preferred, found.sure, found.concern) == (truth, True, int(truth != fitted))
    assert found.verdict.startswith(f"{truth.capitalize()} errors are preferred (log-likelihood higher by")
    assert (f"fit with {truth} errors" in found.verdict) == (truth != fitted)


@settings(max_examples=15, deadline=None)
@given(st.floats(1e-4, 1e4))
def test_units_do_not_matter(unit):
    plain, scaled = error_structure(law("multiplicative")), error_structure(law("multiplicative", unit=unit))
    assert scaled.statistic == pytest.approx(plain.statistic, abs=1e-5)
    assert scaled.standard_error == pytest.approx(plain.standard_error, abs=1e-5)


def test_the_standard_error_is_of_sums_by_edge():
    one = law("additive")
    found = error_structure(one)
    other = one.alternative
    rows = norm(scale=np.sqrt(one.rss / one.nobs)).logpdf(one.residuals) - np.log(one.observed)
    rows = rows - norm(scale=np.sqrt(other.rss / other.nobs)).logpdf(other.residuals)
    sums = pd.Series(rows).groupby(one.edge).sum()
    assert found.standard_error == pytest.approx(np.sqrt(16) * sums.std(), rel=EXACT)
    assert (found.unit, found.units) == ("edge", 16)


def test_a_law_that_hardly_changes_gives_no_information():
    """Where the response spans a few per cent the two structures are the same, and the sentence says so."""
    frame = cut("multiplicative", noise=0.001, edges=4, seed=3).data.copy()
    frame["F"] = 100 * (frame["F"] / 100) ** 0.01
    found = error_structure(fit.power_law(datasets.runs_from_frame(frame, judge=False), "F", ["V", "t"]))
    assert (found.preferred, found.concern) == (None, 0)
    assert "errors fit equally well" in found.verdict


def test_one_edge_has_no_standard_error():
    frame = cut("multiplicative", edges=1, per_edge=12)
    found = error_structure(fit.power_law(frame, "F", ["t"]))
    assert (found.standard_error, found.units, found.sure) == (None, 1, False)


def exact():
    return law("multiplicative", noise=0.0)


def below_zero():
    frame = cut("additive").data.copy()
    frame.loc[0, "F"] = -1.0
    return fit.power_law(datasets.runs_from_frame(frame, judge=False), "F", ["V", "t"], error="additive")


def three_rows():
    return fit.power_law(datasets.runs_from_frame(cut("multiplicative").data.iloc[[0, 8, 16]]), "F", ["V", "t"])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (exact, "fits every row exactly"),
        (below_zero, "1 of 96 rows of F are not above zero"),
        (lambda: three_rows(), "3 observations fix 3 parameters exactly"),
        (
            lambda: fit.load_law(datasets.read_runs(datasets.bundled("clm2023_end_milling"))),
            "linear: its errors are additive",
        ),
    ],
)
def test_what_cannot_be_determined_is_said(make, words):
    assert words in str(error_structure(make()))


def test_the_bundled_laws_multiply():
    """They were drawn with lognormal deviations."""
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    for response, factors in {"AW": ["V", "f", "d", "t"], "P": ["V", "f", "d", "t", "AW"]}.items():
        found = error_structure(fit.power_law(runs, response, factors))
        assert (found.preferred, found.sure) == ("multiplicative", True)


def test_nasa_wear_does_not_tell_surely(measurements):
    runs = datasets.read_runs(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    found = error_structure(fit.power_law(runs, "VB", ["t", "f", "d"], by="material"))
    assert found.statistic == pytest.approx(2.64, abs=0.005)
    assert not found.sure
    assert "± 14 over 15 edges, not significant" in found.verdict
