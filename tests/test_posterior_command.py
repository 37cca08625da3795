"""The posterior in the main job: drawn by default, handed on whole, and nothing written from behind a shut gate."""

import hashlib

import numpy as np
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.cli import main
from fitmodels.core import errors

SHORT = datasets.bundled("ac2017_table1")
GC435 = datasets.bundled("gc435_709m40")
PAIR = "GC435_709M40"


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")

    def call(*arguments):
        code = main([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return code, out, err

    return call


def pair_of(folder):
    return next(path.parent for path in sorted(folder.rglob("params.json")))


def test_priors_that_no_law_has_are_refused_before_a_law_is_shown(run, tmp_path):
    mine = tmp_path / "p.toml"
    mine.write_text('[AW]\nnosuch = { distribution = "normal", mean = 0, sd = 1 }\n')
    code, out, err = run(GC435, "--out", "a", "--priors", mine)
    assert code == 2
    assert "usable" not in out
    assert "the law of AW has no parameter 'nosuch'" in err


def test_a_second_screen_says_why_it_follows_and_that_the_prior_contradicts_the_tests(run, tmp_path):
    mine = tmp_path / "p.toml"
    mine.write_text('[AW]\nV = { distribution = "normal", mean = 3, sd = 0.1 }\n[Fc]\nsource = "x"\n')
    code, out, err = run(GC435, "--out", "a", "--priors", mine)
    assert code == 0
    first, _, second = " ".join(out.split()).partition("The posterior changes a verdict. This replaces the above:")
    assert "prior" not in first
    assert "AW usable with reservations; prior contradicts the tests" in second
    assert "The prior of V, 3.00 ± 0.10, contradicts the tests" in second
    assert "priors of Fc are not used: this file has no such law." in err


def test_priors_of_a_response_that_does_not_exist_are_refused(run, tmp_path):
    (tmp_path / "p.toml").write_text('[VX]\nV = { distribution = "normal", mean = 3, sd = 0.1 }\n')
    code, out, err = run(GC435, "--out", "a", "--priors", "p.toml")
    assert (code, out) == (2, "")
    assert "priors of VX: there is no such response" in err


def test_draws_in_the_folder_are_those_of_the_laws(run, tmp_path):
    assert run(GC435, "--out", "a")[0] == 0
    folder = pair_of(tmp_path / "a")
    pf = parameters.read(folder / "params.json")
    draws = parameters.read_draws(pf, folder)
    assert set(draws) == set(pf.laws)
    law = fit.power_law(datasets.read_runs(GC435), "AW", ["V", "f", "d", "t"])
    expected = fit.posterior(law, seed=1)
    assert np.array_equal(draws["AW"].values, expected.draws)
    reported = pf.posterior.laws["AW"]
    assert reported.method == "exact"
    assert reported.prior_set == "weak"
    assert reported.parameters["V"].median == pytest.approx(np.median(expected.draws[:, 1]))
    assert reported.priors["V"].numbers == {"mean": 0.0, "sd": 2.0}
    assert reported.ess > 400
    assert reported.r_hat < 1.01
    assert hashlib.sha256((folder / "draws.npz").read_bytes()).hexdigest() == pf.posterior.draws_sha256


@pytest.mark.slow
def test_the_seed_decides_and_is_recorded(run, tmp_path):
    for out, seed in (("a", 5), ("b", 5), ("c", 6)):
        assert run(GC435, "--out", out, "--seed", seed)[0] == 0
    a, b, c = ((pair_of(tmp_path / name) / "draws.npz").read_bytes() for name in "abc")
    assert a == b
    assert a != c
    assert parameters.read(pair_of(tmp_path / "a") / "params.json").posterior.seed == 5
    assert ": unchanged" in run(GC435, "--out", "a", "--seed", 5)[1]


def test_priors_of_ones_own_are_used_and_a_changed_file_is_noticed(run, tmp_path):
    mine = tmp_path / "mine.toml"
    mine.write_text('[AW]\nV = { distribution = "normal", mean = 3.0, sd = 0.01 }\n', encoding="utf-8")
    code, out, _ = run(GC435, "--full", "--out", "a", "--priors", mine)
    assert code == 0
    pf = parameters.read(pair_of(tmp_path / "a") / "params.json")
    assert pf.posterior.laws["AW"].parameters["V"].mean == pytest.approx(3.0, abs=0.05)
    assert "Prior sensitivity: priors of half or double width shift" in " ".join(out.split())
    mine.write_text('[AW]\nV = { distribution = "normal", mean = 2.0, sd = 0.01 }\n', encoding="utf-8")
    assert run(GC435, "--out", "a", "--priors", mine)[0] == 2  # another fit stands there


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["--draws", "10"], 2, "draws 10: give a whole number from 1000"),
        (["--seed", "-1"], 2, "-1 is not a seed"),
        (["--priors", "nowhere.toml"], 3, "nowhere.toml cannot be read"),
    ],
)
def test_bad_options_in_a_sentence_and_nothing_written(run, tmp_path, options, code, words):
    got, _, err = run(GC435, "--out", "a", *options)
    assert got == code
    assert words in err
    assert err.count("\n") == 1
    assert not (tmp_path / "a").exists()


def test_a_shut_gate_writes_nothing_and_ends_with_5(run, tmp_path, monkeypatch):
    monkeypatch.setattr("fitmodels.fit.bayes.convergence.ESS", 1e9)
    code, out, err = run(GC435, "--out", "a")
    assert code == 5
    assert "effective draws" in err
    assert "Nothing was written" in err
    assert "Written" not in out
    assert not (tmp_path / "a").exists()


def test_a_posterior_behind_a_shut_gate_is_not_collected(monkeypatch):
    post = fit.posterior(fit.power_law(datasets.read_runs(GC435), "AW", ["V"]))
    monkeypatch.setattr("fitmodels.fit.bayes.convergence.R_HAT", 0.5)
    with pytest.raises(errors.GateError, match="R-hat") as error:
        parameters.collect(tool="a", work="b", laws=[post.law], posteriors=[post])
    assert error.value.exit_code == 5


def test_a_law_that_rows_meet_exactly_has_a_reason_and_no_draws(run, tmp_path):
    rows = ["V,f,AW", *(f"{V},{f},{0.001 * V * f**0.5!r}" for V in (50, 100, 150, 200) for f in (0.1, 0.2, 0.3))]
    (tmp_path / "exact.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    code, out, _ = run("exact.csv", "--tool", "x", "--work", "y", "--full")
    assert code == 0
    assert "No posterior: the law fits every row exactly" in " ".join(out.split())
    folder = pair_of(tmp_path / "exact-fit")
    pf = parameters.read(folder / "params.json")
    assert pf.posterior.draws_file is None
    assert not (folder / "draws.npz").exists()


@pytest.mark.slow
def test_verified_draws_say_so(run, tmp_path):
    code, out, _ = run(SHORT, "--out", "a", "--verify", "--full")
    assert code == 0, out
    assert "Verified by MCMC" in " ".join(out.split())


def test_an_interrupted_run_keeps_its_draws_and_says_so(run, tmp_path, monkeypatch):
    from dataclasses import replace

    from fitmodels.fit.bayes import draw_posterior

    whole = draw_posterior.draw

    def stopped(*arguments, **options):
        found = whole(*arguments, **options)
        return replace(found, sample=replace(found.sample, interrupted=True))

    monkeypatch.setattr(draw_posterior, "draw", stopped)
    code, _, err = run(GC435, "--out", "a")
    assert code == 5
    assert "the run was interrupted" in err
    kept = tmp_path / "a" / "GC435_709M40-En-19.draws-so-far.npz"
    assert str(kept.relative_to(tmp_path)) in err
    assert set(parameters.draws.unpacked(kept.read_bytes(), "kept")) == {"AW"}
    assert not list((tmp_path / "a").rglob("params.json"))
