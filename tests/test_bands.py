"""Bands of gain, phase, step and poles: derivatives against differences, responses against python-control."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from fitmodels.core.errors import IdentError
from fitmodels.datasets import Record
from fitmodels.ident.draws import components, drawn_models, mixture_quantile
from fitmodels.ident.excitation.predicted_precision import predicted_errors
from fitmodels.ident.excitation.signals import chirp
from fitmodels.ident.model import Model
from fitmodels.ident.responses.confidence_bands import response_band, response_slope, step_and_slope, step_band
from scipy.stats import norm

pytestmark = pytest.mark.slow

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


# --- uncertainty of the orders ------------------------------------------------------------------------

COV = np.diag([1e-4, 1e-4])
ONE = Model(b=[0.0, 0.1], a=[1.0, -0.9], nk=1, sample_time=0.02, cov_params=COV * 1e-2)
LATER = Model(b=[0.0, 0.0, 0.0, 0.12], a=[1.0, -0.88], nk=3, sample_time=0.02, cov_params=COV * 1e-2)
EITHER = replace(ONE, alternatives=((0.3, LATER),))


def test_draws_hold_each_structure_by_its_weight_in_random_order():
    models = drawn_models(EITHER, 1000, seed=1).models
    later = np.array([m.nk == 3 for m in models])
    assert later.sum() == 300
    assert 60 <= later[:300].sum() <= 120  # the first draws screen gains
    thetas = np.stack([m.theta for m in models if m.nk == 3])
    assert thetas.mean(axis=0) == pytest.approx(LATER.theta, abs=4e-3 / np.sqrt(300))
    assert np.cov(thetas.T).diagonal() == pytest.approx([1e-6, 1e-6], rel=0.3)


@pytest.mark.parametrize("share", [0.025, 0.2, 0.5, 0.9])
def test_quantiles_of_a_mixture_invert_its_distribution_function(share):
    rng = np.random.default_rng(4)
    weights, means, errors = np.array([0.5, 0.3, 0.2]), rng.standard_normal((3, 50)), rng.uniform(0.1, 2, (3, 50))
    found = mixture_quantile(share, weights, means, errors)
    assert weights @ norm.cdf(found, means, errors) == pytest.approx(share, abs=1e-9)


def test_bands_are_those_of_the_mixture():
    """Bands of two structures: by slopes as by draws, and those of one structure where the other weighs nothing."""
    f, time = np.array([0.3, 1.0, 3.0]), 1.0
    slopes, draws = (response_band(EITHER, f, method=m) for m in ("delta", "draws"))
    for name in ("gain_low", "gain_high"):
        assert getattr(slopes, name) == pytest.approx(getattr(draws, name), rel=0.02)
    for name in ("phase_low", "phase_high"):
        assert getattr(slopes, name) == pytest.approx(getattr(draws, name), abs=0.5)
    assert slopes.gain == pytest.approx(np.abs(ONE.response(f)))
    alone = response_band(ONE, f)
    assert (slopes.phase_low < alone.phase_low - 0.5).all()  # the longer delay
    nearly = response_band(replace(ONE, alternatives=((1e-9, LATER),)), f)
    assert nearly.gain_high == pytest.approx(alone.gain_high, rel=1e-6)
    a, b = (step_band(EITHER, time, method=m) for m in ("delta", "draws"))
    assert b.low == pytest.approx(a.low, abs=0.2 * a.error.max())
    assert a.low[2] < 0.01 < ONE.simulate(np.ones(3))[2]


def test_an_integrator_is_drawn_with_its_pole_at_1():
    """y = y + 0.1 u / (1 - .5 q^-1): the covariance is that of the gain and of the other pole alone."""
    slope = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])  # a = (1 - q^-1)(1 + p q^-1): a1 = p - 1, a2 = -p
    model = Model([0.0, 0.1], [1.0, -1.5, 0.5], 1, 0.02, cov_params=slope @ np.diag([1e-2, 1e-6]) @ slope.T)
    plants = drawn_models(model, 500, seed=2)
    assert plants.left_out == 0
    assert max(abs(m.a.sum()) for m in plants.models) < 1e-15
    assert np.std([m.a[2] for m in plants.models]) == pytest.approx(0.1, rel=0.1)
    band = step_band(model, 1.0)
    assert (band.low <= band.step).all()


def test_an_unstable_alternative_of_a_stable_model_is_left_out():
    (only,) = components(replace(ONE, alternatives=((0.3, replace(LATER, a=[1.0, -1.01])),)))
    assert (only[0], only[1].nk) == (1.0, 1)


def test_a_part_without_error_gives_no_warning():
    weights, means, errors = np.array([0.5, 0.5]), np.array([-1.0, 1e3]), np.array([0.0, 0.1])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert mixture_quantile(0.3, weights, means, errors) == pytest.approx(-1.0)
