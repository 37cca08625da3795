"""Wear substituted into power and force.

Reference: Alaskari & Oraby 2016, doi 10.15242/IIE.E1216006, eq. 4-6 and 8-11. Eq. 8 prints 0.264 and eq. 9 prints
d^1.243; the paper's own eq. 10 and 11 agree with 0.0264 and d^0.9878.
"""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core import errors
from fitmodels.datasets.published_laws import published_law
from fitmodels.fit.composite_law import composite, substituted, without
from statsmodels.regression.linear_model import OLS
from statsmodels.stats.outliers_influence import variance_inflation_factor

EXACT = 1e-9
FACTORS = ["V", "f", "d", "t"]


def bundled():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


def both(response="P", **kwargs):
    runs = bundled()
    return fit.power_law(runs, response, [*FACTORS, "AW"], **kwargs), fit.power_law(runs, "AW", FACTORS)


@pytest.mark.parametrize(
    ("response", "printed", "at", "constant"),
    [
        ("P", {"c0": 0.0264, "V": 1.0173, "f": 0.6845, "d": 0.9288, "t": 0.0348}, 0.067, 5e-4),
        ("Fxz", {"c0": 259.0, "V": 0.1507, "f": 0.4208, "d": 0.9878, "t": 0.0965}, 799.62, 0.2),
    ],
)
def test_the_papers_algebra(response, printed, at, constant):
    """Eq. 8 and 9 with the misprints mended; eq. 10 and 11 at d 2.5 mm and t 10 min."""
    laws = [published_law("GC435", "709M40", name, "power").coefficients for name in (response, "AW")]
    found = substituted(*laws, "AW")
    assert list(found) == list(printed)
    assert found["c0"] == pytest.approx(printed["c0"], rel=5e-3 if response == "P" else 5e-4)
    for name in FACTORS:
        assert found[name] == pytest.approx(printed[name], abs=5.1e-5)
    assert found["c0"] * 2.5 ** found["d"] * 10 ** found["t"] == pytest.approx(at, abs=constant)


@pytest.mark.parametrize("response", ["P", "Fxz"])
def test_on_the_same_rows_composite_and_reduced_are_the_same_numbers(response):
    """Least squares: the short regression is the long one with the left-out column regressed on the others."""
    found = composite(*both(response))
    np.testing.assert_allclose(found.theta, found.reduced.theta, rtol=EXACT, atol=1e-10)
    refit = fit.power_law(bundled(), response, FACTORS)
    np.testing.assert_allclose(found.reduced.theta, refit.theta, rtol=EXACT)
    np.testing.assert_allclose(found.reduced.bse, refit.bse, rtol=EXACT)
    assert (found.reduced.rss, found.reduced.rsquared) == pytest.approx((refit.rss, refit.rsquared))
    assert found.together
    np.testing.assert_allclose(found.bse, np.sqrt(np.diag(refit.covariance())), rtol=0.05)
    assert list(found.comparison.columns) == ["composite", "se", "reduced", "reduced se"]


def test_laws_of_other_rows_are_taken_as_independent():
    """Delta method with a numerical derivative."""
    law, _ = both()
    wear = fit.power_law(bundled(), "AW", FACTORS, edge=None)
    found = composite(law, wear)
    assert not found.together
    assert "assumed independent" in found.assumption

    def all_of(both_thetas):
        long, short = both_thetas[:6], both_thetas[6:]
        return long[:5] + long[5] * short

    at = np.r_[law.theta, wear.theta]
    J = np.column_stack([(all_of(at + h) - all_of(at - h)) / 2e-6 for h in 1e-6 * np.eye(11)])
    cov = np.zeros((11, 11))
    cov[:6, :6], cov[6:, 6:] = law.covariance(), wear.covariance()
    np.testing.assert_allclose(found.cov_theta, J @ cov @ J.T, rtol=1e-6)


def test_rows_alone_give_the_textbook_standard_errors():
    """Independent rows: the delta method and the reduced fit agree but for degrees of freedom and chance."""
    runs = bundled()
    law = fit.power_law(runs, "P", [*FACTORS, "AW"], edge=None)
    found = composite(law, fit.power_law(runs, "AW", FACTORS, edge=None))
    np.testing.assert_allclose(found.bse, np.sqrt(np.diag(found.reduced.covariance())), rtol=0.01)


def test_the_vif_is_statsmodels():
    law, wear = both()
    found = composite(law, wear)
    assert found.vif == pytest.approx(variance_inflation_factor(law.formula.design(law.X), 5), rel=EXACT)
    assert found.concern == 1
    assert "AW is nearly a function of V, f, d, t (VIF 9.4, above 5)" in found.verdict


def test_additive_laws_are_refitted_in_their_own_units():
    found = composite(*both(error="additive"))
    assert found.reduced.error == "additive"
    refit = fit.power_law(bundled(), "P", FACTORS, error="additive")
    np.testing.assert_allclose(found.reduced.theta, refit.theta, rtol=1e-6)
    np.testing.assert_allclose(found.params[1:], refit.params[1:], atol=0.05)


def test_a_material_shifts_both(measurements):
    runs = datasets.read_runs(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    law = fit.power_law(runs, "smcAC_mid_std", ["f", "d", "VB"], by="material")
    wear = fit.power_law(runs, "VB", ["t", "f", "d"], by="material")
    found = composite(law, wear)
    assert found.names == ("ln c0", "f", "d", "t", "material[2]")
    k = law.params["VB"]
    assert found.params["material[2]"] == pytest.approx(law.params["material[2]"] + k * wear.params["material[2]"])
    assert found.params["t"] == pytest.approx(k * wear.params["t"])
    assert found.concern == 0
    reference = OLS(np.log(law.observed), np.delete(law.formula.design(law.X, law.shifts), 3, axis=1)).fit()
    np.testing.assert_allclose(found.reduced.theta, reference.params, rtol=EXACT)


def test_wear_as_the_only_factor_leaves_nothing():
    law = fit.power_law(bundled(), "P", ["AW"])
    found = composite(law, both()[1])
    assert "the only factor" in str(found.reduced)
    assert list(found.comparison.columns) == ["composite", "se"]
    np.testing.assert_allclose(found.theta[1:], law.theta[1] * both()[1].theta[1:])
    assert found.vif == pytest.approx(1)


def test_as_many_rows_as_parameters():
    rows = {"V": [50.0, 90, 140, 60], "t": [2.0, 5, 3, 9], "AW": [0.1, 0.3, 0.15, 0.4], "P": [1.0, 3, 2, 5]}
    runs = datasets.runs_from_frame(pd.DataFrame(rows))
    found = composite(fit.power_law(runs, "P", ["V", "t", "AW"]), fit.power_law(runs, "AW", ["V", "t"]))
    np.testing.assert_allclose(found.theta, found.reduced.theta, rtol=1e-7)
    assert found.reduced.no_interval is None


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda law, wear: composite(wear, law), "P is not among them"),
        (lambda law, wear: composite(without(law, "AW"), wear), "AW is not among them"),
        (lambda law, wear: composite(law, fit.power_law(bundled(), "AW", ["V", "P"])), "neither can be substituted"),
        (
            lambda law, wear: composite(law, fit.exponential_law(datasets.read_runs(datasets.bundled("surf_table1")))),
            "Ra: the form exponential; only power laws",
        ),
        (lambda law, wear: substituted({"c0": 1.0}, {"c0": 1.0}, "AW"), "AW cannot be substituted"),
    ],
)
def test_what_cannot_be_combined_is_said(make, words):
    with pytest.raises(errors.UsageError, match=words):
        make(*both())
