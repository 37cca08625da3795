"""New runs against a law: Chow's test where rows are independent, its size by simulation where they are not."""

import re

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.cli import main
from fitmodels.core import errors
from fitmodels.core.errors import UsageError
from fitmodels.fit.confirmation import confirm, quadratic
from statsmodels.regression.linear_model import OLS

pytestmark = pytest.mark.slow

EXACT = 1e-8
FACTORS = ["V", "f", "d", "t"]
LAWS = [
    datasets.SimulatedLaw("AW", "mm", 7.62e-3, {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}, 0.07, 0.07, digits=9)
]
PLAN = datasets.central_composite({"V": (50, 200), "f": (0.06, 0.6), "d": (1.5, 3)}, seed=1).sort_values("edge")
SOME = PLAN.iloc[[1, 6, 8, 10]]


def frame(plan, seed):
    return datasets.simulate(plan, LAWS, t_max=12.0, criterion=None, seed=seed)


def law(seed=1, **options):
    return fit.power_law(datasets.runs_from_frame(frame(PLAN, seed)), "AW", FACTORS, **options)


def new(seed=1001, **changed):
    data = frame(SOME, seed)
    return datasets.runs_from_frame(data.assign(**{k: f(data) if callable(f) else f for k, f in changed.items()}))


def test_rows_are_judged_by_the_laws_own_prediction_interval():
    fitted, runs = law(), new()
    found = confirm(fitted, runs, level=0.9)
    band = fitted.predict(runs.data[FACTORS], "prediction", level=0.9).to_frame()
    np.testing.assert_allclose(found.rows[["predicted", "low", "high"]], band[["value", "low", "high"]], rtol=EXACT)
    y = runs.values("AW")
    assert (found.rows["inside"] == ((band["low"] <= y) & (y <= band["high"]))).all()
    assert found.expected == pytest.approx(2.4)
    assert list(found.rows["edge"]) == list(runs.data["edge"])


def test_independent_rows_are_chows_test():
    """F from the residual sums of squares of both samples and of the old one alone (Chow 1960, eq. 27)."""
    fitted, runs = law(edge=None), new()
    Z, y = fitted.formula.design(fitted.X), np.log(fitted.observed)
    Z2, y2 = fitted.formula.design(runs.data[FACTORS].to_numpy()), np.log(runs.values("AW"))
    old, both = OLS(y, Z).fit(), OLS(np.r_[y, y2], np.vstack([Z, Z2])).fit()
    expected = (both.ssr - old.ssr) / len(y2) / (old.ssr / old.df_resid)
    (test,) = confirm(fitted, runs).tests
    assert test.statistic == pytest.approx(expected, rel=EXACT)
    assert test.df == (24.0, 139.0)


def test_the_quadratic_form_is_that_of_the_whole_matrix():
    rng = np.random.default_rng(1)
    e, A, half, d = rng.normal(size=7), rng.normal(size=(7, 3)), rng.normal(size=(3, 2)), rng.uniform(0.5, 2, 7)
    C = half @ half.T  # of rank two
    assert quadratic(e, A, C, d) == pytest.approx(e @ np.linalg.solve(A @ C @ A.T + np.diag(d), e), rel=EXACT)


def test_a_true_law_is_rejected_as_often_as_it_should_be():
    """200 laws, each judged on four new edges: 5 % less for Bonferroni, plus four standard errors."""
    found = [confirm(law(seed), new(1000 + seed)) for seed in range(200)]
    rejected = np.mean([not one.holds for one in found])
    assert rejected < 0.05 + 4 * np.sqrt(0.05 * 0.95 / 200)
    levels = np.array([one.tests[0].pvalue for one in found])
    assert abs(np.mean(levels < 0.25) - 0.25) < 4 * np.sqrt(0.25 * 0.75 / 200)  # the test is no rubber stamp
    outside = np.mean([one.outside / len(one.rows) for one in found])
    assert outside == pytest.approx(0.05, abs=0.02)


def test_a_law_that_does_not_hold_is_reported_by_edge():
    found = confirm(law(), new(AW=lambda data: data["AW"] * np.where(data["edge"] == "E07", 1.6, 1.0)))
    assert not found.holds
    assert found.edges.index[~found.edges["inside"]].tolist() == ["E07"]
    assert f"{found.outside} of 24 rows fall outside the 95 % prediction intervals, 1.2 expected" in found.verdict
    assert "does not hold for edge E07 (" in found.verdict
    assert "% above)" in found.verdict
    good = confirm(law(), new())
    assert "the law holds for these runs" in good.verdict


def test_another_time_exponent_is_seen_within_edges():
    found = confirm(law(), new(AW=lambda data: data["AW"] * (data["t"] / 6) ** 0.35))
    assert found.tests[1].pvalue < 1e-6
    assert "rows deviate from it within their edges" in found.verdict


def test_rows_outside_the_region_are_named_and_not_judged():
    runs = new(V=lambda data: np.where(np.arange(len(data)) < 2, 900.0, data["V"]))
    found = confirm(law(), runs)
    assert [row.line for row in found.not_compared] == [int(line) for line in runs.lines[:2]]
    assert len(found.rows) == 22
    assert "2 rows outside the region of the design are not compared" in found.verdict
    assert "V 900 m/min above the 50 to 200 that was cut" in found.verdict
    with pytest.raises(errors.FitError, match="none of the 24 new rows lies in the region"):
        confirm(law(), new(V=900.0))


def test_new_rows_without_edges_get_no_judgement_of_the_whole():
    data = frame(SOME, 5).drop(columns="edge")
    found = confirm(law(), datasets.runs_from_frame(data, edge="none"))
    assert found.holds is None
    assert len(found.rows) == 24
    assert "have no edge column" in found.verdict


def test_a_category():
    data = frame(PLAN, 1)
    hard = data["edge"].isin(data["edge"].unique()[::2])
    data = data.assign(material=np.where(hard, "hard", "soft"), AW=data["AW"] * np.where(hard, 2.0, 1.0))
    fitted = fit.power_law(datasets.runs_from_frame(data), "AW", FACTORS, by="material")
    assert confirm(fitted, new(material="soft")).holds
    assert not confirm(fitted, new(material="hard")).holds
    with pytest.raises(errors.FitError, match="'brass' is not among"):
        confirm(fitted, new(material="brass"))


def test_an_additive_law():
    fitted = law(error="additive")
    found = confirm(fitted, new())
    band = fitted.predict(new().data[FACTORS], "prediction").to_frame()
    np.testing.assert_allclose(found.rows[["predicted", "low", "high"]], band[["value", "low", "high"]], rtol=EXACT)
    assert not confirm(fitted, new(AW=lambda data: data["AW"] * 1.8)).holds


def test_an_exact_law_forgives_nothing():
    t = np.arange(2.0, 14.0, 2.0)
    old = pd.DataFrame({"t": t, "AW": 0.1 * t**0.5})
    fitted = fit.power_law(datasets.runs_from_frame(old), "AW", ["t"])
    found = confirm(fitted, datasets.runs_from_frame(pd.DataFrame({"t": [3.0, 5.0], "AW": [0.2, 0.3]})))
    assert not found.holds
    assert found.outside == 2


@pytest.mark.parametrize(
    ("drop", "words"), [("d", "has no d: the law of AW needs AW, V, f, d, t"), ("AW", "has no AW")]
)
def test_missing_columns_are_refused(drop, words):
    with pytest.raises(UsageError, match=words):
        confirm(law(), datasets.runs_from_frame(frame(SOME, 5).drop(columns=drop)))


def test_other_refusals():
    fitted = law()
    with pytest.raises(errors.FitError, match="all 144 rows are among those the law was fitted to"):
        confirm(fitted, datasets.runs_from_frame(frame(PLAN, 1)))
    with pytest.raises(UsageError, match="level 95"):
        confirm(fitted, new(), level=95)
    with pytest.raises(errors.DataError, match="AW is negative in all rows"):
        new(AW=-1.0)
    with pytest.raises(errors.FitError, match="no usable row"):
        confirm(fitted, new(AW=0.0))
    two = fit.power_law(datasets.runs_from_frame(pd.DataFrame({"t": [2.0, 4.0], "AW": [0.1, 0.2]})), "AW", ["t"])
    with pytest.raises(errors.FitError, match="2 observations fix 2 parameters"):
        confirm(two, new())


def test_the_command_takes_the_law_of_the_same_tool(tmp_path, capsys):
    """Two tools in one table, the second wears 2.2 times as much; new runs wear like the first."""
    a, b, late = frame(PLAN, 1), frame(PLAN, 2), frame(SOME, 3)
    b = b.assign(AW=2.2 * b["AW"], edge="B" + b["edge"])
    both, one, none = tmp_path / "both.csv", tmp_path / "one.csv", tmp_path / "none.csv"
    a = a.assign(tool="A", work="C45")
    pd.concat([a, b.assign(tool="B", work="C45")]).to_csv(both, index=False)
    a.to_csv(one, index=False)
    late.to_csv(none, index=False)
    for tool, code, words in (("A", 0, "the law holds"), ("B", 5, "does not hold for edges")):
        own = tmp_path / f"{tool}.csv"
        late.assign(tool=tool, work="C45").to_csv(own, index=False)
        for given in ([str(own)], [str(none), "--tool", tool, "--work", "C45"]):
            assert main(["confirm", *given, "--data", str(both)]) == code
            out = " ".join(capsys.readouterr().out.split())
            assert out.startswith(f"{tool} on C45: 24 new rows, laws of {tool} on C45 (144 rows).")
            assert words in out
    assert main(["confirm", str(none), "--data", str(both)]) == 2
    assert "has tests of A on C45, B on C45: each pair has laws of its own" in capsys.readouterr().err
    assert main(["confirm", str(tmp_path / "B.csv"), "--data", str(one)]) == 0
    assert "is of B on C45, and the laws are of A on C45" in " ".join(capsys.readouterr().err.split())


def test_runs_without_edges_are_told_by_how_much_they_deviate(tmp_path):
    rng = np.random.default_rng(3)
    V, f = np.meshgrid([100.0, 150.0, 220.0], [0.1, 0.2, 0.3])
    frame = pd.DataFrame({"V": V.ravel(), "f": f.ravel()}).loc[lambda d: d.index.repeat(2)]
    frame["Fc [N]"] = 2000 * frame["f"] ** 0.75 * np.exp(0.02 * rng.standard_normal(len(frame)))
    new = frame.iloc[:4].assign(**{"Fc [N]": frame["Fc [N]"].iloc[:4] * 1.3}).reset_index(drop=True)
    law = fit.power_law(datasets.runs_from_frame(frame.reset_index(drop=True)), "Fc", ["V", "f"])
    verdict = confirm(law, datasets.runs_from_frame(new)).verdict
    assert re.search(r"taken together \(p < 0.0001\): (29|30|31) % above the predictions on average \(", verdict)


def test_a_condition_that_all_earlier_tests_had_in_common_is_named(tmp_path, capsys):
    rng = np.random.default_rng(3)
    V, f = np.meshgrid([100.0, 150.0, 220.0], [0.1, 0.2, 0.3])
    frame = pd.DataFrame({"V": V.ravel(), "f": f.ravel(), "d": 1.5}).loc[lambda d: d.index.repeat(2)]
    frame["Ra"] = 30 * frame["f"] ** 1.5 * np.exp(0.05 * rng.standard_normal(len(frame)))
    old, same, other = (str(tmp_path / name) for name in ("old.csv", "same.csv", "other.csv"))
    frame.to_csv(old, index=False)
    fresh = frame.iloc[4:12].assign(Ra=lambda d: d["Ra"] * 1.02)
    fresh.to_csv(same, index=False)
    fresh.assign(d=3.0).to_csv(other, index=False)
    assert main(["confirm", same, "--data", old]) == 0
    assert "d is" not in capsys.readouterr().out
    assert main(["confirm", other, "--data", old]) == 0
    assert "d is 3 here and 1.5 mm in all tests of the law" in " ".join(capsys.readouterr().out.split())


def test_rows_of_few_edges_say_nothing_of_the_levels_of_new_ones():
    """Two edges at two speeds: their rows scatter by 1 %, edges by 15 %, so that a new edge is no false alarm."""
    rng = np.random.default_rng(2)

    def rows(speeds, level):
        return pd.DataFrame([
            {"edge": f"E{V:g}", "V": V, "t": t, "AW": level * V**0.5 * t**0.5 / 50 * np.exp(rng.normal(0, 0.01))}
            for V in speeds for t in (2.0, 5, 8)
        ])  # fmt: skip

    fitted = fit.power_law(datasets.runs_from_frame(rows((120.0, 200.0), 1.0), judge=False), "AW", ["V", "t"])
    found = confirm(fitted, datasets.runs_from_frame(rows((150.0,), 1.15), judge=False))
    assert found.holds is None
    assert "no joint test: the scatter between edges is not known" in found.verdict


def test_one_new_edge_is_weak_evidence():
    one = new(edge=lambda data: "N1")
    one = datasets.runs_from_frame(one.data[one.data["V"] == one.data["V"].iloc[0]].reset_index(drop=True))
    found = confirm(law(), one)
    assert found.holds
    assert "weak evidence: one new edge, test two or more" in found.verdict
    assert "weak evidence" not in confirm(law(), new()).verdict


def test_options_of_reading_belong_to_one_of_the_two_files(tmp_path, capsys):
    """Wear in um without a unit in the new file, seconds in that of the laws, an invalid test in each at its line."""
    old, late = tmp_path / "old.csv", tmp_path / "late.csv"
    first = frame(PLAN, 1).rename(columns={"AW": "AW [mm]"}).assign(t=lambda d: 60 * d["t"], remark="")
    first.loc[[60, 61], "remark"] = "broken"
    first.to_csv(old, index=False)
    second = frame(SOME, 3).assign(AW=lambda d: 1000 * d["AW"], remark="")
    second.loc[2, "remark"] = "broken"
    second.to_csv(late, index=False)
    assert main(["confirm", str(late), "--data", str(old), "--data-unit", "t=s"]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert ': --leave-out "lines 4"' in said
    assert '--data-leave-out "lines 62-63"' in said, said
    own = ["--unit", "AW=um", "--leave-out", "lines 4", "--data-unit", "t=s", "--data-leave-out", "lines 62,63"]
    assert main(["confirm", str(late), "--data", str(old), *own]) == 0
    done = capsys.readouterr()
    assert done.err == ""
    assert "of 23 rows" in done.out
    assert main(["confirm", str(late), "--data", str(old), "--unit", "t=s"]) in (4, 5)  # the times of the new runs
    assert "--data-unit t=s" in " ".join(capsys.readouterr().err.split())
    assert main(["confirm", str(late), "--data", str(old), "--data-leave-out", "lines 900"]) == 2
    assert "--data-leave-out lines 900: there is no row" in capsys.readouterr().err
