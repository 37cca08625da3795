"""Plain least squares against statsmodels' OLS and numpy's lstsq, and its refusals."""

import numpy as np
import pytest
from fitmodels.core.errors import FitError
from fitmodels.fit import linear
from hypothesis import given, settings
from hypothesis import strategies as st
from statsmodels.regression.linear_model import OLS

# Two backward-stable QR solvers on designs of condition below 100 differ by rounding alone.
SAME = 1e-10
REPRODUCIBLE = settings(derandomize=True, deadline=None, max_examples=25)


def design(seed, n=40, k=4):
    """A constant and k - 1 normal columns, with a response that they explain in part."""
    rng = np.random.default_rng(seed)
    X = np.column_stack([np.ones(n), rng.normal(size=(n, k - 1)) * 10.0 ** np.arange(k - 1) + 3])
    return X, X @ rng.normal(size=k) + rng.normal(size=n)


@pytest.mark.parametrize("seed", range(5))
def test_agrees_with_statsmodels(seed):
    X, y = design(seed)
    ours, theirs = linear(X, y), OLS(y, X).fit(method="qr")
    np.testing.assert_allclose(ours.params, theirs.params, rtol=SAME)
    np.testing.assert_allclose(ours.bse, theirs.bse, rtol=SAME)
    np.testing.assert_allclose(ours.cov_params, theirs.cov_params(), rtol=SAME, atol=1e-14)
    assert ours.rsquared == pytest.approx(theirs.rsquared, rel=SAME)
    assert ours.fvalue == pytest.approx(theirs.fvalue, rel=SAME)
    assert ours.rss == pytest.approx(theirs.ssr, rel=SAME)
    assert (ours.nobs, ours.df_model, ours.df_resid) == (40, theirs.df_model, theirs.df_resid)


@pytest.mark.parametrize("place", [0, 1, 3])
def test_the_constant_may_stand_in_any_column_and_be_any_number(place):
    X, y = design(11)
    moved = np.insert(X[:, 1:], place, -2.5, axis=1)
    ours, theirs = linear(moved, y), OLS(y, moved).fit(method="qr")
    np.testing.assert_allclose(ours.params, theirs.params, rtol=SAME)
    np.testing.assert_allclose(ours.bse, theirs.bse, rtol=SAME)
    assert ours.rsquared == pytest.approx(theirs.rsquared, rel=SAME)
    assert ours.fvalue == pytest.approx(theirs.fvalue, rel=SAME)


def test_without_a_constant_the_total_is_about_zero():
    X, y = design(12)
    ours, theirs = linear(X[:, 1:], y), OLS(y, X[:, 1:]).fit(method="qr")
    np.testing.assert_allclose(ours.params, theirs.params, rtol=SAME)
    np.testing.assert_allclose(ours.bse, theirs.bse, rtol=SAME)
    assert ours.tss == pytest.approx(float(y @ y), rel=SAME)
    assert ours.rsquared == pytest.approx(theirs.rsquared, rel=SAME)  # uncentred there too
    assert ours.df_model == 3


def test_a_far_origin_costs_no_digits():
    """Years, not years since 1950: centring takes the offset out before the QR sees it."""
    years = np.arange(1947.0, 1963.0)
    y = np.sin(years)
    near, far = (linear(np.column_stack([np.ones(16), x, x**2]), y) for x in (years - 1955, (years - 1955) + 1e6))
    assert far.params[2] == pytest.approx(near.params[2], rel=1e-5)
    assert far.rss == pytest.approx(near.rss, rel=1e-9)


def test_a_hundred_thousand_rows_agree_with_lstsq():
    X, y = design(3, n=100_000, k=6)
    np.testing.assert_allclose(linear(X, y).params, np.linalg.lstsq(X, y)[0], rtol=1e-9)


@REPRODUCIBLE
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(2, 5))
def test_repeating_all_rows_keeps_the_coefficients_and_shrinks_the_errors(seed, k, times):
    X, y = design(seed, n=20, k=k)
    once, often = linear(X, y), linear(np.tile(X, (times, 1)), np.tile(y, times))
    np.testing.assert_allclose(often.params, once.params, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(times * often.cov_unscaled, once.cov_unscaled, rtol=1e-9, atol=1e-14)
    assert (often.bse < once.bse).all()


@REPRODUCIBLE
@given(st.integers(0, 10**6), st.lists(st.floats(-18, 18), min_size=3, max_size=3))
def test_column_scales_and_row_order_do_not_matter(seed, powers):
    X, y = design(seed)
    factor = 10.0 ** np.array([0.0, *powers])
    order = np.random.default_rng(seed).permutation(len(y))
    plain, scaled = linear(X, y), linear((X * factor)[order], y[order])
    np.testing.assert_allclose(scaled.params * factor, plain.params, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(scaled.bse * factor, plain.bse, rtol=1e-8)


def test_as_many_rows_as_columns_is_solved_without_errors():
    fit = linear([[1, 2.0], [1, 5.0]], [3.0, 9.0])
    np.testing.assert_allclose(fit.params, [-1, 2], rtol=1e-14)
    assert fit.df_resid == 0
    assert np.isnan(fit.bse).all()
    assert np.isnan(fit.fvalue)


def test_an_exact_fit_and_a_constant_response():
    x = np.arange(8.0)
    X = np.column_stack([np.ones(8), x])
    assert linear(X, 3 + 2 * x).rsquared == pytest.approx(1, abs=1e-15)
    assert linear(X, np.full(8, 4.0)).rsquared == 1.0


@pytest.mark.parametrize(
    ("X", "y", "says"),
    [
        ([[1.0, 2, 3]], [1.0], "1 rows for 3 parameters: add rows or leave out 2 columns"),
        ([[1, 2.0], [1, 3.0]], [1.0], r"X has shape \(2, 2\) and y \(1,\)"),
        ([1.0, 2.0], [1.0, 2.0], r"X has shape \(2,\)"),
        (np.empty((0, 0)), [], "at least one row and one column"),
        ([[1, np.nan], [1, 2], [1, 3]], [1, 2, 3.0], "NaN or infinity"),
        ([[1, np.inf], [1, -np.inf], [1, 3]], [1, 2, 3.0], "NaN or infinity"),
        ([[1, 1], [1, 2], [1, 3]], [1, np.inf, 3.0], "NaN or infinity"),
        ([[1, 1, 3], [1, 2, 5], [1, 3, 7], [1, 5, 11.0]], [1, 2, 3, 4.0], "column 2 of X is a linear"),
        ([[1, 7], [1, 7], [1, 7.0]], [1, 2, 3.0], "column 1 of X is a linear"),
        ([[1, 0], [1, 0], [1, 0.0]], [1, 2, 3.0], "column 1 of X is a linear"),
        ([[1, 0.1], [1, 0.1], [1, 0.1]], [1, 2, 3.0], "column 1 of X is a linear"),
    ],
)
def test_what_cannot_be_fitted_is_refused_in_a_sentence(X, y, says):
    with pytest.raises(FitError, match=says):
        linear(X, y)
