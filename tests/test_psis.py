"""Smoothed importance weights, against ArviZ, the R package loo, and tails of known shape."""

import math
import warnings

import numpy as np
import pytest
from fitmodels.core.errors import FitError
from fitmodels.fit.bayes.psis_loo import effective, pareto_fit, pareto_smoothed, resample, smoothed_columns, tail_length
from hypothesis import given, settings
from hypothesis import strategies as st

SAME = 1e-10


@pytest.fixture(scope="module")
def psislw():
    """Smoothed log weights and k-hat of log weights (G, S), by the ArviZ that is installed."""
    try:
        from arviz_stats.base import array_stats as stats
    except ImportError:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # once a day 0.23 announces the next line
            return pytest.importorskip("arviz").psislw
    return lambda log_weights: stats.psislw(-log_weights)  # this line takes the log likelihood instead


def raw(S, G=3, tail=4.0, seed=1):
    """Log weights with Student tails, (G, S)."""
    return np.random.default_rng(seed).standard_t(tail, size=(G, S))


# The tail has ceil(min(S/5, 3 sqrt(S))) draws, as in the R packages and ArviZ 0.23; arviz-stats rounds down, so that
# only numbers of draws at which that is whole can be compared with both. Heavier tails overflow in ArviZ.
@pytest.mark.parametrize("S", [30, 100, 225, 400, 900, 2500, 10_000])
@pytest.mark.parametrize("tail", [4.0, 8.0, 50.0])
def test_equals_arviz(psislw, S, tail):
    log_weights = raw(S, tail=tail)
    theirs, k = psislw(log_weights.copy())
    ours, k_hat = smoothed_columns(log_weights.T)
    assert np.abs(ours.T - theirs).max() < SAME
    assert np.abs(k_hat - k).max() < SAME


def test_equals_arviz_where_most_weights_are_zero(psislw):
    log_weights = raw(400)
    log_weights[:, ::3] = -1000.0  # e^-1000 is 0 in double precision
    theirs, k = psislw(log_weights.copy())
    ours, k_hat = smoothed_columns(log_weights.T)
    assert np.abs(np.exp(ours.T) - np.exp(theirs)).max() < SAME
    assert np.abs(k_hat - k).max() < SAME
    log_weights[:, ::3] = -np.inf
    again, k_again = smoothed_columns(log_weights.T)
    assert k_again.tolist() == k_hat.tolist()
    assert np.exp(again).tolist() == np.exp(ours).tolist()


def rexp(n, seed):
    """What R draws by ``set.seed(seed); rexp(n)``.

    Mersenne twister seeded by R's congruential scrambling, and Ahrens & Dieter 1972, Commun. ACM 15, 873, algorithm SA.
    """
    state = seed
    for _ in range(50):
        state = (69069 * state + 1) % 2**32
    key = [state := (69069 * state + 1) % 2**32 for _ in range(625)][1:]
    twister = np.random.RandomState()
    twister.set_state(("MT19937", np.array(key, dtype=np.uint32), 624))
    u = iter(twister.randint(0, 2**32, size=20 * n, dtype=np.uint32) / 2**32)
    q = np.cumsum([math.log(2) ** k / math.factorial(k) for k in range(1, 17)])
    return np.array([_exponential(u, q) for _ in range(n)])


def _exponential(u, q):
    doubled, whole = 2 * next(u), 0.0
    while doubled <= 1:
        doubled, whole = 2 * doubled, whole + q[0]
    rest = doubled - 1
    if rest <= q[0]:
        return whole + rest
    least, i = next(u), 0
    while True:
        least, i = min(least, next(u)), i + 1
        if rest <= q[i]:
            return whole + least * q[0]


def test_equals_the_r_package_loo():
    """Its own test "gpdfit returns correct result": set.seed(123); gpdfit(rexp(100)), k and sigma.

    github.com/stan-dev/loo, tests/testthat/test_gpdfit.R; the doubles 3fb2039054945ac7 and 3ff04af287b14952 of the last
    value in tests/testthat/_snaps/gpdfit.md, which is with the prior on k and the grid of 30 + sqrt(n) points.
    """
    x = rexp(100, 123)
    assert x[:4] == pytest.approx([0.84345726, 0.57661027, 1.32905487, 0.03157736], abs=5e-9)  # as R prints them
    assert pareto_fit(np.sort(x)) == pytest.approx((0.07036687912873694, 1.0182977009286174), rel=1e-9)


@pytest.mark.parametrize("k", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_finds_the_shape_of_a_known_tail(k):
    """Target an exponential of rate 1, proposal of rate 1 / (1 - k): weights are Pareto of shape k, exactly."""
    x = np.random.default_rng(1).exponential(1 - k, size=400_000)
    _, k_hat = pareto_smoothed(x * k / (1 - k))
    assert k_hat == pytest.approx(k, abs=0.06)


def test_smoothing_makes_a_mean_less_noisy():
    """Mean 1 of an exponential, from a proposal of rate 5/2 (k 0.6), 200 times."""
    rng = np.random.default_rng(1)
    plain, smooth = [], []
    for _ in range(200):
        x = rng.exponential(0.4, size=1000)
        log_weights = 1.5 * x
        weights = np.exp(log_weights - log_weights.max())
        plain.append(weights @ x / weights.sum())
        smooth.append(np.exp(pareto_smoothed(log_weights)[0]) @ x)
    error = [np.sqrt(np.mean((np.array(found) - 1) ** 2)) for found in (plain, smooth)]
    assert error[1] < error[0]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 600), st.floats(0.01, 20), st.floats(-700, 700))
def test_smoothed_weights_sum_to_one_keep_their_order_and_exceed_no_raw_one(seed, S, width, shift):
    log_weights = np.random.default_rng(seed).normal(0, width, S)
    smoothed, k_hat = pareto_smoothed(log_weights)
    assert np.exp(smoothed).sum() == pytest.approx(1, rel=1e-12)
    order = np.argsort(log_weights)
    assert (np.diff(smoothed[order]) >= -1e-12).all()
    body = order[: max(S - tail_length(S), 1)]
    constant = (smoothed - log_weights)[body]
    assert np.ptp(constant) < 1e-9  # the body keeps its weights
    assert smoothed.max() - constant[0] <= log_weights.max() + 1e-9
    again, k_again = pareto_smoothed(log_weights + shift)
    assert np.abs(again - smoothed).max() < 1e-6
    assert k_again == pytest.approx(k_hat, abs=1e-6)


def test_the_caller_keeps_its_weights():
    log_weights = raw(400)[0]
    kept = log_weights.copy()
    pareto_smoothed(log_weights)
    assert log_weights.tolist() == kept.tolist()


@pytest.mark.parametrize("rounding", [0.0, 1e-14])
def test_equal_weights_have_no_tail_at_all(rounding):
    log_weights = np.full(1000, -3.0)
    log_weights[::7] += rounding
    smoothed, k_hat = pareto_smoothed(log_weights)
    assert k_hat == -np.inf
    assert smoothed.tolist() == [-math.log(1000)] * 1000


@pytest.mark.parametrize(
    "log_weights",
    [
        np.array([0.0, -1.0, 2.0]),
        raw(25)[0],
        np.repeat([0.0, 1.0], [900, 100]),
        np.r_[np.zeros(5), np.full(995, -np.inf)],
    ],
    ids=["three draws", "a tail of five", "a tail of copies", "five draws with any weight"],
)
def test_no_shape_is_never_a_good_shape(log_weights):
    smoothed, k_hat = pareto_smoothed(log_weights)
    assert k_hat == np.inf
    assert np.exp(smoothed) == pytest.approx(np.exp(log_weights) / np.exp(log_weights).sum(), rel=1e-12)


@pytest.mark.parametrize(
    ("log_weights", "sentence"),
    [
        ([0.0, np.nan, 1.0], "log weight of draw 2 is nan, and 1 of 3 are like it"),
        ([0.0, 1.0, np.inf], "log weight of draw 3 is inf"),
        ([-np.inf, -np.inf], "all 2 draws have weight zero"),
        ([], "no draws, so no weights"),
    ],
)
def test_weights_that_cannot_be_are_reported_in_a_sentence(log_weights, sentence):
    with pytest.raises(FitError, match=sentence):
        pareto_smoothed(np.array(log_weights))


@pytest.mark.parametrize(("S", "M"), [(25, 5), (224, 45), (225, 45), (4000, 190), (10_000, 300)])
def test_length_of_the_tail(S, M):
    assert tail_length(S) == M


def test_draws_of_chains_smooth_a_longer_tail():
    assert tail_length(4000, efficiency=0.25) == 380


def test_effective_draws_of_weights():
    """Equal weights: all; one weight: one; in between sum(w)^2 / sum(w^2), whatever their scale."""
    assert effective(np.full(50, -1e4)) == pytest.approx(50)
    assert effective(np.array([0.0, -1e4, -np.inf])) == pytest.approx(1)
    assert effective(np.log([1.0, 2.0, 3.0])) == pytest.approx(36 / 14)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 50), st.integers(1, 300))
def test_resampling_takes_each_draw_its_share_of_times_or_once_more(seed, S, n):
    rng = np.random.default_rng(seed)
    weights = rng.exponential(size=S) * (rng.random(S) < 0.7)
    weights[rng.integers(S)] += 1e-3
    taken = resample(rng, weights, n)
    times, share = np.bincount(taken, minlength=S), n * weights / weights.sum()
    assert len(taken) == n
    assert (np.diff(taken) >= 0).all()
    assert (times[weights == 0] == 0).all()
    assert (np.abs(times - share) < 1 + 1e-9).all()


def test_resampling_is_fair():
    """Over many goes each draw is taken as often as its weight says, to four standard errors."""
    weights = np.array([0.5, 0.02, 0.18, 0.3])
    rng = np.random.default_rng(1)
    times = np.array([np.bincount(resample(rng, weights, 3), minlength=4) for _ in range(4000)])
    error = times.std(axis=0) / math.sqrt(4000)
    assert (np.abs(times.mean(axis=0) - 3 * weights) < 4 * error).all()
