"""Columns that a law does not use, tested as added variables, and conditions that a file lacks.

Reference of the added-variable test: statsmodels' weighted least squares of the levels of edges.
"""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.fit.available import NotAvailable
from fitmodels.fit.checks.autocorrelation import aliased_columns
from fitmodels.fit.checks.missing_factors import (
    added_between,
    added_within,
    is_noted,
    missing_conditions,
    unused_columns,
)
from fitmodels.fit.checks.strata import blocks_between

TIMES = np.arange(2.0, 13.0, 2.0)
CORNERS = np.array(np.meshgrid((80, 120, 180), (0.1, 0.2, 0.4), (1, 1.5, 2.5))).reshape(3, -1).T


def wear(seed, edges=24, power=0.0):
    """A wear test whose wear depends on the diameter D by a power."""
    rng = np.random.default_rng([seed, 5])
    grid = CORNERS[rng.permutation(len(CORNERS))[:edges]]
    V, f, d = np.repeat(grid, len(TIMES), axis=0).T
    D = np.repeat(rng.permutation(np.resize([80.0, 113.0, 160.0], edges)), len(TIMES))
    t = np.tile(TIMES, edges)
    scatter = np.exp(np.repeat(rng.normal(0, 0.05, edges), len(TIMES)) + rng.normal(0, 0.08, len(t)))
    AW = 7.62e-3 * V**0.577 * f**0.168 * d**0.248 * t**0.245 * (D / 113) ** power * scatter
    names = np.repeat([f"E{k + 1:02d}" for k in range(edges)], len(TIMES))
    return pd.DataFrame({"edge": names, "V": V, "f": f, "d": d, "D": D, "t": t, "AW": AW})


def of_columns(frame, factors=("V", "f", "d", "t"), response="AW", icc=0.3, **given):
    runs = datasets.runs_from_frame(frame, judge=False, **given)
    return unused_columns(fit.power_law(runs, response, list(factors)), runs, icc)


def test_a_missing_factor_is_found_with_its_exponent():
    found = [of_columns(wear(seed, power=0.5)) for seed in range(6)]
    assert all(one.concern == 1 and one.verdict.startswith("D (80 to 160 mm) is not in the law of AW") for one in found)
    sizes = [float(one.verdict.split("exponent ")[1].split()[0]) for one in found]
    assert abs(np.mean(sizes) - 0.5) < 0.06


@pytest.mark.parametrize(("name", "at"), [("d", "one d"), ("f", "one value of each condition other than f")])
def test_a_law_on_force_alone_is_fitted_at_one_value_of_what_it_lacks(name, at):
    """The advice was to add the factor, which roughness control refuses."""
    rng = np.random.default_rng(8)
    x = np.tile([0.1, 0.2, 0.3, 0.4], 6)
    F = rng.uniform(400, 900, x.size)
    frame = pd.DataFrame({name: x, "F": F, "Ra": np.exp(0.003 * F + 4 * x + 0.05 * rng.standard_normal(x.size))})
    units = {"F": "N", "Ra": "um", name: "mm" if name == "d" else "mm/rev"}
    runs = datasets.runs_from_frame(frame, judge=False, units=units)
    found = unused_columns(fit.exponential_law(runs, "Ra", "F"), runs, 0.0)
    assert f"{name} (0.1 to 0.4" in found.verdict
    assert f"Fit the tests at {at} and leave the others out: roughness control needs Ra on F alone." in found.verdict
    assert "--law" not in found.verdict


def test_a_column_without_effect_is_seldom_reported():
    p = np.array([of_columns(wear(seed)).pvalue for seed in range(40)])
    assert (p < 0.05).sum() <= 6
    assert 0.3 < np.median(p) < 0.7


def test_a_column_without_a_role_counts_where_it_has_few_levels():
    w = wear(1, power=0.5).rename(columns={"D": "hardness"})
    assert of_columns(w).verdict.startswith("hardness (80 to 160)")
    measured = w.assign(hardness=w["hardness"] + np.arange(len(w)) * 1e-3)
    assert of_columns(measured) is None


def in_blocks(seed, shift, levels=("Mon", "Tue", "Wed")):
    """The wear test of 24 edges, cut in blocks that shift its wear in logarithms."""
    w = wear(seed).drop(columns="D")
    block = np.repeat(np.random.default_rng([seed, 9]).permutation(np.resize(np.arange(3), 24)), len(TIMES))
    return w.assign(day=np.array(levels)[block], AW=w["AW"] * np.exp(shift * (block - 1)))


@pytest.mark.parametrize("levels", [("Mon", "Tue", "Wed"), (1, 2, 3), ("2024-01-02", "2024-01-03", "2024-01-05")])
def test_blocks_that_shift_the_law_name_the_option_that_fits_them(levels):
    found = of_columns(in_blocks(1, 0.2, levels))
    assert found.concern == 1
    head = f"Column 'day' shifts the law; fit it with --by day (levels {levels[0]}, {levels[1]}, {levels[2]}; F(2, "
    assert found.verdict.startswith(head)
    runs = datasets.runs_from_frame(in_blocks(1, 0.2, levels), judge=False)
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"], by="day")
    assert unused_columns(law, runs, 0.3) is None


def test_columns_whose_levels_are_in_the_same_rows_are_named_together():
    w = in_blocks(1, 0.2).assign(machine=lambda w: w["day"].map({"Mon": "B", "Tue": "C", "Wed": "A"}))
    found = of_columns(w)
    assert "Column 'day' shifts the law (as 'machine' does, in the same rows); fit it with --by day (" in found.verdict
    assert found.df == of_columns(w.drop(columns="machine")).df


def test_wrong_edges_that_are_those_of_one_level_are_fitted_by_it():
    """Three edges of an older day and another machine wear 1.6 times as much: leaving them out is no remedy."""
    w = wear(1).drop(columns="D")
    old = w["edge"].isin(w["edge"].unique()[[3, 11, 17]])
    w = w.assign(AW=w["AW"] * np.where(old, 1.6, 1.0), machine=np.where(old, "Weiler", "DMG"))
    found = judged(w)
    assert found.concern == 1
    assert found.suspects == ()
    assert "they are edges of machine Weiler, which may shift them all: fit it with --by machine." in found.verdict
    mixed = w.assign(machine=np.where(np.arange(len(w)) // len(TIMES) % 2, "Weiler", "DMG"))
    assert len(judged(mixed).suspects[0].edges) == 3


def judged(w):
    from fitmodels.fit.checks.strata import split
    from fitmodels.fit.checks.wrong_edges import outlying_edges

    runs = datasets.runs_from_frame(w, judge=False)
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    return outlying_edges(law, split(law), runs)


@pytest.mark.parametrize(
    ("name", "levels"), [("Remark", ("C45", "1.4301", "16MnCr5")), ("coolant", ("dry", "oil", "mist"))]
)
def test_a_column_of_words_that_shifts_the_law_is_named(name, levels):
    found = of_columns(in_blocks(1, 0.2, levels).rename(columns={"day": name}))
    assert found.concern == 1
    assert f"--by {name}, or name the work by it with --map work={name} " in found.verdict
    some = in_blocks(1, 0.2, ("", *levels[1:])).rename(columns={"day": name})
    assert of_columns(some) is None


def aliased(name, of, levels, response="AW"):
    """The finding on a column whose level follows from a factor of the wear test, value by value."""
    w = wear(1).drop(columns="D")
    w = w.assign(**{name: w[of].map(dict(zip(np.unique(w[of]).tolist(), levels, strict=True)))})
    runs = datasets.runs_from_frame(w, judge=False)
    return aliased_columns(fit.power_law(runs, response, ["V", "f", "d", "t"]), runs)


@pytest.mark.parametrize(
    ("name", "of", "levels", "named"),
    [
        ("edge condition", "d", ("new", "reground", "honed"), "new at d 1, reground at d 1.5, honed at d 2.5"),
        ("coolant", "V", ("dry", "oil", "mist"), "dry at V 80, oil at V 120, mist at V 180"),
        ("batch", "f", ("B1", "B2", "B3"), "B1 at f 0.1, B2 at f 0.2, B3 at f 0.4"),
        ("criterion VB [mm]", "d", (0.3, 0.2, 0.25), "0.3 at d 1, 0.2 at d 1.5, 0.25 at d 2.5"),
    ],
)
def test_a_condition_that_changes_with_a_factor_alone_is_a_reservation(name, of, levels, named):
    found = aliased(name, of, levels)
    assert found.concern == 1
    assert found.verdict.startswith(f"The effect of {of} on AW may be that of column {name!r}: {named}, never varied")


@pytest.mark.parametrize(
    ("name", "of", "levels"),
    [
        ("n", "V", (318, 477, 716)),  # follows from the speed
        ("h [mm]", "f", (0.09, 0.18, 0.36)),  # follows from the feed
        ("V_coded", "V", (-1, 0, 1)),
        ("speed level", "V", ("alpha", "beta", "gamma")),
        ("range", "V", ("low", "mid", "high")),
        ("cell", "V", ("C1", "C2", "C3")),
        ("day", "V", ("Mon", "Tue", "Wed")),
        ("Bemerkung", "d", ("leise", "laut", "sehr laut")),
        ("chip", "f", ("ribbon", "helical", "broken")),
    ],
)
def test_columns_that_follow_from_a_factor_or_name_it_are_no_conditions(name, of, levels):
    assert aliased(name, of, levels) is None


def test_a_condition_that_varies_beside_the_factors_is_tested_instead():
    w = in_blocks(1, 0.0).rename(columns={"day": "coolant"})
    runs = datasets.runs_from_frame(w, judge=False)
    assert aliased_columns(fit.power_law(runs, "AW", ["V", "f", "d", "t"]), runs) is None


def test_blocks_without_effect_are_seldom_reported():
    p = np.array([of_columns(in_blocks(seed, 0.0)).pvalue for seed in range(40)])
    assert (p < 0.05).sum() <= 6
    assert 0.3 < np.median(p) < 0.7


def test_the_test_of_blocks_is_that_of_weighted_least_squares():
    from statsmodels.regression.linear_model import WLS

    rng = np.random.default_rng(4)
    levels, weight = rng.normal(size=12), rng.uniform(0.5, 2, 12)
    others = np.column_stack([np.ones(12), rng.normal(size=12)])
    D = np.repeat(np.eye(3)[:, 1:], 4, axis=0)
    F, df, p = blocks_between(levels, others, D, weight)
    full = WLS(levels, np.hstack([others, D]), weights=weight).fit()
    expected, p_value, more = full.compare_f_test(WLS(levels, others, weights=weight).fit())
    assert (F, df, p) == (pytest.approx(expected), 8, pytest.approx(p_value))
    assert more == 2
    assert blocks_between(levels, np.column_stack([np.ones(12), D]), D, weight) is None


def test_several_columns_are_tested_together():
    w = wear(2).assign(
        batch=np.repeat(np.resize([1.0, 2.0, 2.0, 1.0], 24), 6), rake=np.repeat(np.resize([5, 7, 6], 24), 6)
    )
    one, many = of_columns(w[[*"VfdtD", "edge", "AW"]]), of_columns(w)
    assert many.pvalue >= min(1, one.pvalue) or "3 columns" in many.verdict
    for name in ("D", "batch", "rake"):
        assert name in many.kept


def test_numbers_of_tests_and_rows_are_no_factors():
    w = wear(3).drop(columns="D")
    number = np.repeat(np.arange(1, 25), 6)
    assert of_columns(w.assign(no=number, row=np.arange(len(w)), sub=np.tile(np.arange(1, 7), 24))) is None


def test_copies_of_factors_are_not_tested():
    w = wear(4).drop(columns="D")
    found = of_columns(w.assign(n=(w["V"] * 1000 / np.pi / 100).round()))
    assert isinstance(found, NotAvailable)
    assert "not separable" in found.reason


def test_a_condition_left_out_by_the_user_is_tested():
    assert "d (1 to 2.5 mm) is not in the law" in of_columns(wear(5).drop(columns="D"), ("V", "f", "t")).verdict


def test_a_column_that_changes_within_edges():
    """Work that gets smaller from pass to pass."""
    p = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        w = wear(seed)
        w["D"] = np.tile([160.0, 150, 141, 128, 118, 104], 24) * np.repeat(rng.uniform(0.8, 1.25, 24), 6)
        p.append(of_columns(w).pvalue)
    assert np.median(p) > 0.2
    assert min(p) > 0.002
    w["D"] = w["D"] * rng.uniform(0.8, 1.2, len(w))
    w["AW"] *= (w["D"] / 113) ** 0.5
    assert of_columns(w).pvalue < 1e-4


def test_without_edges_rows_are_the_units():
    assert of_columns(wear(7, power=0.5).drop(columns="edge"), edge="none", icc=0.0).concern == 1


def test_without_runs_the_columns_are_unknown():
    law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    assert unused_columns(law, None, 0.0) is None
    assert missing_conditions(law, None) is None


def test_levels_of_edges_as_weighted_least_squares_of_statsmodels():
    from statsmodels.regression.linear_model import WLS

    rng = np.random.default_rng(8)
    X = np.column_stack([np.ones(20), rng.normal(size=(20, 2))])
    x, y, weight = rng.normal(size=20), rng.normal(size=20), rng.uniform(1, 5, 20)
    theirs = WLS(y, np.column_stack([X, x]), weights=weight).fit()
    assert added_between(y, X, x, weight) == pytest.approx(
        (theirs.params[3], theirs.tvalues[3], theirs.df_resid, theirs.pvalues[3]), rel=1e-9
    )


def test_rows_within_edges_by_leaving_out_each_edge():
    rng = np.random.default_rng(9)
    edge = np.repeat(np.arange(8), 5)
    columns, y = rng.normal(size=(40, 2)), rng.normal(size=40)
    b = np.linalg.lstsq(columns, y, rcond=None)[0]
    left = [np.linalg.lstsq(columns[edge != g], y[edge != g], rcond=None)[0][0] for g in range(8)]
    se = np.sqrt(7 / 8 * np.sum((np.array(left) - b[0]) ** 2))
    assert added_within(columns, y, edge)[:3] == pytest.approx((b[0], b[0] / se, 7), rel=1e-9)


@pytest.mark.parametrize(
    ("dropped", "given", "named"),
    [
        ((), {}, ()),
        (("V",), {}, ("Cutting speed V",)),
        (("V",), {"process": "drilling"}, ("Cutting speed V",)),
        (("V",), {"constants": {"V": 200.0}}, ()),
        (("d",), {}, ()),
        (("d", "D"), {}, ("Depth of cut d",)),
        (("d", "D"), {"process": "drilling"}, ()),
        (("d",), {"process": "turning"}, ("Depth of cut d",)),
        ((), {"process": "milling"}, ("Width of cut ae",)),
        (("t",), {}, ("Cutting time t",)),
        (("V", "f"), {}, ("Cutting speed V", "feed f")),
    ],
)
def test_conditions_that_the_file_lacks(dropped, given, named):
    runs = datasets.runs_from_frame(wear(0).drop(columns=list(dropped)), judge=False, **given)
    law = fit.power_law(runs, "AW", [name for name in ("V", "f", "d", "t") if runs.has(name)])
    found = missing_conditions(law, runs)
    assert found.concern == bool(named)
    assert all(name in found.verdict for name in named)
    assert found.verdict.count("not in this file") == bool(named)


@pytest.mark.parametrize("note", ["fixed: V 200 m/min", "Schnittgeschwindigkeit: 200 m/min", "n 610 rpm"])
def test_a_condition_in_the_notes_is_known(note):
    frame = wear(0).drop(columns="V")
    frame.attrs["notes"] = [note]
    runs = datasets.runs_from_frame(frame, judge=False)
    assert missing_conditions(fit.power_law(runs, "AW", ["f", "d", "t"]), runs).concern == 0


def test_speed_in_revolutions_and_feed_per_tooth_stand_for_speed_and_feed():
    w = wear(0).rename(columns={"V": "n", "f": "fz"}).assign(ae=10.0)
    runs = datasets.runs_from_frame(w.drop(columns="D"), judge=False, process="milling")
    assert missing_conditions(fit.power_law(runs, "AW", ["n", "fz", "d", "t"]), runs).concern == 0


def test_the_missing_speed_of_the_nasa_set_is_a_reservation(measurements):
    runs = datasets.read_runs(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    for pair in runs.pairs():
        law = fit.default_laws(pair)[0][0]
        assert any("Cutting speed V" in reason for reason in fit.judge(law, runs=pair).verdict.reasons)


def test_exact_rows_and_shared_line_numbers_are_reasons():
    w = wear(0)
    exact = w.assign(AW=1e-3 * w["V"] ** 0.5 * w["f"] ** 0.2 * w["d"] ** 0.2 * w["t"] ** 0.3)
    assert "no residual variance" in of_columns(exact).reason
    runs = datasets.runs_from_frame(w, judge=False)
    twice = runs.join(runs)
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    assert "share their line numbers" in unused_columns(law, twice, 0.3).reason


def test_the_exponent_in_a_law_with_additive_errors():
    runs = datasets.runs_from_frame(wear(1, power=0.5), judge=False)
    found = unused_columns(fit.power_law(runs, "AW", ["V", "f", "d", "t"], error="additive"), runs, 0.3)
    assert found.concern == 1
    assert float(found.verdict.split("exponent ")[1].split()[0]) == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("note", ["# ap = 2 mm", "# depth of cut: 2 mm", "# d 2 mm"])
def test_a_condition_in_the_notes_is_known_by_any_of_its_names(note):
    assert is_noted((note.lstrip("# "),), "d")
    assert not is_noted((note.lstrip("# "),), "f")
