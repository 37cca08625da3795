"""The gate before the export of a control: faults of a file are refused with their reason, legitimate files pass.

`benchmarks/gate_faults.py` draws the files and puts every fault into several of them; here are some of each.
"""

import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from fitmodels import controllers, parameters
from fitmodels.cli import main
from fitmodels.controllers.constant_load_milling.controller import ConstantLoad
from fitmodels.controllers.exports import CONTROLS, VALUES, rendered
from fitmodels.controllers.gate import check_control, gated_control, simulation
from fitmodels.controllers.gate.settings import Line
from fitmodels.controllers.gate.simulation import Bench, Cut, Drive
from fitmodels.core.errors import GateError, ParameterError
from fitmodels.parameters import ParameterFile
from fitmodels.parameters.checks.report import CheckReport
from fitmodels.parameters.exports.loop import loop_settings
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published

BENCHMARKS = Path(__file__).resolve().parent.parent / "benchmarks"


@pytest.fixture(scope="module")
def script():
    sys.path.insert(0, str(BENCHMARKS))
    try:
        return importlib.import_module("gate_faults")
    finally:
        sys.path.remove(str(BENCHMARKS))


@pytest.mark.parametrize("seed", range(4))
def test_a_legitimate_file_passes(script, seed):
    pf = script.sealed_file(script.drawn(seed))
    report = check_control(pf)
    assert report.ok, report.failed
    names = {"slope", "feed limits", "times", "simulation", "draws", "fault", "limits"}
    assert {f.name for f in report.findings} == names
    assert gated_control(pf).loop == loop_settings(pf, own_form=True).loop


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("current sensor reversed: dynamics and gains x -1", "positive feedback"),
        ("gains and scaling x 100", "times as much, outside 0.5 to 2"),
        ("dynamics.b x 50", "not stable|miss settling time"),
        ("no figures, gains and scaling x 100", "times as much, outside 0.5 to 2"),
        ("law.coefficients.k1 x 0.4", "where the load law gives"),
        ("law.factors.0.unit = mm/s", "give both in the same units"),
        ("load_line.upper.value = 1000000000.0", "1e.09"),
        ("load_line.engagement.feed_programmed x 2.5", "above the upper feed limit .* without adaptive feed"),
        ("load_line.engagement.engage_after = 1000000000.0", r"Engage_after is 1e\+09 s, outside 0 to 2 s"),
        ("load_line.engagement.arm_after = 10.5", "Arm_after is 10.5 s, outside 0 to 10 s"),
        ("load_line.engagement.back_off = 0.001", "Back_off takes .* s for the range of the feed"),
        ("load_line.engagement.recover = 1000.0", "faster than back_off"),
        ("load_line.engagement.load_low = 0.0", "lost sensor, which reads zero, would be taken for air"),
        ("load_line.engagement.idle = 1 x load_line.reference", "engages at|air would be taken for a cut"),
        ("laws dropped", "holds no law .* of the load"),
        ("dynamics dropped", "holds no dynamics, so the control cannot be simulated"),
        ("pi dropped", "has no PI gains"),
    ],
)
def test_a_single_fault_is_refused_with_its_reason(script, name, words):
    with pytest.raises(GateError, match=words):
        gated_control(script.sealed_file(script.faulty(3, name)))


def test_there_are_at_least_forty_single_faults(script):
    assert len([name for name in script.FAULTS if not name.startswith("no figures")]) >= 40


def test_check_and_export_refuse_a_reversed_current_sensor(script, tmp_path, monkeypatch, capsys):
    """It passed both: tune gave negative gains, and the export was positive feedback up to the full feed."""
    monkeypatch.chdir(tmp_path)
    fault = "current sensor reversed: dynamics and gains x -1"
    parameters.write(script.sealed_file(script.faulty(1, fault)), "params.json")
    assert main(["check", "params.json"]) == 5
    assert "FAIL  The load rises with feed by" in capsys.readouterr().out
    assert main(["check", "params.json", "--json"]) == 5
    found = json.loads(capsys.readouterr().out)
    assert [f["name"] for f in found["findings"] if f["passed"] is False] == ["slope"]
    for kind in (*CONTROLS, *VALUES):
        assert main(["export", "params.json", "--to", kind, "--accept-verdict", "--force"]) == 5
        assert "positive feedback" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["params.json"]


def test_the_commands_say_how_the_control_was_tried(script, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")
    parameters.write(script.sealed_file(script.drawn(1)), "params.json")
    assert main(["check", "params.json"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "ok Simulated by the load law, a tool runs from sharp to worn" in out
    assert "ok Times are within their limits: sample_time " in out
    assert " s (1e-05 to 0.5), arm_after " in out
    assert " s (at most 10), engage_after " in out
    assert " s for the range of the feed (at most 2), recover " in out
    assert main(["export", "params.json", "--to", "st"]) == 0
    out = capsys.readouterr().out
    assert "  simulation: Simulated by the load law, a tool runs from sharp to worn" in out
    assert "  fault: Each of these takes the feed to its lower limit, latched until reset: a reading that is not" in out


# --- what only the simulation finds, in files whose numbers agree


def failed(pf: ParameterFile) -> str:
    report = check_control(sealed(pf))
    assert {f.name for f in report.failed} <= {"simulation", "draws", "robustness", "fault"}
    return " ".join(f.words for f in report.failed)


class FreeUnarmed(ConstantLoad):
    """A controller whose feed is the programmed one until it is armed, and the last one when it no longer is."""

    def _target(self, load):
        enabled, self.enabled = self.enabled, self.enabled and self._armed
        target = super()._target(load)
        self.enabled = enabled
        return target


def test_a_feed_above_the_lower_limit_while_nothing_monitors_the_load_is_refused(script, monkeypatch):
    monkeypatch.setattr(simulation, "ConstantLoad", FreeUnarmed)
    words = [finding.words for finding in check_control(script.sealed_file(script.drawn(11))).failed]
    assert len(words) == 2
    assert "When spindle-on is lost in mid-cut, the override is " in words[0]
    assert "When the controller restarts in mid-cut, the override rises from " in words[1]


def noisy(sd: float) -> dict:
    return {"tool": "a", "work": "b", "sensors": [{"symbol": "I", "unit": "A", "sd": sd}]}


def test_a_lower_limit_of_the_gains_above_that_of_the_settings_is_noted(constant_load_file):
    """I = A + B f + k1 VB of the file at 0.22 A: the wear at 700 mm/min is less than at the 600 mm/min stated."""
    pf = constant_load_file(pi={"low": 700.0, "high": 1000.0})
    (found,) = (one for one in check_control(pf).findings if "does not go below" in one.words)
    assert found.passed is None
    assert "does not go below 700 mm/min" in found.words
    assert "the settings state 600" in found.words
    line = pf.laws["I"].coefficients
    wear = (0.22 - line["A"] - line["B"] * 700) / line["k1"]
    assert f"at a wear of {wear:.3g} mm" in found.words
    assert any(words.startswith("feed_low 700, of gains or machine") for words in loop_settings(pf).assumed)
    assert not any("does not go below" in one.words for one in check_control(constant_load_file()).findings)


def test_noise_as_large_as_the_hysteresis_makes_the_engagement_hunt(constant_load_file):
    assert not failed(constant_load_file(identity=noisy(0.002)))
    pf = constant_load_file(identity=noisy(0.02), pi={"filter_time": 0.0, "kp": 60.0, "ki": 1600.0})
    assert "hunts" in failed(pf)


def test_noise_that_the_gains_amplify_moves_the_feed(constant_load_file):
    engagement = constant_load_file().load_line.engagement.model_dump(exclude_none=True)
    fast = {"engagement": {**engagement, "recover": 2.0, "back_off": 4.0}}
    pi = {"filter_time": 0.0, "kp": 3000.0, "ki": 6000.0}
    assert not failed(constant_load_file(identity=noisy(0.001), pi=pi, load_line=fast))
    words = failed(constant_load_file(identity=noisy(0.012), pi=pi, load_line=fast))
    assert "does not come to rest" in words
    assert "sensor noise 0.012 A" in words


@pytest.mark.parametrize("kp", [200.0, 2000.0])
def test_a_proportional_gain_alone_does_not_hold_the_reference(constant_load_file, kp):
    assert "the integral action is too weak" in failed(constant_load_file(pi={"ki": 0.0, "kp": kp}))


def test_a_filter_that_the_gains_were_not_tuned_with_is_simulated(constant_load_file):
    """The settings may add a low-pass to gains that were tuned without one; the check of the gains does not know it."""
    engagement = constant_load_file().load_line.engagement.model_dump(exclude_none=True)
    pi = {"filter_time": 0.0, "kp": 900.0, "ki": 20000.0}
    slow = {"engagement": {**engagement, "filter_corner": 0.2}}
    assert not failed(constant_load_file(pi=pi, load_line={"engagement": engagement}))
    assert "does not come to rest" in failed(constant_load_file(pi=pi, load_line=slow))


@pytest.mark.parametrize(("share", "words"), [(0.05, ""), (0.8, "make the loop unstable, more than 5 %")])
def test_gains_that_many_draws_of_the_load_law_make_unstable_are_refused(constant_load_file, share, words):
    """The gain margin is 2.0: a slope known to 5 % does not use it up, one known to 80 % does."""
    law = constant_load_file().laws["I"].model_dump()
    variance = np.diag([1e-8, (share * law["coefficients"]["B"]) ** 2, 1e-8]).tolist()
    law["uncertainty"] = {"kind": "covariance", "of": ["A", "B", "k1"], "matrix": variance, "df": 17}
    found = failed(constant_load_file(pi={"kp": 900.0, "ki": 20000.0, "filter_time": 0.0}, laws={"I": law}))
    assert (words in found) if words else not found


@pytest.mark.parametrize(("weight", "words"), [(0.02, ""), (0.3, "make the loop unstable, more than 5 %")])
def test_a_structure_of_the_dynamics_that_makes_the_loop_unstable_is_refused(constant_load_file, weight, words):
    """Another structure with the same poles and 1.2 s more delay, which uses up the phase margin."""
    dynamics = constant_load_file().dynamics
    covariance = {"kind": "covariance", "of": list(dynamics.names), "matrix": (1e-16 * np.eye(6)).tolist()}
    none = {"kind": "none", "reason": "given"}
    later = {"weight": weight, "b": [*[0.0] * 60, *dynamics.b], "a": dynamics.a, "nk": 61, "uncertainty": none}
    changed = {"uncertainty": covariance, "alternatives": [later]}
    found = failed(constant_load_file(pi={"kp": 900.0, "ki": 20000.0, "filter_time": 0.0}, dynamics=changed))
    assert (words in found) if words else not found


# --- what could not be simulated is named


def test_without_a_load_law_nothing_is_exported_unless_that_is_accepted_and_recorded(
    constant_load_file, tmp_path, capsys
):
    pf = sealed(constant_load_file(laws=None))
    for kind in CONTROLS:
        with pytest.raises(GateError, match=r"holds no law I of the load.*--accept-verdict exports it all the same"):
            rendered(pf, kind)
    accepted = gated_control(pf, accept_verdict=True).view.verdicts
    assert any(line.startswith("VERDICT ACCEPTED - load law") for line in accepted)
    parameters.write(pf, tmp_path / "params.json")
    out = str(tmp_path / "out.st")
    assert main(["export", str(tmp_path / "params.json"), "--to", "st", "--out", out, "--accept-verdict"]) == 0
    assert "VERDICT ACCEPTED - load law: the file holds no law I" in capsys.readouterr().out


def test_without_dynamics_nothing_is_exported_even_if_verdicts_are_accepted(constant_load_file):
    with pytest.raises(GateError, match="holds no dynamics, so the control cannot be simulated"):
        gated_control(constant_load_file(dynamics=None), accept_verdict=True)


def test_a_file_without_noise_and_covariances_is_simulated_with_that_remark(constant_load_file):
    remarks = [f.words for f in check_control(constant_load_file()).findings if f.passed is None]
    assert any("neither noise of the load's sensor" in words for words in remarks)
    assert any("No simulation checks calibration and wiring of the sensor" in words for words in remarks)
    assert any("Neither load law nor dynamics have a covariance" in words for words in remarks)
    written = " ".join(gated_control(constant_load_file()).view.verdicts)
    assert "neither noise of the load_s sensor" in written


def test_gains_without_a_verdict_are_to_be_tuned_again(script):
    sections = script.drawn(1)
    sections["pi"].pop("verdict", None)
    (found,) = [f for f in check_control(script.sealed_file(sections)).findings if f.name == "gains"]
    assert found.passed is None
    assert found.words.startswith("The gains have no verdict: the file does not state how they were tuned")
    assert found.words.endswith("tune again.")


def test_a_line_of_feed_needs_the_load_in_air(constant_load_file):
    """The feed at one load has no slope: with the load in air, sign and size of the dynamics can be compared."""
    law = constant_load_file().laws["I"].model_dump()
    line = {
        **law, "form": "feed_line", "response": "fm", "unit": "mm/min",
        "coefficients": {"fm0": 1000.0, "slope": -2000.0}, "factors": law["factors"][1:],
    }  # fmt: skip
    base = constant_load_file()
    settings = {**base.load_line.model_dump(exclude_none=True), "law": "fm"}

    def found(idle, scaling=1459.0):
        given = {**settings, "engagement": {**settings["engagement"], **({"idle": idle} if idle else {})}}
        pi = {"scaling_u": scaling}
        return check_control(sealed(constant_load_file(laws={"fm": line}, load_line=given, pi=pi)))

    assert "state the load of the spindle in air" in found(None).failed[0].words
    assert found(0.09).ok
    assert "outside 0.5 to 2" in found(0.09, 2.5 * 1459.0).failed[0].words
    assert "leaves a load in air of -0." in found(None, 1459.0 / 2.5).failed[0].words


def test_a_file_without_a_control_has_no_findings():
    assert check_control(parameters.collect(tool="a", work="b", laws=[])) == CheckReport(())
    assert controllers.check_control.__wrapped__ is check_control


# --- the simulation itself


def test_the_simulated_cut_is_the_difference_equation_with_a_quantised_override():
    """Against scipy's filter of the same polynomials; the override is rounded to 1 %."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(2)
    drive = Drive((0.05, 0.02), (1.0, -1.4, 0.47), 0.02)
    cut = Cut(Line(0.1, 1e-4, 0.2, 0.09, 0.2, 0.0), drive, 1000.0, 0.02, rng)
    cut.in_cut, cut.wear = True, 0.1
    overrides = rng.uniform(0.5, 1.0, 200)
    ours = [cut.load(override) for override in overrides]
    shape = lfilter(drive.b, drive.a, np.round(overrides, 2) * 1000.0)
    assert ours == pytest.approx(0.1 + 1e-4 * shape + 0.2 * 0.1, rel=1e-12)


def test_a_slower_drive_is_held_between_its_samples():
    cut = Cut(
        Line(0.1, 1e-4, 0.2, 0.09, 0.2, 0.0), Drive((1.0,), (1.0,), 0.02), 1000.0, 0.005, np.random.default_rng(1)
    )
    cut.in_cut = True
    loads = np.array([cut.load(override) for override in np.linspace(0.5, 1.0, 41)])
    assert len(np.unique(loads)) == 11  # 4 samples of the controller in one of the drive


def test_a_bench_that_is_copied_goes_on_alike(constant_load_file):
    import copy

    loop = loop_settings(constant_load_file()).loop
    line = Line(0.09584, 1.2416e-4, 0.24832, 0.09584, 0.2, 0.001)
    bench = Bench(ConstantLoad(loop, running=True), Cut(line, Drive((1.0,), (1.0,), 0.02), 1000.0, 0.02,
                                                        np.random.default_rng(3), in_cut=True))  # fmt: skip
    bench.run(1.0)
    again = copy.deepcopy(bench)
    assert bench.run(1.0).override.tolist() == again.run(1.0).override.tolist()


def test_a_changed_file_is_simulated_again_and_a_renamed_one_is_not(constant_load_file):
    from fitmodels.controllers.gate import _findings

    _findings.cache_clear()
    check_control(constant_load_file())
    check_control(constant_load_file(identity={"tool": "other"}))
    assert (_findings.cache_info().misses, _findings.cache_info().hits) == (1, 1)
    check_control(constant_load_file(pi={"kp": 299.0}))
    assert _findings.cache_info().misses == 2


@pytest.mark.parametrize("seed", range(25))
def test_any_number_changed_at_random_gives_findings_and_no_crash(constant_load_file, seed):
    """Whatever passes keeps the feed inside its limits in a run of the controller on the file's own line."""
    rng = np.random.default_rng(seed)
    data = constant_load_file().model_dump(exclude_none=True)
    places = list(_numbers(data))
    at, key = places[rng.integers(len(places))]
    at[key] = type(at[key])(at[key] * rng.choice([-1.0, 0.0, 1e-9, 0.1, 10.0, 1e9]))
    try:
        pf = sealed(ParameterFile.model_validate(json.loads(json.dumps(data))))
        control = gated_control(pf)
    except (ValueError, ParameterError):
        return
    loads = rng.uniform(0.0, 0.3, 300)
    controller = ConstantLoad(control.loop, running=True)
    overrides = [controller.step(load, control.loop.sample_time) for load in loads]
    assert control.loop.low <= min(overrides) <= max(overrides) <= control.loop.high <= 1.0


def _numbers(data):
    parts = (data["laws"]["I"]["coefficients"], data["dynamics"], data["pi"], data["load_line"],
             data["load_line"]["engagement"], data["load_line"]["upper"], data["load_line"]["lower"])  # fmt: skip
    for part in parts:
        yield from ((part, key) for key, value in part.items() if isinstance(value, (int, float)))


def test_the_printed_settings_of_the_paper_pass_end_and_slot_milling():
    """Table 3 of Tai, Tsai & Li 2023: slot milling from 500 to 700 mm/min, where a sharp tool holds 0.24 A at 600."""
    for name in ("CLM-2023", "CLM-2023-slot"):
        report = check_control(published(name))
        assert report.ok, report.failed


@pytest.mark.parametrize("kind", ["ini", "h", "mat"])
def test_values_with_settings_that_no_control_can_have_are_not_written(script, kind, tmp_path):
    """The numbers of a loop that is refused would be loaded by hand."""
    pf = script.sealed_file(script.faulty(2, "load_line.engagement.load_low = 0.0"))
    for write in (parameters.export, controllers.export):
        with pytest.raises(GateError, match=r"lost sensor|holds a control loop"):
            write(pf, kind, tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_a_limit_of_the_load_is_kept_by_reference_and_overload(constant_load_file):
    """A limit of 0.2 A was written and ignored: the control held 0.22 A, a worn tool 0.26."""
    limit = {"unit": "A"}
    refused = sealed(constant_load_file(limits={"responses": {"I": {"high": 0.2, **limit}}}))
    assert [f.words for f in parameters.check(refused).failed] == [
        "load_line: the reference 0.22 A is outside the limit of I in the file, 0 to 0.2 A."
    ]
    with pytest.raises(GateError, match=r"the reference 0.22 A is outside the limit of I"):
        rendered(refused, "c")
    with pytest.raises(GateError, match=r"limits I to 0.225 A, not above 1.05 times the reference"):
        rendered(sealed(constant_load_file(limits={"responses": {"I": {"high": 0.225, **limit}}})), "c")
    narrowed = sealed(constant_load_file(limits={"responses": {"I": {"high": 250.0, "unit": "mA"}}}))
    found = loop_settings(narrowed)
    assert found.loop.overload_at == pytest.approx(0.25)
    assert "overload above 0.25 A, the limit of I in the file" in found.assumed


def test_limits_that_constant_load_does_not_apply_are_named(constant_load_file):
    ranges = {
        "feed": {"low": 0.01, "high": 0.02, "unit": "mm/rev"},
        "feed_rate": {"low": 1.0, "high": 2e3, "unit": "mm/min"},
    }
    (found,) = (f for f in check_control(sealed(constant_load_file(limits=ranges))).findings if "not apply" in f.words)
    assert found.passed is None
    assert "does not apply limits.feed:" in found.words
    assert not any("not apply" in f.words for f in check_control(sealed(constant_load_file())).findings)
