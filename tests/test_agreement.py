"""Two routes agree when their draws could be of one posterior, and not when they could not."""

import numpy as np
import pytest
from fitmodels.fit.bayes.convergence import FIGURES, _compared, compare_draws
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

pytestmark = pytest.mark.slow  # left out where other versions of Python are tried

NAMES = ("c0", "V", "f")


def draws(seed, n=4000, q=3):
    return np.random.default_rng(seed).normal(size=(n, q))


def walk(seed, n=20_000, rho=0.9, chains=4):
    """Chains of a first-order autoregression about 0 with sd 1: 19 draws to an effective one, 1050 of them in all."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n // chains, chains, 3))
    for i in range(1, len(x)):
        x[i] = rho * x[i - 1] + np.sqrt(1 - rho**2) * x[i]
    return x.swapaxes(0, 1).reshape(-1, 3)


@pytest.mark.parametrize("seed", range(10))
def test_draws_of_one_posterior_agree(seed):
    told = compare_draws((draws(seed), 1), (walk(100 + seed), 4), NAMES)
    assert told.agrees, told.words
    assert told.errors < 5


@pytest.mark.parametrize(
    ("change", "name", "figures"),
    [
        (lambda x: x + np.array([0, 0.2, 0]), "V", ("mean", "50 % quantile", "5 % quantile", "95 % quantile")),
        (lambda x: x * [1, 1, 1.2], "f", ("standard deviation", "5 % quantile", "95 % quantile")),
        (lambda x: np.where(x > 1, [1.0, 9.0, 1.0] * x, x), "V", FIGURES),
    ],
    ids=["a mean off by a fifth of a standard deviation", "a fifth too wide", "one tail stretched"],
)
def test_a_difference_is_found_and_named(change, name, figures):
    told = compare_draws((draws(1), 1), (change(draws(2)), 1), NAMES)
    assert not told.agrees
    assert told.name == name
    assert told.figure in figures
    assert abs(told.difference) > told.allowed
    assert f"of {name} differs most" in told.words


def test_other_tails_behind_the_same_mean_and_sd_are_found():
    """Student's t with 3 degrees of freedom, scaled to sd 1, has its 95 % quantile at 1.36 instead of 1.64."""
    t = np.random.default_rng(3).standard_t(3, size=(40_000, 3)) / np.sqrt(3)
    told = compare_draws((draws(1, 40_000), 1), (t, 1), NAMES)
    assert not told.agrees
    assert "quantile" in told.figure


def test_what_does_not_matter_is_no_disagreement_however_many_draws():
    many = draws(1, 400_000, 1)
    told = compare_draws((many, 1), (many + 0.015, 1), ("V",))
    assert told.agrees
    assert told.errors > 5
    assert not compare_draws((many, 1), (many + 0.05, 1), ("V",)).agrees


def test_draws_that_follow_from_each_other_may_differ_by_more():
    """A shift of 0.06 sd is 6 errors of two sets of 20 000 independent draws, and 2 where one set is worth 1050."""
    shift = np.array([0, 0.06, 0])
    assert not compare_draws((draws(1, 20_000), 1), (draws(2, 20_000) + shift, 1), NAMES).agrees
    assert compare_draws((draws(1, 20_000), 1), (walk(2) + shift, 4), NAMES).agrees


def test_copies_side_by_side_count_as_one_draw():
    told = compare_draws((np.repeat(draws(1, 1000), 8, axis=0), 1), (draws(2) + np.array([0, 0.12, 0]), 1), NAMES)
    assert told.agrees


def test_errors_are_those_of_large_samples():
    """Serfling 1980, Approximation Theorems of Mathematical Statistics, 2.2.1 and 2.3.3: over 300 pairs of samples."""
    n = 2000
    tail = np.sqrt(0.05 * 0.95) / norm.pdf(norm.ppf(0.05))
    expected = np.array([1.0, np.sqrt(0.5), tail, 0.5 / norm.pdf(0), tail]) * np.sqrt(2 / n)
    pairs = [_compared((draws(s, n), 1), (draws(900 + s, n), 1)) for s in range(300)]
    differences, in_errors, _ = (np.array(each) for each in zip(*pairs, strict=True))
    np.testing.assert_allclose(differences.std(axis=(0, 2)), expected, rtol=0.1)
    np.testing.assert_allclose(np.sqrt((in_errors**2).mean(axis=(0, 2))), 1.0, rtol=0.1)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 0.0], ids=["not a number", "infinite", "standing still"])
@pytest.mark.parametrize("swap", [False, True])
def test_draws_that_cannot_be_judged_never_agree(bad, swap):
    spoilt = draws(2)
    spoilt[:, 1] = bad
    a, b = ((spoilt, 1), (draws(1), 1)) if swap else ((draws(1), 1), (spoilt, 1))
    told = compare_draws(a, b, NAMES)
    assert not told.agrees
    assert "draws of V are constant or not finite" in told.words


def test_an_interrupted_route_verifies_nothing():
    told = compare_draws((draws(1), 1), (draws(2), 1), NAMES, interrupted=True)
    assert not told.agrees
    assert "interrupted" in told.words


@settings(max_examples=20, deadline=None)
@given(st.floats(1e-3, 1e3), st.floats(-1e3, 1e3), st.floats(-0.3, 0.3))
def test_units_do_not_matter_nor_which_comes_first(scale, shift, apart):
    a, b = draws(1), draws(2) + apart
    told = compare_draws((a, 1), (b, 1), NAMES)
    scaled = compare_draws((a * scale + shift, 1), (b * scale + shift, 1), NAMES)
    back = compare_draws((b, 1), (a, 1), NAMES)
    assert told.agrees == scaled.agrees == back.agrees
    assert (told.name, told.figure) == (scaled.name, scaled.figure) == (back.name, back.figure)
    np.testing.assert_allclose([scaled.difference, -back.difference], told.difference, rtol=1e-6, atol=1e-9)
