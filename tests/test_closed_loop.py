"""Closed loop: feedback is recognised, the plant estimated from loop data, and undecidable records are refused."""

import numpy as np
import pytest
from fitmodels import parameters
from fitmodels.cli import main
from fitmodels.core.errors import IdentError, UsageError
from fitmodels.datasets import Record, read_record
from fitmodels.ident import Model, chirp, identify, prbs
from fitmodels.ident.closed_loop import checked_feedback, feedback
from fitmodels.ident.estimators.bias_checks import response_error
from fitmodels.ident.estimators.plant_and_noise import box_jenkins
from fitmodels.ident.estimators.reference_response import two_stage
from fitmodels.ident.pi.gains import PiGains
from fitmodels.ident.pi.loop import loop_of
from fitmodels.ident.record_disturbances import disturbances
from scipy.signal import lfilter

T, N = 0.02, 750
LAG = Model(b=[0.0, 0.05], a=[1.0, -0.95], nk=1, sample_time=T)
# Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 18
PUBLISHED = Model(b=[0, 0.0611, -0.1338, 0.0752], a=[1, -2.0311, 1.2104, -0.1655], nk=1, sample_time=T)
LATE = Model(b=[0.0, 0.0, 0.0, 0.021, 0.018], a=[1.0, -1.545, 0.5866], nk=3, sample_time=T)
GAINS = {id(LAG): (1.5, 0.1), id(PUBLISHED): (0.5, 0.01), id(LATE): (0.5, 0.06)}  # Kp, Ki per sample
SWEEP = chirp(1.0)
CLOSE = 0.05  # of |G| in the band at 30 dB, one record: the standard error is below .01


def run(plant, r, noise, late):
    """u and y under a digital PI that uses the measured output of ``late`` samples before."""
    kp, ki = GAINS[id(plant)]
    b, a, k = plant.b[1:], plant.a[1:], 10
    u, x, y, total = *np.zeros((3, len(r) + k)), 0.0
    for t in range(k, len(r) + k):
        x[t] = b @ u[t - len(b) : t][::-1] - a @ x[t - len(a) : t][::-1]
        y[t] = x[t] + noise[t - k]
        error = r[t - k] - y[t - late]
        total += ki * error
        u[t] = kp * error + total
    return u[k:], y[k:]


def looped(plant=LAG, r=SWEEP, snr=30.0, seed=1, late=0, colour=0.0, named=False):
    """A record in closed loop with noise of the sensor, relative to the noise-free output (to 1 if that is zero)."""
    noise = lfilter([1.0], [1.0, -colour], np.random.default_rng(seed).standard_normal(len(r) + 300))[300:]
    size = np.std(run(plant, r, np.zeros(len(r)), late)[1]) * 10 ** (-snr / 20) * np.sqrt(1 - colour**2)
    u, y = run(plant, r, size * noise, late)
    return Record(u=u, y=y, sample_time=T, reference=r if named else None)


def open_loop(u, snr, seed, plant=PUBLISHED, colour=0.0):
    x = plant.simulate(u)
    e = lfilter([1.0], [1.0, -colour], np.random.default_rng(seed).standard_normal(len(u)))
    return Record(u=u, y=x + np.std(x) * 10 ** (-snr / 20) * e / np.std(e), sample_time=T)


def gain_error(model, plant):
    f = np.geomspace(0.1, 2.0, 40)
    return float(np.abs(np.abs(model.response(f)) / np.abs(plant.response(f)) - 1).max())


@pytest.mark.parametrize("plant", [LAG, PUBLISHED], ids=["lag", "published"])
@pytest.mark.parametrize(("late", "snr"), [(0, 40), (1, 40), (0, 20), (1, 10)])
def test_a_controller_is_found_in_a_chirp_with_and_without_delay(plant, late, snr):
    found = feedback(looped(plant, late=late, snr=snr))
    assert (found.state, found.share > 0.95) == ("found", True)
    assert "y explains more than 99.9 %" in found.sentence


def test_open_loop_is_not_taken_for_a_closed_one():
    """A regular input is decided; white noise would hide a controller, which is stated."""
    regular = [SWEEP, prbs(2.5, 15.0, 50.0, hold=0.2)]
    states = [
        feedback(open_loop(u, snr, seed, colour=colour)).state
        for u in regular for snr in (60, 30, 10) for colour in (0.0, 0.9) for seed in range(5)
    ]  # fmt: skip
    assert states == ["none"] * 60
    irregular = feedback(open_loop(np.random.default_rng(9).standard_normal(N), 30, 1))
    assert irregular.state == "undecided"
    assert "too irregular" in irregular.sentence


def test_a_plant_without_delay_is_no_controller():
    direct = Model(b=[0.5, 0.2], a=[1.0, -0.7], nk=0, sample_time=T)
    found = feedback(open_loop(prbs(1.0, 15.0, 50.0, hold=0.1), 30, 1, direct))
    assert found.state == "undecided"
    assert "by a plant without delay or by a controller" in found.sentence


def test_the_loop_of_a_real_drive_is_not_taken_for_open(measurements):
    # EMPS: Janot, Gautier & Brunot 2019, under a position controller without delay, signals rounded
    t, _, position, control = np.loadtxt(measurements / "emps/data_emps.csv", delimiter=",", skiprows=1)[:, :4].T
    assert feedback(Record(u=control, y=position, sample_time=float(t[1] - t[0]))).state == "undecided"


@pytest.mark.parametrize("name", ["dryer", "robot_arm"])
def test_open_loop_measurements_are_not_flagged(measurements, name):
    u, y = np.loadtxt(measurements / f"daisy/{name}.dat").T
    assert not feedback(Record(u=u, y=y, sample_time=0.08)).found


@pytest.mark.parametrize("plant", [LAG, PUBLISHED], ids=["lag", "published"])
@pytest.mark.parametrize("colour", [0.0, 0.8])
def test_the_plant_is_identified_in_the_loop(plant, colour):
    """Directly, with a noise model; the feedback is not mistaken for swapped signals."""
    found = identify(looped(plant, colour=colour))
    assert gain_error(found.model, plant) < CLOSE
    assert found.model.nk >= 1
    assert found.causality is None
    assert any("as in closed loop" in reason for reason in found.verdict.reasons)


def test_a_reference_confirms_the_estimate():
    """Named, the loop is no doubt of its own: two-stage and direct estimate agree."""
    found = identify(looped(named=True))
    assert found.loop.two_stage is not None
    assert gain_error(found.loop.two_stage, LAG) < CLOSE
    assert not any("closed loop" in reason or "two-stage" in reason for reason in found.verdict.reasons)
    assert any(clause.startswith("The two-stage estimate") for clause in found.verdicts)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("named", [True, False])
def test_steps_of_the_reference_are_no_fault_of_the_sensor(seed, named):
    """With the present u the regression solved the controller for y: its innovations were the steps."""
    r = np.repeat(np.random.default_rng(seed).integers(0, 2, 30) * 2.0 - 1, 100)
    rec = looped(LATE, r=r, snr=20, seed=seed, named=named)
    found = identify(rec)
    assert found.loop.feedback.found
    assert found.disturbances.found == ()
    np.testing.assert_allclose(found.record.y, rec.centred().y, rtol=1e-9, atol=1e-12)


def test_a_spike_in_closed_loop_is_replaced():
    r = np.repeat(np.random.default_rng(0).integers(0, 2, 30) * 2.0 - 1, 100)
    rec = looped(LATE, r=r, snr=25, named=True)
    y = rec.y.copy()
    y[1234] += np.std(y)
    assert disturbances(Record(u=rec.u, y=y, sample_time=T, reference=r).centred()).replaced.tolist() == [1234]


def test_two_stage_holds_its_standard_errors():
    """Strongly coloured noise, PRBS as reference: the true coefficients lie within 4 of them."""
    rec = looped(named=True, colour=0.95, r=prbs(1.0, 15.0, 50.0, hold=0.4)).centred()
    model = two_stage(rec, lambda part: box_jenkins(part, 1, 1, 6))
    f = np.geomspace(0.2, 2.0, 10)
    assert (np.abs(model.response(f) - LAG.response(f)) < 4 * response_error(model, f) + 0.02).all()


@pytest.mark.parametrize("late", [0, 1])
def test_a_loop_at_constant_reference_is_refused_with_what_to_record(late):
    rec = looped(r=np.ones(N), snr=20, late=late)
    with pytest.raises(IdentError, match=r"as under a PI controller with constant reference .*Kp 1\.5.*steps of about"):
        checked_feedback(rec.part(300, N).centred())


REFUSED = {
    "constant": (np.ones(N), "the reference does not vary"),
    "input": (None, "reference and input u are the same signal"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_reference_that_is_none_is_refused(what):
    given, words = REFUSED[what]
    rec = looped()
    rec = Record(u=rec.u, y=rec.y, sample_time=T, reference=rec.u if given is None else given)
    with pytest.raises(IdentError, match=words):
        identify(rec)


def test_an_undecided_loop_is_listed_as_not_checked():
    found = identify(open_loop(np.random.default_rng(9).standard_normal(N), 30, 1))
    assert any(text.startswith("Closed loop: u is too irregular") for text in found.verdict.not_checked)
    assert "Closed loop" not in found.verdict.checked


def test_the_inverse_of_the_controller_is_refused_where_feedback_is_not_decided():
    """A lag behind a dead time, moved seldom: the model of the record was b0 -.5, "usable with reservations"."""
    rng, x, total, load = np.random.default_rng(2), 0.0, 0.0, 0.0
    r = np.repeat(np.random.default_rng(102).choice([1.0, 1.1, 0.9, 1.05, 0.95], 20), 100)
    u, y, a = *np.zeros((2, 2000)), np.exp(-0.01 / 0.15)
    for k in range(2000):
        load = 0.98 * load + 0.004 * rng.standard_normal()
        y[k] = x + load + 0.004 * rng.standard_normal()
        total += 0.03 * (r[k] - y[k])
        u[k] = 0.5 * (r[k] - y[k]) + total
        x = a * x + (1 - a) * 0.8 * (u[k - 5] if k >= 5 else 0.0)
    found = identify(Record(u=u, y=y, sample_time=0.01))
    assert found.model.b[0] < -0.4
    assert found.verdict.level == 2
    assert "y answers u within the same sample and against the static gain (b0 -0.4" in found.verdict.reasons[0].lower()
    named = identify(Record(u=u, y=y, sample_time=0.01, reference=r))
    assert named.model.dc_gain == pytest.approx(0.75, abs=0.1)
    assert named.verdict.level < 2


def written(tmp_path, **columns):
    path = tmp_path / "production.csv"
    cells = np.column_stack(list(columns.values()))
    path.write_text(",".join(columns) + "\n" + "".join(",".join(f"{c:.6f}" for c in row) + "\n" for row in cells))
    return str(path)


@pytest.fixture(scope="module")
def production(tmp_path_factory):
    """A minute of production: a constant-load PI on the published plant, its target moved every 5 s."""
    r = 0.2 + np.repeat(np.array([0, 1, 0, -1, 1, 0, -1, 1, -1, 0, 1, 0]) * 0.02, 250)
    rec = looped(PUBLISHED, r, snr=25.0, seed=3)
    folder = tmp_path_factory.mktemp("loop")
    columns = {"time [s]": T * np.arange(len(r)), "target [A]": r, "command [V]": rec.u, "current [A]": rec.y}
    return written(folder, **columns), folder


def test_a_running_loop_is_tuned_again_from_production_data(production, capsys):
    """Reference, command and load of the loop in use -> model -> gains that meet 2 s and 4 s on the true plant."""
    path, folder = production
    named = ["--input", "command", "--output", "current", "--reference", "target"]
    assert main(["ident", path, *named, "--out", str(folder / "fit")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "The two-stage estimate from the reference differs from the direct one by at most" in said
    file = folder / "fit" / "params.json"
    assert main(["tune", str(file), "--rise", "2", "--settle", "4", "--overshoot", "0.05"]) == 0
    pi = parameters.read(file).pi
    figures = loop_of(PUBLISHED, PiGains(pi.kp, pi.ki, T, delay=pi.delay)).figures()
    assert figures.rise_time <= 2.0
    assert figures.settling_time <= 4.0


def test_the_reference_is_read_beside_two_signals(production):
    """Input and output need no names once the reference has one; a wrong name is refused with the nearest."""
    path, _ = production
    rec = read_record(path, reference="target")
    assert (rec.input, rec.output) == ("command", "current")
    assert rec.reference[[0, 260]].tolist() == pytest.approx([0.2, 0.22])
    with pytest.raises(UsageError, match="--reference targett: the file has no such column; did you mean 'target"):
        read_record(path, reference="targett")
    with pytest.raises(IdentError, match="reference and input command are the same signal"):
        identify(read_record(path, "command", "current", reference="command"))


@pytest.mark.parametrize("a", [[1.0, -1.77138815, 0.92311635], [1.0, -0.5]], ids=["damped drive", "fast lag"])
def test_a_sweep_of_a_plant_in_open_loop_is_not_refused_where_u_resembles_y(a):
    """A smooth u is nearly a combination of a few y; without feedback in the noise that is no controller."""
    plant = Model(b=[0.0, sum(a)], a=a, nk=1, sample_time=T)
    u = chirp()
    x = plant.simulate(u)
    noise = np.random.default_rng(1).standard_normal(len(u)) * x.std() * 10 ** (-30 / 20)
    assert checked_feedback(Record(u=u, y=x + noise, sample_time=T).centred()).state == "none"
