"""The power law as an estimator of scikit-learn, held to scikit-learn's own checks."""

import sys

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core import errors

pytest.importorskip("sklearn")

from sklearn.exceptions import NotFittedError
from sklearn.model_selection import GroupKFold, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer
from sklearn.utils.estimator_checks import check_estimator

FACTORS = ["V", "f", "d", "t"]


@pytest.fixture(scope="module")
def runs():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


@pytest.fixture(scope="module")
def rows(runs):
    return runs.to_frame()


@pytest.mark.slow
@pytest.mark.parametrize("error", ["multiplicative", "additive"])
def test_all_checks_of_scikit_learn_pass(error):
    results = check_estimator(fit.PowerLawRegressor(error=error, floor=1e-3), on_fail=None, on_skip=None)
    assert [r["check_name"] for r in results if r["status"] == "failed"] == []
    assert sum(r["status"] == "passed" for r in results) > 45


def test_without_a_floor_all_that_fails_are_checks_on_zeros():
    """Scikit-learn's tag for positive data lets zeros through, of which a power law has no logarithm."""
    results = check_estimator(fit.PowerLawRegressor(), on_fail=None, on_skip=None)
    failed = [r for r in results if r["status"] == "failed"]
    assert failed
    assert all("X holds 0, and a power law needs values above zero" in str(r["exception"]) for r in failed)


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
def test_it_fits_what_power_law_fits(runs, rows, error):
    law = fit.power_law(runs, "AW", FACTORS, error=error)
    model = fit.PowerLawRegressor(error=error).fit(rows[FACTORS], rows["AW"], edge=rows["edge"])
    np.testing.assert_array_equal(model.coef_, law.params[FACTORS])
    assert model.intercept_ == law.theta[0]
    np.testing.assert_array_equal(model.law_.bse, law.bse)  # by edge, as there
    np.testing.assert_array_equal(model.predict(rows[FACTORS]), law.fitted)
    new = rows[FACTORS].iloc[:5]
    for kind in ("mean", "prediction"):
        expected = law.predict(new, kind).to_frame()[["low", "high"]]
        np.testing.assert_allclose(model.predict_interval(new, kind), expected, rtol=1e-12)


def test_score_is_r2_in_the_unit_of_the_response(rows):
    model = fit.PowerLawRegressor().fit(rows[FACTORS], rows["AW"])
    y = rows["AW"].to_numpy()
    rest = ((y - model.predict(rows[FACTORS])) ** 2).sum() / ((y - y.mean()) ** 2).sum()
    assert model.score(rows[FACTORS], y) == pytest.approx(1 - rest, rel=1e-12)


def test_it_works_in_a_pipeline_and_in_folds_by_edge(rows):
    model = make_pipeline(FunctionTransformer(lambda X: X * [1 / 60, 1, 1, 1]), fit.PowerLawRegressor())
    scores = cross_val_score(model, rows[FACTORS], rows["AW"], groups=rows["edge"], cv=GroupKFold(4))
    assert scores.min() > 0.5
    model.fit(rows[FACTORS], rows["AW"])
    plain = fit.PowerLawRegressor().fit(rows[FACTORS], rows["AW"])
    np.testing.assert_allclose(model[-1].coef_, plain.coef_, rtol=1e-9)  # a unit changes the constant alone


def test_a_factor_that_stands_still_has_no_exponent(rows):
    held = rows[FACTORS].assign(d=2.5)
    model = fit.PowerLawRegressor().fit(held, rows["AW"])
    assert model.coef_[2] == 0
    assert model.law_.left_out[0].factor == "d"


def test_readings_below_the_floor_are_taken_as_the_floor():
    X = np.array([[1.0], [2.0], [4.0], [0.0]])
    y = np.array([2.0, 4.0, 8.0, 1.0])
    model = fit.PowerLawRegressor(floor=0.5).fit(X, y)
    np.testing.assert_allclose(model.coef_, [1.0], rtol=1e-12)
    assert model.predict([[0.1]])[0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("model", "X", "y", "said"),
    [
        (fit.PowerLawRegressor(), [[1.0], [0.0], [2.0]], [1.0, 2.0, 3.0], "X holds 0.* or give floor"),
        (fit.PowerLawRegressor(), [[1.0], [3.0], [2.0]], [1.0, 0.0, 3.0], "y holds 0.* or give floor"),
        (fit.PowerLawRegressor(floor=0.1), [[1.0], [-3.0], [2.0]], [1.0, 2.0, 3.0], "Negative values in data: X"),
        (fit.PowerLawRegressor(floor=0.0), [[1.0], [3.0], [2.0]], [1.0, 2.0, 3.0], "floor 0.0: .* above zero"),
        (fit.PowerLawRegressor(), [[1.0], [3.0], [2.0]], [2.0, 2.0, 2.0], "nothing to explain"),
        (fit.PowerLawRegressor(error="odd"), [[1.0], [3.0], [2.0]], [1.0, 2.0, 3.0], "'multiplicative' or 'additive'"),
        (fit.PowerLawRegressor(response="x"), pd.DataFrame({"x": [1.0, 3.0, 2.0]}), [1.0, 2.0, 3.0], "called 'x'"),
    ],
    ids=["zero X", "zero y", "negative X", "floor at zero", "constant y", "unknown error", "name taken"],
)
def test_what_cannot_be_fitted_is_a_value_error_with_its_cure(model, X, y, said):
    with pytest.raises(ValueError, match=said):
        model.fit(X, y)


@pytest.mark.parametrize("asked", ["predict", "predict_interval"])
def test_before_fit_it_says_so(asked):
    with pytest.raises(NotFittedError):
        getattr(fit.PowerLawRegressor(), asked)([[1.0]])


def test_without_scikit_learn_the_package_says_how_to_get_it(monkeypatch):
    monkeypatch.delitem(sys.modules, "fitmodels.fit.estimator")
    monkeypatch.delattr(fit, "estimator")
    for name in [name for name in sys.modules if name == "sklearn" or name.startswith("sklearn.")]:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(errors.UsageError, match=r"pip install 'fitmodels\[sklearn\]'"):
        _ = fit.PowerLawRegressor
