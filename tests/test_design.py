"""Central composite designs: counts, range ends, geometric spacing, orthogonality, run order."""

import numpy as np
import pytest
from fitmodels.core.errors import UsageError
from fitmodels.datasets.design import central_composite, round_significant
from hypothesis import given, settings
from hypothesis import strategies as st

TURNING = {"V": (50.0, 200.0), "f": (0.06, 0.6), "d": (1.5, 3.0)}
EXACT = 1e-12  # a few roundings of doubles of order 1

ends = st.tuples(st.floats(1e-3, 1e3), st.floats(1.1, 100.0)).map(lambda p: (p[0], p[0] * p[1]))
counts = {"centre": st.integers(0, 5), "axial_repeats": st.integers(1, 3)}


def coded(plan):
    return plan[[c for c in plan.columns if c.endswith("_coded")]].to_numpy()


def test_the_published_plan_has_24_edges():
    plan = central_composite(TURNING, seed=1)
    assert plan["point"].value_counts().to_dict() == {"factorial": 8, "centre": 4, "axial": 12}
    assert list(plan.columns) == ["run", "edge", "point", "V_coded", "f_coded", "d_coded", "V", "f", "d"]


def test_axial_points_stand_exactly_on_the_range_ends_twice():
    plan = central_composite(TURNING, seed=1)
    for factor, (low, high) in TURNING.items():
        assert plan[factor].min() == low
        assert plan[factor].max() == high
        assert (plan[factor] == low).sum() == (plan[factor] == high).sum() == 2
        assert plan.loc[plan[factor] == low, f"{factor}_coded"].to_numpy() == pytest.approx(-2, abs=EXACT)
        assert plan.loc[plan[factor] == high, f"{factor}_coded"].to_numpy() == pytest.approx(2, abs=EXACT)


def test_levels_are_spaced_geometrically():
    levels = np.unique(central_composite({"V": (50.0, 800.0)}, seed=1, digits=None)["V"].round(9))
    assert levels == pytest.approx([50, 100, 200, 400, 800])


def test_run_order_is_a_seeded_permutation_of_the_edges():
    first, again, other = (central_composite(TURNING, seed=s) for s in (1, 1, 2))
    labels = [f"E{i:02d}" for i in range(1, 25)]
    assert first["run"].tolist() == list(range(1, 25))
    assert sorted(first["edge"]) == labels
    assert first["edge"].tolist() != labels
    assert first["edge"].tolist() != other["edge"].tolist()
    assert first.equals(again)


def test_only_the_order_depends_on_the_seed():
    first, other = (central_composite(TURNING, seed=s).sort_values("edge", ignore_index=True) for s in (1, 2))
    assert first.drop(columns="run").equals(other.drop(columns="run"))


def test_rounded_levels_carry_their_own_coded_level():
    plan = central_composite(TURNING, seed=1, digits=2)
    assert set(plan["V"]) == {50, 71, 100, 140, 200}
    expected = 2 * np.log(plan["V"] / 100) / np.log(2)
    assert plan["V_coded"].to_numpy() == pytest.approx(expected.to_numpy(), abs=EXACT)
    assert abs(plan["V_coded"]).max() == pytest.approx(2)
    assert not np.isin(plan.loc[plan["V"] == 71, "V_coded"], (-1.0,)).any()


def test_range_ends_are_kept_though_they_have_more_digits():
    plan = central_composite({"f": (0.12345678, 0.87654321)}, seed=1, digits=2)
    assert (plan["f"].min(), plan["f"].max()) == (0.12345678, 0.87654321)


def test_coarse_rounding_never_leaves_the_range():
    plan = central_composite({"f": (0.16, 0.18)}, seed=1, digits=1)
    assert plan["f"].between(0.16, 0.18).all()


@settings(max_examples=40, deadline=None)
@given(st.lists(ends, min_size=1, max_size=6), st.floats(1.0, 3.0), counts["centre"], counts["axial_repeats"])
def test_coded_columns_are_balanced_and_orthogonal(ranges, alpha, centre, axial_repeats):
    named = {f"x{i}": r for i, r in enumerate(ranges)}
    k = len(ranges)
    plan = central_composite(named, alpha=alpha, centre=centre, axial_repeats=axial_repeats, seed=3, digits=None)
    x = coded(plan)
    assert len(plan) == 2**k + centre + 2 * k * axial_repeats
    assert x.sum(axis=0) == pytest.approx(0, abs=1e-9)
    assert x.T @ x == pytest.approx(np.eye(k) * (2**k + 2 * axial_repeats * alpha**2), abs=1e-9)


def test_rounding_to_four_digits_leaves_the_columns_nearly_orthogonal():
    x = coded(central_composite(TURNING, seed=1))
    correlation = np.corrcoef(x.T)
    assert abs(correlation - np.eye(3)).max() < 1e-3


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        ({"V": (200.0, 50.0)}, ["V", "200 to 50", "below"]),
        ({"V": (50.0, 50.0)}, ["V", "50 to 50", "constant"]),
        ({"f": (0.0, 0.6)}, ["f", "0 to 0.6", "positive"]),
        ({"f": (-0.1, 0.6)}, ["f", "-0.1", "positive"]),
        ({"f": (0.1, float("nan"))}, ["f", "nan"]),
        ({}, ["0 factors", "1 to 6"]),
        ({f"x{i}": (1.0, 2.0) for i in range(7)}, ["7 factors", "1 to 6"]),
        ({"edge": (1.0, 2.0)}, ["'edge'", "rename"]),
    ],
)
def test_bad_ranges_are_told_in_a_sentence(ranges, words):
    with pytest.raises(UsageError) as error:
        central_composite(ranges, seed=1)
    assert all(word in str(error.value) for word in words)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"alpha": 0.9}, "alpha 0.9"),
        ({"centre": -1}, "centre -1"),
        ({"axial_repeats": 0}, "axial_repeats 0"),
        ({"digits": 0}, "digits 0"),
    ],
)
def test_bad_counts_are_told_in_a_sentence(options, word):
    with pytest.raises(UsageError, match=word):
        central_composite(TURNING, seed=1, **options)


@given(st.floats(1e-6, 1e6), st.integers(1, 8))
def test_rounding_is_idempotent_and_close(value, digits):
    once = round_significant(value, digits)
    assert round_significant(once, digits) == once
    assert float(once) == pytest.approx(value, rel=0.5 * 10.0 ** (1 - digits) * (1 + 1e-9))
