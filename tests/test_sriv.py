"""Refined instrumental variables: the truth comes back, noise in the sensor does not bend it, covariance holds."""

from dataclasses import replace

import numpy as np
import pytest
from fitmodels.core.errors import IdentError
from fitmodels.datasets.records.record import Record, join_records
from fitmodels.ident.estimators.bias_checks import warn_of_bias
from fitmodels.ident.estimators.filters import is_stable, reflected, whitening
from fitmodels.ident.estimators.instrumental import sriv
from fitmodels.ident.estimators.least_squares import arx
from fitmodels.ident.model import Model
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

pytestmark = pytest.mark.slow

# Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 18 and 17
PUBLISHED = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)
FREQUENCIES = np.array([0.1, 0.5, 1.0, 2.0])
# condition number of the chirp's sensitivities, 4e4, times rounding of a simulation near its poles, 1e-14
EXACT = 1e-9


def chirp(n=750):
    t = np.arange(n) * 0.02
    return 2.5 * np.sin(2 * np.pi * (0.1 + (2.0 - 0.1) / (2 * 15) * t) * t)


def record(model=PUBLISHED, u=None, snr=None, seed=0, colour=(1.0,), **options):
    u = chirp() if u is None else u
    x = model.simulate(u)
    e = lfilter([1.0], colour, np.random.default_rng(seed).standard_normal(len(u)))
    noise = 0.0 if snr is None else np.std(x) * 10 ** (-snr / 20) * e / np.std(e)
    return Record(u=u, y=x + noise, sample_time=model.sample_time, **options)


def gain_error(model, truth=PUBLISHED):
    return np.abs(model.response(FREQUENCIES)) / np.abs(truth.response(FREQUENCIES)) - 1


@pytest.mark.parametrize("initial", ["auto", "zero", "estimate"])
def test_published_plant_comes_back_without_noise(initial):
    model = sriv(record(), 3, 3, initial=initial)
    np.testing.assert_allclose(model.theta, PUBLISHED.theta, atol=EXACT)
    assert "converged" in model.notes[0]
    assert "not converged" not in model.notes[0]
    assert (model.nk, model.structure, model.n) == (1, "sriv", 750)


def test_sensor_noise_bends_arx_and_not_the_instrumental_variable():
    """40 draws at 30 dB: standard error of a median gain is 0.02 % at 0.1 Hz, 0.05 % at 2 Hz."""
    errors = [
        [gain_error(arx(rec, 3, 3)), gain_error(sriv(rec, 3, 3))]
        for rec in (record(snr=30, seed=seed) for seed in range(40))
    ]
    bent, straight = np.median(errors, axis=0)
    assert np.abs(bent).max() > 0.25
    assert np.abs(straight).max() < 2e-3
    assert np.median(np.abs(errors), axis=0)[1].max() < 0.01


def test_no_estimate_is_unstable():
    """At 10 dB, and at 20 dB with one order too many."""
    for seed in range(15):
        assert sriv(record(snr=10, seed=seed), 3, 3).stable
        assert sriv(record(snr=20, seed=seed), 4, 3).stable


def test_runs_from_different_states_are_joined_without_crossing():
    """Two runs begin in the middle of a movement; a state carried over the join, or taken as rest, would be seen."""
    u = chirp(1500)
    whole = Record(u=u, y=PUBLISHED.simulate(u), sample_time=0.02)
    parts = join_records([whole.part(800, 1500), whole.part(300, 700)])
    model = sriv(parts, 3, 3)
    np.testing.assert_allclose(model.theta, PUBLISHED.theta, atol=EXACT)
    assert "initial state of each segment estimated" in model.notes
    assert np.abs(sriv(parts, 3, 3, initial="zero").theta - PUBLISHED.theta).max() > 1e-3


def test_a_record_from_rest_keeps_its_state_at_rest():
    notes = [sriv(record(snr=20, seed=seed), 3, 3).notes for seed in range(30)]
    assert not any("initial state of each segment estimated" in n for n in notes)


def test_several_records_are_taken_as_one_joined():
    rec = record(snr=30)
    np.testing.assert_array_equal(sriv([rec, rec], 3, 3).theta, sriv(join_records([rec, rec]), 3, 3).theta)


def test_a_record_joined_to_itself_fits_the_same_with_smaller_errors():
    rec = record(snr=20)
    once, twice = sriv(rec, 3, 3), sriv(join_records([rec, rec]), 3, 3)
    np.testing.assert_allclose(twice.theta, once.theta, rtol=1e-5)
    # variance of the mean of two, and n - p in place of n
    np.testing.assert_allclose(twice.bse / once.bse, np.sqrt(744 / 1494), rtol=1e-3)


@settings(derandomize=True, deadline=None, max_examples=12)
@given(st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_units_scale_the_gain(of_u, of_y):
    rec = record(snr=30)
    scaled = replace(rec, u=rec.u * of_u, y=rec.y * of_y, sha256=None)
    once, other = sriv(rec, 3, 3), sriv(scaled, 3, 3)
    np.testing.assert_allclose(other.a, once.a, atol=1e-6)
    np.testing.assert_allclose(other.dc_gain, once.dc_gain * of_y / of_u, rtol=1e-5)


@settings(derandomize=True, deadline=None, max_examples=5)
@given(st.integers(0, 12))
def test_a_time_shift_shifts_nk(shift):
    u = chirp()
    late = Record(u=u, y=np.r_[np.zeros(shift), PUBLISHED.simulate(u)[: 750 - shift]], sample_time=0.02)
    model = sriv(late, 3, 3, nk=1 + shift)
    np.testing.assert_allclose(model.theta, PUBLISHED.theta, atol=EXACT)
    assert np.all(model.b[: 1 + shift] == 0)


@pytest.mark.parametrize(
    ("colour", "limit"),
    [((1.0,), 0.15), ((1.0, -0.9), 0.25)],
    ids=["white noise", "noise of an autoregression"],
)
def test_standard_errors_are_those_of_a_monte_carlo(colour, limit):
    """200 draws tell a standard deviation to 5 % (one sigma): 15 % is three.

    With coloured noise its order and shape are estimated as well; sigma^2 (J'J)^-1 would be off by a factor of 2 to 4.
    """
    truth = Model(b=[0.0, 0.2, 0.1], a=[1.0, -1.5, 0.7], nk=1, sample_time=0.1)
    u = np.sign(lfilter([1.0], [1.0, -0.8], np.random.default_rng(9).standard_normal(600)))
    models = [sriv(record(truth, u, 20, seed, colour), 2, 2) for seed in range(200)]
    spread = np.std([m.theta for m in models], axis=0)
    reported = np.sqrt(np.mean([np.diag(m.cov_params) for m in models], axis=0))
    np.testing.assert_allclose(reported / spread, 1, atol=limit)


def test_first_order_variance_is_the_textbooks():
    """y = b u(t-1) / (1 + f q^-1) + e under white u of variance 1: the information matrix in closed form.

    With x' = q^-1 b / (1 + f q^-1)^2 u and u' = u / (1 + f q^-1): E x'^2 = b^2 (1 + f^2) / (1 - f^2)^3,
    E u'^2 = 1 / (1 - f^2), E x' u' = b f / (1 - f^2)^2, by residues (covariance: Ljung 1999, section 9.4).
    """
    f, b, n = -0.8, 0.5, 200_000
    truth = Model(b=[0.0, b], a=[1.0, f], nk=1, sample_time=1.0)
    u = np.sign(np.random.default_rng(4).standard_normal(n))
    model = sriv(record(truth, u, 10), 1, 1)
    s = 1 - f**2
    information = np.array([[b**2 * (1 + f**2) / s**3, b * f / s**2], [b * f / s**2, 1 / s]])
    expected = model.noise_variance * np.linalg.inv(information) / n
    np.testing.assert_allclose(model.cov_params, expected, rtol=0.02)


def test_whitening_finds_the_order_and_the_coefficients():
    e = lfilter([1.0], [1.0, -1.2, 0.5], np.random.default_rng(3).standard_normal(20_000))
    h, v = whitening(e, (slice(0, 12_000), slice(12_000, 20_000)))
    np.testing.assert_allclose(h, [1.0, -1.2, 0.5], atol=0.03)
    assert v == pytest.approx(1.0, rel=0.03)


@settings(derandomize=True, deadline=None, max_examples=100)
@given(st.lists(st.floats(-3, 3), min_size=1, max_size=6))
def test_stability_is_what_the_roots_say(coefficients):
    p = np.array([1.0, *coefficients])
    radius = np.abs(np.roots(p)).max(initial=0.0)
    if abs(radius - 1) > 1e-6:
        assert is_stable(p) == (radius < 1)
    assert is_stable(reflected(p))
    assert len(reflected(p)) == len(p)


def test_bias_is_reported_in_words():
    rec = record(snr=30, unit_u="V", unit_y="A")
    reported = warn_of_bias(arx(rec, 3, 3), sriv(rec, 3, 3), (0.1, 2.0))
    assert "ARX gives" in reported
    assert "A/V" in reported
    assert "Use the instrumental variables model" in reported


def test_nothing_is_reported_where_arx_is_right():
    """Equation noise: ARX is the efficient estimator, the other agrees with it within its errors."""
    warned = 0
    for seed in range(25):
        rec = record(snr=20, seed=seed, colour=PUBLISHED.a)
        warned += warn_of_bias(arx(rec, 3, 3), sriv(rec, 3, 3), (0.1, 2.0)) is not None
    assert warned <= 1


@pytest.mark.parametrize(
    ("rec", "orders", "words"),
    [
        (record(), (-1, 3, 1), "na -1: a whole number, 0 or more"),
        (record(), (3, 0, 1), "nb 0: a whole number, 1 or more"),
        (record(), (3, 2.5, 1), "nb 2.5"),
        (record(), (3, 3, -1), "nk -1"),
        (record().part(0, 18), (3, 3, 1), "18 samples"),
        (record(), (5, 5, 1), "not identifiable"),
        (Record(u=np.ones(100), y=np.arange(100.0), sample_time=0.1), (1, 1, 1), "does not vary"),
        (Record(u=chirp(), y=np.ones(750), sample_time=0.02), (1, 1, 1), "does not vary"),
    ],
    ids=["negative order", "no b", "half an order", "negative delay", "short", "order too high", "input", "output"],
)
def test_refusals_name_the_thing_and_the_cure(rec, orders, words):
    with pytest.raises(IdentError, match=words):
        sriv(rec, *orders)


def test_band_outside_the_samples_is_refused():
    with pytest.raises(IdentError, match="half the sample rate"):
        warn_of_bias(PUBLISHED, PUBLISHED, (0.1, 40.0))
