"""Box-Jenkins with autoregressive noise: against scipy's optimiser, and known truths in open and in closed loop."""

import numpy as np
import pytest
from fitmodels.core.errors import IdentError
from fitmodels.datasets.records.record import Record, join_records
from fitmodels.ident import Model, box_jenkins, output_error
from fitmodels.ident.estimators.filters import burg
from scipy.optimize import least_squares
from scipy.signal import lfilter

pytestmark = pytest.mark.slow

# Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 18 and 17
PUBLISHED = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)
SECOND = Model(b=[0.0, 0.0, 0.6, -0.2], a=[1.0, -0.5], nk=2, sample_time=0.02)
D = np.array([1.0, -0.8])


def chirp(n=750):
    t = np.arange(n) * 0.02
    return 2.5 * np.sin(2 * np.pi * (0.1 + (2.0 - 0.1) / (2 * n * 0.02) * t) * t)


def record(model=PUBLISHED, level=0.03, d=D, seed=0, u=None):
    u = chirp() if u is None else u
    x = model.simulate(u)
    e = np.random.default_rng(seed).standard_normal(len(u) + 200)
    v = lfilter([1.0], d, e)[200:]
    return Record(u=u, y=x + level * np.std(x) * v / np.std(v), sample_time=0.02)


def test_published_plant_comes_back_without_noise():
    model = box_jenkins(record(level=0.0), 3, 3, 0)
    np.testing.assert_allclose(model.theta, PUBLISHED.theta, atol=1e-8)


def test_order_zero_of_the_noise_is_output_error_with_an_offset():
    rec = record(d=[1.0]).centred()
    np.testing.assert_allclose(
        box_jenkins(rec, 3, 3, 0).theta, output_error(rec, 3, 3, initial="offset").theta, rtol=1e-5
    )


@pytest.mark.parametrize("seed", range(3))
def test_no_other_optimiser_finds_a_lower_loss(seed):
    """scipy's least_squares on the same errors from rest, with a Jacobian by differences, started from the truth."""
    rec = record(SECOND, seed=seed)

    def error(theta):
        x = lfilter(np.r_[0.0, 0.0, theta[1:3]], np.r_[1.0, theta[:1]], rec.u)
        return lfilter([1.0, theta[3]], [1.0], rec.y - x)[1:]

    other = least_squares(error, np.r_[SECOND.theta, D[1:]], "3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    ours = box_jenkins(rec, 2, 1, 1, 2, initial="zero")
    theta = np.r_[ours.theta, ours.d[1:]]
    assert np.sum(error(theta) ** 2) <= 2 * other.cost * (1 + 1e-9)
    np.testing.assert_array_less(np.abs(ours.theta - other.x[:3]) / ours.bse, 1e-3)
    classical = ours.noise_variance * np.linalg.inv(other.jac.T @ other.jac)[:3, :3]
    np.testing.assert_allclose(ours.bse, np.sqrt(np.diag(classical)), rtol=2e-3)


def test_standard_errors_are_those_of_repeated_records():
    """60 draws: mean of z is within 3 / sqrt(60) of 0, its standard deviation within 3 / sqrt(120) of 1."""
    found = [box_jenkins(record(SECOND, seed=seed), 2, 1, 1, 2) for seed in range(60)]
    z = np.array([(model.theta - SECOND.theta) / model.bse for model in found])
    assert np.abs(z.mean(axis=0)).max() < 3 / np.sqrt(60)
    assert np.abs(z.std(axis=0) - 1).max() < 3 / np.sqrt(120)
    assert np.median([model.d[1] for model in found]) == pytest.approx(-0.8, abs=0.02)


def test_the_loop_that_biases_output_error_does_not_bias_it():
    """u = r - 0.5 y with equation noise: consistent with the noise model, biased without it (Ljung 1999, 13.4)."""
    errors = []
    for seed in range(5):
        r, e = np.random.default_rng(seed).standard_normal((2, 3000))
        y, u = np.zeros(3000), np.zeros(3000)
        for t in range(1, 3000):
            y[t] = 0.9 * y[t - 1] + 0.5 * u[t - 1] + 2 * e[t]
            u[t] = 0.5 * r[t] - 0.5 * y[t]
        rec = Record(u=u, y=y, sample_time=0.02).centred()
        errors.append([f(rec).theta - (-0.9, 0.5) for f in (lambda r: box_jenkins(r, 1, 1, 1), with_output_error)])
    with_noise, without = np.abs(np.median(errors, axis=0))
    assert with_noise.max() < 0.05
    assert without.max() > 0.2


def with_output_error(rec):
    return output_error(rec, 1, 1)


def test_segments_have_their_own_state_and_offset():
    parts = []
    for seed, level in ((1, 4.0), (2, -3.0)):
        rec = record(SECOND, seed=seed)
        parts.append(Record(u=rec.u[50:], y=rec.y[50:] + level, sample_time=0.02))
    model = box_jenkins(join_records(parts), 2, 1, 1, 2)
    assert np.abs((model.theta - SECOND.theta) / model.bse).max() < 4


def test_a_delay_of_thirty_samples_costs_no_initial_states():
    late = Model(b=np.r_[np.zeros(30), 0.05], a=[1.0, -0.95], nk=30, sample_time=0.02)
    model = box_jenkins(record(late), 1, 1, 1, 30)
    assert np.abs((model.theta - late.theta) / model.bse).max() < 4


def test_burg_recovers_an_autoregression_over_segments():
    e = np.random.default_rng(1).standard_normal(4000)
    v = lfilter([1.0], [1.0, -1.6, 0.8], e)
    d, variance = burg([v[:1500], v[1700:]])
    assert len(d) == 3
    np.testing.assert_allclose(d, [1.0, -1.6, 0.8], atol=0.05)
    assert variance == pytest.approx(1.0, rel=0.08)


def test_orders_that_are_not_identifiable_are_refused():
    with pytest.raises(IdentError, match="not identifiable"):
        box_jenkins(record(SECOND, level=0.0), 5, 5, 0)
