"""R-hat, effective draws, Monte Carlo error and autocorrelation time, against ArviZ, emcee and known truth."""

import warnings

import numpy as np
import pytest
from fitmodels.core.errors import UsageError
from fitmodels.fit.bayes.density import Sample
from fitmodels.fit.bayes.diagnostics import (
    autocorrelation_time,
    diagnose,
    ess_bulk,
    ess_mean,
    ess_tail,
    mcse_mean,
    r_hat,
)
from hypothesis import given, settings
from hypothesis import strategies as st

SAME = 1e-10  # relative; the definitions are the same, only sums are taken in another order
FIGURES = {"r_hat": r_hat, "ess_bulk": ess_bulk, "ess_tail": ess_tail, "ess_mean": ess_mean, "mcse": mcse_mean}


@pytest.fixture(scope="module")
def arviz():
    """The same figures of one parameter's draws (chains, draws), by the ArviZ that is installed."""
    try:
        from arviz_stats.base import array_stats as stats
    except ImportError:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # once a day 0.23 announces the next line
            az = pytest.importorskip("arviz")
        ess = {"ess_bulk": "bulk", "ess_tail": "tail", "ess_mean": "mean"}
        return {
            "r_hat": az.rhat,
            "mcse": lambda x: az.mcse(x, method="mean"),
            **{name: lambda x, method=method: az.ess(x, method=method) for name, method in ess.items()},
        }
    return {
        "r_hat": stats.rhat,
        "ess_bulk": lambda x: stats.ess(x, method="bulk"),
        "ess_tail": lambda x: stats.ess(x, method="tail", prob=0.05),  # the 5 and 95 % quantiles, as in 0.23
        "ess_mean": lambda x: stats.ess(x, method="mean"),
        "mcse": lambda x: stats.mcse(x, method="mean"),
    }


def ar1(rho, chains, n, seed=1):
    """Chains of x' = rho x + sqrt(1 - rho^2) e, stationary standard normal."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, chains))
    for i in range(1, n):
        x[i] = rho * x[i - 1] + np.sqrt(1 - rho**2) * x[i]
    return x.T


KINDS = {
    "independent": ar1(0.0, 4, 1000),
    "slow": ar1(0.95, 4, 1000),
    "much too slow": ar1(0.999, 4, 500),
    "swinging": ar1(-0.7, 4, 400),
    "an odd number of draws": ar1(0.5, 3, 301),
    "many short chains": ar1(0.3, 32, 40),
    "as few draws as there may be": ar1(0.0, 4, 4),
    "heavy tails": np.tan(np.pi * (np.random.default_rng(2).random((4, 600)) - 0.5)),
    "one chain elsewhere": ar1(0.2, 4, 500) + np.array([[0], [0], [0], [1.5]]),
    "one chain wider": ar1(0.2, 4, 500) * np.array([[1], [1], [1], [4]]),
    "copies of draws, as resampling leaves": np.repeat(ar1(0.0, 4, 250), 3, axis=1),
    "figures of one digit": np.round(ar1(0.6, 4, 500), 1),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("figure", FIGURES)
def test_equals_arviz(arviz, kind, figure):
    draws = KINDS[kind]
    assert FIGURES[figure](draws)[0] == pytest.approx(float(arviz[figure](draws)), rel=SAME)


def test_parameters_side_by_side_are_judged_as_if_alone():
    draws = np.stack([ar1(rho, 4, 300, seed) for seed, rho in enumerate((0.0, 0.9, -0.5, 0.99))], axis=2)
    for figure in FIGURES.values():
        together = figure(draws)
        assert together.tolist() == pytest.approx([figure(draws[:, :, j])[0] for j in range(4)], rel=1e-12)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9, -0.5])
def test_effective_draws_of_an_autoregression_are_known(rho):
    """Autocorrelation time (1 + rho) / (1 - rho): the sum of rho^|k| over all lags."""
    draws = ar1(rho, 4, 50_000)
    assert ess_mean(draws)[0] == pytest.approx(draws.size * (1 - rho) / (1 + rho), rel=0.05)
    if rho >= 0:  # the window of Sokal closes at once on what swings from side to side
        walkers = ar1(rho, 20, 10_000).T[:, :, None]
        assert autocorrelation_time(walkers)[0] == pytest.approx((1 + rho) / (1 - rho), rel=0.05)


def test_autocorrelation_time_is_that_of_emcee():
    from emcee import autocorr

    chain = np.stack([ar1(rho, 24, 2000, seed).T for seed, rho in enumerate((0.0, 0.8, 0.97, -0.4))], axis=2)
    assert autocorrelation_time(chain).tolist() == pytest.approx(
        autocorr.integrated_time(chain, tol=0).tolist(), rel=SAME
    )
    odd = chain[:997]
    assert autocorrelation_time(odd).tolist() == pytest.approx(autocorr.integrated_time(odd, tol=0).tolist(), rel=SAME)


@pytest.mark.parametrize("value", [0.3, np.nan, np.inf])
def test_a_walker_that_never_moved_has_no_autocorrelation_time(value):
    chain = ar1(0.0, 8, 500).T[:, :, None].repeat(2, axis=2)
    chain[:, 3, 1] = value
    reported = autocorrelation_time(chain)
    assert np.isfinite(reported[0])
    assert reported[1] == np.inf


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-0.9, 0.9), st.sampled_from([np.exp, np.arctan, lambda x: x**3 + x]))
def test_ranks_alone_count_for_the_bulk(seed, rho, rising):
    """R-hat too, where it is the bulk that differs: the fold about the median knows distances, not ranks alone."""
    draws = ar1(rho, 4, 100, seed) / 4 + np.array([[0], [1], [2], [3]])
    assert ess_bulk(rising(draws)).tolist() == ess_bulk(draws).tolist()
    assert r_hat(rising(draws)).tolist() == r_hat(draws).tolist()
    assert ess_bulk(-draws)[0] == pytest.approx(ess_bulk(draws)[0], rel=1e-9)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-0.9, 0.9), st.sampled_from([-8.0, 0.25, 1024.0]))
def test_units_do_not_matter(seed, rho, scale):
    draws = ar1(rho, 4, 100, seed)  # scales are powers of two, which round nothing
    for figure in (r_hat, ess_bulk, ess_mean):
        assert figure(scale * draws)[0] == pytest.approx(figure(draws)[0], rel=1e-9)
    assert mcse_mean(scale * draws)[0] == pytest.approx(abs(scale) * mcse_mean(draws)[0], rel=1e-9)


def diagnosed(draws, chains=1, **facts):
    """Diagnostics of the draws (S, q)."""
    names = tuple("VfdtABCDEFGH"[: draws.shape[1]])
    return diagnose(names, draws, Sample(draws, chains, "exact", "drawn for a test", **facts))


def test_independent_draws_are_about_as_many_effective_ones():
    draws = np.random.default_rng(1).normal(size=(4000, 12))
    found = diagnosed(draws)
    assert (found.chains, found.length) == (4, 1000)
    assert (np.abs(found.ess_bulk / 4000 - 1) < 0.15).all()
    assert (np.abs(found.ess_tail / 4000 - 1) < 0.25).all()
    assert found.r_hat.max() < 1.005
    assert found.mcse == pytest.approx(draws.std(axis=0) / np.sqrt(4000), rel=0.1)
    assert (found.k_hat, found.tau, found.ess_route, found.notes) == (None, None, None, ())


def test_independent_draws_that_drift_are_found_out_by_their_pieces():
    draws = np.random.default_rng(1).normal(size=(4000, 1))
    draws[:, 0] += np.linspace(0, 1, 4000)
    assert diagnosed(draws).r_hat[0] > 1.01


def test_chains_stand_one_after_another():
    draws = np.stack([ar1(0.5, 4, 200), ar1(0.9, 4, 200, 2)], axis=2)
    found = diagnosed(draws.reshape(800, 2), chains=4)
    assert found.r_hat.tolist() == r_hat(draws).tolist()
    assert found.ess_bulk.tolist() == ess_bulk(draws).tolist()
    assert found.ess_tail.tolist() == ess_tail(draws).tolist()
    assert found.mcse.tolist() == mcse_mean(draws).tolist()


def test_facts_of_the_route_are_handed_on():
    tau = np.array([3.0])
    found = diagnosed(np.random.default_rng(1).normal(size=(400, 1)), k_hat=0.2, ess=350.0, tau=tau)
    assert (found.k_hat, found.ess_route) == (0.2, 350.0)
    assert found.tau is tau


@pytest.mark.parametrize(
    ("spoil", "note"),
    [
        (np.nan, "f: 1 of 400 draws are not finite numbers."),
        (-np.inf, "f: 1 of 400 draws are not finite numbers."),
        ("still", "f: all draws are 0.3: the chains are constant."),
        ("rounding", "f: all draws are 0.3: the chains are constant."),
    ],
)
def test_draws_that_cannot_be_judged_get_the_worst_answer_and_spare_the_others(spoil, note):
    draws = np.random.default_rng(1).normal(size=(400, 3))
    clean = diagnosed(draws)
    if isinstance(spoil, str):
        draws[:, 1] = 0.3
        draws[::2, 1] += 1e-17 if spoil == "still" else 5e-17  # the second is the next number there is
    else:
        draws[7, 1] = spoil
    found = diagnosed(draws)
    assert found.notes == (note,)
    assert (found.r_hat[1], found.ess_bulk[1], found.ess_tail[1], found.mcse[1]) == (np.inf, 0, 0, np.inf)
    for figure in ("r_hat", "ess_bulk", "ess_tail", "mcse"):
        assert getattr(found, figure)[[0, 2]].tolist() == getattr(clean, figure)[[0, 2]].tolist()


def test_one_chain_that_never_moved_shows():
    draws = ar1(0.0, 4, 500)
    draws[2] = 0.1
    assert r_hat(draws)[0] > 1.5


def test_two_values_only_have_no_tails_to_speak_of():
    """Every draw is at or below the 95 % quantile: ArviZ says all are effective, here none is."""
    draws = np.random.default_rng(1).integers(0, 2, (4, 500)).astype(float)
    assert ess_tail(draws)[0] == 0
    assert r_hat(draws)[0] < 1.01


def test_chains_too_short_to_judge():
    found = diagnosed(np.random.default_rng(1).normal(size=(12, 2)), chains=4)
    assert found.r_hat.tolist() == [np.inf, np.inf]
    assert found.ess_bulk.tolist() == found.ess_tail.tolist() == [0, 0]
    assert found.notes == ("4 chains of 3 draws are too short to assess: draw more than 400 in all.",)
    with pytest.raises(UsageError, match="chains of 3 draws: at least 4"):
        r_hat(np.zeros((4, 3)))


def test_chains_of_unequal_length_or_missing_names_are_refused():
    draws = np.zeros((10, 2))
    with pytest.raises(UsageError, match="4 equal chains"):
        diagnosed(draws, chains=4)
    with pytest.raises(UsageError, match="2 names, not 1"):
        diagnose(("V",), draws, Sample(draws, 1, "exact", ""))
