"""``fitmodels ident --as step | drive | force-process``: a section of the parameter file, its card and its figure."""

import json

import numpy as np
import pytest
from fitmodels import parameters
from fitmodels.cli import main
from fitmodels.controllers.adaptive_force.plant import DriveAndCut
from fitmodels.core.verdict import DO_NOT_USE
from fitmodels.ident.continuous import ContinuousModel, sampled
from fitmodels.ident.physical_models.equation_of_motion import velocity_and_travel
from fitmodels.ident.physical_models.step_response import step_response_fit
from fitmodels.parameters.file_format import STEPS, migrated
from fitmodels.parameters.published import published

pytestmark = pytest.mark.slow

LAG = ContinuousModel(np.array([0.18]), np.array([0.2, 1.0]), 0.034)
DRIVE = {"M": 95.0, "Fv": 200.0, "Fc": 20.0, "offset": -3.0}
RATIOS = np.array([2.0, 76.0, 480.0]) / 400  # m 2, c 8, d 60, k 400


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")

    def call(*arguments):
        code = main(["ident", *map(str, arguments)])
        out, err = capsys.readouterr()
        return code, " ".join(out.split()), err

    return call


def written(path, headers, *columns):
    """A CSV file of columns."""
    rows = (",".join(f"{value:.8g}" for value in row) for row in zip(*columns, strict=True))
    path.write_text("\n".join([",".join(headers), *rows]) + "\n")
    return path.name


def steps_of(seed, n=800):
    t = np.arange(n) * 0.01
    u = 2.0 * (t % 4 > 1)
    return t, u, LAG.sampled(0.01).simulate(u) + 0.3 + 0.004 * np.random.default_rng(seed).standard_normal(n)


@pytest.fixture
def steps(tmp_path):
    headers = ("time [s]", "command [V]", "current [A]")
    return [written(tmp_path / f"step{seed}.csv", headers, *steps_of(seed)) for seed in (1, 2)]


@pytest.fixture(scope="module")
def moved():
    """Time, force and position in mm of a drive."""
    t = np.arange(8000) * 1e-3
    F = 30 * np.sin(2 * np.pi * 0.23 * t) + 60 * np.sign(np.sin(2 * np.pi * 0.4 * t))
    x = velocity_and_travel(F, 1e-3, *DRIVE.values())[1]
    return t, F + 0.5 * np.random.default_rng(1).standard_normal(len(t)), 1000 * x


@pytest.fixture
def cut(tmp_path):
    t = np.arange(2000) * 0.01
    u = 200 * np.sin(2 * np.pi * (0.1 + 0.05 * t) * t)
    F = sampled([1.0], RATIOS, 0.01).simulate(u) + np.random.default_rng(1).standard_normal(len(t))
    return written(tmp_path / "cut.csv", ("time [s]", "feed [mm/min]", "force [N]"), t, u + 600, F + 500)


def test_a_step_becomes_dynamics_with_their_covariance(run, steps, tmp_path):
    code, out, err = run(steps[0], "--as", "step", "--held-out", steps[1])
    assert (code, err) == (0, "")
    assert "Order 1 was chosen by the record" in out
    assert "Simulation of samples not fitted" in out
    d = parameters.read(tmp_path / "step1-fit/params.json").dynamics
    assert d.structure == "step response of first order with delay"
    assert (d.nk, d.unit_u, d.unit_y) == (4, "V", "A")
    assert d.held_out_fit > 90
    np.testing.assert_allclose(d.dc_gain, 0.18, rtol=0.01)
    assert d.verdict.level == "usable inside the tested region"
    assert (tmp_path / "step1-fit/figures/step_response.png").stat().st_size > 5000
    assert "step response of first order" in (tmp_path / "step1-fit/README.md").read_text()
    assert main(["check", str(tmp_path / "step1-fit/params.json")]) == 0
    assert main(["tune", str(tmp_path / "step1-fit/params.json"), "--settle", "2"]) == 0


@pytest.mark.parametrize("delay", [0.0, 0.05])
def test_the_covariance_of_a_sampled_step_response_is_that_of_monte_carlo(delay):
    """Standard errors of the sampled coefficients, with no delay, and at a whole number of samples."""
    plant = ContinuousModel(np.array([0.18]), np.array([0.2, 1.0]), delay)
    t, u, _ = steps_of(0)
    at, found = np.array([0.2, 0.5, 1.0]), []
    for seed in range(30):
        y = plant.sampled(0.01).simulate(u) + 0.01 * np.random.default_rng(seed).standard_normal(len(t))
        rec = _record(u, y)
        found.append(step_response_fit(rec, 1, delay=None if delay else 0.0).model(0.01))
    spread = np.std([np.abs(m.response(at)) for m in found], axis=0, ddof=1)
    stated = np.median([_gain_errors(m, at) for m in found], axis=0)
    np.testing.assert_allclose(stated, spread, rtol=0.4)  # sd of an sd from 30 draws: 13 %


def test_a_delay_that_no_file_holds_is_refused_with_the_rate_that_it_takes(run, tmp_path):
    t = np.arange(600) * 0.01
    u = ((t > 0.5) & (t < 3)) * 1.0
    y = ContinuousModel(np.array([1.0]), np.array([0.2, 1.0]), 1.2).sampled(0.01).simulate(u)
    y += 1e-3 * np.random.default_rng(1).standard_normal(len(t))
    file = written(tmp_path / "late.csv", ["time [s]", "command [V]", "speed [mm/s]"], t, u, y)
    code, _, err = run(file, "--as", "step")
    assert code == 3
    assert "its delay of 120 samples included; a parameter file holds 100. Resample the record to 33.3 Hz" in err
    assert "keep one of 3 rows" in err
    short = written(tmp_path / "short.csv", ["time [s]", "command [V]", "speed [mm/s]"], t[::3], u[::3], y[::3])
    assert run(short, "--as", "step")[0] == 0


def test_a_force_in_air_is_not_said_to_fall(run, tmp_path):
    t = np.arange(1500) * 0.02
    feed = 400 + 100 * np.sin(2 * np.pi * (0.1 + 0.04 * t) * t)
    force = 5.0 + np.random.default_rng(3).standard_normal(len(t))
    file = written(tmp_path / "air.csv", ["time [s]", "feed rate [mm/min]", "force [N]"], t, feed, force)
    code, _, err = run(file, "--as", "force-process")
    assert code == 4
    assert "force does not follow feed rate" in err
    assert "Check that the tool cuts" in err


def test_a_slide_of_a_tenth_of_a_kilogram_has_wrong_units(run, moved, tmp_path):
    """Millimetres under a header that says metres."""
    t, F, x = moved
    name = written(tmp_path / "axis.csv", ("time [s]", "force [N]", "position [m]"), t, F, x)
    code, out, _ = run(name, "--as", "drive")
    assert code == 0
    assert "The moving mass of 0.095 kg is outside the 1 to 100000 kg of machine tools: check the units" in out


def test_a_constant_input_is_named_with_its_value(run, tmp_path):
    t = np.arange(200) * 0.01
    file = written(tmp_path / "still.csv", ["time [s]", "command [V]", "speed [mm/s]"], t, np.full(200, 1.5), np.sin(t))
    code, _, err = run(file)
    assert code == 4
    assert "does not vary (1.5 throughout)" in err


def _record(u, y):
    from fitmodels.datasets import Record

    return Record(u=u, y=y, sample_time=0.01)


def _gain_errors(model, at):
    """Standard errors of |G| by differences of the coefficients."""
    J = []
    for k in range(len(model.theta)):
        h = 1e-6
        theta = model.theta + h * np.eye(len(model.theta))[k]
        b = np.r_[np.zeros(model.nk), theta[model.na :]]
        z = np.exp(-2j * np.pi * at * model.sample_time)
        g = np.polyval(b[::-1], z) / np.polyval(np.r_[1.0, theta[: model.na]][::-1], z)
        J.append((np.abs(g) - np.abs(model.response(at))) / h)
    J = np.array(J).T
    return np.sqrt(np.diag(J @ model.cov_params @ J.T))


def test_the_order_is_that_of_the_plant(run, tmp_path):
    t, u, _ = steps_of(0)
    plant = ContinuousModel(np.array([1.0]), np.array([0.04, 0.08, 1.0]))  # 5 rad/s, damping 0.2
    y = plant.sampled(0.01).simulate(u) + 0.01 * np.random.default_rng(3).standard_normal(len(t))
    fit = step_response_fit(_record(u, y), None)
    assert fit.order == 2
    np.testing.assert_allclose(fit.shape, (5.0, 0.2), rtol=0.02)
    first = step_response_fit(_record(u, y), 1)
    assert first.verdict.level > 0
    assert "try order 2" in " ".join(first.verdict.reasons)


def test_a_drift_under_the_steps_is_named():
    """Another order, which the record had refused already, was the advice."""
    t, u, _ = steps_of(0)
    y = ContinuousModel(np.array([1.0]), np.array([0.1, 1.0])).sampled(0.01).simulate(u)
    slope = 0.01 * np.random.default_rng(3).standard_normal(len(t)) + 1.5 * np.std(y) * t / t[-1]
    reasons = " ".join(step_response_fit(_record(u, y + slope), None).verdict.reasons)
    assert "the output drifts by" in reasons
    assert "try order" not in reasons


def test_a_drive_gets_a_section_of_its_own(run, moved, tmp_path):
    t, F, x = moved
    name = written(tmp_path / "axis.csv", ("time [s]", "force [N]", "position [mm]"), t, F, x)
    assert run(name, "--as", "drive", "--tool", "X axis")[0] == 0
    pf = parameters.read(tmp_path / "axis-fit/params.json")
    se = np.sqrt(np.diag(pf.drive.uncertainty.matrix))
    for name, value, error in zip(pf.drive.uncertainty.of, DRIVE.values(), se, strict=True):
        assert abs(getattr(pf.drive, name) - value) < 4 * error, name
    assert (pf.drive.unit_inertia, pf.drive.unit_y, pf.dynamics) == ("kg", "mm", None)
    assert pf.drive.simulated_fit > 90
    card = (tmp_path / "axis-fit/README.md").read_text()
    assert "## Feed drive" in card
    assert "inertia M" in card
    assert (tmp_path / "axis-fit/figures/drive.png").stat().st_size > 5000


def test_a_drive_in_volts_and_json(run, moved, tmp_path):
    t, F, x = moved
    name = written(tmp_path / "axis.csv", ("time [s]", "control [V]", "position [mm]"), t, F / 35.15, x)
    code, out, _ = run(name, "--as", "drive", "--force-per-unit", 35.15, "--json")
    assert code == 0
    found = json.loads(out)
    assert found["schema"] == "fitmodels.physical-model/1"
    assert found["section"] == "drive"
    np.testing.assert_allclose(found["estimates"]["M"]["estimate"], 95.0, rtol=0.02)
    assert found["parameters"]["drive"]["force_per_unit"] == 35.15
    assert not list(tmp_path.glob("*-fit"))


def test_a_reversed_force_must_not_be_used(run, moved, tmp_path):
    t, F, x = moved
    name = written(tmp_path / "axis.csv", ("time [s]", "force [N]", "position [mm]"), t, -F, x)
    code, out, _ = run(name, "--as", "drive")
    assert code == 0
    assert "do not use for control" in out
    assert "give force with a minus sign" in out
    pf = parameters.read(tmp_path / "axis-fit/params.json")
    assert pf.drive.verdict.concern == DO_NOT_USE
    assert main(["check", str(tmp_path / "axis-fit/params.json")]) == 5


def test_estimates_of_adaptive_force_alone_name_the_settings_that_are_lacking(run, cut, tmp_path):
    assert run(cut, "--as", "force-process", "--depth", 2)[0] == 0
    pf = parameters.read(tmp_path / "cut-fit/params.json")
    a = pf.adaptive_force
    np.testing.assert_allclose([a.m, a.alpha, a.beta], RATIOS, rtol=0.02)
    assert (a.depth, a.Kd, a.unit_u, a.unit_force) == (2.0, None, "mm/min", "N")
    assert "Settings not stated: g1, g2, g3, Kd, lam" in (tmp_path / "cut-fit/README.md").read_text()
    assert main(["check", str(tmp_path / "cut-fit/params.json")]) == 0
    assert main(["replay", str(tmp_path / "cut-fit/params.json")]) != 0


def test_estimates_replace_those_of_a_file_and_keep_its_settings(run, cut, tmp_path):
    before = published("LYAP")
    parameters.write(before, tmp_path / "p.json")
    code, out, err = run(cut, "--as", "force-process", "--depth", 2, "--params", "p.json")
    assert code == 0, err
    after = parameters.read(tmp_path / "p.json")
    assert after.adaptive_force.Kd == before.adaptive_force.Kd
    assert after.adaptive_force.m != before.adaptive_force.m
    assert "Written: adaptive_force in p.json" in out


def test_ripple_of_the_teeth_is_averaged_over_a_revolution(run, tmp_path):
    """30 % ripple of two flutes at 3000 1/min: no part of (2.2), so the verdict is of the average over 20 ms."""
    dt, noise = 0.004, np.random.default_rng(1)
    t = dt * np.arange(2500)
    u = 250 + 100 * np.sin(2 * np.pi * (0.1 + 0.245 * t) * t)
    plant = DriveAndCut(depth=2.0, ripple=0.3, noise=2.0)
    F = np.r_[0.0, [plant.step(float(command), dt, noise) for command in u[:-1]]]
    name = written(tmp_path / "rippled.csv", ("time [s]", "feed rate [mm/min]", "force [N]"), t[250:], u[250:], F[250:])
    code, out, err = run(name, "--as", "force-process", "--depth", 2, "--spindle", "3000rpm", "--teeth", 2)
    assert code == 0, err
    assert "Fit 96.9 %" in out
    assert "averaged over 20 ms" in out
    pf = parameters.read(tmp_path / "rippled-fit/params.json")
    a = pf.adaptive_force
    assert pf.identity.iso13399 == {"ZEFP": 2.0}
    assert (a.spindle_speed, a.average_time, a.verdict.concern) == (3000.0, 0.02, 0)
    np.testing.assert_allclose([a.m, a.alpha, a.beta], [0.002, 0.125, 1.25], rtol=0.02)  # DriveAndCut at 2 mm
    np.testing.assert_allclose(a.tested.command, (u[250:].min(), u[250:].max()), rtol=1e-5)
    assert run(name, "--as", "force-process", "--out", "plain")[0] == 4  # the ripple hides the faster pole
    assert run(name, "--as", "force-process", "--spindle", "20m/min")[0] == 2
    assert run(name, "--as", "drive", "--spindle", "3000")[0] == 2
    assert run(name, "--as", "drive", "--teeth", "2")[0] == 2


def test_settings_in_other_units_are_refused(run, cut, tmp_path):
    before = published("LYAP")
    other = parameters.collect(tool="a", work="b", adaptive_force={**before.adaptive_force.model_dump(), "unit_u": "V"})
    parameters.write(other, tmp_path / "p.json")
    code, _, err = run(cut, "--as", "force-process", "--params", "p.json")
    assert code in (2, 3, 4)
    assert "in 'V', the record in 'mm/min'" in err


def test_a_section_is_replaced_only_by_force(run, steps, tmp_path):
    parameters.write(parameters.collect(tool="end mill", work="S45C"), tmp_path / "p.json")
    assert run(steps[0], "--as", "step", "--params", "p.json")[0] == 0
    code, _, err = run(steps[0], "--as", "step", "--params", "p.json")
    assert code == 2
    assert "--force" in err
    assert run(steps[1], "--as", "step", "--params", "p.json", "--force")[0] == 0
    assert (tmp_path / "figures/step_response.png").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--as", "step", "--cutoff", "3"], "--cutoff has an effect only with --as drive"),
        (["--as", "step", "--orders", "2,2,1"], "--orders has an effect only without --as"),
        (["--order", "2"], "--order has an effect only with --as step"),
        (["--as", "force-process", "--given", "x=2"], "one of m, k and d"),
        (["--as", "force-process", "--depth", "-1"], "lies above zero"),
        (["--as", "drive"], "'V': give --force-per-unit"),
        (["--as", "drive", "--force-per-unit", "35"], "'A', but a drive needs a position or a speed"),
        (["--as", "motor"], "invalid choice"),
    ],
)
def test_options_and_columns_that_do_not_fit(run, steps, options, words):
    code, _, err = run(steps[0], *options)
    assert code in (2, 4)
    assert words in err
    assert err.count("\n") == 1


def test_records_that_hold_no_response_are_refused(run, tmp_path):
    t = np.arange(600) * 0.02
    u = 1.0 * (t > 3)
    noise = 0.002 * np.random.default_rng(1).standard_normal(len(t))
    headers = ("time [s]", "command [V]", "current [A]")
    late = written(tmp_path / "late.csv", headers, t, 1.0 * (t > 11.97), noise)
    code, _, err = run(late, "--as", "step")
    assert (code, "nothing of the response is in the record" in err) == (4, True)
    fast = written(tmp_path / "fast.csv", headers, t, u, 0.18 * np.r_[0, u[:-1]] + noise)
    code, _, err = run(fast, "--as", "step")
    assert (code, "Record faster" in err) == (4, True)
    code, _, err = run(fast, "--as", "force-process")
    assert (code, "needs the cutting force" in err) == (2, True)


def test_a_slow_response_is_not_said_to_overshoot():
    """Before it settles, noise above the last value is no overshoot."""
    t = np.arange(400) * 0.02
    u = 1.0 * (t > 1)
    y = ContinuousModel(np.array([0.18]), np.array([20.0, 1.0])).sampled(0.02).simulate(u)
    fit = step_response_fit(_record(u, y + 0.001 * np.random.default_rng(7).standard_normal(len(t))), 1)
    assert "has not settled" in " ".join(fit.verdict.reasons)
    assert "overshoots" not in fit.words


def test_a_chirp_is_no_step(run, cut):
    code, _, err = run(cut, "--as", "step")
    assert code == 4
    assert "not made of steps" in err
    assert "without --as step" in err


def test_a_file_of_version_4_has_no_drive():
    """A field of that name was unknown to version 4."""
    old = {"schema_version": "fitmodels.parameters/4", "drive": "foreign", "adaptive_force": {"g1": 0.1}}
    new = migrated(old, "params.json", STEPS, current=5)
    assert (new["drive"], new["adaptive_force"]) == (None, {"g1": 0.1})
