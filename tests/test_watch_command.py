"""``fitmodels watch`` as a user runs it: a recorded run, its journal, requests, and refusals of one sentence."""

import gc
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fitmodels import parameters
from fitmodels.cli import main
from fitmodels.live.watching import Watch

sys.path.insert(0, str(Path(__file__).parent))

from watched_edge import parameter_file, samples

sys.path.remove(str(Path(__file__).parent))

HEADER = "time [s],P [kW],V [m/min],f [mm/rev],d [mm],state\n"


def row(sample):
    return f"{sample.time:.2f},{sample.loads['P']:.5f},150,0.2,2,{sample.state}\n"


@pytest.fixture
def shop(tmp_path, monkeypatch):
    """A folder with a parameter file and a recorded run of three cuts."""
    monkeypatch.chdir(tmp_path)
    parameters.write(parameter_file(), "params.json")
    Path("run.csv").write_text(HEADER + "".join(map(row, samples(rate=5.0))))
    return tmp_path


OPEN = '"kind":"contact","time":9'  # in the second cut
RUN = ["watch", "params.json", "--from", "run.csv", "--replay", "max", "--criterion", "AW=0.25mm"]


def test_a_watch_collects_its_garbage(shop, monkeypatch):
    """It runs for days, and the process begins without the collector."""
    seen = []
    monkeypatch.setattr(Watch, "run", lambda *given: seen.append((gc.isenabled(), gc.get_freeze_count() > 0)))
    gc.disable()
    try:
        assert main(RUN) in (0, 3)
    finally:
        gc.enable()
        gc.unfreeze()
    assert seen == [(True, True)]


def test_a_recorded_run_ends_with_the_state_of_the_edge(shop, capsys):
    assert main([*RUN, "--journal", "kept", "--stream", "s.jsonl"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "shadow mode: nothing is written to the machine" in out
    assert "contact   3.0" in out
    assert max(map(len, out.splitlines())) <= 100
    lines = [json.loads(line) for line in Path("s.jsonl").read_text().splitlines()]
    assert lines[-1]["state"] == "stopped"
    assert main(["watch", "params.json", "--journal", "kept", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["cut_minutes"] == pytest.approx(3.0, abs=0.05)
    assert facts["wear"]["median"] == pytest.approx(lines[-1]["wear"]["median"])


def test_the_same_run_again_adds_nothing_and_a_gauge_reading_narrows_the_wear(shop, capsys):
    main([*RUN, "--journal", "kept"])
    capsys.readouterr()
    main([*RUN, "--journal", "kept", "--json"])
    facts = json.loads(capsys.readouterr().out)
    assert facts["cut_minutes"] == pytest.approx(3.0, abs=0.05)
    wear = facts["wear"]
    assert main(["watch", "params.json", "--journal", "kept", "--gauge", f"AW={wear['median']}mm", "--json"]) == 0
    after = json.loads(capsys.readouterr().out)["wear"]
    assert after["high"] - after["low"] < 0.9 * (wear["high"] - wear["low"])
    assert main(["watch", "params.json", "--journal", "kept", "--new-edge", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["edge"]["number"] == 2


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["watch", "params.json"], "--from"),
        ([*RUN[:-1], "VB=0.25mm"], "AW"),
        ([*RUN[:-1], "AW=0.25kW"], "AW"),
        (RUN[:-2], "--criterion"),
        ([*RUN, "--risk", "5"], "probability"),
        ([*RUN, "--replay", "fast"], "--replay fast"),
        (["watch", "params.json", "--from", "nowhere.csv", "--criterion", "0.3"], "nowhere.csv"),
        (["watch", "params.json", "--journal", "nowhere", "--criterion", "0.3"], "holds no journal"),
        ([*RUN, "--stream", "-", "--json"], "--stream -"),
        ([*RUN, "--serve", "opc.tcp://0.0.0.0:4841"], "--serve"),
        ([*RUN, "--least-cost"], "--least-cost"),
        ([*RUN, "--journal", "run.csv"], "run.csv"),
        ([*RUN, "--page", "99999"], "--page 99999"),
        ([*RUN, "--value", "Q=2"], "no condition 'Q'"),
        ([*RUN, "--value", "ae=-2mm"], "above zero"),
        ([*RUN[:-1], "AW=300"], "AW=300um"),
        ([*RUN, "--certain"], "--gauge"),
    ],
)
def test_refusals_are_one_sentence(shop, capsys, words, sentence):
    assert main(words) in (2, 3)
    out, err = capsys.readouterr()
    assert sentence in err
    assert "Traceback" not in err + out
    assert "internal error" not in err


def test_a_journal_of_another_parameter_file_is_refused(shop, capsys):
    main([*RUN, "--journal", "kept"])
    pf = parameter_file()
    Path("params.json").unlink()
    parameters.write(
        pf.model_copy(update={"identity": pf.identity.model_copy(update={"tool": "GC4325"})}), "params.json"
    )
    capsys.readouterr()
    assert main([*RUN, "--journal", "kept"]) == 2
    assert "GC4325" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_a_watch_that_is_ended_in_mid_cut_goes_on_and_loses_no_cutting(shop, how, capsys):
    """A growing file; the process is ended in the second cut and started again."""
    lines = [row(sample) for sample in samples(rate=5.0)]
    Path("run.csv").write_text(HEADER + "".join(lines[:500]))
    command = [sys.executable, "-m", "fitmodels", "watch", "params.json", "--from", "run.csv", "--criterion", "0.25"]
    child = subprocess.Popen([*command, "--journal", "kept"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    journal = Path("kept/watch-000001.jsonl")
    end = time.monotonic() + 60
    while time.monotonic() < end and not (journal.exists() and OPEN in journal.read_text()):
        time.sleep(0.05)
    os.kill(child.pid, how)
    error = child.communicate()[1]
    assert child.returncode == (-9 if how == signal.SIGKILL else 0)
    assert error == b""
    with Path("run.csv").open("a") as file:
        file.writelines(lines[500:])
    assert main([*RUN, "--journal", "kept", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["cut_minutes"] == pytest.approx(3.0, abs=0.1)
    assert facts["edge"]["number"] == 1


def test_a_second_watch_on_one_journal_is_refused_and_its_requests_reach_the_first(shop, capsys):
    from fitmodels.core.files import locked_folder
    from fitmodels.live.watch_journal import requests

    main([*RUN, "--journal", "kept"])
    capsys.readouterr()
    with locked_folder(Path("kept"), "held"):
        assert main([*RUN, "--journal", "kept"]) == 2
        assert "another fitmodels watch" in capsys.readouterr().err
        assert main(["watch", "params.json", "--journal", "kept", "--gauge", "AW=0.2mm"]) == 0
        assert "Left for the process" in capsys.readouterr().out
    assert [facts["wear"] for _, facts in requests(Path("kept"))] == [0.2]


def test_a_measured_edge_gives_the_next_version_and_a_new_edge_begins_with_it(shop, capsys):
    main([*RUN, "--journal", "kept"])
    before = Path("params.json").read_bytes()
    capsys.readouterr()
    command = ["watch", "params.json", "--journal", "kept", "--measured", "AW=140um"]
    assert main(command) == 0
    out = capsys.readouterr().out
    assert "Written: params-2.json; params.json is unchanged." in out
    assert Path("params.json").read_bytes() == before
    learned = parameters.read("params-2.json")
    assert learned.laws["AW"].n_edges == parameter_file().laws["AW"].n_edges + 1
    assert [edge.startswith("kept-") for edge in learned.history[0].edges] == [True]
    assert main(command) == 3
    assert "params-2.json" in capsys.readouterr().err
    assert main(["watch", "params-2.json", *RUN[2:], "--journal", "kept", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["edge"]["number"], facts["cut_minutes"]) == (2, 0.0)


def test_options_of_learning_need_their_measurement_and_an_edge_that_has_cut(shop, capsys):
    main([*RUN, "--journal", "kept"])
    capsys.readouterr()
    for words, sentence in (
        (["--journal", "kept", "--batch", "B2"], "--measured"),
        (["--journal", "kept", "--measured", "AW=0.2mm", "--edge", "7"], "edge 7"),
        (["--journal", "kept", "--measured", "VB=0.2mm"], "VB"),
        (["--journal", "kept", "--measured", "AW=0.2kg"], "kg"),
        (["--measured", "AW=0.2mm"], "--journal"),
    ):
        assert main(["watch", "params.json", *words]) in (2, 3)
        assert sentence in capsys.readouterr().err
    assert not Path("params-2.json").exists()


def test_a_gauge_reading_that_is_not_used_is_no_success(shop, capsys):
    main([*RUN, "--journal", "kept"])
    capsys.readouterr()
    assert main(["watch", "params.json", "--journal", "kept", "--gauge", "AW=21mm"]) == 2
    assert "check unit and edge" in capsys.readouterr().err
    assert main(["watch", "params.json", "--journal", "kept", "--gauge", "AW=0.12mm"]) == 0
    assert "taken in; expected" in capsys.readouterr().out


def test_least_cost_without_the_cost_of_a_failure_is_said(shop, capsys):
    main(["costs", "params.json", "machine=60/h", "edge=8", "change=1.5min", "volume=120cm3", "currency=EUR"])
    capsys.readouterr()
    assert main([*RUN, "--least-cost"]) == 0
    assert "no cost of a failed edge" in " ".join(capsys.readouterr().out.split())
