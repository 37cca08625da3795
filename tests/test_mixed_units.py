"""Edges with a condition in another unit: found by their wear, and not where there are none."""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.fit.checks.strata import split
from fitmodels.fit.checks.wrong_edges import mixed_units

LEVELS = {"V": (80, 120, 180), "f": (0.1, 0.2, 0.4), "d": (1, 1.5, 2.5)}
ENDS = {"V": (60, 200), "f": (0.08, 0.5), "d": (0.8, 3)}
TIMES = (2.0, 4.0, 7.0, 10.0, 14.0, 18.0)


def wear(seed, edges=24, grid=False, scatter=(0.052, 0.08)):
    """A test by the wear law of AC-2016; standard deviations of edges and rows as there."""
    rng = np.random.default_rng(seed)
    names = [f"E{i + 1:02d}" for i in range(edges)]
    if grid:
        all_of_them = np.array(np.meshgrid(*LEVELS.values())).reshape(3, -1).T
        X = all_of_them[rng.permutation(len(all_of_them))[:edges]].T
    else:
        X = np.exp([rng.uniform(*np.log(ends), edges) for ends in ENDS.values()])
    frame = pd.DataFrame({"edge": names, **dict(zip(LEVELS, X, strict=True))}).loc[np.repeat(range(edges), len(TIMES))]
    frame["t"] = np.tile(TIMES, edges)
    of_edge = np.repeat(rng.normal(0, scatter[0], edges), len(TIMES))
    noise = np.exp(of_edge + rng.normal(0, scatter[1], len(frame)))
    frame["AW"] = (
        0.00762 * frame["V"] ** 0.577 * frame["f"] ** 0.168 * frame["d"] ** 0.248 * frame["t"] ** 0.245 * noise
    )
    return frame.reset_index(drop=True)


def doubts(frame):
    units = {"V": "m/min", "f": "mm/rev", "d": "mm", "t": "min", "AW": "mm"}
    return datasets.runs_from_frame(frame.rename(columns={name: f"{name} [{u}]" for name, u in units.items()})).doubts


def by_response(frame):
    return [doubt for doubt in doubts(frame) if "the unit of th" in doubt.sentence]


def mixed(seed, role, factor, shifted, **how):
    frame = wear(seed, **how)
    frame.loc[frame["edge"].isin([f"E{number:02d}" for number in shifted]), role] *= factor
    return frame


@pytest.mark.parametrize(
    ("role", "factor", "edges", "least"),
    [("f", 1 / 25.4, (2, 9, 15, 20), 18), ("d", 1 / 25.4, (1, 12, 13), 18), ("V", 1 / 0.3048, (3, 4, 17), 10)],
)
def test_edges_in_another_unit_are_found(role, factor, edges, least):
    """Of 20 tests; simulated rates for 24 edges are above .9, and .77 for speeds that land inside the design.

    Of these a square of ln V explains some as well: then the checks of the law name both causes.
    """
    found = [doubts(mixed(seed, role, factor, edges)) for seed in range(20)]
    assert sum(any(role in doubt.columns for doubt in one) for one in found) >= least
    named = f"edges {', '.join(f'E{number:02d}' for number in edges)}: with {role}"
    assert any(doubt.sentence.startswith(named) for one in found for doubt in one)


@pytest.mark.parametrize("grid", [True, False])
def test_sound_files_are_not_doubted(grid):
    assert not [seed for seed in range(40) if by_response(wear(seed, grid=grid))]


def test_a_test_without_scatter_is_not_doubted():
    assert not by_response(wear(1, scatter=(0, 0)))


def test_a_single_edge_may_have_several_causes():
    sentence = by_response(mixed(3, "V", 1 / 0.3048, (7,)))[0].sentence
    assert sentence.startswith("edge E07: with V")
    assert "divided by 3.281 (sfm and m/min)" in sentence
    assert sentence.endswith("check the unit of this edge")


def test_few_edges_and_no_response_are_left_alone():
    assert not by_response(mixed(1, "f", 1 / 25.4, (2,), edges=6))
    assert not by_response(mixed(1, "f", 1 / 25.4, (2, 5)).drop(columns="AW"))


def test_a_diameter_instead_of_a_depth_is_seen_by_the_force():
    """Twice the depth lies among the depths of the other edges; Kienzle's force does not: F = 2000 d f^0.75."""
    frame = wear(5, grid=True)
    rng = np.random.default_rng(5)
    frame["Fc"] = 2000 * frame["d"] * frame["f"] ** 0.75 * np.exp(rng.normal(0, 0.08, len(frame)))
    assert not by_response(frame)
    frame.loc[frame["edge"].isin(["E04", "E11"]), "d"] *= 2
    (doubt,) = by_response(frame)
    assert doubt.sentence.startswith("edges E04, E11: with d")
    assert "divided by 2 (on the diameter and on the radius) the Fc agrees" in doubt.sentence


def test_a_force_without_a_value_is_left_alone():
    assert not by_response(wear(5, grid=True).assign(Fc=float("nan")))


def two_steels(factor=1.4):
    """Forces at 18 settings, each of two steels whose forces differ by a factor that a remark explains."""
    rng = np.random.default_rng(1)
    V, f, d, steel = np.array(np.meshgrid((100, 150, 200), (0.1, 0.2, 0.3), (1, 2), (0, 1), indexing="ij")).reshape(
        4, -1
    )
    Fc = 1800 * f**0.75 * d * factor**steel * np.exp(rng.normal(0, 0.02, len(V)))
    words = np.where(steel > 0, "1.4301", "C45")
    return pd.DataFrame({"V": V, "f": f, "d": d, "Fc [N]": Fc, "Remark": words})


def test_a_computed_power_is_in_no_unit_of_its_own():
    runs = datasets.runs_from_frame(two_steels())
    law = fit.power_law(runs, "P", ["V", "f", "d"])
    assert fit.judge(law).suspects[0].correction.endswith("1.34102")  # as of a measured power
    judged = fit.judge(law, runs=runs)
    assert judged.suspects == ()
    assert judged.verdict.reasons[0].startswith("Column 'Remark' shifts the law; fit it with --by Remark")


def test_a_life_with_a_maximum_over_speed_is_curved_and_in_one_unit():
    """Built-up edges: the life is shortest at the lowest speed."""
    rng = np.random.default_rng(11)
    V = np.repeat([30.0, 50, 70, 100, 140], 4)
    T = np.repeat([3.6, 40, 60, 35.5, 8.8], 4) * np.exp(rng.normal(0, 0.03, 20))
    runs = datasets.runs_from_frame(pd.DataFrame({"V [m/min]": V, "f [mm/rev]": 0.2, "T [min]": T}))
    judged = fit.judge(fit.power_law(runs, "T", ["V"]), runs=runs)
    assert not any(one.correction for one in judged.suspects)
    assert any(reason.startswith("Curvature: the square of V") for reason in judged.verdict.reasons)


def rough(levels, seed=3, top=40.0):
    """Roughness with a built-up edge about a speed: a hump of ln V on the line of a feed mark; planned levels."""
    V, f = np.array(np.meshgrid(levels, (0.1, 0.15, 0.2, 0.3), indexing="ij")).reshape(2, -1)
    hump = 1 + 1.4 * np.exp(-(np.log(V / top) ** 2) / 0.3)
    Ra = 25 * f**1.3 * hump * np.exp(np.random.default_rng(seed).normal(0, 0.04, len(V)))
    return pd.DataFrame({"V [m/min]": V, "f [mm/rev]": f, "Ra [um]": Ra})


@pytest.mark.parametrize("levels", [(15, 30, 45, 70, 110, 160), (20, 40, 60, 90, 140, 200), (10, 20, 40, 80, 120, 180)])
def test_a_built_up_edge_is_no_speed_in_another_unit(levels):
    """Whole levels of a plan that is crossed show that the effect of V changes, never that their unit does."""
    runs = datasets.runs_from_frame(rough(levels))
    judged = fit.judge(fit.power_law(runs, "Ra", ["V", "f"]), runs=runs)
    assert not judged.checks["mixed units"].concern
    assert not any(one.correction for one in judged.suspects)
    found = judged.checks["curvature"].verdict
    assert "Ra rises with V up to about" in found
    assert "as with a built-up edge: fit the tests below and above the maximum separately" in found


def test_some_rows_of_a_level_in_another_unit_are_found_in_a_crossed_plan():
    frame = rough((30, 60, 90, 120, 150, 200), top=1e9)
    frame["Ra [um]"] *= (frame["V [m/min]"] / 100) ** -0.8
    wrong = frame.index[[16, 18]]
    frame.loc[wrong, "V [m/min]"] /= 10
    law = fit.power_law(datasets.runs_from_frame(frame, judge=False), "Ra", ["V", "f"])
    (suspect,) = mixed_units(law, split(law)).suspects
    assert (suspect.column, suspect.factor, suspect.lines) == ("V", 10.0, tuple(map(int, wrong)))
