"""Many rows: what is condensed, thinned or looked at in part gives what all rows give."""

import numpy as np
import pandas as pd
import pytest
from fitmodels.datasets import runs_from_frame
from fitmodels.fit.law_figures import MOST, normal_quantiles, observed_against_predicted, residuals
from fitmodels.fit.laws import LawForm
from fitmodels.fit.nonlinear import BLOCK, Condensed
from fitmodels.fit.regression import power_law
from fitmodels.fit.rows import SOME, identifiable, select
from scipy.optimize import curve_fit


def wear(n, seed=0, noise=0.1):
    rng = np.random.default_rng(seed)
    V, t = rng.uniform(50, 200, n), rng.uniform(1, 20, n)
    return pd.DataFrame({"V": V, "t": t, "AW": 0.01 * V**0.5 * t**0.25 * np.exp(noise * rng.normal(size=n))})


@pytest.mark.parametrize("n", [3, 50, BLOCK, BLOCK + 1, 3 * BLOCK + 7])
def test_the_triangle_holds_what_a_step_needs(n):
    frame, law = wear(n), LawForm("power", "AW", ("V", "t"))
    Z, y, theta = law.design(frame[["V", "t"]].to_numpy()), frame["AW"].to_numpy(), np.array([-4.0, 0.4, 0.2])
    J, r = law.gradient(theta, Z) / 0.3, (law.response_at(theta, Z) - y) / 0.3
    condensed = Condensed(law, Z, y, 0.3)
    R, q = condensed.jacobian(theta), condensed.residuals(theta)
    assert len(R) == len(q) == min(n, 4)
    np.testing.assert_allclose(R.T @ R, J.T @ J, rtol=1e-12)
    np.testing.assert_allclose(R.T @ q, J.T @ r, rtol=1e-12)
    assert q @ q == pytest.approx(r @ r, rel=1e-12)


def test_a_step_to_nowhere_is_infinite_and_warns_of_nothing():
    frame, law = wear(10), LawForm("power", "AW", ("V", "t"))
    condensed = Condensed(law, law.design(frame[["V", "t"]].to_numpy()), frame["AW"].to_numpy(), 1.0)
    assert not np.isfinite(condensed.residuals(np.array([800.0, 0.0, 0.0]))).any()


def test_natural_units_over_several_blocks_are_curve_fit():
    frame = wear(3 * BLOCK)
    law = power_law(runs_from_frame(frame), "AW", ["V", "t"], error="additive")
    V, t, AW = frame.to_numpy().T

    def model(X, c0, a, b):
        return c0 * X[0] ** a * X[1] ** b

    def gradient(X, c0, a, b):
        R = model(X, c0, a, b)
        return np.column_stack([R / c0, R * np.log(X[0]), R * np.log(X[1])])

    params, cov = curve_fit(model, (V, t), AW, p0=law.params, jac=gradient, xtol=1e-12, ftol=1e-12)
    np.testing.assert_allclose(law.params, params, rtol=1e-6)
    np.testing.assert_allclose(law.bse, np.sqrt(np.diag(cov)), rtol=1e-5)


def test_a_dependence_among_many_rows_is_seen():
    """Also where the rows that are looked at first show none of it, or nothing else."""
    frame = wear(3 * SOME)
    V, t = frame["V"].to_numpy(), frame["t"].to_numpy()
    none = np.empty((len(V), 0))
    hidden = V.copy()
    hidden[1] *= 3  # the only row that tells it from V is not among those looked at first
    for column, kept in ((V**0.5 * t, 2), (V**0.5 * t * (1 + 1e-3 * np.sin(t)), 3), (hidden, 3)):
        keep, _ = identifiable(["V", "t", "x"], np.log(np.column_stack([V, t, column])), none, logs=True)
        assert len(keep) == kept


def test_copies_among_many_rows_are_seen():
    frame = pd.concat([wear(500)] * 3, ignore_index=True)
    assert select(runs_from_frame(frame), "AW", ["V", "t"]).repeats == 3
    once_more = pd.concat([frame, frame.iloc[[7]]], ignore_index=True)
    assert select(runs_from_frame(once_more), "AW", ["V", "t"]).repeats == 1


def test_a_panel_thins_its_points_and_says_so():
    few, many = (power_law(runs_from_frame(wear(n)), "AW", ["V", "t"]) for n in (MOST, 2 * MOST))
    for panel in (observed_against_predicted, residuals, normal_quantiles):
        for law in (few, many):
            (points,) = [line for line in panel(law).lines if line.get_marker() == "o"]
            assert len(points.get_xdata()) == MOST
    assert f"{MOST} of {2 * MOST} points shown" in residuals(many).texts[-1].get_text()
    assert not any("shown" in text.get_text() for text in residuals(few).texts)


def test_a_law_without_residuals_shows_none():
    """Neither where rows equal parameters nor where the law meets every row but for rounding."""
    for frame, why in ((wear(3), "3 rows fix"), (wear(20, noise=0), "fits every row")):
        law = power_law(runs_from_frame(frame), "AW", ["V", "t"])
        for panel in (residuals, normal_quantiles):
            ax = panel(law)
            assert not ax.lines
            assert why in ax.texts[0].get_text()
