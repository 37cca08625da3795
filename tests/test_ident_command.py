"""``fitmodels ident`` and ``excite``: from a file to a model in a parameter file, as a user runs them."""

import json
import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fitmodels import ident, parameters
from fitmodels.cards.content.dynamics import _nonminimum_phase
from fitmodels.cli import main
from fitmodels.datasets.records.formats import looks_like_record
from fitmodels.ident import Model
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("small_pictures")]

EXAMPLES = Path(__file__).resolve().parents[1] / "docs" / "examples"
G = Model(b=[0, 0.0611, -0.1338, 0.0752], a=[1, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")

    def call(*arguments):
        code = main([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return code, " ".join(out.split()), err

    return call


@pytest.fixture
def german(tmp_path):
    """A record as a German measuring programme writes it."""
    u = ident.chirp()
    y = G.simulate(u) + 0.24 + 0.005 * np.random.default_rng(1).standard_normal(len(u))
    rows = (f"{k / 50:.2f};{a + 5:.5f};{b:.5f}".replace(".", ",") for k, (a, b) in enumerate(zip(u, y, strict=True)))
    path = tmp_path / "lauf.csv"
    path.write_text("Zeit [s];Vorschubspannung [V];Spindelstrom [A]\n" + "\n".join(rows) + "\n", encoding="latin-1")
    return path


@pytest.mark.parametrize("stated", [(), ("--deviations",)])
def test_a_record_about_zero_is_noted_unless_it_is_stated_to_hold_deviations(run, german, tmp_path, stated):
    text = german.read_text("latin-1").splitlines()
    zero = [
        f"{row.rpartition(';')[0]};{float(row.rpartition(';')[2].replace(',', '.')) - 0.24:.5f}" for row in text[1:]
    ]
    german.write_text("\n".join([text[0], *(row.replace(".", ",") for row in zero)]), encoding="latin-1")
    pf = published("CLM-2023")
    law = {**pf.laws["I"].model_dump(), "verdict": {"level": "usable inside the tested region"}}
    parameters.write(sealed(pf, laws={"I": law}), tmp_path / "params.json")
    code, out, _ = run("ident", german.name, "--params", "params.json", "--force", *stated)
    assert code == 0
    assert ("otherwise it was not made in a cut" in out) == (not stated)
    run("card", "params.json")
    noted = "The record of the dynamics was made about" in (tmp_path / "card.html").read_text("utf-8")
    assert noted == (not stated)


def test_a_record_is_recognised_and_identified(run, german, tmp_path):
    code, out, err = run(german.name)
    assert (code, err) == (0, "")
    assert "G(z) = (0.06" in out
    assert "Non-minimum phase" in out
    assert "sensor noise most likely biases ARX" in out
    folder = tmp_path / "lauf-fit"
    pf = parameters.read(folder / "params.json")
    d = pf.dynamics
    assert (d.nk, len(d.a), d.unit_u, d.unit_y) == (1, 4, "V", "A")
    assert d.held_out_fit > 90
    np.testing.assert_allclose(np.abs(d.response([0.5, 1.0])), np.abs(G.response([0.5, 1.0])), rtol=0.03)
    names = {path.name for path in (folder / "figures").iterdir()}
    assert names == {
        "simulated.png", "bode.png", "step.png", "poles_zeros.png", "residuals.png", "structure.png"
    }  # fmt: skip
    card = (folder / "README.md").read_text(encoding="utf-8")
    assert "## Dynamics" in card
    assert not re.search(r"\bnan\b", card.lower())
    assert run(german.name)[0] == 2  # it is there already


@pytest.mark.parametrize(
    ("zeros", "words"),
    [
        ([1.2], "first moves in the opposite direction"),
        ([1.1 + 0.4j, 1.1 - 0.4j], "reverses its direction for a time, soon after"),
    ],
)
def test_the_step_of_a_model_with_zeros_outside_the_circle_is_described_as_it_moves(zeros, words):
    """Vidyasagar 1986, IEEE Trans. Automatic Control 31, 440: an odd number of real zeros reverses it."""
    b = np.real(np.poly(zeros))
    G = Model(b=[0.0, *(b / b.sum())], a=[1.0, -1.5, 0.56], nk=1, sample_time=0.02, unit_u="V", unit_y="A")
    step = G.simulate(np.ones(200))
    assert (step[np.flatnonzero(step)[0]] * step[-1] < 0) == (words == "first moves in the opposite direction")
    (sentence,) = _nonminimum_phase(SimpleNamespace(b=G.b))
    assert words in sentence


def test_the_result_stands_above_the_details(run, german):
    code, out, _ = run(german.name, "--json")
    data = json.loads(out)
    code, out, _ = run(german.name)
    assert code == 0
    first, _, details = out.partition(" Details ")
    assert f"Simulation fit {data['dynamics']['fit']:.0f} % (samples" in first
    assert re.search(r"settles in \d\.\d+ s after a step of .*; no delay; noise 0\.00\d+ A; valid from", first)
    assert "G(z) =" not in first
    assert "G(z) =" in details


def test_a_record_outside_the_loads_of_the_tests_is_named_with_its_range(run, tmp_path):
    shutil.copy(EXAMPLES / "fraesen.csv", tmp_path)
    shutil.copy(EXAMPLES / "drive.csv", tmp_path)
    assert run("fraesen.csv", "--out", "out")[0] == 0
    (file,) = (tmp_path / "out").rglob("params.json")
    code, out, _ = run("ident", "drive.csv", "--params", file)
    assert code == 0
    assert "! The record of the dynamics was made about 0.026 A (-0.45 to 0.45 A), the tests of 'I' lie at 0.18" in out


def test_every_axis_has_a_label_and_time_is_as_long_as_the_answer(german, tmp_path):
    from fitmodels.datasets import read_record
    from fitmodels.ident import figures

    found = ident.identify(read_record(german))
    panels = [
        *figures.simulation_and_residuals(found.validation, found.validated_on),
        *figures.bode(found.model, ident.frequency_response(found.record)),
        *figures.structure_chart(found), *figures.residual_correlations(found.validation),
        figures.step_figure(found.model), figures.poles_and_zeros(found.model),
    ]  # fmt: skip
    lower = [ax for ax in panels if ax.get_subplotspec().is_last_row()]
    assert all(ax.get_xlabel() for ax in lower)
    assert "current" in panels[0].get_ylabel() or "[A]" in panels[0].get_ylabel()
    assert "[A/V]" in panels[2].get_ylabel()
    assert "chosen" in panels[4].get_title()
    chosen = found.tried.iloc[0]
    assert panels[5].get_yticklabels()[0].get_text() == f"na {chosen.na:.0f}, nb {chosen.nb:.0f}, nk {chosen.nk:.0f}"
    end = panels[-2].get_xlim()[1]
    assert 1.0 < end < 4.0  # the plant has settled after 1.2 s; the record lasts 15 s


@pytest.mark.parametrize(("T", "dt"), [(0.3, 0.02), (5.0, 0.02), (0.001, 0.02)])
def test_a_drawn_step_is_as_long_as_the_answer(T, dt):
    from fitmodels.ident.continuous import ContinuousModel
    from fitmodels.ident.figures import SHORTEST, answer_samples

    n = answer_samples(ContinuousModel(np.array([2.0]), np.array([T, 1.0])).sampled(dt))
    settled = np.log(100) * T / dt
    assert n == SHORTEST or settled < n < 2.5 * settled
    integrating = ContinuousModel(np.array([2.0]), np.array([T, 1.0, 0.0])).sampled(dt)
    assert answer_samples(integrating) <= 3 * settled + 2 * SHORTEST


def runs_of(tmp_path, dead_zone, amplitudes=(0.8, 2.5)):
    """Chirps of several amplitudes through a dead zone and the plant."""
    names = []
    for k, amplitude in enumerate(amplitudes):
        u = amplitude / 2.5 * ident.chirp()
        y = G.simulate(np.sign(u) * np.maximum(np.abs(u) - dead_zone, 0))
        y += 0.004 * np.random.default_rng(k).standard_normal(len(u))
        rows = (f"{j / 50:.2f},{a + 3:.6f},{b:.6f}" for j, (a, b) in enumerate(zip(u, y, strict=True)))
        (tmp_path / f"run{k}.csv").write_text("time [s],command [V],current [A]\n" + "\n".join(rows) + "\n")
        names.append(f"run{k}.csv")
    return names


def test_runs_of_several_amplitudes_of_a_linear_plant(run, tmp_path):
    code, out, _ = run("ident", *runs_of(tmp_path, 0.0), "--amplitudes", "--json")
    assert code == 0
    found = json.loads(out)["dynamics"]
    assert found["amplitudes"]["sentence"].startswith("linear within")
    assert [row["amplitude"] for row in found["amplitudes"]["runs"]] == pytest.approx([0.8, 2.5], abs=0.01)
    assert not any("amplitude" in reason for reason in found["verdict"]["reasons"])


def test_a_gain_that_depends_on_the_amplitude_reaches_the_file_and_its_gains(run, tmp_path):
    code, out, _ = run("ident", *runs_of(tmp_path, 0.2), "--amplitudes", "--out", "dz")
    assert code == 0
    assert "The gain depends on the amplitude: at 0.8 V" in out
    pf = parameters.read(tmp_path / "dz/params.json")
    assert pf.dynamics.verdict.concern >= 1
    assert any("depends on the amplitude" in reason for reason in pf.dynamics.verdict.reasons)
    assert "depends on the amplitude" in run("check", "dz/params.json")[1]
    _, out, _ = run("tune", "dz/params.json", "--settle", "3")
    assert "Verdict on the gains: usable inside" not in out


def test_amplitudes_need_several_runs_that_differ(run, tmp_path):
    names = runs_of(tmp_path, 0.0, (2.5, 2.5))
    code, _, err = run("ident", names[0], "--amplitudes")
    assert (code, "two files or more" in err) == (2, True)
    code, _, err = run("ident", *names, "--amplitudes", "--out", "same")
    assert (code, "hardly differ" in err) == (4, True)


def test_arx_is_handed_over_by_choice_with_its_warning(run, german, tmp_path):
    code, out, _ = run("ident", german.name, "--handover", "arx", "--out", "arx")
    assert code == 0
    assert "ARX model is used by choice" in out
    d = parameters.read(tmp_path / "arx/params.json").dynamics
    assert d.structure == "arx"
    assert any("by choice" in reason for reason in d.verdict.reasons)
    code, _, err = run("ident", german.name, "--handover", "arx", "--as", "step")
    assert code == 2
    assert "--handover has an effect only without --as" in err


def test_the_explicit_command_says_the_same(run, german):
    code, out, _ = run("ident", german.name, "--input", "Vorschubspannung", "--output", "Spindelstrom", "--json")
    assert code == 0
    report = json.loads(out)
    assert report["parameters"]["dynamics"]["nk"] == 1
    assert report["dynamics"]["fit"] > 90
    assert report["dynamics"]["verdict"] == report["parameters"]["dynamics"]["verdict"]
    assert report["dynamics"]["verdict"]["level"] == "usable inside the tested region"


def test_dynamics_are_added_to_a_file_that_is_there(run, german, tmp_path):
    pf = parameters.collect(tool="end mill", work="S45C")
    parameters.write(pf, tmp_path / "p.json")
    assert run("ident", german.name, "--params", "p.json")[0] == 0
    added = parameters.read(tmp_path / "p.json")
    assert added.identity.tool == "end mill"
    assert added.dynamics is not None
    code, _, err = run("ident", german.name, "--params", "p.json")
    assert code != 0
    assert "--force" in err


@pytest.mark.parametrize(
    ("record", "command"),
    [
        ("drive.csv", "ident drive.csv --params p.json"),
        ("force-chirp.csv", "ident force-chirp.csv --as force-process --depth 2 --spindle 3000rpm --params p.json"),
    ],
)
def test_a_simulated_record_marks_the_file_that_it_joins(run, tmp_path, record, command):
    """A controller of measured laws and simulated dynamics must not look measured."""
    shutil.copy(EXAMPLES / record, tmp_path)
    parameters.write(parameters.collect(tool="end mill", work="S45C", simulated=False), tmp_path / "p.json")
    code, out, _ = run(*command.split())
    assert code == 0
    assert "the whole file counts as that: do not run a machine with it" in " ".join(out.split())
    assert parameters.read(tmp_path / "p.json").identity.simulated is True
    assert "simulated or computed, not measured: do not run a machine" in " ".join(run("check", "p.json")[1].split())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--orders", "3,3"], "three whole numbers"),
        (["--input", "nowhere"], "nowhere"),
        (["--rate", "70"], "70"),
    ],
)
def test_bad_options_in_a_sentence(run, german, options, words):
    code, _, err = run("ident", german.name, *options)
    assert code in (2, 3)
    assert words in err
    assert err.count("\n") == 1


def test_a_table_of_tests_is_still_one(run):
    from fitmodels.datasets import bundled

    code, out, _ = run(bundled("gc435_709m40"))
    assert code == 0
    assert "AW = 0.0086 V^0.533" in out


# excite


def test_an_excitation_is_written_and_read_back(run, tmp_path):

    code, out, _ = run("excite", "--out", "u.csv")
    assert code == 0
    assert "750 samples at 50 Hz" in out
    table = np.loadtxt(tmp_path / "u.csv", delimiter=",", skiprows=2)
    np.testing.assert_array_equal(table[:, 1], ident.chirp())
    assert "# sample rate: 50 Hz" in (tmp_path / "u.csv").read_text()
    assert looks_like_record(tmp_path / "u.csv").kind in ("record", "table")
    assert run("excite", "--out", "u.csv")[0] == 2


@pytest.mark.parametrize("kind", ["chirp", "logarithmic", "prbs", "multisine", "steps"])
def test_every_kind_stays_within_its_level(run, tmp_path, kind):
    code, _, err = run(
        "excite", "--kind", kind, "--amplitude", "2", "--offset", "5", "--out", "u.csv", "--duration", "20"
    )
    assert code == 0, err
    u = np.loadtxt(tmp_path / "u.csv", delimiter=",", skiprows=2)[:, 1]
    assert u.min() > 2.99
    assert u.max() < 7.01


def test_the_errors_to_come_are_reported_before_cutting(run, german):
    assert run(german.name, "--out", "fit")[0] == 0
    short = run("excite", "--like", "fit/params.json", "--noise", "0.005")[1]
    unit = parameters.read("fit/params.json").dynamics.unit_u
    assert f"-2.5 to 2.5 {unit}, crest" in short
    code, _, err = run("excite", "--like", "fit/params.json", "--noise", "0.005", "--unit", "furlong")
    assert (code, f"is in {unit}; leave --unit out" in err) == (2, True)
    assert "takes 100 s, longer than the 15 s" in run("excite", "--band", "0.01:2")[1]
    assert "takes" not in run("excite", "--band", "0.1:2", "--duration", "10")[1]
    long = run("excite", "--like", "fit/params.json", "--noise", "0.005", "--duration", "60")[1]
    assert "the predicted standard error of the gain is" in short

    def reported(out):
        return float(out.split("Hz")[-1].split("%")[0])

    assert reported(long) < reported(short)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--band", "2:0.1"], "low:high"),
        (["--band", "0.1:60"], "half the"),
        (["--high", "1"], "limit"),
        (["--like", "nowhere.json", "--noise", "1"], "the file does not exist"),
    ],
)
def test_an_excitation_that_cannot_be(run, options, words):
    code, _, err = run("excite", *options)
    assert code in (2, 3, 4)
    assert words in err
