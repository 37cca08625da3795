"""From a record to a verdict: the published plant is found again, real machines are simulated, doubt is said."""

from dataclasses import replace

import numpy as np
import pytest
from fitmodels import datasets, ident, parameters
from fitmodels.core.errors import IdentError
from fitmodels.datasets import Record
from fitmodels.datasets.records.record import join_records
from fitmodels.ident import Model, identify
from fitmodels.ident.continuous import ContinuousModel, sampled
from fitmodels.ident.static_nonlinearity import backlash
from fitmodels.ident.structure.final_estimates import rescored
from fitmodels.ident.validation.model_validation import plausibility_remarks
from scipy.signal import lfilter

pytestmark = pytest.mark.slow

# Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 17 and 18
G = Model(b=[0, 0.0611, -0.1338, 0.0752], a=[1, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)
U = ident.chirp()
FREQUENCIES = np.array([0.1, 0.5, 1.0, 2.0])


def run(snr=None, seed=1, offset=(0.0, 0.0)):
    y = G.simulate(U)
    noise = 0.0 if snr is None else np.random.default_rng(seed).standard_normal(len(y)) * y.std() * 10 ** (-snr / 20)
    return Record(u=U + offset[0], y=y + noise + offset[1], sample_time=0.02, unit_u="V", unit_y="A")


@pytest.fixture(scope="module")
def at_30_db():
    return identify(run(30))


def test_without_noise_the_published_plant_comes_back_exactly():
    found = identify(run(offset=(5.0, 0.24)))
    assert (found.model.na, found.model.nb, found.model.nk) == (3, 3, 1)
    np.testing.assert_allclose(found.model.theta, G.theta, rtol=1e-6)


def test_sensor_noise_bends_arx_and_not_the_model_and_that_is_said(at_30_db):
    error = np.abs(at_30_db.model.response(FREQUENCIES) / G.response(FREQUENCIES) - 1)
    assert error.max() < 0.02
    bent = np.abs(at_30_db.arx.response(FREQUENCIES) / G.response(FREQUENCIES) - 1)
    assert bent.max() > 0.1
    assert "sensor noise" in at_30_db.bias
    assert any("sensor noise" in verdict for verdict in at_30_db.verdicts)


def test_uneven_samples_make_the_delay_uncertain(tmp_path):
    """A held command, interpolated as a straight line: the delay was 4 ms too short with a standard error of 0.2 ms."""
    rng, t = np.random.default_rng(1), 0.01 * np.arange(1500)
    u = 2 * np.sin(2 * np.pi * (0.1 + 0.1 * t) * t)
    y = Model(b=[0.0] * 5 + [0.03], a=[1.0, -0.94], nk=5, sample_time=0.01).simulate(u)
    cells = np.column_stack([t + rng.uniform(0, 0.008, 1500), u, y + 0.005 * rng.standard_normal(1500)])
    path = tmp_path / "uneven.csv"
    np.savetxt(path, cells, "%.6f", ",", header="t [s],command [V],current [A]", comments="")
    found = identify(datasets.read_record(path, resample=100.0))
    assert [one for one in found.verdict.reasons if one.startswith("The delay is uncertain by 0.005 s")]


@pytest.mark.parametrize(("units", "named"), [(("mm/s", "m/min"), True), (("V", "mm/s"), False), (("", ""), False)])
def test_a_reversed_actual_value_is_named(units, named):
    """A command of 100 mm/s and an actual speed of -98 mm/s; in V the sign of a speed is a matter of the wiring."""
    rec = run(30)
    found = identify(replace(rec, y=-rec.y, unit_u=units[0], unit_y=units[1]))
    reasons = [one for one in found.verdict.reasons if "u rises; check the sign of the sensor" in one]
    assert bool(reasons) == named


def test_the_band_is_what_the_chirp_excites(at_30_db):
    low, high = at_30_db.model.band
    assert low < 0.15
    assert 1.8 < high < 2.4


def test_samples_that_judge_were_not_fitted(at_30_db):
    assert at_30_db.validation.held_out
    assert at_30_db.validation.fit > 90
    assert "samples 126 to 250 and 501 to 625" in at_30_db.validated_on


def test_a_second_run_judges_where_there_is_one():
    found = identify([run(30, 1), run(30, 2)])
    assert "run 2 of 2" in found.validated_on
    other = identify(run(30, 1), held_out=run(30, 3))
    assert "held-out samples" in other.validated_on


def test_known_orders_are_taken_as_they_are():
    found = identify(run(30), orders=(3, 3, 1))
    assert len(found.tried) == 1
    assert (found.model.na, found.model.nb, found.model.nk) == (3, 3, 1)


def test_units_scale_the_gain():
    rec = run(30)
    found = identify(rec, orders=(3, 3, 1)).model
    scaled = identify(Record(u=rec.u * 1000, y=rec.y * 10, sample_time=0.02), orders=(3, 3, 1)).model
    assert scaled.dc_gain == pytest.approx(found.dc_gain / 100, rel=1e-6)


def test_a_reversed_sensor_is_suspected():
    rec = run(40)
    found = identify(Record(u=rec.u, y=-rec.y, sample_time=0.02, unit_u="V", unit_y="A"))
    assert any("check the sign of the sensor" in words for words in found.verdict.reasons)


def test_swapped_columns_are_suspected():
    rec = run(40)
    assert identify(Record(u=rec.y, y=rec.u, sample_time=0.02)).causality is not None


@pytest.mark.parametrize(
    ("u", "y", "words"),
    [
        (np.ones(400), np.random.default_rng(1).normal(size=400), "constant|still|vary"),
        (U[:12], G.simulate(U)[:12], "short|samples|order"),
    ],
    ids=["constant input", "too short"],
)
def test_what_cannot_be_identified_is_said(u, y, words):
    with pytest.raises(IdentError, match=words) as error:
        identify(Record(u=u, y=y, sample_time=0.02))
    assert "\n" not in str(error.value)


# Real machines


def test_a_hair_dryer_is_simulated_on_what_was_not_fitted(measurements):
    """DaISy dryer: published ARX simulates samples 801 to 900 with 88 % fit."""
    rec = datasets.read_record(measurements / "daisy" / "dryer.dat", input="col1", output="col2", sample_time=0.08)
    found = identify(rec.part(0, 300), held_out=rec.part(800, 900))
    assert found.validation.fit > 87


def test_a_robot_arm_is_simulated_on_what_was_not_fitted(measurements):
    rec = datasets.read_record(measurements / "daisy" / "robot_arm.dat", input="col1", output="col2", sample_time=0.01)
    assert identify(rec).validation.rsquared > 0.95


def test_a_servo_is_simulated_on_what_was_not_fitted(measurements):
    file = measurements / "servo_sweep" / "LinA__pp-sine-sweep-10mm-0.5Hz.txt"
    rec = datasets.read_record(file, input="col3", output="col4", time="col1", units={"time": "ms"})
    found = identify(rec)
    assert found.validation.held_out
    assert found.validation.rsquared > 0.98


# The structure


def of(b, a, snr, seed=1, n=750, noise=(1.0,)):
    """Chirp record of a plant with noise shaped by 1 / ``noise``."""
    t = np.arange(n) * 0.02
    u = 2.5 * np.sin(2 * np.pi * (0.1 + 1.9 / (2 * n * 0.02) * t) * t)
    y = lfilter(b, a, u)
    v = lfilter([1.0], noise, np.random.default_rng(seed).standard_normal(n + 500))[500:]
    return Record(u=u, y=y + y.std() * 10 ** (-snr / 20) * v / v.std(), sample_time=0.02)


LATE = (np.r_[np.zeros(30), 0.05], [1.0, -0.95])
MORE_ZEROS = ([0.0, 0.0, 0.6, -0.2], [1.0, -0.5])


def test_a_delay_of_thirty_samples_is_found():
    model = identify(of(*LATE, 40)).model
    assert model.nk == 30
    assert np.abs(model.response(FREQUENCIES) / response(*LATE) - 1).max() < 0.01


def test_a_delay_of_thirty_samples_is_found_with_a_binary_input():
    """Of 40 such records 15 had a delay of 20 samples and a form that made up for it, with errors of 6 %."""
    u = ident.prbs(2.5, 15.0, 50.0, hold=0.2)
    y = lfilter(*LATE, u)
    for seed in range(4):
        e = np.random.default_rng(seed).standard_normal(len(u))
        model = identify(Record(u=u, y=y + 0.03 * y.std() * e, sample_time=0.02)).model
        assert np.abs(model.response(FREQUENCIES) / response(*LATE) - 1).max() < 0.03


def test_a_long_delay_is_found_where_no_form_describes_the_plant():
    """The published plant 30 samples later: without the delay of the best form its gain was wrong by 27 %."""
    u = ident.prbs(2.5, 15.0, 50.0, hold=0.2)
    late = (np.r_[np.zeros(29), G.b], G.a)
    y = lfilter(*late, u)
    e = np.random.default_rng(0).standard_normal(len(u))
    model = identify(Record(u=u, y=y + 0.03 * y.std() * e, sample_time=0.02)).model
    assert model.nk == 30
    assert np.abs(model.response(FREQUENCIES) / response(*late) - 1).max() < 0.05


def test_equal_lags_below_the_sample_time_are_no_form():
    """Five lags of .008 s, sampled every .02 s, stand for a delay with one parameter less."""
    found = identify(of(*MORE_ZEROS, 30))
    assert not any("equal" in name for name in found.tried["form"])


# a zero in the right half plane: K (1 - .2 s) / ((.5 s + 1)(.2 s + 1)(.1 s + 1))
NON_MINIMUM_PHASE = sampled([-0.2, 1.0], np.poly([-2.0, -5.0, -10.0]) / 100, dt=0.02)


@pytest.mark.parametrize("seed", [4, 6, 15])
def test_the_true_orders_are_no_better_than_those_found(seed):
    """The delays of an order are screened by an iteration that misses the best; its neighbours are fitted as well."""
    rec = of(NON_MINIMUM_PHASE.b, NON_MINIMUM_PHASE.a, 20, seed=seed)
    given = min(identify(rec, orders=orders).search.chosen.total for orders in ((3, 3, 1), (3, 2, 1)))
    assert min(one.total for one in identify(rec).search.candidates) < given + 2.0


def test_a_final_estimate_pays_for_the_poles_that_it_has():
    """On the measured input of a plant with backlash a candidate without a pole beyond the band got one at -1."""
    rec = run(30).centred()
    one = identify(rec).chosen
    ringing = Model(b=[0.0, 0.1, 0.1], a=np.polymul([1.0, -0.9], [1.0, 0.9999]), nk=1, sample_time=0.02)
    assert one.guard == 0.0
    again = rescored(rec, one, replace(ringing, n=len(rec), noise_variance=1e-3))
    assert again.guard == pytest.approx(np.log(len(rec)))  # one coefficient for the pole


def test_a_form_with_a_delay_beyond_the_search_is_no_candidate():
    """Swapped columns fitted a lag with a delay of 139 samples, more coefficients than a file holds."""
    rng = np.random.default_rng(1)
    lag = sampled([1.0], [0.3, 1.0], dt=0.02, delay=0.05)
    y = lag.simulate(backlash(U, 0.5))
    found = identify(Record(u=y + 0.01 * y.std() * rng.standard_normal(len(y)), y=U, sample_time=0.02))
    assert found.verdict.level == 2
    assert "swapped" in found.verdict.reasons[0]
    assert max(one.nk for one in found.search.candidates) <= 76  # a tenth of 750 samples, and one
    parameters.collect(tool="clamp", work="axis", laws=[], dynamics=found)


def test_the_form_of_a_long_record_is_that_of_all_its_samples():
    """Eight parts of it are searched: its parameters were those of the parts, the model that of all samples."""
    lags = sampled([1.0], [0.1, 0.7, 1.0], dt=0.02, delay=0.05)
    found = identify(of(lags.b, lags.a, 30, n=8_000), delays=range(1, 6))
    assert found.form is not None
    assert found.form.model.n == found.model.n == 8_000
    assert found.form.values[0] == pytest.approx(found.model.dc_gain, rel=1e-9)
    assert found.tried["weight"].sum() == pytest.approx(1.0)


def response(b, a):
    return Model(b=b, a=a, nk=int(np.flatnonzero(b)[0]), sample_time=0.02).response(FREQUENCIES)


def test_equation_noise_is_recognised():
    found = identify(of(G.b, G.a, 30, noise=G.a))
    assert found.model.structure == "arx"
    assert found.bias is None


def test_more_zeros_than_poles_are_found():
    u, e = np.random.default_rng(3).standard_normal((2, 1000))
    found = identify(Record(u=u, y=lfilter(*MORE_ZEROS, u) + 0.05 * e, sample_time=0.02))
    assert (found.model.na, found.model.nb, found.model.nk) == (1, 2, 2)


def test_coloured_sensor_noise_has_its_own_model():
    found = identify(of(G.b, G.a, 30, noise=[1.0, -0.8]))
    assert found.model.structure == "box_jenkins"
    assert found.model.d[1] == pytest.approx(-0.8, abs=0.1)
    assert np.abs(found.model.response(FREQUENCIES) / G.response(FREQUENCIES) - 1).max() < 0.05


def test_an_integrator_has_a_pole_at_exactly_one():
    found = identify(of([0.0, 0.0, 0.0, 0.02], [1.0, -1.0], 30))
    assert found.model.integrating
    assert found.model.rate_gain == pytest.approx(1.0, rel=0.02)


def test_a_drift_that_is_estimated_leaves_no_integrating_candidate():
    """A pole at 1 would fit the same drift: a random walk once made an integrator of this plant."""
    rec = of(G.b, G.a, 30)
    t = np.linspace(-1, 1, len(rec))
    found = identify(replace(rec, y=rec.y + 0.3 * np.std(rec.y) * (t + t**2)))
    assert found.disturbances.drift
    assert not any(one.integrating for one in found.search.candidates)


def test_weights_of_structures_sum_to_one_with_that_of_the_model():
    found = identify(of(*MORE_ZEROS, 20))
    shares = [weight for weight, _ in found.model.alternatives]
    assert shares
    assert 0 < 1 - sum(shares) < 1
    assert found.tried["weight"].sum() == pytest.approx(1.0)


def test_the_longest_delay_tried_is_named():
    found = identify(of(*LATE, 40), delays=range(1, 28))
    assert any("nk 27 is the longest delay tried" in note for note in found.notes)


def test_a_slow_sweep_of_many_samples_is_searched_over_its_whole_band():
    """20 000 samples, 400 s: any single part of 3 200 samples excites a sixth of the band."""
    found = identify(of(G.b, G.a, 30, n=20_000))
    assert (found.model.na, found.model.nb, found.model.nk) == (3, 3, 1)
    assert np.abs(found.model.response(FREQUENCIES) / G.response(FREQUENCIES) - 1).max() < 0.01
    assert found.model.n == 20_000


def test_runs_of_one_length_equal_runs_of_several_lengths():
    """Segments of one length are treated together; one sample less in the last changes next to nothing."""
    parts = [of(G.b, G.a, 30, seed=seed, n=600) for seed in (1, 2, 3)]
    same = join_records(parts)
    other = join_records([*parts[:2], parts[2].part(0, 599)])
    theta = [ident.box_jenkins(rec.centred(), 3, 3, 1).theta for rec in (same, other)]
    np.testing.assert_allclose(theta[0], theta[1], rtol=0.01)


# A fast and a slow lag: gain at rest 2, of which nothing above 1 Hz shows the slow half


def two_lags(u, noise=0.01, seed=1):
    fast, slow = (ContinuousModel(np.array([1.0]), np.array([T, 1.0])).sampled(0.02) for T in (0.15, 3.0))
    y = fast.simulate(u) + slow.simulate(u)
    return Record(u=u, y=y + noise * np.random.default_rng(seed).standard_normal(len(u)), sample_time=0.02)


@pytest.mark.parametrize("f", [0.5, 2.0])
def test_a_single_sine_gives_no_gain_at_rest(f):
    found = identify(two_lags(np.sin(2 * np.pi * f * 0.02 * np.arange(1500))))
    assert found.concern
    assert any("Hz alone, so that all else is an extrapolation" in one for one in found.verdict.reasons)


def test_a_gain_at_rest_below_the_excited_band_is_an_extrapolation():
    """A slow lag with a chirp from 1.9 Hz on; from 0.05 Hz on there is no doubt."""
    t = 0.02 * np.arange(3000)
    plant = ContinuousModel(np.array([1.0]), np.array([2.0, 1.0])).sampled(0.02)
    for low, doubted in ((1.9, True), (0.02, False)):
        u = np.sin(2 * np.pi * (low + (5.1 - low) / (2 * t[-1]) * t) * t)
        y = plant.simulate(u) + 1e-3 * np.random.default_rng(1).standard_normal(3000)
        reasons = identify(Record(u=u, y=y, sample_time=0.02)).verdict.reasons
        assert any("is an extrapolation: the input excites nothing below" in one for one in reasons) == doubted


@pytest.mark.parametrize(("nk", "seconds"), [(1, 0.0), (4, 0.06)])
def test_the_dead_time_is_without_the_sample_of_the_hold(nk, seconds):
    """A plant without dead time had "delay 0.02 s" beside a continuous estimate of none."""
    u = np.repeat(np.random.default_rng(1).standard_normal(100), 10)
    y = Model(b=[0.0] * nk + [0.1], a=[1.0, -0.9], nk=nk, sample_time=0.02).simulate(u)
    found = identify(Record(u=u, y=y + 0.01 * np.random.default_rng(2).standard_normal(1000), sample_time=0.02))
    assert found.dead_time == pytest.approx(seconds, abs=0.002)


@pytest.mark.parametrize("kind", ["sweep", "steps"])
def test_an_output_that_precedes_the_command_is_refused(kind):
    """Two clocks, 50 ms apart: a sweep was predicted by b = 24, -125, 279, ..., "usable with reservations"."""
    t = 0.01 * np.arange(2008)
    sweep = np.sin(2 * np.pi * (0.05 + 4.95 / 40 * t) * t)
    u = sweep if kind == "sweep" else np.repeat(np.random.default_rng(1).choice([-1.0, 1.0], 251), 8)
    y = Model(b=[0.0, 0.0516], a=[1.0, -0.9355], nk=1, sample_time=0.01).simulate(u)
    y += 0.01 * np.random.default_rng(2).standard_normal(2008)
    early, sound = (Record(u=u[:2000], y=y[k : 2000 + k], sample_time=0.01) for k in (5, 0))
    assert identify(sound).causality is None
    found = identify(early)
    if kind == "sweep":
        assert found.causality.startswith("y responds at least 4 samples (0.04 s) before u changes")
    assert found.verdict.level == 2


@pytest.mark.parametrize(("gain", "words"), [(1.0, "are the same signal in"), (2.5, "one signal, y = 2.5 u, in all")])
def test_two_columns_of_one_signal_are_refused(gain, words):
    """Rounding was tested as noise: residuals "depend on the command", a backlash, a closed loop."""
    with pytest.raises(IdentError, match=words):
        identify(Record(u=U, y=np.round(gain * U, 6), sample_time=0.02))


def test_residuals_of_rounding_are_not_tested():
    found = run()
    judged = identify(Record(u=U, y=found.y.round(10), sample_time=0.02)).verdict
    assert not any("depend" in reason for reason in judged.reasons)


def test_a_response_that_does_not_settle_is_stated_without_inf():
    ringing = Model(b=[0.0, 0.1], a=[1.0, -1.2, 0.9999999999], nk=1, sample_time=0.02)
    (words, *_) = plausibility_remarks(ringing, 20.0)
    assert words.startswith("the step response does not settle, and the longest segment lasts 20 s")
