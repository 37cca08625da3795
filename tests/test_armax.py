"""ARMAX: against statsmodels where the models coincide, least squares where c is 1, and known truths."""

from dataclasses import replace

import numpy as np
import pytest
from fitmodels.core.errors import IdentError
from fitmodels.datasets.records.record import Record, join_records
from fitmodels.ident.estimators.filters import is_stable
from fitmodels.ident.estimators.least_squares import arx
from fitmodels.ident.estimators.prediction_error import armax
from scipy.signal import lfilter
from statsmodels.tsa.statespace.sarimax import SARIMAX

pytestmark = pytest.mark.slow

A, B, C = [1.0, -1.5, 0.7], [0.0, 0.2, 0.1], [1.0, 0.6, 0.3]


def signals(n=1500, seed=0, a=A, b=B, c=C, noise=0.1):
    u = np.sign(lfilter([1.0], [1.0, -0.8], np.random.default_rng(99).standard_normal(n)))
    e = noise * np.random.default_rng(seed).standard_normal(n)
    return u, lfilter(b, a, u) + lfilter(c, a, e)


def record(**options):
    u, y = signals(**options)
    return Record(u=u, y=y, sample_time=0.1)


def test_without_noise_the_transfer_function_is_exact_and_c_is_not_guessed():
    model = armax(record(noise=0.0), 2, 2, 2)
    np.testing.assert_allclose(model.theta, [*A[1:], *B[1:]], atol=1e-11)
    assert any("noise-free record: c is set to 1" in note for note in model.notes)
    np.testing.assert_array_equal(model.c, [1.0, 0.0, 0.0])


def test_c_of_order_zero_is_arx():
    rec = record()
    ours, least_squares = armax(rec, 2, 2, 0), arx(rec, 2, 2)
    np.testing.assert_allclose(ours.theta, least_squares.theta, rtol=1e-8)
    np.testing.assert_allclose(ours.cov_params, least_squares.cov_params, rtol=1e-6)


def test_moving_average_noise_bends_arx_and_not_armax():
    models = [(arx(rec, 2, 2), armax(rec, 2, 2, 2)) for rec in (record(seed=seed) for seed in range(30))]
    truth = np.array([*A[1:], *B[1:]])
    bent = np.mean([m.theta for m, _ in models], axis=0) - truth
    straight = np.mean([m.theta for _, m in models], axis=0) - truth
    assert np.abs(bent[:2]).min() > 0.04
    assert (np.abs(straight) < 3 / np.sqrt(30) * models[0][1].bse).all()
    np.testing.assert_allclose(np.mean([m.c for _, m in models], axis=0), C, atol=0.03)
    assert all(m.structure == "armax" and is_stable(m.c) for _, m in models)


@pytest.mark.parametrize("seed", range(3))
def test_as_statsmodels_where_a_is_one(seed):
    """y = b u + c e is a regression with moving-average errors: exact likelihood there, conditional here, 1/N apart."""
    u, y = signals(1000, seed, a=[1.0], b=[0.0, 0.5, 0.3], noise=1.0)
    ours = armax(Record(u=u, y=y, sample_time=0.1), 0, 2, 2)
    past = np.column_stack([u[1:-1], u[:-2]])
    theirs = SARIMAX(y[2:], exog=past, order=(0, 0, 2)).fit(disp=False, maxiter=200, factr=10, pgtol=1e-7)
    np.testing.assert_allclose(ours.theta, theirs.params[:2], atol=0.03 * ours.bse.max())
    np.testing.assert_allclose(ours.c[1:], theirs.params[2:4], atol=4e-3)
    np.testing.assert_allclose(ours.bse, theirs.bse[:2], rtol=0.05)
    assert ours.noise_variance == pytest.approx(theirs.params[4], rel=0.01)


def test_noise_polynomial_as_statsmodels_finds_it_in_the_equation_error():
    u, y = signals(1000, 7, noise=1.0)
    ours = armax(Record(u=u, y=y, sample_time=0.1), 2, 2, 2)
    equation_error = (lfilter(ours.a, [1.0], y) - lfilter(ours.b, [1.0], u))[2:]
    theirs = SARIMAX(equation_error, order=(0, 0, 2)).fit(disp=False, maxiter=200, factr=10, pgtol=1e-7)
    np.testing.assert_allclose(ours.c[1:], theirs.params[:2], atol=4e-3)


def test_standard_errors_are_those_of_a_monte_carlo():
    """200 draws tell a standard deviation to 5 % (one sigma): 15 % is three."""
    models = [armax(record(n=800, seed=seed), 2, 2, 2) for seed in range(200)]
    spread = np.std([m.theta for m in models], axis=0)
    reported = np.sqrt(np.mean([np.diag(m.cov_params) for m in models], axis=0))
    np.testing.assert_allclose(reported / spread, 1, atol=0.15)


def test_a_record_joined_to_itself_fits_the_same_with_smaller_errors():
    rec = record()
    once, twice = armax(rec, 2, 2, 2), armax(join_records([rec, rec]), 2, 2, 2)
    np.testing.assert_allclose(twice.theta, once.theta, rtol=1e-5)
    np.testing.assert_allclose(twice.bse / once.bse, np.sqrt((1498 - 6) / (2996 - 6)), rtol=1e-3)


def test_nothing_crosses_a_join():
    """The second run ends far from where the first begins; a regressor across the join would be an outlier of 50."""
    rec = record()
    far = replace(rec, y=rec.y + lfilter([1.0], A, np.eye(1, 1500)[0] * 100), sha256=None)
    model = armax([far.part(0, 700), rec.part(700, 1500)], 2, 2, 2)
    np.testing.assert_allclose(model.theta, [*A[1:], *B[1:]], atol=0.03)


@pytest.mark.parametrize(("of_u", "of_y"), [(1e-3, 1.0), (1.0, 1e4), (25.4, 0.0393)])
def test_units_scale_the_gain(of_u, of_y):
    u, y = signals()
    once, other = (armax(Record(u=u * p, y=y * q, sample_time=0.1), 2, 2, 2) for p, q in ((1, 1), (of_u, of_y)))
    np.testing.assert_allclose(other.b, once.b * of_y / of_u, rtol=1e-4)
    np.testing.assert_allclose(other.c, once.c, rtol=1e-4)


@pytest.mark.parametrize("shift", [1, 6])
def test_a_time_shift_shifts_nk(shift):
    u, y = signals()
    once = armax(Record(u=u[: 1500 - shift], y=y[: 1500 - shift], sample_time=0.1), 2, 2, 2)
    model = armax(Record(u=u, y=np.r_[np.zeros(shift), y[: 1500 - shift]], sample_time=0.1), 2, 2, 2, nk=1 + shift)
    # the zeros before the first answer are samples as well: theta agrees to a part of its standard error
    np.testing.assert_allclose(model.theta, once.theta, atol=0.1 * once.bse.max())


def test_an_unstable_free_run_is_reported():
    u = np.sign(np.random.default_rng(2).standard_normal(150))
    e = 0.01 * np.random.default_rng(3).standard_normal(150)
    y = lfilter([0, 0.1], [1, -1.02], u) + lfilter([1.0], [1, -1.02], e)
    model = armax(Record(u=u, y=y, sample_time=0.1), 1, 1, 1)
    assert not model.stable
    assert any("simulation is unstable" in note for note in model.notes)


@pytest.mark.parametrize(
    ("rec", "orders", "words"),
    [
        (record(), (2, 2, -1), "nc -1: a whole number, 0 or more"),
        (record(), (2, 0, 2), "nb 0: a whole number, 1 or more"),
        (record().part(0, 20), (2, 2, 2), "20 samples"),
        (record(noise=0.0), (5, 5, 2), "not identifiable"),
        (Record(u=np.ones(100), y=np.arange(100.0), sample_time=0.1), (1, 1, 1), "does not vary"),
    ],
    ids=["negative order", "no b", "short", "order too high", "input"],
)
def test_refusals_name_the_thing_and_the_cure(rec, orders, words):
    with pytest.raises(IdentError, match=words):
        armax(rec, *orders)
