"""The region of a design: leverage as statsmodels has it, a region and not a box, and the same from plain facts."""

import json

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core import errors
from fitmodels.datasets import region
from hypothesis import given, settings
from hypothesis import strategies as st
from statsmodels.regression.linear_model import OLS
from statsmodels.stats.outliers_influence import OLSInfluence

EXACT = 1e-9
FACTORS = ["V", "f", "d", "t"]
CORNER = {"V": 200.0, "f": 0.6, "d": 3.0, "t": 8.0}


def bundled():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


def law(**options):
    return fit.power_law(bundled(), "AW", FACTORS, **options)


def points(fitted):
    return {name: fitted.X[:, j] for j, name in enumerate(fitted.factors)}


DESIGN = law()


def hat(Z):
    return OLSInfluence(OLS(np.arange(len(Z)) % 3.0, Z).fit()).hat_matrix_diag


def test_leverage_of_rows_is_the_hat_value():
    fitted = law(edge=None)
    ours = fitted.region
    np.testing.assert_allclose(ours.leverage(points(fitted)), hat(fitted.formula.design(fitted.X)), rtol=1e-7)
    assert ours.spaces[0].of == "rows"
    assert ours.largest_leverage == pytest.approx(hat(fitted.formula.design(fitted.X)).max(), rel=1e-7)


def test_leverage_of_edge_settings_is_the_hat_value_of_one_row_an_edge():
    fitted = law()
    ours, edges = fitted.region, bundled().data.groupby("edge")[["V", "f", "d"]].first()
    expected = hat(np.column_stack([np.ones(24), np.log(edges)]))
    np.testing.assert_allclose(ours.leverage(dict(edges.items()) | {"t": 8.0}), expected, rtol=1e-7)
    assert [space.of for space in ours.spaces] == ["edge settings", "rows"]
    rows = region.leverages(ours.facts(), fitted.X)[:, 1]
    np.testing.assert_allclose(rows, hat(fitted.formula.design(fitted.X)), rtol=1e-7)


def test_the_corner_of_the_axial_box_is_outside():
    ours = law().region
    assert not ours.inside(CORNER)[0]
    assert ours.leverage(CORNER)[0] > 2 * ours.largest_leverage
    assert ours.coded_radius({"V": 200.0, "f": 0.6, "d": 3.0, "t": np.exp(ours.centre[3])})[0] == pytest.approx(3**0.5)
    assert ours.words(CORNER).startswith("outside: leverage 0.54 among edge settings, 2.6 times the design's largest")
    low_corner = {"V": 70.0, "f": 0.1, "d": 1.8, "t": 8.0}  # near a factorial point
    assert ours.inside(low_corner)[0]


def test_every_row_of_the_design_is_inside():
    for response, factors in (("AW", FACTORS), ("P", [*FACTORS, "AW"])):
        fitted = fit.power_law(bundled(), response, factors)
        assert fitted.region.inside(points(fitted)).all()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 10**6), st.floats(0.01, 1)), min_size=1, max_size=5))
def test_between_points_of_the_design_is_inside(mixture):
    rows = np.array([i for i, _ in mixture]) % DESIGN.nobs
    weights = np.array([w for _, w in mixture])
    x = np.exp(weights / weights.sum() @ np.log(DESIGN.X[rows]))
    assert DESIGN.region.inside(dict(zip(FACTORS, x, strict=True)))[0]


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-2, 2), min_size=4, max_size=4))
def test_the_facts_alone_tell_the_same(u):
    ours = DESIGN.region
    facts = json.loads(json.dumps(ours.facts()))
    x = np.exp(np.array(ours.centre) + np.array(u) * ours.half_range)
    named = dict(zip(FACTORS, x, strict=True))
    assert region.inside(facts, x) == ours.inside(named)[0]
    assert region.leverages(facts, x)[0] == ours.leverage(named)[0]
    assert region.radius(facts, x) == pytest.approx(np.linalg.norm(u), abs=1e-9)
    assert ours.words(named).startswith("inside" if ours.inside(named)[0] else "outside")


def test_units_do_not_matter():
    runs = bundled()
    other = datasets.runs_from_frame(runs.data.drop(columns="point").assign(V=runs.data["V"] * 3.28))
    there = fit.power_law(other, "AW", FACTORS).region
    assert there.leverage(CORNER | {"V": 656.0})[0] == pytest.approx(DESIGN.region.leverage(CORNER)[0], rel=1e-9)


def test_words_name_the_factor_and_its_range():
    words = DESIGN.region.words({"V": 300.0, "f": 0.19, "d": 2.12, "t": 8.0})
    assert "V 300 m/min above the 50 to 200 that was cut" in words
    assert "inside: leverage 0.04" in DESIGN.region.words({"V": 100.0, "f": 0.19, "d": 2.12, "t": 8.0})
    with pytest.raises(errors.FitError, match="2 points"):
        DESIGN.region.words({"V": [300.0, 100.0], "f": 0.19, "d": 2.12, "t": 8.0})


def test_a_point_a_little_off_an_axial_one_is_inside():
    assert DESIGN.region.inside({"V": 200.0, "f": 0.2, "d": 2.0, "t": 8.0})[0]


def test_each_level_of_a_category_has_its_own_limit():
    rng = np.random.default_rng(1)
    V = np.exp(rng.uniform(4, 5, 22))
    material = np.array(["hard"] * 2 + ["soft"] * 20)
    frame = pd.DataFrame({"V": V, "material": material, "AW": 0.01 * V**0.5 * np.exp(rng.normal(0, 0.05, 22))})
    fitted = fit.power_law(datasets.runs_from_frame(frame), "AW", ["V"], by="material")
    ours = fitted.region
    assert ours.levels == ("hard", "soft")
    hard, soft = ours.spaces[0].largest
    assert hard > 2 * soft
    assert ours.inside({"V": V, "material": material}).all()
    Z = np.column_stack([np.ones(22), np.log(V), material == "soft"])
    np.testing.assert_allclose(ours.leverage({"V": V, "material": material}), hat(Z), rtol=1e-7)
    for bad, words in (({"V": 90.0}, "needs material"), ({"V": 90.0, "material": "x"}, "'x' is not among")):
        with pytest.raises(errors.FitError, match=words):
            ours.inside(bad)


def test_degenerate_designs():
    """One edge; as many rows as parameters; a line in its own units."""
    runs = bundled()
    one = fit.power_law(datasets.runs_from_frame(runs.data[runs.data["edge"] == "E01"]), "AW", FACTORS)
    assert [space.of for space in one.region.spaces] == ["rows"]
    assert one.region.inside({"t": [4.0, 400.0]}).tolist() == [True, False]
    two = fit.power_law(datasets.runs_from_frame(pd.DataFrame({"V": [50.0, 90.0], "AW": [0.1, 0.2]})), "AW", ["V"])
    assert two.region.largest_leverage == pytest.approx(1.0)
    assert two.region.inside({"V": [60.0, 49.0]}).tolist() == [True, False]
    fm, VB = np.array([100.0, 100, 200, 200]), np.array([-0.1, 0.1, 0.1, 0.2])
    frame = pd.DataFrame({"fm": fm, "VB": VB + 0.1, "I": 1 + 0.01 * fm + 2 * VB + [0.01, -0.01, 0.01, 0]})
    line = fit.load_law(datasets.runs_from_frame(frame)).region
    assert not line.logs
    assert line.inside({"fm": [150.0, 100.0], "VB": [0.15, 0.3]}).tolist() == [True, False]


@pytest.mark.parametrize(
    ("bad", "words"),
    [({"V": 100.0}, "needs f, d, t"), (CORNER | {"V": -3.0}, "V -3"), (CORNER | {"t": np.nan}, "t nan")],
)
def test_refusals(bad, words):
    with pytest.raises(errors.FitError, match=words):
        DESIGN.region.inside(bad)


def test_of_very_many_rows_a_choice_draws_the_same_region():
    rng = np.random.default_rng(8)
    edge = np.repeat(np.arange(30), 2000)
    V, f = (np.exp(rng.uniform(*np.log(ends), 30))[edge] for ends in ((50, 200), (0.1, 0.6)))
    t = rng.uniform(1, 20, len(edge))
    AW = 0.01 * V**0.5 * f**0.2 * t**0.3 * np.exp(0.1 * rng.normal(size=len(t)))
    frame = pd.DataFrame({"edge": [f"E{g}" for g in edge], "V": V, "f": f, "t": t, "AW": AW})
    place = fit.power_law(datasets.runs_from_frame(frame), "AW", ["V", "f", "t"]).region
    assert place.inside(frame[["V", "f", "t"]]).all()
    assert not place.inside({"V": [400.0], "f": [0.3], "t": [10.0]}).any()
