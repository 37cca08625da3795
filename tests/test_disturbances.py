"""Disturbances of a record: each is found with its size and place, and a record without any has none."""

import numpy as np
import pytest
from fitmodels.cards.content.dynamics import dynamics_part
from fitmodels.datasets import Record
from fitmodels.ident import Model, chirp, identify, record_disturbances, tune_pi
from fitmodels.ident.additive_disturbances import origins_of_line
from fitmodels.ident.continuous import ContinuousModel
from fitmodels.ident.estimators.high_order_arx import input_lags, long_arx
from fitmodels.ident.estimators.prediction_error import output_error
from fitmodels.ident.figures import structure_chart
from fitmodels.ident.outliers import repeats, skips
from fitmodels.ident.record_disturbances import disturbances
from fitmodels.ident.static_nonlinearity import Nonlinearity, backlash
from fitmodels.parameters.gather.control import dynamics_section
from fitmodels.parameters.sections.dynamics import DynamicsSection

T = 0.02
CLM = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=T)
LAG = Model(b=[0.0, 0.0, 0.0, 0.06], a=[1.0, -0.94], nk=3, sample_time=T)
DRIVE = Model(b=[0.0, 0.0769, 0.0748], a=[1.0, -1.7714, 0.9231], nk=1, sample_time=T)
AMPLITUDE = 2.5  # of the chirp


def record(plant=LAG, seed=1, noise=0.03, acting=lambda u: u, coloured=False, extra=0.0):
    """A chirp of 15 s about a level of 1, with sensor noise relative to the standard deviation of the output."""
    from scipy.signal import lfilter

    u = chirp()
    x = plant.simulate(acting(u))
    e = np.random.default_rng(seed).standard_normal(len(u))
    v = lfilter([0.6], [1.0, -0.8], e) if coloured else e
    return Record(u=u + 1.0, y=x + np.std(x) * (noise * v + extra) + 3.0, sample_time=T, unit_u="mm/min", unit_y="A")


def kinds(rec):
    return [item.kind for item in disturbances(rec).found]


@pytest.mark.parametrize("plant", [CLM, LAG, DRIVE])
@pytest.mark.parametrize("coloured", [False, True])
def test_a_record_without_disturbance_has_none(plant, coloured):
    for seed in range(3):
        rec = record(plant, seed, coloured=coloured)
        found = disturbances(rec)
        assert found.found == ()
        np.testing.assert_allclose(found.record.y, rec.y, rtol=1e-12)
        assert found.columns is None


def test_spikes_are_replaced_by_values_near_the_true_ones():
    at = np.array([100, 101, 333, 600])
    extra = np.zeros(750)
    extra[at] = [1.5, 1.5, -1.0, 0.5]
    clean, rec = record(), record(extra=extra)
    found = disturbances(rec)
    assert found.replaced.tolist() == at.tolist()
    assert np.abs(found.record.y[at] - clean.y[at]).max() < 0.15 * np.std(clean.y)  # noise .03, two in a row
    (item,) = found.found
    assert item.size == pytest.approx(1.5 * np.std(clean.y), rel=0.1)
    assert "samples 101, 102, 334, 601" in item.sentence
    assert "750 samples" in item.sentence
    np.testing.assert_array_equal(np.delete(found.record.u, at), np.delete(rec.u, at))


@pytest.mark.parametrize("at", [(1,), (2,), (9,), (400, 404, 417), (30, 44), (748,)])
@pytest.mark.parametrize("plant", [CLM, LAG, DRIVE])
def test_spikes_at_the_ends_of_a_record_and_close_together_are_found(plant, at):
    extra = np.zeros(750)
    extra[list(at)] = [1.0, -0.8, 0.7][: len(at)]
    assert disturbances(record(plant, extra=extra)).replaced.tolist() == list(at)


@pytest.mark.parametrize("gain", [[0.0, 0.12], [0.0, 0.0, 0.08, 0.04], [0.0, 0.02, 0.019]])
@pytest.mark.parametrize("seed", range(3))
def test_a_command_that_begins_at_its_amplitude_leaves_no_spikes(gain, seed):
    """A chirp by cosine from rest: its first samples had been replaced as spikes."""
    t = T * np.arange(1500)
    u = 2.5 * np.cos(2 * np.pi * (0.1 + 4.9 / 60 * t) * t)
    plant = Model(b=gain, a=[1.0, -0.88] if len(gain) != 3 else [1.0, -1.6, 0.65], nk=1, sample_time=T)
    y = plant.simulate(u) + 0.01 * np.random.default_rng(seed).standard_normal(1500)
    assert disturbances(Record(u=u, y=y, sample_time=T)).found == ()


@pytest.mark.parametrize("seed", range(3))
def test_a_command_that_begins_at_rest_leaves_no_spikes_after_a_dead_time(seed):
    """A sum of sines about a level, from rest, with dead time: the start of the response had been replaced."""
    t = 0.01 * np.arange(2000)
    u = 5.0 + sum(0.4 * np.cos(2 * np.pi * 0.05 * k * t - np.pi * k * k / 40) for k in range(1, 41))
    y = Model(b=[0.0] * 6 + [0.0516], a=[1.0, -0.9355], nk=6, sample_time=0.01).simulate(u)
    rec = Record(u=u, y=y + 0.01 * np.random.default_rng(seed).standard_normal(2000), sample_time=0.01)
    assert disturbances(rec).found == ()


@pytest.mark.parametrize("at", [1, 15, 40])
def test_a_step_at_the_start_of_a_record_is_identified_or_refused_with_a_reason(at):
    """The input is constant in all rows of the long regression, which then has no lag of it."""
    u = np.r_[np.zeros(at), np.ones(1500 - at)]
    y = LAG.simulate(u) + 0.01 * np.random.default_rng(0).standard_normal(1500)
    found = identify(Record(u=u, y=y, sample_time=T))
    assert found.model.dc_gain == pytest.approx(1.0, rel=0.1)
    assert any("The input hardly changes in the samples that can be held out" in one for one in found.verdict.reasons)
    assert any(one.startswith("Simulation of samples not fitted") for one in found.verdict.not_checked)


def test_a_load_impulse_is_no_spike():
    """An innovation passes through the plant; only a wrong sample of the sensor is isolated."""
    from scipy.signal import lfilter

    kick = np.zeros(750)
    kick[400] = 1.0
    rec = record(extra=0.5 * lfilter([1.0], DRIVE.a, kick), plant=DRIVE)
    assert "spikes" not in kinds(rec)


@pytest.mark.parametrize("f", [1.3, 7.3, 21.0])
def test_a_line_is_found_with_frequency_and_amplitude(f):
    extra = 0.1 * np.sin(2 * np.pi * f * T * np.arange(750) + 0.7)
    rec = record(extra=extra)
    found = disturbances(rec)
    (item,) = found.found
    assert found.lines == pytest.approx((f,), abs=0.01)
    assert item.size == pytest.approx(0.1 * np.std(record().y), rel=0.2)
    assert found.columns.shape == (750, 2)


@pytest.mark.parametrize("size", [0.3, 3.0])
def test_a_strong_line_is_not_absorbed_by_the_lags(size):
    found = disturbances(record(CLM, extra=size * np.sin(2 * np.pi * 13.3 * T * np.arange(750))))
    assert found.lines == pytest.approx((13.3,), abs=0.001)
    assert found.found[0].size == pytest.approx(size * np.std(record(CLM).y), rel=0.1)


def test_an_aliased_line_names_its_possible_origins():
    extra = 0.1 * np.sin(2 * np.pi * 60.0 * T * np.arange(750))
    (item,) = disturbances(record(extra=extra)).found
    assert float(item.place.split()[0]) == pytest.approx(10.0, abs=0.01)
    assert "60 (mains)" in item.sentence
    assert origins_of_line(12.0, 100.0).startswith("Sampled at 100 Hz, it may stem from 12, 88, 112")


def test_drift_is_fitted_beside_the_plant():
    extra = 0.5 * np.linspace(-0.5, 0.5, 750)
    found = disturbances(record(extra=extra))
    (item,) = found.found
    assert (item.kind, found.drift) == ("drift", 1)
    assert item.size == pytest.approx(0.5 * np.std(record().y), rel=0.1)


def test_an_integrator_has_no_drift():
    plant = Model(b=[0.0, 0.02], a=[1.0, -1.0], nk=1, sample_time=T)
    assert kinds(record(plant, noise=0.01)) == []


@pytest.mark.parametrize(
    ("kind", "acting", "words"),
    [
        ("dead zone", lambda u: u - np.clip(u, -0.5, 0.5), "u from 0."),
        ("backlash", lambda u: backlash(u, 1.0), "reversals"),
        ("saturation", lambda u: np.clip(u, -1.75, 1.75), "below -0.7"),
        ("saturation", lambda u: np.minimum(u, 1.5), "above 2."),
        ("curvature", lambda u: u + 0.1 * u**2, "varies over u from -1.5 to 3.5 mm/min"),
    ],
)
@pytest.mark.parametrize("plant", [CLM, LAG])
def test_a_static_nonlinearity_is_named_with_its_size(plant, kind, acting, words):
    (item,) = disturbances(record(plant, acting=acting)).found
    assert item.kind == kind
    assert words in item.sentence
    size = {"dead zone": 1.0, "backlash": 1.0}.get(kind)
    assert size is None or item.size == pytest.approx(size, rel=0.15)


@pytest.mark.parametrize("lag", [5, 20])
@pytest.mark.parametrize("levels", [2, 3, 7])
def test_noise_of_a_measured_input_that_steps_is_no_nonlinearity(lag, levels):
    """A saturation at the levels would cut the noise off; one at .65 of the range is found in spite of it."""
    rng = np.random.default_rng(levels)
    held = rng.integers(20, 120, 60)
    u = np.repeat(rng.choice(np.linspace(800.0, 1000.0, levels), 60), held)[:3000]
    pole = np.exp(-1 / lag)
    plant = Model(b=[0.0, 0.5 * (1 - pole)], a=[1.0, -pole], nk=1, sample_time=T)
    measured, noise = u + 2.0 * rng.standard_normal(3000), rng.standard_normal(3000)

    def named(acting):
        y = plant.simulate(acting - 900.0)
        return kinds(Record(u=measured, y=y + 0.03 * np.std(y) * noise, sample_time=T))

    assert named(u) == []
    assert ("saturation" in named(np.minimum(u, 930.0))) == (levels == 7)


def test_a_quantised_and_a_clipped_output_are_named():
    rec = record()
    step = np.ptp(rec.y) / 12
    coarse = Record(u=rec.u, y=np.round(rec.y / step) * step, sample_time=T)
    assert "quantisation" in kinds(coarse)
    fine = Record(u=rec.u, y=rec.y.round(4), sample_time=T)
    assert "quantisation" not in kinds(fine)
    limit = float(np.quantile(rec.y, 0.85))
    assert "clipped output" in kinds(Record(u=rec.u, y=np.minimum(rec.y, limit), sample_time=T))


def test_a_clipped_output_must_not_be_used_and_is_not_called_backlash():
    """It was "usable with reservations" with a model that integrates and a backlash that the plant has not."""
    rec = record(noise=0.01)
    limit = float(np.quantile(rec.y, 0.9))
    found = disturbances(Record(u=rec.u, y=np.minimum(rec.y, limit), sample_time=T))
    assert [(item.kind, item.level) for item in found.found] == [("clipped output", 2)]


@pytest.mark.parametrize(
    "held", [lambda y: y.round(1), lambda y: np.maximum(y.round(2), 0.0)], ids=["coarse", "at zero"]
)
def test_a_quantised_output_that_settles_is_not_clipped(held):
    u = np.repeat([0.0, 1.0, 0.0, 1.0, 0.0, 1.0], 250)
    y = LAG.simulate(u) + 0.002 * np.random.default_rng(1).standard_normal(1500)
    found = disturbances(Record(u=u, y=held(y), sample_time=T))
    assert all(item.level < 2 for item in found.found)


def test_records_that_cannot_be_tested_say_so():
    rec = record()
    assert "too few" in disturbances(rec.part(0, 100)).remark
    u = chirp()
    assert disturbances(Record(u=u, y=LAG.simulate(u), sample_time=T)).remark == "the record has no noise"


def test_segments_have_their_own_level_and_phase():
    extra = 0.1 * np.sin(2 * np.pi * 7.3 * T * np.r_[np.arange(400), np.arange(350) + 17])
    rec = record(extra=extra)
    found = disturbances(Record(u=rec.u, y=rec.y, sample_time=T, starts=(0, 400)))
    assert found.lines == pytest.approx((7.3,), abs=0.02)
    assert found.columns.shape == (750, 4)
    assert not found.columns[:400, 2:].any()
    assert not found.columns[400:, :2].any()


def test_the_f_test_holds_its_level():
    """Unrelated columns: p values are uniform, here over 200 draws (binomial, four standard errors)."""
    rec = record().centred()
    fit = long_arx(rec, 20, input_lags(rec, 20))
    rng = np.random.default_rng(3)
    p = np.array([fit.f_test(rng.standard_normal((len(fit.rows), 3)))[0] for _ in range(200)])
    assert abs((p < 0.1).mean() - 0.1) < 4 * np.sqrt(0.09 / 200)


def test_an_identification_is_as_accurate_beside_disturbances_and_names_them():
    extra = 0.2 * np.sin(2 * np.pi * 1.3 * T * np.arange(750)) + 0.5 * np.linspace(-0.5, 0.5, 750)
    extra[[90, 250, 500]] += 2.0
    found = identify(record(CLM, extra=extra))
    f = np.geomspace(*found.model.band, 40)
    assert np.abs(np.abs(found.model.response(f) / CLM.response(f)) - 1).max() < 0.05
    assert found.verdict.level == 1
    assert [item.kind for item in found.disturbances.found] == ["spikes", "drift", "line"]
    assert sum("output y" in reason for reason in found.verdict.reasons) == 3
    assert "Spikes, jumps, held readings, missing samples, drift, lines and nonlinearity" in found.verdict.checked


@pytest.mark.parametrize("size", [1.0, -5.0])
def test_a_jump_of_the_output_is_named(size):
    """An offset that changes within the record gives a wrong model that simulates it with a fit of 88 %."""
    extra = np.where(np.arange(750) >= 111, size, 0.0)
    found = identify(record(CLM, extra=extra))
    assert ("jump", "sample 112") in [(item.kind, item.place) for item in found.disturbances.found]
    assert found.verdict.level >= 1
    assert any("jumps by up to" in reason and "Record again" in reason for reason in found.verdict.reasons)


@pytest.mark.parametrize(("first", "missing"), [(90, 1), (389, 3), (600, 20)])
def test_missing_samples_of_a_smooth_input_are_named(first, missing):
    """Times that go on hide them; the chirp does not."""
    whole, kept = record(CLM), np.r_[0:first, first + missing : 750]
    (item,) = disturbances(Record(u=whole.u[kept], y=whole.y[kept], sample_time=T)).found[-1:]
    assert (item.kind, item.size, item.place) == ("missing samples", missing, f"sample {first + 1}")


def test_one_missing_sample_is_found_anywhere_in_a_chirp():
    """At an extreme of the input the sample that follows the place deviates least."""
    u = np.round(5 + chirp(), 6)
    for first in range(40, 700):
        assert skips(np.delete(u, first), (slice(0, 749),)) == [(first, 1)], first


@pytest.mark.parametrize(
    "u",
    [
        np.r_[np.zeros(300), np.ones(450)],
        np.repeat(np.random.default_rng(1).choice([-1.0, 1.0], 75), 10),
        np.abs(np.arange(750) % 200 - 100.0),
        np.repeat(np.arange(5.0), 150),
        np.r_[chirp(), chirp()],
        np.random.default_rng(1).standard_normal(750),
    ],
    ids=["step", "binary", "triangle", "stairs", "two sweeps", "noise"],
)
def test_edges_of_an_input_are_no_missing_samples(u):
    assert skips(u, (slice(0, len(u)),)) == []


@pytest.mark.parametrize("length", [4, 10])
def test_a_held_output_is_named(length):
    """A sensor that repeats its reading while the input changes; readings with noise do not repeat."""
    whole = record(CLM)
    y = np.r_[whole.y[:300], np.full(length, whole.y[300]), whole.y[300 + length :]]
    (item,) = disturbances(Record(u=whole.u, y=y, sample_time=T)).found[-1:]
    assert (item.kind, item.size, item.place, item.level) == ("held output", length, "sample 301", 1)


@pytest.mark.parametrize("step", [0.1, 0.5, "sampled slowly"])
def test_repeated_readings_of_a_coarse_or_slow_sensor_are_not_held(step):
    whole = record(CLM)
    slow = step == "sampled slowly"
    y = np.repeat(whole.y[::5], 5) if slow else np.round(whole.y / (step * np.std(whole.y))) * step * np.std(whole.y)
    found = disturbances(Record(u=whole.u, y=y, sample_time=T)).found
    assert "held output" not in [item.kind for item in found]


@pytest.mark.parametrize("every", [2, 5, 10])
def test_a_sensor_that_is_slower_than_the_record_has_no_spikes(every):
    whole = record(CLM)
    found = disturbances(Record(u=whole.u, y=np.repeat(whole.y[::every], every)[:750], sample_time=T))
    (item,) = found.found
    assert (item.kind, item.size, found.replaced.size) == ("slow sensor", every, 0)
    assert f"a new reading every {every} samples only" in item.sentence
    assert f"--resample {50 / every:.4g})" in item.sentence
    assert found.remark == "y repeats its readings"


def test_a_sensor_with_a_clock_of_its_own_is_slow_and_other_outputs_are_not():
    at = np.floor(np.arange(750) / 7.3).astype(int)
    assert repeats(Record(u=np.arange(750.0), y=np.random.default_rng(1).standard_normal(750)[at], sample_time=T)) == 7
    ramp = np.floor(np.arange(750) / 7.0)  # a coarse sensor of a ramp
    for y in (record(CLM).y, ramp, np.round(record(CLM).y, 1)):
        assert repeats(Record(u=np.arange(750.0), y=y, sample_time=T)) == 1


def test_a_slow_plant_is_not_taken_for_a_drift():
    """Its response to the first half wave of the chirp resembles a polynomial; a form without drift explains it."""
    slow = ContinuousModel(num=[1.0], den=np.poly([-1.0] * 5)).sampled(T)
    found = identify(record(slow, noise=0.01))
    f = np.geomspace(*found.model.band, 40)
    assert found.disturbances.drift == 0
    assert np.abs(np.abs(found.model.response(f) / slow.response(f)) - 1).max() < 0.1


NONLINEAR = {
    "backlash": lambda u: backlash(u, 0.5),
    "dead zone": lambda u: u - np.clip(u, -0.75, 0.75),
    "saturation": lambda u: np.minimum(u, 1.75),
}


@pytest.mark.parametrize("kind", NONLINEAR)
def test_orders_are_those_of_the_linear_part_behind_a_nonlinearity(kind):
    """With little noise the criterion alone selects orders that describe the nonlinearity: errors of .24 to .45."""
    rec = record(LAG, noise=0.01, acting=NONLINEAR[kind])
    found = identify(rec)
    x = LAG.simulate(NONLINEAR[kind](chirp()))
    linear = output_error(Record(u=chirp(), y=x, sample_time=T).centred(), 1, 1, 3, initial="offset")
    f = np.geomspace(*found.model.band, 40)
    assert np.abs(np.abs(found.model.response(f) / linear.response(f)) - 1).max() < 0.1
    share, behind = found.model.alternatives[0]
    assert (found.search.without, share) == (kind, 0.5)
    assert np.abs(np.abs(behind.response(f) / LAG.response(f)) - 1).max() < 0.02
    assert kind in found.argument
    totals = [one.total for one in found.search.candidates[1:]]
    assert totals == sorted(totals)
    section = DynamicsSection.model_validate(dynamics_section(found))
    part = f"linear part without the {kind}"
    assert section.alternatives[0].structure == part
    (sentence,) = (text for text in dynamics_part(section).sentences if part in text)
    assert sentence.startswith("Gain and delay depend on the amplitude")
    _, ranking = structure_chart(found)
    assert min(bar.get_width() for bar in ranking.patches) >= 0.0  # above the smallest, also where another is chosen


def test_a_nonlinearity_that_is_named_falsely_leaves_the_structure_as_it_is(monkeypatch):
    """A false backlash of half the range: its removal from the input spoils the record, which the criterion sees."""
    rec = record(LAG, noise=0.01)
    plain = identify(rec)
    false = Nonlinearity("backlash", 0.0, 2.5, 1e-9, 1.0, -1.0, lambda rec, u: u - backlash(u, 2.5))
    monkeypatch.setattr(record_disturbances, "nonlinearity", lambda *args: false)
    found = identify(rec)
    assert [item.kind for item in found.disturbances.found] == ["backlash"]  # the reservation is kept
    assert found.search.without == ""
    np.testing.assert_array_equal(found.model.theta, plain.model.theta)


def test_a_nonlinearity_that_leaves_no_input_leaves_the_structure_as_it_is(monkeypatch):
    rec = record(LAG, noise=0.01)
    plain = identify(rec)
    false = Nonlinearity("dead zone", -9.0, 9.0, 1e-9, 1.0, -1.0, lambda rec, u: u)
    monkeypatch.setattr(record_disturbances, "nonlinearity", lambda *args: false)
    np.testing.assert_array_equal(identify(rec).model.theta, plain.model.theta)


def test_given_orders_are_kept_where_the_input_has_a_nonlinearity():
    found = identify(record(LAG, acting=NONLINEAR["dead zone"]), orders=(2, 2, 3))
    assert (found.model.na, found.model.nb, found.model.nk, found.search.without) == (2, 2, 3, "")


def test_gains_inherit_the_reservation():
    found = identify(record(acting=lambda u: u - np.clip(u, -0.5, 0.5)))
    tuned = tune_pi(found, rise_time=2.0, settling_time=6.0)
    assert tuned.verdict.level >= 1
    assert any(reason.startswith("Model: Dead zone") for reason in tuned.verdict.reasons)
