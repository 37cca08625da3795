"""``fitmodels roughness``: reference force by both readings, kc a, time constants, limits; each value with its origin.

References: numpy's least squares on the tests themselves, SURF's Table 1 and text (0.13 s, 610 rpm, 0 to 150 %),
geometry of feed marks computed from a drawn profile; ill-posed input is refused and nothing is written.
"""

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.cli import main
from fitmodels.controllers.gate.roughness import check_roughness
from fitmodels.controllers.roughness.inverse import inverse_force
from fitmodels.controllers.roughness.plant import loop_theory
from fitmodels.controllers.roughness.reference import (
    ideal_roughness,
    largest_feed,
    regression_of_law,
)
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published

GIVEN = ("Ra=1.6um", "n=610rpm", "f=0.2mm/rev", "servo=0.13s")
TABLE = datasets.bundled("surf_table1")


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A parameter file of Table 1: Ra on F, and F on f."""
    laws = [fit.exponential_law(TABLE, "Ra", "F"), fit.power_law(TABLE, "F", ["f"])]
    path = tmp_path_factory.mktemp("surf") / "params.json"
    parameters.write(parameters.collect(laws=laws, simulated=True), path)
    return path


@pytest.fixture
def params(source, tmp_path):
    path = tmp_path / "params.json"
    path.write_bytes(source.read_bytes())
    return path


def settings(params, *words):
    assert main(["roughness", str(params), *words, "--quiet"]) == 0
    return parameters.read(params).roughness


def refused(params, capsys, *words):
    """The message of a refusal, which leaves the file as it was."""
    before = params.read_bytes()
    assert main(["roughness", str(params), *words]) in (2, 3)
    out, err = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in err
    assert params.read_bytes() == before
    return err


def step(path, unit, response, rate=100):
    """A record of two steps of the feed command, up at 1 s and down at 4 s, from 0.1 to 0.2 mm/rev."""
    t = np.arange(7 * rate) / rate
    u = np.where((t >= 1) & (t < 4), 0.2, 0.1)
    up, down = (response(np.maximum(t - at, 0)) * (t >= at) for at in (1, 4))
    y = 0.1 * response(np.full(1, np.inf))[0] + 0.1 * (up - down)
    y += 0.002 * np.abs(y).max() * np.random.default_rng(5).standard_normal(t.size)
    rows = [f"{a:.3f},{b:.3f},{c:.5f}" for a, b, c in zip(t, u, y, strict=True)]
    path.write_text(f"# simulated\ntime [s],command [mm/rev],measured [{unit}]\n" + "\n".join(rows) + "\n", "utf-8")
    return str(path)


def servo(gain=1.0, ts=0.13):
    return lambda t: gain * -np.expm1(-t / ts)


def force(gain=2800.0, tc=0.3, ts=0.08):
    return lambda t: gain * (1 - (tc * np.exp(-t / tc) - ts * np.exp(-t / ts)) / (tc - ts))


# --- reference force ------------------------------------------------------------------------------------


def test_reference_force_by_both_readings_equals_least_squares_of_the_tests(params):
    runs = datasets.read_runs(TABLE).data
    F, ln_Ra = runs["F"].to_numpy(), np.log(runs["Ra"].to_numpy())
    b, ln_a = np.polyfit(F, ln_Ra, 1)
    slope, constant = np.polyfit(ln_Ra, F, 1)
    section = settings(params, *GIVEN)
    assert section.force == pytest.approx((math.log(1.6) - ln_a) / b, rel=1e-9)
    assert section.regression.slope == pytest.approx(slope, rel=1e-7)
    assert section.regression.constant == pytest.approx(constant, rel=1e-7)
    other = settings(params, *GIVEN, "--force-from", "regression", "--force")
    assert other.force == pytest.approx(constant + slope * math.log(1.6), rel=1e-7)
    assert other.force_from == "regression"


def test_regression_on_the_required_roughness_is_that_of_the_paper(params):
    section = settings(params, *GIVEN, "--data", str(TABLE), "--map", "Ra=Ra_ref")
    assert (round(section.regression.constant, -1), round(section.regression.slope, -1)) == (450, 260)
    assert "Ra_ref" in section.sources["regression"]


def test_interval_of_the_reference_force_holds_its_level(source):
    law, rng, F, inside = parameters.read(source).laws["Ra"], np.random.default_rng(7), np.linspace(450, 750, 12), 0
    X = np.column_stack([np.ones(F.size), F])
    for _ in range(1000):
        ln_Ra = math.log(0.1725) + 0.003844 * F + 0.1 * rng.standard_normal(F.size)
        (ln_a, b), rss, *_ = np.linalg.lstsq(X, ln_Ra, rcond=None)
        matrix = (rss[0] / 10 * np.linalg.inv(X.T @ X)).tolist()
        C = law.uncertainty.model_copy(update={"matrix": matrix, "df": 10})
        drawn = law.model_copy(update={"coefficients": {"a": math.exp(ln_a), "b": b}, "uncertainty": C})
        found = inverse_force(drawn, 1.6)
        inside += found.low < math.log(1.6 / 0.1725) / 0.003844 < found.high
    assert inside / 1000 == pytest.approx(0.95, abs=0.02)  # three of its standard errors


def test_a_force_that_the_tests_do_not_determine_is_refused_without_a_reason(tmp_path, capsys):
    """A law that may not rise with force at all gave a reference that was accepted."""
    rng, F = np.random.default_rng(4), np.linspace(450, 750, 8)
    Ra = 1.2 * np.exp(0.0006 * F + 0.25 * rng.standard_normal(F.size))
    runs = datasets.runs_from_frame(pd.DataFrame({"F": F, "Ra": Ra}), units={"F": "N", "Ra": "um"})
    path = tmp_path / "params.json"
    parameters.write(parameters.collect(laws=[fit.exponential_law(runs, "Ra", "F")]), path)
    law = parameters.read(path).laws["Ra"]
    given = (f"Ra={law.coefficients['a'] * math.exp(600 * law.coefficients['b']):.3f}um", *GIVEN[1:], "kca=2800N")
    err = " ".join(refused(path, capsys, *given).split())
    assert "end: the tests do not determine the force" in err
    assert "--beyond-tests" in err
    assert main(["roughness", str(path), *given, "--beyond-tests", "trial on scrap"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "NOT DETERMINED: The reference force is" in out
    assert "not bounded" not in out
    assert any("trial on scrap" in note for note in parameters.read(path).roughness.notes)


def test_a_force_whose_interval_includes_zero_is_refused_without_a_reason(source, tmp_path, capsys):
    """Both ends are finite, but a force of 0 gives the roughness as well as any other."""
    pf = parameters.read(source)
    law, C = pf.laws["Ra"], pf.laws["Ra"].uncertainty

    def widened(factor):
        matrix = tuple(tuple(float(factor * value) for value in row) for row in C.matrix)
        return law.model_copy(update={"uncertainty": C.model_copy(update={"matrix": matrix})})

    wide = next(w for w in map(widened, np.geomspace(1, 1e5, 400)) if inverse_force(w, 1.6).low <= 0)
    assert math.isfinite(inverse_force(wide, 1.6).low + inverse_force(wide, 1.6).high)
    path = parameters.write(pf.model_copy(update={"laws": {**pf.laws, "Ra": wide}}), tmp_path / "wide.json")
    assert "includes 0 N: the tests do not determine the force" in " ".join(refused(path, capsys, *GIVEN).split())


def test_regression_through_the_covariance_equals_that_of_noisy_tests():
    rng, F = np.random.default_rng(3), np.linspace(300, 900, 20)
    Ra = 0.24 * np.exp(0.0034 * F + 0.2 * rng.standard_normal(F.size))
    runs = datasets.runs_from_frame(pd.DataFrame({"F": F, "Ra": Ra}), units={"F": "N", "Ra": "um"})
    law = parameters.collect(laws=[fit.exponential_law(runs, "Ra", "F")]).laws["Ra"]
    slope, constant = np.polyfit(np.log(Ra), F, 1)
    assert regression_of_law(law) == pytest.approx((constant, slope), rel=1e-6)


# --- values derived, with their origin ------------------------------------------------------------------


def test_each_value_has_an_origin_and_is_printed_with_it(params, capsys):
    assert main(["roughness", str(params), *GIVEN, "d=1mm", "r=0.8mm"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    section = parameters.read(params).roughness
    unsourced = {"law", "force_from", "sources", "notes", "unit_roughness", "unit_force", "unit_feed", "unit_depth"}
    held = {name for name, value in section if value not in (None, ())} - unsourced
    assert held == set(section.sources)
    for name in held - {"regression"}:
        assert section.sources[name] in text
    assert "Programmed feed 0.2 mm/rev (given)" in text
    assert section.process_time == pytest.approx(60 / 610)
    assert "one revolution" in section.sources["process_time"]
    law = parameters.read(params).laws["F"]
    assert section.force_per_feed == pytest.approx(float(law.values(f=0.2)) / 0.2)
    assert (section.override_low, section.override_high) == pytest.approx((0.5, 1.4))  # tested up to 0.28 mm/rev


def test_values_of_the_paper_give_the_published_section(tmp_path):
    paper, path = published("SURF"), tmp_path / "params.json"
    parameters.write(sealed(paper, roughness=None), path)
    words = ("kca=2781.15N", "override=0:150%", "threshold=100N", "wait=0.3s", "sample=10ms")
    section = settings(path, *GIVEN, *words, "--data", str(TABLE), "--map", "Ra=Ra_ref")
    for name in ("force", "feed", "threshold", "threshold_time", "override_low", "override_high", "sample_time",
                 "servo_time", "process_time", "force_per_feed"):  # fmt: skip
        assert getattr(section, name) == pytest.approx(getattr(paper.roughness, name), rel=1e-6), name
    assert section.regression.slope == pytest.approx(paper.roughness.regression.slope, rel=1e-9)


def test_the_file_replays_and_the_command_is_recorded(params, capsys):
    settings(params, *GIVEN)
    assert "fitmodels roughness" in parameters.read(params).provenance.then[-1]
    capsys.readouterr()
    assert main(["replay", str(params), "--system", "roughness", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["systems"]["roughness"]["Ra_mean_um"] == pytest.approx(1.6, rel=0.03)


def test_kc_times_depth_a_given_gain_and_other_units(params):
    assert settings(params, *GIVEN, "d=1mm", "kc=2500N/mm2").force_per_feed == 2500
    more = ("kca=2781N/(mm/rev)", "sample=5ms", "override=50:120%", "valid=-0.05:3kN", "--force")
    section = settings(params, "Ra_ref=63uin", "spindle=610rpm", "feed=122mm/min", "ts=130ms", *more)
    assert section.roughness == pytest.approx(1.6002)
    assert (section.feed, section.servo_time, section.sample_time) == pytest.approx((0.2, 0.13, 0.005))
    assert (section.override_low, section.override_high) == (0.5, 1.2)
    assert (section.force_per_feed, section.force_high) == (2781, 3000)


def test_programmed_feed_is_the_one_of_the_reference_force(params):
    section = settings(params, "Ra=1.6um", "n=610rpm", "servo=0.13s")
    law = parameters.read(params).laws["F"]
    assert float(law.values(f=section.feed)) <= section.force < float(law.values(f=section.feed + 0.001))


def test_times_and_gain_of_recorded_steps(params, tmp_path):
    of_servo = step(tmp_path / "servo.csv", "mm/rev", servo())
    of_force = step(tmp_path / "force.csv", "N", force(tc=0.3, ts=0.13))
    section = settings(params, *GIVEN[:3], "--step", of_servo, "--step", of_force)
    assert section.servo_time == pytest.approx(0.13, rel=0.02)
    assert section.process_time == pytest.approx(0.3, rel=0.05)
    assert "servo.csv" in section.sources["servo_time"]
    bare = parameters.collect(laws=[fit.exponential_law(TABLE, "Ra", "F")])
    parameters.write(bare, tmp_path / "bare.json")
    section = settings(tmp_path / "bare.json", *GIVEN, "--step", of_force)
    assert section.force_per_feed == pytest.approx(2800, rel=0.02)
    assert "force.csv" in section.sources["force_per_feed"]


def test_times_and_gain_of_a_record_without_steps(params, tmp_path):
    t, noise = np.arange(2000) / 100, np.random.default_rng(8)
    u = 0.2 + 0.02 * (np.sin(2 * t) + np.sin(5.3 * t) + np.sin(11 * t))
    x, F, rows = 0.2, 560.0, []
    for time, command in zip(t, u, strict=True):
        rows.append(f"{time:.2f},{60 * 10 * command:.4f},{F + noise.standard_normal():.3f}")
        for _ in range(20):
            x, F = x + (command - x) * 0.0005 / 0.13, F + (2800 * x - F) * 0.0005 / 0.3
    (tmp_path / "run.csv").write_text("time [s],command [mm/min],force [N]\n" + "\n".join(rows) + "\n", "utf-8")
    words = ("Ra=1.6um", "n=600rpm", "f=0.2mm/rev", "servo=0.13s", "--step", str(tmp_path / "run.csv"))
    section = settings(params, *words)
    assert section.process_time == pytest.approx(0.3, rel=0.05)
    bare = parameters.collect(laws=[fit.exponential_law(TABLE, "Ra", "F")])
    parameters.write(bare, tmp_path / "bare.json")
    assert settings(tmp_path / "bare.json", *words).force_per_feed == pytest.approx(2800, rel=0.03)


def test_ideal_roughness_is_that_of_a_drawn_profile():
    f, r = 0.2, 0.8
    x = np.linspace(-f / 2, f / 2, 100001)
    z = r - np.sqrt(r * r - x * x)
    assert ideal_roughness(f, r) == pytest.approx(1000 * np.mean(np.abs(z - z.mean())), rel=0.01)


def test_largest_feed_is_the_width_of_the_arc_at_a_small_depth():
    r, d = 0.8, 0.05
    x = np.linspace(-r, r, 200001)
    assert largest_feed(r, d)[0] == pytest.approx(np.ptp(x[r - np.sqrt(r * r - x * x) <= d]), rel=1e-3)
    assert largest_feed(r, 1.0)[0] == r


# --- beyond the tests -----------------------------------------------------------------------------------


def test_a_feed_far_beyond_the_tests_is_refused_without_a_reason(params, capsys):
    assert "nose radius" in refused(params, capsys, *GIVEN, "override=0:10000%")
    assert "--beyond-tests" in refused(params, capsys, *GIVEN, "r=1.6mm", "override=0:250%")
    section = settings(params, *GIVEN, "r=1.6mm", "override=0:250%", "--beyond-tests", "trial on scrap")
    assert any("EXTRAPOLATED" in note and "trial on scrap" in note for note in section.notes)
    capsys.readouterr()
    words = ("--beyond-tests", "trial", "--force")  # a reason does not accept what no edge can do
    assert "cannot form" in refused(params, capsys, *GIVEN, "r=0.8mm", "override=0:500%", *words)
    assert "nose radius" in refused(params, capsys, *GIVEN, "r=0.8mm", "override=0:250%", *words)
    assert parameters.read(params).roughness == section


def test_a_feed_somewhat_beyond_the_tests_is_stated(params, capsys):
    assert main(["roughness", str(params), *GIVEN, "override=0:150%"]) == 0
    assert "EXTRAPOLATED" in capsys.readouterr().out
    assert any("EXTRAPOLATED" in note for note in parameters.read(params).roughness.notes)


def test_without_tests_of_feed_150_per_cent_is_the_most(tmp_path, capsys):
    path = tmp_path / "params.json"
    parameters.write(parameters.collect(laws=[fit.exponential_law(TABLE, "Ra", "F")]), path)
    pf = json.loads(path.read_text("utf-8"))
    assert pf["design"] is None or not any(one["symbol"] == "f" for one in pf["design"]["factors"])
    assert "--beyond-tests" in refused(path, capsys, *GIVEN, "kca=2800N", "override=0:160%")
    assert settings(path, *GIVEN, "kca=2800N", "override=0:150%").override_high == 1.5


def test_a_force_above_the_tests_is_refused_and_one_below_is_stated(params, capsys):
    assert "lies above the tests" in refused(params, capsys, "Ra=4um", *GIVEN[1:])
    section = settings(params, "Ra=0.9um", *GIVEN[1:])
    assert any("lies below the tests" in note for note in section.notes)


def test_a_given_gain_far_from_the_force_law_needs_a_reason(params):
    section = settings(params, *GIVEN, "kca=800N", "--beyond-tests", "depth of a third")
    assert section.force_per_feed == 800
    assert any("2878" in note and "depth of a third" in note for note in section.notes)


@pytest.mark.parametrize("values", [GIVEN, ("Ra=1.6um", "n=610rpm", "f=0.2mm/rev", "servo=0.13s", "override=10:150%")])
def test_assumed_values_are_those_of_their_source(params, values):
    section = settings(params, *values).model_dump()
    pf = parameters.read(params)
    assert all(finding.passed is not False for finding in check_roughness(pf))
    for name, words in (("threshold", "The threshold "), ("threshold_time", "The time above the threshold")):
        for times in (0.1, 0.5, 2.0, 10.0):
            if name == "threshold" and times * section[name] >= section["force"]:
                continue
            wrong = sealed(pf, roughness={**section, name: times * section[name]})
            failed = [finding.words for finding in check_roughness(wrong) if finding.passed is False]
            assert any(words in each for each in failed), (name, times)


def test_settings_that_the_check_fails_are_refused_or_said_at_once(params, capsys):
    lower = (*GIVEN[:2], "f=0.05mm/rev", *GIVEN[3:])  # the reference needs 0.13 mm/rev
    assert "outside the limits" in refused(params, capsys, *lower)
    assert main(["roughness", str(params), *lower, "--beyond-tests", "trial on scrap"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "! fitmodels check fails these settings, and no export is made: Roughness control: At the ref" in said
    assert main(["check", str(params), "-q"]) == 5


def test_a_condition_outside_the_tests_of_the_force_law_is_stated(tmp_path):
    rng = np.random.default_rng(2)
    frame = pd.DataFrame([(f, d) for f in (0.1, 0.2, 0.3) for d in (0.5, 1.0, 2.0)], columns=["f", "d"])
    frame["F"] = 2000 * frame["d"] * frame["f"] ** 0.75 * np.exp(0.02 * rng.standard_normal(len(frame)))
    frame["Ra"] = 0.24 * np.exp(0.0034 * frame["F"] + 0.05 * rng.standard_normal(len(frame)))
    runs = datasets.runs_from_frame(frame, units={"f": "mm/rev", "d": "mm", "F": "N", "Ra": "um"})
    laws = [fit.exponential_law(runs, "Ra", "F"), fit.power_law(runs, "F", ["f", "d"])]
    parameters.write(parameters.collect(laws=laws), tmp_path / "params.json")
    section = settings(tmp_path / "params.json", *GIVEN, "d=1mm")
    assert section.force_per_feed == pytest.approx(2000 * 0.2**-0.25, rel=0.02)
    assert section.notes == ()
    section = settings(tmp_path / "params.json", *GIVEN, "d=2.5mm", "override=20:150%", "--force")
    assert any("d 2.5 mm is outside" in note for note in section.notes)


# --- ill-posed input ------------------------------------------------------------------------------------


def test_a_reversed_step_is_refused(params, tmp_path, capsys):
    of_force = step(tmp_path / "force.csv", "N", force(gain=-2800.0))
    assert "falls as the command rises" in refused(params, capsys, *GIVEN[:3], "--step", of_force)
    of_servo = step(tmp_path / "servo.csv", "mm/rev", servo(gain=-1.0))
    assert "falls as the command rises" in refused(params, capsys, *GIVEN[:3], "--step", of_servo)


def test_a_sample_time_beyond_the_process_is_refused(params, capsys):
    assert "must be sampled" in refused(params, capsys, *GIVEN, "sample=10s")
    assert "must be sampled" in refused(params, capsys, *GIVEN, "sample=0.06s")
    section = settings(params, *GIVEN, "sample=0.04s")
    assert loop_theory(section.process_time, section.servo_time, section.sample_time).servo_radius < 1


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("Ra=1.6",), "unit is missing"),
        (("Ra=1.6N",), "no unit of it"),
        (("Ra=-1um",), "above zero"),
        (("Ra=1,6um",), "decimal point"),
        (("Ra=nan um",), "decimal point"),
        (("Ra=0.1um",), "no force gives less"),
        (("Ra=1.6um", "roughness=2um"), "same quantity"),
        (("Ra=1.6um", "Rq=2um"), "no such value"),
        (("Ra=1.6um", "override=120:80%"), "low must be below"),
        (("Ra=1.6um", "threshold=700N"), "and below it"),
        (("Ra=1.6um", "threshold=1N"), "above 1 %"),
        (("Ra=1.6um", "valid=0:300N"), "enclose"),
        (("Ra=1.6um", "valid=-1e9:1e9N"), "at most 20 times the reference force 579.5 N"),
        (("Ra=1.6um", "valid=-1e9:3000N"), "narrow the range"),
        (("Ra=1.6um", "valid=-1100:3000N"), "would be taken for air, where the feed rises"),
        (("Ra=1.6um", "override=0:1.4%"), "10 % of the programmed feed, assumed as the override begins at 0"),
        (("Ra=1.6um", "kca=1e9N"), "kc a 1e+09 N per mm/rev and the 2878 N per mm/rev"),
        (("Ra=1.6um", "kca=800N"), "Correct the value or its unit"),
        (("Ra=1.6um", "kca=1e9N", "--beyond-tests", "trial"), "check kc a"),
        (("Ra=1.6um", "kc=2500N/mm2"), "d=1mm"),
        (("Ra=1.6um", "--step", "missing.csv"), "missing.csv"),
        (("Ra=1.6um", "--law", "F"), "is not Ra = a exp(b F)"),
        (("Ra=1.6um", "--level", "1.5"), "--level"),
        (("Ra=1.6um", "--force-law", "Fx"), "no such law"),
        (("Ra=1.6um", "d=1mm", "kca=2.8N"), "specific force of 2.8 N/mm2"),
        (("Ra=1.6um", "process=98s"), "0.001 to 10 s"),
        (("Ra=1.6um", "wait=1h"), "not controlled"),
        (("Ra=1.6um", "r=0.1mm"), "cannot form"),
        (("Ra=1.6um", "r=0.3mm"), "and nose radius 0.3 mm"),
    ],
)
def test_values_that_cannot_be_used_are_refused_with_one_sentence(params, capsys, words, named):
    assert named in refused(params, capsys, *GIVEN[1:], *words)


def test_a_feed_that_gives_too_little_force_is_named_with_its_value(params, capsys):
    """0.2 mm/min at 610 1/min is 0.000328 mm/rev: no threshold was given."""
    words = refused(params, capsys, *GIVEN[:2], "f=0.2mm/min", GIVEN[3])
    assert "f=0.0003279mm/rev gives" in words
    assert "correct f or its unit; threshold=" in words
    assert "correct f" not in refused(params, capsys, *GIVEN, "threshold=1N")


def test_what_is_missing_is_named(params, tmp_path, capsys):
    assert "n=610rpm" in refused(params, capsys, "Ra=1.6um")
    assert "servo=0.13s" in refused(params, capsys, *GIVEN[:3])
    bare = tmp_path / "bare.json"
    parameters.write(parameters.collect(laws=[fit.exponential_law(TABLE, "Ra", "F")]), bare)
    assert "kc a is not known" in refused(bare, capsys, *GIVEN)
    parameters.write(parameters.collect(laws=[fit.power_law(TABLE, "F", ["f"])]), tmp_path / "none.json")
    assert "--form Ra=exponential" in refused(tmp_path / "none.json", capsys, *GIVEN)


def test_settings_are_replaced_only_with_force(params, capsys):
    settings(params, *GIVEN)
    capsys.readouterr()
    assert "--force" in refused(params, capsys, *GIVEN)


def test_json_holds_the_section_and_both_readings(params, capsys):
    assert main(["roughness", str(params), *GIVEN, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["schema"] == "fitmodels.roughness/1"
    assert facts["file"] == Path(params).name
    low, high = (facts["reference"]["interval"][end] for end in ("low", "high"))
    assert low < facts["roughness"]["force"] < high
    assert facts["roughness"]["sources"]["feed"] == "given"
