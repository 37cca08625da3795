"""``fitmodels replay``: what a file can drive is run, told and drawn; what it cannot is said."""

import json

import pytest
from fitmodels import parameters
from fitmodels.cli import main
from fitmodels.parameters.published import PAPERS, published

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
    assert "simulated" in said
    assert "Figures: " in said
    pictures = sorted(path.name for path in (tmp_path / "figures").iterdir())
    assert pictures
    assert all(name.endswith(".png") and name in said.replace("\n", " ") for name in pictures)


def test_the_name_of_a_paper_stands_for_its_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["replay", "AC-2017", "--system", "recursion", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["schema"] == "fitmodels.replay/2"
    assert facts["simulated"] is True
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


def test_verdicts_stand_before_the_replay(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["replay", "AC-2017", "--system", "region"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("Verdict on the law of AW: usable with reservations. Assumed, not printed")


@pytest.mark.slow
def test_the_same_seed_tells_the_same(capsys):
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


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["AC-2017", "--system", "recurson"], 2, "Did you mean 'recursion'?"),
        (["AC-2017", "--system", "roughness"], 3, "does not support this controller"),
        (["nowhere.json"], 3, "the file does not exist"),
        (["AC-2017", "--seed", "-1"], 2, "seed"),
    ],
)
def test_a_wrong_word_is_one_sentence(words, code, says, capsys):
    assert main(["replay", *words]) == code
    assert says in capsys.readouterr().err
