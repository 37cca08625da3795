"""Bands of gain, phase, step and poles: derivatives against differences, responses against python-control."""

from dataclasses import replace

import numpy as np
import pytest
from fitmodels.core.errors import IdentError
from fitmodels.datasets import Record
from fitmodels.ident.excitation.predicted_precision import predicted_errors
from fitmodels.ident.excitation.signals import chirp
from fitmodels.ident.model import Model
from fitmodels.ident.responses.confidence_bands import response_band, response_slope, step_and_slope, step_band

pytestmark = pytest.mark.slow  # left out where other versions of Python are tried

PLANT = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)
F = np.array([0.1, 0.5, 1.0, 2.0, 20.0])
CERTAIN = predicted_errors(PLANT, chirp(), 0.005).model


def moved(model, k, by):
    theta = model.theta.copy()
    theta[k] += by
    a, b = np.r_[1.0, theta[: model.na]], np.r_[np.zeros(model.nk), theta[model.na :]]
    return replace(model, a=a, b=b)


@pytest.mark.parametrize("k", range(6), ids=PLANT.names)
def test_derivatives_are_differences(k):
    up, down = moved(PLANT, k, 1e-6), moved(PLANT, k, -1e-6)
    by_response = np.log(up.response(F) / down.response(F)) / 2e-6
    assert response_slope(PLANT, F)[:, k] == pytest.approx(by_response, rel=1e-5)
    by_step = (up.simulate(np.ones(100)) - down.simulate(np.ones(100))) / 2e-6
    assert step_and_slope(PLANT, 100)[1][:, k] == pytest.approx(by_step, rel=1e-4, abs=1e-6)


def test_response_and_step_are_those_of_python_control():
    control = pytest.importorskip("control", reason="python-control is the reference")
    plant = control.TransferFunction(*PLANT.transfer_function)
    gain, phase, _ = control.frequency_response(plant, 2 * np.pi * F)
    found = response_band(CERTAIN, F)
    assert found.gain == pytest.approx(gain, rel=1e-9)
    assert np.exp(1j * np.radians(found.phase)) == pytest.approx(np.exp(1j * phase), rel=1e-9)
    time, step = control.step_response(plant, T=np.arange(100) * 0.02)
    band = step_band(CERTAIN, 99 * 0.02)
    assert band.time == pytest.approx(time)
    assert band.step == pytest.approx(np.squeeze(step), abs=1e-10)


def test_draws_agree_with_derivatives_while_errors_are_small():
    f = F[:4]
    by_slope, by_draws = (response_band(CERTAIN, f, method=m) for m in ("delta", "draws"))
    assert (by_slope.method, response_band(CERTAIN, f).method) == ("delta", "delta")
    assert by_draws.gain_low == pytest.approx(by_slope.gain_low, rel=0.01)
    assert by_draws.phase_high == pytest.approx(by_slope.phase_high, abs=0.3)
    a, b = (step_band(CERTAIN, 2.0, method=m) for m in ("delta", "draws"))
    assert b.high == pytest.approx(a.high, abs=0.1 * a.error.max() * 2)


def test_a_large_error_is_drawn_and_a_gain_stays_above_zero():
    vague = replace(CERTAIN, cov_params=CERTAIN.cov_params * 400)
    found = response_band(vague, F)
    assert found.method == "draws"
    assert (found.gain_low > 0).all()


def test_the_unexcited_band_is_said():
    found = response_band(replace(CERTAIN, band=(0.1, 2.0)), F)
    assert found.outside.tolist() == [False] * 4 + [True]
    assert "outside 0.1 to 2 Hz" in found.concern
    assert response_band(CERTAIN, F).concern is None


def test_scaled_units_scale_the_band_of_the_gain():
    scale = np.diag([1.0] * 3 + [1000.0] * 3)
    scaled = replace(CERTAIN, b=CERTAIN.b * 1000, cov_params=scale @ CERTAIN.cov_params @ scale)
    one, other = response_band(CERTAIN, F[:4]), response_band(scaled, F[:4])
    assert other.gain_high == pytest.approx(1000 * one.gain_high, rel=1e-6)
    assert other.phase_high == pytest.approx(one.phase_high, rel=1e-6)


REFUSED = {
    "no covariance": (lambda: response_band(PLANT, F), "no covariance"),
    "level": (lambda: step_band(CERTAIN, 1.0, 95), "level 95"),
    "frequency": (lambda: response_band(CERTAIN, [0.0]), "25 Hz"),
    "duration": (lambda: step_band(CERTAIN, 0.001), "one sample"),
    "unstable": (lambda: step_band(Model(b=[1], a=[1, -1.5], nk=0, sample_time=1.0, cov_params=np.eye(2)), 9), "1.5"),
    "unstable draws": (lambda: step_band(replace(CERTAIN, cov_params=CERTAIN.cov_params * 1e6), 9.0), "no band"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_has_no_band_is_refused_in_words(what):
    ask, words = REFUSED[what]
    with pytest.raises(IdentError, match=words):
        ask()


def test_bands_hold_their_level():
    from fitmodels.ident.estimators.prediction_error import output_error

    u, rng = chirp(), np.random.default_rng(3)
    x, g, inside = PLANT.simulate(u), np.abs(PLANT.response(F[:4])), []
    step = PLANT.simulate(np.ones(101))[[10, 25, 50, 100]]
    for _ in range(150):
        y = x + 0.0316 * np.std(x) * rng.standard_normal(750)
        model = output_error(Record(u=u, y=y, sample_time=0.02), 3, 3)
        band, by_step = response_band(model, F[:4]), step_band(model, 2.0)
        low, high = by_step.low[[10, 25, 50, 100]], by_step.high[[10, 25, 50, 100]]
        inside.append([(band.gain_low <= g) & (g <= band.gain_high), (low <= step) & (step <= high)])
    # 150 draws: three standard errors are 5 %; benchmarks/bands.py does 2000
    assert np.abs(np.mean(inside, axis=0) - 0.95).max() < 0.055
