"""Central composite designs: counts, range ends, geometric spacing, orthogonality, run order."""

from itertools import combinations

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


def second_order(x):
    k = x.shape[1]
    products = [x[:, i] * x[:, j] for i, j in combinations(range(k), 2)]
    return np.column_stack([np.ones(len(x)), x, np.square(x), *products])


@pytest.mark.parametrize("k", [2, 3, 4, 5])
@pytest.mark.parametrize("options", [{}, {"axial_repeats": 1}, {"axial_repeats": 1, "half": True}])
def test_a_rotatable_design_predicts_equally_well_in_all_directions(k, options):
    if options.get("half") and k < 5:  # its second-order law cannot be fitted
        return
    named = {f"x{i}": (1.0, 10.0) for i in range(k)}
    z = second_order(coded(central_composite(named, alpha="rotatable", seed=1, digits=None, **options)))
    M = np.linalg.inv(z.T @ z)
    sphere = np.random.default_rng(1).normal(size=(200, k))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    variance = np.einsum("ij,jk,ik->i", second_order(sphere), M, second_order(sphere))
    assert np.ptp(variance) < 1e-9 * variance.mean()


@pytest.mark.parametrize(
    ("k", "alpha", "options", "distance"),
    [
        (3, "face-centred", {}, 1.0),
        (3, "rotatable", {"axial_repeats": 1}, 1.682),  # Montgomery 2017, Design and Analysis, section 11.4
        (4, "rotatable", {"axial_repeats": 1}, 2.0),
        (5, "rotatable", {"axial_repeats": 1, "half": True}, 2.0),
        (3, "orthogonal", {"axial_repeats": 1, "centre": 1}, 1.215),  # Box & Wilson 1951
        (4, "orthogonal", {"axial_repeats": 1, "centre": 1}, 1.414),
        (2, "orthogonal", {"axial_repeats": 1, "centre": 6, "blocks": 2}, 1.414),  # Box & Hunter 1957, table 3
        (3, "orthogonal", {"axial_repeats": 1, "centre": 6, "blocks": 3}, 1.633),
        (4, "orthogonal", {"axial_repeats": 1, "centre": 6, "blocks": 3}, 2.0),
    ],
)
def test_named_distances_are_those_of_the_textbooks(k, alpha, options, distance):
    named = {f"x{i}": (1.0, 10.0) for i in range(k)}
    plan = central_composite(named, alpha=alpha, seed=1, digits=None, **options)
    assert abs(coded(plan)).max() == pytest.approx(distance, abs=5e-4)
    if alpha == "orthogonal" and "blocks" not in options:
        squares = np.square(coded(plan))
        assert np.corrcoef(squares.T) == pytest.approx(np.eye(k), abs=1e-9)


@pytest.mark.parametrize(("k", "blocks"), [(2, 2), (3, 2), (3, 3), (4, 3), (4, 5), (5, 5)])
def test_orthogonal_blocks_leave_every_coefficient_as_it_is(k, blocks):
    named = {f"x{i}": (1.0, 10.0) for i in range(k)}
    plan = central_composite(named, alpha="orthogonal", blocks=blocks, centre=2 * blocks, seed=1, digits=None)
    z, shift = second_order(coded(plan)), np.array([0.0, 3.0, -2.0, 5.0, 1.0])[plan["block"] - 1]
    y = np.random.default_rng(1).normal(size=len(z))
    words = [words for words in plan.attrs["notes"] if "cannot be separated from" in words]
    assert any("Blocks are orthogonal to factors and squares" in note for note in plan.attrs["notes"])
    names = [*named, *(f"{a}²" for a in named), *(f"{a}·{b}" for a, b in combinations(named, 2))]
    with_shift, without = (np.linalg.lstsq(z, values, rcond=None)[0][1:] for values in (y + shift, y))
    lost = [name for name, a, b in zip(names, with_shift, without, strict=True) if abs(a - b) > 1e-9]
    assert all(f" {name}," in words[0].replace(".", ",") for name in lost)
    assert all("·" in name for name in lost)  # never a factor or a square


def test_blocks_are_cut_one_after_the_other_each_with_a_centre():
    plan = central_composite(TURNING, blocks=3, seed=4)
    assert plan["block"].is_monotonic_increasing
    assert set(plan.loc[plan["point"] == "centre", "block"]) == {1, 2, 3}
    assert set(plan.loc[plan["point"] == "axial", "block"]) == {3}
    with pytest.raises(UsageError, match="one edge at the centre of each"):
        central_composite(TURNING, blocks=3, centre=2, seed=1)
    with pytest.raises(UsageError, match="1, 2, 3 or 5"):
        central_composite(TURNING, blocks=4, seed=1)


def test_half_of_the_factorial_states_its_aliases():
    three = central_composite(TURNING, half=True, seed=1)
    assert (three["point"] == "factorial").sum() == 4
    assert "V = f·d; f = V·d; d = V·f" in " ".join(three.attrs["notes"])
    four = central_composite({**TURNING, "t": (4.0, 16.0)}, half=True, seed=1)
    assert "Aliased, only the sum can be estimated: V·f = d·t; V·d = f·t; V·t = f·d." in four.attrs["notes"]
    five = central_composite({**TURNING, "t": (4.0, 16.0), "D": (20.0, 80.0)}, half=True, seed=1, digits=None)
    assert np.linalg.matrix_rank(second_order(coded(five))) == 21  # all of a second-order law
    with pytest.raises(UsageError, match="half of a factorial of 2 factors"):
        central_composite({"V": (1.0, 2.0), "f": (1.0, 2.0)}, half=True, seed=1)


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
def test_bad_ranges_are_reported_in_a_sentence(ranges, words):
    with pytest.raises(UsageError) as error:
        central_composite(ranges, seed=1)
    assert all(word in str(error.value) for word in words)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"alpha": 0.9}, "alpha 0.9"),
        ({"alpha": "round"}, "alpha 'round'"),
        ({"alpha": "rotatable", "axial_repeats": 9}, "rotatable alpha is 0.971"),
        ({"centre": -1}, "centre -1"),
        ({"axial_repeats": 0}, "axial_repeats 0"),
        ({"digits": 0}, "digits 0"),
    ],
)
def test_bad_counts_are_reported_in_a_sentence(options, word):
    with pytest.raises(UsageError, match=word):
        central_composite(TURNING, seed=1, **options)


@given(st.floats(1e-6, 1e6), st.integers(1, 8))
def test_rounding_is_idempotent_and_close(value, digits):
    once = round_significant(value, digits)
    assert round_significant(once, digits) == once
    assert float(once) == pytest.approx(value, rel=0.5 * 10.0 ** (1 - digits) * (1 + 1e-9))
