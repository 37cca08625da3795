"""The measured frequency response: error bars that hold, the excited band, closed loops found, averages as scipy's."""

import numpy as np
import pytest
from fitmodels.core.errors import IdentError
from fitmodels.datasets import Record, join_records
from fitmodels.ident.excitation.signals import chirp, multisine, prbs
from fitmodels.ident.model import Model
from fitmodels.ident.responses.frequency import frequency_response
from fitmodels.ident.responses.spectra import excited_band
from scipy.signal import csd, lfilter, welch

pytestmark = pytest.mark.slow

PLANT = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)
F = np.array([0.1, 0.5, 1.0, 1.5, 2.0])


def recorded(u, snr, seed, model=PLANT, colour=0.0):
    x = model.simulate(u)
    e = lfilter([np.sqrt(1 - colour**2)], [1, -colour], np.random.default_rng(seed).standard_normal(len(x)))
    return Record(u=u, y=x + np.std(x) * 10 ** (-snr / 20) * e, sample_time=model.sample_time)


@pytest.mark.parametrize(
    ("excitation", "snr", "colour"),
    [(chirp(), 30, 0.0), (prbs(2.5, hold=0.2), 20, 0.0), (chirp(), 30, 0.8)],
    ids=["one chirp", "one prbs", "one chirp, coloured noise"],
)
def test_error_bars_hold_their_level_in_a_single_record(excitation, snr, colour):
    g, inside = PLANT.response(F), []
    for seed in range(20):
        found = frequency_response(recorded(excitation, snr, seed, colour=colour), F)
        turn = np.abs(np.degrees(np.angle(found.response / g)))
        inside.append(
            [(found.gain_low <= np.abs(g)) & (np.abs(g) <= found.gain_high), turn <= found.phase_high - found.phase]
        )
    # 20 draws of 10 correlated figures at 95 %: three standard errors are about 9 %
    assert 0.86 < np.mean(inside) <= 1.0


def test_without_noise_the_response_is_the_plants():
    found = frequency_response(recorded(chirp(), 200, 1), F[:4])
    assert found.response == pytest.approx(PLANT.response(F[:4]), rel=1e-3)


def test_the_band_of_the_published_chirp_is_marked():
    low, high = excited_band(recorded(chirp(), 40, 1))
    assert 0.05 < low < 0.15
    assert 1.9 < high < 2.3
    found = frequency_response(recorded(chirp(), 40, 1))
    assert found.band == (low, high)
    assert np.array_equal(found.outside, (found.frequency < low * 0.999) | (found.frequency > high * 1.001))
    assert np.nanmedian(found.gain_error[found.outside]) > 20 * np.median(found.gain_error[~found.outside])


@pytest.mark.parametrize(("lines", "low", "high"), [([0.4, 0.6, 3.0], 0.4, 3.0), ([1.0], 1.0, 1.0)])
def test_the_band_runs_from_the_first_line_to_the_last(lines, low, high):
    u = multisine(1.0, lines, 20, 50)
    found = excited_band(Record(u=u, y=u, sample_time=0.02))
    assert found == (pytest.approx(low, abs=0.11), pytest.approx(high, abs=0.11))  # two bins of smoothing


def test_two_runs_joined_have_smaller_errors_than_one():
    one, other = recorded(chirp(), 30, 1), recorded(chirp(), 30, 2)
    single, both = frequency_response(one, F), frequency_response(join_records([one, other]), F)
    assert np.median(both.gain_error / single.gain_error) == pytest.approx(1 / np.sqrt(2), rel=0.2)


def test_a_record_sampled_needlessly_fast_gives_the_same_response():
    fast = Model(b=[0, 0.002], a=[1, -0.998], nk=1, sample_time=0.001)
    found = frequency_response(recorded(chirp(rate=1000), 30, 3, fast), F)
    assert np.abs(found.gain / np.abs(fast.response(F)) - 1).max() < 0.05
    assert (found.gain_error < 0.03).all()


def test_coherence_is_the_share_that_is_not_noise():
    clean, loud = (frequency_response(recorded(chirp(), snr, 1), F[1:4]).coherence for snr in (40, 0))
    assert (clean > 0.999).all()
    assert (loud < clean).all()


def test_averages_are_those_of_scipy():
    u = np.random.default_rng(11).standard_normal(4096)
    rec = recorded(u, 10, 1)
    f, cross = csd(u - u.mean(), rec.y - rec.y.mean(), 50, nperseg=256)
    found = frequency_response(rec, f[1:], method="welch", resolution=2 * f[1])
    power = welch(u - u.mean(), 50, nperseg=256)[1]
    assert found.response == pytest.approx((cross / power)[1:], rel=1e-9)


def test_averaged_error_bars_hold_for_a_long_random_input():
    rng, inside = np.random.default_rng(11), []
    f = np.array([1.0, 3.0, 8.0, 15.0])
    for seed in range(60):
        found = frequency_response(recorded(rng.standard_normal(8192), 10, seed), f, method="welch", resolution=0.2)
        at = np.abs(PLANT.response(f))
        inside.append((found.gain_low <= at) & (at <= found.gain_high))
    assert 0.9 < np.mean(inside) < 0.99


RINGING = Model(b=[0, 0.1], a=np.real(np.poly(0.999 * np.exp([0.5j, -0.5j]))), nk=1, sample_time=0.02)
NOTCHED = Model(
    b=np.r_[0, 0.2 * np.real(np.poly(0.999 * np.exp([0.25j, -0.25j])))],
    a=np.real(np.poly([*(0.9 * np.exp([0.25j, -0.25j])), 0.3])), nk=1, sample_time=0.02,
)  # fmt: skip


def test_a_ringing_machine_is_distinguished_from_a_short_look():
    found = frequency_response(recorded(np.random.default_rng(11).standard_normal(600), 30, 1, RINGING))
    assert found.method == "local"
    assert "has not decayed" in found.notes[0]
    assert "record longer" in found.notes[1]
    short = frequency_response(recorded(np.random.default_rng(11).standard_normal(100), 30, 1, RINGING))
    assert short.method == "impulse"
    assert "has not decayed" in short.notes[0]


@pytest.mark.parametrize("u", [chirp(), prbs(2.5, hold=0.2)[:750]], ids=["chirp", "prbs"])
def test_an_integrating_plant_is_estimated_from_the_change_of_its_output(u):
    axis = Model(b=[0, 0.00193, 0.00187], a=np.convolve([1, -1], [1, -0.905]), nk=1, sample_time=0.02)
    g, inside = axis.response(F), []
    for seed in range(5):
        found = frequency_response(recorded(u, 30, seed, axis), F)
        assert "its change from sample to sample" in found.notes[0]
        assert np.abs(found.response / g - 1).max() < 0.15
        inside.append((found.gain_low <= np.abs(g)) & (np.abs(g) <= found.gain_high))
    assert np.mean(inside) > 0.85  # 5 draws of 5 correlated figures at 95 %


def test_the_method_follows_from_the_record():
    rng = np.random.default_rng(3)
    assert frequency_response(recorded(chirp(), 30, 1), F).method == "impulse"
    assert frequency_response(recorded(rng.standard_normal(20_000), 30, 1), F).method == "local"
    assert frequency_response(recorded(rng.standard_normal(2_000), 30, 1, RINGING), F).method == "local"


@pytest.mark.parametrize(
    ("model", "near"), [(NOTCHED, 0.25 / (2 * np.pi * 0.02)), (PLANT, 1.0)], ids=["notch", "plant"]
)
@pytest.mark.parametrize("excitation", ["random", "sweep"])
def test_error_bars_of_a_long_record_hold_at_a_narrow_notch(model, near, excitation):
    f = near * np.array([0.6, 0.9, 0.97, 0.99, 1.0, 1.01, 1.03, 1.1])
    g, inside = model.response(f), []
    for seed in range(12):
        u = chirp(f1=4.0, duration=240.0)
        if excitation == "random":
            u = np.random.default_rng(100 + seed).standard_normal(12_000)
        found = frequency_response(recorded(u, 30, seed, model), f)
        assert found.method == "local"
        turn = np.abs(np.degrees(np.angle(found.response / g)))
        inside.append(
            [(found.gain_low <= np.abs(g)) & (np.abs(g) <= found.gain_high), turn <= found.phase_high - found.phase]
        )
    assert np.mean(inside) > 0.9  # 12 draws of 16 correlated figures at 95 %


def test_the_resolution_follows_the_response():
    u = np.random.default_rng(5).standard_normal(20_000)
    smooth, sharp = (frequency_response(recorded(u, 30, 1, model), [3.9, 3.98, 4.06]) for model in (PLANT, RINGING))
    assert sharp.resolution < smooth.resolution / 3  # its peak at 3.98 Hz is 0.016 Hz wide
    assert f"{sharp.method} polynomial method" in sharp.notes[0]


def test_segments_of_any_length_share_one_response():
    u = np.random.default_rng(6).standard_normal(12_000)
    parts = [recorded(part, 30, k) for k, part in enumerate(np.split(u, [100, 3_000, 3_020, 7_000]))]
    found = frequency_response(join_records(parts), F, method="local")
    assert found.response == pytest.approx(PLANT.response(F), rel=0.02)
    assert (found.gain_error < 0.01).all()


def test_an_input_of_few_lines_has_no_local_estimate_between_them():
    u = multisine(1.0, [0.5, 2.0, 8.0], 60, 50)
    found = frequency_response(recorded(u, 30, 1), [0.5, 1.0], method="local")
    assert found.gain[0] == pytest.approx(abs(PLANT.response(F[1:2])[0]), rel=0.01)
    assert np.isinf(found.gain_error[1])
    assert frequency_response(recorded(u, 30, 1), [1.0]).method == "impulse"


REFUSED = {
    "above Nyquist": (lambda rec: frequency_response(rec, [30.0]), "25 Hz"),
    "level": (lambda rec: frequency_response(rec, level=95), "level 95"),
    "method": (lambda rec: frequency_response(rec, method="etfe"), "'etfe': auto, impulse, local or welch"),
    "unused": (lambda rec: frequency_response(rec, resolution=1.0), 'method="welch"'),
    "too few windows": (lambda rec: frequency_response(rec, method="welch", resolution=0.1), "windows"),
    "too short": (lambda rec: frequency_response(rec.part(0, 20)), "20 samples"),
    "still": (lambda rec: frequency_response(Record(u=np.ones(99), y=rec.y[:99], sample_time=0.02)), "does not vary"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_is_refused_in_words(what):
    ask, words = REFUSED[what]
    with pytest.raises(IdentError, match=words):
        ask(recorded(chirp(), 30, 1))
