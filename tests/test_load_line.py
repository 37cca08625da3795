"""Load line of Tai, Tsai & Li (2023), doi 10.1109/ACCESS.2023.3330587: eq. 14, eq. 15 at held current.

Wear is printed in micrometres and kept in millimetres: k1 in A/mm is 1000 times k1 in A/um.
"""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core import errors
from statsmodels.regression.linear_model import OLS


def runs(**columns):
    return datasets.runs_from_frame(pd.DataFrame(columns))


def line(n=15, seed=0, A=0.1158, B=1.2416e-4, k1=0.2226, noise=0.002):
    rng = np.random.default_rng(seed)
    fm, VB = rng.uniform(500, 1000, n), rng.uniform(0, 0.2, n)
    return {"fm": fm, "VB": VB, "I": A + B * fm + k1 * VB + noise * rng.normal(size=n)}


def test_three_points_fix_the_line_with_nothing_left_for_an_interval():
    """Section III.A.1: 1000 mm/min sharp and 700 at 167.3 um, both 0.24 A; 600 at 205.1 um, 0.236 A."""
    given = pd.DataFrame({"fm": [1000, 700, 600], "I": [0.24, 0.24, 0.236], "VB [um]": [0, 167.3, 205.1]})
    law = fit.load_law(datasets.runs_from_frame(given))
    assert law.form == "load_line"
    assert law.params["A"] == pytest.approx(0.1158, abs=5e-5)
    assert law.params["B"] == pytest.approx(1.2416e-4, abs=5e-9)
    assert law.params["k1"] == pytest.approx(1000 * 2.226e-4, abs=5e-5)
    assert law.df_resid == 0
    assert law.no_interval == "no interval: 3 observations fix 3 parameters exactly"
    assert law.bse.isna().all()
    A, B, k1 = law.params
    assert (0.24 - A - 600 * B) / k1 == pytest.approx(0.223, abs=5e-4)  # wear at the lower feed limit, mm
    assert (0.24 - A - 0.220 * k1) / B == pytest.approx(605, abs=0.5)


def test_end_milling_is_fitted_as_feed_on_wear():
    """Held at 0.24 A: sharp, 700 at 167.3 um, five tool changes (Table 1); k1/B near 2 (mm/min)/um."""
    given = datasets.read_runs(datasets.bundled("clm2023_end_milling"))
    law = fit.load_law(given)
    assert (law.form, law.response, law.names) == ("feed_line", "fm", ("fm0", "slope"))
    held = given.values("I") == 0.24
    ols = OLS(given.values("fm")[held], np.column_stack([np.ones(7), given.values("VB")[held]])).fit()
    np.testing.assert_allclose(law.params, ols.params, rtol=1e-10)
    np.testing.assert_allclose(law.bse, ols.bse, rtol=1e-10)
    assert law.params["slope"] / -1000 == pytest.approx(1.97, abs=0.01)
    through_1000 = np.sum((1000 - law.observed) * law.X[:, 0]) / np.sum(law.X[:, 0] ** 2)
    assert through_1000 / 1000 == pytest.approx(1.99, abs=0.005)
    (note,) = law.notes
    assert note.startswith("eq. 14 is refused: B comes out as -5.55e-06 A/(mm/min)")
    assert "on the 7 rows held at 0.24 A (1 others not used)" in note


def test_slot_milling_has_a_held_current_alone():
    law = fit.load_law(datasets.read_runs(datasets.bundled("clm2023_slot_milling")))
    assert (law.form, law.nobs) == ("feed_line", 5)
    assert law.notes[0].startswith("the current is held, so it cannot be a response")
    assert "5 rows held at 0.24 A. It is true at 0.24 A alone." in law.notes[0]
    assert law.params["slope"] == pytest.approx(-540, rel=0.03)  # 100/185 by its two printed points


@pytest.mark.parametrize(("wobble", "form"), [(0.009, "feed_line"), (0.011, "load_line")])
def test_a_current_within_one_per_cent_is_held(wobble, form):
    """A load held by the controller stays within 1 % of its reference (the paper's own regulation)."""
    VB = np.linspace(0, 0.2, 9)
    current = 0.24 * (1 + wobble * np.array([1, 0, -1, 0, 1, 0, -1, 0, 0]))
    fm = (current - 0.1158 - 0.2226 * VB) / 1.2416e-4
    assert fit.load_law(runs(fm=fm, VB=VB, I=current)).form == form


@pytest.mark.parametrize("seed", range(3))
def test_a_good_line_is_statsmodels_ols(seed):
    columns = line(seed=seed)
    law = fit.load_law(runs(**columns))
    ols = OLS(columns["I"], np.column_stack([np.ones(15), columns["fm"], columns["VB"]])).fit(method="qr")
    np.testing.assert_allclose(law.params, ols.params, rtol=1e-9)
    np.testing.assert_allclose(law.bse, ols.bse, rtol=1e-9)
    np.testing.assert_allclose(law.conf_int(), ols.conf_int(), rtol=1e-8)
    np.testing.assert_allclose(law.tvalues, ols.tvalues, rtol=1e-9)
    assert law.rsquared == pytest.approx(ols.rsquared, rel=1e-9)
    assert law.fvalue == pytest.approx(ols.fvalue, rel=1e-9)
    assert (law.form, law.error, law.scale_unit, law.alternative) == ("load_line", "additive", "A", None)
    assert (law.units["I"], law.units["fm"], law.units["VB"]) == ("A", "mm/min", "mm")
    band = law.predict({"fm": 700, "VB": 0.1}, "prediction").to_frame()
    theirs = ols.get_prediction([[1, 700, 0.1]]).summary_frame()[["mean", "obs_ci_lower", "obs_ci_upper"]]
    np.testing.assert_allclose(band[["value", "low", "high"]], theirs, rtol=1e-9)


def test_a_sharp_tool_and_an_idle_spindle_are_kept():
    """Wear 0 and a current that is zero or reads negative are measurements on a line."""
    columns = line(noise=0)
    columns["VB"][0] = 0.0
    columns["I"] = columns["I"] - 0.2
    law = fit.load_law(runs(**columns))
    assert law.nobs == 15
    assert (columns["I"] < 0).any()


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (
            {"B": -1e-4},
            r"load line refused: B comes out as -\S+ A/\(mm/min\), but I rises with fm.*Vary feed",
        ),
        ({"k1": -0.3}, r"load line refused: k1 comes out as -\S+ A/\(mm\), but I rises with VB"),
    ],
)
def test_a_wrong_sign_is_refused_with_the_reason(wrong, says):
    with pytest.raises(errors.FitError, match=says):
        fit.load_law(runs(**line(**wrong)))


def test_feed_that_rises_with_wear_at_held_current_is_refused():
    VB = np.linspace(0, 0.2, 6)
    with pytest.raises(errors.FitError, match=r"current is held.*wrong sign too: fm does not fall with VB"):
        fit.load_law(runs(fm=600 + 500 * VB, VB=VB, I=[0.24] * 6))


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        (line() | {"VB": [0.1] * 15}, r"load line I on fm and VB: VB is constant \(0.1 in all 15 rows\)"),
        (line() | {"fm": [700.0] * 15}, r"fm is constant \(700 in all 15 rows\)\. Add runs in which both"),
        (
            {"fm": [700.0, 600, 500], "VB": [0.1] * 3, "I": [0.24] * 3},
            r"the current is held.*fails too: VB is constant \(0.1 in all 3 rows\)",
        ),
        ({"fm": [700.0, 600], "VB": [0, 0.1], "I": [0.2, 0.3]}, "2 usable rows for 3 parameters"),
        ({"fm": [700.0], "VB": [0.1], "I": [0.24]}, "1 usable row for 2 parameters"),
        ({"fm": [700.0, 6], "VB": [0, 0.1], "I": [np.nan] * 2}, r"no usable row \(2 rows: I missing\)"),
    ],
)
def test_data_that_say_too_little_are_refused(columns, says):
    with pytest.raises(errors.FitError, match=says):
        fit.load_law(runs(**columns))


def test_wear_and_feed_that_move_together_are_named():
    columns = line()
    columns["VB"] = 0.3 - 2e-4 * columns["fm"]
    with pytest.raises(errors.FitError, match=r"VB is an exact sum of others \(-0.0002 fm\)"):
        fit.load_law(runs(**columns))


def test_a_missing_column_is_named():
    with pytest.raises(errors.UsageError, match="no column 'VB'; there are fm, I"):
        fit.load_law(runs(fm=[500.0, 600], I=[0.2, 0.3]))


def test_other_columns_may_play_the_parts():
    columns = line()
    given = runs(fm=columns["fm"], AW=columns["VB"], P=columns["I"])
    law = fit.load_law(given, "P", wear="AW")
    np.testing.assert_allclose(law.params, fit.load_law(runs(**columns)).params, rtol=1e-12)
    assert law.factors == ("fm", "AW")
