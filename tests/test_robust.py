"""Huber's refit against statsmodels RLM, and the edge that a law leans on.

What R's ``MASS::rlm`` prints of the stack losses is in test_published_figures.py.
"""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.fit.checks.robust_fit import dominant_edge, robust
from statsmodels.robust.norms import HuberT
from statsmodels.robust.robust_linear_model import RLM

SETTLED = 1e-7  # statsmodels stops at a change of 1e-8 here


def cut(*, edges=16, per_edge=6, noise=0.05, seed=1, named=True, spoil=None, rows=()):
    rng = np.random.default_rng(seed)
    at, t = np.repeat(np.arange(edges), per_edge), np.tile(np.arange(1.0, per_edge + 1), edges)
    V = np.exp(rng.uniform(np.log(50), np.log(200), edges))[at]
    F = 30 * V**0.5 * t**0.4 * np.exp(noise * rng.normal(size=len(t)))
    if spoil is not None:
        F[at == spoil] *= 2.0
    F[list(rows)] *= 4.0
    frame = pd.DataFrame({"edge": [f"E{g}" for g in at], "V": V, "t": t, "F": F})
    return (
        datasets.runs_from_frame(frame) if named else datasets.runs_from_frame(frame.drop(columns="edge"), edge="none")
    )


def force(error="multiplicative", **kwargs):
    return fit.power_law(cut(**kwargs), "F", ["V", "t"], error=error)


def reference(law):
    Z, y = law.formula.design(law.X, law.shifts), np.log(law.observed)
    return RLM(y, Z, M=HuberT(t=1.345)).fit(conv="coefs", tol=1e-9, maxiter=500)


@pytest.mark.parametrize("rows", [(), (7,), (3, 40, 41, 90)])
def test_the_refit_is_statsmodels_rlm(rows):
    law = force(named=False, rows=rows)
    ours, theirs = robust(law), reference(law)
    np.testing.assert_allclose(ours.theta, theirs.params, rtol=SETTLED)
    np.testing.assert_allclose(ours.bse, theirs.bse, rtol=1e-6)
    np.testing.assert_allclose(ours.weights, theirs.weights, rtol=1e-6)
    assert ours.scale == pytest.approx(theirs.scale, rel=1e-6)


def test_outliers_move_the_plain_fit_and_are_named():
    ours = robust(force(rows=(3, 40, 41, 90), named=False))
    assert set(ours.lines[:4]) == {int(ours.law.lines[i]) for i in (3, 40, 41, 90)}
    assert abs(ours.theta[1] - 0.5) < abs(ours.law.theta[1] - 0.5)
    assert f"{len(ours.lines)} rows have a weight below 0.5" in ours.verdict
    assert list(ours.params.index) == ["c0", "V", "t"]


def test_clean_rows_are_left_alone():
    ours = robust(force())
    assert ours.concern == 0
    assert ours.verdict.startswith("The robust refit agrees")
    assert np.all(np.abs(ours.in_bse) < 1)


def test_in_natural_units_the_fixed_point_is_reached():
    """Weighted residuals are orthogonal to the gradient: the equation that defines Huber's estimate."""
    law = force("additive", rows=(3, 40))
    ours = robust(law)
    Z = law.formula.design(law.X)
    r = law.observed - law.formula.response_at(ours.theta, Z)
    J = law.formula.gradient(ours.theta, Z)
    np.testing.assert_allclose(J.T @ (ours.weights * r) / (np.linalg.norm(J, axis=0) * np.linalg.norm(r)), 0, atol=1e-7)
    assert ours.params["t"] == pytest.approx(0.4, abs=0.03)


def test_standard_errors_are_refits_without_each_edge():
    law = force(rows=(3,))
    Z, y, moved = law.formula.design(law.X), np.log(law.observed), []
    whole = robust(law)
    for name in law.edges.edges:
        kept = law.edge != name
        model = RLM(y[kept], Z[kept], M=HuberT(t=1.345))
        moved.append(model.fit(conv="coefs", tol=1e-9, maxiter=500).params - whole.theta)
    moved = np.array(moved)
    np.testing.assert_allclose(whole.cov_theta, 15 / 16 * moved.T @ moved, rtol=1e-5)


def test_a_spoilt_edge_dominates_and_is_named():
    law = force(spoil=5)
    found = dominant_edge(law)
    assert (found.edge, found.dominates, found.concern) == ("E5", True, 1)
    kept = law.edge != "E5"
    without = np.linalg.lstsq(law.formula.design(law.X)[kept], np.log(law.observed[kept]), rcond=None)[0]
    np.testing.assert_allclose(found.moved, without - law.theta, rtol=1e-7)
    assert f"Edge E5 dominates the law: without edge E5, {found.parameter} moves by" in found.verdict
    assert robust(law).dominant.edge == "E5"


def test_it_is_measured_by_the_law_without_it():
    law = force()
    found = dominant_edge(law)
    runs = cut()
    rest = fit.power_law(datasets.runs_from_frame(runs.data[runs.labels("edge") != found.edge]), "F", ["V", "t"])
    np.testing.assert_allclose(found.moved, rest.theta - law.theta, rtol=1e-7)
    np.testing.assert_allclose(found.in_bse, (rest.theta - law.theta) / rest.edges.bse, rtol=1e-6)
    assert not found.dominates


def test_few_edges_are_said_to_be_few():
    found = dominant_edge(force(edges=5, spoil=2))
    assert not found.dominates
    assert found.verdict.startswith("With 5 edges each of them has a large influence")


def three_rows():
    return fit.power_law(datasets.runs_from_frame(cut().data.iloc[[0, 8, 16]]), "F", ["V", "t"])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: force(noise=0.0), "fits every row exactly"),
        (lambda: force(noise=0.0, rows=(3, 40)), "at least half of the rows lie on the law exactly"),
        (lambda: three_rows(), "3 observations fix 3 parameters"),
    ],
)
def test_no_refit_says_why(make, words):
    assert words in str(robust(make()))


def test_one_edge_has_a_refit_but_no_dominant_edge():
    law = fit.power_law(cut(edges=1, per_edge=12), "F", ["t"])
    ours = robust(law)
    assert "1 edge for 1 parameter estimated between" in str(ours.dominant)
    np.testing.assert_allclose(ours.bse, reference(law).bse, rtol=1e-6)


def test_the_bundled_and_the_real_laws_stand(measurements):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    nasa = datasets.read_runs(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    laws = [
        fit.power_law(runs, "Fxz", ["V", "f", "d", "t", "AW"]),
        fit.power_law(nasa, "VB", ["t", "f", "d"], by="material"),
    ]
    for law, edge in zip(laws, ("E21", "3"), strict=True):
        ours = robust(law)
        assert (ours.concern, ours.dominant.concern, ours.dominant.edge) == (0, 0, edge)
