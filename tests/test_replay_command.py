"""``fitmodels replay``: what a file can drive is run, told and drawn; what it cannot is said."""

import json

import pytest
from fitmodels import parameters
from fitmodels.cli import main
from fitmodels.parameters.published import PAPERS, published

pytestmark = pytest.mark.usefixtures("small_pictures")

DRIVES = {
    "AC-2016": "region",
    "AC-2017": "recursion",
    "CLM-2023": "constant-load",
    "CLM-2023-slot": "constant-load",
    "SURF": "roughness",
    "LYAP": "adaptive-force",
}


@pytest.mark.slow
@pytest.mark.parametrize("paper", PAPERS)
def test_every_paper_is_replayed_from_its_file_alone(paper, tmp_path, capsys):
    file = parameters.write(published(paper), tmp_path / "params.json")
    assert main(["replay", str(file), "--system", DRIVES[paper]]) == 0
    said = capsys.readouterr().out
    assert ("   calculated" if DRIVES[paper] in ("region", "recursion") else "   simulated") in said
    assert "Figures: " in said
    pictures = sorted(path.name for path in (tmp_path / "figures").iterdir())
    assert pictures
    assert all(name.endswith(".png") and name in said.replace("\n", " ") for name in pictures)


@pytest.mark.parametrize("simulated", [True, False])
def test_figures_are_marked_where_the_tests_behind_the_laws_were_simulated(simulated):
    from fitmodels.cards.replays import replayed

    paper = published("AC-2016")
    identity = paper.identity.model_copy(update={"simulated": simulated})
    report = replayed("region", paper.model_copy(update={"identity": identity}), {}, 1)
    for figure in report.figures.values():
        texts = {figure.get_suptitle(), figure.get_supxlabel()}
        assert ("SIMULATED DATA, laws not measured" in texts) is simulated


def test_the_name_of_a_paper_stands_for_its_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["replay", "AC-2017", "--system", "recursion", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["schema"] == "fitmodels.replay/3"
    assert facts["simulated"] is published("AC-2017").identity.simulated
    assert list(facts["systems"]) == ["recursion"]
    assert not list(tmp_path.iterdir())  # nothing is drawn without --out


def test_the_replay_of_constant_load_states_what_a_fault_does(capsys):
    """Times of detection and of the fall to the lower limit, by the settings of the file and by what is assumed."""
    assert main(["replay", "CLM-2023", "--system", "constant-load", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)["systems"]["constant-load"]
    (words,) = [line for line in report["lines"] if "is a fault" in line]
    assert words.startswith(
        "A load that is invalid for 0.05 s, equal for 1 s in the cut or without a heartbeat for 0.2 s"
    )
    assert "takes the feed to 600 mm/min within a further 0.5 s" in words
    assert report["monitoring"] == {
        "load_low": 0.05, "load_high": 1.0, "overload_load": pytest.approx(1.05 * 0.28), "unit_load": "A",
        "arm_after_s": 0.5, "lost_after_s": 0.05, "stuck_after_s": 1.0, "heartbeat_s": 0.2, "overload_after_s": 0.5,
        "on_fault": "lower limit",
    }  # fmt: skip
    assert "on_fault lower limit, not stop" in report["assumed"]


def test_wear_in_mm_is_printed_in_mm_with_three_digits(tmp_path, capsys):
    """CLM-2023 with its wear in mm in place of um: the same replay, the same sentence but for the unit."""
    data = published("CLM-2023").model_dump()
    laws, line = data["laws"], data["load_line"]
    laws["I"]["coefficients"]["k1"] *= 1000
    laws["VB"]["coefficients"]["c0"] /= 1000
    laws["I"]["equation"] = laws["VB"]["equation"] = ""
    laws["VB"]["unit"] = line["unit_wear"] = laws["I"]["factors"][-1]["unit"] = "mm"
    factor = laws["I"]["factors"][-1]
    factor.update({name: factor[name] / 1000 for name in ("low", "high")})
    for limit in (line["upper"], line["lower"]):
        limit["wear"] /= 1000
    line["window"] = [wear / 1000 for wear in line["window"]]
    changed = parameters.ParameterFile.model_validate({**data, "life": None, "content_sha256": None})
    file = parameters.write(changed, tmp_path / "params.json")
    report = _replayed(capsys, str(file), "--system", "constant-load")["constant-load"]
    assert report["lines"][0].startswith("Change the tool at VB 0.205 mm after 2094 mm")
    assert "window of 0.18 to 0.22 mm" in report["lines"][0]
    assert any("a tool worn by 0.201 mm" in line for line in report["lines"])
    assert not any(" 0 mm" in line for line in report["lines"])


def test_verdicts_stand_before_the_replay(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["replay", "AC-2017", "--system", "region"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("Verdict on the law of AW: usable with reservations. Assumed, not printed")


@pytest.mark.slow
def test_the_same_seed_prints_the_same(capsys):
    said = []
    for seed in ("1", "1", "2"):
        assert main(["replay", "SURF", "--json", "--seed", seed]) == 0
        said.append(capsys.readouterr().out.replace(f'"seed": {seed}', ""))
    assert said[0] == said[1] != said[2]


def test_a_file_without_what_a_controller_needs_says_what_is_missing(tmp_path, capsys):
    file = parameters.write(parameters.collect(tool="GC435", work="709M40"), tmp_path / "params.json")
    assert main(["replay", str(file)]) == 3
    said = capsys.readouterr().err
    assert all(system in said for system in DRIVES.values())
    assert "fitmodels settings" in said


def _replayed(capsys, *words):
    assert main(["replay", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)["systems"]


def test_settings_take_units_and_hold_for_region_and_plan(capsys):
    """0.1 inch is 2.54 mm, 330 s are 5.5 min, of which 5 whole minutes are planned."""
    systems = _replayed(capsys, "AC-2017", "--depth", "0.1in", "--time", "330s", "--at", "D=8cm")
    region, plan = systems["region"], systems["recursion"]
    assert (region["d_mm"], region["t_min"], region["at"]) == (2.54, 5.5, {"D": 80.0})
    assert (plan["depth_mm"], plan["life_min"], plan["worn_out"]) == (2.54, 5.0, False)
    assert plan["intervals"][0]["n_per_min"] == pytest.approx(1000 * 150 / (3.141592653589793 * 80))
    assert "Of 5.5 min 5 are planned: whole intervals of 1 min." in plan["assumed"][1]
    assert plan["extrapolated"] == region["extrapolated"] == []
    assert plan["replay_agrees"]


@pytest.mark.parametrize(
    ("words", "begins"),
    [
        (
            ["--objective", "time", "--time", "12min", "--grid", "V=25m/min", "--grid", "f=0.06mm/rev"],
            "Most metal in 12",
        ),
        (["--objective", "life", "--removal", "130cm3/min"], "Longest life at 130 cm3 per min or more"),
    ],
)
def test_an_objective_is_stated_with_what_the_recursion_gives(words, begins, capsys):
    plan = _replayed(capsys, "AC-2017", "--system", "recursion", "--wear-state", *words)["recursion"]
    assert plan["lines"][0].startswith(begins)
    assert any("the largest removal rate of each interval for itself: that gives" in line for line in plan["lines"])
    assert plan["replay_agrees"]
    assert (plan["wear"], plan["objective"]) == ("wear_state", words[1])


def test_least_cost_is_stated_with_its_bound(tmp_path, capsys):
    file = parameters.write(published("AC-2017"), tmp_path / "params.json")
    assert main(["costs", str(file), "machine=30/h", "edge=3", "change=2min", "currency=USD"]) == 0
    capsys.readouterr()
    words = ["--objective", "cost", "--wear-state", "--grid", "V=25m/min", "--grid", "f=0.06mm/rev"]
    plan = _replayed(capsys, str(file), "--system", "recursion", *words)["recursion"]
    assert plan["lines"][0].startswith("Least cost, 0.00")
    assert any(line.startswith("No sequence costs less than 0.00") for line in plan["lines"])
    assert plan["cost_per_cm3"]["currency"] == "USD"


def test_outside_the_tests_both_replays_say_extrapolated(capsys):
    systems = _replayed(capsys, "AC-2017", "--depth", "1.2mm", "--time", "8min")
    for name in ("region", "recursion"):
        assert any(line.startswith("EXTRAPOLATED: d 1.2") for line in systems[name]["lines"]), name
        assert systems[name]["extrapolated"]
        assert not any("EXTRAPOLATED" in line for line in systems[name]["assumed"])


def test_the_recursion_states_the_best_sequence_of_its_time_and_the_bound(capsys):
    plan = _replayed(capsys, "AC-2017", "--system", "recursion")["recursion"]
    words = "By the wear state the recursion removes 2158 cm3, and the best sequence of its 14 min removes 2235 cm3"
    assert any(line.startswith(words) for line in plan["lines"])
    best = plan["best_sequence_wear_state"]
    assert best["recursion_mm3"] < best["removed_mm3"] <= best["bound_mm3"]


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["AC-2017", "--system", "recurson"], 2, "Did you mean 'recursion'?"),
        (["AC-2017", "--system", "roughness"], 3, "does not support this controller"),
        (["nowhere.json"], 3, "the file does not exist"),
        (["AC-2017", "--seed", "-1"], 2, "seed"),
        (["AC-2017", "--depth", "1.5kg"], 2, "--depth 1.5kg: give a number in mm, for instance 1.5mm"),
        (["AC-2017", "--time", "0min"], 2, "give a value above zero"),
        (["AC-2017", "--by", "steel"], 2, "no law has levels"),
        (["AC-2017", "--at", "HB=200"], 2, "no law has this factor"),
        (["AC-2017", "--grid", "d=1mm"], 2, "the grid is of V and f"),
        (["AC-2017", "--objective", "cost"], 2, "the file has no costs"),
        (["AC-2017", "--objective", "time"], 2, "--time 15min"),
        (["CLM-2023", "--depth", "1mm"], 2, "--depth belongs to region and recursion"),
        (["AC-2017", "--system", "region", "--removal", "3", "--objective", "life"], 2, "belongs to recursion"),
    ],
)
def test_a_wrong_word_is_one_sentence(words, code, says, capsys):
    assert main(["replay", *words]) == code
    assert says in capsys.readouterr().err
