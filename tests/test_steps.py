"""Step responses: known truths, scipy's step, bands that hold, a servo with a rate limit, and refusals in words."""

import matplotlib as mpl
import numpy as np
import pytest
from fitmodels.core.errors import IdentError
from fitmodels.datasets import Record, join_records
from fitmodels.ident.continuous import sampled
from fitmodels.ident.physical_models.step_response import step_response_fit
from fitmodels.ident.physical_models.step_shapes import unit_response
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter, step

mpl.use("agg")
EXACT = 1e-6  # of a noise-free coefficient: the search ends where no step lowers the loss, squares of 1e-13


def wave(n=400, dt=0.01, num=(2.0,), den=(0.13, 1.0), delay=0.034, rest=1.0, noise=0.0, seed=0):
    """A square wave of 1 s from 0.2 s on, through a plant, with a rest level and noise of an autoregression."""
    t = np.arange(n) * dt
    u = ((t >= 0.2) & ((t - 0.2) % 1 < 0.5)) * 1.0
    e = lfilter([0.6], [1, -0.8], np.random.default_rng(seed).standard_normal(n))
    return Record(u=u, y=rest + sampled(num, den, dt, delay).simulate(u) + noise * e, sample_time=dt, unit_y="mm")


@pytest.mark.parametrize("zeta", [0.1, 0.7, 0.99999, 1.0, 1.00001, 1.0005, 1.002, 3.0, 500.0])
def test_second_order_is_scipys(zeta):
    t = np.linspace(0, 4, 200)
    wn = 5.0 if zeta < 100 else 500.0
    np.testing.assert_allclose(
        unit_response(2, t, [wn, zeta]), step(([wn**2], [1, 2 * zeta * wn, wn**2]), T=t)[1], atol=1e-7
    )


@pytest.mark.parametrize(
    ("order", "shape"),
    [(1, [0.13]), (2, [10.0, 0.2]), (2, [10.0, 0.7]), (2, [10.0, 1.0]), (2, [10.0, 2.5])],
    ids=["first order", "swinging", "damped", "critical", "overdamped"],
)
@pytest.mark.parametrize("height", [2.0, -3.0], ids=["up", "down"])
@pytest.mark.parametrize("delay", [0.0, 0.1534], ids=["no delay", "delay of part of a sample"])
def test_truth_comes_back(order, shape, height, delay):
    t = np.arange(-0.1, 2, 0.01)
    y = 3 + height * 1.7 * unit_response(order, t - delay, shape)
    fit = step_response_fit((t, y), order, step=height)
    assert fit.gain == pytest.approx(1.7, rel=EXACT)
    assert fit.delay == pytest.approx(delay, abs=1e-5)
    np.testing.assert_allclose(fit.shape, shape, rtol=1e-4)  # flat around zeta = 1
    assert fit.fit > 99.99
    assert ("No significant delay" in fit.words) == (delay == 0)


def test_time_to_63_of_a_servo():
    """A servo of ts 0.13 s, the time to 0.632 of a step (published for a lathe's x drive): read off the curve."""
    rec = wave(delay=0.0)
    fit = step_response_fit(rec, 1)
    rise = rec.y[20:70] - 1
    read = np.interp((1 - np.exp(-1)) * 2.0, rise, np.arange(50) * 0.01)
    assert fit.time_to_63 == pytest.approx(0.13, rel=1e-6)
    assert read == pytest.approx(0.13, abs=1e-3)
    assert fit.time_constants == fit.shape
    for zeta in (0.3, 1.0, 4.0):
        second = step_response_fit((np.arange(0, 5, 0.01), unit_response(2, np.arange(0, 5, 0.01), [6.0, zeta])), 2)
        at = np.array([second.time_to_63 - second.delay])
        assert unit_response(2, at, second.shape)[0] == pytest.approx(1 - np.exp(-1), abs=1e-9)


@settings(max_examples=10, deadline=None)
@given(st.floats(0.01, 100.0), st.floats(0.01, 100.0), st.floats(-50.0, 50.0))
def test_units_scale_the_gain_and_the_time_alone(size, pace, rest):
    rec = wave(noise=0.02)
    other = Record(u=rec.u, y=size * rec.y + rest, sample_time=pace * rec.sample_time)
    one, two = step_response_fit(rec), step_response_fit(other)
    scale = np.array([size, pace, pace])
    np.testing.assert_allclose(two.params, one.params * scale, rtol=1e-4)
    np.testing.assert_allclose(two.bse, one.bse * scale, rtol=1e-3)


def test_twice_the_record_is_the_same_with_smaller_errors():
    rec = wave(noise=0.05)
    one, two = step_response_fit(rec), step_response_fit(join_records([rec, rec]))
    np.testing.assert_allclose(two.params, one.params, rtol=1e-4)
    np.testing.assert_allclose(two.bse * np.sqrt(2), one.bse, rtol=0.05)


def test_the_model_runs_as_the_fit():
    rec = wave(num=[60.0], den=[1.0, 6.0, 60.0], delay=0.027)
    fit = step_response_fit(rec, 2)
    model = fit.model(rec.sample_time)
    np.testing.assert_allclose(model.simulate(rec.u) + 1, rec.y, atol=1e-5)
    np.testing.assert_allclose(fit.fitted[0], rec.y, atol=1e-5)
    assert model.dc_gain == pytest.approx(fit.gain)
    assert model.unit_y == "mm"


def test_two_time_constants():
    fit = step_response_fit(wave(num=[1.0], den=np.polymul([0.2, 1.0], [0.05, 1.0]), delay=0.0, n=800), 2)
    np.testing.assert_allclose(fit.time_constants, [0.2, 0.05], rtol=1e-3)
    assert "Overdamped: time constants 0.2 and 0.05 s" in fit.words
    swinging = step_response_fit(wave(num=[1.0], den=[0.01, 0.06, 1.0]), 2)
    assert swinging.time_constants == ()


def test_errors_hold_under_coloured_noise():
    """40 draws of 400 samples with neighbours correlated by 0.8: z has a spread of 1.0-1.3; white errors give 2.9."""
    fits = [step_response_fit(wave(noise=0.1, seed=seed)) for seed in range(40)]
    z = np.array([(f.params - [2.0, 0.13, 0.034]) / f.bse for f in fits])
    assert (np.abs(z) < 1.96).mean() > 0.85
    assert z.std() < 1.35
    assert sum(f.colour > 0 for f in fits) == 40
    assert "coloured (autoregression of order" in fits[0].words


def test_delay_may_be_given():
    fit = step_response_fit(wave(noise=0.02), delay=0.034)
    assert fit.names == ("gain", "time_constant")
    assert fit.delay == 0.034
    assert fit.shape[0] == pytest.approx(0.13, abs=4 * fit.bse["time_constant"])


def test_noisy_measured_input_is_still_a_step():
    rec = wave(noise=0.01)
    u = rec.u + 0.01 * np.random.default_rng(1).standard_normal(len(rec))
    fit = step_response_fit(Record(u=u, y=rec.y, sample_time=0.01))
    assert fit.gain == pytest.approx(2.0, rel=0.02)
    assert fit.shape[0] == pytest.approx(0.13, rel=0.05)


def test_wrong_order_is_reported():
    swinging = step_response_fit(wave(num=[1.0], den=[0.005, 0.02, 1.0], n=600), 1)
    assert "fit order 2" in swinging.words
    lag = step_response_fit(wave(delay=0.0, noise=0.05), 2)
    assert "fit order 1" in lag.words or "Overdamped" in lag.words
    short = wave(den=(3.0, 1.0))
    assert "has not settled within" in step_response_fit(short.part(0, 60)).words


@pytest.mark.parametrize("order", [1, 2])
def test_servo_square_wave_has_a_rate_limit(measurements, order):
    """Position demand to actual position; the drive's own speed signal is the reference for the slope of the ramps."""
    data = np.loadtxt(measurements / "servo_sweep" / "LinA__no-pp-square-wave-10mm-1Hz.txt")
    rec = Record(u=data[:, 2], y=data[:, 3], sample_time=0.01, output="position", unit_u="mm", unit_y="mm")
    fit = step_response_fit(rec, order)
    speed = np.abs(data[:, 4])
    assert fit.rate_limit == pytest.approx(np.median(speed[speed > 30]), rel=0.03)
    assert "rate-limited at 45.6" in fit.words
    assert fit.fit > (85 if order == 1 else 90)
    assert fit.plot().get_ylabel() == "position [mm]"


def test_a_lag_is_no_rate_limit():
    for noise in (0.0, 0.02, 0.2):
        assert step_response_fit(wave(noise=noise)).rate_limit is None
    t = np.arange(0, 3, 0.01)
    ramp = step_response_fit((t, np.clip(t - 0.2, 0, 1)), 2)
    assert ramp.rate_limit == pytest.approx(1.0, rel=1e-3)


CHIRP = np.sin(0.002 * np.arange(400.0) ** 2)
T = np.arange(100.0)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: step_response_fit(Record(u=np.ones(99), y=np.ones(99), sample_time=0.1)), "is 1 throughout: no step"),
        (lambda: step_response_fit(Record(u=CHIRP, y=CHIRP, sample_time=0.1)), "not made of steps"),
        (lambda: step_response_fit(Record(u=np.arange(99.0), y=np.arange(99.0), sample_time=0.1)), "varies between"),
        (lambda: step_response_fit(Record(u=T % 2, y=T % 3, sample_time=0.1)), "not made of steps"),
        (lambda: step_response_fit(Record(u=1.0 * (T > 20), y=np.ones(100), sample_time=0.1)), "is constant"),
        (lambda: step_response_fit(Record(u=1.0 * (T > 20), y=T % 2, sample_time=0.1)), "does not respond to the"),
        (lambda: step_response_fit((T, T), 3), "order 3: 1 or 2"),
        (lambda: step_response_fit((T, T), delay=-1.0), "delay -1.0 s"),
        (lambda: step_response_fit((T, T), step=0.0), "step 0.0"),
        (lambda: step_response_fit((T, T), at=500.0), "lies outside the record"),
        (lambda: step_response_fit((T[::-1], T)), "times that rise"),
        (lambda: step_response_fit((T, T[:50])), "one row of each"),
        (lambda: step_response_fit((T[:9], np.sqrt(T[:9])), 2), "9 samples for 4 coefficients"),
    ],
    ids=[
        "constant input", "chirp", "ramp", "a change each sample", "still output", "unrelated output", "order",
        "negative delay", "no height", "step outside", "times fall", "lengths differ", "too short",
    ],
)  # fmt: skip
def test_refusals(call, says):
    with pytest.raises(IdentError) as error:
        call()
    assert says in str(error.value)


# What an engineer sees in the figure


def pulse(num, den, noise=0.003, ends=(-np.inf, np.inf)):
    """A pulse of 3 s through a plant, sampled at 50 Hz and clipped."""
    t = np.arange(400) * 0.02
    u = ((t > 1) & (t < 4)) * 1.0
    y = sampled(num, den, 0.02, 0.04).simulate(u) + noise * np.random.default_rng(4).standard_normal(400)
    return Record(u=u, y=np.clip(y, *ends), sample_time=0.02, unit_y="mm")


@pytest.mark.parametrize(("den", "top"), [([1 / 144, 4.8 / 144, 1.0], 0.83), ([0.15, 1.0], 0.94)])
def test_a_response_that_is_clipped_must_not_be_used(den, top):
    whole, cut = pulse((1.0,), den), pulse((1.0,), den, ends=(-0.05, top))
    assert step_response_fit(whole, None).verdict.level == 0
    found = step_response_fit(cut, None).verdict
    assert found.level == 2
    assert f"The output runs into {top:g} mm and stays there" in found.reasons[0]


def test_a_quantised_response_that_settles_is_not_clipped():
    for den in ([0.15, 1.0], [1 / 144, 12 / 144, 1.0]):
        rec = pulse((1.0,), den, noise=0.0)
        found = step_response_fit(Record(u=rec.u, y=rec.y.round(2), sample_time=0.02), None)
        assert not any("stays there" in words for words in found.verdict.reasons)


def test_a_response_that_differs_between_up_and_down_is_doubted():
    rec = pulse((1.0,), [0.15, 1.0])
    y = np.zeros(400)
    for k in range(1, 400):
        y[k] = y[k - 1] + 0.02 / (0.1 if rec.u[k - 1] > 0 else 0.5) * (rec.u[k - 1] - y[k - 1])
    y += 0.003 * np.random.default_rng(1).standard_normal(400)
    reasons = step_response_fit(Record(u=rec.u, y=y, sample_time=0.02), None).verdict.reasons
    assert any("may differ between up and down" in words for words in reasons)


def test_an_integrating_response_has_no_time_constant():
    t = np.arange(400) * 0.02
    u = ((t > 1) & (t < 4)) * 1.0
    y = np.cumsum(u) * 0.02 + 0.003 * np.random.default_rng(2).standard_normal(400)
    with pytest.raises(IdentError, match="keeps moving while the input is held"):
        step_response_fit(Record(u=u, y=y, sample_time=0.02), None)
    slow = pulse((1.0,), [8.0, 1.0])
    assert step_response_fit(slow, 1).params["time_constant"] == pytest.approx(8.0, rel=0.1)
