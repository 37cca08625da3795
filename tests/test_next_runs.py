"""Which tests to add: D-optimal against brute force, and the repeats that pure error lacks."""

import json
import shlex
from itertools import combinations, combinations_with_replacement

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.app.command_forms import Subject, actions
from fitmodels.app.command_words import command
from fitmodels.cards.content.verdicts import follow_up, verdicts_of
from fitmodels.cli import main
from fitmodels.core import errors
from fitmodels.core.errors import UsageError
from fitmodels.fit.next_tests import next_runs
from fitmodels.fit.optimal_tests import d_optimal, determinant_gain

EXACT = 1e-9
FACTORS = ["V", "f", "d", "t"]
RANGES = {"V": (50, 200), "f": (0.06, 0.6), "d": (1.5, 3)}
LAWS = [datasets.SimulatedLaw("AW", "mm", 7.62e-3, {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}, 0.07, 0.07)]


def cut(plan, seed=1):
    return datasets.runs_from_frame(datasets.simulate(plan, LAWS, t_max=12.0, criterion=None, seed=seed))


def bundled_law():
    return fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", FACTORS)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("repeats", [True, False])
def test_the_search_finds_what_brute_force_finds(seed, repeats):
    rng = np.random.default_rng(seed)
    old, candidates = np.column_stack([np.ones(6), rng.normal(size=(6, 2))]), rng.normal(size=(9, 3))
    M = np.linalg.inv(old.T @ old)
    choose = combinations_with_replacement if repeats else combinations
    best = max(determinant_gain(M, candidates[list(rows)]) for rows in choose(range(9), 3))
    chosen, gain = d_optimal(M, candidates, 3, 3 if repeats else 1, np.random.default_rng(0))
    assert gain == pytest.approx(best, rel=EXACT)
    assert determinant_gain(M, candidates[chosen]) == pytest.approx(gain, rel=EXACT)
    assert repeats or len(set(chosen)) == 3


def test_the_gain_is_the_ratio_of_determinants_of_a_refit():
    law = bundled_law()
    plan = next_runs(law, 5)
    edges = datasets.read_runs(datasets.bundled("gc435_709m40")).data.groupby("edge")[["V", "f", "d"]].first()
    both = pd.concat([edges, plan[["V", "f", "d"]]])
    before, after = (
        fit.linear(np.column_stack([np.ones(len(x)), np.log(x)]), np.arange(len(x))) for x in (edges, both)
    )
    ratio = np.linalg.det(before.cov_unscaled) / np.linalg.det(after.cov_unscaled)
    assert plan.attrs["determinant_gain"] == pytest.approx(ratio, rel=1e-6)
    assert plan.attrs["volume"] == pytest.approx(ratio**-0.5, rel=1e-6)


def test_added_tests_beat_random_ones_and_shrink_the_covariance():
    plan = datasets.central_composite(RANGES, seed=1)
    law = fit.power_law(cut(plan), "AW", FACTORS)
    added = next_runs(law, 6)
    rng = np.random.default_rng(1)
    old = np.column_stack([np.ones(24), np.log(plan[list(RANGES)])])
    M = np.linalg.inv(old.T @ old)
    at_random = [
        determinant_gain(M, np.column_stack([np.ones(6), np.log(plan[list(RANGES)].to_numpy()[rng.choice(24, 6)])]))
        for _ in range(200)
    ]
    assert added.attrs["determinant_gain"] >= max(at_random) * (1 - 1e-6)
    more = fit.power_law(cut(pd.concat([plan, added])), "AW", FACTORS)
    before, after = (np.linalg.det(fitted.cov_theta / fitted.scale_se**2) for fitted in (law, more))
    assert after < before / added.attrs["determinant_gain"] ** 0.9  # as it does for edges, so for their rows


def test_without_a_repeated_edge_repeats_come_first():
    plan = datasets.central_composite(RANGES, centre=1, axial_repeats=1, seed=1)
    added = next_runs(fit.power_law(cut(plan), "AW", FACTORS), 4)
    assert added.attrs["criterion"] == "repeats"
    assert "pure error is unknown" in added.attrs["words"]
    assert added["point"].str.startswith("repeat of E").all()
    assert added["point"].nunique() == 4
    known = set(map(tuple, plan[list(RANGES)].to_numpy()))
    assert set(map(tuple, added[list(RANGES)].to_numpy())) <= known
    many = next_runs(fit.power_law(cut(plan), "AW", FACTORS), 20)  # 15 settings
    assert many["point"].value_counts().max() == 2
    assert next_runs(fit.power_law(cut(pd.concat([plan, added])), "AW", FACTORS), 2).attrs["criterion"] == "D-optimal"


def test_new_tests_stay_in_the_region_and_can_be_cut():
    law = bundled_law()
    added = next_runs(law, 9)
    assert law.region.inside({**added[["V", "f", "d"]], "t": 8.0}).all()
    assert list(added["run"]) == list(range(1, 10))
    assert not set(added["edge"]) & set(law.edge)
    assert len(cut(added)) == 9 * 6
    assert added.attrs["units"] == {"V": "m/min", "f": "mm/rev", "d": "mm"}


def test_the_seed_draws_the_order():
    law = bundled_law()
    first, again, other = (next_runs(law, 6, seed=seed) for seed in (1, 1, 2))
    pd.testing.assert_frame_equal(first, again)
    assert not first[["V", "f", "d"]].equals(other[["V", "f", "d"]])
    assert first.attrs["determinant_gain"] == pytest.approx(other.attrs["determinant_gain"], rel=1e-6)


def test_candidates_of_ones_own():
    law = bundled_law()
    corner = {"V": [100.0, 200.0], "f": [0.19, 0.6], "d": [2.1, 3.0]}
    added = next_runs(law, 1, candidates=corner)
    assert added.loc[0, ["point", "V", "f", "d"]].tolist() == ["new", 200.0, 0.6, 3.0]
    assert added.attrs["determinant_gain"] == pytest.approx(1 + law.region.leverage({**corner, "t": 8})[1])
    with pytest.raises(errors.FitError, match="lack d"):
        next_runs(law, 1, candidates={"V": 100.0, "f": 0.2})
    with pytest.raises(errors.FitError, match="above zero"):
        next_runs(law, 1, candidates={"V": -100.0, "f": 0.2, "d": 2.0})


@pytest.mark.parametrize("n", [0, -1, 1001, 2.0, True])
def test_a_number_of_tests_that_is_none(n):
    with pytest.raises(UsageError, match="whole number from 1 to 1000"):
        next_runs(bundled_law(), n)


def test_rows_are_the_tests_where_no_edge_is_named():
    V = np.array([50.0, 70.0, 100.0, 140.0])
    frame = pd.DataFrame({"V": V, "AW": 0.01 * V**0.5 * [1, 1.1, 0.9, 1]})
    once = fit.power_law(datasets.runs_from_frame(frame), "AW", ["V"])
    added = next_runs(once, 2)
    assert added.attrs["criterion"] == "repeats"
    assert sorted(added["V"]) == [50.0, 140.0]
    two = fit.power_law(datasets.runs_from_frame(frame.iloc[[0, 3]]), "AW", ["V"])  # as many rows as parameters
    assert sorted(next_runs(two, 2)["V"]) == [50.0, 140.0]


def test_one_edge_is_repeated_as_it_was():
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    law = fit.power_law(datasets.runs_from_frame(runs.data[runs.data["edge"] == "E01"]), "AW", FACTORS)
    added = next_runs(law, 2)
    assert added["point"].tolist() == ["repeat of E01"] * 2
    assert list(added.columns) == ["run", "edge", "point"]
    assert added.attrs["determinant_gain"] == pytest.approx(3.0)


def test_a_category_is_planned_too():
    plan = datasets.central_composite(RANGES, seed=1)
    runs = cut(plan)
    frame = runs.data.assign(material=np.where(runs.data["edge"].isin(["E01", "E08"]), "hard", "soft"))
    law = fit.power_law(datasets.runs_from_frame(frame), "AW", FACTORS, by="material")
    assert next_runs(law, 4)["material"].tolist() == ["hard"] * 4  # the rare one tells most


def test_settings_where_every_test_ran_out_are_not_proposed_again():
    """Simulated lives about V^-3 at four speeds; the lowest never ends within 60 min."""
    V = np.repeat([80.0, 140, 190, 250], 4)
    life = 6 * (250 / V) ** 3 * np.exp(np.random.default_rng(1).normal(0, 0.1, len(V)))
    table = pd.DataFrame({"V": V, "T": [">60" if one > 60 else f"{one:.3f}" for one in life]})
    law = fit.life_law(datasets.runs_from_frame(table), ["V"])
    assert law.life.run_outs == 4
    plan = next_runs(law, 4)
    assert (np.asarray(law.values(plan[["V"]])) <= 60).all()
    assert "Not proposed: settings where every test ran out" in plan.attrs["words"]
    longer = next_runs(law, 4, longest=300.0)
    assert longer["V"].min() == 80
    assert "Not proposed" not in longer.attrs["words"]


def test_the_command_gives_settings_of_a_milling_machine_and_minutes(tmp_path, capsys):
    """A plan of ``fitmodels plan --process milling`` filled in; both kinds of plan read back to the same V and f."""
    plan = datasets.plan_tests(
        {"V": (80.0, 200.0), "fz": (0.05, 0.2)}, process="milling", constants={"Dc": 20.0, "z": 4.0}, duration=(5, 20),
        readings=3, seed=1,
    )  # fmt: skip
    rng = np.random.default_rng(1)
    level = dict.fromkeys(plan["edge"])
    level = {edge: rng.normal(0, 0.06) for edge in level}
    shift = plan["edge"].map(level) + rng.normal(0, 0.04, len(plan))
    units = plan.attrs["units"]
    plan["VB"] = 7.6e-3 * plan["V"] ** 0.577 * plan["fz"] ** 0.168 * plan["t"] ** 0.3 * np.exp(shift)
    named = {name: f"{name} [{unit}]" for name, unit in {**units, "VB": "mm"}.items() if name in plan}
    tests, out = tmp_path / "tests.csv", tmp_path / "next.csv"
    plan.rename(columns=named).to_csv(tests, index=False)
    for options in ([], ["--decision", "VB=0.2"]):
        assert main(["next", str(tests), "--out", str(out), "--force", *options]) == 0
        rows = pd.read_csv(out, comment="#")
        assert {"fz [mm/tooth]", "n [1/min]", "fm [mm/min]", "Dc [mm]", "z", "t [min]"} <= set(rows)
        assert "f [mm/rev]" not in rows
        assert rows["fz [mm/tooth]"].astype(str).str.len().max() <= 7
        np.testing.assert_allclose(rows["n [1/min]"], 1000 * rows["V [m/min]"] / (np.pi * 20), rtol=1e-3)
        assert (datasets.read_runs(out).values("z") == 4).all()
    assert "3 readings of each edge, as so far" in " ".join(capsys.readouterr().out.split())


def test_the_command_gives_minutes_of_tests_for_the_law_as_a_whole(tmp_path, capsys):
    assert main(["next", str(datasets.bundled("gc435_709m40")), "--law", "AW", "--criterion", "0.15", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["notes"][0] == "plan: 4 more edges, 27.8 min in cut, for the law of AW; cut in the order of run."
    assert "expected after 4 more tests" in found["notes"][1]  # what it gains comes before how it was chosen
    assert [note.startswith("Statistics: ") and "D-optimal" in note for note in found["notes"]].index(True) > 2
    assert sorted(row["t"] for row in found["rows"]) == [1.3, 2.7, 3.8, 20.0]  # lives, at most the longest so far
    assert found["units"]["t"] == "min"


def test_a_file_of_several_pairs_is_planned_for_the_one_that_is_named(tmp_path, capsys):
    """The law of all pairs together is of none of them, and edges numbered 1, 2, ... in each pair are not the same."""
    frame = pd.read_csv(datasets.bundled("gc435_709m40"), comment="#")
    both = pd.concat([frame.assign(work="A"), frame.assign(work="B b", **{"AW [mm]": 3 * frame["AW [mm]"]})])
    both.to_csv(tmp_path / "two.csv", index=False)
    tests = str(tmp_path / "two.csv")
    assert main(["next", tests]) == 2
    assert "2 pairs of tool and work material" in (said := " ".join(capsys.readouterr().err.split()))
    assert "--work A; --work 'B b'." in said
    assert main(["next", tests, "--work", "C"]) == 2
    assert "none of them with work material C" in capsys.readouterr().err
    assert main(["next", tests, "--work", "B b"]) == 0
    assert "on B b; cut in the order" in capsys.readouterr().out
    assert main([tests, "--out", str(tmp_path / "fit"), "--draws", "1000", "--quiet"]) == 0
    for path in (tmp_path / "fit").glob("*/params.json"):
        pf = parameters.read(path)
        remedy = follow_up(pf, "next")
        assert remedy.endswith(f"--work {shlex.quote(pf.identity.work)}")
        form = next(one for one in actions(Subject("two", "p", json.loads(path.read_text()))) if one.name == "next")
        words = command(form, Subject("two", "p", json.loads(path.read_text())), {}, [tests])
        assert f"--work={pf.identity.work}" in words
        assert main([*shlex.split(remedy)[1:], "--quiet"]) == 0


def test_a_pair_of_a_batch_is_corrected_in_its_own_file(tmp_path):
    """The command in its file names the folder and options of many pairs, which no other command takes."""
    shop, out = tmp_path / "shop", tmp_path / "out"
    shop.mkdir()
    text = datasets.bundled("gc435_709m40").read_text("utf-8")
    (shop / "a.csv").write_text(text.replace(",10,0.14,1.07,647", ",10,0.00014,1.07,647"))
    assert main(["batch", str(shop), "--no-site", "--out", str(out), "--criterion", "0.2", "--jobs", "1", "-q"]) == 0
    pf = parameters.read(next(out.glob("pairs/*/params.json")))
    assert follow_up(pf, "next") == f"fitmodels next {shop}/a.csv --criterion 0.2"
    commands = [remedy.command for one in verdicts_of(pf) for remedy in one.remedies if remedy and remedy.command]
    correcting = next(one for one in commands if "--correct" in one)
    assert correcting.startswith(f"fitmodels {shop}/a.csv --criterion 0.2 --correct")
    assert main([*shlex.split(correcting)[1:], "--out", str(tmp_path / "fit"), "--draws", "1000", "-q"]) == 0


def together(seed=1, more=()):
    """Wear of edges whose feed followed the speed, of a known law; ``more`` are settings (V, f) cut besides."""
    rng = np.random.default_rng(seed)
    rows = []
    for i, (V, f) in enumerate([(100, 0.1), (150, 0.2), (200, 0.3), (250, 0.4), (100, 0.1), (200, 0.3), *more]):
        level = np.exp(rng.normal(0, 0.06))
        wear = [1.5e-5 * V**1.6 * f**0.4 * t**0.55 * level * np.exp(rng.normal(0, 0.03)) for t in (2, 5, 8)]
        rows += [(f"E{i}", V, f, 1.6, t, VB) for t, VB in zip((2, 5, 8), wear, strict=True)]
    return pd.DataFrame(rows, columns=["edge", "V [m/min]", "f [mm/rev]", "d [mm]", "t [min]", "VB [mm]"])


def planned(capsys, *words):
    """Rows and notes of the plan that the command prints."""
    assert main(["next", *map(str, words), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    return pd.DataFrame(found["rows"]), " ".join(found["notes"])


def test_factors_that_vary_together_are_separated_by_the_plan(tmp_path, capsys):
    """Feed followed speed; on the same line no number of tests separates them."""
    together().to_csv(tmp_path / "a.csv", index=False)
    rows, notes = planned(capsys, tmp_path / "a.csv")
    assert "V, f varied together in the tests so far" in notes
    assert "Outside of the tested combinations: N01, N02, N03, N04." in notes
    assert "begin with one short cut" in notes
    assert {(100.0, 0.4), (250.0, 0.1)} == {*zip(rows["V"], rows["f"], strict=True)}
    assert rows["t"].max() <= 8  # the longest so far
    together(more=[*zip(rows["V"], rows["f"], strict=True)]).to_csv(tmp_path / "b.csv", index=False)
    law = fit.default_laws(datasets.read_runs(tmp_path / "b.csv"))[0][0]
    assert fit.judge(law).checks["collinearity"].concern == 0
    assert law.params["V"] == pytest.approx(1.6, abs=0.25)
    assert "varied together" not in planned(capsys, tmp_path / "b.csv")[1]
    assert "without --decision" in planned(capsys, tmp_path / "a.csv", "--decision", "life")[1]


def test_a_depth_that_follows_the_feed_is_planned_though_the_law_left_it_out(tmp_path, capsys):
    rng = np.random.default_rng(2)
    V, f = (x.ravel() for x in np.meshgrid([140.0, 180, 230], np.repeat([0.1, 0.2, 0.3], 2)))
    force = 1800 * f**0.75 * 10 * f * np.exp(rng.normal(0, 0.03, len(V)))
    table = pd.DataFrame({"V [m/min]": V, "f [mm/rev]": f, "ap [mm]": 10 * f, "Fc [N]": force.round()})
    table.to_csv(tmp_path / "a.csv", index=False)
    rows, notes = planned(capsys, tmp_path / "a.csv")
    assert "f, d varied together" in notes
    assert "without limit now" in notes
    assert np.corrcoef(np.log(rows["f"]), np.log(rows["d"]))[0, 1] < -0.9
    assert (rows["f"] * rows["d"] <= 0.9).all()  # the largest chip cut
    assert "does not set d: set it as in the tests" in planned(capsys, tmp_path / "a.csv", "--decision", "Fc=900")[1]


def test_factors_against_each_other_are_separated_by_lighter_cuts(tmp_path, capsys):
    """The higher the speed the smaller the feed: both high at once was never cut, and is not proposed."""
    frame = together()
    frame["f [mm/rev]"] = 0.04 / frame["f [mm/rev]"]
    frame.to_csv(tmp_path / "a.csv", index=False)
    rows, notes = planned(capsys, tmp_path / "a.csv")
    assert "V, f varied together" in notes
    assert (rows["V"] * rows["f"] <= 1.05 * (frame["V [m/min]"] * frame["f [mm/rev]"]).max()).all()


def test_edges_are_planned_until_the_criterion_and_no_longer_than_asked(tmp_path, capsys):
    """Wear of a known law, cut far past the criterion: the life at each setting is that of the law."""
    rng = np.random.default_rng(4)
    rows = []
    for i, V in enumerate(np.repeat([100.0, 150.0, 220.0], 3)):
        level = np.exp(rng.normal(0, 0.05))
        wear = [9.5e-6 * V**1.8 * t**0.6 * level * np.exp(rng.normal(0, 0.02)) for t in (5, 15, 30, 60)]
        rows += [(f"E{i}", V, t, VB, 900 * V**-0.1) for t, VB in zip((5, 15, 30, 60), wear, strict=True)]
    names = ["edge", "V [m/min]", "t [min]", "VB [mm]", "Fc [N]"]
    frame = pd.DataFrame(rows, columns=names)
    frame["Fc [N]"] *= np.exp(rng.normal(0, 0.02, len(frame)))
    frame.to_csv(tmp_path / "a.csv", index=False)
    life = fit.tool_life(fit.default_laws(datasets.read_runs(tmp_path / "a.csv"))[0][0])
    for options in ([], ["--law", "Fc"], ["--longest", "10"]):
        rows, notes = planned(capsys, tmp_path / "a.csv", *options)
        expected = [min(life.values(V=V), 10.0 if options[:1] == ["--longest"] else 60.0) for V in rows["V"]]
        np.testing.assert_allclose(rows["t"], expected, rtol=0.05)
        assert rows["t"].min() < 30
        assert "until the wear criterion by the law of VB, at most" in notes


def test_rows_with_a_time_of_their_own_end_at_the_criterion_too():
    """Without edges the time is a setting of each test."""
    V, t = np.linspace(50.0, 160.0, 12), np.array([9.0, 4, 2, 7, 3, 8, 6, 2, 5, 2, 9, 4])
    wear = 0.01 * V**0.5 * t**0.4 * np.exp(np.random.default_rng(1).normal(0, 0.05, len(V)))
    law = fit.power_law(datasets.runs_from_frame(pd.DataFrame({"V": V, "t": t, "AW": wear})), "AW", ["V", "t"])
    assert law.edge is None
    assert next_runs(law, 4)["t"].max() > 7.0
    plan = next_runs(law, 4, durations=lambda table: np.full(len(table), 7.0))
    assert 0 < plan["t"].max() <= 7.0


def test_where_no_test_reaches_the_criterion_the_plan_is_whole_and_says_so(tmp_path, capsys):
    """Edges of 3 min at a life of hours: three times as long reaches the criterion nowhere in the tested region."""
    rng = np.random.default_rng(3)
    rows = []
    for i, (V, f) in enumerate([(60, 0.1), (60, 0.2), (90, 0.1), (90, 0.2), (75, 0.14), (75, 0.14)]):
        level = np.exp(rng.normal(0, 0.05))
        rows += [(f"E{i}", V, f, t, 9e-6 * V**1.8 * f**0.3 * t**0.55 * level * np.exp(rng.normal(0, 0.02)))
                 for t in (1, 2, 3)]  # fmt: skip
    pd.DataFrame(rows, columns=["edge", "V [m/min]", "f [mm/rev]", "t [min]", "VB [mm]"]).to_csv(tmp_path / "a.csv")
    rows, notes = planned(capsys, tmp_path / "a.csv")
    assert len(rows) == 4
    assert rows["t"].tolist() == [9.0] * 4
    assert "by the law none of these tests reaches the criterion in the longest time, 9 min" in notes
    assert "these tests last until the criterion" not in notes
    advised = notes.partition("Test at higher speeds, or run edges longer: --longest ")[2].split(".")[0]
    rows, notes = planned(capsys, tmp_path / "a.csv", "--longest", advised)
    assert "reach it by the law" in notes
    assert len(rows) == 4


def test_settings_that_were_the_same_in_all_tests_are_in_the_plan(tmp_path, capsys):
    """A law has no factor that was constant; a plan without it cannot be cut."""
    frame = together().assign(coolant="flood")
    frame["V [m/min]"] = 150
    frame.to_csv(tmp_path / "a.csv", index=False)
    rows, notes = planned(capsys, tmp_path / "a.csv")
    assert [*rows][:6] == ["run", "edge", "point", "V", "f", "d"]
    assert {*rows["V"]} == {150}
    assert {*rows["d"]} == {1.6}
    assert {*rows["coolant"]} == {"flood"}
    assert "no effect of it: V 150 m/min, d 1.6 mm" in notes
    frame.assign(**{"f [mm/rev]": 0.2}).to_csv(tmp_path / "b.csv", index=False)
    rows, notes = planned(capsys, tmp_path / "b.csv")
    assert rows[["V", "f", "d"]].drop_duplicates().to_numpy().tolist() == [[150, 0.2, 1.6]]
    assert len(rows) == 4
    assert "fitmodels plan --range V=LOW:HIGH --range f=LOW:HIGH --range d=LOW:HIGH" in notes


def test_a_plan_names_the_verdict_on_its_law_and_gives_no_advice_to_stop_on_wrong_rows(tmp_path, capsys):
    """Thirteen of thirty lives are exactly 30 min, as if tests had ended there: no law of them says when to stop."""
    rng = np.random.default_rng(3)
    V, f, d = (x.ravel() for x in np.meshgrid([140.0, 180, 230], [0.12, 0.2, 0.3], [1.0, 2.0]))
    life = 3.2e7 * V**-2.9 * f**-0.6 * d**-0.3 * np.exp(rng.normal(0, 0.12, len(V)))
    table = pd.DataFrame({"Vc [m/min]": V, "f [mm/rev]": f, "ap [mm]": d, "T [min]": life.round(1)})
    table.to_csv(tmp_path / "sound.csv", index=False)
    assert "This plan rests" not in planned(capsys, tmp_path / "sound.csv")[1]
    table["T [min]"] = table["T [min]"].clip(upper=30)
    table.to_csv(tmp_path / "a.csv", index=False)
    notes = planned(capsys, tmp_path / "a.csv")[1]
    assert "This plan rests on the law of T: usable with reservations" in notes
    assert "run-outs not marked" in notes
    assert "No advice on when to stop, since the law is in doubt." in notes
    assert "Stop:" not in notes
    assert "Stop after" not in notes
