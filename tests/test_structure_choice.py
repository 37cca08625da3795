"""Choice among candidate structures: criterion, guard beyond the excited band, weights."""

import numpy as np
import pytest
from fitmodels.ident.structure.choice import LEAST, MOST, criterion, guard, weights
from scipy.signal import butter, cont2discrete

T, BAND = 0.02, (0.1, 2.0)


def mode(hz, damping):
    """A sampled mode with a static gain of 1."""
    w = 2 * np.pi * hz
    b, a, _ = cont2discrete(([w * w], [1.0, 2 * damping * w, w * w]), T)
    return np.ravel(b), a


def test_differences_of_the_criterion_are_those_of_a_library():
    from statsmodels.api import OLS  # BIC of linear regressions, an independent computation

    rng = np.random.default_rng(1)
    X = rng.standard_normal((200, 4))
    y = X @ [1.0, -0.5, 0.1, 0.0] + rng.standard_normal(200)
    ours, theirs = [], []
    for p in (1, 2, 3, 4):
        fit = OLS(y, X[:, :p]).fit()
        ours.append(criterion(200, fit.ssr / 200, p))
        theirs.append(fit.bic)
    np.testing.assert_allclose(np.diff(ours), np.diff(theirs), rtol=1e-9)


def test_a_coefficient_of_the_noise_model_counts_as_one_of_the_plant():
    assert criterion(100, 2.0, 2, 3) == criterion(100, 2.0, 5, 0)


def test_an_exact_fit_has_a_finite_criterion():
    assert np.isfinite(criterion(100, 0.0, 2))


@pytest.mark.parametrize(("cutoff", "n"), [(0.05, 1500), (0.1, 750), (0.5, 750), (5.0, 750)])
@pytest.mark.parametrize("order", [1, 2, 4])
def test_a_low_pass_plant_pays_nothing(order, cutoff, n):
    """A period of 20 s at .05 Hz is in a record of 30 s, not in one of 15 s."""
    b, a = butter(order, cutoff, fs=1 / T)
    assert guard(b, a, T, BAND, n) == 0.0


def test_a_resonance_in_the_band_pays_nothing_and_one_beyond_pays():
    assert guard(*mode(1.0, 0.1), T, BAND, 750) == 0.0
    assert guard(*mode(8.0, 0.01), T, BAND, 750) > np.log(750)


def test_a_resonance_narrower_than_the_resolution_of_the_record_pays_until_the_record_is_long_enough():
    narrow = mode(1.0, 0.005)  # 0.01 Hz wide at -3 dB
    assert guard(*narrow, T, BAND, 750) > guard(*mode(1.0, 0.02), T, BAND, 750) > 0.0  # 15 s resolve 0.067 Hz
    assert guard(*narrow, T, BAND, 6000) == 0.0


def test_a_pair_of_poles_slower_than_the_record_pays_for_both():
    slow = mode(0.03, 0.7)  # a natural period of 33 s
    assert guard(*slow, T, BAND, 750) == pytest.approx(2 * np.log(750))  # a record of 15 s
    assert guard(*slow, T, BAND, 3000) == 0.0


def test_an_unresolved_resonance_beyond_the_band_is_a_line_of_the_noise():
    assert guard(*mode(13.0, 0.0005), T, BAND, 750) > 50 * np.log(750)


@pytest.mark.parametrize("factor", [1e-6, -1.0, 1e6])
def test_the_guard_does_not_depend_on_units(factor):
    b, a = np.array([0.0, 0.1, 0.2]), np.array([1.0, 0.5, 0.9])
    assert guard(factor * b, a, T, BAND, 750) == pytest.approx(guard(b, a, T, BAND, 750))


def test_a_record_excited_up_to_half_the_sample_rate_needs_no_guard():
    assert guard(np.array([0.0, 1.0]), np.array([1.0, 0.99]), T, (0.1, 20.0), 750) == 0.0


def test_weights_sum_to_one_fall_with_the_criterion_and_ignore_its_level():
    bic = np.array([12.0, 3.0, 5.0, 40.0, 3.5])
    w = weights(bic)
    assert w.sum() == pytest.approx(1.0)
    assert (np.diff(w[np.argsort(bic)]) <= 0).all()
    np.testing.assert_allclose(weights(bic + 1e4), w)


def test_a_candidate_without_delay_has_no_weight_beside_a_better_one_with_delay():
    bic = [0.0, 1.0, 2.0]
    assert weights(bic, [False, True, False])[1] == 0.0
    np.testing.assert_allclose(weights(bic, [True, True, False]), weights(bic))


@pytest.mark.parametrize("pole", [1.0, 0.9995])
def test_a_pole_slower_than_the_record_counts_as_one_more_coefficient(pole):
    b = np.array([0.0, 0.1])
    assert guard(b, np.array([1.0, -pole]), T, BAND, 750) == pytest.approx(np.log(750))
    assert guard(b, np.array([1.0, -0.99]), T, BAND, 750) == 0.0


def test_little_weights_are_dropped_and_few_candidates_kept():
    assert np.count_nonzero(weights(np.zeros(50))) == MOST
    w = weights(np.linspace(0.0, 100.0, 50))
    assert w[w > 0].min() >= LEAST
